"""The lines of docs/realsense.md and docs/zed.md for cameras with an SDK.

librealsense plays a recording; the SDK of ZED is in no registry, so a stand-in delivers its views.
OAK has its own tests.
"""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from support import librealsense
from support.documentation import example

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

RNG = np.random.default_rng(0)


def test_realsense(tmp_path: Path) -> None:
    scene = RNG.integers(0, 256, (480, 848 + 20), np.uint8)
    path = librealsense.record(scene, tmp_path / "a.db3")
    assert librealsense.play(path) == [[480, 848, 20]] * 2


def test_zed(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes = dict(
        zip(("left", "right"), RNG.integers(0, 256, (2, 64, 96, 4), np.uint8), strict=True)
    )

    class Mat:
        """A picture that is filled by the camera."""

        data: Any = None

        def get_data(self) -> Any:
            """Return the picture, BGRA."""
            return self.data

    def retrieve(mat: Mat, view: str) -> None:
        mat.data = scenes[view]

    sl: Any = ModuleType("pyzed.sl")
    camera = SimpleNamespace(open=id, grab=lambda: None, retrieve_image=retrieve)
    sl.Camera, sl.Mat, sl.InitParameters = lambda: camera, Mat, object
    sl.VIEW = SimpleNamespace(LEFT="left", RIGHT="right")
    package: Any = ModuleType("pyzed")
    package.sl = sl
    monkeypatch.setitem(sys.modules, "pyzed", package)
    monkeypatch.setitem(sys.modules, "pyzed.sl", sl)

    names: dict[str, Any] = {}
    exec(example("docs/zed.md", "pyzed"), names)  # noqa: S102 - our own example
    for view, image in zip(names["pair"], scenes.values(), strict=True):
        np.testing.assert_array_equal(view, image[:, :, [2, 1, 0]])

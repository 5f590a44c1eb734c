"""The lines of docs/cameras.md for cameras with an SDK, run on stand-ins of what these deliver."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

import phasestereo_live as live
from support import ROOT
from support.documentation import blocks

if TYPE_CHECKING:
    import pytest

SCENE = np.random.default_rng(0).integers(0, 256, (64, 101, 4), np.uint8)
LEFT, RIGHT = np.ascontiguousarray(SCENE[:, :-5]), np.ascontiguousarray(SCENE[:, 5:])
ASKED = 100  # frames


def example(name: str) -> str:
    """Return the block of the page that imports a module."""
    found = [block.text for block in blocks(ROOT / "docs/cameras.md", "python")]
    (text,) = (text for text in found if f"import {name}" in text and "StereoPhase" not in text)
    return text


def run(monkeypatch: pytest.MonkeyPatch, name: str, **contents: Any) -> dict[str, Any]:
    """Run the block with a module that has such contents."""
    parts = name.split(".")

    for depth in range(1, len(parts) + 1):
        module = ModuleType(".".join(parts[:depth]))
        monkeypatch.setitem(sys.modules, module.__name__, module)

    vars(module).update(contents)
    if len(parts) > 1:
        setattr(sys.modules[parts[0]], parts[1], module)

    names: dict[str, Any] = {"np": np}
    exec(example(parts[0]), names)  # noqa: S102 - our own example
    return names


def test_realsense(monkeypatch: pytest.MonkeyPatch) -> None:
    enabled: list[tuple[Any, ...]] = []

    def infrared(side: int) -> Any:
        view = (LEFT, RIGHT)[side - 1][:, :, 0]
        return SimpleNamespace(get_data=lambda: np.ascontiguousarray(view))

    frames = SimpleNamespace(get_infrared_frame=infrared)
    names = run(
        monkeypatch,
        "pyrealsense2",
        pipeline=lambda: SimpleNamespace(start=enabled.append, wait_for_frames=lambda: frames),
        config=lambda: SimpleNamespace(enable_stream=lambda *arguments: enabled.append(arguments)),
        stream=SimpleNamespace(infrared="infrared"),
        format=SimpleNamespace(y8="y8"),
    )

    assert enabled[:2] == [("infrared", side, 848, 480, "y8", 30) for side in (1, 2)]
    check(names["pairs"], gray=True)


class Pipeline:
    """What DepthAI's pipeline is to the example."""

    def __enter__(self) -> Pipeline:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""

    def create(self, kind: str) -> Any:
        """Return a node with two outputs."""
        assert kind == "StereoDepth"

        def output(view: Any) -> Any:
            frame = SimpleNamespace(getCvFrame=lambda: np.ascontiguousarray(view[:, :, 0]))
            return SimpleNamespace(createOutputQueue=lambda: SimpleNamespace(get=lambda: frame))

        node = SimpleNamespace(rectifiedLeft=output(LEFT), rectifiedRight=output(RIGHT))
        return SimpleNamespace(build=lambda *, autoCreateCameras: autoCreateCameras and node)  # noqa: N803

    def start(self) -> None:
        """Begin."""


def test_oak(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = SimpleNamespace(StereoDepth="StereoDepth")
    check(run(monkeypatch, "depthai", Pipeline=Pipeline, node=kinds)["pairs"], gray=True)


def test_zed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Mat:
        """A picture that is filled by the camera."""

        data: Any = None

        def get_data(self) -> Any:
            """Return the picture, BGRA."""
            return self.data

    def retrieve(mat: Mat, view: str) -> None:
        mat.data = {"left": LEFT, "right": RIGHT}[view]

    camera = SimpleNamespace(open=id, grab=lambda: None, retrieve_image=retrieve)

    names = run(
        monkeypatch,
        "pyzed.sl",
        Camera=lambda: camera,
        Mat=Mat,
        InitParameters=object,
        VIEW=SimpleNamespace(LEFT="left", RIGHT="right"),
    )

    check([names["pair"]] * ASKED, gray=False)
    np.testing.assert_array_equal(names["pair"][0], LEFT[:, :, [2, 1, 0]])


def check(pairs: Any, *, gray: bool) -> None:
    """Match what an example delivers."""
    frames = list(live.stream(pairs, num_disparities=16, preset="fast"))
    assert len(frames) == ASKED
    assert frames[0].left.shape == ((64, 96) if gray else (64, 96, 3))
    assert np.median(frames[-1].result.disparity) == 5

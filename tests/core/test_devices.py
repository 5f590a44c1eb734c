"""Devices that search: which one is meant, what is refused, and one that fails."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from support import ENVIRONMENT

TEXTURE = np.random.default_rng(5).integers(0, 256, (70, 110), np.uint8)
PAIR = TEXTURE[:, :104], TEXTURE[:, 6:]
COUNT = 16
SAYS = "the GPU failed, and the processor took over, with the same result: "


class Stand:
    """A device with an answer of its own, which counts how often it is asked."""

    name = "a stand of tests"
    limits = 256, 1 << 27, 1 << 27

    def __init__(self, answer: Callable[..., object]) -> None:
        self.answer = answer
        self.asked = 0

    def search(self, numbers: list[int], left: bytes, right: bytes, pixels: bytes) -> object:
        self.asked += 1
        assert len(numbers) == 20
        assert len(left) >= numbers[0] * numbers[1] * numbers[3]
        assert len(right) >= numbers[1] * numbers[3] * numbers[4]
        assert len(pixels) >= numbers[0] * numbers[1]
        return self.answer(numbers)


def install(monkeypatch: pytest.MonkeyPatch, opened: Callable[[str | None], object]) -> None:
    """Have `phasestereo_gpu` open what a function returns."""
    monkeypatch.setitem(sys.modules, "phasestereo_gpu", SimpleNamespace(Gpu=opened))


def lost(_: object) -> object:
    raise RuntimeError("device lost: unplugged")


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (lost, "RuntimeError: device lost: unplugged"),
        (lambda _: b"12345678", "2 words instead of "),
        (lambda _: "none", "TypeError: "),
    ],
)
@pytest.mark.parametrize("preset", ["fast", "robust"])
def test_a_device_that_fails_leaves_the_bits_and_a_note(
    answer: Callable[..., object], reason: str, preset: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = Stand(answer)
    install(monkeypatch, lambda _: stand)
    expected = ps.match(*PAIR, num_disparities=COUNT, preset=preset)
    matcher = ps.Matcher(preset=preset, device="gpu")
    assert matcher.device == stand.name

    for _ in range(2):  # it is not asked again, and still reported
        found = matcher.match(*PAIR, num_disparities=COUNT)
        assert stand.asked == 1
        for name, values in expected.maps.items():
            np.testing.assert_array_equal(found.maps[name], values)
        notes = [one for one in found.findings if one.sentence.startswith(SAYS + reason)]
        assert [(one.topic, one.severity) for one in notes] == [("match", "note")]

    rig = ps.Rig(preset=preset, num_disparities=COUNT, device="gpu")
    assert rig.match(*PAIR).findings != expected.findings
    once = ps.match(*PAIR, num_disparities=COUNT, preset=preset, device="gpu")
    assert any(one.sentence.startswith(SAYS) for one in once.findings)
    assert stand.asked == 3


@pytest.mark.parametrize(
    "given",
    [
        {"preset": "fast", "left_mask": TEXTURE[:, :104] > 3},
        {"preset": "fast", "optimizer": "dp"},
        {"preset": "paper"},
    ],
)
def test_what_a_device_is_not_asked_for_is_matched(
    given: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = Stand(lost)
    install(monkeypatch, lambda _: stand)
    found = ps.match(*PAIR, device="gpu", num_disparities=COUNT, **given)
    expected = ps.match(*PAIR, num_disparities=COUNT, **given)
    np.testing.assert_array_equal(found.disparity, expected.disparity)
    assert found.findings == expected.findings
    assert stand.asked == 0


def test_a_name_is_handed_over_and_kept_by_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str | None] = []

    def opened(name: str | None) -> object:
        names.append(name)
        return Stand(lost)

    install(monkeypatch, opened)
    for device in ("auto", "gpu", "RTX"):
        pickle.loads(pickle.dumps(ps.Matcher(device=device)))  # noqa: S301 -- our own
        pickle.loads(pickle.dumps(ps.Rig(device=device)))  # noqa: S301
    assert names == [*[None] * 8, *["RTX"] * 4]


def test_what_cannot_be_opened_is_refused_but_by_auto(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(name: str | None) -> object:
        raise ValueError(f"device: got {name}; accepts an adapter")

    install(monkeypatch, opened)
    assert ps.Matcher(device="auto").device == ps.Matcher().device == "cpu"
    with pytest.raises(ValueError, match="^device: got RTX; accepts an adapter$"):
        ps.match(*PAIR, device="RTX")

    monkeypatch.setitem(sys.modules, "phasestereo_gpu", None)
    assert ps.Matcher(device="auto").device == "cpu"
    for device in ("gpu", "RTX"):
        with pytest.raises(ImportError, match=r"pip install 'phasestereo\[gpu\]'$"):
            ps.Rig(device=device)


@pytest.mark.parametrize(("device", "error"), [(3, TypeError), (None, TypeError), ("", ValueError)])
def test_a_device_is_a_name(device: Any, error: type[Exception]) -> None:
    accepts = "accepts 'auto', 'cpu', 'gpu' or a part of the name of an adapter$"
    for call in (ps.Matcher, ps.Rig, lambda device: ps.match(*PAIR, device=device)):
        with pytest.raises(error, match=f"^device: got .*; {accepts}"):
            call(device=device)


def test_a_match_without_a_device_loads_no_engine() -> None:
    program = (
        "import sys, numpy as np, phasestereo as ps\n"
        "ps.Matcher().match(*np.zeros((2, 40, 60), np.uint8), num_disparities=8)\n"
        "sys.exit('phasestereo_gpu' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], check=False, env=ENVIRONMENT)  # noqa: S603
    assert done.returncode == 0

"""The diagnosis: every fault is named, in words and numbers, and sound pairs are not accused."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.rig.diagnosis import Diagnosis, check
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene
from support.warping import moved

Pair = tuple[NDArray[Any], NDArray[Any]]

SCENES = "tsukuba", "Aloe"
ORDER = "ok", "note", "warning"

FAULTS: dict[str, tuple[str, str, Callable[[Any, Any], tuple[Any, Any]]]] = {
    "swapped": ("swap", "warning", lambda left, right: (right, left)),
    "half a pixel": ("alignment", "note", lambda left, right: (left, moved(right, down=0.5))),
    "two pixels": ("alignment", "warning", lambda left, right: (left, moved(right, down=-2))),
    "one degree": ("alignment", "warning", lambda left, right: (moved(left, clockwise=1), right)),
}


def pair(shape: tuple[int, ...] = (80, 120)) -> Pair:
    """Return a pair, everywhere at disparity 6."""
    scene = np.random.default_rng(0).integers(0, 256, (shape[0], shape[1] + 6), dtype=np.uint8)
    return scene[:, :-6], scene[:, 6:]


def severities(diagnosis: Diagnosis) -> dict[str, str]:
    """Return the worst severity of each topic."""
    worst: dict[str, str] = {}
    for found in diagnosis.findings:
        before = worst.get(found.topic, "ok")
        worst[found.topic] = max(before, found.severity, key=ORDER.index)
    return worst


def sentence(diagnosis: Diagnosis, topic: str) -> str:
    return " ".join(found.sentence for found in diagnosis.findings if found.topic == topic)


def test_sound_pairs_are_not_accused(data: Path) -> None:
    for name in SCENES:
        scene = find_scene(data / "middlebury", name).load()
        found = check(scene.left, scene.right)
        assert set(severities(found).values()) == {"ok"}, f"{name}: {found}"


@pytest.mark.parametrize("fault", FAULTS)
def test_injected_faults_are_found_and_nothing_else(data: Path, fault: str) -> None:
    topic, severity, spoil = FAULTS[fault]
    for name in SCENES:
        scene = find_scene(data / "middlebury", name).load()
        found = severities(check(*spoil(scene.left, scene.right)))
        assert found.pop(topic) == severity, name
        assert set(found.values()) == {"ok"}, name


def test_real_blur_and_exposure_are_found(data: Path) -> None:
    defocus = degradation.Degradation(degradation.disk_psf(3), gain=0.6, noise=1)
    for name in SCENES:
        scene = find_scene(data / "middlebury", name).load()

        found = check(defocus(scene.left), scene.right)
        assert severities(found)["blur"] == "warning", name
        assert "the left image is softer than the right by a disk" in sentence(found, "blur"), name
        assert "the left image is darker" in sentence(found, "contrast"), name
        assert severities(found)["swap"] == severities(found)["alignment"] == "ok", name


def test_unrelated_images_are_recognized(data: Path) -> None:
    left, right = (find_scene(data / "middlebury", name).load() for name in ("Art", "Moebius"))
    found = check(left.left, right.right)
    assert "these are not a pair" in sentence(found, "match")
    assert "above 75 % of the width: give such disparities" in sentence(found, "match")
    assert severities(found)["match"] == "warning"
    with pytest.warns(ps.MatchWarning, match="these are not a pair, or far from rectified"):
        ps.match(left.left, right.right, num_disparities=64)
    assert "too little in common" in sentence(found, "contrast")
    assert "too little in common" in sentence(found, "blur")


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (47, 300), (300, 5)])
def test_small_images_are_too_small_to_tell(size: tuple[int, int]) -> None:
    found = check(*pair(size))
    assert "too small to measure" in sentence(found, "alignment")
    assert "too small to measure" in sentence(found, "blur")
    assert "warning" not in severities(found).values()
    json.dumps(found.as_dict(), allow_nan=False)


@pytest.mark.parametrize("size", [(48, 48), (49, 1500), (900, 50)])
def test_long_images_have_a_range_too(size: tuple[int, int]) -> None:
    found = check(*pair(size)).search
    assert found.min_disparity <= 6 < found.min_disparity + found.num_disparities <= 24


@pytest.mark.parametrize("levels", [(0, 0), (255, 255), (7, 80)])
def test_uniform_images_have_too_little_texture(levels: tuple[int, int]) -> None:
    left, right = (np.full((90, 90, 3), level, np.uint8) for level in levels)
    found = check(left, right)
    for topic in ("range", "alignment", "blur", "contrast", "noise"):
        assert "too little texture to measure" in sentence(found, topic)


def test_dict_is_json_and_holds_what_was_found() -> None:
    found = check(*pair())

    said = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert (said["width"], said["height"]) == (120, 80)
    assert said["search"]["min_disparity"] <= 6
    assert not said["search"]["swapped"]
    assert said["alignment"]["vertical"] == pytest.approx(0, abs=0.05)

    assert said["blur"]["blurs"] == found.blur.as_dicts()
    assert said["blur"]["labels"] == found.blur.labels.tolist()
    assert said["contrast"] == asdict(found.contrast)
    assert said["noise"] == dict(zip(("left", "right"), found.blur.noise, strict=True))
    assert len(said["findings"]) == len(found.findings)


@pytest.mark.parametrize(
    ("left", "right", "error", "message"),
    [
        (None, np.zeros((60, 60), np.uint8), TypeError, "left: "),
        (np.zeros((60, 60), np.int32), np.zeros((60, 60), np.int32), TypeError, "left: got dtype"),
        (np.zeros((60, 60)), np.zeros((60, 7)), ValueError, "right: got 60 x 7 .* up to 8 times"),
        (np.zeros((0, 60)), np.zeros((0, 60)), ValueError, "left: got shape"),
        (np.zeros((60, 60)), np.full((60, 60), np.inf), ValueError, "right: got inf.* at row 0"),
    ],
)
def test_refusals_name_the_argument(
    left: Any, right: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        check(left, right)

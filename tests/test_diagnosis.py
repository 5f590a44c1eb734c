"""The diagnosis: every fault is named, in words and numbers, and sound pairs are not accused."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.diagnosis import Diagnosis, check
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene
from warping import moved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    Pair = tuple[NDArray[Any], NDArray[Any]]

NO_BLUR = Blur(side="none", kind="none", size=0.0, angle=0.0)
SCENES = "tsukuba", "Aloe"
ORDER = "ok", "note", "warning"

FAULTS: dict[str, tuple[str, str, Callable[[Any, Any], tuple[Any, Any]]]] = {
    "swapped": ("swap", "warning", lambda left, right: (right, left)),
    "half a pixel": ("alignment", "note", lambda left, right: (left, moved(right, down=0.5))),
    "two pixels": ("alignment", "warning", lambda left, right: (left, moved(right, down=-2))),
    "one degree": ("alignment", "warning", lambda left, right: (moved(left, clockwise=1), right)),
}


def estimate(*blurs: Blur, **changes: Any) -> BlurEstimate:
    """Return what a blur estimate may look like: the blurs take a column of tiles each."""
    fields: dict[str, Any] = {
        "blurs": blurs or (NO_BLUR,),
        "labels": np.tile(np.arange(max(len(blurs), 1), dtype=np.uint8), (2, 1)),
        "tile": 40,
        "certainty": 0.9,
        "contrast": 1.0,
        "gain": 1.0,
        "gamma": 1.0,
        "noise": (1.0, 1.2),
    }

    return BlurEstimate(**(fields | changes))


def pair(shape: tuple[int, ...] = (80, 120)) -> Pair:
    """Return a pair, everywhere at disparity 6."""
    scene = np.random.default_rng(0).integers(0, 256, (shape[0], shape[1] + 6), dtype=np.uint8)
    return scene[:, :-6], scene[:, 6:]


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Diagnosis]:
    """Return what checks a pair, the estimate of blur being given."""

    def diagnosed(images: Pair, given: BlurEstimate | None = None) -> Diagnosis:
        module = importlib.import_module("phasestereo.rig.diagnosis")
        found = module.estimate_pair

        def with_blur(*arguments: Any) -> Any:
            return replace(found(*arguments), blur=given or estimate())

        monkeypatch.setattr(module, "estimate_pair", with_blur)
        return check(*images)

    return diagnosed


def severities(diagnosis: Diagnosis) -> dict[str, str]:
    """Return the worst severity of each topic."""
    worst: dict[str, str] = {}
    for found in diagnosis.findings:
        before = worst.get(found.topic, "ok")
        worst[found.topic] = max(before, found.severity, key=ORDER.index)
    return worst


def sentence(diagnosis: Diagnosis, topic: str) -> str:
    return " ".join(found.sentence for found in diagnosis.findings if found.topic == topic)


def test_sound_pairs_are_not_accused(data: Path, diagnosed: Callable[..., Diagnosis]) -> None:
    for name in SCENES:
        scene = find_scene(data / "middlebury", name).load()
        found = diagnosed((scene.left, scene.right))
        assert set(severities(found).values()) == {"ok"}, f"{name}: {found}"


@pytest.mark.parametrize("fault", FAULTS)
def test_injected_faults_are_found_and_nothing_else(
    data: Path, diagnosed: Callable[..., Diagnosis], fault: str
) -> None:
    topic, severity, spoil = FAULTS[fault]
    for name in SCENES:
        scene = find_scene(data / "middlebury", name).load()
        found = severities(diagnosed(spoil(scene.left, scene.right)))
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


def test_blur_is_put_into_words(diagnosed: Callable[..., Diagnosis]) -> None:
    disk = Blur(side="left", kind="disk", size=3.1, angle=0.0)
    assert sentence(diagnosed(pair(), estimate(disk)), "blur") == (
        "the left image is softer than the right by a disk of radius 3.1 px: check its focus; "
        "robust matching will compensate"
    )

    motion = Blur(side="right", kind="motion", size=9.0, angle=30.0)
    other = Blur(side="right", kind="other", size=2.0, angle=0.0)

    words = sentence(diagnosed(pair(), estimate(NO_BLUR, motion, other)), "blur")
    assert "the right image is softer than the left by a motion of 9.0 px at 30 degrees" in words
    assert "over 33% of the image" in words
    assert "no simple shape" in words


@pytest.mark.parametrize(
    ("blur", "certainty", "severity"),
    [
        (Blur("left", "gaussian", 0.2, 0.0), 1.0, "ok"),
        (Blur("left", "gaussian", 0.5, 0.0), 1.0, "note"),
        (Blur("left", "gaussian", 2.0, 0.0), 1.0, "warning"),
        (Blur("left", "gaussian", 2.0, 0.0), 0.3, "note"),
        (Blur("left", "disk", 0.5, 0.0), 1.0, "ok"),
        (Blur("left", "motion", 1.5, 0.0), 1.0, "ok"),
        (NO_BLUR, 1.0, "ok"),
    ],
)
def test_blur_is_as_grave_as_it_is_large_and_certain(
    diagnosed: Callable[..., Diagnosis], blur: Blur, certainty: float, severity: str
) -> None:
    found = diagnosed(pair(), estimate(blur, certainty=certainty))
    assert severities(found)["blur"] == severity


@pytest.mark.parametrize(
    ("gain", "gamma", "severity", "words"),
    [
        (1.05, 0.97, "ok", "equally bright"),
        (0.8, 1.0, "note", "the left image is darker, its gray levels 0.80 times"),
        (1.8, 1.0, "warning", "the right image is darker, its gray levels 0.56 times"),
        (0.7, 0.5, "warning", "another curve"),  # equal at the median
    ],
)
def test_contrast_is_judged_where_the_grays_are(
    diagnosed: Callable[..., Diagnosis], gain: float, gamma: float, severity: str, words: str
) -> None:
    found = diagnosed(pair(), estimate(gain=gain, gamma=gamma))
    assert severities(found)["contrast"] == severity
    assert words in sentence(found, "contrast")


def test_noise_counts_as_a_share_of_the_range(diagnosed: Callable[..., Diagnosis]) -> None:
    assert severities(diagnosed(pair(), estimate(noise=(1.0, 6.0))))["noise"] == "note"
    assert severities(diagnosed(pair(), estimate(noise=(20.0, 1.0))))["noise"] == "warning"
    wide = tuple(image.astype(np.uint16) * 257 for image in pair())
    assert severities(diagnosed(wide, estimate(noise=(20.0, 20.0))))["noise"] == "ok"


def test_saturation_and_texture_are_noted(diagnosed: Callable[..., Diagnosis]) -> None:
    left, right = (image.copy() for image in pair())
    left[:, :30] = 255
    found = diagnosed((left, right))
    assert severities(found)["saturation"] == "warning"
    assert "25% of the left image is as bright as it can be" in sentence(found, "saturation")
    left[:, :80] = 128
    assert severities(diagnosed((left, right)))["texture"] == "note"


def test_unrelated_images_are_recognized(diagnosed: Callable[..., Diagnosis]) -> None:
    left, _ = pair()
    found = diagnosed(
        (left, np.random.default_rng(9).permutation(left.ravel()).reshape(left.shape))
    )
    assert "these are no pair" in sentence(found, "range")
    assert severities(found)["range"] == "warning"
    assert "too little in common" in sentence(found, "contrast")


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (47, 300), (300, 5)])
def test_small_images_are_too_small_to_tell(size: tuple[int, int]) -> None:
    found = check(*pair(size))
    assert "too small to tell" in sentence(found, "alignment")
    assert "too small to tell" in sentence(found, "blur")
    assert "warning" not in severities(found).values()
    json.dumps(found.as_dict(), allow_nan=False)


@pytest.mark.parametrize("size", [(48, 48), (49, 1500), (900, 50)])
def test_long_images_have_a_range_too(
    size: tuple[int, int], diagnosed: Callable[..., Diagnosis]
) -> None:
    found = diagnosed(pair(size)).search
    assert found is not None
    assert found.min_disparity <= 6 < found.min_disparity + found.num_disparities <= 24


@pytest.mark.parametrize("levels", [(0, 0), (255, 255), (7, 80)])
def test_uniform_images_have_too_little_texture(levels: tuple[int, int]) -> None:
    left, right = (np.full((90, 90, 3), level, np.uint8) for level in levels)
    found = check(left, right)
    for topic in ("range", "alignment", "blur", "contrast", "noise"):
        assert "too little texture to tell" in sentence(found, topic)


def test_dict_is_json_and_holds_what_was_found(diagnosed: Callable[..., Diagnosis]) -> None:
    blur = Blur("left", "motion", 9.0, 45.0)
    given = estimate(blur, NO_BLUR, gain=float("nan"), labels=np.array([[0, 1], [1, 1]], np.uint8))
    found = diagnosed(pair(), given)

    said = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert (said["width"], said["height"]) == (120, 80)
    assert said["search"]["min_disparity"] <= 6
    assert not said["search"]["swapped"]
    assert said["alignment"]["vertical"] == pytest.approx(0, abs=0.05)

    assert said["blur"]["blurs"][0] == {
        "side": "left", "kind": "motion", "size": 9.0, "angle": 45.0, "other": None, "share": 0.25,
    }  # fmt: skip

    assert said["blur"]["labels"] == [[0, 1], [1, 1]]
    assert said["contrast"]["gain"] is None
    assert said["noise"] == {"left": 1.0, "right": 1.2}
    assert len(said["findings"]) == len(found.findings)


def test_text_has_a_line_a_finding(diagnosed: Callable[..., Diagnosis]) -> None:
    found = diagnosed(pair())
    lines = str(found).splitlines()
    assert len(lines) == len(found.findings)
    assert all(line.startswith(("ok: ", "note: ", "warning: ")) for line in lines)


def test_same_pair_same_diagnosis() -> None:
    assert check(*pair()).as_dict() == check(*pair()).as_dict()


def test_kinds_of_pixels_do_not_matter() -> None:
    expected = check(*pair()).as_dict()
    for convert in (
        lambda image: image.astype(np.uint16) * 257,
        lambda image: np.stack([image] * 3, axis=2),
        lambda image: image[:, :, np.newaxis],
    ):
        left, right = pair()
        said = check(convert(left), convert(right)).as_dict()
        assert said["search"] == expected["search"]
        assert said["alignment"]["vertical"] == pytest.approx(
            expected["alignment"]["vertical"], abs=1e-3
        )


@pytest.mark.parametrize(
    ("left", "right", "error", "message"),
    [
        (None, np.zeros((60, 60), np.uint8), TypeError, "left: "),
        (np.zeros((60, 60), np.int32), np.zeros((60, 60), np.int32), TypeError, "left: got dtype"),
        (np.zeros((60, 60), np.uint8), np.zeros((60, 60)), TypeError, "right: got dtype"),
        (np.zeros((60, 60)), np.zeros((60, 61)), ValueError, "right: got .* size of left"),
        (np.zeros((0, 60)), np.zeros((0, 60)), ValueError, "left: got shape"),
        (np.zeros((60, 60)), np.full((60, 60), np.nan), ValueError, "right: got NaN"),
    ],
)
def test_refusals_name_the_argument(
    left: Any, right: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        check(left, right)

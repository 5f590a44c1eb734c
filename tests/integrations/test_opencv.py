"""In OpenCV's place: its names, numbers and pipelines, against the real one."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.metrics import bad_pixels
from phasestereo.opencv import (
    StereoPhase,
    StereoPhase_create,
    createDisparityWLSFilter,
    createRightMatcher,
)
from phasestereo_bench.datasets import Pair, find_scene
from phasestereo_bench.rendering import render_pair
from support import counterpart
from support.pairs import noise_pair

cv2 = counterpart("cv2")
pytest.importorskip("scipy")

COUNT = 48
INVALID = -16
OFF = 1_000_000
SAMPLE: dict[str, Any] = {
    "blockSize": 16,
    "P1": 8 * 3 * 3**2,
    "P2": 32 * 3 * 3**2,
    "disp12MaxDiff": 1,
    "uniquenessRatio": 10,
    "speckleWindowSize": 100,
    "speckleRange": 32,
}
"""What OpenCV's sample stereo_match.py says, but for the disparities."""


@pytest.fixture(scope="module")
def pair() -> Pair:
    """Return a rendered pair, in color."""
    return render_pair(0, height=180, width=260, num_disparities=COUNT)


def bgr(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[:, :, ::-1])


def in_pixels(disparity: np.ndarray, invalid: int = INVALID) -> np.ndarray:
    """Return disparities as this package has them."""
    return np.where(disparity == invalid, np.nan, disparity / 16).astype(np.float32)


def wrong(pair: Pair, disparity: np.ndarray, scored: str = "nonocc") -> float:
    return bad_pixels(disparity, pair.truth, 1.0, pair.masks[scored])


# --- the same names and numbers ---


def test_arguments_are_in_the_order_of_opencv() -> None:
    theirs = re.findall(r"\w+", cv2.StereoSGBM_create.__doc__.split("->")[0])[1:]
    ours = inspect.signature(StereoPhase_create).parameters.values()
    assert [p.name for p in ours if p.kind is p.POSITIONAL_OR_KEYWORD] == theirs

    in_order = [-3, 24, 7, 8, 32, 2, 5, 11, 50, 3, 1]
    matchers = StereoPhase_create(*in_order), cv2.StereoSGBM_create(*in_order)

    for name in theirs:
        get = f"get{name[0].upper()}{name[1:]}"
        assert getattr(matchers[0], get)() == getattr(matchers[1], get)(), name


def test_defaults_are_those_of_opencv() -> None:
    ours, sgbm, bm = StereoPhase_create(), cv2.StereoSGBM_create(), cv2.StereoBM_create()
    assert ours.getBlockSize() == 0, "that of the preset"
    ours.setBlockSize(3)
    for name in accessors(sgbm):
        assert getattr(ours, f"get{name}")() == getattr(sgbm, f"get{name}")(), name
    for name in {*accessors(bm)} - {*accessors(sgbm)}:
        assert getattr(ours, f"get{name}")() == getattr(bm, f"get{name}")(), name


def test_what_is_set_is_got() -> None:
    for theirs in (cv2.StereoSGBM_create(), cv2.StereoBM_create()):
        ours = StereoPhase_create()
        for number, name in enumerate(accessors(theirs)):
            value = number % 2 if name in ("Mode", "PreFilterType") else 2 * number + 5
            for matcher in (ours, theirs):
                getattr(matcher, f"set{name}")(value)
            assert getattr(ours, f"get{name}")() == getattr(theirs, f"get{name}")() == value


def accessors(matcher: Any) -> list[str]:
    """Return the parameters of one of OpenCV's matchers, but for regions of interest.

    Nor is there StereoBM's smaller block: OpenCV keeps none.
    """
    names = {name[3:] for name in dir(matcher) if name.startswith("set")}
    return sorted(names - {"ROI1", "ROI2", "SmallerBlockSize"})


def test_keywords_of_setters_are_those_of_opencv() -> None:
    for theirs in (cv2.StereoSGBM_create(), cv2.StereoBM_create()):
        for name in accessors(theirs):
            keyword = re.findall(r"\((\w+)\)", getattr(theirs, f"set{name}").__doc__)[0]
            getattr(StereoPhase_create(), f"set{name}")(**{keyword: 1})


def test_maps_are_sixteenths_of_what_match_finds(pair: Pair) -> None:
    stereo = StereoPhase_create(2, 41)
    disparity = stereo.compute(bgr(pair.left), bgr(pair.right))

    result = ps.match(
        pair.left,
        pair.right,
        min_disparity=2,
        num_disparities=41,
        lr_check=1,
        speckle_size=0,
        fill=False,
    )

    assert disparity.dtype == np.int16
    is_outside = np.arange(260) - np.rint(result.disparity) < 0
    assert is_outside.mean() < 0.002

    missing = np.isnan(result.disparity) | is_outside
    assert 0.01 < missing.mean() < 0.3
    np.testing.assert_array_equal(disparity == (2 - 1) * 16, missing)
    np.testing.assert_array_equal(disparity[~missing], np.rint(16 * result.disparity[~missing]))
    assert (disparity % 16 != 0).any(), "there are fractions of pixels"

    again = stereo.compute(bgr(pair.left), bgr(pair.right))
    np.testing.assert_array_equal(again, disparity)


def test_colors_are_in_the_order_of_opencv() -> None:
    """What can be seen is in the red channel; the blue one says something else."""
    texture = noise_pair(40, 90, 5)
    other = noise_pair(40, 90, 11, seed=1)

    images = [
        np.dstack([blue // 3, np.full_like(red, 99), red])
        for blue, red in zip(other, texture, strict=True)
    ]

    stereo = StereoPhase_create(0, 16)
    assert np.median(stereo.compute(*images)) == 5 * 16

    opaque = [np.dstack([image, np.full((40, 90), 7, np.uint8)]) for image in images]
    np.testing.assert_array_equal(stereo.compute(*opaque), stereo.compute(*images))

    reversed_channels = [image[:, :, ::-1] for image in images]
    assert (stereo.compute(*reversed_channels) != stereo.compute(*images)).any()

    expected = ps.match(*reversed_channels, num_disparities=16, lr_check=1, speckle_size=0)
    found = StereoPhase_create(0, 16, fill=True).compute(*images)
    np.testing.assert_array_equal(found, np.rint(16 * expected.disparity))


# --- what OpenCV refuses ---


@pytest.mark.parametrize("form", ["gray", "gray, 3-D", "16 bits", "float32", "float64", "strided"])
def test_any_images(pair: Pair, form: str) -> None:
    images = [cv2.cvtColor(bgr(image), cv2.COLOR_BGR2GRAY) for image in (pair.left, pair.right)]

    forms = {
        "gray": images,
        "gray, 3-D": [image[:, :, np.newaxis] for image in images],
        "16 bits": [image.astype(np.uint16) << 4 for image in images],
        "float32": [image.astype(np.float32) / 256 for image in images],
        "float64": [image.astype(np.float64) for image in images],
        "strided": [np.repeat(image, 2, axis=1)[:, ::2] for image in images],
    }

    stereo = StereoPhase_create(0, COUNT)
    found, plain = stereo.compute(*forms[form]), stereo.compute(*images)
    assert (np.abs(found - plain) <= 16).mean() > 0.99
    assert wrong(pair, in_pixels(found)) < 12


def test_the_left_border_has_estimates(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)
    border = np.s_[:, :COUNT]

    seen = pair.masks["nonocc"][border]
    ours = StereoPhase_create(0, COUNT).compute(*images)[border]
    assert seen.mean() > 0.3

    assert (ours[seen] != INVALID).mean() > 0.85
    both = seen & (ours != INVALID)
    assert (np.abs(ours / 16 - pair.truth[border])[both] <= 1).mean() > 0.85

    theirs = cv2.StereoSGBM_create(0, COUNT, 3).compute(*images)[border]
    assert (theirs == INVALID).all()


def test_negative_disparities(pair: Pair) -> None:

    shift = 30
    left, right = bgr(pair.left)[:, shift:], bgr(pair.right)[:, :-shift]

    disparity = StereoPhase_create(-shift, COUNT).compute(left, right)
    assert disparity.min() == (-shift - 1) * 16
    assert disparity.max() > 0

    found = in_pixels(disparity, (-shift - 1) * 16)
    columns = np.arange(found.shape[1]) - found
    assert np.nanmin(columns) > -0.6
    assert np.nanmax(columns) < found.shape[1] - 0.4

    truth, mask = pair.truth[:, shift:] - shift, pair.masks["nonocc"][:, shift:]
    assert bad_pixels(found, truth, 1.0, mask & np.isfinite(found)) < 6


def test_the_largest_disparities_that_fit() -> None:
    left, right = noise_pair(24, 2200, 2040)
    stereo = StereoPhase_create(2038, 10)
    assert np.median(stereo.compute(left, right)[:, 2050:]) == 2040 * 16
    assert np.median(stereo.compute_right(left, right)[:, :150]) == -2040 * 16
    assert stereo.compute_right(left, right).min() == -2048 * 16
    stereo = StereoPhase_create(-2047, 10)
    assert stereo.compute(right, left).min() == -2048 * 16


def test_filling_gives_every_pixel_a_disparity(pair: Pair) -> None:
    disparity = StereoPhase_create(0, COUNT, fill=True).compute(bgr(pair.left), bgr(pair.right))
    assert disparity.min() >= 0
    holes = StereoPhase_create(0, COUNT).compute(bgr(pair.left), bgr(pair.right))
    assert wrong(pair, in_pixels(disparity)) < 5
    assert wrong(pair, in_pixels(disparity), "all") < 0.8 * wrong(pair, in_pixels(holes), "all")


# --- checks ---


@pytest.fixture(scope="module")
def cones(data: Path) -> Pair:
    return find_scene(data / "middlebury", "cones").load()


def share(disparity: np.ndarray) -> float:
    return float((disparity == INVALID).mean())


def test_disp12_max_diff(cones: Pair) -> None:
    images, maps = (bgr(cones.left), bgr(cones.right)), {}

    for most in (-1, 0, 1, 2, 8, OFF):
        maps[most] = StereoPhase_create(0, 64, disp12MaxDiff=most).compute(*images)
        expected = ps.match(
            cones.left,
            cones.right,
            num_disparities=64,
            speckle_size=0,
            fill=False,
            lr_check={OFF: None}.get(most, max(most, 1)),
        )

        gone = np.isnan(expected.disparity)
        assert (maps[most][gone] == INVALID).all()
        assert (maps[most][~gone] != INVALID).mean() > 0.99

    theirs = {
        most: cv2.StereoSGBM_create(0, 64, 3, 216, 864, most).compute(*images)
        for most in (-1, 0, 1, OFF)
    }

    for each in (maps, theirs):
        np.testing.assert_array_equal(each[-1], each[1])
        np.testing.assert_array_equal(each[0], each[1])

        assert share(each[OFF]) < share(each[1])
    assert share(maps[OFF]) < share(maps[8]) < share(maps[2]) < share(maps[1])


@pytest.mark.parametrize(("ratio", "meant"), [(1, 1), (10, 10), (60, 60), (100, 100), (-1, 10)])
def test_uniqueness_ratio(cones: Pair, ratio: int, meant: int) -> None:
    """As OpenCV has it: some cost times (100 - ratio) is below that of the best times 100."""
    options: dict[str, Any] = {"preset": "paper", "optimizer": "wta", "blockSize": 3}

    volume = ps.cost_volume(cones.left, cones.right, num_disparities=64)
    costs = ps.aggregate(volume, window=3).astype(np.int64)

    best = costs.argmin(axis=2)[:, :, np.newaxis]
    own = np.take_along_axis(costs, best, axis=2)

    is_elsewhere = np.abs(np.arange(64) - best) > 1
    is_ambiguous = (is_elsewhere & (costs * (100 - meant) < own * 100)).any(axis=2)
    is_outside = np.arange(costs.shape[1]) < best[:, :, 0]

    found = StereoPhase_create(0, 64, uniquenessRatio=ratio, disp12MaxDiff=OFF, **options).compute(
        bgr(cones.left), bgr(cones.right)
    )

    assert (is_ambiguous & ~is_outside).mean() > 0.001
    np.testing.assert_array_equal(found == INVALID, is_ambiguous | is_outside)


@pytest.mark.parametrize(("size", "most"), [(100, 1), (400, 2), (100, 0), (20, 16000), (9, OFF)])
def test_speckles_are_those_of_opencv(cones: Pair, size: int, most: int) -> None:
    """Of whole disparities that nothing smooths: `robust` looks for them before it smooths."""
    images = bgr(cones.left), bgr(cones.right)
    options: dict[str, Any] = {"preset": "paper", "optimizer": "wta", "blockSize": 3}

    expected = StereoPhase_create(0, 64, **options).compute(*images)
    before = share(expected)
    cv2.filterSpeckles(expected, INVALID, size, min(16 * most, 32767))

    found = StereoPhase_create(0, 64, speckleWindowSize=size, speckleRange=most, **options).compute(
        *images
    )

    assert share(expected) > before
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(("size", "most"), [(0, 1), (-1, 1), (100, -1)])
def test_no_speckles_are_looked_for(cones: Pair, size: int, most: int) -> None:
    images = bgr(cones.left), bgr(cones.right)
    found = StereoPhase_create(0, 64, speckleWindowSize=size, speckleRange=most)
    np.testing.assert_array_equal(
        found.compute(*images), StereoPhase_create(0, 64).compute(*images)
    )


def test_what_is_in_units_of_costs_changes_nothing(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)
    stereo = StereoPhase_create(0, COUNT)
    plain = stereo.compute(*images)

    stereo.setP1(8 * 3 * 21**2)
    stereo.setP2(32 * 3 * 21**2)
    stereo.setPreFilterCap(63)
    stereo.setMode(cv2.StereoSGBM_MODE_HH)
    stereo.setTextureThreshold(100)

    np.testing.assert_array_equal(stereo.compute(*images), plain)


@pytest.mark.parametrize(("block", "window"), [(0, 5), (1, 1), (5, 5), (6, 7), (21, 21)])
def test_blocks_are_windows(pair: Pair, block: int, window: int) -> None:
    images = bgr(pair.left), bgr(pair.right)

    stereo = StereoPhase_create(0, COUNT)
    stereo.setBlockSize(block)
    assert stereo.getBlockSize() == block

    result = ps.match(
        pair.left,
        pair.right,
        num_disparities=COUNT,
        window=window,
        lr_check=1,
        speckle_size=0,
        fill=False,
    )

    found = in_pixels(stereo.compute(*images))
    known = ~np.isnan(found)
    assert known.mean() > 0.6
    np.testing.assert_allclose(found[known], result.disparity[known], atol=1 / 32)

    right = stereo.compute_right(*images)
    other = StereoPhase_create(0, COUNT, 9).compute_right(*images)
    assert (right != other).mean() > 0.05


# --- OpenCV's pipelines ---


@pytest.mark.parametrize("block", [5, 16])
def test_the_parameters_of_the_sample_make_better_maps_than_with_opencv(
    data: Path, block: int
) -> None:
    """With its block of 16, and with one that suits either matcher better."""
    for name in ("cones", "venus", "Motorcycle"):
        pair = find_scene(data / "middlebury", name).load()
        images = bgr(pair.left), bgr(pair.right)
        count = -(-pair.num_disparities // 16) * 16
        options = SAMPLE | {"numDisparities": count, "blockSize": block}

        maps = [
            in_pixels(create(minDisparity=0, **options).compute(*images))
            for create in (StereoPhase_create, cv2.StereoSGBM_create)
        ]

        ours, theirs = (wrong(pair, disparity) for disparity in maps)
        assert ours < 0.5 * theirs, name

        kept = [pair.masks["nonocc"] & np.isfinite(disparity) for disparity in maps]
        assert kept[0].sum() > kept[1].sum()

        errors = [bad_pixels(d, pair.truth, 1.0, k) for d, k in zip(maps, kept, strict=True)]
        assert errors[0] < 0.97 * errors[1], name


# --- the right image and the WLS filter ---


@pytest.mark.parametrize("low", [0, -5, 3])
def test_maps_of_the_right_image_are_as_those_of_opencv(cones: Pair, low: int) -> None:
    images = bgr(cones.left), bgr(cones.right)

    theirs_left = cv2.StereoSGBM_create(low, 64, 3, P1=216, P2=864)
    theirs = cv2.ximgproc.createRightMatcher(theirs_left)
    stereo = StereoPhase_create(low, 64, **SAMPLE)
    ours = createRightMatcher(stereo)

    assert ours.getMinDisparity() == theirs.getMinDisparity()
    assert ours.getNumDisparities() == theirs.getNumDisparities()

    maps = [matcher.compute(images[1], images[0]) for matcher in (ours, theirs)]
    np.testing.assert_array_equal(maps[0], stereo.compute_right(*images))
    assert maps[0].dtype == maps[1].dtype

    invalid = -(low + 64) * 16
    assert maps[0].min() == maps[1].min() == invalid
    assert maps[0].max() <= -low * 16

    both = (maps[0] != invalid) & (maps[1] != invalid)
    assert both.mean() > 0.8
    assert (np.abs(maps[0] - maps[1])[both] <= 16).mean() > 0.9


def test_maps_of_the_right_image_are_right(pair: Pair) -> None:
    disparity = StereoPhase_create(0, COUNT).compute_right(bgr(pair.left), bgr(pair.right))

    found = disparity != -COUNT * 16
    columns = np.arange(disparity.shape[1]) - disparity / 16
    assert columns[found].max() < disparity.shape[1] - 0.4

    error = np.abs(-disparity / 16 - pair.truth_right)[found]
    assert found.mean() > 0.85
    assert (error <= 1).mean() > 0.85


def test_a_program_with_the_wls_filter_and_three_names_exchanged(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)
    maps = {}
    for module, create in ((cv2.ximgproc, cv2.StereoSGBM_create), (None, StereoPhase_create)):
        make_filter = module.createDisparityWLSFilter if module else createDisparityWLSFilter
        make_right = module.createRightMatcher if module else createRightMatcher

        left_matcher = create(minDisparity=0, numDisparities=COUNT, **SAMPLE)
        wls_filter = make_filter(matcher_left=left_matcher)
        right_matcher = make_right(left_matcher)

        left_disp = left_matcher.compute(*images)
        right_disp = right_matcher.compute(images[1], images[0])

        wls_filter.setLambda(8000.0)
        wls_filter.setSigmaColor(1.5)
        filtered = wls_filter.filter(left_disp, images[0], disparity_map_right=right_disp)

        maps[create] = wrong(pair, filtered / 16, "all")
        if module is None:
            settings = ("Lambda", 500), ("SigmaColor", 1.5), ("DepthDiscontinuityRadius", 1)
            plain = make_filter(matcher_left=create(0, COUNT))
            assert [getattr(plain, f"get{name}")() for name, _ in settings] == [
                value for _, value in settings
            ]
        assert left_matcher.getDisp12MaxDiff() == OFF
        assert left_matcher.getSpeckleWindowSize() == left_matcher.getUniquenessRatio() == 0

    assert maps[StereoPhase_create] < 0.75 * maps[cv2.StereoSGBM_create]


def test_opencv_is_needed_for_the_filter_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    code = "import sys, phasestereo.opencv; sys.exit('cv2' in sys.modules)"
    quiet = "-W", "error", "-W", "ignore::UserWarning"
    subprocess.run([sys.executable, *quiet, "-c", code], check=True)  # noqa: S603 - our code

    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.delitem(sys.modules, "cv2.ximgproc", raising=False)

    stereo = StereoPhase_create(0, 16, speckleWindowSize=100)
    with pytest.raises(ImportError, match=r"pip install 'phasestereo\[opencv\]'"):
        createDisparityWLSFilter(stereo)

    assert stereo.getSpeckleWindowSize() == 100, "what fails changes nothing"


# --- the matcher as an object ---


def test_setters_count_from_the_next_pair_on(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)

    stereo = StereoPhase_create()
    stereo.compute(*images)

    stereo.setMinDisparity(2)
    stereo.setNumDisparities(45)
    stereo.setDisp12MaxDiff(3)
    stereo.setUniquenessRatio(7)
    stereo.setSpeckleWindowSize(60)
    stereo.setSpeckleRange(1)

    options: dict[str, Any] = {"disp12MaxDiff": 3, "speckleWindowSize": 60, "speckleRange": 1}
    options["uniquenessRatio"] = 7
    expected = StereoPhase_create(2, 45, **options).compute(*images)

    np.testing.assert_array_equal(stereo.compute(*images), expected)


def test_threads_are_kept_while_settings_are(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int | None] = []

    class Counted(ps.Matcher):
        def __init__(self, **options: Any) -> None:
            made.append(options["threads"])
            super().__init__(**options)

    monkeypatch.setattr("phasestereo.opencv.stereo.Matcher", Counted)

    images = bgr(pair.left)[:40], bgr(pair.right)[:40]
    stereo = StereoPhase_create(0, 20, threads=1)
    for _ in range(2):
        stereo.compute(*images)
        stereo.compute_right(*images)

    stereo.setMinDisparity(1)
    stereo.compute(*images)
    assert made == [1, 1]

    stereo.setDisp12MaxDiff(2)
    stereo.compute(*images)
    assert made == [1, 1, 1]


def test_presets_and_settings(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)
    # Without the median, which would lead some disparities out of the image.

    stereo = StereoPhase_create(0, COUNT, blockSize=7, preset="fast", threads=2, median=0)

    expected = ps.match(
        pair.left,
        pair.right,
        num_disparities=COUNT,
        preset="fast",
        window=7,
        median=0,
        lr_check=1,
        fill=False,
    )

    np.testing.assert_array_equal(in_pixels(stereo.compute(*images)), expected.disparity)

    doubtful = StereoPhase_create(0, COUNT, min_confidence=0.9).compute(*images)
    assert share(doubtful) > share(StereoPhase_create(0, COUNT).compute(*images)) + 0.02


def test_a_given_array_is_written_to(pair: Pair) -> None:
    images = bgr(pair.left), bgr(pair.right)
    for stereo in (StereoPhase_create(0, COUNT), cv2.StereoSGBM_create(0, COUNT, 3)):
        target = np.zeros(pair.left.shape[:2], np.int16)
        assert stereo.compute(*images, target) is target or isinstance(target, np.ndarray)
        np.testing.assert_array_equal(target, stereo.compute(*images))
        np.testing.assert_array_equal(target, stereo.compute(*images, disparity=None))


def test_it_shows_how_it_was_made() -> None:
    stereo = StereoPhase_create(-4, 64, 16, uniquenessRatio=5, preset="fast", power=2)

    expected = (
        "StereoPhase(minDisparity=-4, numDisparities=64, blockSize=16, uniquenessRatio=5, "
        "preset='fast', power=2)"
    )

    assert repr(stereo) == expected
    assert repr(createRightMatcher(stereo)) == f"RightMatcher({expected})"
    assert repr(StereoPhase_create()) == (
        "StereoPhase(minDisparity=0, numDisparities=16, preset='robust')"
    )
    assert isinstance(stereo, StereoPhase)


def test_every_method_of_opencv_is_there_but_for_regions_of_interest() -> None:
    for theirs in (cv2.StereoSGBM_create(), cv2.StereoBM_create()):
        names = {name for name in dir(theirs) if not name.startswith("_")}
        assert {name for name in names - {*dir(StereoPhase)} if "ROI" not in name} == set()


def test_what_is_saved_is_read_by_the_storage_of_opencv(pair: Pair, tmp_path: Path) -> None:
    left, right = bgr(pair.left), bgr(pair.right)
    stereo = StereoPhase.create(
        0, COUNT, 7, uniquenessRatio=5, preset="fast", fill=True, intensity_range=(0, 255), median=0
    )
    for name in ("stereo.yml", "stereo.xml", "stereo.json"):
        stereo.save(str(tmp_path / name))
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
        node = storage.getNode(stereo.getDefaultName())
        assert node.getNode("blockSize").real() == 7

        loaded = StereoPhase.create(threads=1)
        loaded.read(node)
        assert repr(loaded) == repr(stereo)
        np.testing.assert_array_equal(loaded.compute(left, right), stereo.compute(left, right))

    with pytest.raises(OSError, match=r"nowhere.* cannot be written"):
        stereo.save(str(tmp_path / "nowhere" / "stereo.yml"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: StereoMatcher.SGBM", r"^fn: got an object 'StereoMatcher.SGBM'; accepts one of"),
        ("name: StereoMatcher.Phase\nmode: 4", "^mode: got 4"),
        ("name: StereoMatcher.Phase\nsettings: 'fill=Yes'", "^fill: got str"),
    ],
)
def test_what_cannot_be_read_changes_nothing(text: str, message: str) -> None:
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage(f"%YAML:1.0\n---\n{text}\n", flags)
    stereo = StereoPhase.create(0, COUNT, 7, median=0)
    before = repr(stereo)
    with pytest.raises((TypeError, ValueError), match=message):
        stereo.read(storage.root())
    assert repr(stereo) == before


def test_images_of_opencv_s_other_kind(pair: Pair) -> None:
    left, right = bgr(pair.left), bgr(pair.right)
    stereo = StereoPhase.create(0, COUNT, preset="fast")
    found = stereo.compute(cv2.UMat(left), cv2.UMat(right))
    assert isinstance(found, cv2.UMat)
    np.testing.assert_array_equal(found.get(), stereo.compute(left, right))


# --- refusals ---


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"numDisparities": 0}, ValueError, "numDisparities: got 0; accepts 1 to 4095"),
        ({"numDisparities": -16}, ValueError, "numDisparities: got -16"),
        ({"numDisparities": 16.0}, TypeError, "numDisparities: got float; accepts an integer"),
        ({"numDisparities": "16"}, TypeError, "numDisparities: got str"),
        ({"minDisparity": True}, TypeError, "minDisparity: got bool"),
        ({"minDisparity": None}, TypeError, "minDisparity: got NoneType"),
        ({"minDisparity": 2048}, ValueError, "minDisparity: got 2048; accepts -2047 to 2047"),
        (
            {"minDisparity": 2000, "numDisparities": 49},
            ValueError,
            "numDisparities: got 49; accepts 1 to 48 with minDisparity 2000: .* int16",
        ),
        ({"blockSize": -1}, ValueError, "blockSize: got -1"),
        ({"P1": -1}, ValueError, "P1: got -1"),
        ({"P2": 1.5}, TypeError, "P2: got float"),
        ({"preFilterCap": -1}, ValueError, "preFilterCap: got -1"),
        ({"uniquenessRatio": 101}, ValueError, "uniquenessRatio: got 101; accepts .* to 100"),
        ({"disp12MaxDiff": 2**31}, ValueError, "disp12MaxDiff: got 2147483648"),
        ({"speckleRange": 1.0}, TypeError, "speckleRange: got float"),
        ({"speckleWindowSize": 2**40}, ValueError, "speckleWindowSize: got"),
        ({"mode": 4}, ValueError, "mode: got 4; accepts 0 to 3"),
        ({"preset": "best"}, ValueError, "preset: got 'best'"),
        ({"threads": 0}, ValueError, "threads: got 0"),
        ({"windows": 3}, TypeError, "windows: no such setting"),
        ({"window": 5}, TypeError, "window: OpenCV's blockSize sets it here"),
        ({"blockSize": 64}, ValueError, "blockSize: got 64; accepts 0 to 63"),
        ({"neighborhood": 4}, ValueError, "neighborhood: got 4"),
        ({"lr_check": 2}, TypeError, "lr_check: OpenCV's disp12MaxDiff sets it here"),
        ({"speckle_size": 2}, TypeError, "speckle_size: OpenCV's speckleWindowSize sets it here"),
    ],
)
def test_what_cannot_be_made(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=f"^{message}"):
        StereoPhase_create(**options)


def test_setters_refuse_and_change_nothing() -> None:
    stereo = StereoPhase_create(0, 64)

    with pytest.raises(ValueError, match=r"^numDisparities: got 0"):
        stereo.setNumDisparities(0)

    with pytest.raises(TypeError, match=r"^uniquenessRatio: got float"):
        stereo.setUniquenessRatio(1.5)  # type: ignore[arg-type]  # what is tested

    assert (stereo.getNumDisparities(), stereo.getUniquenessRatio()) == (64, 0)
    stereo.setNumDisparities(np.int64(32))  # type: ignore[arg-type]  # an integer, if not int
    assert type(stereo.getNumDisparities()) is int


GRAY = np.zeros((20, 60), np.uint8)
WITH_NAN = np.full((20, 60), np.nan, np.float32)


@pytest.mark.parametrize(
    ("left", "right", "error", "message"),
    [
        (None, GRAY, TypeError, "left: got None, .*cv2.imread"),
        (GRAY, None, TypeError, "right: got None, .*cv2.imread"),
        (GRAY, GRAY[:, :50], ValueError, r"right: got \(20, 50\)"),
        (GRAY, GRAY.astype(np.uint16), TypeError, "right: got dtype uint16"),
        (GRAY.astype(np.int16), GRAY.astype(np.int16), TypeError, "left: got dtype int16"),
        (GRAY[0], GRAY[0], ValueError, r"left: got shape \(60,\)"),
        (np.dstack([GRAY] * 2), GRAY, ValueError, r"left: got shape \(20, 60, 2\)"),
        (GRAY[:0], GRAY[:0], ValueError, "left: got shape .* at least one pixel"),
        (GRAY.astype(np.float32), WITH_NAN, ValueError, "right: got NaN or infinite pixels"),
        (GRAY[:, :9], GRAY[:, :9], ValueError, "numDisparities: got 16; accepts 1 to 9 with"),
    ],
)
def test_images_that_are_refused(
    left: Any, right: Any, error: type[Exception], message: str
) -> None:
    stereo = StereoPhase_create(0, 16)

    for call in (
        stereo.compute,
        stereo.compute_right,
        lambda one, two: createRightMatcher(stereo).compute(two, one),
    ):
        with pytest.raises(error, match=f"^{message}"):
            call(left, right)


@pytest.mark.parametrize(("low", "is_fine"), [(-75, True), (-74, True), (-76, False), (60, False)])
def test_disparities_that_lead_out_of_the_images(low: int, *, is_fine: bool) -> None:
    stereo = StereoPhase_create(low, 17)

    if is_fine:
        assert stereo.compute(GRAY, GRAY).shape == GRAY.shape
        return

    message = f"^minDisparity: got {low}; accepts -75 to 59"
    for compute in (stereo.compute, stereo.compute_right):
        with pytest.raises(ValueError, match=message):
            compute(GRAY, GRAY)


@pytest.mark.parametrize(
    ("target", "error", "message"),
    [
        (np.zeros((20, 60), np.float32), TypeError, "disparity: got dtype float32; accepts int16"),
        ([[0]], TypeError, "disparity: got dtype int64; accepts int16"),
        (np.zeros((20, 59), np.int16), ValueError, r"disparity: got shape \(20, 59\)"),
    ],
)
def test_arrays_that_cannot_be_written_to(
    target: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        StereoPhase_create(0, 16).compute(GRAY, GRAY, target)


def test_matchers_of_others_are_refused() -> None:
    for make in (createRightMatcher, createDisparityWLSFilter):
        with pytest.raises(TypeError, match="^matcher_left: got StereoSGBM; accepts a StereoPhase"):
            make(cv2.StereoSGBM_create())

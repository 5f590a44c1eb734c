"""The page of a pair as a file: whole or not at all, safe to open, and honest."""

import base64
import io
import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo._images import on_screen, screen_range
from phasestereo.io import Calibration
from phasestereo.io.raster import decode_raster
from phasestereo.views.page import write_pair_page
from phasestereo.views.page.embedding import coding_of
from phasestereo.views.page.facts import blur_facts, charts
from phasestereo.views.page.layers import FLAGS, flag_kinds
from phasestereo.views.page.scene import scene_points
from support import counterpart
from support.html_page import Page

for module in ("jinja2", "matplotlib", "PIL"):
    counterpart(module)

SHAPE = (24, 40)
COUNT = 8


def noise(seed: int = 0, shape: tuple[int, ...] = SHAPE) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def pair_of() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair whose disparities are all 3."""
    left = noise()
    return left, np.roll(left, -3, axis=1)


@pytest.fixture(scope="module")
def result() -> ps.Result:
    return ps.match(*pair_of(), num_disparities=COUNT)


def page_data(page: Path) -> Any:
    """Return the numbers that the page's scripts work with, refusing what JSON does not have."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    match = re.search(r'id="page">(.*?)</script>', page.read_text("utf-8"), re.DOTALL)
    assert match
    return json.loads(match[1], parse_constant=refuse)


def test_needs_nothing_beside_it(tmp_path: Path, result: ps.Result) -> None:
    page = tmp_path / "page.html"
    write_pair_page(page, *pair_of(), result, num_disparities=COUNT)

    read = Page(page)
    assert read.open == []
    assert [one for one in read.sources if not one.startswith("data:")] == []
    assert "40 \N{MULTIPLICATION SIGN} 24 pixels, 8 disparities searched: 0 to 7 px." in read.text

    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page.read_text("utf-8"))
    assert policy
    assert policy[1].startswith("default-src 'none'")

    assert list(tmp_path.iterdir()) == [page]


def test_it_begins_with_what_is_probably_wrong(tmp_path: Path, result: ps.Result) -> None:
    told = replace(
        result,
        summary=ps.Summary(1, 0, 0, 0, 0.6, 0.41, 0, 0, 0, np.nan),
        uncertainty=np.full(result.disparity.shape, 0.5, np.float32),
    )
    rows, cols = result.disparity.shape
    rig = Calibration.from_focal(1000, 0.1, width=cols, height=rows)
    page = tmp_path / "page.html"
    write_pair_page(page, *pair_of(), told, calibration=rig, yaw=0.2)

    lead, _, text = Page(page).text.partition("40 \N{MULTIPLICATION SIGN} 24 pixels")
    assert lead.strip().endswith("About 41 % of the pixels are probably wrong.")
    assert "Error bars of depths: a yaw of up to 0.2 degrees is allowed for, 3.5 px" in text


def test_titles_are_text(tmp_path: Path, result: ps.Result) -> None:
    page, title = tmp_path / "page.html", "</title><script>alert('&')</script>"
    write_pair_page(page, *pair_of(), result, title="plain")
    plain = Page(page)
    write_pair_page(page, *pair_of(), result, title=title)
    odd = Page(page)
    assert odd.scripts == plain.scripts
    assert odd.text.count(title) == plain.text.count("plain") == 2


def test_metrics_are_those_of_the_library(tmp_path: Path, result: ps.Result) -> None:
    page = tmp_path / "page.html"

    truth = np.full(SHAPE, 3.0)
    truth[0, 0] = np.nan
    mask = np.ones(SHAPE, dtype=bool)
    mask[:, :5] = False

    write_pair_page(page, *pair_of(), result, truth=truth, mask=mask)

    score = ps.metrics.score(result.disparity, truth, mask=mask)
    text = Page(page).text
    for name, value in (("bad-0.5", f"{score.bad_0_5:.2f} %"), ("rms", f"{score.rms:.2f} px")):
        assert re.search(rf"{name}\s*{re.escape(value)}", text)

    assert re.search(rf"pixels scored\s*{score.pixels:,}", text)
    assert re.search(rf"mean error \(avgerr, EPE\)\s*{score.avgerr:.2f} px", text)

    assert score.avgerr == score.epe  # one number, one row
    assert text.count("EPE") == 1


def test_without_any_estimate(tmp_path: Path, result: ps.Result) -> None:
    page = tmp_path / "page.html"
    nothing = replace(result, disparity=np.full(SHAPE, np.nan, dtype=np.float32))
    write_pair_page(page, *pair_of(), nothing, truth=np.ones(SHAPE))
    assert page_data(page)["charts"]["errors"]["wrong"] == [100] * 80
    text = Page(page).text
    assert re.search("EPE\\)\\s*\N{EN DASH}", text)
    assert "No pixel has a depth" in text


REFUSED: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"left": noise(shape=(24, 41))}, ValueError, "result"),
    ({"result": np.zeros(SHAPE)}, TypeError, "result"),
    ({"truth": np.zeros((3, 3))}, ValueError, "truth"),
    ({"truth": np.zeros(SHAPE, dtype=int)}, TypeError, "truth"),
    ({"truth": np.full(SHAPE, np.nan)}, ValueError, "truth"),
    ({"truth": np.zeros(SHAPE), "mask": np.zeros(SHAPE)}, TypeError, "mask"),
    ({"truth": np.zeros(SHAPE), "mask": np.ones((2, 2), dtype=bool)}, ValueError, "mask"),
    ({"mask": np.ones(SHAPE, dtype=bool)}, ValueError, "mask: has no effect without truth"),
    ({"calibration": Calibration.from_focal(9, 1, width=9, height=9)}, ValueError, "calibration"),
    ({"calibration": "calib.txt"}, TypeError, "calibration"),
]


@pytest.mark.parametrize(("wrong", "error", "message"), REFUSED)
def test_refusals_leave_the_file_alone(
    tmp_path: Path,
    result: ps.Result,
    wrong: dict[str, Any],
    error: type[Exception],
    message: str,
) -> None:
    page = tmp_path / "page.html"
    page.write_text("earlier")
    left, right = pair_of()
    given: dict[str, Any] = {"left": left, "right": right, "result": result} | wrong

    with pytest.raises(error, match=message):
        write_pair_page(page, **given)

    with pytest.raises(ValueError, match=r"^path must end in \.html or \.htm, got '\.pdf'"):
        write_pair_page(tmp_path / "page.pdf", left, right, result)

    assert (page.read_text(), list(tmp_path.iterdir())) == ("earlier", [page])


@pytest.mark.parametrize("missing", ["jinja2", "matplotlib"])
def test_names_the_extra(
    tmp_path: Path, result: ps.Result, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ImportError, match=r"pip install 'phasestereo\[report\]'"):
        write_pair_page(tmp_path / "page.html", *pair_of(), result)
    assert not list(tmp_path.iterdir())


# What the page says


def test_intensities_are_stretched_alike() -> None:
    left = np.linspace(1000, 2000, 1001, dtype=np.float32).reshape(1, -1, 1)
    ends = screen_range((left, left + 500))
    assert ends == pytest.approx((1000, 2500), abs=3)
    shown = on_screen(left, ends)
    assert (shown[0, 0, 0], shown[0, -1, 0]) == (0, pytest.approx(255 * 2 / 3, abs=1))


def test_only_images_of_more_than_8_bits_are_stretched(tmp_path: Path, result: ps.Result) -> None:
    for dtype in (np.uint8, np.uint16):
        left, right = (image.astype(dtype) for image in pair_of())
        write_pair_page(tmp_path / "page.html", left, right, result)
        message = "Intensities are stretched" in (tmp_path / "page.html").read_text(
            encoding="utf-8"
        )
        assert message == (dtype is np.uint16)


def test_every_flag_has_a_color_of_its_own() -> None:
    assert (set(FLAGS), len({color for color, _ in FLAGS.values()})) == (set(ps.Flag), len(ps.Flag))


def test_flags_have_their_shares() -> None:
    flags = np.array([[0, 4], [4 | 256, 16 | 256]], dtype=np.uint16)
    kinds = flag_kinds(flags)
    assert [(kind.name, kind.pixels, kind.share) for kind in kinds] == [
        ("outside", 2, 0.5),
        ("occluded", 1, 0.25),
        ("filled", 2, 0.5),
    ]


def test_blur_in_words() -> None:
    none = ps.Blur("none", "none", 0.0, 0.0)
    disk = ps.Blur("left", "disk", 4.0, 0.0, np.full((3, 3), 1 / 9))
    motion = ps.Blur("right", "motion", 9.0, 45.0, np.eye(9) / 9)
    labels = np.array([[0, 0], [0, 1]], dtype=np.uint8)

    def say(*kinds: ps.Blur) -> Any:
        chosen = labels if len(kinds) > 1 else np.zeros_like(labels)
        return blur_facts(ps.BlurEstimate(kinds, chosen, 16, 0.9, 1.0, (1.0, 1.0)), (40, 40))

    assert say(none).verdict.startswith("No relative blur")
    assert say(disk).verdict == "Relative blur: the left image is softer than the other."

    description = say(disk, none)
    assert description.verdict.endswith(
        "the left image is softer than the other, not everywhere alike."
    )
    assert [(area.words, area.share) for area in description.areas] == [
        ("left image: out of focus, a disk of radius 4.00 px", 0.75),
        ("no relative blur", 0.25),
    ]

    assert "now one image, now the other" in say(disk, motion).verdict
    assert say(disk, motion).areas[1].words == "right image: motion by 9.0 px at 45°"


def test_tiles_lie_on_their_pixels() -> None:
    kinds = ps.Blur("none", "none", 0.0, 0.0), ps.Blur("left", "disk", 4.0, 0.0)
    labels = np.array([[0, 1], [1, 0]], dtype=np.uint8)

    estimate = ps.BlurEstimate(kinds, labels, 16, 0.9, 1.0, (1.0, 1.0))
    uri = blur_facts(estimate, (33, 45)).map.partition(",")[2]
    drawn = np.asarray(decode_raster(io.BytesIO(base64.b64decode(uri))))

    assert drawn.shape == (33, 45, 3)
    first = (drawn == drawn[0, 0]).all(axis=2)  # the last tile of a row is as wide as is left

    expected = np.zeros((33, 45), dtype=bool)
    expected[:16, :16] = expected[16:, 16:] = True
    assert (first == expected).all()


def test_charts_count_every_pixel(result: ps.Result) -> None:
    truth = np.full(SHAPE, 3, dtype=np.float32)

    truth[:, -1] = np.nan
    scored = np.isfinite(truth)

    shown = charts(result, truth, scored)
    estimated = 100 * np.isfinite(result.disparity).mean()
    assert sum(shown["disparities"]["found"]) == pytest.approx(estimated)
    assert sum(shown["reliability"]["pixels"]) == np.count_nonzero(scored)

    errors = np.abs(result.disparity - truth)[scored]
    limit = shown["errors"]["thresholds"][40]
    assert shown["errors"]["wrong"][40] == pytest.approx(100 * (errors > limit).mean())


def test_points_lie_where_the_calibration_says() -> None:
    disparity = np.full((10, 20), 4, dtype=np.float32)
    disparity[0] = 0  # infinitely far
    disparity[1] = np.nan
    disparity[2, :3] = 0.5  # far beyond the others

    scene = scene_points(disparity, None, step=1)
    assert scene.nominal
    assert (scene.geometry.focal, scene.total, scene.shown) == (20, 160, 157)

    assert scene.far == pytest.approx(3 / 160)
    assert scene.limit < scene.geometry.depth(0.5)
    assert scene_points(disparity, None, step=1, max_depth=1e3).shown == 160


def test_codes_hold_disparities_to_a_fine_step() -> None:
    values = np.array([[-3.2, 0.3, np.nan, np.inf, 250.7]], dtype=np.float32)
    coding = coding_of(values, None)

    codes = coding.encode(values)
    assert codes[0, 2:4].tolist() == [65535, 65535]

    decoded = coding.low + coding.step * codes
    known = np.isfinite(values)
    assert np.abs(decoded - values)[known].max() <= 1 / 256 + 1e-6

    wide = coding_of(np.array([[0, 2000]], dtype=np.float32))
    assert wide.encode(np.array([[0, 2000]], dtype=np.float32)).tolist() == [[0, 65534]]
    assert coding_of(np.full((1, 1), np.nan, np.float32)).encode(values).dtype == np.uint16


def test_full_hd_takes_no_more_than_a_few_megabytes(tmp_path: Path) -> None:
    """A picture with detail, and disparities with the noise of sub-pixel estimates."""
    random = np.random.default_rng(0)
    rows, cols = 1080, 1920

    coarse = random.integers(0, 256, (rows // 8, cols // 8, 3)).repeat(8, axis=0).repeat(8, axis=1)
    left = (coarse // 2 + random.integers(0, 24, (rows, cols, 3))).astype(np.uint8)

    ramp = np.linspace(20, 100, rows, dtype=np.float32)[:, np.newaxis]
    disparity = (ramp + random.normal(0, 0.05, (rows, cols))).astype(np.float32)
    confidence = random.uniform(0.9, 1, (rows, cols)).astype(np.float32)
    flags = np.zeros((rows, cols), np.uint16)
    result = ps.Result(disparity, flags, confidence, ps.Settings(), {"matching": 1.0}, None)

    page = tmp_path / "page.html"
    write_pair_page(page, left, left, result)

    assert page.stat().st_size < 8e6  # noise, which nothing compresses, is most of it
    assert not page_data(page)["exact"]
    assert "compressed with loss" in Page(page).text

"""What notebooks show of a result: what it says, its pictures, and that Jupyter and marimo do."""

import asyncio
import base64
import io
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.views.picture import NEUTRAL, colorize, limits
from support import counterpart

pytest.importorskip("matplotlib")

from PIL import Image

SETUP = """
import numpy as np
import phasestereo as ps

disparity = np.tile(np.linspace(5, 45, 120, dtype=np.float32), (90, 1))
disparity[10:20, 30:50] = np.nan
flags = np.where(np.isnan(disparity), ps.Flag.OCCLUDED, 0).astype(np.uint16)
left = np.zeros((90, 120, 3), np.uint8)
left[:, :60] = 255, 0, 0
result = ps.Result(
    disparity, flags, np.ones_like(disparity), ps.Settings(), {"matching": 0.25}, pair=(left, left)
)
"""
OVERVIEW = "ps.views.plot.overview(result)"
EXPORTED = 60  # seconds that a notebook may take


class HtmlBlock(HTMLParser):
    """Images, tags and text of a piece of HTML."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.images: list[dict[str, str]] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "img":
            self.images.append({name: value or "" for name, value in attrs})
        else:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def picture(self, start: str) -> NDArray[np.uint8]:
        """Decode the image whose text begins so."""
        (found,) = (image for image in self.images if image["alt"].startswith(start))
        return decoded(found["src"])


def decoded(uri: str) -> NDArray[np.uint8]:
    kind, data = uri.split(";base64,")
    assert kind in ("data:image/png", "data:image/jpeg")
    with Image.open(io.BytesIO(base64.b64decode(data, validate=True))) as image:
        return np.asarray(image.convert("RGB"))


def shown(result: ps.Result) -> HtmlBlock:
    block = HtmlBlock(result._repr_html_())
    assert not block.open
    return block


@pytest.fixture(scope="module")
def result() -> ps.Result:
    names: dict[str, Any] = {}
    exec(SETUP, names)  # noqa: S102  # our own text, which the notebooks run, too
    made: ps.Result = names["result"]
    return made


def test_the_map_has_the_colors_of_its_disparities(result: ps.Result) -> None:
    picture = shown(result).picture("Disparity map, 120 by 90 pixels: blue is")
    np.testing.assert_array_equal(picture, colorize(result.disparity))
    assert (picture[10:20, 30:50] == NEUTRAL).all()


def test_words_tell_size_share_reasons_time_and_blur(result: ps.Result) -> None:
    text = shown(result).text

    assert "120 x 90 pixels, 98.1% estimated, " in text
    assert "No estimate, gray: 1.9%, flagged occluded 1.9%" in text
    assert "All flags: occluded 1.9%" in text
    assert "Confidence: mean 1.00" in text
    assert "Error bars" not in text
    bars = shown(replace(result, uncertainty=np.full_like(result.disparity, 0.25))).text
    assert "Error bars: median \N{PLUS-MINUS SIGN}0.25 px" in bars

    whole = replace(result, disparity=np.ones_like(result.disparity), flags=0 * result.flags)
    assert "No estimate" not in shown(whole).text
    assert "All flags: none" in shown(whole).text

    texture = np.random.default_rng(0).integers(0, 256, (64, 72), np.uint8)
    matched = ps.match(texture[:, :68], texture[:, 4:], num_disparities=8)
    assert f"blur: {matched.blur}, " in shown(matched).text


@pytest.mark.parametrize("shape", [(1, 1), (1, 700), (900, 1), (3, 2)])
@pytest.mark.parametrize("value", [0.0, -7.0, 3.25, np.nan, np.inf])
def test_odd_results_show_themselves(shape: tuple[int, int], value: float) -> None:
    disparity = np.full(shape, value, np.float32)
    flags, image = np.zeros(shape, np.uint16), np.ones(shape, np.float32)
    result = ps.Result(
        disparity, flags, image, ps.Settings(), {}, uncertainty=image * np.nan, pair=(image, image)
    )

    block = shown(result)
    picture = block.picture("Disparity map")
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1
    assert (tuple(picture[0, 0]) == NEUTRAL) == (not np.isfinite(value))

    assert all(int(image["width"]) > 0 and int(image["height"]) > 0 for image in block.images)


def test_large_results_stay_small_and_true() -> None:
    """Noise is the worst that can be: nothing compresses it."""
    rng = np.random.default_rng(0)
    disparity = rng.uniform(0, 255, (1500, 2000)).astype(np.float32)
    disparity[:, :500] = np.nan
    pair = (rng.integers(0, 256, (1500, 2000, 3), np.uint8),) * 2
    confidence = rng.random((1500, 2000), np.float32)

    result = ps.Result(
        disparity,
        np.zeros((1500, 2000), np.uint16),
        confidence,
        ps.Settings(),
        {},
        uncertainty=4 * confidence,
        pair=pair,
    )

    html = result._repr_html_()
    assert len(html) < 1_000_000

    picture = HtmlBlock(html).picture("Disparity map, 2000 by 1500 pixels")
    assert picture.shape == (330, 440, 3)

    y, x = (((np.arange(size) + 0.5) * 1500 / 330).astype(int) for size in (330, 440))
    low, high = limits(disparity[np.isfinite(disparity)])
    shown = np.ix_(y, x)
    wanted = colorize(disparity[shown], low=low, high=high, trusted=confidence[shown] >= 0.5)

    assert (wanted[:, :110] == NEUTRAL).all()
    assert np.abs(picture.astype(int) - wanted).max() < 10, "the ends come of a sample"


def test_it_needs_nothing_from_elsewhere_and_survives_sanitizers(result: ps.Result) -> None:
    html = result._repr_html_()
    block = HtmlBlock(html)
    assert set(block.tags) <= {"div", "b", "figure", "figcaption", "img", "span"}
    assert all(image["src"].startswith("data:image/") for image in block.images)
    assert all(image["alt"] for image in block.images)
    assert not re.search(r"https?:|url\(|[^-]color:|background", html), "colors are the page's"


def test_text_is_escaped(result: ps.Result) -> None:
    class Hostile:
        def __str__(self) -> str:
            return "<script>alert('x')</script>"

    hostile: Any = Hostile()

    block = shown(replace(result, blur=hostile))
    assert "script" not in block.tags
    assert "<script>alert('x')</script>" in block.text


def test_estimates_of_blur_show_their_kinds() -> None:
    kinds = Blur("none", "none", 0.0, 0.0), Blur("left", "motion", 9.0, 45.0)
    labels = np.array([[0, 0, 0, 1]], np.uint8)
    block = HtmlBlock(BlurEstimate(kinds, labels, 16, 0.875, 1.0, (1.5, 0.25))._repr_html_())
    assert not block.open
    assert "none75.0%left, motion 9.00 px at 45 degrees25.0%" in block.text
    assert "certainty 0.88, noise 1.5 left, 0.25 right" in block.text


def test_calibrations_show_their_fields() -> None:
    rig = ps.io.Calibration.from_focal(700.25, 0.12, width=640, height=480, unit="m")
    block = HtmlBlock(rig._repr_html_())
    assert not block.open
    assert "phasestereo.io.Calibration 640 x 480 pixels" in block.text
    assert "cam0f 700.25 x 700.25 px, center (319.5, 239.5)" in block.text
    assert "baseline0.12" in block.text
    assert "ndisp" not in block.text


def test_diagnoses_show_their_findings() -> None:
    image = np.random.default_rng(0).integers(0, 256, (96, 128, 3), np.uint8)

    diagnosis = ps.check(image[:, :120], 255 - image[:, 8:])
    block = HtmlBlock(diagnosis._repr_html_())

    assert not block.open
    assert block.tags.count("tr") == len(diagnosis.findings) + 1
    assert all(found.sentence in block.text for found in diagnosis.findings)
    assert "128" not in block.text
    assert "120 x 96 pixels" in block.text

    warned = sum(found.severity == "warning" for found in diagnosis.findings)
    assert block.tags.count("b") == 1 + 3 * warned
    assert warned


def test_without_matplotlib_words_remain(
    result: ps.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    block = shown(result)
    assert not block.images
    assert "pip install 'phasestereo[plot]'" in block.text
    assert "98.1% estimated" in block.text


def test_a_notebook_shows_the_result(result: ps.Result, tmp_path: Path) -> None:
    nbformat, nbclient = counterpart("nbformat"), counterpart("nbclient")
    counterpart("ipykernel")

    v4 = nbformat.v4
    notebook = v4.new_notebook(
        cells=[v4.new_code_cell(SETUP), v4.new_code_cell("result"), v4.new_code_cell(OVERVIEW)]
    )

    client = nbclient.NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=EXPORTED,
        resources={"metadata": {"path": tmp_path}},
    )

    asyncio.run(client.async_execute())

    (output,) = notebook.cells[1].outputs
    assert output.output_type == "execute_result"
    assert output.data["text/plain"].startswith("<Result 120x90, 98.1% trusted")

    block = HtmlBlock(output.data["text/html"])
    assert len(block.images) == 1
    np.testing.assert_array_equal(block.picture("Disparity map"), colorize(result.disparity))
    assert "98.1% estimated" in block.text

    (drawn,) = notebook.cells[2].outputs  # once, though it was made by pyplot
    assert "image/png" in drawn.data

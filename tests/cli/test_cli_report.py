"""``phasestereo match --report``: a whole page, or a refusal before any work."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phasestereo import io
from phasestereo_bench.rendering import render_pair
from support import Run, counterpart
from support.browser import Browser

cli = pytest.importorskip("phasestereo.cli")
for module in ("jinja2", "matplotlib", "PIL"):
    counterpart(module)

SHIFT = 3
TOLD = ("disparity", "truth", "depth")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: a pair, everywhere at disparity SHIFT, and its truth."""
    monkeypatch.chdir(tmp_path)
    scene = np.random.default_rng(0).integers(0, 256, (30, 50, 3), dtype=np.uint8)
    io.write_image("left.png", scene[:, :-SHIFT])
    io.write_image("right.png", scene[:, SHIFT:])
    io.write_disparity("truth.pfm", np.full((30, 47), SHIFT, dtype=np.float32))
    return tmp_path


@pytest.fixture
def match(run: Callable[..., Run]) -> Callable[[str], Run]:
    """Return a function that matches the pair here: exit code, standard output, error."""
    arguments = "match", "left.png", "right.png", "--num-disparities", 8
    return lambda options: run(*arguments, *options.split())


@pytest.mark.skipif(sys.platform != "linux", reason="names of other systems are Unicode")
def test_names_that_are_not_utf_8_are_shown_escaped(run: Callable[..., Run]) -> None:
    left = Path("left.png").rename(os.fsdecode(b"left\xff.png"))
    assert run("match", left, "right.png", "--num-disparities", 8, "--report", "p.html")[0] == 0
    assert r"left\udcff.png" in Path("p.html").read_text("utf-8")


def test_page_has_what_was_asked_for(browser: Browser, match: Callable[[str], Run]) -> None:
    options = "--report page.html --truth truth.pfm -o out.npy --focal 40 --baseline 0.5"

    code, out, err = match(options)
    assert (code, err) == (0, "")
    assert "wrote page.html" in out

    browser.open(Path("page.html"))
    assert browser.complaints() == []
    assert browser.driver.title.startswith("left.png and right.png")

    found = io.read_disparity("out.npy")[15, 23]
    browser.run("readOut({ x: 23, y: 15 })")
    shown = {key: browser.run(f"return element('value-{key}').textContent") for key in TOLD}
    assert float(shown["disparity"].removesuffix(" px")) == pytest.approx(found, abs=0.01)
    assert float(shown["truth"].removesuffix(" px")) == pytest.approx(3, abs=0.01)
    assert float(shown["depth"].partition(" (")[0]) == pytest.approx(40 * 0.5 / found, rel=0.003)

    text = browser.run("return document.body.innerText")
    assert "8 disparities searched: 0 to 7 px" in text
    assert "Nominal geometry" not in text


def test_a_page_alone_is_something_to_do(match: Callable[[str], Run]) -> None:
    assert match("--report page.html")[0] == 0

    page = Path("page.html").read_text("utf-8")
    assert "Nominal geometry" in page
    assert sorted(path.name for path in Path().iterdir()) == [
        "left.png",
        "page.html",
        "right.png",
        "truth.pfm",
    ]


def test_cameras_found_one_above_the_other_have_a_map_and_no_page(run: Callable[..., Run]) -> None:
    pair = render_pair(3, height=200, width=300, num_disparities=40)
    for name, image in (("upper.png", pair.left), ("lower.png", pair.right)):
        io.write_image(name, np.rot90(image, -1))
    words = "match", "upper.png", "lower.png", "--num-disparities", 48
    assert run(*words, "-o", "alone.npy")[0] == 0
    assert np.abs(np.rot90(np.load("alone.npy")) - pair.truth)[20:-20, 48:-20].mean() < 1

    code, out, err = run(*words, "-o", "map.npy", "--report", "page.html")
    assert code == 2
    assert "wrote map.npy" in out
    assert "--report: no page is written: got cameras one above the other" in err
    assert not Path("page.html").exists()
    np.testing.assert_array_equal(np.load("map.npy"), np.load("alone.npy"))


def never(*_: object, **__: object) -> None:
    raise AssertionError("matched in vain")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--report left.png/page.html", "left.png: File exists"),
        ("--report left.png", "--report: left.png is an input or another"),
        ("--report page.pdf", "--report: path must end in .html or .htm, got '.pdf'"),
        ("--report .", "--report: . is a folder"),
    ],
)
def test_refused_before_matching(
    match: Callable[[str], Run], monkeypatch: pytest.MonkeyPatch, options: str, message: str
) -> None:
    monkeypatch.setattr("phasestereo.cli.match.match_pair", never)
    code, _, err = match(options)
    assert code != 0
    assert message in err


def test_missing_extra_is_named_before_matching(
    match: Callable[[str], Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasestereo.cli.match.match_pair", never)
    monkeypatch.setitem(sys.modules, "jinja2", None)
    code, _, err = match("--report page.html")
    assert code == 1
    assert "pip install 'phasestereo[report]'" in err
    assert not Path("page.html").exists()

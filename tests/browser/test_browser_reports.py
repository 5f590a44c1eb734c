"""The page of the demonstration in a real browser."""

from pathlib import Path

import pytest

from browser import Browser
from conftest import counterpart
from phasestereo_bench.demo import run_demo, write_demo

for module in ("jinja2", "matplotlib", "scipy", "PIL"):
    counterpart(module)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_demo(run_demo(0), tmp_path_factory.mktemp("demo"))[-1]


@pytest.mark.parametrize("dark", [False, True])
def test_loads_without_a_word(browser: Browser, page: Path, *, dark: bool) -> None:
    browser.open(page, width=400, dark=dark)
    assert (browser.requests(), browser.complaints()) == ([page.as_uri()], [])
    assert browser.run("return [...document.images].every((image) => image.naturalWidth > 0)")
    assert browser.run("return document.documentElement.scrollWidth") <= 400
    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(16, 19, 23)" if dark else "rgb(251, 251, 250)")

"""The pages of ``bench report`` and of the demonstration in a real browser."""

from pathlib import Path

import pytest

from browser import Browser
from conftest import counterpart
from phasestereo_bench.demo import run_demo, write_demo
from phasestereo_bench.report import read_results, write_report
from test_bench_report import record, store

for module in ("jinja2", "matplotlib", "scipy", "PIL"):
    counterpart(module)


LONG = "robust:neighborhood=5,window=11,compensate_blur=false"  # wider than a telephone


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("reports")
    records = [
        record(method, bad, row=row)
        for method, bad in ((LONG, 10.0), ("opencv:sgbm", 30.0))
        for row in ("sharp", "gauss 2")
    ]

    results = read_results([store(folder / "results.jsonl", records)])
    bench = write_report(results, folder / "bench", metric="v2.nonocc")

    return {
        "bench": next(path for path in bench if path.suffix == ".html"),
        "demo": write_demo(run_demo(0), folder / "demo")[-1],
    }


@pytest.mark.parametrize("name", ["bench", "demo"])
@pytest.mark.parametrize("dark", [False, True])
def test_load_without_a_word(
    browser: Browser, pages: dict[str, Path], name: str, *, dark: bool
) -> None:
    browser.open(pages[name], width=400, dark=dark)
    assert (browser.requests(), browser.complaints()) == ([pages[name].as_uri()], [])
    assert browser.run("return [...document.images].every((image) => image.naturalWidth > 0)")
    assert browser.run("return document.documentElement.scrollWidth") <= 400
    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(16, 19, 23)" if dark else "rgb(251, 251, 250)")

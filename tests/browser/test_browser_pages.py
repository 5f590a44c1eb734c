"""What holds of all pages that we make, in a real browser: they fit, are read well, ask nobody."""

from __future__ import annotations

import shutil
import subprocess
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, NamedTuple

import pytest
from test_browser_pair_page import CALIBRATION, images, made_up, truth_of

import phasestereo as ps
import phasestereo_live
from phasestereo.views.page import write_pair_page
from phasestereo_bench.demo import run_demo, write_demo
from phasestereo_live.calibration.page import write_calibration_page
from phasestereo_live.viewer import Display, Server
from support import ENVIRONMENT, ROOT, boards, counterpart
from support.browser import Browser, serving
from support.live_frames import COUNT, FAST, LEFT, RIGHT, frame

if TYPE_CHECKING:
    from collections.abc import Iterator

for module in ("jinja2", "matplotlib", "scipy", "PIL"):
    counterpart(module)

SIZES = {"telephone": (390, 844), "tablet": (800, 900), "desk": (1440, 900)}


class Site(NamedTuple):
    """A page: where it is, when its scripts are done, what it has for a screen reader to go to."""

    address: str
    done: str = "true"
    regions: tuple[str, ...] = ()
    seen: tuple[str, ...] = ()
    """What is in sight at once, by its identifier."""


@pytest.fixture(scope="module")
def sites(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Site]]:
    folder = tmp_path_factory.mktemp("pages")
    result = made_up()
    report = folder / "pair & more #1.html"
    write_pair_page(report, *images(), result, truth=truth_of(result), calibration=CALIBRATION)

    seen = boards.pairs(boards.chessboard(9, 6), 8, 0.025)
    write_calibration_page(
        folder / "calibration.html", phasestereo_live.calibrate(seen, square=0.025)
    )

    program = [sys.executable, str(ROOT / "docs" / "try_page.py"), str(folder / "try")]
    subprocess.run(program, env=ENVIRONMENT, check=True)  # noqa: S603  # ours
    shutil.copy(ROOT / "tests" / "stand_in_matcher.js", folder / "try" / "matcher.js")

    show = Display(FAST, COUNT, folder)
    show.add(frame())
    show.diagnose(ps.check(LEFT, RIGHT))

    ready = "document.documentElement?.dataset.{} === '{}'"
    viewer = "The pair and its layers", "In three dimensions", "Measure"
    with ExitStack() as stack:
        home = stack.enter_context(serving(folder / "try"))
        server = stack.enter_context(Server(show))
        stack.callback(show.close)
        spoil = "defocus", "shake", "dim", "turn", "rows", "stage"
        yield {
            "report": Site(
                report.as_uri(), ready.format("ready", "yes"), (*viewer, "Blur", "Numbers")
            ),
            "calibration": Site((folder / "calibration.html").as_uri()),
            "demo": Site(write_demo(run_demo(0), folder / "demo")[-1].as_uri()),
            "try": Site(
                f"{home}/index.html",
                ready.format("matched", "robust"),
                (*viewer, "The pair", "What check finds"),
                spoil,
            ),
            "live": Site(
                server.address,
                ready.format("ready", "yes"),
                (*viewer, "What is found", "Settings"),
                ("save", "findings"),
            ),
        }


def visit(browser: Browser, site: Site, size: str, *, dark: bool = False) -> None:
    browser.visit("about:blank")  # an earlier page may still ask its server
    width, height = SIZES[size]
    browser.visit(site.address, width=width, height=height, dark=dark)
    browser.wait(site.done)


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["report", "calibration", "demo", "try", "live"])
def test_it_fits_is_read_well_and_asks_nobody_else(
    browser: Browser, sites: dict[str, Site], name: str, size: str, theme: str
) -> None:
    site = sites[name]
    visit(browser, site, size, dark=theme == "dark")
    assert browser.complaints() == []
    assert browser.faint() == []
    assert browser.run("return document.documentElement.scrollWidth") <= SIZES[size][0]
    assert browser.run("return [...document.images].every((image) => image.naturalWidth > 0)")

    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(16, 19, 23)" if theme == "dark" else "rgb(251, 251, 250)")

    asked = browser.requests()
    origin = site.address.rsplit("/", 1)[0]
    assert [url for url in asked if not url.startswith((f"{origin}/", "about:"))] == []
    if site.address.startswith("file:"):
        assert [url for url in asked if url != "about:blank"] == [site.address]

    bottom = "return document.getElementById('{}').getBoundingClientRect().bottom <= innerHeight"
    seen = () if size == "tablet" else site.seen
    assert [one for one in seen if not browser.run(bottom.format(one))] == []


def test_a_low_window_shows_a_large_picture_and_its_scale(
    browser: Browser, sites: dict[str, Site]
) -> None:
    browser.visit(sites["report"].address, width=1280, height=711)
    browser.wait(sites["report"].done)
    box = "return document.querySelector('{}').getBoundingClientRect().{}"
    assert browser.run(box.format(".frame", "height")) > 400
    assert browser.run(box.format("#scale", "bottom")) <= 711


def test_a_faint_text_is_seen_by_the_test(browser: Browser, sites: dict[str, Site]) -> None:
    visit(browser, sites["report"], "desk")
    browser.run("element('keys').style.color = 'var(--page)'")
    assert len(browser.faint()) == 1


NAMELESS = """
const named = (node) => node.labels?.length || node.ariaLabel || node.textContent.trim();
const controls = document.querySelectorAll("button, input, select, a, canvas[role]");
const images = document.querySelectorAll("img:not([alt])");
return [...[...controls].filter((node) => !named(node)), ...images].map((node) => node.outerHTML);
"""

# What Tab leads to; of radio buttons that belong together it is one.
FOCUSABLE = """
const nodes = document.querySelectorAll("a[href], button, input, select, [tabindex='0']");
window.reached = new Set();
addEventListener("focusin", ({ target }) => reached.add(target.name || target));
window.expected = new Set([...nodes].filter((node) => !node.disabled && node.checkVisibility())
  .map((node) => (node.type === "radio" ? node.name : node)));
document.activeElement.blur();
return expected.size;
"""
MISSED = (
    "return [...expected].filter((one) => !reached.has(one)).map((one) => one.outerHTML ?? one)"
)
TAB = "\ue004"


@pytest.mark.parametrize("name", ["report", "try", "live"])
def test_keys_reach_everything_and_a_screen_reader_names_it(
    browser: Browser, sites: dict[str, Site], name: str
) -> None:
    visit(browser, sites[name], "desk")
    assert browser.run(NAMELESS) == []
    assert {("region", one) for one in sites[name].regions} <= {*browser.names("region")}
    roles = "slider", "radio", "button", "combobox", "checkbox", "application", "img", "link"
    assert all(spoken for _, spoken in browser.names(*roles))

    other = "[tabindex]:not([tabindex='0'])"
    assert browser.run("return document.querySelectorAll(arguments[0]).length", other) == 0

    count = browser.run(FOCUSABLE)
    body = browser.driver.find_element("css selector", "body")
    body.send_keys(TAB * (count + 5))
    assert browser.run(MISSED) == []

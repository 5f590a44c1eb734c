"""The pictures of pages in the documentation, made again: ``python tests/screenshots.py``.

Needs Chromium, its driver, selenium and the extras ``bench`` and ``report``. Look at what comes out
before it is committed.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import sleep

from PIL import Image
from selenium import webdriver

import phasestereo as ps
import phasestereo_live as live
from phasestereo.views.page import write_pair_page
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from phasestereo_live.viewer import Display, Server
from support.browser import Browser, running, serving

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"


def write_page(path: Path) -> None:
    """Write the page of a rendered pair whose left image is out of focus."""
    pair = render_pair(3, height=480, width=640, num_disparities=80)
    left = Degradation(disk_psf(3.0), noise=1.0)(pair.left)
    result = ps.match(left, pair.right, num_disparities=pair.num_disparities)

    write_pair_page(
        path,
        left,
        pair.right,
        result,
        truth=pair.truth,
        mask=pair.masks["nonocc"],
        calibration=pair.calibration,
        num_disparities=pair.num_disparities,
        title="A rendered pair, its left image out of focus",
    )


def viewer(browser: Browser) -> None:
    """Display the wipe from the left image to the disparities, a pixel held."""
    browser.run("setMix(0.55); hold({ x: 330, y: 250 }); scrollTo(0, 0)")


def cloud(browser: Browser) -> None:
    """Display the points in space."""
    browser.run("document.getElementById('space').scrollIntoView()")
    browser.wait("document.getElementById('cloud').dataset.drawn === 'yes'")
    sleep(2)  # until the last frame is drawn


def figures(browser: Browser) -> None:
    """Display the charts and the blur."""
    browser.run("document.getElementById('spread').scrollIntoView()")
    browser.wait("document.querySelectorAll('[id^=chart-][data-drawn]').length === 3")


SHOTS: dict[str, tuple[Callable[[Browser], None], bool]] = {
    "report-page": (viewer, False),
    "report-page-points": (cloud, False),
    "report-page-charts": (figures, True),
}


def save(browser: Browser, name: str) -> None:
    """Save what is in sight as a picture of the documentation."""
    sleep(0.5)
    Image.fromarray(browser.picture()).save(IMAGES / f"{name}.jpg", quality=84, optimize=True)


def take_live_page(browser: Browser) -> None:
    """Take the page of ``phasestereo live --show``."""
    pair = render_pair(2, height=480, width=640, num_disparities=64)
    left = Degradation(disk_psf(3.0), noise=1.0)(pair.left)
    result = ps.match(left, pair.right, num_disparities=64)

    show = Display(ps.PRESETS["robust"], 64, Path())
    if pair.calibration is not None:
        show.know(pair.calibration, "mm")
    show.add(live.Frame(311, 12.4, left, pair.right, result))
    show.diagnose(ps.check(left, pair.right))

    with Server(show) as server:
        browser.visit(server.address, width=1440, height=960)
        browser.wait("document.documentElement?.dataset.ready === 'yes'")
        browser.run("setMix(0.7); hold({ x: 330, y: 250 })")
        save(browser, "live-page")
        show.close()


def take_try_page(browser: Browser, folder: Path) -> None:
    """Take the page "try it", an image out of focus; needs what ``make web`` builds."""
    program = [sys.executable, str(ROOT / "docs" / "try_page.py"), str(folder)]
    subprocess.run(program, check=True)  # noqa: S603  # our own

    with serving(folder) as address:
        browser.visit(f"{address}/index.html", width=1440, height=900)

        done = "document.documentElement.dataset.matched === 'robust'"
        browser.wait(done)
        browser.run("setMix(0.6); element('defocus').value = 4")
        browser.run("element('defocus').dispatchEvent(new Event('input'))")
        browser.wait(done)

        save(browser, "try-page")


def main() -> None:
    """Take all pictures."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        raise SystemExit("needs chromium and chromedriver")

    with (
        tempfile.TemporaryDirectory() as folder,
        running(webdriver, chromium, driver) as browser,
    ):
        page = Path(folder) / "page.html"
        write_page(page)

        for name, (arrange, dark) in SHOTS.items():
            browser.open(page, width=1280, height=960, dark=dark)
            arrange(browser)
            save(browser, name)

        take_live_page(browser)
        take_try_page(browser, Path(folder) / "web")


if __name__ == "__main__":
    main()

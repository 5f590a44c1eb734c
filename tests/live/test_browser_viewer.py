"""The page of ``phasestereo live --show`` in a real browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration
from phasestereo_live.video.streaming import Failure
from phasestereo_live.viewer import Display, Server
from test_viewer import COLS, COUNT, FAST, LEFT, RIGHT, ROWS, SHIFT, frame
from test_viewer import server as server  # noqa: PLC0414 - a fixture

if TYPE_CHECKING:
    from pathlib import Path

    from browser import Browser


@pytest.fixture
def show(tmp_path: Path) -> Display:
    shown = Display(FAST, COUNT, tmp_path)
    shown.know(Calibration.from_focal(100, 0.2, width=COLS, height=ROWS), "m")
    shown.add(frame())
    shown.diagnose(ps.check(LEFT, RIGHT))
    return shown


def look(browser: Browser, server: Server, width: int = 1440, *, dark: bool = False) -> None:
    browser.visit("about:blank")  # an earlier page may still ask its server, which has gone
    browser.visit(server.address, width=width, height=900 if width > 800 else 844, dark=dark)
    # On the way from the link to the page there is no element for a moment.
    browser.wait("document.documentElement?.dataset.ready === 'yes'")


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1440])
def test_it_fits_and_says_nothing_on_the_console(
    browser: Browser, server: Server, width: int, theme: str
) -> None:
    dark = theme == "dark"

    look(browser, server, width, dark=dark)
    assert browser.run("return document.documentElement.scrollWidth") <= width
    assert browser.complaints() == []
    origin = server.address.rsplit("/", 1)[0]
    assert all(url.startswith(f"{origin}/") for url in browser.requests())
    assert server.address not in browser.run("return location.href")

    background = browser.run("return getComputedStyle(document.body).backgroundColor")
    channels = [int(part) for part in background.removeprefix("rgb(").rstrip(")").split(",")]
    assert (max(channels) < 60) == dark

    in_sight = "return document.getElementById('{}').getBoundingClientRect().bottom <= innerHeight"
    for needed in ("save", "left") if width < 800 else ("save", "left", "disparity", "readout"):
        assert browser.run(in_sight.format(needed)), needed


def test_new_frames_and_troubles_appear_by_themselves(
    browser: Browser, server: Server, show: Display
) -> None:
    look(browser, server)
    assert f". {COLS} \u00d7 {ROWS}, frame 0" in browser.text("status"), "after how much is wrong"

    show.fail(Failure(1, None, OSError("camera 1: gave no frame")))
    show.add(frame(2, apart=0.02))
    browser.wait("document.getElementById('status').textContent.includes('frame 2, 1 failed')")
    assert "camera 1: gave no frame" in browser.text("trouble")
    assert "not synchronized" in browser.text("trouble")

    browser.wait("document.querySelector('#left img').src.includes('frame=2')")
    picture = browser.picture("#disparity")
    assert np.ptp(picture[200:300, 300:400].reshape(-1, 3), axis=0).max() < 40  # one disparity


def test_keys_lead_the_cursor(browser: Browser, server: Server) -> None:
    look(browser, server)

    view = browser.driver.find_element("css selector", "#disparity")
    view.send_keys("\ue014")  # arrow right, from the middle
    browser.wait(f"document.getElementById('at').textContent === '{COLS // 2 + 1}, {ROWS // 2}'")

    assert browser.text("value") == f"{SHIFT}.00 px"
    assert browser.text("depth") == "4.000 m"

    crosses = "[...document.querySelectorAll('.cross')].every((cross) => !cross.hidden)"
    assert browser.run(f"return {crosses}")


def test_sliders_set_what_is_matched_with(browser: Browser, server: Server, show: Display) -> None:
    look(browser, server)

    slider = browser.driver.find_element("css selector", "#uniqueness")
    slider.send_keys("\ue014" * 3)
    browser.wait("document.getElementById('uniqueness-shown').textContent === '3'")

    version = 0
    for version in range(50):
        if show.settings.uniqueness == 3:
            break
        show.wait(version, 0.1)

    assert show.settings.uniqueness == 3

    browser.run("change({ p1: -1 })")
    browser.wait("!document.getElementById('refused').hidden")
    assert browser.text("refused").startswith("p1: got -1; accepts 0")


def test_every_control_has_a_name_and_a_place_in_the_order(
    browser: Browser, server: Server
) -> None:
    look(browser, server)

    unnamed = browser.run(
        "return [...document.querySelectorAll('input, button, .view')].filter((control) =>"
        " !(control.labels?.length || control.textContent.trim() || control.ariaLabel))"
        ".map((control) => control.id)"
    )

    assert unnamed == []
    assert browser.run("return document.querySelectorAll('img:not([alt])').length") == 0

    # A section is a region for screen readers only if it has a name.
    assert {("region", "What is found"), ("region", "Settings")} <= {*browser.names("region")}

    other = "[tabindex]:not([tabindex='0'])"
    assert browser.run("return document.querySelectorAll(arguments[0]).length", other) == 0

    for live in ("trouble", "refused", "saved", "findings", "readout"):
        assert browser.run(
            f"const e = document.getElementById('{live}');"
            "return e.role === 'alert' || e.role === 'status' || e.ariaLive === 'polite'"
        ), live


def test_buttons_save_the_pair_and_end_the_run(
    browser: Browser, server: Server, show: Display, tmp_path: Path
) -> None:
    look(browser, server)
    browser.run("document.getElementById('save').click()")
    browser.wait("document.getElementById('saved').textContent.startsWith('Saved pair-000000')")
    assert len(list(tmp_path.iterdir())) == 3
    browser.run("document.getElementById('close').click()")
    assert show.wait_closed(10)

"""The page of ``phasestereo live --show`` in a real browser: what it has besides other pages."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from test_viewer import server as server  # noqa: PLC0414 - a fixture

import phasestereo as ps
from phasestereo.io import Calibration
from phasestereo_live.video.streaming import Failure
from phasestereo_live.viewer import Display, Server, frames
from support.live_frames import COLS, COUNT, FAST, LEFT, RIGHT, ROWS, SHIFT, frame

if TYPE_CHECKING:
    from pathlib import Path

    from support.browser import Browser

KNOWN = Calibration.from_focal(100, 0.2, width=COLS, height=ROWS)


@pytest.fixture
def show(tmp_path: Path) -> Display:
    shown = Display(FAST, COUNT, tmp_path)
    shown.know(KNOWN, "m")
    shown.add(frame())
    shown.diagnose(ps.check(LEFT, RIGHT))
    return shown


def look(browser: Browser, server: Server) -> None:
    browser.visit("about:blank")  # an earlier page may still ask its server, which has gone
    browser.visit(server.address, width=1440)
    # On the way from the link to the page there is no element for a moment.
    browser.wait("document.documentElement?.dataset.ready === 'yes'")
    assert server.address not in browser.run("return location.href")


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
    browser.wait("live.frame === 2")

    browser.run("element('hold-frame').click()")
    for _ in range(100):
        if show.held is not None:
            break
        show.wait(1000, 0.05)
    show.add(frame(3))
    browser.wait("document.getElementById('status').textContent.includes('frame 3')")
    assert browser.run("return live.frame") == 2
    assert show.save()[0] == "pair-000002-left.png"
    browser.run("element('hold-frame').click()")
    browser.wait("live.frame === 3")
    assert browser.complaints() == []


@pytest.mark.parametrize("step", [1, 2])
def test_the_viewer_has_what_was_matched(
    browser: Browser, server: Server, show: Display, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    monkeypatch.setattr(frames, "_MOST", ROWS * COLS // step**2)
    given = frame(5)
    bars = np.linspace(0.1, 2, ROWS * COLS, dtype=np.float32).reshape(ROWS, COLS)
    given = replace(given, result=replace(given.result, uncertainty=bars))
    given.result.disparity[2, 4] = np.nan
    given.result.flags[2, 4] = ps.Flag.OCCLUDED
    show.add(given)
    look(browser, server)
    browser.wait("live.frame === 5")

    thin = slice(None, None, step), slice(None, None, step)
    for name in ("disparity", "uncertainty", "flags"):
        shown = np.array(browser.run(f"return [...maps.{name}]"), np.float32)
        np.testing.assert_array_equal(shown, getattr(given.result, name)[thin].ravel())
    for side, image in (("left", LEFT), ("right", RIGHT)):
        levels = browser.run(f"return [...pictures.{side}.bytes]")
        colors = np.array(levels, np.uint8).reshape(-1, 4)[:, :3]
        np.testing.assert_array_equal(colors, image[thin].reshape(-1, 3))

    view = browser.driver.find_element("css selector", "#stage")
    view.send_keys("\ue014")  # arrow right, from the middle
    x, y = browser.run("return [state.pixel.x * page.step, state.pixel.y * page.step]")
    assert browser.text("value-pixel") == f"{x}, {y}"
    assert browser.text("value-disparity") == f"{SHIFT}.00 px"
    known = ps.depth_interval(given.result, KNOWN)._asdict()
    near, far = (float(known[end][y, x]) for end in ("near", "far"))
    assert browser.text("value-depth") == f"4 ({near:.4g} to {far:.4g}) m"
    assert browser.run("return element('scaling').checkVisibility()") is False


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

    for live in ("trouble", "refused", "saved", "findings"):
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
    browser.run("document.getElementById('save-pair').click()")
    browser.wait("document.getElementById('saved').textContent.includes('pair-000000-2')")
    assert len(list(tmp_path.iterdir())) == 5
    show.end("no more frames come")
    browser.wait("document.getElementById('status').textContent.endsWith(': no more frames come')")
    assert browser.run("return document.getElementById('trouble').hidden")
    browser.run("document.getElementById('close').click()")
    assert show.wait_closed(10)

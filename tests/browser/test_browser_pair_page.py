"""The page of a pair in a real browser: what is seen, said and done in it."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration
from phasestereo.result import KEEPS
from phasestereo.views.depths import ranging
from phasestereo.views.page import page as page_module, write_pair_page
from phasestereo.views.page.scene import scene_points
from phasestereo.views.picture import NEUTRAL, UNSCORED, colorize
from support import counterpart
from support.browser import Browser

for module in ("jinja2", "matplotlib", "PIL"):
    counterpart(module)

SHAPE = (36, 48)
HIDDEN, FLAGGED, WRONG = (30, 5), (20, 6), (12, 7)  # x, y: no estimate, filled, 5 px off
PLACES = [(0, 0), (47, 35), (24, 18), HIDDEN, FLAGGED, WRONG]
NEARLY = 1 / 256 + 0.005 + 1e-6  # pixels: half a step of the codes, and two decimal places
CALIBRATION = Calibration.from_focal(50, 0.2, width=48, height=36)


def images(seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, 256, (*SHAPE, 3), dtype=np.uint8) for _ in range(2))
    return left, right


def made_up() -> ps.Result:
    """Return a result in which every number is known to be another one."""
    rows, cols = SHAPE

    disparity = np.linspace(1, 9, rows * cols, dtype=np.float32).reshape(SHAPE)

    flags = np.zeros(SHAPE, dtype=np.uint16)
    flags[FLAGGED[::-1]] = ps.Flag.OCCLUDED | ps.Flag.FILLED
    flags[HIDDEN[::-1]] = ps.Flag.MASKED
    disparity[HIDDEN[::-1]] = np.nan

    confidence = np.linspace(1, 0, rows * cols, dtype=np.float32).reshape(SHAPE)

    bars = np.linspace(0.25, 2, rows * cols, dtype=np.float32).reshape(SHAPE)
    bars[HIDDEN[::-1]] = np.nan

    labels = np.array([[0, 0, 1], [0, 0, 1]], dtype=np.uint8)
    kinds = ps.Blur("left", "disk", 3.0, 0.0, np.full((3, 3), 1 / 9)), ps.Blur("none", "none", 0, 0)
    blur = ps.BlurEstimate(kinds, labels, 16, 0.9, 1.0, (1.0, 2.0))

    return ps.Result(
        disparity, flags, confidence, ps.PRESETS["robust"], {"matching": 0.5}, bars, blur
    )


def truth_of(result: ps.Result) -> NDArray[np.float32]:
    truth = result.disparity + np.float32(0.25)
    truth[WRONG[::-1]] -= 5.25
    truth[HIDDEN[::-1]] = 2
    truth[-1] = np.nan
    return truth


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pages") / "pair & more #1.html"
    result = made_up()
    truth = truth_of(result)
    write_pair_page(
        path, *images(), result, truth=truth, calibration=CALIBRATION, num_disparities=10
    )
    return path


@pytest.fixture
def opened(browser: Browser, page: Path) -> Browser:
    """Return a browser that shows the page as it is at first; only loaded when need be."""
    if browser.run("return location.href + innerWidth") != f"{page.as_uri()}1280":
        browser.open(page)
    browser.run(
        """
        flicker(false);
        hold(null);
        stage.zoomBy(0);
        document.querySelector("input[value=wipe]").click();
        setMix(1);
        state.hatched = false;
        choose("disparity");
        readOut({ x: 24, y: 18 });
        """
    )

    return browser


def click(browser: Browser, selector: str) -> None:
    browser.driver.find_element("css selector", selector).click()


def press(browser: Browser, selector: str, *keys: str) -> None:
    browser.driver.find_element("css selector", selector).send_keys(*keys)


def look_at(browser: Browser, layer: str) -> None:
    click(browser, f".tab:has(input[value={layer}])")


def on_stage(browser: Browser, x: int, y: int) -> tuple[int, ...]:
    """Return the color of a pixel of the images on the stage, marks left out."""
    color = browser.run(
        """
        const [x, y] = arguments;
        const pixel = state.pixel;
        state.pixel = null;
        stage.paint();
        state.pixel = pixel;
        const [left, top] = stage.origin;
        const at = (start, place) => Math.floor(start + (place + 0.5) * stage.scale);
        return [...stage.context.getImageData(at(left, x), at(top, y), 1, 1).data.slice(0, 3)];
        """,
        x,
        y,
    )

    return tuple(color)


def hover(browser: Browser, x: float, y: float, *, clicked: bool = False) -> None:
    """Move the mouse to the middle of a pixel."""
    actions = counterpart("selenium.webdriver").ActionChains(browser.driver, duration=20)
    canvas = browser.driver.find_element("css selector", "#stage")

    browser.run("arguments[0].scrollIntoView({block: 'center'})", canvas)
    dx, dy = browser.run(
        """
        const [left, top] = stage.origin, [x, y] = arguments;
        return [left + (x + 0.5) * stage.scale - stage.canvas.clientWidth / 2,
                top + (y + 0.5) * stage.scale - stage.canvas.clientHeight / 2];
        """,
        x,
        y,
    )

    actions.move_to_element_with_offset(canvas, round(dx), round(dy))
    (actions.click() if clicked else actions).perform()


def number(text: str) -> float:
    """Return a number of pixels that is read out."""
    return float(text.removesuffix(" px"))


def read(browser: Browser) -> dict[str, str]:
    """Return the text of the read-out, with plain minus signs."""
    cells = browser.run(
        """
        const cells = [...document.querySelectorAll("#values dd")];
        return cells.map((cell) => [cell.id.replace("value-", ""), cell.textContent]);
        """
    )
    return {name: text.replace("\N{MINUS SIGN}", "-") for name, text in cells}


def test_loads_without_a_word_and_without_a_network(browser: Browser, page: Path) -> None:
    browser.open(page)
    assert browser.requests() == [page.as_uri()]
    assert browser.driver.title == "Stereo pair \N{EN DASH} phasestereo"
    draw_all(browser)
    assert (browser.complaints(), browser.requests()) == ([], [])


def draw_all(browser: Browser, what: str = "#cloud, [id^=chart-]") -> None:
    """Bring everything near once that is drawn only then."""
    script = "return [...document.querySelectorAll(arguments[0])].map((node) => node.id)"
    for place in browser.run(script, what):
        browser.run("document.getElementById(arguments[0]).scrollIntoView()", place)
        browser.wait(f"document.getElementById('{place}').dataset.drawn === 'yes'")


def test_layers_have_their_colors(opened: Browser) -> None:
    result = made_up()
    left, right = images()
    known = truth_of(result)

    low, high = np.nanpercentile(known, (1, 99))
    expected: dict[str, NDArray[np.uint8]] = {
        "left": left,
        "right": right,
        "disparity": colorize(result.disparity, low=low, high=high),
        "truth": colorize(known, low=low, high=high),
    }

    for layer, picture in expected.items():
        look_at(opened, layer)
        for x, y in PLACES:
            assert on_stage(opened, x, y) == pytest.approx(picture[y, x].tolist(), abs=4)

    look_at(opened, "error")
    assert on_stage(opened, 0, 0) == (255, 255, 255)  # 0.25 px is right
    assert on_stage(opened, *WRONG) == (128, 0, 38)  # the end of the scale
    assert (on_stage(opened, *HIDDEN), on_stage(opened, 0, 35)) == (NEUTRAL, UNSCORED)

    look_at(opened, "flags")
    assert on_stage(opened, *FLAGGED) == (0xE6, 0x9F, 0x00)

    look_at(opened, "confidence")
    assert on_stage(opened, 0, 0) == (253, 231, 36)  # viridis ends yellow
    look_at(opened, "uncertainty")
    assert on_stage(opened, 47, 35) == (0, 0, 3)  # the longest bar is the darkest
    assert on_stage(opened, *HIDDEN) == NEUTRAL


def test_flags_can_be_picked_out(opened: Browser) -> None:
    look_at(opened, "flags")
    assert "occluded 0.1 %" in opened.driver.find_element("css selector", "#scale").text
    click(opened, "#scale button:nth-child(1)")
    assert on_stage(opened, *HIDDEN) == (0x5A, 0x5A, 0x5A)
    assert on_stage(opened, *FLAGGED) == (236, 235, 230)
    click(opened, "#scale button:nth-child(1)")
    assert on_stage(opened, *FLAGGED) == (0xE6, 0x9F, 0x00)


def test_flicker_shows_left_and_right_in_turn(opened: Browser) -> None:
    left, right = images()

    click(opened, "#flicker")
    assert opened.run("return document.getElementById('flicker').ariaPressed") == "true"

    for side, image in (("right", right), ("left", left), ("right", right)):
        opened.wait(f"state.view === '{side}'")
        if opened.run("return state.view") == side:
            color = opened.run("flicker(false); return null") or on_stage(opened, 24, 18)
            shown = opened.run("return state.view")
            wanted = {"left": left, "right": right}[shown]
            assert color == tuple(wanted[18, 24])
            opened.run("flicker(true)")
        assert image is not None

    click(opened, "#flicker")
    stays = opened.run("return state.view")
    assert opened.run("return state.timer") == 0

    press(opened, "#stage", " ")
    assert {stays, opened.run("return state.view")} == {"left", "right"}


def test_slider_mixes_the_left_image_with_the_layer(opened: Browser) -> None:
    left, _ = images()
    near, far = (2, 18), (45, 18)
    whole = {place: on_stage(opened, *place) for place in (near, far)}

    press(opened, "#mix", "\ue011")  # Home
    for x, y in (near, far):
        assert on_stage(opened, x, y) == tuple(left[y, x])

    opened.run(
        "const mix = document.getElementById('mix'); mix.value = 50;"
        "mix.dispatchEvent(new Event('input'))"
    )

    assert on_stage(opened, *near) == whole[near]
    assert on_stage(opened, *far) == tuple(left[far[::-1]])

    click(opened, "label:has(input[value=fade])")
    for x, y in (near, far):
        middle = (left[y, x].astype(float) + whole[x, y]) / 2
        assert on_stage(opened, x, y) == pytest.approx(middle.tolist(), abs=2)


def drag(browser: Browser, start: tuple[float, float], by: tuple[int, int]) -> None:
    """Press the mouse on a place of the stage, in image coordinates, move it by so much, let go."""
    hover(browser, *start)
    actions = counterpart("selenium.webdriver").ActionChains(browser.driver, duration=30)
    actions.click_and_hold().move_by_offset(*by).release().perform()


def test_the_line_is_dragged_itself(opened: Browser) -> None:
    opened.run("setMix(0.5)")
    scale = opened.run("return stage.scale")

    drag(opened, (23.5, 5), (round(12 * scale), 0))
    assert opened.run("return state.mix") == pytest.approx(0.75, abs=0.02)
    value = opened.run("return Number(document.getElementById('mix').value)")
    assert value == pytest.approx(75, abs=2)

    assert opened.run("return state.held") is False

    opened.run("setMix(1)")
    drag(opened, (47, 17.5), (round(-24 * scale), 0))  # its handle waits at the border
    assert opened.run("return state.mix") == pytest.approx(0.5, abs=0.03)

    drag(opened, (10, 5), (40, 0))  # beside it there is nothing to drag
    assert opened.run("return state.mix") == pytest.approx(0.5, abs=0.03)


def wheel(browser: Browser, y: int) -> None:
    actions = counterpart("selenium.webdriver").ActionChains(browser.driver)
    canvas = browser.driver.find_element("css selector", "#stage")
    origin = counterpart("selenium.webdriver.common.actions.wheel_input").ScrollOrigin
    actions.scroll_from_origin(origin.from_element(canvas, 60, -40), 0, y).perform()


def test_the_wheel_zooms_to_the_pointer_without_a_click(opened: Browser) -> None:
    hover(opened, 30, 12)
    opened.run("document.activeElement.blur()")
    scrolled = "return scrollY"
    before = opened.run(scrolled)

    wheel(opened, -400)
    opened.wait("stage.zoom > 2")
    assert opened.run(scrolled) == before
    assert read(opened)["pixel"] != "24, 18"

    wheel(opened, 800)
    opened.wait("stage.zoom === 1")

    wheel(opened, 300)  # nothing is left to zoom: the page goes on
    opened.wait(f"scrollY > {before}")


def test_two_fingers_zoom_and_move(opened: Browser) -> None:
    """What was between them is between them afterwards."""
    opened.run("stage.zoomBy(2)")
    opened.run(
        """
        const box = stage.canvas.getBoundingClientRect();
        stage.canvas.setPointerCapture = () => {};
        const send = (type, pointerId, x, y) => {
          const place = { clientX: box.left + x, clientY: box.top + y };
          stage.canvas.dispatchEvent(new PointerEvent(type, { pointerId, ...place }));
        };
        send("pointerdown", 7, 200, 200);
        send("pointerdown", 8, 300, 200);
        window.between = stage.at({ clientX: box.left + 250, clientY: box.top + 200 });
        send("pointermove", 8, 340, 220);
        send("pointermove", 7, 180, 220);
        window.now = stage.at({ clientX: box.left + 260, clientY: box.top + 220 });
        send("pointerup", 7, 180, 220);
        send("pointerup", 8, 340, 220);
        delete stage.canvas.setPointerCapture;
        """
    )

    assert opened.run("return stage.zoom") == pytest.approx(3.2, rel=0.03)
    assert opened.run("return now") == pytest.approx(opened.run("return between"), abs=0.5)


@pytest.mark.parametrize("zoomed", [False, True])
def test_readout_shows_the_right_numbers(opened: Browser, *, zoomed: bool) -> None:
    result, (left, right) = made_up(), images()

    truth = truth_of(result)
    _, near, far = ps.depth_interval(result, CALIBRATION, keep="all")
    for x, y in PLACES:
        if zoomed:
            opened.run("stage.move(arguments[0], arguments[1], 4)", x, y)

        hover(opened, x, y)
        shown = read(opened)
        assert shown["pixel"] == f"{x}, {y}"
        found = float(result.disparity[y, x])
        assert float(shown["confidence"]) == pytest.approx(result.confidence[y, x], abs=0.007)
        assert shown["left"] == "{} {} {}".format(*left[y, x])

        if (x, y) == HIDDEN:
            assert (shown["disparity"], shown["match"], shown["error"]) == (
                "no estimate",
                "\N{EN DASH}",
                "missing",
            )
            continue

        assert number(shown["disparity"]) == pytest.approx(found, abs=NEARLY)
        assert number(shown["match"]) == pytest.approx(x - found, abs=NEARLY)
        assert number(shown["uncertainty"][1:]) == pytest.approx(
            result.uncertainty[y, x], abs=NEARLY
        )
        depth, *ends = re.findall(r"[\d.]+|\N{INFINITY}", shown["depth"])
        assert float(depth) == pytest.approx(50 * 0.2 / found, rel=0.004)
        for end, wanted in zip(ends, (near[y, x], far[y, x]), strict=True):
            assert float(end.replace("\N{INFINITY}", "inf")) == pytest.approx(wanted, rel=0.02)

        at = round(x - found)
        assert shown["right"] == ("outside" if at < 0 else "{} {} {}".format(*right[y, at]))

        unknown = np.isnan(truth[y, x])
        if unknown:
            assert shown["error"] == "not scored"
        else:
            assert number(shown["error"]) == pytest.approx(found - truth[y, x], abs=2 * NEARLY)

    opened.run("stage.zoomBy(0)")
    hover(opened, *FLAGGED)
    assert read(opened)["flags"] == "occluded, filled"
    hover(opened, *HIDDEN)
    assert read(opened)["flags"] == "masked"


def test_a_click_holds_the_pixel(opened: Browser) -> None:
    hover(opened, *WRONG, clicked=True)
    hover(opened, 40, 30)
    assert read(opened)["pixel"] == "12, 7"
    press(opened, "#stage", "\ue00c")  # Escape
    hover(opened, 40, 30)
    assert read(opened)["pixel"] == "40, 30"


def test_keys_do_what_the_mouse_does(opened: Browser) -> None:
    stage = "#stage"

    press(opened, stage, "\ue014", "\ue014", "\ue015")  # right, right, down
    assert read(opened)["pixel"] == "26, 19"
    spoken = opened.driver.find_element("css selector", "#spoken").get_attribute("textContent")
    assert spoken.startswith("Pixel 26, 19; Disparity d")

    press(opened, stage, "2")
    assert opened.run("return state.view") == "right"

    press(opened, stage, "+")
    assert opened.run("return stage.zoom") == 2

    press(opened, stage, "0")
    assert opened.run("return stage.zoom") == 1

    press(opened, stage, "f")
    assert opened.run("return state.timer") != 0
    press(opened, stage, "f")


def test_marks_measure_a_length_by_keys_alone(opened: Browser) -> None:
    """Its error bar holds 90 % of the lengths that disparities within their errors would have."""
    opened.run("forgetMarks()")
    result, ends = made_up(), ((20, 6), (44, 30))
    for name, (x, y) in zip("ab", ends, strict=True):
        opened.run("hold({ x: arguments[0] - 1, y: arguments[1] })", x, y)
        press(opened, "#stage", "\ue014", name)  # right

    drawn = np.random.default_rng(3).standard_normal((2, 200_000))
    points = []
    for (x, y), errors in zip(ends, drawn, strict=True):
        disparity, bar = float(result.disparity[y, x]), 0.02 * float(result.uncertainty[y, x])
        z = 50 * 0.2 / (disparity + errors * bar / 1.645)
        points.append(np.stack([(x - 23.5) * z / 50, (y - 17.5) * z / 50, z]))
    lengths = np.linalg.norm(points[1] - points[0], axis=0)

    # Bars so short that what is not linear does not matter, and a yaw that is known.
    opened.run("maps.uncertainty = maps.uncertainty.map((bar) => 0.02 * bar)")
    opened.run("window.share = page.scene.share; page.scene.share = [0, 0, 0]")
    found = opened.run("return lengthBetween(placeOf(marks.A), placeOf(marks.B))")
    opened.run("maps.uncertainty = maps.uncertainty.map((bar) => 50 * bar)")
    opened.run("page.scene.share = share")

    assert found["length"] == pytest.approx(np.median(lengths), rel=2e-3)
    low, high = np.quantile(lengths, [0.05, 0.95])
    assert found["bar"] == pytest.approx((high - low) / 2, rel=0.02)
    said = opened.text("measured")
    assert "A at 20, 6: depth" in said
    assert "Length from A to B:" in said
    assert opened.run("return element('measured').ariaLive") == "polite"
    assert opened.run("return element('section').querySelector('svg').ariaLabel") is not None


def test_what_is_not_trusted_is_hatched(opened: Browser) -> None:
    """Stripes are where the result is not trusted, and nowhere else."""
    opened.run("state.hatched = true; stage.paint()")
    alpha = opened.run(
        "const { data } = shown.hatches.getContext('2d').getImageData(0, 0, 48, 36);"
        "return Array.from({ length: 48 * 36 }, (_, at) => data[4 * at + 3])"
    )
    striped = np.reshape(alpha, SHAPE) > 0
    trusted = made_up().trusted
    assert not (striped & trusted).any()
    assert striped[~trusted].mean() > 0.5


def test_a_plane_is_found_again(opened: Browser) -> None:
    """A plane in space is put into the maps; pixels that are not trusted lie elsewhere."""
    rows, cols = np.indices(SHAPE)
    normal, distance = np.array([0.36, -0.48, 0.8]), 4.0
    rays = np.stack([(cols - 23.5) / 50, (rows - 17.5) / 50, np.ones(SHAPE)])
    disparity = 50 * 0.2 * np.tensordot(normal, rays, 1) / distance
    disparity[10:12] = 9
    sure = np.ones(SHAPE)
    sure[10:12] = 0.2

    found = opened.run(
        """
        const [disparity, confidence] = arguments;
        const before = { ...maps };
        Object.assign(maps, { disparity, confidence });
        const plane = planeIn({ x: 40, y: 30 }, { x: 5, y: 5 });
        Object.assign(maps, before);
        return plane;
        """,
        disparity.ravel().tolist(),
        sure.ravel().tolist(),
    )

    assert found["normal"] == pytest.approx(-normal, abs=1e-6)
    assert found["distance"] == pytest.approx(distance, rel=1e-6)
    assert found["rms"] < 1e-6
    assert (found["pixels"], found["trusted"]) == (36 * 26, 36 * 24)


def test_zoom_and_drag_keep_pixels_under_the_pointer(opened: Browser) -> None:
    hover(opened, 36, 9)
    opened.run("stage.zoomBy(4, [36.5, 9.5])")
    hover(opened, 36, 9)
    assert read(opened)["pixel"] == "36, 9"

    actions = counterpart("selenium.webdriver").ActionChains(opened.driver, duration=30)
    before = opened.run("return stage.x")
    actions.click_and_hold().move_by_offset(-60, 0).release().perform()
    assert opened.run("return stage.x") == pytest.approx(
        before + 60 / opened.run("return stage.scale"), abs=1
    )

    assert opened.run("return state.held") is False  # a drag is not a click


def test_points_are_drawn_and_turn(opened: Browser) -> None:
    draw_all(opened)
    opened.run("document.getElementById('cloud').scrollIntoView({block: 'center'})")
    first = settled(opened)
    colored = (np.ptp(first.astype(int), axis=2) > 60).mean()
    assert colored > 0.01  # the points have the colors of the noise they come from

    actions = counterpart("selenium.webdriver").ActionChains(opened.driver, duration=100)
    cloud = opened.driver.find_element("css selector", "#cloud")
    actions.move_to_element(cloud).click_and_hold().move_by_offset(120, 40).release().perform()
    turned = settled(opened)
    assert (np.abs(turned.astype(int) - first).max(axis=2) > 60).mean() > 0.01

    geometry = ranging(made_up().disparity, CALIBRATION, uncertainty=None, yaw=0.0, anchor=None)
    scene = scene_points(made_up().disparity, geometry, step=1)
    assert scene.shown > 1600
    counts = {}
    for keep in KEEPS:
        opened.run(
            "const keep = document.getElementById('keep'); keep.value = arguments[0];"
            "keep.dispatchEvent(new Event('change'))",
            keep,
        )
        near = ps.point_cloud(made_up(), CALIBRATION, keep=keep, max_depth=scene.limit)
        counts[keep] = f"{len(near):,} points"
        shown = f"document.getElementById('cloud-shown').textContent === '{counts[keep]}'"
        opened.wait(shown)
    assert len({*counts.values()}) == 3
    assert counts["all"] == f"{scene.shown:,} points"


def settled(browser: Browser) -> NDArray[np.uint8]:
    """Return the 3-D view once it stands still."""
    before = browser.picture("#cloud")
    for _ in range(20):
        after = browser.picture("#cloud")
        if (after == before).all():
            break
        before = after
    return before


def test_points_are_picked_and_turned_by_keys(opened: Browser) -> None:
    """A click on the middle of the view, as the left camera sees it, is the middle's pixel."""
    draw_all(opened)
    cloud = opened.driver.find_element("css selector", "#cloud")
    opened.run("arguments[0].scrollIntoView({block: 'center'})", cloud)
    opened.run("arguments[0].focus()", cloud)
    cloud.send_keys("0")

    before = settled(opened)
    cloud.send_keys("\ue014" * 4)
    turned = settled(opened)
    assert (np.abs(turned.astype(int) - before).max(axis=2) > 60).mean() > 0.01

    cloud.send_keys("0")
    assert (np.abs(settled(opened).astype(int) - before).max(axis=2) > 60).mean() < 0.001

    cloud.click()
    x, y = map(int, read(opened)["pixel"].split(", "))
    assert abs(x - 24) < 6
    assert abs(y - 18) < 6


def test_charts_say_what_is_under_the_pointer(opened: Browser) -> None:
    draw_all(opened)
    chart = opened.driver.find_element("css selector", "#chart-errors")
    opened.run("arguments[0].scrollIntoView({block: 'center'})", chart)
    counterpart("selenium.webdriver").ActionChains(opened.driver).move_to_element(chart).perform()
    shown = opened.driver.find_element("css selector", "#chart-errors .shown-here").text
    assert "% are off by more than" in shown
    assert opened.run("return document.querySelectorAll('#chart-disparities rect').length") == 120


def test_points_are_where_the_disparities_say(opened: Browser) -> None:
    found = made_up().disparity[18, 24]
    point = opened.run("return pointOf(18 * 48 + 24)")
    z = 50 * 0.2 / found
    assert point == pytest.approx([(24 - 23.5) * z / 50, (18 - 17.5) * z / 50, z], rel=1e-3)
    opened.run("showPixel(7 * 48 + 12)")
    assert read(opened)["pixel"] == "12, 7"


# What not every result has


def nothing_found() -> ps.Result:
    return replace(made_up(), disparity=np.full(SHAPE, np.nan, dtype=np.float32))


def of_noise(
    rows: int, cols: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], ps.Result, dict[str, Any]]:
    left, right = np.random.default_rng(1).integers(0, 256, (2, rows, cols), dtype=np.uint8)
    result = ps.match(left, right, num_disparities=1)
    return left, right, result, {"truth": np.zeros((rows, cols))}


Variant = tuple["NDArray[Any]", "NDArray[Any]", ps.Result, dict[str, Any]]
LEFT, RIGHT = images()
LEVELS = LEFT.astype(np.uint16) * 16, RIGHT.astype(np.uint16) * 16
FLOATS = LEFT * 1e6 - 3, RIGHT * 1e6
TRUTH = {"truth": truth_of(made_up())}
HOSTILE = {"title": "</script><script>throw 1</script> {{ x }} \u2028"}
VARIANTS: dict[str, Variant] = {
    "no truth": (LEFT, RIGHT, made_up(), {}),
    "no blur, no confidence": (
        LEFT,
        RIGHT,
        replace(made_up(), blur=None, confidence=None, uncertainty=None),
        TRUTH,
    ),
    "no estimate": (LEFT, RIGHT, nothing_found(), TRUTH),
    "gray and color": (LEFT[:, :, 0], RIGHT, made_up(), {}),
    "16 bits": (*LEVELS, made_up(), {}),
    "floats": (*FLOATS, made_up(), {}),
    "a hostile title": (LEFT, RIGHT, made_up(), HOSTILE),
    "1 x 1": of_noise(1, 1),
    "5 x 8": of_noise(5, 8),
    "2 x 60": of_noise(2, 60),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_whatever_there_is_is_shown(browser: Browser, tmp_path: Path, name: str) -> None:
    left, right, result, more = VARIANTS[name]
    write_pair_page(tmp_path / "page.html", left, right, result, **more)
    browser.open(tmp_path / "page.html", width=640, height=640)

    layers = browser.run("return views.map((view) => view.key)")
    assert ("truth" in layers) == ("error" in layers) == ("truth" in more)
    assert ("confidence" in layers) == (result.confidence is not None)
    assert ("uncertainty" in layers) == (result.uncertainty is not None)

    for layer in layers:
        look_at(browser, layer)

    rows, cols = result.disparity.shape
    hover(browser, cols - 1, rows - 1)
    found = result.disparity[-1, -1]
    if np.isfinite(found):
        assert number(read(browser)["disparity"]) == pytest.approx(found, abs=NEARLY)
    else:
        assert read(browser)["disparity"] == "no estimate"

    if name == "16 bits":
        assert "left" not in read(browser)  # what is shown is not what was measured

    if name in ("no truth", "no blur, no confidence", "no estimate", "1 x 1"):
        draw_all(browser)  # which takes seconds without a GPU: where it may make a difference

    assert browser.complaints() == []


def test_thinned_out_numbers_are_those_of_their_pixels(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_module, "MOST_PIXELS", 500)
    result = made_up()
    write_pair_page(tmp_path / "page.html", *images(), result)
    browser.open(tmp_path / "page.html")

    assert "every 2nd pixel of every 2nd row" in browser.run("return document.body.innerText")
    hover(browser, 5, 7)  # of those shown
    shown = read(browser)

    assert shown["pixel"] == "10, 14"
    assert number(shown["disparity"]) == pytest.approx(result.disparity[14, 10], abs=NEARLY)
    assert number(shown["match"]) == pytest.approx(10 - result.disparity[14, 10], abs=NEARLY)

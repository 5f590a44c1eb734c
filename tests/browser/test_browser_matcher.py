"""The core as WebAssembly in a browser: the same maps, to the bit, and what it says of faults."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import base64
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from browser import Browser, serving
from conftest import ROOT
from phasestereo.io import read_image
from phasestereo.result import MAPS
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair

Image = NDArray[Any]
Pair = tuple[Image, Image]

WEB = ROOT / "web"

# Has the page do one thing with the matcher, and keep what comes of it where Python can see it.
_CALL = """
const [task, images, options] = arguments;
window.outcome = null;
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const image = ([width, height, text]) =>
    ({ width, height, data: new Uint8ClampedArray(bytes(text).buffer) });
const text = (array) => {
    const values = new Uint8Array(array.buffer);
    let characters = "";
    for (let i = 0; i < values.length; i += 8192)
        characters += String.fromCharCode(...values.subarray(i, i + 8192));
    return btoa(characters);
};
window.matcher[task](...images.map(image), options).then((value) => {
    for (const name of ["disparity", "flags", "confidence", "uncertainty"])
        if (value[name]) value[name] = text(value[name]);
    window.outcome = { value };
}, (error) => { window.outcome = { error: error.message }; });
"""


# Has the worker tell how much memory the core has, whenever it is asked.
_TELLING = """
window.Worker = class extends Worker {
    constructor(url, options) {
        const more = `import "${url}";
            const { instantiate } = WebAssembly;
            let memory = null;
            WebAssembly.instantiate = async (...given) => {
                const made = await instantiate(...given);
                memory = made.exports.memory;
                return made;
            };
            const work = self.onmessage;
            self.onmessage = (event) => {
                const { id, task } = event.data;
                if (task !== "tell") work(event);
                else postMessage({ id, value: memory.buffer.byteLength });
            };`;
        super(URL.createObjectURL(new Blob([more], { type: "text/javascript" })), options);
    }
};
"""

# Has the page match again and again, and keep the core's bytes of memory before and after.
_REPEAT = """
const [times, address] = arguments;
const image = (width, height) => {
    const data = new Uint8ClampedArray(4 * width * height);
    for (let at = 0; at < data.length; at++) data[at] = Math.imul(at + width, 2654435761) >>> 24;
    return { width, height, data };
};
const sizes = [[96, 64], [40, 90], [17, 16], [1, 1]];
import(address).then(async ({ createMatcher }) => {
    const matcher = await createMatcher();
    let done = 0;
    const once = async (n) => {
        const [width, height] = sizes[n % sizes.length];
        const pair = [image(width, height), image(width, height)];
        const preset = ["fast", "robust", "paper"][n % 3];
        const numDisparities = n % 5 ? 16 : 0;
        await matcher.match(...pair, { preset, numDisparities }).then(() => done++, () => {});
        if (n % 7 === 0) await matcher.check(...pair).catch(() => {});
    };
    for (let n = 0; n < 60; n++) await once(n);
    const before = await matcher.call("tell", {});
    for (let n = 0; n < times; n++) await once(n);
    window.told = [before, await matcher.call("tell", {}), done];
    matcher.close();
}).catch((error) => { window.told = error.message; });
"""


class MatcherPage:
    """A page that has the matcher."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def call(self, task: str, pair: Pair, **options: Any) -> dict[str, Any]:
        """Return what comes of a call: ``value`` or ``error``."""
        self.browser.run(_CALL, task, [_sent(image) for image in pair], options)
        self.browser.wait("window.outcome !== null")
        outcome: dict[str, Any] = self.browser.run("return window.outcome")
        return outcome

    def match(self, pair: Pair, **options: Any) -> dict[str, Any]:
        """Return a map, its planes as arrays."""
        result: dict[str, Any] = self.call("match", pair, **options)["value"]
        size = result["height"], result["width"]
        for name, kind in MAPS.items():
            dtype = np.dtype(kind.dtype).newbyteorder("<")
            if result[name] is not None:
                result[name] = np.frombuffer(base64.b64decode(result[name]), dtype).reshape(size)
        return result


def _sent(image: Image) -> tuple[int, int, str]:
    """Return an image as RGBA, as a page has it."""
    height, width = image.shape[:2]
    rgba = np.full((height, width, 4), 255, np.uint8)
    rgba[:, :, :3] = image.reshape(height, width, -1)
    return width, height, base64.b64encode(rgba.tobytes()).decode()


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Return where the files of the page are served; skip visibly where they are not built."""
    if not (WEB / "phasestereo.wasm").is_file():
        pytest.skip("no web/phasestereo.wasm: make web")
    with serving(WEB) as address:
        yield address


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> MatcherPage:
    """Return a page whose matcher is ready."""
    browser.visit(f"{address}/matcher.js")
    browser.run(
        "import(arguments[0]).then((module) => module.createMatcher())"
        ".then((matcher) => { window.matcher = matcher; })",
        f"{address}/matcher.js",
    )

    browser.wait("window.matcher !== undefined")
    return MatcherPage(browser)


@pytest.fixture(scope="module")
def rendered() -> Pair:
    """Return a rendered pair whose left image is out of focus."""
    pair = render_pair(3, height=240, width=320, num_disparities=48)
    return Degradation(disk_psf(3.0), noise=1.0)(pair.left), pair.right


def _same(found: dict[str, Any], expected: ps.Result) -> None:
    for name in MAPS:
        wanted = expected.maps.get(name)
        if wanted is None:
            assert found[name] is None
        else:
            np.testing.assert_array_equal(found[name], wanted)


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
def test_maps_are_those_of_python_to_the_bit(
    page: MatcherPage, rendered: Pair, preset: str
) -> None:
    found = page.match(rendered, preset=preset, numDisparities=48)
    _same(found, ps.match(*rendered, preset=preset, num_disparities=48))
    assert found["milliseconds"] > 0


def test_a_real_pair_is_matched_over_the_range_that_is_found(page: MatcherPage, data: Path) -> None:
    folder = data / "middlebury" / "scenes2003" / "cones"
    pair = read_image(folder / "im2.png"), read_image(folder / "im6.png")

    expected = ps.match(*pair)
    found = page.match(pair)
    _same(found, expected)

    span = found["found"]["range"]
    assert (span["minDisparity"], span["numDisparities"], span["origin"]) == (
        expected.search.min_disparity,
        expected.search.num_disparities,
        "found",
    )


def test_what_is_found_is_what_python_finds(page: MatcherPage, rendered: Pair) -> None:
    expected = ps.match(*rendered, num_disparities=48)
    found = page.call("check", rendered, numDisparities=48)["value"]

    names = "side", "kind", "size", "angle", "share"
    kinds = [{name: blur[name] for name in names} for blur in found["blur"]]
    there = [{name: blur[name] for name in names} for blur in expected.blur.as_dicts()]

    assert (kinds, kinds[0]["side"], kinds[0]["kind"]) == (there, "left", "disk")

    for name in ("certainty", "contrast", "noise", "impulses", "coding"):
        assert found[name] == pytest.approx(getattr(expected.blur, name), rel=1e-6)

    assert tuple(found["rows"]["coefficients"]) == expected.alignment.coefficients
    for name in ("error", "blocks", "spread", "applied"):
        assert found["rows"][name] == getattr(expected.alignment, name)

    assert found["range"]["confidence"] == expected.search.confidence
    assert (found["range"]["origin"], found["inverted"]) == ("given", False)


def test_findings_are_those_of_python_word_for_word(page: MatcherPage, rendered: Pair) -> None:
    dim = rendered[0] // 3, rendered[1]
    matched, checked = page.match(dim)["found"], page.call("check", dim)["value"]

    for found, expected in ((matched, ps.match(*dim)), (checked, ps.check(*dim))):
        assert found["findings"] == [asdict(one) for one in expected.findings]
        assert any("is darker" in one["sentence"] for one in found["findings"])


def test_faults_are_reported_and_the_next_call_works(page: MatcherPage, rendered: Pair) -> None:
    left, right = rendered
    small = right[:20]

    for pair, options, message in (
        ((left, small), {}, "right: got 20 x 320 pixels; accepts up to 8 times as many or as few"),
        (rendered, {"preset": "best"}, "preset: got 'best'; accepts 'robust', 'paper', 'fast'"),
        (rendered, {"numDisparities": 321}, "num_disparities: got 321; accepts an integer"),
        (rendered, {"minDisparity": 1}, "min_disparity: got 1; accepts 0 where num_disparities"),
    ):
        outcome = page.call("match", pair, **options)
        assert outcome["error"].startswith(message)

    _same(
        page.match(rendered, preset="fast", numDisparities=48),
        ps.match(*rendered, preset="fast", num_disparities=48),
    )


def test_two_hundred_matches_take_no_more_memory(browser: Browser, address: str) -> None:
    """Of some sizes, by all presets; with those that are refused, too."""
    browser.visit(f"{address}/matcher.js")
    browser.run(_TELLING)
    browser.run(_REPEAT, 200, f"{address}/matcher.js")
    browser.wait("window.told !== undefined", 120)
    before, after, done = browser.run("return window.told")
    assert before == after
    assert done > 200


def test_a_module_that_is_not_there_is_reported(page: MatcherPage, address: str) -> None:
    page.browser.run(
        "import(arguments[0]).then((module) => module.createMatcher({ wasm: 'nothing.wasm' }))"
        ".catch((error) => { window.refused = error.message; })",
        f"{address}/matcher.js",
    )
    page.browser.wait("window.refused !== undefined")
    assert "nothing.wasm: 404" in page.browser.run("return window.refused")

"""The core as WebAssembly in a browser: the same maps, to the bit, and what it says of faults."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from dataclasses import asdict
from pathlib import Path

import pytest

import phasestereo as ps
from phasestereo.io import read_image
from phasestereo.settings import PresetName
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from support.browser import Browser
from support.matcher_page import (
    MatcherPage,
    Pair,
    address as address,  # noqa: PLC0414 - a fixture
    assert_same_maps,
    page as page,  # noqa: PLC0414 - a fixture
)

# Has the worker report the memory of the core, whenever it is asked.
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
                if (task !== "report") work(event);
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
    // Once every size by every preset, with either range, with a check and without.
    for (let n = 0; n < 420; n++) await once(n);
    const before = await matcher.call("report", {});
    for (let n = 0; n < times; n++) await once(n);
    window.reported = [before, await matcher.call("report", {}), done];
    matcher.close();
}).catch((error) => { window.reported = error.message; });
"""


@pytest.fixture(scope="module")
def rendered() -> Pair:
    """Return a rendered pair whose left image is out of focus."""
    pair = render_pair(3, height=240, width=320, num_disparities=48)
    return Degradation(disk_psf(3.0), noise=1.0)(pair.left), pair.right


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
def test_maps_are_those_of_python_to_the_bit(
    page: MatcherPage, rendered: Pair, preset: PresetName
) -> None:
    found = page.match(rendered, preset=preset, numDisparities=48)
    assert_same_maps(found, ps.match(*rendered, preset=preset, num_disparities=48))
    assert found["milliseconds"] > 0


def test_a_real_pair_is_matched_over_the_range_that_is_found(page: MatcherPage, data: Path) -> None:
    folder = data / "middlebury" / "scenes2003" / "cones"
    pair = read_image(folder / "im2.png"), read_image(folder / "im6.png")

    expected = ps.match(*pair)
    found = page.match(pair)
    assert_same_maps(found, expected)

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

    assert_same_maps(
        page.match(rendered, preset="fast", numDisparities=48),
        ps.match(*rendered, preset="fast", num_disparities=48),
    )


def test_two_hundred_matches_take_no_more_memory(browser: Browser, address: str) -> None:
    """Of some sizes, by all presets; with those that are refused, too."""
    browser.visit(f"{address}/matcher.js")
    browser.run(_TELLING)
    browser.run(_REPEAT, 200, f"{address}/matcher.js")
    browser.wait("window.reported !== undefined", 120)
    before, after, done = browser.run("return window.reported")
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

"""Searches on the GPU of a browser: the bits of the core, failures, and what is refused.

Chromium's SwiftShader computes on the processor as a GPU would.
"""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.result import MAPS
from phasestereo.settings import PresetName
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from support.browser import Browser
from support.matcher_page import (
    MatcherPage,
    Pair,
    address as address,  # noqa: PLC0414 - a fixture
    assert_same_maps,
)

NAME = "google swiftshader"

# Starts workers with a script of the test's, which may change what they use, and reports what was
# submitted to the GPU.
_WORKER = """
const [patch] = arguments;
window.Worker = class extends Worker {
    constructor(url, options) {
        const more = `import "${url}";
            const { submit } = GPUQueue.prototype;
            let [submitted, matches] = [0, 0];
            GPUQueue.prototype.submit = function (...given) {
                submitted++;
                return submit.apply(this, given);
            };
            const work = self.onmessage;
            self.onmessage = (event) => {
                const { id, task } = event.data;
                matches += task === "match";
                if (task !== "report") work(event);
                else postMessage({ id, value: submitted });
            };
            ${patch}`;
        super(URL.createObjectURL(new Blob([more], { type: "text/javascript" })), options);
    }
};
"""

_CREATE = """
const [address, device, change] = arguments;
window.change = change;
window.outcome = null;
import(address).then(({ createMatcher }) => createMatcher({ device })).then((matcher) => {
    window.matcher = matcher;
    window.outcome = "";
}).catch((error) => { window.outcome = error.message; });
"""

# Has the matcher do four things one after another, and then all at once; are their results equal?
_TOGETHER = """
const image = (width, height, shift) => {
    const data = new Uint8ClampedArray(4 * width * height);
    for (let at = 0; at < data.length; at++)
        data[at] = at % 4 === 3 ? 255 : Math.imul((at >> 2) + shift + 1, 2654435761) >>> 24;
    return { width, height, data };
};
const pair = (width, height) => [image(width, height, 0), image(width, height, 3)];
const works = [
    () => window.matcher.match(...pair(70, 50), { preset: "fast", numDisparities: 12 }),
    () => window.matcher.check(...pair(90, 60)),
    () => window.matcher.match(...pair(61, 40), { preset: "robust", numDisparities: 8 }),
    () => window.matcher.match(...pair(50, 70), { preset: "fast", numDisparities: 16 }),
];
const text = ({ milliseconds, ...value }) =>
    JSON.stringify(value, (_, one) => (ArrayBuffer.isView(one) ? [...one].join() : one));
window.outcome = null;
(async () => {
    const apart = [];
    for (const work of works) apart.push(text(await work()));
    const together = (await Promise.all(works.map((work) => work()))).map(text);
    window.outcome = apart.map((one, n) => one === together[n]);
})().catch((error) => { window.outcome = error.message; });
"""

# A setting that the page does not offer.
_SGM = """
const { instantiate } = WebAssembly;
WebAssembly.instantiate = async (...given) => {
    const { exports } = await instantiate(...given);
    const { memory, phasestereo_allocate, phasestereo_new } = exports;
    const texts = ["optimizer", "sgm"].map((text) => {
        const bytes = new TextEncoder().encode(`${text}\\0`);
        const start = phasestereo_allocate(bytes.length);
        new Uint8Array(memory.buffer, start, bytes.length).set(bytes);
        return start;
    });
    const setting = phasestereo_allocate(8);
    new Uint32Array(memory.buffer, setting, 2).set(texts);
    const made = (preset) => phasestereo_new(preset, setting, 1, 1);
    return { exports: { ...exports, phasestereo_new: made } };
};
"""

# A GPU whose buffers hold a band of 64 rows.
_SMALL = """
for (const name of ["maxBufferSize", "maxStorageBufferBindingSize"])
    Object.defineProperty(GPUSupportedLimits.prototype, name, { value: 150_000 });
"""

# What goes wrong, by a part of the reason that is reported.
FAULTS = {
    "device lost: ": """
        const { requestDevice } = GPUAdapter.prototype;
        let device = null;
        GPUAdapter.prototype.requestDevice = async function (...given) {
            return (device = await requestDevice.apply(this, given));
        };
        const counted = GPUQueue.prototype.submit;
        let asked = 0;
        GPUQueue.prototype.submit = function (...given) {
            counted.apply(this, given);
            asked += matches > 0;
            if (asked === 2) device.destroy();
        };
    """,
    "WGSL": """
        const { createShaderModule } = GPUDevice.prototype;
        GPUDevice.prototype.createShaderModule = function () {
            return createShaderModule.call(this, { code: "this is not a shader" });
        };
    """,
    "1125899906842624": """
        const { createBuffer } = GPUDevice.prototype;
        GPUDevice.prototype.createBuffer = function ({ usage }) {
            return createBuffer.call(this, { size: 2 ** 50, usage });
        };
    """,
    "no answer in 60 seconds": """
        const { setTimeout } = self;
        self.setTimeout = (done, time) => setTimeout(done, time / 60);
        GPUBuffer.prototype.mapAsync = () => new Promise(() => {});
    """,
    "differ from those of the processor": """
        const { getMappedRange } = GPUBuffer.prototype;
        GPUBuffer.prototype.getMappedRange = function (...given) {
            const range = getMappedRange.apply(this, given);
            new Uint32Array(range).fill(0);
            return range;
        };
    """,
}


def created(
    browser: Browser, address: str, device: str, patch: str = ""
) -> tuple[MatcherPage, str]:
    """Return a page with a matcher, and the message if that was refused, else an empty text."""
    browser.visit(f"{address}/matcher.js")
    browser.run(_WORKER, patch)
    browser.run(_CREATE, f"{address}/matcher.js", device, f"{device} {patch}")
    browser.wait("window.outcome !== null", 120)
    return MatcherPage(browser), browser.run("return window.outcome")


def on_gpu(browser: Browser, address: str, patch: str = "") -> MatcherPage:
    """Return a page whose matcher searches on a GPU; skip visibly where the browser has none."""
    page, refused = created(browser, address, "gpu", patch)
    if refused.startswith("device: got 'gpu'"):
        pytest.skip(refused)
    assert refused == ""
    return page


def submitted(page: MatcherPage) -> int:
    """Return the number of tasks that the GPU was given."""
    return int(page.browser.run("return window.matcher.call('report', {})"))


def rendered(rows: int, cols: int) -> Pair:
    pair = render_pair(3, height=max(rows, 16), width=cols, num_disparities=16)
    return pair.left[:rows], pair.right[:rows]


def half_blurred() -> Pair:
    """Return a pair with two versions of its right image: half of the left one is out of focus."""
    left, right = rendered(160, 240)
    blurred = Degradation(disk_psf(3.0), noise=1.0)(left)
    return np.concatenate([left[:, :120], blurred[:, 120:]], axis=1), right


@pytest.fixture
def page(browser: Browser, address: str) -> MatcherPage:
    """Return a page whose matcher searches on the GPU; only loaded when need be."""
    is_there = browser.run("return window.change === 'gpu '")
    return MatcherPage(browser) if is_there else on_gpu(browser, address)


@pytest.mark.parametrize("preset", ["fast", "robust"])
@pytest.mark.parametrize(
    ("size", "disparities"),
    [
        ((48, 64), (0, 16)),
        ((67, 41), (-3, 7)),
        ((1, 90), (0, 1)),
        ((131, 83), (5, 70)),
        ((33, 130), (-20, 37)),
    ],
)
def test_maps_are_those_of_the_core_to_the_bit(
    page: MatcherPage, preset: PresetName, size: tuple[int, int], disparities: tuple[int, int]
) -> None:
    minimum, count = disparities
    pair, before = rendered(*size), submitted(page)
    found = page.match(pair, preset=preset, minDisparity=minimum, numDisparities=count)
    assert (found["engine"], submitted(page) > before) == (NAME, True)
    assert_same_maps(
        found, ps.match(*pair, preset=preset, min_disparity=minimum, num_disparities=count)
    )


@pytest.mark.parametrize(("rows", "cols", "count"), [(70, 75, 9), (150, 60, 18)])
def test_paths_along_columns_are_those_of_the_core(
    browser: Browser, address: str, rows: int, cols: int, count: int
) -> None:
    page, pair = on_gpu(browser, address, _SGM), rendered(rows, cols)
    found = page.match(pair, preset="fast", numDisparities=count)
    assert (found["engine"], submitted(page) > 0) == (NAME, True)
    assert_same_maps(found, ps.match(*pair, preset="fast", optimizer="sgm", num_disparities=count))


def test_both_versions_of_the_right_image_are_searched(page: MatcherPage) -> None:
    pair, before = half_blurred(), submitted(page)
    found = page.match(pair, numDisparities=20)
    assert (found["engine"], submitted(page) > before) == (NAME, True)
    assert {blur["side"] for blur in found["found"]["blur"]} == {"none", "left"}
    assert_same_maps(found, ps.match(*pair, num_disparities=20))


def test_a_gpu_with_little_memory_searches_bands_one_by_one(
    page: MatcherPage, browser: Browser, address: str
) -> None:
    pair, before = rendered(200, 50), submitted(page)
    whole = page.match(pair, preset="fast", numDisparities=16)
    once = submitted(page) - before

    small = on_gpu(browser, address, _SMALL)
    before = submitted(small)
    found = small.match(pair, preset="fast", numDisparities=16)
    assert submitted(small) - before > once
    for name in MAPS:
        np.testing.assert_array_equal(found[name], whole[name])


def test_masks_are_left_to_the_core(page: MatcherPage) -> None:
    left, right = rendered(60, 80)
    masks = np.ones((2, 60, 80), dtype=bool)
    masks[0, 20:40, 30:50] = masks[1, :10, :] = False
    seen = [
        np.dstack([image, 255 * mask]).astype(np.uint8)
        for image, mask in zip((left, right), masks, strict=True)
    ]
    found = page.match((seen[0], seen[1]), preset="fast", numDisparities=16)
    assert found["engine"] == "WebAssembly"
    expected = ps.match(
        left, right, preset="fast", num_disparities=16, left_mask=masks[0], right_mask=masks[1]
    )
    assert_same_maps(found, expected)


@pytest.mark.parametrize("reason", FAULTS)
def test_a_device_that_fails_leaves_the_match_to_the_core(
    browser: Browser, address: str, reason: str
) -> None:
    page, pair = on_gpu(browser, address, FAULTS[reason]), half_blurred()
    before = submitted(page)
    presets: list[PresetName] = ["robust", "fast"]
    for preset in presets:
        found = page.match(pair, preset=preset, numDisparities=20)
        assert_same_maps(found, ps.match(*pair, preset=preset, num_disparities=20))
        assert found["engine"] == "WebAssembly"
        said = [one["sentence"] for one in found["found"]["findings"]]
        failed = "the GPU failed, and the processor took over, with the same result: "
        reasons = [one.removeprefix(failed) for one in said if one.startswith(failed)]
        assert (len(reasons), reason in reasons[0]) == (1, True)
    # It is not asked again.
    assert submitted(page) - before <= 2


def test_software_is_used_only_if_it_is_asked_for(browser: Browser, address: str) -> None:
    pair = rendered(48, 64)
    for device in ("auto", "cpu"):
        page, refused = created(browser, address, device)
        assert refused == ""
        found = page.match(pair, preset="fast", numDisparities=16)
        assert (found["engine"], submitted(page)) == ("WebAssembly", 0)
    assert_same_maps(found, ps.match(*pair, preset="fast", num_disparities=16))


@pytest.mark.parametrize(
    ("missing", "named"),
    [
        ("delete WebAssembly.Suspending", "JavaScript Promise Integration"),
        ("Object.defineProperty(navigator, 'gpu', { value: undefined })", "WebGPU"),
        ("navigator.gpu.requestAdapter = async () => null", "adapter"),
    ],
)
def test_browsers_without_it_have_the_core(
    browser: Browser, address: str, missing: str, named: str
) -> None:
    _, refused = created(browser, address, "gpu", missing)
    assert refused.startswith("device: got 'gpu'; accepts 'auto' or 'cpu' here: ")
    assert refused.endswith(named)

    page, refused = created(browser, address, "auto", missing)
    assert refused == ""
    pair = rendered(48, 64)
    found = page.match(pair, preset="fast", numDisparities=16)
    assert_same_maps(found, ps.match(*pair, preset="fast", num_disparities=16))
    assert (found["engine"], submitted(page)) == ("WebAssembly", 0)


def test_another_device_is_refused(browser: Browser, address: str) -> None:
    _, refused = created(browser, address, "tpu")
    assert refused == "device: got 'tpu'; accepts 'auto', 'cpu', 'gpu'"


def test_calls_wait_for_each_other(page: MatcherPage) -> None:
    """While the core waits for the GPU, nothing else may use its memory."""
    before = submitted(page)
    page.browser.run(_TOGETHER)
    page.browser.wait("window.outcome !== null", 120)
    assert page.browser.run("return window.outcome") == [True] * 4
    assert submitted(page) - before >= 8

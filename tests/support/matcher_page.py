"""A page in a browser that has the matcher."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.result import MAPS
from support import ROOT
from support.browser import Browser, serving

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


class MatcherPage:
    """A page that has the matcher."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def call(self, task: str, pair: Pair, **options: Any) -> dict[str, Any]:
        """Return the outcome of a call: ``value`` or ``error``."""
        self.browser.run(_CALL, task, [_sent(image) for image in pair], options)
        self.browser.wait("window.outcome !== null", 120)
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


def assert_same_maps(found: dict[str, Any], expected: ps.Result) -> None:
    """Check that a page returned all maps of a match in Python, to the bit."""
    for name in MAPS:
        wanted = expected.maps.get(name)
        if wanted is None:
            assert found[name] is None
        else:
            np.testing.assert_array_equal(found[name], wanted)


def _sent(image: Image) -> tuple[int, int, str]:
    """Return an image as RGBA, as a page has it."""
    height, width = image.shape[:2]
    rgba = np.full((height, width, 4), 255, np.uint8)
    planes = image.reshape(height, width, -1)
    rgba[:, :, : max(3, planes.shape[2])] = planes
    return width, height, base64.b64encode(rgba.tobytes()).decode()


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Return the address of the page's files; skip visibly where they are not built."""
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

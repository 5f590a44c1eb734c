"""A browser as the tests drive it: Chromium without a window and without a network."""

import base64
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo.io.raster import decode_raster

# SwiftShader draws WebGL and computes WebGPU, on the processor; whatever leads out of the machine
# goes nowhere.
_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--use-fake-device-for-media-stream=device-count=2",
    "--use-fake-ui-for-media-stream",
)

# Chromium's hints on how canvases and WebGL could be faster.
_HINTS = ("willReadFrequently", "GPU stall due to ReadPixels")

# Texts on plain backgrounds that are seen, each with what is behind it; what is disabled is exempt.
_FAINT = """
const context = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
const parts = (color) => {
  context.clearRect(0, 0, 1, 1);
  context.fillStyle = color;
  context.fillRect(0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data];
};
const over = (front, back) => [0, 1, 2].map((n) => back[n] + (front[n] - back[n]) * front[3] / 255);
const linear = (part) => part < 10 ? part / 3294.6 : ((part / 255 + 0.055) / 1.055) ** 2.4;
const light = (color) =>
  [0.2126, 0.7152, 0.0722].reduce((sum, share, n) => sum + share * linear(color[n]), 0);
const paper = parts(getComputedStyle(document.documentElement).getPropertyValue("--page"));
const found = [];
for (const node of document.querySelectorAll("body *")) {
  const own = [...node.childNodes].some((one) => one.nodeType === 3 && one.textContent.trim());
  const isSeen = node.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  if (!own || !isSeen || node.disabled || node.closest("script, noscript, .unseen")) continue;
  let back = paper;
  const around = [];
  for (let one = node; one; one = one.parentElement) around.unshift(one);
  for (const one of around) back = over(parts(getComputedStyle(one).backgroundColor), back);
  const style = getComputedStyle(node);
  const text = over(parts(node.ownerSVGElement ? style.fill : style.color), back);
  const [bright, dark] = [light(text), light(back)].sort((a, b) => b - a);
  const contrast = (bright + 0.05) / (dark + 0.05);
  if (contrast < 4.5) found.push([contrast.toFixed(2), node.outerHTML.slice(0, 80)]);
}
return found;
"""


class Browser:
    """One Chromium, by the driver that is installed beside it; pages open in a window of it."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, page: Path, *, width: int = 1280, height: int = 900, dark: bool = False) -> None:
        """Open a page at this size and in this theme, and wait until its scripts are done."""
        self.visit(page.absolute().as_uri(), width=width, height=height, dark=dark)
        if self.run("return document.getElementById('page') !== null"):
            self.wait("document.documentElement?.dataset.ready === 'yes'")

    def visit(
        self, address: str, *, width: int = 1280, height: int = 900, dark: bool = False
    ) -> None:
        """Open an address at this size and in this theme."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.driver.get("about:blank")  # an earlier page may ask for more until it is left
        self.complaints()
        self.requests()
        self.driver.get(address)

    def run(self, script: str, *arguments: Any) -> Any:
        """Run a script in the page; return its result."""
        return self.driver.execute_script(script, *arguments)

    def text(self, element: str) -> str:
        """Return the text of the element with this id."""
        return str(self.run(f"return document.getElementById('{element}').textContent"))

    def names(self, *roles: str) -> list[tuple[str, str]]:
        """Return role and name of what a screen reader finds in the page, of these roles."""
        nodes = self.driver.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        return [
            (node["role"]["value"], node.get("name", {}).get("value", ""))
            for node in nodes
            if not node["ignored"] and node["role"]["value"] in roles
        ]

    def wait(self, condition: str, seconds: float = 30.0) -> None:
        """Wait until an expression of the page is true."""
        until = monotonic() + seconds
        while not self.run(f"return Boolean({condition})"):
            if monotonic() > until:
                pytest.fail(f"{condition}: did not come true; the console says {self.complaints()}")
            sleep(0.03)

    def complaints(self) -> list[str]:
        """Return the messages of the console since the last call, but for hints on speed."""
        entries = self.driver.get_log("browser")
        messages = [line["message"] for line in entries if line["level"] in ("SEVERE", "WARNING")]
        return [text for text in messages if not any(hint in text for hint in _HINTS)]

    def requests(self) -> list[str]:
        """Return the requests since the last call, but for data that the page holds."""
        entries = self.driver.get_log("performance")
        events = [json.loads(line["message"])["message"] for line in entries]
        urls = [
            event["params"]["request"]["url"]
            for event in events
            if event["method"] == "Network.requestWillBeSent"
        ]

        return [url for url in urls if not url.startswith(("data:", "blob:"))]

    def faint(self) -> list[list[str]]:
        """Return the texts in the page whose contrast is below 4.5, as WCAG 2.1 has it."""
        return list(self.run(_FAINT))

    def picture(self, selector: str = "") -> NDArray[np.uint8]:
        """Return the visible part, or one element, as RGB."""
        if selector:
            shot = self.driver.find_element("css selector", selector).screenshot_as_png
        else:
            shot = self.driver.get_screenshot_as_png()
        return np.asarray(decode_raster(io.BytesIO(shot)), dtype=np.uint8)[:, :, :3]

    def whole_page(self) -> bytes:
        """Return all of the page as a PNG, also what is out of sight."""
        height = self.run("return document.documentElement.scrollHeight")
        width = self.run("return innerWidth")
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        options = {"captureBeyondViewport": True, "clip": clip}
        shot = self.driver.execute_cdp_cmd("Page.captureScreenshot", options)["data"]
        return base64.b64decode(shot)


@contextmanager
def running(webdriver: Any, program: str, service: str) -> Iterator[Browser]:
    """Start a browser, and end it afterwards; both programs are named: none is downloaded."""
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for option in _OPTIONS:
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})

    driver = webdriver.Chrome(options, webdriver.ChromeService(service))
    try:
        yield Browser(driver)
    finally:
        driver.quit()


class _QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *_: object) -> None:  # noqa: A002 - the name of the base class
        """Say nothing of what is asked for."""


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Serve the files of a folder on this machine; gives the address, no slash at its end."""
    handler = partial(_QuietHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()

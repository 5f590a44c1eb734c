"""The page "try it" in a real browser: with a stand-in for the matcher, and with the core."""

import shutil
import struct
import subprocess
import sys
import zlib
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phasestereo.cli.errors import spelled
from phasestereo.io import read_disparity, read_image
from support import ENVIRONMENT, ROOT, counterpart, hostile
from support.browser import Browser, serving

for module in ("jinja2", "matplotlib"):
    counterpart(module)

CORE = ROOT / "web" / "phasestereo.wasm"
RIGHT, END = "\ue014", "\ue010"  # keys
MOST_BYTES = 910_000  # compressed


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the page twice: with the core, if it is there, and with a stand-in."""
    folder = tmp_path_factory.mktemp("web")
    program = [sys.executable, str(ROOT / "docs" / "try_page.py"), str(folder / "core")]
    subprocess.run(program, env=ENVIRONMENT, check=True)  # noqa: S603  # ours
    shutil.copytree(folder / "core", folder / "stand-in")
    shutil.copy(ROOT / "tests" / "stand_in_matcher.js", folder / "stand-in" / "matcher.js")
    return folder


@pytest.fixture(scope="module")
def site(built: Path) -> Iterator[str]:
    with serving(built) as address:
        yield address


def matched(browser: Browser) -> None:
    browser.wait("document.documentElement.dataset.matched === 'robust'")


def open_page(browser: Browser, address: str, *, width: int = 1440, dark: bool = False) -> None:
    height = 844 if width < 800 else 900
    browser.visit(f"{address}/index.html", width=width, height=height, dark=dark)
    matched(browser)


@pytest.fixture
def opened(browser: Browser, site: str) -> Browser:
    """Return a browser that shows the page as it is at first; only loaded when need be."""
    address = f"{site}/stand-in"

    if browser.run("return location.href + innerWidth") != f"{address}/index.html1440":
        open_page(browser, address)

    browser.run("window.refusal = ''; element('pair').selectedIndex = 0")
    browser.run("element('pair').dispatchEvent(new Event('change'))")
    matched(browser)
    browser.run("calls.length = 0; choose('disparity'); setMix(1)")

    return browser


def test_its_policy_lets_nothing_out(opened: Browser) -> None:
    opened.complaints()

    opened.run(
        """
        window.sent = "";
        fetch("http://localhost:9/", { method: "POST", body: "a photograph" })
          .then(() => (window.sent = "sent"), () => (window.sent = "refused"));
        """
    )

    opened.wait("window.sent")
    assert opened.run("return window.sent") == "refused"
    assert any("Content Security Policy" in line for line in opened.complaints())


def test_a_slider_matches_at_once_and_again_when_it_rests(opened: Browser) -> None:
    slider = opened.driver.find_element("css selector", "#dim")
    slider.send_keys(END)
    assert (opened.text("dim-shown"), slider.get_attribute("aria-valuetext")) == ("90 %", "90 %")
    matched(opened)

    calls = opened.run("return calls")
    assert [call.get("preset", "check") for call in calls][-3:] == ["fast", "check", "robust"]
    assert calls[0]["preset"] == "fast"
    assert all(call["numDisparities"] == 64 for call in calls if call["task"] == "match")
    assert calls[-1]["first"] < 0.3 * calls[-1]["second"]  # the left image is dim

    # Those of the match and of the check, each once, the worst first.
    items = "document.querySelectorAll('#findings li')"
    assert opened.run(f"return Array.from({items}, (item) => item.textContent)") == [
        "warning about 40 % of the pixels are probably wrong",
        "note the left image is softer than the right",
        "ok noise of 1.0 gray levels",
    ]

    assert opened.text("time-shown") == "12 ms"
    assert opened.text("preset-shown") == "with robust, nvidia ampere"


def test_the_other_side_is_spoiled_and_all_goes_back(opened: Browser) -> None:
    opened.driver.find_element("css selector", "#dim").send_keys(END)
    opened.driver.find_element("css selector", ".chip:has(#side-right)").click()
    matched(opened)

    call = opened.run("return calls.at(-1)")
    assert call["second"] < 0.3 * call["first"]

    opened.driver.find_element("css selector", "#reset").click()
    matched(opened)
    assert opened.text("dim-shown") == "0 %"
    assert opened.run("return calls.at(-1).second") > call["second"]

    opened.driver.find_element("css selector", ".chip:has(#side-left)").click()


def test_the_viewer_is_the_report_pages(opened: Browser) -> None:
    opened.driver.find_element("css selector", "#stage").send_keys("4", RIGHT)
    assert opened.run("return state.view") == "confidence"
    assert opened.text("value-confidence") == "0.75"
    assert opened.text("value-uncertainty") == "\N{PLUS-MINUS SIGN}0.50 px"
    assert (opened.text("value-pixel"), opened.text("value-disparity")) == ("225, 168", "10.50 px")

    opened.driver.find_element("css selector", "#turn").send_keys(RIGHT)
    matched(opened)  # `fast` has no confidence: it is shown again with `robust`
    assert opened.run("return state.view") == "confidence"

    opened.run("element('cloud').scrollIntoView()")
    opened.wait("element('cloud').dataset.drawn === 'yes'")
    assert opened.text("cloud-shown") == f"{448 * 336 - 1:,} points"
    opened.run("scrollTo(0, 0)")


def test_rendered_views_show_the_same_things(opened: Browser) -> None:
    errors = opened.run(
        """
        return import("./render.js").then(({ SCENES, renderPair, NUM_DISPARITIES }) =>
          Object.keys(SCENES).map((name) => {
            const { left, right, truth } = renderPair(name);
            const gray = ({ data }, x, y) => data[4 * (y * left.width + x) + 1];
            const off = (by) => {
              const seen = [];
              for (let y = 0; y < left.height; y += 3) for (let x = 0; x < left.width; x += 3) {
                const match = Math.round(x - truth[y * left.width + x] - by);
                if (match >= 0) seen.push(Math.abs(gray(left, x, y) - gray(right, match, y)));
              }
              return seen.sort((a, b) => a - b)[seen.length >> 1];
            };
            const most = truth.reduce((a, b) => Math.max(a, b));
            const least = truth.reduce((a, b) => Math.min(a, b));
            return [off(0), off(4), least > 0 && most < NUM_DISPARITIES - 1];
          }));
        """
    )

    assert len(errors) == 2
    for right, wrong, fits in errors:
        assert right < 0.4 * wrong
        assert fits


DROP = """
const make = (name, width, height, color) => new Promise((done) => {
  const canvas = made("canvas", { width, height });
  const context = canvas.getContext("2d");
  [context.fillStyle] = color;
  context.fillRect(0, 0, width / 2, height);
  context.fillStyle = color.at(-1);
  context.fillRect(width / 2, 0, width / 2, height);
  canvas.toBlob((blob) => done(new File([blob], name, { type: "image/png" })));
});
return Promise.all(arguments[0].map((file) => make(...file))).then((files) => {
  const dataTransfer = new DataTransfer();
  for (const file of files) dataTransfer.items.add(file);
  delete document.documentElement.dataset.matched;
  document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
});
"""


def test_two_images_are_dropped(opened: Browser) -> None:
    files = [["im1.png", 120, 80, ["#404040"]], ["im0.png", 120, 80, ["#808080"]]]

    opened.run(DROP, files)
    matched(opened)

    call = opened.run("return calls.at(-1)")
    assert (call["size"], call["first"], call["second"]) == ([120, 80], 128, 64)
    assert call["numDisparities"] == 0  # to be found
    assert opened.text("pair-note") == "120 \N{MULTIPLICATION SIGN} 80 pixels."
    assert opened.run("return [page.cols, page.rows, stage.cols]") == [120, 80, 120]
    assert not opened.run("return isThere('truth')")

    opened.driver.find_element("css selector", "#shake").send_keys(RIGHT)
    matched(opened)
    known = opened.run("return calls.at(-1)")
    assert (known["minDisparity"], known["numDisparities"]) == (-2, 40)  # as they were found

    opened.driver.find_element("css selector", "#exchange").click()
    matched(opened)
    assert opened.run("return calls.at(-1).first") == 64


def test_one_image_is_dropped_with_both_views(opened: Browser) -> None:
    opened.run(DROP, [["both.png", 2400, 1000, ["#a0a0a0", "#202020"]]])
    matched(opened)

    call = opened.run("return calls.at(-1)")
    assert call["first"] == 160
    assert call["second"] == pytest.approx(32, abs=8)  # beside the other view, and made smaller

    width, height = call["size"]
    assert 499_000 < width * height < 501_000
    assert opened.text("pair-note").endswith(
        f"matched at {width} \N{MULTIPLICATION SIGN} {height}."
    )


DROP_BYTES = """
const dataTransfer = new DataTransfer();
for (const [name, text] of arguments[0]) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  dataTransfer.items.add(new File([bytes], name));
}
delete document.documentElement.dataset.matched;
document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
"""


def drop(browser: Browser, *files: tuple[str, bytes]) -> dict[str, Any]:
    """Drop files; return the last call of the matcher."""
    browser.run(DROP_BYTES, [[name, b64encode(content).decode()] for name, content in files])
    matched(browser)
    return dict(browser.run("return calls.at(-1)"))


NO_IMAGE = "is not an image that this browser reads"
GRAY = np.random.default_rng(0).integers(0, 256, (60, 90), np.uint8)


def written(kind: str) -> bytes:
    """Return an image of noise as a file."""
    target = BytesIO()
    counterpart("PIL.Image").fromarray(GRAY).save(target, kind)
    return target.getvalue()


@pytest.mark.parametrize(("content", "message"), [
    (lambda: written("PNG")[:2000], NO_IMAGE),
    (lambda: written("JPEG")[:1500], NO_IMAGE),
    (lambda: hostile.png(2**31 - 1, 2**31 - 1, 0, b"x"), NO_IMAGE),
    (lambda: hostile.png(65535, 65535, 0, zlib.compress(b"0")), NO_IMAGE),
    (lambda: hostile.png(0, 0, 0), NO_IMAGE),
    (lambda: png16(0)[:-40], NO_IMAGE),
    (lambda: deep(2**31 - 1, 2**31 - 1), "got 2147483647 x 2147483647 pixels; accepts 1 to 100,"),
    (lambda: deep(0, 7), "got 0 x 7 pixels; accepts 1 to 100,000,000 in all"),
    (lambda: deep(10_000, 10_000, zlib.compress(bytes(100))), NO_IMAGE),
    (lambda: b"", NO_IMAGE),
    (lambda: b"no image", NO_IMAGE),
    (lambda: b"%PDF-1.4", NO_IMAGE),
    (lambda: b"<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>", NO_IMAGE),
])  # fmt: skip
def test_what_is_no_image_is_refused(
    opened: Browser, content: Callable[[], bytes], message: str
) -> None:
    opened.run(DROP_BYTES, [[f"{side}.png", b64encode(content()).decode()] for side in "ab"])
    opened.wait("!document.getElementById('trouble').hidden", 5)
    said = opened.text("trouble").replace("\N{MULTIPLICATION SIGN}", "x")
    assert said.partition(": ")[0] in ("a.png", "b.png")
    assert said.partition(": ")[2].startswith(message)
    assert opened.complaints() == []


def deep(cols: int, rows: int, data: bytes = b"") -> bytes:
    """Return a PNG of 16 bits of what it says to hold, and may not."""
    eight, sixteen = (bytes([depth, 0, 0, 0, 0]) for depth in (8, 16))
    return hostile.png(cols, rows, 0, data).replace(eight, sixteen, 1)


def test_a_file_of_two_pictures_is_dropped(opened: Browser) -> None:
    pil = counterpart("PIL.Image")
    left, right, preview = (
        pil.new("L", size, level)
        for size, level in (((90, 60), 160), ((90, 60), 32), ((45, 30), 9))
    )
    files = []
    for other in (right, preview):
        target = BytesIO()
        left.save(target, format="MPO", save_all=True, append_images=[other])
        files.append(target.getvalue())

    call = drop(opened, ("pair.mpo", files[0]))
    assert (call["size"], call["first"], call["second"]) == ([90, 60], 160, 32)

    # A picture with a preview is one alone, which has both views side by side.
    call = drop(opened, ("one.jpg", files[1]))
    assert (call["size"], call["first"], call["second"]) == ([45, 60], 160, 160)


def test_the_focal_length_is_that_of_the_photographs(opened: Browser) -> None:
    pil = counterpart("PIL.Image")
    exif = pil.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    files = []
    for name in ("im0.jpg", "im1.jpg"):
        target = BytesIO()
        pil.new("L", (90, 60), 160).save(target, format="JPEG", exif=exif)
        files.append((name, target.getvalue()))

    drop(opened, *files)
    assert opened.run("return page.scene.focal[0]") == pytest.approx(26 / 36 * 90)
    assert "Focal length 26 mm" in opened.text("pair-note")
    drop(opened, *((f"{name}.png", png16(100)) for name in "ab"))
    assert opened.run("return page.scene.focal[0]") == 9


def png16(level: int, rule: int = 0) -> bytes:
    """Return a gray PNG of 16 bits, its columns one brighter each, its rows filtered by a rule."""
    rows, cols = 7, 9
    values = np.broadcast_to(level + np.arange(cols), (rows, cols)).astype(">u2")
    plain = np.frombuffer(values.tobytes(), np.uint8).reshape(rows, -1).astype(int)
    left = np.pad(plain, ((0, 0), (2, 0)))[:, :-2]
    above = np.pad(plain, ((1, 0), (0, 0)))[:-1]
    corner = np.pad(plain, ((1, 0), (2, 0)))[:-1, :-2]
    guess = left + above - corner
    apart = np.abs([guess - left, guess - above, guess - corner])
    paeth = np.choose(apart.argmin(0), [left, above, corner])
    taken = [0 * plain, left, above, (left + above) // 2, paeth][rule]
    filtered = np.insert((plain - taken) % 256, 0, rule, axis=1).astype(np.uint8)

    head = struct.pack(">IIBBBBB", cols, rows, 16, 0, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(filtered.tobytes())), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


@pytest.mark.parametrize("rule", range(5))
def test_images_of_16_bits_are_stretched_alike(opened: Browser, tmp_path: Path, rule: int) -> None:
    files = [(f"{side}.png", png16(level, rule)) for side, level in (("a", 4000), ("b", 1000))]
    for name, file in files:
        (tmp_path / name).write_bytes(file)
    assert [read_image(tmp_path / name).max() for name, _ in files] == [4008, 1008]
    call = drop(opened, *files)  # of 12 bits 8 are left
    assert (call["size"], call["first"], call["second"]) == ([9, 7], 250, 62)
    levels = opened.run("return [...pictures.left.bytes].filter((_, at) => at % 4 === 0)")
    assert levels == [(4000 + x) >> 4 for x in range(9)] * 7


def test_two_cameras_are_matched_until_one_frame_is_held(opened: Browser) -> None:
    button = opened.driver.find_element("css selector", "#cameras")
    button.click()
    opened.wait("calls.filter((call) => call.preset === 'fast').length > 3")
    assert opened.run("return calls.every((call) => call.preset === 'fast')")
    assert opened.run("return calls.at(-1).size") == [640, 480]
    assert button.get_attribute("aria-pressed") == "true"

    button.click()
    matched(opened)
    assert button.get_attribute("aria-pressed") == "false"
    count = opened.run("return calls.length")
    matched(opened)
    assert opened.run("return calls.length") == count
    assert opened.complaints() == []


def test_images_of_two_resolutions_are_brought_to_that_of_the_left_one(opened: Browser) -> None:
    opened.run(DROP, [["im0.png", 120, 80, ["#808080"]], ["im1.png", 61, 40, ["#404040"]]])
    matched(opened)
    call = opened.run("return calls.at(-1)")
    assert (call["size"], call["first"], call["second"]) == ([120, 80], 128, 64)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([["a.png", 60, 40, ["#111"]], ["b.png", 64, 40, ["#111"]]], "images: got 60 x 40 and 64"),
        ([["a.png", 40, 40, ["#111"]]], "a.png: got 40 x 40 pixels, too narrow for two views"),
        ([["a.png", 9, 9, ["#111"]]] * 3, "files: got 3; accepts two images, or one"),
    ],
)
def test_what_is_no_pair_is_refused(
    opened: Browser, files: list[list[object]], message: str
) -> None:
    opened.run(DROP, files)
    opened.wait("!document.getElementById('trouble').hidden")
    assert opened.text("trouble").replace("\N{MULTIPLICATION SIGN}", "x").startswith(message)


def test_an_error_of_the_matcher_is_reported_and_goes(opened: Browser) -> None:
    opened.run("window.refusal = 'left: got 9 rows; accepts 16 or more'")

    slider = opened.driver.find_element("css selector", "#defocus")
    slider.send_keys(RIGHT)
    opened.wait("!document.getElementById('trouble').hidden")
    assert opened.text("trouble") == "Not matched: left: got 9 rows; accepts 16 or more"

    opened.run("window.refusal = ''")
    slider.send_keys(RIGHT)
    matched(opened)

    assert opened.run("return document.getElementById('trouble').hidden")


def test_what_is_said_is_read_out(opened: Browser) -> None:
    message = "return ['findings', 'pair-note', 'trouble'].map((id) => element(id).role ?? '')"
    assert opened.run(message)[1:] == ["status", "alert"]
    assert opened.run("return element('findings').ariaLive") == "polite"


def test_a_known_length_sets_the_scale_of_what_is_saved(opened: Browser, tmp_path: Path) -> None:
    opened.run("marks.A = { x: 20, y: 20 }; marks.B = { x: 60, y: 40 }; tellMeasures()")
    opened.run("element('known').value = 2.5; element('unit').value = 'm'")
    opened.run("element('set-scale').click()")
    assert "Length from A to B: 2.5 \N{PLUS-MINUS SIGN} " in opened.text("measured")
    assert "depth" in opened.text("measured")

    kept = (
        "new Promise((done) => { URL.createObjectURL = (blob) => { done(blob); return 'blob:' } })"
    )
    text = "blob.arrayBuffer().then((buffer) => [...new Uint8Array(buffer)])"
    files = {}
    for name in ("save-map", "save-cloud"):
        opened.run(f"window.saved = {kept}; element('{name}').click()")
        files[name] = bytes(opened.run(f"return saved.then((blob) => {text})"))

    path = tmp_path / "map.pfm"
    path.write_bytes(files["save-map"])
    shown = np.array(opened.run("return [...maps.disparity]"), dtype=np.float32)
    assert np.array_equal(read_disparity(path).ravel(), shown, equal_nan=True)

    head, _, body = files["save-cloud"].partition(b"end_header\n")
    point = np.frombuffer(body[:12], "<f4")
    assert f"element vertex {len(body) // 15}\n".encode() in head
    at = "maps.disparity.findIndex((_, at) => isTrusted(at) && isPoint(at))"
    assert point == pytest.approx(opened.run(f"return pointOf({at})"), rel=1e-5)


@pytest.fixture(scope="module")
def core(built: Path) -> Path:
    """Return the page with the core; without it, skip visibly."""
    if (built / "core" / CORE.name).is_file():
        return built / "core"
    pytest.skip(f"no {CORE}: make web")


def test_all_of_it_is_small(core: Path) -> None:
    sizes = {path.name: len(zlib.compress(path.read_bytes(), 9)) for path in core.iterdir()}
    assert {"index.html", "viewer.js", "page.js", CORE.name} <= sizes.keys()
    assert sum(sizes.values()) < MOST_BYTES


def test_the_page_names_what_searched(browser: Browser, site: str, core: Path) -> None:
    """Software is used only if the address asks for it."""
    open_page(browser, f"{site}/{core.name}")
    assert browser.text("preset-shown") == "with robust, WebAssembly"
    expected = browser.run("return [...maps.disparity].join()")

    browser.visit(f"{site}/{core.name}/index.html?device=gpu")
    browser.wait("document.documentElement.dataset.matched", 120)
    if (refused := browser.text("trouble")).startswith("The matcher could not be loaded: device"):
        pytest.skip(refused)
    assert browser.text("preset-shown") == "with robust, google swiftshader"
    assert browser.run("return [...maps.disparity].join()") == expected
    assert browser.complaints() == []


@pytest.mark.parametrize(("cols", "rows"), [(1, 1), (1, 5000), (60_000, 1)])
def test_the_core_answers_for_strange_sizes(
    browser: Browser, site: str, core: Path, cols: int, rows: int
) -> None:
    open_page(browser, f"{site}/{core.name}")
    content = hostile.png(cols, rows, 0, zlib.compress(bytes((cols + 1) * rows)))
    browser.run(DROP_BYTES, [[name, b64encode(content).decode()] for name in ("a", "b")])
    browser.wait("document.documentElement.dataset.matched")
    assert browser.complaints() == []


def test_findings_are_those_of_the_command_line(
    browser: Browser, site: str, core: Path, tmp_path: Path
) -> None:
    open_page(browser, f"{site}/{core.name}")
    browser.run(
        "element('defocus').value = 4; element('defocus').dispatchEvent(new Event('input'))"
    )
    matched(browser)

    paths = []
    for side in ("left", "right"):
        url = browser.run(f"return pictures.{side}.canvas.toDataURL()")
        paths.append(tmp_path / f"{side}.png")
        paths[-1].write_bytes(b64decode(url.partition(",")[2]))

    program = [sys.executable, "-m", "phasestereo", "check", *map(str, paths)]
    told = subprocess.run(  # noqa: S603  # ours
        program, env=ENVIRONMENT, check=False, capture_output=True, text=True
    ).stdout
    shown = browser.run(
        "return [...element('findings').children].map((one) => one.lastChild.textContent.trim())"
    )
    assert any("softer" in sentence for sentence in shown)
    assert [sentence for sentence in shown if spelled(sentence) not in told] == []


def test_the_core_matches_what_sliders_spoil(browser: Browser, site: str, core: Path) -> None:
    open_page(browser, f"{site}/{core.name}")
    assert browser.complaints() == []
    assert wrong(browser) < 5
    assert "the images are equally sharp" in browser.text("findings")

    browser.run(
        "setSlider = (name, value) => { element(name).value = value; "
        "element(name).dispatchEvent(new Event('input')); }"
    )

    browser.run("setSlider('defocus', 4); setSlider('rows', 2)")
    matched(browser)
    assert wrong(browser) < 12

    findings = browser.text("findings")
    assert "the left image is softer than the right by a disk of radius" in findings
    assert "the right image shows things 2.0 px higher than the left one" in findings

    browser.run("setSlider('defocus', 0); setSlider('rows', 0); setSlider('turn', 1)")
    matched(browser)
    assert wrong(browser) < 12
    assert "is rotated counter-clockwise (or sheared) by" in browser.text("findings")


def wrong(browser: Browser) -> float:
    """Return the share of wrong pixels that the page shows, in percent."""
    return float(browser.text("wrong-shown").removesuffix(" %"))

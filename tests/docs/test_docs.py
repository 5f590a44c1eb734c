"""The documentation: examples run, command lines parse, pages build and hold together."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import base64
import io
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from importlib import metadata
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration, read_image, write_disparity, write_image
from phasestereo.metrics import bad_pixels
from phasestereo_bench.rendering import render_pair
from support import ENVIRONMENT, ROOT, counterpart
from support.documentation import PAGES, CodeBlock, blocks, commands, name

HEIGHT, WIDTH, NUM_DISPARITIES = 240, 320, 80
PICTURES = {
    "index": 6,
    "gallery": 15,
    "how-it-works": 6,
    "how-it-works/codes": 20,
    "suites": 29,
}
"""Pages that the build draws for, and how many pictures they have at least."""


@pytest.fixture(scope="session")
def pair_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the examples read: a rendered pair and what is known."""
    folder = tmp_path_factory.mktemp("pair")
    pair = render_pair(2, height=HEIGHT, width=WIDTH, num_disparities=70)
    assert isinstance(pair.calibration, Calibration)

    write_image(folder / "left.png", pair.left)
    write_image(folder / "right.png", pair.right)
    write_disparity(folder / "truth.pfm", pair.truth)
    (folder / "calib.txt").write_text(_calibration_text(pair.calibration))

    return folder


@pytest.fixture
def here(pair_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a fresh copy of the folder, where examples may leave what they like."""
    folder = tmp_path / "examples"
    shutil.copytree(pair_folder, folder)
    monkeypatch.chdir(folder)
    return folder


def _calibration_text(calibration: Calibration) -> str:
    rows = ("; ".join(" ".join(map(str, row)) for row in calibration.cam0),) * 2
    lines = [f"cam{number}=[{row}]" for number, row in enumerate(rows)]
    fields = "doffs", "baseline", "width", "height", "ndisp"
    lines += [f"{field}={getattr(calibration, field)}" for field in fields]
    return "\n".join(lines) + "\n"


# Examples


def program(found: list[CodeBlock]) -> str:
    """Return the blocks of a page as one program, each at the lines that it has on its page."""
    text = ""
    for block in found:
        text += "\n" * (block.line - 1 - text.count("\n")) + block.text
    return text


WITH_EXAMPLES = [page for page in PAGES if any(block.runs for block in blocks(page, "python"))]


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=name)
def test_examples_run_as_they_stand(page: Path, here: Path) -> None:
    found = [block for block in blocks(page, "python") if block.runs]
    for module in _foreign(found):
        counterpart(module)
    if "import pandora" in found[0].text and not _pandora_finds_the_plugin():
        pytest.skip("this package is on the path, not installed: Pandora cannot find its plugin")

    # In a process of its own, as its reader runs it: examples limit their memory.
    (here / page.name).write_text(program(found), encoding="utf-8")
    finished = subprocess.run(  # noqa: S603  # our own interpreter
        [sys.executable, page.name],
        cwd=here,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    if "it comes with: pip install" in finished.stderr:
        pytest.skip(finished.stderr.splitlines()[-1])
    assert finished.returncode == 0, finished.stderr


def _foreign(found: list[CodeBlock]) -> list[str]:
    """Return the optional packages that examples import themselves."""
    text = "".join(block.text for block in found)
    imported = re.findall(r"^\s*(?:import|from) (\w+)", text, re.MULTILINE)
    ours = {"phasestereo", "phasestereo_live", "phasestereo_large", "numpy"}
    return sorted(set(imported) - ours - sys.stdlib_module_names)


def _pandora_finds_the_plugin() -> bool:
    plugins = metadata.entry_points(group="pandora.plugin")
    return any(plugin.value.startswith("phasestereo_large.pandora:") for plugin in plugins)


def test_the_pair_of_the_examples_is_matched(here: Path) -> None:
    left, right = read_image(here / "left.png"), read_image(here / "right.png")
    result = ps.match(left, right, num_disparities=NUM_DISPARITIES)
    truth = ps.io.read_disparity(here / "truth.pfm")
    depth = ps.io.read_calibration(here / "calib.txt").depth(truth)
    assert bad_pixels(result.disparity, truth, 1.0) < 15
    assert 8 <= truth.min() < truth.max() <= 68
    assert np.isfinite(depth).all()


# Command lines

COMMANDS = [
    pytest.param(words, id=f"{name(page)}: {' '.join(words)}")
    for page in PAGES
    for words in commands(page)
]


@pytest.mark.parametrize("words", COMMANDS)
def test_command_lines_are_such_as_the_program_takes(words: list[str], here: Path) -> None:
    for word in words:
        _prepare(here / word)
    _parse(words)


def test_a_wrong_command_line_is_reported() -> None:
    cyclopts = pytest.importorskip("cyclopts")
    with pytest.raises(cyclopts.CycloptsError):
        _parse(["match", "left.png", "right.png", "--num-disparitys", "64"])


def _parse(words: list[str]) -> None:
    from phasestereo.cli import app  # noqa: PLC0415  # needs the extra cli

    if words[-1] != "--help":
        app.parse_args(words, exit_on_error=False, print_error=False)


def _prepare(path: Path) -> None:
    """Make what a placeholder or a file of an example stands for, since options look for it."""
    if path.name in ("FOLDER", "DATA", "NAME"):
        path.mkdir(exist_ok=True)
    elif path.suffix in (".png", ".pfm", ".jsonl", ".md") and not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_the_first_command_of_the_first_page_does_what_it_says(here: Path) -> None:
    from phasestereo.cli import run as phasestereo  # noqa: PLC0415  # needs the extra cli

    words = next(words for words in commands(ROOT / "docs/index.md") if words[0] == "match")
    assert phasestereo(words) == 0
    assert ps.io.read_disparity(here / "out.pfm").shape == (HEIGHT, WIDTH)


# The site


class LinkedPage(HTMLParser):
    """What a page loads, what it links to, what can be linked to, and its pictures."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.pictures: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        if "id" in given:
            self.anchors.add(given["id"])

        source = given.get("src", "")
        if source.startswith("data:"):
            self.pictures.append(source)
        elif source:
            self.loads.append(source)

        if tag == "link" and given.get("rel") not in ("canonical", "next", "prev"):
            self.loads.append(given.get("href", ""))

        if tag == "a" and "href" in given:
            self.links.append(given["href"])


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site, with every warning an error, and return its folder."""
    for module in ("mkdocs", "material", "mkdocstrings", "markdown_exec"):
        counterpart(module)

    folder = tmp_path_factory.mktemp("site")
    finished = subprocess.run(  # noqa: S603  # our own interpreter
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env=ENVIRONMENT | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )

    report = finished.stderr[:5000] + finished.stderr[-2000:]
    assert finished.returncode == 0, report
    assert "WARNING" not in finished.stderr, report

    return folder


@pytest.fixture(scope="session")
def pages(site: Path) -> dict[str, LinkedPage]:
    """Return all pages by their address below the root of the site."""
    read = {}
    for path in sorted(site.rglob("*.html")):
        page = LinkedPage()
        page.feed(path.read_text(encoding="utf-8"))
        read[path.relative_to(site).as_posix()] = page
    return read


def test_every_page_is_there(pages: dict[str, LinkedPage]) -> None:
    sources = [page.relative_to(ROOT / "docs") for page in PAGES if ROOT / "docs" in page.parents]
    wanted = {
        (source.parent / ("index.html" if source.stem == "index" else f"{source.stem}/index.html"))
        for source in sources
    }
    assert {path.as_posix() for path in wanted} <= pages.keys()
    assert {"changelog/index.html", "contributing/index.html"} <= pages.keys()


def test_no_page_asks_another_host_for_anything(site: Path, pages: dict[str, LinkedPage]) -> None:
    foreign = {
        (address, source)
        for address, page in pages.items()
        for source in page.loads
        if urlsplit(source).netloc
    }

    assert foreign == set()

    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert styles
    asked = [
        found for style in styles for found in re.findall(r"url\(\s*['\"]?(?:https?:)?//", style)
    ]

    assert asked == []


def test_the_glossary_has_a_sentence_on_every_flag() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").partition("## Flags")[2]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    entries = {row[0].strip("`"): row[1] for row in rows if row[0].startswith("`")}
    assert list(entries) == [flag.name for flag in ps.Flag]
    assert all(sentence.endswith(".") for sentence in entries.values())


def test_what_pages_load_and_link_to_is_there(site: Path, pages: dict[str, LinkedPage]) -> None:
    for address, page in pages.items():
        if address == "404.html":  # its links begin at the root of wherever the site will be
            continue
        for link in [*page.loads, *page.links]:
            _follow(site, pages, address, link)


def _follow(site: Path, pages: dict[str, LinkedPage], address: str, link: str) -> None:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return
    target = (site / address).parent / parts.path if parts.path else site / address
    target = target / "index.html" if target.is_dir() else target
    assert target.exists(), f"{address} links to {link}"

    if parts.fragment and target.suffix == ".html":
        there = pages[target.resolve().relative_to(site.resolve()).as_posix()]
        assert parts.fragment in there.anchors, f"{address} links to {link}"


@pytest.mark.parametrize(("page", "least"), PICTURES.items())
def test_the_build_draws_pictures(page: str, least: int, pages: dict[str, LinkedPage]) -> None:
    image = counterpart("PIL.Image")
    found = pages["index.html" if page == "index" else f"{page}/index.html"].pictures
    assert len(found) >= least
    for source in found:
        data = base64.b64decode(source.partition("base64,")[2])
        pixels = np.asarray(image.open(io.BytesIO(data)), np.float64)
        assert pixels.std() > 10


def test_examples_that_the_build_runs_are_shown_with_what_they_print(site: Path) -> None:
    text = re.sub(r"<[^>]+>", "", (site / "gallery/index.html").read_text(encoding="utf-8"))
    assert re.search(r"result.blur: left, disk (3\.[5-9]|4\.[0-5])", text)
    assert re.search(r"result.blur: left, motion 1[234]\.\d+ px at (19|20|21) degrees", text)
    assert re.search(r"warning: the right image shows things 2\.\d px lower", text)
    bands = re.sub(r"<[^>]+>", "", (site / "how-it-works/index.html").read_text())
    assert "True\n" in bands

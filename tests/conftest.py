"""What several test files share: where the real data is, and how hypothesis runs."""

import os
import shutil
import signal
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from browser import Browser, running

Run = tuple[int, str, str]

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = (
    ROOT / "python",
    *(ROOT / "python" / name for name in ("phasestereo-live", "phasestereo-large")),
    ROOT / "benches/harness",
)
"""The folders that hold our packages."""

# "CI" would have pytest compare and show whole what differs: megabytes, in minutes.
os.environ.setdefault("PHASESTEREO_CI", os.environ.pop("CI", ""))
ON_CI = os.environ["PHASESTEREO_CI"] == "true"

LACKING = {
    "this Python has a GIL": "a job of the workflow runs a Python that has none",
    "only root becomes another user": "who runs the tests is not always root",
    "could not import 'open3d'": "it brings a web server, and plugins for pytest that fail here",
    "could not import 'pyrealsense2'": "it has no wheels for other processors than x86-64",
    "no headers of ROS 1": "Debian 12 is the last that has them, and CI runs elsewhere",
    "could not import 'mc_cnn'": "its OpenCV would replace the one that others are tested with",
}
"""What a machine of CI cannot have, by how its skip begins, and why: no other may skip there."""

if os.environ.get("PHASESTEREO_DATA") == "none":  # said, and so not forgotten
    LACKING["no real data"] = "the pairs are not there to be copied"

ENVIRONMENT = os.environ | {
    "PYTHONPATH": os.pathsep.join([*map(str, PACKAGES), os.environ.get("PYTHONPATH", "")])
}
"""Of processes that import our packages from the tree."""

# The same examples every time and everywhere; new ones are what `make fuzz` is for, which loads
# "explore". No deadlines: a slow machine is no failure.
hypothesis.settings.register_profile("fixed", deadline=None, derandomize=True, database=None)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=500, print_blob=True)
hypothesis.settings.load_profile("fixed")

# A shell has what it starts in the background ignore Ctrl-C, and that would go on to our processes.
signal.signal(signal.SIGINT, signal.default_int_handler)


LINES, WIDTH = 4, 200  # of what is said of a failure, and of a line of its code


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Cut what is said of a failure: arrays and files fill screens; ``-vv`` shows all."""
    report = yield
    refuse_skip(report)
    if item.config.get_verbosity() < 2:
        for trace, crash, _ in getattr(report.longrepr, "chain", ()):
            for entry in trace.reprentries:
                entry.lines = shortened(entry.lines)
            if crash is not None:
                (crash.message,) = shortened([crash.message.partition("\n")[0]])
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Hold files that skip as a whole to the same."""
    report = yield
    refuse_skip(report)
    return report


def refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Make a failure on CI of what skips, but for what is listed: all else has to be there."""
    if not ON_CI or not isinstance(report.longrepr, tuple):
        return
    reason = report.longrepr[2].removeprefix("Skipped: ")
    if not reason.startswith(tuple(LACKING)):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid}: nothing may skip on CI: {reason}"


def shortened(lines: list[str]) -> list[str]:
    """Return the lines of a failure, none too long, and few of those that explain it."""
    said = [number for number, line in enumerate(lines) if line.startswith("E  ")]
    kept = (line for number, line in enumerate(lines) if number not in said[LINES:])
    return [line if len(line) <= WIDTH else f"{line[:WIDTH]} ..." for line in kept]


class EndingError(Exception):
    """What the progress callback of a test raises to end a run."""


def real_data() -> Path:
    """Return where real pairs are, if there are any."""
    return Path(os.environ.get("PHASESTEREO_DATA", ROOT / "../shared"))


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real pairs."""
    folder = real_data()
    if not (folder / "middlebury").is_dir():
        place = folder.resolve()
        pytest.skip(f"no real data in {place}: set PHASESTEREO_DATA to a folder of pairs")
    return folder


def counterpart(module: str) -> Any:
    """Return a module that tests hold ours against; skip them where it is missing."""
    return pytest.importorskip(module)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Run]:
    """Return what runs the command line in this process: exit code, standard output, error."""
    cli = pytest.importorskip("phasestereo.cli")

    def run(*arguments: object) -> Run:
        code = cli.run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def run_bench(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Run]:
    """Return what runs ``phasestereo bench`` in this process, in an empty folder, wide lines."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return partial(run, "bench")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Return Chromium."""
    webdriver = counterpart("selenium.webdriver")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    programs = chromium, shutil.which("chromedriver")

    if programs[0] and programs[1]:
        with running(webdriver, programs[0], programs[1]) as opened:
            yield opened
        return

    pytest.skip("no browser: apt-get install chromium chromium-driver")

"""What several test files share: where the real data is, and how hypothesis runs."""

import shutil
import signal
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path

import hypothesis
import pytest

from support import LACKING, ON_CI, Run, counterpart, real_data
from support.browser import Browser, running

# The same examples every time and everywhere; new ones are what `make fuzz` is for, which loads
# "explore". No deadlines: a slow machine is not a failure.
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


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real pairs."""
    folder = real_data()
    if not (folder / "middlebury").is_dir():
        place = folder.resolve()
        pytest.skip(f"no real data in {place}: set PHASESTEREO_DATA to a folder of pairs")
    return folder


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Callable[..., Run]:
    """Return a function that runs the command line here: exit code, standard output, error."""
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
    """Return a function that runs ``phasestereo bench`` here, in an empty folder, wide lines."""
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

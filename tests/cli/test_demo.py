"""The demonstration: it shows what it claims, and leaves exactly the files that it says."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phasestereo import io
from phasestereo.metrics import bad_pixels
from phasestereo.views.templating import render_page
from phasestereo_bench.demo import METHODS, Demo, run_demo, verdict, write_demo
from support.html_page import Page

for module in ("scipy", "matplotlib", "jinja2", "cyclopts", "cv2"):
    pytest.importorskip(module)

FILES = {
    *("left.png", "left_sharp.png", "right.png", "nonocc.png", "truth.pfm", "truth.png"),
    *(f"disparity_{method.key}.{kind}" for method in METHODS for kind in ("png", "pfm")),
    *(f"error_{method.key}.png" for method in METHODS),
    *("overview.png", "report.html"),
}


@pytest.fixture(scope="module")
def small() -> Demo:
    """Return a small demo."""
    return run_demo(3, height=90, width=120, num_disparities=16)


@pytest.fixture(scope="module")
def folder(small: Demo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what a small demo wrote."""
    target = tmp_path_factory.mktemp("demo") / "new" / "folder"
    write_demo(small, target)
    return target


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_phase_codes_make_at_most_half_of_the_errors(seed: int) -> None:
    outcomes = {outcome.method.key: outcome for outcome in run_demo(seed).outcomes}
    rivals = [outcomes["sad"].degraded.bad, outcomes["nsad"].degraded.bad]

    assert outcomes["phase"].degraded.bad <= 0.5 * min(rivals)
    assert outcomes["phase"].sharp.bad < 16

    assert outcomes["robust"].degraded.bad < 1.05 * outcomes["phase"].degraded.bad
    assert outcomes["robust"].sharp.bad < outcomes["phase7"].sharp.bad
    assert max(outcomes[key].sharp.bad for key in ("phase7", "sad", "nsad")) < 10

    assert outcomes["sgbm"].degraded.bad > 25
    assert outcomes["sgbm"].sharp.bad < 10


def test_files_are_those_that_are_named(small: Demo, folder: Path) -> None:
    names = set(os.listdir(folder))  # noqa: PTH208 - names, hidden ones too
    assert (names, set(write_demo(small, folder))) == (FILES, {folder / name for name in names})


def test_files_hold_what_was_computed(small: Demo, folder: Path) -> None:
    np.testing.assert_array_equal(io.read_image(folder / "left.png"), small.degraded)
    np.testing.assert_array_equal(io.read_image(folder / "right.png"), small.pair.right)
    truth = io.read_disparity(folder / "truth.pfm")
    scored = io.read_image(folder / "nonocc.png") == 255
    for outcome in small.outcomes:
        disparity = io.read_disparity(folder / f"disparity_{outcome.method.key}.pfm")
        assert bad_pixels(disparity, truth, 1.0, scored) == outcome.degraded.bad


def test_page_is_whole_and_needs_nothing_else(small: Demo, folder: Path) -> None:
    content = (folder / "report.html").read_text("utf-8")
    page = Page(folder / "report.html")

    assert page.open == []
    assert len(page.sources) >= 5 + 2 * len(small.outcomes)
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert "://" not in content
    assert "prefers-color-scheme: dark" in content

    assert verdict(small) in page.text
    for outcome in small.outcomes:
        assert f"{outcome.degraded.bad:.1f} %" in page.text


def test_page_says_how_to_get_its_figures(
    small: Demo, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cli = pytest.importorskip("phasestereo.cli")

    page = Page(folder / "report.html")

    commands = re.findall("phasestereo (match .*)", page.text)
    assert len(commands) == len(METHODS) - 1  # all but StereoSGBM

    monkeypatch.chdir(folder)
    for command, outcome in zip(commands, small.outcomes, strict=False):
        assert cli.run(command.split()) == 0
        assert re.search(rf"bad-1.0\W+{outcome.degraded.bad:.2f} %", capsys.readouterr().out)


def test_verdict_names_the_best_of_the_others(small: Demo) -> None:
    others = [o for o in small.outcomes if o.method.key in ("sad", "nsad", "sgbm")]
    best = min(others, key=lambda outcome: outcome.degraded.bad)
    assert f"{best.method.name}, {best.degraded.bad:.1f} %" in verdict(small)
    phase = small.outcomes[0]
    ratio = best.degraded.bad / phase.degraded.bad
    assert f"{ratio:.1f} times as many" in verdict(small)


def test_demo_command(
    small: Demo,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cli = pytest.importorskip("phasestereo.cli")

    opened: list[str] = []
    monkeypatch.setattr(
        "phasestereo_bench.cli.demo.run_demo", lambda seed, **_: replace(small, seed=seed)
    )
    monkeypatch.setattr("webbrowser.open", opened.append)

    assert cli.run(["demo", "--output", str(tmp_path / "out"), "--seed", "7"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert verdict(small) in out
    assert str(tmp_path / "out" / "report.html") in out
    assert "demo --seed 7" in (tmp_path / "out" / "report.html").read_text("utf-8")

    assert opened == []

    assert cli.run(["demo", "--output", str(tmp_path / "out"), "--open"]) == 0
    assert opened == [(tmp_path / "out" / "report.html").as_uri()]


def test_demo_command_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cli = pytest.importorskip("phasestereo.cli")

    (tmp_path / "file").touch()
    assert cli.run(["demo", "--output", str(tmp_path / "file")]) == 1
    assert cli.run(["demo", "--seed", "-1"]) == 2

    lines = capsys.readouterr().err.splitlines()
    assert [line.startswith("phasestereo: error: ") for line in lines] == [True, True]
    assert "File exists" in lines[0]
    assert "--seed" in lines[1]


def test_pages_have_no_gaps(small: Demo) -> None:
    jinja2 = pytest.importorskip("jinja2")
    with pytest.raises(jinja2.UndefinedError):
        render_page("demo.html.j2", package="phasestereo_bench", demo=small)

"""The command line: what it writes and prints, what it refuses, and what it never leaves behind."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo import io, metrics
from phasestereo.views.picture import NEUTRAL, disparity_picture
from support import Run

cli = pytest.importorskip("phasestereo.cli")

SHIFT = 5
COUNT = 16


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds a pair, everywhere at disparity SHIFT, and truth."""
    monkeypatch.chdir(tmp_path)

    scene = np.random.default_rng(0).integers(0, 256, (40, 70, 3), dtype=np.uint8)
    io.write_image("left.png", scene[:, :-SHIFT])
    io.write_image("right.png", scene[:, SHIFT:])

    truth = np.full((40, 65), SHIFT, np.float32)
    truth[:, :SHIFT] = np.nan
    io.write_disparity("truth.pfm", truth)

    return tmp_path


def match(run: Callable[..., Run], *options: object, count: int = COUNT) -> Run:
    return run("match", "left.png", "right.png", "--num-disparities", count, *options)


def process(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command line in a process of its own."""
    command = [sys.executable, "-W", "error", "-m", "phasestereo", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)  # noqa: S603 - our own command


def listing(folder: Path) -> set[str]:
    return set(os.listdir(folder))  # noqa: PTH208 - names, hidden ones too


def pixels_of_pair() -> tuple[NDArray[Any], NDArray[Any]]:
    return io.read_image("left.png"), io.read_image("right.png")


# What comes out


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ["out.pfm", "out.npy", "out.tif", "out.png", "OUT.PFM"])
def test_map_is_what_the_library_returns(run: Callable[..., Run], name: str) -> None:
    code, out, err = match(run, "-o", name)
    assert (code, "see --color" in err) == (0, name.endswith(".png"))
    assert f"wrote {name}" in out
    expected = ps.match(*pixels_of_pair(), num_disparities=COUNT).disparity
    # A PNG holds steps of 1/256; 0 stands for no estimate there.
    least, step = (1 / 256, 1 / 512) if name.endswith(".png") else (0, 0)
    np.testing.assert_allclose(io.read_disparity(name), np.maximum(expected, least), 0, step)


@pytest.mark.usefixtures("folder")
def test_search_masks_and_settings_arrive(run: Callable[..., Run]) -> None:
    valid = np.ones((40, 65), np.uint8)
    valid[10:20, 10:30] = 0
    io.write_image("mask.png", valid)

    options = "--min-disparity 2 --threads 1 --left-mask mask.png --right-mask mask.png --no-fill"
    settings = "--neighborhood 5 --frequencies 1 1 --p1 0.5 --p2 3 --optimizer wta --no-shiftable"
    code, _, _ = match(run, "-o", "out.npy", *options.split(), *settings.split())
    assert code == 0

    expected = ps.match(
        *pixels_of_pair(),
        num_disparities=COUNT,
        min_disparity=2,
        left_mask=valid != 0,
        right_mask=valid != 0,
        neighborhood=5,
        frequencies=(1, 1),
        p1=0.5,
        p2=3.0,
        optimizer="wta",
        shiftable=False,
        fill=False,
    ).disparity

    assert np.isnan(expected[15, 15])
    np.testing.assert_array_equal(io.read_disparity("out.npy"), expected)


@pytest.mark.usefixtures("folder")
def test_color_image_shows_the_map(run: Callable[..., Run]) -> None:
    code, out, _ = match(run, "--color", "out.png", "-o", "out.npz", "--no-fill")
    assert code == 0
    assert re.match(r"(about \d+|less than 1) % of the pixels are probably wrong\n", out)

    shown, maps = io.read_image("out.png"), np.load("out.npz")
    trusted = maps["confidence"] >= 0.5
    wanted = disparity_picture(maps["disparity"], title=out.splitlines()[0], trusted=trusted)
    np.testing.assert_array_equal(shown, wanted)
    assert (shown == NEUTRAL).all(axis=2).any()


@pytest.mark.usefixtures("folder")
def test_json_is_one_object_and_nothing_else(run: Callable[..., Run]) -> None:
    code, out, err = match(
        run, "--json", "-o", "out.pfm", "--color", "out.png", "--truth", "truth.pfm", "--window", 5
    )
    assert (code, err) == (0, "")

    said = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    result = ps.match(*pixels_of_pair(), num_disparities=COUNT, window=5)
    score = metrics.score(result.disparity, io.read_disparity("truth.pfm"))

    assert (said["width"], said["height"]) == (65, 40)
    assert (said["min_disparity"], said["num_disparities"]) == (0, COUNT)
    assert said["settings"] == json.loads(json.dumps(asdict(result.settings)))
    assert said["timings"].keys() == result.timings.keys()
    assert said["blurs"] == result.blur.as_dicts()

    assert said["estimated"] == 1.0
    assert said["flags"] == {
        flag.name.lower(): np.count_nonzero(result.flags & flag) for flag in ps.Flag if flag.name
    }
    assert said["flags"]["outside"] > 0

    assert said["files"] == {"output": "out.pfm", "color": "out.png"}
    assert said["metrics"] == pytest.approx(score.as_dict())


@pytest.mark.usefixtures("folder")
def test_numbers_that_json_lacks_are_null(run: Callable[..., Run]) -> None:
    mask = np.zeros((40, 65), np.uint8)
    mask[0, 0] = 255  # where the truth has no disparity
    io.write_image("mask.png", mask)
    code, out, _ = match(run, "--json", "--truth", "truth.pfm", "--left-mask", "mask.png")
    assert code == 0
    assert json.loads(out)["metrics"]["avgerr"] is None
    assert json.loads(out)["metrics"]["bad-1.0"] == 100


@pytest.mark.usefixtures("folder")
def test_truth_is_scored_where_its_mask_says(run: Callable[..., Run]) -> None:
    gray = np.full((40, 65), SHIFT * 8, np.uint8)
    gray[:, 40:] = 8  # wrong by 4 pixels there
    io.write_image("truth.pgm", gray)

    mask = np.full((40, 65), 128, np.uint8)
    mask[:, 10:30] = 255
    io.write_image("mask.png", mask)

    options = ["--truth", "truth.pgm", "--truth-scale", 8, "--truth-mask", "mask.png"]
    code, out, _ = match(run, *options, "--truth-mask-level", 255)
    assert code == 0
    assert re.search(r"bad-1.0\W+0.00 %", out)
    assert re.search(r"pixels\W+800", out)

    code, out, _ = match(run, *options)
    assert code == 0
    assert not re.search(r"bad-1.0\W+0.00 %", out)
    assert re.search(r"pixels\W+2,600", out)


# Help


def test_help_of_a_match_is_one_screen(run: Callable[..., Run], monkeypatch: Any) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    code, out, _ = run("match", "--help")
    assert code == 0
    assert out.count("\n") <= 50
    for option in ("--output", "--num-disparities", "--preset", "--rectify", "--calib", "--truth"):
        assert f"{option} " in out
    assert "--neighborhood" not in out
    assert "--help-expert shows" in out
    assert "phasestereo match left.png right.png -o out.pfm" in out


@pytest.mark.parametrize("command", ["match", "batch"])
def test_expert_help_has_every_setting_with_its_defaults(
    run: Callable[..., Run], command: str
) -> None:
    _, out, _ = run(command, "--help-expert")
    basics, experts = out.split("Expert settings")
    words = " ".join(experts.replace("│", " ").split())

    for field in fields(ps.Settings):
        assert f"--{field.name.replace('_', '-')} " in words
    assert "An odd integer from 3 to 63. Default: 3; 7 with paper; 9 with fast." in words
    assert "--threads" in basics
    assert "--neighborhood" not in basics


def test_try_makes_a_pair_and_its_page(run: Callable[..., Run], tmp_path: Path) -> None:
    code, out, err = run("try", "-o", tmp_path / "try.html")
    assert (code, err) == (0, "")
    assert "the left image is softer than the right" in out
    assert f"look at {tmp_path / 'try.html'}" in out
    assert "480 &times; 360 pixels" in (tmp_path / "try.html").read_text("utf-8")

    # Of its scene the truth is known: the wall, the floor, and a box that hides some of both.
    trying = pytest.importorskip("phasestereo.cli.trying")
    found = ps.match(*trying._pair()).disparity
    places = {(60, 240): 8, (170, 110): 8 + (219 - 180) * 24 // 180, (280, 240): 27, (350, 40): 30}
    assert {at: round(float(found[at])) for at in places} == pytest.approx(places, abs=1)


def test_doctor_says_what_is_here_and_whether_it_is_right(
    run: Callable[..., Run], monkeypatch: Any
) -> None:
    # The digests themselves are compared by tests/core/test_platforms.py.
    monkeypatch.setattr("phasestereo._core.self_check", lambda _: [])
    monkeypatch.setattr("phasestereo.cli.doctor._ROUNDS", 1)
    code, out, _ = run("doctor", "--json")
    found = json.loads(out)
    assert (code, found["differing"]) == (0, [])
    assert found["versions"]["phasestereo"] == ps.__version__
    assert set(found["milliseconds"]) == set(ps.PRESETS)

    monkeypatch.setattr("phasestereo._core.self_check", lambda _: ["Motion, 160 x 120"])
    code, out, err = run("doctor")
    assert code == 1
    assert found["instructions"] in out
    assert "matches of Motion, 160 x 120 are not to the bit those of other platforms" in err


def test_mistyped_arguments_are_guessed() -> None:
    image = np.zeros((40, 60), np.uint8)
    with pytest.raises(TypeError, match=r"no such setting \(did you mean num_disparities\?\)"):
        ps.match(image, image, num_disparties=16)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"no such setting \(did you mean window\?\)"):
        ps.Matcher(windwo=5)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"num_disparities: no such setting \(an argument of match"):
        ps.Matcher(num_disparities=16)  # type: ignore[call-arg]


def test_version_is_that_of_the_package(run: Callable[..., Run]) -> None:
    assert run("--version") == (0, f"{ps.__version__}\n", "")


# What is refused: exit code, and the one line on standard error

WRONG = 2
FAILED = 1


def truncate(name: str) -> None:
    content = Path(name).read_bytes()
    Path(name).write_bytes(content[: len(content) // 2])


def lie(name: str) -> None:
    Path(name).write_bytes(b"Pf\n65 40\n-1.0\nabc")


REFUSALS: list[tuple[str, int, str]] = [
    ("left.png right.png --num-disparities 6.5 --json", WRONG, "got 6.5; accepts a whole number"),
    ("left.png right.png --p1 5 2 --json", WRONG, "unknown arguments: 2"),
    ("left.png right.png --num-disparities 9 8 --json", WRONG, "unknown arguments: 8"),
    ("left.png right.png --bands a,b --json", WRONG, "--bands: got a,b; accepts whole numbers"),
    ("left.png right.png --rectify left.png --json", WRONG, "--rectify: got left.png, which is a"),
    ("left.png right.png --calib left.png --depth a.pfm", WRONG, "--calib: got left.png, which is"),
    ("left.png right.png --num-disparities some --json", WRONG, "--num-disparities"),
    ("left.png right.png --min-disparity 3 --json", WRONG, "3; accepts 0 without --num-disp"),
    ("left.png --num-disparities 9 --json", WRONG, "--layout: got None for left.png"),
    ("left.png right.png --num-disparities 0 --json", WRONG, "--num-disparities"),
    ("left.png right.png --num-disparities 66 --json", WRONG, "--num-disparities: got 66"),
    ("left.png right.png --num-disparities 1e3 --json", WRONG, "--num-disparities"),
    ("left.png right.png --num-disparities 9 --min-disparity 99 --json", WRONG, "--min-disparity"),
    (
        "left.png right.png --num-disparities 9 --threads -1 --json",
        WRONG,
        'value "-1" for --threads. Must',
    ),
    ("left.png right.png --num-disparities 9 --threads 1025 --json", WRONG, "--threads: got 1025"),
    ("left.png right.png --num-disparities 9 --preset best --json", WRONG, "--preset: got 'best'"),
    ("left.png right.png --num-disparities 9 --window 4 --json", WRONG, "--window: got 4"),
    ("left.png right.png --num-disparities 9 --cost ssd --json", WRONG, "--cost"),
    ("left.png right.png --num-disparities 9 --p1 x --json", WRONG, "--p1"),
    ("left.png right.png --num-disparities 9 --p2 -1 --json", WRONG, "--p2: got -1"),
    ("left.png right.png --num-disparities 9 --frequencies 2 --json", WRONG, "--frequencies"),
    ("left.png right.png --num-disparities 9 --best --json", WRONG, "--best"),
    ("left.png right.png --num-disparities 9 -o out.jpg", WRONG, "--output: got .jpg; .*--color"),
    ("left.png right.png --num-disparities 9 -o out.xyz", WRONG, "--output: .*'.xyz'"),
    ("left.png right.png --num-disparities 9 --color out.pfm", WRONG, "--color: .pfm"),
    ("left.png right.png --num-disparities 9 -o left.png", WRONG, "--output: left.png is an input"),
    (
        "left.png right.png --num-disparities 9 --color ./a.png -o a.png",
        WRONG,
        "a.png is an input or another",
    ),
    ("left.png right.png --num-disparities 9 --min-disparity -4 -o a.png", WRONG, "--output: .*-4"),
    ("left.png right.png --num-disparities 9 --truth-scale 4 --json", WRONG, "--truth-scale"),
    ("left.png right.png --num-disparities 9 --truth truth.pfm --truth-scale 0", WRONG, "-scale"),
    ("none.png right.png --num-disparities 9 --json", FAILED, "none.png: No such file"),
    ("left.png lie.pfm --num-disparities 9 --json", FAILED, "lie.pfm: .*header"),
    ("left.png broken.png --num-disparities 9 --json", FAILED, "broken.png: "),
    ("left.png small.png --num-disparities 9 --json", FAILED, "right: got 4 x 64 .*up to 8 times"),
    ("left.png text.png --num-disparities 9 --json", FAILED, "text.png: not an image"),
    ("left.png empty.png --num-disparities 9 --json", FAILED, "empty.png: an empty file"),
    ("left.png inf.npy --num-disparities 9 --json", FAILED, "right: got inf"),
    ("inf.npy inf.npy --num-disparities 9 --json", FAILED, "left: "),
    ("left.png right.png --num-disparities 9 -o left.png/out.pfm", FAILED, "left.png: File exists"),
    ("left.png right.png --num-disparities 9 -o sub", FAILED, "sub is a folder"),
    ("left.png right.png --num-disparities 9 --json --truth lie.pfm", FAILED, "lie.pfm: "),
    ("left.png right.png --num-disparities 9 --json --truth left.png", FAILED, "--truth-scale"),
    ("left.png right.png --num-disparities 9 --json --truth none.pfm", FAILED, "none.pfm"),
    ("left.png right.png --num-disparities 9 --json --truth nan.pfm", FAILED, "nothing .* score"),
    (
        "left.png right.png --num-disparities 9 --json --left-mask small.png",
        FAILED,
        "--left-mask: got s",
    ),
    ("left.png right.png --num-disparities 9 --json --left-mask nan.pfm", FAILED, "nan.pfm: "),
    ("left.png right.png --json --left-mask black.png", WRONG, "--left-mask: got no valid pixel"),
    ("left.png right.png --json --right-mask black.png", WRONG, "--right-mask: got no valid pixel"),
    (
        "left.png right.png --num-disparities 9 --truth truth.pfm --truth-mask small.png",
        FAILED,
        "s",
    ),
]


@pytest.mark.parametrize(("arguments", "code", "message"), REFUSALS)
def test_refusals_are_one_line_and_leave_nothing(
    folder: Path, run: Callable[..., Run], arguments: str, code: int, message: str
) -> None:
    io.write_image("broken.png", io.read_image("right.png"))
    truncate("broken.png")

    lie("lie.pfm")
    Path("text.png").write_text("not an image at all")
    Path("empty.png").touch()
    Path("sub").mkdir()
    io.write_image("small.png", np.ones((4, 64), np.uint8))
    io.write_image("black.png", np.zeros((40, 65), np.uint8))
    io.write_image("nan.pfm", np.full((40, 65), np.nan, np.float32))
    io.write_image("inf.npy", np.full((40, 65), np.inf, np.float32))

    before = {name: (folder / name).stat().st_mtime_ns for name in listing(folder)}

    got, out, err = run("match", *arguments.split())
    assert (got, out) == (code, "")
    assert re.fullmatch(rf"phasestereo: error: .*{message}.*\n", err)
    assert {name: (folder / name).stat().st_mtime_ns for name in listing(folder)} == before


def test_unknown_commands_are_refused(run: Callable[..., Run]) -> None:
    code, out, err = run("frobnicate")
    assert (code, out) == (WRONG, "")
    assert re.fullmatch(r"phasestereo: error: .*frobnicate.*\n", err)


@pytest.mark.skipif(os.name == "nt", reason="needs symbolic links")
def test_input_is_not_overwritten_through_a_link(folder: Path, run: Callable[..., Run]) -> None:
    (folder / "link.png").symlink_to("right.png")
    before = Path("right.png").read_bytes()
    code, _, err = match(run, "-o", "link.png")
    assert code == WRONG
    assert "link.png is an input" in err
    assert Path("right.png").read_bytes() == before


@pytest.mark.usefixtures("folder")
def test_nothing_is_matched_before_the_outputs_are_checked(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[int] = []
    monkeypatch.setattr("phasestereo.cli.match.match_pair", lambda *_, **__: called.append(1))
    for option, path in (("-o", "left.png/out.pfm"), ("-o", "out.xyz"), ("--color", "out.pfm")):
        assert match(run, option, path)[0] in (WRONG, FAILED)
    assert called == []


@pytest.mark.usefixtures("folder")
def test_failing_writes_leave_nothing_behind(
    folder: Path, run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device", "out.png")

    before = listing(folder)
    monkeypatch.setattr("phasestereo.cli.outputs.Outputs.check", lambda *_: None)
    monkeypatch.setattr("phasestereo.cli.outputs.write_image", fail)
    code, _, err = match(run, "--color", "out.png")
    assert (code, err) == (FAILED, "phasestereo: error: out.png: No space left on device\n")
    assert listing(folder) == before


@pytest.mark.usefixtures("folder")
def test_bugs_show_their_traceback(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise KeyError("bug")

    monkeypatch.setattr("phasestereo.cli.match.match_pair", broken)
    with pytest.raises(KeyError, match="bug"):
        match(run, "--json")


# As a process


@pytest.mark.usefixtures("folder")
def test_process_exit_codes_and_streams() -> None:
    arguments = "match", "left.png", "right.png", "--num-disparities", COUNT
    good = process(*arguments, "--json", "-o", "out.pfm")
    assert (good.returncode, good.stderr) == (0, "")  # no progress bar where nobody looks
    assert json.loads(good.stdout)["files"] == {"output": "out.pfm"}
    assert process(*arguments, "-o", "left.png/out.pfm").returncode == FAILED
    made = process(*arguments, "-o", "new/out.pfm")
    assert (made.returncode, Path("new/out.pfm").is_file()) == (0, True)
    assert "probably wrong" in process(*arguments).stdout


def test_reader_who_leaves_early_gets_no_traceback(tmp_path: Path) -> None:
    with (tmp_path / "err").open("w") as err:
        command = [sys.executable, "-m", "phasestereo", "match", "--help"]
        writer = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=err)  # noqa: S603 - our own command
        writer.stdout.close()
        assert writer.wait() == 1
    assert (tmp_path / "err").read_text() == ""


@pytest.mark.usefixtures("folder")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="/dev/full is Linux's")
def test_output_that_nobody_can_take_gets_no_traceback() -> None:
    words = "match", "left.png", "right.png", "--num-disparities", COUNT, "-o"
    command = [sys.executable, "-m", "phasestereo", *map(str, words)]
    with Path("/dev/full").open("w") as full:
        for given in ([*command, "full.pfm"], [*command[:4], "--help"]):
            ended = subprocess.run(given, stdout=full, stderr=subprocess.PIPE, check=False)  # noqa: S603 - our own command
            said = b"phasestereo: error: standard output: No space left on device\n"
            assert (ended.returncode, ended.stderr) == (FAILED, said)

    for name, closed in (("no_out.pfm", ">&-"), ("no_err.pfm", "2>&-"), ("none.pfm", ">&- 2>&-")):
        line = " ".join([*command, name, closed])
        ended = subprocess.run(line, shell=True, capture_output=True, check=False)  # noqa: S602 - closes a stream
        assert (ended.returncode, ended.stderr) == (0, b"")
        assert Path(name).read_bytes() == Path("full.pfm").read_bytes()


def test_the_home_folder_is_found_where_shells_leave_it(
    folder: Path, run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(folder / "home"))
    monkeypatch.setenv("USERPROFILE", str(folder / "home"))
    for words in (["--output=~/a.pfm"], ["-o", "~/b.pfm"]):
        assert match(run, *words)[0] == 0
    assert listing(folder / "home") == {"a.pfm", "b.pfm"}
    assert match(run, "--output=./~/c.pfm")[0] == 0
    assert listing(folder / "~") == {"c.pfm"}


@pytest.mark.skipif(os.name == "nt", reason="needs a pseudo-terminal")
@pytest.mark.usefixtures("folder")
def test_progress_is_shown_on_terminals() -> None:
    master, slave = os.openpty()
    arguments = ["match", "left.png", "right.png", "--num-disparities", "16", "--json"]
    command = [sys.executable, "-m", "phasestereo", *arguments]

    run = subprocess.run(command, stdout=subprocess.PIPE, stderr=slave, check=False)  # noqa: S603 - our own command
    # What was written may get lost with the last one that holds the other end.
    assert select.select([master], [], [], 10)[0], "something is shown"

    shown = os.read(master, 100_000).decode()
    os.close(slave)
    os.close(master)

    assert run.returncode == 0
    assert "Matching" in shown
    assert "Matching" not in run.stdout.decode()


@pytest.mark.skipif(os.name == "nt", reason="needs a pseudo-terminal")
def test_interrupt_ends_a_match_soon_and_leaves_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for name in ("left.npy", "right.npy"):  # a match of many seconds
        io.write_image(tmp_path / name, rng.integers(0, 256, (3000, 1500), dtype=np.uint8))

    before = listing(tmp_path)

    master, slave = os.openpty()
    search = ["--preset", "paper", "--num-disparities", "512"]  # without estimates before it
    options = [*search, "--threads", "1", "-o", "out.pfm"]
    running = subprocess.Popen(  # noqa: S603 - our own command
        [sys.executable, "-m", "phasestereo", "match", "left.npy", "right.npy", *options],
        cwd=tmp_path,
        stderr=slave,
    )
    os.close(slave)

    shown = ""
    while not re.search(r"[1-9]\d?%", shown):
        shown += os.read(master, 4096).decode()

    running.send_signal(signal.SIGINT)
    assert running.wait(timeout=10) == 130
    shown += os.read(master, 100_000).decode()
    os.close(master)

    assert "phasestereo: interrupted" in shown
    assert "Traceback" not in shown
    assert listing(tmp_path) == before


STRANGE = "a\x1b[2Jb\x9b1mc\u202ed.png"


@pytest.mark.skipif(sys.platform == "win32", reason="no such names")
@pytest.mark.usefixtures("folder")
def test_names_of_files_cannot_write_to_the_terminal(run: Callable[..., Run]) -> None:
    code, out, err = run("match", STRANGE, STRANGE, "--num-disparities", "4", "--json")

    shown = "a\\x1b[2Jb\\x9b1mc\\u202ed.png"
    assert (code, out, err) == (
        1,
        "",
        f"phasestereo: error: {shown}: No such file or directory\n",
    )

    output = Path(STRANGE).with_suffix(".npy")
    code, out, err = run("match", "left.png", "right.png", "--num-disparities", "4", "-o", output)
    assert (code, err) == (0, "")
    assert out.endswith(f"wrote {shown[:-4]}.npy\n")

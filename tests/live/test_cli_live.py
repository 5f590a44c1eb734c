"""``phasestereo live``: what it writes of videos, folders and cameras, and what it refuses."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo.views.picture import colorize
from phasestereo_live.video.decoding import open_video
from support import counterpart
from support.footage import (
    COLS,
    COUNT,
    INTRA,
    LOSSLESS,
    ROWS,
    damage,
    film,
    pair,
    shift,
    side_by_side,
)

cli = pytest.importorskip("phasestereo.cli")
av = counterpart("av")
cv2 = counterpart("cv2")

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from support import Run

WRONG, FAILED, INTERRUPTED = 2, 1, 130
SEARCH = ("--num-disparities", COUNT, "--preset", "fast")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds a video of six frames."""
    monkeypatch.chdir(tmp_path)
    film(Path("video.mkv"), side_by_side(6), **LOSSLESS, times=[0, 1, 2, 5, 6, 7])
    return tmp_path


def process(*arguments: object) -> list[str]:
    return [sys.executable, "-W", "error", "-m", "phasestereo", "live", *map(str, arguments)]


def listing() -> set[str]:
    return set(os.listdir())  # noqa: PTH208 - names, hidden ones too


def pictures(path: str) -> list[tuple[float, Any]]:
    """Return the times and the pictures of a video."""
    with av.open(path) as container:
        return [(frame.time, frame.to_ndarray(format="rgb24")) for frame in container.decode()]


def luma_error(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Return the difference in brightness of two pictures; a video halves their colors."""
    return float(abs((one.astype(float) - other) @ (0.299, 0.587, 0.114)).mean())


# What comes out


def test_video_shows_the_left_image_beside_the_disparities(run: Callable[..., Run]) -> None:
    code, out, err = run("live", "video.mkv", *SEARCH, "-o", "out.mp4")
    assert (code, err) == (0, "")
    assert out.startswith("6 frames, 0 failed, ")
    assert out.endswith(f" of {COLS} x {ROWS} pixels, {COUNT} disparities\nwrote out.mp4\n")

    found = pictures("out.mp4")
    assert [when for when, _ in found] == pytest.approx([0, 0.05, 0.1, 0.25, 0.3, 0.35], abs=1e-3)

    capture = cv2.VideoCapture("out.mp4")
    for index, (_, shown) in enumerate(found):
        assert shown.shape == (ROWS, 2 * COLS, 3)
        left, right = pair(index)
        assert luma_error(shown[:, :COLS], left) < 3
        wanted = ps.match(left, right, num_disparities=COUNT, preset="fast").disparity
        colors = colorize(wanted, low=0, high=COUNT)
        assert luma_error(shown[:, COLS:], colors) < 8
        there, bgr = capture.read()
        assert there
        assert abs(bgr[:, :, ::-1].astype(int) - shown).mean() < 5

    assert not capture.read()[0]
    assert listing() == {"video.mkv", "out.mp4"}


def test_what_masks_leave_is_matched(run: Callable[..., Run]) -> None:
    seen = np.ones((ROWS, COLS), bool)
    seen[: ROWS // 3, : COLS // 2] = False
    io.write_image("left_mask.png", 255 * seen.astype(np.uint8))
    io.write_image("right_mask.png", 255 * seen[:, ::-1].astype(np.uint8))
    masks = "--left-mask", "left_mask.png", "--right-mask", "right_mask.png"
    code, _, err = run(
        "live", "video.mkv", *SEARCH, "--frames", "d%03d.npy", "--no-temporal-filter", *masks
    )
    assert code == 0, err

    wanted = ps.match(
        *pair(0),
        num_disparities=COUNT,
        preset="fast",
        left_mask=seen,
        right_mask=np.ascontiguousarray(seen[:, ::-1]),
    )
    np.testing.assert_array_equal(np.load("d000.npy"), wanted.disparity)

    code, _, err = run(
        "live", "video.mkv", *SEARCH, "--frames", "d%03d.npy", "--left-mask", "no.png"
    )
    assert code != 0
    assert "no.png" in err


@pytest.mark.parametrize("ending", ["pfm", "npy", "tif", "png"])
def test_each_frame_has_its_file(run: Callable[..., Run], ending: str) -> None:
    pattern = f"maps/all/d%03d.{ending}"

    code, out, _ = run("live", "video.mkv", *SEARCH, "--frames", pattern, "--every", 2)
    assert code == 0
    assert f"wrote {pattern}" in out

    assert sorted(path.name for path in Path("maps/all").iterdir()) == [
        f"d{index:03}.{ending}" for index in (0, 2, 4)
    ]

    least, step = (1 / 256, 1 / 512) if ending == "png" else (0, 0)  # as KITTI has it
    for index in (0, 2, 4):
        wanted = ps.match(*pair(index), num_disparities=COUNT, preset="fast").disparity
        found = io.read_disparity(pattern % index)
        np.testing.assert_allclose(found, np.maximum(wanted, least), 0, step)


def test_settings_arrive(run: Callable[..., Run]) -> None:
    options = "--min-disparity 2 --optimizer wta --no-fill --threads 1 --start 1 --stop 2"
    code, _, _ = run("live", "video.mkv", *SEARCH, "--frames", "%d.npy", *options.split())
    assert code == 0

    wanted = ps.match(
        *pair(1),
        num_disparities=COUNT,
        min_disparity=2,
        preset="fast",
        optimizer="wta",
        fill=False,
    )

    np.testing.assert_array_equal(io.read_disparity("1.npy"), wanted.disparity)
    assert listing() == {"video.mkv", "1.npy"}


def test_a_frame_without_its_other_view_is_named_in_plain_words(run: Callable[..., Run]) -> None:
    for side in (0, 1):
        Path(str(side)).mkdir()
        for index in range(2 - side):
            io.write_image(f"{side}/{index}.png", pair(index)[side])
    code, _, err = run("live", "0", "1", *SEARCH, "--json")
    assert (code, err) == (0, "phasestereo: skipped frame 1: 1/1.png: No such file or directory\n")


def test_json_is_one_object_and_nothing_else(run: Callable[..., Run]) -> None:
    damage(film(Path("a.mkv"), side_by_side(4), **INTRA), Path("b.mkv"), {1})

    code, out, err = run("live", "b.mkv", *SEARCH, "--json", "-o", "o.mkv")
    assert code == 0
    assert err.startswith("phasestereo: skipped frame 1: damaged")

    said = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert (said["width"], said["height"], said["num_disparities"]) == (COLS, ROWS, COUNT)
    assert (said["frames"], said["failed"], said["interrupted"]) == (3, 1, False)
    assert [failure["frame"] for failure in said["failures"]] == [1]
    assert said["files"] == {"output": "o.mkv"}
    assert said["settings"]["optimizer"] == ps.PRESETS["fast"].optimizer
    assert said["frames_per_second"] == pytest.approx(3 / said["seconds"])

    times = [when for when, _ in pictures("o.mkv")]
    assert times == pytest.approx([0, 0.1, 0.15])  # the one that is missing leaves a gap


def test_folders_and_layouts(run: Callable[..., Run]) -> None:
    for index in range(2):
        for view, image in zip(("left", "right"), pair(index), strict=True):
            Path(view).mkdir(exist_ok=True)
            io.write_image(f"{view}/{index}.png", image)

    Path("both").mkdir()
    io.write_image("both/1.png", np.concatenate(pair(1)))
    for number, source in enumerate(
        (("left", "right"), (".",), ("both", "--layout", "top-bottom"))
    ):
        code, _, err = run("live", *source, *SEARCH, "--frames", f"m{number}/%d.pfm")
        assert (code, err) == (0, "")

    code, _, err = run("live", ".", *SEARCH, "--rate", 5, "-o", "o.mp4")
    assert (code, err) == (0, "")
    assert [when for when, _ in pictures("o.mp4")] == pytest.approx([0, 0.2])

    for name, index in (("m0/1.pfm", 1), ("m1/1.pfm", 1), ("m2/0.pfm", 1)):
        assert np.median(io.read_disparity(name)) == shift(index)


def test_cameras(run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV opens a video file just as it opens a camera."""
    for number, view in ((0, 0), (2, 1)):
        film(Path(f"{number}.avi"), [pair(index)[view] for index in range(3)], **LOSSLESS)

    device = cv2.VideoCapture
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: device(f"{number}.avi"))

    code, out, err = run("live", "--cameras", 0, 2, *SEARCH, "--frames", "%d.pfm")
    assert code == 0
    assert out.startswith("3 frames, 5 failed")
    assert "camera 0: gave no frame, and is given up" in err
    assert [np.median(io.read_disparity(f"{index}.pfm")) for index in range(3)] == [3, 4, 5]


def test_frames_are_logged_to_rerun(run: Callable[..., Run]) -> None:
    damage(film(Path("a.mkv"), side_by_side(4), **INTRA), Path("b.mkv"), {1})
    Path("calib.txt").write_text(
        "cam0=[100 0 48; 0 100 32; 0 0 1]\ncam1=[100 0 48; 0 100 32; 0 0 1]\n"
        f"doffs=0\nbaseline=60\nwidth={COLS}\nheight={ROWS}\n"
    )

    options = ("--rerun", "a.rrd", "--calib", "calib.txt")
    assert run("live", "b.mkv", *SEARCH, *options)[0] == 0

    found: dict[str, set[int]] = {}
    for chunk in counterpart("rerun.chunk").RrdReader("a.rrd").stream():
        for row in chunk.to_record_batch().to_pylist():
            if "frame" in row:
                found.setdefault(chunk.entity_path, set()).add(row["frame"])

    good = {0, 2, 3}
    assert found == {
        "/stereo/left": good,
        "/stereo/left/depth": good,
        "/stereo/right": good,
        "/stereo/disparity": good,
        "/stereo/points": good,
        "/stereo/failures": {1},
    }


def test_image_of_another_size_fails_in_the_video_alone(run: Callable[..., Run]) -> None:
    for index, size in enumerate((COLS, COLS - 8, COLS)):
        for view, image in zip(("left", "right"), pair(index), strict=True):
            Path(view).mkdir(exist_ok=True)
            io.write_image(f"{view}/{index}.png", image[:, :size])

    code, out, err = run("live", ".", *SEARCH, "-o", "o.mp4", "--frames", "m/%d.pfm")

    assert code == 0
    assert out.startswith("2 frames, 1 failed")
    assert "skipped frame 1: picture: got 176 x 64 pixels; accepts 192 x 64, as before" in err
    assert len(list(Path("m").iterdir())) == 3
    assert len(pictures("o.mp4")) == 2


# What goes wrong


def test_no_frame_at_all_is_a_failure(run: Callable[..., Run]) -> None:
    damage(film(Path("a.mkv"), side_by_side(2), **INTRA), Path("b.mkv"), {0, 1})
    code, _, err = run("live", "b.mkv", *SEARCH, "-o", "o.mp4")
    assert code == FAILED
    assert err.endswith("phasestereo: error: none of 2 frames could be matched\n")
    code, _, err = run("live", "a.mkv", *SEARCH, "--start", "2", "-o", "o.mp4")
    assert (code, err) == (FAILED, "phasestereo: error: the source has no frame to match\n")
    assert listing() == {"video.mkv", "a.mkv", "b.mkv"}


def test_a_page_without_a_frame_ends(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "phasestereo_live.cli.show.Screen.stay", lambda _: pytest.fail("waits for nothing")
    )
    code, _, err = run("live", "video.mkv", *SEARCH, "--start", 6)
    assert code == FAILED
    assert err.endswith("phasestereo: error: the source has no frame to match\n")


@pytest.mark.parametrize("more", ["-o o.mp4", "--frames m/%d.npy"])
def test_full_disk_ends_the_run_and_names_the_file(more: str) -> None:
    """A limit on the size of files stands for it; what was not completed was not written."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({2**13}, -1))"
    start = f"{limited}; from phasestereo import cli; import sys; sys.exit(cli.run(sys.argv[1:]))"
    command = [sys.executable, "-c", start, *process("video.mkv", *SEARCH, *more.split())[5:]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    name = more.split()[1] % 0 if "%" in more else "o.mp4"
    assert done.returncode == FAILED, done.stderr
    assert done.stderr.startswith(f"phasestereo: error: {name}: ")
    assert "wrote" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("video.mkv --json --save-to .", WRONG, "--save-to: has no effect without --show"),
        ("video.mkv --save-to text.mp4", FAILED, "text.mp4: File exists"),
        ("video.mkv --show=window", WRONG, "--show"),
        ("--json", WRONG, "SOURCE is missing"),
        ("video.mkv --cameras 0 1 --json", WRONG, "--cameras: got SOURCE as well"),
        ("--cameras 0 1 2 --json", WRONG, "--cameras: got 0 1 2; accepts one or two"),
        ("text.mp4 --json", FAILED, "text.mp4: damaged, or no video"),
        ("video.mkv -o video.mkv", WRONG, "--output: video.mkv is an input or another"),
        ("video.mkv -o ./none/../video.mkv", WRONG, "--output: none/../video.mkv is an input"),
        ("video.mkv -o o.gif", WRONG, "--output: path of a video must end in .mp4 or"),
        ("video.mkv -o text.mp4/o.mp4", FAILED, "text.mp4: File exists"),
        ("video.mkv --frames d.pfm", WRONG, "--frames: got d.pfm; accepts a name with one number"),
        ("video.mkv --frames %s%d.pfm", WRONG, "--frames: got %s%d.pfm; accepts a name"),
        ("video.mkv --frames %d.jpg", WRONG, "--frames: path of a disparity map must end in"),
        ("video.mkv --frames text.mp4/%d.pfm", FAILED, "text.mp4: File exists"),
        ("rig --frames rig/left/%d.png", WRONG, "--frames: rig/left holds the images"),
        ("video.mkv --frames %d.png --min-disparity -9", WRONG, "--frames: disparity must lie in"),
        ("video.mkv --rerun o.mp4", WRONG, "--rerun: path of a recording must end in .rrd"),
        (
            "video.mkv --json --calib c.txt",
            WRONG,
            "--calib: has no effect without",
        ),
        (
            "video.mkv --rerun o.rrd --calib rig/left/0.png",
            WRONG,
            "--calib: got rig/left/0.png, which",
        ),
        ("video.mkv --json --rate 5", WRONG, "--rate: has no effect without --output"),
        ("video.mkv --json --num-disparities 97", WRONG, "--num-disparities: got 97"),
        ("video.mkv --json --preset slow", WRONG, "--preset: got 'slow'"),
        ("video.mkv video.mkv --layout top-bottom --json", WRONG, "--layout: got 'top-bottom'"),
        ("video.mkv --layout both --json", WRONG, "--layout"),
        ("rig/left --json", FAILED, "source: rig/left has neither"),
        ("rig --start 1", WRONG, "--start: got 1; accepts less than 1, the number of frames"),
    ],
)
def test_wrong_commands_are_refused(
    run: Callable[..., Run], arguments: str, code: int, message: str
) -> None:
    Path("text.mp4").write_text("no video")
    for view in ("left", "right"):
        Path("rig", view).mkdir(parents=True)
        io.write_image(f"rig/{view}/0.png", pair(0)[0])

    before = listing()

    words = arguments.split()
    search = () if "--num-disparities" in words else SEARCH[:2]
    preset = () if "--preset" in words else SEARCH[2:]
    found, out, err = run("live", *words, *search, *preset)

    assert (found, out) == (code, "")
    assert err.startswith("phasestereo: error: ")
    assert message in err
    assert listing() == before


# Processes of their own


def begun(*options: object) -> subprocess.Popen[str]:
    """Start a long run, and return once it has written some frames."""
    film(Path("long.mkv"), (side_by_side(20) * 200), codec="mjpeg", pixels="yuvj444p")
    command = process("long.mkv", *SEARCH, "--frames", "m/%d.pfm", *options)
    running = subprocess.Popen(  # noqa: S603 - our own command
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )

    while not Path("m/60.pfm").exists():
        assert running.poll() is None, running.communicate()
        time.sleep(0.01)

    return running


def test_interrupt_completes_the_files() -> None:
    running = begun("-o", "o.mp4", "--json")

    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (INTERRUPTED, "phasestereo: interrupted\n")

    said = json.loads(out)
    assert said["interrupted"] is True
    assert 60 <= said["frames"] < 4000
    assert said["frames"] <= len(pictures("o.mp4")) <= said["frames"] + 1

    assert listing() == {"video.mkv", "long.mkv", "o.mp4", "m"}
    assert not [path for path in Path("m").iterdir() if path.suffix != ".pfm"]


def test_interrupt_lets_the_frame_be_written(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def write(path: Path, disparity: NDArray[np.float32]) -> None:
        if path.name == "2.pfm":
            signal.raise_signal(signal.SIGINT)
        io.write_disparity(path, disparity)
        written.append(path.name)

    monkeypatch.setattr("phasestereo_live.cli.outputs.write_disparity", write)
    with pytest.raises(KeyboardInterrupt):
        run("live", "video.mkv", *SEARCH, "--frames", "m/%d.pfm", "-o", "o.mp4")

    assert written[1:] == ["0.pfm", "1.pfm", "2.pfm"]  # after a rehearsal
    assert len(pictures("o.mp4")) == 3


def test_killed_run_leaves_a_draft_that_plays() -> None:
    running = begun("-o", "o.mp4")
    running.kill()
    running.communicate(timeout=60)
    (draft,) = Path().glob("o.*.part.mp4")
    captures = list(open_video(draft).captures)
    assert len(captures) >= 20
    assert captures[10].take().shape == (ROWS, 2 * COLS, 3)

"""The command line on pairs larger than memory: what it says, what it refuses, and a kill."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from phasestereo_large.windows import open_raster
from support import counterpart

rasterio = counterpart("rasterio")
cli = counterpart("phasestereo.cli")
counterpart("filelock")

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from support import Run

HEIGHT, WIDTH, COUNT = 640, 160, 16
PAIR = ["large", "left.tif", "right.tif", "--num-disparities", str(COUNT)]
LARGE = [*PAIR, "--max-memory", "4GB"]
COMMAND = [*LARGE, "--band-rows", "32"]


@pytest.fixture(autouse=True)
def pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Write left.tif and right.tif in the current folder, and return their content."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(0)
    left = random.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    right = np.roll(left, -5, axis=1)
    for name, image in (("left.tif", left), ("right.tif", right)):
        write_geotiff(name, image, like=Georeference(crs="EPSG:32631"))
    return left, right


def names() -> list[str]:
    return sorted(path.name for path in Path().iterdir())


def blocks() -> dict[str, tuple[int, int]]:
    found = Path("out.tif.part").glob("rows*.npz")
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in found}


def test_it_says_what_it_takes_and_what_came_out(
    pair: tuple[NDArray[np.uint8], ...], run: Callable[..., Run]
) -> None:
    code, out, err = run(*LARGE, "-o", "out.tif", "--threads", 1, "--band-rows", 128)
    assert code == 0, err

    looking, first, second, putting = err.splitlines()
    assert looking == "phasestereo: looking at the whole pair"
    assert putting == "phasestereo: putting the output together"
    assert re.fullmatch(
        r"phasestereo: 160 x 640 pixels, 16 disparities: 5 bands of 128 rows, 1 threads?, "
        r"at most [\d.]+ [MG]B of memory, about \d+ s", first
    )  # fmt: skip
    assert re.fullmatch(r"phasestereo: by its first band, \d+ s to go", second)

    lines = out.splitlines()
    assert re.match(r"160 x 640 pixels, 16 disparities, [\d.]+ s", lines[0])
    assert lines[1].startswith("estimated 100.0%, flagged: ")
    assert lines[-1] == "wrote out.tif"

    whole = ps.match(*pair, num_disparities=COUNT)
    found = read_geotiff("out.tif")
    np.testing.assert_array_equal(found.image, whole.disparity)
    assert found.georeference.crs == rasterio.CRS.from_epsg(32631)

    assert names() == ["left.tif", "out.tif", "right.tif"]


def test_the_summary_is_one_json_object(run: Callable[..., Run]) -> None:
    options = ["-o", "out.npy", "--flags-output", "flags.npy", "--json", "--preset", "fast"]
    options += ["--confidence", "--confidence-output", "confidence.npy"]

    code, out, _ = run(*LARGE, *options, "--band-rows", 320)
    summary = json.loads(out)
    assert code == 0

    assert (summary["width"], summary["height"]) == (WIDTH, HEIGHT)
    assert summary["bands"] == {"matched": 2, "finished_before": 0, "rows": 320}
    assert summary["settings"]["optimizer"] == "so"
    assert summary["estimated"] == 1.0

    assert summary["files"] == {
        "disparity": "out.npy", "flags": "flags.npy", "confidence": "confidence.npy"
    }  # fmt: skip
    assert all(np.load(name).shape == (HEIGHT, WIDTH) for name in summary["files"].values())

    assert summary["memory"]["expected"] > 0


def start(*options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "phasestereo", *COMMAND, "-o", "out.tif", *options]
    return subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # noqa: S603  # our own


def end_half_way(number: int) -> tuple[int, str]:
    """Start the command, send it a signal when it has two blocks, return its code and errors."""
    process = start()
    while len(blocks()) < 2 and process.poll() is None:
        time.sleep(0.001)
    process.send_signal(number)
    _, err = process.communicate()
    return process.returncode, err


@pytest.mark.skipif(os.name == "nt", reason="there are no such signals")
@pytest.mark.parametrize("name", ["SIGKILL", "SIGINT"])
def test_a_command_that_is_ended_half_way_goes_on(
    pair: tuple[NDArray[np.uint8], ...], run: Callable[..., Run], name: str
) -> None:
    number = getattr(signal, name)
    code, err = end_half_way(number)
    assert code == (130 if name == "SIGINT" else -number), err
    if name == "SIGINT":
        assert "finished bands are kept: the same command goes on from there" in err
    assert not Path("out.tif").exists()

    before = blocks()
    assert len(before) >= 2

    code, out, err = run(*COMMAND, "-o", "out.tif", "--json")
    assert code == 0, err
    assert f", {len(before)} finished before" in err
    assert json.loads(out)["bands"]["finished_before"] == len(before)
    assert json.loads(out)["bands"]["matched"] == HEIGHT // 32 - len(before)

    whole = ps.match(*pair, num_disparities=COUNT)
    with open_raster("out.tif") as raster:
        np.testing.assert_array_equal(raster.read(0, HEIGHT)[0], whole.disparity)
    assert names() == ["left.tif", "out.tif", "right.tif"]


def highest(process: subprocess.Popen[str]) -> int:
    """Return the most memory that a process has resident until it ends, in bytes."""
    most = 0
    while process.poll() is None:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{process.pid}/status").read_text())
        most = max(most, int(found[1]) * 1024 if found else 0)  # a zombie has none
        time.sleep(0.001)
    return most


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
@pytest.mark.parametrize(("preset", "limit"), [("fast", 170), ("robust", 280)])
def test_memory_stays_below_the_limit(preset: str, limit: int) -> None:
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (2400, 1500), np.uint8)
    for name in ("left.tif", "right.tif"):
        write_geotiff(name, image)

    command = [*PAIR, "--max-memory", f"{limit}MB", "--preset", preset, "-o", "out.tif"]
    process = subprocess.Popen(  # noqa: S603  # our own
        [sys.executable, "-m", "phasestereo", *command, "--json"],
        text=True,
        stdout=subprocess.PIPE,
    )

    most = highest(process)
    out, _ = process.communicate()

    assert process.returncode == 0
    assert json.loads(out)["bands"]["matched"] >= 2
    assert 0 < most <= limit * 10**6


def test_another_run_is_refused_unless_asked_for(run: Callable[..., Run]) -> None:
    end_half_way(signal.SIGTERM)
    code, _, err = run(*COMMAND, "-o", "out.tif", "--window", "7")
    assert code == 2
    assert err.startswith("phasestereo: error: --restart: got False, but ")
    assert "with window 5 (now 7); accepts True to drop them" in err
    assert run(*COMMAND, "-o", "out.tif", "--window", "7", "--restart")[0] == 0


@pytest.mark.parametrize(("options", "error"), [
    ("-o out.png", "--output: got out.png; accepts .tif, .tiff, .npy, .zarr"),
    ("-o left.tif", "--output: left.tif is in use already"),
    ("-o out.tif --flags-output out.tif", "--flags-output: out.tif is in use already"),
    ("-o out.tif --min-disparity 400", "--min-disparity: got 400"),
])  # fmt: skip
def test_a_wrong_command_line_is_reported(
    run: Callable[..., Run], options: str, error: str
) -> None:
    code, _, err = run(*COMMAND, *options.split())
    assert (code, err.split("error: ")[1][: len(error)]) == (2, error)
    assert names() == ["left.tif", "right.tif"]


@pytest.mark.parametrize("memory", ["1MB", "little"])
def test_what_is_no_memory_is_reported(run: Callable[..., Run], memory: str) -> None:
    code, _, err = run(*PAIR, "-o", "out.tif", "--max-memory", memory)
    assert code == 2
    assert "error: --max-memory: got " in err


@pytest.mark.parametrize(("change", "error"), [
    ({"crs": "EPSG:32632"}, "right.tif: got EPSG:32632; accepts the reference system of left.tif"),
    ({"size": (HEIGHT, WIDTH + 1)}, "right.tif: got (640, 161) pixels; accepts the size of left"),
])  # fmt: skip
def test_images_that_are_no_pair_are_reported(
    run: Callable[..., Run], change: dict[str, Any], error: str
) -> None:
    image = np.zeros(change.get("size", (HEIGHT, WIDTH)), np.uint8)
    write_geotiff("right.tif", image, like=Georeference(crs=change.get("crs", "EPSG:32631")))
    code, _, err = run(*COMMAND, "-o", "out.tif")
    assert (code, err.startswith(f"phasestereo: error: {error}")) == (1, True), err

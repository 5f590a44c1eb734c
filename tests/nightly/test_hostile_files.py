"""Small files that claim much, and files without an end, are refused at once and by name."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phasestereo_large import outofcore
from phasestereo_large.geotiff import read_geotiff, write_geotiff
from phasestereo_large.windows import open_raster
from support import ENVIRONMENT, NIGHTLY, Run, counterpart, hostile, sampled

for _module in ("PIL", "tifffile", "rasterio", "cv2", "yaml", "cyclopts", "rosbags", "zarr"):
    counterpart(_module)

SECONDS, BYTES = 2.0, 200_000_000  # that refusing may take


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hostile")
    hostile.make(made)
    return made


measured = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="memory is measured by /proc"
)


def said(program: str, folder: Path, timeout: int) -> list[Any]:
    """Run a program of the tests, and return the lines of JSON that it prints."""
    finished = subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, "-m", program, str(folder)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )

    assert finished.returncode == 0, finished.stderr[-2000:]
    # Libraries print, too.
    return [json.loads(line) for line in finished.stdout.splitlines() if line.startswith("{")]


@measured
def test_every_hostile_file_is_refused_soon_by_name_and_in_little_memory(folder: Path) -> None:
    outcomes = said("support.hostile", folder, 120)
    assert len(outcomes) == len(sampled([*hostile.cases(folder)], 4)) > 10
    assert [each for each in outcomes if not is_refused(each, folder)] == []


def is_refused(outcome: dict[str, Any], folder: Path) -> bool:
    named = f"{folder / outcome['file']}" in outcome["raised"]
    kind = outcome["raised"].split(":")[0]
    refused = kind in {"ValueError", "OSError"} and "\n" not in outcome["raised"]
    limit = 1.0 if outcome["file"] == "numbers.yml" else SECONDS  # a calibration of 120 kB
    return named and refused and outcome["seconds"] < limit and outcome["bytes"] < BYTES


@measured
def test_every_door_refuses_what_is_no_file_of_its_kind_soon_and_by_name(tmp_path: Path) -> None:
    """FIFO, device, hole, empty file, folder, missing; or cut short, stretched, mutated."""
    for module in ("av", "rerun", "distributed", "dask"):
        counterpart(module)
    listed, *outcomes = said("support.doors", tmp_path, 900)
    assert listed == {"unlisted": [], "gone": []}
    assert len(outcomes) > (900 if NIGHTLY else 100)
    assert [wrong for outcome in outcomes if (wrong := wrong_with(outcome))] == []


def wrong_with(outcome: dict[str, Any]) -> str:
    """Return the fault in the outcome of a call, in a line."""
    door, kind, raised = (outcome[name] for name in ("door", "kind", "raised"))
    is_allowed = kind == "empty" and door.endswith("read_manifest(path)")  # of no pair yet

    faults = {
        "is accepted": outcome["must"] and not raised and not is_allowed,
        "is refused": kind == "sound" and raised,
        "is refused in a wrong way": raised and not outcome["refused"],
        "is not named": raised and Path(outcome["file"]).stem not in raised,
        "takes too long": outcome["seconds"] > SECONDS and kind != "sound",
        "takes too much memory": outcome["bytes"] > BYTES and kind != "sound",
    }
    found = [fault for fault, is_there in faults.items() if is_there]
    return f"{door}: {outcome['file']} {', '.join(found)} {raised[:200]}" if found else ""


def test_a_mask_beside_a_picture_is_bounded_too(tmp_path: Path) -> None:
    write_geotiff(tmp_path / "a.tif", np.zeros((16, 16), np.uint8))
    (tmp_path / "a.tif.msk").write_bytes(hostile.looping())
    for read in (read_geotiff, lambda path: open_raster(path).__enter__()):
        with pytest.raises(ValueError, match=r"a\.tif\.msk: the directories .* in a circle"):
            read(tmp_path / "a.tif")


def test_a_run_out_of_core_takes_no_more_than_it_may_at_opening(tmp_path: Path) -> None:
    """A strip of 60 MB, which GDAL would unpack whole to read one pixel."""
    path = tmp_path / "a.tif"

    packed = hostile.zeros(2**26)
    path.write_bytes(
        hostile.tiff(hostile.page(2**13, 7000, compression=8, stored=len(packed)), packed)
    )

    with pytest.raises(ValueError, match=r"blocks of 7000 rows, .* at most 40000000 are allowed"):
        outofcore.match(path, path, tmp_path / "o.npy", num_disparities=4, max_memory="40MB")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", [("match", "--num-disparities", "8", "--json"), ("check",)])
@pytest.mark.parametrize("name", ["loop.tif", "bomb.tif", "rgba.png"])
def test_the_commands_say_so_in_one_line(
    run: Callable[..., Run], folder: Path, command: tuple[str, ...], name: str
) -> None:
    path = folder / name
    code, out, err = run(command[0], path, path, *command[1:])
    assert (code, out) == (1, "")
    assert err.startswith(f"phasestereo: error: {path}: ")
    assert err.count("\n") == 1

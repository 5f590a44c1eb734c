"""Small files that claim much, and files without an end, are refused at once and by name."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import hostile
from conftest import ENVIRONMENT, counterpart
from phasestereo_large import outofcore
from phasestereo_large.geotiff import read_geotiff, write_geotiff
from phasestereo_large.windows import open_raster

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Run

for _module in ("PIL", "tifffile", "rasterio", "cv2", "yaml"):
    counterpart(_module)

SECONDS, BYTES = 2.0, 200_000_000  # that refusing may take


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("hostile")
    hostile.make(made)
    return made


@pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="memory is measured by /proc"
)
def test_every_hostile_file_is_refused_soon_by_name_and_in_little_memory(folder: Path) -> None:
    finished = subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, hostile.__file__, str(folder)],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )

    assert (finished.returncode, finished.stderr) == (0, "")
    outcomes = [json.loads(line) for line in finished.stdout.splitlines()]
    assert len(outcomes) == len(list(hostile.cases(folder))) > 40
    assert [each for each in outcomes if not is_refused(each, folder)] == []


def is_refused(outcome: dict[str, Any], folder: Path) -> bool:
    named = f"{folder / outcome['file']}" in outcome["raised"]
    kind = outcome["raised"].split(":")[0]
    refused = kind in {"ValueError", "OSError"} and "\n" not in outcome["raised"]
    return named and refused and outcome["seconds"] < SECONDS and outcome["bytes"] < BYTES


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
@pytest.mark.parametrize("name", ["loop.tif", "bomb.tif", "rgba.png", "fifo.png", "zero.png"])
def test_the_commands_say_so_in_one_line(
    run: Callable[..., Run], folder: Path, command: tuple[str, ...], name: str
) -> None:
    path = folder / name
    if not path.exists():
        pytest.skip("no FIFO here")
    code, out, err = run(command[0], path, path, *command[1:])
    assert (code, out) == (1, "")
    assert err.startswith(f"phasestereo: error: {path}: ")
    assert err.count("\n") == 1

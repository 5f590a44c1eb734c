"""What an import loads, and what users are told where an extra or a distribution is missing."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo._extras import require
from phasestereo.io import read_image
from phasestereo.views.picture import colorize
from phasestereo_large import dask as lazily, xarray as labeled
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from phasestereo_live import rerun
from support import ENVIRONMENT, counterpart


def run(
    *arguments: str, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run Python in a process of its own, from which this package can be imported."""
    return subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env=ENVIRONMENT | environment,
    )


def test_an_import_loads_numpy_and_nothing_else_from_outside() -> None:
    finished = run(
        "-W",
        "error",
        "-c",
        "import sys; before = set(sys.modules); import phasestereo\n"
        "print(*{name.partition('.')[0] for name in set(sys.modules) - before})",
    )

    assert (finished.returncode, finished.stderr) == (0, "")
    assert set(finished.stdout.split()) - sys.stdlib_module_names == {"numpy", "phasestereo"}


def test_an_import_loads_none_of_what_only_some_need() -> None:
    """Each of these takes as long to load as much of this package."""
    finished = run(
        "-c",
        "import sys, numpy; before = set(sys.modules); import phasestereo\n"
        "print(*set(sys.modules) - before)",
    )

    loaded = set(finished.stdout.split())
    assert (
        loaded & {"inspect", "importlib.metadata", "email", "json", "tomllib", "asyncio"} == set()
    )

    ours = {name.removeprefix("phasestereo.") for name in loaded}
    assert "_core" in ours
    others = {"cli", "io", "metrics", "opencv", "rectification", "stages", "views"}
    assert ours & (others | {"rig.diagnosis", "rig.estimation"}) == set()


@pytest.mark.parametrize("name", ps.__all__)
def test_what_is_imported_when_it_is_asked_for_is_there(name: str) -> None:
    assert name in dir(ps)
    assert getattr(ps, name) is not None


def test_a_name_that_is_not_there_is_reported() -> None:
    with pytest.raises(AttributeError, match=r"^module 'phasestereo' has no attribute 'mach'$"):
        ps.mach  # type: ignore[attr-defined]  # noqa: B018  # that is what is tested
    with pytest.raises(AttributeError, match=r"^phasestereo_live\.calibrate: pip install"):
        _ = ps.calibrate  # type: ignore[attr-defined]  # the point


# Missing extras, as users meet them


def hide(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make an installed package, and all of its modules, impossible to import."""
    top = module.partition(".")[0]
    loaded = [name for name in sys.modules if name == top or name.startswith(f"{top}.")]
    for name in {top, module, *loaded}:
        monkeypatch.setitem(sys.modules, name, None)


def test_an_error_inside_an_optional_package_is_not_taken_for_its_absence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_package.py").write_text("import nowhere_to_be_found\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="^No module named 'nowhere_to_be_found'$"):
        require("broken_package", extra="io")


def _read(name: str) -> Callable[[Path], object]:
    def read(folder: Path) -> object:
        (folder / name).write_bytes({"a.png": b"\x89PNG\r\n\x1a\n", "a.tif": b"II*\0"}[name])
        return read_image(folder / name)

    return read


def _color(_: Path) -> object:
    return colorize(np.ones((8, 8), np.float32))


def _film(folder: Path) -> object:
    (folder / "video.mp4").touch()
    return live.stream(folder / "video.mp4", num_disparities=16)


def _record(folder: Path) -> object:
    with rerun.saving(folder / "recording.rrd") as recording:
        return recording


def _label(_: Path) -> object:
    return labeled.as_dataset(ps.match(*PAIR, num_disparities=8))


PAIR = np.zeros((2, 40, 60), np.uint8)
MAPS = {name: PAIR[0].astype("f4") for name in ("map1x", "map1y", "map2x", "map2y")}


CALLS = [
    ("PIL", "io", _read("a.png")),
    ("tifffile", "io", _read("a.tif")),
    ("matplotlib", "plot", _color),
    ("cv2", "live", lambda _: live.stream(0, num_disparities=16)),
    ("cv2", "rectify", lambda _: ps.rectify(PAIR[0], PAIR[1], MAPS)),
    ("av", "live", _film),
    ("rerun", "rerun", _record),
    ("rasterio", "geo", lambda folder: write_geotiff(folder / "out.tif", np.ones((8, 8), "f4"))),
    ("rasterio", "geo", lambda folder: read_geotiff(folder / "a.tif")),
    ("xarray", "geo", _label),
    ("dask", "dask", lambda _: lazily.match(PAIR[0], PAIR[1], num_disparities=8)),
]


@pytest.mark.parametrize(("module", "extra", "call"), CALLS)
def test_users_are_given_the_command_when_they_call_what_needs_it(
    module: str,
    extra: str,
    call: Callable[[Path], object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hide(module, monkeypatch)
    command = re.escape(f"it comes with: pip install 'phasestereo[{extra}]'")
    with pytest.raises(ImportError, match=rf"^{module}[.\w]* is not installed; {command}$"):
        call(tmp_path)


@pytest.mark.parametrize("module", ["cyclopts", "rich"])
def test_the_command_without_its_extra_says_how_to_get_it(module: str) -> None:
    finished = run("-c", f"import sys; sys.modules[{module!r}] = None\n{MAIN}", COLUMNS="200")
    message = f"{module} is not installed; it comes with: pip install 'phasestereo[cli]'"
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == f"phasestereo: error: {message}\n"


def test_the_plugin_without_pandora_says_how_to_get_it() -> None:
    finished = run(
        "-c", "import sys; sys.modules['pandora'] = None\nimport phasestereo_large.pandora"
    )

    message = (
        "ImportError: pandora is not installed; it comes with: pip install 'phasestereo[pandora]'"
    )

    assert finished.returncode == 1
    assert finished.stderr.endswith(f"{message}\n")


MAIN = """
from phasestereo.__main__ import main
sys.argv = ["phasestereo", "--version"]
sys.exit(main())
"""


def test_the_command_with_its_extra_starts() -> None:
    counterpart("cyclopts")
    finished = run("-c", f"import sys\n{MAIN}")
    assert (finished.returncode, finished.stderr) == (0, "")
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*\n", finished.stdout)


# Missing distributions


@pytest.mark.parametrize(
    ("arguments", "requirement"),
    [
        (
            ["live", "video.mp4", "--num-disparities", "16"],
            "'phasestereo[live]' (in a clone: '.[live]' ./python/phasestereo-live)",
        ),
        (
            ["batch", "pairs.csv", "-o", "maps"],
            "'phasestereo[batch]' (in a clone: '.[batch]' ./python/phasestereo-large)",
        ),
        (
            ["large", "left.tif", "right.tif"],
            "'phasestereo[large]' (in a clone: '.[large]' ./python/phasestereo-large)",
        ),
        (["demo"], "./benches/harness (in a clone)"),
        (["bench", "speed"], "./benches/harness (in a clone)"),
    ],
)
def test_a_command_of_a_distribution_says_how_to_get_it_where_it_is_missing(
    arguments: list[str], requirement: str
) -> None:
    counterpart("cyclopts")
    finished = run("-c", f"{WITHOUT_OTHERS}sys.argv[1:] = {arguments}\nsys.exit(main())")
    message = f"this command is not installed; it comes with: pip install {requirement}"
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == f"phasestereo: error: {message}\n"


def test_the_help_of_a_command_that_is_missing_says_how_to_get_it() -> None:
    counterpart("cyclopts")
    finished = run(
        "-c", f"{WITHOUT_OTHERS}sys.argv[1:] = ['live', '--help']\nsys.exit(main())", COLUMNS="200"
    )
    assert finished.returncode == 0
    assert "Not installed; it comes with: pip install 'phasestereo[live]'" in finished.stdout


def test_a_geotiff_is_not_read_without_its_distribution(tmp_path: Path) -> None:
    counterpart("rasterio")
    for name in ("left.tif", "right.tif"):
        write_geotiff(
            tmp_path / name, np.zeros((40, 60), np.uint8), like=Georeference(crs="EPSG:32631")
        )

    arguments = ["match", "left.tif", "right.tif", "--json"]
    code = f"{WITHOUT_OTHERS}sys.argv[1:] = {arguments}\nsys.exit(main())"
    finished = run("-c", code, cwd=tmp_path)
    assert (finished.returncode, finished.stdout) == (1, "")
    assert finished.stderr == (
        "phasestereo: error: left.tif is a GeoTIFF, whose masks and place count: phasestereo-large "
        "is not installed; it comes with: pip install 'phasestereo[geo]'\n"
    )


WITHOUT_OTHERS = """
import sys
from importlib import import_module, metadata
metadata.entry_points = lambda **_: ()
from phasestereo.__main__ import main
"""

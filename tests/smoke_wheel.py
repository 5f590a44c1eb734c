"""Try wheels and source distributions as their users will: installed in an empty environment.

python tests/smoke_wheel.py [--url URL] FILE...

makes an empty environment of this Python for each file, far from the source tree, and installs the
file there: the matcher with NumPy alone, which then matches a pair; the others with their extras
and with the matcher's wheel beside them, whose commands then start, or which match on a GPU. With a
URL, links of the matcher's page have to start with it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHIFT = 4
"""Pixels between the images of the pair."""

ADDED = {
    "phasestereo_live": ("[ros,rerun]", ["live --help", "calibrate --help", "rig test --help"]),
    "phasestereo_large": ("[batch,dask,geo,large]", ["batch --help", "large --help"]),
}
"""Of the other distributions the extras, and the commands that they add."""

GPU_SIZE = 4.5
"""Most megabytes of the wheel of the engine for GPUs."""

ON_ADAPTERS = """
import numpy as np, phasestereo as ps, phasestereo_gpu
texture = np.random.default_rng(0).integers(0, 256, (60, 84), np.uint8)
pair = texture[:, :80], texture[:, 4:]
expected = ps.match(*pair, num_disparities=16)
adapters = [name for name, *_ in phasestereo_gpu.adapters()]
for device in ["auto", *adapters]:
    found = ps.match(*pair, num_disparities=16, device=device)
    assert found.findings == expected.findings, found.findings
    assert found.disparity.tobytes() == expected.disparity.tobytes(), device
print("it matches on:", *adapters)
"""
"""Matches on every adapter that this machine has."""

TOLERANCE = 0.5
"""Pixels: noise shows no fractions, and curves through its costs find some."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--url")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()

    if given.inside:
        check_installation(given.url)
    elif not given.files:
        parser.error("there is no file to try")

    for file in given.files:
        check_license(file)
        name = file.name.partition("-")[0]
        if name == "phasestereo" and file.suffix == ".whl":
            check_files(file)
        with tempfile.TemporaryDirectory() as folder:
            place = file.resolve(strict=True)
            if name == "phasestereo_gpu":
                try_gpu(Path(folder), place)
            elif name in ADDED:
                try_added(Path(folder), place, *ADDED[name])
            else:
                try_in(Path(folder), place, given.url)


def check_license(file: Path) -> None:
    """Check that an archive has the license; a wheel of the matcher those of its crates, too."""
    if file.suffix == ".whl":
        with zipfile.ZipFile(file) as packed:
            names = packed.namelist()
    else:
        with tarfile.open(file) as unpacked:
            names = unpacked.getnames()
    wanted = ["LICENSE"]
    if file.name.startswith(("phasestereo-", "phasestereo_gpu-")):
        wanted.append("LICENSES.txt")
    for part in wanted:
        require(any(name.endswith(f"/{part}") for name in names), f"{part}: {file.name} lacks it")


def install(folder: Path, *what: str) -> Path:
    """Install into an environment in an empty folder; return its Python."""
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    run([*pip, "--python", str(python), "install", *what], folder)
    return python


def try_added(folder: Path, file: Path, extras: str, commands: list[str]) -> None:
    """Install one of the distributions on top of the matcher, and start its commands."""
    python = install(folder, "--find-links", str(file.parent), f"{file}{extras}")
    for words in ["doctor", *commands]:
        # Isolated: neither the folder of this file nor PYTHONPATH is where modules are looked for.
        started = "import sys; from phasestereo.__main__ import main; sys.exit(main())"
        run([str(python), "-I", "-c", started, *words.split()], folder, subprocess.DEVNULL)
    print(f"{file.name}: installed with {extras}, and its commands start")  # noqa: T201


def try_gpu(folder: Path, file: Path) -> None:
    """Install the engine for GPUs beside the matcher, and match on what adapters there are."""
    megabytes = file.stat().st_size / 1e6
    require(megabytes <= GPU_SIZE, f"at most {GPU_SIZE} MB, and has {megabytes:.1f}")
    python = install(folder, "--find-links", str(file.parent), str(file))
    run([str(python), "-I", "-W", "error", "-c", ON_ADAPTERS], folder)
    print(f"{file.name}: {megabytes:.1f} MB, installed, and has the bits of the core")  # noqa: T201


def try_in(folder: Path, file: Path, url: str | None) -> None:
    """Install the matcher into an environment in an empty folder, and check it there."""
    python = install(folder, "--only-binary=numpy", "numpy", str(file))

    # Isolated: neither the folder of this file nor PYTHONPATH is where modules are looked for.
    inside = [str(python), "-I", "-W", "error", __file__, "--inside"]
    run([*inside, *(["--url", url] if url else [])], folder)
    print(f"{file.name}: installed, and matches a pair with NumPy alone")  # noqa: T201


def run(command: list[str], folder: Path, out: int | None = None) -> None:
    done = subprocess.run(command, cwd=folder, check=False, stdout=out)  # noqa: S603 -- our own
    if done.returncode:
        sys.exit(f"failed with {done.returncode}: {' '.join(command)}")


def check_files(wheel: Path) -> None:
    """Compare the files of a wheel with those of the package in the source tree."""
    with zipfile.ZipFile(wheel) as packed:
        names = {name for name in packed.namelist() if not name.endswith("/")}

    ours = {name for name in names if name.startswith("phasestereo/")}
    compiled = {name for name in ours if name.endswith((".so", ".pyd"))}
    package = ROOT / "python"
    there = {
        path.relative_to(package).as_posix()
        for path in (package / "phasestereo").rglob("*")
        if path.is_file() and path.suffix not in (".pyc", ".so", ".pyd", ".new")
    }

    require(len(compiled) == 1, f"one extension module, not {sorted(compiled)}")
    require(ours - compiled == there, f"the package's files, not {(ours - compiled) ^ there}")

    beside = {name.partition("/")[2] for name in names - ours}
    others = [name for name in names - ours if ".dist-info/" not in name]
    require(not others, f"nothing beside the package, not {others}")
    require(any(name.startswith("sboms/") for name in beside), f"an SBOM, not {sorted(beside)}")


def check_installation(url: str | None) -> None:
    """Check what is installed beside this Python: its metadata, its command, a match."""
    import numpy as np  # noqa: PLC0415 -- the Python that installs has none

    import phasestereo as ps  # noqa: PLC0415 -- as above

    names = {one.name for one in metadata.distributions()}
    require(names == {"numpy", "phasestereo"}, f"NumPy and nothing else, not {sorted(names)}")
    place = Path(ps.__file__).resolve()
    require(place.is_relative_to(Path(sys.prefix).resolve()), f"its own files, not {place}")
    check_page(metadata.metadata("phasestereo"), url)

    texture = np.random.default_rng(0).integers(0, 256, (60, 84), np.uint8)
    left, right = texture[:, :80], texture[:, SHIFT:]
    for preset in "robust", "fast", "paper":
        found = ps.match(left, right, preset=preset, num_disparities=16).disparity[:, 16:]
        far = np.abs(found - SHIFT).max()
        require(far < TOLERANCE, f"{SHIFT} px by {preset}, and is off by {far} px")

    command = Path(sys.executable).with_name("phasestereo")
    done = subprocess.run([command, "--version"], capture_output=True, text=True, check=False)  # noqa: S603
    asked = "pip install 'phasestereo[cli]'"
    require(done.returncode == 1 and asked in done.stderr, f"{asked}, not {done.stderr!r}")


def check_page(page: metadata.PackageMetadata, url: str | None) -> None:
    """Check what the page of the package shows."""
    require("Project-URL" in page, "addresses")
    description = page.get_payload()  # type: ignore[attr-defined] # it is a message
    links = re.findall(r"\]\(([^)]+)\)", description)
    require(len(links) > 10, f"links in its description, not {links}")
    if url is not None:
        dead = [link for link in links if not f"{link}/".startswith(f"{url}/")]
        require(not dead, f"links below {url}, not {dead}")
        require("make demo" not in description, "commands of pip alone on its page")


def require(held: bool, wanted: str) -> None:  # noqa: FBT001 -- as assert, which -O leaves out
    """End with a message unless something holds."""
    if not held:
        sys.exit(f"the package has to have {wanted}")


if __name__ == "__main__":
    main()

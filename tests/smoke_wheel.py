"""Try wheels and source distributions as their users will: installed, with NumPy alone.

python tests/smoke_wheel.py [--url URL] FILE...

makes an empty environment of this Python for each file, far from the source tree, installs the file
there and has it match a pair. With a URL, links of the package page have to start with it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import venv
import zipfile
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHIFT = 4
"""Pixels between the images of the pair."""

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
        if file.suffix == ".whl":
            check_files(file)
        with tempfile.TemporaryDirectory() as folder:
            try_in(Path(folder), file.resolve(strict=True), given.url)


def try_in(folder: Path, file: Path, url: str | None) -> None:
    """Install a file into an environment in an empty folder, and check it there."""
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    run(
        [*pip, "--python", str(python), "install", "--only-binary=numpy", "numpy", str(file)],
        folder,
    )

    # Isolated: neither the folder of this file nor PYTHONPATH is where modules are looked for.
    inside = [str(python), "-I", "-W", "error", __file__, "--inside"]
    run([*inside, *(["--url", url] if url else [])], folder)
    print(f"{file.name}: installed, and matches a pair with NumPy alone")  # noqa: T201


def run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, check=False)  # noqa: S603 -- our own commands
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
    for part in "licenses/LICENSE", "sboms/":
        require(any(name.startswith(part) for name in beside), f"{part}, and has {sorted(beside)}")


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
        require("make demo" in description.split("pip install", 1)[-1], "pip before make")


def require(held: bool, wanted: str) -> None:  # noqa: FBT001 -- as assert, which -O leaves out
    """End with a message unless something holds."""
    if not held:
        sys.exit(f"the package has to have {wanted}")


if __name__ == "__main__":
    main()

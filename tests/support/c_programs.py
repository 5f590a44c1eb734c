"""Programs in C that are compiled against the library, and what they write."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from support import ON_CI, ROOT

Image = NDArray[Any]


Pair = tuple[Image, Image]


SANITIZED = "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
"""The library is not compiled so, but what C's functions write for it is watched."""


LIBRARY = ROOT / "target" / "debug" / "libphasestereo.so"


INTERFACE = ROOT / "rust" / "c"


STRICT = "-Wall", "-Wextra", "-Wpedantic", "-Werror"


GRAY, RGB, RGBA, BGR, BGRA = range(5)


@dataclass(frozen=True)
class Program:
    """A compiled C program, and a folder for its files."""

    path: Path
    folder: Path

    def run(
        self,
        pair: Pair,
        *,
        preset: str = "fast",
        disparities: int = 48,
        channels: int = RGB,
        size: tuple[int, int] | None = None,
        stride: int | None = None,
        backward: bool = False,
    ) -> tuple[int, list[str], Path]:
        """Match images of memory: exit code, lines printed, file with the planes."""
        for name, image in zip(("left", "right"), pair, strict=True):
            (self.folder / name).write_bytes(image.tobytes())

        rows, cols = size or pair[0].shape[:2]

        row_bytes = stride or pair[0].nbytes // len(pair[0])
        bits = 8 * pair[0].itemsize
        output = self.folder / "planes"
        numbers = map(str, (cols, rows, channels, bits, row_bytes))

        command: list[str | Path] = [
            self.path,
            self.folder / "left",
            self.folder / "right",
            *numbers,
        ]
        command += [preset, str(disparities), output, *(["right"] if backward else [])]

        done = run(*command, check=False)
        return done.returncode, done.stdout.splitlines(), output

    def same(self, pair: Pair, expected: ps.Result, **options: Any) -> dict[str, list[str]]:
        """Compare with a map of Python's; return the printed lines, by their first word."""
        code, lines, output = self.run(pair, **options)
        assert code == 0, lines

        size = expected.disparity.shape
        for name, plane in planes_of(output, size).items():
            values = getattr(expected, name)
            np.testing.assert_array_equal(
                plane, np.full(size, np.nan) if values is None else values
            )

        return {line.split()[0]: line.split()[1:] for line in lines}


def planes_of(output: Path, size: tuple[int, ...]) -> dict[str, Image]:
    """Return the planes that the program wrote."""
    data, split = output.read_bytes(), 3 * 4 * size[0] * size[1]
    numbers = np.frombuffer(data[:split], np.float32).reshape(3, *size)
    found = dict(zip(("disparity", "confidence", "uncertainty"), numbers, strict=True))
    return found | {"flags": np.frombuffer(data[split:], np.uint16).reshape(size)}


def run(
    *command: str | Path, check: bool = True, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a compiler, or a program that it made."""
    done = subprocess.run(  # noqa: S603 - all commands are of this file
        command, capture_output=True, text=True, check=False, **options
    )
    if check and done.returncode != 0:
        pytest.fail(f"{command[0]}: {done.returncode}: {done.stdout[-500:]}{done.stderr[-1000:]}")
    return done


def needed(path: Path | str | None, message: str) -> str:
    """Return a program or file."""
    if path is None or not Path(path).exists():
        pytest.skip(message)
    return str(path)


@pytest.fixture(scope="module")
def library() -> str:
    return needed(LIBRARY, f"no {LIBRARY.relative_to(ROOT)}: make test")


@pytest.fixture(scope="module")
def program(library: str, tmp_path_factory: pytest.TempPathFactory) -> Program:
    assert library
    folder = tmp_path_factory.mktemp("c")
    return Program(_compiled("c_program", INTERFACE, folder), folder)


def _compiled(name: str, headers: Path, folder: Path) -> Path:
    """Compile a program of the tests, with sanitizers where the compiler has them."""
    compiler = needed(shutil.which("cc"), "no C compiler: apt-get install gcc")
    options = "-std=c99", "-D_DEFAULT_SOURCE", *STRICT, f"-I{headers}"
    sources = ROOT / "tests" / f"{name}.c", LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}"

    path = folder / name
    made = run(compiler, *options, *SANITIZED, *sources, "-o", path, check=False)
    if made.returncode != 0:
        if ON_CI:
            pytest.fail(made.stderr)
        run(compiler, *options, *sources, "-o", path)
    return path

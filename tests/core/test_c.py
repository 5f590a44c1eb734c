"""The C interface: programs made against its header get Python's maps, to the bit."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from conftest import ROOT, unavailable
from phasestereo.io import write_image
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair

Image = NDArray[Any]
Pair = tuple[Image, Image]
Change = Callable[[Image], Image]

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
        command += [preset, str(disparities), output]

        done = _run(*command, check=False)
        return done.returncode, done.stdout.splitlines(), output

    def same(self, pair: Pair, expected: ps.Result, **options: Any) -> dict[str, list[str]]:
        """Compare with a map of Python's; return what was printed, by its first word."""
        code, lines, output = self.run(pair, **options)
        assert code == 0, lines

        size = expected.disparity.shape
        data = output.read_bytes()
        split = 3 * 4 * expected.disparity.size
        planes = np.frombuffer(data[:split], np.float32).reshape(3, *size)
        flags = np.frombuffer(data[split:], np.uint16).reshape(size)
        np.testing.assert_array_equal(flags, expected.flags)

        wanted = expected.disparity, expected.confidence, expected.uncertainty
        for plane, values in zip(planes, wanted, strict=True):
            none = np.full(size, np.nan)
            np.testing.assert_array_equal(plane, none if values is None else values)

        return {line.split()[0]: line.split()[1:] for line in lines}


def _run(*command: str | Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a compiler, or a program that it made."""
    return subprocess.run(  # noqa: S603 - all commands are of this file
        command, capture_output=True, text=True, check=check
    )


def _needed(path: Path | str | None, message: str) -> str:
    """Return a program or file; without it, skip visibly, or fail where it must be there."""
    if path is None or not Path(path).exists():
        unavailable(message)
    return str(path)


@pytest.fixture(scope="module")
def library() -> str:
    return _needed(LIBRARY, f"no {LIBRARY.relative_to(ROOT)}: make test")


@pytest.fixture(scope="module")
def program(library: str, tmp_path_factory: pytest.TempPathFactory) -> Program:
    compiler = _needed(shutil.which("cc"), "no C compiler: apt-get install gcc")
    folder = tmp_path_factory.mktemp("c")
    path = folder / "program"

    source = ROOT / "tests" / "c_program.c"
    found = f"-Wl,-rpath,{LIBRARY.parent}"
    options = "-std=c99", *STRICT, f"-I{INTERFACE}"

    _run(compiler, *options, source, library, found, "-o", path)
    return Program(path, folder)


@pytest.fixture(scope="module")
def pair() -> Pair:
    rendered = render_pair(3, height=120, width=160, num_disparities=48)
    return Degradation(disk_psf(3.0), noise=1.0)(rendered.left), rendered.right


def test_the_header_is_one_of_c_and_of_cpp(tmp_path: Path) -> None:
    compiler = _needed(shutil.which("cc"), "no C compiler: apt-get install gcc")
    source = tmp_path / "header.c"
    source.write_text('#include "phasestereo.h"\n', encoding="utf-8")
    for language, standard in (("c", "c99"), ("c++", "c++11")):
        options = "-x", language, f"-std={standard}", *STRICT, f"-I{INTERFACE}", "-fsyntax-only"
        _run(compiler, *options, source)


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
def test_maps_are_those_of_python_to_the_bit(program: Program, pair: Pair, preset: str) -> None:
    expected = ps.match(*pair, preset=preset, num_disparities=48)
    said = program.same(pair, expected, preset=preset)
    assert (said["version"], said["threads"]) == ([ps.__version__], ["2"])
    assert int(said["memory"][0]) > pair[0].nbytes
    assert said["range"] == ["0", "48", "0"]


def test_what_is_found_is_what_python_finds(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair)
    said = program.same(pair, expected, preset="robust", disparities=0)
    search, blur, alignment = expected.search, expected.blur, expected.alignment

    assert search.origin == "found"
    assert said["range"] == [str(search.min_disparity), str(search.num_disparities), "1"]

    assert (blur.blur.side, blur.blur.kind) == ("left", "disk")
    assert said["blur"][:2] == ["1", "2"]
    assert [float(value) for value in said["blur"][2:]] == [blur.blur.size, blur.certainty]
    assert tuple(map(float, said["noise"])) == blur.noise

    assert float(said["rows"][0]) == alignment.coefficients[0]


def test_findings_are_those_of_python_word_for_word(program: Program, pair: Pair) -> None:
    left, right = pair
    dim = left // 3, right
    _, lines, _ = program.run(dim, preset="robust", disparities=0)

    for call, expected in (("matched", ps.match(*dim)), ("checked", ps.check(*dim))):
        said = [line.removeprefix(f"{call} ") for line in lines if line.startswith(f"{call} ")]
        assert said == [f"{one.topic}|{one.severity}|{one.sentence}" for one in expected.findings]
        assert any(line.startswith("contrast|") and "is darker" in line for line in said)


def test_settings_are_read_from_text(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair, num_disparities=48, median=0, min_confidence=0.25, lr_check=None)
    program.same(pair, expected, preset="settings")


def _changed(pair: Pair, change: Change) -> Pair:
    left, right = (np.ascontiguousarray(change(image)) for image in pair)
    return left, right


@pytest.mark.parametrize(
    ("channels", "order"),
    [(RGBA, [0, 1, 2, 0]), (BGR, [2, 1, 0]), (BGRA, [2, 1, 0, 0])],
    ids=["rgba", "bgr", "bgra"],
)
def test_channels_are_taken_in_any_order(
    program: Program, pair: Pair, channels: int, order: list[int]
) -> None:
    given = _changed(pair, lambda image: image[:, :, order])
    expected = ps.match(*pair, preset="fast", num_disparities=48)
    program.same(given, expected, channels=channels)


def test_gray_and_16_bits_are_those_of_python(program: Program, pair: Pair) -> None:
    gray = _changed(pair, lambda image: image[:, :, 1])
    wide = _changed(pair, lambda image: image.astype(np.uint16) * 257)
    for given, channels in ((gray, GRAY), (wide, RGB)):
        expected = ps.match(*given, preset="fast", num_disparities=48)
        program.same(given, expected, channels=channels)


def test_rows_lie_any_number_of_bytes_apart(program: Program, pair: Pair) -> None:
    expected = ps.match(*pair, preset="fast", num_disparities=48)
    upside_down = _changed(pair, lambda image: image[::-1])
    program.same(upside_down, expected, stride=-pair[0][0].nbytes)
    padded = _changed(pair, lambda image: np.pad(image, ((0, 0), (0, 7), (0, 0))))
    program.same(padded, expected, size=pair[0].shape[:2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"preset": "best"}, "preset: got 'best'; accepts 'robust', 'paper', 'fast'"),
        ({"disparities": 161}, "1 num_disparities: got 161; accepts an integer from 1 to 160"),
        ({"disparities": -1}, "1 num_disparities: got -1; accepts an integer from 1 to 160"),
        ({"channels": 9}, "1 left: got channels 9; accepts PHASESTEREO_GRAY to _BGRA"),
        ({"size": (0, 160)}, "1 left: got 0 x 160 pixels; accepts at least one pixel"),
    ],
)
def test_what_is_not_acceptable_is_reported(
    program: Program, pair: Pair, options: dict[str, Any], message: str
) -> None:
    code, lines, _ = program.run(pair, **options)
    assert code == 1
    assert lines[0].startswith(message)


def test_the_example_with_opencv_writes_a_map(library: str, pair: Pair, tmp_path: Path) -> None:
    assert library

    cmake = shutil.which("cmake")
    if cmake is None:
        pytest.skip("no cmake: apt-get install cmake")

    build, source = tmp_path / "build", INTERFACE / "example"
    configured = _run(cmake, "-S", source, "-B", build, check=False)
    if configured.returncode != 0:
        pytest.skip("no headers of OpenCV: apt-get install libopencv-dev")
    _run(cmake, "--build", build)

    for name, image in zip(("left", "right"), pair, strict=True):
        write_image(tmp_path / f"{name}.png", image)
    files = [tmp_path / name for name in ("left.png", "right.png", "map.tiff")]
    done = _run(build / "match", *files, "48")
    assert done.stdout == "disparities 0 to 47\n"

    written = pytest.importorskip("tifffile").imread(files[2])
    np.testing.assert_array_equal(written, ps.match(*pair, num_disparities=48).disparity)

"""The header for C++: a program of OpenCV with one line exchanged gets Python's map, to the bit."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo.io import read_image, write_image
from phasestereo.opencv import StereoPhase
from phasestereo_bench.rendering import render_pair
from support import ROOT, counterpart
from support.c_programs import INTERFACE, LIBRARY, STRICT, needed, run

HEADERS = Path("/usr/include/opencv4")
OPENCV = "SGBM> sgbm = StereoSGBM::create(0, 16, 3);"
OURS = "Phase> sgbm = phasestereo::StereoPhase::create(0, 16, 3);"
COUNT = 48

Image = NDArray[np.uint8]


@pytest.fixture(scope="module")
def pair() -> tuple[Image, Image]:
    rendered = render_pair(3, height=150, width=220, num_disparities=COUNT)
    return rendered.left, rendered.right


def compiled(source: str | Path, folder: Path, *libraries: str) -> Path:
    """Compile a program of the tests against OpenCV."""
    compiler = needed(shutil.which("c++"), "no C++ compiler: apt-get install g++")
    needed(HEADERS, "no headers of OpenCV: apt-get install libopencv-dev")
    needed(LIBRARY, f"no {LIBRARY.relative_to(ROOT)}: make test")
    program = folder / "program"
    run(
        compiler, "-std=c++11", "-fsanitize=undefined", "-fno-sanitize-recover=all", *STRICT,
        f"-I{INTERFACE}", "-isystem", HEADERS, source, LIBRARY, f"-Wl,-rpath,{LIBRARY.parent}",
        *(f"-lopencv_{name}" for name in ("core", *libraries)), "-o", program,
    )  # fmt: skip
    return program


def test_a_program_of_opencv_with_one_line_exchanged(
    pair: tuple[Image, Image], tmp_path: Path
) -> None:
    text = (ROOT / "tests/stereo_match.cpp").read_text("utf-8")
    assert text.count(f"Ptr<Stereo{OPENCV}") == 1
    source = tmp_path / "stereo_match.cpp"
    changed = text.replace(f"Ptr<Stereo{OPENCV}", f"Ptr<phasestereo::Stereo{OURS}")
    source.write_text(f"#include <phasestereo.hpp>\n{changed}", encoding="utf-8")
    for side, image in zip(("left", "right"), pair, strict=True):
        write_image(tmp_path / f"{side}.png", image)

    files = [tmp_path / name for name in ("left.png", "right.png", "map.tiff")]
    theirs = ROOT / "tests/stereo_match.cpp"
    for program, *libraries in ((theirs, "imgcodecs", "calib3d"), (source, "imgcodecs")):
        made = compiled(program, tmp_path, *libraries)
        assert run(made, *files, str(COUNT)).stdout == f"type 1, {COUNT} disparities\n"

    stereo = StereoPhase.create(
        0, COUNT, 5, 600, 2400, 1, 63, uniquenessRatio=10, speckleWindowSize=100, speckleRange=32
    )
    expected = stereo.compute(pair[0][:, :, ::-1], pair[1][:, :, ::-1])
    np.testing.assert_array_equal(read_image(tmp_path / "map.tiff") * 16, expected)


def test_what_python_saves_is_loaded_in_cpp_and_the_other_way_round(tmp_path: Path) -> None:
    cv2 = counterpart("cv2")
    stereo = StereoPhase.create(
        -2, 40, 7, uniquenessRatio=3, mode=2, preset="fast", fill=True, frequencies=(1, 1), median=3
    )
    stereo.save(str(tmp_path / "in.yml"))

    program = compiled(ROOT / "tests/stereo_phase.cpp", tmp_path)
    lines = run(program, tmp_path / "in.yml", tmp_path / "out.yml").stdout.splitlines()
    assert lines[:3] == ["-2 40 7 3 2", "middle 112", "same 1"]
    refusals = [
        "-211 numDisparities: got 0; accepts 1 to 4095",
        "-211 numDisparities: got 49; accepts 1 to 48, of which int16 holds sixteenths",
        "-5 preset: got 'best'; accepts 'robust', 'paper', 'fast'",
        "-5 window: a parameter of OpenCV sets it here",
        "-5 median: got 'x'; accepts",
        "-211 mode: got 4; accepts 0 to 3",
        "-209 right: got another size or type",
        "-210 left: got type 5; accepts CV_8U and CV_16U",
        "-5 num_disparities: got 200; accepts an integer from 1 to 120",
        "-212 file: got another object; accepts a StereoMatcher.Phase",
    ]
    for line, start in zip(lines[3:], refusals, strict=True):
        assert line.startswith(start)

    loaded = StereoPhase.create()
    storage = cv2.FileStorage(str(tmp_path / "out.yml"), cv2.FILE_STORAGE_READ)
    loaded.read(storage.getFirstTopLevelNode())
    stereo.setP1(9)
    assert sorted(re.findall(r"\w+=[^=]+(?=[,)])", repr(loaded))) == sorted(
        re.findall(r"\w+=[^=]+(?=[,)])", repr(stereo))
    )

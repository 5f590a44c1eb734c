"""Calibrations: parsed, checked, and turned into depth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from phasestereo.io import Calibration, read_calibration, read_disparity

if TYPE_CHECKING:
    from pathlib import Path

QUARTER = "middlebury/MiddEval3/trainingQ"

CALIBRATION = """\
cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]
cam1=[1000.5 0 330; 0 1000.5 200; 0 0 1]
doffs=30
baseline=200.25
width=640
height=480
ndisp=70
isint=0
vmin=7
vmax=65.5
dyavg=0.23
"""


def calibration(tmp_path: Path, text: str) -> Calibration:
    (tmp_path / "calib.txt").write_text(text, encoding="utf-8")
    return read_calibration(tmp_path / "calib.txt")


def test_calibration_is_parsed(tmp_path: Path) -> None:
    loaded = calibration(tmp_path, CALIBRATION)
    assert loaded == Calibration(
        cam0=((1000.5, 0, 300), (0, 1000.5, 200), (0, 0, 1)),
        cam1=((1000.5, 0, 330), (0, 1000.5, 200), (0, 0, 1)),
        doffs=30,
        baseline=200.25,
        width=640,
        height=480,
        ndisp=70,
        vmin=7,
        vmax=65.5,
    )
    assert loaded.focal == 1000.5
    assert len({loaded, calibration(tmp_path, CALIBRATION.replace("=", " = "))}) == 1
    short = calibration(tmp_path, "\n".join(CALIBRATION.splitlines()[:6]))
    assert short == replace(loaded, ndisp=None, vmin=None, vmax=None)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("doffs=30", "doffs 30", "line 3, 'doffs 30': expected name=value"),
        ("doffs=30", "=30", "line 3"),
        ("doffs=30", "doffs=thirty", "line 3"),
        ("doffs=30", "doffs=", "line 3"),
        ("width=640", "width=640.5", "line 5"),
        ("isint=0", "width=640", "line 8.*width is given twice"),
        ("cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]", "cam0=[1000.5 0 300]", "line 1.*3 rows"),
        ("cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]", "cam0=1000.5 0 300", "line 1.*matrix"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 zero 300;", "line 1"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 0;", "line 1.*3 numbers"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 nan 300;", "cam0 must be 3 x 3 finite"),
        ("cam0=[1000.5 0 300;", "cam0=[-1000.5 0 300;", "positive focal length"),
        ("cam1=", "cam9=", "no line gives cam1"),
        ("doffs=30", "doffs=nan", "doffs must be finite"),
        ("baseline=200.25", "baseline=0", "baseline must be positive"),
        ("baseline=200.25", "baseline=inf", "baseline must be positive and finite"),
        ("height=480", "height=-1", "height must be positive"),
        ("ndisp=70", "ndisp=0", "ndisp must be positive"),
    ],
)
def test_malformed_calibrations_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CALIBRATION
    with pytest.raises(ValueError, match=rf"calib\.txt: .*{message}"):
        calibration(tmp_path, CALIBRATION.replace(old, new))


def test_depth_is_the_formula_and_nan_where_there_is_none(tmp_path: Path) -> None:
    loaded = calibration(tmp_path, CALIBRATION)
    disparity = np.array([[0, 7.5, np.nan, np.inf], [-30, -31, -29.5, -np.inf]], np.float32)
    depth = loaded.depth(disparity)
    product = 200.25 * 1000.5
    expected = [
        [product / 30, product / 37.5, np.nan, np.nan],
        [np.nan, np.nan, 2 * product, np.nan],
    ]
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, expected, rtol=1e-6)
    assert loaded.depth(0).shape == ()
    with pytest.raises(TypeError, match="real numbers"):
        loaded.depth(np.array(["7"]))


def test_real_depth_lies_where_the_calibration_says(data: Path) -> None:
    scene = data / QUARTER / "Motorcycle"
    loaded = read_calibration(scene / "calib.txt")
    assert (loaded.width, loaded.height, loaded.ndisp) == (741, 497, 70)
    assert loaded.doffs == pytest.approx(loaded.cam1[0][2] - loaded.cam0[0][2], abs=1e-3)
    truth = read_disparity(scene / "disp0GT.pfm")
    depth = loaded.depth(truth)
    np.testing.assert_array_equal(np.isnan(depth), np.isnan(truth))
    assert 1900 < np.nanmin(depth) < np.nanmax(depth) < 5000  # mm: a motorcycle in a workshop

"""The page of a calibration: the coverage, the fit, and the possible accuracy of depths.

    write_calibration_page("calibration.html", live.calibrate("boards/", square=0.025))

One HTML file, without other files, a network or scripts: its pictures are SVG.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import check_type
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath
from phasestereo.views.templating import check_page_path, render_page
from phasestereo_live.calibration import StereoCalibration

__all__ = ["write_calibration_page"]

_NEAREST, _FARTHEST = 5, 400  # baselines: the range of the plot
_SAMPLES = 60
_WIDTH, _HEIGHT = 600, 300  # of the plot
_TICKS = (1, 2, 5)  # in each decade


def distances_of(calibration: StereoCalibration) -> list[float]:
    """Return the distances to report depth errors at: 1, 3 and 10 m, or times 15 baselines."""
    step = 1.0 if calibration.unit == "m" else 15 * calibration.baseline
    return [step, 3 * step, 10 * step]


def write_calibration_page(
    path: StrPath, calibration: StereoCalibration, *, title: str = "Calibration"
) -> None:
    """Write a page that shows a calibration: one HTML file, which needs no network.

    It has the next pictures to take, the cameras with standard deviations, the positions of corners
    in both images, the error of each view, and the error of depths over the distance.

    Parameters
    ----------
    path
        The file: ``.html`` or ``.htm``.
    calibration
        The calibration from `phasestereo_live.calibrate`.
    title
        Heading of the page.

    Raises
    ------
    TypeError
        If it is not a calibration.
    ValueError
        If the suffix is different.
    OSError
        If the file cannot be written.
    ImportError
        If the extra ``report`` is not installed.
    """
    check_page_path(path)
    check_type("calibration", calibration, StereoCalibration, "a StereoCalibration")

    depth = calibration.depth_error(distances_of(calibration))
    used = [view for view in calibration.views if view.used]
    sides = [(view.left for view in used), (view.right for view in used)]
    page = render_page(
        "calibration.html.j2",
        package="phasestereo_live.calibration",
        title=str(title),
        found=calibration,
        used=len(used),
        most=max(view.error for view in used),
        cameras=_camera_rows(calibration),
        depth=zip(*(part.tolist() for part in depth), strict=True),
        images=[
            _Image(name, cells, np.concatenate([*places]))
            for name, cells, places in zip(
                ("Left", "Right"), calibration.coverage, sides, strict=True
            )
        ],
        plot=_plot(calibration),
    )
    # Show names of files that are not UTF-8 as the terminal does.
    replace_text(path, page, errors="backslashreplace")


@dataclass(frozen=True, slots=True, eq=False)
class _Image:
    """The corners in one image: the number in each cell, and each position."""

    name: str
    cells: NDArray[np.int64]
    places: NDArray[np.float64]

    @property
    def filled(self) -> int:
        return int((self.cells > 0).sum())


def _camera_rows(found: StereoCalibration) -> list[tuple[str, str, str]]:
    """Return the name, value and standard deviation of the numbers that people ask for."""
    spread = found.deviations
    rows = [
        (f"{side} {what}", f"{matrix[at]:.2f} px", f"{spread[f'{name}{number}']:.2f}")
        for number, side, matrix in ((1, "left", found.K1), (2, "right", found.K2))
        for what, name, at in (
            ("focal length", "fx", (0, 0)),
            ("center, column", "cx", (0, 2)),
            ("center, row", "cy", (1, 2)),
        )
    ]
    rows.append(("baseline", f"{found.baseline:.5g} {found.unit}", f"{spread['baseline']:.2g}"))
    for name, angle in found.angles.items():
        rows.append((f"{name} of the right camera", f"{angle:.3f}°", f"{spread[name]:.3f}"))
    return rows


def _plot(found: StereoCalibration) -> dict[str, Any]:
    """Return the lines and ticks of the plot of errors over distances, both on log scales."""
    distances = np.geomspace(_NEAREST, _FARTHEST, _SAMPLES) * found.baseline
    errors = found.depth_error(distances)
    shown = {
        "total": errors.total,
        "disparity": errors.disparity,
        "calibration": errors.calibration,
    }
    ends = [np.log10(distances[[0, -1]])]
    every = np.concatenate([*shown.values()])
    ends.append(np.log10([every[every > 0].min(), every.max()]))

    def place(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        low, high = ends[axis]
        share = (np.log10(np.maximum(values, 1e-300)) - low) / (high - low)
        return _HEIGHT * (1 - share) if axis else _WIDTH * share

    lines = {
        name: " ".join(
            f"{x:.1f},{y:.1f}" for x, y in zip(place(distances, 0), place(line, 1), strict=True)
        )
        for name, line in shown.items()
    }
    ticks = []
    for axis in (0, 1):
        low, high = ends[axis]
        decades = range(int(np.floor(low)), int(np.ceil(high)) + 1)
        digits = (1,) if axis else _TICKS  # errors span many decades
        values = np.array([digit * 10.0**decade for decade in decades for digit in digits])
        values = values[(values >= 10**low) & (values <= 10**high)]
        ticks.append(
            [
                (float(at), f"{value:g}")
                for at, value in zip(place(values, axis), values, strict=True)
            ]
        )
    return {"lines": lines, "x": ticks[0], "y": ticks[1], "width": _WIDTH, "height": _HEIGHT}

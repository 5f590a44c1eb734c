"""``phasestereo calibrate``: takes pictures of a board, writes a calibration and rates it."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import phasestereo
from phasestereo._extras import require
from phasestereo.cli.errors import claim, refusals
from phasestereo.cli.options import as_word
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io.files import target_of
from phasestereo.io.pair import Layout
from phasestereo_live.calibration import StereoCalibration, calibrate as calibrate_pair
from phasestereo_live.calibration.page import distances_of, write_calibration_page

_METERS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_SUFFIXES = {"output": [".yaml", ".yml", ".xml"], "page": [".html", ".htm"]}
_OPTIONS = frozenset(["board", "square", "charuco", "marker", "layout"])


def _length(word: str) -> float:
    match = re.fullmatch(r"([0-9]*\.?[0-9]+)(mm|cm|m|in)", word)
    if match is None or not float(match[1]) > 0:
        raise ValueError
    return float(match[1]) * _METERS[match[2]]


_Length = Annotated[
    float | None, as_word(_length, "a length with its unit: 25mm, 2.5cm, 0.025m or 1in")
]


def calibrate(
    left: Path,
    right: Path | None = None,
    /,
    *,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    board: str | None = None,
    square: _Length = None,
    charuco: str | None = None,
    marker: _Length = None,
    layout: Layout | None = None,
    page: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
) -> None:
    """Calibrate two cameras from pictures or a video of a board.

    Prints how well the board's corners fit, how exact depths can be, and which picture to take
    next. Needs the extra ``rectify``. For example:

    ```
    phasestereo calibrate boards --board 9x6 --square 25mm -o calibration.yaml --page page.html
    phasestereo match left.png right.png --rectify calibration.yaml -o out.pfm --depth depth.npy
    ```

    Parameters
    ----------
    left
        A folder of pairs (in folders left and right, or with these names, or ..._L and ..._R), or a
        video of both views side by side; with RIGHT, the left camera's folder or video.
    right
        The right camera's folder or video.
    output
        File for the calibration in OpenCV's format: .yaml, .yml or .xml.
    board
        Inner corners of a chessboard, such as 9x6; for a ChArUco board, its squares. Without it,
        the command finds the size of a chessboard.
    square
        Side of a square with its unit: 25mm. Without it, lengths are in squares.
    charuco
        Dictionary of a ChArUco board's markers, such as DICT_5X5_100.
    marker
        Side of a marker. Default: three quarters of a square.
    layout
        How each picture, or the video, holds both views: side-by-side, or top-bottom.
    page
        File (.html) for a page that shows coverage, every view, and the error in depth. Needs the
        extra ``report``.
    as_json
        Print one JSON object on standard output.
    """
    files = claim([("output", output), ("page", page)], [left, right], _SUFFIXES)

    with refusals(options=_OPTIONS):
        for path in files:
            target_of(path)  # before reading all pictures
        if page is not None:
            require("jinja2", extra="report")
        found = calibrate_pair(
            left,
            right,
            board=board,
            square=square,
            charuco=charuco,
            marker=marker,
            layout=layout,
        )

    with refusals():
        if output is not None:
            found.save(output)
        if page is not None:
            write_calibration_page(page, found, title=f"Calibration by {left.name}")
    if as_json:
        print_json(_as_dict(found, files))
    else:
        print_lines([*_sentences(found), *(f"wrote {path}" for path in files)])


def _sentences(found: StereoCalibration) -> Iterator[str]:
    used = sum(view.used for view in found.views)
    yield f"{used} of {len(found.views)} pairs used, {found.board}"
    for view in found.views:
        if not view.used:
            yield f"left out: {view.reason}"

    held_out = "" if found.held_out is None else f" ({found.held_out:.2f} px in other views)"
    yield f"corners fit to {found.error:.2f} px, rows to {found.rows:.2f} px{held_out}"
    spread = found.deviations
    yield (
        f"focal length {found.K1[0, 0]:.1f} +- {spread['fx1']:.1f} px, baseline "
        f"{found.baseline:.4g} +- {spread['baseline']:.1g} {found.unit}, yaw "
        f"{found.angles['yaw']:.3f} +- {spread['yaw']:.3f} degrees"
    )
    errors = found.depth_error(distances_of(found))
    for distance, total, calibration in zip(
        errors.distance, errors.total, errors.calibration, strict=True
    ):
        yield (
            f"depth error at {distance:.3g} {found.unit}: {total:.2g} {found.unit}, "
            f"{calibration:.2g} of it by the calibration (disparities known to 0.25 px)"
        )
    yield from (f"next: {sentence}" for sentence in found.advice)


def _as_dict(found: StereoCalibration, files: Sequence[Path]) -> dict[str, Any]:
    errors = found.depth_error(distances_of(found))
    return {
        "version": phasestereo.__version__,
        "width": found.size[0],
        "height": found.size[1],
        "board": found.board,
        "unit": found.unit,
        **{name: getattr(found, name).tolist() for name in ("K1", "D1", "K2", "D2", "R", "T")},
        "error": found.error,
        "rows": found.rows,
        "held_out": found.held_out,
        "baseline": found.baseline,
        "angles": found.angles,
        "deviations": found.deviations,
        "depth_error": {name: part.tolist() for name, part in errors._asdict().items()},
        "views": [
            {
                "left": view.names[0],
                "right": view.names[1],
                "used": view.used,
                "reason": view.reason,
                "error": view.error if view.used else None,
                "rows": view.rows if view.used else None,
            }
            for view in found.views
        ],
        "coverage": [cells.tolist() for cells in found.coverage],
        "advice": list(found.advice),
        "files": [str(path) for path in files],
    }

"""Write calibrations of two cameras in other programs' formats."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from phasestereo._numbers import accept
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath
from phasestereo.io.rigs.cameras import Matrix

Form: TypeAlias = Literal["opencv", "camera_info", "kalibr"]
FORMS: tuple[Form, ...] = get_args(Form)


def written(
    path: StrPath, cameras: Mapping[str, Matrix], size: tuple[int, int], form: Form
) -> None:
    """Write cameras that are known except for their distance.

    Parameters
    ----------
    path
        The file; for "camera_info" the folder.
    cameras
        ``K1, D1, R1, P1, K2, D2, R2, P2`` by OpenCV's names.
    size
        Rows and columns of the images.
    form
        One of `FORMS`.

    Raises
    ------
    ValueError
        If the form is unknown.
    OSError
        If a file cannot be written.
    """
    accept("form", form, FORMS)

    # Rectified rays are R1 of the left camera and R2 of the right one; the right one is at +x.
    rotation = cameras["R2"].T @ cameras["R1"]
    translation = cameras["R2"].T @ [[-1.0], [0.0], [0.0]]
    if form == "opencv":
        intrinsics = {name: cameras[name] for name in ("K1", "D1", "K2", "D2")}
        _write(path, _opencv({**intrinsics, "R": rotation, "T": translation}, size))
    elif form == "kalibr":
        pose = np.vstack([np.hstack([rotation, translation]), [[0.0, 0.0, 0.0, 1.0]]])
        _write(path, _kalibr(cameras, size, pose))
    else:
        for number, side in ((1, "left"), (2, "right")):
            _write(Path(path) / f"{side}.yaml", _camera_info(cameras, size, number, side))


def _write(path: StrPath, lines: list[str]) -> None:
    replace_text(path, "\n".join(lines) + "\n")


def _numbers(matrix: Matrix) -> str:
    return "[" + ", ".join(repr(float(value)) for value in np.ravel(matrix)) + "]"


def _opencv(matrices: Mapping[str, Matrix], size: tuple[int, int]) -> list[str]:
    lines = ["%YAML:1.0", "---", f"image_width: {size[1]}", f"image_height: {size[0]}"]
    for name, matrix in matrices.items():
        rows, cols = matrix.shape if matrix.ndim == 2 else (1, matrix.size)
        lines += [
            f"{name}: !!opencv-matrix",
            f"   rows: {rows}",
            f"   cols: {cols}",
            "   dt: d",
            f"   data: {_numbers(matrix)}",
        ]
    return lines


def _camera_info(
    cameras: Mapping[str, Matrix], size: tuple[int, int], number: int, side: str
) -> list[str]:
    lines = [
        f"image_width: {size[1]}",
        f"image_height: {size[0]}",
        f"camera_name: {side}",
        "distortion_model: plumb_bob",
    ]
    distortion = np.append(cameras[f"D{number}"], 0.0)
    projection = cameras[f"P{number}"].copy()
    if number == 2:
        projection[0, 3] = -projection[0, 0]
    for name, matrix in (
        ("camera_matrix", cameras[f"K{number}"]),
        ("distortion_coefficients", distortion[np.newaxis]),
        ("rectification_matrix", cameras[f"R{number}"]),
        ("projection_matrix", projection),
    ):
        rows, cols = matrix.shape
        lines += [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: {_numbers(matrix)}"]
    return lines


def _kalibr(cameras: Mapping[str, Matrix], size: tuple[int, int], pose: Matrix) -> list[str]:
    lines = []
    for number in (1, 2):
        matrix = cameras[f"K{number}"]
        lines += [
            f"cam{number - 1}:",
            "  camera_model: pinhole",
            f"  intrinsics: {_numbers(matrix[[0, 1, 0, 1], [0, 1, 2, 2]])}",
            "  distortion_model: radtan",
            f"  distortion_coeffs: {_numbers(cameras[f'D{number}'])}",
            f"  resolution: [{size[1]}, {size[0]}]",
        ]
    rows = [f"  - {_numbers(row)}" for row in pose]
    return [*lines, "  T_cn_cnm1:", *rows]

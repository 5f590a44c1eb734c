"""Calibrations with each camera by itself: ROS's camera_info, EuRoC's, Kalibr's chains."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from phasestereo.io.depth import LengthUnit
from phasestereo.io.rigs.cameras import Cameras, Matrix
from phasestereo.io.rigs.documents import Document, numbers
from phasestereo.io.rigs.names import as_cameras, check_rotation

_PINHOLE = (
    "radtan", "radial-tangential", "plumb_bob", "rational_polynomial", "brown conrady", "none", "",
)  # fmt: skip
FISHEYE = "equi", "equidistant", "fisheye"
_LEAST_BASELINE = 0.001  # m: those of stereo endoscopes are 4 mm


def is_camera(document: Document) -> bool:
    """Return whether a file holds one camera, as ROS's and EuRoC's do."""
    return _is_euroc(document) or _is_ros(document)


def is_chain(document: Document) -> bool:
    """Return whether a file is a chain of Kalibr's: cameras named cam0, cam1 ..."""
    return all(isinstance(document.get(name), dict) for name in ("cam0", "cam1"))


def cameras_of_pair(left: Document, right: Document) -> Cameras:
    """Return the camera pair from one file for each camera.

    Raises
    ------
    ValueError
        If they are of different kinds, incomplete, or of a model unknown to OpenCV.
    """
    if _is_euroc(left) != _is_euroc(right):
        raise ValueError("one file is EuRoC's and one is ROS's; accepts two of a kind")
    if not _is_euroc(left):
        pair = joined([_of_ros(left), _of_ros(right)], {})
        _check_baseline(pair.matrices["P1"], pair.matrices["P2"])
        return pair

    left_pose, right_pose = (pose_of(document["T_BS"], "T_BS") for document in (left, right))
    return joined(
        [_of_intrinsics(left), _of_intrinsics(right)], moved(np.linalg.inv(right_pose) @ left_pose)
    )


def _check_baseline(left: Matrix, right: Matrix) -> None:
    """Refuse projections with a baseline that is not times the focal length, as in ROS.

    Raises
    ------
    ValueError
        If so: the baseline would be less than that of any stereo camera.
    """
    shift = np.abs(right[:2, 3] - left[:2, 3]).max()
    if 0 < shift / right[0, 0] < _LEAST_BASELINE:
        focal = right[0, 0]
        raise ValueError(
            f"P[3] is {right[0, 3]:g}, a baseline of {1000 * shift / focal:.2g} mm at a focal "
            f"length of {focal:g} px; accepts -f times the baseline in m, for {shift:g} m "
            f"{-shift * focal:g}"
        )


def cameras_of_chain(document: Document) -> Cameras:
    """Return the pair of the first two cameras of a chain of Kalibr's.

    Raises
    ------
    ValueError
        As `cameras_of_pair`.
    """
    left, right = document["cam0"], document["cam1"]

    if "T_cn_cnm1" in right:
        pose = pose_of(right["T_cn_cnm1"], "T_cn_cnm1")
    elif "T_cam_imu" in left and "T_cam_imu" in right:
        body = [pose_of(camera["T_cam_imu"], "T_cam_imu") for camera in (left, right)]
        pose = body[1] @ np.linalg.inv(body[0])
    else:
        raise ValueError("cam1 has neither T_cn_cnm1 nor T_cam_imu: where is it?")

    return joined([_of_intrinsics(left), _of_intrinsics(right)], moved(pose))


def _is_euroc(document: Document) -> bool:
    return "T_BS" in document and "intrinsics" in document


def _is_ros(document: Document) -> bool:
    recorded = all(name in document or name.lower() in document for name in "KDRP")
    return recorded or ("camera_matrix" in document and "projection_matrix" in document)


def _of_ros(document: Document) -> Document:
    """Return matrices of a camera_info, as its calibrator writes it or as it is recorded."""
    long = "camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"
    camera: Document = {}
    for short, name, shape in zip("KDRP", long, ((3, 3), None, (3, 3), (3, 4)), strict=True):
        value = next(
            (document[key] for key in (name, short, short.lower()) if key in document), None
        )
        if value is None:
            raise ValueError(f"has no {name}")
        matrix = numbers(value, name)
        # A recorded message has its matrices as flat lists.
        if shape is not None and matrix.size == shape[0] * shape[1]:
            matrix = matrix.reshape(shape)
        camera[short] = matrix.ravel() if short == "D" else matrix

    if not np.any(camera["K"]):
        raise ValueError("camera_matrix is 0, as of a camera that was never calibrated")
    # Drivers of rectified images leave P at 0 if they do not report the cameras' distance.
    if not np.any(camera["P"]) and not camera["D"].any():
        camera["P"] = np.column_stack([camera["K"], np.zeros(3)])
    # Drivers that send only rectified images leave R at 0.
    is_rectified = np.array_equal(camera["K"], camera["P"][:, :3]) and not camera["D"].any()
    if is_rectified and not np.any(camera["R"]):
        camera["R"] = np.eye(3)

    size = [document.get(f"image_{side}", document.get(side)) for side in ("width", "height")]
    model = document.get("distortion_model", "plumb_bob")
    return camera | {"size": _cut(camera, document, size), "model": model}


def _cut(camera: Document, document: Document, size: list[Any]) -> list[Any] | None:
    """Move K and P from the whole sensor to its region of interest, binned; return its size.

    As ROS's image_geometry does it.
    """
    window, binning = document.get("roi") or {}, np.ones(2, int)
    if window.get("width") and window.get("height"):
        size = [window["width"], window["height"]]
        for name in "KP":
            center = camera[name][:2, 2]
            center -= (window["x_offset"], window["y_offset"]) * (center != 0)
    for at, axis in enumerate("xy"):
        binning[at] = document.get(f"binning_{axis}") or 1
    for name in "KP":
        camera[name][:2] /= binning[:, np.newaxis]
    return None if None in size else [side // by for side, by in zip(size, binning, strict=True)]


def _of_intrinsics(document: Document) -> Document:
    """Return matrices of a camera as EuRoC and Kalibr write it."""
    if document.get("camera_model", "pinhole") != "pinhole":
        raise ValueError(f"camera_model: got {document['camera_model']}; accepts pinhole")

    focal = numbers(document.get("intrinsics"), "intrinsics").ravel()
    if focal.shape != (4,):
        raise ValueError(f"intrinsics: got {focal.size} numbers; accepts 4: fu, fv, cu, cv")

    fu, fv, cu, cv = focal
    name = next(
        (key for key in document if str(key).startswith("distortion_coef")), "distortion_coeffs"
    )
    return {
        "K": np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]),
        "D": numbers(document.get(name), name).ravel(),
        "size": document.get("resolution"),
        "model": document.get("distortion_model", "radtan"),
    }


def pose_of(value: Any, name: str) -> Matrix:
    """Return a pose, a rotation and a translation of 4 x 4 numbers.

    Raises
    ------
    ValueError
        If it is something else.
    """
    pose: Matrix = numbers(value, name)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or pose[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"{name}: accepts 4 x 4 numbers, a rotation and a translation")
    check_rotation(name, pose[:3, :3])
    return pose


def moved(pose: Matrix) -> Document:
    """Return R and T of a pose of 4 x 4."""
    return {"R": pose[:3, :3], "T": pose[:3, 3]}


def joined(cameras: list[Document], pair: Document, unit: LengthUnit | None = "m") -> Cameras:
    """Return the pair of two cameras of the same model.

    Parameters
    ----------
    cameras
        For each, its matrices by OpenCV's names without the side, its ``size`` and its ``model`` of
        distortion: "radtan" or "equidistant".
    pair
        ``R`` and ``T``, if known.
    unit
        The unit of ``T``.

    Raises
    ------
    ValueError
        If the cameras differ in model, only one has a size, or the model is different.
    """
    sizes = [as_size(camera.pop("size")) for camera in cameras]
    models = [str(camera.pop("model")).lower() for camera in cameras]

    for model in models:
        if model not in _PINHOLE + FISHEYE:
            known = "radtan, plumb_bob, rational_polynomial, equidistant"
            raise ValueError(f"distortion_model: got {model}; accepts {known}")

    if (None in sizes and any(sizes)) or (models[0] in FISHEYE) != (models[1] in FISHEYE):
        raise ValueError("the cameras differ in model, or one has no size; accepts two of a kind")

    both = {
        f"{name}{side}": value
        for side, camera in enumerate(cameras, start=1)
        for name, value in camera.items()
    }
    made = as_cameras(both | pair, size=sizes[0], fisheye=models[0] in FISHEYE, unit=unit)
    return made if sizes[0] == sizes[1] else replace(made, right_size=sizes[1])


def as_size(value: Any) -> tuple[int, int] | None:
    """Return columns and rows, if they are given.

    Raises
    ------
    ValueError
        If something else is given.
    """
    if value is None:
        return None

    size = numbers(value, "resolution").ravel()
    if size.shape != (2,) or not (size > 0).all() or (size % 1).any():
        raise ValueError("resolution: accepts two numbers, columns and rows")
    return int(size[0]), int(size[1])

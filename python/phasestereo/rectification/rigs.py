"""Calibrations that hold each camera by itself: ROS's camera_info, EuRoC's, Kalibr's chains."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasestereo.rectification.cameras import Cameras, Matrix
from phasestereo.rectification.documents import Document, numbers
from phasestereo.rectification.names import as_cameras, check_rotation

_PINHOLE = "radtan", "radial-tangential", "plumb_bob", "rational_polynomial", "none", ""
_FISHEYE = "equi", "equidistant", "fisheye"


def is_camera(document: Document) -> bool:
    """Return whether a file holds one camera, as ROS's and EuRoC's do."""
    return _is_euroc(document) or _is_ros(document)


def is_chain(document: Document) -> bool:
    """Return whether a file is a chain of Kalibr's: cameras named cam0, cam1 ..."""
    return all(isinstance(document.get(name), dict) for name in ("cam0", "cam1"))


def cameras_of_pair(left: Document, right: Document) -> Cameras:
    """Return the camera pair that a file for each of them holds.

    Raises
    ------
    ValueError
        If they are of different kinds, incomplete, or of a model that OpenCV does not have.
    """
    if _is_euroc(left) != _is_euroc(right):
        raise ValueError("one file is EuRoC's and one is ROS's; accepts two of a kind")
    if not _is_euroc(left):
        return _joined([_of_ros(left), _of_ros(right)], {})

    left_pose, right_pose = (_pose(document["T_BS"], "T_BS") for document in (left, right))
    return _joined(
        [_of_intrinsics(left), _of_intrinsics(right)], _moved(np.linalg.inv(right_pose) @ left_pose)
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
        pose = _pose(right["T_cn_cnm1"], "T_cn_cnm1")
    elif "T_cam_imu" in left and "T_cam_imu" in right:
        body = [_pose(camera["T_cam_imu"], "T_cam_imu") for camera in (left, right)]
        pose = body[1] @ np.linalg.inv(body[0])
    else:
        raise ValueError("cam1 has neither T_cn_cnm1 nor T_cam_imu: where is it?")

    return _joined([_of_intrinsics(left), _of_intrinsics(right)], _moved(pose))


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

    size = [document.get(f"image_{side}", document.get(side)) for side in ("width", "height")]
    model = document.get("distortion_model", "plumb_bob")
    return camera | {"size": None if None in size else size, "model": model}


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


def _pose(value: Any, name: str) -> Matrix:
    pose: Matrix = numbers(value, name)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or pose[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"{name}: accepts 4 x 4 numbers, a rotation and a translation")
    check_rotation(name, pose[:3, :3])
    return pose


def _moved(pose: Matrix) -> Document:
    return {"R": pose[:3, :3], "T": pose[:3, 3]}


def _joined(cameras: list[Document], pair: Document) -> Cameras:
    """Return the pair of two cameras of the same model and size."""
    sizes = [as_size(camera.pop("size")) for camera in cameras]
    models = [str(camera.pop("model")).lower() for camera in cameras]

    for model in models:
        if model not in _PINHOLE + _FISHEYE:
            known = "radtan, plumb_bob, rational_polynomial, equidistant"
            raise ValueError(f"distortion_model: got {model}; accepts {known}")

    if sizes[0] != sizes[1] or (models[0] in _FISHEYE) != (models[1] in _FISHEYE):
        raise ValueError("the cameras differ in size or model; accepts two of a kind")

    both = {
        f"{name}{side}": value
        for side, camera in enumerate(cameras, start=1)
        for name, value in camera.items()
    }
    return as_cameras(both | pair, size=sizes[0], fisheye=models[0] in _FISHEYE)


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

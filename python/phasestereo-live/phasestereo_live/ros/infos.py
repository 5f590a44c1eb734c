"""Read a pair of ``camera_info`` messages: whether and how to rectify, and the geometry."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from phasestereo.io.rigs.cameras import Cameras, Matrix, is_vertical, q_of
from phasestereo.io.rigs.singles import cameras_of_pair
from phasestereo.views.registering import ThirdCamera

_RECTIFIED = re.compile(r"(?<![a-z])rect(ified)?(?![a-z])")
_SAME = 1e-6  # relative: for matrices that were once written as text
_ROWS_OFF = 0.5  # px: if rows differ by more, images are not rectified


class RigGeometry(NamedTuple):
    """The cameras that rectify frames (None: already rectified), Q of rectified frames, notes."""

    cameras: Cameras | None
    q: Matrix | None
    notes: tuple[str, ...] = ()
    vertical: bool | None = None
    """Whether the right camera is below the left one; None: not known."""


def info_topics(topic: str) -> tuple[str, ...]:
    """Return the possible topics of ``camera_info`` beside an image topic: ROS's, RealSense's."""
    parent = topic.removesuffix("/compressed").rpartition("/")[0]
    return f"{parent}/camera_info", f"{parent.rpartition('/')[0]}/info/camera_info"


def geometry_of(
    left: Any,
    right: Any,
    topics: tuple[str, str],
    size: tuple[int, int] | None = None,
    baseline: tuple[float, float] | None = None,
) -> RigGeometry:
    """Return the calibration of the images on these topics, from both messages.

    Images count as rectified if the names of both topics say so (``image_rect``), or if rectifying
    would change nothing. Binning and regions of interest change the matrices as in ROS's
    image_geometry.

    Parameters
    ----------
    left, right
        The messages.
    topics
        The topics of the images.
    size
        Columns and rows of the images; None: those in the messages.
    baseline
        Distances of the right camera to the right of the left one and below it, m, from
        `baseline_of`; used if the messages do not give them.

    Raises
    ------
    ValueError
        If the cameras are not calibrated, differ in model, are not a pair, are calibrated for
        images of other proportions, or rectified images show different rows (different columns for
        cameras one above the other).
    """
    documents = [_document(message) for message in (left, right)]
    cameras = cameras_of_pair(*documents)
    cameras, notes = (cameras, ()) if size is None else cameras.at(size)
    notes = tuple(f"camera_info: {note}" for note in notes)

    p1, p2 = cameras.matrices["P1"], cameras.matrices["P2"]
    if baseline is not None and (p1[:2, 3] == p2[:2, 3]).all():
        p2 = p2.copy()
        p2[:2, 3] -= p2[[0, 1], [0, 1]] * baseline
        cameras = replace(cameras, matrices={**cameras.matrices, "P2": p2})

    vertical = is_vertical(p1, p2)
    lines, across = ("columns", 0) if vertical else ("rows", 1)
    off = abs(p1[across, 2] - p2[across, 2])
    if off > _ROWS_OFF:
        raise ValueError(
            f"camera_info: {lines} of rectified images are {off:g} px apart by P and the regions "
            f"of interest; accepts images of the same {lines}"
        )
    named = all(_RECTIFIED.search(topic) for topic in topics)
    is_straight = all(_is_straight(cameras.matrices, side) for side in "12")
    q = q_of(p1, p2)
    raw = None if named or is_straight else cameras
    return RigGeometry(raw, q, notes, None if q is None else vertical)


def third_camera(message: Any, left: Any, pose: Matrix) -> ThirdCamera:
    """Return the camera of a ``camera_info`` with raw images.

    Parameters
    ----------
    message
        Its message.
    left
        The message of the left camera, which R rectifies.
    pose
        (4, 4), pose of its frame in the frame of the left camera, m.

    Raises
    ------
    ValueError
        If it is not calibrated, or of an unknown model.
    """
    document = _document(message)
    both = cameras_of_pair(document, document)
    width, height = both.size or (0, 0)
    rotation = pose[:3, :3].T
    turned = _document(left)["R"].reshape(3, 3)
    rectified = turned if turned.any() else np.eye(3)  # RealSense's recordings have zeros
    return ThirdCamera(
        matrix=both.matrices["K1"],
        distortion=both.matrices["D1"],
        rotation=rotation @ rectified.T,
        translation=-rotation @ pose[:3, 3],
        width=width,
        height=height,
        fisheye=both.fisheye,
        unit="m",
    )


def _document(message: Any) -> dict[str, Any]:
    """Return a message in the calibration reader's form; ROS 1 has names in capital letters."""
    names = "width", "height", "distortion_model", "binning_x", "binning_y"
    fields: dict[str, Any] = {name: getattr(message, name, None) for name in names}
    for name in "KDRP":
        fields[name] = np.array(
            getattr(message, name, getattr(message, name.lower(), ())), np.float64
        )
    roi = getattr(message, "roi", None)
    sides = "x_offset", "y_offset", "width", "height"
    return fields | {"roi": roi and {side: getattr(roi, side) for side in sides}}


def _is_straight(matrices: Any, side: str) -> bool:
    """Return whether rectifying images of a camera leaves them unchanged."""
    camera, rotation = matrices[f"K{side}"], matrices[f"R{side}"]
    projection = matrices[f"P{side}"][:, :3]

    close = np.allclose(camera, projection, rtol=_SAME, atol=_SAME)
    is_turned = not np.allclose(rotation, np.eye(3), atol=_SAME)
    return bool(close and not is_turned and not matrices[f"D{side}"].any())

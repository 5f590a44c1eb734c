"""What a pair of ``camera_info`` messages says: whether and how to rectify, and the geometry."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np

from phasestereo.rectification.cameras import Cameras, Matrix, is_vertical, q_of
from phasestereo.rectification.rigs import cameras_of_pair

_RECTIFIED = re.compile(r"(?<![a-z])rect(ified)?(?![a-z])")
_SAME = 1e-6  # relative: matrices that have been through text


class RigGeometry(NamedTuple):
    """The cameras that rectify frames (None: they are rectified), and Q of rectified ones."""

    cameras: Cameras | None
    q: Matrix | None


def info_topic(topic: str) -> str:
    """Return where the ``camera_info`` of an image topic is, by ROS's convention: beside it."""
    parent = topic.removesuffix("/compressed").rpartition("/")[0]
    return f"{parent}/camera_info"


def geometry_of(left: Any, right: Any, topics: tuple[str, str]) -> RigGeometry:
    """Return what both messages say of images of these topics.

    Images are rectified already where the names of both topics say so (``image_rect``), or where
    rectifying would change nothing.

    Raises
    ------
    ValueError
        If the cameras are not calibrated, differ in size or model, or are no pair.
    """
    documents = [_document(message) for message in (left, right)]
    cameras = cameras_of_pair(*documents)

    p1, p2 = (np.asarray(document["P"]).reshape(3, 4) for document in documents)
    if not (p1[0, 0] > 0 and p2[0, 0] > 0):
        raise ValueError("camera_info: P is 0, as of cameras that were not calibrated as a pair")

    if is_vertical(p1, p2):
        raise ValueError(
            "camera_info: got cameras one above the other; accepts cameras side by side"
        )
    q = q_of(p1, p2)
    named = all(_RECTIFIED.search(topic) for topic in topics)
    return RigGeometry(None if named or all(map(_is_straight, documents)) else cameras, q)


def _document(message: Any) -> dict[str, Any]:
    """Return a message as the reader of calibrations takes it; ROS 1 has capital letters."""
    fields: dict[str, Any] = {
        name: np.asarray(getattr(message, name, getattr(message, name.lower(), ())), np.float64)
        for name in "KDRP"
    }

    # A camera without distortion may leave D out.
    if not fields["D"].size:
        fields["D"] = np.zeros(5)

    return fields | {
        "width": message.width,
        "height": message.height,
        "distortion_model": message.distortion_model,
    }


def _is_straight(document: dict[str, Any]) -> bool:
    """Return whether rectifying images of a camera leaves them as they are."""
    camera, rotation = document["K"].reshape(3, 3), document["R"].reshape(3, 3)
    projection = document["P"].reshape(3, 4)[:, :3]

    close = np.allclose(camera, projection, rtol=_SAME, atol=_SAME)
    return bool(close and np.allclose(rotation, np.eye(3), atol=_SAME) and not document["D"].any())

"""Write maps, depths and points of each frame to a recording, and a diagnosis each second."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import Any, Literal, get_args

from phasestereo._numbers import accept
from phasestereo.io import Calibration
from phasestereo.rig.diagnosis import check
from phasestereo.views.depths import Selection
from phasestereo.views.registering import ThirdCamera
from phasestereo_live.ros.bags import RecordingWriter
from phasestereo_live.ros.messages import (
    DEPTHS,
    MAP_IMAGES,
    camera_info,
    diagnostics,
    disparity_image,
    image_of,
    in_space,
    registered,
)
from phasestereo_live.ros.pairing import Header
from phasestereo_live.video.streaming import Frame

MessageKind = Literal["disparity", "confidence", "uncertainty", "depth", "points", "diagnostics"]
KINDS: tuple[MessageKind, ...] = get_args(MessageKind)
GEOMETRIC: tuple[MessageKind, ...] = ("depth", "points")
"""Kinds that need the geometry of the cameras."""

_SECOND = 10**9  # ns


class FrameWriter:
    """Writes the messages of frames to a recording.

    It uses the topics of ``stereo_image_proc``, in the namespace that both image topics share:
    ``disparity``, ``depth``, ``points2``, with the ``camera_info`` of all; and ``/diagnostics``. No
    ROS message has a place for confidences or error bars, so they are images (32FC1) on the topics
    ``confidence`` and ``uncertainty``, with the header of the disparities.

    Parameters
    ----------
    writer
        The recording.
    topics
        The topics of the left and the right images.
    kinds
        Messages to write, from `KINDS`. A result without confidences yields no messages with
        confidences or error bars.
    depth_encoding
        "32FC1", m, or "16UC1", mm.
    selection
        The pixels that get depths and points, in m; with ``decimate`` these are under
        ``decimated``, with a ``camera_info`` of their size. None: the trusted ones.
    third
        A third camera and the frame of its images: the kind ``"depth"`` adds its ``depth``,
        ``near`` and ``far`` (the ends of the error bars), ``confidence`` and ``camera_info`` under
        ``registered``, NaN without a depth. None: no such camera.

    Raises
    ------
    ValueError
        If a kind or an encoding is unknown.
    """

    def __init__(
        self,
        writer: RecordingWriter,
        topics: tuple[str, str],
        *,
        kinds: Collection[MessageKind] = KINDS,
        depth_encoding: str = DEPTHS[0],
        selection: Selection | None = None,
        third: tuple[ThirdCamera, str] | None = None,
    ) -> None:
        for kind in kinds:
            accept("kinds", kind, KINDS)
        accept("depth_encoding", depth_encoding, DEPTHS)

        self._writer = writer
        self._kinds = kinds
        self._encoding = depth_encoding
        self._selection = selection
        self._third = third
        self._space = os.path.commonpath([f"/{topic.lstrip('/')}" for topic in topics]).rstrip("/")
        self._diagnosed: int | None = None  # the stamp of the last diagnosis

    def write(self, frame: Frame, header: Header, calibration: Calibration | None) -> None:
        """Write the messages of a frame.

        Parameters
        ----------
        frame
            The frame.
        header
            The header of its left image.
        calibration
            The geometry of the rectified pair, the baseline in m. None: unknown; it then writes
            neither depths nor points.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        make, result = self._writer.make, frame.result
        found = {}

        if calibration is not None and {*self._kinds} - {"points", "diagnostics"}:
            found["camera_info"] = camera_info(make, header, calibration)
        if "disparity" in self._kinds:
            found["disparity"] = disparity_image(make, header, result, calibration)

        for name in MAP_IMAGES:
            values = result.maps.get(name)
            if name in self._kinds and values is not None:
                found[name] = image_of(make, header, values)

        if calibration is not None and {*self._kinds} & {*GEOMETRIC}:
            found |= self._in_space(frame, header, calibration)

        for name, message in found.items():
            self._writer.write(f"{self._space}/{name}", header.stamp, message)

        if "diagnostics" in self._kinds and self._is_due(header.stamp):
            status = diagnostics(make, header, check(frame.left, frame.right, self_rectify=False))
            self._writer.write("/diagnostics", header.stamp, status)

    def _in_space(self, frame: Frame, header: Header, calibration: Calibration) -> dict[str, Any]:
        """Return depths and points."""
        make, result = self._writer.make, frame.result
        given: dict[str, Any] = {"encoding": self._encoding, "selection": self._selection}
        found = in_space(make, header, result, calibration, frame.left, kinds=self._kinds, **given)
        if "depth" in self._kinds and self._third is not None:
            camera, frame_id = self._third
            there = Header(header.stamp, frame_id)
            found |= registered(make, there, result, calibration, camera, **given)
        return found

    def _is_due(self, stamp: int) -> bool:
        """Return whether a second has passed, or time went back."""
        last = self._diagnosed
        due = last is None or not 0 <= stamp - last < _SECOND
        self._diagnosed = stamp if due else last
        return due

"""Log frames to rerun (https://rerun.io), which shows them live or replays them.

Needs the extra ``rerun``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo.io import Calibration
from phasestereo.io.depth import meters_in
from phasestereo.io.drafts import draft_of
from phasestereo.io.files import StrPath
from phasestereo.views.depths import YAW, Selection, depths_of, ranging
from phasestereo.views.triangulation import point_cloud
from phasestereo_live.video.streaming import Failure, Frame

__all__ = ["log_failure", "log_frame", "saving"]

_COLORS = "turbo"  # as in phasestereo.views.picture


def log_frame(
    frame: Frame,
    *,
    entity: str = "stereo",
    low: float | None = None,
    high: float | None = None,
    calibration: Calibration | None = None,
    selection: Selection | None = None,
    recording: Any = None,
) -> None:
    """Log a matched frame.

    On the timelines ``frame`` (its number) and ``time`` (seconds, if it has a time) this logs
    images at ``entity/left`` and ``entity/right``, and the disparities in pixels at
    ``entity/disparity``. With a calibration it also logs colored points at ``entity/points``, the
    left camera at ``entity/left`` (``Pinhole``) and its depths at ``entity/left/depth``, all in m.

    Parameters
    ----------
    frame
        A frame of `phasestereo_live.stream`.
    entity
        Path to log it under.
    low, high
        Disparities at the ends of the colors; None: those of each frame.
    calibration
        The geometry of the rig, for images of this size; if it has no unit, m.
    selection
        The pixels that get depths and points, in the unit of the baseline; None: the trusted ones.
    recording
        A ``rerun.RecordingStream``; None: the current one, as ``rerun.init`` makes it.

    Raises
    ------
    ValueError
        If the calibration is for images of another size, or only one of low and high is given.
    ImportError
        If rerun is not installed.
    """
    if (low is None) != (high is None):
        raise ValueError(f"low: got {low} and high {high}; accepts both or neither")

    rerun = require("rerun", extra="rerun")
    ends = None if low is None else (low, high)

    disparity = rerun.DepthImage(
        frame.result.disparity, meter=1.0, colormap=_COLORS, depth_range=ends
    )
    logged = {
        "left": rerun.Image(frame.left),
        "right": rerun.Image(frame.right),
        "disparity": disparity,
    }

    if calibration is not None:
        chosen = selection or Selection()
        logged |= _in_space(frame, calibration, meters_in(calibration.unit or "m"), chosen)
        # Cameras look along Z, with Y down.
        axes = rerun.ViewCoordinates.RIGHT_HAND_Y_DOWN
        rerun.log(entity, axes, static=True, recording=recording)
        camera = rerun.Pinhole(
            image_from_camera=np.array(calibration.cam0),
            resolution=[calibration.width, calibration.height],
            camera_xyz=rerun.ViewCoordinates.RDF,
        )
        rerun.log(f"{entity}/left", camera, static=True, recording=recording)

    _set_time(frame, recording)
    for name, shown in logged.items():
        rerun.log(f"{entity}/{name}", shown, recording=recording)


def _in_space(
    frame: Frame, calibration: Calibration, meters: float, selection: Selection
) -> dict[str, Any]:
    """Return points and depths in m, with 0, which rerun does not draw, for the others."""
    rerun = require("rerun", extra="rerun")
    cloud = point_cloud(frame.result, calibration, image=frame.left, **asdict(selection))
    bars = frame.result.uncertainty
    geometry = ranging(frame.result.disparity, calibration, uncertainty=bars, yaw=YAW, anchor=None)
    whole = replace(selection, decimate=1)  # a picture must have its camera's size
    depth = depths_of(frame.result, geometry, whole).depth * np.float32(meters)
    return {
        "points": rerun.Points3D(cloud.points * np.float32(meters), colors=cloud.colors),
        "left/depth": rerun.DepthImage(np.nan_to_num(depth), meter=1.0, colormap=_COLORS),
    }


def log_failure(failure: Failure, *, entity: str = "stereo", recording: Any = None) -> None:
    """Log a frame that failed, as a warning at ``entity/failures``; see `log_frame`."""
    rerun = require("rerun", extra="rerun")
    _set_time(failure, recording)
    message = rerun.TextLog(str(failure), level=rerun.TextLogLevel.WARN)
    rerun.log(f"{entity}/failures", message, recording=recording)


@contextmanager
def saving(path: StrPath) -> Iterator[Any]:
    """Record to a file during the block; the file appears at its end, also after an error.

    Parameters
    ----------
    path
        The file, .rrd; ``rerun FILE`` shows it.

    Yields
    ------
    rerun.RecordingStream
        The ``recording`` for `log_frame`.

    Raises
    ------
    OSError
        If its folder does not exist or is not writable, or the path is not a file.
    ValueError
        If it does not end in .rrd.
    ImportError
        If rerun is not installed.
    """
    rerun = require("rerun", extra="rerun")
    target, draft = draft_of(path, (".rrd",), "recording")
    recording = rerun.RecordingStream("phasestereo")

    recording.save(draft)

    try:
        yield recording
    finally:
        recording.flush()
        recording.disconnect()
        draft.replace(target)


def _set_time(moment: Frame | Failure, recording: Any) -> None:
    rerun = require("rerun", extra="rerun")
    rerun.set_time("frame", sequence=moment.index, recording=recording)
    if moment.time is not None:
        rerun.set_time("time", duration=moment.time, recording=recording)

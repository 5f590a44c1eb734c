"""Recordings of robots for ``phasestereo live``: the topics to read, the messages to write."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from phasestereo.cli.errors import wrong
from phasestereo.cli.options import NOT_NEGATIVE
from phasestereo.io import Calibration
from phasestereo.views.depths import Selection
from phasestereo_live.ros.bags import RecordingWriter, is_recording
from phasestereo_live.ros.messages import DEPTHS, Depths
from phasestereo_live.ros.output import GEOMETRIC, KINDS, FrameWriter, MessageKind
from phasestereo_live.ros.recordings import TOLERANCE, Recording, open_recording
from phasestereo_live.video.streaming import Frame

_SEVERAL = Parameter(consume_multiple=True, show_default=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """The topics of a recording that hold the pairs.

    Parameters
    ----------
    left
        Topic of the left images, if SOURCE is a recording: .mcap, .db3, a folder of rosbag2, or a
        .bag of ROS 1. Default: the only two topics that differ by "left" and "right". Needs the
        extra ``ros``, but not ROS.
    right
        Topic of the right images.
    camera_info
        Topics of both cameras' camera_info. Default: those beside the images, if there are any.
        Images on image_rect count as rectified; camera_info rectifies all others.
    register
        Topic of the camera_info of a third camera, such as a color camera: -o also gets depths in
        its frame, under registered. Its position comes from /tf_static.
    tolerance
        Largest difference in seconds between the stamps of a left and a right image. Default 0.01.
    """

    left: str | None = None
    right: str | None = None
    camera_info: tuple[str, str] | None = None
    register: str | None = None
    tolerance: Annotated[float | None, Parameter(validator=NOT_NEGATIVE)] = None

    def check(self, places: tuple[Any, ...]) -> Path | None:
        """Return the recording, if the source is one.

        Raises
        ------
        CommandError
            If topics have no effect or are missing.
        """
        path = None
        if len(places) == 1 and isinstance(places[0], str) and is_recording(places[0]):
            path = Path(places[0])

        for name in ("left", "right", "camera_info", "register", "tolerance"):
            if path is None and getattr(self, name) is not None:
                raise wrong(name, "has no effect without a recording (.mcap, .db3, .bag)")
        return path

    def open(self, path: Path) -> Recording:
        """Open a recording.

        Raises
        ------
        OSError, ValueError, ImportError
            As in `open_recording`.
        """
        return open_recording(
            path,
            self.left or "",
            self.right or "",
            camera_info=self.camera_info,
            register=self.register or "",
            tolerance=TOLERANCE if self.tolerance is None else self.tolerance,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Messages:
    """The messages to write to a recording.

    Parameters
    ----------
    messages
        Messages that -o gets for each frame: disparity, depth, points, and once a second
        diagnostics. Default: all but points, which take the most space. Depth and points need the
        geometry of the cameras.
    depth_encoding
        Encoding of the depths: 32FC1, m (the default), or 16UC1, mm.
    """

    messages: Annotated[tuple[MessageKind, ...], _SEVERAL] = ()
    depth_encoding: Depths | None = None

    def check(self, *, wanted: bool, known: bool) -> None:
        """Refuse options that have no effect or need a geometry that is not known.

        Raises
        ------
        CommandError
            If there is such an option.
        """
        for name in ("messages", "depth_encoding"):
            if getattr(self, name) and not wanted:
                raise wrong(name, "has no effect without -o of a recording")

        for kind in self.messages:
            if kind in GEOMETRIC and not known:
                raise wrong(
                    "messages", f"{kind} needs camera_info, or --rectify with a calibration"
                )

    def sink(
        self,
        recording: Recording,
        selection: Selection,
        known: Callable[[Frame], Calibration | None],
        messages: RecordingWriter,
    ) -> Callable[[Frame], None]:
        """Return a function that writes frames to another recording, with a geometry in m."""
        writer = FrameWriter(
            messages,
            recording.topics,
            kinds=self.messages or [kind for kind in KINDS if kind != "points"],
            depth_encoding=self.depth_encoding or DEPTHS[0],
            selection=selection,
            third=recording.third,
        )

        def write(frame: Frame) -> None:
            calibration = known(frame)
            meters = None if calibration is None else calibration.in_meters()
            writer.write(frame, recording.headers.pop(frame.index), meters)

        return write

"""Recordings of robots for ``phasestereo live``: which topics, and the messages that come out."""

# No `from __future__ import annotations`: the command line is made of these annotations.

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
    """The topics of a recording whose messages are the pairs.

    Parameters
    ----------
    left
        Topic of the left images, where SOURCE is a recording: .mcap, .db3, a folder of rosbag2, or
        a .bag of ROS 1. Default: the only two that "left" and "right" distinguish. Needs the extra
        ``ros``, and not ROS.
    right
        Topic of the right images.
    camera_info
        Topics of both cameras' camera_info. Default: those beside the images, if there are any;
        images on image_rect count as rectified, others are rectified by it.
    register
        Topic of the camera_info of a third camera, as of a color camera: -o gets depths in its
        frame, too, below registered. Where it is follows from /tf_static.
    tolerance
        By how many seconds the stamps of a left and a right image may differ. Default 0.01.
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
            If topics have no effect, or are missing.
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
            As `open_recording`.
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
    """The messages that go to a recording.

    Parameters
    ----------
    messages
        Messages that -o gets of each frame: disparity, depth, points, and once a second
        diagnostics. Default: all but points, which take the most room; depth and points need the
        geometry of the cameras.
    depth_encoding
        That of the depths: 32FC1, m (the default), or 16UC1, mm.
    """

    messages: Annotated[tuple[MessageKind, ...], _SEVERAL] = ()
    depth_encoding: Depths | None = None

    def check(self, *, wanted: bool, known: bool) -> None:
        """Refuse what has no effect, or needs a geometry that is not known.

        Raises
        ------
        CommandError
            If so.
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
        """Return a writer of frames to another recording, by a geometry in m."""
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

"""Write video files without losing finished pictures, even in a crash."""

from __future__ import annotations

import math
import os
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.drafts import draft_of
from phasestereo.io.files import StrPath
from phasestereo_live._closing import Closing

SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv")

_CLOCK = 60_000  # ticks per second: nearly the most that MPEG-4 Part 2 allows
_TICK = _CLOCK // 1000  # smallest step that all formats can hold
_CODECS = {  # the first available; constant quality, near lossless for the first kind
    "libx264": {"crf": "17", "preset": "veryfast", "tune": "zerolatency"},
    "mpeg4": {"b": "50M", "qmin": "2", "qmax": "4"},
}
# Complete pictures go to the disk at once. An MP4 grows in playable fragments, and becomes an
# ordinary file at the end.
_OPTIONS = {"flush_packets": "1"}
_FRAGMENTS = {"movflags": "hybrid_fragmented+frag_keyframe"}
_KEY_SECONDS = 1


class VideoWriter(Closing):
    """Writes pictures to a video file.

    Until you close it, pictures go to a file of the same name with ``.part`` before the suffix. If
    the process dies, you can play that file up to where it ends. Closing, also when an error ends
    the ``with`` block, completes the file and puts it in its place; without a single picture, it
    writes nothing, and an earlier file stays.

    Parameters
    ----------
    path
        The file: .mp4, .m4v, .mov or .mkv. H.264, or MPEG-4 Part 2 if PyAV has no encoder for it.
    rate
        Pictures per second, for pictures without a time.

    Raises
    ------
    OSError
        If the folder does not exist, or the path is not a file.
    ValueError
        If the suffix is unknown, or the rate is not positive.
    ImportError
        If PyAV is not installed.
    """

    def __init__(self, path: StrPath, *, rate: float = 25.0) -> None:
        require("av", extra="live")
        self._target, self._draft = draft_of(path, SUFFIXES, "video")
        if not 0 < rate < math.inf:
            raise ValueError(f"rate: got {rate}; accepts more than 0")

        self._rate = Fraction(rate).limit_denominator(1001)
        self._container: Any = None
        self._stream: Any = None
        self._size = (0, 0)

        self._start: float | None = None
        self._ticks = -_TICK
        self._closed = False

    def write(self, picture: NDArray[np.uint8], time: float | None = None) -> None:
        """Append a picture.

        Parameters
        ----------
        picture
            uint8 (H, W, 3), RGB; all of one size. Odd sides get one extra black row or column.
        time
            Display time in seconds; the first picture appears at 0. None: one after another at the
            rate.

        Raises
        ------
        TypeError, ValueError
            If it is not such a picture, or differs in size from the first; if the time is not
            finite, or the writer is closed.
        OSError
            If the file cannot be written.
        """
        if self._closed:
            raise ValueError(f"{self._target}: this video is closed; accepts no more pictures")
        _check(picture, time)

        rows, cols = picture.shape[:2]
        if self._container is None:
            self._open(rows, cols)

        if (rows, cols) != self._size:
            wanted = f"{self._size[1]} x {self._size[0]}"
            raise ValueError(f"picture: got {cols} x {rows} pixels; accepts {wanted}, as before")

        # The pixel format halves the colors, so sides must be even.
        even = np.pad(picture, ((0, rows % 2), (0, cols % 2), (0, 0)))
        frame = require("av", extra="live").VideoFrame.from_ndarray(even, format="rgb24")
        frame.pts, frame.time_base = self._next(time), Fraction(1, _CLOCK)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Complete the file and put it in its place."""
        self._closed = True
        container, self._container = self._container, None
        if container is None:
            return

        try:
            container.mux(self._stream.encode(None))
        finally:
            container.close()
            self._draft.replace(self._target)

    def _open(self, rows: int, cols: int) -> None:
        av = require("av", extra="live")
        codec = next(name for name in _CODECS if _can_encode(av, name))
        container = av.open(
            os.fspath(self._draft),
            "w",
            options=_OPTIONS | ({} if self._draft.suffix.lower() == ".mkv" else _FRAGMENTS),
        )

        stream = container.add_stream(codec, rate=self._rate, options=_CODECS[codec])
        stream.width, stream.height = cols + cols % 2, rows + rows % 2
        stream.pix_fmt = "yuv420p"  # every player can show it
        stream.codec_context.gop_size = max(1, round(_KEY_SECONDS * self._rate))
        stream.codec_context.time_base = stream.time_base = Fraction(1, _CLOCK)

        try:
            stream.codec_context.open()
        except BaseException:
            container.close()
            self._draft.unlink(missing_ok=True)
            raise

        self._container, self._stream, self._size = container, stream, (rows, cols)

    def _next(self, time: float | None) -> int:
        """Return the time of the next picture in ticks: later than the one before."""
        if time is None:
            ticks = self._ticks + round(_CLOCK / self._rate) if self._ticks >= 0 else 0
        else:
            self._start = time if self._start is None else self._start
            ticks = round((time - self._start) * _CLOCK)

        self._ticks = max(ticks, self._ticks + _TICK)
        return self._ticks


def _check(picture: NDArray[np.uint8], time: float | None) -> None:
    if not isinstance(picture, np.ndarray) or picture.dtype != np.uint8:
        got = getattr(picture, "dtype", type(picture).__name__)
        raise TypeError(f"picture: got {got}; accepts uint8")

    if picture.ndim != 3 or picture.shape[2] != 3 or not picture.size:
        raise ValueError(f"picture: got shape {picture.shape}; accepts (H, W, 3)")

    if time is not None and not math.isfinite(time):
        raise ValueError(f"time: got {time}; accepts finite numbers")


def _can_encode(av: Any, name: str) -> bool:
    try:
        av.Codec(name, "w")
    except ValueError:  # the codec does not exist
        return False
    return True

"""Decode video files and network streams with PyAV; damaged frames do not shift the count."""

from __future__ import annotations

import os
from collections.abc import Iterator
from fractions import Fraction
from heapq import heappop, heappush
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo.io.files import StrPath, open_regular
from phasestereo.io.limits import max_pixels
from phasestereo_live.video.capture import Capture, CaptureSource, Image, lost

_PATIENCE = 10.0  # seconds to wait for a network stream before giving up
_UNTIMED = "no picture came of it"


def open_video(path: StrPath) -> CaptureSource[Image]:
    """Open a video file, or a stream at an address such as ``rtsp://...``.

    Frames are uint8, or uint16 if the video has more than 8 bits, (H, W) if it is gray, else RGB
    (H, W, 3). They are turned upright if the file has an orientation. Frames with more pixels than
    `phasestereo.io.max_pixels` are lost, like damaged ones.

    Raises
    ------
    OSError
        If it cannot be opened.
    ValueError
        If it is not a video.
    ImportError
        If PyAV is not installed.
    """
    av = require("av", extra="live")
    name = os.fspath(path)
    # A frame of a few bytes may unpack to any size, and opening the video decodes one.
    bounded = {"max_pixels": str(min(max_pixels(), 2**31 - 1))}
    options = dict(bounded)
    if not is_address(name):
        open_regular(name).close()  # reports errors in the words of the system
        options["protocol_whitelist"] = "file"  # playlists may name addresses

    try:
        container = av.open(name, timeout=_PATIENCE, options=options)
    except av.error.FFmpegError as error:
        if isinstance(error, OSError) and not isinstance(error, ValueError):
            raise OSError(error.errno, error.strerror, name) from error
        raise ValueError(f"{name}: damaged, or no video ({error.strerror})") from error

    if not container.streams.video:
        container.close()
        raise ValueError(f"{name}: there is no video in this file")

    stream = container.streams.video[0]

    # By default decoders conceal damage, but we must not measure invented pixels.
    stream.codec_context.options = bounded | {"err_detect": "crccheck+explode"}

    rate = stream.average_rate or stream.guessed_rate
    return CaptureSource(
        captures=_Decoder(container, stream, rate).captures(),
        close=container.close,
        length=stream.frames or None,
        rate=float(rate) if rate else None,
        ahead=True,
    )


def is_address(name: str) -> bool:
    """Return whether a name is an address, not a file."""
    return "://" in name


class _Decoder:
    """Numbers the frames of a stream in display order.

    Each packet announces a frame and its display time. Decoders give frames in the order of these
    times. So when a frame comes, all frames announced for earlier times that have not come are
    lost, whether or not the decoder reported it.
    """

    def __init__(self, container: Any, stream: Any, rate: Fraction | None) -> None:
        self._container = container
        self._stream = stream
        self._rate = rate
        self._announced: list[int] = []  # a heap of times
        self._reasons: dict[int, str] = {}  # for each time, the reason for the lost frame
        self._index = 0

        # AVI has only a decoding order: if the display order differs, the times are made up.
        reordered = getattr(stream.codec_context, "has_b_frames", False)
        self._timed = not (container.format.name == "avi" and reordered)

    def captures(self) -> Iterator[Capture[Image]]:
        """Yield a capture for each frame."""
        failure = require("av", extra="live").error.FFmpegError
        broken = None
        try:
            for packet in self._container.demux(self._stream):
                yield from self._decoded(packet, failure)
        except failure as error:
            broken = error

        yield from self._missed(before=None)
        if broken is not None:
            yield self._lost(None, f"the video cannot be read any further ({broken.strerror})")

    def _decoded(self, packet: Any, failure: type[Exception]) -> Iterator[Capture[Image]]:
        # A packet with a time announces a frame; it may be lost, or come later.
        announced = self._timed and packet.pts is not None and not packet.is_discard
        if announced and packet.size:
            heappush(self._announced, packet.pts)

        try:
            frames = packet.decode()
        except failure as error:
            reason = f"damaged ({getattr(error, 'strerror', error)})"
            if announced:
                self._reasons[packet.pts] = reason
            else:
                yield self._lost(None, reason)
            return

        for frame in frames:
            if self._timed and frame.pts is not None:
                yield from self._missed(before=frame.pts)
                if self._announced and self._announced[0] == frame.pts:
                    heappop(self._announced)
            yield self._capture(frame)

    def _missed(self, *, before: int | None) -> Iterator[Capture[Image]]:
        """Yield the frames announced for times before this one that did not come."""
        while self._announced and (before is None or self._announced[0] < before):
            time = heappop(self._announced)
            yield self._lost(time, self._reasons.pop(time, _UNTIMED))

    def _capture(self, frame: Any) -> Capture[Image]:
        if frame.is_corrupt:
            return self._lost(frame.pts, self._reasons.pop(frame.pts, "damaged"))
        index, self._index = self._index, self._index + 1
        return Capture(index, self._time(frame.pts, index), lambda: _pixels(frame))

    def _lost(self, pts: int | None, reason: str) -> Capture[Image]:
        index, self._index = self._index, self._index + 1
        return lost(index, self._time(pts, index), ValueError(reason))

    def _time(self, pts: int | None, index: int) -> float | None:
        if self._timed and pts is not None:
            return float(pts * self._stream.time_base)
        return float(index / self._rate) if self._rate else None


def _pixels(frame: Any) -> Image:
    """Return the pixels of a frame upright, in their stored color format and bit depth."""
    deep = max(component.bits for component in frame.format.components) > 8
    if len(frame.format.components) == 1 and not frame.format.has_palette:
        form = "gray16le" if deep else "gray"
    else:
        form = "rgb48le" if deep else "rgb24"

    pixels: Image = frame.to_ndarray(format=form)
    return np.rot90(pixels, round(frame.rotation / 90))

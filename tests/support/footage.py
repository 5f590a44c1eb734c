"""Moving pairs and video files made of them, for the tests of videos."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import ndimage

from support import counterpart

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Image = NDArray[np.uint8]

av = counterpart("av")

ROWS, COLS = 64, 96
COUNT = 16
LOSSLESS: dict[str, Any] = {"codec": "ffv1", "pixels": "bgr0"}
INTRA: dict[str, Any] = {"codec": "mjpeg", "pixels": "yuvj444p", "options": {"q": "2"}}


def shift(index: int) -> int:
    """Return the disparity of all of a frame."""
    return 3 + index % 8


def pair(index: int, *, color: bool = True) -> tuple[Image, Image]:
    """Return a pair of the scene, which moves on and comes nearer."""
    noise = np.random.default_rng(0).normal(size=(ROWS, COLS + 64, 3))
    smooth = ndimage.gaussian_filter(noise, (0.8, 0.8, 0))
    scene = (128 + 150 * smooth).clip(0, 255).astype(np.uint8)
    left = scene[:, 2 * index : 2 * index + COLS]
    right = scene[:, 2 * index + shift(index) : 2 * index + shift(index) + COLS]
    return (left, right) if color else (left[:, :, 1], right[:, :, 1])


def side_by_side(count: int) -> list[Image]:
    """Return pictures of both views."""
    return [np.concatenate(pair(index), axis=1) for index in range(count)]


def film(
    path: Path,
    pictures: Iterable[NDArray[Any]],
    *,
    codec: str = "ffv1",
    pixels: str = "bgr0",
    options: dict[str, str] | None = None,
    times: Sequence[int] | None = None,
    form: str = "rgb24",
    turned: int = 0,
) -> Path:
    """Write a video of 20 pictures a second, or of pictures at given 20ths of a second."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=20, options=options or {})
        for index, picture in enumerate(pictures):
            if not index:
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt = pixels
                if turned:
                    if not hasattr(stream, "set_display_rotation"):
                        pytest.skip("this version of PyAV writes no rotations")
                    stream.set_display_rotation(turned)

            frame = av.VideoFrame.from_ndarray(picture, format=form)
            frame.pts = index if times is None else times[index]
            container.mux(stream.encode(frame))

        container.mux(stream.encode(None))

    return path


def damage(source: Path, path: Path, which: Collection[int]) -> Path:
    """Copy a video, with some of its packets spoilt."""
    with av.open(str(source)) as whole, av.open(str(path), "w") as spoilt:
        stream = whole.streams.video[0]
        copy: Any = spoilt.add_stream_from_template(stream)
        packets = (packet for packet in whole.demux(stream) if packet.size)

        for index, packet in enumerate(packets):
            data = bytearray(bytes(packet))
            if index in which:
                third = len(data) // 3
                data[third : 2 * third] = bytes(value ^ 0xFF for value in data[third : 2 * third])

            again = av.Packet(bytes(data))
            again.pts, again.dts, again.time_base = packet.pts, packet.dts, packet.time_base
            again.is_keyframe = packet.is_keyframe
            again.stream = copy
            spoilt.mux(again)

    return path

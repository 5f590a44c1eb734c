"""Open cameras with OpenCV: one for each view, or one that delivers both in each picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from time import monotonic, sleep
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo_live.video.capture import Capture, CaptureSource, Image, Pair, lost

PATIENCE = 5
"""Frames in a row that cameras may miss before they count as gone."""
_PAUSE = 0.5  # seconds before another try to open a camera that is gone


def open_camera(number: int, patience: int | None) -> CaptureSource[Image]:
    """Open one camera, whose pictures hold both views.

    Parameters
    ----------
    number
        Its number.
    patience
        Frames in a row that it may miss before it counts as gone; None: wait for it.

    Raises
    ------
    OSError
        If it cannot be opened.
    ImportError
        If OpenCV is not installed.
    """
    devices = _open([number])
    captures = _captures([number], devices, lambda images: images[0], patience)
    return _source(devices, captures)


def open_cameras(left: int, right: int, patience: int | None) -> CaptureSource[Pair]:
    """Open a camera for each view, and take frames from both as close in time as possible.

    Parameters
    ----------
    left, right
        Their numbers.
    patience
        As in `open_camera`.

    Raises
    ------
    OSError
        If one of them cannot be opened.
    ImportError
        If OpenCV is not installed.
    """
    devices = _open([left, right])
    captures = _captures([left, right], devices, lambda images: (images[0], images[1]), patience)
    return _source(devices, captures)


def _open(numbers: Sequence[int]) -> list[Any]:
    cv2 = require("cv2", extra="live")
    devices: list[Any] = []
    for number in numbers:
        device = cv2.VideoCapture(number)
        devices.append(device)

        if not device.isOpened():
            _release(devices)
            raise OSError(f"camera {number}: cannot be opened")

        device.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # waiting frames are old; not all drivers obey

    return devices


def _release(devices: Sequence[Any]) -> None:
    for device in devices:
        device.release()


def _source(devices: Sequence[Any], captures: Iterator[Capture[Any]]) -> CaptureSource[Any]:
    """Return a source that never reads ahead: a frame that waits for a match to end is old."""
    rate = devices[0].get(require("cv2", extra="live").CAP_PROP_FPS)
    return CaptureSource(
        captures=captures,
        close=lambda: _release(devices),
        rate=rate if rate > 0 else None,
    )


def _captures(
    numbers: Sequence[int],
    devices: Sequence[Any],
    arrange: Callable[[list[Image]], Any],
    patience: int | None,
) -> Iterator[Capture[Any]]:
    """Grab from all cameras, which is quick, before decoding any frame, which is slow."""
    start = monotonic()
    index = missed = 0
    while patience is None or missed < patience:
        grabbed: list[bool] = []
        times: list[float] = []
        # A grab takes hardly any time, so the views are close; decoding comes later.
        for device in devices:
            grabbed.append(device.grab())
            times.append(monotonic())

        time = times[-1] - start
        gone = [number for number, there in zip(numbers, grabbed, strict=True) if not there]

        if gone:
            missed += 1
            last = ", and is given up" if missed == patience else ""
            error = OSError(f"camera {gone[0]}: gave no frame{last}")
            yield lost(index, time, error)
            if patience is None and missed >= PATIENCE:
                _try_again(numbers, devices, gone)
        else:
            missed = 0
            apart = times[-1] - times[0] if len(times) > 1 else None
            yield Capture(index, time, lambda: arrange(_retrieved(numbers, devices)), apart)

        index += 1


def _try_again(numbers: Sequence[int], devices: Sequence[Any], gone: Sequence[int]) -> None:
    """Reopen, after a pause, cameras that no longer deliver."""
    sleep(_PAUSE)
    for number, device in zip(numbers, devices, strict=True):
        if number in gone:
            device.release()
            device.open(number)


def _retrieved(numbers: Sequence[int], devices: Sequence[Any]) -> list[Image]:
    images = []
    for number, device in zip(numbers, devices, strict=True):
        there, image = device.retrieve()
        if not there:
            raise OSError(f"camera {number}: gave a damaged frame")
        images.append(np.ascontiguousarray(image[:, :, ::-1]) if image.ndim == 3 else image)

    return images

"""Pack a frame for the page: its maps, its images, and the geometry of its points."""

from __future__ import annotations

import json

import numpy as np

from phasestereo._images import as_alike, as_rgb8
from phasestereo.io import Calibration
from phasestereo.views.depths import YAW, ranging
from phasestereo.views.page.scene import described
from phasestereo_live.video.streaming import Frame

_MOST = 1_000_000  # pixels: of larger frames, the page gets every n-th pixel of every n-th row
_MAPS = "disparity", "confidence", "uncertainty"


def packed(
    frame: Frame, calibration: Calibration | None, unit: str, ends: tuple[int, int]
) -> bytes:
    """Return the length of a head, the head, maps (float32), both images (RGBA), flags (uint16).

    Parameters
    ----------
    frame
        The frame.
    calibration
        Its geometry, if its size is that of the frame; None: a nominal geometry.
    unit
        The unit of the baseline.
    ends
        Disparities at the ends of the colors.
    """
    result = frame.result
    step = 1
    while result.disparity.size > _MOST * step**2:
        step += 1
    thin = slice(None, None, step), slice(None, None, step)

    scene = None
    if (
        calibration is not None
        and (calibration.height, calibration.width) == result.disparity.shape
    ):
        bars = result.uncertainty
        known = ranging(result.disparity, calibration, uncertainty=bars, yaw=YAW, anchor=None)
        scene = described(known, unit)

    maps = {name: one for name in _MAPS if (one := getattr(result, name)) is not None}
    rows, cols = result.disparity[thin].shape
    images = [
        np.dstack([as_rgb8(image[thin]), np.full((rows, cols), 255, np.uint8)])
        for image in as_alike(frame.left, frame.right)
    ]
    head = json.dumps(
        {
            "index": frame.index,
            "width": cols,
            "height": rows,
            "step": step,
            "ends": ends,
            "scene": scene,
            "maps": list(maps),
        },
        allow_nan=False,
    ).encode()
    head += b" " * (-len(head) % 4)  # four-byte numbers begin at multiples of four

    parts = [*(one[thin].astype("<f4") for one in maps.values()), *images]
    parts.append(result.flags[thin].astype("<u2"))
    return b"".join(
        [np.uint32(len(head)).astype("<u4").tobytes(), head, *(one.tobytes() for one in parts)]
    )

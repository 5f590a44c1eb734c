"""OpenCV's matchers, set for pairs of all kinds, with an estimate at every pixel.

Images are uint8, (H, W) or (H, W, 3); disparities follow the convention of this package. OpenCV
leaves out columns on the left, which other matchers are scored on, so both images are first
extended there by repeating their edge.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Map

Image: TypeAlias = NDArray[np.uint8]

BM: dict[str, Any] = {"blockSize": 9}


def _sgbm(block: int) -> dict[str, Any]:
    """Return the options of StereoSGBM; its penalties grow with the block, as OpenCV advises."""
    return {
        "blockSize": block,
        "P1 per channel": 8 * block**2,
        "P2 per channel": 32 * block**2,
        "disp12MaxDiff": -1,
        "uniquenessRatio": 0,
    }


SGBM, SGBM_3X3 = _sgbm(5), _sgbm(3)


def create_bm(num_disparities: int) -> Any:
    """Return a StereoBM for a number of disparities, a multiple of 16.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    """
    cv2 = require("cv2", extra="opencv")
    return cv2.StereoBM_create(numDisparities=num_disparities, **BM)


def create_sgbm(
    num_disparities: int, mode: str, *, channels: int, options: Mapping[str, Any] = SGBM
) -> Any:
    """Return a StereoSGBM for a number of disparities, a multiple of 16.

    Parameters
    ----------
    num_disparities
        The number.
    mode
        The name of the mode in `cv2`, such as "STEREO_SGBM_MODE_HH".
    channels
        Channels of its images; the penalties grow with them.
    options
        Its other options: `SGBM` or `SGBM_3X3`.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    """
    cv2 = require("cv2", extra="opencv")
    return cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=num_disparities,
        blockSize=options["blockSize"],
        P1=channels * options["P1 per channel"],
        P2=channels * options["P2 per channel"],
        disp12MaxDiff=options["disp12MaxDiff"],
        uniquenessRatio=options["uniquenessRatio"],
        mode=getattr(cv2, mode),
    )


def match_bm(left: Image, right: Image, num_disparities: int) -> Map:
    """Match the gray images with StereoBM, at its defaults except for the block.

    It also leaves out half a block on every side; the images are extended there, too.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    """
    cv2 = require("cv2", extra="opencv")
    count, margin = _sixteens(num_disparities), BM["blockSize"] // 2
    matcher = create_bm(count)

    gray = _gray(cv2, left, right)
    found = matcher.compute(*(_continued(image, count + margin, margin) for image in gray))
    return _disparities(found[margin:-margin, count + margin : -margin])


def match_sgbm(
    left: Image,
    right: Image,
    num_disparities: int,
    *,
    mode: str = "HH",
    options: Mapping[str, Any] = SGBM,
) -> Map:
    """Match with StereoSGBM, over eight directions by default.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    """
    images, count = _alike(left, right), _sixteens(num_disparities)
    channels = 1 if images[0].ndim == 2 else images[0].shape[2]
    full = f"STEREO_SGBM_MODE_{mode}"
    matcher = create_sgbm(count, full, channels=channels, options=options)
    found = matcher.compute(*(_continued(image, count, 0) for image in images))
    return _disparities(found[:, count:])


def match_by(matcher: Any, left: Image, right: Image, _num_disparities: int) -> Map:
    """Match with an OpenCV object, or a similar one, that has its own range.

    Parameters
    ----------
    matcher
        An object with ``compute(left, right)``: takes BGR, or gray if it is a StereoBM; returns
        int16 sixteenths of a pixel, less than ``16 * getMinDisparity()`` where missing, or floats
        in pixels.
    left, right
        uint8 (H, W) or (H, W, 3), RGB.

    Raises
    ------
    ImportError
        If it is a StereoBM or one image alone is gray, the other is colored, and OpenCV is not
        installed.
    """
    least = int(getattr(matcher, "getMinDisparity", lambda: 0)())
    count = int(getattr(matcher, "getNumDisparities", lambda: 0)())
    margin = max(least + count, 0)

    if "BM" in type(matcher).__name__ and "SGBM" not in type(matcher).__name__:
        images = _gray(require("cv2", extra="opencv"), left, right)
    else:
        images = [image if image.ndim == 2 else image[:, :, ::-1] for image in _alike(left, right)]

    answer = np.asarray(matcher.compute(*(_continued(image, margin, 0) for image in images)))
    found = answer[:, margin:]
    if found.dtype == np.int16:
        return _disparities(found, 16 * least)
    return found.astype(np.float32)


def _alike(left: Image, right: Image) -> list[Image]:
    """Return both images as they are, or in gray if one of them is: OpenCV refuses such pairs."""
    if left.ndim == right.ndim:
        return [left, right]
    return _gray(require("cv2", extra="opencv"), left, right)


def _gray(cv2: Any, *images: Image) -> list[Image]:
    return [
        image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY)
        for image in images
    ]


def _sixteens(num_disparities: int) -> int:
    """Return the next multiple of 16, the only numbers of disparities that OpenCV takes."""
    return -(-num_disparities // 16) * 16


def _continued(image: Image, left: int, others: int) -> Image:
    """Extend an image by repeating its edge, by the given numbers of pixels on its sides."""
    sides = ((others, others), (left, others), (0, 0))
    return np.pad(image, sides[: image.ndim], mode="edge")


def _disparities(sixteenths: NDArray[np.int16], least: int = 0) -> Map:
    return np.where(sixteenths < least, np.nan, sixteenths / 16).astype(np.float32)

"""From two raw images to two whose rows correspond: by a calibration, or by what they show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from phasestereo import _core
from phasestereo._images import ImageOrPath, Pixels
from phasestereo._numbers import accept, as_number
from phasestereo._opening import Fitted, opened_alike
from phasestereo.io.rigs.cameras import Cameras, Warp
from phasestereo.io.rigs.reading import CalibrationSource
from phasestereo.rectification.record import (
    INTERPOLATIONS,
    Interpolation,
    Method,
    Rectification,
    masks_of,
    read_calibration,
    warped,
)
from phasestereo.rig.diagnosis import check

_OFF = 1.0  # rows: more than a calibration that fits leaves


def rectify(
    left: ImageOrPath,
    right: ImageOrPath,
    calibration: CalibrationSource | Rectification | Cameras | None = None,
    *,
    alpha: float | None = None,
    interpolation: Interpolation | None = None,
    others: Iterable[tuple[ImageOrPath, ImageOrPath]] = (),
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
) -> Rectification:
    """Rectify a stereo pair, so that what both images show lies on the same row of both.

    Parameters
    ----------
    left, right
        Images as `phasestereo.match` takes them, of two sizes and types, too: the right one is
        brought to the size of the left one first.
    calibration
        One of these; None: how the cameras stand to each other is estimated from the images alone.

        - A file: OpenCV's YAML, XML or ``.npz`` with ``K1, D1, K2, D2, R, T`` or ``K1, D1, R1, P1,
          K2, D2, R2, P2``, or with maps for ``cv2.remap``, under any usual name
          (``cameraMatrix1``, ``M1``, ``mtxL`` ...); a camchain of Kalibr's; a saved rectification.
        - A pair of files (left, right): ROS's camera_info, EuRoC's ``sensor.yaml``; or two that
          complete each other, as ``intrinsics.yml`` and ``extrinsics.yml`` of OpenCV's sample.
        - A folder: of ``.npy`` files so named, or with a pair of files as ``left.yaml``,
          ``right.yaml`` or ``cam0/sensor.yaml``, ``cam1/sensor.yaml``.
        - A mapping of matrices by name.
        - A `Rectification` of the same cameras.
    alpha
        What of the images to keep, as ``cv2.stereoRectify`` has it: 0, only what is valid
        everywhere, to 1, all pixels. None: as the calibration has it, or OpenCV's default, -1. For
        calibrations.
    interpolation
        How images are read between their pixels: "linear", "cubic" or "lanczos" (8 x 8 pixels).
        None: linear with a calibration, which gives the bits that OpenCV's `remap` gives by
        default; lanczos without.
    others
        More pairs of the same cameras, whose left images are of the same size: without a
        calibration all of them together show more than one does.
    left_mask, right_mask
        bool (H, W), True = valid, of the images as they are given, each of its own size: rectified
        pixels that are read from others are False in the masks of the result. None: all but NaN,
        alpha 0 and no data.

    Returns
    -------
    Rectification
        The images, masks of what lies outside, the maps to use again, and Q where it is known.

    Raises
    ------
    TypeError, ValueError
        For images or a calibration that are none, or do not fit each other; ValueError also if the
        images alone do not show enough, which the message explains.
    OSError
        If a file cannot be read.
    ImportError
        If the extra ``rectify`` is not installed.

    Notes
    -----
    With a calibration the geometry is OpenCV's: ``stereoRectify``, ``initUndistortRectifyMap``,
    ``remap``. Without one, focal lengths, distortion, principal points and rotations are estimated
    together, so that the rows of what both images show correspond. The scale of the scene is
    unknown then, and little is known of the horizontal geometry: `Q` is None.

    Examples
    --------
    >>> rig = ps.rectify("left.png", "right.png", "calibration.yaml")
    >>> result = ps.match(rig.left, rig.right, left_mask=rig.left_mask, right_mask=rig.right_mask)
    >>> depth = rig.calibration.depth(result.disparity)
    """
    found = opened_alike((left, right), (left_mask, right_mask))
    size = found.pair[0].shape[1], found.pair[0].shape[0]

    _check_options(alpha, interpolation)

    if calibration is None:
        pairs = [found.pair, *(opened_alike(other).pair for other in others)]
        _check_pairs(pairs)
        matrices, error, sentences = _core.rectify_pairs(pairs)
        maps = Cameras(matrices=matrices).warp(size, None).maps
        made = _rectified(found, Warp(maps, None), "images", interpolation or "lanczos")
        return replace(made, error=error, sentences=tuple(sentences))

    cameras = read_calibration(calibration)
    if isinstance(cameras, Rectification):
        return _rectified_again(found, cameras, interpolation)
    warp = cameras.warp(size, alpha, found.right)
    made = _rectified(found, warp, "calibration", interpolation or "linear")
    made = _measured(replace(made, unit=cameras.unit))
    return replace(made, sentences=(*made.sentences, *warp.notes))


def _check_pairs(pairs: Sequence[tuple[Pixels, Pixels]]) -> None:
    """Refuse pairs of several sizes, and pixels that are not finite."""
    size = pairs[0][0].shape[:2]
    if any(pair[0].shape[:2] != size for pair in pairs):
        raise ValueError(f"others: got pairs of another size; accepts that of left, {size}")
    for pair in pairs:
        for image, side in zip(pair, ("left", "right"), strict=True):
            if not np.isfinite(image).all():
                raise ValueError(f"{side}: got NaN or infinite pixels; accepts finite ones")


def _check_options(alpha: float | None, interpolation: str | None) -> None:
    if alpha is not None and as_number("alpha", alpha) != -1:
        as_number("alpha", alpha, least=0, most=1)

    if interpolation is not None:
        accept("interpolation", interpolation, INTERPOLATIONS)


def _rectified(
    found: Fitted,
    warp: Warp,
    method: Method,
    interpolation: Interpolation,
) -> Rectification:
    left, right = warped(found.pair, warp.maps, interpolation)
    left_mask, right_mask = masks_of(warp.maps, found.pair[0].shape, found.masks)

    return Rectification(
        left=left,
        right=right,
        left_mask=left_mask,
        right_mask=right_mask,
        maps=warp.maps,
        Q=warp.q,
        method=method,
        interpolation=interpolation,
        error=None,
        sentences=(),
        vertical=warp.vertical,
    )


def _rectified_again(
    found: Fitted,
    known: Rectification,
    interpolation: Interpolation | None,
) -> Rectification:
    """Return another pair rectified as the one before it."""
    if known.maps[0][0].shape != (size := found.pair[0].shape[:2]):
        raise ValueError(
            f"calibration: got that of {known.maps[0][0].shape} pixels; accepts that of the "
            f"images' {size}"
        )

    way = interpolation or known.interpolation
    made = _rectified(found, Warp(known.maps, known.Q, known.vertical), known.method, way)
    return replace(made, error=known.error, sentences=known.sentences, unit=known.unit)


def _measured(made: Rectification) -> Rectification:
    """Return a rectification with what its images show of it: calibrations age."""
    if not all(np.isfinite(image).all() for image in (made.left, made.right)):
        return made  # where pixels are NaN, as masked ones may be, nothing is looked at

    turns = int(made.vertical)  # columns are to correspond where one camera is above the other
    images = np.rot90(made.left, turns), np.rot90(made.right, turns)
    found = check(*images, self_rectify=False).alignment
    lines = "columns" if made.vertical else "rows"
    if found is None:
        said = (
            f"these images do not show how {lines} correspond: they show too little in common, or "
            "the calibration is not of these cameras"
        )
        return replace(made, sentences=(said,))

    off = f"{found.rms:.2f} px rms, known to {found.error:.2f} px"
    if found.rms > max(_OFF, 4 * found.error):
        said = (
            f"{lines} do not correspond ({off}): the calibration is not of these cameras as "
            "they are, or the images are exchanged"
        )
    else:
        said = f"{lines} correspond as the calibration says ({off})"

    return replace(made, error=found.rms, sentences=(said,))

"""Turn two raw images into two with corresponding rows: by a calibration, or the images alone."""

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

_OFF = 1.0  # rows: more than a fitting calibration leaves


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
    """Rectify a stereo pair, so that a scene point lies on the same row of both images.

    Parameters
    ----------
    left, right
        Images as `phasestereo.match` takes them; sizes and types may differ: the right one is first
        resampled to the left one's size.
    calibration
        One of these; None: the relative pose of the cameras is estimated from the images alone.

        - A file: OpenCV's YAML, XML or ``.npz`` with ``K1, D1, K2, D2, R, T`` or ``K1, D1, R1, P1,
          K2, D2, R2, P2``, or with maps for ``cv2.remap``, under any usual name
          (``cameraMatrix1``, ``M1``, ``mtxL`` ...); a camchain of Kalibr's; a saved rectification.
        - A pair of files (left, right): ROS's camera_info, EuRoC's ``sensor.yaml``; or two that
          complete each other, as ``intrinsics.yml`` and ``extrinsics.yml`` of OpenCV's sample.
        - A folder: of ``.npy`` files with these names, or with a pair such as ``left.yaml``,
          ``right.yaml`` or ``cam0/sensor.yaml``, ``cam1/sensor.yaml``.
        - A mapping of matrices by name.
        - A `Rectification` of the same cameras.
    alpha
        How much of the images to keep, as in ``cv2.stereoRectify``: from 0, only pixels valid
        everywhere, to 1, all pixels. None: as the calibration has it, or OpenCV's default, -1. For
        calibrations with matrices only.
    interpolation
        The interpolation between pixels: "linear", "cubic" or "lanczos" (8 x 8 pixels). None:
        linear with a calibration, to the same bits as OpenCV's `remap` by default; lanczos without
        one.
    others
        More pairs of the same cameras, with left images of the same size: without a calibration,
        all of them together show more than one.
    left_mask, right_mask
        bool (H, W), True = valid, for the original images, each of its own size: rectified pixels
        read from invalid ones are False in the masks of the result. None: all are valid but NaN,
        alpha 0 and no data.

    Returns
    -------
    Rectification
        The images, masks of pixels outside the originals, the maps to use again, and Q if known.

    Raises
    ------
    TypeError, ValueError
        For images or a calibration that are invalid, or do not fit each other; ValueError also if
        the images alone do not show enough; the message explains this.
    OSError
        If a file cannot be read.
    ImportError
        If the extra ``rectify`` is not installed.

    Notes
    -----
    With a calibration the geometry is OpenCV's: ``stereoRectify``, ``initUndistortRectifyMap``,
    ``remap``. Without one, focal lengths, distortion, principal points and rotations are estimated
    together, so that rows correspond. Then the scale of the scene is unknown, and the horizontal
    geometry is nearly unknown, and `Q` stays None.

    Examples
    --------
    >>> rig = ps.rectify("left.png", "right.png", "calibration.yaml")
    >>> result = ps.match(rig.left, rig.right, left_mask=rig.left_mask, right_mask=rig.right_mask)
    >>> depth = rig.calibration.depth(result.disparity)
    """
    found = opened_alike((left, right), (left_mask, right_mask))
    size = found.pair[0].shape[1], found.pair[0].shape[0]

    _check_options(alpha, interpolation)

    cameras = None if calibration is None else read_calibration(calibration)
    if alpha is not None and (not isinstance(cameras, Cameras) or cameras.is_maps):
        raise ValueError(f"alpha: got {alpha}; accepts None without the matrices of a calibration")

    if cameras is None:
        pairs = [found.pair, *(opened_alike(other).pair for other in others)]
        _check_pairs(pairs)
        matrices, error, sentences = _core.rectify_pairs(pairs)
        maps = Cameras(matrices=matrices).warp(size, None).maps
        made = _rectified(found, Warp(maps, None), "images", interpolation or "lanczos")
        return replace(made, error=error, sentences=tuple(sentences))

    if isinstance(cameras, Rectification):
        return _rectified_again(found, cameras, interpolation)
    warp = cameras.warp(size, alpha, found.right)
    made = _rectified(found, warp, "calibration", interpolation or "linear")
    made = _measured(replace(made, unit=cameras.unit))
    return replace(made, sentences=(*made.sentences, *warp.notes))


def _check_pairs(pairs: Sequence[tuple[Pixels, Pixels]]) -> None:
    """Refuse pairs of different sizes, and non-finite pixels."""
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
    """Return another pair, rectified like the one before, and measured: cameras move."""
    if known.maps[0][0].shape != (size := found.pair[0].shape[:2]):
        raise ValueError(
            f"calibration: got that of {known.maps[0][0].shape} pixels; accepts that of the "
            f"images' {size}"
        )

    way = interpolation or known.interpolation
    made = _rectified(found, Warp(known.maps, known.Q, known.vertical), known.method, way)
    return _measured(replace(made, unit=known.unit))


def _measured(made: Rectification) -> Rectification:
    """Return a rectification with the row error measured on its images: calibrations age."""
    if not all(np.isfinite(image).all() for image in (made.left, made.right)):
        return made  # NaN pixels, which may be masked, are not examined

    turns = int(made.vertical)  # columns should correspond if one camera is above the other
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
    refuted = found.rms > max(_OFF, 4 * found.error)
    if refuted:
        said = (
            f"{lines} do not correspond ({off}): the calibration is not of these cameras as "
            "they are, or the images are exchanged"
        )
    else:
        said = f"{lines} correspond as the calibration says ({off})"

    return replace(made, error=found.rms, sentences=(said,), refuted=refuted)

"""Estimates of the blur, the noise and the contrast of a pair, without a match."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from phasestereo import _core
from phasestereo._core import LEAST_SIZE
from phasestereo._images import as_mask, opened_pair
from phasestereo.matching import match_silently
from phasestereo.rig.estimates import as_estimates
from phasestereo.rig.photometry import fractions, response
from phasestereo.rig.reduction import reduced, reduction
from phasestereo.settings import PRESETS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from phasestereo._images import ImageOrPath, Pixels
    from phasestereo.rig.blur import BlurEstimate
    from phasestereo.rig.estimates import Estimates

    Mask = NDArray[np.bool_]

_ROUGH_WIDTH = 256  # pixels: enough for areas that correspond within a few pixels


def estimate_blur(
    left: ImageOrPath,
    right: ImageOrPath,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    threads: int | None = None,
) -> BlurEstimate:
    """Estimate the relative blur of a rectified stereo pair, its gain and its noise.

    Parameters
    ----------
    left, right, left_mask, right_mask, threads
        As `phasestereo.match` takes them.
    num_disparities, min_disparity
        The disparities to search, as `phasestereo.match` takes them. None: they are found.

    Returns
    -------
    BlurEstimate
        "none", with certainty 0, for images below 64 x 64 pixels, or if nothing can be estimated.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`.

    Notes
    -----
    The pair is matched at a quarter of its size, where little is left of the blur, to find blocks
    of 64 x 64 pixels that show the same. To their power spectra the model

        blurred = gain * |H|^2 * (sharp - its noise) + noise

    is fitted for the responses H of Gaussians up to 8 px, disks and annuli up to 14 px and motions
    up to 31 px; the fewest kinds that explain all blocks are kept, and neighboring tiles agree
    unless the evidence says otherwise. Where no family explains the spectra well, the kernel is
    measured: by least squares between the images, one warped onto the other after a match at half
    their size.
    Only what the blur of the two images differs by is seen: if both are equally soft, it is none.
    """
    pair = opened_pair(left, right)
    size = pair[0].shape
    masks = as_mask(left_mask, size, "left_mask"), as_mask(right_mask, size, "right_mask")

    found = estimate_pair(pair, masks, (min_disparity, num_disparities), threads)
    # The preset asks for a blur, so there is one.
    return cast("BlurEstimate", found.blur)


def estimate_pair(
    pair: tuple[Pixels, Pixels],
    masks: tuple[Mask | None, Mask | None],
    search: tuple[int, int | None],
    threads: int | None,
) -> Estimates:
    """Estimate of checked images what the default preset does, and gain and gamma."""
    asked = PRESETS["robust"]
    estimated = _core.estimate_pair(pair, masks, search, asked, threads)
    found = as_estimates(estimated, asked, search, None)
    if found.blur is None:
        return found

    span = found.search.min_disparity, found.search.num_disparities
    gain, gamma = _response(pair, masks, span)
    return replace(found, blur=replace(found.blur, gain=gain, gamma=gamma))


def _response(
    pair: tuple[Pixels, Pixels], masks: tuple[Mask | None, Mask | None], search: tuple[int, int]
) -> tuple[float, float]:
    """Return gain and gamma, (1, 1) where the images are too small."""
    values, _ = _core.packed_pair((_unmasked(pair[0], masks[0]), _unmasked(pair[1], masks[1])))
    left, right, _ = fractions(*values)
    if min(left.shape) < LEAST_SIZE:
        return 1.0, 1.0

    # Small copies are matched: means over windows are compared, which bear errors of some pixels.
    factor = reduction(left.shape, _ROUGH_WIDTH)
    small = reduced(left, factor), reduced(right, factor)
    low, high = search[0] // factor, (search[0] + search[1] - 1) // factor + 1
    count = min(high - low + 1, small[0].shape[1])

    rough = match_silently(
        small,
        (None, None),
        (low, count),
        settings=PRESETS["fast"],
        threads=None,
        progress=None,
        given=(None, None),
    ).disparity

    rows, cols = (
        np.minimum(np.arange(length) // factor, tiles - 1)
        for length, tiles in zip(left.shape, rough.shape, strict=True)
    )
    disparity = factor * rough[np.ix_(rows, cols)]

    if masks[0] is not None:
        disparity[~masks[0]] = np.nan
    return response(left, right, disparity)


def _unmasked(image: Pixels, mask: Mask | None) -> Pixels:
    """Return an image with masked pixels, which may be NaN, replaced by a valid one."""
    if mask is None or mask.all():
        return image

    filled = image.copy()
    filled[~mask] = image[mask][0] if mask.any() else 0
    return filled

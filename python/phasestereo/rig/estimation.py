"""Estimates of the blur, the noise and the contrast of a pair, without a match."""

from __future__ import annotations

from typing import cast

from numpy.typing import ArrayLike

from phasestereo import _core
from phasestereo._images import ImageOrPath, Mask, Pixels
from phasestereo._opening import opened_valid
from phasestereo.rig.blur import BlurEstimate
from phasestereo.rig.estimates import Estimates
from phasestereo.settings import PRESETS


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
        The disparities to search, as `phasestereo.match` takes them. None: found in the images.

    Returns
    -------
    BlurEstimate
        "none", with certainty 0, for images below 64 x 64 pixels, or if estimation fails.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`.

    Notes
    -----
    The pair is matched at a quarter of its size, where little of the blur is left, to find blocks
    of 64 x 64 pixels that show the same. The model

        blurred = gain * |H|^2 * (sharp - its noise) + noise

    is fitted to their power spectra, with the responses H of Gaussians up to 8 px, disks and annuli
    up to 14 px and motions up to 31 px. The fewest kinds that explain all blocks are kept, and
    neighboring tiles agree unless the evidence contradicts it. Where no family explains the spectra
    well, the kernel is measured: by least squares between the images, one warped onto the other
    after a match at half their size. Only the relative blur is estimated: for equally soft images
    it is "none".

    Examples
    --------
    >>> estimate = ps.estimate_blur(left, right, num_disparities=64)
    >>> estimate.blur  # as <Blur: left, disk 2.96 px>
    """
    _, pair, masks = opened_valid((left, right), (left_mask, right_mask))

    found = estimate_pair(pair, masks, (min_disparity, num_disparities), threads)
    # The preset requests blur estimation, so there is an estimate.
    return cast("BlurEstimate", found.blur)


def estimate_pair(
    pair: tuple[Pixels, Pixels],
    masks: tuple[Mask | None, Mask | None],
    search: tuple[int, int | None],
    threads: int | None,
    *,
    self_rectify: bool = False,
) -> Estimates:
    """Estimate what the default preset does, for checked images; rectified first if requested."""
    settings = PRESETS["robust"]
    return _core.estimate_pair(pair, masks, search, settings, threads, self_rectify=self_rectify)

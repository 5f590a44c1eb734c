"""The stages of a match as separate functions, to inspect or to build on.

In the order of the data: `descriptor`, the phase codes of an image; `cost_volume`, the comparison
of codes; `aggregate`, costs summed over windows; `optimize`, the disparity of every pixel. `match`
itself never makes a volume.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import as_mask, as_numbers, as_pair, as_pixels
from phasestereo._numbers import as_integer
from phasestereo.known import Known, as_known
from phasestereo.settings import Settings, SettingsOverrides, resolve

LARGEST_PENALTY = 2**40

Unsigned = TypeVar("Unsigned", np.uint16, np.uint32)


def descriptor(
    image: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    noise: float | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.uint64]:
    """Describe every pixel by the quantized phases of its neighborhood's Fourier transform.

    Parameters
    ----------
    image
        As `match` takes it.
    mask
        bool (H, W), True = valid; the values of invalid pixels have no effect. None: all are valid.
    settings
        Settings to start from; None: the preset ``"paper"``. ``neighborhood``, ``taper``,
        ``frequencies``, ``power``, ``bits``, ``noise_threshold`` and ``sizes`` matter here.
    threads
        Number of threads; None: all processors of the process.
    noise
        Standard deviation of the noise of the image, in units of its pixels; for a color image, of
        its gray values. Needed with ``noise_threshold > 0``, ignored otherwise.
    **overrides
        Fields of `Settings` by name.

    Returns
    -------
    ndarray
        (H, W), the narrowest of uint16, uint32 and uint64 that holds a code. Components come in
        the order of eq. 3 (u = 0: v = 1..s; then u = 1..r: v = -s..s), the first in the lowest
        bits, 2^(b - 1) bits each: the level modulo 2^b in a Johnson code (0, 1, 3, 2 for b = 2), so
        that the number of bits in which two codes differ is the similarity measure of eq. 6.
        With ``noise_threshold > 0`` 4 bits each: whether the real part is clearly negative, the
        imaginary part too; whether the real part is clearly positive, the imaginary part too. With
        ``sizes=2`` the components (0, 1) and (1, 0) of the larger neighborhood, with the weak
        level if there is one, come first, then all of the smaller one, without it.

    Raises
    ------
    TypeError, ValueError
        As `match` does.

    Notes
    -----
    Pedone & Heikkilä 2008, eq. 3; arg in [-pi, pi), floor, F = 0 at level 0. The transform is
    computed in integers: its cosines are rounded to steps of about L / 1000, and those of one
    frequency sum to zero. Floats that are not integer multiples of one step are resolved in 4
    million steps of their range without 0.1 % at either end (in large images: of an even sample),
    and clamped four ranges beyond. A level may therefore differ from that of a floating-point
    component very near a boundary: in natural images, about one bit in a thousand differs.

    White noise of standard deviation s gives either part of every component the standard deviation
    s sqrt(sum(w^2) / 2), with the window w: s L / sqrt(2) for the uniform one. A part is clear if
    its magnitude exceeds ``noise_threshold`` times that (with ``power=2`` the square of it),
    rounded to a whole step of the integers.

    Examples
    --------
    >>> codes = ps.descriptor(image, neighborhood=7, frequencies=(2, 1), bits=2)
    """
    chosen = resolve("paper" if settings is None else None, settings, overrides)
    pixels = as_pixels(image, "image")
    return _core.descriptor(pixels, as_mask(mask, pixels.shape, "mask"), chosen, threads, noise)


def cost_volume(
    left: ArrayLike,
    right: ArrayLike,
    *,
    num_disparities: int,
    min_disparity: int = 0,
    settings: Settings | None = None,
    threads: int | None = None,
    known: Known | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> NDArray[np.uint16]:
    """Compare every pixel with every candidate.

    Parameters
    ----------
    left, right, num_disparities, min_disparity, threads, known
        As `match` takes them, `known` without ``before``.
    settings
        Settings to start from; None: the preset ``"paper"``. ``cost`` and its related settings
        matter here.
    **overrides
        Fields of `Settings` by name.

    Returns
    -------
    ndarray
        uint16 (H, W, num_disparities): the cost of left pixel (x, y) at disparity
        ``min_disparity + k``; candidates outside the right image are taken at its border column.
        Unit: bits for ``cost="phase"``, 1/16 gray level for ``"sad"`` (255 levels to the intensity
        range), 1/256 standard deviation for ``"nsad"``, 1/256 of a correlation for ``"zncc"``.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As `match` does.

    Examples
    --------
    >>> costs = ps.cost_volume(left, right, num_disparities=48)  # uint16 (H, W, 48), bits
    """
    chosen = resolve("paper" if settings is None else None, settings, overrides)
    disparities = min_disparity, num_disparities
    compensation = as_known(known).compensation
    return _core.cost_volume(as_pair(left, right), disparities, chosen, threads, compensation)


def aggregate(costs: ArrayLike, *, window: int = 9, shiftable: bool = True) -> NDArray[np.uint32]:
    """Aggregate a cost volume.

    Parameters
    ----------
    costs
        uint16 (H, W, D), as from `cost_volume`.
    window
        Side of the square window, odd, 1 to 63. Costs continue beyond the image by repeating its
        edge.
    shiftable
        Whether to take the least of five sums, centered on the pixel and half a window above,
        below, left and right of it, each center clamped into the image (Pedone & Heikkilä 2008,
        section 2.3); or only the centered one.

    Returns
    -------
    ndarray
        uint32 (H, W, D), sums: divide by ``window ** 2`` for the mean cost.

    Raises
    ------
    TypeError
        If the costs are not a uint16 array.
    ValueError
        If they are not 3-D, are empty, or the window is out of range.

    Examples
    --------
    >>> sums = ps.aggregate(costs, window=9)  # uint32 (H, W, 48)
    """
    volume = as_volume(costs, np.uint16)
    settings = replace(Settings.preset("paper"), window=window, shiftable=shiftable)
    return _core.aggregate_volume(volume, settings)


def optimize(
    costs: ArrayLike,
    *,
    p1: int,
    p2: int,
    optimizer: Literal["dp", "so", "wta", "sgm"] = "dp",
) -> NDArray[np.uint16]:
    """Choose a candidate for every pixel of a volume of aggregated costs.

    Parameters
    ----------
    costs
        uint32 (H, W, D), as from `aggregate`, up to 2^28.
    p1, p2
        Cost of a change of the index by one, and by more, along a path, in the unit of the costs:
        integers from 0 to 2^40. Values above 2^28 count as 2^28.
    optimizer
        ``"dp"``: dynamic programming along each row under the ordering constraint that from one
        pixel to the next an index may rise by at most one, for P1, or drop to any smaller one, for
        P2 (Pedone & Heikkilä 2008, section 2.3); ties go to the same index, then to the smaller
        one. ``"so"``: the least mean of the totals of two paths along the row, from the left and
        from the right; along each path the index stays, changes by one, for P1, or by more, for P2,
        which counts at least as P1. ``"sgm"``: the least mean of the totals of four such paths,
        from the left, the right, above and below (Hirschmüller, *Stereo Processing by Semiglobal
        Matching and Mutual Information*, PAMI 2008). ``"wta"``: the least cost of each pixel on its
        own. Ties go to the smallest index. Paths from the right begin 16 columns beyond each panel
        of 64 columns, those from above and below 16 rows outside each band of 64 rows.

    Returns
    -------
    ndarray
        uint16 (H, W), indices: add ``min_disparity`` for disparities.

    Raises
    ------
    TypeError
        If the costs are not a uint32 array, or P1 or P2 is not an integer.
    ValueError
        If the costs are not 3-D, are empty or exceed 2^28, P1 or P2 is out of range, or there is no
        such optimizer.

    Examples
    --------
    >>> disparity = ps.optimize(sums, optimizer="sgm", p1=100, p2=400)
    """
    volume = as_volume(costs, np.uint32)
    settings = replace(Settings.preset("paper"), optimizer=optimizer)
    near, far = (
        as_integer(name, value, least=0, most=LARGEST_PENALTY)
        for name, value in (("p1", p1), ("p2", p2))
    )

    return _core.optimize_volume(volume, settings, near, far)


def as_volume(costs: ArrayLike, dtype: type[Unsigned]) -> NDArray[Unsigned]:
    """Return a volume of costs of the given type as a contiguous array in native byte order."""
    volume = as_numbers(costs, "costs", (np.dtype(dtype).name,), ("H", "W", "D"))
    return np.require(volume, dtype, ["C", "ALIGNED"])

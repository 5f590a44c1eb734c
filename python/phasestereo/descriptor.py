"""The phase codes of an image, to look at or to build on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasestereo import _core
from phasestereo._images import as_mask, as_pixels
from phasestereo.settings import Settings, resolve

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def descriptor(
    image: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    noise: float | None = None,
    **overrides: Any,
) -> NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.uint64]:
    """Describe every pixel by the quantised phases of its neighbourhood's Fourier transform.

    Parameters
    ----------
    image
        As `match` takes them.
    mask
        bool (H, W), True = valid; what the other pixels hold has no effect. None: all are valid.
    settings
        Settings to start from; None: the preset ``"paper"``. ``neighborhood``, ``taper``,
        ``frequencies``, ``power``, ``bits``, ``noise_threshold`` and ``sizes`` matter here.
    threads
        Number of threads; None: as many as the process may use.
    noise
        Standard deviation of the noise of the image, in units of its pixels; of its gray values
        where it has colour. Needed with ``noise_threshold > 0``, else without effect.
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
        ``sizes=2`` the components (0, 1) and (1, 0) of the larger neighbourhood, with the weak
        level if there is one, come first, then all of the smaller one, without it.

    Raises
    ------
    TypeError, ValueError
        As `match` does.

    Notes
    -----
    Pedone & Heikkilä 2008, eq. 3; arg in [-pi, pi), floor, F = 0 at level 0. The transform is
    computed in integers: its cosines are rounded to steps of about L / 4000, and those of one
    frequency sum to zero. Float images are resolved in 2 to 4 million steps of the range in which
    their pixels lie, but for 0.1 % at either end (of large images: of an even sample), and clamped
    four ranges beyond. A level may therefore differ from that of a floating-point component which
    lies very near to a boundary: for natural images about one bit in a thousand does.

    White noise of standard deviation s gives either part of every component the standard deviation
    s sqrt(sum(w^2) / 2), w being the window: s L / sqrt(2) for the uniform one. A part is clear if
    its magnitude exceeds ``noise_threshold`` times that (with ``power=2`` the square of it),
    rounded to a whole step of the integers.
    """
    chosen = resolve("paper" if settings is None else None, settings, overrides)
    pixels = as_pixels(image, "image")
    return _core.descriptor(pixels, as_mask(mask, pixels.shape, "mask"), chosen, threads, noise)

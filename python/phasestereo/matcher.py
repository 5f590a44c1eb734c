"""Two images in, one disparity map out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasestereo import _core
from phasestereo._images import as_mask, as_pair
from phasestereo.result import Result
from phasestereo.settings import Settings, resolve

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike


def match(
    left: ArrayLike,
    right: ArrayLike,
    *,
    num_disparities: int,
    min_disparity: int = 0,
    preset: str = "paper",
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    progress: Callable[[int, int], object] | None = None,
    **overrides: Any,
) -> Result:
    """Match a rectified stereo pair.

    Parameters
    ----------
    left, right
        Images of equal size and dtype: (H, W) or (H, W, 1) gray, (H, W, 3) RGB or (H, W, 4) RGBA
        (alpha is left out); uint8, uint16, float32 or float64, of any strides and byte order. They
        may differ in the number of channels.
    num_disparities
        Number of disparities to search, 1 to the images' width and at most 16384.
    min_disparity
        Smallest disparity; those in [min_disparity, min_disparity + num_disparities) are searched.
    preset
        Name of the settings to start from, one of `PRESETS`.
    settings
        Settings to start from in place of a preset.
    threads
        Number of threads, 1 to 1024; None: what the environment variable ``RAYON_NUM_THREADS``
        says, or else as many as the process may use. The result does not depend on it.
    left_mask, right_mask
        bool (H, W), True = valid. A masked pixel neither votes nor is estimated, and what it holds
        (it may be NaN) has no effect. None: all are valid.
    progress
        Called as ``progress(rows_done, rows)`` every now and then from the calling thread; what it
        raises ends the match.
    **overrides
        Fields of `Settings` by name, which take precedence over ``preset`` and ``settings``.

    Returns
    -------
    Result
        Disparities, flags and confidences, each (H, W).

    Raises
    ------
    TypeError
        For a wrong type or dtype, or an unknown setting.
    ValueError
        For a wrong value or shape, NaN or infinite pixels that no mask covers, an unknown preset.
    MemoryError
        If the working memory cannot be had.
    KeyboardInterrupt
        Soon after Ctrl-C.

    Notes
    -----
    The method is that of Pedone & Heikkilä, *Blur and Contrast Invariant Fast Stereo Matching*,
    ACIVS 2008. Working memory is about ``(6 * window + 12) * W * num_disparities`` bytes a thread
    (with masks ``8 * window + 22``), whatever the height; and for the whole pair 9 bytes a pixel.
    """
    chosen = resolve(preset, settings, overrides)
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: got {type(progress).__name__}; accepts a callable or None")
    pair = as_pair(left, right)
    size = pair[0].shape
    masks = as_mask(left_mask, size, "left_mask"), as_mask(right_mask, size, "right_mask")
    disparities = min_disparity, num_disparities
    disparity, flags, confidence, timings = _core.match_pair(
        pair, masks, disparities, chosen, threads, progress
    )
    return Result(disparity, flags, confidence, chosen, timings)

"""Any image a caller passes -> rows x columns x channels, as the core takes it."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core

Pixels: TypeAlias = (
    NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32] | NDArray[np.float64]
)

Mask: TypeAlias = NDArray[np.bool_]
"""True where pixels are valid."""

Map: TypeAlias = NDArray[np.float32]
"""Disparities, or other values per pixel; NaN where unknown."""

ImageOrPath: TypeAlias = ArrayLike | os.PathLike[str]
"""An image as an array, or its file (`ArrayLike` includes file names)."""

ACCEPTED = "uint8, uint16, float32 or float64"

_INTENSITIES = (0.1, 99.9)  # percentiles: the ends of `Settings.intensity_range`, too
_KINDS = {"b": "bool", "f": "floats", "iu": "integers", "iuf": "real numbers"}
_MODES = ("P", "PA", "CMYK", "YCbCr", "HSV", "LAB")
"""Of Pillow's images: arrays of these hold indices of a palette, or other colors than RGB."""
_SAMPLES = 2**20  # pixels: nearly as good as all of them for finding the ends of intensities


def as_pixels(image: ArrayLike, name: str) -> Pixels:
    """Return an image as a contiguous array in native byte order, shape (H, W, 1) or (H, W, 3).

    Parameters
    ----------
    image
        (H, W) or (H, W, 1) gray, (H, W, 3) RGB or (H, W, 4) RGBA, whose alpha is dropped; uint8,
        uint16, float32 or float64, of any strides and byte order.
    name
        Name of the argument, for messages.

    Raises
    ------
    TypeError
        If it is not an array of one of these types.
    ValueError
        If it has another shape or no pixel.
    """
    pixels = as_array(image, name)
    if pixels.dtype.kind + str(pixels.dtype.itemsize) not in ("u1", "u2", "f4", "f8"):
        raise TypeError(f"{name}: got dtype {pixels.dtype}; accepts {ACCEPTED}")

    if pixels.ndim == 2:
        pixels = pixels[:, :, np.newaxis]
    if pixels.ndim != 3 or pixels.shape[2] not in (1, 3, 4):
        raise ValueError(
            f"{name}: got shape {np.shape(image)}; accepts (H, W) or (H, W, 1) gray, "
            "(H, W, 3) RGB and (H, W, 4) RGBA"
        )
    if pixels.size == 0:
        raise ValueError(f"{name}: got shape {np.shape(image)}; accepts at least one pixel")

    # Alpha is left out. The core takes contiguous pixels in the byte order of the machine.
    colors = pixels[:, :, :3]
    return np.require(colors, colors.dtype.newbyteorder("="), ["C", "ALIGNED"])


def as_views(left: ArrayLike, right: ArrayLike) -> tuple[Pixels, Pixels]:
    """Return both images as `as_pixels` does; they may differ in size and type."""
    return as_pixels(left, "left"), as_pixels(right, "right")


def as_alike(left: ArrayLike, right: ArrayLike) -> tuple[Pixels, Pixels]:
    """Return both images as they are matched: the right one at the left one's size."""
    pair = as_views(left, right)
    if pair[0].shape[:2] == pair[1].shape[:2]:
        return pair
    return pair[0], _core.fit_right(pair, (None, None))[0]


def as_pair(left: ArrayLike, right: ArrayLike) -> tuple[Pixels, Pixels]:
    """Return both images as `as_pixels` does; their sizes and types must agree."""
    pair = as_views(left, right)

    if pair[0].dtype != pair[1].dtype:
        raise TypeError(f"right: got dtype {pair[1].dtype}; accepts that of left, {pair[0].dtype}")
    if pair[0].shape[:2] != pair[1].shape[:2]:
        raise ValueError(
            f"right: got {pair[1].shape[:2]} pixels; accepts the size of left, {pair[0].shape[:2]}"
        )

    return pair


def as_rgb8(pixels: Pixels) -> NDArray[np.uint8]:
    """Return an image from `as_pixels` as one to look at: uint8 (H, W, 3).

    uint8 stays as it is. uint16 is shifted right by the bits that the image does not use: few
    cameras use all 16. Floats are stretched to their range without the 0.1 % at either end; NaN
    becomes black.
    """
    if pixels.dtype == np.uint16:
        shift = max(int(pixels.max()).bit_length() - 8, 0)
        shown = np.right_shift(pixels, shift, dtype=np.uint16).astype(np.uint8)
    elif pixels.dtype == np.uint8:
        shown = pixels.astype(np.uint8, copy=False)
    else:
        shown = on_screen(pixels, screen_range([pixels]))

    return np.broadcast_to(shown, (*shown.shape[:2], 3))


def screen_range(images: Sequence[NDArray[Any]]) -> tuple[float, float]:
    """Return the intensities to show as black and white, the same for all images."""
    every = [max(1, round(image.shape[0] * image.shape[1] / _SAMPLES)) for image in images]
    sample = np.concatenate([image[::n].ravel() for image, n in zip(images, every, strict=True)])
    known = sample[np.isfinite(sample)].astype(np.float64)
    low, high = np.percentile(known, _INTENSITIES).tolist() if known.size else (0.0, 1.0)
    return low, high if high > low else low + 1.0


def on_screens(images: Sequence[Pixels]) -> list[NDArray[np.uint8]]:
    """Return images in 8 bits, unchanged or stretched; images of one dtype share one range."""
    alike = len({image.dtype for image in images}) == 1
    return [
        image.astype(np.uint8, copy=False)
        if image.dtype == np.uint8
        else on_screen(image, screen_range(images if alike else [image]))
        for image in images
    ]


def on_screen(image: NDArray[Any], black_white: tuple[float, float]) -> NDArray[np.uint8]:
    """Return an image in 8 bits, stretched to a range; non-finite pixels become black."""
    low, high = black_white
    values = image.astype(np.float64)
    share = (np.where(np.isfinite(values), values, low) - low) / (high - low)
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)


def as_mask(mask: ArrayLike | None, size: tuple[int, ...], name: str) -> NDArray[np.bool_] | None:
    """Return a mask (True = valid) of the given size as a contiguous array, or None."""
    if mask is None:
        return None

    return np.ascontiguousarray(as_numbers(mask, name, "b", size[:2]))


class RightView(NamedTuple):
    """Where a right image of another size lies over the left one."""

    size: tuple[int, int]
    """Its columns and rows."""
    matrix: NDArray[np.float64]
    """(3, 3): maps its columns and rows to those of the left image."""


class Seen(NamedTuple):
    """An image as the caller gave it, as the core takes it, and its mask of valid pixels."""

    array: NDArray[np.generic]
    pixels: Pixels
    valid: Mask | None


def as_seen(image: ArrayLike, mask: ArrayLike | None, name: str) -> Seen:
    """Return an image and the mask of its valid pixels; None: all are valid.

    Parameters
    ----------
    image
        As `as_pixels` takes it, or a NumPy masked array. Invalid are masked pixels, pixels with an
        alpha of 0 (unless alpha is 0 everywhere), and NaN, which marks missing data in floats.
    mask
        bool (H, W), True = valid; None: all.
    name
        Name of the argument, for messages; the name of the mask ends in ``_mask``.

    Raises
    ------
    TypeError, ValueError
        As `as_pixels` and `as_mask`.
    """
    hidden = None
    if _is_masked_array(image):
        hidden = sys.modules["numpy.ma"].getmaskarray(image)
        image = sys.modules["numpy.ma"].getdata(image)

    array = as_array(image, name)
    pixels = as_pixels(array, name)
    size = pixels.shape[:2]
    valid = as_mask(mask, size, f"{name}_mask")

    if hidden is not None and hidden.any():
        valid = join_masks(valid, ~hidden.reshape(*size, -1).any(axis=2))
    valid = join_masks(valid, seen_by_alpha(array))
    if pixels.dtype.kind == "f":
        known = np.logical_not(np.isnan(pixels).max(axis=2))
        valid = valid if known.all() else join_masks(valid, known)
    return Seen(array, pixels, valid)


def seen_by_alpha(array: NDArray[np.generic]) -> Mask | None:
    """Return the pixels of an image that its alpha does not hide; None: all."""
    if array.shape[2:] != (4,):
        return None
    seen = np.asarray(array[:, :, 3] != 0)
    # A fourth channel that is 0 everywhere only pads pixels to four bytes.
    return seen if seen.any() and not seen.all() else None


def join_masks(
    mask: NDArray[np.bool_] | None, other: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """Return the pixels valid in both masks; None: all."""
    if mask is None or other is None:
        return other if mask is None else mask
    return mask & other


def as_array(value: ArrayLike, name: str) -> NDArray[np.generic]:
    """Return an array-like as an array; DLPack passes other libraries' arrays without a copy.

    If it is not an array, the message names the argument.
    """
    if _is_masked_array(value):
        raise TypeError(f"{name}: got a masked array; accepts plain arrays, and masks apart")
    if value is None or isinstance(value, str | bytes | os.PathLike):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts an array")
    if (mode := getattr(value, "mode", None)) in _MODES:
        raise TypeError(f"{name}: got Pillow's mode {mode}; accepts L, RGB, RGBA, I;16 or F")

    try:
        if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
            return np.from_dlpack(value)  # type: ignore[arg-type]  # asked for above
        return np.asarray(value)
    except MemoryError:
        raise
    except Exception as error:
        raise TypeError(
            f"{name}: got {type(value).__name__}, not an array; accepts arrays of numbers"
        ) from error


def as_numbers(
    value: ArrayLike,
    name: str,
    dtypes: str | tuple[str, ...] = "iuf",
    *shapes: tuple[int | str, ...],
) -> NDArray[Any]:
    """Return an array-like of these types and shapes as an array, without a copy.

    Parameters
    ----------
    value
        The argument.
    name
        The name that messages use.
    dtypes
        NumPy's kind letters, as in `_KINDS`, or names of dtypes.
    shapes
        The accepted shapes, with a letter for each length from 1; none: (H, W).

    Raises
    ------
    TypeError, ValueError
        If it has another type or shape.
    """
    values = as_array(value, name)
    if (values.dtype.kind if isinstance(dtypes, str) else values.dtype.name) not in dtypes:
        words = _KINDS[dtypes] if isinstance(dtypes, str) else " or ".join(dtypes)
        raise TypeError(f"{name}: got dtype {values.dtype}; accepts {words}")

    accepted = shapes or (("H", "W"),)
    if not any(_fits(values.shape, shape) for shape in accepted):
        words = " or ".join(str(shape).replace("'", "") for shape in accepted)
        raise ValueError(f"{name}: got shape {values.shape}; accepts {words}")
    return values


def _fits(given: tuple[int, ...], wanted: tuple[int | str, ...]) -> bool:
    sides = zip(given, wanted, strict=False)
    return len(given) == len(wanted) and all(
        a > 0 if isinstance(b, str) else a == b for a, b in sides
    )


def _is_masked_array(value: object) -> bool:
    """Recognize masked arrays without importing `numpy.ma`.

    An import during a match would hold its lock while another thread forks the process.
    """
    masked_array = getattr(sys.modules.get("numpy.ma"), "MaskedArray", ())
    return isinstance(value, masked_array)

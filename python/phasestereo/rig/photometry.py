"""The gray values of a pair, as measured by the core."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Saturation:
    """Shares of an image's pixels, 0 to 1, with a channel at an end of its range of values.

    Parameters
    ----------
    dark, bright
        At the smallest and at the largest value.
    """

    dark: float
    bright: float


@dataclass(frozen=True, slots=True)
class Contrast:
    """The relation of the gray levels of the images: ``left = gain * right ** gamma``.

    Parameters
    ----------
    gain, gamma
        Of intensities as fractions of their range.
    ratio
        The left image's gray level over the right one's, at the right image's median.
    """

    gain: float
    gamma: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Photometry:
    """Facts about the gray values of a pair; pairs of values are (left, right).

    Parameters
    ----------
    intensity_range
        Black to white, in units of the pixels: the range of the bits in use, or for floats the
        range of the values without 0.1 % at either end.
    saturation
        Pixels at the ends of the values.
    low_texture
        Shares of the image, 0 to 1, without texture along its rows; NaN: too narrow.
    smeared
        Shares of the texture that is smeared, such as by lossy compression, denoising or a soft
        lens; NaN: unknown.
    repeated
        Shares of the image whose texture repeats itself along its rows; NaN: too narrow.
    fields
        Shift of odd rows against even ones, in pixels; 0: none.
    mosaic
        Whether pixels two apart are more alike than neighbors, along rows, as in the raw mosaic of
        a color sensor or in YUYV.
    contrast
        Gain and gamma; None: too little corresponds.
    """

    intensity_range: float
    saturation: tuple[Saturation, Saturation]
    low_texture: tuple[float, float]
    smeared: tuple[float, float]
    repeated: tuple[float, float]
    fields: tuple[int, int]
    mosaic: tuple[bool, bool]
    contrast: Contrast | None

"""What the gray values of a pair say, as the core has measured it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Saturation:
    """Shares of an image's pixels, 0 to 1, a channel of which is at an end of the values it has.

    Parameters
    ----------
    dark, bright
        At the least and at the largest value.
    """

    dark: float
    bright: float


@dataclass(frozen=True, slots=True)
class Contrast:
    """How the gray levels of the images correspond: ``left = gain * right ** gamma``.

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
    """What the gray values of a pair say; of two values, that of the left image comes first.

    Parameters
    ----------
    intensity_range
        Black to white, in units of the pixels: what the bits in use can hold, or the range in which
        floats lie but for 0.1 % at either end.
    saturation
        Pixels at the ends of the values.
    low_texture
        Shares of the image, 0 to 1, with no texture along its rows; NaN: too narrow.
    smeared
        Shares of the texture that is smeared, as by lossy compression, by denoising or by a soft
        lens; NaN: unknown.
    repeated
        Shares of the image whose texture repeats itself along its rows; NaN: too narrow.
    fields
        By how many pixels odd rows are shifted against even ones; 0: they are not.
    contrast
        Gain and gamma; None: too little corresponds.
    """

    intensity_range: float
    saturation: tuple[Saturation, Saturation]
    low_texture: tuple[float, float]
    smeared: tuple[float, float]
    repeated: tuple[float, float]
    fields: tuple[int, int]
    contrast: Contrast | None

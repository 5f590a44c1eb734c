"""Relative blur of a pair: which image is blurrier, where and how, from the images alone.

Only the *difference* of the two blurs harms a match. It can be measured without knowing the scene:
where both images show the same, their power spectra differ by gain, noise, and the response of the
relative blur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from phasestereo._tables import as_html

Side = Literal["none", "left", "right"]
BlurKind = Literal["none", "gaussian", "disk", "motion", "annulus", "other"]

# For an annulus with a hole of 0.75; 1.8 for one of half the radius.
_DIVISORS = {"gaussian": 1, "disk": 2, "annulus": 1.6, "other": math.sqrt(2), "none": math.inf}
"""The size of a blur divided by its standard deviation along an axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Blur:
    """A kind of relative blur: it makes the sharper image as soft as the other.

    Parameters
    ----------
    side
        The softer image; "none": both are equally sharp.
    kind
        The family of the point-spread function: "gaussian", "disk" (defocus), "motion" (straight,
        at constant speed), "annulus" (defocus of a lens with a covered middle, such as a mirror
        lens), or "other", which none of these explains.
    size
        In pixels: the standard deviation of a Gaussian, the radius of a disk, the outer radius of
        an annulus, the length of a motion (1: no blur), the root mean square radius of "other"; 0
        without blur.
    angle
        Direction of a motion in degrees, in [0, 180): 0 is along x, 90 along y, from x (right)
        towards y (down); 0 for other kinds.
    psf
        The point-spread function, float64 (n, n), n odd, sum 1: the sharper image convolved with it
        is as soft as the other one. None if there is no blur.
    other
        The blur of the other image, if each image has its own, such as with two cameras shaken
        along different paths: each image convolved with the other one's blur, they look alike.
        None: the other image is sharp.

    Examples
    --------
    >>> blur = ps.estimate_blur(left, right).blur
    >>> blur.side, blur.kind, blur.size  # as ('left', 'disk', 2.96)
    """

    side: Side
    kind: BlurKind
    size: float
    angle: float
    psf: NDArray[np.float64] | None = None
    other: Blur | None = None

    @property
    def spread(self) -> float:
        """The standard deviation along an axis, or along the path of a motion, pixels."""
        if self.kind == "motion":
            return (self.size - 1) / math.sqrt(12)
        return self.size / _DIVISORS[self.kind]

    def as_dict(self) -> dict[str, Any]:
        """Return the blur for JSON, without arrays."""
        plain = {name: getattr(self, name) for name in ("side", "kind", "size", "angle")}
        return plain | {"other": None if self.other is None else self.other.as_dict()}

    def __str__(self) -> str:
        if self.side == "none":
            return "none"

        if self.other is not None:
            return f"{replace(self, other=None)}, and {self.other}"
        along = f" at {self.angle:.0f} degrees" if self.kind == "motion" else ""
        return f"{self.side}, {self.kind} {self.size:.2f} px{along}"

    def __repr__(self) -> str:
        """Show the blur without its array."""
        return f"<Blur: {self}>"


@dataclass(frozen=True, slots=True, eq=False)
class BlurEstimate:
    """The relative blur of two images, estimated from them alone.

    Parameters
    ----------
    blurs
        The kinds of relative blur in the image, at least one, largest area first.
    labels
        uint8 (rows, columns) for square tiles of the left image: the index into `blurs` of each.
        Pixel (x, y) lies in the tile of row y // `tile` and column x // `tile`, or in the last one.
    tile
        Side of a tile in pixels.
    certainty
        In [0, 1]: how much better the first of `blurs` explains its part of the images than the
        alternative: no blur, or, for "none", the best blur. If disks follow depth: their share of
        the evidence that separate blurs per area would explain.
    contrast
        Contrast of the left image relative to the right one, from the spectra.
    noise
        Standard deviations of the noise of the left and of the right image, in the unit of their
        pixels (for color images, of the gray values 0.299 R + 0.587 G + 0.114 B). Texture as fine
        as noise counts as noise.
    gain, gamma
        Relation of the intensities, as fractions of their range: left = gain * right ** gamma. NaN
        if too little corresponds.
    reused
        Whether the estimate comes from an earlier frame, since the blur still looks the same:
        `phasestereo.Rig`, and `phasestereo_live.stream`.
    impulses
        The least difference of hot, dead and stuck pixels of the left and of the right image from
        their neighbors, in units of the pixels; 0 without such pixels. Blur and noise are estimated
        without them.
    coding
        Loss by compression in blocks of 8 x 8 pixels (JPEG, video) in the left and in the right
        image: the standard deviation of a noise that does the same harm, in units of the pixels.
        Estimated at the borders of the blocks, wherever they begin; about 0 without compression.

    Examples
    --------
    >>> estimate = ps.estimate_blur(left, right)
    >>> estimate.areas()  # the share of each kind
    >>> estimate.label_map(left.shape[:2])  # the kind of each pixel
    """

    blurs: tuple[Blur, ...]
    labels: NDArray[np.uint8]
    tile: int
    certainty: float
    contrast: float
    noise: tuple[float, float]
    gain: float = math.nan
    gamma: float = math.nan
    reused: bool = False
    impulses: tuple[float, float] = (0.0, 0.0)
    coding: tuple[float, float] = (0.0, 0.0)

    @property
    def blur(self) -> Blur:
        """The kind of the largest area."""
        return self.blurs[0]

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return the kinds for JSON, each with its share of the image."""
        return [
            blur.as_dict() | {"share": share}
            for blur, share in zip(self.blurs, self.areas(), strict=True)
        ]

    def __str__(self) -> str:
        """Return the kinds in words, each with its share of the image."""
        if len(self.blurs) == 1:
            return str(self.blur)

        shares = zip(self.blurs, self.areas(), strict=True)
        return ", ".join(f"{blur} in {share:.0%}" for blur, share in shares)

    def _repr_html_(self) -> str:
        """Show the kinds as a table in notebooks."""
        left, right = self.noise
        numbers = f"certainty {self.certainty:.2f}, noise {left:.3g} left, {right:.3g} right"
        kinds = zip(map(str, self.blurs), map("{:.1%}".format, self.areas()), strict=True)
        return as_html("BlurEstimate", numbers, ("Relative blur", "share of the image"), kinds)

    def areas(self) -> tuple[float, ...]:
        """Return the share of the image of each of `blurs`."""
        counts = np.bincount(self.labels.ravel(), minlength=len(self.blurs))
        return tuple((counts / self.labels.size).tolist())

    def label_map(self, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return the index into `blurs` of every pixel of an image of this size (rows, cols)."""
        y, x = (
            np.minimum(np.arange(length) // self.tile, tiles - 1)
            for length, tiles in zip(size, self.labels.shape, strict=True)
        )
        return self.labels[np.ix_(y, x)]

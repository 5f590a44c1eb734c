"""Defines the paper's experiments: the blurred images, the amounts of blur, and the methods.

Two protocols set up the methods, and neither looks at a blurred pair:

- "fixed": every method has the settings of its grid that are the best on the sharp pair, and keeps
  them at all levels;
- "tied": the window has the size of the point-spread function, as in the paper, and the side L of
  the neighborhood follows from it by a rule; the penalty is the best on the sharp pair for the
  smallest of these windows and neighborhoods, and kept at all levels.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import ceil
from typing import Literal, NamedTuple

import numpy as np

from phasestereo.settings import Settings
from phasestereo_bench.arrays import Array
from phasestereo_bench.degradation import Degradation, Kernel, areas, disk_psf, gaussian_psf

# Degradations

Kind = Literal["motion x", "motion y", "gauss", "areas"]

_CONTRAST = Degradation(gain=0.6, offset=20)
_GRID = np.add.outer(np.arange(4), np.arange(4)) % 4  # contrast, motion, as it was, out of focus


@dataclass(frozen=True, slots=True)
class PaperBlur:
    """A degradation of the left image.

    Parameters
    ----------
    kind
        Motion along a row or a column, Gaussian blur, or areas of different degradations.
    amount
        Length in pixels, standard deviation in pixels, or the blur factor, which is the length of a
        motion along x and the diameter of a disk. Motion of 1 and a Gaussian of 0 change nothing.
    """

    kind: Kind
    amount: float

    def __call__(self, image: Array) -> Array:
        """Return the degraded image, of the same shape and type."""
        if self.kind == "gauss":
            return Degradation(gaussian_psf(self.amount))(image)

        motion = box_psf(self.amount)
        if self.kind != "areas":
            return Degradation(motion if self.kind == "motion x" else motion.T)(image)

        disk = disk_psf(self.amount / 2)
        versions: list[Callable[[Array], Array]] = [
            _CONTRAST,
            Degradation(motion),
            Degradation(),
            Degradation(disk),
        ]

        return areas(image, _GRID, versions)


def box_psf(length: float) -> Kernel:
    """Return the point-spread function of a motion along x over exactly `length` pixels, >= 1.

    float64 (1, odd), sum 1: each tap is the share of the path over its pixel. Its transform has its
    first zero at the frequency 1 / length.
    """
    half = int(np.ceil((length - 1) / 2))
    distance = np.abs(np.arange(-half, half + 1))
    taps = np.clip(length / 2 - (distance - 0.5), 0, 1)
    return np.asarray(taps / taps.sum())[np.newaxis]


SHARP = PaperBlur("gauss", 0)
"""The degradation that changes nothing."""

# Methods


class Grid(NamedTuple):
    """Values to choose from: windows and neighborhoods in pixels."""

    windows: tuple[int, ...] = (5, 7, 9, 11)
    neighborhoods: tuple[int, ...] = (7, 11, 15, 21)


class MatchingCost(NamedTuple):
    """A way to compare two pixels; windows and dynamic programming are the same for all.

    Attributes
    ----------
    cost
        Name of the cost in `phasestereo.Settings`.
    name
        Its name in text.
    unit
        Unit of its cost, and so of its penalties.
    penalties
        Penalties to choose from.
    """

    cost: Literal["phase", "sad", "nsad"]
    name: str
    unit: str
    penalties: tuple[float, ...]

    def candidates(self, grid: Grid, power: int) -> list[Settings]:
        """Return all settings to choose from; if two are equally good, the first counts."""
        sides = grid.neighborhoods if self.cost == "phase" else (None,)
        return [
            self.settings(window=window, neighborhood=side, penalty=penalty, power=power)
            for side in sides
            for window in grid.windows
            for penalty in self.penalties
        ]

    def settings(
        self, *, window: int, penalty: float, neighborhood: int | None = None, power: int = 1
    ) -> Settings:
        """Return the settings of the paper's preset with these changes; b = 2."""
        paper = Settings.preset("paper")
        if self.cost != "phase" or neighborhood is None:
            return replace(paper, cost=self.cost, window=window, p1=penalty, p2=penalty)

        return replace(
            paper, neighborhood=neighborhood, window=window, power=power, p1=penalty, p2=penalty
        )


def recoded(settings: Settings, bits: int) -> Settings:
    """Return settings of phase codes with another number of phase bits.

    A component takes 2^(b - 1) bits of the code, so each further bit of phase doubles all distances
    and the penalty.
    """
    penalty = settings.p1 * 2.0 ** (bits - settings.bits)
    return replace(settings, bits=bits, p1=penalty, p2=penalty)


SMALLEST = 7
"""The smallest window and neighborhood of the protocol "tied", pixels."""

FULL_GRID, QUICK_GRID = Grid(), Grid((SMALLEST,), (SMALLEST,))

PHASE = MatchingCost("phase", "phase codes", "bits", (0.5, 1, 2, 4))
SAD = MatchingCost("sad", "SAD", "gray levels", (5, 10, 15, 20, 30))
NSAD = MatchingCost("nsad", "normalized SAD", "standard deviations", (0.25, 0.5, 1, 2))

METHODS = (PHASE, SAD, NSAD)

# Experiments

PROTOCOLS = ("tied", "fixed")

RULES: Mapping[str, Callable[[float], float]] = {
    "2n + 1": lambda n: 2 * n + 1,
    "3n": lambda n: 3 * n,
    "4 sigma + 1": lambda sigma: 4 * sigma + 1,
}
"""How L follows from the level of the blur. For a motion of n pixels, the first puts the zero of
its transform just above the descriptor's highest frequency, u = 2 (the paper's equation 9), the
second at one and a half times that. A Gaussian has no zeros."""


class Series(NamedTuple):
    """A line in a figure: a method set up by a protocol; `rule` gives L, if L follows a rule."""

    protocol: str
    method: MatchingCost
    rule: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One of the paper's experiments.

    Attributes
    ----------
    key
        Its name in files.
    number
        Its number in the paper.
    title, symbol
        Its name in text, and the symbol of a level.
    kind
        The kind of blur of the left image.
    levels
        The amounts of blur.
    quick_levels
        The levels that are enough for a trial.
    power
        The power k of the descriptor; b = 2, r = 2, s = 1.
    rules
        Rules for L in the protocol "tied"; the first is the paper's own bound.
    rival
        The method that the paper compares with.
    """

    key: str
    number: int
    title: str
    symbol: str = "n"
    kind: Kind
    levels: tuple[float, ...]
    quick_levels: tuple[float, ...]
    power: int
    rules: tuple[str, ...] = ("2n + 1", "3n")
    rival: MatchingCost = SAD

    def blur(self, level: float) -> PaperBlur:
        """Return the degradation of the left image, or one that changes nothing."""
        return SHARP if self.is_sharp(level) else PaperBlur(self.kind, level)

    def is_sharp(self, level: float) -> bool:
        """Return whether the left image stays as it is."""
        return (self.kind, level) in {("gauss", 0), ("motion x", 1), ("motion y", 1)}

    def size(self, level: float) -> float:
        """Return the point-spread function's size, pixels: 2 sigma each way for a Gaussian."""
        return 4 * level + 1 if self.kind == "gauss" else level

    def window(self, level: float) -> int:
        """Return the window's side in the protocol "tied"."""
        return odd(max(SMALLEST, self.size(level)))

    def neighborhood(self, level: float, rule: str) -> int:
        """Return the side of the neighborhood that a rule gives."""
        return odd(max(SMALLEST, RULES[rule](level)))

    def series(self, protocol: str) -> list[Series]:
        """Return the lines of a figure."""
        rules = self.rules if protocol == "tied" else ("",)
        phase = [Series(protocol, PHASE, rule) for rule in rules]
        return [*phase, Series(protocol, SAD), Series(protocol, NSAD)]


def odd(side: float) -> int:
    """Return the smallest odd integer at or above `side`."""
    return ceil(side) | 1


_LENGTHS = tuple(map(float, range(1, 22, 2)))

MOTION_X = Experiment(
    key="motion_x",
    number=1,
    title="motion along x",
    kind="motion x",
    levels=_LENGTHS,
    quick_levels=(1.0, 11.0),
    power=2,
)
MOTION_Y = replace(MOTION_X, key="motion_y", title="motion along y", kind="motion y")
GAUSS = Experiment(
    key="gauss",
    number=2,
    title="Gaussian blur",
    symbol="sigma",
    kind="gauss",
    levels=tuple(step / 2 for step in range(11)),
    quick_levels=(0.0, 4.0),
    power=1,
    rules=("4 sigma + 1",),
)
AREAS = Experiment(
    key="areas",
    number=3,
    title="contrast, motion, defocus",
    kind="areas",
    levels=tuple(map(float, range(3, 16))),
    quick_levels=(3.0, 11.0),
    power=1,
    rival=NSAD,
)
EXPERIMENTS = (MOTION_X, MOTION_Y, GAUSS, AREAS)

BITS = (1, 2, 3, 4)
"""Bits of the phase in Figure 3, under the Gaussian blur of `BITS_SIGMAS` pixels."""

BITS_KEY = "bits"
"""The key of Figure 3; the other figures have the key of their experiment."""

BITS_SIGMAS = (0.25, 1.0, 4.0)
QUICK_BITS_SIGMAS = (1.0,)

"""The paper's experiments: what is blurred, how much, and which settings take part.

Two protocols set the methods up, both without a look at any blurred pair:

- "fixed": every method has the settings of its grid that are the best on the sharp pair, and keeps
  them at all levels;
- "tied": the window has the size of the point-spread function, as in the paper, and the side L of
  the neighbourhood follows from it by a rule; the penalty is the best on the sharp pair for the
  smallest of these windows and neighbourhoods, and kept at all levels.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

from phasestereo_bench.paper.blurs import Blur
from phasestereo_bench.paper.methods import NSAD, PHASE, SAD

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from phasestereo_bench.paper.blurs import Kind
    from phasestereo_bench.paper.methods import Method

__all__ = [
    "AREAS",
    "BITS",
    "BITS_KEY",
    "BITS_SIGMAS",
    "EXPERIMENTS",
    "GAUSS",
    "MAPS_LEVEL",
    "MOTION_X",
    "MOTION_Y",
    "PROTOCOLS",
    "QUICK_BITS_SIGMAS",
    "RULES",
    "SHARP",
    "SMALLEST",
    "Experiment",
    "Series",
    "odd",
]

SHARP = Blur("gauss", 0)
"""The degradation that changes nothing."""

SMALLEST = 7
"""The smallest window and neighbourhood of the protocol "tied", pixels."""

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
    """A line in a figure: a method, set up by a protocol.

    Attributes
    ----------
    protocol
        One of `PROTOCOLS`.
    method
        Phase codes or one of its rivals.
    rule
        The rule for L where the protocol is "tied" and the method phase codes, else empty.
    """

    protocol: str
    method: Method
    rule: str = ""

    @property
    def label(self) -> str:
        """Its name in a legend."""
        return f"{self.method.name}, L = {self.rule}" if self.rule else self.method.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One of the paper's experiments.

    Attributes
    ----------
    key
        Its name in files.
    number
        Its number in the paper.
    title
        Its name in text.
    axis
        What a level is, with its unit.
    symbol
        The level's symbol.
    kind
        What is done to the left image.
    levels
        How much of it.
    quick_levels
        Those of them that make do for a trial.
    power
        The power k of the descriptor; b = 2, r = 2, s = 1.
    rules
        Rules for L in the protocol "tied", the first being the paper's own bound.
    rival
        What the paper compares with.
    """

    key: str
    number: int
    title: str
    axis: str
    symbol: str
    kind: Kind
    levels: tuple[float, ...]
    quick_levels: tuple[float, ...]
    power: int
    rules: tuple[str, ...]
    rival: Method

    def blur(self, level: float) -> Blur:
        """Return what is done to the left image; nothing is the same everywhere."""
        blur = Blur(self.kind, level)
        return SHARP if self.is_sharp(level) else blur

    def is_sharp(self, level: float) -> bool:
        """Tell whether nothing is done."""
        return (self.kind, level) in {("gauss", 0), ("motion x", 1), ("motion y", 1)}

    def size(self, level: float) -> float:
        """Return the size of the point-spread function, pixels: of a Gaussian, 2 sigma each way."""
        return 4 * level + 1 if self.kind == "gauss" else level

    def window(self, level: float) -> int:
        """Return the window's side in the protocol "tied"."""
        return odd(max(SMALLEST, self.size(level)))

    def neighborhood(self, level: float, rule: str) -> int:
        """Return the neighbourhood's side by a rule."""
        return odd(max(SMALLEST, RULES[rule](level)))

    def series(self, protocol: str) -> list[Series]:
        """Return the lines of a figure."""
        rules = self.rules if protocol == "tied" else ("",)
        phase = [Series(protocol, PHASE, rule) for rule in rules]
        return [*phase, Series(protocol, SAD), Series(protocol, NSAD)]


def odd(side: float) -> int:
    """Return the smallest odd integer that is not smaller."""
    return ceil(side) | 1


_LENGTHS = tuple(map(float, range(1, 22, 2)))

EXPERIMENTS = (
    Experiment(
        key="motion_x",
        number=1,
        title="motion along x",
        axis="length of the motion along x, n (pixels)",
        symbol="n",
        kind="motion x",
        levels=_LENGTHS,
        quick_levels=(1.0, 11.0),
        power=2,
        rules=("2n + 1", "3n"),
        rival=SAD,
    ),
    Experiment(
        key="motion_y",
        number=1,
        title="motion along y",
        axis="length of the motion along y, n (pixels)",
        symbol="n",
        kind="motion y",
        levels=_LENGTHS,
        quick_levels=(1.0, 11.0),
        power=2,
        rules=("2n + 1", "3n"),
        rival=SAD,
    ),
    Experiment(
        key="gauss",
        number=2,
        title="Gaussian blur",
        axis="standard deviation sigma of the Gaussian (pixels)",
        symbol="sigma",
        kind="gauss",
        levels=tuple(step / 2 for step in range(11)),
        quick_levels=(0.0, 4.0),
        power=1,
        rules=("4 sigma + 1",),
        rival=SAD,
    ),
    Experiment(
        key="areas",
        number=3,
        title="contrast, motion, defocus",
        axis="blur factor of the areas, n (pixels)",
        symbol="n",
        kind="areas",
        levels=tuple(map(float, range(3, 16))),
        quick_levels=(3.0, 11.0),
        power=1,
        rules=("2n + 1", "3n"),
        rival=NSAD,
    ),
)

MOTION_X, MOTION_Y, GAUSS, AREAS = EXPERIMENTS

BITS = (1, 2, 3, 4)
"""Bits of the phase in Figure 3, under the Gaussian blur of `BITS_SIGMAS` pixels."""

BITS_KEY = "bits"
"""What stands for Figure 3 where the others have the key of their experiment."""

BITS_SIGMAS = (0.25, 1.0, 4.0)
QUICK_BITS_SIGMAS = (1.0,)

MAPS_LEVEL = 11.0
"""Blur factor of the disparity maps of Figure 5."""

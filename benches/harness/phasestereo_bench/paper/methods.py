"""The methods that are compared, and the settings each may choose from on a sharp pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from phasestereo.settings import Settings

if TYPE_CHECKING:
    from typing import Literal

__all__ = ["METHODS", "NSAD", "PHASE", "SAD", "Grid", "Method", "recoded"]


@dataclass(frozen=True, slots=True)
class Grid:
    """Values to choose from: windows and neighbourhoods in pixels."""

    windows: tuple[int, ...] = (5, 7, 9, 11)
    neighborhoods: tuple[int, ...] = (7, 11, 15, 21)


@dataclass(frozen=True, slots=True)
class Method:
    """A way to compare two pixels; windows and dynamic programming are the same for all.

    Attributes
    ----------
    cost
        As `phasestereo.Settings` has it.
    name
        Its name in text.
    unit
        That of its cost, and so of its penalties.
    penalties
        Those to choose from.
    """

    cost: Literal["phase", "sad", "nsad"]
    name: str
    unit: str
    penalties: tuple[float, ...]

    def candidates(self, grid: Grid, power: int) -> list[Settings]:
        """Return all the settings to choose from; where two are equally good, the first counts."""
        sides = grid.neighborhoods if self.cost == "phase" else (None,)
        return [
            self.settings(window=window, neighborhood=side, penalty=penalty, power=power)
            for side in sides
            for window in grid.windows
            for penalty in self.penalties
        ]

    def settings(
        self,
        *,
        window: int,
        penalty: float,
        neighborhood: int | None = None,
        power: int = 1,
    ) -> Settings:
        """Return the settings of the paper's preset but for these; b = 2."""
        if self.cost != "phase" or neighborhood is None:
            return Settings(cost=self.cost, window=window, penalty=penalty)
        return Settings(neighborhood=neighborhood, window=window, power=power, penalty=penalty)


def recoded(settings: Settings, bits: int) -> Settings:
    """Return settings of phase codes with other bits of phase.

    A component takes 2^(b - 1) bits of the code, so all distances double with every further bit of
    phase, and so does the penalty.
    """
    penalty = cast("float", settings.penalty)
    return replace(settings, bits=bits, penalty=penalty * 2.0 ** (bits - settings.bits))


PHASE = Method("phase", "phase codes", "bits", (0.5, 1, 2, 4))
SAD = Method("sad", "SAD", "gray levels", (5, 10, 15, 20, 30))
NSAD = Method("nsad", "normalised SAD", "standard deviations", (0.25, 0.5, 1, 2))

METHODS = (PHASE, SAD, NSAD)

"""Facts of a pair that a caller gives before a match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from phasestereo import _core
from phasestereo._numbers import check_type
from phasestereo.rig.compensation import BlurCompensation

Noise: TypeAlias = float | tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """What is known of a pair, and therefore not estimated. It can be pickled.

    Parameters
    ----------
    noise
        Standard deviation of the noise of both images, or a pair of them (left, right), in units
        of their pixels, from 0; of gray values where they have color. It matters with
        ``noise_threshold > 0``. None: it is estimated then.
    blur_compensation
        How the blur of the images is evened out before pixels are compared; it holds the noise,
        too. For ``cost="phase"``. None: with ``compensate_blur=True`` what suits the blur that is
        found, else not at all.

    Raises
    ------
    TypeError
        If a field has the wrong type.
    ValueError
        If the noise is out of range, or given beside `blur_compensation`.

    Examples
    --------
    >>> result = ps.match(left, right, known=ps.Known(noise=2.0))
    """

    noise: Noise | None = None
    blur_compensation: BlurCompensation | None = None

    def __post_init__(self) -> None:
        """Check every field; the core owns the range of the noise."""
        kinds = (BlurCompensation, type(None))
        accepts = "BlurCompensation or None"
        check_type("known.blur_compensation", self.blur_compensation, kinds, accepts)
        if self.noise is None:
            return
        _core.check_noise(self.noise)
        if self.blur_compensation is not None:
            raise ValueError(
                f"known.noise: got {self.noise!r} beside known.blur_compensation, which holds it; "
                "accepts None"
            )

    def exchanged(self) -> Known:
        """Return these facts for the pair with left and right exchanged, and mirrored.

        Raises
        ------
        ValueError
            If the blur compensation is known, whose kernels are of this pair.
        """
        as_known(self, unused=("blur_compensation",))
        return Known(noise=self.noise[::-1] if isinstance(self.noise, tuple) else self.noise)

    @property
    def compensation(self) -> BlurCompensation | None:
        """The blur compensation, or one of the noise alone; None where neither is known."""
        if self.noise is None:
            return self.blur_compensation
        both = self.noise if isinstance(self.noise, tuple) else (self.noise, self.noise)
        return BlurCompensation(noise=both)


def as_known(known: Known | None, *, unused: tuple[str, ...] = ()) -> Known:
    """Return the facts, empty for None.

    Raises
    ------
    TypeError
        If it has another type.
    ValueError
        If a field is known that is of no use to the caller.
    """
    if known is None:
        return Known()
    check_type("known", known, Known, "Known or None")

    for name in unused:
        if (value := getattr(known, name)) is not None:
            raise ValueError(f"known.{name}: got {value!r}; accepts None here")
    return known

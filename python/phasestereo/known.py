"""Facts of a pair that the caller knows before a match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from phasestereo import _core
from phasestereo._numbers import check_type
from phasestereo.rig.compensation import BlurCompensation

Noise: TypeAlias = float | tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """Known facts of a pair, which are not estimated. It can be pickled.

    Parameters
    ----------
    noise
        Standard deviation of the noise of both images, or a pair (left, right), in units of their
        pixels, from 0; for color images, of the gray values. It matters with ``noise_threshold >
        0``. None: it is estimated then.
    blur_compensation
        How to even out the blur of the images before pixels are compared; includes the noise. For
        ``cost="phase"``. None: with ``compensate_blur=True``, a compensation for the blur that is
        found; else none.

    Raises
    ------
    TypeError
        If a field has the wrong type.
    ValueError
        If the noise is out of range, or given together with `blur_compensation`.

    Examples
    --------
    >>> result = ps.match(left, right, known=ps.Known(noise=2.0))
    """

    noise: Noise | None = None
    blur_compensation: BlurCompensation | None = None

    def __post_init__(self) -> None:
        """Check every field; the core defines the range of the noise."""
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
        """Return these facts for the exchanged and mirrored pair.

        Raises
        ------
        ValueError
            If the blur compensation is known: its kernels fit this pair only.
        """
        as_known(self, unused=("blur_compensation",))
        return Known(noise=self.noise[::-1] if isinstance(self.noise, tuple) else self.noise)

    @property
    def compensation(self) -> BlurCompensation | None:
        """The blur compensation, or one with the noise alone; None if neither is known."""
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
        If a field is known that the caller does not use.
    """
    if known is None:
        return Known()
    check_type("known", known, Known, "Known or None")

    for name in unused:
        if (value := getattr(known, name)) is not None:
            raise ValueError(f"known.{name}: got {value!r}; accepts None here")
    return known

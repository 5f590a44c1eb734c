"""The captures of a source in order of time; any of them may turn out to be damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, Generic, TypeAlias, TypeVar

from numpy.typing import NDArray

from phasestereo.io.pair import Layout, views_of

T = TypeVar("T")
Image: TypeAlias = NDArray[Any]
Pair: TypeAlias = tuple[Image, Image]


@dataclass(frozen=True, slots=True, eq=False)
class Capture(Generic[T]):
    """A recording of one moment.

    Parameters
    ----------
    index
        Its number in the source, from 0; lost captures also have one.
    time
        Seconds from the source's own zero, if known.
    take
        Returns an image, or a pair of them. Raises OSError or ValueError if it
        is damaged. Call it at most once, before you ask for the next capture.
    apart
        Seconds between the two views of a pair, if known.
    """

    index: int
    time: float | None
    take: Callable[[], T]
    apart: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CaptureSource(Generic[T]):
    """A sequence of captures.

    Parameters
    ----------
    captures
        The captures. Their iterator raises nothing: a damaged capture fails in its `take`.
    close
        Frees the files and cameras of the source. Default: the source holds nothing.
    length
        Number of captures, if known beforehand.
    rate
        Captures per second, if known.
    ahead
        Whether another thread may take captures before they are needed.
    """

    captures: Iterator[Capture[T]]
    close: Callable[[], None] = lambda: None
    length: int | None = None
    rate: float | None = None
    ahead: bool = False


def split(source: CaptureSource[Image], layout: Layout) -> CaptureSource[Pair]:
    """Return a source of pairs from a source of pictures with both views."""

    def cut(capture: Capture[Image]) -> Capture[Pair]:
        return Capture(capture.index, capture.time, lambda: views_of(capture.take(), layout))

    return CaptureSource(
        captures=map(cut, source.captures),
        close=source.close,
        length=source.length,
        rate=source.rate,
        ahead=source.ahead,
    )


def join(left: CaptureSource[Image], right: CaptureSource[Image]) -> CaptureSource[Pair]:
    """Return a source of pairs from one source for each view; it ends with the shorter one."""
    lengths = [source.length for source in (left, right) if source.length is not None]

    def close() -> None:
        left.close()
        right.close()

    return CaptureSource(
        captures=_joined(left.captures, right.captures),
        close=close,
        length=min(lengths, default=None),
        rate=left.rate or right.rate,
        ahead=left.ahead and right.ahead,
    )


def lost(index: int, time: float | None, error: Exception) -> Capture[Any]:
    """Return a capture for a frame that is already lost."""

    def fail() -> Any:
        raise error

    return Capture(index, time, fail)


def _joined(
    left: Iterator[Capture[Image]], right: Iterator[Capture[Image]]
) -> Iterator[Capture[Pair]]:
    for index, (one, other) in enumerate(zip_longest(left, right)):
        if one is None or other is None:
            ended, going = ("left", "right") if one is None else ("right", "left")
            message = f"the {ended} view ends after {index} frames, the {going} one goes on"
            yield lost(index, None, ValueError(message))
            return
        yield Capture(index, one.time, _both(one, other))


def _both(one: Capture[Image], other: Capture[Image]) -> Callable[[], Pair]:
    return lambda: (one.take(), other.take())

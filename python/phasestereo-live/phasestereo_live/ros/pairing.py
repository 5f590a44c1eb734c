"""Pair the frames of two cameras that have the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, TypeAlias

SIDES = "left", "right"
_MOST_WAITING = 64
"""Frames of a camera to keep until the other one delivers: it may have stopped."""

Message: TypeAlias = Any
"""A message, or the error from reading it."""


class Header(NamedTuple):
    """The header of a message: its capture time, ns since 1970, and its coordinate frame."""

    stamp: int
    frame_id: str


class UnpairedError(ValueError):
    """A frame of one camera without a frame of the other camera at the same time."""


class Arrival(NamedTuple):
    """A message from one of the two topics: its side (0 left, 1 right), its header, itself."""

    side: int
    header: Header
    message: Message


def paired(
    arrivals: Iterable[Arrival], tolerance: int
) -> Iterator[tuple[Header, tuple[Message, Message] | Exception]]:
    """Pair messages by their stamps.

    Parameters
    ----------
    arrivals
        Messages in order of recording; each side in order of time.
    tolerance
        Largest difference between the stamps of a pair, ns.

    Yields
    ------
    tuple
        The header of the left message (or of the message itself, if it has no partner), and both
        messages, or the error.
    """
    waiting: tuple[deque[Arrival], deque[Arrival]] = (deque(), deque())
    for arrival in arrivals:
        if isinstance(arrival.message, Exception):
            yield arrival.header, arrival.message
            continue

        waiting[arrival.side].append(arrival)
        yield from _ready(waiting, tolerance)
        if len(waiting[arrival.side]) > _MOST_WAITING:
            yield _alone(waiting[arrival.side].popleft(), None, tolerance)

    # The recording is over: messages that still wait have no partner.
    for queue in waiting:
        while queue:
            yield _alone(queue.popleft(), None, tolerance)


def _ready(
    waiting: tuple[deque[Arrival], deque[Arrival]], tolerance: int
) -> Iterator[tuple[Header, tuple[Message, Message] | Exception]]:
    """Yield the decided messages: the oldest of both sides pair up, or the older stays alone."""
    while waiting[0] and waiting[1]:
        left, right = waiting[0][0], waiting[1][0]
        apart = left.header.stamp - right.header.stamp
        if abs(apart) <= tolerance:
            yield left.header, (waiting[0].popleft().message, waiting[1].popleft().message)
        else:
            yield _alone(waiting[int(apart > 0)].popleft(), abs(apart), tolerance)


def _alone(arrival: Arrival, apart: int | None, tolerance: int) -> tuple[Header, UnpairedError]:
    mine, other = SIDES[arrival.side], SIDES[1 - arrival.side]
    nearest = "" if apart is None else f": the next one is {apart / 1e9:.3f} s later"
    stamp = arrival.header.stamp / 1e9

    return arrival.header, UnpairedError(
        f"the {mine} frame of {stamp:.3f} s has no {other} one within {tolerance / 1e9:g} s"
        f"{nearest}"
    )

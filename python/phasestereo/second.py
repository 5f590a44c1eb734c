"""The second map of a match: given, or made from the pair by another matcher."""

from __future__ import annotations

import atexit
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakSet

from numpy.typing import NDArray

from phasestereo._images import Map, as_array
from phasestereo._numbers import as_number
from phasestereo.matchers import OtherMatcher, load_matcher
from phasestereo.verification import as_claims

_TICK = 0.1  # s between checks for Ctrl-C
# s that an exit waits for abandoned matchers: a network answers within seconds, and what takes
# longer probably hangs.
_LEAVE = 10.0

_started: WeakSet[threading.Thread] = WeakSet()


@atexit.register
def _wait_for_abandoned() -> None:
    """Let native code return: C++ aborts a process whose interpreter ends beneath a thread."""
    end = time.monotonic() + _LEAVE
    for thread in list(_started):
        thread.join(max(end - time.monotonic(), 0))


def as_second(
    second: Any, timeout: float | None, size: tuple[int, ...]
) -> SecondMatcher | Map | None:
    """Return the second map of a match, or its source, as the core takes it.

    Parameters
    ----------
    second
        A map, or anything that `load_matcher` takes; None: no second map.
    timeout
        Time limit of a matcher; None: no limit.
    size
        Rows and columns of the left image.

    Raises
    ------
    TypeError, ValueError, OSError, ImportError
        As `phasestereo.matchers.load_matcher`; also for an array that is not a map of the left
        image, and for a wrong timeout.
    """
    if isinstance(second, str) or callable(second) or hasattr(second, "compute"):
        return as_second_matcher(second, timeout)
    if timeout is not None:
        as_number("timeout", timeout, positive=True)
    if second is None:
        if timeout is not None:
            raise ValueError("timeout: got one without a second matcher; accepts None then")
        return None
    return as_claims(as_array(second, "second"), size, "second")


def as_second_matcher(second: Any, timeout: float | None) -> SecondMatcher:
    """Return the second matcher of one match, or of all frames of a stream.

    Parameters
    ----------
    second
        Anything that `load_matcher` takes, or a `SecondMatcher`, which is returned unchanged.
    timeout
        Time limit in seconds; None: no limit, or the matcher's own.

    Raises
    ------
    TypeError, ValueError, OSError, ImportError
        As `phasestereo.matchers.load_matcher`; also for a wrong timeout.
    """
    seconds = None if timeout is None else as_number("timeout", timeout, positive=True)
    if isinstance(second, SecondMatcher) and seconds is None:
        return second
    try:
        return SecondMatcher(load_matcher(second), seconds)
    except (TypeError, ValueError) as error:
        raise type(error)(str(error).replace("matcher:", "second:", 1)) from error


@dataclass(slots=True)
class SecondMatcher:
    """A matcher as the core calls it: it returns a map, or the reason for its failure.

    While a call that took too long runs on, the next ones fail at once.

    Parameters
    ----------
    matcher
        The matcher.
    timeout
        Time limit in seconds; None: no limit.
    """

    matcher: OtherMatcher
    timeout: float | None
    _late: threading.Thread | None = field(default=None, init=False, repr=False)

    @property
    def name(self) -> str:
        """Its name in findings."""
        return self.matcher.name

    @property
    def max_disparity(self) -> int | None:
        """The largest disparity that it can return, in pixels; None: unknown."""
        return self.matcher.max_disparity

    def __call__(self, left: NDArray[Any], right: NDArray[Any], num_disparities: int) -> Map | str:
        """Return float32 (H, W), pixels, NaN without a disparity; or the reason for the failure."""
        try:
            return self._within(lambda: self.matcher(left, right, num_disparities))
        except Exception as error:  # noqa: BLE001 - whatever it raises, our own map stands
            return f"{type(error).__name__}: {error}"

    def _within(self, work: Callable[[], Map]) -> Map:
        """Run the work within the time limit; a thread that exceeds it is abandoned."""
        if self.timeout is None:
            return work()
        if self._late is not None and self._late.is_alive():
            raise TimeoutError("it is still at work on an earlier pair")

        found: list[Map | Exception] = []

        def run() -> None:
            try:
                found.append(work())
            except Exception as error:  # noqa: BLE001 - raised again by the waiting thread
                found.append(error)

        thread = threading.Thread(target=run, daemon=True, name="second matcher")
        _started.add(thread)  # from the start: Ctrl-C may end the wait for it
        thread.start()
        left = self.timeout
        while thread.is_alive() and left > 0:
            thread.join(min(_TICK, left))
            left -= _TICK
        if not found:
            self._late = thread
            raise TimeoutError(f"no answer within {self.timeout:g} s")
        if isinstance(found[0], Exception):
            raise found[0]
        return found[0]

"""Ctrl-C, kept out of what must not be half done, and of processes that are not to hear it."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def held_back() -> Iterator[None]:
    """Let a block end before Ctrl-C is heard; an error that ends it goes first.

    A mask would not do: the system hands a signal that one thread masks to another one, and Python
    then has the main thread hear it.
    """
    hear = signal.getsignal(signal.SIGINT)
    if not callable(hear) or threading.current_thread() is not threading.main_thread():
        yield  # nobody hears it, or not here
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, hear)
    if came:
        hear(came[0], None)


@contextmanager
def unheard() -> Iterator[None]:
    """Start threads and processes in a block which Ctrl-C does not reach, as long as they want.

    Systems without signal masks do not know that. This thread hears of it when the block ends.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

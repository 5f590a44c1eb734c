"""Ctrl-C, blocked for the processes that match: the one that started them ends them."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unheard() -> Iterator[None]:
    """Block Ctrl-C for the threads and processes that are started in a block of code.

    They inherit the signal mask and may lift it. What arrives in this thread meanwhile is handled
    when the block ends. Systems without signal masks (Windows) ignore this.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return

    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

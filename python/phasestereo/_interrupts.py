"""Ctrl-C, postponed where work must not stop halfway."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_postponed() -> Iterator[None]:
    """Postpone Ctrl-C to the end of a block; an exception that ends the block takes precedence.

    A signal mask would not work: the system delivers a signal that one thread masks to another
    thread, and Python still runs the handler in the main thread.
    """
    handler = signal.getsignal(signal.SIGINT)
    if not callable(handler) or threading.current_thread() is not threading.main_thread():
        yield  # nobody handles the signal, or another thread does
        return

    received: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if received:
        handler(received[0], None)

"""Ctrl-C, kept out of what must not be half done, and of what is not to hear it."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import signal
import threading
import time
from collections.abc import Iterator

import pytest

from phasestereo._interrupts import interrupts_postponed


@pytest.fixture(autouse=True)
def hearing() -> Iterator[None]:
    """Have Ctrl-C raise KeyboardInterrupt, and find that so after the test."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


@pytest.mark.parametrize("times", [1, 3])
def test_the_block_ends_before_it_is_heard(times: int) -> None:
    done = []

    def write() -> None:
        with interrupts_postponed():
            for number in range(times):
                signal.raise_signal(signal.SIGINT)
                done.append(number)
        pytest.fail("not heard after the block")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert done == [*range(times)]


def test_an_inner_block_leaves_it_to_the_outer_one() -> None:
    done = []

    def write() -> None:
        with interrupts_postponed():
            with interrupts_postponed():
                signal.raise_signal(signal.SIGINT)
            done.append("between")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert done == ["between"]


def test_nothing_is_heard_where_nothing_came() -> None:
    with interrupts_postponed():
        pass


def test_an_error_of_the_block_passes() -> None:
    def write() -> None:
        with interrupts_postponed():
            signal.raise_signal(signal.SIGINT)
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        write()


def test_a_process_that_ignores_it_goes_on_to() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_postponed():
        signal.raise_signal(signal.SIGINT)
    assert signal.signal(signal.SIGINT, signal.default_int_handler) == signal.SIG_IGN


def test_other_threads_leave_it_alone() -> None:
    found = []

    def block() -> None:
        with interrupts_postponed():
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=block)
    thread.start()
    thread.join()
    assert found == [signal.default_int_handler]


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="there are no signal masks")
def test_what_another_thread_hears_waits_for_the_block() -> None:
    done, ended = [], threading.Event()
    other = threading.Thread(target=ended.wait)
    other.start()

    def start() -> None:
        with interrupts_postponed():
            signal.pthread_kill(other.ident, signal.SIGINT)
            for number in range(3):  # Python runs its handlers between these
                time.sleep(0.02)
                done.append(number)

    with pytest.raises(KeyboardInterrupt):
        start()
    ended.set()
    other.join()
    assert done == [0, 1, 2]

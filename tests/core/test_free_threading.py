"""Threads that match, change arrays and drop results at the same time, with a GIL and without."""

import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import phasestereo as ps

ROUNDS, THREADS = 12, 4
FREE = not getattr(sys, "_is_gil_enabled", lambda: True)()

SCENE = np.random.default_rng(0).integers(0, 256, (50, 90), np.uint8)
LEFT, RIGHT = SCENE[:, :-4], SCENE[:, 4:]


@pytest.mark.skipif(not FREE, reason="this Python has a GIL; the workflow runs one that has none")
def test_the_package_leaves_the_gil_off() -> None:
    enabled: Callable[[], bool] = vars(sys)["_is_gil_enabled"]
    assert not enabled()  # after the import of this package and of NumPy


def run_all(targets: list[Any]) -> None:
    """Run functions in threads that begin together; raise what one of them raised."""
    raised: list[BaseException] = []
    barrier = threading.Barrier(len(targets))

    def run(target: Any) -> None:
        barrier.wait()
        try:
            target()
        except BaseException as error:  # noqa: BLE001 -- raised again in the thread of the test
            raised.append(error)

    threads = [threading.Thread(target=run, args=(target,)) for target in targets]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if raised:
        raise raised[0]


def test_threads_that_share_a_matcher_get_the_bits_of_one() -> None:
    matcher = ps.Matcher(preset="fast", threads=2)
    expected = {n: ps.match(LEFT, RIGHT, num_disparities=n, preset="fast") for n in (8, 16, 30)}
    results: deque[ps.Result] = deque(maxlen=3)  # older ones are dropped by whatever thread

    def match() -> None:
        for number in range(ROUNDS):
            count = (8, 16, 30)[number % 3]
            found = matcher.match(LEFT, RIGHT, num_disparities=count)
            np.testing.assert_array_equal(found.disparity, expected[count].disparity)
            np.testing.assert_array_equal(found.flags, expected[count].flags)
            results.append(found)

    run_all([match] * THREADS)


def test_arrays_may_change_while_others_match_them() -> None:
    """What comes out is of no use then, but something comes out."""
    left, right = LEFT.astype(np.float32), RIGHT.astype(np.float32)
    over = threading.Event()

    def match() -> None:
        try:
            for _ in range(ROUNDS):
                found = ps.match(left, right, num_disparities=16, preset="fast")
                assert found.disparity.shape == left.shape
        finally:
            over.set()

    def change() -> None:
        value = 0
        while not over.is_set():
            value += 1
            left[:] = value % 255
            right[::2] = LEFT[::2] + value % 7

    run_all([match, match, change])


def test_matchers_and_statistics_are_made_and_dropped_by_many_threads() -> None:
    def make() -> None:
        for number in range(ROUNDS // 2):
            matcher = ps.Matcher(preset=("fast", "robust")[number % 2], threads=1 + number % 2)
            matcher.match(LEFT, RIGHT, num_disparities=8)
            ps.estimate_blur(LEFT, RIGHT)
            with pytest.raises(ValueError, match=r"^right: "):
                matcher.match(LEFT, RIGHT[:1, :1], num_disparities=8)

    run_all([make] * THREADS)

"""Processes that work: one that is killed, hangs or cannot start costs its task alone."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import pytest

from phasestereo_large.processes import Processes, local


def result(processes: Processes, *task: Any) -> Any:
    processes.submit("a", *task)
    key, outcome = processes.finished()
    assert key == "a"
    return outcome()


def test_a_process_that_died_while_it_had_nothing_to_do_is_replaced() -> None:
    with local(1) as processes:
        for _ in range(3):
            os.kill(result(processes, os.getpid), signal.SIGKILL)
            time.sleep(0.3)


def test_a_process_that_dies_or_hangs_takes_nothing_else_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("phasestereo_large.processes._GRACE", 0.0)
    tasks: dict[str, tuple[Any, ...]] = {
        "killed": (signal.raise_signal, signal.SIGKILL),
        "left": (os._exit, 3),
        "hangs": (time.sleep, 1000),
        "fails": (int, "x"),
        "unknown": (lambda: 0,),
        **{str(number): (abs, -number) for number in range(6)},
    }

    found: dict[str, Any] = {}
    with local(2, seconds=2) as processes:
        for key, task in tasks.items():
            processes.submit(key, *task)
        for _ in tasks:
            key, outcome = processes.finished()
            try:
                found[key] = outcome()
            except Exception as error:  # noqa: BLE001 - all are looked at
                found[key] = f"{type(error).__name__}: {error}"

    assert "lambda" in found.pop("unknown")
    assert found == {
        "killed": "WorkerDiedError: its worker died: killed by SIGKILL, as when memory runs out",
        "left": "WorkerDiedError: its worker died: ended with exit code 3",
        "hangs": "TimeoutError: took longer than 2 s, and was ended",
        "fails": "ValueError: invalid literal for int() with base 10: 'x'",
        **{str(number): number for number in range(6)},
    }


def test_a_jump_of_the_clock_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with local(1, seconds=60) as processes:
        processes.submit("a", time.sleep, 0.5)
        now = time.time()
        monkeypatch.setattr(time, "time", lambda: now + 10**6)
        assert processes.finished()[1]() is None


def test_what_is_at_work_ends_with_the_block() -> None:
    with local(2) as processes:
        number = result(processes, os.getpid)
        for key in "abc":
            processes.submit(key, time.sleep, 1000)
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)

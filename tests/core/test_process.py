"""A match inside a process: signals, other threads, forks, memory."""

import os
import sys
import threading
import time

import numpy as np
import pytest

import phasestereo as ps
from support.processes import run

RNG = np.random.default_rng(0)
SMALL = RNG.integers(0, 256, (2, 40, 60), np.uint8)


INTERRUPTED = """
import _thread, threading, time
import numpy as np, phasestereo as ps
pair = np.random.default_rng(0).integers(0, 256, (2, 3000, 3000), np.uint8)
seen = []
def interrupt():
    while not seen:
        time.sleep(0.01)
    seen.append(time.monotonic())
    _thread.interrupt_main()
threading.Thread(target=interrupt).start()
try:
    ps.match(*pair, num_disparities=2000, progress=lambda *rows: seen.append(rows))
except KeyboardInterrupt:
    asked = next(moment for moment in seen if isinstance(moment, float))
    print(time.monotonic() - asked)
"""


SIGNALED = "import os, signal\n" + INTERRUPTED.replace(
    "_thread.interrupt_main()", "os.kill(os.getpid(), signal.SIGINT)"
)


@pytest.mark.parametrize(
    "code",
    [
        INTERRUPTED,
        INTERRUPTED.replace("num_disparities=2000", "num_disparities=1000, window=63"),
        pytest.param(SIGNALED, marks=pytest.mark.skipif(os.name == "nt", reason="no such signals")),
    ],
    ids=["long", "while a large window warms up", "by the system"],
)
def test_ctrl_c_stops_a_long_match_within_a_second(code: str) -> None:
    finished = run(code)
    assert finished.returncode == 0, finished.stderr
    # A second is promised to the user; a busy machine may take its time to schedule the threads.
    assert float(finished.stdout) < 5


def test_other_python_threads_run_during_a_match() -> None:
    pair = RNG.integers(0, 256, (2, 600, 800), np.uint8)
    match = threading.Thread(target=lambda: ps.match(*pair, num_disparities=256, threads=1))
    match.start()

    steps = 0
    while match.is_alive():
        time.sleep(0.001)
        steps += 1

    assert steps > 20, "the interpreter was held"


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted as Linux lists them")
def test_the_environment_may_limit_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = RNG.integers(0, 256, (2, 500, 800), np.uint8)

    def most_threads() -> int:
        seen: list[int] = []
        count = lambda *_: seen.append(len(os.listdir("/proc/self/task")))  # noqa: E731, PTH208  # names are all we want
        ps.match(*pair, num_disparities=256, progress=count)
        return max(seen)

    monkeypatch.setenv("RAYON_NUM_THREADS", "1")
    alone = most_threads()
    monkeypatch.setenv("RAYON_NUM_THREADS", "5")
    assert most_threads() == alone + 4


def test_progress_is_reported_to_the_end() -> None:
    calls: list[tuple[int, int]] = []
    pair = RNG.integers(0, 256, (2, 300, 400), np.uint8)
    ps.match(*pair, num_disparities=128, progress=lambda *call: calls.append(call))
    assert calls[-1] == (300, 300)
    assert calls == sorted(calls)


def test_what_progress_raises_ends_the_match() -> None:
    def stop(done: int, rows: int) -> None:
        raise LookupError(f"{done} of {rows}")

    with pytest.raises(LookupError, match="of 40"):
        ps.match(*SMALL, num_disparities=8, progress=stop)


def test_writing_into_an_image_during_its_match_is_safe() -> None:
    pair = RNG.integers(0, 256, (2, 300, 400), np.uint8)
    expected = ps.match(*pair, num_disparities=64).disparity
    left = pair[0].copy()

    def scribble(*_: int) -> None:
        left[:] = 0

    found = ps.match(left, pair[1], num_disparities=64, progress=scribble).disparity
    np.testing.assert_array_equal(found, expected)


MEMORY_CASES = {
    "disparities": "ps.match(wide, wide, num_disparities=16384, optimizer='dp', threads=1)",
    "masks": "ps.match(wide, wide, num_disparities=8192, left_mask=wide == 0, optimizer='dp')",
    "neighborhood": "ps.descriptor(long, neighborhood=63, frequencies=(4, 4), bits=1, threads=1)",
    "image": "ps.match(broad, broad, num_disparities=1, preset='paper', threads=1)",
    "estimation": "ps.match(vast, vast, num_disparities=1, threads=1)",
    "volume": "ps.cost_volume(tall, tall, num_disparities=512, threads=1)",
    "costs": "ps.aggregate(np.zeros((2000, 500, 400), np.uint16))",
    "aggregated": "ps.optimize(np.zeros((2000, 500, 150), np.uint32), p1=1, p2=1)",
}


@pytest.mark.skipif(sys.platform != "linux", reason="limits of address space are Linux's")
@pytest.mark.parametrize("case", MEMORY_CASES)
def test_memory_that_cannot_be_had_is_a_memory_error(case: str) -> None:
    finished = run(f"""
import re, resource
import numpy as np, phasestereo as ps
wide, long = np.zeros((4, 16384), np.uint8), np.zeros((1, 4_000_000), np.uint8)
tall = np.zeros((2000, 600), np.uint8)
broad = np.random.default_rng(0).random((5000, 5000), np.float32)  # of no narrower type
vast = np.zeros((11000, 11000), np.uint8)
ps.match(wide[:, :64], wide[:, :64], num_disparities=4, threads=1)
used = int(re.search(r"VmSize:\\s+(\\d+)", open("/proc/self/status").read())[1]) << 10
limit = used + (1 << 29)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    {MEMORY_CASES[case]}
except MemoryError:
    print("refused")
""")

    assert (finished.returncode, finished.stdout.strip()) == (0, "refused"), finished.stderr


FORKED_MEANWHILE = """
import os, signal, threading, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 advises against it
import numpy as np, phasestereo as ps
pair = np.random.default_rng(0).integers(0, 256, (2, 400, 600), np.uint8)
match = threading.Thread(target=lambda: ps.match(*pair, num_disparities=128))
match.start()
child = os.fork()
if child == 0:
    signal.alarm(20)
    ps.match(*pair[:, :40, :60], num_disparities=8)
    os._exit(0)
_, status = os.waitpid(child, 0)
match.join()
raise SystemExit(os.waitstatus_to_exitcode(status))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_child_forked_during_the_first_match_matches() -> None:
    for _ in range(3):
        finished = run(FORKED_MEANWHILE)
        assert finished.returncode == 0, finished.stderr

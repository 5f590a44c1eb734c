"""Threads and memory that matches share or keep: reuse, overlap, forks, pickles, what is left."""

import os
import pickle
import sys
from inspect import signature
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.settings import PresetName
from support.processes import return_memory_at_once, run

RNG = np.random.default_rng(0)
SIZES = [(40, 60), (150, 90), (3, 200), (40, 60), (1, 1), (97, 131)]
PAIRS = [RNG.integers(0, 256, (2, *size), np.uint8) for size in SIZES]
PRESETS = list(ps.PRESETS)
BYTES_TO_WIDEST: list[dict[str, Any]] = [
    {"preset": "robust"},
    {"preset": "fast"},
    {"preset": "paper"},
    {"preset": "fast", "precision": "full", "confidence": True},
    {"preset": "paper", "cost": "sad", "p1": 15, "p2": 15},
    {"preset": "paper", "cost": "sad", "window": 1, "optimizer": "wta"},
]

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="read from /proc of Linux")
forking = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")


def count(pair: Any) -> int:
    """Return the number of disparities to search for a pair."""
    return min(24, int(pair.shape[2]))


def assert_equal(found: ps.Result, expected: ps.Result) -> None:
    """Check that two results are the same to the bit."""
    for field in ("disparity", "flags", "confidence"):
        ours, theirs = getattr(found, field), getattr(expected, field)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(ours, theirs)
    assert found.settings == expected.settings


@pytest.mark.parametrize("options", BYTES_TO_WIDEST, ids=str)
def test_a_matcher_gives_what_match_gives_whatever_it_matched_before(
    options: dict[str, Any],
) -> None:
    matcher = ps.Matcher(**options, threads=2)
    for pair in (*PAIRS, *reversed(PAIRS)):
        found = matcher.match(*pair, num_disparities=count(pair))
        assert_equal(found, ps.match(*pair, num_disparities=count(pair), **options))


@pytest.mark.parametrize("preset", PRESETS)
def test_a_matcher_takes_ranges_masks_and_progress(preset: PresetName) -> None:
    (left, right), calls = PAIRS[1], []
    options: dict[str, Any] = {"num_disparities": 9, "min_disparity": -4}
    masked: dict[str, Any] = options | {"left_mask": left > 50, "right_mask": right > 50}

    matcher = ps.Matcher(preset=preset)
    plain = matcher.match(left, right, **options)

    found = matcher.match(left, right, **masked, progress=lambda *rows: calls.append(rows))
    assert_equal(found, ps.match(left, right, **masked, preset=preset))
    assert calls[-1] == (150, 150)
    assert_equal(matcher.match(left, right, **options), plain)


def test_a_matcher_tells_what_it_was_made_of() -> None:
    matcher = ps.Matcher(settings=ps.Settings(uniqueness=3), window=5, threads=3)
    assert (matcher.settings, matcher.threads) == (ps.Settings(uniqueness=3, window=5), 3)
    assert "uniqueness=3" in repr(matcher)
    assert "threads=3" in repr(matcher)

    assert ps.Matcher().settings == ps.match(*PAIRS[0], num_disparities=2).settings

    ours, theirs = signature(ps.Matcher).parameters, signature(ps.match).parameters
    for name in ("preset", "settings", "threads"):
        assert ours[name] == theirs[name]

    ours = signature(ps.Matcher.match).parameters
    of_videos = {"self", "temporal_filter"}
    of_one_pair = {"right_map"}
    found = {*ours, *signature(ps.Matcher).parameters}
    assert found == {*of_videos, *theirs} - of_one_pair
    for name in set(ours) - of_videos:
        assert ours[name] == theirs[name]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"preset": "slow"}, ValueError, "^preset: got 'slow'"),
        ({"window": 4}, ValueError, "^window: got 4"),
        ({"windows": 5}, TypeError, "^windows: no such setting"),
        ({"threads": 0}, ValueError, "^threads: got 0; accepts an integer from 1 to 1024"),
        ({"threads": 2.0}, TypeError, "^threads: got float"),
        ({"num_disparities": 4}, TypeError, "^num_disparities: no such setting"),
    ],
)
def test_a_matcher_refuses_what_match_refuses(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        ps.Matcher(**options)


def test_a_matcher_survives_what_it_refuses() -> None:
    matcher, pair = ps.Matcher(preset="fast"), PAIRS[1]

    expected = matcher.match(*pair, num_disparities=9)

    def stop(*_: int) -> None:
        raise LookupError

    for error, options in [
        (ValueError, {"num_disparities": 1000}),
        (TypeError, {"num_disparities": 9, "progress": 3}),
        (LookupError, {"num_disparities": 9, "progress": stop}),
    ]:
        with pytest.raises(error):
            matcher.match(*pair, **options)  # type: ignore[arg-type]  # that is the point
        assert_equal(matcher.match(*pair, num_disparities=9), expected)


def test_a_matcher_travels() -> None:
    matcher = ps.Matcher(preset="fast", window=7, threads=3)
    expected = matcher.match(*PAIRS[0], num_disparities=9)
    copy = pickle.loads(pickle.dumps(matcher))  # noqa: S301  # our own bytes
    assert (copy.settings, copy.threads) == (matcher.settings, 3)
    assert_equal(copy.match(*PAIRS[0], num_disparities=9), expected)
    assert_equal(matcher.match(*PAIRS[0], num_disparities=9), expected)


# Threads


THREADS = """
import os, threading, time
os.environ |= {"RAYON_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "1"}
import numpy as np, phasestereo as ps
pair = np.random.default_rng(0).integers(0, 256, (2, 40, 60), np.uint8)
def threads():
    return len(os.listdir("/proc/self/task"))
def at_rest():
    # A listing that is read while threads end may miss others.
    counts = [threads()]
    while counts[-20:] != [counts[-1]] * 20:
        time.sleep(0.01)
        counts.append(threads())
    return counts[-1]
"""

TOGETHER = """
pair = np.random.default_rng(0).integers(0, 256, (2, 200, 300), np.uint8)
def most_threads(call):
    ready = threading.Barrier(11)
    def work():
        ready.wait()
        for _ in range(8):
            call()
    callers = [threading.Thread(target=work) for _ in range(10)]
    for caller in callers:
        caller.start()
    before, seen = at_rest(), [0]
    ready.wait()
    while any(caller.is_alive() for caller in callers):
        seen.append(threads())
        time.sleep(0.001)
    return max(seen) - before
assert most_threads(lambda: ps.match(*pair, num_disparities=64)) == 2
assert most_threads(lambda: ps.match(*pair, num_disparities=64, threads=3)) > 12
matcher = ps.Matcher()
assert most_threads(lambda: matcher.match(*pair, num_disparities=64)) <= 0
"""


@on_linux
def test_matches_at_the_same_time_share_their_threads() -> None:
    finished = run(THREADS + TOGETHER, timeout=300)
    assert finished.returncode == 0, finished.stderr


SETTLED = """
def settled(more):
    for _ in range(500):
        if threads() == before + more:
            return True
        time.sleep(0.01)
before = threads()
"""


@on_linux
def test_threads_stay_for_the_next_match_until_they_are_released() -> None:
    finished = run(
        THREADS
        + SETTLED
        + """
for _ in range(3):
    ps.match(*pair, num_disparities=8, threads=4)
    assert settled(4), "own"
ps.match(*pair, num_disparities=8, threads=3)
assert settled(3), "own, another number"
ps.match(*pair, num_disparities=8)
assert settled(3 + 2), "shared"
ps.release_memory()
assert settled(0), "released"
ps.match(*pair, num_disparities=8)
if hasattr(os, "fork"):
    if os.fork() == 0:
        os._exit(0)
    assert settled(0), "forked"
ps.match(*pair, num_disparities=8)
matcher = ps.Matcher(threads=4)
ps.release_memory()
assert settled(4), "a matcher"
for _ in range(3):
    matcher.match(*pair, num_disparities=8)
    assert settled(4), "a matcher"
del matcher
assert settled(0), "without the matcher"
"""
    )

    assert finished.returncode == 0, finished.stderr


def test_a_match_that_waits_for_others_can_be_interrupted() -> None:
    finished = run("""
import _thread, os, threading, time
os.environ["RAYON_NUM_THREADS"] = "1"
import numpy as np, phasestereo as ps
pair = np.random.default_rng(0).integers(0, 256, (2, 1000, 1500), np.uint8)
begun, over = threading.Event(), threading.Event()
def occupy():
    def stop(*rows):
        begun.set()
        if over.is_set():
            raise LookupError
    try:
        ps.match(*pair, num_disparities=1500, window=63, progress=stop)
    except LookupError:
        pass
threads = [threading.Thread(target=occupy) for _ in range(70)]
for thread in threads:
    thread.start()
begun.wait()
time.sleep(0.5)
threading.Timer(0.5, _thread.interrupt_main).start()
start = time.monotonic()
try:
    ps.match(*pair, num_disparities=1500, window=63)
except KeyboardInterrupt:
    print(time.monotonic() - start)
over.set()
for thread in threads:
    thread.join()
""")

    assert finished.returncode == 0, finished.stderr
    assert float(finished.stdout) < 10


# Forks


FORKED = """
import os, signal, threading, time, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 advises against it
import numpy as np, phasestereo as ps
pair = np.random.default_rng(0).integers(0, 256, (2, 400, 600), np.uint8)
small = pair[:, :40, :60]
matcher = ps.Matcher(preset="fast", threads=3)
unused = ps.Matcher(threads=2)
expected = matcher.match(*small, num_disparities=8)
def check():
    for found in (
        matcher.match(*small, num_disparities=8),
        matcher.match(*small, num_disparities=8),
        ps.match(*small, num_disparities=8, preset="fast"),
        ps.match(*small, num_disparities=8, preset="fast", threads=2),
    ):
        assert (found.disparity == expected.disparity).all()
def forked(work):
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        try:
            work()
            os._exit(0)
        except BaseException as error:
            print(repr(error), flush=True)
            os._exit(3)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0, status
"""


@forking
@pytest.mark.parametrize(
    "code",
    [
        "forked(check)",
        "forked(lambda: (check(), forked(check), check()))",
        "forked(lambda: globals().pop('unused') and None)",
        "forked(lambda: (check(), globals().pop('matcher')) and None)",
        "def leave():\n    global matcher, unused\n    del matcher, unused\nforked(leave)",
    ],
)
def test_a_forked_child_has_threads_of_its_own(code: str) -> None:
    finished = run(FORKED + code + "\ncheck()")
    assert finished.returncode == 0, finished.stderr + finished.stdout


@forking
def test_children_forked_at_any_moment_match() -> None:
    finished = run(
        FORKED
        + """
stop = threading.Event()
def busy(work):
    while not stop.is_set():
        work()
threads = [threading.Thread(target=busy, args=[work]) for work in (
    lambda: ps.match(*pair, num_disparities=64, preset="fast"),
    lambda: ps.match(*small, num_disparities=8, preset="fast"),
    lambda: matcher.match(*pair, num_disparities=64),
    lambda: matcher.match(*small, num_disparities=8),
    lambda: ps.Matcher(threads=2).match(*small, num_disparities=8),
)]
for thread in threads:
    thread.start()
try:
    for moment in range(30):
        time.sleep(0.001 * moment)
        forked(check)
finally:
    stop.set()
    for thread in threads:
        thread.join()
check()
""",
    )
    assert finished.returncode == 0, finished.stderr + finished.stdout


# Memory

RESIDENT = """
import gc, re
import numpy as np, phasestereo as ps
def resident():
    gc.collect()
    return int(re.search(r"VmRSS:\\s+(\\d+)", open("/proc/self/status").read())[1]) << 10
rng = np.random.default_rng(0)
large = rng.integers(0, 256, (2, 300, 1600), np.uint8)
small = rng.integers(0, 256, (2, 60, 200), np.uint8)
"""


@on_linux
@pytest.mark.parametrize("preset", PRESETS)
def test_memory_does_not_grow_from_match_to_match(
    monkeypatch: pytest.MonkeyPatch, preset: PresetName
) -> None:
    return_memory_at_once(monkeypatch)
    finished = run(
        RESIDENT
        + f"""
matcher = ps.Matcher(preset={preset!r}, threads=2)
def turn():
    matcher.match(*large, num_disparities=64)
    matcher.match(*small, num_disparities=32)
    ps.match(*small, num_disparities=32, preset={preset!r}, threads=2)
for _ in range(5):
    turn()
before = resident()
for _ in range(30):
    turn()
print(resident() - before)
"""
    )

    assert finished.returncode == 0, finished.stderr
    # One match takes more than that.
    assert int(finished.stdout) < 10 << 20


@on_linux
def test_match_keeps_bounded_memory_until_it_is_released_and_a_matcher_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    return_memory_at_once(monkeypatch)
    finished = run(
        RESIDENT
        + """
huge = rng.integers(0, 256, (2, 64, 9000), np.uint8)
ps.match(*small, num_disparities=32)
before = resident()
ps.match(*large, num_disparities=700, preset="fast", threads=1)
print(resident() - before)
ps.match(*huge, num_disparities=8000, preset="fast", precision="full", threads=1)
print(resident() - before)
ps.match(*large, num_disparities=700, preset="fast", threads=1)
ps.release_memory()
print(resident() - before)
matcher = ps.Matcher(preset="fast", precision="full", threads=1)
matcher.match(*huge, num_disparities=8000)
print(resident() - before)
del matcher
print(resident() - before)
"""
    )

    assert finished.returncode == 0, finished.stderr
    few, too_many, released, of_matcher, without = map(int, finished.stdout.split())
    assert few > 4 << 20
    assert max(too_many, released, without) < 4 << 20
    assert of_matcher > 64 << 20


NO_THREADS = """
import os, pickle, resource
import numpy as np
import phasestereo as ps

calls = {
    "match": lambda: ps.match(*pair), "check": lambda: ps.check(*pair),
    "Matcher": ps.Matcher, "Rig": ps.Rig, "load": lambda: pickle.loads(saved),
}
pair = np.random.default_rng(0).integers(0, 256, (2, 60, 90), np.uint8)
rig = ps.Rig(threads=1)
rig.match(*pair)
saved = pickle.dumps(rig)
ps.release_memory()
if os.getuid() == 0:  # whose processes are not limited
    os.setuid(65534)
resource.setrlimit(resource.RLIMIT_NPROC, (0, 0))
for name, call in calls.items():
    try:
        call()
    except RuntimeError as error:
        print(name, error)
"""


@on_linux
def test_threads_that_cannot_be_started_are_an_exception() -> None:
    done = run(NO_THREADS)
    said = [line.partition(" threads: could not start them") for line in done.stdout.splitlines()]
    assert [name for name, found, _ in said if found] == [
        "match",
        "check",
        "Matcher",
        "Rig",
        "load",
    ]

"""A long run through one `Matcher`: changing sizes, several threads, faults; what is left of it.

    python benches/soak.py [--seconds 300] [--threads 3] [--seed 0]

Threads hand pairs of changing sizes and settings to one `Matcher` each preset. Among them are
faults: frames that are NaN all over, images of different sizes, types that are refused, a progress
that ends the match, and matches for which memory is refused (on Linux, by a limit on the address
space, in processes of their own). Some results are compared with those of fresh matches, bit for
bit. Prints the numbers of frames, faults and differences, and the resident memory after each tenth
of the time. The exit code is 1 if a bit differed, a fault went unnoticed, or memory grew by more
than 32 MB after the third tenth.
"""

from __future__ import annotations

import argparse
import gc
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from typing import Any

import numpy as np

import phasestereo as ps
from phasestereo_large.outofcore.plan import resident

SIZES = (37, 64, 120, 181, 240, 333)
PRESETS = "robust", "fast", "paper"
GROWTH = 32 * 10**6  # bytes that measuring may be wrong by: allocators keep some for each thread
EVERY = 40  # frames of which one is compared
SHORT = """
import resource, sys
import numpy as np, phasestereo as ps
image = np.random.default_rng(0).integers(0, 256, (1200, 1600), np.uint8)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 40_000_000,) * 2)
try:
    ps.match(image, image, num_disparities=256, threads=1)
except MemoryError:
    sys.exit(3)
"""


class FaultError(Exception):
    """What a progress raises."""


def pair(chance: random.Random) -> tuple[Any, Any]:
    """Return two views of noise, of any size and type."""
    height, width = chance.choice(SIZES), chance.choice(SIZES)
    samples = np.random.default_rng(chance.randrange(2**32))
    shape = (height, width + 7, *chance.choice(((), (3,))))
    scene = samples.integers(0, 256, shape, np.uint8).astype(chance.choice(("u1", "u2", "f4")))
    return scene[:, :-7], scene[:, 7:]


def fault(matcher: ps.Matcher, chance: random.Random) -> str:
    """Do something that must be refused, or survived; return what, and whether it was."""
    left, right = pair(chance)
    kind = chance.choice(("nan", "size", "type", "interrupt"))

    def end(*_: int) -> None:
        raise FaultError

    options: dict[str, Any] = {"num_disparities": 16}
    if kind == "nan":
        left, right = np.full(left.shape[:2], np.nan, "f4"), np.zeros(left.shape[:2], "f4")
    elif kind == "size":
        right = right[:-1]
    elif kind == "type":
        left = left.astype("i4")
    else:
        options["progress"] = end
    try:
        matcher.match(left, right, **options)
    except (FaultError, ValueError, TypeError):
        return kind
    return kind if kind == "nan" else f"unnoticed {kind}"


def frames(matchers: dict[str, ps.Matcher], seed: int, end: float, told: Counter[str]) -> None:
    """Match until the time is over; count into `told`, which is this thread's own."""
    chance = random.Random(seed)  # noqa: S311 -- no secret
    while time.monotonic() < end:
        preset = chance.choice(PRESETS)
        if chance.random() < 0.1:
            told[f"fault: {fault(matchers[preset], chance)}"] += 1
            continue
        left, right = pair(chance)
        count = chance.choice((1, 8, 16, 30))
        found = matchers[preset].match(left, right, num_disparities=count)
        told["frames"] += 1
        if told["frames"] % EVERY == 0:
            fresh = ps.match(left, right, num_disparities=count, preset=preset, threads=1)
            same = np.array_equal(found.disparity, fresh.disparity, equal_nan=True)
            told["compared"] += 1
            told["differing"] += not (same and np.array_equal(found.flags, fresh.flags))


def short_of_memory(end: float, told: Counter[str]) -> None:
    """Have memory refused to matches in processes of their own, one now and then."""
    while sys.platform == "linux" and time.monotonic() < end:
        done = subprocess.run([sys.executable, "-c", SHORT], check=False, capture_output=True)  # noqa: S603
        outcome = {3: "refused", 0: "enough"}.get(done.returncode, "ended the process")
        told[f"memory: {outcome}"] += 1
        time.sleep(min(10.0, max(0.0, end - time.monotonic())))


def main() -> int:
    """Soak, and say what came of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--threads", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    matchers = {preset: ps.Matcher(preset=preset) for preset in PRESETS}
    started = time.monotonic()
    end, told = started + given.seconds, [Counter[str]() for _ in range(given.threads + 1)]
    threads = [
        threading.Thread(target=frames, args=(matchers, given.seed + number, end, told[number]))
        for number in range(given.threads)
    ]
    threads.append(threading.Thread(target=short_of_memory, args=(end, told[-1])))
    for thread in threads:
        thread.start()
    levels = []
    for tenth in range(1, 11):
        time.sleep(max(0.0, started + tenth * given.seconds / 10 - time.monotonic()))
        gc.collect()
        levels.append(resident())
    for thread in threads:
        thread.join()
    grown = levels[-1] - levels[2]
    every = sum(told, Counter())
    for name, count in sorted(every.items()):
        print(f"{name}: {count}")  # noqa: T201
    seconds = time.monotonic() - started
    print(  # noqa: T201
        f"{seconds:.0f} s on {given.threads} threads; MB resident after each tenth of the time: "
        + " ".join(f"{level / 1e6:.1f}" for level in levels)
    )
    wrong = every["differing"] + sum(n for name, n in every.items() if "unnoticed" in name)
    return int(wrong > 0 or grown > GROWTH)


if __name__ == "__main__":
    sys.exit(main())

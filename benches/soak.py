"""A long run of matchers, a rig and the viewer, with faults; what is left of it.

    python benches/soak.py [--seconds 300] [--threads 3] [--seed 0]

- Threads hand pairs of changing sizes and settings to one `Matcher` each preset. Among them are
  faults: frames that are NaN all over, images of different sizes, types that are refused, a
  progress that ends the match, and matches for which memory is refused (on Linux, by a limit on the
  address space, in processes of their own). Some results are compared with those of fresh matches,
  bit for bit.
- A stream, whose `Rig` is bumped and sees bad frames, is shown by the viewer. Browsers ask for all
  that there is; others say nothing, say nonsense, or leave in the middle.
- A `Rig` is saved and loaded now and then: both match the next frames to the same bits.

Prints the numbers of frames, faults and differences, and memory, threads and descriptors after each
tenth of the time. The exit code is 1 if a bit differed, a fault went unnoticed, memory grew by more
than 32 MB after the third tenth, or threads or descriptors are left at the end.
"""

from __future__ import annotations

import argparse
import gc
import random
import subprocess
import sys
import threading
import time
import warnings
from collections import Counter
from contextlib import suppress
from http.client import HTTPConnection, HTTPException
from http.cookies import SimpleCookie
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

import phasestereo as ps
import phasestereo_live
from phasestereo_large.outofcore.plan import resident
from phasestereo_live.viewer import Display, Server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SIZES = (37, 64, 120, 181, 240, 333)
PRESETS = "robust", "fast", "paper"
GROWTH = 32 * 10**6  # bytes that measuring may be wrong by: allocators keep some for each thread
EVERY = 40  # frames of which one is compared
SHORT = """
import resource, sys
import numpy as np, phasestereo as ps
image = np.random.default_rng(0).integers(0, 256, (2400, 3200), np.uint8)
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
    """Try something that must be refused, or survived; return it, and whether it was."""
    left, right = pair(chance)
    kind = chance.choice(("nan", "size", "type", "interrupt"))

    def end(*_: int) -> None:
        raise FaultError

    options: dict[str, Any] = {"num_disparities": 16}
    if kind == "nan":
        left, right = np.full(left.shape[:2], np.nan, "f4"), np.zeros(left.shape[:2], "f4")
    elif kind == "size":
        right = right[:3]  # further apart than other resolutions of a view
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


def filmed(chance: random.Random, end: float) -> Iterator[tuple[Any, Any]]:
    """Yield what two cameras see: one of them is bumped, darkens or fails now and then."""
    samples = np.random.default_rng(chance.randrange(2**32))
    scene = np.kron(samples.integers(0, 256, (45, 70), np.uint8), np.ones((4, 4), np.uint8))
    rows, dark, number = 2, 1.0, 0
    while time.monotonic() < end:
        number += 1
        if number % 200 == 0:
            rows = chance.choice((0, 1, 2, 3, 4))
        if number % 150 == 0:
            dark = chance.choice((0.3, 0.6, 1.0))
        noise = samples.integers(0, 5, (2, 160, 240), np.uint8)
        left = scene[2:162, 20:260] // 2 + noise[0]
        right = (scene[rows : rows + 160, 27:267] // 2 * dark).astype(np.uint8) + noise[1]
        bad = chance.random()
        if bad < 0.01:
            right = right[:-1]
        elif bad < 0.02:
            left = np.full(left.shape, np.nan, np.float32)
        yield left, right


def a_rig(seed: int, end: float, told: Counter[str], folder: Path) -> None:
    """Match frames by a rig; one that was saved and loaded goes on as this one does."""
    chance, path = random.Random(seed), folder / "rig.txt"  # noqa: S311 -- no secret
    rig, other = ps.Rig(preset="fast", num_disparities=24), None
    for number, (left, right) in enumerate(filmed(chance, end)):
        try:
            found = rig.match(left, right)
        except (TypeError, ValueError):
            told["rig: refused"] += 1
            other = None
            continue
        told["rig: frames"] += 1
        if other is not None:
            again = other.match(left, right)
            told["compared"] += 1
            told["differing"] += found.disparity.tobytes() != again.disparity.tobytes()
            other = None
        if number % EVERY == 0:
            rig.save(path)
            other = ps.Rig.load(path, preset="fast", num_disparities=24)
    told["rig: events"] += len(rig.events)


def a_viewer(seed: int, end: float, told: Counter[str], folder: Path) -> None:
    """Show a stream to browsers that behave, and to others."""
    show = Display(ps.PRESETS["fast"], 24, folder)
    with Server(show) as server:
        looking = threading.Thread(target=browsers, args=(server.address, seed, end, told))
        looking.start()
        frames = filmed(random.Random(seed), end)  # noqa: S311 -- no secret
        with phasestereo_live.stream(
            frames, num_disparities=24, preset="fast", on_error=show.fail
        ) as stream:
            for frame in stream:
                show.add(frame)
                told["viewer: frames"] += 1
        show.end("the soak is over")
        show.close()
        looking.join()


def browsers(address: str, seed: int, end: float, told: Counter[str]) -> None:
    """Ask for what there is, say nothing, or nonsense, or leave before the answer."""
    chance = random.Random(seed)  # noqa: S311 -- no secret
    host, key = address.removeprefix("http://").split("/")
    idle: list[HTTPConnection] = []
    room, cookie = let_in(host, key)
    paths = "", "viewer.js", "state?after=-1", "value?x=9&y=9", "left.jpg", "disparity.png"
    while time.monotonic() < end:
        connection = HTTPConnection(host, timeout=30)
        kind = chance.choice(("asks", "asks", "asks", "is silent", "is unknown", "leaves"))
        told[f"viewer: a browser {kind}"] += 1
        with suppress(OSError, HTTPException):  # as a connection that had to make room
            if kind == "is silent":
                connection.connect()
                idle.append(connection)
            else:
                headers = {} if kind == "is unknown" else {"Cookie": cookie}
                connection.request("GET", f"{room}{chance.choice(paths)}", headers=headers)
                if kind != "leaves":
                    answer = connection.getresponse()
                    answer.read()
                    told[f"viewer: {kind}, {answer.status}"] += 1
        if connection not in idle:
            connection.close()
        if len(idle) > 100:
            idle.pop(0).close()
        time.sleep(0.02)
    for connection in idle:
        connection.close()


def let_in(host: str, key: str) -> tuple[str, str]:
    """Return the room that a key leads to, and the cookie for it."""
    connection = HTTPConnection(host, timeout=30)
    connection.request("GET", f"/{key}")
    answer = connection.getresponse()
    page = answer.read().decode()
    connection.close()
    ((name, morsel),) = SimpleCookie(answer.headers["Set-Cookie"]).items()
    assert page  # noqa: S101 -- which leads to the room
    return morsel["path"], f"{name}={morsel.value}"


def descriptors() -> int:
    """Return the number of open files and connections; 0 where the system does not say."""
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.exists() else 0


def main() -> int:
    """Soak, and say what came of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--threads", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    warnings.simplefilter("ignore", ps.MatchWarning)  # of noise
    matchers = {preset: ps.Matcher(preset=preset) for preset in PRESETS}
    match_once(matchers)
    before = threading.active_count(), descriptors()

    started = time.monotonic()
    end, told = started + given.seconds, [Counter[str]() for _ in range(given.threads + 3)]
    levels: list[tuple[float, int, int]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        works: list[tuple[Callable[..., None], tuple[Any, ...]]] = [
            (short_of_memory, (end, told[-1])),
            (a_rig, (given.seed, end, told[-2], folder)),
            (a_viewer, (given.seed, end, told[-3], folder)),
        ]
        works.extend(
            (frames, (matchers, given.seed + at, end, told[at])) for at in range(given.threads)
        )
        threads = [threading.Thread(target=work, args=args) for work, args in works]
        for thread in threads:
            thread.start()
        for tenth in range(1, 11):
            time.sleep(max(0.0, started + tenth * given.seconds / 10 - time.monotonic()))
            gc.collect()
            levels.append((resident() / 1e6, threading.active_count(), descriptors()))
        for thread in threads:
            thread.join()
    after = settled(before)

    every = sum(told, Counter())
    for name, count in sorted(every.items()):
        print(f"{name}: {count}")  # noqa: T201
    seconds = time.monotonic() - started
    print(f"{seconds:.0f} s; MB, threads, descriptors after each tenth of the time:")  # noqa: T201
    print(" ".join(f"{megabytes:.1f},{many},{open_}" for megabytes, many, open_ in levels))  # noqa: T201
    print(f"threads, descriptors before {before}, after {after}")  # noqa: T201
    wrong = every["differing"] + sum(n for name, n in every.items() if "unnoticed" in name)
    grown = 1e6 * (levels[-1][0] - levels[2][0])
    return int(wrong > 0 or grown > GROWTH or is_more(after, before))


def match_once(matchers: dict[str, ps.Matcher]) -> None:
    """Start the threads that last."""
    for matcher in matchers.values():
        matcher.match(*pair(random.Random(0)), num_disparities=8)  # noqa: S311 -- no secret


def settled(before: tuple[int, int]) -> tuple[int, int]:
    """Return threads and descriptors once those of connections that were closed have gone."""
    until = time.monotonic() + 30
    while True:
        after = threading.active_count(), descriptors()
        if not is_more(after, before) or time.monotonic() > until:
            return after
        time.sleep(0.1)


def is_more(after: tuple[int, int], before: tuple[int, int]) -> bool:
    """Return whether either count has grown."""
    return after[0] > before[0] or after[1] > before[1]


if __name__ == "__main__":
    sys.exit(main())

"""The speed benchmark: who takes part, in which turns, what is recorded, what tables show."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import copy
import os
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pytest

from phasestereo import _core, io
from phasestereo.settings import PRESETS
from phasestereo_bench import read_store, run_jobs, speed as bench
from phasestereo_bench.environment import usable_cpus
from phasestereo_bench.speed import GrayPair, contenders, memory, records, results, rounds
from phasestereo_bench.speed.rounds import pinned
from phasestereo_bench.tables import table_texts
from support import Run

cv2 = pytest.importorskip("cv2")

RIVALS = ["opencv:bm", "opencv:bm-unchecked", "opencv:sgbm-3way", "match"]
WEIGHT = {"peak_bytes": 3_000_000, "result_bytes": 1_000_000, "first_call": 1.25}

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="no affinity of threads elsewhere")


@pytest.fixture
def pair() -> GrayPair:
    noise = np.random.default_rng(0).integers(0, 256, (40, 80), dtype=np.uint8)
    return bench.GrayPair("tiny", noise[:, :-5].copy(), noise[:, 5:].copy(), 16)


@pytest.fixture
def weightless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do without the processes that memory takes."""
    monkeypatch.setattr(records, "memory_of", lambda *_args, **_kwargs: WEIGHT)


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Leave OpenCV the threads that it had."""
    count = cv2.getNumThreads()
    yield
    cv2.setNumThreads(count)


# Who takes part


@pytest.mark.parametrize("preset", ["fast", "robust"])
def test_ours_gets_the_threads_and_the_preset(pair: GrayPair, preset: str) -> None:
    ours = bench.CONTENDERS[bench.OURS[preset]](16, 1)
    result = ours(pair.left, pair.right)
    assert np.median(result.disparity) == pytest.approx(5, abs=0.1)
    assert result.settings == PRESETS[preset]
    assert ours.func.__self__.threads == 1  # type: ignore[attr-defined] # a bound method's partial


def test_rivals_are_set_as_they_say() -> None:
    checked = bench.CONTENDERS["opencv:bm"](32, None).__self__  # type: ignore[attr-defined] # a bound method
    unchecked = bench.CONTENDERS["opencv:bm-unchecked"](32, None).__self__  # type: ignore[attr-defined] # the same

    plain = cv2.StereoBM_create()
    assert checked.getBlockSize() == unchecked.getBlockSize() == 9
    assert checked.getNumDisparities() == unchecked.getNumDisparities() == 32
    assert checked.getUniquenessRatio() == plain.getUniquenessRatio() > 0
    assert checked.getTextureThreshold() == plain.getTextureThreshold() > 0
    assert unchecked.getUniquenessRatio() == unchecked.getTextureThreshold() == 0

    matcher = bench.CONTENDERS["opencv:sgbm-3way"](16, None).__self__  # type: ignore[attr-defined] # a bound method
    assert matcher.getMode() == cv2.STEREO_SGBM_MODE_SGBM_3WAY


@pytest.mark.parametrize("count", [1, 2])
def test_opencv_gets_its_threads(count: int) -> None:
    contenders.set_opencv_threads(3 - count)
    contenders.set_opencv_threads(count)
    assert cv2.getNumThreads() == count


# Turns


@on_linux
def test_pinned_holds_threads_that_were_there_and_new_ones() -> None:
    everywhere = os.sched_getaffinity(0)
    affinity: dict[str, set[int]] = {}
    go, stop = threading.Event(), threading.Event()

    def early() -> None:
        go.wait()
        affinity["early"] = os.sched_getaffinity(0)
        stop.wait()
        affinity["after"] = os.sched_getaffinity(0)

    thread = threading.Thread(target=early)
    thread.start()

    with pinned() as core:
        go.set()
        late = threading.Thread(target=lambda: affinity.update(late=os.sched_getaffinity(0)))
        late.start()
        late.join()
        while "early" not in affinity:
            stop.wait(0.001)
        affinity["main"] = os.sched_getaffinity(0)

    stop.set()
    thread.join()

    held = {name: affinity.pop(name) for name in ("main", "early", "late")}
    assert held == {"main": {core}, "early": {core}, "late": {core}}
    assert (affinity, os.sched_getaffinity(0)) == ({"after": everywhere}, everywhere)


def test_all_take_turns_in_changing_order(monkeypatch: pytest.MonkeyPatch, pair: GrayPair) -> None:
    turns: list[str] = []

    def made(name: str) -> Callable[..., Callable[..., None]]:
        return lambda *_: lambda *_: turns.append(name)

    monkeypatch.setattr(rounds, "CONTENDERS", {name: made(name) for name in bench.CONTENDERS})

    entrants = rounds.time_all_threads(pair, "robust", 12)
    by_round = [turns[start : start + 5] for start in range(0, len(turns), 5)]
    assert len(by_round) == 13  # the first is to warm up, and does not count
    assert all(
        sorted(turn) == sorted(["phasestereo:robust", "phasestereo:robust+match", *RIVALS[:-1]])
        for turn in by_round
    )
    assert len(set(map(tuple, by_round))) > 3
    assert [len(entrant.seconds) for entrant in entrants] == [12] * 5


@on_linux
def test_opencv_takes_part_with_one_thread_and_two(pair: GrayPair) -> None:
    entrants, core = rounds.time_one_thread(pair, "fast", 1)
    assert core in os.sched_getaffinity(0)

    assert [(e.name, e.opencv_threads) for e in entrants] == [
        ("phasestereo:fast", None),
        ("phasestereo:fast+match", None),
        *((name, count) for name in RIVALS[:-1] for count in (1, 2)),
    ]

    assert [set(stage) for stage in entrants[0].stages] == [
        {"description", "matching", "refinement"}
    ]


# Memory


@on_linux
def test_memory_is_that_of_the_match(pair: GrayPair) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (500, 600), dtype=np.uint8)
    whole = bench.GrayPair("larger", noise, noise, 16)
    weight = memory.memory_of(bench.OURS["fast"], whole, threads=1)
    assert weight["result_bytes"] == 6 * noise.size  # disparities and flags
    assert weight["peak_bytes"] > 0.9 * weight["result_bytes"]
    theirs = memory.memory_of("opencv:bm", pair, threads=2)
    assert theirs["result_bytes"] == 2 * pair.left.size


# Records


@pytest.mark.usefixtures("weightless")
def test_figures_follow_from_the_seconds(tmp_path: Path, pair: GrayPair) -> None:
    records = run_jobs(bench.speed_jobs([pair], rounds=3), tmp_path / "speed.jsonl", workers=0)
    assert [(record["preset"], record["threads"]) for record in records] == [
        (preset, threads) for preset in ("fast", "robust") for threads in ("one", "all")
    ]

    for record in records:
        is_one = record["threads"] == "one"
        assert record["thread_count"] == (1 if is_one else usable_cpus())
        assert is_one or record["pinned_to"] is None
        assert record["status"] == "ok", record
        assert (record["width"], record["height"], record["num_disparities"]) == (75, 40, 16)
        assert record["simd"] == _core.simd_level()

        ours = record["ours"]
        assert (len(ours["seconds"]), ours["median"]) == (3, median(ours["seconds"]))
        assert ours["minimum"] == min(ours["seconds"])
        assert ours["gde_per_second"] == pytest.approx(75 * 40 * 16 / ours["median"] / 1e9)
        assert 0 < ours["description_share"] < 1

        assert list(record["rivals"]) == RIVALS
        for rival in record["rivals"].values():
            ratios = [a / b for a, b in zip(rival["seconds"], ours["seconds"], strict=True)]
            assert rival["median_ratio"] == pytest.approx(median(ratios))
            assert rival["ratio_of_medians"] == pytest.approx(rival["median"] / ours["median"])
            assert rival["memory"] == WEIGHT


@pytest.mark.usefixtures("weightless")
def test_the_faster_number_of_opencv_threads_counts(
    monkeypatch: pytest.MonkeyPatch, pair: GrayPair
) -> None:
    stage = {"description": 0.5, "matching": 1.0}
    slow, fast = [3.0, 3.0, 3.0], [4.0, 2.0, 2.0]

    entrants = [
        rounds.Entrant(bench.OURS["fast"], print, None, [2.0, 2.0, 1.0], [stage] * 3),
        rounds.Entrant(bench.OURS["fast"] + contenders.MATCH, print, None, fast),
        rounds.Entrant("opencv:bm", print, 1, slow),
        rounds.Entrant("opencv:bm", print, 2, fast),
    ]

    monkeypatch.setattr(records, "time_one_thread", lambda *_: (entrants, 0))
    record = records.measure(pair, "fast", "one", 3)

    rival = record["rivals"]["opencv:bm"]
    assert (rival["seconds"], rival["opencv_threads"]) == (fast, 2)
    assert rival["slower"] == {"1": slow}
    assert (rival["ratio_of_medians"], rival["median_ratio"]) == (1.0, 2.0)

    assert (record["ours"]["description_share"], record["pinned_to"]) == (0.25, 0)


@pytest.mark.usefixtures("weightless")
def test_done_is_not_done_again_unless_something_changed(
    tmp_path: Path, pair: GrayPair, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "speed.jsonl"

    def run() -> list[dict[str, Any]]:
        return run_jobs(bench.speed_jobs([pair], rounds=1), store, workers=0)

    first = run()
    content = store.read_bytes()
    assert (run(), store.read_bytes()) == (first, content)

    monkeypatch.setattr(_core, "simd_level", lambda: "another")
    assert [r["simd"] for r in run()] == ["another"] * 4
    assert len(read_store(store)) == 9  # an environment, and twice four records


# Pairs


@pytest.mark.parametrize("name", ["tsukuba", "cones", "Motorcycle", "chess"])
def test_what_is_not_there_is_left_out(tmp_path: Path, name: str) -> None:
    for data, reason in ((None, "which takes a folder"), (tmp_path, str(tmp_path))):
        found, left_out = bench.find_pairs(data, cache=tmp_path, names=[name])
        assert (found, len(left_out)) == ([], 1)
        assert left_out[0].startswith(f"left out: {name}, ")
        assert reason in left_out[0]


def test_colors_become_gray(tmp_path: Path) -> None:
    folder = tmp_path / "large" / "chess_1920x1080"
    folder.mkdir(parents=True)

    colors = np.random.default_rng(0).integers(0, 256, (20, 300, 3), dtype=np.uint8)
    io.write_image(folder / "left.png", colors)
    io.write_image(folder / "right.png", colors[..., 0])

    (found,), left_out = bench.find_pairs(tmp_path, cache=tmp_path, names=["chess"])

    assert left_out == []
    assert (found.name, found.num_disparities) == ("chess", 256)
    assert found.evaluations == 20 * 300 * 256
    np.testing.assert_array_equal(found.left, cv2.cvtColor(colors, cv2.COLOR_RGB2GRAY))
    np.testing.assert_array_equal(found.right, colors[..., 0])

    io.write_image(folder / "right.png", colors[:10])
    assert "differ in size" in bench.find_pairs(tmp_path, cache=tmp_path, names=["chess"])[1][0]


def test_real_pairs_have_the_sizes_that_are_stated(data: Path, tmp_path: Path) -> None:
    names = ["tsukuba", "cones", "Motorcycle"]
    found, left_out = bench.find_pairs(data, cache=tmp_path, names=names)

    assert left_out == []
    assert [(p.left.shape, p.num_disparities) for p in found] == [
        ((288, 384), 16),
        ((375, 450), 64),
        ((497, 741), 64),
    ]

    in_the_tree, _ = bench.find_pairs(data / "middlebury", cache=tmp_path, names=names)
    assert [p.name for p in in_the_tree] == names


# What the tables show


def record(**changed: Any) -> dict[str, Any]:
    """Return a record such as those of `speed_jobs`."""
    rival = {"median_ratio": 1.5, "memory": {"peak_bytes": 4_000_000, "result_bytes": 2}}
    made = {
        "kind": "speed",
        "status": "ok",
        "pair": "cones",
        "height": 375,
        "width": 450,
        "num_disparities": 64,
        "preset": "fast",
        "threads": "one",
        "rounds": 15,
        "environment": "e",
        "simd": "avx2",
        "opencv_build": "baseline: SSE3",
        "thread_count": 1,
        "pinned_to": 0,
        "ours": {
            "median": 0.01234,
            "gde_per_second": 0.875,
            "description_share": 0.4,
            "memory": WEIGHT,
        },
        "rivals": {name: copy.deepcopy(rival) for name in RIVALS},
    }
    return {**made, **changed}


def test_tables_show_records_by_size() -> None:
    lines = [
        record(threads="all", thread_count=8, pinned_to=None),
        record(pair="tsukuba", height=288, width=384, num_disparities=16),
        record(),
    ]

    lines[0]["rivals"]["opencv:bm"]["memory"] = {"error": "it died"}
    del lines[1]["rivals"]["opencv:sgbm-3way"]
    assert "a single thread was held to one processor" in bench.explain_speed(lines)

    texts = [
        [[entry.text for entry in row] for row in table(lines).rows]
        for table in (bench.time_table, bench.memory_table)
    ]

    figures, cones = ["12.3", "0.88", "1.50", "1.50"], ["cones", "450 x 375", "fast", "64"]
    tsukuba = ["tsukuba", "384 x 288", "fast", "16", "1"]

    assert texts == [
        [
            [*tsukuba, *figures, "-", "1.50", "1.25", "40"],
            [*cones, "1", *figures, "1.50", "1.50", "1.25", "40"],
            [*cones, "8", *figures, "1.50", "1.50", "1.25", "40"],
        ],
        [
            [*tsukuba, "3.0", "1.0", "4.0", "4.0", "-", "4.0"],
            [*cones, "1", "3.0", "1.0", "4.0", "4.0", "4.0", "4.0"],
            [*cones, "8", "3.0", "1.0", "-", "4.0", "4.0", "4.0"],
        ],
    ]


def test_a_record_is_compared_with_the_last_one_of_another_core_on_the_same_machine() -> None:
    def of(core: str, environment: str, seconds: float, rival: float) -> dict[str, Any]:
        made = record(core=core, environment=environment)
        made["ours"]["median"] = seconds
        made["rivals"]["opencv:sgbm-3way"]["median_ratio"] = rival
        return made

    machines = [
        {"kind": "environment", "id": name, "cpu": cpu, "cores": 2}
        for name, cpu in (("old", "a"), ("new", "a"), ("other", "b"))
    ]
    stale, before = of("1", "old", 0.02, 1.0), of("2", "old", 0.01, 3.0)
    elsewhere, now = of("3", "other", 0.001, 9.0), of("4", "new", 0.04, 1.5)
    failed = {**of("5", "new", 0.0, 1.0), "status": "error"}
    lines = [*machines, stale, before, elsewhere, failed, now]
    assert results.records_before(lines, [now, elsewhere, before]) == [before, None, stale]

    # The machine was half as fast: the rival took twice the time, and we four times as long.
    shown = bench.time_table([now], lines)
    by_name = dict(zip(shown.header, (entry.text for entry in shown.rows[0]), strict=True))
    assert (by_name["ms"], by_name["before"]) == ("40.0", "2.00")
    assert "before" not in bench.time_table([now]).header


# The command


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, weightless: None) -> Path:  # noqa: ARG001 - it is in force
    """Return the current folder, with a small pair in place of the large rendered ones."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHASESTEREO_DATA", raising=False)
    monkeypatch.setenv("COLUMNS", "200")

    noise = np.random.default_rng(0).integers(0, 256, (40, 270), dtype=np.uint8)
    (tmp_path / "out").mkdir()
    for side, view in (("left", noise[:, :-5]), ("right", noise[:, 5:])):
        for size in ("2964x1988x256", "1920x1080x128", "116x87x16"):
            io.write_image(tmp_path / "out" / f"rendered-{size}-{side}.png", view)
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_the_command_and_its_tables(run_bench: Callable[..., Run]) -> None:
    command = ["speed", "-o", "out/speed.jsonl", "--rounds", 1]
    code, out, err = run_bench(*command)
    assert code == 0, err
    assert "265 x 40" in out
    assert err.count("left out: ") == 4
    assert "Records: out/speed.jsonl" in out

    code, again, err = run_bench(*command, "--pairs", "rendered", "0.01MPx16")
    assert "0.01MPx16" in again
    assert "4 of 8 measurements are in out/speed.jsonl already" in err

    assert "| rendered | 265 x 40 | fast | 256 | 1 |" in table_texts(Path("out"))["speed"]

    code, _, err = run_bench(*command, "--pairs", "rendered", "--fresh")
    assert code == 0
    assert "renamed out/speed.jsonl to out/speed.jsonl.bak" in err
    assert [len(read_store(f"out/speed.jsonl{end}")) for end in ("", ".bak")] == [5, 13]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--pairs", "venus"], 2, "--pairs: got 'venus'"),
        (["--pairs", "1MPx17"], 2, "--pairs: got '1MPx17'"),
        (["--pairs", "cones"], 1, "there is no pair to match"),
        (["--rounds", "0"], 2, "rounds"),
    ],
)
def test_commands_that_are_refused(
    run_bench: Callable[..., Run], arguments: list[str], code: int, message: str
) -> None:
    answer = run_bench("speed", "-o", "out/speed.jsonl", *arguments)
    assert answer[0] == code
    assert message in answer[2].splitlines()[-1]

"""Jobs on processes: every end of a job is recorded, nothing that is done is done again."""

import json
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench import Job, read_store, run_jobs
from phasestereo_bench.environment import _commit, describe_environment, usable_cpus

HERE = Path(__file__).parent
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="read from /proc")


# Work


def square(number: float) -> Mapping[str, Any]:
    return {"square": number * number}


def note(path: str) -> Mapping[str, Any]:
    """Leave a trace of having run."""
    with Path(path).open("a") as file:
        file.write("x")
    return {}


def give(value: Any) -> Mapping[str, Any]:
    return {"value": value}


def numbers() -> Mapping[str, Any]:
    array = np.arange(3, dtype=np.float32)
    return {"one": array[1], "many": (array[2], math.nan, -math.inf), "deep": {"n": np.int64(3)}}


def fail(message: str) -> Mapping[str, Any]:
    raise ValueError(message)


def fail_unless(path: str) -> Mapping[str, Any]:
    if not Path(path).exists():
        raise FileNotFoundError(path)
    return {}


def lie() -> Mapping[str, Any]:
    return {"name": "other", "seconds": 7.5, "peak_bytes": 11}


def fill(size: int) -> Mapping[str, Any]:
    return {"sum": float(np.ones(size // 8).sum())}


def threads() -> Mapping[str, Any]:
    _ = np.ones((800, 800)) @ np.ones((800, 800))
    opencv = __import__("cv2").getNumThreads() if HAS_OPENCV else 1
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    set_to = [os.environ.get(name) for name in names]
    # One more waits for the end of the parent.
    tasks = len(list(Path("/proc/self/task").iterdir())) - 1
    return {"opencv": opencv, "tasks": tasks, "set": set_to}


def nap(seconds: float) -> Mapping[str, Any]:
    time.sleep(seconds)
    return {}


HAS_OPENCV = __import__("importlib.util").util.find_spec("cv2") is not None


def job(name: str, work: Callable[..., Mapping[str, Any]], **arguments: Any) -> Job:
    return Job({"kind": "test", "name": name}, work, arguments)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return tmp_path / "store.jsonl"


# What is recorded


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_records_come_in_the_order_of_the_jobs(store: Path, workers: int) -> None:
    jobs = [job(f"{n}", square, number=n) for n in range(5)]
    records = run_jobs(jobs, store, workers=workers)

    assert [record["square"] for record in records] == [0, 1, 4, 9, 16]
    assert all(record["status"] == "ok" and record["kind"] == "test" for record in records)
    assert all(record["seconds"] >= 0 for record in records)

    lines = read_store(store)
    assert sorted(map(str, lines[1:])) == sorted(map(str, records))
    assert {record["environment"] for record in records} == {lines[0]["id"]}


def test_one_line_per_environment(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_jobs([job("a", square, number=1)], store, workers=0)
    run_jobs([job("b", square, number=1)], store, workers=0)

    elsewhere = {**describe_environment(), "id": "0123456789ab"}
    monkeypatch.setattr("phasestereo_bench.runner.describe_environment", lambda: elsewhere)
    record = run_jobs([job("c", square, number=1)], store, workers=0)[0]
    assert record["environment"] == "0123456789ab"

    kinds = [line["kind"] for line in read_store(store)]
    assert kinds == ["environment", "test", "test", "environment", "test"]


def test_numbers_are_written_as_json_has_them(store: Path) -> None:
    record = run_jobs([job("a", numbers)], store, workers=1)[0]
    assert (record["one"], record["many"], record["deep"]) == (1, [2, None, None], {"n": 3})
    assert json.loads(store.read_text().splitlines()[1]) == record


def test_own_seconds_and_memory_take_precedence_and_nothing_replaces_the_key(store: Path) -> None:
    record = run_jobs([job("a", lie)], store, workers=0)[0]
    assert (record["name"], record["seconds"], record["peak_bytes"]) == ("a", 7.5, 11)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_job_that_raises_fails_alone(store: Path, workers: int) -> None:
    jobs = [job("bad", fail, message="no\n luck"), job("good", square, number=3)]
    bad, good = run_jobs(jobs, store, workers=workers)
    assert (bad["status"], bad["error"]) == ("failed", "ValueError: no luck")
    assert "in fail" in bad["traceback"]
    assert good["square"] == 9


@pytest.mark.parametrize("workers", [0, 1])
def test_what_json_does_not_take_fails_its_cell(store: Path, workers: int) -> None:
    jobs = [job("bad", give, value={1j}), job("good", give, value="é\n\x85\u2028")]
    bad, good = run_jobs(jobs, store, workers=workers)
    assert bad["error"].startswith("TypeError")
    assert good["value"] == read_store(store)[2]["value"] == "é\n\x85\u2028"


def test_what_cannot_be_sent_fails_its_cell(store: Path) -> None:
    jobs = [job("bad", lambda: {"a": 1}), job("good", square, number=3)]
    bad, good = run_jobs(jobs, store, workers=1)
    assert "lambda" in bad["error"]
    assert good["status"] == "ok"


# Going on


@pytest.mark.parametrize("workers", [0, 1])
def test_finished_cells_are_kept_and_failed_ones_tried_again(
    store: Path, tmp_path: Path, workers: int
) -> None:
    trace, needed = tmp_path / "trace", tmp_path / "needed"
    jobs = [job("note", note, path=str(trace)), job("late", fail_unless, path=str(needed))]

    first = run_jobs(jobs, store, workers=workers)
    assert [record["status"] for record in first] == ["ok", "failed"]

    needed.touch()
    second = run_jobs([*jobs, job("new", square, number=2)], store, workers=workers)
    assert ([record["status"] for record in second], second[0]) == (["ok", "ok", "ok"], first[0])
    assert trace.read_text() == "x"

    before = store.read_bytes()
    assert (run_jobs(jobs, store, workers=workers), store.read_bytes()) == (second[:2], before)


def test_equal_keys_are_one_cell(store: Path, tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    twins = [Job({"a": 1, "b": 2}, note, {"path": str(trace)}) for _ in range(2)]
    twins.append(Job({"b": 2, "a": 1}, note, {"path": str(trace)}))
    records = run_jobs(twins, store, workers=0)
    assert trace.read_text() == "x"
    assert records[0] == records[1] == records[2]


@pytest.mark.parametrize("torn", ['{"kind": "test", "na', '{"kind": "test"', "\x00\x00", "7"])
def test_a_torn_last_line_is_dropped_and_its_cell_run(store: Path, torn: str) -> None:
    jobs = [job(f"{n}", square, number=n) for n in range(3)]
    whole = run_jobs(jobs, store, workers=0)

    lines = store.read_text().splitlines(keepends=True)
    store.write_text("".join(lines[:-1]) + torn)
    assert len(read_store(store)) == 3

    again = run_jobs(jobs, store, workers=0)
    assert [record["square"] for record in again] == [record["square"] for record in whole]
    assert [line.get("square") for line in read_store(store)] == [None, 0, 1, 4]
    assert store.read_text().endswith("\n")


@pytest.mark.parametrize(
    "content", ["hello", "hello\n", "\n", "[]\n", '{"kind": "other"}\n', "\xff"]
)
def test_other_files_are_not_touched(store: Path, content: str) -> None:
    store.write_text(content, "latin-1")
    with pytest.raises(ValueError, match="not a file of benchmark results"):
        run_jobs([job("a", square, number=1)], store, workers=0)
    assert store.read_text("latin-1") == content


def test_damage_within_a_file_is_reported(store: Path) -> None:
    run_jobs([job("a", square, number=1)], store, workers=0)
    content = store.read_text() + "damage\n{}\n"
    store.write_text(content)
    with pytest.raises(ValueError, match="line 3 is not a JSON object"):
        run_jobs([job("b", square, number=1)], store, workers=0)
    assert store.read_text() == content


# While it runs


@pytest.mark.parametrize("workers", [0, 2])
def test_progress_counts_what_is_to_be_run(store: Path, workers: int) -> None:
    run_jobs([job("0", square, number=0)], store, workers=0)
    seen: list[tuple[int, int]] = []
    jobs = [job(f"{n}", square, number=n) for n in range(4)]
    run_jobs(jobs, store, workers=workers, progress=lambda *step: seen.append(step))
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_what_progress_raises_ends_the_run(store: Path) -> None:
    def stop(done: int, _total: int) -> None:
        if done == 1:
            raise StopAsyncIteration

    jobs = [job("quick", square, number=1), *(job(f"{n}", nap, seconds=600) for n in range(3))]

    with pytest.raises(StopAsyncIteration):
        run_jobs(jobs, store, workers=2, progress=stop)
    assert [line.get("name") for line in read_store(store)] == [None, "quick"]


@on_linux
def test_workers_use_one_thread_each(store: Path) -> None:
    before = dict(os.environ)
    record = run_jobs([job("a", threads)], store, workers=1)[0]
    assert (record["opencv"], record["tasks"], record["set"]) == (1, 1, ["1", "1", "1"])
    assert dict(os.environ) == before


def start(command: list[str], **variables: str) -> subprocess.Popen[str]:
    """Start a process which finds the tests, in a group of its own."""
    path = os.pathsep.join(filter(None, [str(HERE), os.environ.get("PYTHONPATH")]))
    return subprocess.Popen(  # noqa: S603 - our own interpreter on our own code
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": path, **variables},
    )


def wait_for_record(store: Path, process: subprocess.Popen[str]) -> None:
    """Wait until a store has its environment and a record."""
    while process.poll() is None:
        if store.exists() and store.read_bytes().count(b"\n") >= 2:
            return
        time.sleep(0.02)
    pytest.fail(f"it ended before it recorded anything: {process.communicate()}")


UNGUARDED = """
import sys
from pathlib import Path
from test_bench_runner import job, square
from phasestereo_bench import run_jobs
run_jobs([job("a", square, number=1), job("b", square, number=2)], Path(sys.argv[1]), workers=2)
"""


def test_a_script_without_a_guard_is_reported(tmp_path: Path, store: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    process = start([sys.executable, str(script), str(store)])
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "worker processes cannot be started" in err.splitlines()[-1]
    assert "__main__" in err.splitlines()[-1]


# Figures beside the figures


def test_environment_names_what_matters() -> None:
    facts = describe_environment()
    assert (facts["kind"], facts["id"]) == ("environment", describe_environment()["id"])
    assert len(facts["id"]) == 12

    assert facts["cpu"]
    assert facts["cores"] == usable_cpus() >= 1
    assert facts["versions"]["phasestereo"] == ps.__version__
    assert facts["versions"]["numpy"] == np.__version__

    assert facts["versions"]["python"] == sys.version.split()[0]
    assert (facts["versions"]["opencv"] is not None) == HAS_OPENCV


def test_commit_is_that_of_the_checkout_a_file_is_part_of(tmp_path: Path) -> None:
    git = shutil.which("git")
    if git is None:
        pytest.skip("git is not installed")

    def ask(*arguments: str) -> str:
        command = [git, "-c", "user.name=a", "-c", "user.email=a@b", *arguments]
        return subprocess.run(  # noqa: S603 - found by which
            command, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    file = tmp_path / "module.py"
    file.write_text("1")
    assert _commit(file) is None
    ask("init", "--quiet")
    assert _commit(file) is None, "git knows nothing of the file"
    ask("add", "module.py")
    ask("commit", "--quiet", "--message", "One")
    assert _commit(file) == ask("rev-parse", "HEAD")
    file.write_text("2")
    assert _commit(file) == ask("rev-parse", "HEAD") + "-dirty"


@on_linux
def test_peak_is_that_of_the_job_alone(store: Path) -> None:
    sizes = [200_000_000, 24_000_000, 24_000_000, 24_000_000]
    jobs = [job(f"{n}", fill, size=size) for n, size in enumerate(sizes)]
    records = run_jobs(jobs, store, workers=1)
    for record, size in zip(records, sizes, strict=True):
        assert record["sum"] == size / 8
        assert abs(record["peak_bytes"] - size) < 5_000_000

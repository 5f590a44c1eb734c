"""The Middlebury harness: the published figures, the records, and what it refuses."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
import os
import shutil
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_bench_cases import SHIFT, plant, run_middlebury
from test_bench_methods import own
from test_bench_runner import start, wait_for_record

import phasestereo_bench as bench
from phasestereo import io, metrics
from phasestereo.metrics import roc_area
from phasestereo_bench import Method, read_store
from phasestereo_bench.cases import SUITE_SCENES, Case
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.middlebury import middlebury_jobs
from phasestereo_bench.report.results import read_results
from phasestereo_bench.report.sharp import sharp_tables

for module in ("scipy", "PIL"):
    pytest.importorskip(module)

HERE = "test_bench_middlebury"
Run = tuple[int, str, str]


# Methods of a user's


def sparse(left: Any, _right: Any, _count: int) -> Any:
    """Get a third of the pixels right, a third wrong, and leave the others out."""
    disparity = np.full(left.shape[:2], float(SHIFT))
    disparity[::3] = 1e6
    disparity[1::3] = np.nan
    return disparity


def sure(left: Any, right: Any, count: int) -> Any:
    """Trust what is right alone."""
    disparity = sparse(left, right, count)
    return disparity, np.where(disparity == SHIFT, 0.9, 0.1)


def undecided(left: Any, right: Any, count: int) -> Any:
    return sparse(left, right, count), np.full(left.shape[:2], 0.5, np.float32)


def three(left: Any, right: Any, count: int) -> Any:
    return *undecided(left, right, count), 1


def blind(left: Any, right: Any, count: int) -> Any:
    return silent(left, right, count), np.zeros(left.shape[:2], np.float32)


def silent(left: Any, _right: Any, _count: int) -> Any:
    return np.full(left.shape[:2], np.nan, np.float32)


def small(left: Any, _right: Any, _count: int) -> Any:
    return np.zeros((left.shape[0], left.shape[1] - 1), np.float32)


def integers(left: Any, _right: Any, _count: int) -> Any:
    return np.zeros(left.shape[:2], np.int16)


def nothing(_left: Any, _right: Any, _count: int) -> Any:
    return None


def careless(left: Any, right: Any, _count: int) -> Any:
    left[:] = right[:] = 0
    raise RuntimeError("out of luck")


def crash(_left: Any, _right: Any, _count: int) -> Any:
    os._exit(7)


def beside(left: Any, _right: Any, _count: int) -> Any:
    """Be off by 1.5 px everywhere."""
    return np.full(left.shape[:2], SHIFT + 1.5)


def nap(left: Any, right: Any, count: int) -> Any:
    """Take its time if the test says so."""
    if "NAP" in os.environ:
        signal.pause()
    return sparse(left, right, count)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a folder tree of two small scenes."""
    for name in ("one", "three"):
        plant(tmp_path / "data", name)
    return tmp_path / "data"


@pytest.fixture
def scenes(tree: Path) -> list[Scene]:
    return find_scenes(tree)


# The published figures

PUBLISHED = {
    ("tsukuba", "sharp"): {"opencv:sgbm": 4.4, "7": 5.6, "21": 10.0},
    ("tsukuba", "gauss 4"): {
        "opencv:sgbm": 44.8,
        "opencv:sgbm+true-blur": 16.2,
        "7": 34.7,
        "21": 20.3,
        "7+true-blur": 14.9,
    },
    ("tsukuba", "mixed"): {"opencv:sgbm": 23.9, "7": 23.2, "21": 13.9},
    ("venus", "sharp"): {"opencv:sgbm": 2.1, "7": 2.7, "21": 5.6},
    ("venus", "gauss 4"): {
        "opencv:sgbm": 45.7,
        "opencv:sgbm+true-blur": 11.4,
        "7": 58.0,
        "21": 36.8,
        "7+true-blur": 24.1,
    },
    ("venus", "mixed"): {"opencv:sgbm": 20.7, "7": 29.3, "21": 12.9},
}
"""Rows of the suite: bad-1.0 in %; StereoSGBM, and `paper` by its neighborhood."""


def test_figures_are_the_published_ones(data: Path) -> None:
    pytest.importorskip("cv2")

    scenes = [s for s in find_scenes(data / "middlebury") if s.name in ("tsukuba", "venus")]
    sides = ("7", "21", "7+true-blur")
    methods = ["opencv:sgbm", "opencv:sgbm+true-blur", *(f"paper:neighborhood={s}" for s in sides)]

    records = run_middlebury(scenes, methods, ["sharp", "gauss 4", "mixed"])

    measured: dict[tuple[str, str], dict[str, float]] = {}
    for record in records:
        name = record["method"] + "+true-blur" * record["true_blur"]
        cells = measured.setdefault((record["scene"], record["degradation"]), {})
        cells[name.removeprefix("paper:neighborhood=")] = record["v2"]["nonocc"]

    assert {case: set(cells) for case, cells in measured.items()} == {
        case: set(cells) for case, cells in PUBLISHED.items()
    }

    for case, published in PUBLISHED.items():
        for name, percent in published.items():
            tolerance = 1 if name.startswith("opencv") else 2
            assert abs(measured[case][name] - percent) <= tolerance, (case, name)


# Records


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_record_holds_what_metrics_say(data: Path, side: str) -> None:
    scene = next(s for s in find_scenes(data / "middlebury") if s.name == "cones")
    arguments = [scene], ["paper:window=5"], ["gauss 2"]
    (record,) = run_middlebury(*arguments, sides=[side], workers=0)

    pair = scene.load()
    spoiled = Case(scene, "one-sided-blur", "gauss 2", side).pair(true_blur=False)
    views = spoiled.left, spoiled.right
    disparity, confidence = bench.method("paper:window=5").match(*views, pair.num_disparities)

    nonocc, count = pair.masks["nonocc"], pair.num_disparities
    scores = metrics.score(disparity, pair.truth, mask=nonocc, num_disparities=count)
    v2 = metrics.middlebury_v2(disparity, pair)

    assert record["v3"] | {"d1": record["d1"], "epe": record["epe"]} == asdict(scores)
    assert record["v2"] == {"nonocc": v2.nonocc, "all": v2.all, "disc": v2.disc}
    assert record["epe"] == metrics.end_point_error(disparity, pair.truth, nonocc)
    assert record["roc"] == roc_area(confidence, disparity, pair.truth, mask=nonocc)

    assert (record["height"], record["width"], record["num_disparities"]) == (375, 450, 64)
    assert record["settings"]["window"] == 5
    assert list(record)[:9] == [
        *("kind", "suite", "collection", "scene", "degradation", "side", "method", "true_blur"),
        "status",
    ]
    assert record["collection"] == "scenes2003"


def test_missing_estimates_are_bad_and_errors_are_clipped(scenes: list[Scene]) -> None:
    record = run_middlebury(scenes[:1], [sparse], ["sharp"], workers=0)[0]

    pair = scenes[0].load()
    rows = pair.masks["nonocc"].sum(axis=1)
    thirds = [rows[start::3].sum() / rows.sum() for start in range(3)]

    assert record["v2"]["nonocc"] == pytest.approx(100 * (thirds[0] + thirds[1]))
    assert record["v3"]["invalid"] == pytest.approx(100 * thirds[1])
    assert record["v3"]["a99"] == pair.num_disparities - SHIFT
    assert record["epe"] > pair.num_disparities
    assert record["v2"]["disc"] is None, "there is no such mask"


def test_what_there_is_not_is_null(scenes: list[Scene]) -> None:
    record = run_middlebury(scenes[:1], [silent], ["sharp"], workers=0)[0]
    assert record["v2"]["nonocc"] == record["v3"]["bad_4"] == record["v3"]["invalid"] == 100
    assert record["epe"] is record["v3"]["avgerr"] is record["v3"]["a50"] is None

    (scenes[0].folder / "disp6.pgm").unlink()  # then nothing shows what is occluded

    record = run_middlebury(scenes[:1], [sparse], ["sharp"], workers=0)[0]

    assert record["status"] == "ok"
    assert record["v2"]["nonocc"] is record["d1"] is record["epe"] is None
    assert set(record["v3"].values()) == {None}
    assert record["v2"]["all"] > 0


def test_confidence_is_scored_where_there_is_one(scenes: list[Scene]) -> None:
    methods: list[Any] = [sparse, sure, Method("undecided", undecided), Method("three", three)]
    records = run_middlebury(scenes[:1], methods, ["sharp"], workers=0)

    assert [record.get("roc") for record in records] == [None, 1.0, 0.5, None]
    assert [record["status"] for record in records] == ["ok", "ok", "ok", "failed"]
    assert records[1]["v2"] == records[0]["v2"], "the disparities are the same"
    assert records[3]["error"].endswith("returned 3 things, not disparities, confidences")

    (record,) = run_middlebury(scenes[:1], [Method("blind", blind)], ["sharp"], workers=0)
    assert (record["status"], record["roc"]) == ("ok", None), "all are wrong"

    (scenes[0].folder / "disp6.pgm").unlink()
    (record,) = run_middlebury(scenes[:1], [sure], ["sharp"], workers=0)
    assert (record["status"], record["roc"]) == ("ok", None), "no mask"


def test_gray_pairs_are_matched_by_all(tmp_path: Path) -> None:
    scene = find_scenes(plant(tmp_path, "map", gray=True))[0]
    methods = [name for name in bench.available() if name != "opencv:bm"]  # too flat for it
    for record in run_middlebury([scene], methods, ["sharp"], workers=0):
        assert record["v2"]["nonocc"] < 5, record["method"]


def test_cells_are_all_combinations_that_exist(scenes: list[Scene]) -> None:
    jobs = middlebury_jobs(
        scenes, ["paper", "paper+true-blur", "paper"], ["sharp", "disk 3"], sides=("left", "right")
    )
    keys = [job.key for job in jobs]
    assert len({json.dumps(dict(key)) for key in keys}) == len(keys) == 2 * 2 * (1 + 2)
    assert not any(key["true_blur"] for key in keys if key["degradation"] == "sharp")
    assert {key["suite"] for key in keys} == {"one-sided-blur"}


def test_defaults_are_the_whole_suite(scenes: list[Scene]) -> None:
    keys = [job.key for job in middlebury_jobs(scenes[:1])]

    informed = {str(key["method"]) for key in keys if key["true_blur"]}
    plain = {str(key["method"]) for key in keys if not key["true_blur"]}
    lengths = {f"paper:neighborhood={length}" for length in (7, 11, 15, 21)}
    opencv = {"opencv:sgbm"} & set(bench.available())

    assert plain == {"robust"} | lengths | opencv
    assert informed == {"robust", "paper:neighborhood=7"} | opencv
    assert len(keys) == 9 * len(plain) + 6 * len(informed)

    keys = [job.key for job in middlebury_jobs(scenes[:1], suite="sharp")]
    assert {key["degradation"] for key in keys} == {"sharp"}
    opencv = {"opencv:bm", "opencv:sgbm", "opencv:sgbm-3x3"} & set(bench.available())
    assert {key["method"] for key in keys} == {"robust", "fast", "paper"} | opencv


# A user's own


def test_functions_of_ones_own(scenes: list[Scene]) -> None:
    methods: list[Any] = [
        own,
        Method("mine", sparse, {"a": 1}),
        Method("mine", sparse, true_blur=True),
    ]

    records = run_middlebury(scenes, methods, ["disk 3", "contrast 1.5 0.6"], workers=2)

    assert len(records) == 2 * (3 + 2)
    assert {record["method"] for record in records} == {"test_bench_methods:own", "mine"}
    assert {record["status"] for record in records} == {"ok"}
    assert next(r["settings"] for r in records if r["method"] == "mine") == {"a": 1}


def test_what_no_other_process_can_import(scenes: list[Scene]) -> None:
    def local(left: Any, right: Any, count: int) -> Any:
        return sparse(left, right, count)

    (record, _) = run_middlebury(scenes, [local], ["sharp"], workers=1)
    assert (record["status"], "local" in record["error"]) == ("failed", True)
    (record, _) = run_middlebury(scenes, [local], ["sharp"], workers=0)
    assert (record["status"], record["method"].startswith(f"{HERE}:")) == ("ok", True)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"suite": "blunt"}, ValueError, "suite: got 'blunt'; accepts one-sided-blur, sharp"),
        ({"degradations": ["fog"]}, ValueError, "degradation: got 'fog'; accepts sharp, gauss 2"),
        ({"sides": ["top"]}, ValueError, "side: got 'top'; accepts left, right"),
        ({"methods": ["paper", "papre"]}, ValueError, "method: got 'papre'; accepts"),
        ({"methods": "paper"}, TypeError, "methods: got str; accepts a list"),
        ({"methods": [Method("a", own), Method("a", sparse)]}, ValueError, "methods: two of them"),
        (
            {"methods": ["paper+true-blur"], "degradations": ["mixed"]},
            ValueError,
            "no cell is left",
        ),
        ({"methods": []}, ValueError, "methods: got none"),
    ],
)
def test_refusals(
    scenes: list[Scene], arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        run_middlebury(scenes, **arguments)
    assert str(raised.value).startswith(message)


# On the command line


def test_command_prints_means_and_where_the_records_are(
    run_bench: Callable[..., Run], tree: Path
) -> None:
    code, out, err = run_bench(
        "middlebury",
        *(tree, "--degradation", "gauss 2", "sharp", "--side", "left", "right"),
        *("--method", f"{HERE}:sparse", f"{HERE}:sparse+true-blur", "--workers", "0"),
    )
    assert (code, err) == (0, "")

    records = read_store("results.jsonl")[1:]
    assert len(records) == 2 * 2 * 3

    bad = np.mean([record["v2"]["nonocc"] for record in records if not record["true_blur"]])
    assert out.count("Means over 2 of 12 scenes") == 2
    assert out.count(f"{bad:.1f}") == 6, "both sides: gauss 2 and sharp plain, gauss 2 given"
    assert "left image degraded" in out
    assert "right image degraded" in out
    assert "phasestereo bench report results.jsonl" in out


def test_command_goes_on_and_begins_anew(run_bench: Callable[..., Run], tree: Path) -> None:
    command = tree, "--method", f"{HERE}:sparse", "--workers", "0", "-o", "a.jsonl"

    assert run_bench("middlebury", *command, "--degradation", "sharp")[0] == 0
    first = read_store("a.jsonl")

    code, _, err = run_bench("middlebury", *command, "--degradation", "sharp", "mixed")
    assert code == 0
    assert "2 of 4 cells are in a.jsonl already; --fresh reruns them" in err
    assert read_store("a.jsonl")[:3] == first

    second = read_store("a.jsonl")
    assert len(second) == 5

    for aside in ("a.jsonl.bak", "a.jsonl.bak1"):
        before = read_store("a.jsonl")
        code, _, err = run_bench("middlebury", *command, "--degradation", "sharp", "--fresh")
        assert (code, err) == (0, f"phasestereo: renamed a.jsonl to {aside}\n")
        assert (read_store(aside), len(read_store("a.jsonl"))) == (before, 3)

    assert read_store("a.jsonl.bak") == second


def test_command_tells_cells_of_other_versions(
    run_bench: Callable[..., Run], tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = tree, "--degradation", "sharp", "--method", f"{HERE}:sparse", "--workers", "0"
    run_bench("middlebury", *command)
    monkeypatch.setattr("phasestereo.__version__", "99")
    assert (
        "already, 2 of them from other versions or machines; --fresh"
        in run_bench("middlebury", *command)[2]
    )


def test_failed_cells_are_reported_and_the_others_run(
    run_bench: Callable[..., Run], tree: Path
) -> None:
    methods = [f"{HERE}:{name}" for name in ("small", "integers", "nothing", "careless", "crash")]

    code, out, err = run_bench(
        "middlebury",
        *(tree, "--scene", "one", "--degradation", "sharp", "--workers", "1"),
        *("--method", *methods, "paper"),
    )

    assert code == 1
    assert err == (
        f"phasestereo: error: 5 of 6 cells failed, the first of them {methods[0]}, one, sharp: "
        "ValueError: the method returned shape (48, 71), not (48, 72)\n"
    )

    errors = [record["error"] for record in read_store("results.jsonl")[1:-1]]
    for error, words in zip(
        errors,
        ("shape (48, 71)", "int16, not floats", "NoneType", "out of luck", "code 7"),
        strict=True,
    ):
        assert words in error

    assert read_store("results.jsonl")[-1]["v2"]["nonocc"] < 5, "the images are as they were"
    assert all(f"{method} failed: " in out for method in methods)


def test_command_takes_what_the_suite_is_of(run_bench: Callable[..., Run], tree: Path) -> None:
    plant(tree, "venus")
    plant(tree, "blind", truth=False)

    common = "--degradation", "sharp", "--method", f"{HERE}:sparse", "--workers", "0"
    assert "scenes2001/venus" in SUITE_SCENES["one-sided-blur"]

    code, _, err = run_bench("middlebury", tree, *common)
    assert code == 0
    assert err == (
        "phasestereo: left out, not of one-sided-blur; --scene takes any: "
        "scenes2001/blind, scenes2001/one, scenes2001/three\n"
    )

    assert _scenes("results.jsonl") == ["venus"]

    shutil.rmtree(tree / "scenes2001" / "venus")
    code, _, err = run_bench("middlebury", tree, *common, "--suite", "sharp", "-o", "b.jsonl")
    assert (code, err) == (0, "phasestereo: left out, without a known truth: scenes2001/blind\n")
    assert _scenes("b.jsonl") == ["one", "three"]

    assert (
        run_bench("middlebury", tree, *common, "-o", "c.jsonl", "--scene", "scenes2001/*e", "ONE")[
            0
        ]
        == 0
    )
    assert _scenes("c.jsonl") == ["one", "three"]


def test_sizes_of_version_3_have_tables_of_their_own(
    run_bench: Callable[..., Run], tmp_path: Path
) -> None:
    root = tmp_path / "data" / "MiddEval3"
    for number, letter in enumerate("QHF"):
        plant_v3(root / f"training{letter}" / "Piano", 2**number)
    plant_v3(root / "trainingF" / "Jadeplant", 4)

    code, out, err = run_bench(
        *("middlebury", root.parent, "--suite", "sharp", "--scene", "training?/*"),
        *("--method", f"{HERE}:beside", "--workers", "0"),
    )
    assert code == 0, err
    records = {
        (record["collection"], record["scene"]): record
        for record in read_store("results.jsonl")[1:]
    }
    assert [record["width"] for record in records.values()] == [256, 256, 128, 64]
    assert records["MiddEval3/trainingH", "Piano"]["num_disparities"] == 160

    # 1.5 px are 6 px of the full size at a quarter of it, 3 px at half of it: beyond 2 px of it.
    name = f"{HERE}:beside"
    lines = [line.split() for line in out.splitlines()]
    for size, count, official in (("quarter", 1, 100), ("half", 1, 100), ("full", 2, 0)):
        (line,) = [line for line in lines if line[:2] == [size, name]]
        assert line[2:8] == [str(count), f"{official:.1f}", "100.0", "100.0", "0.0", "0.0"]

    (*_, title) = sharp_tables(read_results(["results.jsonl"]))
    assert title == "The sizes of version 3"


def plant_v3(folder: Path, factor: int) -> None:
    """Plant a scene of MiddEval3 at a size, everywhere at disparity SHIFT."""
    folder.mkdir(parents=True)
    height, width = 48 * factor, 64 * factor
    texture = np.random.default_rng(0).integers(40, 216, (height, width + SHIFT, 3), np.uint8)
    io.write_image(folder / "im0.png", texture[:, :-SHIFT].copy())
    io.write_image(folder / "im1.png", texture[:, SHIFT:].copy())
    io.write_disparity(folder / "disp0GT.pfm", np.full((height, width), SHIFT, np.float32))
    io.write_image(folder / "mask0nocc.png", np.full((height, width), 255, np.uint8))


def _scenes(store: str) -> list[str]:
    return sorted(record["scene"] for record in read_store(store)[1:])


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ((), 1, "no folder given"),
        (("missing",), 1, "no such folder"),
        (("empty",), 1, "no scene in"),
        (("blind",), 1, "nothing to score, no truth is known: scenes2001/blind"),
        (("blind", "--scene", "blind"), 2, "--scene: without truth there is nothing to score"),
        (("data", "--scene", "two"), 2, "--scene: got 'two'; there is scenes2001/one, scenes2001/"),
        (
            ("data", "--method", "papre"),
            2,
            "--method: got 'papre'; accepts robust, paper, fast, sad, nsad",
        ),
        (("data", "--suite", "blunt"), 2, "--suite: got 'blunt'; accepts one-sided-blur, sharp"),
        (("data", "--degradation", "fog"), 2, "--degradation: got 'fog'; accepts sharp, gauss 2"),
        (("data", "--side", "top"), 2, "--side: got 'top'; accepts left, right"),
        (("data", "--workers", "-1"), 2, "--workers"),
        (("data", "-o", "taken.txt"), 1, "taken.txt: not a file of benchmark results"),
        (("data", "-o", "taken.txt", "--fresh"), 1, "taken.txt: not a file of benchmark results"),
        (("data", "-o", "nowhere/a.jsonl"), 1, "nowhere/a.jsonl: No such file"),
    ],
)
@pytest.mark.usefixtures("tree")
def test_command_refuses(
    run_bench: Callable[..., Run],
    tmp_path: Path,
    arguments: tuple[str, ...],
    code: int,
    message: str,
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "taken.txt").write_text("my notes")
    plant(tmp_path / "blind", "blind", truth=False)
    before = sorted(tmp_path.rglob("*"))

    got, out, err = run_bench("middlebury", *arguments)
    assert (got, out) == (code, "")
    assert err.startswith(f"phasestereo: error: {message}") or message in err
    assert err.count("\n") == 1

    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "taken.txt").read_text() == "my notes"


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system has no process groups")
def test_ctrl_c_says_how_to_go_on(tree: Path, tmp_path: Path) -> None:
    store = tmp_path / "results.jsonl"
    command = [
        *(sys.executable, "-W", "error", "-m", "phasestereo", "bench", "middlebury", str(tree)),
        *("--degradation", "sharp", "--method", f"{HERE}:sparse", f"{HERE}:nap", "-o", str(store)),
    ]

    process = start([*command, "--workers", "2"], NAP="")
    wait_for_record(store, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")

    done = len(read_store(store)) - 1
    assert 1 <= done <= 2
    assert err == (
        f"phasestereo: {done} of 4 cells are in {store}; the same command does the others\n"
        "phasestereo: interrupted\n"
    )

    process = start([*command, "--workers", "2"])
    out, err = process.communicate(timeout=60)
    assert (process.returncode, len(read_store(store))) == (0, 5)
    assert err == f"phasestereo: {done} of 4 cells are in {store} already; --fresh reruns them\n"

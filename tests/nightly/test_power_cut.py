"""Runs that end at any operation on a file, and folders that came back incomplete from a backup."""

from __future__ import annotations

import shutil
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo_large import outofcore
from phasestereo_large.batch import PairFiles, Record, run
from phasestereo_large.batch.manifest import Manifest
from support import EndingError, counterpart, sampled
from support.power import PowerCutError, cut

counterpart("filelock")
counterpart("rasterio")

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="paths of open files: /proc"),
    # Nobody closes a file without power.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

OUTPUTS = "out.npy", "flags.npy"
FOLDER = Path("out.npy.part")


@pytest.fixture
def whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Write a pair in the current folder; return the result of an undisturbed run."""
    monkeypatch.chdir(tmp_path)

    random = np.random.default_rng(0)
    right = random.integers(0, 256, (160, 70), np.uint8)
    np.save("left.npy", np.roll(right, 4, axis=1))
    np.save("right.npy", right)

    match()
    found = {name: Path(name).read_bytes() for name in OUTPUTS}
    for name in OUTPUTS:
        Path(name).unlink()
    return found


def match(**options: Any) -> outofcore.MapReport:
    given: dict[str, Any] = {"preset": "fast", "window": 5, "num_disparities": 12, "threads": 1}
    given |= {"max_memory": "8GB", "band_rows": 32, "flags_output": OUTPUTS[1]}
    return outofcore.match("left.npy", "right.npy", OUTPUTS[0], **given | options)


def assert_whole(whole: dict[str, bytes]) -> None:
    assert {name: Path(name).read_bytes() for name in OUTPUTS} == whole
    names = {path.name for path in Path().iterdir()}
    assert names == {"left.npy", "right.npy", *OUTPUTS}


def end_after(bands: int) -> Callable[[int, int], None]:
    def progress(done: int, _rows: int) -> None:
        if done >= bands * 32:
            raise EndingError

    return progress


def test_whatever_the_operation_that_the_power_goes_at_the_rerun_comes_to_the_same(
    whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    with cut(monkeypatch, Path()) as power:
        match(band_rows=64)

    points = power.count
    assert points > 40
    for name in OUTPUTS:
        Path(name).unlink()

    for last in sampled(range(points)):
        with cut(monkeypatch, Path(), last) as power, pytest.raises(PowerCutError):
            match(band_rows=64)
        assert power.gone
        if not (FOLDER / "run.json").exists() and Path(OUTPUTS[0]).exists():
            assert {name: Path(name).read_bytes() for name in OUTPUTS} == whole  # it was over

        match(band_rows=64)
        assert_whole(whole)

        for name in OUTPUTS:
            Path(name).unlink()


def unfinished(bands: int) -> None:
    with pytest.raises(EndingError):
        match(progress=end_after(bands))


def files() -> list[str]:
    return sorted(path.name for path in FOLDER.iterdir())


def delete(path: Path, _older: Path) -> None:
    path.unlink()


def empty(path: Path, _older: Path) -> None:
    path.write_bytes(b"")


def flip(path: Path, _older: Path) -> None:
    content = bytearray(path.read_bytes())
    if content:
        content[2 * len(content) // 3] ^= 16
    path.write_bytes(content)


def restore(path: Path, older: Path) -> None:
    """Put back a file that an earlier run had there, under the name of this one."""
    kind = path.name[:9]
    found = sorted(file for file in older.iterdir() if file.name[:9] == kind)
    shutil.copy(found[0] if found else older / "run.json", path)


@pytest.mark.parametrize("fault", [delete, empty, flip, restore])
@pytest.mark.parametrize("preset", ["fast", "robust"])
def test_whatever_file_of_the_draft_is_missing_or_damaged_the_rerun_comes_to_the_same(
    whole: dict[str, bytes], fault: Callable[[Path, Path], None], preset: str
) -> None:
    options: dict[str, Any] = {"preset": preset}
    match(**options)
    expected = {name: Path(name).read_bytes() for name in OUTPUTS}
    assert (expected == whole) == (preset == "fast")

    with pytest.raises(EndingError):
        match(progress=end_after(2), **options)
    shutil.copytree(FOLDER, "older")
    with pytest.raises(EndingError):
        match(progress=end_after(4), **options)
    shutil.copytree(FOLDER, "saved")

    names = files()
    assert len([name for name in names if name.startswith("rows")]) == 4
    for name in sampled(names, 3):
        shutil.rmtree(FOLDER, ignore_errors=True)
        shutil.copytree("saved", FOLDER)

        before = (FOLDER / name).read_bytes()
        fault(FOLDER / name, Path("older"))
        same = (FOLDER / name).exists() and (FOLDER / name).read_bytes() == before

        stages: list[str] = []
        report = match(stage=stages.append, **options)
        assert {name: Path(name).read_bytes() for name in OUTPUTS} == expected, name
        assert not FOLDER.exists()
        # That there was a last band nobody can know when its file is gone.

        last = name.startswith("rows00000096")
        if name.startswith("rows") and not same and not (fault is delete and last):
            assert report.again, (name, fault)
            assert set(report.again) <= set(stages)
            assert report.plan.bands >= 2


def test_what_a_run_of_others_left_is_not_taken_for_that_of_this_one(
    whole: dict[str, bytes],
) -> None:
    with pytest.raises(EndingError):
        match(num_disparities=4, progress=end_after(4))
    shutil.copytree(FOLDER, "other")
    with pytest.raises(EndingError):
        match(restart=True, progress=end_after(4))
    for path in FOLDER.glob("rows*"):
        path.unlink()

    for path in Path("other").glob("rows*"):
        shutil.copy(path, FOLDER)
    shutil.rmtree("other")

    report = match()
    assert len(report.again) >= 4
    assert_whole(whole)


def test_bands_that_overlap_after_a_partial_restore_are_put_together_once(
    whole: dict[str, bytes],
) -> None:
    unfinished(3)
    shutil.copytree(FOLDER, "older")

    with pytest.raises(EndingError):
        match(restart=True, band_rows=64, progress=end_after(4))

    for path in Path("older").glob("rows*"):
        shutil.copy(path, FOLDER)
    shutil.rmtree("older")

    match()
    assert_whole(whole)


# A batch


def record(name: str, recipe: str) -> Record:
    return Record(
        name=name,
        state="done",
        left="l",
        right="r",
        num_disparities=1,
        min_disparity=0,
        recipe=recipe,
        files={f"{name}.npy": 3},
    )


def keep_records(folder: Path, recipe: str) -> None:
    """Do what a run does with its manifest."""
    manifest = Manifest(folder)
    manifest.save(["a"])
    for name in ("a", "b", "c"):
        manifest.add(record(name, recipe))
    manifest.save(["c", "b", "a"])


def test_whatever_the_operation_a_manifest_is_that_of_before_or_knows_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep_records(tmp_path, "old")
    shutil.copytree(tmp_path, tmp_path.parent / "before")
    with cut(monkeypatch, tmp_path) as power:
        keep_records(tmp_path, "new")

    assert power.count > 6

    for last in range(power.count):
        shutil.rmtree(tmp_path)
        shutil.copytree(tmp_path.parent / "before", tmp_path)
        with cut(monkeypatch, tmp_path, last), pytest.raises(PowerCutError):
            keep_records(tmp_path, "new")

        found = Manifest(tmp_path)
        assert set(found.records) == {"a", "b", "c"}
        assert {each.recipe for each in found.records.values()} <= {"old", "new"}

        keep_records(tmp_path, "new")
        assert {each.recipe for each in Manifest(tmp_path).records.values()} == {"new"}


class Here:
    """Matches in this process, which a run takes for others."""

    def __init__(self) -> None:
        self._ended: list[tuple[str, Callable[[], Any]]] = []

    def slots(self) -> int:
        return 1

    def submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> None:
        result = function(*arguments)
        self._ended.append((key, lambda: result))

    def finished(self) -> tuple[str, Callable[[], Any]]:
        return self._ended.pop(0)


def test_whatever_the_operation_the_rerun_of_a_batch_does_the_rest(
    whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasestereo_large.batch.running.local", lambda *_: nullcontext(Here()))
    assert whole

    search: dict[str, Any] = {"num_disparities": 12}
    pairs = [
        PairFiles(name=name, left=Path("left.npy"), right=Path("right.npy"), **search)
        for name in ("a", "b")
    ]
    options: dict[str, Any] = {"preset": "fast", "window": 5, "suffix": ".npy", "threads": 1}

    folder = Path("maps")
    run(pairs, folder, **options)
    expected = {pair.name: (folder / f"{pair.name}.npy").read_bytes() for pair in pairs}
    shutil.rmtree(folder)
    folder.mkdir()

    with cut(monkeypatch, folder) as power:
        run(pairs, folder, **options)
    assert power.count > 10

    for last in range(power.count):
        shutil.rmtree(folder)
        folder.mkdir()
        with cut(monkeypatch, folder, last), pytest.raises(PowerCutError):
            run(pairs, folder, **options)

        report = run(pairs, folder, **options)
        assert (report.failed, report.done + report.skipped) == ([], 2), last
        found = {pair.name: (folder / f"{pair.name}.npy").read_bytes() for pair in pairs}
        assert found == expected, last

"""The suite of surfaces: what is counted, held against loops; its cases, and the command."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo import io
from phasestereo_bench.datasets import find_scenes
from phasestereo_bench.rendering import render_room
from phasestereo_bench.store import read_store
from phasestereo_bench.surfaces import (
    SceneCase,
    TableCase,
    count_bad,
    kinds_of_pixels,
    stripes,
    surface_cases,
    surface_table,
    upsampled_table,
)
from support import Run

HERE = "test_bench_surfaces"


def flat(left: NDArray[Any], _right: Any, _count: int) -> NDArray[np.float32]:
    """Return a map of zeros: a method of the tests."""
    return np.zeros(left.shape[:2], np.float32)


def made() -> NDArray[np.float64]:
    """Return a wall at 5 px that a slanted floor begins below, a pole before both, and a hole."""
    truth = np.full((60, 200), 5.0)
    truth[30:] += 0.2 * np.arange(1, 31)[:, None]
    truth[10:50, 90:93] = 30
    truth[10:50, 130:150] = 40
    truth[5:8, 20:30] = np.nan
    return truth


def test_kinds_are_those_of_a_naive_search() -> None:
    truth = made()
    rng = np.random.default_rng(0)
    gray = 100 + rng.normal(0, 2, truth.shape)
    gray[:, 100:] += 40 * (np.arange(100) % 4 < 2)
    scored = np.ones(truth.shape, dtype=bool)
    scored[:, :10] = False
    kinds = kinds_of_pixels(truth, scored, gray)

    known = np.isfinite(truth)
    np.testing.assert_array_equal(kinds["all"], scored & known)

    pole = np.zeros(truth.shape, dtype=bool)
    pole[10:50, 90:93] = True
    np.testing.assert_array_equal(kinds["thin"], pole)
    np.testing.assert_array_equal(kinds["edge"], _near_an_edge(truth) & scored & known & ~pole)

    rest = scored & known & ~pole & ~kinds["edge"]
    np.testing.assert_array_equal(kinds["flat"] | kinds["slanted"], rest)
    assert not (kinds["flat"] & kinds["slanted"]).any()
    assert not kinds["curved"].any()
    # The floor's first rows are between both.
    assert kinds["flat"][:27][rest[:27]].all()
    assert kinds["slanted"][33:, :85][rest[33:, :85]].all()
    assert kinds["plain"][:, 12:97][kinds["all"][:, 12:97]].mean() > 0.98
    assert not kinds["plain"][:, 103:-4].any()


def _near_an_edge(truth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Search two pixels around each one for neighbors more than 2 px apart."""
    height, width = truth.shape
    near = np.zeros(truth.shape, dtype=bool)
    for y in range(height):
        for x in range(width):
            for dy, dx in ((0, 1), (1, 0)):
                there = y + dy < height and x + dx < width
                if there and abs(truth[y, x] - truth[y + dy, x + dx]) > 2:
                    # Either neighbor is 1 px from the jump, and what is beside it 2 px.
                    for i, j in ((y, x), (y + dy, x + dx)):
                        near[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = True
    return near


def test_what_is_curved_is_counted_apart() -> None:
    truth = made()
    curved = np.zeros(truth.shape, dtype=bool)
    curved[20:40, 40:60] = True
    kinds = kinds_of_pixels(truth, np.ones_like(curved), np.zeros(truth.shape), curved)
    np.testing.assert_array_equal(kinds["curved"], curved)
    assert not (kinds["curved"] & (kinds["flat"] | kinds["slanted"])).any()


def test_bad_pixels_and_stripes_are_those_of_a_loop() -> None:
    rng = np.random.default_rng(1)
    truth = rng.uniform(10, 20, (30, 40))
    found = truth + rng.normal(0, 2, truth.shape)
    found[rng.uniform(size=truth.shape) < 0.1] = np.nan
    mask = rng.uniform(size=truth.shape) < 0.5

    counts = count_bad(found, truth, {"some": mask})
    errors = [
        abs(a - b) if np.isfinite(a) else 99.0
        for a, b, there in zip(found.ravel(), truth.ravel(), mask.ravel(), strict=True)
        if there
    ]
    assert counts == {
        "pixels": {"some": len(errors)},
        "bad_1": {"some": sum(error > 1 for error in errors)},
        "bad_2": {"some": sum(error > 2 for error in errors)},
    }

    steps = [
        abs(found[y + 1, x] - found[y, x])
        for y in range(29)
        for x in range(40)
        if np.isfinite(found[y + 1, x]) and np.isfinite(found[y, x])
    ]
    assert stripes(found) == pytest.approx(np.mean([step > 2 for step in steps]))
    assert np.isnan(stripes(np.full((3, 3), np.nan)))


def plant(root: Path, name: str) -> Path:
    """Plant a scene of a third of the size, of a plane at 6 px before one at 2; return the root."""
    folder = root / name
    folder.mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 255, (60, 108, 3), dtype=np.uint8)
    truth = np.full((60, 100), 2.0)
    truth[20:40, 40:70] = 6.0
    columns = np.arange(100)[None] - truth.astype(int) + 8
    left = np.take_along_axis(picture, columns[..., None], axis=1)
    io.write_image(folder / "view1.png", left)
    io.write_image(folder / "view5.png", picture[:, 8:])
    for file in ("disp1.png", "disp5.png"):
        io.write_image(folder / file, (3 * truth).astype(np.uint8))
    io.write_image(folder / "mask_nonocc.png", np.full((60, 100), 255, np.uint8))
    return root


def test_an_upsampled_scene_is_counted_at_both_scales(tmp_path: Path) -> None:
    (scene,) = find_scenes(plant(tmp_path, "scenes2006/ThirdSize/Aloe"))
    task = SceneCase(scene, 3, "upsampled 3x").load()
    assert task.left.shape == (180, 300, 3)
    assert task.num_disparities == 240

    own, large = task.views
    assert (own.row, large.row) == ("upsampled 3x", "upsampled 3x, own pixels")
    truth = scene.load().truth
    np.testing.assert_array_equal(large.truth, np.repeat(np.repeat(3 * truth, 3, 0), 3, 1))

    # 2.4 px of the large map are 0.8 px of the scene.
    found = large.truth + 2.4
    np.testing.assert_allclose(own.seen(found), truth + 0.8)
    assert count_bad(own.seen(found), own.truth, own.kinds)["bad_1"]["all"] == 0
    every = count_bad(large.seen(found), large.truth, large.kinds)
    assert every["bad_2"]["all"] == every["pixels"]["all"] == 9 * own.kinds["all"].sum()

    # The images are the scene's, apart from interpolation and noise.
    middle = task.left[1::3, 1::3].astype(float) - scene.load().left
    assert abs(np.median(middle)) <= 1


def test_the_scale_of_a_sensors_map_is_found(tmp_path: Path) -> None:
    pair = render_room(0, "table", height=480, width=640, noise=0.5)
    folder = tmp_path / "tabletop/box"
    folder.mkdir(parents=True)
    levels = np.rint((pair.truth - 30) / 0.8).astype(np.uint8)
    levels[:, :50] = 0
    for name, image in (("left", pair.left), ("right", pair.right), ("disparity", levels)):
        io.write_image(folder / f"{name}.png", image)

    (case,) = surface_cases([tmp_path], seeds=0)
    assert isinstance(case, TableCase)
    (view,) = case.load().views
    np.testing.assert_array_equal(np.isfinite(view.truth), levels > 0)
    off = np.abs(view.truth - pair.truth)[levels > 0]
    assert np.median(off) < 0.5
    assert case.load().num_disparities > pair.truth.max()


def view(bad: int, *, curved: int = 0, striped: float = 0.01) -> dict[str, Any]:
    pixels = dict.fromkeys(("all", "plain", "flat", "slanted", "edge", "thin"), 1000)
    pixels["curved"] = curved
    wrong = dict.fromkeys(pixels, bad)
    return {
        "pixels": pixels, "bad_1": wrong, "bad_2": dict.fromkeys(pixels, bad // 2),
        "stripes": striped, "truth_stripes": 0.001,
    }  # fmt: skip


def test_tables_have_means_and_the_scene_that_loses_most() -> None:
    def record(row: str, scene: str, bad: int, **other: Any) -> dict[str, Any]:
        return {"row": row, "scene": scene, "method": "ours", "views": {row: view(bad, **other)}}

    records = [
        record("scenes as they are", "a", 50),
        record("scenes as they are", "b", 100),
        record("upsampled 2x", "a", 130, striped=0.03),
        record("upsampled 2x", "b", 90, curved=200),
    ]
    table = surface_table(records)
    assert table.header[:4] == ("row", "method", "scenes", "all")
    first, second = ([entry.text for entry in row] for row in table.rows)
    assert first[:4] == ["scenes as they are", "ours", "2", "7.5 / 3.8"]
    assert first[-2:] == ["-", "1.00 (0.10)"]
    # Only one scene has anything curved.
    assert second[-2:] == ["45.0 / 22.5", "2.00 (0.10)"]

    compared = upsampled_table(records)
    assert [entry.text for entry in compared.rows[0]] == [
        *("upsampled 2x", "ours", "7.5", "11.0", "+8.0", "a")
    ]
    assert upsampled_table(records[:2]) is None


def test_the_command_prints_a_table_and_keeps_records(run_bench: Callable[..., Run]) -> None:
    command = "surfaces", "--megapixels", "0.01", "--seeds", "1", "--method", f"{HERE}:flat"
    code, out, err = run_bench(*command, "--workers", "0")
    assert code == 0, err
    assert "plain curved things, 0.01 MP" in out
    assert "100.0 / 100.0" in out

    records = read_store("surfaces.jsonl")[1:]
    assert [record["scene"] for record in records] == ["table-0", "room-0", "curved-0"]
    counted = records[0]["views"]["rendered table tops, 0.01 MP"]
    assert counted["pixels"]["all"] == counted["bad_2"]["all"] > 5000
    assert counted["stripes"] == 0

    code, _, err = run_bench(*command, "--workers", "0")
    assert code == 0
    assert "3 of 3 maps are in surfaces.jsonl already; --fresh reruns them" in err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("--megapixels", "0"), 2, "--megapixels: got 0; accepts 0.01 to 68"),
        (("--megapixels", "nan"), 2, "--megapixels: got nan; accepts 0.01 to 68"),
        (("--seeds", "0"), 1, "there is nothing to match"),
        (("--method", "magic"), 2, "--method: got 'magic'"),
        (("nowhere",), 1, "no such folder"),
        ((".",), 1, "and for tabletop/*/left.png"),
    ],
)
def test_the_command_refuses(
    run_bench: Callable[..., Run], arguments: tuple[str, ...], code: int, message: str
) -> None:
    found, _, err = run_bench("surfaces", *arguments, "--workers", "0")
    assert message in err
    assert found == code

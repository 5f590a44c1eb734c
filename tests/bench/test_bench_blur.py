"""The benchmark of the estimation of blur: its trials, what is right about them, and its table."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phasestereo import io
from phasestereo_bench import blur as bench, read_store, run_jobs
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.degradation import Degradation, disk_psf, gaussian_psf, motion_psf
from phasestereo_bench.tables import table_texts

for module in ("scipy", "PIL"):
    pytest.importorskip(module)

SHIFT = 4
Run = tuple[int, str, str]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a folder tree with a scene of squares of many sizes, everywhere at one disparity."""
    folder = tmp_path / "data" / "scenes2001" / "squares"
    folder.mkdir(parents=True)

    rng = np.random.default_rng(7)
    y, x = np.mgrid[:120, : 170 + SHIFT]

    texture = np.zeros(y.shape)
    for side, weight in ((13, 0.3), (7, 0.25), (4, 0.2), (2, 0.15), (1, 0.1)):
        texture += weight * rng.integers(0, 256, (150, 200))[y // side, x // side]

    image = np.rint(texture).astype(np.uint8)
    io.write_image(folder / "im2.ppm", np.dstack([image[:, :-SHIFT]] * 3))
    io.write_image(folder / "im6.ppm", np.dstack([image[:, SHIFT:]] * 3))

    for file in ("disp2.pgm", "disp6.pgm"):
        io.write_image(folder / file, np.full((120, 170), 8 * SHIFT, np.uint8))

    return tmp_path / "data"


@pytest.fixture
def scene(tree: Path) -> Scene:
    return find_scenes(tree)[0]


# Trials


def test_there_are_so_many_trials(scene: Scene) -> None:
    keys = [dict(job.key) for job in bench.blur_jobs([scene])]
    assert len({json.dumps(key) for key in keys}) == len(keys) == 109
    assert {key["kind"] for key in keys} == {"blur"}
    sides = [key["side"] for key in keys]
    assert [sides.count(side) for side in ("left", "right", "both", "neither")] == [52, 52, 4, 1]
    assert len(bench.blur_jobs([scene], every=7)) == 16


@pytest.mark.parametrize(
    ("family", "psf"),
    [("gaussian", gaussian_psf(3)), ("disk", disk_psf(3)), ("motion", motion_psf(3, 40))],
)
@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_images_are_blurred_as_given(scene: Scene, family: str, psf: Any, side: str) -> None:
    pair = scene.load()
    views = bench.BlurTrial(scene, family, 3.0, 40.0, side, 2.0).views(pair)
    for view, image, name, seed in zip(
        views, (pair.left, pair.right), ("left", "right"), (1, 2), strict=True
    ):
        blurred = Degradation(psf, noise=2, seed=seed)(image)
        np.testing.assert_array_equal(view, blurred if side in (name, "both") else image)


def test_a_record_tells_what_was_found(scene: Scene, tmp_path: Path) -> None:
    (record,) = run_jobs(bench.blur_jobs([scene], every=1000), tmp_path / "a.jsonl", workers=0)

    assert record["status"] == "ok"
    assert (record["collection"], record["scene"]) == ("scenes2001", "squares")
    assert record["found"] == {"side": "none", "kind": "none", "size": 0, "angle": 0}

    assert (record["kinds"], record["areas"]) == (1, [1.0])
    assert (record["width"], record["height"]) == (170, 120)
    assert record["seconds"] > 0
    assert 0 < record["certainty"] <= 1

    tried = bench.try_out(bench.BlurTrial(scene, "disk", 4.0, 0.0, "right", 1.0))
    assert bench.verdict({"family": "disk", "size": 4, "angle": 0, "side": "right"} | tried).all


# Verdicts


def record(family: str, size: float, angle: float, side: str, /, **changes: Any) -> dict[str, Any]:
    """Return a record of a trial in which all was found, but for the changes."""
    found = {"side": side, "kind": family, "size": size, "angle": angle}
    if side in ("both", "neither"):
        found = {"side": "none", "kind": "none", "size": 0, "angle": 0}

    kinds = changes.pop("kinds", 1)
    return {
        "kind": "blur",
        "collection": "a",
        "scene": "b",
        "family": family,
        "size": size,
        "angle": angle,
        "side": side,
        "noise": 1.0,
        "status": "ok",
        "environment": "0",
        "found": found | changes,
        "kinds": kinds,
    }


@pytest.mark.parametrize(
    ("measured", "wrong"),
    [
        (record("disk", 3, 0, "left"), set()),
        (record("disk", 3, 0, "left", size=3.5), set()),
        (record("disk", 3, 0, "left", size=3.6), {"size"}),
        (record("disk", 8, 0, "left", size=8.7), set()),
        (record("disk", 8, 0, "left", size=7.1), {"size"}),
        (record("disk", 3, 0, "left", side="right"), {"side"}),
        (record("disk", 3, 0, "left", kind="gaussian"), {"kind", "size"}),
        (record("disk", 2, 0, "left", kind="gaussian", size=1.1), set()),
        (record("disk", 2, 0, "left", kind="gaussian", size=2), {"size"}),
        (record("gaussian", 1.5, 0, "left", kind="disk", size=3), set()),
        (record("gaussian", 2, 0, "left", kind="disk", size=4), {"kind", "size"}),
        (record("gaussian", 1, 0, "left", kind="motion", size=3), {"kind", "size"}),
        (record("motion", 9, 0, "left", angle=170), set()),
        (record("motion", 9, 135, "left", angle=119), {"angle"}),
        (record("motion", 9, 0, "left", kind="other"), {"kind", "size", "angle"}),
        (record("motion", 9, 0, "right", kinds=2), {"single"}),
        (record("none", 0, 0, "neither"), set()),
        (record("disk", 3, 0, "both"), set()),
        (record("disk", 3, 0, "both", side="left", kind="disk"), {"kind", "side"}),
    ],
)
def test_verdicts(measured: dict[str, Any], wrong: set[str]) -> None:
    judged = bench.verdict(measured)
    names = ("kind", "side", "size", "angle", "single")
    assert ({name for name in names if not getattr(judged, name)}, judged.all) == (wrong, not wrong)


# Results


RECORDS = [
    record("motion", 9, 30, "left", angle=34, size=9.4),
    record("motion", 9, 30, "right", kind="disk"),
    record("disk", 3, 0, "left"),
    record("gaussian", 2, 0, "left"),
    record("gaussian", 3, 0, "both"),
    record("none", 0, 0, "neither") | {"noise": 0.0},
]


def test_the_table_has_a_row_for_each_blur() -> None:
    rows = {
        row[0].text: [entry.text for entry in row[1:]] for row in bench.blur_table(RECORDS).rows
    }
    assert rows == {
        "gaussian 2": ["1", "100", "100", "100", "-", "100", "100", "0.00", "-"],
        "disk 3": ["1", "100", "100", "100", "-", "100", "100", "0.00", "-"],
        "motion 9": ["2", "50.0", "100", "50.0", "50.0", "100", "50.0", "0.40", "4.0"],
        "none: as they are": ["1", "100", "100", "-", "-", "100", "100", "-", "-"],
        "none: both alike": ["1", "100", "100", "-", "-", "100", "100", "-", "-"],
        "all": ["6", "83.3", "100", "83.3", "83.3", "100", "83.3", "0.00", "4.0"],
    }

    assert list(rows)[-1] == "all"
    assert "1 scenes; a blurred image has 8 bits and noise of 1 gray levels" in (
        bench.explain_blur(RECORDS)
    )


# The command


def test_the_command_and_its_table(run_bench: Callable[..., Run], tree: Path) -> None:
    command = "blur", tree, "--every", 40, "--workers", 0

    code, out, err = run_bench(*command)
    assert (code, err) == (0, "")
    assert "none: as they are" in out
    assert "Records: blur.jsonl" in out
    assert len(read_store("blur.jsonl")) == 1 + 3
    assert "| none: as they are | 1 | 100 |" in table_texts(Path())["blur"]

    code, again, err = run_bench(*command)
    assert (code, again) == (0, out)
    assert err == "phasestereo: 3 of 3 trials are in blur.jsonl already; --fresh reruns them\n"

    code, _, err = run_bench(*command, "--fresh")
    assert (code, err) == (0, "phasestereo: renamed blur.jsonl to blur.jsonl.bak\n")

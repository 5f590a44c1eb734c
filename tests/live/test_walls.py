"""A wall at a known distance: what is measured there is what the geometry says."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration, write_image
from phasestereo_live.walls import Wall
from support import Run, counterpart

HEIGHT, WIDTH, FOCAL, BASELINE = 300, 400, 400.0, 0.1
CAMERA = Calibration.from_focal(FOCAL, BASELINE, width=WIDTH, height=HEIGHT)
REACH = FOCAL * BASELINE

Array = NDArray[np.float64]


def rays() -> tuple[Array, Array]:
    """Return the points of an image's pixels at the distance 1, as cameras without errors do."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    return (x - (WIDTH - 1) / 2) / FOCAL, (y - (HEIGHT - 1) / 2) / FOCAL


class Scene:
    """A wall before two cameras with errors that the calibration does not know.

    Both lenses distort by ``k1``; the right camera is turned by ``yaw``, radians. The wall is
    turned by ``tilt`` about the vertical axis.
    """

    def __init__(self, distance: float, *, tilt: float = 0, k1: float = 0, yaw: float = 0) -> None:
        self.distance, self.k1, self.yaw = distance, k1, yaw
        self.normal = np.array([np.sin(tilt), 0, np.cos(tilt)])

    def points(self, *, right: bool) -> Array:
        """Return the points of the wall, (3, H, W), that the pixels of a camera see."""
        seen = rays()
        straight = seen
        for _ in range(30):
            factor = 1 + self.k1 * (straight[0] ** 2 + straight[1] ** 2)
            straight = seen[0] / factor, seen[1] / factor

        directions = np.stack([*straight, np.ones((HEIGHT, WIDTH))])
        if right:
            directions = np.einsum("ij,jhw->ihw", self.turn.T, directions)
        center = np.array([BASELINE * right, 0, 0])
        ahead = self.normal @ (np.array([0, 0, self.distance]) - center)
        steps: Array = ahead / np.einsum("i,ihw->hw", self.normal, directions)
        return center[:, None, None] + directions * steps

    @property
    def turn(self) -> Array:
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])

    def disparity(self) -> Array:
        """Return the distances of left pixels from their partners."""
        moved = self.points(right=False) - np.array([BASELINE, 0, 0])[:, None, None]
        x, y, z = np.einsum("ij,jhw->ihw", self.turn, moved)
        factor = 1 + self.k1 * ((x / z) ** 2 + (y / z) ** 2)
        result: Array = FOCAL * (rays()[0] - factor * x / z)
        return result

    def pair(self, noise: float = 0.0, frame: int = 0) -> list[NDArray[np.uint8]]:
        """Return both images: waves on the wall, of up to 0.2 periods per pixel, and noise."""
        waves = np.random.default_rng(5).uniform([0.02, 0, 0], [0.2, 1, 1], (40, 3))
        images = []
        for side in (False, True):
            x, y, z = self.points(right=side)
            along = x * self.normal[2] - (z - self.distance) * self.normal[0]
            scale = 2 * np.pi * FOCAL / self.distance
            gray = 128 + 14 * sum(
                np.cos(scale * f * (along * np.cos(6.3 * a) + y * np.sin(6.3 * a)) + 6.3 * p)
                for f, a, p in waves
            )
            gray += np.random.default_rng([frame, side]).normal(0, noise, gray.shape)
            images.append(np.clip(np.rint(gray), 0, 255).astype(np.uint8))
        return images


def made_up(disparity: Array) -> ps.Result:
    """Return a result with these disparities, all of them trusted."""
    given = disparity.astype(np.float32)
    flags = np.zeros(given.shape, np.uint16)
    settings = ps.PRESETS["robust"]
    return ps.Result(given, flags, np.ones_like(given), settings, {"matching": 0.0})


def measured(distance: float, *results: ps.Result) -> dict[str, float]:
    wall = Wall(distance, CAMERA)
    for result in results:
        wall.add(result)
    return {check.name: check.value for check in wall.test()}


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_figures_are_those_of_points_in_space(tilt: float) -> None:
    """By the plane with the least squares of distances, found another way."""
    rng = np.random.default_rng(1)
    true = Scene(2, tilt=tilt).disparity()
    frames = [true + rng.normal(0, 0.05, true.shape) for _ in range(4)]
    found = measured(2.1, *map(made_up, frames))

    part = np.s_[30:-30, 40:-40]
    x, y = (each[part].ravel() for each in rays())
    depths = [REACH / each.astype(np.float32).astype(np.float64)[part].ravel() for each in frames]
    apart, pixels, ahead = [], [], []
    for depth in depths:
        points = np.stack([x * depth, y * depth, depth], axis=1)
        center = points.mean(axis=0)
        normal = np.linalg.svd(points - center, full_matrices=False)[2][2]
        apart.append(np.sqrt(np.mean(((points - center) @ normal) ** 2)))
        plane = center @ normal / (np.stack([x, y, np.ones_like(x)], axis=1) @ normal)
        pixels.append(np.sqrt(np.mean((REACH / depth - REACH / plane) ** 2)))
        ahead.append(center @ normal / normal[2])

    assert found["fill"] == 1
    assert found["plane"] == pytest.approx(np.median(apart) / 2.1 * 100, rel=0.01)
    assert found["subpixel"] == pytest.approx(np.median(pixels), rel=0.01)
    assert found["accuracy"] == pytest.approx((np.median(ahead) / 2.1 - 1) * 100, abs=0.02)
    spread = np.median(np.std(depths, axis=0, ddof=1))
    assert found["temporal"] == pytest.approx(spread / 2.1 * 100, rel=1e-6)


@pytest.mark.parametrize(
    "errors", [{}, {"tilt": 0.3}, {"yaw": 0.003}, {"k1": -0.06}], ids=["none", "tilt", "yaw", "k1"]
)
def test_a_rendered_wall_is_measured_as_computed(errors: dict[str, float]) -> None:
    scene = Scene(1, **errors)
    computed = measured(1, made_up(scene.disparity()))
    found = measured(1, ps.match(*scene.pair(), num_disparities=64))

    assert found["fill"] == 1
    # Between whole pixels disparities are biased: by 0.08 px of 40 at most.
    assert found["accuracy"] == pytest.approx(computed["accuracy"], abs=0.2)
    assert found["subpixel"] == pytest.approx(computed["subpixel"], abs=0.05)
    assert found["plane"] == pytest.approx(computed["plane"], abs=0.05 / REACH * 100)

    if "yaw" in errors:  # 1.2 px of 40
        assert computed["accuracy"] == pytest.approx((40 / 41.2 - 1) * 100, abs=0.2)
    if "k1" in errors:
        assert computed["subpixel"] > 0.3


def test_noise_shows_from_frame_to_frame() -> None:
    scene, spreads = Scene(1), []
    for noise in (0, 2, 8):
        frames = [ps.match(*scene.pair(noise, frame), num_disparities=64) for frame in range(4)]
        found = measured(1, *frames)
        part = np.s_[30:-30, 40:-40]
        depths = [REACH / frame.disparity[part].astype(np.float64) for frame in frames]
        spread = np.median(np.std(depths, axis=0, ddof=1)) * 100
        assert found["temporal"] == pytest.approx(spread, rel=1e-6)
        spreads.append(spread)
    assert 0 == spreads[0] < spreads[1] < spreads[2] / 1.5


def test_what_the_right_camera_does_not_see_does_not_count() -> None:
    near = Scene(0.5)  # 80 px: more than the border of a tenth
    disparity = near.disparity()
    disparity[:, :80] = np.nan
    assert measured(0.5, made_up(disparity))["fill"] == 1
    disparity[30:150] = np.nan
    assert measured(0.5, made_up(disparity))["fill"] == 0.5


def test_what_is_no_wall_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^distance: got 0"):
        Wall(0, CAMERA)
    with pytest.raises(ValueError, match=r"^distance: got 0.01 m, .*accepts a wall farther away"):
        Wall(0.01, CAMERA, unit="m")
    wall = Wall(1, CAMERA)
    with pytest.raises(ValueError, match=r"^result: got 0 trusted pixels"):
        wall.add(made_up(np.full((HEIGHT, WIDTH), np.nan)))
    with pytest.raises(ValueError, match=r"^calibration: got that of 400 x 300 pixels"):
        wall.add(made_up(np.ones((10, 10))))
    with pytest.raises(ValueError, match=r"^limits: got 'rows'; accepts limits of fill, accuracy"):
        wall.test({"rows": 1})
    with pytest.raises(ValueError, match=r"^limits: got fill=nan"):
        wall.test({"fill": float("nan")})
    assert [check.passed for check in wall.test()] == [False] * 4 + [None]


# The command


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    counterpart("cyclopts")
    folder = tmp_path_factory.mktemp("wall")
    for frame in range(3):
        for side, image in zip(("left", "right"), Scene(1).pair(2, frame), strict=True):
            write_image(folder / f"{side}_{frame}.png", image)
    return folder


def test_a_wall_is_tested_beside_the_rig(frames: Path, run: Callable[..., Run]) -> None:
    words: list[Any] = ["rig", "test", frames, "--focal", 400, "--baseline", 100, "--unit", "mm"]
    code, out, _ = run(*words, "--wall", "1.0m", "--json")
    told = {check["name"]: check for check in json.loads(out)["checks"]}
    assert (code, told["fill"]["value"]) == (0, 1)
    assert abs(told["accuracy"]["value"]) < 0.05
    assert 0.01 < told["temporal"]["value"] < 0.2
    assert told["rows"]["value"] < 0.2

    code, out, err = run(*words, "--wall", "98cm", "--limit", "accuracy=1", "--limit", "rows=1")
    assert (code, "no-go: accuracy" in err) == (3, True)
    assert "FAILED: accuracy 2.0" in out
    assert " mm at 980 mm)" in out
    assert "ok: fill 1, at least 0.99" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--wall", "1m"], "--wall: needs --rectify, or --focal and --baseline"),
        (["--wall", "1m", "--focal", "9", "--baseline", "1"], "--wall: got 1m; needs --unit"),
        (["--wall", "1km"], "got 1km; accepts a distance, as 1.0m"),
        (["--wall", "0m"], "got 0m; accepts a distance"),
        (["--unit", "m"], "--unit: has no effect without --wall"),
        (
            ["--wall", "1", "--focal", "400", "--baseline", "100", "--unit", "mm"],
            "--wall: got 1 mm,",
        ),
        (["--wall", "1", "--rectify", "a", "--baseline", "1"], "--baseline: has no effect beside"),
    ],
)
def test_options_that_mean_nothing_are_refused(
    frames: Path, run: Callable[..., Run], words: list[str], message: str
) -> None:
    code, out, err = run("rig", "test", frames, *words)
    assert (code, out) == (2, "")
    assert message in " ".join(err.split())


def test_a_saved_rig_has_no_wall(tmp_path: Path, run: Callable[..., Run]) -> None:
    ps.Rig().save(tmp_path / "rig.txt")
    words = "--wall", "1", "--focal", "9", "--baseline", "1"
    code, _, err = run("rig", "test", tmp_path / "rig.txt", *words)
    assert (code, "--wall: got a saved rig" in err) == (2, True)

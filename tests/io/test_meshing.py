"""Surfaces: which pixels are joined, where they lie, and what a reader of glTF finds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration, write_glb
from support import counterpart

SHAPE = (4, 6)
RIG = Calibration.from_focal(50, 0.2, width=6, height=4)
PICTURE = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3), np.uint8)


def step_map() -> NDArray[np.float32]:
    """Return disparities of two surfaces, 5 and 8, one pixel of the first unknown."""
    disparity = np.full(SHAPE, 5, np.float32)
    disparity[:, 3:] = 8
    disparity[0, 0] = np.nan
    return disparity


def test_neighbors_of_one_surface_are_joined() -> None:
    mesh = ps.surface_mesh(step_map(), RIG, image=PICTURE)

    assert len(mesh.points) == 23
    assert len(mesh.faces) == 2 * (3 * 4 - 1)  # 2 + 2 columns of squares, one without its corner

    sides = mesh.points[mesh.faces][:, :, 2]
    assert (np.ptp(sides, axis=1) == 0).all()  # none hangs between the surfaces

    joined = ps.surface_mesh(step_map(), RIG, max_step=3)
    assert len(joined.faces) == 2 * (3 * 5 - 1)
    assert joined.picture is None


def test_corners_are_the_points_of_the_cloud() -> None:
    mesh = ps.surface_mesh(step_map(), RIG, image=PICTURE, max_depth=1.5)
    cloud = ps.point_cloud(step_map(), RIG, max_depth=1.5)
    np.testing.assert_array_equal(mesh.points, cloud.points)
    cols, rows = mesh.pixels.astype(int).T
    assert (step_map()[rows, cols] == 8).all()


def test_triangles_face_the_camera() -> None:
    mesh = ps.surface_mesh(step_map(), RIG)
    a, b, c = np.moveaxis(mesh.points[mesh.faces] * [1, -1, -1], 1, 0)  # as glTF has it
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()  # towards the viewer, at the origin, who looks along -Z


@pytest.mark.parametrize("image", [PICTURE, PICTURE[:, :, 0], None])
def test_trimesh_reads_the_surface(tmp_path: Path, image: Any) -> None:
    trimesh = counterpart("trimesh")

    mesh = ps.surface_mesh(step_map(), RIG, image=image)
    write_glb(tmp_path / "a.glb", mesh)
    (read,) = trimesh.load(tmp_path / "a.glb", process=False).geometry.values()

    assert len(read.faces) == len(mesh.faces)
    triangles = (mesh.points * np.array([1, -1, -1], np.float32))[mesh.faces]
    np.testing.assert_array_equal(read.vertices[read.faces].astype(np.float32), triangles)

    if image is None:
        return

    texture = np.asarray(read.visual.material.baseColorTexture.convert("RGB"))
    np.testing.assert_array_equal(
        texture, PICTURE if image.ndim == 3 else image[..., None].repeat(3, 2)
    )

    x = read.visual.uv[:, 0] * SHAPE[1] - 0.5
    y = (1 - read.visual.uv[:, 1]) * SHAPE[0] - 0.5
    places = np.stack([x, y], axis=1)[read.faces]
    np.testing.assert_allclose(places, mesh.pixels[mesh.faces], atol=1e-4)


def test_what_cannot_be_is_refused(tmp_path: Path) -> None:
    mesh = ps.surface_mesh(step_map(), RIG)

    with pytest.raises(ValueError, match=r"^path of a surface must end in \.glb, got '\.obj'"):
        write_glb(tmp_path / "a.obj", mesh)

    with pytest.raises(TypeError, match=r"^mesh: got ndarray; accepts a Mesh"):
        write_glb(tmp_path / "a.glb", mesh.points)  # type: ignore[arg-type]

    nothing = ps.surface_mesh(np.full(SHAPE, np.nan, np.float32), RIG)
    with pytest.raises(ValueError, match=r"^mesh: has no triangle"):
        write_glb(tmp_path / "a.glb", nothing)

    with pytest.raises(ValueError, match=r"^max_step: got 0; accepts a positive"):
        ps.surface_mesh(step_map(), RIG, max_step=0)

    with pytest.raises(ValueError, match=r"^image: got \(3, 6\) pixels; accepts the map's"):
        ps.surface_mesh(step_map(), RIG, image=PICTURE[:3])

    assert not list(tmp_path.iterdir())

"""Surfaces as glTF 2.0 in one binary file (GLB), through trimesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo._numbers import check_type
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, suffix
from phasestereo.shapes import Mesh

_TURNED = (1, -1, -1)  # glTF has Y up and looks along -Z


def write_glb(path: StrPath, mesh: Mesh) -> None:
    """Write a surface as a binary glTF file, textured with its picture.

    Parameters
    ----------
    path
        The file, ``.glb``; an existing one is replaced once the new one is complete.
    mesh
        The surface. It is turned to glTF's axes, X right, Y up and Z towards the viewer, so it
        stands upright in viewers. Corners without a triangle are dropped.

    Raises
    ------
    TypeError
        If mesh is not a `phasestereo.Mesh`.
    ValueError
        If the suffix is wrong, or the mesh has no triangles.
    OSError
        If the file cannot be written.
    ImportError
        If the extra ``mesh`` is not installed.
    """
    if suffix(path) != ".glb":
        raise ValueError(f"path of a surface must end in .glb, got {suffix(path)!r}")
    check_type("mesh", mesh, Mesh, "a Mesh")
    if not len(mesh.faces):
        raise ValueError("mesh: has no triangle, for no four neighbors are of one surface")

    content = _surface(mesh).export(file_type="glb")
    with replacing(path) as file:
        file.write(content)


def _surface(mesh: Mesh) -> Any:
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return require("trimesh", extra="mesh").Trimesh(
        vertices=mesh.points[used] * np.array(_TURNED, np.float32),
        faces=faces.reshape(-1, 3),
        visual=_texture(mesh, used),
        process=False,
    )


def _texture(mesh: Mesh, used: np.ndarray[Any, Any]) -> Any:
    """Return the picture as a trimesh texture: corners have places in it, from the bottom left."""
    if mesh.picture is None:
        return None

    visual = require("trimesh.visual", extra="mesh")
    rows, cols = mesh.picture.shape[:2]
    places = (mesh.pixels[used] + 0.5) / np.array([cols, rows], np.float32)
    places[:, 1] = 1 - places[:, 1]

    picture = require("PIL.Image", extra="mesh").fromarray(mesh.picture)
    material = visual.material.PBRMaterial(
        baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=1.0
    )
    return visual.TextureVisuals(uv=places, material=material)

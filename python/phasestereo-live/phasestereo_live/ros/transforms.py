"""How two cameras stand to each other by the transforms of a recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from phasestereo.io.rigs.cameras import Matrix

_ACROSS = 0.05  # of the baseline: what rectified cameras may be off it, and radians of their turn


def pose_between(
    transforms: Iterable[tuple[str, str, Any]], first: str, second: str
) -> Matrix | None:
    """Return the pose of the second frame in the first one, (4, 4), m.

    Parameters
    ----------
    transforms
        Of each its frame, the frame of its child, and a ``geometry_msgs/Transform``, the pose of
        the child in the frame.
    first, second
        Frames of cameras: X to the right, Z forward.

    Returns
    -------
    ndarray or None
        None: no chain of transforms joins them.
    """
    poses: dict[str, dict[str, Matrix]] = {}
    for parent, child, transform in transforms:
        pose = _pose(transform)
        poses.setdefault(parent, {})[child] = pose
        poses.setdefault(child, {})[parent] = np.asarray(np.linalg.inv(pose), np.float64)

    reached: dict[str, Matrix] = {first: np.eye(4)}
    open_ = [first]
    while open_:
        frame = open_.pop()
        for other, step in poses.get(frame, {}).items():
            if other not in reached:
                reached[other] = reached[frame] @ step
                open_.append(other)
    return None if first == second else reached.get(second)


def baseline_of(pose: Matrix | None) -> float | None:
    """Return the distance of two rectified cameras, m, by the pose of the right in the left one.

    None: there is no pose, or they do not stand side by side.
    """
    if pose is None:
        return None
    along, *across = pose[:3, 3]
    turned = np.abs(pose[:3, :3] - np.eye(3)).max()
    if not along > 0 or np.abs(across).max() > _ACROSS * along or turned > _ACROSS:
        return None
    return float(along)


def _pose(transform: Any) -> Matrix:
    """Return a transform as a matrix of 4 x 4."""
    q, t = transform.rotation, transform.translation
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / (np.linalg.norm([q.x, q.y, q.z, q.w]) or 1)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = t.x, t.y, t.z
    return pose

"""The relative pose of two cameras from the transforms of a recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from phasestereo.io.rigs.cameras import Matrix

_ACROSS = 0.05  # of the baseline: largest offset of rectified cameras across it; radians of turn


def pose_between(
    transforms: Iterable[tuple[str, str, Any]], first: str, second: str
) -> Matrix | None:
    """Return the pose of the second frame in the first one, (4, 4), m.

    Parameters
    ----------
    transforms
        For each, its frame, the frame of its child, and a ``geometry_msgs/Transform``, the pose of
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


def baseline_of(pose: Matrix | None) -> tuple[float, float] | None:
    """Return the distances of a camera to the right of a rectified one and below it, m.

    Parameters
    ----------
    pose
        (4, 4), pose of the camera in the frame of the other one; None: unknown.

    Returns
    -------
    tuple or None
        One of the two is 0. None: the pose is unknown, or the camera is neither beside nor below.
    """
    if pose is None or np.abs(pose[:3, :3] - np.eye(3)).max() > _ACROSS:
        return None
    axis = int(abs(pose[1, 3]) > abs(pose[0, 3]))
    along, across = pose[axis, 3], np.delete(pose[:3, 3], axis)
    if not along > 0 or np.abs(across).max() > _ACROSS * along:
        return None
    return (0.0, float(along)) if axis else (float(along), 0.0)


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

"""Camera pairs for tests: real ones of the shared data, one that is made up, and what they see."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.io import read_image
from support import counterpart

Floats = NDArray[np.float64]

cv2, yaml = counterpart("cv2"), counterpart("yaml")

SIZE = (160, 120)  # columns, rows
EXACT = (3, 100, 1e-12)  # criteria: iterations, and pixels


def turned(*degrees: float) -> Floats:
    """Return a rotation about x, y and z."""
    matrix = np.eye(3)
    for angle, axis in zip(np.deg2rad(degrees), np.eye(3), strict=True):
        matrix = matrix @ cv2.Rodrigues(angle * axis)[0]
    return matrix


def made_up() -> dict[str, Floats]:
    """Return the calibration of a pair of small cameras, by OpenCV's names."""
    return {
        "K1": np.array([[150.0, 0, 82], [0, 151, 57], [0, 0, 1]]),
        "D1": np.array([-0.2, 0.05, 0.001, -0.002, 0.0]),
        "K2": np.array([[148.0, 0, 77], [0, 149, 62], [0, 0, 1]]),
        "D2": np.array([-0.21, 0.06, 0.0, 0.001, 0.01]),
        "R": turned(1.0, -2.0, 0.5),
        "T": np.array([-0.12, 0.002, 0.001]),
    }


def of_opencv(rig: dict[str, Floats], size: tuple[int, int], alpha: float = -1) -> dict[str, Any]:
    """Return OpenCV's rectification by a calibration: R1, R2, P1, P2, Q and all four maps."""
    given = [rig[name] for name in ("K1", "D1", "K2", "D2")]
    r1, r2, p1, p2, q, *_ = cv2.stereoRectify(
        *given, size, rig["R"], rig["T"].reshape(3, 1), flags=cv2.CALIB_ZERO_DISPARITY, alpha=alpha
    )
    left = cv2.initUndistortRectifyMap(given[0], given[1], r1, p1, size, cv2.CV_32FC1)
    right = cv2.initUndistortRectifyMap(given[2], given[3], r2, p2, size, cv2.CV_32FC1)
    return {"R1": r1, "R2": r2, "P1": p1, "P2": p2, "Q": q, "maps": (left, right)}


def euroc_frames(data: Path) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Return the raw frames of the EuRoC rig."""
    folder = data / "rigs/euroc"
    names = sorted(path.name for path in (folder / "cam0").glob("*.png"))
    return [(read_image(folder / "cam0" / n), read_image(folder / "cam1" / n)) for n in names]


def euroc(data: Path) -> dict[str, Floats]:
    """Return the calibration of the EuRoC rig, read by other means than ours."""
    rig, poses = {}, []
    for side, camera in (("1", "cam0"), ("2", "cam1")):
        text = (data / f"rigs/euroc/{camera}/sensor.yaml").read_text().split("\n", 1)[1]
        content = yaml.safe_load(text)

        fu, fv, cu, cv = content["intrinsics"]
        rig[f"K{side}"] = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
        rig[f"D{side}"] = np.array(content["distortion_coefficients"])
        poses.append(np.array(content["T_BS"]["data"]).reshape(4, 4))

    pose = np.linalg.inv(poses[1]) @ poses[0]
    return rig | {"R": pose[:3, :3], "T": pose[:3, 3]}


@dataclass(frozen=True)
class Lens:
    """A camera: intrinsics, distortion (4 or more), and the rotation from it to the rig's frame."""

    k: Floats
    d: Floats
    r: Floats

    def sees(self, rays: Floats) -> Floats:
        """Return the pixels (N, 2) of rays of the rig's frame."""
        turned_back = rays @ self.r
        zero = np.zeros(3)
        seen: Floats = cv2.projectPoints(turned_back[:, np.newaxis], zero, zero, self.k, self.d)[0]
        return seen.reshape(-1, 2)

    def rays(self, points: Floats) -> Floats:
        """Return the rays of the rig's frame, (N, 3) with z = 1, that it sees at these pixels."""
        undo = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
        flat = undo(points[:, np.newaxis], self.k, self.d, R=self.r, P=np.eye(3), criteria=EXACT)
        return np.column_stack([flat.reshape(-1, 2), np.ones(len(points))])


def row_errors(maps: Any, left: Lens, right: Lens, shifts: Floats) -> Floats:
    """Return by how many rows things differ in rectified images, all over them and at all depths.

    Pixels of the rectified left image are led to the raw one, as rays through the true left camera
    to things at each of the depths, from there through the true right camera to the raw right
    image, and by the inverse of the right map to the rectified one.

    Parameters
    ----------
    maps
        As `phasestereo.Rectification` has them.
    left, right
        The true cameras, in one frame whose x axis is the baseline.
    shifts
        By how much things at each of the depths move from left to right, of the focal length.
    """
    (x_map, y_map), there = maps
    rows, cols = x_map.shape
    y, x = (part.ravel() for part in np.mgrid[4:rows:12, 4:cols:12])

    seen = np.stack([x_map[y, x], y_map[y, x]], axis=1).astype(np.float64)
    known = ((seen >= 0) & (seen <= (cols - 1, rows - 1))).all(axis=1)
    y, seen = y[known], seen[known]

    rays, errors = left.rays(seen), []
    for shift in shifts:
        raw = right.sees(rays - (shift, 0, 0))
        place, found = inverted(there, raw)
        errors.append((place[:, 1] - y)[found])

    return np.concatenate(errors)


def inverted(maps: Any, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the places where maps read these points, and whether they do so anywhere."""
    rows, cols = maps[0].shape
    place, off = points.copy(), np.zeros_like(points)

    for _ in range(30):
        at = place.astype(np.float32).T[:, np.newaxis]
        read = [cv2.remap(m, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for m in maps]
        off = np.stack(read, axis=-1)[0] - points
        place = place - off

    outside = (place < 0) | (place > (cols - 1, rows - 1)) | (np.abs(off) >= 0.02)
    return place, ~np.any(outside, axis=1)

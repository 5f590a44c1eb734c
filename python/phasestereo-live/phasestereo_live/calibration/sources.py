"""Sources of pictures of a board: folders, pairs of images, videos; all in gray, 8 bits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import ImageOrPath, as_pixels, as_rgb8
from phasestereo._opening import opened
from phasestereo.io.files import StrPath, describe_error, open_regular
from phasestereo.io.folders import images_of, pair_paths, paths_of_rig
from phasestereo.io.limits import check_size
from phasestereo.io.pair import Layout, read_pair, views_of

Gray: TypeAlias = NDArray[np.uint8]
BoardPaths: TypeAlias = "StrPath | Sequence[tuple[ImageOrPath, ImageOrPath]]"
Finds: TypeAlias = Callable[[Gray], "NDArray[np.float64] | None"]
"""Returns the places (N, 2) of a board's corners in a picture."""

# First bytes of files that hold frames themselves: a playlist could name files and addresses.
_CONTAINERS = ((0, b"\x1aE\xdf\xa3"), (4, b"ftyp"), (8, b"AVI "))
_SMALL = 640  # columns of the small frames to search in a video
_SAMPLES = 4  # a second
_STEADY = 0.5  # of these small pixels, from a frame to the next
_NEW = 0.04  # of the width: least difference of a pose from earlier ones
_MOST_FRAMES = 60  # to take from a video
_LOOKS = 20  # frames to check for a video of one camera
_BOTH = "accepts a video of both views side by side, or one of each camera"


class Shot(NamedTuple):
    """A pair of pictures taken at one moment: their names, and gray images (H, W).

    Without images, it has the reason why reading them failed.
    """

    names: tuple[str, str]
    images: tuple[Gray, Gray] | None
    reason: str = ""


def shots(
    left: BoardPaths, right: StrPath | None, layout: Layout | None, finds: Finds
) -> Iterator[Shot]:
    """Yield pairs of pictures.

    Parameters
    ----------
    left, right, layout
        As in `phasestereo_live.calibrate`.
    finds
        Finds a board in a small picture; videos supply only frames with a board that are steady and
        differ from earlier ones.

    Raises
    ------
    OSError, TypeError, ValueError
        If the source does not exist or is invalid.
    """
    if not isinstance(left, str | os.PathLike):
        if right is not None or layout is not None:
            raise TypeError("left: got pairs of images beside right or layout; accepts these alone")
        return _read(_checked_pairs(left))

    first, second = Path(left), None if right is None else Path(right)
    if second is not None and layout is not None:
        raise ValueError("layout: has no effect beside right; accepts None then")
    if not first.is_dir():
        return _of_video(first, second, layout or "side-by-side", finds)
    if second is not None:
        return _read(pair_paths(first, second))
    if layout is None:
        return _read(paths_of_rig(first))
    return _halved(images_of(first), layout)


def _checked_pairs(pairs: Any) -> list[tuple[ImageOrPath, ImageOrPath]]:
    listed: list[Any] = list(pairs) if isinstance(pairs, Sequence) else [None]
    if not all(isinstance(pair, Sequence) and len(pair) == 2 for pair in listed):
        raise TypeError(
            "left: accepts a folder, a video, or a list of pairs (left image, right image)"
        )
    return [(left, right) for left, right in listed]


def _read(pairs: Iterable[tuple[ImageOrPath, ImageOrPath]]) -> Iterator[Shot]:
    for number, pair in enumerate(pairs):
        names = _name(pair[0], f"left image {number}"), _name(pair[1], f"right image {number}")
        try:
            yield Shot(names, (_gray(opened(pair[0])), _gray(opened(pair[1]))))
        except (OSError, ValueError) as error:
            yield Shot(names, None, describe_error(error))


def _halved(paths: Iterable[Path], layout: Layout) -> Iterator[Shot]:
    for path in paths:
        names = f"{path} (left)", f"{path} (right)"
        try:
            left, right = read_pair(path, layout)
            yield Shot(names, (_gray(left), _gray(right)))
        except (OSError, ValueError) as error:
            yield Shot(names, None, describe_error(error))


def _name(image: ImageOrPath, otherwise: str) -> str:
    return os.fspath(image) if isinstance(image, str | os.PathLike) else otherwise


def _gray(image: ArrayLike) -> Gray:
    cv2 = require("cv2", extra="rectify")
    return cv2.cvtColor(as_rgb8(as_pixels(image, "image")).copy(), cv2.COLOR_RGB2GRAY)


def _of_video(left: Path, right: Path | None, layout: Layout, finds: Finds) -> Iterator[Shot]:
    """Yield frames of a video of both views, or of a video for each."""
    cv2 = require("cv2", extra="rectify")
    paths = [left] if right is None else [left, right]
    videos = [_opened_video(path) for path in paths]
    rate = videos[0].get(cv2.CAP_PROP_FPS)
    step = max(round((rate if 1 <= rate <= 1000 else 30) / _SAMPLES), 2)
    chosen = _Chosen(finds)
    number, spans = 0, 0

    try:
        while len(chosen.poses) < _MOST_FRAMES:
            first = _frames(videos, layout)
            second = _frames(videos, layout)
            if first is None or second is None:
                break
            if number < _LOOKS * step and right is None and layout == "side-by-side":
                spans += _spans(np.hstack(first), finds)
            if chosen.takes(first, second):
                labels = [f"{path}, frame {number}" for path in paths]
                both = labels if right else [f"{labels[0]} ({side})" for side in ("left", "right")]
                yield Shot((both[0], both[1]), first)

            number += step
            if not all(video.grab() for _ in range(step - 2) for video in videos):
                break
    finally:
        for video in videos:
            video.release()

    films = " and ".join(map(str, paths))
    if spans > len(chosen.poses):
        raise ValueError(f"{films}: is of one camera, whose frames show the board whole; {_BOTH}")
    if not chosen.poses:
        raise ValueError(f"{films}: no frame shows the board, held still, in both views; {_BOTH}")


def _spans(frame: Gray, finds: Finds) -> bool:
    """Return whether a board lies across the middle of a frame, as in one camera's video."""
    small = _small(frame)
    found = finds(small)
    return found is not None and bool(found[:, 0].min() < small.shape[1] / 2 < found[:, 0].max())


def _opened_video(path: Path) -> Any:
    cv2 = require("cv2", extra="rectify")
    with open_regular(path) as file:
        head = file.read(16)
    if not any(head[at : at + len(magic)] == magic for at, magic in _CONTAINERS):
        raise ValueError(
            f"{path}: is neither a folder nor a video; accepts MP4, MOV, MKV, WebM or AVI"
        )

    video = cv2.VideoCapture(os.fspath(path), cv2.CAP_FFMPEG)
    width, height = (
        int(video.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    )
    if not video.isOpened() or width < 1:
        raise ValueError(f"{path}: damaged, or a video that OpenCV cannot read")
    check_size(width, height)
    return video


def _frames(videos: list[Any], layout: Layout) -> tuple[Gray, Gray] | None:
    """Return the next frame of both views, or None if a video ended or breaks off."""
    read = [video.read() for video in videos]
    if not all(there for there, _ in read):
        return None
    views = views_of(read[0][1], layout) if len(read) == 1 else (read[0][1], read[1][1])
    left, right = (_gray(view[..., ::-1]) for view in views)  # OpenCV's are BGR
    return left, right


class _Chosen:
    """Chooses frames in which both views see the board, at rest, and in a new place."""

    def __init__(self, finds: Finds) -> None:
        self._finds = finds
        self.poses: list[NDArray[np.float64]] = []

    def takes(self, first: tuple[Gray, Gray], second: tuple[Gray, Gray]) -> bool:
        """Return whether to take a frame, given this one and the next one."""
        places = []
        for now, then in zip(map(_small, first), map(_small, second), strict=True):
            found = self._finds(now)
            if found is None or _motion(now, then, found) > _STEADY:
                return False
            places.append(found / now.shape[1])

        pose = np.concatenate([_pose(found) for found in places])
        if any(np.abs(pose - other).max() < _NEW for other in self.poses):
            return False
        self.poses.append(pose)
        return True


def _pose(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a board's position, size and turn: ends of its corners in four directions."""
    x, y = places.T
    along = np.stack([x, y, (x + y) / 2, (x - y) / 2])
    return np.concatenate([along.min(axis=1), along.max(axis=1)])


def _small(image: Gray) -> Gray:
    cv2 = require("cv2", extra="rectify")
    scale = min(_SMALL / image.shape[1], 1.0)
    return cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def _motion(now: Gray, then: Gray, places: NDArray[np.float64]) -> float:
    """Return the median motion of corners from one frame to the next, pixels."""
    cv2 = require("cv2", extra="rectify")
    points = places.astype(np.float32).reshape(-1, 1, 2)
    moved, found, _ = cv2.calcOpticalFlowPyrLK(now, then, points, None)
    tracked = found.ravel() == 1
    if not tracked.any():
        return np.inf
    return float(np.median(np.linalg.norm((moved - points)[tracked, 0], axis=1)))

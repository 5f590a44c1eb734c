"""Recognize a caller's source: a path, a camera, or images in memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sized
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from phasestereo.io.pair import Layout, check_layout
from phasestereo_live.video.cameras import PATIENCE, open_camera, open_cameras
from phasestereo_live.video.capture import Capture, CaptureSource, Image, Pair, join, split
from phasestereo_live.video.decoding import is_address, open_video
from phasestereo_live.video.folders import open_folder, open_folders, open_rig

Place: TypeAlias = str | os.PathLike[str] | int
"""A video file or its address, a folder of images, or the number of a camera."""

_SIDE_BY_SIDE: Layout = "side-by-side"


def open_source(
    source: Place | Iterable[Any] | CaptureSource[Pair],
    right: Place | None = None,
    *,
    layout: Layout | None = None,
    patience: int | None = PATIENCE,
) -> CaptureSource[Pair]:
    """Open the source passed to `phasestereo_live.stream`.

    Raises
    ------
    TypeError
        If it has no accepted type, or the two views are of different kinds.
    ValueError
        If a layout is unknown or has no effect, the source has no video or no image, or one view is
        a folder and the other a file.
    OSError
        If a file, a folder or a camera cannot be opened.
    ImportError
        If an extra is missing.
    """
    if layout is not None:
        check_layout(layout)

    if right is not None:
        if layout is not None:
            raise ValueError(f"layout: got {layout!r} beside right; accepts None there")
        return _open_views(source, right, patience)

    if isinstance(source, int) and not isinstance(source, bool):
        return split(open_camera(source, patience), layout or _SIDE_BY_SIDE)

    if isinstance(source, str | os.PathLike):
        if not _is_folder(source):
            return split(open_video(source), layout or _SIDE_BY_SIDE)
        folder = Path(source)
        return open_rig(folder) if layout is None else split(open_folder(folder), layout)

    if isinstance(source, Iterable | CaptureSource):
        return _open_given(source, layout)
    raise TypeError(
        f"source: got {type(source).__name__}; accepts a path, the number of a camera, or an "
        "iterable of pairs of images"
    )


def _open_given(
    source: Iterable[Any] | CaptureSource[Pair], layout: Layout | None
) -> CaptureSource[Pair]:
    """Return the caller's source of pairs, or of images with both views."""
    if isinstance(source, CaptureSource):
        if layout is not None:
            raise ValueError(f"layout: got {layout!r} for a source of pairs; accepts None there")
        return source

    if layout is None:
        return _at_hand(source, _as_pair)
    return split(_at_hand(source, np.asarray), layout)


def _open_views(
    left: Place | Iterable[Any] | CaptureSource[Pair], right: Place, patience: int | None
) -> CaptureSource[Pair]:
    """Open a source for each view."""
    if isinstance(left, str | os.PathLike) and isinstance(right, str | os.PathLike):
        folders = [_is_folder(path) for path in (left, right)]
        if all(folders):
            return open_folders(Path(left), Path(right))
        if not any(folders):
            return _open_videos(left, right)
        raise ValueError(
            f"right: got {os.fspath(right)} beside {os.fspath(left)}, a folder and a file; accepts "
            "two folders or two videos"
        )

    if isinstance(left, int) and isinstance(right, int) and bool not in (type(left), type(right)):
        if left == right:
            raise ValueError(f"right: got camera {right}, which is the left one, too")
        return open_cameras(left, right, patience)

    raise TypeError(
        f"right: got {type(right).__name__} beside {type(left).__name__}; accepts two videos, two "
        "folders of images, or the numbers of two cameras"
    )


def _open_videos(
    left: str | os.PathLike[str], right: str | os.PathLike[str]
) -> CaptureSource[Pair]:
    first = open_video(left)
    try:
        return join(first, open_video(right))
    except BaseException:
        first.close()
        raise


def _is_folder(path: str | os.PathLike[str]) -> bool:
    return not is_address(os.fspath(path)) and Path(path).is_dir()


def _at_hand(items: Iterable[Any], taken: Callable[[Any], Any]) -> CaptureSource[Any]:
    """Return a source of an iterable's items; the iterable's errors pass to the caller."""
    captures = (Capture(index, None, partial(taken, item)) for index, item in enumerate(items))
    length = len(items) if isinstance(items, Sized) else None
    return CaptureSource(captures=captures, length=length)


def _as_pair(item: Any) -> tuple[Image, Image]:
    try:
        left, right = item
    except (TypeError, ValueError):
        kind = type(item).__name__
        raise TypeError(f"source: got {kind} for a frame; accepts a pair (left, right)") from None
    return left, right

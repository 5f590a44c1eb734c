"""The record of a rectification: two images with corresponding rows, and their maps."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import ImageOrPath, Map, Mask, as_mask, as_views
from phasestereo._opening import opened_alike
from phasestereo.io.calibration import Calibration
from phasestereo.io.depth import LengthUnit
from phasestereo.io.drafts import replacing
from phasestereo.io.rigs.cameras import MAPS, Cameras, Maps, Matrix
from phasestereo.io.rigs.documents import Document, read_document
from phasestereo.io.rigs.reading import (
    CalibrationSource,
    cameras_of_files,
    named_all,
    read_cameras,
    read_documents,
)

Method = Literal["calibration", "images"]
Interpolation = Literal["linear", "cubic", "lanczos"]

_IMAGES = "left", "right", "left_mask", "right_mask"
_METHODS = "calibration", "images"
INTERPOLATIONS = {"linear": "INTER_LINEAR", "cubic": "INTER_CUBIC", "lanczos": "INTER_LANCZOS4"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rectification:
    """A rectified pair and its maps; it can be pickled and saved.

    `phasestereo.match` takes it as ``match(r.left, r.right, left_mask=r.left_mask,
    right_mask=r.right_mask, ...)``.

    Parameters
    ----------
    left, right
        The rectified images, (H, W) or (H, W, 3), each with its original dtype, both of the left
        one's size.
    left_mask, right_mask
        bool (H, W): False where a rectified pixel lies outside the original image.
    maps
        ``((left x, left y), (right x, right y))``, each float32 (H, W): the column and the row of
        the original image, the right one at the left one's size, at which a rectified pixel is
        read, as ``cv2.remap`` takes them.
    Q
        OpenCV's matrix of the rectified pair, (4, 4), for `phasestereo.io.Calibration.from_q`.
        None: unknown, as without a calibration, since images do not show the scale of a scene.
    method
        ``"calibration"``, or ``"images"``: from the images alone.
    interpolation
        The interpolation between pixels: "linear", "cubic" or "lanczos".
    error
        Root mean square error of the row correspondence, pixels: measured on the pair with a
        calibration or an earlier rectification; without one, expected over the whole image. None:
        the images share too little.
    sentences
        Findings, in plain words.
    vertical
        Whether the right camera is below the left one: then columns correspond, and `match` takes
        the pair with ``vertical=True``.
    unit
        The unit of the baseline in `Q`; None: unknown.
    refuted
        Whether the images refute the calibration: rows do not correspond, as a sentence says.

    Examples
    --------
    >>> rig = ps.rectify(left, right)
    >>> rig.save("rig.npz")
    >>> again = ps.Rectification.load("rig.npz").apply(left, right)
    """

    left: NDArray[Any]
    right: NDArray[Any]
    left_mask: NDArray[np.bool_]
    right_mask: NDArray[np.bool_]
    maps: Maps
    Q: Matrix | None
    method: Method
    interpolation: Interpolation
    error: float | None
    sentences: tuple[str, ...]
    vertical: bool = False
    unit: LengthUnit | None = None
    refuted: bool = False

    @property
    def calibration(self) -> Calibration | None:
        """The geometry of the rectified pair, for depths and points; None: unknown."""
        if self.Q is None:
            return None
        rows, cols = self.left.shape[:2]
        return Calibration.from_q(self.Q, width=cols, height=rows, unit=self.unit)

    def apply(self, left: ImageOrPath, right: ImageOrPath) -> tuple[NDArray[Any], NDArray[Any]]:
        """Rectify another pair of the same cameras.

        Parameters
        ----------
        left, right
            Images as `phasestereo.match` takes them, the left one of the first pair's size.

        Returns
        -------
        tuple
            The rectified images. The masks are those of the first pair.

        Raises
        ------
        TypeError, ValueError
            As `phasestereo.match`, and for another size.
        ImportError
            If the extra ``rectify`` is not installed.
        """
        return warped((left, right), self.maps, self.interpolation)

    def as_dict(self) -> dict[str, Any]:
        """Return method, error and sentences for JSON."""
        return {"method": self.method, "error": self.error, "sentences": list(self.sentences)}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, ``.npz`` without pickled objects, which `load` reads.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        plain = self.as_dict() | {
            "interpolation": self.interpolation,
            "vertical": self.vertical,
            "unit": self.unit,
            "refuted": self.refuted,
        }
        arrays = {name: getattr(self, name) for name in _IMAGES}
        arrays |= dict(zip(MAPS, (*self.maps[0], *self.maps[1]), strict=True))
        if self.Q is not None:
            arrays["Q"] = self.Q

        with replacing(path) as file:
            np.savez(file, allow_pickle=False, plain=np.array(json.dumps(plain)), **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Rectification:
        """Read a file written by `save`.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is not such a file, or is damaged.
        """
        return _loaded(read_document(path), os.fspath(path))

    def __repr__(self) -> str:
        """Show the size and the sentences, not the arrays."""
        rows, cols = self.left.shape[:2]
        error = "rows not measured" if self.error is None else f"rows to {self.error:.2f} px"
        return f"<Rectification {cols}x{rows} from {self.method}, {error}>"


def read_calibration(
    source: CalibrationSource | Rectification | Cameras,
) -> Cameras | Rectification:
    """Return the camera pair of a calibration, or a saved rectification.

    Parameters
    ----------
    source
        As `phasestereo.io.rigs.reading.read_cameras` takes it, or the file of a rectification. A
        camera pair or a rectification is returned unchanged.

    Raises
    ------
    TypeError, OSError, ValueError, ImportError
        As `read_cameras`.
    """
    if isinstance(source, Rectification | Cameras):
        return source
    if isinstance(source, Mapping):
        return read_cameras(source)

    paths, documents = read_documents(source)
    if len(documents) == 1 and is_saved(documents[0]):
        return _loaded(documents[0], named_all(paths))
    return cameras_of_files(documents, named_all(paths))


def is_saved(document: Document) -> bool:
    """Return whether `Rectification.save` wrote a file."""
    return "plain" in document and all(name in document for name in (*MAPS, *_IMAGES))


def _loaded(document: Document, name: str) -> Rectification:
    try:
        return from_document(document)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{name}: not a saved rectification ({error})") from error


def from_document(document: Document) -> Rectification:
    """Return the rectification that a file holds.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it holds no rectification.
    """
    plain = json.loads(str(document["plain"]))
    left, right, left_mask, right_mask = (document[name] for name in _IMAGES)
    x1, y1, x2, y2 = maps = [document[name] for name in MAPS]
    q, error = document.get("Q"), plain["error"]

    # Files may be hostile: everything is checked.
    as_views(left, right)
    size = left.shape[:2]
    if right.shape[:2] != size or any(
        part.shape != size or part.dtype != np.float32 for part in maps
    ):
        raise ValueError("maps that are not those of the images")
    if any(mask.shape != size or mask.dtype != np.bool_ for mask in (left_mask, right_mask)):
        raise ValueError("masks that are not those of the images")
    if q is not None and (q.shape != (4, 4) or q.dtype != np.float64):
        raise ValueError("a matrix Q that is invalid")
    if plain["interpolation"] not in INTERPOLATIONS or plain["method"] not in _METHODS:
        raise ValueError("a way to rectify that is not known")

    return Rectification(
        left=left,
        right=right,
        left_mask=left_mask,
        right_mask=right_mask,
        maps=((x1, y1), (x2, y2)),
        Q=q,
        method=plain["method"],
        interpolation=plain["interpolation"],
        error=None if error is None else float(error),
        sentences=tuple(str(sentence) for sentence in plain["sentences"]),
        vertical=plain["vertical"] is True,
        unit=next((unit for unit in get_args(LengthUnit) if unit == plain.get("unit")), None),
        refuted=plain.get("refuted") is True,
    )


def warped(
    images: tuple[ImageOrPath, ImageOrPath], maps: Maps, interpolation: Interpolation
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return both images of a pair, read at their maps.

    Raises
    ------
    TypeError, ValueError
        If they are not a pair, or differ in size from the maps.
    """
    cv2 = require("cv2", extra="rectify")
    pair = opened_alike(images).pair
    size = maps[0][0].shape

    if pair[0].shape[:2] != size:
        raise ValueError(f"left: got {pair[0].shape[:2]} pixels; accepts those of the maps, {size}")

    flag = getattr(cv2, INTERPOLATIONS[interpolation])
    left, right = (cv2.remap(image, x, y, flag) for image, (x, y) in zip(pair, maps, strict=True))
    return left, right


def masks_of(
    maps: Maps, size: tuple[int, ...], given: tuple[ArrayLike | None, ArrayLike | None]
) -> tuple[Mask, Mask]:
    """Return masks of rectified pixels that fall on valid pixels of images of this size.

    Raises
    ------
    TypeError, ValueError
        If a mask is invalid or of another size.
    """
    cv2 = require("cv2", extra="rectify")
    found = []
    for part, mask, name in zip(maps, given, ("left_mask", "right_mask"), strict=True):
        valid = as_mask(mask, size, name)
        there = inside(part, size)
        if valid is not None:
            invalid = cv2.remap((~valid).astype(np.float32), *part, cv2.INTER_LINEAR)
            there &= invalid == 0
        found.append(there)

    left, right = found
    return left, right


def inside(maps: tuple[Map, Map], size: tuple[int, ...]) -> Mask:
    """Return the mask of map entries inside an image of this size (rows, columns)."""
    x, y = maps
    return (x >= 0) & (x <= size[1] - 1) & (y >= 0) & (y <= size[0] - 1)

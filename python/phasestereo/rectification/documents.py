"""Files of named matrices: YAML, XML, ``.npz``, folders of ``.npy``; nothing in them is run."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from phasestereo._extras import require
from phasestereo.io.files import StrPath, decoding, read_bounded
from phasestereo.io.limits import SMALL, max_pixels
from phasestereo.io.npz import decode_array, decode_arrays

Document: TypeAlias = dict[str, Any]

ACCEPTED = (
    "OpenCV's .yml, .xml or .npz with K1, D1, K2, D2, R, T; a folder of .npy named so; a pair of "
    "ROS's camera_info or of EuRoC's sensor.yaml; Kalibr's camchain; a saved rectification"
)
_MOST_TEXT = 2**17  # bytes: YAML is read slowly, and calibrations have some thousands
_DEEPEST = 32  # lists and mappings in each other
_MOST_FILES = 64  # of a folder
_MAP_BYTES = 16 + 16 + 26  # of a pixel: two maps, and images of three floats with a mask each
_XML_MATRIX = re.compile(
    r'<(\w+) type_id="opencv-(?:nd-)?matrix">\s*'
    r"(?:<rows>(\d{1,5})</rows>\s*<cols>(\d{1,5})</cols>|<sizes>([\d\s]{1,99})</sizes>)\s*"
    r'<dt>"?\w+"?</dt>\s*<data>([^<]*)</data>\s*</\1>'
)
# OpenCV 5 writes vectors as the latter, with a list of sizes.
_MATRICES = "tag:yaml.org,2002:opencv-matrix", "tag:yaml.org,2002:opencv-nd-matrix"


def read_document(path: StrPath) -> Document:
    """Read what a file, or a folder of ``.npy`` files, holds by name.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is damaged, too large, or nothing of `ACCEPTED`.
    ImportError
        If it is YAML, and the extra ``rectify`` is not installed.
    """
    if Path(path).is_dir():
        return _read_folder(Path(path))
    with decoding(path) as file:
        head = file.read(8)
        file.seek(0)
        if head.startswith(b"PK"):
            most = _MAP_BYTES * max_pixels() + SMALL
            return dict(decode_arrays(read_bounded(file, most), most))

        text = _text(file)
        if text.lstrip().startswith("<?xml"):
            return _of_xml(text)
        return _of_yaml(text)


def _read_folder(folder: Path) -> Document:
    paths = sorted(folder.glob("*.npy"))
    if not paths:
        raise ValueError(f"{folder}: a folder without .npy files; accepts {ACCEPTED}")
    if len(paths) > _MOST_FILES:
        raise ValueError(f"{folder}: has {len(paths)} .npy files; accepts {_MOST_FILES} at most")

    found: Document = {}
    for path in paths:
        with decoding(path) as file:
            found[path.stem] = decode_array(read_bounded(file, 8 * max_pixels() + SMALL))
    return found


def _text(file: BinaryIO) -> str:
    try:
        text = read_bounded(file, _MOST_TEXT).decode("utf-8-sig")
    except ValueError as error:  # of what cannot be decoded, too
        raise ValueError(f"no calibration; accepts {ACCEPTED}") from error

    if "\0" in text:
        raise ValueError(f"no calibration; accepts {ACCEPTED}")
    return text


def _of_xml(text: str) -> Document:
    """Return the matrices of a file as cv2.FileStorage writes it: it knows no entities."""
    return {
        name: _matrix({"sizes": sizes.split() or [rows, cols], "data": data.split()})
        for name, rows, cols, sizes, data in _XML_MATRIX.findall(text)
    }


def _of_yaml(text: str) -> Document:
    """Return what a YAML file holds; OpenCV's has a header of its own, which YAML does not know."""
    yaml = require("yaml", extra="rectify")
    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the one in C is ten times as fast

    class Loader(base):  # type: ignore[misc, valid-type]  # known at run time
        """Plain values and OpenCV's matrices."""

    def construct(loader: Any, node: Any) -> Any:
        return _matrix(loader.construct_mapping(node, deep=True))

    for tag in _MATRICES:
        Loader.add_constructor(tag, construct)
    body = re.sub(r"\A%YAML[^\n]*\n(---[^\n]*\n)?", "", text)

    try:
        _check_events(yaml, yaml.parse(body, Loader=base))
        document = yaml.load(body, Loader=Loader)  # a safe loader
    except (yaml.YAMLError, RecursionError) as error:
        where = getattr(error, "problem_mark", None)
        line = "" if where is None else f" (YAML breaks off at line {where.line + 1})"
        raise ValueError(f"no calibration{line}; accepts {ACCEPTED}") from error

    if isinstance(document, dict):
        return {str(name): value for name, value in document.items()}
    raise ValueError(f"no calibration; accepts {ACCEPTED}")


def _check_events(yaml: Any, events: Iterable[Any]) -> None:
    """Refuse aliases, of which a few lines make gigabytes, and what is nested very deeply."""
    depth = 0
    for event in events:
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("has aliases (*), which are not read")  # noqa: TRY004 -- the file's
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise ValueError(f"is nested more than {_DEEPEST} deep")


def _matrix(mapping: Document) -> Any:
    """Return the matrix that a mapping of rows and columns, or of sizes, and of data holds."""
    numbers = np.array([float(value) for value in mapping["data"]])
    sizes = mapping["sizes"] if "sizes" in mapping else (mapping["rows"], mapping["cols"])
    shape = [int(size) for size in sizes]
    if numbers.size != math.prod(shape):
        raise ValueError(f"a matrix of {' x '.join(map(str, shape))} has {numbers.size} numbers")
    return numbers.reshape(shape)


def numbers(value: Any, name: str) -> Any:
    """Return the matrix that a list, a list of lists, or rows, columns and data hold.

    Raises
    ------
    ValueError
        If they hold none.
    """
    try:
        if isinstance(value, dict):
            return _matrix(value)
        return np.asarray(value).astype(np.float64)
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"{name}: holds no matrix of numbers") from error

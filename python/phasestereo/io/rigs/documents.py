"""Files of named values: YAML, JSON, XML, INI, ``.npz``, ``.mat``, folders. Runs no code.

It does not use `cv2.FileStorage`: in OpenCV 5.0 it ends the process on 50 kB of open brackets.
"""

from __future__ import annotations

import ast
import configparser
import io
import json
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from xml.etree import ElementTree as ET

import numpy as np

from phasestereo._extras import require
from phasestereo.io.files import StrPath, decoding, read_bounded
from phasestereo.io.limits import SMALL, max_pixels
from phasestereo.io.npy import decode_array, decode_arrays

Document: TypeAlias = dict[str, Any]

MIDDLEBURY, NUMBERS, XML, COLMAP = "(calib.txt)", "(numbers)", "(xml)", "(colmap)"
"""Names of what a file holds that has no names of its own."""

ACCEPTED = (
    "OpenCV's .yml, .xml, .json or .npz with K1, D1, K2, D2, R, T; a folder of .npy named so; a "
    "pair of ROS's camera_info, of EuRoC's sensor.yaml or of mrcal's .cameramodel; Kalibr's "
    "camchain; OAK's JSON; ZED's .conf; KITTI's and Middlebury's calib.txt; ORB-SLAM's and OKVIS's "
    "YAML; FoundationStereo's K.txt; MATLAB's .mat; a COLMAP model or Metashape's XML of two "
    "images; a saved rectification"
)
_MOST_TEXT = 2**17  # bytes: YAML is slow to read, and calibrations have a few thousand
_DEEPEST = 32  # lists and mappings in each other
_MOST_FILES = 64  # of a folder
_MAP_BYTES = 16 + 16 + 26  # of a pixel: two maps, and images of three floats with a mask each
_MATRICES = "tag:yaml.org,2002:opencv-matrix", "tag:yaml.org,2002:opencv-nd-matrix"
# OpenCV 5 writes vectors as the latter, with a list of sizes.
_HDF = b"\x89HDF"
_FOREIGN = {
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"II*\0": "a TIFF picture",
    b"MM\0*": "a TIFF picture",
    b"%PDF": "a PDF document",
    _HDF: "an HDF5 file, as MATLAB writes with -v7.3; save it with -v7",
    b"\x80": "a Python pickle, which could run anything; save the matrices by numpy.savez",
    b"SQLi": "an SQLite database, as of COLMAP or a recording; give COLMAP's model, its folder",
    b"\x1f\x8b": "a gzip archive; unpack it",
}
"""How files begin that are not calibrations, and what they are."""


def read_document(path: StrPath) -> Document:
    """Read the contents of a file, or of a folder of ``.npy`` files, by name.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is damaged, too large, or not in `ACCEPTED`.
    ImportError
        If it is YAML, and the extra ``rectify`` is not installed; if it is a ``.mat`` file or a
        model of COLMAP, and scipy or pycolmap is not installed.
    """
    if Path(path).is_dir():
        return _read_folder(Path(path))
    with decoding(path) as file:
        head = file.read(8)
        file.seek(0)
        if head.startswith(b"PK"):
            most = _MAP_BYTES * max_pixels() + SMALL
            return dict(decode_arrays(read_bounded(file, most), most))
        if head.startswith(b"\x93NUMPY"):  # one array alone: a matrix Q
            return {"Q": decode_array(read_bounded(file, SMALL))}
        if head.startswith(b"MATLAB"):
            return _of_matlab(read_bounded(file, SMALL))
        return of_text(_text(file))


def of_text(text: str) -> Document:
    """Return a text's contents by name: JSON, mrcal's, XML, INI, Middlebury's, numbers or YAML.

    Raises
    ------
    ValueError
        If it is damaged, or in none of these formats.
    """
    body = re.sub(r"(?m)\A(?:\s*#.*\n)+", "", text).strip()
    if body.startswith("{") and (found := _of_braces(body)) is not None:
        return found
    if body.startswith("<"):
        return _of_xml(body)
    if re.match(r"\[[\w ]+\]\s*\n", body):
        return _of_sections(body)
    if re.match(r"\w+ *=", body):
        return {MIDDLEBURY: text}
    if body and re.fullmatch(r"[-+.\deE,\s]+", body):
        return {NUMBERS: [float(word) for word in body.replace(",", " ").split()]}
    if len(text) > _MOST_TEXT:
        raise ValueError(f"has more than the {_MOST_TEXT} bytes that YAML is read to")
    return _of_yaml(text)


def _read_folder(folder: Path) -> Document:
    if any((folder / f"images.{ending}").is_file() for ending in ("bin", "txt")):
        return {COLMAP: folder}

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
    content = read_bounded(file, SMALL)
    for head, kind in _FOREIGN.items():
        if content.startswith(head):
            raise ValueError(f"is {kind}; accepts {ACCEPTED}")
    try:
        text = content.decode("utf-8-sig")
    except ValueError as error:  # also for text that cannot be decoded
        raise ValueError(f"is not text; accepts {ACCEPTED}") from error

    if "\0" in text:
        raise ValueError(f"is not text; accepts {ACCEPTED}")
    return text


def _of_braces(text: str) -> Document | None:
    """Return the contents of JSON, or of mrcal's Python literal; None: neither."""
    try:
        found = ast.literal_eval(text) if "'lensmodel'" in text else json.loads(text)
    except (MemoryError, RecursionError, SyntaxError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _of_sections(text: str) -> Document:
    """Return the sections of an INI file, by their names and those of their values in capitals."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise ValueError(f"is a damaged INI file ({str(error).splitlines()[0]})") from error
    return {name.upper(): {k.upper(): v for k, v in parser[name].items()} for name in parser}


def _of_matlab(content: bytes) -> Document:
    """Return the variables of a ``.mat`` file, structures as mappings."""
    module = require("scipy.io", extra="rigs")
    try:
        shapes = [math.prod(shape) for _, shape, _ in module.whosmat(io.BytesIO(content))]
        if sum(shapes) > SMALL:
            raise ValueError(f"has {sum(shapes)} numbers; accepts {SMALL} at most")
        found = module.loadmat(io.BytesIO(content), simplify_cells=True)
    except NotImplementedError as error:
        raise ValueError(f"is {_FOREIGN[_HDF]}") from error
    except (KeyError, TypeError, OSError) as error:
        raise ValueError(f"is a damaged .mat file ({error})") from error

    # MATLAB stores its objects in a form that only MATLAB reads.
    if "__function_workspace__" in found or "None" in found:
        raise ValueError(
            "holds an object of MATLAB, such as stereoParameters, which MATLAB alone reads; there: "
            "s = toStruct(stereoParams); save('rig.mat', '-struct', 's', '-v7')"
        )
    values = {name: value for name, value in found.items() if not name.startswith("__")}
    inner = list(values.values())
    return inner[0] if len(inner) == 1 and isinstance(inner[0], dict) else values


def _of_xml(text: str) -> Document:
    """Return the matrices of a file of cv2.FileStorage, or the tree of another one."""
    try:
        tree = ET.fromstring(text)  # noqa: S314 -- expat since 2.4.1 bounds entities, `SMALL` the text
    except ET.ParseError as error:
        raise ValueError(f"is damaged XML ({error})") from error
    if tree.tag != "opencv_storage":
        return {XML: tree}

    found: Document = {}
    for node in tree:
        parts = {part.tag: (part.text or "").split() for part in node}
        if "data" in parts:
            sizes = parts.get("sizes") or [*parts.get("rows", []), *parts.get("cols", [])]
            found[node.tag] = _matrix({"sizes": sizes, "data": parts["data"]})
        elif not len(node):
            found[node.tag] = (node.text or "").strip().strip('"')
    return found


def _of_yaml(text: str) -> Document:
    """Return the contents of a YAML file; OpenCV's has a header that is not valid YAML."""
    yaml = require("yaml", extra="rectify")
    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the one in C is ten times as fast

    class Loader(base):  # type: ignore[misc, valid-type]  # known at run time
        """Plain values and OpenCV's matrices."""

    def construct(loader: Any, node: Any) -> Any:
        return _matrix(loader.construct_mapping(node, deep=True))

    for tag in _MATRICES:
        Loader.add_constructor(tag, construct)
    body = re.sub(r"\A%YAML[^\n]*\n(---[^\n]*\n)?", "", text)
    if body != text:
        body = re.sub(r"(?m)^(\s*[\w.]+:)(?=[^\s:])", r"\1 ", body)  # OpenCV needs no space there

    body = re.sub(r"\n---\s*\Z", "\n", body)  # as `ros2 topic echo` ends a message
    try:
        _check_events(yaml, yaml.parse(body, Loader=base))
        document = yaml.load(body, Loader=Loader)  # a safe loader
    except (yaml.YAMLError, RecursionError) as error:
        where = getattr(error, "problem_mark", None)
        line = "" if where is None else f" (YAML breaks off at line {where.line + 1})"
        raise ValueError(f"is text, but not a calibration{line}; accepts {ACCEPTED}") from error

    if isinstance(document, dict):
        return {str(name): value for name, value in document.items()}
    raise ValueError(f"is text, but not a calibration; accepts {ACCEPTED}")


def _check_events(yaml: Any, events: Iterable[Any]) -> None:
    """Refuse aliases, which make gigabytes from a few lines, and very deep nesting."""
    depth = 0
    for event in events:
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("has aliases (*), which are not read")  # noqa: TRY004 -- the file's
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise ValueError(f"is nested more than {_DEEPEST} deep")


def _matrix(mapping: Document) -> Any:
    """Return the matrix in a mapping of data with rows and columns, or with sizes."""
    numbers = np.array([float(value) for value in mapping["data"]])
    sizes = mapping["sizes"] if "sizes" in mapping else (mapping["rows"], mapping["cols"])
    shape = [int(size) for size in sizes]
    if numbers.size != math.prod(shape):
        raise ValueError(f"a matrix of {' x '.join(map(str, shape))} has {numbers.size} numbers")
    return numbers.reshape(shape)


def numbers(value: Any, name: str) -> Any:
    """Return the matrix in a list, a list of lists, or rows, columns and data.

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

"""Networks in ONNX files, run by onnxruntime on the processor; without weights of our own.

The inputs of a file, of float32, float16 or uint8, determine its layout:

- one input of rank 4 with 2 channels: the gray images, left first; with 6: both in color;
- two inputs of rank 4 with 1 or 3 channels each: the left and the right image.

Channels are first or last, whichever dimension has one of these numbers. Values are from 0 to 1,
those of uint8 from 0 to 255. The first output holds the disparities of the left image in pixels, at
the size of the input; its other dimensions are 1. Images are extended at the right and at the
bottom, by repeating their edge, to the size that the file requires or to multiples of 64, and the
output is cropped again.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Map

Image: TypeAlias = NDArray[np.uint8]

_MULTIPLE = 64  # px: multiples that networks with several scales take
_GRAY = np.array([0.299, 0.587, 0.114])
_CHANNELS = {1: (2, 6), 2: (1, 3)}  # of each input, by how many inputs there are
_DTYPES: dict[str, np.dtype[Any]] = {
    "tensor(float)": np.dtype(np.float32),
    "tensor(float16)": np.dtype(np.float16),
    "tensor(uint8)": np.dtype(np.uint8),
}


class NetworkInputs(NamedTuple):
    """The inputs of a network.

    Attributes
    ----------
    names
        Their names: one for both images, or one for each.
    channels
        Of each input.
    last
        Whether channels come last.
    size
        Height and width if the file fixes them, else None.
    dtype
        Of the inputs.
    """

    names: tuple[str, ...]
    channels: int
    last: bool
    size: tuple[int | None, int | None]
    dtype: np.dtype[Any]


def match_onnx(
    left: Image,
    right: Image,
    num_disparities: int,  # noqa: ARG001 - as all matchers
    *,
    path: str,
    threads: int | None = None,
    white: float = 1.0,
) -> Map:
    """Match with the network in an ONNX file, which takes no range.

    Parameters
    ----------
    left, right
        uint8 (H, W) or (H, W, 3), RGB.
    num_disparities
        Not used.
    path
        The file.
    threads
        Number of threads, from 1; None: onnxruntime's default.
    white
        The value of white pixels in an input of floats.

    Returns
    -------
    ndarray
        float32 (H, W), pixels.

    Raises
    ------
    ImportError
        If onnxruntime is not installed.
    OSError
        If the file is missing.
    ValueError
        If it is not an ONNX file, does not take a pair, or not images of this size, or fails, or
        does not return a map.
    """
    session = opened(path, threads)
    layout = layout_of(session, path)

    height, width = left.shape[:2]
    fed = _fed((left, right), layout, _padding((height, width), layout, path), white)
    try:
        answer = np.asarray(session.run(None, fed)[0], np.float32)
    except Exception as error:  # onnxruntime's own exceptions share no base but this
        raise ValueError(f"{path}: the network failed: {error}") from error

    shape = tuple(side for side in answer.shape if side != 1)
    if len(shape) != 2 or shape[0] < height or shape[1] < width:
        raise ValueError(
            f"{path}: its first output is {answer.shape}, not a map of {height} x {width}"
        )

    return answer.reshape(shape)[:height, :width].copy()


def max_disparity_of(path: str, *, threads: int | None = None) -> int | None:
    """Return the largest disparity of a network, in pixels, if its file's metadata has it.

    Raises
    ------
    ImportError, OSError, ValueError
        As `match_onnx`, also for a file that does not take a pair.
    """
    session = opened(path, threads)
    layout_of(session, path)
    said = str(session.get_modelmeta().custom_metadata_map.get("max_disparity", ""))
    return int(said) if said.isdecimal() and int(said) > 0 else None


def layout_of(session: Any, path: str) -> NetworkInputs:
    """Return a network's input layout.

    Raises
    ------
    ValueError
        If the inputs are not those of a pair.
    """
    inputs = session.get_inputs()
    described = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
    accepted = _CHANNELS.get(len(inputs), ())

    for last in (False, True):
        found = {each.shape[3 if last else 1] for each in inputs if len(each.shape) == 4}
        if len(found) == 1 and found <= set(accepted) and _are_alike(inputs):
            rows, cols = inputs[0].shape[1:3] if last else inputs[0].shape[2:4]
            size = _fixed(rows), _fixed(cols)
            names = tuple(each.name for each in inputs)
            return NetworkInputs(names, found.pop(), last, size, _DTYPES[inputs[0].type])

    raise ValueError(
        f"{path}: takes {described or 'nothing'}; accepts inputs of rank 4, float32, float16 or "
        "uint8: one of 2 or 6 channels, or two of 1 or 3"
    )


@lru_cache(4)
def opened(path: str, threads: int | None = None) -> Any:
    """Return the session of a network, opened once per process.

    Raises
    ------
    ImportError, OSError, ValueError
        As `match_onnx`.
    """
    ort = require("onnxruntime", extra="onnx")
    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file")

    options = ort.SessionOptions()
    options.intra_op_num_threads = threads or 0  # 0: its default
    options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors; warnings are about unused constants

    try:
        return ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exceptions share no base but this
        raise ValueError(f"{path}: onnxruntime cannot read it: {error}") from error


def _are_alike(inputs: Any) -> bool:
    kinds = {each.type for each in inputs}
    return len(kinds) == 1 and kinds <= _DTYPES.keys() and all(len(e.shape) == 4 for e in inputs)


def _fixed(side: Any) -> int | None:
    """Return a dimension if the file fixes it; a free one has a name, or nothing."""
    return side if isinstance(side, int) and side > 0 else None


def _padding(size: tuple[int, int], layout: NetworkInputs, path: str) -> tuple[int, int]:
    """Return the rows and columns to add to the images."""
    wanted = [
        fixed or -(-side // _MULTIPLE) * _MULTIPLE
        for side, fixed in zip(size, layout.size, strict=True)
    ]

    if wanted[0] < size[0] or wanted[1] < size[1]:
        raise ValueError(
            f"{path}: takes {wanted[1]} x {wanted[0]} pixels, the pair has {size[1]} x {size[0]}"
        )

    return wanted[0] - size[0], wanted[1] - size[1]


def _fed(
    pair: tuple[Image, Image], layout: NetworkInputs, padding: tuple[int, int], white: float
) -> dict[str, Any]:
    """Return the inputs by name."""
    gray = layout.channels in (1, 2)
    scale = 1.0 if layout.dtype == np.uint8 else white / 255

    planes = (_planes(image, gray=gray) * scale for image in pair)
    margins = ((0, 0), (0, padding[0]), (0, padding[1]))
    images = [np.pad(image, margins, mode="edge") for image in planes]
    if len(layout.names) == 1:
        images = [np.concatenate(images, axis=0)]

    if layout.dtype == np.uint8:
        images = [np.rint(image) for image in images]
    arranged = [np.moveaxis(image, 0, 2) if layout.last else image for image in images]
    batches = [np.ascontiguousarray(image[np.newaxis], layout.dtype) for image in arranged]
    return dict(zip(layout.names, batches, strict=True))


def _planes(image: Image, *, gray: bool) -> NDArray[np.float64]:
    """Return the channels, first, from 0 to 255."""
    color = image if image.ndim == 3 else np.repeat(image[:, :, np.newaxis], 3, axis=2)
    return (color @ _GRAY)[np.newaxis] if gray else np.moveaxis(color.astype(np.float64), 2, 0)

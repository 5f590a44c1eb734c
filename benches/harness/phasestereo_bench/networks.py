"""Networks as methods: any ONNX file that takes a pair, and HITNet's as it was published.

They run with onnxruntime, on the processor and on one thread. No weights come with this package:
they are given by path.

What an ONNX file takes is read off its inputs, float32 and values from 0 to 1:

- one input of rank 4 with 2 channels: the gray images, left first; with 6: both in color;
- two inputs of rank 4 with 1 or 3 channels each: the left and the right image.

Channels are first or last, whichever of both dimensions is one of these numbers. Its first output
is the disparities of the left image in pixels, of the size of the input, and its other dimensions
are 1. Images are continued at the right and at the bottom, by repeating their edge, to the size
the file asks for or to multiples of 64, and what comes out is cropped again.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasestereo._extras import require

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Image = NDArray[np.uint8]
    Map = NDArray[np.float32]

HITNET_SHA256 = "5dcb177e76698e773c7c31404a5b62b08723f954016446c2d9765a78d1b8a3b9"
"""Of the ONNX file of HITNet's weights for ETH3D (Tankovich et al., CVPR 2021; Google Research)."""

_MULTIPLE = 64  # px: what networks that work at several sizes take
_GRAY = np.array([0.299, 0.587, 0.114])
_CHANNELS = {1: (2, 6), 2: (1, 3)}  # of each input, by how many inputs there are


class NetworkInputs(NamedTuple):
    """How a network takes its inputs.

    Attributes
    ----------
    names
        Of the inputs: one for both images, or one for each.
    channels
        Of each input.
    last
        Whether channels come last.
    size
        Height and width, where the file fixes them, else None.
    """

    names: tuple[str, ...]
    channels: int
    last: bool
    size: tuple[int | None, int | None]


def match_onnx(left: Image, right: Image, num_disparities: int, *, path: str) -> Map:  # noqa: ARG001 - as all methods
    """Match with the network in an ONNX file, which gets no range.

    Raises
    ------
    ImportError
        If onnxruntime is not installed.
    OSError
        If there is no such file.
    ValueError
        If it is no ONNX file, takes something else than a pair, or images of another size, or
        returns something else than a map.
    """
    session = _session(path)
    layout = layout_of(session, path)

    height, width = left.shape[:2]
    fed = _fed(left, right, layout, _padding((height, width), layout, path))
    answer = np.asarray(session.run(None, fed)[0], np.float32)

    shape = tuple(side for side in answer.shape if side != 1)
    if len(shape) != 2 or shape[0] < height or shape[1] < width:
        raise ValueError(
            f"{path}: its first output is {answer.shape}, no map of {height} x {width}"
        )

    found: Map = answer.reshape(shape)[:height, :width].copy()
    return found


def runtime() -> Any:
    """Return onnxruntime.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    return require("onnxruntime", extra="onnx", of="./benches/harness")


def require_hitnet(path: str) -> None:
    """Refuse any file but HITNet's.

    Raises
    ------
    OSError
        If there is no such file.
    ValueError
        If its SHA-256 is another one.
    """
    digest = digest_of(path)
    if digest != HITNET_SHA256:
        raise ValueError(
            f"hitnet: {path} has the SHA-256 {digest}, not {HITNET_SHA256}, which the figures of "
            f"this benchmark are of; onnx:{path} takes any other network"
        )


def license_of(path: str) -> str:
    """Return the license of a network: what its file says, or the first line of one beside it."""
    said = _session(path).get_modelmeta().custom_metadata_map
    texts = (file.read_text("utf-8", "replace") for file in Path(path).parent.glob("LICENSE*"))
    lines = (line.strip() for text in texts for line in text.splitlines() if line.strip())
    return str(said.get("license") or next(lines, "not said: ask who trained it"))


@lru_cache(4)
def digest_of(path: str) -> str:
    """Return the SHA-256 of a file, as hexadecimal digits; OSError if there is none."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def layout_of(session: Any, path: str) -> NetworkInputs:
    """Return how a network takes its inputs.

    Raises
    ------
    ValueError
        If these are not those of a pair.
    """
    inputs = session.get_inputs()
    described = ", ".join(f"{each.name} {each.type} {each.shape}" for each in inputs)
    accepted = _CHANNELS.get(len(inputs), ())

    for last in (False, True):
        found = {each.shape[3 if last else 1] for each in inputs if len(each.shape) == 4}
        if len(found) == 1 and found <= set(accepted) and _are_floats(inputs):
            rows, cols = inputs[0].shape[1:3] if last else inputs[0].shape[2:4]
            size = _fixed(rows), _fixed(cols)
            return NetworkInputs(tuple(each.name for each in inputs), found.pop(), last, size)

    raise ValueError(
        f"{path}: takes {described or 'nothing'}; accepts float32 inputs of rank 4: one of 2 or 6 "
        "channels, or two of 1 or 3"
    )


@lru_cache(4)
def _session(path: str) -> Any:
    """Open a network once for each process, on one thread as all methods are."""
    ort = runtime()
    if not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file")

    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors; warnings are about constants that are not used

    try:
        return ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exceptions share no base but this
        raise ValueError(f"{path}: onnxruntime cannot read it: {error}") from error


def _are_floats(inputs: Any) -> bool:
    return all(each.type == "tensor(float)" and len(each.shape) == 4 for each in inputs)


def _fixed(side: Any) -> int | None:
    """Return a dimension if the file fixes it; others have a name, or none."""
    return side if isinstance(side, int) and side > 0 else None


def _padding(size: tuple[int, int], layout: NetworkInputs, path: str) -> tuple[int, int]:
    """Return how many rows and columns the images lack."""
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
    left: Image, right: Image, layout: NetworkInputs, padding: tuple[int, int]
) -> dict[str, Any]:
    """Return the inputs by name."""
    gray = layout.channels in (1, 2)

    images = [_continued(_planes(image, gray=gray), padding) for image in (left, right)]
    if len(layout.names) == 1:
        images = [np.concatenate(images, axis=0)]

    arranged = [np.moveaxis(image, 0, 2) if layout.last else image for image in images]
    batches = [np.ascontiguousarray(image[np.newaxis]) for image in arranged]
    return dict(zip(layout.names, batches, strict=True))


def _planes(image: Image, *, gray: bool) -> Map:
    """Return the channels, first, from 0 to 1."""
    color = image if image.ndim == 3 else np.repeat(image[:, :, np.newaxis], 3, axis=2)
    planes = (color @ _GRAY)[np.newaxis] if gray else np.moveaxis(color, 2, 0)
    return (planes / 255).astype(np.float32)


def _continued(planes: Map, padding: tuple[int, int]) -> Map:
    return np.pad(planes, ((0, 0), (0, padding[0]), (0, padding[1])), mode="edge")

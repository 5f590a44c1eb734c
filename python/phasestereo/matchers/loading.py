"""A specification, a function or an OpenCV object -> a matcher with one way to call it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import Map, as_numbers, as_pair, on_screens
from phasestereo.matchers import onnx, opencv

_OPTION = re.compile(r",(\w+)=([^,]*)$")
_DEFAULT_SHARE = 3  # the default number of disparities is the width divided by this


@dataclass(frozen=True, slots=True)
class OtherMatcher:
    """Another matcher; `load_matcher` makes them.

    Parameters
    ----------
    name
        Its name in messages and tables.
    run
        The function ``(left, right, num_disparities) -> disparity``.
    max_disparity
        The largest disparity that it can return, pixels; None: unknown.
    """

    name: str
    run: Callable[[Any, Any, int], ArrayLike]
    max_disparity: int | None = None

    def __call__(
        self, left: ArrayLike, right: ArrayLike, num_disparities: int | None = None
    ) -> Map:
        """Match a pair.

        Parameters
        ----------
        left, right
            Images of one size and dtype, as `phasestereo.match` takes them.
        num_disparities
            Number of disparities to search, from 0 on, for matchers that take a range. None: a
            third of the width.

        Returns
        -------
        ndarray
            float32 (H, W), pixels: left pixel (x, y) corresponds to right pixel (x - d, y). NaN
            where the matcher has no finite disparity.

        Raises
        ------
        TypeError
            If an image is invalid, or the answer is not an array of numbers.
        ValueError
            If the images differ in size, or do not have a network's size, or the answer does not
            have the size of the left image.

        Exceptions of the matcher itself pass through.
        """
        pair = as_pair(left, right)
        rows, cols = pair[0].shape[:2]
        if num_disparities is None:
            num_disparities = -(-cols // _DEFAULT_SHARE)

        flat = [image[:, :, 0] if image.shape[2] == 1 else image for image in pair]
        answer = self.run(flat[0], flat[1], num_disparities)
        values = as_numbers(answer, f"answer of {self.name}", "iuf", (rows, cols))
        with np.errstate(over="ignore"):  # values beyond float32 are not disparities
            disparity = values.astype(np.float32)
        disparity[~np.isfinite(disparity)] = np.nan
        return disparity


def load_matcher(matcher: object, *, threads: int | None = None) -> OtherMatcher:
    """Return a matcher for a network, OpenCV's matchers or a function.

    Parameters
    ----------
    matcher
        One of

        - ``"onnx:FILE.onnx"``: a network, run by onnxruntime. What it takes is found from the file,
          see `phasestereo.matchers.onnx`. ``,max_disparity=N`` after it says what it can answer at
          most, unless the file's metadata do; ``,white=255`` that its values are 0 to 255, not 1.
        - ``"sgbm"`` or ``"bm"``: OpenCV's StereoSGBM over 8 directions, StereoBM, of 5 x 5 and
          9 x 9 pixels.
        - An object with ``compute(left, right)`` as OpenCV's matchers have it: BGR in, int16
          sixteenths of a pixel out, or floats in pixels.
        - A function ``(left, right) -> disparity``: arrays (H, W) or (H, W, 3) of the images' dtype
          in, (H, W) real numbers in pixels out, NaN elsewhere.
        - A matcher that this has returned.
    threads
        Number of threads of a network, from 1; None: onnxruntime's default. Others set their own.

    Returns
    -------
    OtherMatcher
        Call it as ``(left, right)`` or ``(left, right, num_disparities)``.

    Raises
    ------
    TypeError
        If it is not one of these.
    ValueError
        If the specification or option is unknown, or the file is not a network that takes a pair.
    OSError
        If the file is missing.
    ImportError
        If onnxruntime or OpenCV is not installed.

    Examples
    --------
    >>> network = load_matcher(lambda left, right: left * 0.0)
    >>> import numpy as np
    >>> network(*np.zeros((2, 40, 60), np.uint8)).dtype
    dtype('float32')
    """
    if isinstance(matcher, OtherMatcher):
        return matcher
    if isinstance(matcher, str):
        return _named(matcher, threads)
    if hasattr(matcher, "compute"):
        run = partial(_in_8_bits, partial(opencv.match_by, matcher))
        return OtherMatcher(type(matcher).__name__, run)
    if callable(matcher):
        function: Callable[..., ArrayLike] = matcher
        name = getattr(matcher, "__name__", type(matcher).__name__)
        return OtherMatcher(name, lambda left, right, _count: function(left, right))

    raise TypeError(
        f"matcher: got {type(matcher).__name__}; accepts a specification such as onnx:net.onnx, "
        "an object with compute(left, right), or a function (left, right) -> disparity"
    )


def _named(spec: str, threads: int | None) -> OtherMatcher:
    whole, options = spec, {}
    while found := _OPTION.search(spec):
        options[found[1]] = _as_integer(whole, *found.groups())
        spec = spec[: found.start()]

    kind, _, path = spec.partition(":")
    opencvs = {"sgbm": opencv.match_sgbm, "bm": opencv.match_bm}
    if spec in opencvs and not options:
        require("cv2", extra="opencv")
        return OtherMatcher(spec, partial(_in_8_bits, opencvs[spec]))

    if kind != "onnx" or not path or options.keys() - {"max_disparity", "white"}:
        raise ValueError(
            f"matcher: got {whole!r}; accepts sgbm, bm, and onnx:FILE.onnx, with "
            ",max_disparity=N and ,white=255 after it if need be"
        )

    most = options.get("max_disparity", onnx.max_disparity_of(path, threads=threads))
    network = partial(onnx.match_onnx, path=path, threads=threads, white=options.get("white", 1))
    return OtherMatcher(f"onnx:{Path(path).stem}", partial(_in_8_bits, network), most)


def _as_integer(spec: str, name: str, value: str) -> int:
    if not value.isdecimal() or int(value) < 1:
        raise ValueError(f"matcher: got {spec!r}; accepts an integer from 1 as {name}")
    return int(value)


def _in_8_bits(
    match: Callable[..., Map],
    left: NDArray[Any],
    right: NDArray[Any],
    num_disparities: int,
) -> Map:
    return match(*on_screens([left, right]), num_disparities)

"""A pair that any matcher can use, and the way back for that matcher's maps."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import ImageOrPath, Map, Pixels, as_numbers, seen_by_alpha
from phasestereo._numbers import as_integer
from phasestereo._opening import opened_valid
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath, named, open_regular, read_bounded
from phasestereo.known import Known, as_known
from phasestereo.rig.findings import Finding, warn
from phasestereo.settings import PRESETS, PresetName, Settings, SettingsOverrides, resolve
from phasestereo.verification import Verification, judge

Unit: TypeAlias = Literal["pixels", "sixteenths"]
"""The unit of 1 in a map: a pixel, or 1/16 of one, as in OpenCV's matchers."""

_MOST_TEXT = 2**23  # bytes: the runs of a mask with a million edges
_NO_ALPHA = (
    "alpha is dropped: the images show what it hides; restored maps leave out what it hides in the "
    "left one"
)
_UNITS = {"pixels": 1.0, "sixteenths": 1 / 16}


class Restoration:
    """Turns maps of a prepared pair into maps of the original left image.

    `prepare` makes it, `save` writes it, `load` reads it. It can be pickled.

    Examples
    --------
    >>> ps.prepare(left, right).restoration.save("back.json")
    >>> restoration = ps.Restoration.load("back.json")
    """

    __slots__ = ("_core",)

    def __init__(self, core: _core.Back) -> None:
        self._core = core

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the original left image."""
        return self._core.size

    @property
    def prepared_size(self) -> tuple[int, int]:
        """Rows and columns of the prepared images."""
        return self._core.prepared_size

    def restore(self, disparity: ArrayLike, *, unit: Unit | None = None) -> Map:
        """Return a map of the prepared pair as one of the original left image.

        Parameters
        ----------
        disparity
            The map of the prepared left image: left column x corresponds to right column ``x -
            disparity``. Integers or floats; non-finite values are missing. A map of a smaller or
            larger size, as some networks return, has disparities in its own pixels.
        unit
            "pixels"; or "sixteenths" of a pixel with negative values missing, as in OpenCV's
            matchers. None: pixels; int16 is refused, since it can be either.

        Returns
        -------
        ndarray
            float32 (H, W) of the original left image, pixels: left pixel (x, y) corresponds to
            column ``x - disparity`` of the original right image, as in `Result.disparity`. NaN
            where the map has none, or where the pixel is masked or outside the prepared image.

        Raises
        ------
        TypeError
            If it is not an array of real numbers.
        ValueError
            If its shape is wrong, or it is int16 and no unit is given.

        Examples
        --------
        >>> pair = ps.prepare(left, right)
        >>> disparity = pair.restore(np.full(pair.left.shape[:2], 7.5))
        """
        return self._core.restored(_as_pixels(disparity, unit))

    def save(self, path: StrPath) -> None:
        """Write it to a text file (JSON), which `load` reads to the bit.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        replace_text(path, self._core.text)

    @classmethod
    def load(cls, path: StrPath) -> Restoration:
        """Read a file written by `save`.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is not a saved restoration, or is damaged.
        """
        with named(str(path)), open_regular(path) as file:
            text = read_bounded(file, _MOST_TEXT).decode(errors="replace")
            return cls(_core.Back(text))

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return _restoration, (self._core.text,)

    def __repr__(self) -> str:
        (rows, cols), (high, wide) = self.prepared_size, self.size
        return f"<Restoration from {cols}x{rows} to {wide}x{high}>"


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A pair that any matcher can use; `prepare` makes it. It can be pickled.

    Parameters
    ----------
    left, right
        The images, of one size and dtype, (H, W), (H, W, 1) or (H, W, 3) as given; their
        disparities begin at 0. An image that needed no change is the original, without alpha.
    done
        The changes, one sentence each; empty: none.
    num_disparities
        The number of disparities of the pair, from 0 on.
    restoration
        Brings maps of the pair back; can be saved.
    findings
        Findings about the pair, as from a match.

    Examples
    --------
    >>> pair = ps.prepare(left, right)
    >>> pair.done, pair.num_disparities
    """

    left: NDArray[Any]
    right: NDArray[Any]
    done: tuple[str, ...]
    num_disparities: int
    restoration: Restoration
    findings: tuple[Finding, ...] = ()
    _judge: partial[Verification] | None = field(default=None, repr=False)

    def restore(self, disparity: ArrayLike, *, unit: Unit | None = None) -> Map:
        """Return a map of the prepared pair as one of the original left image.

        Parameters, result and errors are those of `Restoration.restore`.
        """
        return self.restoration.restore(disparity, unit=unit)

    def judge(self, disparity: ArrayLike, *, unit: Unit | None = None) -> Verification:
        """Judge a map of the prepared pair by the original images: `verify` of `restore`.

        The estimates of `prepare` are reused, unless it was given a range, or other settings than
        those of the preset ``"robust"``, or this is a copy from a pickle.

        Parameters
        ----------
        disparity, unit
            As `Restoration.restore` takes them.

        Returns
        -------
        Verification
            For the original left image: confidence, error bar and verdict of every pixel, better
            disparities, findings.

        Raises
        ------
        TypeError, ValueError, MemoryError, KeyboardInterrupt
            As `Restoration.restore` and `phasestereo.verify`.

        Examples
        --------
        >>> pair = ps.prepare(left, right)
        >>> judged = pair.judge(np.full(pair.left.shape[:2], 7.5))
        """
        if self._judge is None:
            raise ValueError("pair: got no images as they came; accepts what prepare has returned")
        return self._judge(self.restore(disparity, unit=unit))

    def __repr__(self) -> str:
        rows, cols = self.left.shape[:2]
        return (
            f"<Prepared {cols}x{rows}, {self.num_disparities} disparities, {len(self.done)} done>"
        )


def prepare(
    left: ImageOrPath,
    right: ImageOrPath,
    *,
    max_disparity: int | None = None,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    known: Known | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> Prepared:
    """Prepare a pair for any other matcher, with the estimates that `match` makes.

    The images are those that `match` compares: rectified if they are far from it, the rows of the
    right one aligned, a negative inverted, impulses removed, the sharper one blurred like the other
    one, area by area. In addition, the right one gets the gray levels of the left one if they
    differ by more than a tenth, noise of about 10 gray levels or more is smoothed, and if many
    disparities are negative, columns are added to make them positive. All channels are treated
    alike. A faultless pair is not changed. It takes as long as the estimates of `match`, plus the
    time to make the images.

    Parameters
    ----------
    left, right, num_disparities, min_disparity, preset, settings, threads, left_mask, right_mask, \
known, **overrides
        As `match` takes them; ``align_rows=False`` leaves rows as they are,
        ``self_rectify=False`` does not rectify, ``compensate_blur=False`` and ``denoise=False``
        neither blur nor smooth.
    max_disparity
        The largest disparity that the other matcher can return, pixels, from 1. Larger ones in the
        pair are made smaller: columns are cut off, and if that is not enough, the images are
        reduced by 2, 4, ... 64. None: no limit.

    Returns
    -------
    Prepared
        Both images, the changes, and the way back for maps.

    Raises
    ------
    TypeError, ValueError, OSError, ImportError, MemoryError, KeyboardInterrupt
        As `match`; ValueError also if images reduced by 64 still exceed `max_disparity`.

    Warns
    -----
    MatchWarning
        If the pair is unfit for a match, as `match`.

    Examples
    --------
    >>> pair = ps.prepare(left, right)
    >>> network = ps.matchers.load_matcher("sgbm")
    >>> disparity = pair.restore(network(pair.left, pair.right, pair.num_disparities))

    Notes
    -----
    On one scene that is new to the other matcher, bad-1.0 falls most for faulty rigs: HITNet with
    rows off by 4 px 66 % -> 5 %, turned by 5 degrees 70 -> 5, out of focus on one side 55 -> 24.
    See the page "Use your network".
    """
    if max_disparity is not None:
        max_disparity = as_integer("max_disparity", max_disparity, least=1)

    asked = resolve(preset, settings, overrides)
    arrays, pair, valid = opened_valid((left, right), (left_mask, right_mask))
    images, done, count, back, ready, estimates = _core.prepare_pair(
        pair,
        valid,
        (min_disparity, num_disparities),
        max_disparity,
        asked,
        threads,
        as_known(known),
    )

    warn(estimates.findings)
    hides = any(seen_by_alpha(array) is not None for array in arrays)
    return Prepared(
        left=_like(arrays[0], pair[0] if images[0] is None else images[0]),
        right=_like(arrays[1], pair[1] if images[1] is None else images[1]),
        done=(*done, _NO_ALPHA) if hides else tuple(done),
        num_disparities=count,
        restoration=Restoration(back),
        findings=estimates.findings,
        _judge=partial(
            judge,
            arrays,
            (left_mask, right_mask),
            threads=threads,
            known=known,
            ready=ready if asked == PRESETS["robust"] and num_disparities is None else None,
        ),
    )


def _like(given: NDArray[Any], pixels: Pixels) -> NDArray[Any]:
    """Return pixels in the number of dimensions of the original image."""
    return pixels[:, :, 0] if given.ndim == 2 else pixels


def _restoration(text: str) -> Restoration:
    return Restoration(_core.Back(text))


def _as_pixels(disparity: ArrayLike, unit: Unit | None) -> Map:
    values = as_numbers(disparity, "disparity")
    if unit is None and values.dtype == np.int16:
        raise ValueError(
            "unit: got none for a map of int16; accepts 'sixteenths', as OpenCV's matchers return "
            "them, or 'pixels'"
        )
    if unit not in (None, *_UNITS):
        raise ValueError(f"unit: got {unit!r:.80}; accepts pixels, sixteenths or None")

    with np.errstate(over="ignore"):  # values beyond float32 are missing
        pixels = values.astype(np.float32) * np.float32(_UNITS[unit or "pixels"])
    if unit == "sixteenths":
        pixels[pixels < 0] = np.nan
    return pixels

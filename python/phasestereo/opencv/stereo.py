"""The matcher that replaces OpenCV's: BGR images in, sixteenths of pixels out."""

# ruff: noqa: N802, N803 -- the names are OpenCV's

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._core import MOST_DISPARITIES
from phasestereo._extras import require
from phasestereo._images import Pixels, as_array, as_numbers, as_pair
from phasestereo.matching import Matcher
from phasestereo.opencv.parameters import DEFAULTS, LARGEST_DISPARITY, Parameters
from phasestereo.opencv.storage import NAME, STORED, as_text, from_node
from phasestereo.settings import PRESET, PresetName, Settings, SettingsOverrides, resolve

Sixteenths: TypeAlias = NDArray[np.int16]

SCALE = 16
"""One pixel of disparity in OpenCV's maps."""
NEGATIVE_UNIQUENESS = 10
"""StereoSGBM's value for a uniquenessRatio below 0."""

DECIDED = {
    "window": "blockSize",
    "lr_check": "disp12MaxDiff",
    "uniqueness": "uniquenessRatio",
    "speckle_size": "speckleWindowSize",
    "speckle_range": "speckleRange",
}
"""Settings that OpenCV's parameters decide."""


class StereoPhase(Parameters):
    """A matcher with the methods of ``cv2.StereoSGBM``; `create` makes one.

    It keeps its threads and its memory from one pair to the next. Set parameters only while no
    other thread uses it.
    """

    def __init__(
        self, *, preset: str, threads: int | None, overrides: dict[str, Any], **values: int
    ) -> None:
        super().__init__(**values)
        for name in overrides.keys() & DECIDED.keys():
            raise TypeError(f"{name}: OpenCV's {DECIDED[name]} sets it here")

        self._name = preset
        self._overrides = overrides
        self._threads = threads
        self._chosen = resolve(preset, None, {"fill": False, "confidence": False, **overrides})
        self._matchers: dict[Settings, Matcher] = {}

        # Invalid parameters raise here, not at the first pair.
        self._check_range()
        self._matcher(self._settings())

    @staticmethod
    def create(  # noqa: PLR0917 -- OpenCV takes them by position
        minDisparity: int = 0,
        numDisparities: int = 16,
        blockSize: int = 0,
        P1: int = 0,
        P2: int = 0,
        disp12MaxDiff: int = 0,
        preFilterCap: int = 0,
        uniquenessRatio: int = 0,
        speckleWindowSize: int = 0,
        speckleRange: int = 0,
        mode: int = 0,
        *,
        preset: PresetName = PRESET,
        threads: int | None = None,
        **overrides: Unpack[SettingsOverrides],
    ) -> StereoPhase:
        """Make a matcher with OpenCV's interface and the parameters of ``StereoSGBM_create``.

        Parameters
        ----------
        minDisparity
            Smallest disparity, -2047 to 2047 pixels.
        numDisparities
            Number of disparities to search, 1 to the images' width; any, not only multiples of 16.
            All are below 2048.
        blockSize
            Side of the window over which costs are summed, up to 63 pixels; even sizes are enlarged
            by one. 0: the preset's, 5 for ``"robust"`` and 9 for ``"fast"``. 3 to 7 suit most
            pairs; blocks as large as StereoBM needs cost details here, too.
        disp12MaxDiff
            Left-right check: a pixel is left out if the right pixel chosen for it fits another one
            better, whose disparity differs by more pixels than this. 0 or less: 1, as StereoSGBM
            does despite its documentation; a large number, such as 1000000: no check.
        uniquenessRatio
            Percent, up to 100: a pixel is left out if another candidate, not next to the best,
            costs less than ``100 / (100 - uniquenessRatio)`` times the best cost. 0: no check;
            less: 10, as in StereoSGBM.
        speckleWindowSize, speckleRange
            Regions of up to speckleWindowSize pixels are left out if they differ from everything
            around them by more than speckleRange pixels. No check if the size is 0 or less, or the
            range less than 0.
        P1, P2, preFilterCap, mode
            Stored and returned, without effect: their units are those of OpenCV's costs, not of
            phase codes. `Settings` ``p1``, ``p2`` and ``optimizer`` are similar.
        preset
            Name of the settings to start from, one of `phasestereo.PRESETS`.
        threads
            Number of threads, as `phasestereo.match` takes it.
        **overrides
            Fields of `phasestereo.Settings` by name, except those that the parameters above set.
            ``fill=True`` gives every pixel a disparity: left-out pixels take the background's.

        Returns
        -------
        StereoPhase
            With `compute`, `compute_right` and OpenCV's get and set methods.

        Raises
        ------
        TypeError
            For a parameter that is not an integer, or an unknown setting.
        ValueError
            For a value out of range, or disparities beyond int16.
        """
        return StereoPhase(
            preset=preset,
            threads=threads,
            overrides=dict(overrides),
            minDisparity=minDisparity,
            numDisparities=numDisparities,
            blockSize=blockSize,
            P1=P1,
            P2=P2,
            disp12MaxDiff=disp12MaxDiff,
            preFilterCap=preFilterCap,
            uniquenessRatio=uniquenessRatio,
            speckleWindowSize=speckleWindowSize,
            speckleRange=speckleRange,
            mode=mode,
        )

    def compute(
        self, left: ArrayLike, right: ArrayLike, disparity: Sixteenths | None = None
    ) -> Sixteenths:
        """Match a rectified stereo pair; return the disparities of the left image.

        Parameters
        ----------
        left, right
            Images of equal size and dtype: (H, W) or (H, W, 1) gray, (H, W, 3) BGR or (H, W, 4)
            BGRA (alpha is left out); uint8, uint16, float32 or float64; arrays, or ``cv2.UMat``.
        disparity
            Array to write the map to, int16 (H, W); None: a new array.

        Returns
        -------
        numpy.ndarray
            int16 (H, W), or a ``cv2.UMat`` where `left` is one: sixteenths of a pixel, rounded.
            Left pixel (x, y) corresponds to right pixel (x - disparity / 16, y).
            ``(minDisparity - 1) * 16`` where the match lies outside the right image or a check
            failed, unless ``fill=True``.

        Raises
        ------
        TypeError
            For a wrong type or dtype.
        ValueError
            For a wrong shape, NaN or infinite pixels, disparities that the images or int16 cannot
            hold.
        """
        pair = _pair(left, right)
        target = _target(disparity, pair[0].shape[:2])
        found = self._match(*pair, self._settings())
        sixteenths = _sixteenths(found, self.getMinDisparity() - 1, target)
        return type(left)(sixteenths) if _is_umat(left) else sixteenths  # type: ignore[call-arg, return-value] # as OpenCV

    def compute_right(self, left: ArrayLike, right: ArrayLike) -> Sixteenths:
        """Match the same pair from the right image, for ``cv2.ximgproc``'s WLS filter.

        It equals the map from the matcher of `cv2.ximgproc.createRightMatcher`: unchecked, with
        negative disparities.

        Parameters
        ----------
        left, right
            The images in the order, and of the kind, that `compute` takes.

        Returns
        -------
        numpy.ndarray
            int16 (H, W), sixteenths of a pixel: right pixel (x, y) corresponds to left pixel (x -
            disparity / 16, y); the disparities are those of `compute` times -1. ``-(minDisparity +
            numDisparities) * 16`` where the match lies outside the left image, unless
            ``fill=True``.

        Raises
        ------
        TypeError, ValueError
            As `compute` does.
        """
        pair = _pair(left, right)
        # In mirrored images the right camera becomes the left one, and near things shift the same
        # way.
        mirrored = pair[1][:, ::-1], pair[0][:, ::-1]
        found = -self._match(*mirrored, self._settings(is_checked=False))[:, ::-1]
        lowest = 1 - self.getMinDisparity() - self.getNumDisparities()
        return _sixteenths(found, lowest - 1, np.empty(found.shape, np.int16))

    def save(self, filename: str) -> None:
        """Write the parameters, the preset and the settings to a file with OpenCV's FileStorage.

        Parameters
        ----------
        filename
            The file: ``.yml``, ``.xml`` or ``.json``. `read`, and C++'s ``StereoPhase``, read it.

        Raises
        ------
        OSError
            If it cannot be written.
        ImportError
            If OpenCV is not installed.
        """
        cv2 = require("cv2", extra="opencv")
        storage = cv2.FileStorage()
        if not storage.open(filename, cv2.FILE_STORAGE_WRITE):
            raise OSError(f"{filename}: cannot be written")
        self.write(storage, self.getDefaultName())
        storage.release()

    def write(self, fs: Any, name: str | None = None) -> None:
        """Write the same to a ``cv2.FileStorage``, as an object of this name if given."""
        if name is not None:
            fs.startWriteStruct(name, require("cv2", extra="opencv").FILE_NODE_MAP)
        fs.write("name", NAME)
        for parameter in STORED:
            fs.write(parameter, self._values[parameter])
        fs.write("preset", self._name)
        fs.write("settings", as_text(self._overrides))
        if name is not None:
            fs.endWriteStruct()

    def read(self, fn: Any) -> None:
        """Load the data that `save` or `write`, or C++'s ``StereoPhase``, has written.

        Parameters
        ----------
        fn
            The ``cv2.FileNode`` of the object, as ``storage.getFirstTopLevelNode()``. Parameters
            missing in it stay unchanged.

        Raises
        ------
        TypeError, ValueError
            If it is another object, or holds values that `create` refuses; then nothing changes.
        """
        values, preset, overrides = from_node(fn)
        self.__dict__ = vars(
            StereoPhase(
                preset=self._name if preset is None else preset,
                threads=self._threads,
                overrides=self._overrides if overrides is None else overrides,
                **(self._values | values),
            )
        )

    def getDefaultName(self) -> str:
        """Return the name of the object in a saved file."""
        return "StereoPhase"

    def clear(self) -> None:
        """Free the threads and the memory that are kept for the next pair."""
        self._matchers.clear()

    def empty(self) -> bool:
        """Return False: a match needs no training and no loading."""
        return False

    def __repr__(self) -> str:
        """Show the call that makes such a matcher, without OpenCV's defaults."""
        given: dict[str, Any] = {
            name: value
            for name, value in self._values.items()
            if value != DEFAULTS[name] or name in ("minDisparity", "numDisparities")
        }
        given |= {"preset": self._name, **self._overrides}
        return f"StereoPhase({', '.join(f'{name}={value!r}' for name, value in given.items())})"

    def _match(self, left: Pixels, right: Pixels, settings: Settings) -> NDArray[np.float32]:
        """Return the disparities of RGB images, NaN where there is no estimate."""
        low, count = self._check_range(left.shape[1])
        matcher = self._matcher(settings)
        found = matcher.match(left, right, min_disparity=low, num_disparities=count).disparity

        if not settings.fill:  # smoothing has moved a few out of the image
            columns = np.arange(found.shape[1]) - np.rint(found)
            found[(columns < 0) | (columns >= found.shape[1])] = np.nan
        return found

    def _matcher(self, settings: Settings) -> Matcher:
        """Return a matcher with these settings, a new one if necessary."""
        if settings not in self._matchers:
            if len(self._matchers) > 1:  # one for compute, one for compute_right; others are old
                self._matchers.clear()
            self._matchers[settings] = Matcher(settings=settings, threads=self._threads)
        return self._matchers[settings]

    def _settings(self, *, is_checked: bool = True) -> Settings:
        """Return settings for the parameters; for right matchers of `cv2.ximgproc`, unchecked."""
        block = self.getBlockSize()
        window = block + 1 - block % 2 if block > 0 else self._chosen.window

        if not is_checked:
            return replace(self._chosen, window=window, lr_check=None, uniqueness=0, speckle_size=0)

        # Numbers out of our range mean the same as in StereoSGBM.
        most = self.getDisp12MaxDiff() if self.getDisp12MaxDiff() > 0 else 1
        ratio = self.getUniquenessRatio()
        has_speckles = self.getSpeckleRange() >= 0 and self.getSpeckleWindowSize() > 0

        return replace(
            self._chosen,
            window=window,
            lr_check=most if most < self.getNumDisparities() - 1 else None,
            uniqueness=ratio if ratio >= 0 else NEGATIVE_UNIQUENESS,
            speckle_size=self.getSpeckleWindowSize() if has_speckles else 0,
            speckle_range=min(self.getSpeckleRange(), MOST_DISPARITIES) if has_speckles else 0,
        )

    def _check_range(self, width: int | None = None) -> tuple[int, int]:
        """Return the range to search; refuse one that int16 or the width cannot hold."""
        low, count = self.getMinDisparity(), self.getNumDisparities()
        most = min(LARGEST_DISPARITY + 1 - low, count if width is None else width)
        if count > most:
            raise ValueError(
                f"numDisparities: got {count}; accepts 1 to {most} with minDisparity {low}: at "
                f"most the images' width, and no disparity above {LARGEST_DISPARITY}, of which "
                "int16 holds no sixteenths"
            )
        if width is not None and not 2 - width - count <= low <= width - 1:
            raise ValueError(
                f"minDisparity: got {low}; accepts {2 - width - count} to {width - 1}: any other "
                f"leads all {count} disparities out of images {width} pixels wide"
            )

        return low, count


def _pair(left: ArrayLike, right: ArrayLike) -> tuple[Pixels, Pixels]:
    """Return a pair of BGR or gray images as RGB or gray."""
    pair = as_pair(_rgb(left, "left"), _rgb(right, "right"))
    for image, name in zip(pair, ("left", "right"), strict=True):
        if image.dtype.kind == "f" and not np.isfinite(image).all():
            raise ValueError(
                f"{name}: got NaN or infinite pixels; accepts finite ones (phasestereo.match takes "
                "masks, too)"
            )

    return pair


def _rgb(image: ArrayLike, name: str) -> NDArray[Any]:
    """Return an image with the channel order of the rest of this package."""
    if image is None:
        raise TypeError(
            f"{name}: got None, which is what cv2.imread returns for a file that it cannot read"
        )

    pixels = as_array(image.get() if _is_umat(image) else image, name)  # type: ignore[union-attr] # checked
    return pixels[:, :, 2::-1] if pixels.ndim == 3 and pixels.shape[2] in (3, 4) else pixels


def _is_umat(image: object) -> bool:
    """Return whether it is a ``cv2.UMat``, without importing OpenCV."""
    return type(image).__name__ == "UMat"


def _target(disparity: Sixteenths | None, size: tuple[int, ...]) -> Sixteenths:
    """Return the array to write to: the given one, or a new one."""
    if disparity is None:
        return np.empty(size, np.int16)

    target: Sixteenths = as_numbers(disparity, "disparity", ("int16",), size)
    if not target.flags.writeable:
        raise ValueError("disparity: got an array that is read-only; accepts a writable one")
    return target


def _sixteenths(disparity: NDArray[np.float32], invalid: int, target: Sixteenths) -> Sixteenths:
    """Round pixels to sixteenths, with the given disparity for NaN."""
    target[...] = np.rint(np.where(np.isnan(disparity), invalid, disparity) * SCALE)
    return target


StereoPhase_create = StereoPhase.create

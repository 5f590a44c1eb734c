"""OpenCV's parameters under OpenCV's names: their ranges, and a get and a set for each."""

# ruff: noqa: N802, N803 -- the names are OpenCV's

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from phasestereo._numbers import as_integer

ANY = -(2**31), 2**31 - 1
"""The range of a C++ int."""
NATURAL = 0, ANY[1]
LARGEST_DISPARITY = 2047
"""The largest whole disparity whose sixteenths fit int16, and the smallest minus one."""

RANGES: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        "minDisparity": (-LARGEST_DISPARITY, LARGEST_DISPARITY),
        "numDisparities": (1, 2 * LARGEST_DISPARITY + 1),
        "blockSize": (0, 63),
        "P1": NATURAL,
        "P2": NATURAL,
        "disp12MaxDiff": ANY,
        "preFilterCap": NATURAL,
        "uniquenessRatio": (ANY[0], 100),
        "speckleWindowSize": ANY,
        "speckleRange": ANY,
        "mode": (0, 3),
        "preFilterType": (0, 1),
        "preFilterSize": NATURAL,
        "textureThreshold": NATURAL,
        "smallerBlockSize": ANY,
    }
)
"""The smallest and the largest value of each parameter."""

DEFAULTS: Mapping[str, int] = MappingProxyType(
    dict.fromkeys(RANGES, 0)
    | {"numDisparities": 16, "blockSize": 0}
    | {"preFilterType": 1, "preFilterSize": 9, "textureThreshold": 10}
)
"""Those of ``StereoSGBM_create``, and of ``StereoBM_create`` for what it alone has; but for the
block size, 0 being that of the preset."""


class Parameters:
    """The parameters of OpenCV's StereoSGBM and StereoBM, and their use in a `StereoPhase`.

    These have an effect: minDisparity, numDisparities, blockSize, disp12MaxDiff, uniquenessRatio,
    speckleWindowSize and speckleRange. The others describe costs that this matcher does not use.
    They are stored and returned, so that programs run unchanged, and change no disparity.

    Parameters
    ----------
    **values
        Parameters by name; missing ones have their `DEFAULTS`.

    Raises
    ------
    TypeError
        If a value is not an integer.
    ValueError
        If it is out of range.
    """

    def __init__(self, **values: int) -> None:
        self._values = dict(DEFAULTS)
        for name, value in values.items():
            self._set(name, value)

    def _set(self, name: str, value: int) -> None:
        low, high = RANGES[name]
        self._values[name] = as_integer(name, value, least=low, most=high)

    def getMinDisparity(self) -> int:
        """Return the smallest disparity that is searched."""
        return self._values["minDisparity"]

    def setMinDisparity(self, minDisparity: int) -> None:
        """Set the smallest disparity that is searched, -2047 to 2047 pixels."""
        self._set("minDisparity", minDisparity)

    def getNumDisparities(self) -> int:
        """Return the number of disparities searched."""
        return self._values["numDisparities"]

    def setNumDisparities(self, numDisparities: int) -> None:
        """Set the number of disparities searched: any number, not only multiples of 16."""
        self._set("numDisparities", numDisparities)

    def getDisp12MaxDiff(self) -> int:
        """Return the disparity difference that the left-right check allows."""
        return self._values["disp12MaxDiff"]

    def setDisp12MaxDiff(self, disp12MaxDiff: int) -> None:
        """Set the pixels of disparity difference that the left-right check allows; 0 or less: 1."""
        self._set("disp12MaxDiff", disp12MaxDiff)

    def getUniquenessRatio(self) -> int:
        """Return the lead, in percent, that the best cost must have."""
        return self._values["uniquenessRatio"]

    def setUniquenessRatio(self, uniquenessRatio: int) -> None:
        """Set the lead, in percent up to 100, that the best cost must have; 0: none, less: 10."""
        self._set("uniquenessRatio", uniquenessRatio)

    def getSpeckleWindowSize(self) -> int:
        """Return the largest size of regions that are removed."""
        return self._values["speckleWindowSize"]

    def setSpeckleWindowSize(self, speckleWindowSize: int) -> None:
        """Set the largest size, in pixels, of isolated regions to remove; 0 or less: none."""
        self._set("speckleWindowSize", speckleWindowSize)

    def getSpeckleRange(self) -> int:
        """Return the largest difference between neighbors of one region."""
        return self._values["speckleRange"]

    def setSpeckleRange(self, speckleRange: int) -> None:
        """Set the largest difference in pixels within a region; negative: no regions."""
        self._set("speckleRange", speckleRange)

    def getBlockSize(self) -> int:
        """Return the side of the window over which costs are summed; 0: the preset's."""
        return self._values["blockSize"]

    def setBlockSize(self, blockSize: int) -> None:
        """Set the side of the window over which costs are summed, up to 63; 0: the preset's."""
        self._set("blockSize", blockSize)

    def getP1(self) -> int:
        """Return P1 as it was set."""
        return self._values["P1"]

    def setP1(self, P1: int) -> None:
        """Set P1, which changes no disparity: the setting ``p1`` does."""
        self._set("P1", P1)

    def getP2(self) -> int:
        """Return P2 as it was set."""
        return self._values["P2"]

    def setP2(self, P2: int) -> None:
        """Set P2, which changes no disparity: the setting ``p2`` does."""
        self._set("P2", P2)

    def getMode(self) -> int:
        """Return the mode as it was set."""
        return self._values["mode"]

    def setMode(self, mode: int) -> None:
        """Set the mode, 0 to 3, which changes no disparity: the setting ``optimizer`` does."""
        self._set("mode", mode)

    def getPreFilterCap(self) -> int:
        """Return the cap of the prefilter as it was set."""
        return self._values["preFilterCap"]

    def setPreFilterCap(self, preFilterCap: int) -> None:
        """Set the cap of the prefilter, which changes no disparity: there is no prefilter."""
        self._set("preFilterCap", preFilterCap)

    def getPreFilterType(self) -> int:
        """Return the type of StereoBM's prefilter as it was set."""
        return self._values["preFilterType"]

    def setPreFilterType(self, preFilterType: int) -> None:
        """Set the type of StereoBM's prefilter, 0 or 1, which changes no disparity."""
        self._set("preFilterType", preFilterType)

    def getPreFilterSize(self) -> int:
        """Return the size of StereoBM's prefilter as it was set."""
        return self._values["preFilterSize"]

    def setPreFilterSize(self, preFilterSize: int) -> None:
        """Set the size of StereoBM's prefilter, which changes no disparity."""
        self._set("preFilterSize", preFilterSize)

    def getTextureThreshold(self) -> int:
        """Return StereoBM's least texture as it was set."""
        return self._values["textureThreshold"]

    def setTextureThreshold(self, textureThreshold: int) -> None:
        """Set StereoBM's least texture, which changes no disparity: ``min_confidence`` does."""
        self._set("textureThreshold", textureThreshold)

    def getSmallerBlockSize(self) -> int:
        """Return StereoBM's smaller block size as it was set."""
        return self._values["smallerBlockSize"]

    def setSmallerBlockSize(self, blockSize: int) -> None:
        """Set StereoBM's smaller block size, which changes no disparity (nor does it there)."""
        self._set("smallerBlockSize", blockSize)

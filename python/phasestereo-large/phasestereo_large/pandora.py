"""The matching cost ``phase`` for CNES Pandora, which finds it through an entry point.

Pandora writes x_right = x_left + d, this library x_right = x_left - d: only this module changes the
sign. It treats borders, masks and shifted images exactly as Pandora does, so that the later steps
of its pipelines, and the tiles of CARS, can rely on them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo import _core
from phasestereo._extras import require
from phasestereo._images import as_pair
from phasestereo.known import Known
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.settings import Settings
from phasestereo.stages import aggregate, cost_volume as compare

try:
    from json_checker import And, Checker
    from pandora.img_tools import shift_right_img
    from pandora.matching_cost.matching_cost import AbstractMatchingCost
    from scipy.ndimage import distance_transform_edt
    from xarray import DataArray, Dataset
except ModuleNotFoundError:
    require("pandora", extra="pandora")  # raises, and names the extra
    raise

Plane = NDArray[np.float32]
Volume = NDArray[np.float32]

METHOD = "phase"
"""Value of ``matching_cost_method``."""

_BLOCK = 16  # disparities compared at a time: needs little memory beside Pandora's own volume


class _View(NamedTuple):
    """One band of an image with its gaps filled, and its valid pixels."""

    pixels: Plane
    valid: NDArray[np.bool_]


class _Terms(NamedTuple):
    """The settings and the blur compensation for comparing images."""

    settings: Settings
    compensation: BlurCompensation | None


@AbstractMatchingCost.register_subclass(METHOD)
class PhaseCost(AbstractMatchingCost):
    """Hamming distance of the phase codes of two pixels, its mean over a window; unit: bits.

    Parameters
    ----------
    **cfg
        The step in Pandora's configuration. In addition to ``matching_cost_method``, ``subpix``,
        ``band``, ``step`` and ``spline_order``, which have their usual meaning:

        - ``window_size``: side of the square that averages costs, odd, 1 to 63.
          Default 5.
        - ``neighborhood``, ``taper``, ``frequencies``, ``power``, ``bits``, ``noise_threshold``: as
          in `phasestereo.Settings`; the step estimates the noise that ``noise_threshold`` needs.
          Defaults 3, "uniform", [1, 1], 1, 2 and 0.5, as in the preset ``robust``.
        - ``compensate_blur``: whether to estimate the relative blur of the images and even it out
          before comparing them. Default true.

    Raises
    ------
    TypeError, ValueError
        If a parameter of this library has the wrong type or value.
    json_checker.core.exceptions.CheckerError
        If one of Pandora's has, or a parameter is unknown.

    Notes
    -----
    A cost depends on ``neighborhood + window_size - 1`` pixels across, with ``compensate_blur`` on
    4 more. The rest of Pandora sees this window: half of it is the border without costs, the halo
    of pixels without data, and the margin that a tile needs.
    """

    OWN: ClassVar[dict[str, Any]] = {
        "neighborhood": 3,
        "taper": "uniform",
        "frequencies": [1, 1],
        "power": 1,
        "bits": 2,
        "noise_threshold": 0.5,
        "compensate_blur": True,
    }
    """The parameters that are not Pandora's, and their defaults."""

    def __init__(self, **cfg: Any) -> None:
        self.instantiate_class(**cfg)
        self._settings = _settings(self.cfg or {})
        self._window_size = _support(self._settings)
        self._border = (self._window_size - 1) // 2

    def check_conf(self, **cfg: Any) -> dict[str, Any]:
        """Check every parameter; return the step with its defaults."""
        checked: dict[str, Any] = {**self.OWN, **super().check_conf(**cfg)}
        _settings(checked)

        # A copy: all methods share the schema, and would also demand these parameters.
        schema: dict[str, Any] = {
            **self.schema,
            **dict.fromkeys(self.OWN, object),
            "window_size": int,
            "matching_cost_method": And(str, lambda name: name == METHOD),
        }

        Checker(schema).validate(checked)
        return checked

    def compute_cost_volume(
        self, img_left: Dataset, img_right: Dataset, cost_volume: Dataset
    ) -> Dataset:
        """Fill in the volume that Pandora allocated.

        Parameters
        ----------
        img_left, img_right
            ``im``: float32 (row, col) or (band_im, row, col); ``msk``, if any: int16 (row, col).
        cost_volume
            ``cost_volume``: float32 (row, col, disp).

        Returns
        -------
        Dataset
            The same volume: bits, NaN if the window of either pixel leaves its image.
        """
        self.check_band_input_mc(img_left, img_right)
        left, right = _view(img_left, self._band), _view(img_right, self._band)

        disparities = np.asarray(cost_volume.coords["disp"].data, dtype=np.float64)
        terms = _evened_out(left, right, disparities, self._settings)
        costs = np.full((*left.pixels.shape, disparities.size), np.nan, dtype=np.float32)

        # Disparities have steps of 1 / n column: each of n shifted images gives every n-th one.
        shifted = self._shifted(right)
        for part, pixels in enumerate(shifted):
            first = int(np.floor(disparities[0]))
            _fill(costs[:, :, part :: len(shifted)], (left.pixels, pixels), first, terms)

        _leave_out_borders(costs, disparities, self._border)
        columns = cost_volume.attrs["col_to_compute"] - img_left.coords["col"].data[0]
        cost_volume["cost_volume"].data = costs[:, columns, :]
        cost_volume.attrs.update({"type_measure": "min", "cmax": _most_bits(self._settings)})
        return cost_volume

    def _shifted(self, right: _View) -> list[Plane]:
        """Return the right image, then Pandora's interpolations at 1/n, 2/n ... of a column."""
        rows, cols = right.pixels.shape
        coords = {"row": np.arange(rows), "col": np.arange(cols)}
        image = Dataset({"im": DataArray(right.pixels, coords, ("row", "col"))})
        found = shift_right_img(image, int(self._subpix or 1), order=int(self._spline_order or 1))

        # There is one column less between columns; its stand-in lies outside, and has no cost.
        between = [np.pad(each["im"].data, ((0, 0), (0, 1)), mode="edge") for each in found[1:]]
        return [right.pixels, *between]


def _settings(cfg: dict[str, Any]) -> Settings:
    """Return the settings that a step requests; they check themselves."""
    own = {name: cfg[name] for name in PhaseCost.OWN}
    if isinstance(own["frequencies"], list):  # JSON has no tuples
        own["frequencies"] = tuple(own["frequencies"])
    return replace(Settings.preset("paper"), **own, window=cfg["window_size"], shiftable=False)


def _support(settings: Settings) -> int:
    """Return the largest width of a cost's support, in pixels."""
    larger = _core.LARGER + _core.MUCH_LARGER if settings.compensate_blur else 0
    return settings.neighborhood + settings.window - 1 + larger


def _most_bits(settings: Settings) -> int:
    """Return the length of a code: two codes cannot differ by more."""
    r, s = settings.frequencies
    bits = (r * (2 * s + 1) + s) << (settings.bits - 1)
    return 2 * bits if settings.noise_threshold > 0 else bits


def _view(image: Dataset, band: str | None) -> _View:
    """Return the band to match; the nearest pixels with data replace those without."""
    pixels = image["im"].data
    if band is not None:
        pixels = pixels[list(image["band_im"].data).index(band)]

    valid = np.isfinite(pixels)
    if "msk" in image.data_vars:
        valid &= image["msk"].data != image.attrs["no_data_mask"]
    if not valid.any():
        return _View(np.zeros(valid.shape, np.float32), valid)

    if not valid.all():
        # The indices of the nearest valid pixel, for every pixel.
        nearest = distance_transform_edt(~valid, return_distances=False, return_indices=True)
        pixels = pixels[tuple(nearest)]
    return _View(np.ascontiguousarray(pixels, dtype=np.float32), valid)


def _evened_out(
    left: _View, right: _View, disparities: NDArray[np.float64], settings: Settings
) -> _Terms:
    """Return the terms for comparing the images; estimate their blur and noise if necessary."""
    if not (settings.compensate_blur or settings.noise_threshold > 0):
        return _Terms(settings, None)

    pair = as_pair(left.pixels, right.pixels)
    # Pandora's disparities have the opposite sign.
    low, high = int(np.floor(disparities[0])), int(np.ceil(disparities[-1]))
    search = -high, min(high - low + 1, left.pixels.shape[1])
    asked = replace(settings, align_rows=False)

    found = _core.estimate_pair(
        pair, (left.valid, right.valid), search, asked, None, self_rectify=False
    )
    return _Terms(found.settings, found.blur_compensation)


def _fill(costs: Volume, pair: tuple[Plane, Plane], first: int, terms: _Terms) -> None:
    """Write the costs at whole disparities, in Pandora's sign, from the first one on."""
    width = pair[0].shape[1]
    settings, compensation = terms
    end = min(costs.shape[2], width - first)  # beyond this, no pixel lies inside the right image
    block = min(_BLOCK, width)

    for start in range(max(0, 1 - width - first), end, block):
        count = min(block, end - start)
        bits = compare(
            *pair,
            min_disparity=1 - first - start - count,
            num_disparities=count,
            settings=settings,
            known=Known(blur_compensation=compensation),
        )
        sums = aggregate(bits, window=settings.window, shiftable=False)[:, :, ::-1]
        costs[:, :, start : start + count] = sums / np.float32(settings.window**2)


def _leave_out_borders(costs: Volume, disparities: NDArray[np.float64], border: int) -> None:
    """Invalidate the costs whose windows leave either image."""
    rows, cols = costs.shape[:2]
    row, col = np.arange(rows)[:, None], np.arange(cols)[:, None]

    match = col + disparities
    inside = (np.minimum(col, match) >= border) & (np.maximum(col, match) <= cols - 1 - border)

    costs[(np.minimum(row, rows - 1 - row) < border)[:, 0]] = np.nan
    costs[:, ~inside] = np.nan

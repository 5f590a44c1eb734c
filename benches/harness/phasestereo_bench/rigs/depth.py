"""Models defocus that grows with depth: a lens focuses at one distance, and the scene has many."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Image, Plane
from phasestereo_bench.datasets import Pair
from phasestereo_bench.degradation import convolve, disk_psf, quantize
from phasestereo_bench.rigs.fault import SEEDS
from phasestereo_bench.rigs.geometry import sampled
from phasestereo_bench.rigs.optics import BLURRED_NOISE
from phasestereo_bench.rigs.sensor import noise

_LAYERS = 12
_SHARP = 0.5  # px: a smaller disk is ignored
_FAR, _NEAR = 2.0, 98.0  # percentiles of the left disparities between which radii are measured
_LEAST_COVER = 1e-3


@dataclass(frozen=True, slots=True)
class DepthOfField:
    """A step that puts one image, or both, out of focus by how far things are.

    Parameters
    ----------
    radius
        Radius of the disk at the end of the scene opposite to the end in focus, px.
    opposite
        The worse image is in focus far away; the other image is in focus nearby if this is true,
        else everywhere.
    """

    radius: float
    opposite: bool = False

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the pair as these lenses show it.

        Raises
        ------
        ValueError
            If the pair has no truth.
        """
        truth = pair.known_truth
        far, near = np.percentile(filled(truth), (_FAR, _NEAR))
        images = {"left": pair.left, "right": pair.right}
        maps = {"left": filled(truth), "right": filled(seen_from_right(truth))}
        other = {"left": "right", "right": "left"}[side]
        focused = {side: far, other: near} if self.opposite else {side: far}

        for name, focus in focused.items():
            radii = self.radius / max(near - far, 1e-6)
            soft = quantize(_layered(images[name], maps[name], focus, radii), np.uint8)
            images[name] = noise(soft, SEEDS[name], sigma=BLURRED_NOISE)

        return replace(pair, left=images["left"], right=images["right"])


@dataclass(frozen=True, slots=True)
class Raised:
    """A step that raises the right camera: rows are off by this share of the disparity."""

    share: float

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the pair of this rig; for a raised left camera, all goes the other way."""
        y, x = np.mgrid[: pair.right.shape[0], : pair.right.shape[1]].astype(np.float64)
        share = self.share if side == "right" else -self.share
        down = share * filled(seen_from_right(pair.known_truth))
        return replace(pair, right=quantize(sampled(pair.right, x, y - down), np.uint8))


@dataclass(frozen=True, slots=True)
class Redrawn:
    """A step that draws a new right image from the left one, with disparities of this span.

    `first` is the least disparity of the delivered pair, as in `Pair`.
    """

    span: int
    first: int = 0

    def __call__(self, pair: Pair, _side: str) -> Pair:
        """Return the pair of cameras that are closer together and turned toward each other."""
        known = pair.known_truth
        low, high = float(np.nanmin(known)), float(np.nanmax(known))
        truth = ((known - low) * (self.span / max(high - low, 1e-6))).astype(np.float32)
        seen = filled(seen_from_right(truth))
        y, x = np.mgrid[: truth.shape[0], : truth.shape[1]]

        column = np.clip(np.nan_to_num(np.rint(x - truth)), 0, None).astype(int)
        visible = (truth <= x) & (np.abs(np.take_along_axis(seen, column, 1) - truth) <= 1)
        return replace(
            pair,
            right=quantize(sampled(pair.left, x + seen, y), np.uint8),
            truth=truth,
            truth_right=None,
            masks={"nonocc": visible, "all": np.isfinite(truth)},
            num_disparities=16,
            first=self.first,
        )


@dataclass(frozen=True, slots=True)
class Pasted:
    """A step that puts small things close to the cameras: pieces of the scene, upside down."""

    count: int
    size: int
    ahead: int

    def __call__(self, pair: Pair, _side: str) -> Pair:
        """Return the pair with things that are nearer than all else by `ahead` px of disparity."""
        rng = np.random.default_rng(SEEDS["left"])
        left, right, truth = pair.left.copy(), pair.right.copy(), pair.known_truth.copy()
        rows, cols = truth.shape
        near = int(np.nanmax(truth)) + self.ahead
        thing, hidden = np.zeros(truth.shape, bool), np.zeros(truth.shape, bool)

        for _ in range(self.count):
            y = rng.integers(0, rows - self.size)
            x = rng.integers(min(near, cols - self.size - 1), cols - self.size)
            here = slice(y, y + self.size), slice(x, x + self.size)
            there = slice(y, y + self.size), slice(max(x - near, 0), max(x - near, 0) + self.size)
            left[here] = right[there] = pair.left[::-1][here]
            truth[here], thing[here], hidden[there] = x - there[1].start, True, True

        column = np.clip(np.nan_to_num(np.rint(np.arange(cols) - truth)), 0, None).astype(int)
        shown = ~np.take_along_axis(hidden, column, 1) | thing
        masks = {
            name: (mask | thing) & (shown | (name == "all")) for name, mask in pair.masks.items()
        }
        more = min(max(pair.num_disparities, (near + 16) // 16 * 16), cols)
        return replace(
            pair,
            left=left,
            right=right,
            truth=truth,
            truth_right=None,
            masks=masks,
            num_disparities=more,
        )


def filled(disparity: NDArray[np.floating]) -> Plane:
    """Return a map without gaps: the farther of the next known values on either side in the row.

    A row without any known value gets the median of the map.
    """
    known = np.isfinite(disparity)
    cols = np.arange(disparity.shape[1])
    # Columns of the next known value on either side.
    before = np.maximum.accumulate(np.where(known, cols, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, cols, cols.size)[:, ::-1], axis=1)[:, ::-1]

    left = _taken(disparity, before, before >= 0)
    right = _taken(disparity, after, after < cols.size)

    # Gaps are mostly occlusions, which show the farther surface.
    nearest = np.fmin(left, right)
    return np.where(np.isfinite(nearest), nearest, np.nanmedian(disparity)).astype(np.float64)


def seen_from_right(disparity: NDArray[np.floating]) -> Plane:
    """Return the map of the right view: the nearest value that falls on a column, else NaN."""
    seen = np.full(disparity.shape, -np.inf)
    y, x = np.nonzero(np.isfinite(disparity))
    values = disparity[y, x].astype(np.float64)
    column = np.rint(x - values).astype(int)
    inside = column >= 0

    # Nearer things hide farther ones.
    np.maximum.at(seen, (y[inside], column[inside]), values[inside])
    return np.where(np.isfinite(seen), seen, np.nan)


def _layered(image: Image, disparity: Plane, focus: float, radii: float) -> Plane:
    """Return the image as layers, each blurred by its own disk, from the farthest to the nearest.

    A disk's radius grows by `radii` px with each px of disparity off `focus`.
    """
    edges = np.linspace(disparity.min(), disparity.max() + 1e-6, _LAYERS + 1)
    colors = np.atleast_3d(image).astype(np.float64)
    total, cover = np.zeros(colors.shape), np.zeros(disparity.shape)

    for low, high in pairwise(edges):
        layer = ((disparity >= low) & (disparity < high)).astype(np.float64)
        shown = colors * layer[:, :, np.newaxis]
        radius = radii * abs((low + high) / 2 - focus)

        # Colors and cover are blurred alike, so a layer's rim lets the layers behind it through.
        if radius >= _SHARP:
            psf = disk_psf(radius)
            layer, shown = convolve(layer, psf), convolve(shown, psf)

        total = shown + total * (1 - layer)[:, :, np.newaxis]
        cover = layer + cover * (1 - layer)

    return (total / np.maximum(cover, _LEAST_COVER)[:, :, np.newaxis]).reshape(image.shape)


def _taken(values: NDArray[np.floating], cols: NDArray[np.intp], known: NDArray[np.bool_]) -> Plane:
    """Return each row's values at these columns, NaN elsewhere."""
    taken = np.take_along_axis(values, np.where(known, cols, 0), axis=1)
    return np.where(known, taken, np.nan).astype(np.float64)

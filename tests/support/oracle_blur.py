"""What the estimation of relative blur computes, written from its definition, in float64.

Slow and plain on purpose, nothing shared with the implementation but two things that have oracles
and tests of their own: the match by which blocks are found, and the kernels of the families. The
left image is the reference; spectra are half planes ``[ky, kx]``, ky from 0 to 31, kx as in
`numpy.fft.fftfreq`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import phasestereo as ps
from phasestereo_bench.degradation import disk_psf, gaussian_psf, motion_psf
from support import oracle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Bools = NDArray[np.bool_]
    Floats = NDArray[np.float64]
    Side = Literal["none", "left", "right"]
    Psf = tuple[str, float, float]
    Block = tuple[int, int, int]

SIDE = 64
UNKNOWN, UNTRIED = np.inf, 1.0


# --- what both images show in common ---


@dataclass
class MaskedPair:
    """A pair as gray values about the middle of 8 bits, and where its pixels are valid."""

    left: Floats
    right: Floats
    left_valid: Bools
    right_valid: Bools
    search: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        rows, cols = self.left.shape
        return rows, cols


def scene_of(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    *,
    search: tuple[int, int],
    masks: tuple[Bools | None, Bools | None] = (None, None),
) -> MaskedPair:
    grays, valid = [], []
    for image, mask in zip((left, right), masks, strict=True):
        gray = oracle.to_gray(image) - 128
        valid.append(np.ones(gray.shape, bool) if mask is None else mask)
        grays.append(gray if mask is None else oracle.fill_masked(gray, mask))
    return MaskedPair(grays[0], grays[1], valid[0], valid[1], search)


def reduced(image: Floats, factor: int) -> Floats:
    rows, cols = (length // factor for length in image.shape)
    squares = image[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
    mean: Floats = squares.mean(axis=(1, 3))
    return mean


def rough(pair: MaskedPair, factor: int, neighborhood: int, **others: Any) -> Floats:
    """Return disparities, in pixels of the whole image, of the pair reduced by a factor."""
    smaller = [reduced(image, factor).astype(np.float32) for image in (pair.left, pair.right)]

    width = smaller[0].shape[1]
    low, high = (d // factor for d in (pair.search[0], sum(pair.search) - 1))
    count = min(high + 2 - low, width)

    result = ps.match(
        *smaller,
        min_disparity=int(np.clip(low, 1 - width - (count - 1), width - 1)),
        num_disparities=count,
        preset="paper",
        neighborhood=neighborhood,
        frequencies=(1, 1),
        **others,
        precision="byte",
        optimizer="so",
        shiftable=False,
        p1=3,
        p2=16,
        confidence=False,
    )

    return result.disparity.astype(np.float64) * factor


def between(disparity: Floats, factor: int, size: tuple[int, int]) -> Floats:
    """Return the disparity of every pixel, interpolated between those of the reduced image."""

    def places(length: int, there: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
        exact = np.clip((np.arange(length) + 0.5) / factor - 0.5, 0, there - 1)
        first = np.minimum(exact.astype(int), max(there - 2, 0))
        return first, np.minimum(first + 1, there - 1), exact - first

    top, bottom, down = places(size[0], disparity.shape[0])
    left, right, along = places(size[1], disparity.shape[1])

    rows = disparity[top] + down[:, None] * (disparity[bottom] - disparity[top])
    between: Floats = rows[:, left] + along * (rows[:, right] - rows[:, left])
    return between


def blocks(pair: MaskedPair, disparity: Floats, factor: int, step: int) -> list[Block | None]:
    """Return top, left and right of the pair of blocks of every tile; None elsewhere."""
    rows, cols = pair.size
    places: list[Block | None] = []
    for y in range(-(-rows // step)):
        for x in range(-(-cols // step)):
            top = int(np.clip(y * step + step // 2 - SIDE // 2, 0, rows - SIDE))
            left = int(np.clip(x * step + step // 2 - SIDE // 2, 0, cols - SIDE))

            down, along = (
                min((corner + 16) // factor, there - 1)
                for corner, there in zip((top, left), disparity.shape, strict=True)
            )

            core = disparity[down : down + 32 // factor, along : along + 32 // factor]
            middle = np.sort(core, axis=None)[core.size // 2]
            right = left - int(np.copysign(np.floor(abs(middle) + 0.5), middle))
            # At most a tenth of either block may be masked.
            seen = 0 <= right <= cols - SIDE and all(
                (~valid[top : top + SIDE, corner : corner + SIDE]).sum() <= SIDE**2 / 10
                for valid, corner in ((pair.left_valid, left), (pair.right_valid, right))
            )

            places.append((top, left, right) if seen else None)

    return places


# --- spectra ---


@cache
def window() -> Floats:
    """Return the raised cosine whose squares have the sum 1."""
    profile = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(SIDE) + 0.5) / SIDE)
    square: Floats = np.outer(profile, profile)
    normal: Floats = square / np.sqrt((square**2).sum())
    return normal


def half_spectrum(block: Floats) -> NDArray[np.complex128]:
    mean = (block * window()).sum() / window().sum()
    return np.fft.fft2((block - mean) * window())[: SIDE // 2]


def pair_spectra(
    images: tuple[Floats, Floats], place: Block
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    top, *corners = place
    left, right = (
        half_spectrum(image[top : top + SIDE, corner : corner + SIDE])
        for image, corner in zip(images, corners, strict=True)
    )
    return left, right


def response(psf: Floats) -> Floats:
    """Return the power that a kernel leaves in every bin, as the window smears it."""
    wrapped = np.zeros((SIDE, SIDE))
    half = psf.shape[0] // 2
    for (y, x), tap in np.ndenumerate(psf):
        wrapped[(y - half) % SIDE, (x - half) % SIDE] += tap

    power = np.abs(np.fft.fft2(wrapped)) ** 2

    # A Hann window in space is this three-tap average in frequency.
    for axis in (0, 1):
        beside = np.roll(power, 1, axis) + np.roll(power, -1, axis)
        power = 2 / 3 * power + 1 / 6 * beside

    return pooled(power[: SIDE // 2])


# --- bins ---


@dataclass
class Bins:
    """Which coefficients are one bin, and how much each bin counts."""

    members: list[tuple[NDArray[np.intp], NDArray[np.intp]]]
    weights: Floats
    low: Floats
    sectors: list[tuple[NDArray[np.intp], NDArray[np.intp]]]


@cache
def bins() -> Bins:
    ky, kx = np.meshgrid(np.arange(32), np.fft.fftfreq(SIDE, 1 / SIDE).astype(int), indexing="ij")

    frequency = np.hypot(kx, ky)
    # Squares of 2 x 2 coefficients at low frequencies, of 4 x 4 at high ones.
    size = np.where((ky < 16) & (kx >= -16) & (kx < 15), 2, 4)
    names = np.stack([size, ky // size, (kx + 1) // size], axis=-1)
    members: list[Any] = [
        np.nonzero((names == name).all(-1)) for name in np.unique(names.reshape(-1, 3), axis=0)
    ]

    # A bin counts by one over its frequency, so that each octave counts alike. Below 1.2 cycles per
    # block the spectrum of the window itself covers everything.
    counted = [frequency[member][frequency[member] > 1.2] for member in members]
    weights = np.array([(1 / found).sum() for found in counted])
    means = np.array([frequency[member].mean() for member in members])

    # Up to 5 cycles per block a blur leaves enough to find the gain.
    low = ((means >= 1.2) & (means < 5)).astype(float)
    eighth = np.floor(np.arctan2(ky, kx) / np.pi * 8 + 0.5).astype(int) % 8

    # Up here there is little but noise, in some direction at the least: motion blurs only one.
    high = (frequency > 0.35 * SIDE) & (ky > 0)
    sectors: list[Any] = [np.nonzero(high & (eighth == sector)) for sector in range(8)]

    return Bins(members, weights / weights.sum(), low / low.sum(), sectors)


def pooled(power: Floats) -> Floats:
    return np.array([power[member].mean() for member in bins().members])


def least_high(power: Floats) -> float:
    return float(min(power[sector].mean() for sector in bins().sectors))


# --- the model ---


def fit(
    soft: Floats, sharp: Floats, noise: tuple[float, float], responses: Floats
) -> tuple[Floats, Floats]:
    """Fit soft = gain response (sharp - its noise) + noise, with the noise of (soft, sharp).

    Returns
    -------
    loss, gain
        For each of the responses (n, bins).
    """
    weights, low = bins().weights, bins().low
    # The gain of contrast, as power, from low frequencies, which a blur hardly changes.
    signal = np.maximum(sharp - noise[1], 0.02 * sharp)
    lows = np.log(np.maximum(soft - noise[0], 0.02 * soft)) - np.log(signal)
    gain = np.exp(np.clip((low * (lows - np.log(responses))).sum(1), -20, 20))

    # One Newton step of the gain: what more of it does depends on how much of a bin is signal.
    there = gain[:, None] * responses * signal
    residual, trust = np.log(soft) - np.log(there + noise[0]), there / (there + noise[0])
    pull = (weights * trust * np.clip(residual, -2, 2)).sum(1)

    correction = np.clip(pull / np.maximum((weights * trust).sum(1), 1e-9), -1, 1)
    # Residuals are limited to 2 nepers: blocks need not show the same altogether.
    left = np.abs(residual - trust * correction[:, None])
    return (weights * np.minimum(left, 2)).sum(1), gain * np.exp(correction)


def lack(soft: Floats, sharp: Floats, noise: tuple[float, float]) -> float:
    """Return by how much one image has less power than the other, given no blur, in nepers."""
    signal = np.maximum(sharp - noise[1], 0.02 * sharp)
    lows = np.log(np.maximum(soft - noise[0], 0.02 * soft)) - np.log(signal)
    gain = np.exp(np.clip((bins().low * lows).sum(), -20, 20))
    return float((bins().weights * (np.log(gain * signal + noise[0]) - np.log(soft))).sum())


@cache
def bank() -> tuple[list[Psf], Floats]:
    psfs: list[Psf] = [
        *(("gaussian", size, 0.0) for size in (1, 1.5, 2, 3, 4, 5.5, 7)),
        *(("disk", size, 0.0) for size in (2, 3, 4, 5, 6, 8, 10)),
        *(
            ("motion", size, float(angle))
            for size in (5, 7, 9, 11, 13, 15, 18, 21, 25)
            for angle in range(0, 180, 15)
        ),
    ]

    return psfs, np.array([response(kernel_of(psf)) for psf in psfs])


def kernel_of(psf: Psf) -> Floats:
    family, size, angle = psf
    if family == "motion":
        return motion_psf(max(size, 1), angle)
    return gaussian_psf(size) if family == "gaussian" else disk_psf(size)


def spread(psf: Psf) -> float:
    family, size, _ = psf
    return {"gaussian": size, "disk": size / 2, "motion": float((size - 1) / np.sqrt(24))}[family]


FLAT = np.ones((1, 1))


# --- tiles ---


@dataclass
class Grid:
    """Tiles, and the powers of the blocks about their centers: (tiles, 2, bins)."""

    shape: tuple[int, int]
    places: list[Block | None]
    powers: Floats
    highs: Floats

    @property
    def known(self) -> Bools:
        return np.array([place is not None for place in self.places])


def grid(pair: MaskedPair, disparity: Floats, step: int) -> Grid:
    places = blocks(pair, disparity, 4, step)
    powers = np.zeros((len(places), 2, len(bins().members)))
    highs = np.full((len(places), 2), np.nan)

    for tile, place in enumerate(places):
        if place is not None:
            for side, half in enumerate(pair_spectra((pair.left, pair.right), place)):
                power = np.abs(half) ** 2
                powers[tile, side], highs[tile, side] = pooled(power), least_high(power)

    rows, cols = pair.size
    return Grid((-(-rows // step), -(-cols // step)), places, powers, highs)


def noise_of(there: Grid) -> tuple[float, float]:
    highs = np.sort(there.highs[there.known], axis=0)
    if len(highs) == 0:
        return 0.0, 0.0
    # The quietest tenth of the blocks, each in its quietest direction, is quieter than the noise:
    # 1.28 was measured for noise of a known level.
    left, right = highs[len(highs) // 10] * 1.28
    return float(left), float(right)


def losses_of(
    powers: Floats, noise: tuple[float, float], choices: Sequence[tuple[Side, Floats]]
) -> Floats:
    """Return the loss of each blur, of a side and with responses, for a pair of blocks.

    Of more than eight, those of an image that clearly lacks less power than the other one are not
    tried.
    """
    left, right = powers
    by_side = {"left": (left, right, noise), "right": (right, left, noise[::-1])}

    more = lack(*by_side["left"]) - lack(*by_side["right"])
    many = sum(len(responses) for _, responses in choices) > 8
    untried = {"left": many and -more > 0.3, "right": many and more > 0.3}

    # What one image lacks may look like noise of the other, but not both ways around.
    none = (fit(*by_side["left"], FLAT)[0] + fit(*by_side["right"], FLAT)[0]) / 2

    losses: list[Floats] = []
    for side, responses in choices:
        if side == "none":
            losses.append(none)
        elif untried[side]:
            losses.append(np.full(len(responses), max(float(none[0]), UNTRIED)))
        else:
            losses.append(fit(*by_side[side], responses)[0])

    return np.concatenate(losses)


def everything() -> list[tuple[Side, Floats]]:
    """Return the candidates: no blur, the bank on the left, and on the right."""
    _, responses = bank()
    return [("none", FLAT), ("left", responses), ("right", responses)]


def losses_on(
    there: Grid, noise: tuple[float, float], choices: Sequence[tuple[Side, Floats]]
) -> Floats:
    """Return the losses of all tiles (tiles, blurs)."""
    losses = np.full((len(there.places), sum(len(each) for _, each in choices)), UNKNOWN)
    for tile in np.flatnonzero(there.known):
        losses[tile] = losses_of(there.powers[tile], noise, choices)
    return losses


def chosen(losses: Floats) -> list[int]:
    """Return the fewest choices that explain the tiles, of losses (tiles, choices)."""
    known = losses[np.isfinite(losses[:, 0])]
    if len(known) == 0:
        return []

    # No blur comes first, unless one choice is clearly better for all tiles together.
    means = known.mean(0)
    best = int(means.argmin())
    choices = [0 if means[0] <= means[best] + 0.03 else best]

    # A further choice counts where it is better by 0.06: on sharp pairs some are better by chance.
    while len(choices) < 8:
        so_far = known[:, choices].min(1)
        worth = np.maximum(so_far[:, None] - known - 0.06, 0).mean(0)
        if worth.max() < 0.01:
            break
        choices.append(int(worth.argmax()))

    return choices


def best_members(losses: Floats, choice: int) -> NDArray[np.intp]:
    """Return the tiles of a choice; where there are several, the better explained half of them."""
    members = np.flatnonzero(np.isfinite(losses[:, 0]) & (losses.argmin(1) == choice))
    if losses.shape[1] == 1:
        return members
    order = np.argsort(losses[members, choice], kind="stable")
    return members[order[: -(-len(members) // 2)]]


def around(tile: int, shape: tuple[int, int]) -> list[int]:
    y, x = divmod(tile, shape[1])
    rows, cols = (
        range(max(y - 1, 0), min(y + 2, shape[0])),
        range(max(x - 1, 0), min(x + 2, shape[1])),
    )
    return [row * shape[1] + col for row in rows for col in cols]


def steadied(losses: Floats, shape: tuple[int, int]) -> Floats:
    """Return for each tile the losses of the best explained one around it.

    Blocks that straddle a boundary are explained well by nothing.
    """
    best = losses.min(1)
    taken = [
        min([tile, *around(tile, shape)], key=lambda t: best[t]) for tile in range(len(losses))
    ]
    return losses[taken]


def labels(losses: Floats, shape: tuple[int, int]) -> NDArray[np.intp]:
    """Return the choice of every tile after up to eight rounds of comparison with its neighbors."""
    # Iterated conditional modes of a Potts model (Besag 1986): a neighbor of another choice costs
    # 0.15 nepers, a diagonal one half of that.
    known = np.where(np.isfinite(losses), losses, 0)
    now = losses.argmin(1)
    for _ in range(8):
        energy = known.copy()
        for tile in range(len(losses)):
            for other in set(around(tile, shape)) - {tile}:
                beside = abs(other - tile) in (1, shape[1])
                energy[tile, now[other]] -= 0.15 if beside else 0.075

        after = energy.argmin(1)
        if (after == now).all():
            break
        now = after

    kept: NDArray[np.intp] = now
    return kept


# --- kinds ---


@dataclass
class Kind:
    """A kind of blur: its family or "other" or "none", its kernel, its powers, and how it fits."""

    side: Side
    psf: Psf
    kernel: Floats | None
    powers: Floats
    loss: float
    gain: float
    other: Psf | None = None  # the blur of the other image, if it lacks something as well


def unseen() -> Kind:
    """Return the kind of no blur that was chosen first and lost all its tiles."""
    nothing = np.full((2, len(bins().members)), np.finfo(np.float32).tiny, float)
    return Kind("none", ("none", 0.0, 0.0), None, nothing, 2.0, 1.0)


def refined(soft: Floats, sharp: Floats, noise: tuple[float, float]) -> tuple[Psf, float, float]:
    """Return the best of all families, from the nearest of the bank on, its loss and its gain."""

    def judge(psf: Psf) -> tuple[Psf, float, float]:
        loss, gain = fit(soft, sharp, noise, response(kernel_of(psf))[None])
        return psf, float(loss[0]), float(gain[0])

    psfs, responses = bank()
    losses, _ = fit(soft, sharp, noise, responses)

    seeds = []
    for family in ("gaussian", "disk", "motion"):
        members = [n for n, psf in enumerate(psfs) if psf[0] == family]
        seeds.append(judge(psfs[min(members, key=lambda n: losses[n])]))

    # Families that begin much worse than the best have no chance.
    least = min(loss for _, loss, _ in seeds)
    found = [descended(seed, judge) for seed in seeds if seed[1] <= 1.6 * least + 0.02]
    return min(found, key=lambda each: each[1])


def descended(seed: tuple[Psf, float, float], judge: Any) -> tuple[Psf, float, float]:
    best, largest = seed, {"gaussian": 8, "disk": 14, "motion": 31}[seed[0][0]]
    # Coordinate descent in size and angle, with steps that are halved where nothing gets better.
    for halving in range(5):
        grow, turn = 0.2 / 2**halving, 8 / 2**halving

        while True:
            family, size, angle = best[0]
            near = [(family, size * factor, angle) for factor in (1 - grow, 1 + grow)]

            if family == "motion":
                near += [(family, size, (angle + by) % 180) for by in (turn, -turn)]
            tried = [judge(psf) for psf in near if psf[1] <= largest]

            better = min(tried, key=lambda each: each[1], default=best)
            if better[1] >= best[1]:
                break
            best = better

    return best


def kind_of(
    pair: MaskedPair, there: Grid, tiles: NDArray[np.intp], noise: tuple[float, float], side: Side
) -> Kind:
    """Return the kind of blur that the blocks of these tiles have together."""
    powers = there.powers[tiles].mean(0)
    left, right = powers
    loss = losses_of(powers, noise, [("none", FLAT)])
    _, gain = fit(left, right, noise, FLAT)
    none = Kind("none", ("none", 0.0, 0.0), None, powers, float(loss[0]), float(gain[0]))

    if side == "none":
        return none

    (soft, sharp), levels = (
        ((left, right), noise) if side == "left" else ((right, left), noise[::-1])
    )

    psf, least, power = refined(soft, sharp, levels)
    # Real pairs differ by such a small blur, too.
    if spread(psf) < 0.6 and least <= 0.3:
        return none
    family = Kind(side, psf, kernel_of(psf), powers, least, power)

    # Enough tiles that no family explains well are measured without one.
    if least <= 0.3 or len(tiles) < 12:
        return family
    taps = measured(pair, [there.places[tile] for tile in tiles], side)
    if taps is None:
        return family

    loss, gain = fit(soft, sharp, levels, response(taps)[None])
    if loss[0] > 1.5 * least:
        return family

    size = radius(taps)
    return Kind(side, ("other", size, 0.0), taps, powers, float(loss[0]), float(gain[0]))


def radius(taps: Floats) -> float:
    y, x = np.indices(taps.shape)
    y_mean, x_mean = (taps * y).sum(), (taps * x).sum()
    return float(np.sqrt((taps * ((y - y_mean) ** 2 + (x - x_mean) ** 2)).sum()))


# --- blurs of both images ---


def two_sided(there: Grid, noise: tuple[float, float]) -> Kind | None:
    """Return the blurs of both images, if they explain all blocks clearly better than one does."""
    if there.known.sum() < 12:
        return None

    powers = np.mean([there.powers[tile] for tile in np.flatnonzero(there.known)], axis=0)
    one_sided = losses_of(powers, noise, everything()).min()
    if one_sided <= 0.3:
        return None

    def against(side: int, undone: Floats) -> tuple[Floats, Floats, tuple[float, float]]:
        """Return the evidence for a blur of a side, that of the other side undone."""
        sharp = powers[1 - side]
        signal = np.maximum(sharp - noise[1 - side], 0.02 * sharp)
        return powers[side], signal / np.maximum(undone, 1e-3), (noise[side], 0.0)

    psfs, responses = bank()
    pairs = [
        (fit(*against(side, response), responses)[0], side, psf)
        for psf, response in zip(psfs, responses, strict=True)
        for side in (0, 1)
    ]
    losses, side, known = min(pairs, key=lambda each: each[0].min())
    best = psfs[int(losses.argmin())]
    both = [best, known] if side == 0 else [known, best]

    for _ in range(3):
        for side in (0, 1):
            both[side] = refined(*against(side, response(kernel_of(both[1 - side]))))[0]

    fits = [
        fit(
            *against(side, response(kernel_of(both[1 - side]))),
            response(kernel_of(both[side]))[None],
        )
        for side in (0, 1)
    ]
    is_slight = min(map(spread, both)) < 0.6
    if is_slight or np.mean([loss[0] for loss, _ in fits]) > 0.7 * one_sided:
        return None

    softer = 0 if spread(both[0]) >= spread(both[1]) else 1
    psf, (loss, gain) = both[softer], fits[softer]
    name: Side = "left" if softer == 0 else "right"
    numbers = float(loss[0]), float(gain[0])
    return Kind(name, psf, kernel_of(psf), powers, *numbers, other=both[1 - softer])


# --- a kernel of no family ---


def measured(pair: MaskedPair, places: Sequence[Block | None], side: Side) -> Floats | None:
    """Return the kernel that least squares find between the images, one warped onto the other."""
    # The right image is warped onto the left one by a finer map, to whole pixels.
    disparity = between(rough(pair, 2, 9), 2, pair.size)
    shift = np.copysign(np.floor(np.abs(disparity) + 0.5), disparity).astype(int)
    from_x = np.clip(np.arange(pair.size[1]) - shift, 0, pair.size[1] - 1)
    seen = np.take_along_axis(pair.right, from_x, axis=1)

    product = np.zeros((SIDE // 2, SIDE), complex)
    power = np.zeros((SIDE // 2, SIDE))

    for place in places:
        assert place is not None
        left, right = pair_spectra((pair.left, seen), (place[0], place[1], place[1]))
        soft, sharp = (left, right) if side == "left" else (right, left)
        # Blocks of strong contrast count no more than others.
        scale = product.size / (np.abs(left) ** 2 + np.abs(right) ** 2).sum()
        product += scale * soft * sharp.conj()
        power += scale * np.abs(sharp) ** 2

    # Least squares with a little regularization, against division by nothing.
    return cleaned(kernel(product / (power + 1e-3 * power.mean())))


def kernel(half: NDArray[np.complex128]) -> Floats:
    """Return the kernel, centered, whose spectrum this half plane and its mirror image are."""
    whole = np.zeros((SIDE, SIDE), complex)
    for ky, kx in np.ndindex(*half.shape):
        whole[-ky % SIDE, -kx % SIDE] = half[ky, kx].conj()
    whole[: SIDE // 2] = half
    taps: Floats = np.fft.fftshift(np.fft.ifft2(whole)).real
    return taps


def cleaned(taps: Floats) -> Floats | None:
    """Return the connected group of strong taps about the largest, sum 1."""
    inner = taps[SIDE // 2 - 15 : SIDE // 2 + 16, SIDE // 2 - 15 : SIDE // 2 + 16]
    if inner.max() <= 0:
        return None

    # Smaller taps are noise, as are those apart from the group of the largest.
    strong = np.pad(inner >= 0.08 * inner.max(), 1)
    group = np.zeros_like(strong)
    top = np.unravel_index(inner.argmax(), inner.shape)
    group[top[0] + 1, top[1] + 1] = True

    while True:
        grown = strong & np.any(
            [np.roll(group, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0
        )

        if (grown == group).all():
            break
        group = grown

    kept = np.where(group[1:-1, 1:-1], inner, 0)
    normal: Floats = kept / kept.sum()
    return normal


# --- blur that follows depth ---


@dataclass
class Curve:
    """Squared radii, negative of the right image, at the ends and the middle of a span."""

    span: tuple[float, float]
    squared: tuple[float, float, float]

    def radii(self, disparity: Floats) -> Floats:
        low, high = self.span
        part = np.clip((disparity - low) / (high - low), 0, 1)
        curve = np.polynomial.Polynomial.fit(
            [0, 0.5, 1], self.squared, 2, domain=[0, 1], window=[0, 1]
        )
        squared: Floats = curve(part)
        return np.sign(squared) * np.sqrt(np.abs(squared))

    def drawn(self, disparity: Floats) -> Floats:
        """Return the radii of tiles: none, or 2 to 9.5 in steps of 1.5."""
        radii = self.radii(disparity)
        steps = np.clip(np.floor((np.abs(radii) - 2) / 1.5 + 0.5), 0, 5)
        found: Floats = np.where(np.abs(radii) < 1, 0, np.sign(radii) * (2 + 1.5 * steps))
        return found


def depths_of(pair: MaskedPair, tile: int) -> Floats:
    """Return the median disparity about the middle of every tile."""
    disparity = rough(pair, 4, 5, window=5, subpixel=True)
    depths = np.empty([-(-length // tile) for length in pair.size])

    for place in np.ndindex(*depths.shape):
        middle = (
            min(each * tile + tile // 2, length - 1)
            for each, length in zip(place, pair.size, strict=True)
        )
        y, x = (max(each - 16, 0) // 4 for each in middle)
        core = disparity[y : y + 8, x : x + 8]
        depths[place] = np.sort(core, axis=None)[core.size // 2]
    return depths


def disk_losses(powers: Floats, noise: tuple[float, float]) -> Floats:
    """Return losses of disks of 10 to 1 px on the right, of none, and of 1 to 10 px on the left."""
    disks = np.stack([response(disk_psf(radius)) for radius in range(1, 11)])
    left, right = powers
    on_right, _ = fit(right, left, noise[::-1], disks)
    on_left, _ = fit(left, right, noise, disks)
    return np.concatenate([on_right[::-1], losses_of(powers, noise, [("none", FLAT)]), on_left])


def following(
    known: Floats, weight: Floats, losses: Floats, apart: float, span: tuple[float, float]
) -> Curve | None:
    """Return the curve that explains blocks of these disparities clearly best, if one does."""
    parts = np.minimum(
        (np.clip((known - span[0]) / (span[1] - span[0]), 0, 1) * 16).astype(int), 15
    )
    sums = np.array([(weight[:, None] * losses)[parts == part].sum(0) for part in range(16)])
    middles = span[0] + (np.arange(16) + 0.5) / 16 * (span[1] - span[0])

    def total(curve: Curve) -> float:
        radii = np.clip(curve.radii(middles), -10, 10)
        at = (np.interp(r, np.arange(-10, 11), row) for r, row in zip(radii, sums, strict=True))
        return float(sum(at))

    # Two lenses alike in focus apart, or one lens that blurs.
    tried = []
    for first, last in np.ndindex(51, 51):
        ends = np.array([first / 25 - 1, (first + last) / 50 - 1, last / 25 - 1])
        tried += [100 * ends, 100 * ends**2, -100 * ends**2]
    curves = [Curve(span, (float(a), float(b), float(c))) for a, b, c in tried]
    best = min(curves, key=total)

    uniform = sums.sum(0).min() / weight.sum()
    gain = uniform - total(best) / weight.sum()
    return best if gain >= 0.025 and gain >= (uniform - apart) / 2 else None


def disk_of(signed: float, powers: Floats, noise: tuple[float, float]) -> Kind:
    """Return the kind of a disk, on the right image if its radius is negative, or of none."""
    left, right = powers
    if not signed:
        _, power = fit(left, right, noise, FLAT)
        loss = losses_of(powers, noise, [("none", FLAT)])
        return Kind("none", ("none", 0.0, 0.0), None, powers, float(loss[0]), float(power[0]))

    taps = disk_psf(abs(signed))
    side: Side = "left" if signed > 0 else "right"
    soft, sharp, levels = (left, right, noise) if signed > 0 else (right, left, noise[::-1])
    loss, power = fit(soft, sharp, levels, response(taps)[None])
    return Kind(side, ("disk", abs(signed), 0.0), taps, powers, float(loss[0]), float(power[0]))


def by_depth(
    pair: MaskedPair, there: Grid, step: int, noise: tuple[float, float], apart: float
) -> tuple[list[Kind], NDArray[np.intp], int, float] | None:
    """Return disks whose radii follow depth, their map, its tile and the contrast; or None."""
    rows, cols = pair.size
    tile = max(16, -(-int(np.sqrt(rows * cols // 6000)) // 16) * 16)
    depths = depths_of(pair, tile)

    # The disparity of each block, and how mixed those around it are.
    members = np.flatnonzero(there.known)
    of_blocks, mixed = [], []
    for number in members:
        y, x = (
            min(each * step + step // 2, length - 1) // tile
            for each, length in zip(divmod(int(number), there.shape[1]), pair.size, strict=True)
        )
        of_blocks.append(depths[y, x])
        mixed.append(np.ptp(depths[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]))

    known, ends = np.array(of_blocks), np.sort(of_blocks)
    if len(known) < 24:
        return None
    span = float(ends[len(ends) // 32]), float(ends[len(ends) - 1 - len(ends) // 32])
    if span[1] - span[0] < 2:
        return None

    weight = 1 / (1 + (np.array(mixed) / (0.1 * (span[1] - span[0]))) ** 2)
    losses = np.array([disk_losses(there.powers[number], noise) for number in members])
    curve = following(known, weight, losses, apart, span)
    if curve is None:
        return None

    drawn, of_members = curve.drawn(depths), curve.drawn(known)
    radii = list(dict.fromkeys(drawn.ravel().tolist()))
    chosen = [members[of_members == r] if r in of_members else members for r in radii]
    kinds = [
        disk_of(signed, there.powers[tiles].mean(0), noise)
        for signed, tiles in zip(radii, chosen, strict=True)
    ]

    drawn_kinds = np.array([radii.index(r) for r in drawn.ravel()]).reshape(depths.shape)
    signs = [-0.5 if kind.side == "right" else 0.5 for kind in kinds]
    logs = np.array([sign * np.log(kind.gain) for sign, kind in zip(signs, kinds, strict=True)])
    return kinds, drawn_kinds, tile, float(np.exp(logs[drawn_kinds].mean()))


# --- all of it ---


@dataclass
class Estimate:
    """What `phasestereo.estimate_blur` finds."""

    kinds: list[Kind]
    labels: NDArray[np.intp]
    tile: int
    certainty: float
    contrast: float
    noise: tuple[float, float]


def certainty_of(kind: Kind, noise: tuple[float, float]) -> float:
    # The contrary of a blur: the image as it is. Of an image as it is: the best blur.
    losses = losses_of(kind.powers, noise, everything())
    contrary = losses[1:].min() if kind.side == "none" else losses[0]
    return float(np.clip(1 - kind.loss / contrary, 0, 1))


def estimate(pair: MaskedPair) -> Estimate:
    """Return the blur of a pair of at least 64 x 64 pixels, of which some tiles have blocks."""
    rows, cols = pair.size
    # At most about 110 blocks, 32 to 64 pixels apart, show whether there is any blur.
    spacing = int(np.clip(np.ceil(np.sqrt(rows * cols // 110) / 8) * 8, 32, 64))
    disparity = rough(pair, 4, 9)
    there = grid(pair, disparity, spacing)

    noise = noise_of(there)
    losses = losses_on(there, noise, everything())
    both = two_sided(there, noise)
    choices = chosen(losses) if both is None else []
    found = None
    if any(choice > 0 for choice in choices):
        apart = losses[there.known][:, choices].min(1).mean()
        found = by_depth(pair, there, spacing, noise, float(apart))
    if found is not None:
        choices = []

    kinds: list[Kind] = [] if both is None else [both]

    for number, choice in enumerate(choices):
        count = len(bank()[0])
        side: Side = "none" if choice == 0 else "left" if choice <= count else "right"

        members = best_members(losses[:, choices], number)
        if len(members) == 0:
            if side == "none":
                kinds.append(unseen())
            continue

        kind = kind_of(pair, there, members, noise, side)
        if kind.side != "none" or all(other.side != "none" for other in kinds):
            kinds.append(kind)

    # Several kinds are drawn on a finer map, of at most about 6000 tiles.
    tile, drawn = max(rows, cols), np.zeros((1, 1), int)
    if len(kinds) > 1:
        tile = max(16, -(-int(np.sqrt(rows * cols // 6000)) // 16) * 16)
        drawn = map_of(grid(pair, disparity, tile), kinds, noise)

    contrast = None
    if found is not None:
        kinds, drawn, tile, contrast = found

    # The kind of the largest area comes first; kinds without any tile are dropped.
    areas = np.bincount(drawn.ravel(), minlength=len(kinds))
    order = [int(n) for n in np.argsort(-areas, kind="stable") if areas[n] > 0]
    first = kinds[order[0]]
    if contrast is None:
        contrast = float(np.sqrt(first.gain) ** (-1 if first.side == "right" else 1))

    return Estimate(
        kinds=[kinds[n] for n in order],
        labels=np.array([order.index(n) for n in drawn.ravel()]).reshape(drawn.shape),
        tile=tile,
        certainty=certainty_of(first, noise),
        contrast=contrast,
        noise=(float(np.sqrt(noise[0])), float(np.sqrt(noise[1]))),
    )


def map_of(there: Grid, kinds: list[Kind], noise: tuple[float, float]) -> NDArray[np.intp]:
    """Return the kind that explains each of the tiles."""
    choices: list[tuple[Side, Floats]] = [
        (kind.side, FLAT if kind.kernel is None else response(kind.kernel)[None]) for kind in kinds
    ]
    losses = losses_on(there, noise, choices)
    return labels(steadied(losses, there.shape), there.shape).reshape(there.shape)

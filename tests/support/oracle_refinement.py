"""What becomes of chosen candidates, written from its definitions alone, as `oracle` is.

From what was chosen for each pixel, and what that and others cost, to a map with flags and
confidences: places between candidates, the left-right check, speckles, filling, edges drawn to
those of the image, medians, smoother surfaces, trust. Disparities are float32 throughout, since
thresholds are held against their differences; what is summed is summed in float64.
"""

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import phasestereo as ps
from support import ROOT, oracle

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Map = NDArray[np.float32]
Pixel = tuple[int, int]

MISSING = ps.Flag.MASKED | ps.Flag.NO_CANDIDATE
UNMATCHED = MISSING | ps.Flag.OUTSIDE | ps.Flag.MATCH_MASKED
CHECKED = ps.Flag.OCCLUDED | ps.Flag.MISMATCHED | ps.Flag.AMBIGUOUS | ps.Flag.SPECKLE
UNTRUSTED = UNMATCHED | CHECKED | ps.Flag.LOW_CONFIDENCE


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What was chosen, what it costs and the cheapest that is not next to it (inf: none), (H, W).

    The offset is where the match lies, in pixels from the chosen candidate.
    """

    chosen: Ints
    own: Ints
    elsewhere: Floats
    offset: Map


# --- choices ---


def evidence_of(totals: Ints, costs: Ints, chosen: Ints) -> Evidence:
    """Return the figures of chosen candidates by totals (H, W, N), and costs between them."""
    at = chosen[:, :, np.newaxis]
    beside = np.abs(np.arange(totals.shape[2]) - at) <= 1

    return Evidence(
        chosen=chosen,
        own=np.take_along_axis(totals, at, axis=2)[:, :, 0],
        elsewhere=np.where(beside, np.inf, totals).min(axis=2),
        offset=offsets(costs, chosen),
    )


def of_scanlines(aggregated: Ints, chosen: Ints) -> Evidence:
    """Return the evidence of aggregated costs."""
    return evidence_of(aggregated, aggregated, chosen)


def of_paths(aggregated: Ints, means: Ints) -> Evidence:
    """Return the evidence of means of paths, in which the pixel's own costs count twice again."""
    return evidence_of(means, means + 2 * aggregated, oracle.winner_takes_all(means))


def offsets(costs: Ints, chosen: Ints) -> Map:
    """Return the place of the match between candidates, -0.5 to 0.5 from the chosen one, (H, W).

    The tip of the V through the costs of the candidate below, the chosen and that above; as much
    steeper about the candidate as flatter half-way to the next: t / 2 (1 + 0.3 (1 - |t|)), t being
    twice the tip's place. Candidates at either end are taken as they are.
    """
    found = np.zeros(chosen.shape, np.float32)
    for y, x in np.ndindex(chosen.shape):
        n = chosen[y, x]
        if not 0 < n < costs.shape[2] - 1:
            continue

        below, own, above = costs[y, x, n - 1 : n + 2]
        depth = np.float32(max(max(below, above) - own, 1))
        t = np.clip(np.float32(below - above) / depth, np.float32(-1), np.float32(1))
        one = np.float32(1)
        found[y, x] = np.float32(0.5) * t * (one + np.float32(0.3) * (one - abs(t)))

    return found


def first_flags(chosen: Ints, low: int, masks: tuple[Bools, Bools], number: int) -> Ints:
    """Return the verdict on every pixel and its chosen candidate, one by one."""
    left_mask, right_mask = masks
    height, width = chosen.shape
    valid = oracle.valid_candidates(left_mask, right_mask, low, number)
    flags = np.zeros(chosen.shape, np.int64)

    for y, x in np.ndindex(height, width):
        column = x - low - chosen[y, x]
        inside = int(np.clip(column, 0, width - 1))

        if not left_mask[y, x]:
            flags[y, x] = ps.Flag.MASKED
        elif not valid[y, x].any():
            flags[y, x] = ps.Flag.NO_CANDIDATE
        else:
            flags[y, x] = ps.Flag.OUTSIDE * (column != inside)
            flags[y, x] |= ps.Flag.MATCH_MASKED * (not right_mask[y, inside])

    return flags


def check(evidence: Evidence, flags: Ints, low: int, most: int) -> Ints:
    """Return the flags with those of the left-right check.

    A right pixel belongs to the left one that has chosen it for the least, of several the nearest
    surface. A left pixel is inconsistent whose disparity differs from that of the owner of its
    match by more than `most`: mismatched beside a pixel that is consistent, else occluded.
    """
    height, width = flags.shape
    checked = flags.copy()

    for y in range(height):
        chosen, own = evidence.chosen[y], evidence.own[y]
        matched = [x for x in range(width) if not flags[y, x] & UNMATCHED]
        match = {x: x - low - chosen[x] for x in matched}

        consistent = set()
        for x in matched:
            rivals = [other for other in matched if match[other] == match[x]]
            owner = min(rivals, key=lambda other: (own[other], -chosen[other]))
            if abs(chosen[owner] - chosen[x]) <= most:
                consistent.add(x)
        for x in set(matched) - consistent:
            is_beside = x - 1 in consistent or x + 1 in consistent
            checked[y, x] |= ps.Flag.MISMATCHED if is_beside else ps.Flag.OCCLUDED

    return checked


def flag_ambiguous(evidence: Evidence, flags: Ints, percent: int) -> Ints:
    """Return flags with those of choices that are not cheaper than all else by a percentage."""
    known = np.isfinite(evidence.elsewhere)
    elsewhere = np.where(known, evidence.elsewhere, 0)
    ambiguous = known & (elsewhere * (100 - percent) < 100 * evidence.own)
    return np.where(ambiguous & (flags & MISSING == 0), flags | ps.Flag.AMBIGUOUS, flags)


# --- maps ---


def trusted(disparity: Map, flags: Ints) -> Bools:
    """Return whether a pixel's own estimate counts."""
    counts: Bools = ~np.isnan(disparity) & (flags & UNTRUSTED == 0)
    return counts


def regions(disparity: Map, counts: Bools, step: float) -> Iterator[list[Pixel]]:
    """Yield the pixels that hang together by neighbors (of four) that differ by `step` at most."""
    left = {(int(y), int(x)) for y, x in np.argwhere(counts)}

    while left:
        region = [left.pop()]

        for y, x in region:
            for there in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if there in left and abs(disparity[there] - disparity[y, x]) <= step:
                    left.remove(there)
                    region.append(there)
        yield region


def flag_speckles(disparity: Map, flags: Ints, size: int, step: float) -> Ints:
    """Return the flags with those of regions of up to `size` trusted pixels."""
    flagged = flags.copy()
    for region in regions(disparity, trusted(disparity, flags), step):
        if len(region) <= size:
            for pixel in region:
                flagged[pixel] |= ps.Flag.SPECKLE
    return flagged


def fill(disparity: Map, flags: Ints) -> tuple[Map, Ints]:
    """Return the map with the smaller of the nearest trusted disparities to the left and right.

    A row without any takes them from the nearest row that has one, the upper of two. Masked pixels
    have none.
    """
    counts = trusted(disparity, flags)
    rows = [int(y) for y in np.flatnonzero(counts.any(axis=1))]
    filled, marked = disparity.copy(), flags.copy()
    filled[flags & ps.Flag.MASKED != 0] = np.nan

    for y, x in np.argwhere(~counts & (flags & ps.Flag.MASKED == 0)):
        if rows:
            source = min(rows, key=lambda row: (abs(row - y), row))
            places = np.flatnonzero(counts[source])
            beside = [*places[places <= x][-1:], *places[places >= x][:1]]
            filled[y, x] = disparity[source, beside].min()
            marked[y, x] |= ps.Flag.FILLED

    return filled, marked


def around(pixel: Pixel, shape: tuple[int, int], reach: int, step: int = 1) -> Iterator[Pixel]:
    """Yield the pixels of the image up to `reach` rows and columns away, every this many-th."""
    for dy in range(-reach, reach + 1, step):
        for dx in range(-reach, reach + 1, step):
            y, x = pixel[0] + dy, pixel[1] + dx
            if 0 <= y < shape[0] and 0 <= x < shape[1]:
                yield y, x


def near_jumps(disparity: Map) -> Bools:
    """Return whether, within four pixels, the next disparity right or below differs by over 1."""
    height, width = disparity.shape
    jumps = np.zeros((height, width), bool)
    jumps[:, :-1] |= np.abs(np.diff(disparity, axis=1)) > 1
    jumps[:-1] |= np.abs(np.diff(disparity, axis=0)) > 1

    near = np.zeros_like(jumps)
    for y, x in np.argwhere(jumps):
        for pixel in around((int(y), int(x)), (height, width), 4):
            near[pixel] = True

    return near


def guide(disparity: Map, gray: Ints) -> Map:
    """Return the map with medians of like pixels near jumps, of two middle ones the smaller.

    Of 9 x 9 pixels every second row and column counts, and of these the pixels whose gray values,
    in 32nds of the mean difference of neighbors, differ by 32 at most. Disparities are counted in
    eighths of a pixel from the pixel's own.
    """
    guided = disparity.copy()
    scale = np.float32(32 / max(oracle.mean_step(gray), 1 / 16))
    level = np.trunc(gray.astype(np.float32) * scale)
    eighths = np.trunc(np.nan_to_num(disparity).astype(np.float32) * np.float32(8))

    for y, x in np.argwhere(near_jumps(disparity) & ~np.isnan(disparity)):
        here = int(y), int(x)
        window = [p for p in around(here, disparity.shape, 4, 2) if not np.isnan(disparity[p])]
        alike = [p for p in window if abs(level[p] - level[here]) <= 32]
        away = sorted(eighths[p] - eighths[here] for p in alike)
        guided[here] += np.float32(away[(len(away) - 1) // 2] / 8)

    return guided


def shifted(values: NDArray[Any], dy: int, dx: int) -> Floats:
    """Return the values at (y + dy, x + dx); NaN beyond the image."""
    reach = max(abs(dy), abs(dx))
    padded = np.pad(values.astype(np.float64), reach, constant_values=np.nan)
    return padded[reach + dy :, reach + dx :][: values.shape[0], : values.shape[1]]


def median(disparity: Map) -> Map:
    """Return the medians of 3 x 3 disparities; the edge is repeated, unknown ones are as the own.

    What is unknown stays so.
    """
    nine = [values for _, _, values in oracle.neighbors(disparity, 1, "edge")]
    known = [np.where(np.isnan(values), disparity, values) for values in nine]
    medians = np.sort(known, axis=0)[4]
    return np.where(np.isnan(disparity), disparity, medians)


def smooth(disparity: Map) -> Map:
    """Return the mean over 7 x 7 of the pixels that lie, as those opposite do, within 1 of it."""
    total, count = np.zeros(disparity.shape), np.ones(disparity.shape)
    for dy, dx in itertools.product(range(-3, 4), repeat=2):
        if (dy, dx) != (0, 0):
            one, other = (
                shifted(disparity, *there).astype(np.float32) - disparity
                for there in ((dy, dx), (-dy, -dx))
            )

            same = (np.abs(one) <= 1) & (np.abs(other) <= 1)
            total += np.where(same, one, 0)
            count += same

    return (disparity + total / count).astype(np.float32)


# --- trust ---


def reliability(evidence: Evidence, unit: float, unrelated: float = np.inf) -> Floats:
    """Return a / (a + 4) of each pixel, a being by how many units its disparity is ahead.

    Where no candidate is elsewhere, it is ahead of a match of `unrelated` pixels.
    """
    elsewhere = np.where(np.isinf(evidence.elsewhere), unrelated, evidence.elsewhere)
    ahead = np.maximum(elsewhere - evidence.own, 0) / unit
    return np.where(np.isinf(ahead), 0, ahead / (np.where(np.isinf(ahead), 0, ahead) + 4))


def confidence(disparity: Map, reliable: Floats, gray: Ints, agree: float = 1.0) -> Floats:
    """Return s^3 / (s^3 + 0.01), s being the share of the support around for a disparity.

    Of 9 x 9 pixels every second row and column counts, for disparities up to `agree` from its own;
    its weight is half where the gray value differs by twice the mean difference of neighbors.
    """
    half = max(2 * oracle.mean_step(gray), 1) ** 2
    weight, support = np.zeros(disparity.shape), np.zeros(disparity.shape)
    for dy, dx in itertools.product(range(-4, 5, 2), repeat=2):
        there = shifted(disparity, dy, dx)
        alike = half / (half + (shifted(gray, dy, dx) - gray) ** 2)
        weight += np.where(np.isnan(there), 0, alike)

        agrees = np.abs(there - disparity) <= agree
        support += np.where(agrees, alike * shifted(reliable, dy, dx), 0)

    known = ~np.isnan(disparity)
    share = (support / np.where(known, weight, 1)) ** 3
    return np.where(known, share / (share + 0.01), 0)


def learned(optimizer: str) -> tuple[Floats, Floats, Floats]:
    """Return the weights of the calibration: of traits (8, 5), points (2, 10), of bars (8,)."""
    file = "rust/match/src/refinement/calibration/weights.rs"
    text = (ROOT / file).read_text()
    several = np.array([float(one) for one in re.findall(r"-?\d+\.\d+", text)]).reshape(3, 68)
    place = {"sgm": 0, "so": 1}.get(optimizer, 2)
    odds, points, bars = np.split(several[place], [40, 60])
    return odds.reshape(8, 5), points.reshape(2, 10), bars


def calibrated(
    raw: NDArray[Any],
    disparity: Map,
    flags: Ints,
    *,
    low: int,
    number: int,
    optimizer: str,
    noise: float = 0.0,
    smoothing: float = 0.0,
    blurred: bool = False,
    whole: NDArray[Any] | None = None,
) -> tuple[Floats, Floats]:
    """Return probabilities and bars from raw confidences and eight traits of the whole map.

    The logarithm of the odds is a line in that of the raw odds, in steps of 1/1024, another one for
    filled pixels; it is lower for others up to 8 columns from a jump. That of the bar is a line
    through ten points above -4 to 5. Maps are sampled whole up to 768 rows. `whole` are other raw
    confidences, to take the mean of.
    """
    assert raw.shape[0] <= 768
    known, filled = ~np.isnan(disparity), flags & ps.Flag.FILLED != 0
    own, high = known & ~filled, low + number - 1
    failed = flags & (ps.Flag.OCCLUDED | ps.Flag.MISMATCHED | ps.Flag.SPECKLE) != 0
    at_low = (disparity < low + 0.5) & (low != 0)
    at_high = (disparity > high - 0.5) & (high != 0)

    odds, points, wider = learned(optimizer)
    mean = np.mean((raw if whole is None else whole)[own]) if own.any() else 0.0
    sure = log_odds(max(mean, 0.4))
    traits = np.array(
        [
            1.0,
            sure,
            max(0.0, 1.5 - sure),
            log_odds(failed.mean()),
            np.log(noise + 0.3),
            np.log(smoothing + 0.1),
            float(blurred),
            np.log((own & (at_low | at_high)).mean() + 0.003),
        ]
    )

    jumps = np.abs(np.diff(disparity, axis=1, append=np.nan)) > 1
    beside = np.any([shifted(jumps, 0, by) == 1 for by in range(-8, 9)], axis=0) & ~filled

    height, slope, outline, filled_height, filled_slope = traits @ odds
    step = log_odds((np.minimum(np.floor(raw * 1024), 1023) + 0.5) / 1024)
    z = height + slope * step + outline * beside + filled * (filled_height + filled_slope * step)
    line = [np.interp(z, np.arange(-4, 6), points[kind]) for kind in (0, 1)]
    bars = np.exp(np.where(filled, line[1], line[0]) + traits @ wider)
    return np.where(known, 1 / (1 + np.exp(-z)), 0), np.where(known, bars, np.nan)


def log_odds(share: Any) -> Any:
    """Return the logarithms of the odds of shares, which are taken to be 0.004 to 0.996."""
    bounded = np.clip(share, 0.004, 0.996)
    return np.log(bounded / (1 - bounded))


def invalidate(
    disparity: Map, flags: Ints, trust: NDArray[Any], *, least: float, filled: bool
) -> tuple[Map, Ints]:
    """Return the map without what is trusted too little, and what is flagged if not filled."""
    low = (trust < least) & ~np.isnan(disparity)
    flags = flags | low * ps.Flag.LOW_CONFIDENCE
    gone = low | ((not filled) & (flags & UNTRUSTED != 0))
    flags = np.where(gone, flags & ~ps.Flag.FILLED, flags)
    return np.where(gone, np.float32(np.nan), disparity), flags


def refine(
    evidence: Evidence,
    gray: Ints,
    *,
    low: int,
    number: int,
    masks: tuple[Bools, Bools],
    settings: ps.Settings,
) -> tuple[Map, Ints]:
    """Return disparities and flags, from candidates to smooth surfaces; none invalidated yet."""
    flags = first_flags(evidence.chosen, low, masks, number)
    if settings.lr_check is not None:
        flags = check(evidence, flags, low, settings.lr_check)
    if settings.uniqueness > 0:
        flags = flag_ambiguous(evidence, flags, settings.uniqueness)

    disparity = (low + evidence.chosen).astype(np.float32)
    if settings.subpixel:
        disparity += evidence.offset

    disparity[flags & MISSING != 0] = np.nan
    if settings.speckle_size > 0:
        step = settings.speckle_range
        flags = flag_speckles(disparity, flags, settings.speckle_size, step)

    checks = settings.lr_check is not None, settings.uniqueness > 0, settings.speckle_size > 0
    if any(checks):
        disparity, flags = fill(disparity, flags)

    if settings.guided_median:
        disparity = guide(disparity, gray)

    if settings.median:
        disparity = median(disparity)

    if settings.subpixel:
        disparity = smooth(disparity)

    return disparity, flags

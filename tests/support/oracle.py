"""What the method computes, written from its formulas alone, to hold the implementation against.

Slow and plain on purpose: float64 where the definition has real numbers, int64 where it counts,
one step of the method per function, nothing shared with the implementation. Equation numbers are
those of Pedone & Heikkila, *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008. The
left image is the reference; left x corresponds to right x - d; candidate n stands for the
disparity ``min_disparity + n``.
"""

# ruff: noqa: N803, N806 -- L, F, M are the paper's names; renamed, formulas are hard to compare

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Taper = Literal["uniform", "gaussian", "hann"]


# --- images ---


def color_channels(image: NDArray[Any]) -> NDArray[Any]:
    """Return the image as (H, W, C) without its alpha channel (the last one of two or four)."""
    channels = image[:, :, np.newaxis] if image.ndim == 2 else image
    return channels[:, :, :-1] if channels.shape[2] in {2, 4} else channels


def to_gray(image: NDArray[Any]) -> Floats:
    """Return 0.299 R + 0.587 G + 0.114 B; a gray image passes, alpha is ignored.

    Of integers, the weights are in 32768ths and the result in sixteenths.
    """
    channels = color_channels(image).astype(np.float64)
    if channels.shape[2] == 1:
        return channels[:, :, 0]
    red, green, blue = channels[:, :, 0], channels[:, :, 1], channels[:, :, 2]
    if np.issubdtype(image.dtype, np.integer):
        return np.floor((9798 * red + 19235 * green + 3735 * blue) / 2048 + 0.5) / 16
    return 0.299 * red + 0.587 * green + 0.114 * blue


def fill_masked(image: NDArray[Any], mask: Bools) -> NDArray[Any]:
    """Return the image with every masked pixel (mask False) replaced by the nearest valid one.

    Nearest within its row, the left one of two; a row without a valid pixel copies the nearest row
    that has one, the upper one of two; an image without a valid pixel becomes zero.
    """
    filled = np.zeros_like(image)
    valid_rows = [int(y) for y in np.flatnonzero(mask.any(axis=1))]

    for y in valid_rows:
        valid = [int(x) for x in np.flatnonzero(mask[y])]
        for x in range(image.shape[1]):
            filled[y, x] = image[y, min(valid, key=lambda c: (abs(c - x), c))]

    for y in range(image.shape[0]):
        if valid_rows:
            filled[y] = filled[min(valid_rows, key=lambda c: (abs(c - y), c))]

    return filled


def convolve(image: Floats, kernel: Floats) -> Floats:
    """Return the sum of kernel(i, j) image(x - i, y - j), i and j from the kernel's center.

    The image continues by reflection.
    """
    rows, cols = kernel.shape[0] // 2, kernel.shape[1] // 2
    total = np.zeros_like(image, dtype=np.float64)
    for dx, dy, values in neighbors(image, max(rows, cols), "symmetric"):
        if abs(dy) <= rows and abs(dx) <= cols:
            total += kernel[rows - dy, cols - dx] * values
    return total


def class_map(labels: NDArray[np.uint8], tile: int, shape: tuple[int, int]) -> Ints:
    """Return the class of each pixel: that of its square tile, or of the last one there is."""
    rows = np.minimum(np.arange(shape[0]) // tile, labels.shape[0] - 1)
    cols = np.minimum(np.arange(shape[1]) // tile, labels.shape[1] - 1)
    classes: Ints = labels[rows][:, cols].astype(np.int64)
    return classes


def neighbors(
    values: NDArray[Any], half: int, mode: Literal["symmetric", "edge"]
) -> Iterator[tuple[int, int, NDArray[Any]]]:
    """Yield dx, dy and the values at (x + dx, y + dy) of every (x, y), over |dx|, |dy| <= half.

    Outside, "symmetric" continues as d c b a | a b c d, "edge" as a a a a | a b c d.
    """
    height, width = values.shape[:2]
    border = [(half, half), (half, half)] + [(0, 0)] * (values.ndim - 2)
    padded = np.pad(values, border, mode=mode)
    for dy in range(-half, half + 1):
        for dx in range(-half, half + 1):
            yield dx, dy, padded[half + dy :, half + dx :][:height, :width]


# --- descriptor ---


def frequencies(r: int, s: int) -> list[tuple[int, int]]:
    """Return the (u, v) of the components, eq. 3: u in [0, r], v in [-s, s], u + sgn(v - 1) >= 0.

    The condition keeps u >= 1 whole and v >= 1 of u = 0: r (2 s + 1) + s components.
    """
    return [(u, v) for u in range(r + 1) for v in range(-s, s + 1) if u + np.sign(v - 1) >= 0]


def taper_weights(L: int, taper: Taper) -> Floats:
    """Return w(j), j = -h..h, with h = (L - 1) / 2."""
    j = np.arange(L) - (L - 1) // 2
    if taper == "gaussian":
        sigma = (L - 1) / 4
        return np.exp(-(j**2) / (2 * sigma**2))
    if taper == "hann":
        return 0.5 * (1 + np.cos(2 * np.pi * j / (L + 1)))
    return np.ones(L)


def filter_1d(index: int, L: int, taper: Taper) -> Complexes:
    """Return w(j) (e^(-2 pi i index j / L) - kappa), j = -h..h; kappa makes it sum to zero.

    kappa = sum(w e) / sum(w), which is zero for the uniform taper. For index 0 the filter is w.
    """
    w = taper_weights(L, taper)
    if index == 0:
        return w.astype(np.complex128)
    j = np.arange(L) - (L - 1) // 2
    e = np.exp(-2j * np.pi * index * j / L)
    filtered: Complexes = w * (e - np.sum(w * e) / np.sum(w))
    return filtered


def spectrum(gray: Floats, L: int, r: int, s: int, taper: Taper = "uniform") -> Complexes:
    """Return F(u, v) of the L x L neighborhood of every pixel, (H, W, D); see eq. 3.

    F(u, v) = sum over (dx, dy) of A(x + dx, y + dy) f_u(dx) f_v(dy), under the uniform taper the
    discrete Fourier transform with its origin at the center pixel. The image continues by
    reflection. What can only be the rounding of a zero becomes zero, so that ties are decided by
    rule and not by the last bit.
    """
    if L % 2 == 0 or max(r, s) > (L - 1) // 2:
        raise ValueError(f"L must be odd and r, s at most (L - 1) / 2, got L={L}, r={r}, s={s}")

    half = (L - 1) // 2
    wanted = frequencies(r, s)
    F = np.zeros((*gray.shape, len(wanted)), dtype=np.complex128)
    along = {index: filter_1d(index, L, taper) for index in range(-s, max(r, s) + 1)}

    for dx, dy, values in neighbors(gray, half, "symmetric"):
        for component, (u, v) in enumerate(wanted):
            F[:, :, component] += values * (along[u][dx + half] * along[v][dy + half])

    rounding = 1e-13 * L * L * np.abs(gray).max()
    F.real[np.abs(F.real) < rounding] = 0
    F.imag[np.abs(F.imag) < rounding] = 0

    return F


def levels(F: Complexes, k: int, b: int) -> Ints:
    """Return floor(M / pi * arg(F^k)), eq. 3, M = 2^(b-1), arg in [-pi, pi): levels -M..M - 1.

    Every boundary belongs to the level it opens, counter-clockwise: for b = 2 the positive real
    axis is 0, the positive imaginary axis 1, the negative real axis -2, the negative imaginary
    axis -1. F = 0 is level 0.
    """
    M = 2 ** (b - 1)
    re, im = F.real, F.imag
    if k == 2:
        re, im = (re - im) * (re + im), 2 * re * im
    angle = np.arctan2(im, re)
    angle = np.where(angle == np.pi, -np.pi, angle)
    return np.where(F == 0, 0, np.floor(angle / (np.pi / M))).astype(np.int64)


def weak_threshold(noise: float, weak: float, L: int, taper: Taper = "uniform") -> float:
    """Return the magnitude up to which a real or imaginary part is weak.

    Of white noise each has the standard deviation noise sqrt(sum(w(dx)^2 w(dy)^2) / 2).
    """
    w = taper_weights(L, taper)
    return weak * noise * float(np.sqrt(np.sum(np.outer(w, w) ** 2) / 2))


def parts(F: Complexes, k: int) -> Floats:
    """Return the real and imaginary parts of F^k, (H, W, D, 2)."""
    powered = F**k
    return np.stack([powered.real, powered.imag], axis=-1)


def weak_levels(F: Complexes, k: int, threshold: float) -> Ints:
    """Return the levels -1, 0 (weak) and 1 of the parts of F^k, (H, W, D, 2).

    A part is weak up to the k-th power of the threshold.
    """
    each = parts(F, k)
    return np.where(np.abs(each) <= threshold**k, 0, np.sign(each)).astype(np.int64)


def boundary_distance(F: Complexes, k: int, b: int) -> Floats:
    """Return the distance, in the complex plane, that F may move before its level can change.

    The boundaries of floor(M arg(F^k) / pi) are the rays at multiples of pi / (M k), M = 2^(b-1);
    the nearest is at most half of that away, never more than a right angle, so its distance is
    |F| sin(angle to it).
    """
    step = np.pi / (2 ** (b - 1) * k)
    past = np.mod(np.angle(F), step)
    distance: Floats = np.abs(F) * np.sin(np.minimum(past, step - past))
    return distance


def circular_distance(levels_a: Ints, levels_b: Ints, b: int) -> Ints:
    """Return the distance around the circle of 2^b levels, summed over the last axis, eq. 4-6."""
    M = 2 ** (b - 1)
    x = np.abs(levels_a - levels_b)
    total: Ints = np.where(x <= M, x, 2 * M - x).sum(axis=-1)
    return total


# --- costs ---


def right_columns(width: int, min_disparity: int, num_disparities: int) -> Ints:
    """Return the right column x - d, clamped to the image, of each left column and d, (W, N)."""
    d = min_disparity + np.arange(num_disparities)
    columns: Ints = np.clip(np.arange(width)[:, np.newaxis] - d, 0, width - 1)
    return columns


def phase_costs(
    levels_left: Ints, levels_right: Ints, min_disparity: int, num_disparities: int, b: int
) -> Ints:
    """Return the circular distance of left x and right x - d, (H, W, N)."""
    columns = right_columns(levels_left.shape[1], min_disparity, num_disparities)
    each = [circular_distance(levels_left, levels_right[:, x], b) for x in columns.T]
    return np.stack(each, axis=-1)


def weak_costs(
    levels_left: Ints, levels_right: Ints, min_disparity: int, num_disparities: int
) -> Ints:
    """Return by how much the parts of left x and right x - d differ, in levels, (H, W, N)."""
    columns = right_columns(levels_left.shape[1], min_disparity, num_disparities)
    each = [np.abs(levels_left - levels_right[:, x]).sum(axis=(2, 3)) for x in columns.T]
    return np.stack(each, axis=-1)


def sad_costs(
    left: NDArray[np.uint8], right: NDArray[np.uint8], min_disparity: int, num_disparities: int
) -> Floats:
    """Return |left x - right (x - d)| in gray, (H, W, N)."""
    a, b = to_gray(left), to_gray(right)
    columns = right_columns(a.shape[1], min_disparity, num_disparities)
    return np.stack([np.abs(a - b[:, x]) for x in columns.T], axis=-1)


def normalize(image: NDArray[Any], window: int) -> Floats:
    """Return (I - mean) / sqrt(var + 1) in gray, over the window around each pixel, (H, W, 1).

    Population variance; the image continues by reflection.
    """
    channels = to_gray(image)[:, :, np.newaxis]
    half = (window - 1) // 2
    around = [values for _, _, values in neighbors(channels, half, "symmetric")]
    mean = sum(around) / window**2
    variance = sum((values - mean) ** 2 for values in around) / window**2
    return np.asarray((channels - mean) / np.sqrt(variance + 1), dtype=np.float64)


def nsad_costs(
    left: NDArray[Any],
    right: NDArray[Any],
    window: int,
    min_disparity: int,
    num_disparities: int,
) -> Floats:
    """Return |left x - right (x - d)| of the normalized gray images, (H, W, N)."""
    a, b = normalize(left, window), normalize(right, window)
    columns = right_columns(a.shape[1], min_disparity, num_disparities)
    return np.stack([np.abs(a - b[:, x]).sum(axis=2) for x in columns.T], axis=-1)


# --- aggregation ---


def valid_candidates(
    left_mask: Bools, right_mask: Bools, min_disparity: int, num_disparities: int
) -> Bools:
    """Return whether a (pixel, candidate) has a valid pixel at both ends, (H, W, N)."""
    columns = right_columns(left_mask.shape[1], min_disparity, num_disparities)
    return np.stack([left_mask & right_mask[:, x] for x in columns.T], axis=-1)


def dropped_bits(window: int, ceiling: int, p2: float = 0.0) -> int:
    """Return the least n for which window * (window * ceiling >> n) is at most 170.

    One more where that, and a jump that costs p2 in each pixel of the window, fit a byte only so
    and at least 80 steps are left.
    """

    def largest(n: int) -> int:
        return window * (window * ceiling >> n)

    least = next(n for n in range(64) if largest(n) <= 170)
    fits = [largest(n) + window_penalty(p2, window, n) <= 255 for n in (least, least + 1)]
    return least + (fits == [False, True] and largest(least + 1) >= 80)


def box_sum(values: NDArray[Any], window: int, dropped: int = 0) -> NDArray[Any]:
    """Return the sum over the window x window box around each pixel; the edge is repeated.

    Of the sum of each column of the box this many lowest bits are dropped.
    """
    half = (window - 1) // 2

    columns = [
        np.zeros(values.shape, dtype=np.result_type(values, np.int64)) for _ in range(window)
    ]

    for dx, _, shifted in neighbors(values, half, "edge"):
        columns[half + dx] += shifted

    kept = [column >> dropped if dropped else column for column in columns]
    return np.sum(kept, axis=0, dtype=kept[0].dtype)


def full_box_sum(costs: Ints, window: int, valid: Bools, ceiling: int, dropped: int = 0) -> Ints:
    """Return the box sum of the valid costs scaled to the full window, rounded half up.

    Where none is valid, every pixel of the window is taken to cost the ceiling. No sum is scaled
    beyond that: a column with few valid costs may lose less to dropped bits than a full one.
    """
    most = window * (window * ceiling >> dropped)
    count = box_sum(valid.astype(np.int64), window)
    total = box_sum(np.where(valid, costs, 0), window, dropped)
    scaled = (total * window * window + count // 2) // np.maximum(count, 1)
    return np.where(count == 0, most, np.minimum(scaled, most))


def aggregate(
    costs: NDArray[Any],
    window: int,
    *,
    shiftable: bool,
    valid: Bools | None = None,
    ceiling: int | None = None,
    dropped: int = 0,
) -> NDArray[Any]:
    """Return the least of the five box sums which the pixel anchors (section 2.3), (H, W, N).

    Centered at (0, 0), (+-h, 0), (0, +-h), h = (window - 1) / 2, each center clamped to the image.
    Not shiftable: the one at (0, 0) alone. With `valid`, and integer costs with their ceiling (the
    largest of one pixel), the sums are those of `full_box_sum`. Dropped are the lowest bits of
    the sums of columns.
    """
    if valid is None:
        sums = box_sum(costs, window, dropped)
    elif ceiling is None:
        raise ValueError("ceiling must be given with valid, got None")
    else:
        sums = full_box_sum(costs, window, valid, ceiling, dropped)

    if not shiftable:
        return sums

    height, width = costs.shape[:2]
    h = (window - 1) // 2

    five: list[NDArray[Any]] = []

    for dx, dy in [(0, 0), (-h, 0), (h, 0), (0, -h), (0, h)]:
        rows = np.clip(np.arange(height) + dy, 0, height - 1)
        columns = np.clip(np.arange(width) + dx, 0, width - 1)
        five.append(sums[rows][:, columns])

    least: NDArray[Any] = np.min(five, axis=0)
    return least


# --- optimization ---


def winner_takes_all(aggregated: NDArray[Any]) -> Ints:
    """Return the smallest candidate of minimal cost of each pixel, (H, W)."""
    best: Ints = np.argmin(aggregated, axis=2)
    return best


def scanline(aggregated: NDArray[Any], penalty_rise: int, penalty_drop: int) -> Ints:
    """Return the candidates of the cheapest path along each row with d(x + 1) <= d(x) + 1, (H, W).

    cost(x, d) = aggregated(x, d) + the least of

    - stay: cost(x - 1, d),
    - rise: cost(x - 1, d - 1) + penalty_rise,
    - drop: cost(x - 1, d') + penalty_drop, for every d' > d.

    Equal costs go to stay, then to the smaller predecessor, and at the end of the row to the
    smallest d.
    """
    aggregated = aggregated.astype(np.result_type(aggregated, np.int64))
    height, width, number = aggregated.shape
    came_from = np.zeros((height, width, number), dtype=np.int64)
    cost = aggregated[:, 0].copy()

    for x in range(1, width):
        before = cost
        cost = aggregated[:, x].copy()

        for d in range(number):
            # In the order of preference: argmin takes the first of equals.
            sources = [d] + [d - 1] * (d > 0) + list(range(d + 1, number))
            penalties = [0] + [penalty_rise] * (d > 0) + [penalty_drop] * (number - 1 - d)
            offers = before[:, sources] + penalties
            cost[:, d] += offers.min(axis=1)
            came_from[:, x, d] = np.array(sources)[offers.argmin(axis=1)]

    return followed(cost, came_from)


def followed(cost: Ints, came_from: Ints) -> Ints:
    """Return the path back from the smallest cheapest end of each row, (H, W)."""
    height, width, _ = came_from.shape
    path = np.zeros((height, width), dtype=np.int64)
    path[:, -1] = np.argmin(cost, axis=1)
    for x in range(width - 1, 0, -1):
        path[:, x - 1] = came_from[np.arange(height), x, path[:, x]]
    return path


# --- paths ---

BAND, PANEL = 64, 64
"""Rows of a band and columns of a panel."""

LOOK_ROWS, LOOK_COLUMNS = 16, 16
"""Rows outside a band from where paths come up and down, columns right of a panel likewise."""


def mean_step(gray: NDArray[Any]) -> float:
    """Return the mean difference of horizontal neighbors; 0 where there are none."""
    steps = np.abs(np.diff(gray, axis=1))
    return float(steps.mean()) if steps.size else 0.0


def jump_penalties(gray: Ints, p1: int, p2: int, edges: float, ahead: tuple[int, int]) -> Ints:
    """Return the cost of a jump of a path to each pixel from the one (dx, dy) ahead, (H, W).

    Where the gray value differs by more than `adaptive_p2` times the mean difference of neighbors,
    in whole steps of gray, it is half of p2, by more than thrice that a third; p1 at the least.
    """
    dx, dy = ahead
    step = int(edges * mean_step(gray))
    there = next(v for x, y, v in neighbors(gray, 1, "edge") if (x, y) == (dx, dy))
    jump = np.abs(gray - there)
    parts = np.select([(edges == 0) | (jump <= step), jump <= 3 * step], [1, 2], 3)
    penalties: Ints = np.maximum(p2 // parts, p1)
    return penalties


def path_totals(costs: Ints, p2: Ints, p1: int) -> Ints:
    """Return the totals of paths that go down the columns, from the first row on, (H, W, N).

    total(p, d) = cost(p, d) + the least of m(d), m(d - 1) + p1, m(d + 1) + p1 and p2(p), m
    being the totals of the pixel before, less the least of these.
    """
    totals = costs.astype(np.int64)
    unreachable = np.iinfo(np.int64).max // 2

    for y in range(1, len(costs)):
        m = totals[y - 1] - totals[y - 1].min(axis=1, keepdims=True)
        beside = np.pad(m, [(0, 0), (1, 1)], constant_values=unreachable) + p1
        jump = np.broadcast_to(p2[y][:, np.newaxis], m.shape)
        totals[y] += np.min([m, beside[:, :-2], beside[:, 2:], jump], axis=0)

    return totals


def mean(a: Ints, b: Ints) -> Ints:
    """Return half the sum, rounded up."""
    halves: Ints = (a + b + 1) // 2
    return halves


def both_directions(costs: Ints, p2: tuple[Ints, Ints], p1: int) -> Ints:
    """Return the mean of the totals of paths down and up the columns, each with its own p2."""
    down = path_totals(costs, p2[0], p1)
    return mean(down, path_totals(costs[::-1], p2[1][::-1], p1)[::-1])


def row_means(
    aggregated: Ints, p1: int, p2: int, gray: Ints | None = None, edges: float = 0.0
) -> Ints:
    """Return the means of the totals of two paths along the rows, (H, W, N).

    Those from the right begin `LOOK_COLUMNS` columns right of each panel.
    """
    gray = np.zeros(aggregated.shape[:2], np.int64) if gray is None else gray
    columns = np.swapaxes(aggregated, 0, 1)
    left, right = (jump_penalties(gray, p1, p2, edges, (dx, 0)).T for dx in (-1, 1))

    totals = path_totals(columns, left, p1)
    means = np.empty_like(totals)

    for first in range(0, len(columns), PANEL):
        panel, seen = slice(first, first + PANEL), slice(first, first + PANEL + LOOK_COLUMNS)
        back = path_totals(columns[seen][::-1], right[seen][::-1], p1)[::-1]
        means[panel] = mean(totals[panel], back[:PANEL])

    return np.swapaxes(means, 0, 1)


def column_means(
    aggregated: Ints, p1: int, p2: int, gray: Ints | None = None, edges: float = 0.0
) -> Ints:
    """Return the means of the totals of two paths down and up the columns, (H, W, N).

    They begin `LOOK_ROWS` rows outside each band.
    """
    gray = np.zeros(aggregated.shape[:2], np.int64) if gray is None else gray

    above, below = (jump_penalties(gray, p1, p2, edges, (0, dy)) for dy in (-1, 1))

    means = np.empty(aggregated.shape, np.int64)

    for first in range(0, len(aggregated), BAND):
        top = max(first - LOOK_ROWS, 0)
        seen = slice(top, first + BAND + LOOK_ROWS)
        found = both_directions(aggregated[seen], (above[seen], below[seen]), p1)
        means[first : first + BAND] = found[first - top :][:BAND]

    return means


def path_means(
    aggregated: Ints, p1: int, p2: int, gray: Ints | None = None, edges: float = 0.0
) -> Ints:
    """Return the means of the totals of four paths: of the means along rows and columns."""
    along = row_means(aggregated, p1, p2, gray, edges)
    return mean(along, column_means(aggregated, p1, p2, gray, edges))


def free_scanline(aggregated: Ints, p1: int, p2: int) -> Ints:
    """Return the candidates of the least mean of two paths along the row, (H, W)."""
    return winner_takes_all(row_means(aggregated, p1, p2))


# --- the whole method ---


def window_penalty(penalty: float, window: int, dropped: int = 0) -> int:
    """Return the penalty in bits per pixel as one on box sums, the nearest integer, halves up."""
    return int(np.floor(penalty * window * window / 2**dropped + 0.5))


def match_phase(
    left: NDArray[Any],
    right: NDArray[Any],
    *,
    min_disparity: int,
    num_disparities: int,
    L: int,
    window: int,
    r: int,
    s: int,
    k: int,
    b: int,
    p1: float,
    p2: float,
    shiftable: bool = True,
    optimizer: Literal["dp", "wta"] = "dp",
    taper: Taper = "uniform",
) -> Ints:
    """Return the left image's disparities, (H, W): codes, costs, shiftable windows, one-pass DP."""
    codes_left = levels(spectrum(to_gray(left), L, r, s, taper), k, b)
    codes_right = levels(spectrum(to_gray(right), L, r, s, taper), k, b)

    costs = phase_costs(codes_left, codes_right, min_disparity, num_disparities, b)
    aggregated = aggregate(costs, window, shiftable=shiftable)

    if optimizer == "wta":
        return min_disparity + winner_takes_all(aggregated)

    rise, drop = (window_penalty(penalty, window) for penalty in (p1, p2))
    return min_disparity + scanline(aggregated, rise, drop)


# --- what is done to images before they are described ---


def beyond_neighbors(gray: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the height of each pixel beyond its eight neighbors, their spread, and their median.

    The largest and the smallest neighbor are left out; the image continues as c b | a b c | b a.
    """
    padded = np.pad(gray, 1, mode="reflect")
    height, width = gray.shape
    places = [(dy, dx) for dy in range(3) for dx in range(3) if (dy, dx) != (1, 1)]
    n = np.sort([padded[dy : dy + height, dx : dx + width] for dy, dx in places], axis=0)
    return np.maximum(gray - n[6], n[1] - gray), n[6] - n[1], (n[3] + n[4]) / 2


def without_impulses(gray: Floats, height: float) -> Floats:
    """Return gray values in which those give way to a median that lie far beyond neighbors."""
    beyond, spread, median = beyond_neighbors(gray)
    repaired: Floats = np.where(beyond > spread + height, median, gray)
    return repaired


def has_impulses(gray: Floats, level: float) -> bool:
    """Tell whether more pixels than those of clean images lie beyond doubt beyond neighbors."""
    beyond, spread, _ = beyond_neighbors(gray)
    return bool(np.mean(beyond > 3 * spread + 40 * level) > 4e-5)


def block_jump(gray: Floats, level: float) -> float:
    """Return by how much the borders of blocks of 8 pixels stand out, along both axes at least."""

    def along(a: Floats) -> float:
        steps = np.abs(np.diff(a, axis=1))
        extra = np.clip(steps[:, 1:-1] - (steps[:, :-2] + steps[:, 2:]) / 2, -4 * level, 4 * level)
        means = sorted(extra[:, phase::8].mean() for phase in range(8))
        return float(means[-1] - means[-2])

    return min(along(gray), along(gray.T))


def guided_filter(gray: Floats, deviation: float) -> Floats:
    """Return the image filtered by itself over 5 x 5 pixels (He, Sun & Tang, eq. 5, 6 and 8)."""

    def mean(values: Floats) -> Floats:
        each = np.stack([each for _, _, each in neighbors(values, 2, "symmetric")])
        means: Floats = each.mean(axis=0)
        return means

    variance = mean(gray**2) - mean(gray) ** 2
    a = variance / (variance + deviation**2)
    b = (1 - a) * mean(gray)
    filtered: Floats = mean(a) * gray + mean(b)
    return filtered

"""The oracle against values worked out by hand, and against the most literal reading there is."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import oracle

THIRD = np.exp(-2j * np.pi / 3)  # one step of a transform of length 3: -1/2 - i sqrt(3)/2


def one_row(*rows: list[int]) -> NDArray[np.int64]:
    """Return costs (1, W, N) from one list of N costs per column."""
    return np.array([rows])


# --- images ---


def test_gray_weighs_the_colors_and_is_not_rounded() -> None:
    rgb = np.array([[[10, 20, 30]]], dtype=np.uint8)
    assert oracle.to_gray(rgb)[0, 0] == pytest.approx(2.99 + 11.74 + 3.42)
    rgba = np.array([[[10, 20, 30, 77]]], dtype=np.uint8)
    assert oracle.to_gray(rgba)[0, 0] == pytest.approx(18.15)


def test_masked_pixels_take_the_nearest_valid_of_their_row_then_the_nearest_row() -> None:
    image = np.array([[9, 9, 9, 9], [1, 2, 3, 4], [9, 9, 9, 9], [9, 9, 9, 9], [5, 6, 7, 8]])
    mask = np.zeros((5, 4), dtype=bool)
    mask[1, [0, 2]] = True
    mask[4, 3] = True
    expected = [[1, 1, 3, 3], [1, 1, 3, 3], [1, 1, 3, 3], [8, 8, 8, 8], [8, 8, 8, 8]]
    assert oracle.fill_masked(image, mask).tolist() == expected


def test_a_masked_row_between_two_valid_ones_takes_the_upper() -> None:
    mask = np.array([[True], [False], [True]])
    assert oracle.fill_masked(np.array([[1], [9], [2]]), mask).tolist() == [[1], [1], [2]]


def test_an_image_without_a_valid_pixel_fills_with_zero_and_color_is_filled_whole() -> None:
    color = np.arange(6).reshape(1, 2, 3) + 1
    assert not oracle.fill_masked(color, np.zeros((1, 2), dtype=bool)).any()
    filled = oracle.fill_masked(color, np.array([[False, True]]))
    assert filled.tolist() == [[[4, 5, 6], [4, 5, 6]]]


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_neighbors_reflect_as_often_as_needed(width: int) -> None:
    """``d c b a | a b c d`` has the period 2 W and is its own mirror image."""
    row = np.arange(width)[np.newaxis]
    for dx, _, values in oracle.neighbors(row, 6, "symmetric"):
        for x in range(width):
            position = (x + dx) % (2 * width)
            assert values[0, x] == min(position, 2 * width - 1 - position)


def test_neighbors_repeat_the_edge() -> None:
    column = np.array([[5], [6], [7]])
    found = {dy: values[:, 0].tolist() for _, dy, values in oracle.neighbors(column, 2, "edge")}
    assert found == {-2: [5, 5, 5], -1: [5, 5, 6], 0: [5, 6, 7], 1: [6, 7, 7], 2: [7, 7, 7]}


# --- descriptor ---


def test_components_come_in_the_order_of_the_paper() -> None:
    expected = [(0, 1), (1, -1), (1, 0), (1, 1), (2, -1), (2, 0), (2, 1)]
    assert (oracle.frequencies(2, 1), oracle.frequencies(0, 2)) == (expected, [(0, 1), (0, 2)])
    assert (oracle.frequencies(1, 0), len(oracle.frequencies(4, 2))) == ([(1, 0)], 4 * 5 + 2)


@pytest.mark.parametrize(("length", "r", "s"), [(3, 1, 1), (5, 2, 1), (7, 3, 2), (9, 1, 4)])
def test_spectrum_is_the_fourier_transform_with_the_center_as_origin(
    length: int, r: int, s: int
) -> None:
    gray = np.random.default_rng(0).uniform(0, 255, (4, 3))

    spectra = oracle.spectrum(gray, length, r, s)

    half = length // 2
    padded = np.pad(gray, half, mode="symmetric")

    for y, x in np.ndindex(gray.shape):
        block = padded[y : y + length, x : x + length]
        transform = np.fft.fft2(np.fft.ifftshift(block))
        expected = [transform[v, u] for u, v in oracle.frequencies(r, s)]
        np.testing.assert_allclose(spectra[y, x], expected, atol=1e-9)


def test_hann_filters_by_hand() -> None:
    """For L = 3: w = 1/2, 1, 1/2, sum(w e) = 1 - 1/2 = 1/2, sum(w) = 2, so kappa = 1/4."""
    np.testing.assert_allclose(oracle.filter_1d(0, 3, "hann"), [0.5, 1, 0.5])
    side = 0.5 * (THIRD - 0.25)
    np.testing.assert_allclose(oracle.filter_1d(1, 3, "hann"), [side.conjugate(), 0.75, side])


def test_gaussian_filters_by_hand() -> None:
    """For L = 5: sigma = 1, w = e^-2, e^-1/2, 1, e^-1/2, e^-2."""
    w1, w2 = np.exp(-0.5), np.exp(-2)
    np.testing.assert_allclose(oracle.filter_1d(0, 5, "gaussian"), [w2, w1, 1, w1, w2])

    c1, c2 = np.cos(2 * np.pi / 5), np.cos(4 * np.pi / 5)
    kappa = (1 + 2 * w1 * c1 + 2 * w2 * c2) / (1 + 2 * w1 + 2 * w2)
    assert oracle.filter_1d(1, 5, "gaussian")[2] == pytest.approx(1 - kappa)
    assert oracle.filter_1d(-1, 5, "gaussian")[3] == pytest.approx(
        w1 * (np.exp(2j * np.pi / 5) - kappa)
    )


def test_an_image_constant_along_x_has_exactly_no_horizontal_frequency() -> None:
    gray = np.repeat(np.random.default_rng(1).uniform(0, 255, (9, 1)), 8, axis=1)
    spectra = oracle.spectrum(gray, 7, 2, 1)
    horizontal = [u > 0 for u, _ in oracle.frequencies(2, 1)]
    assert not spectra[:, :, horizontal].any()
    assert spectra[:, :, 0].all()


def test_levels_of_two_bits_are_quadrants_with_the_stated_ties() -> None:
    inside = np.array([3 + 1j, -1 + 3j, -3 - 1j, 1 - 3j])
    ties = np.array([1, 1j, -1, -1j, 0, complex(-0.0, 0.0), complex(-1, -0.0), complex(1, -0.0)])
    assert oracle.levels(inside, 1, 2).tolist() == [0, 1, -2, -1]
    assert oracle.levels(ties, 1, 2).tolist() == [0, 1, -2, -1, 0, 0, -2, 0]


def test_levels_of_other_bits() -> None:
    spectra = np.exp(1j * np.deg2rad([10, 50, 100, 170, -170, -100, -50, -10]))
    assert oracle.levels(spectra, 1, 1).tolist() == [0, 0, 0, 0, -1, -1, -1, -1]
    assert oracle.levels(spectra, 1, 3).tolist() == [0, 1, 2, 3, -4, -3, -2, -1]
    assert oracle.levels(spectra, 1, 4).tolist() == [0, 2, 4, 7, -8, -5, -3, -1]
    diagonals = np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
    assert oracle.levels(diagonals, 1, 3).tolist() == [1, 3, -3, -1]


def test_levels_of_doubled_phase() -> None:
    """Phases 20, 70, 110, 160 double to 40, 140, -140, -40; F and -F have the same level."""
    spectra = np.exp(1j * np.deg2rad([20, 70, 110, 160]))
    assert oracle.levels(spectra, 2, 2).tolist() == [0, 1, -2, -1]
    assert oracle.levels(-spectra, 2, 2).tolist() == [0, 1, -2, -1]
    ties = np.array([1, 3 + 3j, 1j, -3 + 3j, -1, -3 - 3j, -1j, 3 - 3j, 0])
    assert oracle.levels(ties, 2, 2).tolist() == [0, 1, -2, -1, 0, 1, -2, -1, 0]


def test_weak_thresholds_by_hand() -> None:
    """Uniform: L / sqrt(2); of L = 3 the Hann window's squares sum to (1/4 + 1 + 1/4)^2."""
    assert oracle.weak_threshold(2, 0.5, 9) == pytest.approx(9 / np.sqrt(2))
    assert oracle.weak_threshold(2, 3, 3, "hann") == pytest.approx(6 * 1.5 / np.sqrt(2))


@pytest.mark.parametrize(("k", "u"), [(1, 1), (1, 2)])
def test_weak_thresholds_are_deviations_of_parts_of_noise(k: int, u: int) -> None:
    noise = np.random.default_rng(5).normal(0, 3, (300, 300))
    each = oracle.parts(oracle.spectrum(noise, 5, u, 1), k)
    assert each.std() == pytest.approx(oracle.weak_threshold(3, 1, 5), rel=0.02)


def test_convolution_flips_the_kernel_and_reflects_the_image() -> None:
    image = np.array([[1.0, 10.0, 100.0]])
    assert oracle.convolve(image, np.array([[0, 0, 1]])).tolist() == [[1, 1, 10]]
    assert oracle.convolve(image, np.array([[1, 0, 0]])).tolist() == [[10, 100, 100]]
    tall = np.array([[0], [0], [0], [0], [1]])
    assert oracle.convolve(image.T, tall).tolist() == [[10], [1], [1]]


@given(
    st.complex_numbers(min_magnitude=0.1, max_magnitude=10),
    st.floats(0, 2 * np.pi),
    st.sampled_from([1, 2]),
    st.sampled_from([1, 2, 3, 4]),
)
def test_the_level_holds_within_the_boundary_distance(
    center: complex, direction: float, k: int, b: int
) -> None:
    spectra = np.array([center])
    moved = spectra + 0.999 * oracle.boundary_distance(spectra, k, b) * np.exp(1j * direction)
    if oracle.boundary_distance(spectra, k, b)[0] > 1e-9:
        assert oracle.levels(moved, k, b) == oracle.levels(spectra, k, b)


def test_circular_distance_goes_the_short_way_round() -> None:
    a = np.array([-4, -4, -4, 0])
    b = np.array([3, 0, -1, -3])
    each = [int(oracle.circular_distance(a[[i]], b[[i]], 3)) for i in range(4)]
    assert each == [1, 4, 3, 3]
    assert oracle.circular_distance(a, b, 3) == 11


# --- costs ---


def test_sad_costs_by_hand() -> None:
    left = np.array([[[10, 20, 30], [0, 0, 255]]], dtype=np.uint8)
    right = np.array([[[12, 20, 27], [255, 0, 0]]], dtype=np.uint8)
    expected = [[[5, 5], [510, 12 + 20 + 228]]]
    assert oracle.sad_costs(left, right, 0, 2).tolist() == expected
    gray = oracle.sad_costs(left[:, :, 0], right[:, :, 0], 0, 2)
    assert gray.tolist() == [[[2, 2], [255, 12]]]


def test_nsad_costs_by_hand() -> None:
    """[0, 3, 6] has the neighborhoods (0, 0, 3), (0, 3, 6), (3, 6, 6): variances 2, 6, 2."""
    left = np.array([[0, 3, 6]], dtype=np.uint8)
    flat = np.full((1, 3), 9, dtype=np.uint8)
    n = 1 / np.sqrt(3)

    np.testing.assert_allclose(oracle.normalize(left, 3)[0, :, 0], [-n, 0, n], atol=1e-15)
    np.testing.assert_allclose(
        oracle.nsad_costs(left, flat, 3, 0, 2), [[[n, n], [0, 0], [n, n]]], atol=1e-15
    )
    np.testing.assert_allclose(
        oracle.nsad_costs(left, left, 3, 0, 2), [[[0, 0], [0, n], [0, n]]], atol=1e-15
    )


# --- aggregation ---

NINE = np.arange(1, 10).reshape(3, 3, 1)
NINE_SUMS = np.array([[21, 27, 33], [39, 45, 51], [57, 63, 69]])


def test_box_sum_repeats_the_edge() -> None:
    """At the corner: (1 + 1 + 2) twice and 4 + 4 + 5."""
    assert oracle.box_sum(NINE, 3)[:, :, 0].tolist() == NINE_SUMS.tolist()
    assert oracle.box_sum(np.full((2, 2, 1), 255, dtype=np.uint8), 3)[0, 0, 0] == 9 * 255


def test_shiftable_windows_take_the_least_of_five() -> None:
    still = oracle.aggregate(NINE, 3, shiftable=False)
    assert still[:, :, 0].tolist() == NINE_SUMS.tolist()
    shifted = oracle.aggregate(NINE, 3, shiftable=True)
    assert shifted[:, :, 0].tolist() == [[21, 21, 27], [21, 27, 33], [39, 45, 51]]
    turned = oracle.aggregate(NINE[::-1, ::-1], 3, shiftable=True)
    assert turned[::-1, ::-1].tolist() == shifted.tolist()


def test_window_centers_are_clamped_into_the_image() -> None:
    """The sums are 100, 150, 200, 250; a center left of the image would have found 0."""
    costs = one_row([0], [10], [10], [10])
    assert oracle.aggregate(costs, 5, shiftable=True)[0, :, 0].tolist() == [100, 100, 100, 150]


def test_votes_need_a_valid_pixel_at_both_ends() -> None:
    left = np.array([[True, True, False]])
    right = np.array([[False, True, True]])
    expected = [[[False, False], [True, False], [False, False]]]
    assert oracle.valid_candidates(left, right, 0, 2).tolist() == expected
    assert oracle.valid_candidates(left, right, -1, 2).tolist() == [
        [[True, False], [True, True], [False, False]]
    ]


def test_scaled_votes_round_half_up_and_none_cost_the_ceiling() -> None:
    """Two valid costs of 1 and 2 around the middle: 3 * 9 / 2 = 13.5; column 4 has none."""
    costs = one_row([7], [1], [2], [7], [7], [7])
    valid = one_row([0], [1], [1], [0], [0], [0]) > 0
    still = oracle.aggregate(costs, 3, shiftable=False, valid=valid, ceiling=14)[0, :, 0]
    assert still.tolist() == [9, 14, 14, 18, 126, 126]
    shifted = oracle.aggregate(costs, 3, shiftable=True, valid=valid, ceiling=14)[0, :, 0]
    assert shifted.tolist() == [9, 9, 14, 14, 18, 126]


def test_a_byte_holds_what_is_left_of_a_window() -> None:
    """9 * (72 >> 2) = 162, 9 * (72 >> 1) = 324; 3 * (84 >> 1) = 126; 63 * (2520 >> 10) = 126."""
    cases = [(9, 8), (3, 28), (63, 40), (1, 1)]
    assert [oracle.dropped_bits(*case) for case in cases] == [2, 1, 10, 0]


def test_a_byte_holds_the_cost_of_a_jump_if_one_bit_is_enough() -> None:
    """162 + 93 = 255; 162 + 94 exceed it, 81 + 47 do not; 81 + 174 = 255 and 81 + 175."""
    cases = [(4.59, 2), (4.64, 3), (17.18, 3), (17.3, 2)]
    assert [oracle.dropped_bits(9, 8, p2) for p2, _ in cases] == [bits for _, bits in cases]


def test_bits_are_dropped_from_the_sum_of_each_column() -> None:
    """Columns of the middle: 12, 15, 18, without their lowest bit 6, 7, 9."""
    assert oracle.box_sum(NINE, 3, 1)[1, 1, 0] == 22
    assert oracle.aggregate(NINE, 3, shiftable=False, dropped=2)[1, 1, 0] == 3 + 3 + 4

    valid = NINE != 5  # 12, 10, 18 without a bit make 20, of which 9 / 8 are 22.5
    voted = oracle.aggregate(NINE, 3, shiftable=False, valid=valid, ceiling=9, dropped=1)
    assert voted[1, 1, 0] == 23

    nobody = oracle.aggregate(NINE, 3, shiftable=False, valid=NINE < 0, ceiling=9, dropped=1)
    assert (nobody == 3 * 13).all()

    # Two valid costs of 9 in each column: 18, or 9 without a bit; 27 * 9 / 6 = 40.5 exceeds 39.
    without_a_row = np.array([[[1]], [[1]], [[0]]] * 3) * np.ones((9, 9, 1), int) > 0
    highest = np.full((9, 9, 1), 9)
    full = oracle.aggregate(highest, 3, shiftable=False, valid=without_a_row, ceiling=9, dropped=1)
    assert full[4, 4, 0] == 39


# --- optimization ---


@pytest.mark.parametrize(
    ("costs", "rise", "drop", "expected"),
    [
        pytest.param([[5, 5, 0], [0, 5, 5]], 1, 2, [2, 0], id="any drop at one price"),
        pytest.param([[0, 9, 9], [9, 0, 9], [9, 9, 0]], 1, 9, [0, 1, 2], id="rise step by step"),
        pytest.param([[1, 9, 9], [9, 9, 0]], 0, 0, [2, 2], id="no rise by two"),
        pytest.param([[0, 9, 9], [9, 9, 0]], 1, 1, [0, 0], id="smallest at the end"),
        pytest.param([[0, 1], [9, 0]], 1, 1, [1, 1], id="stay before rise"),
        pytest.param([[1, 0], [0, 9]], 1, 1, [0, 0], id="stay before drop"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 2, 2, [0, 1], id="rise before drop"),
        pytest.param([[9, 0, 0], [0, 9, 9]], 1, 1, [1, 0], id="the nearer of two drops"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 3, 1, [2, 1], id="a dear rise"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 1, 3, [0, 1], id="a dear drop"),
        pytest.param([[4, 2, 3]], 1, 1, [1], id="one column"),
        pytest.param([[4], [2]], 1, 1, [0, 0], id="one candidate"),
    ],
)
def test_scanline_by_hand(
    costs: list[list[int]], rise: int, drop: int, expected: list[int]
) -> None:
    assert oracle.scanline(one_row(*costs), rise, drop).tolist() == [expected]


def path_cost(costs: NDArray[Any], path: tuple[int, ...], rise: int, drop: int) -> float:
    total = float(sum(costs[x, d] for x, d in enumerate(path)))
    for before, after in itertools.pairwise(path):
        if after > before + 1:
            return np.inf
        total += 0 if after == before else rise if after > before else drop
    return total


@given(st.integers(1, 4), st.integers(1, 4), st.data())
def test_scanline_finds_the_cheapest_of_all_paths(width: int, number: int, data: Any) -> None:
    cells = st.lists(st.integers(0, 6), min_size=width * number, max_size=width * number)
    costs = np.array([data.draw(cells), data.draw(cells)]).reshape(2, width, number)

    rise, drop = data.draw(st.integers(0, 5)), data.draw(st.integers(0, 5))

    found = oracle.scanline(costs, rise, drop)

    for row, path in zip(costs, found, strict=True):
        every = itertools.product(range(number), repeat=width)
        least = min(path_cost(row, candidate, rise, drop) for candidate in every)
        assert path_cost(row, tuple(path), rise, drop) == least


# --- paths ---


def test_penalties_are_lower_where_gray_values_jump() -> None:
    """Of 0, 2, 12, 18 the mean step is 6: 10 is more, 18 is not more than thrice that."""
    gray = np.array([[0, 2, 12, 18], [19, 0, 12, 18]])

    assert oracle.mean_step(gray[:1]) == 6
    left = oracle.jump_penalties(gray[:1], 1, 13, 1.0, (-1, 0))
    assert left.tolist() == [[13, 13, 6, 13]]
    assert oracle.jump_penalties(gray[:1], 1, 13, 1.0, (1, 0)).tolist() == [[13, 6, 13, 13]]
    assert oracle.jump_penalties(gray[:1], 5, 13, 0.5, (-1, 0)).tolist() == [[13, 13, 5, 6]]
    assert oracle.jump_penalties(gray[:1], 1, 13, 0.0, (-1, 0)).tolist() == [[13] * 4]

    steep = np.array([[0, 0, 0, 0], [40, 0, 10, 0]])  # steps 0 0 0 40 10 10: mean 10
    assert oracle.jump_penalties(steep, 1, 13, 1.0, (0, -1))[1].tolist() == [4, 13, 13, 13]
    assert oracle.jump_penalties(steep, 1, 13, 1.0, (0, 1))[0].tolist() == [4, 13, 13, 13]


def free_path_cost(costs: NDArray[Any], path: tuple[int, ...], p1: int, p2: int) -> int:
    changes = [abs(after - before) for before, after in itertools.pairwise(path)]
    return int(
        sum(costs[x, d] for x, d in enumerate(path))
        + sum(0 if apart == 0 else p1 if apart == 1 else p2 for apart in changes)
    )


@given(st.integers(1, 4), st.integers(1, 4), st.data())
def test_totals_are_those_of_the_cheapest_of_all_paths(width: int, number: int, data: Any) -> None:
    """But for the least total of each pixel before, which is the same for all candidates."""
    cells = st.lists(st.integers(0, 6), min_size=width * number, max_size=width * number)
    costs = np.array(data.draw(cells)).reshape(width, 1, number)

    p1 = data.draw(st.integers(0, 5))
    p2 = p1 + data.draw(st.integers(0, 5))

    totals = oracle.path_totals(costs, np.full((width, 1), p2), p1)[-1, 0]

    least = [
        min(
            free_path_cost(costs[:, 0], (*before, last), p1, p2)
            for before in itertools.product(range(number), repeat=width - 1)
        )
        for last in range(number)
    ]

    assert (totals - totals.min()).tolist() == (np.array(least) - min(least)).tolist()


def test_two_paths_have_the_mean_of_their_totals_rounded_up() -> None:
    """From the left 0 5 | 5 2, from the right 0 7 | 5 0; both at d = 1 of the first: 12 / 2."""
    costs = one_row([0, 5], [5, 0])
    means = oracle.row_means(costs, 2, 2)
    assert means.tolist() == [[[1, 5], [5, 1]]]
    assert oracle.column_means(np.swapaxes(costs, 0, 1), 2, 2).tolist() == [[[1, 5]], [[5, 1]]]
    assert oracle.free_scanline(costs, 2, 2).tolist() == [[0, 1]]


def test_four_paths_are_the_mean_of_two_means() -> None:
    costs = np.random.default_rng(0).integers(0, 50, (5, 7, 4))
    along, across = (paths(costs, 3, 9) for paths in (oracle.row_means, oracle.column_means))
    assert (oracle.path_means(costs, 3, 9) == np.ceil((along + across) / 2)).all()


@pytest.mark.parametrize(("away", "seen"), [(15, True), (16, True), (17, False)])
def test_paths_begin_sixteen_rows_outside_a_band(away: int, *, seen: bool) -> None:
    for place, beside in ((63 + away, 63), (64 - away, 64)):
        costs = np.zeros((130, 1, 2), np.int64)
        costs[place] = [[0, 40]]
        means = oracle.column_means(costs, 5, 5)
        assert bool(means[beside].any()) is seen
        assert means[127 - beside, 0, 1] > 0


@pytest.mark.parametrize(("away", "seen"), [(15, True), (16, True), (17, False)])
def test_paths_from_the_right_begin_beyond_a_panel(away: int, *, seen: bool) -> None:
    costs = np.zeros((1, 130, 2), np.int64)
    costs[0, 63 + away] = [0, 40]
    means = oracle.row_means(costs, 5, 5)
    assert bool(means[0, 63].any()) is seen
    assert means[0, 64:128, 1].all(), "from the left they come from anywhere"


# --- the whole method ---


@pytest.mark.parametrize(
    ("penalty", "expected"),
    [
        *[((2, 9), 162), ((0.5, 9), 41), ((0.7, 3), 6), ((0, 5), 0)],
        # 4.5 * 81 / 4 = 91.125 and 1.5 * 9 / 4 = 3.375; 2 * 81 / 8 = 20.25 and 2 * 1 / 4 = 0.5.
        *[((4.5, 9, 2), 91), ((1.5, 3, 2), 3), ((2, 9, 3), 20), ((2, 1, 2), 1)],
    ],
)
def test_penalties_lose_the_bits_that_costs_lose_and_are_rounded_half_up(
    penalty: tuple[Any, ...], expected: int
) -> None:
    assert oracle.window_penalty(*penalty) == expected

//! The reference implementation of every stage: the same signature, written so that it can be checked by
//! reading.
//!
//! Slow on purpose. The tests compare the fast stages with these, bit for bit. Every constant is repeated
//! here, and no function of the core is called except for the logarithm and the exponential, so that a change
//! there is detected here. The basis of the descriptor has its own oracle in the Python tests.

use std::cmp::Reverse;
use std::ops::Range;

use phasestereo_match::base::math::{exp, ln};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::aggregation::Window;
use phasestereo_match::descriptor::basis::{Basis, Component};
use phasestereo_match::image::convolution::{Kernel, KernelWeights};
use phasestereo_match::image::texture::Roughness;
use phasestereo_match::image::view::Mask;
use phasestereo_match::optimization::Penalties;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::calibration::Weights as CalibrationWeights;
use phasestereo_match::refinement::confidence::VotedMap;
use phasestereo_match::refinement::flag;
use phasestereo_match::refinement::left_right_check::Choices;
use phasestereo_match::settings::Settings;

/// Fractional bits of kernel weights, and those that a product of two factors keeps in between.
const WEIGHT_BITS: u32 = 14;
const KEPT_BITS: u32 = 2;
/// Rows of a band and columns of a panel that paths are cut to, and their look-ahead beyond.
const BAND: usize = 64;
const PANEL: usize = 64;
const ROWS_AHEAD: usize = 16;
const COLUMNS_AHEAD: usize = 16;
/// The second-best cost where all candidates are next to the chosen one.
pub const NO_CANDIDATE: u32 = u32::MAX;

/// Continues `0..length` by reflection, the edge repeated.
pub fn reflect(index: isize, length: usize) -> usize {
    let mut index = index;
    loop {
        if index < 0 {
            index = -1 - index;
        } else if index as usize >= length {
            index = 2 * length as isize - 1 - index;
        } else {
            return index as usize;
        }
    }
}

/// Continues `0..length` by one at either end, the edge not repeated.
fn mirrored(index: isize, length: usize) -> usize {
    match index {
        -1 => 1.min(length - 1),
        _ if index as usize == length => length.saturating_sub(2),
        _ => index as usize,
    }
}

/// Reference implementation of [`phasestereo_match::image::masking::fill_masked`]: for every masked pixel the
/// whole row is searched, then, for rows without a valid pixel, all rows.
pub fn fill_masked(plane: &Plane<i32>, mask: &Mask) -> Plane<i32> {
    let (rows, cols) = (plane.rows(), plane.cols());
    let is_seeded = |y: &usize| mask.row(*y).contains(&true);

    Plane::from_fn(rows, cols, |y, x| {
        let near = (0..rows).filter(|row| row.abs_diff(y) <= 64 + 31);
        let Some(from) = near.filter(is_seeded).min_by_key(|row| (row.abs_diff(y), *row)) else {
            return 0;
        };

        let valid = (0..cols).filter(|&col| mask.row(from)[col]);

        let nearest = valid.min_by_key(|col| (col.abs_diff(x), *col));
        nearest.map_or(0, |col| plane.row(from)[col])
    })
}

/// Reference implementation of [`phasestereo_match::cost::normalized_sad::normalize`]: mean and variance of
/// each window by themselves.
pub fn normalize(plane: &Plane<u16>, window: usize) -> Plane<u16> {
    let radius = (window / 2) as isize;
    let count = (window * window) as i64;

    Plane::from_fn(plane.rows(), plane.cols(), |y, x| {
        let mut sum = 0i64;
        let mut squares = 0i64;
        for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx))) {
            let (row, col) = (y as isize + dy, x as isize + dx);
            let value = plane.row(reflect(row, plane.rows()))[reflect(col, plane.cols())];
            sum += i64::from(value);
            squares += i64::from(value).pow(2);
        }

        let one_gray_level = (16 * count).pow(2);
        let variance = (count * squares - sum * sum + one_gray_level) as f64;

        let deviations = (count * i64::from(plane.row(y)[x]) - sum) as f64 / variance.sqrt();
        ((deviations.clamp(-16.0, 16.0) + 16.0) * 256.0).round() as u16
    })
}

/// Reference implementation of [`phasestereo_match::image::convolution::convolve`]: every sum by itself, one
/// whole pass after the other.
pub fn convolve(gray: &Plane<i32>, kernel: &Kernel, fraction: u32) -> Plane<i32> {
    let pass = |values: &Plane<i32>, weights: &Plane<i32>, dropped: u32| {
        let unit = 1 << dropped;
        let rounded = |y, x| (weighted_sum(values, weights, y, x) + unit / 2).div_euclid(unit);
        Plane::from_fn(values.rows(), values.cols(), |y, x| rounded(y, x) as i32)
    };

    match kernel.weights() {
        KernelWeights::All(weights) => pass(gray, weights, WEIGHT_BITS - fraction),
        KernelWeights::Factors { column, row } => {
            let between = pass(gray, column, WEIGHT_BITS - fraction - KEPT_BITS);
            pass(&between, row, WEIGHT_BITS + KEPT_BITS)
        }
    }
}

/// The weighted sum around a pixel: a true convolution, the kernel flipped.
fn weighted_sum(values: &Plane<i32>, weights: &Plane<i32>, y: usize, x: usize) -> i64 {
    let (vertical, horizontal) = ((weights.rows() / 2) as isize, (weights.cols() / 2) as isize);

    let mut sum = 0;
    for dy in -vertical..=vertical {
        let row = values.row(reflect(y as isize - dy, values.rows()));
        for dx in -horizontal..=horizontal {
            let weight = weights.row((dy + vertical) as usize)[(dx + horizontal) as usize];
            sum += i64::from(weight) * i64::from(row[reflect(x as isize - dx, values.cols())]);
        }
    }

    sum
}

/// Reference implementation of [`phasestereo_match::image::impulses::repaired`]: the neighbors of every pixel
/// are sorted.
pub fn repair(plane: &Plane<i32>, height: i32) -> Plane<i32> {
    Plane::from_fn(plane.rows(), plane.cols(), |y, x| {
        let pixel = plane.row(y)[x];
        let sorted = sorted_neighbors(plane, y, x);
        let spread = sorted[6] - sorted[1];
        let beyond = (pixel - sorted[6]).max(sorted[1] - pixel);
        let median = (sorted[3] + sorted[4]).div_euclid(2);

        if beyond - spread > height { median } else { pixel }
    })
}

/// Reference implementation of [`phasestereo_match::image::impulses::count_doubtless`], for all rows.
pub fn doubtless(plane: &Plane<i32>, height: i32) -> u64 {
    let places = (0..plane.rows()).flat_map(|y| (0..plane.cols()).map(move |x| (y, x)));
    let is_doubtless = |(y, x): &(usize, usize)| {
        let pixel = plane.row(*y)[*x];
        let sorted = sorted_neighbors(plane, *y, *x);
        let beyond = (pixel - sorted[6]).max(sorted[1] - pixel);
        beyond - 3 * (sorted[6] - sorted[1]) > height
    };

    places.filter(is_doubtless).count() as u64
}

/// The eight neighbors of a pixel in rising order.
fn sorted_neighbors(plane: &Plane<i32>, y: usize, x: usize) -> Vec<i32> {
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx)));
    let value = |(dy, dx): (isize, isize)| {
        let row = plane.row(mirrored(y as isize + dy, plane.rows()));
        row[mirrored(x as isize + dx, plane.cols())]
    };

    let mut values: Vec<_> = around.filter(|place| *place != (0, 0)).map(value).collect();
    values.sort_unstable();
    values
}

/// Reference implementation of [`phasestereo_match::image::blocking::Extra::jump`]: phase by phase,
/// differences clipped to `clip` half steps.
pub fn jump(plane: &Plane<i32>, clip: i32) -> f64 {
    // Columns are the rows of the transposed plane.
    let turned = Plane::from_fn(plane.cols(), plane.rows(), |y, x| plane.row(x)[y]);

    let along = |plane: &Plane<i32>| {
        let mean = |phase: usize| {
            let places = (0..plane.cols().saturating_sub(3)).filter(|x| x % 8 == phase);
            let extras = places.flat_map(|x| {
                (0..plane.rows()).map(move |y| {
                    let of = |i: usize| plane.row(y)[x + i];
                    let inside = (of(0) - of(1)).abs() + (of(2) - of(3)).abs();
                    i64::from((2 * (of(1) - of(2)).abs() - inside).clamp(-clip, clip))
                })
            });

            let extras: Vec<i64> = extras.collect();
            (!extras.is_empty()).then(|| extras.iter().sum::<i64>() as f64 / extras.len() as f64)
        };

        let means: Option<Vec<f64>> = (0..8).map(mean).collect();
        means.map_or(0.0, |mut means| {
            means.sort_unstable_by(f64::total_cmp);
            means[7] - means[6]
        })
    };

    along(plane).min(along(&turned)) / 2.0
}

/// Reference implementation of [`phasestereo_match::image::smoothing::smooth`]: every window by itself; sums
/// over the rows of a column first.
pub fn smooth_gray(plane: &Plane<i32>, deviation: f64, scale: f64) -> Plane<i32> {
    let (rows, cols) = (plane.rows(), plane.cols());
    let mean = |values: &dyn Fn(usize, usize) -> f64, y: usize, x: usize| {
        let column = |dx: isize| {
            let x = reflect(x as isize + dx, cols);
            let row = |dy: isize| values(reflect(y as isize + dy, rows), x);
            row(-2) + row(-1) + row(0) + row(1) + row(2)
        };
        (column(-2) + column(-1) + column(0) + column(1) + column(2)) / 25.0
    };

    let gray = |y: usize, x: usize| f64::from(plane.row(y)[x]);
    let noise =
        (deviation.min((1u64 << 40) as f64) * deviation.min((1u64 << 40) as f64)).max(f64::MIN_POSITIVE);

    let windows = Plane::from_fn(rows, cols, |y, x| {
        let center = mean(&gray, y, x);
        let squares = mean(&|y, x| gray(y, x) * gray(y, x), y, x);
        let share = noise / ((squares - center * center).max(0.0) + noise);
        (share, share * center)
    });

    Plane::from_fn(rows, cols, |y, x| {
        let share = mean(&|y, x| windows.row(y)[x].0, y, x);
        let drawn = mean(&|y, x| windows.row(y)[x].1, y, x);
        let value = gray(y, x) - share * gray(y, x) + drawn;
        (value * scale).round_ties_even() as i32
    })
}

/// Reference implementation of [`phasestereo_match::descriptor::describe`]: every component by its double
/// sum. Parts of components up to `threshold` are weak, if there is a weak level; with two sizes, those of
/// the larger one.
pub fn describe(gray: &Plane<i32>, settings: &Settings, threshold: f64) -> Plane<u64> {
    let basis = Basis::new(settings);
    if settings.sizes == 1 {
        return components(gray, &basis, settings, threshold, |_| true);
    }

    let larger = Settings { neighborhood: settings.neighborhood + 2, ..settings.clone() };
    let is_axis = |c: &Component| c.u + c.v.unsigned_abs() == 1;
    let axes = components(gray, &Basis::new(&larger), &larger, threshold, is_axis);
    let no_weak = Settings { noise_threshold: 0.0, ..settings.clone() };
    let all = components(gray, &basis, &no_weak, 0.0, |_| true);

    let (r, s) = settings.frequencies;
    let bits = (r.min(1) + s.min(1)) << (settings.bits - 1) << usize::from(settings.noise_threshold > 0.0);

    Plane::from_fn(gray.rows(), gray.cols(), |y, x| axes.row(y)[x] | all.row(y)[x] << bits)
}

/// Reference implementation of [`phasestereo_match::descriptor::describe_roughly`].
pub fn describe_roughly(gray: &Plane<i32>, settings: &Settings) -> Plane<u64> {
    components(gray, &Basis::rough(settings), settings, 0.0, |_| true)
}

/// The codes of one size, from the components that count.
fn components(
    gray: &Plane<i32>,
    basis: &Basis,
    settings: &Settings,
    threshold: f64,
    counts: impl Fn(&Component) -> bool,
) -> Plane<u64> {
    let weak = settings.has_weak().then_some(threshold);

    let radius = basis.radius() as isize;
    let tap = |f: isize, j: isize| {
        let filter = &basis.filters()[f.unsigned_abs()];
        let distance = j.unsigned_abs();
        let imaginary = i64::from(filter.odd[distance]) * j.signum() as i64 * if f < 0 { -1 } else { 1 };
        (i64::from(filter.even[distance]), imaginary)
    };

    Plane::from_fn(gray.rows(), gray.cols(), |y, x| {
        let mut code = 0;

        for (c, component) in basis.components().into_iter().filter(&counts).enumerate() {
            let mut re = 0;
            let mut im = 0;
            for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx))) {
                let (row, col) = (y as isize + dy, x as isize + dx);
                let pixel = gray.row(reflect(row, gray.rows()))[reflect(col, gray.cols())];
                // The product of the filters along x and along y, (a + i b) (c + i d).
                let ((a, b), (c, d)) = (tap(component.u as isize, dx), tap(component.v, dy));
                re += (a * c - b * d) * i64::from(pixel);
                im += (a * d + b * c) * i64::from(pixel);
            }

            let (quantized, bits) = quantize(re, im, (settings.power, settings.bits), weak);
            code |= quantized << (c * bits);
        }

        code
    })
}

/// Tangents of the multiples of an eighth of a right angle.
const TANGENTS: [f64; 7] = [
    0.198_912_367_379_658,
    0.414_213_562_373_095_05,
    0.668_178_637_919_298_9,
    1.0,
    1.496_605_762_665_489,
    2.414_213_562_373_095,
    5.027_339_492_125_846,
];

/// Reference implementation of [`phasestereo_match::descriptor::quantizer`]: the code of the component `re +
/// i im` and its length, given the power of the spectrum and the bits of its phase. A boundary belongs to the
/// sector counterclockwise of it, zero to the first sector. With a weak level: the clearly negative parts,
/// then the clearly positive ones.
pub fn quantize(re: i64, im: i64, (power, bits): (usize, usize), weak: Option<f64>) -> (u64, usize) {
    if let Some(weak) = weak {
        let (a, b) = (re as f64, im as f64);
        let (a, b, weak) = match power {
            1 => (a, b, weak),
            _ => ((a - b) * (a + b), 2.0 * a * b, weak * weak),
        };
        let bits = [a < -weak, b < -weak, a > weak, b > weak];
        return ((0..4).map(|bit| u64::from(bits[bit]) << bit).sum(), 4);
    }

    let length = 1 << (bits - 1);
    // Turned by right angles until it lies in the first quadrant, its lower border included.
    let (mut turns, mut x, mut y) = (0, re, im);
    while (x, y) != (0, 0) && !(x > 0 && y >= 0) {
        (x, y) = (y, -x);
        turns += 1;
    }

    // Sixteenths of a half turn up to the component, then its place among the levels of its power: these go
    // around once while it turns by a whole turn over the power.
    let beyond = TANGENTS.iter().filter(|tangent| x > 0 && y as f64 / x as f64 >= **tangent).count();
    let eighths = 8 * turns + beyond;
    let level = eighths * power * 2 * length / 32 % (2 * length);

    // Ones enter at the low end until the word is full, then zeros do.
    let ones = |count: usize| (1u64 << count) - 1;
    let code = if level < length { ones(level) } else { ones(length) - ones(level - length) };
    (code, length)
}

/// Reference implementation of [`phasestereo_match::cost::Costs::write`] for phase codes: every bit compared
/// by itself, over the whole image.
pub fn phase_costs(left: &Plane<u64>, right: &Plane<u64>, candidates: Candidates) -> Plane<u16> {
    let (rows, cols, count) = (left.rows(), left.cols(), candidates.count());

    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let (a, b) = (left.row(y)[x], right.row(y)[candidates.column(x, k, cols)]);
        (0..64).filter(|bit| a >> bit & 1 != b >> bit & 1).count() as u16
    })
}

/// Reference implementation of [`phasestereo_match::cost::Costs::write`] for absolute differences.
pub fn absolute_differences(left: &Plane<u16>, right: &Plane<u16>, candidates: Candidates) -> Plane<u16> {
    let (rows, cols, count) = (left.rows(), left.cols(), candidates.count());

    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let column = candidates.column(x, k, cols);
        left.row(y)[x].abs_diff(right.row(y)[column])
    })
}

/// Reference implementation of [`phasestereo_match::cost::zncc`]: the correlation of every two neighborhoods
/// by itself.
pub fn zncc(left: &Plane<u16>, right: &Plane<u16>, candidates: Candidates, side: usize) -> Plane<u16> {
    let (rows, cols, count) = (left.rows(), left.cols(), candidates.count());
    let reach = (side / 2) as isize;
    let around = move || (-reach..=reach).flat_map(move |v| (-reach..=reach).map(move |u| (v, u)));
    let pixels = (side * side) as i64;

    let cost = |y: usize, columns: [isize; 2]| {
        let value = |plane: &Plane<u16>, column: isize, (v, u): (isize, isize)| {
            let row = (y as isize + v).clamp(0, rows as isize - 1) as usize;
            i64::from(plane.row(row)[(column + u).clamp(0, cols as isize - 1) as usize])
        };
        let pairs = || around().map(|at| (value(left, columns[0], at), value(right, columns[1], at)));
        let sum = |of: fn((i64, i64)) -> i64| pairs().map(of).sum::<i64>();

        let (l, r) = (sum(|(l, _)| l), sum(|(_, r)| r));
        let spread =
            |squares: i64, sum: i64| ((pixels * squares - sum * sum + (16 * pixels).pow(2)) as f64).sqrt();
        let spreads = spread(sum(|(l, _)| l * l), l) * spread(sum(|(_, r)| r * r), r);
        let correlation = (pixels * sum(|(l, r)| l * r) - l * r) as f64 / spreads;
        ((1.0 - correlation.clamp(-1.0, 1.0)) * 256.0).round_ties_even() as u16
    };

    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = ((place / count) as isize, place % count);
        let column = x - candidates.disparity(k);
        cost(y, [x, column])
    })
}

/// The sum over a whole window, from that over its `support` valid pixels; without any, the largest possible.
/// Bits are dropped from the sum of each column, so the mean of a few may exceed the largest sum.
fn scaled(sum: u64, support: u64, window: Window) -> u64 {
    let pixels = (window.side * window.side) as u64;
    let mean = (sum * pixels + support / 2).checked_div(support);
    mean.unwrap_or(u64::MAX).min(window.largest_sum())
}

/// Reference implementation of [`phasestereo_match::cost::aggregation::Aggregator`]: each window summed by
/// itself, over the whole image.
pub fn aggregate(costs: &Plane<u16>, validity: &Plane<u16>, window: Window) -> Plane<u32> {
    let count = window.candidates;
    let boxes = Plane::from_fn(window.rows, window.cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let support = box_sum(validity, Window { dropped: 0, ..window }, y, x, k);
        scaled(box_sum(costs, window, y, x, k), support, window) as u32
    });

    if !window.shiftable {
        return boxes;
    }

    let radius = window.radius();
    Plane::from_fn(window.rows, window.cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let (top, bottom) = (y.saturating_sub(radius), (y + radius).min(window.rows - 1));
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(window.cols - 1));

        // Windows may shift by their radius, but stay centered within the image.
        let centers = [(y, x), (top, x), (bottom, x), (y, left), (y, right)];
        centers.map(|(y, x)| boxes.row(y)[x * count + k]).into_iter().fold(u32::MAX, u32::min)
    })
}

/// The sum of one window; the bits that are dropped are those of each column.
fn box_sum(volume: &Plane<u16>, window: Window, y: usize, x: usize, k: usize) -> u64 {
    let radius = window.radius() as isize;
    let column_sum = |dx: isize| {
        let col = (x as isize + dx).clamp(0, window.cols as isize - 1) as usize;
        let row = |dy: isize| (y as isize + dy).clamp(0, window.rows as isize - 1) as usize;
        let cost = |dy| u64::from(volume.row(row(dy))[col * window.candidates + k]);
        (-radius..=radius).map(cost).sum::<u64>() >> window.dropped
    };

    (-radius..=radius).map(column_sum).sum()
}

/// Reference implementation of [`phasestereo_match::optimization::ordered::Ordered`]: every origin of every
/// state is tried.
pub fn in_order(costs: &[u32], candidates: usize, penalties: Penalties) -> Vec<u16> {
    let mut totals = vec![0u64; candidates];
    let mut origins: Vec<Vec<usize>> = Vec::new();

    for costs in costs.chunks(candidates) {
        // Total and origin of the best path to each candidate.
        let best: Vec<(u64, usize)> = (0..candidates)
            .map(|to| {
                // Among equal totals, the first one counts.
                let from = |from: usize, penalty: u64| (totals[from] + penalty, from);
                let stayed = std::iter::once(from(to, 0));
                let rose = to.checked_sub(1).map(|smaller| from(smaller, penalties.p1));
                let dropped = (to + 1..candidates).map(|larger| from(larger, penalties.p2));
                let origins = stayed.chain(rose).chain(dropped);
                origins.min_by_key(|(total, _)| *total).unwrap_or((u64::MAX, to))
            })
            .collect();

        totals = best.iter().zip(costs).map(|((total, _), &cost)| total + u64::from(cost)).collect();
        origins.push(best.into_iter().map(|(_, from)| from).collect());
    }

    let mut index = least(&totals);
    let mut chosen = vec![];
    for origins in origins.iter().rev() {
        chosen.push(index as u16);
        index = origins[index];
    }

    chosen.reverse();
    chosen
}

/// The index of the first of the smallest values.
fn least<T: Ord + Copy>(values: &[T]) -> usize {
    let mut best = 0;
    for (index, value) in values.iter().enumerate() {
        if *value < values[best] {
            best = index;
        }
    }

    best
}

/// Reference implementation of [`phasestereo_match::optimization::edges::Edges`]: each pixel and neighbor by
/// itself. The lowest bits of a pixel hold the jump from above, the next ones that from the left.
pub fn edges(gray: &Plane<i32>, threshold: f64) -> Plane<u8> {
    let (rows, cols) = (gray.rows(), gray.cols());
    let differences = (0..rows).flat_map(|y| gray.row(y).windows(2));
    let sum: u64 = differences.map(|pair| u64::from(pair[0].abs_diff(pair[1]))).sum();
    let mean = sum as f64 / (rows * (cols - 1)).max(1) as f64;
    let small = (threshold * mean) as u64;

    Plane::from_fn(rows, cols, |y, x| {
        let jump = |neighbor: i32| {
            let difference = u64::from(neighbor.abs_diff(gray.row(y)[x]));
            u8::from(difference > small) + u8::from(difference > 3 * small)
        };

        let above = jump(gray.row(y.saturating_sub(1))[x]);
        let left = jump(gray.row(y)[x.saturating_sub(1)]);
        above | left << 2
    })
}

/// The candidates that are searched in a band and a panel, given their numbers.
pub type Searched<'a> = &'a dyn Fn(usize, usize) -> Range<usize>;

/// The costs when a band and a panel determine the searched candidates: all others cost more than any.
fn limited(
    costs: &Plane<u32>,
    candidates: usize,
    searched: impl Fn(usize, usize) -> Range<usize>,
) -> Plane<u32> {
    Plane::from_fn(costs.rows(), costs.cols(), |y, place| {
        let is_searched = searched(y, place / candidates).contains(&(place % candidates));
        if is_searched { costs.row(y)[place] } else { u32::MAX }
    })
}

/// Reference implementation of the sums of [`phasestereo_match::optimization`] that decide by horizontal
/// paths only: half the sum of both totals, rounded up, for every candidate of every pixel. `edges` are those
/// of [`edges`](fn@edges).
pub fn scanline_optimization(
    costs: &Plane<u32>,
    candidates: usize,
    penalties: Penalties,
    edges: Option<&Plane<u8>>,
    searched: Searched,
) -> Plane<u64> {
    let rows = 0..costs.rows();
    let cols = costs.cols() / candidates;
    let totals = |step, columns, costs: &Plane<u32>| {
        let image = PathCosts { costs, candidates, penalties, edges };
        image.totals((0, step), rows.clone(), columns)
    };

    // From the left, each pixel has the candidates of its own panel; from the right, those of the panel that
    // the path is for.
    let own = limited(costs, candidates, |y, x| searched(y / BAND, x / PANEL));
    let left = totals(1, 0..cols, &own);
    let right = |first: usize| {
        let end = ((first + PANEL).min(cols) + COLUMNS_AHEAD).min(cols);
        let costs = limited(costs, candidates, |y, _| searched(y / BAND, first / PANEL));
        totals(-1, first..end, &costs)
    };
    let right: Vec<_> = (0..cols).step_by(PANEL).map(right).collect();

    Plane::from_fn(rows.end, costs.cols(), |y, place| {
        let panel = place / candidates / PANEL;
        (left.row(y)[place] + right[panel].row(y)[place]).div_ceil(2)
    })
}

/// Reference implementation of the sums of [`phasestereo_match::optimization`] that decide by four paths: the
/// mean of the horizontal mean and, for each band with its look-ahead rows, the vertical mean.
pub fn semi_global(
    costs: &Plane<u32>,
    candidates: usize,
    penalties: Penalties,
    edges: Option<&Plane<u8>>,
    searched: Searched,
) -> Plane<u64> {
    let (rows, cols) = (costs.rows(), costs.cols() / candidates);

    let horizontal = scanline_optimization(costs, candidates, penalties, edges, searched);
    let vertical = |first: usize| {
        let seen = first.saturating_sub(ROWS_AHEAD)..(first + BAND + ROWS_AHEAD).min(rows);
        let costs = &limited(costs, candidates, |_, x| searched(first / BAND, x / PANEL));
        let image = PathCosts { costs, candidates, penalties, edges };
        [1, -1].map(|dy| image.totals((dy, 0), seen.clone(), 0..cols))
    };
    let vertical: Vec<_> = (0..rows).step_by(BAND).map(vertical).collect();

    Plane::from_fn(rows, costs.cols(), |y, place| {
        let [above, below] = &vertical[y / BAND];
        let vertical = (above.row(y)[place] + below.row(y)[place]).div_ceil(2);
        (horizontal.row(y)[place] + vertical).div_ceil(2)
    })
}

/// The inputs of the totals of paths.
struct PathCosts<'a> {
    costs: &'a Plane<u32>,
    candidates: usize,
    penalties: Penalties,
    edges: Option<&'a Plane<u8>>,
}

impl PathCosts<'_> {
    /// Totals of the paths that take steps of `(dy, dx)` through some rows and columns, starting at their
    /// border.
    fn totals(&self, (dy, dx): (isize, isize), rows: Range<usize>, columns: Range<usize>) -> Plane<u64> {
        let Self { costs, candidates, .. } = *self;
        let mut totals = costs.map(|_| 0);

        for y in by_steps(rows.clone(), dy) {
            for x in by_steps(columns.clone(), dx) {
                // The previous pixel on the path; outside the rows and columns it is missing, and nothing to
                // add.
                let from = (y.wrapping_add_signed(-dy), x.wrapping_add_signed(-dx));
                let is_inside = rows.contains(&from.0) && columns.contains(&from.1);

                let places = |x: usize| x * candidates..(x + 1) * candidates;
                let costs = &costs.row(y)[places(x)];
                let steps = if is_inside {
                    let mut before = totals.row(from.0)[places(from.1)].to_vec();
                    let least = before[least(&before)];
                    // For a candidate that is not searched here, a path keeps only its smallest total.
                    let ends = before.iter_mut().zip(costs).filter(|(_, cost)| **cost == u32::MAX);
                    ends.for_each(|(total, _)| *total = u64::MAX / 2);

                    self.steps(&before, least, self.p2(from, (y, x)))
                } else {
                    vec![0; candidates]
                };

                for ((total, step), cost) in totals.row_mut(y)[places(x)].iter_mut().zip(steps).zip(costs) {
                    *total = step + u64::from(*cost);
                }
            }
        }

        totals
    }

    /// The cost of the step to each candidate, beyond the smallest total of the previous pixel: to stay, to
    /// change by one, or to come from the candidate with that smallest total. (If this is at most one away,
    /// P2 is not less than the right penalty.)
    fn steps(&self, before: &[u64], least: u64, p2: u64) -> Vec<u64> {
        let step = |k: usize| {
            let beside = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
            let changed = beside.filter_map(|k| before.get(k)).map(|total| total + self.penalties.p1);
            changed.chain([before[k], least + p2]).fold(u64::MAX, u64::min) - least
        };
        (0..before.len()).map(step).collect()
    }

    /// P2 between two neighbors: lower where the gray value jumps, in whichever direction the path goes.
    fn p2(&self, a: (usize, usize), b: (usize, usize)) -> u64 {
        let (before, after) = (a.min(b), a.max(b));

        let neighbor = usize::from(before.0 == after.0);
        let jump = self.edges.map_or(0, |edges| edges.row(after.0)[after.1] >> (2 * neighbor) & 3);

        (self.penalties.p2 / u64::from(1 + jump)).max(self.penalties.p1)
    }
}

/// A range in the order of steps of this sign.
fn by_steps(range: Range<usize>, step: isize) -> Vec<usize> {
    if step < 0 { range.rev().collect() } else { range.collect() }
}

/// The evidence of the candidate chosen for a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelEvidence {
    /// Its index.
    pub chosen: u16,
    /// Its cost.
    pub best: u32,
    /// The smallest cost of a candidate not next to it. [`NO_CANDIDATE`]: without such a candidate.
    pub second_best: u32,
    /// Sub-pixel offset of the match from the chosen candidate, pixels.
    pub offset: f32,
}

/// Reference implementation of [`phasestereo_match::optimization::selection`] for one pixel, from the sums of
/// all paths and from its own costs.
pub fn select(sums: &[u64], costs: &[u32]) -> PixelEvidence {
    let valley: Vec<_> = sums.iter().zip(costs).map(|(&sum, &cost)| evidence(sum, cost)).collect();
    found(least(sums), sums, &valley)
}

/// [`select`] for a pixel whose candidate was chosen elsewhere, using only its costs.
pub fn margin(chosen: u16, costs: &[u32]) -> PixelEvidence {
    let valley: Vec<_> = costs.iter().map(|&cost| evidence(cost.into(), 0)).collect();
    let costs: Vec<u64> = costs.iter().map(|&cost| cost.into()).collect();
    found(chosen.into(), &costs, &valley)
}

/// The evidence of a chosen candidate: its costs decide, `valley` gives the offset.
fn found(chosen: usize, costs: &[u64], valley: &[u32]) -> PixelEvidence {
    // The neighbors of the chosen candidate see the same match.
    let others = costs.iter().enumerate().filter(|(k, _)| k.abs_diff(chosen) > 1);
    let beside = chosen.checked_sub(1).and_then(|below| valley.get(below)).zip(valley.get(chosen + 1));

    PixelEvidence {
        chosen: chosen as u16,
        best: capped(costs[chosen]),
        second_best: others.map(|(_, &cost)| capped(cost)).min().unwrap_or(NO_CANDIDATE),
        offset: beside.map_or(0.0, |(&below, &above)| offset(below, valley[chosen], above)),
    }
}

/// A cost, clamped to the largest one.
fn capped(cost: u64) -> u32 {
    cost.min(u64::from(NO_CANDIDATE) - 1) as u32
}

/// The cost that places a match between candidates: the path sum, plus twice the pixel's own cost.
fn evidence(sum: u64, cost: u32) -> u32 {
    (u64::from(capped(sum)) + 2 * u64::from(cost)).min((1 << 31) - 1) as u32
}

/// Reference implementation of [`phasestereo_match::optimization::subpixel::offset`]: the tip of a V, moved
/// away from the candidate.
pub fn offset(below: u32, own: u32, above: u32) -> f32 {
    let [below, own, above] = [below, own, above].map(i64::from);
    let slope = (below - own).max(above - own).max(1);
    let doubled = ((below - above) as f32 / slope as f32).clamp(-1.0, 1.0);

    0.5 * doubled * (1.0 + 0.3 * (1.0 - doubled.abs()))
}

/// Reference implementation of [`phasestereo_match::refinement::surfaces::smooth`]: every pair of neighbors
/// by itself.
pub fn smooth_surfaces(disparity: &Plane<f32>) -> Plane<f32> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let reach = 3;
    let at = |y: usize, x: usize, dy: isize, dx: isize| {
        let (y, x) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        (y < rows && x < cols).then(|| disparity.row(y)[x])
    };
    let pairs = (0..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx)));
    let pairs: Vec<(isize, isize)> = pairs.filter(|pair| *pair > (0, 0)).collect();

    Plane::from_fn(rows, cols, |y, x| {
        let own = disparity.row(y)[x];
        let mut sum = 0.0;
        let mut count = 1.0;

        for &(dy, dx) in &pairs {
            let (Some(ahead), Some(behind)) = (at(y, x, dy, dx), at(y, x, -dy, -dx)) else {
                continue;
            };

            if (ahead - own).abs() <= 1.0 && (behind - own).abs() <= 1.0 {
                sum += (ahead - own) + (behind - own);
                count += 2.0;
            }
        }

        own + sum / count
    })
}

/// Reference implementation of [`VotedMap::confidences`]: each pixel asks those around it, in opposite pairs
/// whose weights take one division.
pub fn confidences(map: VotedMap) -> Plane<f32> {
    let (rows, cols) = (map.disparity.rows(), map.disparity.cols());
    // In units of twice the mean difference of neighbors.
    let scale = 1.0 / ((2.0 * mean_difference(map.texture.roughness)).max(1.0) as f32);

    // Disparity, gray value and vote of a neighbor, if it has a disparity.
    let at = |y: usize, x: usize, dy: isize, dx: isize| {
        let (y, x) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        let is_inside = y < rows && x < cols;
        let disparity = is_inside.then(|| map.disparity.row(y)[x]).filter(|d| !d.is_nan())?;
        Some((disparity, map.texture.gray.row(y)[x] as f32 * scale, map.votes.row(y)[x]))
    };
    let missing = (f32::NAN, 1_073_741_824.0, 0.0);

    let pairs = [0, 2, 4].into_iter().flat_map(|dy| [-4, -2, 0, 2, 4].map(|dx| (dy, dx)));
    let pairs: Vec<_> = pairs.filter(|pair| *pair > (0, 0)).collect();

    Plane::from_fn(rows, cols, |y, x| {
        let Some((own, gray, mut votes)) = at(y, x, 0, 0) else { return 0.0 };

        let mut weight = 1.0;
        for &(dy, dx) in &pairs {
            let [ahead, behind] = [(dy, dx), (-dy, -dx)].map(|(dy, dx)| at(y, x, dy, dx).unwrap_or(missing));

            let inverse = |gray_there: f32| 1.0 + (gray_there - gray) * (gray_there - gray);
            let [a, b] = [inverse(ahead.1), inverse(behind.1)];
            let both = 1.0 / (a * b);
            weight += b * both + a * both;

            let vote = |(there, _, vote): (f32, f32, f32), alike: f32| {
                if (there - own).abs() <= 1.0 { alike * vote } else { 0.0 }
            };
            votes += vote(ahead, b * both) + vote(behind, a * both);
        }

        let support = votes / weight;
        let cube = support * support * support;
        cube / (cube + 0.01)
    })
}

/// The mean difference of horizontal neighbors.
fn mean_difference(roughness: Roughness) -> f64 {
    if roughness.pairs == 0 { 0.0 } else { roughness.sum as f64 / roughness.pairs as f64 }
}

/// The vote of a pixel for its disparity, from its cost and the second-best one; half a vote is ahead by 4
/// units.
pub fn vote(best: u32, second_best: Option<u32>, unit: f32) -> f32 {
    let ahead = second_best.map_or(0, |cost| cost.saturating_sub(best)) as f32;
    ahead / (ahead + 4.0 * unit)
}

/// A map with raw confidences, of a whole pair.
#[derive(Debug, Clone, Copy)]
pub struct RawMap<'a> {
    pub disparity: &'a Plane<f32>,
    pub flags: &'a Plane<u16>,
    pub confidence: &'a Plane<f32>,
}

/// Reference implementation of [`phasestereo_match::refinement::calibration`]: confidence and bar of each
/// pixel by itself, from the sums over the sampled rows, checked for every pixel.
pub fn calibrated(
    map: RawMap,
    candidates: Candidates,
    compensation: (Option<&BlurCompensation>, f64),
    weights: &CalibrationWeights,
) -> [Plane<f32>; 2] {
    let (rows, cols) = (map.disparity.rows(), map.disparity.cols());
    let share = calibration_traits(map, candidates, compensation);

    let weighed = |which: usize| {
        let mut sum = 0.0;
        for (value, weights) in share.iter().zip(&weights.odds) {
            sum += value * weights[which];
        }
        sum
    };
    let mut wider = 0.0;
    for (value, weight) in share.iter().zip(&weights.bars) {
        wider += value * weight;
    }

    let of_pixel = |y: usize, x: usize| {
        if map.disparity.row(y)[x].is_nan() {
            return [0.0, f32::NAN];
        }

        let is_filled = map.flags.row(y)[x] & flag::FILLED != 0;
        let is_seen = map.flags.row(y)[x] & flag::MISSING == 0;
        let raw = if is_seen { map.confidence.row(y)[x] } else { 0.0 };
        let step = ((raw * 1024.0).floor() as usize).min(1023);
        let l = log_odds((step as f64 + 0.5) / 1024.0);
        let is_outline = |left: usize| {
            let row = map.disparity.row(y);
            left + 1 < cols && (row[left + 1] - row[left]).abs() > 1.0
        };
        let is_beside = (x.saturating_sub(8)..=x + 8).any(is_outline);
        let [height, slope] = if is_filled {
            [weighed(0) + weighed(3), weighed(1) + weighed(4)]
        } else if is_beside {
            [weighed(0) + weighed(2), weighed(1)]
        } else {
            [weighed(0), weighed(1)]
        };
        let z = height + slope * l;

        let knots = &weights.knots[usize::from(is_filled)];
        let place = (z + 4.0).clamp(0.0, 9.0);
        let left = (place.floor() as usize).min(8);
        let part = place - left as f64;
        let line = knots[left] * (1.0 - part) + knots[left + 1] * part;
        [(1.0 / (1.0 + exp(-z))) as f32, exp(line + wider) as f32]
    };

    [0, 1].map(|which| Plane::from_fn(rows, cols, |y, x| of_pixel(y, x)[which]))
}

/// The logarithm of the odds of a share that is not too certain.
fn log_odds(share: f64) -> f64 {
    let share = share.clamp(0.004, 0.996);
    ln(share / (1.0 - share))
}

fn calibration_traits(
    map: RawMap,
    candidates: Candidates,
    (compensation, gray_level): (Option<&BlurCompensation>, f64),
) -> [f64; 8] {
    let (rows, cols) = (map.disparity.rows(), map.disparity.cols());
    let is_counted = |y: usize| {
        // Three bands of 96 rows, in the middle of each third.
        let of_band = |third: usize| {
            let first = (2 * third + 1) * rows / 6 - 48;
            (first..first + 96).contains(&y)
        };
        rows <= 768 || (0..3).any(of_band)
    };
    let ends = [candidates.min() as f32, (candidates.min() + candidates.count() as isize - 1) as f32];

    let (mut sum, mut own, mut failed, mut at_end, mut all) = (0u64, 0u64, 0u64, 0u64, 0u64);
    for (y, x) in (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))) {
        if !is_counted(y) {
            continue;
        }
        let (disparity, flags) = (map.disparity.row(y)[x], map.flags.row(y)[x]);

        all += 1;
        if flags & (flag::OCCLUDED | flag::MISMATCHED | flag::SPECKLE) != 0 {
            failed += 1;
        }
        if disparity.is_nan() || flags & flag::FILLED != 0 {
            continue;
        }
        own += 1;
        sum += (f64::from(map.confidence.row(y)[x]) * 1_048_576.0).floor() as u64;
        let is_low = ends[0] != 0.0 && disparity < ends[0] + 0.5;
        let is_high = ends[1] != 0.0 && disparity > ends[1] - 0.5;
        if is_low || is_high {
            at_end += 1;
        }
    }

    let of = |part: u64, whole: u64| if whole == 0 { part as f64 } else { part as f64 / whole as f64 };
    let mean = of(sum, own) / 1_048_576.0;
    let sure = log_odds(if mean < 0.4 { 0.4 } else { mean });
    let [noise, smoothing] = [BlurCompensation::noise, BlurCompensation::smoothing].map(|of| {
        let [left, right] = compensation.map_or([0.0; 2], of);
        if left > right { left / gray_level } else { right / gray_level }
    });
    let is_blurred = compensation.is_some_and(|known| known.every_kernel().next().is_some());

    [
        1.0,
        sure,
        if sure < 1.5 { 1.5 - sure } else { 0.0 },
        log_odds(of(failed, all)),
        ln(noise + 0.3),
        ln(smoothing + 0.1),
        f64::from(u8::from(is_blurred)),
        ln(of(at_end, all) + 0.003),
    ]
}

/// Reference implementation of [`phasestereo_match::refinement::left_right_check::Checker`]: for every pixel,
/// all others of the row are checked.
pub fn check_row(choices: Choices, most: u16, flags: &[u16]) -> Vec<u16> {
    let Choices { chosen, costs, candidates } = choices;
    let cols = chosen.len();

    let has_match = |x: usize| {
        flags[x] & (flag::MISSING | flag::OUTSIDE | flag::MATCH_MASKED) == 0
            && (0..cols as isize).contains(&(x as isize - candidates.disparity(chosen[x].into())))
    };
    let column = |x: usize| x as isize - candidates.disparity(chosen[x].into());

    let is_consistent = |x: usize| {
        let rivals = (0..cols).filter(|&other| has_match(other) && column(other) == column(x));
        // Among equal costs the largest disparity: the nearer surface hides the other.
        let owner = rivals.min_by_key(|&other| (costs[other], Reverse(chosen[other])));
        has_match(x) && owner.is_some_and(|owner| chosen[owner].abs_diff(chosen[x]) <= most)
    };

    let reason = |x: usize| {
        let beside = x.saturating_sub(1)..(x + 2).min(cols);
        if !has_match(x) || is_consistent(x) {
            0
        } else if beside.into_iter().any(is_consistent) {
            flag::MISMATCHED
        } else {
            flag::OCCLUDED
        }
    };

    (0..cols).map(|x| flags[x] | reason(x)).collect()
}

/// Reference implementation of [`phasestereo_match::refinement::speckles::flag_speckles`]: each region is
/// walked from each of its pixels, until it is too large.
pub fn flag_speckles(disparity: &Plane<f32>, flags: &Plane<u16>, (size, range): (usize, f32)) -> Plane<u16> {
    let (rows, cols) = (disparity.rows(), disparity.cols());

    let region = |y: usize, x: usize| {
        let mut region = vec![(y, x)];
        let mut next = 0;
        let mut seen = disparity.map(|_| false);
        seen.row_mut(y)[x] = true;

        // A flood fill; it stops as soon as the region is too large for a speckle.
        while let Some(&(y, x)) = region.get(next)
            && region.len() <= size
        {
            let beside = [(y.wrapping_sub(1), x), (y + 1, x), (y, x.wrapping_sub(1)), (y, x + 1)];
            for (v, u) in beside.into_iter().filter(|&(v, u)| v < rows && u < cols) {
                let is_connected = (disparity.row(v)[u] - disparity.row(y)[x]).abs() <= range;
                let is_new = !seen.row(v)[u] && trusted(disparity, flags, v, u).is_some();
                if is_connected && is_new {
                    seen.row_mut(v)[u] = true;
                    region.push((v, u));
                }
            }

            next += 1;
        }

        region.len()
    };

    Plane::from_fn(rows, cols, |y, x| {
        let is_speckle = trusted(disparity, flags, y, x).is_some() && region(y, x) <= size;
        flags.row(y)[x] | if is_speckle { flag::SPECKLE } else { 0 }
    })
}

/// The disparity of a pixel, if it is trusted.
fn trusted(disparity: &Plane<f32>, flags: &Plane<u16>, y: usize, x: usize) -> Option<f32> {
    let value = disparity.row(y)[x];
    (flags.row(y)[x] & flag::UNTRUSTED == 0 && !value.is_nan()).then_some(value)
}

/// Reference implementation of [`phasestereo_match::refinement::filling::fill`]: each pixel looks for its
/// neighbors by itself. Disparity and flags.
pub fn fill(disparity: &Plane<f32>, flags: &Plane<u16>) -> (Plane<f32>, Plane<u16>) {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let trusted = |y, x| trusted(disparity, flags, y, x);

    let filling = |y: usize, x: usize| {
        // The row itself, if it has a trusted pixel; else the nearest row that has one (ties: above).
        let seeded = (0..rows).filter(|&row| (0..cols).any(|col| trusted(row, col).is_some()));
        let from = seeded.min_by_key(|row| (row.abs_diff(y), *row))?;
        if from.abs_diff(y) > 32 {
            return None;
        }

        let before = (0..=x).rev().find_map(|col| trusted(from, col));
        let after = (x..cols).find_map(|col| trusted(from, col));
        before.into_iter().chain(after).reduce(f32::min)
    };

    let is_masked = |y: usize, x: usize| flags.row(y)[x] & flag::MASKED != 0;

    let filled = Plane::from_fn(rows, cols, |y, x| match (trusted(y, x), filling(y, x)) {
        (Some(value), _) => value,
        _ if is_masked(y, x) => f32::NAN,
        (None, Some(value)) => value,
        (None, None) => disparity.row(y)[x],
    });

    let flags = Plane::from_fn(rows, cols, |y, x| {
        let is_filled = trusted(y, x).is_none() && !is_masked(y, x) && filling(y, x).is_some();
        flags.row(y)[x] | if is_filled { flag::FILLED } else { 0 }
    });

    (filled, flags)
}

/// Reference implementation of [`phasestereo_match::refinement::median::smooth`]: the nine values sorted.
pub fn smooth(disparity: &Plane<f32>) -> Plane<f32> {
    let near = |at: usize, length: usize| {
        [-1, 0, 1].map(|step| (at as isize + step).clamp(0, length as isize - 1) as usize)
    };

    Plane::from_fn(disparity.rows(), disparity.cols(), |y, x| {
        let center = disparity.row(y)[x];
        let rows = near(y, disparity.rows()).map(|row| disparity.row(row));
        let window = rows.map(|row| near(x, disparity.cols()).map(|col| row[col]));

        let mut values = window.as_flattened().to_vec();
        values.iter_mut().filter(|value| value.is_nan()).for_each(|value| *value = center);
        values.sort_by(f32::total_cmp);

        if center.is_nan() { center } else { values[4] }
    })
}

/// Codes of gray values of a side (0: left, 1: right), under a kernel if given.
pub type Describe<'a> = dyn Fn(usize, &Plane<i32>, Option<&Kernel>) -> Plane<u64> + 'a;

/// The inputs of [`synthesize`].
#[derive(Clone, Copy)]
pub struct Soft<'a> {
    /// Gray values.
    pub grays: [&'a Plane<i32>; 2],
    /// Their masks.
    pub valid: [&'a Mask; 2],
    /// Class of each left pixel.
    pub classes: &'a Plane<usize>,
    /// The kernels of the classes, for the left and the right image.
    pub kernels: &'a [[Option<Kernel>; 2]],
    /// Codes of gray values of a side, under a kernel if given.
    pub codes: &'a Describe<'a>,
    /// Steps of left gray values per step of the right ones, and their largest magnitude.
    pub left: (f64, i64),
}

/// Reference implementation of [`phasestereo_match::refinement::synthesis::BlurredPair::redraw`]: the whole
/// image under all kernels, by each of the three maps.
pub fn synthesize(disparity: &Plane<f32>, soft: Soft) -> Plane<f32> {
    // Sums over windows, by each map; for a soft left image, all classes share one view.
    let maps = [disparity.clone(), rival(disparity, false), rival(disparity, true)];
    let side_of = |class: usize| softness(&soft.kernels[class]).map(|(side, _)| side);

    let left = maps.each_ref().map(|map| {
        let distances: Vec<_> = (0..soft.kernels.len()).map(|c| distances(map, soft, 0, c)).collect();

        let of_class = |y: usize, x: usize| distances[soft.classes.row(y)[x]].as_ref();
        let all = Plane::from_fn(map.rows(), map.cols(), |y, x| {
            of_class(y, x).map_or(0, |distances| distances.row(y)[x])
        });

        windows(&all)
    });

    let right: Vec<_> = (0..soft.kernels.len())
        .map(|c| maps.each_ref().map(|map| distances(map, soft, 1, c).map(|all| windows(&all))))
        .collect();

    Plane::from_fn(disparity.rows(), disparity.cols(), |y, x| {
        let here = maps.each_ref().map(|map| map.row(y)[x]);
        let class = soft.classes.row(y)[x];
        // All maps are judged at the same places: those of the extreme disparities.
        let whole = here.map(whole);
        let places = [whole.into_iter().max(), whole.into_iter().min()];
        let place = |disparity: Option<i64>| beside(x, -disparity.unwrap_or(0), maps[0].cols());

        let unlike = |map: usize| match side_of(class) {
            Some(0) => left[map].row(y)[x],
            Some(_) => {
                let sums = right[class][map].as_ref().map_or(&[][..], |sums| sums.row(y));
                places.into_iter().map(|at| sums[place(at)]).sum()
            }
            None => 0,
        };

        let best = (0..maps.len()).min_by_key(|map| (unlike(*map), *map));
        here[best.unwrap_or(0)]
    })
}

/// The side that is soft, and its blur: the other one is blurred to become like it.
fn softness(kernels: &[Option<Kernel>; 2]) -> Option<(usize, &Kernel)> {
    match (&kernels[0], &kernels[1]) {
        (None, Some(blur)) => Some((0, blur)),
        (Some(blur), None) => Some((1, blur)),
        _ => None,
    }
}

/// The smallest or the largest disparity around each pixel, unless it counts as the same as its own.
fn rival(disparity: &Plane<f32>, is_largest: bool) -> Plane<f32> {
    let around = |at: usize, length: usize| at.saturating_sub(4)..(at + 5).min(length);

    Plane::from_fn(disparity.rows(), disparity.cols(), |y, x| {
        let own = disparity.row(y)[x];

        let rows = around(y, disparity.rows()).map(|row| &disparity.row(row)[around(x, disparity.cols())]);
        let mut known: Vec<f32> = rows.flatten().copied().filter(|value| !value.is_nan()).collect();
        known.sort_by(f32::total_cmp);

        let found = if is_largest { known.last() } else { known.first() }.copied();
        found.filter(|found| (found - own).abs() > 0.5).unwrap_or(own)
    })
}

/// A disparity in whole pixels; 0 elsewhere.
fn whole(disparity: f32) -> i64 {
    if disparity.is_nan() { 0 } else { disparity.round_ties_even() as i64 }
}

/// The column `by` to the right, clamped into the image.
fn beside(x: usize, by: i64, cols: usize) -> usize {
    (x as i64 + by).clamp(0, cols as i64 - 1) as usize
}

/// Hamming distances between a soft side and its expected image by a map, for one class; `None`: this class
/// is not soft there.
fn distances(map: &Plane<f32>, soft: Soft, side: usize, class: usize) -> Option<Plane<u32>> {
    let (_, blur) = softness(&soft.kernels[class]).filter(|(which, _)| *which == side)?;

    let shown = if side == 0 {
        Plane::from_fn(map.rows(), map.cols(), |y, x| {
            soft.grays[1].row(y)[beside(x, -whole(map.row(y)[x]), map.cols())]
        })
    } else {
        let rows: Vec<_> = (0..map.rows()).map(|y| from_right(map.row(y), soft, y)).collect();
        Plane::from_fn(map.rows(), map.cols(), |y, x| rows[y][x])
    };

    let synthetic = (soft.codes)(1 - side, &shown, Some(blur));
    let there = (soft.codes)(side, soft.grays[side], None);

    Some(Plane::from_fn(map.rows(), map.cols(), |y, x| {
        let bits = (synthetic.row(y)[x] ^ there.row(y)[x]).count_ones();
        if soft.valid[side].row(y)[x] { bits } else { 0 }
    }))
}

/// A row of the left image as the right view shows it.
fn from_right(map: &[f32], soft: Soft, y: usize) -> Vec<i32> {
    let (left, right) = (soft.grays[0].row(y), soft.grays[1].row(y));
    let cols = map.len();

    // The disparity of each pixel of the right view: the largest that leads to it, else the larger one beside
    // it.
    let hits = |at: usize| (0..cols).filter(move |&x| x as i64 - whole(map[x]) == at as i64);
    let nearest: Vec<_> = (0..cols).map(|at| hits(at).map(|x| whole(map[x])).max()).collect();
    let at = |x: Option<usize>| nearest.get(x?).copied().flatten();
    let seen = |x: usize| {
        let around = at(x.checked_sub(1)).zip(at(Some(x + 1)));
        nearest[x].or(around.map(|(before, after)| before.max(after)))
    };

    let shown = |x: usize| seen(x).map(|disparity| i64::from(left[beside(x, disparity, cols)]));
    let own = |x: usize| i64::from((f64::from(right[x]) * soft.left.0).round() as i32);

    // In a gap, the right image, made as bright as the left one beside it.
    let gray = |x: usize| {
        let start = (0..x).rev().find(|x| seen(*x).is_some()).map_or(0, |x| x + 1);
        let end = (x..cols).find(|x| seen(*x).is_some()).unwrap_or(cols);
        let near = |other: &usize| start.saturating_sub(16) <= *other && *other < end + 16;

        let brighter: Vec<_> = (0..cols).filter(near).filter_map(|x| Some(shown(x)? - own(x))).collect();
        let mean = brighter.iter().sum::<i64>().div_euclid(brighter.len().max(1) as i64);
        (own(x) + mean).clamp(-soft.left.1, soft.left.1)
    };

    (0..cols).map(|x| shown(x).unwrap_or_else(|| gray(x)) as i32).collect()
}

/// Sums over windows, within the image.
fn windows(values: &Plane<u32>) -> Plane<u32> {
    let around = |at: usize, length: usize| at.saturating_sub(7)..(at + 8).min(length);

    Plane::from_fn(values.rows(), values.cols(), |y, x| {
        let rows = around(y, values.rows()).map(|row| &values.row(row)[around(x, values.cols())]);
        rows.flatten().sum()
    })
}

/// Reference implementation of [`phasestereo_match::refinement::guided_median::GuidedMedian::filter`]: the
/// weighted values sorted. The narrow median covers 5 x 5 pixels two apart, wide ones 7 x 7 three apart.
pub fn guided_median(disparity: &Plane<f32>, gray: &Plane<i32>, is_wide: bool) -> Plane<f32> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let differences = (0..rows).flat_map(|y| gray.row(y).windows(2));
    let sum: i64 = differences.map(|pair| (i64::from(pair[0]) - i64::from(pair[1])).abs()).sum();
    let roughness = (sum as f64 / (rows * (cols - 1)).max(1) as f64).max(0.0625);

    let (reach, stride, around_jumps) = if is_wide { (9, 3, 8) } else { (4, 2, 4) };
    let scale = (if is_wide { 15.9375 } else { 32.0 } / roughness) as f32;
    let level = |y: usize, x: usize| (gray.row(y)[x] as f32 * scale).clamp(-16_383.0, 16_383.0) as i32;
    let steps = |y: usize, x: usize| (disparity.row(y)[x] * 8.0) as i32;

    let weight = |difference: u32, [down, along]: [usize; 2]| {
        if !is_wide {
            return u32::from(difference <= 32);
        }
        let square: f64 = (down * down + along * along) as f64;
        let nearness = (256.0 * exp(-square / 72.0)).round().min(255.0) as u32;
        (255u32.saturating_sub(difference) * nearness) >> 8
    };

    let is_jump = |y: usize, x: usize| {
        let beside = [(y + 1, x), (y, x + 1)].into_iter().filter(|&(v, u)| v < rows && u < cols);
        let mut steps = beside.map(|(v, u)| (disparity.row(v)[u] - disparity.row(y)[x]).abs());
        steps.any(|step| step > 1.0)
    };
    let jumps = Plane::from_fn(rows, cols, is_jump);

    let window = |at: usize, by: usize, length: usize| at.saturating_sub(by)..(at + by + 1).min(length);
    let places = move |y: usize, x: usize, by: usize| {
        window(y, by, rows).flat_map(move |v| window(x, by, cols).map(move |u| (v, u)))
    };

    Plane::from_fn(rows, cols, |y, x| {
        let own = disparity.row(y)[x];
        if own.is_nan() || !places(y, x, around_jumps).any(|(v, u)| jumps.row(v)[u]) {
            return own;
        }

        let counts = places(y, x, reach).filter(|&(v, u)| {
            v.abs_diff(y) % stride + u.abs_diff(x) % stride == 0 && !disparity.row(v)[u].is_nan()
        });

        let mut values: Vec<(i32, u32)> = counts
            .map(|(v, u)| {
                let away = steps(v, u).wrapping_sub(steps(y, x)).clamp(-32_768, 32_767);
                let difference = level(v, u).abs_diff(level(y, x));
                (away, weight(difference, [v.abs_diff(y), u.abs_diff(x)]))
            })
            .collect();

        values.sort_unstable();
        let total: u32 = values.iter().map(|(_, weight)| weight).sum();

        let mut below = 0;
        let is_middle = |(_, weight): &&(i32, u32)| {
            below += weight;
            2 * below >= total
        };

        // The smallest value up to which there is at least half of the weight.
        let median = values.iter().find(is_middle).map_or(0, |(away, _)| *away);

        if median == 0 { own } else { own + median as f32 / 8.0 }
    })
}

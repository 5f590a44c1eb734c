//! The naive twin of every stage: the same signature, written so that it can be checked by reading.
//!
//! Slow on purpose. The tests hold the fast stages to these, bit for bit.

use crate::aggregation::Window;
use crate::basis::Basis;
use crate::candidates::Candidates;
use crate::confidence::{RADIUS, STEP, Scene, TOLERANCE, confidence, similar};
use crate::convolution::{GUARD, Kernel, SHIFT, Weights};
use crate::intensity::LEVEL_STEPS;
use crate::normalisation::DEVIATION_STEPS;
use crate::plane::{Plane, reflect};
use crate::quantiser::Quantiser;
use crate::scanline::Steps;
use crate::settings::{Rule, Settings};
use crate::subpixel::REACH;
use crate::view::Mask;

/// Twin of [`crate::masking::fill_masked`]: for every masked pixel the whole row is searched, then, for
/// rows without a valid pixel, the whole column of rows.
pub fn fill_masked(plane: &Plane<i32>, mask: &Mask) -> Plane<i32> {
    let (rows, cols) = (plane.rows(), plane.cols());
    let is_seeded = |y: &usize| mask.row(*y).contains(&true);
    Plane::from_fn(rows, cols, |y, x| {
        let Some(from) = (0..rows).filter(is_seeded).min_by_key(|row| (row.abs_diff(y), *row))
        else {
            return 0;
        };
        let valid = (0..cols).filter(|&col| mask.row(from)[col]);
        let nearest = valid.min_by_key(|col| (col.abs_diff(x), *col));
        nearest.map_or(0, |col| plane.row(from)[col])
    })
}

/// Twin of [`crate::normalisation::normalise`]: mean and variance of each window by themselves.
pub fn normalise(plane: &Plane<u16>, window: usize) -> Plane<u16> {
    let (radius, count) = ((window / 2) as isize, (window * window) as i64);
    Plane::from_fn(plane.rows(), plane.cols(), |y, x| {
        let (mut sum, mut squares) = (0i64, 0i64);
        for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx)))
        {
            let (row, col) = (y as isize + dy, x as isize + dx);
            let value = plane.row(reflect(row, plane.rows()))[reflect(col, plane.cols())];
            (sum, squares) = (sum + i64::from(value), squares + i64::from(value).pow(2));
        }
        let one_gray_level = (count * i64::from(LEVEL_STEPS)).pow(2);
        let variance = (count * squares - sum * sum + one_gray_level) as f64;
        let deviations = (count * i64::from(plane.row(y)[x]) - sum) as f64 / variance.sqrt();
        ((deviations.clamp(-16.0, 16.0) + 16.0) * f64::from(DEVIATION_STEPS)).round() as u16
    })
}

/// Twin of [`crate::convolution::convolve`]: every sum by itself, one whole pass after the other.
pub fn convolve(gray: &Plane<i32>, kernel: &Kernel, fraction: u32) -> Plane<i32> {
    let pass = |values: &Plane<i32>, weights: &Plane<i32>, dropped: u32| {
        let unit = 1 << dropped;
        let rounded = |y, x| (weighted_sum(values, weights, y, x) + unit / 2).div_euclid(unit);
        Plane::from_fn(values.rows(), values.cols(), |y, x| rounded(y, x) as i32)
    };
    match kernel.weights() {
        Weights::All(weights) => pass(gray, weights, SHIFT - fraction),
        Weights::Factors { column, row } => {
            pass(&pass(gray, column, SHIFT - fraction - GUARD), row, SHIFT + GUARD)
        }
    }
}

fn weighted_sum(values: &Plane<i32>, weights: &Plane<i32>, y: usize, x: usize) -> i64 {
    let (down, across) = ((weights.rows() / 2) as isize, (weights.cols() / 2) as isize);
    let mut sum = 0;
    for dy in -down..=down {
        let row = values.row(reflect(y as isize - dy, values.rows()));
        for dx in -across..=across {
            let weight = weights.row((dy + down) as usize)[(dx + across) as usize];
            sum += i64::from(weight) * i64::from(row[reflect(x as isize - dx, values.cols())]);
        }
    }
    sum
}

/// Twin of [`crate::descriptor::describe`]: every component by its double sum. Parts of components up to
/// `threshold` are weak, if there is a weak level.
pub fn describe(gray: &Plane<i32>, settings: &Settings, threshold: f64) -> Plane<u64> {
    let (basis, mut quantiser) = (Basis::new(settings), Quantiser::new(settings));
    if settings.has_weak() {
        quantiser = quantiser.with_weak_level(threshold);
    }
    let radius = basis.radius() as isize;
    let tap = |f: isize, j: isize| {
        let (filter, distance) = (&basis.filters()[f.unsigned_abs()], j.unsigned_abs());
        let imaginary =
            i64::from(filter.odd[distance]) * j.signum() as i64 * if f < 0 { -1 } else { 1 };
        (i64::from(filter.even[distance]), imaginary)
    };
    Plane::from_fn(gray.rows(), gray.cols(), |y, x| {
        let mut code = 0;
        for (c, component) in basis.components().into_iter().enumerate() {
            let (mut re, mut im) = (0, 0);
            for (dy, dx) in
                (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx)))
            {
                let (row, col) = (y as isize + dy, x as isize + dx);
                let pixel = gray.row(reflect(row, gray.rows()))[reflect(col, gray.cols())];
                let ((a, b), (c, d)) = (tap(component.u as isize, dx), tap(component.v, dy));
                re += (a * c - b * d) * i64::from(pixel);
                im += (a * d + b * c) * i64::from(pixel);
            }
            code |= quantiser.code(re, im) << (c * quantiser.code_length());
        }
        code
    })
}

/// Twin of [`crate::cost::Operands::write_costs`] for phase codes: every bit compared by itself, over the whole
/// image.
pub fn phase_costs(left: &Plane<u64>, right: &Plane<u64>, candidates: Candidates) -> Plane<u16> {
    let (rows, cols, count) = (left.rows(), left.cols(), candidates.count());
    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let (a, b) = (left.row(y)[x], right.row(y)[candidates.column(x, k, cols)]);
        (0..64).filter(|bit| a >> bit & 1 != b >> bit & 1).count() as u16
    })
}

/// Twin of [`crate::cost::Operands::write_costs`] for absolute differences.
pub fn absolute_differences(
    left: &[Plane<u16>],
    right: &[Plane<u16>],
    candidates: Candidates,
) -> Plane<u16> {
    let (rows, cols, count) = (left[0].rows(), left[0].cols(), candidates.count());
    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let column = candidates.column(x, k, cols);
        left.iter().zip(right).map(|(l, r)| l.row(y)[x].abs_diff(r.row(y)[column])).sum()
    })
}

/// Twin of [`crate::aggregation::Aggregator`]: each window summed by itself, over the whole image.
pub fn aggregate(costs: &Plane<u16>, votes: &Plane<u16>, window: Window) -> Plane<u32> {
    let count = window.candidates;
    let boxes = Plane::from_fn(window.rows, window.cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let votes = box_sum(votes, Window { dropped: 0, ..window }, y, x, k);
        window.share(box_sum(costs, window, y, x, k), votes) as u32
    });
    if !window.shiftable {
        return boxes;
    }
    let radius = window.radius();
    Plane::from_fn(window.rows, window.cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let (top, bottom) = (y.saturating_sub(radius), (y + radius).min(window.rows - 1));
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(window.cols - 1));
        let centres = [(y, x), (top, x), (bottom, x), (y, left), (y, right)];
        centres.map(|(y, x)| boxes.row(y)[x * count + k]).into_iter().fold(u32::MAX, u32::min)
    })
}

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

/// Twin of [`crate::scanline::Scanline`]: every origin of every state is tried.
pub fn optimize(costs: &[u32], candidates: usize, rule: Rule, steps: Steps) -> Vec<u16> {
    let mut totals = vec![0u64; candidates];
    let mut origins: Vec<Vec<usize>> = Vec::new();
    for costs in costs.chunks(candidates) {
        let best: Vec<(u64, usize)> = (0..candidates)
            .map(|to| {
                let ways = ways(&totals, to, rule, steps);
                ways.into_iter().min_by_key(|(total, _)| *total).unwrap_or((u64::MAX, to))
            })
            .collect();
        totals =
            best.iter().zip(costs).map(|((total, _), &cost)| total + u64::from(cost)).collect();
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

/// What it takes to come to `to`, and from where: of equal ones the first counts.
fn ways(totals: &[u64], to: usize, rule: Rule, steps: Steps) -> Vec<(u64, usize)> {
    let from = |from: usize, penalty: u64| (totals[from] + penalty, from);
    let mut ways = vec![from(to, 0)];
    let smaller = to.checked_sub(1);
    ways.extend(smaller.map(|smaller| from(smaller, steps.near)));
    match rule {
        Rule::DynamicProgramming => {
            ways.extend((to + 1..totals.len()).map(|larger| from(larger, steps.far)));
        }
        Rule::ScanlineOptimization => {
            ways.extend((to + 1..totals.len()).take(1).map(|larger| from(larger, steps.near)));
            ways.push(from(least(totals), steps.far));
        }
        // From the least, at no cost: then each pixel takes its own.
        Rule::WinnerTakesAll => ways = vec![(0, least(totals))],
    }
    ways
}

fn least<T: Ord + Copy>(values: &[T]) -> usize {
    let mut best = 0;
    for (index, value) in values.iter().enumerate() {
        if *value < values[best] {
            best = index;
        }
    }
    best
}

/// Twin of [`crate::subpixel::offset`]: the tip of a V, moved away from the candidate.
pub fn offset(below: u32, own: u32, above: u32) -> f64 {
    let [below, own, above] = [below, own, above].map(f64::from);
    let slope = (below - own).max(above - own).max(1.0);
    let tip = ((below - above) / (2.0 * slope)).clamp(-0.5, 0.5);
    tip * (1.0 + 0.6 * (1.0 - 2.0 * tip.abs()))
}

/// Twin of [`crate::subpixel::smooth`]: every pair of neighbours asked for by itself.
pub fn smooth(disparity: &Plane<f32>) -> Plane<f32> {
    let (rows, cols, reach) = (disparity.rows(), disparity.cols(), REACH as isize);
    let at = |y: usize, x: usize, dy: isize, dx: isize| {
        let (y, x) = (y.checked_add_signed(dy)?, x.checked_add_signed(dx)?);
        (y < rows && x < cols).then(|| disparity.row(y)[x])
    };
    let pairs = (0..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dy, dx)));
    let pairs: Vec<(isize, isize)> = pairs.filter(|pair| *pair > (0, 0)).collect();
    Plane::from_fn(rows, cols, |y, x| {
        let own = disparity.row(y)[x];
        let (mut sum, mut count) = (0.0, 1.0);
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

/// Twin of the fit of a blur to the powers of two blocks, `[blurred, sharp]` like the noise; `weights` are those
/// of all bins and those by which gains are found. Returns loss and gain.
pub fn blur_fit(
    [blurred, sharp]: [Vec<f64>; 2],
    noise: [f64; 2],
    response: &[f64],
    [weights, low]: [Vec<f64>; 2],
) -> (f64, f64) {
    let bins = 0..blurred.len();
    let signal = |power: f64, noise: f64| (power - noise).max(0.02 * power);
    let quotient = |bin: usize| {
        let there = response[bin] * signal(sharp[bin], noise[1]);
        (signal(blurred[bin], noise[0]) / there).ln()
    };
    let log_gain: f64 = bins.clone().map(|bin| low[bin] * quotient(bin)).sum();
    let gain = log_gain.clamp(-20.0, 20.0).exp();
    let there = |bin: usize| gain * response[bin] * signal(sharp[bin], noise[1]);
    let residual = |bin: usize| (blurred[bin] / (there(bin) + noise[0])).ln();
    let trust = |bin: usize| weights[bin] * there(bin) / (there(bin) + noise[0]);
    let pull: f64 = bins.clone().map(|bin| trust(bin) * residual(bin).clamp(-2.0, 2.0)).sum();
    let trusted: f64 = bins.clone().map(trust).sum();
    let correction = (pull / trusted.max(1e-9)).clamp(-1.0, 1.0);
    let left =
        |bin: usize| (residual(bin) - trust(bin) / weights[bin].max(1e-300) * correction).abs();
    let loss = bins.map(|bin| weights[bin] * left(bin).min(2.0)).sum();
    (loss, gain * correction.exp())
}

/// Twin of [`Scene::confidences`]: each pixel asks those around it.
pub fn confidences(scene: Scene) -> Plane<f32> {
    let (rows, cols) = (scene.disparity.rows(), scene.disparity.cols());
    let similar = similar(scene.gray);
    let around = |here: usize, length: usize| {
        (0..length).filter(move |there| {
            let away = here.abs_diff(*there);
            away <= RADIUS && away.is_multiple_of(STEP)
        })
    };
    Plane::from_fn(rows, cols, |y, x| {
        let own = scene.disparity.row(y)[x];
        if own.is_nan() {
            return 0.0;
        }
        let (mut weight, mut votes) = (0.0, 0.0);
        for (row, col) in around(y, rows).flat_map(|row| around(x, cols).map(move |col| (row, col)))
        {
            let other = scene.disparity.row(row)[col];
            let difference = (scene.gray.row(y)[x] - scene.gray.row(row)[col]) as f32;
            let alike = similar / (similar + difference * difference);
            if !other.is_nan() {
                weight += alike;
            }
            if (own - other).abs() <= TOLERANCE {
                votes += alike * scene.votes.row(row)[col];
            }
        }
        confidence(votes / weight)
    })
}

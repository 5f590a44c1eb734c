//! The naive twin of every stage: the same signature, written so that it can be checked by reading.
//!
//! Slow on purpose. The tests hold the fast stages to these, bit for bit.

use crate::aggregation::Window;
use crate::basis::Basis;
use crate::candidates::Candidates;
use crate::intensity::LEVEL_STEPS;
use crate::normalisation::DEVIATION_STEPS;
use crate::plane::{Plane, reflect};
use crate::quantiser::Quantiser;
use crate::scanline::Steps;
use crate::settings::Settings;
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

/// Twin of [`crate::descriptor::describe`]: every component by its double sum.
pub fn describe(gray: &Plane<i32>, settings: &Settings) -> Plane<u64> {
    let (basis, quantiser) = (Basis::new(settings), Quantiser::new(settings));
    let radius = basis.radius() as isize;
    Plane::from_fn(gray.rows(), gray.cols(), |y, x| {
        let mut code = 0;
        for (c, &component) in basis.components().iter().enumerate() {
            let (mut re, mut im) = (0i128, 0i128);
            for (dy, dx) in
                (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx)))
            {
                let (row, col) = (y as isize + dy, x as isize + dx);
                let pixel = gray.row(reflect(row, gray.rows()))[reflect(col, gray.cols())];
                let along = basis.filter(component.u as isize, col, dx);
                let (a, b) = along.times(basis.filter(component.v, row, dy));
                (re, im) = (re + a * i128::from(pixel), im + b * i128::from(pixel));
            }
            let rotation = basis.rotations()[basis.rotation_index(component, x, y)];
            let (a, b) = (i128::from(rotation.re), i128::from(rotation.im));
            code |=
                quantiser.code(re * a - im * b, re * b + im * a) << (c * quantiser.code_length());
        }
        code
    })
}

/// Twin of [`crate::cost::Costs::write_row`] for phase codes: every bit compared by itself, over the whole image.
pub fn phase_costs(left: &Plane<u64>, right: &Plane<u64>, candidates: Candidates) -> Plane<u16> {
    let (rows, cols, count) = (left.rows(), left.cols(), candidates.count());
    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        let (a, b) = (left.row(y)[x], right.row(y)[candidates.column(x, k, cols)]);
        (0..64).filter(|bit| a >> bit & 1 != b >> bit & 1).count() as u16
    })
}

/// Twin of [`crate::cost::Costs::write_row`] for absolute differences.
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
        window.share(box_sum(costs, window, y, x, k), box_sum(votes, window, y, x, k))
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

fn box_sum(volume: &Plane<u16>, window: Window, y: usize, x: usize, k: usize) -> u32 {
    let radius = window.radius() as isize;
    let mut sum = 0;
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let row = (y as isize + dy).clamp(0, window.rows as isize - 1) as usize;
            let col = (x as isize + dx).clamp(0, window.cols as isize - 1) as usize;
            sum += u32::from(volume.row(row)[col * window.candidates + k]);
        }
    }
    sum
}

/// Twin of [`crate::scanline::Scanline`]'s dynamic programming: every origin of every state is tried.
pub fn dynamic_programming(costs: &[u32], candidates: usize, steps: Steps) -> Vec<u16> {
    let mut totals: Vec<u64> = costs[..candidates].iter().map(|&cost| cost.into()).collect();
    let mut origins = Vec::new();
    for costs in costs.chunks(candidates).skip(1) {
        let best: Vec<(u64, usize)> = (0..candidates)
            .map(|to| {
                // Staying comes first, so that it wins ties; then the origins in rising order.
                let tried = std::iter::once(to).chain(0..candidates);
                let total = |from: usize| match from {
                    _ if from == to => Some(totals[from]),
                    _ if from + 1 == to => Some(totals[from] + steps.rise),
                    _ if from > to => Some(totals[from] + steps.drop),
                    _ => None,
                };
                let paths = tried.filter_map(|from| total(from).map(|total| (total, from)));
                paths.min_by_key(|(total, _)| *total).unwrap_or((u64::MAX, to))
            })
            .collect();
        totals =
            best.iter().zip(costs).map(|((total, _), &cost)| total + u64::from(cost)).collect();
        origins.push(best.into_iter().map(|(_, from)| from).collect::<Vec<_>>());
    }
    let mut index = least(&totals);
    let mut chosen = vec![index as u16];
    for origins in origins.iter().rev() {
        index = origins[index];
        chosen.push(index as u16);
    }
    chosen.reverse();
    chosen
}

/// Twin of [`crate::scanline::Scanline`]'s winner-takes-all.
pub fn winner_takes_all(costs: &[u32], candidates: usize) -> Vec<u16> {
    costs.chunks(candidates).map(|costs| least(costs) as u16).collect()
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

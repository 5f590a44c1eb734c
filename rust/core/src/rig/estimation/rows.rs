//! How the rows of a pair correspond: a smooth field of vertical offsets, fitted to blocks that were found in both
//! images.
//!
//! Blocks mislead where the images do not show the same, at jumps in depth above all. So the fit is by iteratively
//! reweighted least squares, first of absolute deviations, then with Tukey's biweight. Blocks are followed from the
//! reduced copies, which withstand blur and noise, to the whole images, which are exact; the fit with the least
//! standard error is kept. The field is linear unless keystone and distortion explain much more.

use std::array::from_fn;

use super::overview::{GOOD_CONFIDENCE, Overview, RoughMap};
use super::tracks::{BLOCK, Seed, Track, follow};
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::math;
use crate::pipeline::runtime::Runtime;
use crate::rig::alignment::{Alignment, CUBIC, LINEAR, TERMS, places, terms};
use crate::rig::blur::parts::PairRows;

/// Number of blocks that are followed.
const BLOCKS: usize = 400;
/// Fewest blocks to fit a field to.
const LEAST_BLOCKS: usize = 24;
/// Fewest blocks to fit a field with all terms to.
const ENOUGH_BLOCKS: usize = 60;
/// Fields with a larger standard error, pixels, are not used.
const LARGEST_ERROR: f64 = 0.5;
/// Times that the rough match is repeated with the last field; rows that were far off come nearer each time.
const ROUNDS: usize = 3;
/// Vertical offsets, in rows of the copy, that a rough match withstands.
const TOLERATED: f64 = 0.4;
/// ... and those with which it is about the same: confidences of 36 pairs with rows up to 1 px off change by 0.002 on
/// average, and by 0.006 at most.
const HARDLY: f64 = 0.25;
/// All terms are used if their field differs from the linear one by so many standard errors,
const RICHER: f64 = 2.0;
/// ... each of which is at least so many pixels.
const LEAST_RICHER: f64 = 0.02;
/// Reweightings, and how many of them are for absolute deviations.
const STEPS: (usize, usize) = (20, 6);
/// Residuals beyond so many robust standard deviations have no weight.
const CUT: f64 = 4.0;
/// Least robust standard deviation: no correlation is more exact, pixels.
const FLOOR: f64 = 0.02;
/// Error that no averaging over blocks removes, as a share of a pixel of the copy.
const BIAS: f64 = 0.02;
/// Largest ratio of the pivots of the normal equations: beyond it, the blocks lie along a line.
const LARGEST_CONDITION: f64 = 1e6;
/// Bands of rows over which blocks may wobble together.
const BANDS: usize = 12;
/// Fewest blocks in a band, of either half of them.
const LEAST_IN_BAND: usize = 3;
/// Blocks wobble together where the bands of one half of them leave at most this share of the residuals of the other half.
const EXPLAINED: f64 = 0.75;
/// Offsets below this, pixels root mean square, are ignored: on 12 aligned scenes up to 0.05 are found.
const LEAST_RMS: f64 = 0.12;
/// ... and so are offsets of fewer standard errors than this.
const LEAST_ERRORS: f64 = 2.0;

/// Lens distortion is named from so many pixels on, and so many standard errors: of 10 pairs without any up to 2.6.
pub const DISTORTED: (f64, f64) = (2.0, 3.0);

/// The vertical offsets of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct RowOffsets {
    /// The vertical offset at every place.
    pub field: Alignment,
    /// Its standard error, root mean square over the image, pixels.
    pub error: f64,
    /// Number of blocks that agree with it.
    pub blocks: usize,
    /// Robust standard deviation of the blocks from it, pixels.
    pub spread: f64,
    /// What of this the rows have in common, as where a rolling shutter shakes: root mean square over the rows, pixels; 0
    /// where the blocks of a row scatter each by itself.
    pub wobble: f64,
}

impl RowOffsets {
    /// The largest offset at a border by the terms that lens distortion alone has, pixels, if it is large and clearly larger than its
    /// own error.
    pub fn distortion(&self) -> Option<f64> {
        let terms = &self.field.coefficients()[CUBIC..];
        let most = terms.iter().fold(0.0f64, |most, value| most.max(value.abs()));
        (most >= DISTORTED.0.max(DISTORTED.1 * self.error)).then_some(most)
    }

    /// Whether the offsets are too large to be an error of the estimate.
    pub fn is_significant(&self) -> bool {
        let rms = self.field.rms();
        rms > LEAST_RMS && rms > LEAST_ERRORS * self.error
    }
}

/// What is found out about the rows of a pair.
pub struct FoundRows {
    /// The offsets; `None` where there is too little texture or too little in common.
    pub offsets: Option<RowOffsets>,
    /// The last rough match on the way to them, if there was another one.
    pub map: Option<RoughMap>,
}

/// Estimates the field of a pair from a rough match of the unaligned pair.
pub fn offsets(
    rows: PairRows,
    overview: &Overview,
    rough: &RoughMap,
    candidates: Option<Candidates>,
    runtime: Runtime,
) -> Result<FoundRows> {
    let mut map = None;
    let found = first(rows, overview, rough, &mut map, candidates, runtime)?;
    let Some((mut fit, mut tracks)) = found else {
        return Ok(FoundRows { offsets: None, map });
    };
    let mut fits = vec![];
    let mut factor = overview.factor;
    let mut most = tracks.len();

    // Coarse to fine: each field places the blocks in copies four times as large.
    loop {
        fits.push(fit.clone());
        if factor == 1 {
            break;
        }

        factor = (factor / 4).max(1);
        let seed = |track: &Track| {
            let Seed { x, y, dx, .. } = track.place;
            Seed { x, y, dx, dy: fit.field.at(x + dx, y) }
        };
        let seeds: Vec<Seed> = tracks.iter().map(seed).collect();

        tracks = follow(rows, overview, &seeds, factor, runtime)?;
        most = most.max(tracks.len());
        match fitted(&tracks, rows.size(), spacing(overview), factor, most) {
            Some(found) => fit = found,
            None => break,
        }
    }

    let best = fits.into_iter().filter(|fit| fit.error < LARGEST_ERROR);
    Ok(FoundRows { offsets: best.min_by(|a, b| a.error.total_cmp(&b.error)), map })
}

/// Whether a rough match hardly changes if its rows are straightened by a field.
pub fn is_straight(overview: &Overview, map: &RoughMap, field: &Alignment) -> bool {
    difference(field, map.field.as_ref()) < HARDLY * overview.factor as f64
}

/// The field in the reduced copies, and the blocks that it was fitted to. Further rough matches go into `map`.
fn first(
    rows: PairRows,
    overview: &Overview,
    rough: &RoughMap,
    map: &mut Option<RoughMap>,
    candidates: Option<Candidates>,
    runtime: Runtime,
) -> Result<Option<(RowOffsets, Vec<Track>)>> {
    let (mut field, mut best) = (None, None);
    // A poor match may mean that the rows are far off.
    if rough.confidence < GOOD_CONFIDENCE {
        field = overview.shift(candidates, rows.size(), runtime)?;
    }

    // A better field gives a better map, which gives more and better blocks.
    for round in 1.. {
        if field.is_some() {
            *map = Some(overview.rough(candidates, field.as_ref(), runtime)?);
        }

        let seeds = seeds(overview, map.as_ref().unwrap_or(rough), field.as_ref());
        let tracks = follow(rows, overview, &seeds, overview.factor, runtime)?;
        let count = tracks.len();
        let found = fitted(&tracks, rows.size(), spacing(overview), overview.factor, count);
        let Some(found) = found else { break };
        let tolerated = TOLERATED * overview.factor as f64;
        let is_near = difference(&found.field, field.as_ref()) < tolerated;
        field = Some(found.field.clone());
        best = Some((found, tracks));

        if is_near || round == ROUNDS {
            break;
        }
    }

    Ok(best)
}

/// Distance of neighboring blocks, pixels of the whole image, so that about [`BLOCKS`] cover it.
fn spacing(overview: &Overview) -> usize {
    let size = overview.planes[0].as_slice().len();

    (((size / BLOCKS) as f64).sqrt() as usize).max(1) * overview.factor
}

/// Blocks all over the image, wherever the disparity is known.
fn seeds(overview: &Overview, map: &RoughMap, field: Option<&Alignment>) -> Vec<Seed> {
    let factor = overview.factor;
    let step = spacing(overview) / factor;
    // The center of a pixel of the copy, in pixels of the whole image.
    let center = |at: usize| factor as f64 * (at as f64 + 0.5) - 0.5;

    let mut seeds = vec![];
    for row in (step / 2..map.disparity.rows()).step_by(step) {
        for col in (step / 2..map.disparity.cols()).step_by(step) {
            let disparity = f64::from(map.disparity.row(row)[col]);
            if disparity.is_finite() {
                let (x, y) = (center(col), center(row));
                let dx = -disparity * factor as f64;
                let dy = field.map_or(0.0, |field| field.at(x + dx, y));
                seeds.push(Seed { x, y, dx, dy });
            }
        }
    }

    seeds
}

/// Root mean square of the difference of two fields, pixels.
fn difference(field: &Alignment, other: Option<&Alignment>) -> f64 {
    let mut coefficients = *field.coefficients();
    if let Some(other) = other {
        coefficients.iter_mut().zip(other.coefficients()).for_each(|(a, b)| *a -= b);
    }

    Alignment::new(coefficients, field.size()).map_or(f64::INFINITY, |field| field.rms())
}

/// The field through blocks that were found in copies reduced by a factor, `spacing` pixels apart.
///
/// `most` is the largest number of blocks that were found in any copies. Where only few of them are found again, as in a
/// blurred image, these may be there by chance: the error grows by as much.
fn fitted(
    tracks: &[Track],
    (rows, cols): (usize, usize),
    spacing: usize,
    factor: usize,
    most: usize,
) -> Option<RowOffsets> {
    if tracks.len() < LEAST_BLOCKS {
        return None;
    }

    let points: Vec<Point> =
        tracks.iter().map(|track| Point::of_track(track, (rows, cols))).collect();

    let mut fit = robust(&points, LINEAR)?;
    // Overlapping blocks do not err independently, so there are fewer independent points than blocks.
    let overlap = ((BLOCK * factor) as f64 / spacing as f64).max(1.0);
    let excess = overlap * most as f64 / points.len() as f64;

    if points.len() >= ENOUGH_BLOCKS
        && let Some(all) = robust(&points, TERMS)
        && all.difference(&fit) > RICHER * all.error(excess).max(LEAST_RICHER)
    {
        fit = all;
    }

    // A field that less than half of the blocks agree with may be one of several.
    if fit.agreeing < LEAST_BLOCKS.max(points.len() / 2) {
        return None;
    }

    let residual = |(track, point): (&Track, &Point)| {
        let band = ((track.place.y + 0.5) / rows as f64 * BANDS as f64) as usize;
        (band, point.residual(&fit.coefficients))
    };
    let residuals: Vec<(usize, f64)> = tracks.iter().zip(&points).map(residual).collect();

    Some(RowOffsets {
        wobble: wobble(&residuals),
        field: Alignment::new(fit.coefficients, (rows, cols)).ok()?,
        error: math::hypot(fit.error(excess), BIAS * factor as f64),
        blocks: fit.agreeing,
        spread: fit.spread,
    })
}

/// What blocks in the same band of rows have in common, from the band and the residual of each.
///
/// Any scatter fits its own medians, so those of every other block are judged by the blocks between.
fn wobble(residuals: &[(usize, f64)]) -> f64 {
    let of_half = |half: usize| residuals.iter().skip(half).step_by(2).copied();
    let of_band = |half: usize, band: usize| -> Option<f64> {
        let own = of_half(half).filter(|(at, _)| *at == band);
        let own: Vec<f64> = own.map(|(_, residual)| residual).collect();
        (own.len() >= LEAST_IN_BAND).then(|| median(own))
    };
    let medians: [[Option<f64>; BANDS]; 2] = from_fn(|half| from_fn(|band| of_band(half, band)));

    // Residuals of one half, as they are and less the medians of the other one.
    let (mut before, mut after) = (vec![], vec![]);
    for half in 0..2 {
        for (band, residual) in of_half(half) {
            if let Some(common) = medians[1 - half].get(band).copied().flatten() {
                before.push(residual.abs());
                after.push((residual - common).abs());
            }
        }
    }
    if before.len() < LEAST_BLOCKS || median(after) > EXPLAINED * median(before) {
        return 0.0;
    }

    let common: Vec<f64> = medians.into_iter().flatten().flatten().collect();
    (common.iter().map(|value| value * value).sum::<f64>() / common.len() as f64).sqrt()
}

/// One equation of a fit.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// What the coefficients are multiplied by.
    pub terms: [f64; TERMS],
    /// What the sum of these should be, pixels.
    pub value: f64,
    /// Inverse variance of the value, of arbitrary scale.
    pub weight: f64,
}

impl Point {
    /// The equation of a block in images of so many rows and columns.
    pub fn of_track(Track { place, weight }: &Track, (rows, cols): (usize, usize)) -> Self {
        // Fields are functions of places from -1 to 1 of the right image.
        let fraction = |at: f64, length: usize| (at + 0.5) / (length as f64 / 2.0) - 1.0;
        Self {
            terms: terms(fraction(place.x + place.dx, cols), fraction(place.y, rows)),
            value: place.dy,
            weight: *weight,
        }
    }

    /// The value less that of a field with these coefficients.
    pub fn residual(&self, coefficients: &[f64; TERMS]) -> f64 {
        self.value - coefficients.iter().zip(self.terms).map(|(a, b)| a * b).sum::<f64>()
    }
}

/// The result of a robust fit.
pub struct RobustFit {
    /// Of the terms of a field.
    pub coefficients: [f64; TERMS],
    /// Robust standard deviation of the residuals, pixels.
    pub spread: f64,
    /// Number of points with any weight.
    pub agreeing: usize,
    /// Mean over the image of the variance of the field, for residuals of variance 1.
    mean_variance: f64,
}

impl RobustFit {
    /// Standard error of the field, root mean square over the image; `excess` is the ratio of its variance to that for
    /// independent points.
    pub fn error(&self, excess: f64) -> f64 {
        self.spread * (excess * self.mean_variance).sqrt()
    }

    /// Root mean square of the difference of two fields.
    fn difference(&self, other: &Self) -> f64 {
        let field = |(x, y)| -> f64 {
            let terms = terms(x, y);
            (0..TERMS).map(|i| (self.coefficients[i] - other.coefficients[i]) * terms[i]).sum()
        };

        let squares: Vec<f64> = places().map(|place| field(place).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

/// Fits the first `count` terms by iteratively reweighted least squares; `None` where they are not determined.
pub fn robust(points: &[Point], count: usize) -> Option<RobustFit> {
    let mut weights: Vec<f64> = points.iter().map(|point| point.weight).collect();
    let mut coefficients = [0.0; TERMS];
    let mut spread = 0.0;

    for step in 0..STEPS.0 {
        coefficients = Normal::new(points, &weights, count).solved()?;
        let residual = |point: &Point| {
            let field: f64 = (0..count).map(|term| coefficients[term] * point.terms[term]).sum();
            (point.value - field).abs()
        };
        let residuals: Vec<f64> = points.iter().map(residual).collect();
        // 1.4826 times the median absolute deviation is the standard deviation of normal errors.
        spread = 1.4826 * median(residuals.clone()) + FLOOR;

        // Absolute deviations lead near the solution from anywhere; the biweight then ignores outliers entirely.
        for ((weight, point), residual) in weights.iter_mut().zip(points).zip(&residuals) {
            *weight = point.weight
                * if step < STEPS.1 {
                    1.0 / residual.max(0.1 * spread)
                } else {
                    (1.0 - (residual / (CUT * spread)).powi(2)).max(0.0).powi(2)
                };
        }
    }

    // Each remaining point counts once in the variance, whatever its weight.
    let agree: Vec<f64> = weights.iter().map(|weight| f64::from(*weight > 0.0)).collect();
    let agreeing = agree.iter().filter(|weight| **weight > 0.0).count();
    let mean_variance = Normal::new(points, &agree, count).mean_variance()?;
    Some(RobustFit { coefficients, spread, agreeing, mean_variance })
}

/// The middle one of some values.
pub fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The normal equations of the first `count` terms; of the symmetric matrix, the lower triangle.
struct Normal {
    matrix: [[f64; TERMS]; TERMS],
    target: [f64; TERMS],
    count: usize,
}

impl Normal {
    fn new(points: &[Point], weights: &[f64], count: usize) -> Self {
        let (mut matrix, mut target) = ([[0.0; TERMS]; TERMS], [0.0; TERMS]);

        for (Point { terms, value, .. }, weight) in points.iter().zip(weights) {
            for row in 0..count {
                let weighted = weight * terms[row];
                target[row] += weighted * value;
                for col in 0..=row {
                    matrix[row][col] += weighted * terms[col];
                }
            }
        }

        Self { matrix, target, count }
    }

    /// The Cholesky factor; `None` where the equations do not determine all terms.
    fn factor(&self) -> Option<[[f64; TERMS]; TERMS]> {
        // A pivot that is tiny beside the first one means that the points do not determine a term.
        let mut lower = [[0.0f64; TERMS]; TERMS];
        for row in 0..self.count {
            for col in 0..=row {
                let done: f64 = (0..col).map(|k| lower[row][k] * lower[col][k]).sum();
                let rest = self.matrix[row][col] - done;

                if row > col {
                    lower[row][col] = rest / lower[col][col];
                } else if rest * LARGEST_CONDITION > self.matrix[0][0] {
                    lower[row][row] = rest.sqrt();
                } else {
                    return None;
                }
            }
        }

        Some(lower)
    }

    /// The coefficients, by substitution forward and backward.
    fn solved(&self) -> Option<[f64; TERMS]> {
        let lower = self.factor()?;
        let mut solution = forward(&lower, self.target, self.count);

        for row in (0..self.count).rev() {
            let known: f64 = (row + 1..self.count).map(|k| lower[k][row] * solution[k]).sum();
            solution[row] = (solution[row] - known) / lower[row][row];
        }

        solution[self.count..].fill(0.0);

        Some(solution)
    }

    /// Mean over the image of the variance of the field, for residuals of variance 1.
    fn mean_variance(&self) -> Option<f64> {
        // The variance at a place is t' A^-1 t = |L^-1 t|^2 for its terms t.
        let lower = self.factor()?;
        let variance = |(x, y)| -> f64 {
            let half = forward(&lower, terms(x, y), self.count);
            half[..self.count].iter().map(|value| value * value).sum()
        };

        let variances: Vec<f64> = places().map(variance).collect();
        Some(variances.iter().sum::<f64>() / variances.len() as f64)
    }
}

/// Solves the equations of a lower triangle.
fn forward(lower: &[[f64; TERMS]; TERMS], mut values: [f64; TERMS], count: usize) -> [f64; TERMS] {
    for row in 0..count {
        let known: f64 = (0..row).map(|k| lower[row][k] * values[k]).sum();
        values[row] = (values[row] - known) / lower[row][row];
    }

    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(field: &[f64; TERMS], wrong: usize) -> Vec<Point> {
        let place = |index: usize| 2.0 * ((index * 37 % 101) as f64 / 100.0) - 1.0;
        let point = |index: usize| {
            let terms = terms(place(index), place(7 * index + 3));
            let exact: f64 = field.iter().zip(terms).map(|(a, b)| a * b).sum();
            let astray = if index.is_multiple_of(wrong) { 3.0 } else { 0.0 };
            Point { terms, value: exact + astray, weight: 1.0 }
        };

        (1..200).map(point).collect()
    }

    #[test]
    fn a_field_is_found_in_spite_of_outliers() {
        let field = [1.5, -2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
        let fit = robust(&points(&field, 5), LINEAR).expect("enough points");
        assert!((0..TERMS).all(|term| (fit.coefficients[term] - field[term]).abs() < 1e-6));
        assert_eq!(fit.agreeing, 160);

        let field = [1.5, -2.0, 0.5, 1.0, -0.25, 0.75, -1.0, 0.5];
        let fit = robust(&points(&field, 6), TERMS).expect("enough points");
        assert!((0..TERMS).all(|term| (fit.coefficients[term] - field[term]).abs() < 1e-6));
    }

    #[test]
    fn blocks_wobble_where_those_of_a_row_agree() {
        let scatter = |index: usize| (index * 7919 % 101) as f64 / 50.0 - 1.0;
        let band = |index: usize| index / 30;
        let common = |index: usize| if band(index) % 2 == 0 { 0.8 } else { -0.8 };

        let apart: Vec<_> = (0..360).map(|index| (band(index), scatter(index))).collect();
        assert!(wobble(&apart).abs() < 1e-12);
        let together: Vec<_> =
            (0..360).map(|index| (band(index), common(index) + 0.3 * scatter(index))).collect();
        assert!((wobble(&together) - 0.8).abs() < 0.1);
        assert!(wobble(&together[..20]).abs() < 1e-12, "too few");
    }

    #[test]
    fn offsets_count_beyond_an_eighth_of_a_pixel_and_two_standard_errors() {
        let is_significant = |offset: f64, error: f64| {
            let coefficients = [offset, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            let field = Alignment::new(coefficients, (100, 100)).expect("a legal field");
            RowOffsets { field, error, blocks: 100, spread: 0.1, wobble: 0.0 }.is_significant()
        };

        assert!(is_significant(0.125, 0.01) && !is_significant(0.115, 0.01));
        assert!(is_significant(1.0, 0.49) && !is_significant(1.0, 0.51));
    }

    #[test]
    fn blocks_along_a_line_determine_no_field() {
        let point = |index: usize| Point {
            terms: terms(index as f64 / 100.0 - 1.0, 0.5),
            value: 1.0,
            weight: 1.0,
        };
        let points: Vec<Point> = (0..200).map(point).collect();
        assert!(robust(&points, LINEAR).is_none());
    }
}

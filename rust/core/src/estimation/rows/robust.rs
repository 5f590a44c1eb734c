//! Robust fits of fields of vertical offsets to blocks: iteratively reweighted least squares, first of
//! absolute deviations, then with Tukey's biweight.
//!
//! The spline of the row has more factors than the blocks of some images determine, so it has a prior: its
//! factors, and with more or less weight their second differences, are normal with mean 0. Where blocks are
//! few, the spline follows its neighbors, and goes to 0 with them. Its width and smoothness are the values
//! under which the blocks are most probable, with the factors integrated out (Bayesian interpolation, Neural
//! Computation 4, 1992):
//!
//! ```text
//! A = sum of t t' / variance over the blocks;  b = sum of t dy / variance;  P = (1 + smooth D' D) / width^2
//! evidence(width, smooth) = (log |P| - log |A + P| + b' (A + P)^-1 b) / 2
//! ```
//!
//! The evidence of a spline is that of the best of them minus that of the smooth field alone: the logarithm
//! of how much more probable the blocks are with the spline.

use std::array::from_fn;

use crate::estimation::tracks::{BLOCK, Track};
use phasestereo_match::base::linear::{Cholesky, Normal};
use phasestereo_match::base::math;
use phasestereo_match::base::statistics::{deviation, robust_weight};
use phasestereo_match::pair::alignment::sway::{self, INTERVALS, KNOTS, mean_weights};
use phasestereo_match::pair::alignment::{TERMS, places, terms};

/// Reweightings, and how many of them use absolute deviations.
const STEPS: (usize, usize) = (20, 6);
/// Least robust standard deviation: no correlation is more exact, pixels.
const FLOOR: f64 = 0.02;
/// Largest ratio of the pivots of the normal equations: beyond it, the blocks lie along a line.
const LARGEST_CONDITION: f64 = 1e6;
/// Places along a row over which errors are averaged.
const COLUMNS: usize = 8;
/// Most unknowns of a fit.
const MOST: usize = TERMS + KNOTS;
/// Widths that are tried, pixels,
const WIDTHS: [f64; 8] = [0.06, 0.12, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
/// ... and weights of the second differences; with less, a few mistaken blocks at a border bend a spline to
/// them.
const SMOOTHNESS: [f64; 3] = [10.0, 100.0, 1000.0];

/// One equation of a fit.
pub struct Equation {
    /// The terms of the smooth field.
    pub terms: [f64; TERMS],
    /// The weights of the factors of the spline.
    pub sway: [f64; KNOTS],
    /// The offset.
    pub value: f64,
    /// Inverse variance of the offset, of arbitrary scale.
    pub weight: f64,
}

impl Equation {
    /// The equation of a block in copies, reduced by a factor, of images with this many rows and columns.
    pub fn of_track(Track { place, weight }: &Track, (rows, cols): (usize, usize), factor: usize) -> Self {
        // Fields are functions of places from -1 to 1 of the right image, splines of shares of the height. A
        // block shows the mean over its rows.
        let fraction = |at: f64, length: usize| (at + 0.5) / (length as f64 / 2.0) - 1.0;
        let half = (BLOCK * factor) as f64 / 2.0;
        let share = |y: f64| (y + 0.5) / rows as f64;

        Self {
            terms: terms(fraction(place.x + place.dx, cols), fraction(place.y, rows)),
            sway: mean_weights(share(place.y - half), share(place.y + half)),
            value: place.dy,
            weight: *weight,
        }
    }

    /// The offset minus that of a smooth field with these coefficients.
    pub fn residual(&self, coefficients: &[f64; TERMS]) -> f64 {
        self.value - coefficients.iter().zip(self.terms).map(|(a, b)| a * b).sum::<f64>()
    }
}

/// The model to fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// The number of terms of the smooth field, from the first on.
    pub smooth: usize,
    /// Whether it includes a spline of the row.
    pub sways: bool,
    /// Ratio of the variance of a mean over points to that over independent ones.
    pub excess: f64,
}

/// The result of a robust fit.
pub struct RobustFit {
    /// Factors of the terms of the smooth field.
    pub coefficients: [f64; TERMS],
    /// Factors of the spline of the row.
    pub sway: [f64; KNOTS],
    /// Robust standard deviation of the residuals, pixels.
    pub spread: f64,
    /// Number of points with any weight.
    pub agreeing: usize,
    /// Standard error of the field, root mean square over the image.
    pub error: f64,
    /// Standard error in the middle of every interval of the spline, root mean square over the columns.
    pub errors: [f64; INTERVALS],
    /// Weights of the points.
    weights: Vec<f64>,
}

impl Model {
    /// Number of unknowns.
    fn count(&self) -> usize {
        self.smooth + if self.sways { KNOTS } else { 0 }
    }

    /// The factors of the unknowns.
    fn row(&self, terms: &[f64; TERMS], sway: &[f64; KNOTS]) -> [f64; MOST] {
        let mut row = [0.0; MOST];
        row[..self.smooth].copy_from_slice(&terms[..self.smooth]);
        row[self.smooth..self.smooth + KNOTS].copy_from_slice(sway);
        row
    }

    /// Fits the field; `None` if it is not determined.
    pub fn fitted(&self, points: &[Equation]) -> Option<RobustFit> {
        let rows: Vec<[f64; MOST]> = points.iter().map(|point| self.row(&point.terms, &point.sway)).collect();
        let mut weights: Vec<f64> = points.iter().map(|point| point.weight).collect();
        let mut solution = [0.0; MOST];
        let mut spread = 0.0;
        let mut prior = None;

        for step in 0..STEPS.0 {
            let mut normal = normal(&rows, points, &weights, self.count());
            if self.sways {
                // At first the spread is unknown, but a spline of the largest width hardly depends on it.
                if step == 1 || step == STEPS.1 || step + 1 == STEPS.0 {
                    prior = Some(self.most_probable(&rows, points, &weights, spread)?.1);
                }
                let noise = self.noise(spread.max(FLOOR), &weights);
                prior.get_or_insert_with(Prior::widest).add_to(&mut normal, self.smooth, noise);
            }

            solution = factor(&normal, self.smooth)?.solved(normal.target);
            let residual = |(row, point): (&[f64; MOST], &Equation)| {
                let field: f64 = (0..self.count()).map(|at| solution[at] * row[at]).sum();
                (point.value - field).abs()
            };
            let residuals: Vec<f64> = rows.iter().zip(points).map(residual).collect();
            spread = deviation(residuals.iter().copied()) + FLOOR;

            for ((weight, point), residual) in weights.iter_mut().zip(points).zip(&residuals) {
                *weight = point.weight * robust_weight(*residual, spread, step >= STEPS.1);
            }
        }

        // Each remaining point counts once in the variance, whatever its weight.
        let agree: Vec<f64> = weights.iter().map(|weight| f64::from(*weight > 0.0)).collect();
        let agreeing = agree.iter().filter(|weight| **weight > 0.0).count();
        let mut normal = normal(&rows, points, &agree, self.count());
        if let Some(prior) = prior {
            prior.add_to(&mut normal, self.smooth, self.noise(spread, &agree));
        }
        let factor = factor(&normal, self.smooth)?;
        let errors = from_fn(|interval| {
            let y = (2 * interval + 1) as f64 / INTERVALS as f64 - 1.0;
            let x = |at| (2 * at + 1) as f64 / COLUMNS as f64 - 1.0;
            self.error(&factor, spread, (0..COLUMNS).map(|at| (x(at), y)))
        });

        let (coefficients, sway) = self.parted(&solution);
        let error = self.error(&factor, spread, places());
        Some(RobustFit { coefficients, sway, spread, agreeing, error, errors, weights })
    }

    /// The factors of the smooth terms, and those of the spline, whose linear part moves to the smooth terms:
    /// only their sum is determined.
    fn parted(&self, solution: &[f64; MOST]) -> ([f64; TERMS], [f64; KNOTS]) {
        let mut coefficients: [f64; TERMS] = from_fn(|at| if at < self.smooth { solution[at] } else { 0.0 });
        let mut sway = [0.0; KNOTS];
        if !self.sways {
            return (coefficients, sway);
        }

        sway.copy_from_slice(&solution[self.smooth..][..KNOTS]);
        // In a sum over symmetrical places, shift and slope are determined separately.
        let (mut sums, mut squares) = ([0.0; 2], [0.0; 2]);
        for (_, y) in places() {
            let offset = sway::at(&sway, 0.5 * (y + 1.0));
            for (at, term) in [1.0, y].into_iter().enumerate() {
                sums[at] += term * offset;
                squares[at] += term * term;
            }
        }
        let [shift, slope] = [0, 1].map(|at| sums[at] / squares[at]);

        coefficients[0] += shift;
        coefficients[2] += slope;
        for (knot, factor) in sway.iter_mut().enumerate() {
            // A cubic B-spline whose factors are a line is that line.
            let y = 2.0 * (knot as f64 - 1.0) / INTERVALS as f64 - 1.0;
            *factor -= shift + slope * y;
        }
        (coefficients, sway)
    }

    /// Standard error of the field at places, root mean square.
    fn error(&self, factor: &Cholesky<MOST>, spread: f64, places: impl Iterator<Item = (f64, f64)>) -> f64 {
        let variance = |(x, y): (f64, f64)| -> f64 {
            let fraction = 0.5 * (y + 1.0);
            factor.variance(self.row(&terms(x, y), &mean_weights(fraction, fraction)))
        };

        let variances: Vec<f64> = places.map(variance).collect();
        let mean = variances.iter().sum::<f64>() / variances.len() as f64;
        spread * (self.excess * mean).sqrt()
    }

    /// The variance of a point of weight 1, if points with these weights have this spread.
    fn noise(&self, spread: f64, weights: &[f64]) -> f64 {
        let positive = weights.iter().filter(|weight| **weight > 0.0).count().max(1);
        self.excess * spread * spread * weights.iter().sum::<f64>() / positive as f64
    }

    /// The evidence for a spline of the row in addition to the smooth terms of a fit.
    pub fn evidence(&self, points: &[Equation], fit: &RobustFit) -> f64 {
        let rows: Vec<[f64; MOST]> = points.iter().map(|point| self.row(&point.terms, &point.sway)).collect();
        self.most_probable(&rows, points, &fit.weights, fit.spread).map_or(0.0, |found| found.0)
    }

    /// The same, and the prior of the most probable spline.
    fn most_probable(
        &self,
        rows: &[[f64; MOST]],
        points: &[Equation],
        weights: &[f64],
        spread: f64,
    ) -> Option<(f64, Prior)> {
        let count = self.smooth + KNOTS;
        let normal = normal(rows, points, weights, count).scaled(1.0 / self.noise(spread, weights));

        let alone = probability(&Normal { count: self.smooth, ..normal }, self.smooth)?;
        let mut best: Option<(f64, Prior)> = None;
        for prior in Prior::all() {
            let mut with = normal;
            prior.add_to(&mut with, self.smooth, 1.0);
            let found = probability(&with, self.smooth)? + prior.half_logarithm - alone;
            if best.as_ref().is_none_or(|(most, _)| found > *most) {
                best = Some((found, prior));
            }
        }
        best
    }
}

impl RobustFit {
    /// Root mean square of the difference of two fields.
    pub fn difference(&self, other: &Self) -> f64 {
        let field = |(x, y)| -> f64 {
            let terms = terms(x, y);
            let spline = mean_weights(0.5 * (y + 1.0), 0.5 * (y + 1.0));
            let smooth = (0..TERMS).map(|i| (self.coefficients[i] - other.coefficients[i]) * terms[i]);
            let sway = (0..KNOTS).map(|i| (self.sway[i] - other.sway[i]) * spline[i]);
            smooth.sum::<f64>() + sway.sum::<f64>()
        };

        let squares: Vec<f64> = places().map(|place| field(place).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

/// The prior of the factors of the spline, before any blocks.
struct Prior {
    /// The inverse of their covariance.
    precision: [[f64; KNOTS]; KNOTS],
    /// Half of the logarithm of its determinant.
    half_logarithm: f64,
}

impl Prior {
    /// All priors to try.
    fn all() -> impl Iterator<Item = Self> {
        SMOOTHNESS.into_iter().flat_map(|smooth| {
            let unit = Self::new(smooth);
            WIDTHS.into_iter().map(move |width| unit.scaled(width))
        })
    }

    /// The least informative one.
    fn widest() -> Self {
        Self::new(0.0).scaled(WIDTHS[WIDTHS.len() - 1])
    }

    /// The one with width 1 and this weight of the second differences.
    fn new(smooth: f64) -> Self {
        let mut precision = [[0.0; KNOTS]; KNOTS];
        for (knot, row) in precision.iter_mut().enumerate() {
            row[knot] = 1.0;
        }
        for first in 0..KNOTS - 2 {
            for (i, a) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                for (j, b) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    precision[first + i][first + j] += smooth * a * b;
                }
            }
        }

        let normal = Normal { matrix: precision, ..Normal::new(KNOTS) };
        // The matrix is one plus squares, so it has a factor.
        let half_logarithm = normal.factor().map_or(0.0, |factor| factor.half_log_determinant());
        Self { precision, half_logarithm }
    }

    /// Adds it to equations in which the factors of the spline come after the smooth terms.
    fn add_to(&self, normal: &mut Normal<MOST>, smooth: usize, weight: f64) {
        for (row, values) in normal.matrix[smooth..].iter_mut().zip(&self.precision) {
            for (sum, value) in row[smooth..].iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
    }

    /// The same with another width.
    fn scaled(&self, width: f64) -> Self {
        let precision = self.precision.map(|row| row.map(|value| value / (width * width)));
        let half_logarithm = self.half_logarithm - KNOTS as f64 * math::ln(width);
        Self { precision, half_logarithm }
    }
}

/// The normal equations of points with these weights.
fn normal(rows: &[[f64; MOST]], points: &[Equation], weights: &[f64], count: usize) -> Normal<MOST> {
    let mut normal = Normal::new(count);
    for ((terms, point), weight) in rows.iter().zip(points).zip(weights) {
        normal.add(terms, point.value, *weight);
    }
    normal
}

/// The factor of equations; `None` if the points do not determine the smooth terms.
fn factor(normal: &Normal<MOST>, smooth: usize) -> Option<Cholesky<MOST>> {
    normal.factor().filter(|factor| factor.condition(smooth) < LARGEST_CONDITION)
}

/// Logarithm of the probability of the points, without the part that all models share.
fn probability(normal: &Normal<MOST>, smooth: usize) -> Option<f64> {
    let factor = factor(normal, smooth)?;
    Some(factor.variance(normal.target) / 2.0 - factor.half_log_determinant())
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::pair::alignment::LINEAR;

    const PLAIN: Model = Model { smooth: LINEAR, sways: false, excess: 1.0 };
    const SWAYING: Model = Model { sways: true, ..PLAIN };

    fn points(field: &[f64; TERMS], wrong: usize) -> Vec<Equation> {
        let place = |index: usize| 2.0 * ((index * 37 % 101) as f64 / 100.0) - 1.0;
        let point = |index: usize| {
            let (x, y) = (place(index), place(7 * index + 3));
            let terms = terms(x, y);
            let exact: f64 = field.iter().zip(terms).map(|(a, b)| a * b).sum();
            let astray = if index.is_multiple_of(wrong) { 3.0 } else { 0.0 };
            let share = 0.5 * (y + 1.0);
            Equation { terms, sway: mean_weights(share, share), value: exact + astray, weight: 1.0 }
        };

        (1..200).map(point).collect()
    }

    /// The same, with noise, and with waves in rows whose share of the height is in a range.
    fn waving(height: f64, rows: std::ops::Range<f64>) -> Vec<Equation> {
        let mut points = points(&[1.5, -2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0], 200);
        points.retain(|point| rows.contains(&(0.5 * (point.terms[2] + 1.0))));
        for (index, point) in points.iter_mut().enumerate() {
            let noise = (index * 7919 % 101) as f64 / 500.0 - 0.1;
            point.value += height * math::sin(8.0 * point.terms[2]) + noise;
        }
        points
    }

    #[test]
    fn a_field_is_found_in_spite_of_outliers() {
        let field = [1.5, -2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
        let fit = PLAIN.fitted(&points(&field, 5)).expect("enough points");
        assert!((0..TERMS).all(|term| (fit.coefficients[term] - field[term]).abs() < 1e-6));
        assert_eq!(fit.agreeing, 160);

        let field = [1.5, -2.0, 0.5, 1.0, -0.25, 0.75, -1.0, 0.5];
        let all = Model { smooth: TERMS, ..PLAIN };
        let fit = all.fitted(&points(&field, 6)).expect("enough points");
        assert!((0..TERMS).all(|term| (fit.coefficients[term] - field[term]).abs() < 1e-6));
    }

    #[test]
    fn blocks_along_a_line_determine_no_field() {
        let point = |index: usize| Equation {
            terms: terms(index as f64 / 100.0 - 1.0, 0.5),
            sway: mean_weights(0.75, 0.75),
            value: 1.0,
            weight: 1.0,
        };
        let points: Vec<Equation> = (0..200).map(point).collect();
        assert!(PLAIN.fitted(&points).is_none());
    }

    #[test]
    fn there_is_evidence_of_rows_that_sway_and_none_in_noise() {
        let evidence =
            |points: &[Equation]| SWAYING.evidence(points, &SWAYING.fitted(points).expect("enough points"));
        assert!(evidence(&waving(0.0, 0.0..1.0)) < 1.0);
        assert!(evidence(&waving(0.5, 0.0..1.0)) > 50.0);
    }

    #[test]
    fn a_spline_is_the_waves_and_shrinks_where_there_are_no_blocks() {
        let points = waving(0.8, 0.0..1.0);
        let fit = SWAYING.fitted(&points).expect("enough points");
        let value = |fit: &RobustFit, y: f64| {
            let smooth = fit.coefficients[0] + fit.coefficients[2] * y;
            smooth + sway::at(&fit.sway, 0.5 * (y + 1.0))
        };
        for row in -9..=9 {
            let y = f64::from(row) / 10.0;
            let exact = 1.5 + 0.5 * y + 0.8 * math::sin(8.0 * y);
            assert!((value(&fit, y) - exact).abs() < 0.1, "{y}");
        }

        // Only the upper half: the lower one is unknown, and reported as such.
        let fit = SWAYING.fitted(&waving(0.8, 0.0..0.5)).expect("enough points");
        assert!(fit.errors[2] < 0.1 && fit.errors[13] > 0.5, "{:?}", fit.errors);
        assert!(fit.sway.iter().all(|factor| factor.abs() < 4.0), "{:?}", fit.sway);
    }
}

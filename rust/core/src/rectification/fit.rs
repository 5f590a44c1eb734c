//! The numbers of two cameras, fitted to matches so that their rows correspond: Levenberg's and Marquardt's
//! steps, with Tukey's weights against mistakes.
//!
//! ```text
//! cost = sum of w r^2 / (6 s^2) + sum of numbers^2          # r: rows apart, s: their spread
//! repeat: (J' W J + 1, its diagonal times 1 + damping) step = J' W r + numbers    # taken if the cost falls
//!         first w = 1 / max(|r| / s, 0.5), then Tukey's biweight
//! ```

use super::cameras::{Cameras, NUMBERS, USUAL, WIDE};
use super::matches::CornerMatch;
use phasestereo_match::base::linear::Normal;
use phasestereo_match::base::math;
use phasestereo_match::base::statistics::{biweight, deviation};

/// The minimum added to the spread of rows, pixels: no match is more exact.
const SPREAD: f64 = 0.05;
/// Errors beyond this many spreads do not count.
const CUT: f64 = 4.7;
/// Number of correlated errors that count as one.
const TOGETHER: f64 = 6.0;
/// Tries to damp a step, and the improvement it must reach, in deviations.
const TRIES: usize = 8;
const STILL: f64 = 2e-3;
/// Matches agree with cameras if their rows are at most this many spreads apart, or this share of the width.
const AGREE: (f64, f64) = (4.0, 0.004);

/// Fitted cameras.
pub struct CameraFit {
    /// The cameras.
    pub cameras: Cameras,
    /// The weight of each match by its agreement, 0 for mistakes.
    pub weights: Vec<f64>,
    /// The spread of the rows, pixels.
    pub spread: f64,
    /// The final normal equations; their inverse is the covariance of the numbers.
    pub normal: Normal<NUMBERS>,
}

/// Most steps, and how many of them come before Tukey's weights.
#[derive(Debug, Clone, Copy)]
pub struct Steps(pub usize, pub usize);

/// Fits cameras to matches of these weights, starting from given ones.
pub fn fit(
    matches: &[CornerMatch],
    weights: &[f64],
    start: &Cameras,
    Steps(most, first): Steps,
) -> CameraFit {
    let mut cameras = start.clone();
    let mut damping = 1e-3;
    let mut state = (vec![], 0.0, Normal::held([1.0; NUMBERS]));

    for step in 0..most.max(1) {
        let (mut rows, mut slopes) = (Vec::with_capacity(matches.len()), vec![]);
        for found in matches {
            let (row, slope) = cameras.row_derivatives([found.left, found.right]);
            rows.push(row);
            slopes.push(slope);
        }

        let scaled = rows.iter().zip(weights).map(|(row, weight)| (row * weight.sqrt()).abs());
        let scaled: Vec<f64> = scaled.collect();
        let spread = deviation(scaled.iter().copied()) + SPREAD;
        let agree = |error: &f64| {
            let error = error / spread;
            if step < first { 1.0 / error.max(0.5) } else { biweight(error, CUT) }
        };
        let agree: Vec<f64> = scaled.iter().map(agree).collect();
        let scale = 1.0 / (TOGETHER * spread * spread);
        let total: Vec<f64> = agree.iter().zip(weights).map(|(a, b)| a * b * scale).collect();

        let mut normal = Normal::held([1.0; NUMBERS]);
        for ((row, slope), weight) in rows.iter().zip(&slopes).zip(&total) {
            normal.add(slope, *row, *weight);
        }
        for (target, number) in normal.target.iter_mut().zip(cameras.numbers()) {
            *target += number;
        }

        let own: f64 = rows.iter().zip(&total).map(|(row, weight)| weight * row * row).sum();
        let before = own + held(&cameras);
        let moved = improve(&mut cameras, &mut damping, &normal, |new| {
            let sum: f64 = matches
                .iter()
                .zip(&total)
                .filter(|(_, weight)| **weight > 0.0)
                .map(|(found, weight)| weight * new.row_difference([found.left, found.right]).powi(2))
                .sum();
            sum + held(new) <= before
        });

        state = (agree, spread, normal);
        if moved < STILL && step > first {
            break;
        }
    }

    let (weights, spread, normal) = state;
    CameraFit { cameras, weights, spread, normal }
}

impl CameraFit {
    /// How improbable the cameras are: the logarithm of the spread for each match, plus the cost of unusual
    /// numbers.
    pub fn improbability(&self) -> f64 {
        let count = self.weights.len() as f64;
        math::ln(self.spread) + TOGETHER * held(&self.cameras) / (2.0 * count)
    }
}

/// The cost of unusual numbers.
fn held(cameras: &Cameras) -> f64 {
    cameras.numbers().iter().map(|number| number * number).sum()
}

/// Takes a step, damped until it improves; returns the largest change.
fn improve(
    cameras: &mut Cameras,
    damping: &mut f64,
    normal: &Normal<NUMBERS>,
    is_good: impl Fn(&Cameras) -> bool,
) -> f64 {
    for _ in 0..TRIES {
        let Some(step) = normal.damped(*damping).solved() else { return 0.0 };
        let numbers = std::array::from_fn(|index| cameras.numbers()[index] - step[index]);
        let new = cameras.with_numbers(numbers);

        if is_good(&new) {
            *cameras = new;
            *damping = (*damping / 5.0).max(1e-9);
            return step.iter().fold(0.0, |most, change| most.max(change.abs()));
        }
        *damping *= 10.0;
    }

    0.0
}

/// Cameras refitted to matches, some of which agree, and the row tolerance of those that agree with each; the
/// best first. They start from usual lenses, barrel and pincushion, and from lenses that may differ much.
pub fn fitted(matches: &[CornerMatch], agreeing: &[bool], size: (usize, usize)) -> [(Cameras, f64); 3] {
    let least = AGREE.1 * size.1 as f64;
    let start = |(spreads, k1): ([f64; NUMBERS], f64)| {
        let mut numbers = [0.0; NUMBERS];
        numbers[super::cameras::K1] = k1;
        let mut cameras = Cameras::new(numbers, spreads, size);
        let mut kept: Vec<CornerMatch> =
            matches.iter().zip(agreeing).filter(|(_, is_in)| **is_in).map(|(one, _)| *one).collect();

        let (mut cost, mut near) = (f64::INFINITY, least);
        for steps in [Steps(15, 4), Steps(8, 0)] {
            let fit = fit(&kept, &vec![1.0; kept.len()], &cameras, steps);
            cameras = fit.cameras;

            near = least.max(AGREE.0 * fit.spread);
            let rows = |one: &CornerMatch| cameras.row_difference([one.left, one.right]).abs();
            kept = matches.iter().filter(|one| rows(one) < near).copied().collect();
            let sum: f64 = matches.iter().map(|one| rows(one).min(least)).sum();
            cost = (sum + 2.0 * held(&cameras)) / matches.len() as f64;
        }
        (cost, cameras, near)
    };

    let mut found = [(USUAL, -0.75), (USUAL, 0.75), (WIDE, 0.0)].map(start);
    found.sort_by(|one, other| one.0.total_cmp(&other.0));
    found.map(|(_, cameras, near)| (cameras, near))
}

#[cfg(test)]
mod tests {
    use super::super::cameras::Point;
    use super::*;

    const SIZE: (usize, usize) = (480, 640);

    /// Matches of things at many depths, seen by cameras; one in this many is a mistake.
    fn seen(cameras: &Cameras, wrong: usize) -> Vec<CornerMatch> {
        let place = |index: usize| -> Option<CornerMatch> {
            let [x, y] = [(index * 37 % 601) as f64 + 20.0, (index * 91 % 433) as f64 + 20.0];
            let disparity = (index * 53 % 60) as f64;
            let astray = if index.is_multiple_of(wrong) { 25.0 } else { 0.0 };
            let left: Point = cameras.raw([x, y], 0)?;
            let right = cameras.raw([x - disparity, y + astray], 1)?;
            Some(CornerMatch { left, right })
        };
        (1..400).filter_map(place).collect()
    }

    #[test]
    fn of_cameras_with_equal_rows_the_usual_ones_are_more_probable() {
        let fit = |focal: f64, spread: f64| {
            let mut numbers = [0.0; NUMBERS];
            numbers[0] = focal;
            let cameras = Cameras::new(numbers, USUAL, SIZE);
            CameraFit { cameras, weights: vec![1.0; 400], spread, normal: Normal::held([1.0; NUMBERS]) }
                .improbability()
        };
        assert!(fit(-5.0, 0.2) > fit(-1.0, 0.2));
        assert!(fit(-5.0, 0.33) > fit(0.0, 0.2) && fit(-1.0, 0.2) < fit(0.0, 0.33));
    }

    #[test]
    fn cameras_are_found_in_spite_of_mistakes() {
        let numbers = [0.2, 0.5, -0.9, 0.0, 0.3, 0.0, 0.2, 0.0, -0.1, 0.3, 1.0, 0.8, -0.2, -1.5];
        let truth = Cameras::new(numbers, USUAL, SIZE);
        let matches = seen(&truth, 7);
        let agree: Vec<bool> = (1..400).map(|index: usize| !index.is_multiple_of(7)).collect();

        let (cameras, near) = fitted(&matches, &agree, SIZE)[0].clone();
        assert!((1.0..10.0).contains(&near), "{near}");
        for one in seen(&truth, usize::MAX) {
            assert!(cameras.row_difference([one.left, one.right]).abs() < 0.2, "{one:?}");
        }
    }

    #[test]
    fn a_fit_tells_mistakes_from_the_rest() {
        let truth = Cameras::new([0.3; NUMBERS], USUAL, SIZE);
        let matches = seen(&truth, 5);
        let start = Cameras::new([0.0; NUMBERS], USUAL, SIZE);
        let found = fit(&matches, &vec![1.0; matches.len()], &start, Steps(30, 8));
        for (weight, index) in found.weights.iter().zip(1usize..) {
            assert_eq!(*weight > 0.0, !index.is_multiple_of(5), "match {index}");
        }
        assert!(found.spread < 0.2 && found.normal.factor().is_some());
    }
}

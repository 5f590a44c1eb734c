//! The axis of the disparities: along rows if the cameras are beside each other, along columns if one is
//! above the other, along slanted lines in pairs of satellite images.
//!
//! ```text
//! dx, dy = how far each matched corner moves;  minus, for both: a quadratic field, fitted robustly
//! spread(t) = deviation of cos(t) dy - sin(t) dx, for directions t      # the rest: distances, mistakes
//! the axis is the direction with the least spread across it, if some other one has 2.5 times its spread
//! ```
//!
//! The field removes the effects of cameras that are turned, zoomed, or have distorting lenses: a plane moves
//! by such a field alone, so pairs of one plane show no axis.

use std::f64::consts::PI;

use super::matches::CornerMatch;
use phasestereo_match::base::linear::Normal;
use phasestereo_match::base::math::{cos, sin};
use phasestereo_match::base::statistics::deviation;

/// Fewest matches that determine an axis.
const LEAST_MATCHES: usize = 40;
/// The largest spread relative to the smallest, and in pixels of an image of 1000 pixels on its long side: in
/// 292 runs on 146 pairs, original and turned by 90 degrees, no axis was wrong; pairs of a plane have ratios
/// below 1.9.
const CLEAR: (f64, f64) = (2.5, 0.5);
/// Rounds of the robust fit; errors of up to this share of their deviation count in full.
const ROUNDS: usize = 12;
const SURE: f64 = 0.5;
/// Lines at no larger angle than this to an axis are along it, degrees. None of 146 pairs has lines at 20 to
/// 80.
const ALONG: f64 = 30.0;
/// Directions that are tried.
const DIRECTIONS: usize = 90;
/// Least spread that is distinguished, pixels of such an image.
const LEAST_SPREAD: f64 = 0.05;

/// The lines that disparities follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Their angle against the rows, degrees from -90 to 90: positive if they run down to the right.
    pub angle: f64,
    /// The spread along them divided by that across them.
    pub ratio: f64,
}

impl Axis {
    /// The axis in the original images, from the axis in images turned by 90 degrees counterclockwise.
    pub fn turned_back(self) -> Self {
        let angle = self.angle + 90.0;
        Self { angle: if angle > 90.0 { angle - 180.0 } else { angle }, ..self }
    }

    /// Whether the axis shows one camera beside the other.
    pub fn is_along_rows(self) -> bool {
        self.angle.abs() <= ALONG
    }

    /// Whether the axis shows one camera above the other.
    pub fn is_along_columns(self) -> bool {
        self.angle.abs() >= 90.0 - ALONG
    }
}

/// The axis that matches show in images of this many rows and columns; `None`: they do not determine it.
pub fn axis(matches: &[CornerMatch], (rows, cols): (usize, usize)) -> Option<Axis> {
    if matches.len() < LEAST_MATCHES {
        return None;
    }
    let scale = 1000.0 / rows.max(cols) as f64;
    let terms: Vec<[f64; 6]> = matches.iter().map(|one| terms(one.left, (rows, cols))).collect();
    let [along, down] = [0, 1].map(|axis| {
        let moves = matches.iter().map(|one| scale * (one.right[axis] - one.left[axis]));
        rest(&terms, moves.collect())
    });
    let (along, down) = (along?, down?);

    let spread = |step: usize| {
        let angle = step as f64 * PI / DIRECTIONS as f64;
        let (sine, cosine) = (sin(angle), cos(angle));
        deviation(along.iter().zip(&down).map(|(dx, dy)| cosine * dy - sine * dx))
    };
    let spreads: Vec<f64> = (0..DIRECTIONS).map(spread).collect();
    let most = spreads.iter().copied().fold(0.0, f64::max);
    let (step, least) = (0..).zip(spreads).min_by(|a, b| a.1.total_cmp(&b.1))?;
    let angle = f64::from(step) * 180.0 / DIRECTIONS as f64;

    let ratio = most / least.max(LEAST_SPREAD);
    let angle = if angle > 90.0 { angle - 180.0 } else { angle };
    (ratio >= CLEAR.0 && most >= CLEAR.1).then_some(Axis { angle, ratio })
}

/// The terms of a quadratic field at a place, as shares of the image from its middle.
fn terms(place: [f64; 2], (rows, cols): (usize, usize)) -> [f64; 6] {
    let (x, y) = (place[0] / cols as f64 - 0.5, place[1] / rows as f64 - 0.5);
    [1.0, x, y, x * y, x * x, y * y]
}

/// The residuals of a robust quadratic fit to some values.
fn rest(terms: &[[f64; 6]], values: Vec<f64>) -> Option<Vec<f64>> {
    let mut errors = values.clone();
    let mut weights = vec![1.0; values.len()];
    for _ in 0..ROUNDS {
        let mut normal = Normal::held([1e-9; 6]);
        for ((terms, value), weight) in terms.iter().zip(&values).zip(&weights) {
            normal.add(terms, *value, *weight);
        }
        let model = normal.solved()?;
        for ((error, terms), value) in errors.iter_mut().zip(terms).zip(&values) {
            *error = value - terms.iter().zip(&model).map(|(term, by)| term * by).sum::<f64>();
        }
        let deviation = deviation(errors.iter().copied()) + LEAST_SPREAD;
        for (weight, error) in weights.iter_mut().zip(&errors) {
            *weight = 1.0 / (error.abs() / deviation).max(SURE);
        }
    }
    Some(errors)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (600, 800);

    /// Matches of things at two distances, which move along lines at an angle; every seventh is a mistake.
    fn matches(angle: f64, by: f64) -> Vec<CornerMatch> {
        let (sine, cosine) = (sin(angle.to_radians()), cos(angle.to_radians()));
        let one = |index: usize| {
            let (x, y) = ((index * 37 % 780) as f64, (index * 101 % 590) as f64);
            let near = by * (index % 3) as f64;
            // The right camera is turned, and its lens distorts.
            let (along, down) = (0.05 * y + 1e-5 * x * y, -0.05 * x + 2e-5 * y * y);
            let wrong = if index.is_multiple_of(7) { (index * 13 % 100) as f64 - 50.0 } else { 0.0 };
            let right = [x + along - near * cosine + wrong, y + down - near * sine - wrong / 3.0];
            CornerMatch { left: [x, y], right }
        };
        (0..210).map(one).collect()
    }

    #[test]
    fn things_move_along_the_lines_on_which_the_cameras_are() {
        for angle in [0.0, 10.0, 45.0, 88.0, -60.0] {
            let found = axis(&matches(angle, 12.0), SIZE).expect("a clear axis");
            assert!((found.angle - angle).abs() <= 4.0, "{angle}: {found:?}");
            assert_eq!(found.is_along_rows(), angle.abs() <= 30.0, "{angle}");
            assert_eq!(found.is_along_columns(), angle.abs() >= 60.0, "{angle}");
        }
    }

    #[test]
    fn a_plane_and_few_matches_show_no_axis() {
        assert_eq!(axis(&matches(90.0, 0.0), SIZE), None);
        assert_eq!(axis(&matches(90.0, 12.0)[..39], SIZE), None);
    }
}

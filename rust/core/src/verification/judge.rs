//! The traits of a claim -> the probability that it is right, and its error bar.
//!
//! A claim is right if it is within 1 px of the true disparity. The logarithms of the odds are sums of lines
//! through points, one for each trait, in three cases: the claim agrees with the own disparity, it does not,
//! or the right image does not see the pixel as far as the own match knows:
//!
//! ```text
//! odds       = offset + sum over traits of line(trait)
//! confidence = 1 / (1 + exp(-odds))
//! bar        = exp(line(odds))                                 # holds 90 % of the errors
//! ahead      = offset + sum over traits of line(trait)         # of pixels that differ, in all cases
//! ```
//!
//! Where a claim and the own disparity differ, `ahead` is the logarithm of the odds that the claim is right, if
//! one of both is. It has lines of its own.
//!
//! `phasestereo bench confidence` learns the lines and writes `weights.rs`.

#[allow(
    clippy::approx_constant,
    clippy::allow_attributes,
    reason = "a weight that was learned may be close to any constant"
)]
mod weights;

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::exp;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::refinement::{calibration, flag};

use crate::verification::traits::{AGREES, TRAITS, Traits, Values};

/// Points of the line of a trait.
pub const KNOTS: usize = 6;
/// Cases with lines of their own.
pub const CASES: usize = 3;
/// Flags of pixels of which the own match knows nothing, or that the right image does not see.
pub const UNSEEN: u16 = flag::MISSING | flag::OUTSIDE | flag::MATCH_MASKED | flag::OCCLUDED;

/// Points of the lines of all traits.
type Lines = [[f32; KNOTS]; TRAITS];

/// Learned weights.
#[derive(Debug)]
struct Weights {
    /// Where the points of each trait are, ascending.
    places: Lines,
    /// What was learned, by case.
    cases: [Learned; CASES],
    /// That a claim is right rather than the own disparity, where they differ.
    ahead: Odds,
}

/// Odds as a sum of lines.
#[derive(Debug)]
struct Odds {
    offset: f32,
    /// The heights of the points of all traits.
    lines: Lines,
}

/// What was learned of one case.
#[derive(Debug)]
struct Learned {
    odds: Odds,
    /// The points of the logarithm of the bar, pixels.
    bars: [f64; calibration::KNOTS],
}

/// How likely a claim is right; NaN without one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chance {
    /// The logarithm of the odds.
    pub odds: f32,
    /// The same that the claim is right rather than the own disparity; 0 where they agree.
    pub ahead: f32,
    /// Its error bar, pixels.
    pub bar: f32,
}

impl Default for Chance {
    fn default() -> Self {
        Self { odds: f32::NAN, ahead: 0.0, bar: f32::NAN }
    }
}

/// How likely all claims are right, on the threads of the current pool.
pub fn chances(traits: &Traits, own: &Disparity, control: &Control) -> Result<Plane<Chance>> {
    Plane::by_rows(traits.size(), control, |y, row: &mut [Chance]| {
        let flags = own.flags.row(y);
        traits.of_row(y, |x, values| row[x] = weights::WEIGHTS.chance(&values, flags[x]));
    })
}

/// The error bar, pixels, of a disparity with these odds and flags where the match and the claim differ.
pub fn bar(odds: f32, flags: u16) -> f32 {
    weights::WEIGHTS.cases[case(f32::INFINITY, flags)].bar(odds)
}

/// The probability with these logarithms of the odds; 0 where these are NaN.
pub fn probability(odds: f32) -> f32 {
    if odds.is_nan() { 0.0 } else { (1.0 / (1.0 + exp(-f64::from(odds)))) as f32 }
}

/// The case of a pixel: 0 if claim and own disparity agree, 2 if the right image does not see it, else 1.
pub fn case(gap: f32, flags: u16) -> usize {
    if flags & UNSEEN != 0 { 2 } else { usize::from(gap > AGREES) }
}

impl Weights {
    /// The chance of a pixel with these traits and flags.
    fn chance(&self, values: &Values, flags: u16) -> Chance {
        let learned = &self.cases[case(values[0], flags)];
        let odds = learned.odds.of(values, &self.places);
        let ahead = if values[0] > AGREES { self.ahead.of(values, &self.places) } else { 0.0 };
        Chance { odds, ahead, bar: learned.bar(odds) }
    }
}

impl Odds {
    /// Those of a pixel with these traits.
    fn of(&self, values: &Values, places: &Lines) -> f32 {
        let mut odds = self.offset;
        for (index, value) in values.iter().enumerate() {
            let (left, part) = place(&places[index], *value);
            let heights = &self.lines[index];
            odds += heights[left] + part * (heights[left + 1] - heights[left]);
        }
        odds
    }
}

impl Learned {
    /// The bar of a claim with these odds.
    fn bar(&self, odds: f32) -> f32 {
        exp(calibration::at(&self.bars, f64::from(odds))) as f32
    }
}

/// The point left of a value, and the part of the way to the next one; values beyond the ends count as these.
fn place(points: &[f32; KNOTS], value: f32) -> (usize, f32) {
    let left = points[1..KNOTS - 1].iter().filter(|point| value >= **point).count();
    let width = points[left + 1] - points[left];
    let part = if width > 0.0 { (value - points[left]) / width } else { 0.0 };
    (left, part.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_through_their_points_and_end_with_them() {
        let points = [0.0, 1.0, 3.0, 3.0, 4.0, 8.0];
        assert_eq!([-1.0, 0.5, 2.0].map(|at| place(&points, at)), [(0, 0.0), (0, 0.5), (1, 0.5)]);
        assert_eq!([3.0, 6.0, 9.0].map(|at| place(&points, at)), [(3, 0.0), (4, 0.5), (4, 1.0)]);
    }

    #[test]
    fn places_of_weights_ascend() {
        for points in &weights::WEIGHTS.places {
            assert!(points.is_sorted(), "{points:?}");
        }
    }
}

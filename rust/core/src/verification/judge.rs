//! The traits of a claim -> the probabilities that the claim and the own disparity are right, and error bars.
//!
//! A disparity is right if it is within 1 px of the true one. The logarithms of the odds are sums of lines
//! through points, one for each trait, in three cases: the claim agrees with the own disparity, it does not,
//! or the right image does not see the pixel as far as the own match knows:
//!
//! ```text
//! odds       = offset + sum over traits of line(trait)         # of the claim, of the own disparity
//! confidence = 1 / (1 + exp(-odds))
//! bar        = exp(line(odds))                                 # holds 90 % of the errors
//! ```
//!
//! That a claim agrees makes the own disparity surer, too, and one that does not makes it less so: its odds
//! here are those once the claim is known. `phasestereo bench confidence` learns the lines and writes
//! `weights.rs`.

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
use phasestereo_match::refinement::flag;

use crate::verification::traits::{AGREES, TRAITS, Traits, Values};

/// Points of the line of a trait.
pub const KNOTS: usize = 6;
/// Cases with lines of their own.
pub const CASES: usize = 3;
/// Points of the line of a bar, one apart, and the place of the first.
const BAR_KNOTS: usize = 10;
const FIRST_BAR_KNOT: f64 = -4.0;
/// Flags of pixels of which the own match knows nothing, or that the right image does not see.
pub const UNSEEN: u16 = flag::MISSING | flag::OUTSIDE | flag::MATCH_MASKED | flag::OCCLUDED;

/// Points of the lines of all traits.
type Lines = [[f32; KNOTS]; TRAITS];

/// Learned weights.
#[derive(Debug)]
struct Weights {
    /// Where the points of each trait are, ascending.
    places: Lines,
    /// Of claims, by case.
    claim: [Learned; CASES],
    /// Of own disparities, by case.
    own: [Learned; CASES],
}

/// What was learned of one case.
#[derive(Debug)]
struct Learned {
    offset: f32,
    /// The heights of the points of all traits.
    lines: Lines,
    /// The points of the logarithm of the bar, pixels.
    bars: [f64; BAR_KNOTS],
}

/// How likely a disparity is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chance {
    /// The logarithm of the odds that it is.
    pub odds: f32,
    /// Its error bar, pixels.
    pub bar: f32,
}

impl Default for Chance {
    fn default() -> Self {
        Self { odds: f32::NAN, bar: f32::NAN }
    }
}

/// How likely the claim and the own disparity of a pixel are right, once both are known; NaN where there is
/// no claim.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Chances {
    /// Of the claim.
    pub claim: Chance,
    /// Of the own disparity.
    pub own: Chance,
}

/// How likely all claims and own disparities are right, on the threads of the current pool.
pub fn chances(traits: &Traits, own: &Disparity, control: &Control) -> Result<Plane<Chances>> {
    Plane::by_rows(traits.size(), control, |y, row: &mut [Chances]| {
        let flags = own.flags.row(y);
        traits.of_row(y, |x, values| row[x] = weights::WEIGHTS.chances(&values, flags[x]));
    })
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
    /// The chances of a pixel with these traits and flags.
    fn chances(&self, values: &Values, flags: u16) -> Chances {
        let case = case(values[0], flags);
        let learned = [&self.claim[case], &self.own[case]];
        let mut odds = learned.map(|one| one.offset);

        for (index, value) in values.iter().enumerate() {
            let (left, part) = place(&self.places[index], *value);
            for (odds, learned) in odds.iter_mut().zip(learned) {
                let heights = &learned.lines[index];
                *odds += heights[left] + part * (heights[left + 1] - heights[left]);
            }
        }

        let chance = |which: usize| Chance {
            odds: odds[which],
            bar: bar(&learned[which].bars, odds[which]),
        };
        Chances { claim: chance(0), own: chance(1) }
    }
}

/// The point left of a value, and the part of the way to the next one; values beyond the ends count as these.
fn place(points: &[f32; KNOTS], value: f32) -> (usize, f32) {
    let left = points[1..KNOTS - 1].iter().filter(|point| value >= **point).count();
    let width = points[left + 1] - points[left];
    let part = if width > 0.0 { (value - points[left]) / width } else { 0.0 };
    (left, part.clamp(0.0, 1.0))
}

/// The bar of a disparity with these odds.
fn bar(points: &[f64; BAR_KNOTS], odds: f32) -> f32 {
    let place = (f64::from(odds) - FIRST_BAR_KNOT).clamp(0.0, (BAR_KNOTS - 1) as f64);
    let left = (place as usize).min(BAR_KNOTS - 2);
    let part = place - left as f64;
    exp(points[left] * (1.0 - part) + points[left + 1] * part) as f32
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

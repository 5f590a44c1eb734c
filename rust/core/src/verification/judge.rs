//! The traits of a claim -> the probability that it is right, and its error bar.
//!
//! A claim is right if it is within 1 px of the true disparity. The logarithms of the odds are sums of lines
//! through points, one for each trait, in three cases: the claim agrees with the own disparity; it does not;
//! or the right image does not show the pixel, as far as the own match shows:
//!
//! ```text
//! odds       = offset + sum over traits of line(trait)
//! confidence = 1 / (1 + exp(-odds))
//! bar        = exp(line(odds))                                 # holds 90 % of the errors
//! ahead      = offset + sum over traits of line(trait)         # of pixels that differ, in all cases
//! ```
//!
//! If a claim and the own disparity differ, `ahead` is the logarithm of the odds that the claim is right,
//! given that one of them is. It has lines of its own.
//!
//! `phasestereo bench confidence --of maps` learns the lines and writes `weights.rs`.

#[allow(
    clippy::approx_constant,
    clippy::allow_attributes,
    reason = "a weight that was learned may be close to any constant"
)]
mod weights;

use std::iter::zip;

use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::exp_single;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::refinement::{calibration, flag};

use crate::verification::traits::{AGREES, LEAST, LOCAL, RowTraits, Stretch, TRAITS, Traits, WIDTH, odds};

/// Points of the line of a trait.
pub const KNOTS: usize = 6;
/// Cases with lines of their own.
pub const CASES: usize = 3;
/// Flags of pixels without an own match, or that the right image does not show.
pub const UNMATCHED: u16 = flag::MISSING | flag::UNSEEN;

/// Points of the lines of all traits.
type Lines = [[f32; KNOTS]; TRAITS];

/// Learned weights.
#[derive(Debug)]
struct Weights {
    /// The places of the points of each trait, ascending.
    places: Lines,
    /// The learned weights, by case.
    cases: [Learned; CASES],
    /// Odds that a claim is right rather than the own disparity, where they differ.
    ahead: Odds,
}

/// Odds as a sum of lines.
#[derive(Debug)]
struct Odds {
    offset: f32,
    /// The heights of the points of all traits.
    lines: Lines,
}

/// The learned weights of one case.
#[derive(Debug)]
struct Learned {
    odds: Odds,
    /// The points of the logarithm of the bar, pixels.
    bars: [f32; calibration::KNOTS],
}

/// The chance that a claim is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chance {
    /// The probability; 0 without a claim.
    pub confidence: f32,
    /// The logarithm of the odds that the claim is right rather than the own disparity; 0 if they agree, or
    /// either is missing.
    pub ahead: f32,
    /// The error bar of the claim, pixels; NaN without one.
    pub bar: f32,
}

impl Default for Chance {
    fn default() -> Self {
        Self { confidence: 0.0, ahead: 0.0, bar: f32::NAN }
    }
}

/// The chances of all claims, on the threads of the current pool.
pub fn chances(traits: &Traits, runtime: Runtime) -> Result<Plane<Chance>> {
    let weights = &weights::WEIGHTS;
    let cases = weights.cases.each_ref().map(|learned| {
        (Sum::new(&learned.odds, &weights.places, &traits.pair), Line::of_bars(&learned.bars))
    });
    let ahead = Sum::new(&weights.ahead, &weights.places, &traits.pair);
    traits.by_rows(runtime.control, |traits, row| judge_row(runtime.level(), traits, &cases, &ahead, row))
}

/// The error bar, pixels, of a disparity with this confidence and these flags, where the match and the claim
/// differ.
pub fn bar(confidence: f32, flags: u16) -> f32 {
    let case = if flags & UNMATCHED != 0 { 2 } else { 1 };
    exp_single(Line::of_bars(&weights::WEIGHTS.cases[case].bars).at(odds(confidence)))
}

/// The confidence, kept away from 0 and 1.
pub fn kept(confidence: f32) -> f32 {
    confidence.clamp(LEAST, 1.0 - LEAST)
}

/// A line through points, level beyond them: a height, and its bend at each point but the last.
#[derive(Debug)]
struct Line<const BENDS: usize> {
    height: f32,
    bends: [(f32, f32); BENDS],
    last: f32,
}

impl<const BENDS: usize> Line<BENDS> {
    /// The line through some points with ascending places.
    fn through(places: impl Fn(usize) -> f32, heights: &[f32]) -> Self {
        let mut before = 0.0;
        let bends = std::array::from_fn(|knot| {
            let width = places(knot + 1) - places(knot);
            let slope = if width > 0.0 { (heights[knot + 1] - heights[knot]) / width } else { 0.0 };
            let bend = slope - before;
            before = slope;
            (places(knot), bend)
        });
        Self { height: heights[0], bends, last: places(BENDS) }
    }

    #[inline(always)]
    fn at(&self, value: f32) -> f32 {
        let value = if value < self.last { value } else { self.last };
        self.bends.iter().fold(self.height, |sum, (place, bend)| {
            let beyond = value - place;
            sum + bend * if beyond > 0.0 { beyond } else { 0.0 }
        })
    }
}

impl Line<{ calibration::KNOTS - 1 }> {
    /// The line of the bars of a case, by odds.
    fn of_bars(bars: &[f32; calibration::KNOTS]) -> Self {
        Self::through(|knot| calibration::FIRST_KNOT as f32 + knot as f32, bars)
    }
}

/// The odds of the pixels of one pair: the contribution of its traits, and the lines of the local ones.
struct Sum {
    offset: f32,
    lines: [Line<{ KNOTS - 1 }>; LOCAL],
}

impl Sum {
    fn new(odds: &Odds, places: &Lines, pair: &[f32]) -> Self {
        let line = |which: usize| Line::through(|knot| places[which][knot], &odds.lines[which]);
        let of_pair = zip(LOCAL.., pair).map(|(which, value)| line(which).at(*value));
        Self { offset: odds.offset + of_pair.sum::<f32>(), lines: std::array::from_fn(line) }
    }

    #[inline(always)]
    fn of(&self, traits: &Stretch) -> [f32; WIDTH] {
        let mut odds = [self.offset; WIDTH];
        for (line, values) in zip(&self.lines, traits) {
            zip(&mut odds, values).for_each(|(sum, value)| *sum += line.at(*value));
        }
        odds
    }
}

/// Judges the claims of a row, a stretch at a time, by the cases that occur in it.
#[leveled]
fn judge_row(
    level: Level,
    traits: &RowTraits<'_>,
    cases: &[(Sum, Line<{ calibration::KNOTS - 1 }>); CASES],
    ahead: &Sum,
    row: &mut [Chance],
) {
    let (claims, own, flags) = traits.known();
    let stretches = zip(row.chunks_mut(WIDTH), zip(claims.chunks(WIDTH), flags.chunks(WIDTH)));
    let mut values = [[0.0; WIDTH]; LOCAL];
    for (first, (out, (claims, flags))) in zip((0..).step_by(WIDTH), stretches) {
        traits.write_stretch(first, &mut values);
        let gaps = &values[0];
        let mut of_pixel = [0; WIDTH];
        for (case, (gap, flags)) in zip(&mut of_pixel, zip(gaps, flags)) {
            *case = if flags & UNMATCHED != 0 { 2 } else { u32::from(*gap > AGREES) };
        }

        for (case, (odds, bars)) in (0..).zip(cases) {
            if !of_pixel[..out.len()].contains(&case) {
                continue;
            }
            let odds = odds.of(&values);
            let [mut confidence, mut bar] = [[0.0; WIDTH]; 2];
            for at in 0..WIDTH {
                confidence[at] = probability(odds[at]);
                bar[at] = exp_single(bars.at(odds[at]));
            }
            for (at, (out, claim)) in zip(&mut *out, claims).enumerate() {
                if of_pixel[at] == case && claim.is_finite() {
                    *out = Chance { confidence: confidence[at], ahead: 0.0, bar: bar[at] };
                }
            }
        }
        if gaps[..out.len()].iter().any(|gap| *gap > AGREES) {
            let differs = zip(claims, &own[first..]).map(|(claim, own)| (own - claim).abs());
            for (out, (gap, ahead)) in zip(&mut *out, zip(differs, ahead.of(&values))) {
                if gap.is_finite() && gap > AGREES {
                    out.ahead = ahead;
                }
            }
        }
    }
}

/// The probability for this logarithm of the odds.
#[inline(always)]
fn probability(odds: f32) -> f32 {
    1.0 / (1.0 + exp_single(-odds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_through_their_points_and_end_with_them() {
        let (places, heights) = ([0.0, 1.0, 3.0, 3.0, 4.0, 8.0], [2.0, 1.0, 5.0, 5.0, 5.0, 3.0]);
        let line = Line::<5>::through(|knot| places[knot], &heights);
        let found = [-1.0, 0.0, 0.5, 2.0, 3.0, 4.0, 6.0, 8.0, 9.0].map(|at| line.at(at));
        let expected = [2.0, 2.0, 1.5, 3.0, 5.0, 5.0, 4.0, 3.0, 3.0_f32];
        assert_eq!(found.map(f32::to_bits), expected.map(f32::to_bits));
    }

    #[test]
    fn places_of_weights_ascend_and_heights_at_one_place_are_the_same() {
        let weights = &weights::WEIGHTS;
        let all = weights.cases.iter().map(|learned| &learned.odds).chain([&weights.ahead]);
        for (points, heights) in all.flat_map(|odds| zip(&weights.places, &odds.lines)) {
            assert!(points.is_sorted(), "{points:?}");
            for (points, heights) in zip(points.windows(2), heights.windows(2)) {
                let step = (heights[0] - heights[1]).abs();
                assert!(points[0] < points[1] || step < 0.002, "{heights:?}");
            }
        }
    }
}

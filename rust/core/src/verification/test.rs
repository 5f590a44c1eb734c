//! Claims, the own match and the evidence -> a verdict for each pixel.
//!
//! The score of a claim is the logarithm of the odds that it is off by more than a pixel, given its
//! surroundings:
//!
//! ```text
//! by       = |own - claim|
//! score    = OFFSET
//!          + BY       * min(by - 1, 2)                     # how far apart the two are
//!          + SOON     * min(by - 1, 0.5)                   # the first half pixel counts most
//!          + TRUST    * logit(mean confidence of the own match, 9 x 9)
//!          + EVIDENCE * clamp(evidence, -20, 60)           # `evidence`
//!          + JUMP     * min(range of the claims, 7 x 7, 3) # maps fail near their jumps
//!          + NOWHERE  * min(least |own - claim| over the own disparities, 7 x 7, 1.5)
//!          + HIDDEN   if the map itself has a nearer pixel in front of the right one that this pixel claims
//! ```
//!
//! The weights come from a logistic regression over maps of `HITNet` and of `StereoSGBM`: 12 Middlebury
//! pairs, unchanged, with one image out of focus, with noise, as JPEG, and with both out of focus. Inputs
//! were chosen by leaving out each of these conditions once: only inputs that help on all of them were kept.
//! The offset was then set so that fewer than 1 % of the right pixels of `HITNet` are refuted in unchanged
//! and noisy pairs, and about 2 % out of focus. Trees over 44 inputs, including a match of the other image
//! and one with other settings, refute 2 to 6 points more of the wrong pixels.
//!
//! `HIDDEN` was set by hand: pixels that the right image does not show are not in the regression, and a map
//! that is right there contradicts the match. With -0.7, fewer of them are refuted, and 1 to 2 points less of
//! the wrong pixels.

use crate::verification::evidence::DIFFERENT;
use crate::verification::hypotheses::right_column;
use crate::verification::judge::UNMATCHED;
use crate::verification::traits::{self, RANGE, RightColumns};
use crate::verification::{Counts, verdict};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::ln;
use phasestereo_match::base::plane::{Plane, TASK_ROWS, around, zeroed};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::refinement::calibration::STEPS;

const OFFSET: f64 = -1.95;
const BY: f64 = 0.43;
const SOON: f64 = 1.34;
const TRUST: f64 = 0.21;
const EVIDENCE: f64 = 0.029;
const JUMP: f64 = 0.35;
const NOWHERE: f64 = 0.87;
const HIDDEN: f64 = -0.4;

/// Least score of a refuted claim: odds of more than 4.
const REFUTED: f64 = 1.45;
/// Most pixels by which a supported claim differs from the own disparity.
const SUPPORTS: f32 = 1.5;
/// Least confidence of an own disparity that supports a claim.
const CONFIDENT: f32 = 0.8;

/// The inputs of the verdicts; planes of one size.
#[derive(Debug, Clone, Copy)]
pub struct Test<'a> {
    /// The claims; non-finite values make no claim.
    pub map: &'a Plane<f32>,
    /// The own match, with confidences.
    pub own: &'a Disparity,
    /// The evidence against the claims, from the costs.
    pub against: &'a Plane<f32>,
}

impl Test<'_> {
    /// The verdicts and their numbers, on the threads of the current pool.
    pub fn judge(&self, runtime: Runtime) -> Result<(Plane<u8>, Counts)> {
        let (rows, cols) = self.map.size();
        let verdicts = Plane::by_bands((rows, cols), TASK_ROWS, |first, band: &mut [u8]| {
            runtime.control.checkpoint()?;
            let trust = self.trust(first..first + band.len() / cols, runtime.level())?;
            let lines = band.chunks_exact_mut(cols).zip(trust.chunks_exact(cols));
            for (y, (line, trust)) in (first..).zip(lines) {
                let right = RightColumns::new(self.map.row(y));
                for (x, (out, trust)) in line.iter_mut().zip(trust).enumerate() {
                    let hidden = if right.is_hidden(x, self.map.row(y)[x]) { HIDDEN } else { 0.0 };
                    *out = self.verdict(y, x, OFFSET + TRUST * trust + hidden);
                }
            }
            Ok(())
        })?;

        let counts = self.counts(&verdicts);
        Ok((verdicts, counts))
    }

    fn verdict(&self, y: usize, x: usize, base: f64) -> u8 {
        let (claim, own) = (self.map.row(y)[x], self.own.disparity.row(y)[x]);
        if !claim.is_finite() {
            return verdict::NO_CLAIM;
        }
        if own.is_nan() || self.own.flags.row(y)[x] & UNMATCHED != 0 {
            return verdict::UNKNOWN;
        }

        let by = (own - claim).abs();
        if by > DIFFERENT && base + self.score(y, x, by) > REFUTED {
            return verdict::REFUTED;
        }

        let is_supported = by <= SUPPORTS && self.confidence(y, x) > CONFIDENT;
        if is_supported { verdict::SUPPORTED } else { verdict::UNKNOWN }
    }

    /// The part of the score that depends on how claim and own disparity differ.
    fn score(&self, y: usize, x: usize, by: f32) -> f64 {
        let around = self.around(y, x);
        let beyond = f64::from(by) - 1.0;

        BY * beyond.min(2.0)
            + SOON * beyond.min(0.5)
            + EVIDENCE * f64::from(self.against.row(y)[x]).clamp(-20.0, 60.0)
            + JUMP * f64::from(around.range).min(3.0)
            + NOWHERE * f64::from(around.nearest).min(1.5)
    }

    /// The surroundings of a pixel among claims and own disparities.
    fn around(&self, y: usize, x: usize) -> Around {
        let (map, own) = (self.map, &self.own.disparity);
        let columns = around(x, RANGE, map.cols());
        let claim = map.row(y)[x];

        let (mut low, mut high, mut nearest) = (claim, claim, f32::INFINITY);
        for v in around(y, RANGE, map.rows()) {
            let pixels = map.row(v)[columns.clone()].iter().zip(&own.row(v)[columns.clone()]);
            for (other, own) in pixels {
                let other = if other.is_finite() { *other } else { claim };
                (low, high) = (low.min(other), high.max(other));
                nearest = nearest.min((own - claim).abs());
            }
        }

        Around { range: high - low, nearest }
    }

    /// The logit of the mean confidence around the pixels of some rows.
    fn trust(&self, rows: std::ops::Range<usize>, level: Level) -> Result<Vec<f64>> {
        let size = self.map.size();
        let windows = Windows::new(size, traits::NEAR);
        let mut trust = zeroed(rows.len() * size.1)?;

        let steps = |y: usize| (0..size.1).map(move |x| [(self.confidence(y, x) * STEPS) as i32]);
        let mean = |y: usize, x: usize, [sum]: [i32; 1]| {
            f64::from(sum) / f64::from(STEPS) / f64::from(windows.pixels(y, x))
        };
        windows.write((rows.start, &mut trust), steps, mean, level)?;
        for mean in &mut trust {
            *mean = logit(*mean).clamp(-3.0, 4.0);
        }

        Ok(trust)
    }

    fn confidence(&self, y: usize, x: usize) -> f32 {
        self.own.confidence.as_ref().map_or(0.0, |confidence| confidence.row(y)[x])
    }

    fn counts(&self, verdicts: &Plane<u8>) -> Counts {
        let mut counts = Counts::default();
        let cols = self.map.cols();

        for y in 0..verdicts.rows() {
            let pixels = verdicts.row(y).iter().zip(self.map.row(y)).enumerate();
            for (x, (verdict, claim)) in pixels {
                counts.verdicts[usize::from(*verdict)] += 1;
                let is_outside = claim.is_finite() && right_column(x, *claim, cols).is_none();
                counts.outside += u64::from(is_outside);
            }
        }

        counts
    }
}

/// The surroundings of a pixel, pixels.
struct Around {
    /// Range of the claims.
    range: f32,
    /// The least difference of an own disparity from the claim.
    nearest: f32,
}

/// The logarithm of the odds of a probability, kept away from 0 and 1.
fn logit(probability: f64) -> f64 {
    let probability = probability.clamp(0.001, 0.999);
    ln(probability / (1.0 - probability))
}

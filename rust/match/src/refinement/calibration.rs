//! Raw confidences -> probabilities that a disparity is within 1 px of the true one, and error bars.
//!
//! Disparities with a raw confidence of 0.8 are right in 95 % of the pixels of a sharp pair, but in half of
//! those of a pair that has failed. Traits of the pair distinguish the two, above all the mean of the raw
//! confidences themselves. So straight lines map the logarithms of the odds; their slopes and heights depend
//! on the traits, with one line for a pixel's own disparity and one for filled ones. Beside an outline, where
//! a surface that grew beyond its edge looks as sure as inside, the line of a pixel's own one is lower:
//!
//! ```text
//! outline    = a jump between neighbors in the row, at most OUTLINE_REACH pixels away
//! trait      = 1, odds of the mean raw confidence of pixels not filled, how far these are below LOW_ODDS,
//!              odds of the share that fails the checks, noise, smoothing, whether there is a blur,
//!              share at the ends of the searched range
//! z          = sum of trait (height + slope odds(raw) + if beside an outline: height
//!              + if filled: height + slope odds(raw))
//! confidence = 1 / (1 + exp(-z))
//! bar        = exp(line through KNOTS points at z, own or filled + sum of trait bars)
//! odds(p)    = ln(p / (1 - p))
//! ```
//!
//! Both are functions of the raw confidence and of the kind of pixel, so they are tables made once per pair.
//! The weights are learned by `phasestereo bench confidence`, which writes `weights.rs`.
//!
//! The traits are those of the whole pair. For tall images they come from a fixed set of rows, so that parts
//! of a pair can be matched by themselves once these rows are known.

mod weights;

use std::iter;
use std::ops::Range;
use std::sync::OnceLock;

use rayon::prelude::*;

use crate::base::error::Result;
use crate::base::math::{exp, ln};
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled, whole};
use crate::choices::{
    FEW_ROWS, LEAST_MEAN_CONFIDENCE, LEAST_SHARE, LOW_ODDS, NO_NOISE, NO_SMOOTHING, NONE_AT_ENDS,
    OUTLINE_REACH, SAMPLED_BAND_ROWS, SAMPLED_BANDS,
};
use crate::pair::Pair;
use crate::pair::blur_compensation::BlurCompensation;
use crate::pair::candidates::Candidates;
use crate::refinement::flag;
use crate::refinement::jumps::Mark;
use crate::settings::Optimizer;

/// Traits of a pair.
pub const TRAITS: usize = 8;
/// Points of the logarithm of the bar.
pub const KNOTS: usize = 10;
/// The first of these points; the others follow in steps of 1.
pub const FIRST_KNOT: f64 = -4.0;
/// Steps of a raw confidence.
pub const BINS: usize = 1024;
/// Steps of a confidence that is summed: integers give the same sum in any order.
pub const STEPS: f32 = (1 << 20) as f32;
/// Pixels whose confidences, in steps, sum to less than 2^32.
pub const PART: usize = 2048;
/// Flags of pixels that fail the left-right check or are speckles.
pub const FAILED: u16 = flag::OCCLUDED | flag::MISMATCHED | flag::SPECKLE;

/// Learned weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// For each trait: height, slope, the amount that an outline adds to the height, and those that filled
    /// pixels add to both.
    pub odds: [[f64; 5]; TRAITS],
    /// The points of the logarithm of the bar, for a pixel's own disparity and for filled ones.
    pub knots: [[f64; KNOTS]; 2],
    /// The part of the bar that each trait adds.
    pub bars: [f64; TRAITS],
}

impl Weights {
    /// The weights learned from matches by this optimizer. With fewer paths, a raw confidence means less.
    pub fn of(optimizer: Optimizer) -> &'static Self {
        let [four_paths, two_paths, none] = &weights::WEIGHTS;
        match optimizer {
            Optimizer::SemiGlobal => four_paths,
            Optimizer::ScanlineOptimization => two_paths,
            Optimizer::DynamicProgramming | Optimizer::WinnerTakesAll => none,
        }
    }
}

/// Sums over pixels of a raw map that show how well a pair was matched.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Raw confidences of pixels not filled, in steps.
    pub confidence: u64,
    /// The number of these pixels.
    pub own: u64,
    /// Pixels that fail the left-right check or are speckles.
    pub failed: u64,
    /// Pixels not filled whose disparity is at an end of the searched range, unless that end is zero: nothing
    /// lies beyond infinity.
    pub ends: u64,
    /// All pixels.
    pub pixels: u64,
}

impl Tally {
    /// The sums over some pixels whose disparities were searched among these candidates.
    pub fn new(confidence: &[f32], disparity: &[f32], flags: &[u16], candidates: Candidates) -> Self {
        let [low, high] = [0, candidates.count() - 1].map(|k| candidates.disparity(k) as f32);
        // Sub-pixel disparities lie up to half a pixel from their candidate.
        let below = if low == 0.0 { f32::NEG_INFINITY } else { low + 0.5 };
        let above = if high == 0.0 { f32::INFINITY } else { high - 0.5 };

        let parts = confidence.chunks(PART).zip(disparity.chunks(PART)).zip(flags.chunks(PART));
        let tally = |((confidence, disparity), flags)| {
            tally_part(Level::best(), confidence, disparity, flags, [below, above])
        };
        parts.map(tally).fold(Self::default(), Self::and)
    }

    /// The sums over the sampled rows of a whole raw map.
    pub fn of_sample(
        confidence: &Plane<f32>,
        disparity: &Plane<f32>,
        flags: &Plane<u16>,
        candidates: Candidates,
    ) -> Self {
        let rows: Vec<usize> = sampled(flags.rows()).into_iter().flatten().collect();
        let sums = rows
            .into_par_iter()
            .map(|y| Self::new(confidence.row(y), disparity.row(y), flags.row(y), candidates));
        sums.reduce(Self::default, Self::and)
    }

    /// The sums over the pixels of both.
    pub fn and(self, other: Self) -> Self {
        Self {
            confidence: self.confidence + other.confidence,
            own: self.own + other.own,
            failed: self.failed + other.failed,
            ends: self.ends + other.ends,
            pixels: self.pixels + other.pixels,
        }
    }
}

/// Sums over at most [`PART`] pixels. `ends`: disparities below the first and above the second are at an end.
#[leveled]
fn tally_part(level: Level, confidence: &[f32], disparity: &[f32], flags: &[u16], ends: [f32; 2]) -> Tally {
    let [mut confidences, mut own, mut failed, mut at_ends] = [0u32; 4];

    for ((confidence, disparity), flags) in confidence.iter().zip(disparity).zip(flags) {
        let is_own = (flags & flag::FILLED == 0) & !disparity.is_nan();
        let steps = whole(confidence * STEPS) as u32;
        confidences += if is_own { steps } else { 0 };
        own += u32::from(is_own);
        at_ends += u32::from(is_own & ((*disparity < ends[0]) | (*disparity > ends[1])));
        failed += u32::from(flags & FAILED != 0);
    }

    Tally {
        confidence: confidences.into(),
        own: own.into(),
        failed: failed.into(),
        ends: at_ends.into(),
        pixels: flags.len() as u64,
    }
}

/// The rows that are tallied in an image of this height.
pub fn sampled(height: usize) -> Vec<Range<usize>> {
    if height <= FEW_ROWS {
        return iter::once(0..height).collect();
    }

    let (count, rows) = (SAMPLED_BANDS, SAMPLED_BAND_ROWS);
    let first = |index: usize| (2 * index + 1) * height / (2 * count) - rows / 2;
    (0..count).map(|index| first(index)..first(index) + rows).collect()
}

/// The logarithm of the odds of a share.
fn odds(share: f64) -> f64 {
    let share = share.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE);
    ln(share / (1.0 - share))
}

/// The log odds at the middle of every step of a raw confidence, computed once.
fn odds_of_bins() -> &'static [f64] {
    static ODDS: OnceLock<Vec<f64>> = OnceLock::new();
    ODDS.get_or_init(|| (0..BINS).map(|bin| odds((bin as f64 + 0.5) / BINS as f64)).collect())
}

/// Faults of a pair that lower its confidences.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Faults {
    /// Standard deviation of the noise of the noisier image, gray levels of 8 bits.
    noise: f64,
    /// Standard deviation of the smoothing of the more smoothed image, gray levels of 8 bits.
    smoothing: f64,
    /// Whether a blur is compensated.
    is_blurred: bool,
}

impl Faults {
    /// The faults that are compensated; a gray level is `gray_level` units of the pixels.
    pub fn new(compensation: Option<&BlurCompensation>, gray_level: f64) -> Self {
        let largest = |values: [f64; 2]| values[0].max(values[1]) / gray_level;

        compensation.map_or(Self::default(), |found| Self {
            noise: largest(found.noise()),
            smoothing: largest(found.smoothing()),
            is_blurred: found.has_kernels(),
        })
    }

    /// The faults that are compensated in a pair. The left image, which is never resampled, defines the gray
    /// level.
    pub fn of_pair(pair: &Pair) -> Self {
        let [left, _] = pair.views();
        // A constant image has no range.
        let level = left.scale().width() / 255.0;

        Self::new(pair.blur_compensation(), if level > 0.0 { level } else { 1.0 })
    }
}

/// The traits of a pair.
pub fn traits(tally: Tally, faults: Faults) -> [f64; TRAITS] {
    let share = |part: u64, whole: u64| part as f64 / whole.max(1) as f64;
    let own = odds((share(tally.confidence, tally.own) / f64::from(STEPS)).max(LEAST_MEAN_CONFIDENCE));
    let failed = odds(share(tally.failed, tally.pixels));
    let ends = ln(share(tally.ends, tally.pixels) + NONE_AT_ENDS);

    let blur = if faults.is_blurred { 1.0 } else { 0.0 };
    let noise = ln(faults.noise + NO_NOISE);
    let smoothing = ln(faults.smoothing + NO_SMOOTHING);
    [1.0, own, (LOW_ODDS - own).max(0.0), failed, noise, smoothing, blur, ends]
}

/// The confidence and the bar for every raw confidence of one pair.
#[derive(Debug)]
pub struct ConfidenceCalibration {
    /// For a pixel's own disparity, for its own beside an outline, then for filled ones.
    tables: Vec<[f32; 2]>,
}

impl ConfidenceCalibration {
    /// The tables of a pair with these traits.
    pub fn new(traits: &[f64; TRAITS], weights: &Weights) -> Self {
        let sum = |which: usize| -> f64 {
            traits.iter().zip(&weights.odds).map(|(value, weights)| value * weights[which]).sum()
        };
        let wider: f64 = traits.iter().zip(&weights.bars).map(|(value, weight)| value * weight).sum();

        let [height, slope, outline, filled_height, filled_slope] = [0, 1, 2, 3, 4].map(sum);

        let table = |height: f64, slope: f64, knots: usize| {
            odds_of_bins().iter().map(move |odds| {
                let z = height + slope * odds;
                let confidence = 1.0 / (1.0 + exp(-z));
                [confidence as f32, exp(at(&weights.knots[knots], z) + wider) as f32]
            })
        };
        let own = table(height, slope, 0).chain(table(height + outline, slope, 0));
        Self { tables: own.chain(table(height + filled_height, slope + filled_slope, 1)).collect() }
    }

    /// Replaces raw confidences, and returns the bars; without a disparity they are 0 and NaN. Pixels filled
    /// where the right image shows nothing have no support, whatever surrounds them.
    pub fn apply(
        &self,
        confidence: &mut Plane<f32>,
        disparity: &Plane<f32>,
        flags: &Plane<u16>,
        level: Level,
    ) -> Result<Plane<f32>> {
        let cols = disparity.cols();
        let mut bars = Plane::new(disparity.rows(), cols)?;

        let rows = confidence.as_mut_slice().par_chunks_mut(cols);
        let rows = rows.zip(bars.as_mut_slice().par_chunks_mut(cols)).enumerate();
        rows.try_for_each_init(
            || zeroed(cols),
            |outlines, (y, (confidence, bars))| {
                let outlines = outlines.as_mut().map_err(|error| error.clone())?;
                let here = disparity.row(y);
                // The row below is not looked at: it may be that of another part of the pair.
                level.run(Mark::<OUTLINE_REACH> { here, below: here, jumps: outlines });

                let map = here.iter().zip(flags.row(y)).zip(outlines);
                for ((confidence, bar), ((disparity, flags), outline)) in
                    confidence.iter_mut().zip(bars).zip(map)
                {
                    let raw = if flags & flag::MISSING == 0 { *confidence } else { 0.0 };
                    let kind = if flags & flag::FILLED == 0 { usize::from(*outline != 0) } else { 2 };
                    [*confidence, *bar] = self.of_pixel([raw, *disparity], kind);
                }
                Ok(())
            },
        )?;

        Ok(bars)
    }

    /// Confidence and bar of a pixel, from its raw confidence and its disparity.
    #[inline(always)]
    fn of_pixel(&self, [raw, disparity]: [f32; 2], kind: usize) -> [f32; 2] {
        let bin = ((raw * BINS as f32) as i32).clamp(0, BINS as i32 - 1) as usize;
        let known = self.tables[kind * BINS + bin];
        if disparity.is_nan() { [0.0, f32::NAN] } else { known }
    }
}

/// The height of the line through points one apart; beyond the ends, that of the last point.
pub fn at(knots: &[f64; KNOTS], z: f64) -> f64 {
    let place = (z - FIRST_KNOT).clamp(0.0, (KNOTS - 1) as f64);
    let left = (place as usize).min(KNOTS - 2);
    let part = place - left as f64;

    knots[left] * (1.0 - part) + knots[left + 1] * part
}

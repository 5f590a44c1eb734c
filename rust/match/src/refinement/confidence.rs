//! The costs of a disparity and the disparities around it -> confidence: the likelihood that it is right.
//!
//! Every pixel votes for its own disparity, more strongly the further its best candidate is ahead of all
//! others. The support of a disparity is the share of the votes around it that agree, weighted by the
//! similarity of gray values, since similar pixels tend to show the same surface:
//!
//! ```text
//! vote(q)    = ahead(q) / (ahead(q) + HALF_VOTE)          # ahead: second-best cost - best cost
//! weight(q)  = s^2 / (s^2 + (gray(p) - gray(q))^2)        # s: SIMILAR_GRAY mean differences of neighbors
//! support(p) = sum of weight(q) vote(q) over q that agree / sum of weight(q) over all q with a disparity
//! confidence = support^3 / (support^3 + HALF_SUPPORT)
//! ```
//!
//! So a weak pixel among strong ones that agree is trusted, and a strong pixel that stands alone is not.
//!
//! Neighbors are processed in opposite pairs. Gray values are in units of `s`, and the two weights of a pair,
//! `1 / a` and `1 / b`, are `b / (a b)` and `a / (a b)`: this replaces two divisions, the slowest operations,
//! by one.
//!
//! It separates right from wrong pixels better than the ratio of the second-best cost to the best one (PKR)
//! or their relative margin, on sharp and on degraded pairs. Adding other measures did not improve it: the
//! left-right check, the cost of other pixels with the same match, the share of paths that agree, the cost
//! itself, the share of penalties in it, whether a pixel was filled. `phasestereo bench confidence` measures
//! its performance.
//!
//! X. Hu, P. Mordohai: *A Quantitative Evaluation of Confidence Measures for Stereo Vision*, PAMI 2012.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled};
use crate::choices::{AGREEMENT, CONFIDENCE_RADIUS, CONFIDENCE_STEP, HALF_SUPPORT, HALF_VOTE, SIMILAR_GRAY};
use crate::image::texture::{Roughness, Texture};
use crate::optimization::evidence::NONE;
use crate::pair::plan::{Plan, Stage};
use crate::refinement::window_rows::{BAND, WindowRows, missing_rows};

const _: () = assert!(CONFIDENCE_RADIUS.is_multiple_of(CONFIDENCE_STEP), "a pixel has a vote for itself");

/// Rows within reach of one row, which is in the middle.
const ROWS: usize = 2 * CONFIDENCE_RADIUS + 1;
/// Rows of these, and columns, that count.
const SIDE: usize = 2 * CONFIDENCE_RADIUS / CONFIDENCE_STEP + 1;
/// The gray value of pixels without a disparity, in units of the difference at which votes count half: their
/// weight vanishes beside the pixel's own of 1, and the product of the inverses of two weights is still
/// finite.
pub const UNLIKE: f32 = (1u32 << 30) as f32;

/// The computation of confidences.
pub struct Confidences;

impl Stage for Confidences {
    fn reach(&self, plan: Plan) -> usize {
        if plan.settings.needs_confidence() { CONFIDENCE_RADIUS } else { 0 }
    }
}

/// The cost margin of a choice: its aggregated cost, and the lowest one among candidates not next to it,
/// since neighbors see the same match.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CostMargin {
    /// Cost of the chosen candidate.
    pub best: u32,
    /// Second-best cost; `None`: all candidates are next to the chosen one.
    pub second_best: Option<u32>,
}

impl CostMargin {
    /// The margin of a choice with this cost and this second-best one, or [`NONE`].
    #[inline(always)]
    pub fn new(best: u32, second_best: u32) -> Self {
        Self { best, second_best: (second_best != NONE).then_some(second_best) }
    }

    /// Whether the cost of the choice is not at least `percent` (at most 100) of the second-best one below
    /// that.
    #[inline(always)]
    pub fn is_ambiguous(self, percent: u64) -> bool {
        let best = u64::from(self.best);
        self.second_best.is_some_and(|second_best| u64::from(second_best) * (100 - percent) < best * 100)
    }
}

/// The vote of a pixel, from 0 to 1, given its cost margin; `unit` steps are one unit of the mean cost.
#[inline(always)]
pub fn vote(margin: CostMargin, unit: f32) -> f32 {
    let Some(second_best) = margin.second_best else { return 0.0 };

    let ahead = second_best.saturating_sub(margin.best) as f32;
    ahead / (ahead + HALF_VOTE * unit)
}

/// The confidence, from 0 to 1, of a disparity with this support, from 0 to 1.
#[inline(always)]
pub fn confidence(support: f32) -> f32 {
    let cube = support * support * support;
    cube / (cube + HALF_SUPPORT)
}

/// A map and the votes for it, in planes of one size.
#[derive(Debug, Clone, Copy)]
pub struct VotedMap<'a> {
    /// Disparities, pixels; NaN: none.
    pub disparity: &'a Plane<f32>,
    /// Votes for them, from 0 to 1.
    pub votes: &'a Plane<f32>,
    /// Gray values of the left image.
    pub texture: &'a Texture<'a>,
}

impl VotedMap<'_> {
    /// The confidence of every disparity; 0: none.
    pub fn confidences(&self, out: &mut Plane<f32>, level: Level, control: &Control) -> Result<()> {
        let cols = self.disparity.cols();
        let similar = similar(self.texture.roughness);

        out.write_bands(BAND, |first, band| {
            control.checkpoint()?;

            let rows = VotedRows {
                disparity: WindowRows::new(cols, f32::NAN)?,
                votes: WindowRows::new(cols, 0.0)?,
                gray: WindowRows::new(cols, UNLIKE)?,
            };
            let weights = zeroed(cols)?;
            support(level, *self, first, similar, rows, weights, band);
            Ok(())
        })
    }
}

/// The square of the difference of gray values at which votes count half; the difference is at least one
/// step.
pub fn similar(roughness: Roughness) -> f32 {
    let difference = (SIMILAR_GRAY * roughness.mean()).max(1.0) as f32;
    difference * difference
}

/// The rows within reach of one row; row `y` of the map has number `y + CONFIDENCE_RADIUS`.
struct VotedRows {
    disparity: WindowRows<f32, ROWS>,
    votes: WindowRows<f32, ROWS>,
    /// In units of the difference at which votes count half.
    gray: WindowRows<f32, ROWS>,
}

impl VotedRows {
    /// Copies the row of this number from the map; beyond the map there are no disparities.
    #[inline(always)]
    fn copy(&mut self, number: usize, map: VotedMap, scale: f32) {
        let [disparity, votes, gray] =
            [&mut self.disparity, &mut self.votes, &mut self.gray].map(|rows| rows.row_mut(number));

        let Some(y) = number.checked_sub(CONFIDENCE_RADIUS).filter(|y| *y < map.disparity.rows()) else {
            disparity.fill(f32::NAN);
            gray.fill(UNLIKE);
            return;
        };

        disparity.copy_from_slice(map.disparity.row(y));
        votes.copy_from_slice(map.votes.row(y));
        for ((to, from), disparity) in gray.iter_mut().zip(map.texture.gray.row(y)).zip(disparity) {
            *to = if disparity.is_nan() { UNLIKE } else { *from as f32 * scale };
        }
    }

    /// The row of this number, starting `before` columns before its first one.
    #[inline(always)]
    fn row(&self, number: usize, before: usize, count: usize) -> VotedPixels<'_> {
        let [disparity, votes, gray] =
            [&self.disparity, &self.votes, &self.gray].map(|rows| &rows.row(number, before)[..count]);
        VotedPixels { disparity, votes, gray }
    }
}

/// Neighboring pixels of a row.
#[derive(Clone, Copy)]
struct VotedPixels<'a> {
    disparity: &'a [f32],
    votes: &'a [f32],
    gray: &'a [f32],
}

impl VotedPixels<'_> {
    /// The first ones.
    #[inline(always)]
    fn part(self, count: usize) -> Self {
        let Self { disparity, votes, gray } = self;
        Self { disparity: &disparity[..count], votes: &votes[..count], gray: &gray[..count] }
    }
}

/// Writes the confidences of a band that begins at row `first`. `weights`: the sums of the weights of a row.
#[leveled]
fn support(
    level: Level,
    map: VotedMap<'_>,
    first: usize,
    similar: f32,
    rows: VotedRows,
    weights: Vec<f32>,
    band: &mut [f32],
) {
    let mut rows = rows;
    let mut weights = weights;
    let cols = map.disparity.cols();
    let scale = 1.0 / similar.sqrt();

    for (y, sums) in (first..).zip(band.chunks_mut(cols)) {
        for number in missing_rows::<ROWS>(y, first) {
            rows.copy(number, map, scale);
        }

        // A pixel's vote for itself.
        let here = rows.row(y + CONFIDENCE_RADIUS, 0, cols);
        weights.fill(1.0);
        sums.copy_from_slice(here.votes);

        // The pixels ahead in reading order, each with its opposite.
        let row = |at: usize| rows.row(y + at, CONFIDENCE_RADIUS, cols + 2 * CONFIDENCE_RADIUS);
        add_pairs::<{ SIDE / 2 + 1 }>(here, [row(CONFIDENCE_RADIUS); 2], &mut weights, sums);
        for down in (CONFIDENCE_STEP..=CONFIDENCE_RADIUS).step_by(CONFIDENCE_STEP) {
            let around = [row(CONFIDENCE_RADIUS + down), row(CONFIDENCE_RADIUS - down)];
            add_pairs::<0>(here, around, &mut weights, sums);
        }

        for ((sum, weight), disparity) in sums.iter_mut().zip(&weights).zip(here.disparity) {
            *sum = if disparity.is_nan() { 0.0 } else { confidence(*sum / *weight) };
        }
    }
}

/// Adds the votes of the pixels of two rows to the sums of each pixel, from column `FIRST` of the windows on:
/// each pixel ahead with its opposite behind. A neighbor without a disparity votes neither for nor against.
///
/// One loop over the pixels, with all pairs at constant distances: the sums stay in registers.
#[inline(always)]
fn add_pairs<const FIRST: usize>(
    here: VotedPixels,
    [ahead, behind]: [VotedPixels; 2],
    weights: &mut [f32],
    sums: &mut [f32],
) {
    let cols = here.disparity.len();
    let here = here.part(cols);
    let [ahead, behind] = [ahead, behind].map(|pixels| pixels.part(cols + 2 * CONFIDENCE_RADIUS));
    let (weights, sums) = (&mut weights[..cols], &mut sums[..cols]);

    for x in 0..cols {
        let (mut weight, mut sum) = (weights[x], sums[x]);
        let (disparity, gray) = (here.disparity[x], here.gray[x]);

        for column in FIRST..SIDE {
            let (right, left) = (x + column * CONFIDENCE_STEP, x + (SIDE - 1 - column) * CONFIDENCE_STEP);

            let (a, b) = (ahead.gray[right] - gray, behind.gray[left] - gray);
            let (a, b) = (1.0 + a * a, 1.0 + b * b);
            // One division for both weights.
            let both = 1.0 / (a * b);
            let (a, b) = (b * both, a * both);
            weight += a + b;

            // A comparison with NaN is false: a missing neighbor never agrees.
            let a = if (ahead.disparity[right] - disparity).abs() <= AGREEMENT { a } else { 0.0 };
            let b = if (behind.disparity[left] - disparity).abs() <= AGREEMENT { b } else { 0.0 };
            sum += a * ahead.votes[right] + b * behind.votes[left];
        }

        (weights[x], sums[x]) = (weight, sum);
    }
}

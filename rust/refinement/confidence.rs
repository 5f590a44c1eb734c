//! The costs of a disparity and the disparities around it -> confidence: how likely it is right.
//!
//! Every pixel votes for its own disparity, the more strongly the further its best candidate is ahead of all others. The
//! support of a disparity is the share of the votes around it that agree, weighted by how similar the gray values are,
//! since similar pixels tend to show the same surface:
//!
//! ```text
//! vote(q)    = ahead(q) / (ahead(q) + HALF_VOTE)          # ahead: least cost elsewhere - own cost
//! weight(q)  = s^2 / (s^2 + (gray(p) - gray(q))^2)        # s: SIMILAR mean differences of neighbors
//! support(p) = sum of weight(q) vote(q) over q that agree / sum of weight(q) over all q around p
//! confidence = support^3 / (support^3 + HALF_SUPPORT)
//! ```
//!
//! So a weak pixel among firm ones that agree is trusted, and a firm pixel that stands alone is not.
//!
//! Areas under the ROC curve (is the disparity off by more than 1 px?) of the sum of eight paths, means over 13
//! sharp pairs and over 96 with one image degraded: 0.940 and 0.863 for visible pixels, 0.934 and 0.853 for all
//! whose match lies within the right image. The ratio of the least cost elsewhere to the least one (PKR), and what
//! is the same to an ROC curve, their relative margin, have 0.907 and 0.834, 0.888 and 0.820, and less on every
//! single pair. Nothing else that was tried beside it made it better: the left-right check, the share of the paths
//! that agree, the cost itself, what of it are penalties, whether a pixel was filled.
//!
//! X. Hu, P. Mordohai: *A Quantitative Evaluation of Confidence Measures for Stereo Vision*, PAMI 2012.

use crate::error::Result;
use crate::image::plane::{Plane, zeroed};
use crate::image::texture::{Roughness, Texture};
use crate::pipeline::control::Control;
use crate::refinement::CostMargin;
use crate::simd::{Level, Loop};

/// How far ahead of all others the best candidate of a pixel with half a vote is, in units of the mean cost (bits, for
/// phase codes of 16 bits). Area under the ROC curve of visible pixels, over 13 sharp and 32 degraded pairs: 1: 0.937,
/// 0.860; 2: 0.939, 0.860; 4: 0.940, 0.860; 8: 0.940, 0.859.
pub const HALF_VOTE: f32 = 4.0;
/// How far up, down, left and right votes count. As above: 0: 0.912, 0.831; 2: 0.936, 0.849; 4: 0.940, 0.860; 6: 0.935,
/// 0.865, but on two pairs less than the margin.
pub const RADIUS: usize = 4;
/// Every so many-th row and column up to there counts: all of them take three times as long. As above: 1: 0.941, 0.859;
/// 2: 0.940, 0.860.
pub const STEP: usize = 2;
const _: () = assert!(RADIUS.is_multiple_of(STEP), "a pixel has a vote for itself");
/// Disparities agree that differ by no more, pixels. As above: 0.5: 0.928, 0.848; 1: 0.940, 0.860; 2: 0.938, 0.860.
pub const TOLERANCE: f32 = 1.0;
/// A vote counts half where the gray value differs by so many times the mean difference of horizontal neighbors: so
/// neither contrast nor the unit of gray values matters. As above: 1: 0.940, 0.858; 2: 0.940, 0.860; 4: 0.938, 0.861;
/// whatever the gray value: 0.927, 0.857.
pub const SIMILAR: f64 = 2.0;
/// The cube of the support that half of all disparities with it are right at. Logistic regression of right and
/// wrong on the logarithm of the support, half of the weight on sharp and half on degraded pairs, gives the power
/// 2.6 and the support 0.214, whichever scene is left out: 2.55 to 2.71 and 0.208 to 0.215. The mean confidence of
/// a pair is below the share of its right pixels by 0.02 on sharp pairs (from 0.05 below to 0.00 above), and above
/// it by 0.05 on degraded ones.
pub const HALF_SUPPORT: f32 = 0.01;

/// Rows of a band, which share a buffer.
const ROWS: usize = 16;

/// The vote of a pixel, from 0 to 1, by its cost margin, of which `unit` steps are one unit of the mean cost.
#[inline(always)]
pub fn vote(margin: CostMargin, unit: f32) -> f32 {
    let Some(elsewhere) = margin.elsewhere else { return 0.0 };

    let ahead = elsewhere.saturating_sub(margin.own) as f32;
    ahead / (ahead + HALF_VOTE * unit)
}

/// The confidence, from 0 to 1, of a disparity with so much support, from 0 to 1.
#[inline(always)]
pub fn confidence(support: f32) -> f32 {
    let cube = support * support * support;
    cube / (cube + HALF_SUPPORT)
}

/// A map with the votes for it; planes of one size.
#[derive(Debug, Clone, Copy)]
pub struct VotedMap<'a> {
    /// Disparities, pixels; NaN where there is none.
    pub disparity: &'a Plane<f32>,
    /// Votes for them, from 0 to 1.
    pub votes: &'a Plane<f32>,
    /// Gray values of the left image.
    pub texture: &'a Texture,
}

impl VotedMap<'_> {
    /// The confidence of every disparity; 0 where there is none.
    pub fn confidences(&self, out: &mut Plane<f32>, level: Level, control: &Control) -> Result<()> {
        let cols = self.disparity.cols();
        let similar = similar(self.texture.roughness);

        out.write_bands(ROWS, |first, band| {
            control.checkpoint()?;
            let mut weights = zeroed(cols)?;
            for (y, sums) in (first..).zip(band.chunks_mut(cols)) {
                level.run(Support { map: *self, y, similar, weights: &mut weights, sums });
            }
            Ok(())
        })
    }

    #[inline(always)]
    fn row(&self, y: usize) -> PixelRow<'_> {
        PixelRow {
            disparity: self.disparity.row(y),
            votes: self.votes.row(y),
            gray: self.texture.gray.row(y),
        }
    }
}

/// The square of the difference of gray values at which votes count half: at least that of one step.
pub fn similar(roughness: Roughness) -> f32 {
    let difference = (SIMILAR * roughness.mean()).max(1.0) as f32;
    difference * difference
}

/// A row of the map, or a part of it.
#[derive(Clone, Copy)]
struct PixelRow<'a> {
    disparity: &'a [f32],
    votes: &'a [f32],
    gray: &'a [i32],
}

impl PixelRow<'_> {
    #[inline(always)]
    fn part(&self, first: usize, count: usize) -> Self {
        Self {
            disparity: &self.disparity[first..][..count],
            votes: &self.votes[first..][..count],
            gray: &self.gray[first..][..count],
        }
    }
}

/// Writes the confidences of row `y`, summing votes in `sums` first.
struct Support<'a> {
    map: VotedMap<'a>,
    y: usize,
    similar: f32,
    weights: &'a mut [f32],
    sums: &'a mut [f32],
}

impl Loop for Support<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { map, y, similar, weights, sums } = self;
        let (rows, cols) = (map.disparity.rows(), map.disparity.cols());

        weights.fill(0.0);
        sums.fill(0.0);

        let here = map.row(y);
        for row in places(y, rows) {
            let there = map.row(row);
            for away in (0..=2 * RADIUS).step_by(STEP) {
                // Columns from `first` on have a pixel so far away; theirs begin at `other`.
                let first = RADIUS.saturating_sub(away);
                let other = away.saturating_sub(RADIUS);
                let count = cols.saturating_sub(first.max(other));

                if count > 0 {
                    let weights = &mut weights[first..][..count];
                    let sums = &mut sums[first..][..count];

                    let pair = [here.part(first, count), there.part(other, count)];
                    add(pair, similar, weights, sums);
                }
            }
        }

        for ((sum, weight), disparity) in sums.iter_mut().zip(weights).zip(here.disparity) {
            let is_known = !disparity.is_nan();
            // A pixel with a disparity counts itself, so its weight is not 0.
            *sum = if is_known { confidence(*sum / *weight) } else { 0.0 };
        }
    }
}

/// Rows whose votes count for row `y`, within the image.
#[inline(always)]
fn places(y: usize, rows: usize) -> impl Iterator<Item = usize> {
    let around = (0..=2 * RADIUS).step_by(STEP);
    around.filter_map(move |away| (y + away).checked_sub(RADIUS)).filter(move |&row| row < rows)
}

/// Adds the vote of one neighbor of each pixel. A neighbor without a disparity votes neither for nor against.
#[inline(always)]
fn add([here, there]: [PixelRow; 2], similar: f32, weights: &mut [f32], sums: &mut [f32]) {
    let ours = here.disparity.iter().zip(here.gray);
    let theirs = there.disparity.iter().zip(there.gray).zip(there.votes);
    let totals = weights.iter_mut().zip(sums);

    for (((ours, gray), ((theirs, other), vote)), (weight, sum)) in ours.zip(theirs).zip(totals) {
        let difference = (gray - other) as f32;
        let alike = similar / (similar + difference * difference);
        // A comparison with NaN is false: a missing neighbor never agrees.
        let agrees = (ours - theirs).abs() <= TOLERANCE;

        *weight += if theirs.is_nan() { 0.0 } else { alike };
        *sum += if agrees { alike * vote } else { 0.0 };
    }
}

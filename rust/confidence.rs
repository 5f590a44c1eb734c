//! What speaks for a disparity, in its costs and around it -> confidences: how likely it is right.
//!
//! A pixel whose best candidate is clearly ahead of all others has a strong vote, and it votes for the disparity that
//! it has. A disparity is trusted by as many of the votes around it as agree with it, those of similar gray values
//! counting most: they tend to show the same surface. So a weak pixel among firm ones that agree is trusted, and a
//! firm one is not that stands alone.
//!
//! Areas under the ROC curve (is the disparity off by more than 1 px?) of the sum of eight paths, means over 13
//! sharp pairs and over 96 with one image degraded: 0.940 and 0.863 for visible pixels, 0.934 and 0.853 for all
//! whose match lies within the right image. The ratio of the least cost elsewhere to the least one (PKR), and what
//! is the same to an ROC curve, their relative margin, have 0.907 and 0.834, 0.888 and 0.820, and less on every
//! single pair. Nothing else that was tried beside it made it better: the left-right check, the share of the paths
//! that agree, the cost itself, what of it are penalties, whether a pixel was filled.
//!
//! X. Hu, P. Mordohai: *A Quantitative Evaluation of Confidence Measures for Stereo Vision*, PAMI 2012.

use std::array::from_fn;

use crate::control::Control;
use crate::error::Result;
use crate::plane::{Plane, parts, zeroed};
use crate::refinement::Margin;
use crate::simd::{Kernel, Level};
use crate::texture::{Roughness, Texture};

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
/// A vote counts half where the gray value differs by so many times the mean difference of horizontal neighbours: so
/// neither contrast nor the unit of gray values matters. As above: 1: 0.940, 0.858; 2: 0.940, 0.860; 4: 0.938, 0.861;
/// whatever the gray value: 0.927, 0.857.
pub const SIMILAR: f64 = 2.0;
/// The cube of the support that half of all disparities with it are right at. Logistic regression of right and
/// wrong on the logarithm of the support, half of the weight on sharp and half on degraded pairs, gives the power
/// 2.6 and the support 0.214, whichever scene is left out: 2.55 to 2.71 and 0.208 to 0.215. The mean confidence of
/// a pair is below the share of its right pixels by 0.02 on sharp pairs (from 0.05 below to 0.00 above), and above
/// it by 0.05 on degraded ones.
pub const HALF_SUPPORT: f32 = 0.01;

/// Rows that votes come from.
const SIDE: usize = 2 * RADIUS / STEP + 1;
/// Rows from a pixel's own down that it is compared with, and those of which comparisons are kept.
const BELOW: usize = RADIUS / STEP + 1;
const KEPT: usize = RADIUS + 1;
/// Rows of a band: of those above it, gray values are compared again.
const ROWS: usize = 64;
/// Pixels that are worked out at a time.
const LANES: usize = 16;
/// Columns about them that count.
const SPAN: usize = LANES + 2 * RADIUS;

/// The vote of a pixel, from 0 to 1, by the costs of its best candidates, of which `unit` are one unit of the mean cost.
#[inline(always)]
pub fn vote(margin: Margin, unit: f32) -> f32 {
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

/// What is known of all pixels; planes of one size.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// Disparities, pixels; NaN where there is none.
    pub disparity: &'a Plane<f32>,
    /// Votes for them, from 0 to 1.
    pub votes: &'a Plane<f32>,
    /// Gray values of the left image.
    pub texture: &'a Texture,
}

impl Scene<'_> {
    /// The confidence of every disparity; 0 where there is none.
    pub fn confidences(&self, out: &mut Plane<f32>, level: Level, control: &Control) -> Result<()> {
        let (cols, gray) = (self.disparity.cols(), &self.texture.gray);
        let similar = similar(self.texture.roughness);
        out.write_bands(ROWS, |first, band| {
            control.checkpoint()?;
            let mut alike = Alike::new(cols)?;
            for y in first.saturating_sub(RADIUS)..first + band.len() / cols {
                level.run(Compare { gray, y, similar, alike: &mut alike });
                if let Some(row) = y.checked_sub(first) {
                    let confidences = &mut band[row * cols..][..cols];
                    level.run(Support { scene: *self, y, alike: &alike, confidences });
                }
            }
            Ok(())
        })
    }
}

/// The square of the difference of gray values at which votes count half: at least that of one step.
pub fn similar(roughness: Roughness) -> f32 {
    let difference = (SIMILAR * roughness.mean()).max(1.0) as f32;
    difference * difference
}

/// How alike the gray values of the last rows are, from 0 to 1, to those of the pixels beside and below them: of a pair
/// of pixels, that is the same for both.
struct Alike {
    values: Vec<f32>,
    width: usize,
}

impl Alike {
    fn new(cols: usize) -> Result<Self> {
        let width = cols.next_multiple_of(LANES) + 2 * RADIUS;
        Ok(Self { values: zeroed(KEPT * BELOW * SIDE * width)?, width })
    }

    /// Where the numbers are of row `y` and the pixels so many steps below and so many from the left end of a window;
    /// before and after those of its columns are [`RADIUS`] others.
    #[inline(always)]
    fn place(&self, y: usize, below: usize, across: usize) -> usize {
        ((y % KEPT * BELOW + below) * SIDE + across) * self.width
    }

    /// The numbers of row `y`, from its first column on, and the pixels of a row and a column of their windows.
    #[inline(always)]
    fn row(&self, y: usize, down: usize, across: usize) -> &[f32] {
        let place = if let Some(below) = down.checked_sub(SIDE / 2) {
            self.place(y, below, across) + RADIUS
        } else {
            // As the other one of the pair has it; beside the image there is none, and any number will do.
            let below = SIDE / 2 - down;
            self.place(y + KEPT - below * STEP, below, SIDE - 1 - across) + across * STEP
        };
        &self.values[place..]
    }
}

/// Compares the gray values of row `y`.
struct Compare<'a> {
    gray: &'a Plane<i32>,
    y: usize,
    similar: f32,
    alike: &'a mut Alike,
}

impl Kernel for Compare<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { gray, y, similar, alike } = self;
        let here = gray.row(y);
        for below in (0..BELOW).filter(|below| y + below * STEP < gray.rows()) {
            let there = gray.row(y + below * STEP);
            for across in 0..SIDE {
                // Columns that have one so far away: from `first` on; theirs begin at `other`.
                let first = RADIUS.saturating_sub(across * STEP);
                let other = (across * STEP).saturating_sub(RADIUS);
                let count = here.len().saturating_sub(first.max(other));
                let (Some(here), Some(there)) = (here.get(first..), there.get(other..)) else {
                    continue;
                };
                let place = alike.place(y, below, across) + RADIUS + first;
                let values = &mut alike.values[place..][..count];
                for ((value, here), there) in values.iter_mut().zip(here).zip(there) {
                    let difference = (here - there) as f32;
                    *value = similar / (similar + difference * difference);
                }
            }
        }
    }
}

/// The confidences of row `y`.
struct Support<'a> {
    scene: Scene<'a>,
    y: usize,
    alike: &'a Alike,
    confidences: &'a mut [f32],
}

impl Kernel for Support<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let row = |k: usize| (self.y + k * STEP) as isize - RADIUS as isize;
        let disparity = from_fn(|k| self.scene.disparity.row_or_nothing(row(k)));
        let votes = from_fn(|k| self.scene.votes.row_or_nothing(row(k)));
        let alike: [[&[f32]; SIDE]; SIDE] =
            from_fn(|down| from_fn(|across| self.alike.row(self.y, down, across)));
        let mut room = [[[0.0; SPAN]; SIDE]; 2];
        for (index, out) in self.confidences.chunks_mut(LANES).enumerate() {
            let x = index * LANES;
            let first = x as isize - RADIUS as isize;
            let [disparity_room, votes_room] = &mut room;
            let disparity = parts(disparity, first, disparity_room, |_, _| f32::NAN);
            let votes = parts(votes, first, votes_room, |_, _| 0.0);
            let confidences = confidences(disparity, votes, x, &alike);
            out.copy_from_slice(&confidences[..out.len()]);
        }
    }
}

/// Of neighbouring pixels, by what is known of those around them. Each of these has a vote; one without a disparity,
/// and that are those beside the image, has none, neither for nor against.
#[inline(always)]
fn confidences(
    disparity: [&[f32]; SIDE],
    votes: [&[f32]; SIDE],
    x: usize,
    alike: &[[&[f32]; SIDE]; SIDE],
) -> [f32; LANES] {
    let own: [f32; LANES] = from_fn(|j| disparity[SIDE / 2][RADIUS + j]);
    let (mut weight, mut sum) = ([0.0; LANES], [0.0; LANES]);
    for down in 0..SIDE {
        for across in 0..SIDE {
            let theirs = &disparity[down][across * STEP..][..LANES];
            let votes = &votes[down][across * STEP..][..LANES];
            let alike = &alike[down][across][x..][..LANES];
            // Nothing is added as bits that are all zero: a choice would keep the sums out of registers.
            let (mut counted, mut agreed) = ([0.0; LANES], [0.0; LANES]);
            for j in 0..LANES {
                let is_known = if theirs[j].is_nan() { 0 } else { !0 };
                let is_near = if (own[j] - theirs[j]).abs() <= TOLERANCE { !0 } else { 0 };
                counted[j] = f32::from_bits(alike[j].to_bits() & is_known);
                agreed[j] = f32::from_bits((alike[j] * votes[j]).to_bits() & is_near);
            }
            weight = from_fn(|j| weight[j] + counted[j]);
            sum = from_fn(|j| sum[j] + agreed[j]);
        }
    }
    let mut confidences = [0.0; LANES];
    for j in 0..LANES {
        let support = confidence(sum[j] / weight[j]);
        confidences[j] = if own[j].is_nan() { 0.0 } else { support };
    }
    confidences
}

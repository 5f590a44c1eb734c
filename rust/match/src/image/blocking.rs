//! Blocking: how much of the 8 x 8 grid of JPEG and video codecs shows in an image.
//!
//! Such a codec loses detail block by block, so neighbors on either side of a block border differ by more
//! than neighbors inside a block. The grid may begin anywhere, as in crops:
//!
//! ```text
//! extra[x] = |a[x] - a[x + 1]| - (|a[x - 1] - a[x]| + |a[x + 1] - a[x + 2]|) / 2
//! mean[phase] = mean of extra, clipped, over all x of the same phase, x mod 8
//! jump = the largest of the means - the second largest
//! ```
//!
//! This is done along rows and along columns; the smaller jump counts, since blocks have borders on all
//! sides. In an image without blocks, no phase stands out.

use std::ops::Range;

use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled};

/// Side of a block, pixels.
pub const SIDE: usize = 8;
/// Rows above and below a border whose values count.
pub const REACH: usize = 2;
/// Gray levels, of 255, to which extra differences are clipped: those of blocks are small, those of edges
/// large. Without clipping, some sharp images have larger jumps than lightly compressed ones.
const CLIP: f64 = 4.0;

/// Sums of the extra differences in an image, in half steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Extra {
    /// Sums over borders between columns and between rows, by phase.
    sums: [[i64; SIDE]; 2],
    /// Numbers of differences in these sums.
    counts: [[u64; SIDE]; 2],
}

impl Extra {
    /// The sums over some rows of a plane that begins at row `first` of an image of `height` rows. `steps`
    /// are the steps of a gray level.
    pub fn of_rows(
        plane: &Plane<i32>,
        rows: Range<usize>,
        (first, height): (usize, usize),
        steps: f64,
        level: Level,
    ) -> Result<Self> {
        let cols = plane.cols();
        let clip = (2.0 * CLIP * steps) as i32;
        let mut extra = Self::default();
        let mut found = zeroed(cols)?;
        // Summed by column first; phases come at the end.
        let mut sums = vec![0i64; cols];

        for y in rows {
            let own = plane.row(y);
            if cols > 3 {
                let found = &mut found[..cols - 3];
                let rows = [own, &own[1..], &own[2..], &own[3..]];

                block_differences(level, rows, clip, found);
                add_to(level, &mut sums, found);

                // Columns 0 to `cols - 4` of this phase.
                for phase in 0..SIDE {
                    extra.counts[0][phase] += (cols - 3 + SIDE - 1 - phase) as u64 / SIDE as u64;
                }
            }

            // Phases of rows are those of the whole image.
            let row = first + y;
            if row >= 1 && row + REACH < height {
                let rows = [plane.row(y - 1), own, plane.row(y + 1), plane.row(y + 2)];
                block_differences(level, rows, clip, &mut found);

                let phase = row % SIDE;
                extra.sums[1][phase] += sum_of(level, &found);
                extra.counts[1][phase] += cols as u64;
            }
        }

        for (x, sum) in sums.into_iter().enumerate() {
            extra.sums[0][x % SIDE] += sum;
        }

        Ok(extra)
    }

    /// The sums over both parts.
    pub fn and(mut self, other: Self) -> Self {
        for axis in 0..2 {
            for phase in 0..SIDE {
                self.sums[axis][phase] += other.sums[axis][phase];
                self.counts[axis][phase] += other.counts[axis][phase];
            }
        }
        self
    }

    /// How much block borders stand out, in steps; 0 if they do not, or if the image is too small.
    pub fn jump(&self) -> f64 {
        let [horizontal, vertical] = [0, 1].map(|axis| {
            if self.counts[axis].contains(&0) {
                return 0.0;
            }

            let sums = self.sums[axis].iter().zip(&self.counts[axis]);
            let mut means: Vec<f64> = sums.map(|(sum, count)| *sum as f64 / *count as f64).collect();

            means.sort_unstable_by(f64::total_cmp);
            means[SIDE - 1] - means[SIDE - 2]
        });

        horizontal.min(vertical) / 2.0
    }
}

/// Adds the values of one row to the sums of its columns.
#[leveled]
fn add_to(level: Level, sums: &mut [i64], found: &[i32]) {
    for (sum, found) in sums.iter_mut().zip(found) {
        *sum += i64::from(*found);
    }
}

/// The sum of the values of one row.
#[leveled]
fn sum_of(level: Level, found: &[i32]) -> i64 {
    found.iter().map(|found| i64::from(*found)).sum()
}

/// Writes twice the extra differences between the second and the third of four rows, or of four columns.
#[leveled]
fn block_differences(level: Level, rows: [&[i32]; 4], clip: i32, found: &mut [i32]) {
    let n = found.len();
    let [before, one, other, after] = rows.map(|row| &row[..n]);

    for i in 0..n {
        let beside = (before[i] - one[i]).abs() + (other[i] - after[i]).abs();
        let extra = 2 * (one[i] - other[i]).abs() - beside;
        found[i] = extra.clamp(-clip, clip);
    }
}

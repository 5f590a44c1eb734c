//! Costs around the chosen candidate -> sub-pixel offset; neighbors' disparities -> a smoother surface.
//!
//! The offset depends on the shape of the costs around their minimum. Sums of Hamming distances are V-shaped, as sums of
//! absolute differences are, so the tip of a V through three costs is taken. A V attracts disparities to whole pixels
//! ("pixel locking"), which an interpolation function corrects (Haller and Nedevschi: *Design of interpolation functions
//! for subpixel-accuracy stereo-vision systems*, IEEE TIP 21, 2012):
//!
//! ```text
//! tip    = (below - above) / (max(below, above) - own), clamped to -1 .. 1     # twice where the tip of the V lies
//! offset = tip / 2 * (1 + STEEPER * (1 - |tip|))
//! ```

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, Loop};
use crate::refinement::window_rows::{BAND, WindowRows, missing_rows};

/// Weight of the pixel's own costs beside the mean of the paths' totals.
///
/// P1 draws the totals of paths to the whole disparities of their neighbors. The pixel's own costs are free of that, but
/// noisier: with more of them fractions are more even on rendered pairs, and real ones have a few more wrong pixels.
/// A parabola through the totals prefers whole disparities by far.
const OWN_SHARE: u32 = 2;
/// How much steeper than a V the interpolation is at the candidate; half-way to the next one it is as much flatter:
/// this is where fractions are most even on rendered and on real pairs together.
const STEEPER: f32 = 0.3;

/// Rows and columns on either side that surfaces are smoothed over: more bend what is curved.
pub const REACH: usize = 3;
/// Largest difference of the disparities of neighbors on one surface, pixels.
const SAME_SURFACE: f32 = 1.0;

/// Rows that a pixel is smoothed over, its own in the middle.
const SIDE: usize = 2 * REACH + 1;

/// The cost of a candidate for [`offset`]: the mean of the paths' totals, plus the weighted cost of the pixel's own window,
/// which each total contains once already; at most [`i32::MAX`].
#[inline(always)]
pub fn evidence(total: u32, cost: u32) -> u32 {
    total.saturating_add(cost.saturating_mul(OWN_SHARE)).min(i32::MAX as u32)
}

/// The offset of the match from the chosen candidate, -0.5 to 0.5 pixels, from the costs of the candidate below, the chosen
/// one and the candidate above, each at most [`i32::MAX`].
///
/// Only the differences of the costs count, and only their ratio. Equal costs on both sides give 0. If one of them is
/// below the candidate's own, the match is half-way to it. At either end of the range there is no V: take the match as it
/// is.
#[inline(always)]
pub fn offset(below: u32, own: u32, above: u32) -> f32 {
    let lean = below as i32 - above as i32;
    let depth = (below.max(above) as i32 - own as i32).max(1);
    // Twice the offset of the tip of the V.
    let tip = (lean as f32 / depth as f32).clamp(-1.0, 1.0);

    0.5 * tip * (1.0 + STEEPER * (1.0 - tip.abs()))
}

/// Replaces disparities by the mean over [`REACH`] pixels around, of pixels on the same surface. NaN stays NaN and does not
/// count.
///
/// Pixels count in pairs opposite one another, so that the mean of a slanted surface is the surface, up to its edge.
pub fn smooth(
    disparity: &Plane<f32>,
    smoothed: &mut Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let cols = disparity.cols();
    smoothed.write_bands(BAND, |first, smoothed| {
        control.checkpoint()?;

        let rows = WindowRows::new(cols, f32::NAN)?;
        let counts = zeroed(cols)?;
        level.run(SmoothRows { disparity, first, rows, counts, smoothed });
        Ok(())
    })
}

/// Writes a band of rows, of which `first` is the first, smoothed over the rows around each.
struct SmoothRows<'a> {
    disparity: &'a Plane<f32>,
    first: usize,
    /// Row `y` of the map is number `y + REACH`.
    rows: WindowRows<f32, SIDE>,
    /// Pairs of each pixel of a row that count.
    counts: Vec<i32>,
    smoothed: &'a mut [f32],
}

impl Loop for SmoothRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { disparity, first, mut rows, mut counts, smoothed } = self;
        let cols = disparity.cols();

        for (y, sums) in (first..).zip(smoothed.chunks_mut(cols)) {
            for number in missing_rows::<SIDE>(y, first) {
                let row = number.checked_sub(REACH).filter(|y| *y < disparity.rows());
                match row {
                    Some(y) => rows.row_mut(number).copy_from_slice(disparity.row(y)),
                    None => rows.row_mut(number).fill(f32::NAN),
                }
            }

            sums.fill(0.0);
            counts.fill(0);

            // The pixels ahead in reading order, each with its opposite.
            let own = &rows.row(y + REACH, 0)[..cols];
            let row = |at: usize| rows.row(y + at, REACH);
            add_pairs::<{ REACH + 1 }>(own, [row(REACH); 2], sums, &mut counts);
            for down in 1..=REACH {
                let around = [row(REACH + down), row(REACH - down)];
                add_pairs::<0>(own, around, sums, &mut counts);
            }

            for ((sum, count), own) in sums.iter_mut().zip(&counts).zip(own) {
                *sum = own + *sum / (1 + 2 * *count) as f32;
            }
        }
    }
}

/// Adds the pairs of two rows that count to the sums of each pixel, from column `FIRST` of the windows on: the differences
/// from the pixel's own value, and their number.
///
/// One loop over the pixels, in which all pairs are a constant distance away: the sums stay in registers.
#[inline(always)]
fn add_pairs<const FIRST: usize>(
    own: &[f32],
    [ahead, behind]: [&[f32]; 2],
    sums: &mut [f32],
    counts: &mut [i32],
) {
    let cols = own.len();
    let (sums, counts) = (&mut sums[..cols], &mut counts[..cols]);
    let (ahead, behind) = (&ahead[..cols + SIDE - 1], &behind[..cols + SIDE - 1]);

    for x in 0..cols {
        let (mut sum, mut count) = (sums[x], counts[x]);

        for at in FIRST..SIDE {
            let (a, b) = (ahead[x + at] - own[x], behind[x + SIDE - 1 - at] - own[x]);
            let is_same = (a.abs() <= SAME_SURFACE) & (b.abs() <= SAME_SURFACE);
            sum += if is_same { a + b } else { 0.0 };
            count += i32::from(is_same);
        }

        (sums[x], counts[x]) = (sum, count);
    }
}

//! Neighbors' disparities -> a smoother surface.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled};
use crate::choices::{JUMP, SURFACE_REACH};
use crate::pair::plan::{Plan, Stage};
use crate::refinement::window_rows::{BAND, WindowRows, missing_rows};

/// Rows that a pixel is smoothed over, with its own in the middle.
const SIDE: usize = 2 * SURFACE_REACH + 1;

/// The smoothing of surfaces.
pub struct Surfaces;

impl Stage for Surfaces {
    fn reach(&self, plan: Plan) -> usize {
        if plan.settings.subpixel { SURFACE_REACH } else { 0 }
    }
}

/// Replaces disparities by the mean over the [`SURFACE_REACH`] pixels around, using pixels on the same
/// surface. NaN stays NaN and does not count.
///
/// Pixels count in opposite pairs, so that the mean of a slanted surface is the surface, up to its edge.
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
        smooth_rows(level, disparity, first, rows, counts, smoothed);
        Ok(())
    })
}

/// Writes a band that begins at row `first`, smoothed over the rows around each. `rows`: row `y` of the map
/// has number `y + SURFACE_REACH`. `counts`: for each pixel of a row, the pairs that count.
#[leveled]
fn smooth_rows(
    level: Level,
    disparity: &Plane<f32>,
    first: usize,
    rows: WindowRows<f32, SIDE>,
    counts: Vec<i32>,
    smoothed: &mut [f32],
) {
    let mut rows = rows;
    let mut counts = counts;
    let cols = disparity.cols();

    for (y, sums) in (first..).zip(smoothed.chunks_mut(cols)) {
        for number in missing_rows::<SIDE>(y, first) {
            let row = number.checked_sub(SURFACE_REACH).filter(|y| *y < disparity.rows());
            match row {
                Some(y) => rows.row_mut(number).copy_from_slice(disparity.row(y)),
                None => rows.row_mut(number).fill(f32::NAN),
            }
        }

        sums.fill(0.0);
        counts.fill(0);

        // The pixels ahead in reading order, each with its opposite.
        let own = &rows.row(y + SURFACE_REACH, 0)[..cols];
        let row = |at: usize| rows.row(y + at, SURFACE_REACH);
        add_pairs::<{ SURFACE_REACH + 1 }>(own, [row(SURFACE_REACH); 2], sums, &mut counts);
        for down in 1..=SURFACE_REACH {
            let around = [row(SURFACE_REACH + down), row(SURFACE_REACH - down)];
            add_pairs::<0>(own, around, sums, &mut counts);
        }

        for ((sum, count), own) in sums.iter_mut().zip(&counts).zip(own) {
            *sum = own + *sum / (1 + 2 * *count) as f32;
        }
    }
}

/// For the pairs of two rows that count, adds the differences from the pixel's own value, and their number,
/// to the sums of each pixel, from column `FIRST` of the windows on.
///
/// One loop over the pixels, with all pairs at constant distances: the sums stay in registers.
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
            let is_same = (a.abs() <= JUMP) & (b.abs() <= JUMP);
            sum += if is_same { a + b } else { 0.0 };
            count += i32::from(is_same);
        }

        (sums[x], counts[x]) = (sum, count);
    }
}

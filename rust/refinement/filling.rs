//! Disparities for pixels whose own are not trusted: that of the background beside them.
//!
//! An occluded pixel belongs to the farther one of the surfaces beside it. For wrong matches nothing was clearly better:
//! not the nearer neighbor, not the one with the more similar gray value, not the one on the same side of the largest step
//! of gray values.

use rayon::prelude::*;

use crate::error::Result;
use crate::image::masking::nearest;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;
use crate::refinement::flag;
use crate::simd::{Level, Loop};

/// Most rows between a row without a trusted pixel and the row that it copies. Such rows are rare, and rows further away
/// say nothing about them.
pub const REACH: usize = 32;

/// Gives every untrusted pixel the smaller disparity of the nearest trusted pixels to its left and right, and
/// [`flag::FILLED`]. A row without any trusted pixel takes the filled values of the nearest row that has one, up to
/// [`REACH`] away (ties: above); without such a row it stays as it is.
///
/// Masked pixels become NaN.
pub fn fill(
    disparity: &mut Plane<f32>,
    flags: &mut Plane<u16>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let (rows, cols) = (disparity.rows(), disparity.cols());

    let is_seeded = |y: usize| {
        disparity.row(y).iter().zip(flags.row(y)).any(|(value, flags)| is_trusted(*value, *flags))
    };
    let seeded: Vec<bool> = (0..rows).map(is_seeded).collect();

    // Rows without a trusted pixel go first, while the rows that they copy are still unfilled.
    for (y, source) in nearest(&seeded).into_iter().enumerate().filter(|(y, _)| !seeded[*y]) {
        let source = source.filter(|from| from.abs_diff(y) <= REACH);

        let spread = match source {
            Some(from) => spread(disparity.row(from), flags.row(from), level),
            None => disparity.row(y).to_vec(),
        };

        let filled = if source.is_some() { flag::FILLED } else { 0 };
        let (disparity, flags) = (disparity.row_mut(y), flags.row_mut(y));
        level.run(Fill { spread: &spread, filled, disparity, flags });
    }

    let parts = disparity.as_mut_slice().par_chunks_mut(cols);
    let parts = parts.zip(flags.as_mut_slice().par_chunks_mut(cols)).zip(seeded);
    parts.filter(|(_, is_seeded)| *is_seeded).try_for_each(|((disparity, flags), _)| {
        control.checkpoint()?;
        let spread = spread(disparity, flags, level);
        level.run(Fill { spread: &spread, filled: flag::FILLED, disparity, flags });
        Ok(())
    })
}

/// Whether a pixel's own estimate counts.
#[inline(always)]
pub fn is_trusted(disparity: f32, flags: u16) -> bool {
    (flags & flag::UNTRUSTED == 0) & !disparity.is_nan()
}

/// The trusted values of a row; in each gap the smaller one of the values at its ends.
fn spread(disparity: &[f32], flags: &[u16], level: Level) -> Vec<f32> {
    let mut row = vec![f32::NAN; disparity.len()];
    level.run(Trusted { disparity, flags, row: &mut row });

    // Each gap, from `start` on, is filled when the value after it is reached.
    let mut before = f32::NAN;
    let mut start = 0;
    for x in 0..=row.len() {
        let after = row.get(x).copied().unwrap_or(f32::NAN);
        if x < row.len() && after.is_nan() {
            continue;
        }
        if start < x {
            // The minimum of a number and NaN is the number, so gaps at the border have one end.
            row[start..x].fill(before.min(after));
        }

        (before, start) = (after, x + 1);
    }

    row
}

/// Writes the trusted values of a row; NaN elsewhere.
pub(crate) struct Trusted<'a> {
    pub(crate) disparity: &'a [f32],
    pub(crate) flags: &'a [u16],
    pub(crate) row: &'a mut [f32],
}

impl Loop for Trusted<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for ((out, &value), &flags) in self.row.iter_mut().zip(self.disparity).zip(self.flags) {
            *out = if is_trusted(value, flags) { value } else { f32::NAN };
        }
    }
}

/// Writes filled values over the untrusted disparities of a row, with a flag; NaN over masked ones.
struct Fill<'a> {
    spread: &'a [f32],
    filled: u16,
    disparity: &'a mut [f32],
    flags: &'a mut [u16],
}

impl Loop for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { spread, filled, disparity, flags } = self;
        for ((value, flags), &spread) in disparity.iter_mut().zip(flags).zip(spread) {
            let is_trusted = is_trusted(*value, *flags);
            let is_masked = *flags & flag::MASKED != 0;

            // At trusted pixels the spread value is their own.
            *value = if is_masked { f32::NAN } else { spread };
            *flags |= if is_trusted | is_masked { 0 } else { filled };
        }
    }
}

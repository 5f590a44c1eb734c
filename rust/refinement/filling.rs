//! Disparities for pixels whose own are not trusted: the background beside them.
//!
//! A pixel that the right image does not see belongs to the farther one of the surfaces beside it, and for
//! wrong matches nothing did clearly better: not the nearer neighbor, that of the more similar gray value, or one on
//! the same side of the largest step of gray values.

use rayon::prelude::*;

use crate::error::Result;
use crate::image::masking::nearest;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;
use crate::refinement::flag;
use crate::simd::{Level, Loop};

/// Rows without a trusted pixel take what another one has that is so many rows away at most. Such rows are rare, and
/// of what is further away they know nothing.
pub const REACH: usize = 32;

/// Gives every pixel that is not masked, and not trusted, the smaller disparity of the nearest trusted pixels to
/// its left and right, and [`flag::FILLED`]. A row without any trusted pixel takes what the nearest row with
/// one, up to [`REACH`] away (ties: above), has there; without such a row it stays as it is.
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
    // Rows without any go first: what they take is then still as it was.
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

/// The trusted values of a row, and elsewhere the smaller of the nearest ones on either side.
fn spread(disparity: &[f32], flags: &[u16], level: Level) -> Vec<f32> {
    let mut row = vec![f32::NAN; disparity.len()];
    level.run(Trusted { disparity, flags, row: &mut row });
    let (mut before, mut start) = (f32::NAN, 0);
    for x in 0..=row.len() {
        let after = row.get(x).copied().unwrap_or(f32::NAN);
        if x < row.len() && after.is_nan() {
            continue;
        }
        if start < x {
            // A number is less than NaN.
            row[start..x].fill(before.min(after));
        }
        (before, start) = (after, x + 1);
    }
    row
}

/// What is trusted of a row; NaN elsewhere.
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

/// What has been spread over a row -> its disparities where they are not trusted, but for masked ones; with a flag.
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
            let (is_trusted, is_masked) = (is_trusted(*value, *flags), *flags & flag::MASKED != 0);
            // Where a pixel is trusted, its own value is what has been spread.
            *value = if is_masked { f32::NAN } else { spread };
            *flags |= if is_trusted | is_masked { 0 } else { filled };
        }
    }
}

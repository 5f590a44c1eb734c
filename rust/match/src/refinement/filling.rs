//! Disparities for pixels whose own are not trusted: those of the background beside them.
//!
//! An occluded pixel belongs to the farther of the surfaces beside it. For wrong matches, no alternative was
//! clearly better: not the nearer neighbor, not the one with the more similar gray value, not the one on the
//! same side of the largest step of gray values.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::choices::FILLING_REACH;
use crate::image::masking::nearest;
use crate::pair::plan::{Plan, Stage};
use crate::refinement::flag;
use crate::refinement::window_rows::BAND;

/// Pixels tested together for the end of a gap: the bytes of a word.
const LOOK: usize = 8;

/// The filling of untrusted pixels.
pub struct Filling;

impl Stage for Filling {
    fn reach(&self, plan: Plan) -> usize {
        if plan.settings.has_checks() { FILLING_REACH } else { 0 }
    }
}

/// Gives every untrusted pixel the smaller disparity of the nearest trusted pixels to its left and right, and
/// [`flag::FILLED`]. A row without any trusted pixel copies the filled values of the nearest row that has
/// one, up to [`FILLING_REACH`] away (ties: above); without such a row it stays unchanged.
///
/// Masked pixels become NaN.
pub fn fill(
    disparity: &mut Plane<f32>,
    flags: &mut Plane<u16>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let (rows, cols) = (disparity.rows(), disparity.cols());

    let is_seeded =
        |y: usize| disparity.row(y).iter().zip(flags.row(y)).any(|(value, flags)| is_trusted(*value, *flags));
    let seeded: Vec<bool> = (0..rows).map(is_seeded).collect();

    // Rows without a trusted pixel go first, while the rows that they copy are still unfilled.
    let mut spread = Spread::default();
    for (y, source) in nearest(&seeded).into_iter().enumerate().filter(|(y, _)| !seeded[*y]) {
        let source = source.filter(|from| from.abs_diff(y) <= FILLING_REACH);
        let own;
        let spread = if let Some(from) = source {
            spread.find(disparity.row(from), flags.row(from), level)?
        } else {
            own = disparity.row(y).to_vec();
            &own
        };

        let filled = if source.is_some() { flag::FILLED } else { 0 };
        let (disparity, flags) = (disparity.row_mut(y), flags.row_mut(y));
        fill_row(level, spread, filled, disparity, flags);
    }

    let bands = disparity.as_mut_slice().par_chunks_mut(BAND * cols);
    let bands = bands.zip(flags.as_mut_slice().par_chunks_mut(BAND * cols)).zip(seeded.par_chunks(BAND));
    bands.try_for_each(|((disparity, flags), seeded)| {
        control.checkpoint()?;
        let mut spread = Spread::default();

        let rows = disparity.chunks_mut(cols).zip(flags.chunks_mut(cols)).zip(seeded);
        for ((disparity, flags), _) in rows.filter(|(_, is_seeded)| **is_seeded) {
            let spread = spread.find(disparity, flags, level)?;
            fill_row(level, spread, flag::FILLED, disparity, flags);
        }
        Ok(())
    })
}

/// Whether a pixel's own estimate counts.
#[inline(always)]
pub fn is_trusted(disparity: f32, flags: u16) -> bool {
    (flags & flag::UNTRUSTED == 0) & !disparity.is_nan()
}

/// Buffers of rows that are spread one after another.
#[derive(Debug, Default)]
struct Spread {
    /// The trusted values of a row, and those that fill the gaps between them.
    row: Memory<f32>,
    /// 1 where a gap begins or ends, else 0; zeros up to a multiple of [`LOOK`].
    ends: Memory<u8>,
}

impl Spread {
    /// The trusted values of a row; each gap has the smaller one of the values at its ends.
    fn find(&mut self, disparity: &[f32], flags: &[u16], level: Level) -> Result<&[f32]> {
        let cols = disparity.len();
        self.row.resize(cols)?;
        self.ends.resize(cols.next_multiple_of(LOOK))?;

        let Self { row, ends } = self;
        find_gaps(level, disparity, flags, row, ends);

        // Eight bytes are tested at once: most pixels are not at an end.
        let mut start = None;
        for (look, ends) in ends.as_chunks::<LOOK>().0.iter().enumerate() {
            let mut ends = u64::from_le_bytes(*ends);
            while ends != 0 {
                let x = look * LOOK + ends.trailing_zeros() as usize / 8;
                ends &= ends - 1;

                start = match start {
                    None => Some(x),
                    Some(start) => {
                        fill_gap(row, start..x);
                        None
                    }
                };
            }
        }
        if let Some(start) = start {
            fill_gap(row, start..cols);
        }

        Ok(row)
    }
}

/// Fills a gap of a row with the smaller one of the values at its ends.
fn fill_gap(row: &mut [f32], gap: Range<usize>) {
    let before = gap.start.checked_sub(1).map_or(f32::NAN, |x| row[x]);
    let after = row.get(gap.end).copied().unwrap_or(f32::NAN);

    // The minimum of a number and NaN is the number, so gaps at the border have one end.
    row[gap].fill(before.min(after));
}

/// Extracts the trusted values of a row, NaN elsewhere, and where they begin and end.
#[leveled]
fn find_gaps(level: Level, disparity: &[f32], flags: &[u16], row: &mut [f32], ends: &mut [u8]) {
    write_trusted(disparity, flags, row);

    ends.fill(0);
    ends[0] = u8::from(row[0].is_nan());
    for ((out, before), here) in ends[1..].iter_mut().zip(&row[..]).zip(&row[1..]) {
        *out = u8::from(before.is_nan() != here.is_nan());
    }
}

/// Writes the trusted values of a row; NaN elsewhere.
#[inline(always)]
pub(crate) fn write_trusted(disparity: &[f32], flags: &[u16], row: &mut [f32]) {
    for ((out, &value), &flags) in row.iter_mut().zip(disparity).zip(flags) {
        *out = if is_trusted(value, flags) { value } else { f32::NAN };
    }
}

/// Writes filled values over the untrusted disparities of a row, with a flag; NaN over masked ones.
#[leveled]
fn fill_row(level: Level, spread: &[f32], filled: u16, disparity: &mut [f32], flags: &mut [u16]) {
    for ((value, flags), &spread) in disparity.iter_mut().zip(flags).zip(spread) {
        let is_trusted = is_trusted(*value, *flags);
        let is_masked = *flags & flag::MASKED != 0;

        // At trusted pixels the spread value is their own.
        *value = if is_masked { f32::NAN } else { spread };
        *flags |= if is_trusted | is_masked { 0 } else { filled };
    }
}

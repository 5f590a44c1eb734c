//! Disparities for pixels whose own are not trusted: the background beside them.
//!
//! A pixel that the right image does not see belongs to the farther one of the surfaces beside it, and for
//! wrong matches nothing did clearly better: not the nearer neighbour, that of the more similar gray value, or one on
//! the same side of the largest step of gray values.

use crate::control::Control;
use crate::error::Result;
use crate::masking::nearest;
use crate::plane::Plane;
use crate::refinement::flag;

/// Rows without a trusted pixel take what another one has that is so many rows away at most. Such rows are rare, and
/// of what is further away they know nothing.
pub const REACH: usize = 32;

/// Gives every pixel that is not masked, and not trusted, the smaller disparity of the nearest trusted pixels to
/// its left and right, and [`flag::FILLED`]. A row without any trusted pixel takes what the nearest row with
/// one, up to [`REACH`] away (ties: above), has there; without such a row it stays as it is.
///
/// Masked pixels become NaN.
pub fn fill(
    disparity: &Plane<f32>,
    flags: &mut Plane<u16>,
    control: &Control,
) -> Result<Plane<f32>> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let trusted = |y: usize| {
        let pixels = disparity.row(y).iter().zip(flags.row(y));
        pixels.map(|(&value, &flags)| if is_trusted(value, flags) { value } else { f32::NAN })
    };
    let seeded: Vec<bool> = (0..rows).map(|y| trusted(y).any(|value| !value.is_nan())).collect();
    let mut sources = nearest(&seeded);
    for (y, source) in sources.iter_mut().enumerate() {
        *source = source.filter(|from| from.abs_diff(y) <= REACH);
    }
    let filled = Plane::by_rows((rows, cols), control, |y, row| {
        match sources[y] {
            Some(from) => spread(trusted(from), row),
            None => row.copy_from_slice(disparity.row(y)),
        }
        let pixels = row.iter_mut().zip(disparity.row(y)).zip(flags.row(y));
        for ((out, &value), &flags) in pixels {
            if is_trusted(value, flags) {
                *out = value;
            } else if flags & flag::MASKED != 0 {
                *out = f32::NAN;
            }
        }
    })?;
    for y in (0..rows).filter(|&y| sources[y].is_some()) {
        for (&value, flags) in disparity.row(y).iter().zip(flags.row_mut(y)) {
            let is_filled = !is_trusted(value, *flags) && *flags & flag::MASKED == 0;
            *flags |= if is_filled { flag::FILLED } else { 0 };
        }
    }
    Ok(filled)
}

/// Whether a pixel's own estimate counts.
pub fn is_trusted(disparity: f32, flags: u16) -> bool {
    flags & flag::UNTRUSTED == 0 && !disparity.is_nan()
}

/// Writes the values of a row, and for NaN the smaller of the nearest values on either side.
fn spread(
    values: impl DoubleEndedIterator<Item = f32> + ExactSizeIterator + Clone,
    row: &mut [f32],
) {
    let mut before = f32::NAN;
    for (out, value) in row.iter_mut().zip(values.clone()) {
        before = if value.is_nan() { before } else { value };
        *out = before;
    }
    let mut after = f32::NAN;
    for (out, value) in row.iter_mut().zip(values).rev() {
        after = if value.is_nan() { after } else { value };
        // Where there is a value, both are the same; a number is less than NaN.
        *out = out.min(after);
    }
}

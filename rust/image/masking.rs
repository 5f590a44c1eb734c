//! Masked pixels take the values of valid neighbors, so that their own values have no effect on anything.

use crate::error::Result;
use crate::image::convolution::LARGEST_KERNEL;
use crate::image::plane::Plane;
use crate::image::view::Mask;
use crate::pipeline::control::Control;
use crate::settings::LARGEST_WINDOW;

/// Most rows between a row without a valid value and the row that it copies: as far as codes under the largest kernel
/// depend on pixels, so rows further away matter to no valid pixel.
pub const REACH: usize = LARGEST_KERNEL / 2 + LARGEST_WINDOW / 2;

/// Replaces masked values by the nearest valid value of their row (ties: left). A row without any copies the nearest row
/// that has one, up to [`REACH`] away (ties: above), or becomes zero.
pub fn fill_masked<T: Copy + Default>(
    plane: &mut Plane<T>,
    mask: &Mask,
    control: &Control,
) -> Result<()> {
    let mut seeded = vec![false; plane.rows()];
    for (y, seeded) in seeded.iter_mut().enumerate() {
        control.checkpoint()?;
        *seeded = fill_row(plane.row_mut(y), mask.row(y));
    }

    for (y, source) in nearest(&seeded).into_iter().enumerate() {
        match source {
            Some(from) if from == y => {}
            Some(from) if from.abs_diff(y) <= REACH => {
                let copied = plane.row(from).to_vec();
                plane.row_mut(y).copy_from_slice(&copied);
            }
            _ => plane.row_mut(y).fill(T::default()),
        }
    }

    Ok(())
}

/// Replaces the masked values of a row; whether it has any valid one.
fn fill_row<T: Copy>(row: &mut [T], valid: &[bool]) -> bool {
    let sources = nearest(valid);
    let original = row.to_vec();

    for (value, source) in row.iter_mut().zip(&sources) {
        if let Some(x) = source {
            *value = original[*x];
        }
    }

    valid.contains(&true)
}

/// For every place the nearest place that holds true (ties: the smaller one).
pub(crate) fn nearest(present: &[bool]) -> Vec<Option<usize>> {
    // Forward, the last one so far; backward, the better of it and the next one.
    let mut before = None;
    let mut places: Vec<Option<usize>> = Vec::with_capacity(present.len());

    for (i, &here) in present.iter().enumerate() {
        before = if here { Some(i) } else { before };
        places.push(before);
    }

    let mut after: Option<usize> = None;
    for (i, place) in places.iter_mut().enumerate().rev() {
        after = if present[i] { Some(i) } else { after };
        *place = match (*place, after) {
            (Some(a), Some(b)) => Some(if b - i < i - a { b } else { a }),
            (found, None) | (None, found) => found,
        };
    }

    places
}

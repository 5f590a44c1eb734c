//! Masked pixels take the values of valid neighbors, so that what they hold has no effect on anything.

use crate::error::Result;
use crate::image::convolution::LARGEST_KERNEL;
use crate::image::plane::Plane;
use crate::image::view::Mask;
use crate::pipeline::control::Control;
use crate::settings::LARGEST_WINDOW;

/// Rows without a valid value copy one that is so many rows away at most: as far as codes reach under the largest
/// kernel, so that what is further away matters to no valid pixel.
pub const REACH: usize = LARGEST_KERNEL / 2 + LARGEST_WINDOW / 2;

/// Replaces masked values by the nearest valid one of their row (ties: left); rows without any copy the
/// nearest row that has one, up to [`REACH`] away (ties: above), or become zero.
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

/// For every place the nearest one that holds true, ties to the smaller.
pub(crate) fn nearest(present: &[bool]) -> Vec<Option<usize>> {
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

//! Masked pixels take the values of valid neighbors, so that their own values have no effect on anything.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::image::LARGEST_KERNEL;
use crate::image::view::Mask;
use crate::settings::LARGEST_WINDOW;

/// Most rows between a row without a valid value and the row that it copies: as far as codes under the largest kernel
/// depend on pixels, so rows further away matter to no valid pixel.
pub const REACH: usize = LARGEST_KERNEL / 2 + LARGEST_WINDOW / 2;

/// Replaces masked values by the nearest valid value of their row (ties: left). A row without any copies the nearest row
/// that has one, up to [`REACH`] away (ties: above), or becomes zero.
pub fn fill_masked<T: Copy + Default + Send + Sync>(
    plane: &mut Plane<T>,
    mask: &Mask,
    control: &Control,
) -> Result<()> {
    let seeded: Vec<bool> = (0..mask.rows()).map(|y| mask.row(y).contains(&true)).collect();
    plane.write_bands(1, |y, row| {
        control.checkpoint()?;
        fill_row(row, mask.row(y));
        Ok(())
    })?;

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

/// Replaces the masked values of a row, run by run, by the valid ones on either side.
fn fill_row<T: Copy>(row: &mut [T], valid: &[bool]) {
    let mut end = 0;

    while let Some(masked) = valid[end..].iter().position(|valid| !valid) {
        let start = end + masked;
        let run = valid[start..].iter().position(|valid| *valid);
        end = run.map_or(row.len(), |run| start + run);

        let left = start.checked_sub(1).map(|x| row[x]);
        let right = row.get(end).copied();
        // The pixels of the left half, that in the middle included, are nearer to the left value.
        let middle = start + (end - start).div_ceil(2);
        let (of_left, of_right) = row[start..end].split_at_mut(middle - start);
        if let Some(value) = left.or(right) {
            of_left.fill(value);
        }
        if let Some(value) = right.or(left) {
            of_right.fill(value);
        }
    }
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

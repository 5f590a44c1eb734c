//! Masked pixels take the values of valid neighbors, so that their own values have no effect on anything.

use crate::base::plane::Plane;
use crate::image::LARGEST_KERNEL;
use crate::settings::LARGEST_WINDOW;

/// Which pixels are valid.
pub type Mask = Plane<bool>;

/// Most rows between a row without a valid value and the row that it copies: codes of an image that is not
/// smoothed depend on pixels no further away, so rows beyond do not matter to any valid pixel.
pub const REACH: usize = LARGEST_KERNEL / 2 + LARGEST_WINDOW / 2;

/// Replaces masked values by the nearest valid value in their row (ties: left). A row without any copies the
/// nearest row that has one, up to [`REACH`] away (ties: above), or becomes zero.
pub fn fill_masked<T: Copy + Default>(plane: &mut Plane<T>, mask: &Mask) {
    let seeded: Vec<bool> = (0..mask.rows()).map(|y| mask.row(y).contains(&true)).collect();
    for y in 0..mask.rows() {
        fill_row(plane.row_mut(y), mask.row(y));
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
        // The pixels of the left half, including the middle one, are nearer to the left value.
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

/// Pixels of this many channels, with masked ones replaced by the nearest valid ones of their column up to
/// `reach - 1` rows away, else by `black`: resampling along columns must not use values from other columns.
pub fn filled_along_columns<T: Copy>(
    pixels: &[T],
    channels: usize,
    mask: &Mask,
    reach: usize,
    black: T,
) -> Vec<T> {
    let (rows, cols) = (mask.rows(), mask.cols());
    let mut filled = Vec::with_capacity(pixels.len());
    for (y, x) in (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))) {
        // The row itself, then those above and below it, nearest first.
        let near = (0..reach).flat_map(|by| [y.checked_sub(by), Some(y + by)]).flatten();
        match near.filter(|row| *row < rows).find(|row| mask.row(*row)[x]) {
            Some(from) => {
                filled.extend_from_slice(&pixels[(from * cols + x) * channels..][..channels]);
            }
            None => filled.extend(std::iter::repeat_n(black, channels)),
        }
    }
    filled
}

/// For every place the nearest place that is true (ties: the smaller one).
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

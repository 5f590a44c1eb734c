//! The rows that the windows of one row of pixels cover, with room beyond their ends: so a window is the same
//! loop for all pixels, and neighbors are at constant distances.

use std::ops::Range;

use crate::base::error::Result;
use crate::base::memory::Memory;

/// Least number of columns before the first one and after the last one. A row begins at a cache line.
pub const MARGIN: usize = 16;
/// The length of rows is a multiple of this, for loops over blocks of this length.
const MULTIPLE: usize = 16;
/// Rows of a band, which share the rows of its windows; those above and below it are prepared again.
pub const BAND: usize = 32;

/// The last `COUNT` rows of a band and of its halo, each at the place of its number modulo `COUNT`.
#[derive(Debug)]
pub struct WindowRows<T, const COUNT: usize> {
    rows: [Memory<T>; COUNT],
    cols: usize,
}

impl<T: Copy + Default, const COUNT: usize> WindowRows<T, COUNT> {
    /// Rows of `cols` columns, with this value beyond their ends.
    pub fn new(cols: usize, beyond: T) -> Result<Self> {
        let mut rows = std::array::from_fn(|_| Memory::default());
        for row in &mut rows {
            row.resize(cols.next_multiple_of(MULTIPLE) + 2 * MARGIN)?;
            row.fill(beyond);
        }
        Ok(Self { rows, cols })
    }

    /// Row `number`, writable.
    #[inline(always)]
    pub fn row_mut(&mut self, number: usize) -> &mut [T] {
        &mut self.rows[number % COUNT][MARGIN..][..self.cols]
    }

    /// Row `number`, starting `before` columns before its first one.
    #[inline(always)]
    pub fn row(&self, number: usize, before: usize) -> &[T] {
        &self.rows[number % COUNT][MARGIN - before..]
    }

    /// Repeats the first and the last value of row `number` one place beyond its ends.
    #[inline(always)]
    pub fn repeat_ends(&mut self, number: usize) {
        let row = &mut self.rows[number % COUNT];
        row[MARGIN - 1] = row[MARGIN];
        row[MARGIN + self.cols] = row[MARGIN + self.cols - 1];
    }
}

/// The numbers of the rows that windows of `COUNT` rows need for row `y` of a band and that are not stored
/// yet: all of them for the `first` row, one more for each row after it. Number `y` is the top row of the
/// windows of row `y`.
#[inline(always)]
pub fn missing_rows<const COUNT: usize>(y: usize, first: usize) -> Range<usize> {
    let kept = if y == first { 0 } else { COUNT - 1 };
    y + kept..y + COUNT
}

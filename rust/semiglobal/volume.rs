//! Values of a band of rows: by row, group of columns, candidate, column of the group.

use crate::aggregation::stride;
use crate::error::Result;
use crate::memory::Memory;
use crate::strip::{BLOCK, SIDE, turned};

/// Columns that are worked on together: as many as lanes.
pub const GROUP: usize = BLOCK;

/// One value for every candidate of every pixel of a band. Beyond the last column there are zeros, up to a whole
/// group.
#[derive(Debug)]
pub struct Volume<T> {
    candidates: usize,
    /// Places from one row to the next.
    stride: usize,
    values: Memory<T>,
}

impl<T> Default for Volume<T> {
    fn default() -> Self {
        Self { candidates: 0, stride: 0, values: Memory::default() }
    }
}

impl<T: Copy + Default> Volume<T> {
    /// Makes room for so many rows and columns.
    pub fn begin(&mut self, (rows, cols): (usize, usize), candidates: usize) -> Result<()> {
        (self.candidates, self.stride) = (candidates, stride(cols.div_ceil(GROUP) * candidates));
        self.values.room(rows * self.stride * GROUP)
    }

    /// The values of a group of columns in a row, of one candidate after another.
    #[inline(always)]
    pub fn of(&self, row: usize, group: usize) -> &[[T; GROUP]] {
        let first = row * self.stride + group * self.candidates;
        &self.values.as_chunks().0[first..][..self.candidates]
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn of_mut(&mut self, row: usize, group: usize) -> &mut [[T; GROUP]] {
        let first = row * self.stride + group * self.candidates;
        &mut self.values.as_chunks_mut().0[first..][..self.candidates]
    }

    /// Brings a group of columns, given one after another, [`stride`] places apart, candidate after candidate, from
    /// lanes into rows.
    pub fn take(&mut self, group: usize, columns: &[[T; BLOCK]]) {
        let none = [T::default(); BLOCK];
        let sides = || (0..BLOCK).step_by(SIDE);
        for (top, left) in sides().flat_map(|top| sides().map(move |left| (top, left))) {
            for k in 0..self.candidates {
                let mut square = [[T::default(); SIDE]; SIDE];
                for (x, lanes) in square.iter_mut().enumerate() {
                    let column =
                        columns.get((left + x) * stride(self.candidates) + k).unwrap_or(&none);
                    lanes.copy_from_slice(&column[top..][..SIDE]);
                }
                for (y, values) in turned(square).iter().enumerate() {
                    self.of_mut(top + y, group)[k][left..][..SIDE].copy_from_slice(values);
                }
            }
        }
    }
}

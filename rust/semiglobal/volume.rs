//! Values of a band of rows: by row, group of columns, candidate, column of the group.

use crate::error::Result;
use crate::memory::Memory;
use crate::simd::Kernel;
use crate::strip::{BLOCK, SIDE, turned};

/// Columns that are worked on together: as many as lanes.
pub const GROUP: usize = BLOCK;

/// One value for every candidate of every pixel of a band. Beyond the last column there are zeros, up to a whole
/// group.
#[derive(Debug)]
pub struct Volume<T> {
    groups: usize,
    candidates: usize,
    values: Memory<T>,
}

impl<T> Default for Volume<T> {
    fn default() -> Self {
        Self { groups: 0, candidates: 0, values: Memory::default() }
    }
}

impl<T: Copy + Default> Volume<T> {
    /// Makes room for so many rows and columns.
    pub fn begin(&mut self, (rows, cols): (usize, usize), candidates: usize) -> Result<()> {
        (self.groups, self.candidates) = (cols.div_ceil(GROUP), candidates);
        self.values.room(rows * self.groups * candidates * GROUP)
    }

    /// The values of a group of columns in a row, of one candidate after another.
    #[inline(always)]
    pub fn of(&self, row: usize, group: usize) -> &[[T; GROUP]] {
        let first = (row * self.groups + group) * self.candidates;
        &self.values.as_chunks().0[first..][..self.candidates]
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn of_mut(&mut self, row: usize, group: usize) -> &mut [[T; GROUP]] {
        let first = (row * self.groups + group) * self.candidates;
        &mut self.values.as_chunks_mut().0[first..][..self.candidates]
    }

    #[inline(always)]
    fn take_group(&mut self, group: usize, columns: &[[T; BLOCK]]) {
        let none = [T::default(); BLOCK];
        let corners =
            (0..BLOCK).step_by(SIDE).flat_map(|y| (0..GROUP).step_by(SIDE).map(move |x| (y, x)));
        for (top, left) in corners {
            for k in 0..self.candidates {
                let column =
                    |x: usize| columns.get((left + x) * self.candidates + k).unwrap_or(&none);
                let square = std::array::from_fn(|x| {
                    let mut lanes = [T::default(); SIDE];
                    lanes.copy_from_slice(&column(x)[top..][..SIDE]);
                    lanes
                });
                for (y, values) in turned(square).iter().enumerate() {
                    self.of_mut(top + y, group)[k][left..][..SIDE].copy_from_slice(values);
                }
            }
        }
    }
}

/// Brings the rows of a block of lanes, given column after column and candidate after candidate, into a volume.
pub struct TakeColumns<'a, T> {
    /// Where they go, of as many rows as lanes.
    pub volume: &'a mut Volume<T>,
    /// The group of columns.
    pub group: usize,
    /// Its columns, fewer at the end of the rows.
    pub columns: &'a [[T; BLOCK]],
}

impl<T: Copy + Default> Kernel for TakeColumns<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.volume.take_group(self.group, self.columns);
    }
}

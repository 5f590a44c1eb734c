//! Values of a band of rows: by group of columns, row, candidate, column of the group.
//!
//! They are found column by column, rows in lanes, and kept in the same place; then each group is turned.

use crate::aggregation::stride;
use crate::error::Result;
use crate::memory::Memory;
use crate::simd::{Kernel, Level};
use crate::strip::BLOCK;
use crate::value::Value;

/// Columns that are worked on together: as many as lanes.
pub const GROUP: usize = BLOCK;

/// Columns that are brought into rows at a time: as many bytes as a word has.
const SIDE: usize = 8;

/// One value for every candidate of every pixel of a band. Beyond the last column there are zeros, up to a whole
/// group.
#[derive(Debug)]
pub struct Volume<T> {
    cols: usize,
    candidates: usize,
    values: Memory<T>,
}

impl<T> Default for Volume<T> {
    fn default() -> Self {
        Self { cols: 0, candidates: 0, values: Memory::default() }
    }
}

impl<T: Value> Volume<T> {
    /// Makes room for as many rows as lanes, and so many columns.
    pub fn begin(&mut self, cols: usize, candidates: usize) -> Result<()> {
        (self.cols, self.candidates) = (cols, candidates);
        self.values.room(cols.div_ceil(GROUP) * self.group_values())
    }

    /// Values of a group.
    fn group_values(&self) -> usize {
        GROUP * stride(self.candidates) * BLOCK
    }

    /// All columns before they are turned, one after another, [`stride`] places apart, candidate after candidate,
    /// rows in lanes.
    #[inline(always)]
    pub fn columns_mut(&mut self) -> &mut [[T; BLOCK]] {
        self.values.as_chunks_mut().0
    }

    /// The values of a group of columns in a row, of one candidate after another.
    #[inline(always)]
    pub fn of(&self, row: usize, group: usize) -> &[[T; GROUP]] {
        let first = (group * BLOCK + row) * stride(self.candidates);
        &self.values.as_chunks().0[first..][..self.candidates]
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn of_mut(&mut self, row: usize, group: usize) -> &mut [[T; GROUP]] {
        let first = (group * BLOCK + row) * stride(self.candidates);
        &mut self.values.as_chunks_mut().0[first..][..self.candidates]
    }

    /// Turns all groups, one after another by way of `spare`.
    pub fn turn(&mut self, spare: &mut Memory<T>, level: Level) -> Result<()> {
        let (length, column) = (self.group_values(), stride(self.candidates) * BLOCK);
        spare.room(length)?;
        for group in 0..self.cols.div_ceil(GROUP) {
            let there = (self.cols - group * GROUP).min(GROUP) * column;
            spare[..there].copy_from_slice(&self.values[group * length..][..there]);
            let columns = spare[..there].as_chunks().0;
            level.run(Take { volume: self, group, columns });
        }
        Ok(())
    }

    #[inline(always)]
    fn take(&mut self, group: usize, columns: &[[T; BLOCK]]) {
        let (candidates, apart) = (self.candidates, stride(self.candidates));
        let (none, row) = ([T::default(); BLOCK], apart * GROUP);
        let first = group * self.group_values();
        let values = &mut self.values[first..];
        // All of a candidate before the next one: so lines of the cache are still at hand when they are needed again.
        for (k, left) in (0..candidates).flat_map(|k| (0..GROUP).step_by(SIDE).map(move |x| (k, x)))
        {
            let mut lanes = [none; SIDE];
            for (x, lanes) in lanes.iter_mut().enumerate() {
                *lanes = *columns.get((left + x) * apart + k).unwrap_or(&none);
            }
            if T::BITS == 8 {
                let mut place = k * GROUP + left;
                let words = turned(&lanes);
                for word in (0..BLOCK).map(|y| words[y % SIDE][y / SIDE]) {
                    let pixels = word.to_le_bytes().map(|byte| T::truncated(byte.into()));
                    values[place..place + SIDE].copy_from_slice(&pixels);
                    place += row;
                }
            } else {
                for (x, column) in lanes.iter().enumerate() {
                    for (y, value) in column.iter().enumerate() {
                        values[k * GROUP + left + x + y * row] = *value;
                    }
                }
            }
        }
    }
}

/// Bytes of eight columns, by row: in squares of eight by eight, whose rows are words that are shuffled into one
/// another.
#[inline(always)]
fn turned<T: Value>(columns: &[[T; BLOCK]; SIDE]) -> [[u64; BLOCK / SIDE]; SIDE] {
    let mut words = [[0; BLOCK / SIDE]; SIDE];
    for (words, column) in words.iter_mut().zip(columns) {
        for (square, word) in words.iter_mut().enumerate() {
            let byte = |y: usize| column[square * SIDE + y].widened() as u8;
            *word = u64::from_le_bytes(std::array::from_fn(byte));
        }
    }
    exchange(&mut words, 4, 0x0000_0000_ffff_ffff);
    exchange(&mut words, 2, 0x0000_ffff_0000_ffff);
    exchange(&mut words, 1, 0x00ff_00ff_00ff_00ff);
    words
}

/// Exchanges, in squares of bytes, those that are `step` places above and to the right of one another: of every
/// two times `step` bytes, the upper words give their later ones for the earlier ones of the lower words.
#[inline(always)]
fn exchange(words: &mut [[u64; BLOCK / SIDE]; SIDE], step: usize, earlier: u64) {
    for upper in (0..SIDE).filter(|word| word & step == 0) {
        let (above, below) = (words[upper], words[upper + step]);
        for (square, (above, below)) in above.into_iter().zip(below).enumerate() {
            let given = (above >> (8 * step) ^ below) & earlier;
            words[upper][square] = above ^ given << (8 * step);
            words[upper + step][square] = below ^ given;
        }
    }
}

/// Brings a group of columns from lanes into rows.
#[derive(Debug)]
struct Take<'a, T> {
    /// Where they go.
    volume: &'a mut Volume<T>,
    group: usize,
    /// Its columns; there are fewer of the last one.
    columns: &'a [[T; BLOCK]],
}

impl<T: Value> Kernel for Take<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.volume.take(self.group, self.columns);
    }
}

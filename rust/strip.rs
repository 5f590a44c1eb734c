//! Strips: rows of the image side by side, one in each lane.
//!
//! All that lies between codes and disparities is worked out a strip at a time, on values ordered by column,
//! then lane: the next row is the next value and the next column so many lanes further. Every step is then
//! the same for long runs of neighbouring values, whatever the number of candidates.

use std::array::from_fn;
use std::ops::Range;

use crate::error::Result;
use crate::memory::Memory;

/// Lanes that a row of candidates is searched for at a time: those of one AVX2 register of bytes.
pub const BLOCK: usize = 32;

/// Rows and columns that are brought into lanes at a time: whole words are written then, not single bytes.
const ROWS: usize = 8;
const COLUMNS: usize = 32;

/// Which rows of the image a strip holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Strip {
    /// The first row whose disparities it gives.
    pub first: usize,
    /// Number of rows whose disparities it gives.
    pub rows: usize,
    /// Rows above and below them that it also needs.
    pub margin: usize,
    /// Rows of the image.
    pub height: usize,
}

impl Strip {
    /// The rows whose disparities it gives.
    pub fn range(&self) -> Range<usize> {
        self.first..self.first + self.rows
    }

    /// Blocks of lanes that give disparities; the last may be partly idle.
    pub fn blocks(&self) -> usize {
        self.rows.div_ceil(BLOCK)
    }

    /// All lanes: those that give disparities and the margins, filled up to half blocks.
    pub fn lanes(&self) -> usize {
        (self.blocks() * BLOCK + 2 * self.margin).next_multiple_of(BLOCK / 2)
    }

    /// The row in a lane; beyond the image, its nearest one.
    pub fn row(&self, lane: usize) -> usize {
        (self.first + lane).saturating_sub(self.margin).min(self.height - 1)
    }

    /// Brings rows into lanes: `value` of `columns`, one after another.
    pub fn transpose<'a, T: Copy + Default + 'a, U: Copy + Default>(
        &self,
        columns: &[usize],
        row: impl Fn(usize) -> &'a [T],
        value: impl Fn(T) -> U,
        out: &mut Memory<U>,
    ) -> Result<()> {
        let lanes = self.lanes();
        out.room(columns.len() * lanes)?;
        for (columns, out) in columns.chunks(COLUMNS).zip(out.chunks_mut(COLUMNS * lanes)) {
            for first in (0..lanes).step_by(ROWS) {
                let rows = ROWS.min(lanes - first);
                let mut tile = [[T::default(); COLUMNS]; ROWS];
                for (lane, tile) in (first..first + rows).zip(&mut tile) {
                    pick(row(self.row(lane)), columns, tile);
                }
                for (column, out) in out.chunks_exact_mut(lanes).enumerate() {
                    let values: [U; ROWS] = from_fn(|row| value(tile[row][column]));
                    out[first..first + rows].copy_from_slice(&values[..rows]);
                }
            }
        }
        Ok(())
    }
}

/// Copies the values at these columns; most runs of columns have no gap.
fn pick<T: Copy>(row: &[T], columns: &[usize], out: &mut [T; COLUMNS]) {
    let (first, last) = (columns[0], columns[columns.len() - 1]);
    if columns.iter().zip(first..=last).filter(|(column, x)| *column == x).count() == columns.len()
    {
        out[..columns.len()].copy_from_slice(&row[first..=last]);
    } else {
        out.iter_mut().zip(columns).for_each(|(out, column)| *out = row[*column]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::Plane;

    #[test]
    fn rows_beyond_the_image_repeat_its_edge() {
        let plane = Plane::from_fn(3, 2, |y, x| (10 * y + x) as u8);
        let strip = Strip { first: 1, rows: 2, margin: 2, height: 3 };
        assert_eq!((strip.blocks(), strip.lanes()), (1, 48));
        let mut out = Memory::default();
        strip.transpose(&[1, 0, 0], |y| plane.row(y), |value| value, &mut out).expect("memory");
        assert_eq!(out[..6], [1, 1, 11, 21, 21, 21]);
        assert_eq!(out[48..54], [0, 0, 10, 20, 20, 20]);
        assert_eq!(out[48..96], out[96..144]);
    }
}

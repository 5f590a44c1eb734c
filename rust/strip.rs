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

/// Rows and columns that are brought into lanes at a time: whole registers of bytes, which lanes come in
/// multiples of.
const SIDE: usize = BLOCK / 2;

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
        for (columns, out) in columns.chunks(SIDE).zip(out.chunks_mut(SIDE * lanes)) {
            let columns = Columns::new(columns);
            for first in (0..lanes).step_by(SIDE) {
                let tile = from_fn(|lane| columns.of(row(self.row(first + lane))).map(&value));
                for (out, values) in out.chunks_exact_mut(lanes).zip(turned(tile)) {
                    out[first..][..SIDE].copy_from_slice(&values);
                }
            }
        }
        Ok(())
    }
}

/// A few columns of a row that are picked together.
enum Columns<'a> {
    /// From this one on without a gap, as most are.
    Run(usize),
    /// Others, or fewer.
    Any(&'a [usize]),
}

impl<'a> Columns<'a> {
    fn new(columns: &'a [usize]) -> Self {
        let is_run = columns.windows(2).all(|pair| pair[1] == pair[0] + 1);
        if is_run && columns.len() == SIDE { Self::Run(columns[0]) } else { Self::Any(columns) }
    }

    /// Their values; what is beyond the last is of no meaning.
    #[inline(always)]
    fn of<T: Copy + Default>(&self, row: &[T]) -> [T; SIDE] {
        let mut values = [T::default(); SIDE];
        match self {
            Self::Run(first) => values.copy_from_slice(&row[*first..][..SIDE]),
            Self::Any(columns) => {
                values.iter_mut().zip(*columns).for_each(|(value, x)| *value = row[*x]);
            }
        }
        values
    }
}

/// A square with rows and columns exchanged: each half of its rows is shuffled into the other, over and over.
#[inline(always)]
fn turned<U: Copy + Default>(mut square: [[U; SIDE]; SIDE]) -> [[U; SIDE]; SIDE] {
    for _ in 0..SIDE.ilog2() {
        let mut shuffled = [[U::default(); SIDE]; SIDE];
        for row in 0..SIDE / 2 {
            let (a, b) = (square[row], square[row + SIDE / 2]);
            for i in 0..SIDE / 2 {
                shuffled[2 * row][2 * i] = a[i];
                shuffled[2 * row][2 * i + 1] = b[i];
            }
            for i in 0..SIDE / 2 {
                shuffled[2 * row + 1][2 * i] = a[SIDE / 2 + i];
                shuffled[2 * row + 1][2 * i + 1] = b[SIDE / 2 + i];
            }
        }
        square = shuffled;
    }
    square
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plane::Plane;

    #[test]
    fn columns_of_any_order_and_number_come_into_lanes() {
        let plane = Plane::from_fn(20, 50, |y, x| (1000 * y + x) as u16);
        let strip = Strip { first: 0, rows: 20, margin: 1, height: 20 };
        let runs: Vec<usize> = (0..50).collect();
        let broken: Vec<usize> = (0..3).flat_map(|_| 7..20).chain([49, 0, 0, 3]).collect();
        for columns in [&runs[..], &runs[3..35], &runs[..1], &broken, &[]] {
            let mut out = Memory::default();
            strip.transpose(columns, |y| plane.row(y), u32::from, &mut out).expect("memory");
            assert_eq!(out.len(), columns.len() * strip.lanes());
            for (column, out) in columns.iter().zip(out.chunks_exact(strip.lanes())) {
                let expected = |lane| u32::from(plane.row(strip.row(lane))[*column]);
                assert!(out.iter().enumerate().all(|(lane, value)| *value == expected(lane)));
            }
        }
    }

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

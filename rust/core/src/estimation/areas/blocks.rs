//! Blocks of pixels of an image that are searched or left out together.

use std::ops::Range;

use phasestereo_match::base::plane::{Plane, around};

/// Side of a block, pixels.
pub const BLOCK: usize = 8;
/// Blocks that represent an image.
pub const SAMPLED: usize = 64;
/// Pixels of a block that must cost much along the run for it to be searched.
const MANY: usize = 10;
/// Columns searched together: sums over them stay in the first-level cache.
const LONGEST: usize = 64;

/// The searched blocks of an image.
pub struct Blocks {
    /// Blocks in a row.
    pub cols: usize,
    /// Whether each is searched, row after row.
    pub is_searched: Vec<bool>,
}

impl Blocks {
    /// None of the blocks of an image.
    pub fn none(rows: usize, cols: usize) -> Self {
        let cols = cols.div_ceil(BLOCK);
        Self { cols, is_searched: vec![false; rows.div_ceil(BLOCK) * cols] }
    }

    /// Those with at least `MANY` of these pixels.
    pub fn of(pixels: &Plane<bool>) -> Self {
        Self::of_larger(pixels, 1, pixels.size())
    }

    /// The same for an image of this size, larger by a factor that divides a block, where each pixel
    /// represents several.
    pub fn of_larger(pixels: &Plane<bool>, by: usize, (rows, cols): (usize, usize)) -> Self {
        let mut found = Self::none(rows, cols);
        let side = BLOCK / by;
        for (row, blocks) in found.is_searched.chunks_exact_mut(found.cols).enumerate() {
            let mut counts = vec![0; blocks.len()];
            for y in row * side..((row + 1) * side).min(pixels.rows()) {
                for (count, part) in counts.iter_mut().zip(pixels.row(y).chunks(side)) {
                    *count += part.iter().filter(|is_one| **is_one).count();
                }
            }
            let is_many = |count: usize| count * by * by >= MANY;
            blocks.iter_mut().zip(counts).for_each(|(block, count)| *block = is_many(count));
        }
        found
    }

    /// About [`SAMPLED`] of them, all over the image.
    pub fn sampled(rows: usize, cols: usize) -> Self {
        let mut blocks = Self::none(rows, cols);
        // Odd, so that they are not below one another.
        let step = (blocks.is_searched.len() / SAMPLED) | 1;
        blocks.is_searched.iter_mut().step_by(step).for_each(|block| *block = true);
        blocks
    }

    /// The first row and column of each searched block.
    pub fn places(&self) -> impl Iterator<Item = (usize, usize)> {
        let searched = (0..self.is_searched.len()).filter(|at| self.is_searched[*at]);
        searched.map(|at| (at / self.cols * BLOCK, at % self.cols * BLOCK))
    }

    /// Searches a block and its neighbors.
    pub fn search_around(&mut self, at: usize) {
        let (row, column) = (at / self.cols, at % self.cols);
        for row in around(row, 1, self.is_searched.len() / self.cols) {
            self.is_searched[row * self.cols..][around(column, 1, self.cols)].fill(true);
        }
    }

    /// The columns of neighboring searched blocks in a row of blocks.
    pub fn stretches(&self, row: usize, cols: usize) -> Vec<Range<usize>> {
        let mut stretches: Vec<Range<usize>> = vec![];
        for (block, is_searched) in
            self.is_searched[row * self.cols..(row + 1) * self.cols].iter().enumerate()
        {
            let (start, end) = (block * BLOCK, ((block + 1) * BLOCK).min(cols));
            match stretches.last_mut() {
                Some(last) if *is_searched && last.end == start && last.len() < LONGEST => {
                    last.end = end;
                }
                _ if *is_searched => stretches.push(start..end),
                _ => {}
            }
        }
        stretches
    }
}

//! A map in the making: bands of it are written by tasks of their own, then it is refined as a whole.

use std::ops::Range;

use crate::error::Result;
use crate::image::plane::Plane;
use crate::refinement::ResultRow;

/// A map in the making.
#[derive(Debug)]
pub struct Map {
    /// Disparities, pixels; NaN where there is none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: Plane<u16>,
    /// Votes for the disparities, from 0 to 1, if the settings need them.
    pub votes: Option<Plane<f32>>,
}

/// The part of the map that one task writes.
#[derive(Debug)]
pub struct Band<'a> {
    first: usize,
    cols: usize,
    /// Disparities, row after row.
    pub disparity: &'a mut [f32],
    /// Flags, row after row.
    pub flags: &'a mut [u16],
    votes: Option<&'a mut [f32]>,
}

impl Map {
    /// A map of so many rows and columns, of which nothing is known.
    pub fn new((rows, cols): (usize, usize), with_votes: bool) -> Result<Self> {
        Ok(Self {
            disparity: Plane::new(rows, cols)?,
            flags: Plane::new(rows, cols)?,
            votes: with_votes.then(|| Plane::new(rows, cols)).transpose()?,
        })
    }

    /// Parts of the map: these rows of the pair, one after another, of which the first is the map's.
    pub fn bands(&mut self, rows: impl Iterator<Item = Range<usize>>) -> Vec<Band<'_>> {
        let cols = self.disparity.cols();
        let mut disparity = self.disparity.as_mut_slice();
        let mut flags = self.flags.as_mut_slice();
        let mut votes = self.votes.as_mut().map(Plane::as_mut_slice);
        let band = |rows: Range<usize>| {
            let places = rows.len() * cols;
            Band {
                first: rows.start,
                cols,
                disparity: disparity.split_off_mut(..places).unwrap_or_default(),
                flags: flags.split_off_mut(..places).unwrap_or_default(),
                votes: votes.as_mut().and_then(|votes| votes.split_off_mut(..places)),
            }
        };
        rows.map(band).collect()
    }
}

impl Band<'_> {
    /// The rows of the pair that it is of.
    pub fn rows(&self) -> Range<usize> {
        self.first..self.first + self.disparity.len() / self.cols
    }

    /// One of its rows.
    pub fn row(&mut self, row: usize) -> ResultRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;
        ResultRow {
            disparity: &mut self.disparity[places.clone()],
            flags: &mut self.flags[places.clone()],
            votes: self.votes.as_deref_mut().map(|votes| &mut votes[places]),
        }
    }
}

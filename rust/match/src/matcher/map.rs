//! The disparity map before and during refinement: tasks write bands of it, then it is refined as a whole.

use std::ops::Range;

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::refinement::ResultRow;

/// An unrefined disparity map.
#[derive(Debug)]
pub struct DraftMap {
    /// Disparities, pixels; NaN: none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: Plane<u16>,
    /// Support of the disparities, from 0 to 1, if the settings need it.
    pub votes: Option<Plane<f32>>,
}

/// The part of the map that one task writes.
#[derive(Debug)]
pub struct MapBand<'a> {
    first: usize,
    cols: usize,
    disparity: &'a mut [f32],
    flags: &'a mut [u16],
    votes: Option<&'a mut [f32]>,
}

impl DraftMap {
    /// A map of zeros of this size.
    pub fn new((rows, cols): (usize, usize), with_votes: bool) -> Result<Self> {
        Ok(Self {
            disparity: Plane::new(rows, cols)?,
            flags: Plane::new(rows, cols)?,
            votes: with_votes.then(|| Plane::new(rows, cols)).transpose()?,
        })
    }

    /// Consecutive bands of the map: `rows` are rows of the pair, the first of which is the map's first.
    pub fn bands(&mut self, rows: impl Iterator<Item = Range<usize>>) -> Vec<MapBand<'_>> {
        let cols = self.disparity.cols();
        let mut disparity = self.disparity.as_mut_slice();
        let mut flags = self.flags.as_mut_slice();
        let mut votes = self.votes.as_mut().map(Plane::as_mut_slice);

        // Each call takes the band's pixels off the front of the rest of the planes.
        let band = |rows: Range<usize>| {
            let places = rows.len() * cols;
            MapBand {
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

impl MapBand<'_> {
    /// The rows of the pair that the band covers.
    pub fn rows(&self) -> Range<usize> {
        self.first..self.first + self.disparity.len() / self.cols
    }

    /// The row of the map with this index within the band.
    pub fn row(&mut self, row: usize) -> ResultRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;

        ResultRow {
            disparity: &mut self.disparity[places.clone()],
            flags: &mut self.flags[places.clone()],
            votes: self.votes.as_deref_mut().map(|votes| &mut votes[places]),
        }
    }
}

//! Square tiles of an image, each with the block around its center.

use super::bins::SIDE;

/// The tiles of an image, row after row; those at its far ends may reach beyond it.
#[derive(Debug, Clone, Copy)]
pub struct Tiling {
    /// Rows and columns of the image.
    image: (usize, usize),
    /// Side of a tile, pixels.
    pub side: usize,
    /// Rows of tiles.
    pub rows: usize,
    /// Columns of tiles.
    pub cols: usize,
}

impl Tiling {
    /// The tiles of an image of this size.
    pub fn new(image: (usize, usize), side: usize) -> Self {
        Self { image, side, rows: image.0.div_ceil(side), cols: image.1.div_ceil(side) }
    }

    /// The row and the column of a tile.
    pub fn place(&self, tile: usize) -> (usize, usize) {
        (tile / self.cols, tile % self.cols)
    }

    /// The tile in a row and a column, or the last one.
    pub fn tile(&self, (y, x): (usize, usize)) -> usize {
        y.min(self.rows - 1) * self.cols + x.min(self.cols - 1)
    }

    /// The pixel in the middle of a tile; at the far ends, the last one.
    pub fn center(&self, (y, x): (usize, usize)) -> (usize, usize) {
        let center = |tile: usize, length: usize| (tile * self.side + self.side / 2).min(length - 1);
        (center(y, self.image.0), center(x, self.image.1))
    }

    /// The first pixel of the block around the center of a tile, moved inside the image.
    pub fn corner(&self, place: (usize, usize)) -> (usize, usize) {
        let (y, x) = self.center(place);
        let first = |center: usize, length: usize| center.saturating_sub(SIDE / 2).min(length - SIDE);
        (first(y, self.image.0), first(x, self.image.1))
    }

    /// The first rows of the blocks of all rows of tiles.
    pub fn tops(&self) -> Vec<usize> {
        (0..self.rows).map(|y| self.corner((y, 0)).0).collect()
    }
}

//! What speaks for and against the disparities chosen for a band of rows.

use crate::error::Result;
use crate::memory::Memory;

/// A cost that there is none of.
pub const NONE: u32 = u32::MAX;

/// What is known of the candidate chosen for a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Its index.
    pub chosen: u16,
    /// What it costs.
    pub own: u32,
    /// The least cost elsewhere: not next to it, where the same match shows again. [`NONE`]: there is no elsewhere.
    pub elsewhere: u32,
    /// Where the match lies, from the chosen candidate on, pixels.
    pub offset: f32,
}

/// What was found of the pixels of a band, row after row.
#[derive(Debug, Default)]
pub struct Evidence {
    cols: usize,
    chosen: Memory<u16>,
    own: Memory<u32>,
    elsewhere: Memory<u32>,
    offset: Memory<f32>,
}

/// What was found of neighboring pixels: the fields of [`Found`].
#[derive(Debug, Clone, Copy)]
#[expect(missing_docs, reason = "they are those of Found")]
pub struct EvidenceRow<'a> {
    pub chosen: &'a [u16],
    pub own: &'a [u32],
    pub elsewhere: &'a [u32],
    pub offset: &'a [f32],
}

impl Evidence {
    /// Begins a band.
    pub fn begin(&mut self, rows: usize, cols: usize) -> Result<()> {
        self.cols = cols;
        self.chosen.room(rows * cols)?;
        self.own.room(rows * cols)?;
        self.elsewhere.room(rows * cols)?;
        self.offset.room(rows * cols)
    }

    /// Writes what was found of neighboring pixels of a row, from column `first` on.
    #[inline(always)]
    pub fn set(&mut self, row: usize, first: usize, found: EvidenceRow) {
        let places = row * self.cols + first..row * self.cols + first + found.chosen.len();
        self.chosen[places.clone()].copy_from_slice(found.chosen);
        self.own[places.clone()].copy_from_slice(found.own);
        self.elsewhere[places.clone()].copy_from_slice(found.elsewhere);
        self.offset[places].copy_from_slice(found.offset);
    }

    /// What was found of a row.
    pub fn row(&self, row: usize) -> EvidenceRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;
        EvidenceRow {
            chosen: &self.chosen[places.clone()],
            own: &self.own[places.clone()],
            elsewhere: &self.elsewhere[places.clone()],
            offset: &self.offset[places],
        }
    }
}

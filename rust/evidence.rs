//! What speaks for and against the chosen candidates of a band of rows.

use crate::error::Result;
use crate::memory::Memory;

/// A cost that there is none of.
pub const NONE: u32 = u32::MAX;

/// What was found of the pixels of a band, row after row.
#[derive(Debug, Default)]
pub struct Evidence {
    cols: usize,
    chosen: Memory<u16>,
    own: Memory<u32>,
    elsewhere: Memory<u32>,
    offset: Memory<f32>,
}

/// What was found of some neighbouring pixels of a row.
#[derive(Debug, Clone, Copy)]
pub struct EvidenceRow<'a> {
    /// Index of the chosen candidate.
    pub chosen: &'a [u16],
    /// What it costs.
    pub own: &'a [u32],
    /// The least cost elsewhere: not next to it, where the same match shows again. [`NONE`]: there is no elsewhere.
    pub elsewhere: &'a [u32],
    /// Where the match lies, from the chosen candidate on, pixels.
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

    /// Writes what was found of neighbouring pixels.
    #[inline(always)]
    pub fn set(&mut self, row: usize, first: usize, found: EvidenceRow) {
        let (place, count) = (row * self.cols + first, found.chosen.len());
        self.chosen[place..][..count].copy_from_slice(found.chosen);
        self.own[place..][..count].copy_from_slice(found.own);
        self.elsewhere[place..][..count].copy_from_slice(found.elsewhere);
        self.offset[place..][..count].copy_from_slice(found.offset);
    }

    /// Takes over what another one has, from column `first` on.
    pub fn take(&mut self, other: &Self, first: usize) {
        let rows = other.chosen.len() / other.cols.max(1);
        (0..rows).for_each(|row| self.set(row, first, other.row(row)));
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

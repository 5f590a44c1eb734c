//! What speaks for and against the disparities chosen for a band of rows.

use crate::error::Result;
use crate::pipeline::memory::Memory;

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

/// What was found of neighboring pixels.
#[derive(Debug, Clone, Copy)]
pub struct EvidenceRow<'a> {
    /// Indices of the chosen candidates.
    pub chosen: &'a [u16],
    /// What they cost.
    pub own: &'a [u32],
    /// The least costs elsewhere: not next to them, where the same match shows again. [`NONE`]: there is no elsewhere.
    pub elsewhere: &'a [u32],
    /// Where the matches lie, from the chosen candidates on, pixels.
    pub offset: &'a [f32],
}

impl Evidence {
    /// Begins a band; unless it is weighed, the chosen candidates are all that is known of it.
    pub fn begin(&mut self, rows: usize, cols: usize, is_weighed: bool) -> Result<()> {
        self.cols = cols;
        self.chosen.resize(rows * cols)?;
        let weighed = if is_weighed { rows * cols } else { 0 };
        self.own.resize(weighed)?;
        self.elsewhere.resize(weighed)?;
        self.offset.resize(weighed)
    }

    /// Writes which candidates were chosen for neighboring pixels of a row, from column `first` on.
    #[inline(always)]
    pub fn choose(&mut self, row: usize, first: usize, chosen: &[u16]) {
        self.chosen[row * self.cols + first..][..chosen.len()].copy_from_slice(chosen);
    }

    /// Writes what was found of neighboring pixels of a row that is weighed, from column `first` on.
    #[inline(always)]
    pub fn set(&mut self, row: usize, first: usize, found: EvidenceRow) {
        let places = row * self.cols + first..row * self.cols + first + found.chosen.len();
        self.choose(row, first, found.chosen);
        self.own[places.clone()].copy_from_slice(found.own);
        self.elsewhere[places.clone()].copy_from_slice(found.elsewhere);
        self.offset[places].copy_from_slice(found.offset);
    }

    /// What was found of a row.
    pub fn row(&self, row: usize) -> EvidenceRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;
        let weighed = if self.own.is_empty() { 0..0 } else { places.clone() };
        EvidenceRow {
            chosen: &self.chosen[places],
            own: &self.own[weighed.clone()],
            elsewhere: &self.elsewhere[weighed.clone()],
            offset: &self.offset[weighed],
        }
    }
}

//! The chosen candidates of a band of rows, and the evidence for and against each: its cost, the second-best
//! cost, and the sub-pixel offset.

use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::base::value::ROWS;

/// The cost of a missing candidate.
pub const NONE: u32 = u32::MAX;

/// The evidence of the pixels of a band, row after row.
#[derive(Debug, Default)]
pub struct Evidence {
    cols: usize,
    chosen: Memory<u16>,
    best: Memory<u32>,
    second_best: Memory<u32>,
    offset: Memory<f32>,
}

/// The evidence of neighboring pixels of a row.
#[derive(Debug, Clone, Copy)]
pub struct EvidenceRow<'a> {
    /// Indices of the chosen candidates.
    pub chosen: &'a [u16],
    /// Their costs.
    pub best: &'a [u32],
    /// The second-best costs: the lowest among candidates not next to the chosen ones, since neighbors see
    /// the same match. [`NONE`]: no such candidate.
    pub second_best: &'a [u32],
    /// Sub-pixel offsets of the matches from the chosen candidates, pixels.
    pub offset: &'a [f32],
}

impl EvidenceRow<'_> {
    /// Only the chosen candidates.
    pub fn bare(self) -> Self {
        Self { best: &[], second_best: &[], offset: &[], ..self }
    }
}

impl Evidence {
    /// Sizes the buffers for a band. If the band is not weighed, only the chosen candidates are kept.
    pub fn begin(&mut self, rows: usize, cols: usize, is_weighed: bool) -> Result<()> {
        self.cols = cols;
        self.chosen.resize(rows * cols)?;

        let weighed = if is_weighed { rows * cols } else { 0 };
        self.best.resize(weighed)?;
        self.second_best.resize(weighed)?;
        self.offset.resize(weighed)
    }

    /// Writes the candidates chosen for neighboring pixels of a row, from column `first` on.
    #[inline(always)]
    pub fn choose(&mut self, row: usize, first: usize, chosen: &[u16]) {
        write(&mut self.chosen[row * self.cols + first..], chosen);
    }

    /// Writes the evidence of neighboring pixels of a row of a weighed band, from column `first` on.
    #[inline(always)]
    pub fn set(&mut self, row: usize, first: usize, found: EvidenceRow) {
        let place = row * self.cols + first;

        write(&mut self.chosen[place..], found.chosen);
        write(&mut self.best[place..], found.best);
        write(&mut self.second_best[place..], found.second_best);
        write(&mut self.offset[place..], found.offset);
    }

    /// The evidence of a row; unless the band is weighed, all but the chosen candidates is empty.
    pub fn row(&self, row: usize) -> EvidenceRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;
        let weighed = if self.best.is_empty() { 0..0 } else { places.clone() };

        EvidenceRow {
            chosen: &self.chosen[places],
            best: &self.best[weighed.clone()],
            second_best: &self.second_best[weighed.clone()],
            offset: &self.offset[weighed],
        }
    }
}

/// Writes values. Most calls have `ROWS` of them, which are copied in registers, without a call.
#[inline(always)]
fn write<V: Copy>(out: &mut [V], values: &[V]) {
    match (<&[V; ROWS]>::try_from(values), out.first_chunk_mut()) {
        (Ok(values), Some(out)) => *out = *values,
        _ => out[..values.len()].copy_from_slice(values),
    }
}

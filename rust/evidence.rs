//! What speaks for and against the chosen candidates of a band of rows.

use crate::error::Result;
use crate::memory::Memory;
use crate::value::Value;

/// A cost that there is none of: beyond the first or the last candidate.
pub const NONE: u32 = u32::MAX;

/// Chosen candidates and costs, row after row.
#[derive(Debug, Default)]
pub struct Evidence {
    cols: usize,
    chosen: Memory<u16>,
    /// Of the chosen candidate, of those below and above it, and the least one elsewhere.
    costs: [Memory<u32>; 4],
}

/// The evidence of one row.
#[derive(Debug, Clone, Copy)]
pub struct EvidenceRow<'a> {
    /// Index of the chosen candidate.
    pub chosen: &'a [u16],
    /// What it costs.
    pub own: &'a [u32],
    /// What the candidate before it costs; [`NONE`]: there is no such candidate.
    pub below: &'a [u32],
    /// What the candidate after it costs; [`NONE`]: there is no such candidate.
    pub above: &'a [u32],
    /// The least cost elsewhere: not next to it, where the same match shows again. [`NONE`]: there is no elsewhere.
    pub elsewhere: &'a [u32],
}

impl Evidence {
    /// Begins a band.
    pub fn begin(&mut self, rows: usize, cols: usize) -> Result<()> {
        self.cols = cols;
        self.chosen.room(rows * cols)?;
        self.costs.iter_mut().try_for_each(|costs| costs.room(rows * cols))
    }

    /// Writes what was found of some pixels of a row: the chosen candidates, and costs in the order of
    /// [`EvidenceRow`]; the largest value of their type means that there is none.
    #[inline(always)]
    pub fn set<W: Value, const N: usize>(
        &mut self,
        row: usize,
        first: usize,
        chosen: &[u16; N],
        costs: [[W; N]; 4],
    ) {
        let place = row * self.cols + first;
        self.chosen[place..][..N].copy_from_slice(chosen);
        for (out, costs) in self.costs.iter_mut().zip(costs) {
            for (out, cost) in out[place..][..N].iter_mut().zip(costs) {
                let is_none = cost == W::truncated(u64::MAX);
                *out = if is_none { NONE } else { cost.widened().min(u64::from(NONE - 1)) as u32 };
            }
        }
    }

    /// Takes over the columns from `first` on from another one.
    pub fn take(&mut self, other: &Self, first: usize, cols: usize) {
        fn copy<T: Copy>(
            ours: &mut [T],
            our_cols: usize,
            theirs: &[T],
            their_cols: usize,
            place: (usize, usize),
        ) {
            let rows = ours.chunks_exact_mut(our_cols).zip(theirs.chunks_exact(their_cols));
            rows.for_each(|(ours, theirs)| {
                ours[place.0..][..place.1].copy_from_slice(&theirs[..place.1])
            });
        }
        copy(&mut self.chosen, self.cols, &other.chosen, other.cols, (first, cols));
        for (ours, theirs) in self.costs.iter_mut().zip(&other.costs) {
            copy(ours, self.cols, theirs, other.cols, (first, cols));
        }
    }

    /// The evidence of a row.
    pub fn row(&self, row: usize) -> EvidenceRow<'_> {
        let places = row * self.cols..(row + 1) * self.cols;
        let [own, below, above, elsewhere] =
            self.costs.each_ref().map(|costs| &costs[places.clone()]);
        EvidenceRow { chosen: &self.chosen[places.clone()], own, below, above, elsewhere }
    }
}

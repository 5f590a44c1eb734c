//! Sums of all paths -> the best candidate of each pixel, and what the others came to.

use std::ops::Range;

use crate::error::Result;
use crate::evidence::Evidence;
use crate::memory::Memory;
use crate::semiglobal::volume::GROUP;
use crate::value::Value;

/// What is best in some groups of columns of a band.
#[derive(Debug)]
pub struct Selection<W> {
    groups: Range<usize>,
    sums: Memory<W>,
    evidence: Evidence,
}

impl<W> Default for Selection<W> {
    fn default() -> Self {
        Self { groups: 0..0, sums: Memory::default(), evidence: Evidence::default() }
    }
}

impl<W: Value> Selection<W> {
    /// Begins a band of so many rows.
    pub fn begin(&mut self, rows: usize, groups: Range<usize>, candidates: usize) -> Result<()> {
        self.sums.room(candidates * GROUP)?;
        self.evidence.begin(rows, groups.len() * GROUP)?;
        self.groups = groups;
        Ok(())
    }

    /// What was selected, of all rows.
    pub fn evidence(&self) -> &Evidence {
        &self.evidence
    }

    /// Where the sums of a group of columns are to be written, of one candidate after another.
    #[inline(always)]
    pub fn sums(&mut self) -> &mut [[W; GROUP]] {
        self.sums.as_chunks_mut().0
    }

    /// Selects from these sums: of equal ones the first.
    #[inline(always)]
    pub fn select(&mut self, row: usize, group: usize) {
        if !self.groups.contains(&group) {
            return;
        }
        let sums = self.sums.as_chunks::<GROUP>().0;
        let (mut own, mut chosen) = ([W::FAR; GROUP], [0u16; GROUP]);
        for (k, sums) in (0u16..).zip(sums.iter().copied()) {
            for j in 0..GROUP {
                chosen[j] = if sums[j] < own[j] { k } else { chosen[j] };
                own[j] = own[j].min(sums[j]);
            }
        }
        let most = W::truncated(u64::MAX);
        let (mut below, mut above, mut elsewhere) = ([most; GROUP], [most; GROUP], [most; GROUP]);
        for (k, sums) in (0u16..).zip(sums.iter().copied()) {
            for j in 0..GROUP {
                // All bits where the candidate is the chosen one or next to it.
                let is_near = if chosen[j].abs_diff(k) > 1 { W::default() } else { most };
                elsewhere[j] = elsewhere[j].min(sums[j].max(is_near));
            }
        }
        for j in 0..GROUP {
            let k = usize::from(chosen[j]);
            below[j] = k.checked_sub(1).map_or(most, |k| sums[k][j]);
            above[j] = sums.get(k + 1).map_or(most, |sums| sums[j]);
        }
        let first = (group - self.groups.start) * GROUP;
        self.evidence.set(row, first, &chosen, [own, below, above, elsewhere]);
    }
}

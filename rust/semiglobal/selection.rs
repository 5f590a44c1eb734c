//! Sums of all paths -> the best candidate of each pixel, and what the others came to.

use std::array::from_fn;
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
    candidates: usize,
    sums: Memory<W>,
    evidence: Evidence,
}

impl<W> Default for Selection<W> {
    fn default() -> Self {
        Self { groups: 0..0, candidates: 0, sums: Memory::default(), evidence: Evidence::default() }
    }
}

impl<W: Value> Selection<W> {
    /// Begins a band of so many rows.
    pub fn begin(&mut self, rows: usize, groups: Range<usize>, candidates: usize) -> Result<()> {
        self.candidates = candidates;
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
    pub fn sums(&mut self, candidates: usize) -> &mut [[W; GROUP]] {
        &mut self.sums.as_chunks_mut().0[..candidates]
    }

    /// Selects from these sums: of equal ones the first.
    #[inline(always)]
    pub fn select(&mut self, row: usize, group: usize) {
        if !self.groups.contains(&group) {
            return;
        }
        let sums = &self.sums.as_chunks::<GROUP>().0[..self.candidates];
        let (mut own, mut chosen) = ([W::FAR; GROUP], [0u16; GROUP]);
        for (k, sums) in (0u16..).zip(sums) {
            for j in 0..GROUP {
                chosen[j] = if sums[j] < own[j] { k } else { chosen[j] };
                own[j] = own[j].min(sums[j]);
            }
        }
        let most = W::truncated(u64::MAX);
        let mut elsewhere = [most; GROUP];
        for (k, sums) in (0u16..).zip(sums) {
            for j in 0..GROUP {
                let is_near = chosen[j].abs_diff(k) <= 1;
                elsewhere[j] = elsewhere[j].min(if is_near { most } else { sums[j] });
            }
        }
        let beside: [[W; 2]; GROUP] = from_fn(|j| {
            let at = |k: usize| sums.get(k).map_or(most, |sums| sums[j]);
            let k = usize::from(chosen[j]);
            [at(k.wrapping_sub(1)), at(k + 1)]
        });
        let first = (group - self.groups.start) * GROUP;
        self.evidence.set(
            row,
            first,
            &chosen,
            [own, from_fn(|j| beside[j][0]), from_fn(|j| beside[j][1]), elsewhere],
        );
    }
}

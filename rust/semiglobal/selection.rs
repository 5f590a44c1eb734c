//! Sums of all paths -> the best candidate of each pixel, and what the others came to.

use std::ops::Range;

use crate::error::Result;
use crate::evidence::{Evidence, EvidenceRow, NONE};
use crate::memory::Memory;
use crate::semiglobal::PATHS;
use crate::semiglobal::volume::GROUP;
use crate::subpixel::{evidence, offset};
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

    /// Selects from these sums, of equal ones the first; `costs` are those of the pixels themselves.
    #[inline(always)]
    pub fn select<V: Value>(&mut self, row: usize, group: usize, costs: &[[V; GROUP]]) {
        if !self.groups.contains(&group) {
            return;
        }
        let sums = &self.sums.as_chunks::<GROUP>().0[..costs.len()];
        let (mut own, mut chosen) = ([W::FAR; GROUP], [0u16; GROUP]);
        for (k, sums) in (0u16..).zip(sums.iter().copied()) {
            for j in 0..GROUP {
                chosen[j] = if sums[j] < own[j] { k } else { chosen[j] };
                own[j] = own[j].min(sums[j]);
            }
        }
        let most = W::truncated(u64::MAX);
        let mut elsewhere = [most; GROUP];
        for (k, sums) in (0u16..).zip(sums.iter().copied()) {
            for j in 0..GROUP {
                // All bits where the candidate is the chosen one or next to it.
                let is_near = if chosen[j].abs_diff(k) > 1 { W::default() } else { most };
                elsewhere[j] = elsewhere[j].min(sums[j].max(is_near));
            }
        }
        let found = EvidenceRow {
            chosen: &chosen,
            own: &own.map(cost),
            elsewhere: &elsewhere.map(|sum| if sum == most { NONE } else { cost(sum) }),
            offset: &offsets(chosen, sums, costs),
        };
        self.evidence.set(row, (group - self.groups.start) * GROUP, found);
    }
}

/// Where matches lie between candidates. Those at either end of the range are taken as they are.
#[inline(always)]
fn offsets<W: Value, V: Value>(
    chosen: [u16; GROUP],
    sums: &[[W; GROUP]],
    costs: &[[V; GROUP]],
) -> [f32; GROUP] {
    let mut valleys = [[0; GROUP]; 3];
    for j in 0..GROUP {
        let middle = usize::from(chosen[j]);
        let is_inside = middle > 0 && middle + 1 < costs.len();
        for (place, valley) in valleys.iter_mut().enumerate() {
            let k = if is_inside { middle + place - 1 } else { middle };
            valley[j] = evidence(cost(sums[k][j]), cost(costs[k][j]), PATHS);
        }
    }
    let [below, own, above] = valleys;
    let mut offsets = [0.0; GROUP];
    for j in 0..GROUP {
        offsets[j] = offset(below[j], own[j], above[j]);
    }
    offsets
}

#[inline(always)]
fn cost<V: Value>(value: V) -> u32 {
    value.widened().min(u64::from(NONE - 1)) as u32
}

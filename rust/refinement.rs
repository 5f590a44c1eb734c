//! Chosen candidates -> what the caller gets: disparities, flags that say why, and confidence.

use std::array::from_fn;

use crate::aggregation::{Aggregated, Tile};
use crate::candidates::Candidates;
use crate::error::Result;
use crate::memory::Memory;
use crate::simd::Kernel;
use crate::strip::BLOCK;
use crate::value::Value;
use crate::votes::Votes;

/// Why an estimate is missing or not to be trusted; bits of the flags.
pub mod flag {
    /// The left pixel is masked: there is no estimate.
    pub const MASKED: u16 = 1;
    /// No candidate has a valid pixel in the right image: there is no estimate.
    pub const NO_CANDIDATE: u16 = 2;
    /// The match lies outside the right image.
    pub const OUTSIDE: u16 = 4;
    /// The match lies on a masked pixel of the right image.
    pub const MATCH_MASKED: u16 = 8;
    /// The left pixel is not seen in the right image: what was chosen for it belongs to another one.
    pub const OCCLUDED: u16 = 16;
    /// What was chosen belongs to another left pixel, too, although the right image sees this one.
    pub const MISMATCHED: u16 = 32;
    /// Another candidate costs about as much.
    pub const LOW_CONFIDENCE: u16 = 64;
    /// The pixel belongs to a small region that stands out from all around it.
    pub const SPECKLE: u16 = 128;
    /// The disparity is that of other pixels: this one's own is not trusted.
    pub const FILLED: u16 = 256;

    /// Those that leave nothing to estimate.
    pub const MISSING: u16 = MASKED | NO_CANDIDATE;
    /// Those of a pixel whose own estimate is missing or not to be trusted.
    pub const UNTRUSTED: u16 =
        MISSING | OUTSIDE | MATCH_MASKED | OCCLUDED | MISMATCHED | LOW_CONFIDENCE | SPECKLE;
}

/// One pixel of the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Disparity, pixels; NaN where there is none.
    pub disparity: f32,
    /// Reasons, from [`flag`].
    pub flags: u16,
    /// From 0 to 1.
    pub confidence: f32,
}

/// What pixels are told by that all have in common.
#[derive(Debug, Clone, Copy)]
pub struct Judge<'a> {
    /// The disparities that were searched.
    pub candidates: Candidates,
    /// Columns of the image.
    pub cols: usize,
    /// Which (pixel, candidate) pairs are valid; `None`: all.
    pub votes: Option<&'a Votes<'a>>,
    /// Whether untrusted estimates stay.
    pub fill: bool,
}

impl Judge<'_> {
    /// The estimate of pixel `(y, x)`, for which `chosen` was chosen.
    #[inline]
    pub fn estimate(&self, y: usize, x: usize, chosen: u16, margin: Option<Margin>) -> Estimate {
        let flags = self.flags(y, x, chosen.into());
        let distrusted = if self.fill { flag::MISSING } else { !0 };
        if flags & distrusted != 0 {
            return Estimate { disparity: f32::NAN, flags, confidence: 0.0 };
        }
        let disparity = self.candidates.disparity(chosen.into()) as f32;
        Estimate { disparity, flags, confidence: margin.map_or(0.0, Margin::confidence) }
    }

    #[inline]
    fn flags(&self, y: usize, x: usize, chosen: usize) -> u16 {
        let is_outside = self.candidates.is_outside(x, chosen, self.cols);
        let outside = if is_outside { flag::OUTSIDE } else { 0 };
        let Some(votes) = self.votes else { return outside };
        if votes.is_masked(y, x) {
            flag::MASKED
        } else if !(0..self.candidates.count()).any(|k| votes.has(y, x, k)) {
            flag::NO_CANDIDATE
        } else if votes.has(y, x, chosen) {
            outside
        } else {
            outside | flag::MATCH_MASKED
        }
    }
}

/// The aggregated cost of the chosen candidate, and the least one elsewhere: not next to it, where the same
/// match shows again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Margin {
    /// Cost of the chosen candidate.
    pub own: u64,
    /// Least cost elsewhere; `None`: there is no elsewhere.
    pub elsewhere: Option<u64>,
}

impl Margin {
    /// The margin relative to the least cost elsewhere, clipped to `[0, 1]`; 0 where there is no elsewhere.
    pub fn confidence(self) -> f32 {
        match self.elsewhere {
            None | Some(0) => 0.0,
            Some(second) => {
                let margin = second.saturating_sub(self.own);
                (margin as f64 / second as f64) as f32
            }
        }
    }
}

/// The margins of one strip after another; their memory is used again.
#[derive(Debug)]
pub struct Margins<V> {
    own: Memory<V>,
    elsewhere: Memory<V>,
}

impl<V> Default for Margins<V> {
    fn default() -> Self {
        Self { own: Memory::default(), elsewhere: Memory::default() }
    }
}

impl<V: Value> Margins<V> {
    /// Begins a strip of so many pixels, in blocks.
    pub fn begin(&mut self, blocks: usize) -> Result<()> {
        self.own.room(blocks * BLOCK)?;
        self.elsewhere.room(blocks * BLOCK)
    }

    /// The margin of the pixel at a place of the strip, of which `chosen` of `count` candidates was chosen.
    pub fn of(&self, place: usize, chosen: u16, count: usize) -> Margin {
        let is_elsewhere = chosen >= 2 || usize::from(chosen) + 2 < count;
        let own = self.own[place].widened();
        let elsewhere = is_elsewhere.then(|| self.elsewhere[place].widened());
        Margin { own, elsewhere }
    }
}

/// The columns of a tile, searched for the costs of what was chosen and of what was not.
#[derive(Debug)]
pub struct Measure<'a, V> {
    /// Where margins are kept.
    pub margins: &'a mut Margins<V>,
    /// Indices chosen, of one block after another, column after column, lane by lane.
    pub chosen: &'a [u16],
    /// The columns.
    pub tile: &'a Tile,
    /// What they cost.
    pub costs: Aggregated<'a, V>,
    /// Blocks of lanes.
    pub blocks: usize,
    /// Columns of the image.
    pub cols: usize,
}

impl<V: Value> Kernel for Measure<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let most = V::truncated(u64::MAX);
        for (place, column) in self.tile.finished.clone().enumerate() {
            for block in 0..self.blocks {
                let at = block * self.cols + column;
                let Some(chosen) = self.chosen[at * BLOCK..].first_chunk::<BLOCK>() else { return };
                let (mut own, mut elsewhere) = ([most; BLOCK], [most; BLOCK]);
                for (index, &cost) in (0..).zip(self.costs.of(place, block).every()) {
                    let none = V::default();
                    // All bits where the candidate is the chosen one or next to it.
                    let is_near: [V; BLOCK] =
                        from_fn(|j| if u16::abs_diff(chosen[j], index) > 1 { none } else { most });
                    let is_other: [V; BLOCK] =
                        from_fn(|j| if chosen[j] == index { none } else { most });
                    elsewhere = from_fn(|j| elsewhere[j].min(cost[j].max(is_near[j])));
                    own = from_fn(|j| own[j].min(cost[j].max(is_other[j])));
                }
                self.margins.own.as_chunks_mut().0[at] = own;
                self.margins.elsewhere.as_chunks_mut().0[at] = elsewhere;
            }
        }
    }
}

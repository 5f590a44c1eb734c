//! The costs of a pixel's candidates -> the best candidate, the second-best cost, and the sub-pixel offset.
//!
//! ```text
//! chosen      = the least k with cost[k] = min over k' of cost[k']
//! best        = cost[chosen]
//! second_best = min of cost[k] over |k - chosen| > 1
//! offset      = the tip of a V through chosen - 1, chosen, chosen + 1
//! ```
//!
//! While costs stream by, each lane keeps its smallest one; at the end, the smallest lanes of sixteen pixels
//! are found together. The costs are then read twice more from the first-level cache: to locate the smallest
//! one, by a bit mask of the lanes equal to it, and for the second-best cost, with the chosen candidate and
//! its neighbors masked.
//!
//! Pixels go through the steps together, each step a small loop of its own, since the compiler turns such
//! loops into vector instructions. Values written pixel by pixel are read for all pixels only some steps
//! later: a processor has to wait if it reads in one piece what it has just written in many.

use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::base::simd::highest_bits;
use crate::base::value::{LANES, LaneRows, Lanes, ROWS, Value};
use crate::optimization::evidence::{Evidence, EvidenceRow, NONE};
use crate::optimization::subpixel::{self, evidence};

/// Pixels whose candidates are selected together.
pub const PIXELS: usize = ROWS;

/// The selection for up to [`PIXELS`] pixels. Access it through a reference: the compiler would split a local
/// one into single lanes.
#[derive(Debug)]
pub struct Selection<T> {
    /// The least cost of each pixel in each lane.
    least: LaneRows<T>,
    /// Costs of the chosen candidates.
    best: [T; PIXELS],
    /// Indices of the chosen candidates.
    chosen: [u16; PIXELS],
    /// The largest number at three places in the middle, 0 at all others. The part that has them at a
    /// candidate and its neighbors masks their costs: the maximum with it leaves all other costs unchanged.
    mask: Memory<T>,
    /// Smallest costs among candidates not next to the chosen ones.
    second_best: [u32; PIXELS],
    /// Sub-pixel offsets from the chosen candidates.
    offset: [f32; PIXELS],
}

impl<T: Value> Default for Selection<T> {
    fn default() -> Self {
        Self {
            least: LaneRows([[T::default(); LANES]; PIXELS]),
            best: [T::default(); PIXELS],
            chosen: [0; PIXELS],
            mask: Memory::default(),
            second_best: [NONE; PIXELS],
            offset: [0.0; PIXELS],
        }
    }
}

impl<T: Value> Selection<T> {
    /// Sizes the buffer for pixels with up to `most` runs of candidates, whose costs are weighed.
    pub fn begin(&mut self, most: usize) -> Result<()> {
        let middle = most * LANES;
        self.mask.resize(2 * middle + 1)?;
        self.mask.fill(T::default());
        self.mask[middle - 1..middle + 2].fill(T::truncated(u64::MAX));

        Ok(())
    }

    /// The smallest cost of each pixel in each lane, writable.
    #[inline(always)]
    pub fn least(&mut self) -> &mut [Lanes<T>; PIXELS] {
        &mut self.least.0
    }

    /// Finds the smallest cost of each pixel in each lane.
    #[inline(always)]
    pub fn find_least(&mut self, totals: &[Lanes<T>], runs: usize) {
        for (least, totals) in self.least.0.iter_mut().zip(totals.chunks_exact(runs)) {
            let mut lanes = totals[0];
            for totals in &totals[1..] {
                for j in 0..LANES {
                    lanes[j] = lanes[j].min(totals[j]);
                }
            }

            *least = lanes;
        }
    }

    /// Finds the smallest cost of each pixel, from those of its lanes, and the first candidate that has it.
    #[inline(always)]
    pub fn settle(&mut self, totals: &[Lanes<T>], runs: usize) {
        let Self { least, best, chosen, .. } = self;
        *best = T::least_lanes(least);
        // Unused pixels must not keep old numbers.
        *chosen = [0; PIXELS];

        for ((chosen, best), totals) in chosen.iter_mut().zip(best).zip(totals.chunks_exact(runs)) {
            // Neighbors mostly choose from the same run, so the processor predicts where this ends.
            for (run, totals) in totals.iter().enumerate() {
                let mut is_best = [0; LANES];
                for j in 0..LANES {
                    is_best[j] = if totals[j] == *best { u8::MAX } else { 0 };
                }

                let lanes = highest_bits(&is_best);
                if lanes != 0 {
                    *chosen = ((run * LANES) as u32 + lanes.trailing_zeros()) as u16;
                    break;
                }
            }
        }
    }

    /// The candidates chosen for the first pixels.
    #[inline(always)]
    pub fn chosen(&self, pixels: usize) -> &[u16] {
        &self.chosen[..pixels]
    }

    /// Renumbers the chosen candidates among all, given the `start` of those that were searched.
    #[inline(always)]
    pub fn number_from(&mut self, start: usize) {
        for chosen in &mut self.chosen {
            *chosen += start as u16;
        }
    }

    /// Sets the candidate chosen for a pixel and its cost, if the choice was made elsewhere.
    #[inline(always)]
    pub fn choose(&mut self, pixel: usize, chosen: u16, best: T) {
        (self.chosen[pixel], self.best[pixel]) = (chosen, best);
    }

    /// Finds the second-best cost and the sub-pixel offset of the chosen candidates, for pixels with
    /// `candidates` in `runs`. `totals` made the choice; `costs` are those of the pixels alone, if totals are
    /// of paths.
    #[inline(always)]
    pub fn weigh(
        &mut self,
        totals: &[Lanes<T>],
        costs: Option<&[Lanes<T>]>,
        (candidates, runs): (usize, usize),
    ) {
        let Self { least, chosen, mask, second_best, offset, .. } = self;

        // The chosen candidate and its neighbors; at either end of the range any three will do.
        let mut valley = [[0; PIXELS]; 3];
        for (pixel, totals) in totals.chunks_exact(runs).enumerate() {
            let below = usize::from(chosen[pixel]).clamp(1, runs * LANES - 2) - 1;
            let totals = &totals.as_flattened()[below..][..3];

            let mut own = [T::default(); 3];
            if let Some(costs) = costs {
                let costs = &costs[pixel * runs..][..runs];
                own.copy_from_slice(&costs.as_flattened()[below..][..3]);
            }

            for (i, valley) in valley.iter_mut().enumerate() {
                valley[pixel] = evidence(capped(totals[i]), capped(own[i]));
            }
        }

        // The smallest cost that is not masked is the second-best one.
        let middle = mask.len() / 2;
        let pixels = least.0.iter_mut().zip(&*chosen).zip(totals.chunks_exact(runs));
        for ((least, chosen), totals) in pixels {
            let mask = &mask[middle - usize::from(*chosen)..].as_chunks::<LANES>().0[..runs];

            let mut lanes = [T::truncated(u64::MAX); LANES];
            for run in 0..runs {
                for j in 0..LANES {
                    lanes[j] = lanes[j].min(totals[run][j].max(mask[run][j]));
                }
            }

            *least = lanes;
        }

        let others = T::least_lanes(least);

        // From here on for all pixels, used or not: a fixed length is vectorized.
        let candidates = candidates as u32;
        for pixel in 0..PIXELS {
            let k = u32::from(chosen[pixel]);
            let has_second = (k >= 2) | (k + 2 < candidates);
            second_best[pixel] = if has_second { capped(others[pixel]) } else { NONE };
        }

        let [below, at, above] = &valley;
        let mut tips = [0.0; PIXELS];
        for pixel in 0..PIXELS {
            tips[pixel] = subpixel::offset(below[pixel], at[pixel], above[pixel]);
        }

        // At either end of the range there is no V: the match is taken as it is.
        for pixel in 0..PIXELS {
            let k = u32::from(chosen[pixel]);
            let is_inside = (k > 0) & (k + 1 < candidates);
            offset[pixel] = if is_inside { tips[pixel] } else { 0.0 };
        }
    }

    /// Writes the evidence of the first pixels.
    #[inline(always)]
    pub fn write(&self, pixels: usize, evidence: &mut Evidence, (row, first): (usize, usize)) {
        let mut best = [0; PIXELS];
        for (best, cost) in best.iter_mut().zip(&self.best) {
            *best = capped(*cost);
        }

        let found = EvidenceRow {
            chosen: &self.chosen[..pixels],
            best: &best[..pixels],
            second_best: &self.second_best[..pixels],
            offset: &self.offset[..pixels],
        };

        evidence.set(row, first, found);
    }
}

/// A cost in 32 bits, below [`NONE`].
#[inline(always)]
fn capped<T: Value>(cost: T) -> u32 {
    cost.widened().min(u64::from(NONE - 1)) as u32
}

//! The costs of a pixel's candidates -> the best candidate, the best one elsewhere, and the sub-pixel offset.
//!
//! ```text
//! chosen    = the least k with cost[k] = min over k' of cost[k']
//! own       = cost[chosen]
//! elsewhere = min of cost[k] over |k - chosen| > 1
//! offset    = the tip of a V through chosen - 1, chosen, chosen + 1
//! ```
//!
//! While costs go by, each lane keeps its least one and the run of candidates that it came from; only at the end are the
//! lanes compared. Pixels take one step after another together, each step a small loop of its own, since the compiler
//! turns such loops into vector instructions.

use crate::optimization::evidence::{Evidence, EvidenceRow, NONE};
use crate::refinement::subpixel::{self, evidence};
use crate::value::{LANES, Lanes, Value, least_lane};

/// Pixels whose candidates are selected together.
pub const PIXELS: usize = 16;

/// The selection for up to [`PIXELS`] pixels.
#[derive(Debug)]
pub struct Selection<T> {
    /// The number of each lane. In memory, since the compiler splits a constant into single lanes.
    lanes: Lanes<T>,
    /// The least cost in each lane.
    least: [Lanes<T>; PIXELS],
    /// The run of candidates that the least cost of each lane was found in.
    run: [Lanes<T>; PIXELS],
    /// Costs of the chosen candidates.
    own: [T; PIXELS],
    /// Indices of the chosen candidates.
    chosen: [u16; PIXELS],
    /// Least costs of candidates not next to the chosen ones.
    elsewhere: [u32; PIXELS],
    /// Sub-pixel offsets from the chosen candidates.
    offset: [f32; PIXELS],
}

impl<T: Value> Default for Selection<T> {
    fn default() -> Self {
        Self {
            lanes: std::array::from_fn(|j| T::truncated(j as u64)),
            least: [[T::default(); LANES]; PIXELS],
            run: [[T::default(); LANES]; PIXELS],
            own: [T::default(); PIXELS],
            chosen: [0; PIXELS],
            elsewhere: [NONE; PIXELS],
            offset: [0.0; PIXELS],
        }
    }
}

impl<T: Value> Selection<T> {
    /// Most runs of candidates that an index of this type can number.
    pub const MOST_RUNS: u64 = T::LARGEST_TOTAL;

    /// Stores the least cost of each lane of a pixel.
    #[inline(always)]
    pub fn take(&mut self, pixel: usize, minimum: Minimum<T>) {
        self.least[pixel] = minimum.least;
        self.run[pixel] = minimum.run;
    }

    /// Finds the least cost of each pixel, of so many runs of candidates, and the first candidate that has it.
    ///
    /// The first candidate is the least lane in the least run that has the least cost. Lanes and runs that do not qualify
    /// are moved behind all others by adding a number larger than any index, so that every step is a plain minimum.
    #[inline(always)]
    pub fn settle(&mut self, runs: usize) {
        let Self { lanes, least, run, own, chosen, .. } = self;

        for (own, least) in own.iter_mut().zip(&*least) {
            *own = least_lane(least);
        }

        // The runs of lanes whose cost is not the least one are moved behind all runs.
        for ((run, least), own) in run.iter_mut().zip(&*least).zip(&*own) {
            let mut behind = [T::default(); LANES];
            for j in 0..LANES {
                behind[j] = least[j].minus(*own);
            }

            let behind = amplified(behind, runs);
            for j in 0..LANES {
                run[j] = run[j].plus(behind[j]);
            }
        }

        let mut first = [T::default(); PIXELS];
        for (first, run) in first.iter_mut().zip(&*run) {
            *first = least_lane(run);
        }

        // The lanes whose run is not the first one are moved behind all lanes.
        for (run, first) in run.iter_mut().zip(&first) {
            let mut behind = [T::default(); LANES];
            for j in 0..LANES {
                behind[j] = run[j].minus(*first);
            }

            let behind = amplified(behind, LANES);
            for j in 0..LANES {
                run[j] = lanes[j].plus(behind[j]);
            }
        }

        let mut lane = [T::default(); PIXELS];
        for (lane, run) in lane.iter_mut().zip(&*run) {
            *lane = least_lane(run);
        }

        for ((chosen, first), lane) in chosen.iter_mut().zip(&first).zip(&lane) {
            *chosen = (first.widened() * LANES as u64 + lane.widened()) as u16;
        }
    }

    /// The candidates chosen for the first pixels.
    #[inline(always)]
    pub fn chosen(&self, pixels: usize) -> &[u16] {
        &self.chosen[..pixels]
    }

    /// Sets the candidate chosen for a pixel and its cost, where something else has chosen.
    #[inline(always)]
    pub fn choose(&mut self, pixel: usize, chosen: u16, own: T) {
        (self.chosen[pixel], self.own[pixel]) = (chosen, own);
    }

    /// Finds the least cost elsewhere and the sub-pixel offset of the chosen candidates, for pixels with so many candidates
    /// in so many runs. `totals` decided and are overwritten; `costs` are the pixels' own costs, if totals are of paths.
    #[inline(always)]
    pub fn weigh(
        &mut self,
        totals: &mut [Lanes<T>],
        costs: Option<&[Lanes<T>]>,
        (pixels, candidates, runs): (usize, usize, usize),
    ) {
        let Self { least, chosen, elsewhere, offset, .. } = self;
        let most = T::truncated(u64::MAX);

        // Takes out the costs of the chosen candidate and its neighbors; the least of the rest is then the one elsewhere.
        let mut valley = [[0; PIXELS]; 3];
        for pixel in 0..pixels {
            let k = usize::from(chosen[pixel]);
            for (beside, valley) in valley.iter_mut().enumerate() {
                // There is no candidate before the first one or after the last.
                let Some(k) = (k + beside).checked_sub(1).filter(|k| *k < candidates) else {
                    continue;
                };

                let (run, lane) = (pixel * runs + k / LANES, k % LANES);
                let total = &mut totals[run][lane];
                let cost = costs.map(|costs| costs[run][lane]);

                valley[pixel] = evidence(capped(*total), cost.map_or(0, capped));
                *total = most;
            }
        }

        for (least, totals) in least.iter_mut().zip(totals.chunks_exact(runs)).take(pixels) {
            let mut lanes = totals[0];
            for totals in &totals[1..] {
                for j in 0..LANES {
                    lanes[j] = lanes[j].min(totals[j]);
                }
            }

            *least = lanes;
        }

        let mut others = [T::default(); PIXELS];
        for (others, least) in others.iter_mut().zip(&*least) {
            *others = least_lane(least);
        }

        for pixel in 0..pixels {
            let k = usize::from(chosen[pixel]);
            let is_elsewhere = k >= 2 || k + 2 < candidates;
            elsewhere[pixel] = if is_elsewhere { capped(others[pixel]) } else { NONE };
        }

        // For all pixels, whether used or not: a fixed length is vectorized.
        let [below, at, above] = &valley;
        for pixel in 0..PIXELS {
            offset[pixel] = subpixel::offset(below[pixel], at[pixel], above[pixel]);
        }

        // At either end of the range there is no V: the match is taken as it is.
        for pixel in 0..pixels {
            let k = usize::from(chosen[pixel]);
            let is_inside = k > 0 && k + 1 < candidates;
            offset[pixel] = if is_inside { offset[pixel] } else { 0.0 };
        }
    }

    /// Writes the evidence of the first pixels.
    #[inline(always)]
    pub fn write(&self, pixels: usize, evidence: &mut Evidence, (row, first): (usize, usize)) {
        let mut own = [0; PIXELS];
        for (own, cost) in own.iter_mut().zip(&self.own) {
            *own = capped(*cost);
        }

        let found = EvidenceRow {
            chosen: &self.chosen[..pixels],
            own: &own[..pixels],
            elsewhere: &self.elsewhere[..pixels],
            offset: &self.offset[..pixels],
        };

        evidence.set(row, first, found);
    }
}

/// The least cost of a pixel so far in each lane, and the run that it was found in.
#[derive(Debug, Clone, Copy)]
pub struct Minimum<T> {
    least: Lanes<T>,
    run: Lanes<T>,
}

impl<T: Value> Minimum<T> {
    /// The minimum of the first run.
    #[inline(always)]
    pub fn of(first: Lanes<T>) -> Self {
        Self { least: first, run: [T::default(); LANES] }
    }

    /// Includes the costs of run `index`.
    #[inline(always)]
    pub fn see(&mut self, index: usize, costs: Lanes<T>) {
        let index = T::truncated(index as u64);
        let Self { least, run } = *self;

        for j in 0..LANES {
            let is_less = costs[j] < least[j];
            self.run[j] = if is_less { index } else { run[j] };
        }

        for j in 0..LANES {
            self.least[j] = least[j].min(costs[j]);
        }
    }

    /// The minimum of all costs of a pixel.
    #[inline(always)]
    pub fn of_all(costs: &[Lanes<T>]) -> Self {
        let mut minimum = Self::of(costs[0]);
        for (index, costs) in costs.iter().enumerate().skip(1) {
            minimum.see(index, *costs);
        }
        minimum
    }
}

/// Keeps 0 and makes anything else `least` or more. By doubling: a comparison would be compiled lane by lane.
#[inline(always)]
fn amplified<T: Value>(mut values: Lanes<T>, least: usize) -> Lanes<T> {
    // Without the cap, doubling would wrap in types that do not saturate.
    for value in &mut values {
        *value = (*value).min(T::truncated(64));
    }

    for _ in 0..least.next_power_of_two().trailing_zeros() {
        for value in &mut values {
            *value = value.plus(*value);
        }
    }

    values
}

/// A cost in 32 bits, below [`NONE`].
#[inline(always)]
fn capped<T: Value>(cost: T) -> u32 {
    cost.widened().min(u64::from(NONE - 1)) as u32
}

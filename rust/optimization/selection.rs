//! The costs of a pixel's candidates -> the best of them, and what the others come to.
//!
//! ```text
//! chosen    = the least k with cost[k] = min over k' of cost[k']
//! own       = cost[chosen]
//! elsewhere = min of cost[k] over |k - chosen| > 1
//! offset    = the tip of a V through chosen - 1, chosen, chosen + 1
//! ```
//!
//! The least cost is kept for each lane, together with the run of candidates that it was found in; which lane has it is
//! asked at the end. A few pixels go through one step after another, each step a small loop of its own: that is what
//! the compiler turns into vector instructions.

use crate::optimization::evidence::{Evidence, EvidenceRow, NONE};
use crate::refinement::subpixel::{self, evidence};
use crate::value::{LANES, Lanes, Value, least_lane};

/// Pixels that are selected for together.
pub const PIXELS: usize = 16;

/// What is found of some pixels.
#[derive(Debug)]
pub struct Selection<T> {
    /// The number of each lane: kept, since the compiler takes constants apart.
    lanes: Lanes<T>,
    /// The least cost in each lane, and the run of candidates that it was found in.
    least: [Lanes<T>; PIXELS],
    run: [Lanes<T>; PIXELS],
    own: [T; PIXELS],
    chosen: [u16; PIXELS],
    elsewhere: [u32; PIXELS],
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
    /// Most runs of candidates that can be told apart.
    pub const MOST_RUNS: u64 = T::LARGEST_TOTAL;

    /// Takes down what is least in the lanes of a pixel.
    #[inline(always)]
    pub fn take(&mut self, pixel: usize, minimum: Minimum<T>) {
        self.least[pixel] = minimum.least;
        self.run[pixel] = minimum.run;
    }

    /// Finds the least cost of each pixel with so many runs of candidates, and the first candidate that has it.
    #[inline(always)]
    pub fn settle(&mut self, runs: usize) {
        let Self { lanes, least, run, own, chosen, .. } = self;
        for (own, least) in own.iter_mut().zip(&*least) {
            *own = least_lane(least);
        }
        for ((run, least), own) in run.iter_mut().zip(&*least).zip(&*own) {
            // A lane with a larger cost counts as one of a run behind all others.
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

    /// Says which candidate was chosen for a pixel, by whatever, and what it costs.
    #[inline(always)]
    pub fn choose(&mut self, pixel: usize, chosen: u16, own: T) {
        (self.chosen[pixel], self.own[pixel]) = (chosen, own);
    }

    /// Finds what else there is to know of the candidates chosen for pixels with so many candidates and runs of these:
    /// `totals` decided, and are lost; `costs` are those of the pixels themselves, if these are something else.
    #[inline(always)]
    pub fn weigh(
        &mut self,
        totals: &mut [Lanes<T>],
        costs: Option<&[Lanes<T>]>,
        (pixels, candidates, runs): (usize, usize, usize),
    ) {
        let Self { least, chosen, elsewhere, offset, .. } = self;
        let most = T::truncated(u64::MAX);
        let mut valley = [[0; PIXELS]; 3];
        for pixel in 0..pixels {
            let k = usize::from(chosen[pixel]);
            for (beside, valley) in valley.iter_mut().enumerate() {
                // The candidate before the first one and the one after the last are none.
                let Some(k) = (k + beside).checked_sub(1).filter(|k| *k < candidates) else {
                    continue;
                };
                let place = (pixel * runs + k / LANES, k % LANES);
                let total = &mut totals[place.0][place.1];
                let cost = costs.map(|costs| costs[place.0][place.1]);
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
        let [below, at, above] = &valley;
        for pixel in 0..PIXELS {
            offset[pixel] = subpixel::offset(below[pixel], at[pixel], above[pixel]);
        }
        for pixel in 0..pixels {
            let k = usize::from(chosen[pixel]);
            let is_inside = k > 0 && k + 1 < candidates;
            offset[pixel] = if is_inside { offset[pixel] } else { 0.0 };
        }
    }

    /// Writes what was found of the first pixels.
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

/// The least of the costs of a pixel that were seen, in each lane.
#[derive(Debug, Clone, Copy)]
pub struct Minimum<T> {
    least: Lanes<T>,
    run: Lanes<T>,
}

impl<T: Value> Minimum<T> {
    /// Nothing was seen yet but the first run.
    #[inline(always)]
    pub fn of(first: Lanes<T>) -> Self {
        Self { least: first, run: [T::default(); LANES] }
    }

    /// Sees the costs of the run of an index.
    #[inline(always)]
    pub fn see(&mut self, index: usize, costs: Lanes<T>) {
        let (index, Self { least, run }) = (T::truncated(index as u64), *self);
        for j in 0..LANES {
            let is_less = costs[j] < least[j];
            self.run[j] = if is_less { index } else { run[j] };
        }
        for j in 0..LANES {
            self.least[j] = least[j].min(costs[j]);
        }
    }

    /// Sees all costs of a pixel.
    #[inline(always)]
    pub fn of_all(costs: &[Lanes<T>]) -> Self {
        let mut minimum = Self::of(costs[0]);
        for (index, costs) in costs.iter().enumerate().skip(1) {
            minimum.see(index, *costs);
        }
        minimum
    }
}

/// 0 stays 0, all else becomes as much as `least` or more: by doubling, since the compiler makes choices lane by lane.
#[inline(always)]
fn amplified<T: Value>(mut values: Lanes<T>, least: usize) -> Lanes<T> {
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

#[inline(always)]
fn capped<T: Value>(cost: T) -> u32 {
    cost.widened().min(u64::from(NONE - 1)) as u32
}

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

use crate::evidence::{Found, NONE};
use crate::subpixel::{evidence, offset};
use crate::value::{LANES, Lanes, Value, least_lane};

/// Pixels that are selected for together.
pub const PIXELS: usize = 16;

/// What is least for some pixels.
#[derive(Debug)]
pub struct Minima<S> {
    /// The number of each lane: kept, since the compiler takes constants apart.
    lanes: Lanes<S>,
    /// The least cost in each lane, and the run of candidates that it was found in.
    least: [Lanes<S>; PIXELS],
    run: [Lanes<S>; PIXELS],
    /// The least cost of each pixel, the first candidate that has it, and the least cost elsewhere.
    own: [S; PIXELS],
    chosen: [u16; PIXELS],
    elsewhere: [S; PIXELS],
}

impl<S: Value> Default for Minima<S> {
    fn default() -> Self {
        Self {
            lanes: std::array::from_fn(|j| S::truncated(j as u64)),
            least: [[S::default(); LANES]; PIXELS],
            run: [[S::default(); LANES]; PIXELS],
            own: [S::default(); PIXELS],
            chosen: [0; PIXELS],
            elsewhere: [S::default(); PIXELS],
        }
    }
}

impl<S: Value> Minima<S> {
    /// Most runs of candidates that can be told apart.
    pub const MOST_RUNS: u64 = S::LARGEST_TOTAL;

    /// Takes down what is least in the lanes of a pixel.
    #[inline(always)]
    pub fn take(&mut self, pixel: usize, minimum: Minimum<S>) {
        self.least[pixel] = minimum.least;
        self.run[pixel] = minimum.run;
    }

    /// Finds the least cost of each pixel, and the first candidate that has it.
    #[inline(always)]
    pub fn settle(&mut self) {
        let Self { lanes, least, run, own, chosen, .. } = self;
        for (own, least) in own.iter_mut().zip(&*least) {
            *own = least_lane(least);
        }
        let most = S::truncated(u64::MAX);
        for ((run, least), own) in run.iter_mut().zip(&*least).zip(&*own) {
            for j in 0..LANES {
                let is_larger = if least[j] == *own { S::default() } else { most };
                run[j] = run[j].max(is_larger);
            }
        }
        let mut first = [S::default(); PIXELS];
        for (first, run) in first.iter_mut().zip(&*run) {
            *first = least_lane(run);
        }
        for (run, first) in run.iter_mut().zip(&first) {
            for j in 0..LANES {
                let is_later = if run[j] == *first { S::default() } else { most };
                run[j] = is_later.max(lanes[j]);
            }
        }
        let mut lane = [S::default(); PIXELS];
        for (lane, run) in lane.iter_mut().zip(&*run) {
            *lane = least_lane(run);
        }
        for ((chosen, first), lane) in chosen.iter_mut().zip(&first).zip(&lane) {
            *chosen = (first.widened() * LANES as u64 + lane.widened()) as u16;
        }
    }

    /// The candidate chosen for a pixel.
    #[inline(always)]
    pub fn chosen(&self, pixel: usize) -> u16 {
        self.chosen[pixel]
    }

    /// Says which candidate was chosen for a pixel, by whatever, and what it costs.
    #[inline(always)]
    pub fn choose(&mut self, pixel: usize, chosen: u16, own: S) {
        (self.chosen[pixel], self.own[pixel]) = (chosen, own);
    }

    /// Sees the least cost, in each lane, of the candidates that are neither the chosen one nor next to it.
    #[inline(always)]
    pub fn see_others(&mut self, pixel: usize, sums: &[Lanes<S>]) {
        let most = S::truncated(u64::MAX);
        let mut least = [most; LANES];
        let mut first = 1u16.wrapping_sub(self.chosen[pixel]);
        for sums in sums {
            for j in 0..LANES {
                // All bits where the candidate is the chosen one or next to it.
                let is_near = if first.wrapping_add(j as u16) <= 2 { most } else { S::default() };
                least[j] = least[j].min(sums[j].max(is_near));
            }
            first = first.wrapping_add(LANES as u16);
        }
        self.least[pixel] = least;
    }

    /// Finds the least cost elsewhere of each pixel, after the others were seen.
    #[inline(always)]
    pub fn settle_others(&mut self) {
        for (elsewhere, least) in self.elsewhere.iter_mut().zip(&self.least) {
            *elsewhere = least_lane(least);
        }
    }

    /// What there is to know of the candidate chosen for a pixel, after all is settled: `sums` decided, of so many
    /// paths' totals; `costs` are those of the pixel itself.
    #[inline(always)]
    pub fn weigh<T: Value>(
        &self,
        pixel: usize,
        (sums, costs): (&[Lanes<S>], &[Lanes<T>]),
        (candidates, paths): (usize, u32),
    ) -> Found {
        let (own, chosen) = (capped(self.own[pixel]), self.chosen[pixel]);
        let k = usize::from(chosen);
        let is_elsewhere = k >= 2 || k + 2 < candidates;
        let elsewhere = capped(self.elsewhere[pixel]);
        let is_inside = k > 0 && k + 1 < candidates;
        let mut valley = [0; 3];
        if is_inside {
            for (value, k) in valley.iter_mut().zip(k - 1..) {
                *value = evidence(capped(sums[k / LANES][k % LANES]), capped(costs[k / LANES][k % LANES]), paths);
            }
        }
        Found {
            chosen,
            own,
            elsewhere: if is_elsewhere { elsewhere } else { NONE },
            offset: offset(valley[0], valley[1], valley[2]),
        }
    }
}

/// The least of the costs of a pixel that were seen, in each lane.
#[derive(Debug, Clone, Copy)]
pub struct Minimum<S> {
    least: Lanes<S>,
    run: Lanes<S>,
}

impl<S: Value> Minimum<S> {
    /// Nothing was seen yet but the first run.
    #[inline(always)]
    pub fn of(first: Lanes<S>) -> Self {
        Self { least: first, run: [S::default(); LANES] }
    }

    /// Sees the costs of the run of an index.
    #[inline(always)]
    pub fn see(&mut self, index: usize, costs: Lanes<S>) {
        let (index, Self { least, run }) = (S::truncated(index as u64), *self);
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
    pub fn of_all(costs: &[Lanes<S>]) -> Self {
        let mut minimum = Self::of(costs[0]);
        for (index, costs) in costs.iter().enumerate().skip(1) {
            minimum.see(index, *costs);
        }
        minimum
    }
}

#[inline(always)]
fn capped<S: Value>(cost: S) -> u32 {
    cost.widened().min(u64::from(NONE - 1)) as u32
}

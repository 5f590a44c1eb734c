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

/// The selection for up to [`PIXELS`] pixels. It lies behind a reference: of a local one the compiler would keep single lanes.
#[derive(Debug)]
pub struct Selection<T> {
    /// The number of each lane. In memory, since the compiler splits a constant into single lanes.
    lanes: Lanes<T>,
    /// The least costs of each pixel.
    minima: [Minimum<T>; PIXELS],
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
            minima: [Minimum::of([T::default(); LANES]); PIXELS],
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

    /// The least costs of each pixel, to be written.
    #[inline(always)]
    pub fn minima(&mut self) -> &mut [Minimum<T>; PIXELS] {
        &mut self.minima
    }

    /// Finds the least cost of each pixel and the first candidate that has it: the least lane in the least run with this
    /// cost. Runs and lanes that do not qualify are replaced by the largest number, so that every step is a plain minimum.
    #[inline(always)]
    pub fn settle(&mut self) {
        let Self { lanes, minima, own, chosen, .. } = self;

        for (own, minimum) in own.iter_mut().zip(&*minima) {
            *own = least_lane(&minimum.least);
        }

        for (Minimum { least, run }, own) in minima.iter_mut().zip(&*own) {
            keep_equal(run, least, *own);
        }

        let mut first = [T::default(); PIXELS];
        for (first, minimum) in first.iter_mut().zip(&*minima) {
            *first = least_lane(&minimum.run);
        }

        for (Minimum { run, .. }, first) in minima.iter_mut().zip(&first) {
            let mut lane = *lanes;
            keep_equal(&mut lane, run, *first);
            *run = lane;
        }

        let mut lane = [T::default(); PIXELS];
        for (lane, minimum) in lane.iter_mut().zip(&*minima) {
            *lane = least_lane(&minimum.run);
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

    /// Numbers the chosen candidates among all, where those that were searched begin with `start`.
    #[inline(always)]
    pub fn number_from(&mut self, start: usize) {
        for chosen in &mut self.chosen {
            *chosen += start as u16;
        }
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
        let Self { minima, chosen, elsewhere, offset, .. } = self;
        let most = T::truncated(u64::MAX);

        // Takes out the costs of the chosen candidate and its neighbors; the least of the rest is then the one elsewhere.
        let mut valley = [[0; PIXELS]; 3];
        for (pixel, totals) in totals.chunks_exact_mut(runs).take(pixels).enumerate() {
            let totals = &mut totals.as_flattened_mut()[..candidates];
            let k = usize::from(chosen[pixel]);
            // At either end of the range one of them is the chosen one itself.
            let places = [k.saturating_sub(1), k, (k + 1).min(candidates - 1)];

            for (valley, place) in valley.iter_mut().zip(places) {
                let cost = costs
                    .map_or(0, |costs| capped(costs.as_flattened()[pixel * runs * LANES + place]));
                valley[pixel] = evidence(capped(totals[place]), cost);
            }
            for place in places {
                totals[place] = most;
            }
        }

        for (minimum, totals) in minima.iter_mut().zip(totals.chunks_exact(runs)).take(pixels) {
            let mut lanes = totals[0];
            for totals in &totals[1..] {
                for j in 0..LANES {
                    lanes[j] = lanes[j].min(totals[j]);
                }
            }

            minimum.least = lanes;
        }

        let mut others = [T::default(); PIXELS];
        for (others, minimum) in others.iter_mut().zip(&*minima) {
            *others = least_lane(&minimum.least);
        }

        // From here on for all pixels, whether used or not: a fixed length is vectorized.
        let candidates = candidates as u32;
        for pixel in 0..PIXELS {
            let k = u32::from(chosen[pixel]);
            let is_elsewhere = (k >= 2) | (k + 2 < candidates);
            elsewhere[pixel] = if is_elsewhere { capped(others[pixel]) } else { NONE };
        }

        let [below, at, above] = &valley;
        for pixel in 0..PIXELS {
            offset[pixel] = subpixel::offset(below[pixel], at[pixel], above[pixel]);
        }

        // At either end of the range there is no V: the match is taken as it is.
        for pixel in 0..PIXELS {
            let k = u32::from(chosen[pixel]);
            let is_inside = (k > 0) & (k + 1 < candidates);
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

/// Replaces numbers by the largest one where the value is not the wanted one.
#[inline(always)]
fn keep_equal<T: Value>(numbers: &mut Lanes<T>, values: &Lanes<T>, wanted: T) {
    for j in 0..LANES {
        // 0, or all bits. In arithmetic, since a comparison would be compiled lane by lane.
        let unequal = T::default().minus(values[j].minus(wanted).min(T::truncated(1)));
        numbers[j] = numbers[j].max(unequal);
    }
}

/// A cost in 32 bits, below [`NONE`].
#[inline(always)]
fn capped<T: Value>(cost: T) -> u32 {
    cost.widened().min(u64::from(NONE - 1)) as u32
}

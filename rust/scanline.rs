//! A row of aggregated costs -> the index of each pixel's disparity (paper, section 2.3).

use crate::aggregation::Window;
use crate::control::Control;
use crate::error::Result;
use crate::plane::{Plane, zeroed};
use crate::settings::{Optimizer, Penalty};

/// Penalties in steps of the aggregated costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Steps {
    /// For an index one larger than the left neighbour's.
    pub rise: u64,
    /// For a smaller index than the left neighbour's.
    pub drop: u64,
}

impl Steps {
    /// The penalties of checked settings against costs summed over a window, `steps` to the unit.
    pub fn new(penalty: Penalty, window: Window, steps: u16) -> Self {
        let unit = f64::from(window.area()) * f64::from(steps);
        let rounded = |value: f64| (value * unit).round() as u64;
        Self { rise: rounded(penalty.rise), drop: rounded(penalty.drop) }
    }
}

/// Chooses a candidate for every pixel of a row; its working memory is kept from row to row.
#[derive(Debug)]
pub struct Scanline {
    candidates: usize,
    optimizer: Optimizer,
    steps: Steps,
    /// Where the best path to each (pixel, candidate) comes from.
    origins: Vec<u16>,
    /// Cost of the best path to each candidate of one pixel and of the next.
    totals: [Vec<u64>; 2],
    /// The index chosen for each pixel.
    chosen: Vec<u16>,
}

impl Scanline {
    /// For rows of `cols` pixels with so many candidates each.
    pub fn new(cols: usize, candidates: usize, optimizer: Optimizer, steps: Steps) -> Result<Self> {
        Ok(Self {
            candidates,
            optimizer,
            steps,
            origins: zeroed(cols * candidates)?,
            totals: [zeroed(candidates)?, zeroed(candidates)?],
            chosen: zeroed(cols)?,
        })
    }

    /// The index of each pixel's candidate, from a row of costs, candidate innermost.
    pub fn choose(&mut self, costs: &[u32]) -> &[u16] {
        match self.optimizer {
            Optimizer::DynamicProgramming => self.dynamic_programming(costs),
            Optimizer::WinnerTakesAll => self.winner_takes_all(costs),
        }
        &self.chosen
    }

    /// The smallest cost of each pixel by itself; of equal ones the smallest index.
    fn winner_takes_all(&mut self, costs: &[u32]) {
        for (chosen, costs) in self.chosen.iter_mut().zip(costs.chunks_exact(self.candidates)) {
            *chosen = first_least(costs);
        }
    }

    /// One pass along the row under the ordering constraint `d(x + 1) <= d(x) + 1`: an index stays, rises
    /// by one or drops to any smaller one. Of equal costs staying wins, then the smaller origin, and at
    /// the row's end the smaller index.
    fn dynamic_programming(&mut self, costs: &[u32]) {
        let [before, after] = &mut self.totals;
        let count = self.candidates;
        let pixels = costs.chunks_exact(count).zip(self.origins.chunks_exact_mut(count));
        for (x, (costs, origins)) in pixels.enumerate() {
            if x == 0 {
                before.iter_mut().zip(costs).for_each(|(total, &cost)| *total = cost.into());
            } else {
                step(before, costs, self.steps, after, origins);
                std::mem::swap(before, after);
            }
        }
        let mut index = first_least(before);
        for (chosen, origins) in self.chosen.iter_mut().zip(self.origins.chunks_exact(count)).rev()
        {
            *chosen = index;
            index = origins[usize::from(index)];
        }
    }
}

/// The chosen indices of a whole volume of aggregated costs.
pub fn optimize(
    volume: &Plane<u32>,
    candidates: usize,
    optimizer: Optimizer,
    steps: Steps,
    control: &Control,
) -> Result<Plane<u16>> {
    let mut chosen = Plane::new(volume.rows(), volume.cols() / candidates)?;
    let mut scanline = Scanline::new(chosen.cols(), candidates, optimizer, steps)?;
    for y in 0..volume.rows() {
        control.checkpoint()?;
        chosen.row_mut(y).copy_from_slice(scanline.choose(volume.row(y)));
    }
    Ok(chosen)
}

/// Extends the best paths by one pixel.
fn step(before: &[u64], costs: &[u32], steps: Steps, after: &mut [u64], origins: &mut [u16]) {
    // The least total above the index at hand, and where it is; of equal ones the lowest.
    let mut above: Option<(u64, usize)> = None;
    for index in (0..before.len()).rev() {
        let mut best = (before[index], index);
        if index > 0 && before[index - 1] + steps.rise < best.0 {
            best = (before[index - 1] + steps.rise, index - 1);
        }
        if let Some((total, origin)) = above
            && total + steps.drop < best.0
        {
            best = (total + steps.drop, origin);
        }
        (after[index], origins[index]) = (best.0 + u64::from(costs[index]), best.1 as u16);
        if above.is_none_or(|(total, _)| before[index] <= total) {
            above = Some((before[index], index));
        }
    }
}

/// The first index of the least value.
fn first_least<T: Ord>(values: &[T]) -> u16 {
    // `min_by_key` returns the first of equal elements.
    values.iter().enumerate().min_by_key(|(_, value)| *value).map_or(0, |(index, _)| index as u16)
}

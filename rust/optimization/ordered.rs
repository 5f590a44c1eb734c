//! Dynamic programming along a row under the ordering constraint (paper, section 2.3).
//!
//! From a pixel to the next the disparity stays, rises by one, for P1, or drops to any smaller one, for P2: the right
//! coordinate `x - d` must not run backwards.
//!
//! ```text
//! D(x, k) = C(x, k) + min(D(x-1, k),                      # it stayed
//!                         D(x-1, k-1) + P1,               # it rose
//!                         min over i > k of D(x-1, i) + P2)    # it dropped
//! ```
//!
//! Where each total came from is written down, and the way back from the least one at the last pixel is followed. Of
//! equal totals staying wins, then the smaller origin. The minimum over `i > k` goes from one candidate to the next, so
//! this is one candidate after another, in integers that hold any sum.

use crate::error::Result;
use crate::optimization::Penalties;
use crate::pipeline::memory::Memory;
use crate::value::{LANES, Lanes, Value};

/// Chooses candidates along one row after another; its memory is used again.
#[derive(Debug, Default)]
pub struct Ordered {
    /// The total of each candidate.
    totals: Memory<u64>,
    /// Where the totals of each pixel came from, all candidates of one pixel after another.
    origins: Memory<u16>,
    /// The candidate chosen for each pixel.
    chosen: Memory<u16>,
}

impl Ordered {
    /// The candidates chosen for the pixels of a row of these costs, all of one pixel after another.
    pub fn choose<V: Value>(
        &mut self,
        costs: &[Lanes<V>],
        candidates: usize,
        penalties: Penalties,
    ) -> Result<&[u16]> {
        let runs = candidates.div_ceil(LANES);
        let cols = costs.len() / runs;
        self.totals.resize(candidates)?;
        self.totals.fill(0);
        self.origins.resize(cols * candidates)?;
        self.chosen.resize(cols)?;

        let pixels = costs.chunks_exact(runs).zip(self.origins.chunks_exact_mut(candidates));
        for (costs, origins) in pixels {
            extend(&mut self.totals, &costs.as_flattened()[..candidates], origins, penalties);
        }

        let mut index = first_least(&self.totals);
        let origins = self.origins.chunks_exact(candidates);
        for (chosen, origins) in self.chosen.iter_mut().zip(origins).rev() {
            *chosen = index;
            index = origins[usize::from(index)];
        }
        Ok(&self.chosen)
    }
}

/// Extends the best ways by a pixel, from the largest candidate down.
fn extend<V: Value>(totals: &mut [u64], costs: &[V], origins: &mut [u16], penalties: Penalties) {
    let (mut least, mut of_least) = (u64::MAX - penalties.p2, 0);
    for k in (0..totals.len()).rev() {
        let stayed = totals[k];
        let rose = if k > 0 { totals[k - 1] + penalties.p1 } else { u64::MAX };
        let dropped = least + penalties.p2;
        let best = stayed.min(rose).min(dropped);

        origins[k] = if best == stayed {
            k as u16
        } else if best == rose {
            k as u16 - 1
        } else {
            of_least
        };
        if stayed <= least {
            (least, of_least) = (stayed, k as u16);
        }
        totals[k] = best + costs[k].widened();
    }
}

fn first_least(totals: &[u64]) -> u16 {
    let mut best = 0;
    for (k, total) in totals.iter().enumerate() {
        if *total < totals[best] {
            best = k;
        }
    }
    best as u16
}

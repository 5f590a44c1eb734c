//! Dynamic programming along a row under the ordering constraint (paper, section 2.3).
//!
//! From a pixel to the next the disparity stays, rises by one at a penalty of P1, or drops to any smaller one at a penalty
//! of P2: the right coordinate `x - d` must not run backwards.
//!
//! ```text
//! D(x, k) = C(x, k) + min(D(x-1, k),                      # it stayed
//!                         D(x-1, k-1) + P1,               # it rose
//!                         min over i > k of D(x-1, i) + P2)    # it dropped
//! ```
//!
//! A back-pointer is kept for each total, and the path is traced back from the least total at the last pixel. Among equal
//! totals staying wins, then the smaller origin. The minimum over `i > k` runs from the largest candidate down, so the
//! loop is sequential; its integers hold any sum.

use crate::error::Result;
use crate::optimization::penalties::Penalties;
use crate::pipeline::memory::Memory;
use crate::value::{LANES, Lanes, Value};

/// Chooses candidates row by row; its buffers are reused.
#[derive(Debug, Default)]
pub struct Ordered {
    /// The total of each candidate.
    totals: Memory<u64>,
    /// Back-pointers: the candidate that each total came from, all candidates of one pixel after another.
    origins: Memory<u16>,
    /// The candidate chosen for each pixel.
    chosen: Memory<u16>,
}

impl Ordered {
    /// The candidates chosen for the pixels of a row, from aggregated costs: all candidates of one pixel after another.
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

        // Forward: totals and back-pointers.
        let pixels = costs.chunks_exact(runs).zip(self.origins.chunks_exact_mut(candidates));
        for (costs, origins) in pixels {
            extend(&mut self.totals, &costs.as_flattened()[..candidates], origins, penalties);
        }

        // Backward: the chosen path.
        let mut index = first_least(&self.totals);
        let origins = self.origins.chunks_exact(candidates);
        for (chosen, origins) in self.chosen.iter_mut().zip(origins).rev() {
            *chosen = index;
            index = origins[usize::from(index)];
        }

        Ok(&self.chosen)
    }
}

/// Extends the best paths by a pixel, from the largest candidate down.
fn extend<V: Value>(totals: &mut [u64], costs: &[V], origins: &mut [u16], penalties: Penalties) {
    // `least` is the least total of all candidates larger than `k`: none yet, but P2 can be added without overflow.
    let mut least = u64::MAX - penalties.p2;
    let mut of_least = 0;

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

        // A total that ties with a larger candidate's takes its place: the smaller origin wins.
        if stayed <= least {
            (least, of_least) = (stayed, k as u16);
        }

        totals[k] = best + costs[k].widened();
    }
}

/// The first of the least totals.
fn first_least(totals: &[u64]) -> u16 {
    let mut best = 0;
    for (k, total) in totals.iter().enumerate() {
        if *total < totals[best] {
            best = k;
        }
    }

    best as u16
}

//! Dynamic programming along rows under the ordering constraint (paper, section 2.3).
//!
//! From one pixel to the next, the disparity stays, rises by one at a penalty of P1, or drops to any smaller
//! one at a penalty of P2: the right coordinate `x - d` must not decrease.
//!
//! ```text
//! D(x, k) = C(x, k) + min(D(x-1, k),                      # it stayed
//!                         D(x-1, k-1) + P1,               # it rose
//!                         min over i > k of D(x-1, i) + P2)    # it dropped
//! ```
//!
//! The path is traced back from the smallest total at the last pixel. Among equal totals, staying wins, then
//! the smaller origin.
//!
//! The minimum over `i > k` runs from the largest candidate down, so nothing can be vectorized within a row.
//! But rows do not depend on each other: [`ROWS`] of them are neighboring lanes. Costs have neighboring
//! candidates, so they are transposed, one run of candidates of all rows at a time.
//!
//! One byte is kept per total: whether it stayed, rose or dropped, and whether its predecessor `D(x-1, k)` is
//! at most those of all larger candidates. A drop to `k` came from the first such candidate above `k`.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::base::simd::{Level, leveled};
use crate::base::value::{LANES, Lanes, Value};
use crate::cost::aggregation::PixelBlock;
use crate::optimization::penalties::{LARGEST_SUMMED_PENALTY, Penalties};

/// Rows whose paths are found together: a power of two.
pub const ROWS: usize = 16;

/// Origins of a total: a rise, a drop, or otherwise the same candidate.
const ROSE: u8 = 1;
const DROPPED: u8 = 2;
/// Set in addition if the previous total is at most those of all larger candidates.
const LEAST: u8 = 4;

/// Chooses candidates for a few rows at a time; its buffers are reused.
#[derive(Debug, Default)]
pub struct Ordered {
    /// The totals of each candidate, of all rows, after a place that nothing rises from; in the narrowest
    /// integers that hold them.
    narrow: Memory<u32>,
    wide: Memory<u64>,
    /// The origin of each total: candidate by candidate of one pixel after another, of all rows.
    origins: Memory<u8>,
    /// The candidate chosen for each pixel, row by row.
    chosen: Memory<u16>,
}

impl Ordered {
    /// Chooses candidates for the pixels of up to [`ROWS`] whole rows from their aggregated costs, row after
    /// row.
    pub fn choose<V: Value>(
        &mut self,
        (block, costs): (&PixelBlock, &[Lanes<V>]),
        candidates: usize,
        penalties: Penalties,
        (level, control): (Level, &Control),
    ) -> Result<&[u16]> {
        let cols = block.columns.len();
        self.origins.resize(cols * candidates * ROWS)?;
        self.chosen.resize(block.rows.len() * cols)?;

        let Self { narrow, wide, origins, chosen } = self;
        let pass = Pass { block, costs, candidates, penalties };
        // A path that stays costs at most all of its pixels, so no smallest total exceeds that, and no other
        // total exceeds it by more than a penalty.
        let largest =
            (V::LARGEST_TOTAL.saturating_mul(cols as u64 + 1)).saturating_add(2 * LARGEST_SUMMED_PENALTY);
        let last = if largest <= u32::MAX.into() {
            pass.forward(narrow, origins, level, control)?
        } else {
            pass.forward(wide, origins, level, control)?
        };

        pass.trace_back(last, origins.as_chunks().0, chosen);
        Ok(&self.chosen)
    }
}

/// An integer that holds the total of any path.
trait Total: Copy + Default + Ord + Send + Sync {
    /// The largest one.
    const MOST: Self;

    fn of(value: u64) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
}

macro_rules! impl_total {
    ($type:ty) => {
        impl Total for $type {
            const MOST: Self = Self::MAX;

            #[inline(always)]
            fn of(value: u64) -> Self {
                value as Self
            }

            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }

            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
        }
    };
}

impl_total!(u32);
impl_total!(u64);

/// The costs of a block, in which paths are found.
#[derive(Clone, Copy)]
struct Pass<'a, V> {
    block: &'a PixelBlock,
    costs: &'a [Lanes<V>],
    candidates: usize,
    penalties: Penalties,
}

impl<V: Value> Pass<'_, V> {
    /// Finds the totals at the last pixel of all rows, and the origin of every total; returns the first
    /// smallest candidates.
    fn forward<W: Total>(
        self,
        totals: &mut Memory<W>,
        origins: &mut [u8],
        level: Level,
        control: &Control,
    ) -> Result<[u16; ROWS]> {
        totals.resize((self.candidates + 1) * ROWS)?;
        totals.fill(W::default());
        let totals: &mut [[W; ROWS]] = totals.as_chunks_mut().0;
        let penalties = [self.penalties.p1, self.penalties.p2].map(W::of);
        totals[0] = [W::MOST.minus(penalties[0]); ROWS];

        let mut origins = origins.as_chunks_mut().0;
        for (strip, columns) in self.block.strips().enumerate() {
            control.checkpoint()?;
            let (here, rest) = origins.split_at_mut(columns.len() * self.candidates);
            origins = rest;
            extend(level, self, strip, penalties, totals, here);
        }

        let mut first = [0; ROWS];
        let mut least = totals[1];
        for (k, totals) in (0..).zip(&totals[1..]) {
            for row in 0..ROWS {
                if totals[row] < least[row] {
                    (first[row], least[row]) = (k, totals[row]);
                }
            }
        }
        Ok(first)
    }

    /// Follows the paths back from the candidates of the last pixel.
    fn trace_back(self, last: [u16; ROWS], origins: &[[u8; ROWS]], chosen: &mut [u16]) {
        let cols = self.block.columns.len();
        let mut current = last;

        for (x, origins) in origins.chunks_exact(self.candidates).enumerate().rev() {
            for (row, k) in current.iter_mut().enumerate().take(self.block.rows.len()) {
                chosen[row * cols + x] = *k;
                let here = usize::from(*k);
                match origins[here][row] & (ROSE | DROPPED) {
                    0 => {}
                    ROSE => *k -= 1,
                    _ => {
                        let above = origins[here + 1..].iter();
                        *k += 1 + above.take_while(|of| of[row] & LEAST == 0).count() as u16;
                    }
                }
            }
        }
    }
}

/// Extends the best paths of all rows through the columns of a strip. `penalties`: P1 and P2. `origins`:
/// receives the origins of the strip's totals.
#[leveled]
fn extend<V: Value, W: Total>(
    level: Level,
    pass: Pass<'_, V>,
    strip: usize,
    penalties: [W; 2],
    totals: &mut [[W; ROWS]],
    origins: &mut [[u8; ROWS]],
) {
    let [p1, p2] = penalties;
    let Pass { block, costs, candidates, .. } = pass;
    let runs = candidates.div_ceil(LANES);
    let width = block.stride() * runs;
    let costs = &costs[block.place(strip, 0) * runs..][..block.rows.len() * width];

    let [mut rows, mut spare] = [[[V::default(); LANES]; ROWS]; 2];

    for (x, origins) in origins.chunks_exact_mut(candidates).enumerate() {
        // No candidate yet, but P2 can be added without overflow.
        let mut least = [W::MOST.minus(p2); ROWS];

        for run in (0..runs).rev() {
            for (row, costs) in rows.iter_mut().zip(costs.chunks_exact(width)) {
                *row = costs[x * runs + run];
            }
            transpose(&mut rows, &mut spare);
            let costs: &[[V; ROWS]] = rows.as_flattened().as_chunks().0;

            let first = run * LANES;
            let origins = &mut origins[first..(first + LANES).min(candidates)];
            let totals = &mut totals[first..][..=origins.len()];
            for k in (0..origins.len()).rev() {
                let (stayed, smaller) = (totals[k + 1], totals[k]);
                let (best, origin) = step(stayed, smaller, least, [p1, p2]);
                totals[k + 1] = with_costs(best, costs[k]);
                origins[k] = origin;
                least = lesser(least, stayed);
            }
        }
    }
}

/// The best totals of all rows before a pixel's costs are added, and their origins.
#[inline(always)]
fn step<W: Total>(
    stayed: [W; ROWS],
    smaller: [W; ROWS],
    least: [W; ROWS],
    [p1, p2]: [W; 2],
) -> ([W; ROWS], [u8; ROWS]) {
    let mut best = [W::default(); ROWS];
    let mut origins = [0; ROWS];

    for row in 0..ROWS {
        let rose = smaller[row].plus(p1).min(stayed[row]);
        best[row] = rose.min(least[row].plus(p2));
        let changes = (u8::from(rose < stayed[row]) * ROSE) | (u8::from(best[row] < rose) * DROPPED);
        origins[row] = changes | (u8::from(stayed[row] <= least[row]) * LEAST);
    }

    (best, origins)
}

#[inline(always)]
fn with_costs<V: Value, W: Total>(mut totals: [W; ROWS], costs: [V; ROWS]) -> [W; ROWS] {
    for row in 0..ROWS {
        totals[row] = totals[row].plus(W::of(costs[row].widened()));
    }
    totals
}

#[inline(always)]
fn lesser<W: Total>(mut values: [W; ROWS], others: [W; ROWS]) -> [W; ROWS] {
    for row in 0..ROWS {
        values[row] = values[row].min(others[row]);
    }
    values
}

/// Runs of candidates of all rows -> all rows of each candidate, in the same place.
///
/// A place has a 9-bit number, the bits of the row before those of the candidate. Interleaving both halves of
/// all places moves the highest bit behind the others; doing so once per bit of a row moves the row's bits
/// behind those of the candidate.
#[inline(always)]
fn transpose<V: Value>(rows: &mut [Lanes<V>; ROWS], spare: &mut [Lanes<V>; ROWS]) {
    for _ in 0..ROWS.ilog2() / 2 {
        interleave_halves(rows, spare);
        interleave_halves(spare, rows);
    }
}

#[inline(always)]
fn interleave_halves<V: Value>(rows: &[Lanes<V>; ROWS], out: &mut [Lanes<V>; ROWS]) {
    let (first, second) = rows.split_at(ROWS / 2);
    for (out, (first, second)) in out.chunks_exact_mut(2).zip(first.iter().zip(second)) {
        interleave(first, second, out.as_flattened_mut());
    }
}

#[inline(always)]
fn interleave<V: Value>(first: &Lanes<V>, second: &Lanes<V>, out: &mut [V]) {
    for (out, (first, second)) in out.chunks_exact_mut(2).zip(first.iter().zip(second)) {
        (out[0], out[1]) = (*first, *second);
    }
}

//! Paths along the rows: from the left and from the right end, every row of a band in a lane of its own.

use crate::aggregation::{Aggregated, Tile, stride};
use crate::edges::{Edges, Neighbour};
use crate::error::Result;
use crate::memory::Memory;
use crate::scanline::Steps;
use crate::semiglobal::Far;
use crate::semiglobal::volume::Volume;
use crate::simd::{Kernel, Level};
use crate::strip::{BLOCK, Strip};
use crate::value::Value;

/// A band of rows as the other paths need it.
#[derive(Debug)]
pub struct Rows<V, T> {
    /// What each candidate costs.
    pub costs: Volume<V>,
    /// The mean total of the two paths along the row.
    pub totals: Volume<T>,
}

impl<V, T> Default for Rows<V, T> {
    fn default() -> Self {
        Self { costs: Volume::default(), totals: Volume::default() }
    }
}

/// Paths along the rows of one band after another; its memory is used again.
#[derive(Debug)]
pub struct Across<V, T> {
    candidates: usize,
    cols: usize,
    near: T,
    far: Far<T>,
    /// Jumps of the gray values: of one column after another, lane by lane.
    edges: Memory<u8>,
    /// The least total of the column before.
    least: [T; BLOCK],
    /// Totals of the paths from the right, of two columns.
    back: [Memory<T>; 2],
    /// A group of columns that is turned.
    spare: (Memory<V>, Memory<T>),
}

impl<V, T: Value> Default for Across<V, T> {
    fn default() -> Self {
        Self {
            candidates: 0,
            cols: 0,
            near: T::default(),
            far: Far::default(),
            edges: Memory::default(),
            least: [T::default(); BLOCK],
            back: Default::default(),
            spare: Default::default(),
        }
    }
}

impl<V: Value, T: Value> Across<V, T> {
    /// Begins a band, of which `rows` are to be found.
    pub fn begin(
        &mut self,
        rows: &mut Rows<V, T>,
        strip: Strip,
        (cols, candidates): (usize, usize),
        steps: Steps,
        edges: Option<&Edges>,
    ) -> Result<()> {
        (self.cols, self.candidates) = (cols, candidates);
        (self.near, self.far) = (T::truncated(steps.near), Far::new(steps));
        if let Some(edges) = edges {
            let columns: Vec<_> = (0..cols).collect();
            let strip = Strip { margin: 0, ..strip };
            strip.transpose(&columns, |y| edges.row(y), |edges| edges, &mut self.edges)?;
        } else {
            self.edges.room(cols * BLOCK)?;
            self.edges.fill(0);
        }
        rows.costs.begin(cols, candidates)?;
        rows.totals.begin(cols, candidates)?;
        self.least = [T::default(); BLOCK];
        self.back.iter_mut().try_for_each(|column| column.room(candidates * BLOCK))
    }

    /// Finishes the rows of the band, when every column is done.
    pub fn finish(&mut self, rows: &mut Rows<V, T>, level: Level) -> Result<()> {
        level.run(Return { across: self, rows });
        rows.costs.turn(&mut self.spare.0, level)?;
        rows.totals.turn(&mut self.spare.1, level)
    }

    #[inline(always)]
    fn advance(&mut self, rows: &mut Rows<V, T>, tile: &Tile, aggregated: Aggregated<V>) {
        let (count, stride) = (self.candidates, stride(self.candidates));
        let (costs, totals) = (rows.costs.columns_mut(), rows.totals.columns_mut());
        let edges = self.edges.as_chunks::<BLOCK>().0;
        for (place, x) in tile.finished.clone().enumerate() {
            let kept = &mut costs[x * stride..][..count];
            let costs = aggregated.of(place, 0).every();
            let (before, here) = totals.split_at_mut(x * stride);
            let before = &before[x.saturating_sub(1) * stride..];
            let far = self.far.after_all(jumps(edges[x]));
            let here = &mut here[..count];
            self.least = step(before, self.least, costs, far, self.near, here, kept);
        }
    }

    #[inline(always)]
    fn come_back(&mut self, rows: &mut Rows<V, T>) {
        let (count, stride) = (self.candidates, stride(self.candidates));
        let edges = self.edges.as_chunks::<BLOCK>().0;
        let (costs, totals) = (rows.costs.columns_mut(), rows.totals.columns_mut());
        let [before, here] = &mut self.back;
        let (mut before, mut here) = (before.as_chunks_mut().0, here.as_chunks_mut().0);
        let mut least = [T::default(); BLOCK];
        for x in (0..self.cols).rev() {
            let is_first = x + 1 == self.cols;
            let far = if is_first {
                [T::default(); BLOCK]
            } else {
                self.far.after_all(jumps(edges[x + 1]))
            };
            let before_it = if is_first { &[] } else { &*before };
            let costs = &costs[x * stride..][..count];
            least = step(before_it, least, costs, far, self.near, here, &mut []);
            for (total, back) in totals[x * stride..][..count].iter_mut().zip(&*here) {
                *total = mean(*total, *back);
            }
            std::mem::swap(&mut before, &mut here);
        }
    }
}

/// Extends paths by one pixel: the totals of all candidates there, and the least of them. No path comes from where
/// nothing is `before`; costs are `kept` where there is room.
#[inline(always)]
fn step<V: Value, T: Value>(
    before: &[[T; BLOCK]],
    least: [T; BLOCK],
    costs: &[[V; BLOCK]],
    far: [T; BLOCK],
    near: T,
    totals: &mut [[T; BLOCK]],
    kept: &mut [[V; BLOCK]],
) -> [T; BLOCK] {
    let count = costs.len();
    let mut least_here = [T::FAR; BLOCK];
    let (costs, totals) = (&costs[..count], &mut totals[..count]);
    if before.is_empty() {
        kept.iter_mut().zip(costs).for_each(|(kept, cost)| *kept = *cost);
        for (total, cost) in totals.iter_mut().zip(costs) {
            let mut first = [T::default(); BLOCK];
            for j in 0..BLOCK {
                first[j] = T::truncated(cost[j].widened());
                least_here[j] = least_here[j].min(first[j]);
            }
            *total = first;
        }
        return least_here;
    }
    let before = &before[..count];
    let (mut below, mut here) = ([T::FAR; BLOCK], relative(before[0], least));
    for k in 0..count {
        let above = if k + 1 < count { relative(before[k + 1], least) } else { [T::FAR; BLOCK] };
        let (cost, mut total) = (costs[k], [T::default(); BLOCK]);
        for j in 0..BLOCK {
            let changed = below[j].min(above[j]).plus_penalty(near);
            let best = here[j].min(far[j]).min(changed);
            total[j] = best.plus(T::truncated(cost[j].widened()));
            least_here[j] = least_here[j].min(total[j]);
        }
        totals[k] = total;
        if let Some(kept) = kept.get_mut(k) {
            *kept = cost;
        }
        (below, here) = (here, above);
    }
    least_here
}

#[inline(always)]
fn mean<T: Value>(mut totals: [T; BLOCK], others: [T; BLOCK]) -> [T; BLOCK] {
    for j in 0..BLOCK {
        totals[j] = totals[j].mean(others[j]);
    }
    totals
}

#[inline(always)]
fn relative<T: Value>(mut totals: [T; BLOCK], least: [T; BLOCK]) -> [T; BLOCK] {
    for j in 0..BLOCK {
        totals[j] = totals[j].minus(least[j]);
    }
    totals
}

/// The jumps from the left neighbours.
#[inline(always)]
fn jumps(mut edges: [u8; BLOCK]) -> [u8; BLOCK] {
    for edges in &mut edges {
        *edges = Neighbour::Left.jump(*edges);
    }
    edges
}

/// The columns of a tile, reached from the left.
pub struct Advance<'a, V, T> {
    /// Where paths are kept.
    pub across: &'a mut Across<V, T>,
    /// What is found of the band.
    pub rows: &'a mut Rows<V, T>,
    /// The columns.
    pub tile: &'a Tile,
    /// What they cost.
    pub costs: Aggregated<'a, V>,
}

impl<V: Value, T: Value> Kernel for Advance<'_, V, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.across.advance(self.rows, self.tile, self.costs);
    }
}

/// All columns, reached from the right.
struct Return<'a, V, T> {
    across: &'a mut Across<V, T>,
    rows: &'a mut Rows<V, T>,
}

impl<V: Value, T: Value> Kernel for Return<'_, V, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.across.come_back(self.rows);
    }
}

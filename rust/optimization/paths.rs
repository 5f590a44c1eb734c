//! One step of a path, and the passes of paths through a block of pixels (Hirschmüller, PAMI 2008, equation 13).
//!
//! A path goes from pixel to pixel `p-1`, `p`, ...; the total of candidate `k` at pixel `p` is
//!
//! ```text
//! L(p, k) = C(p, k) + min(L(p-1, k),
//!                         L(p-1, k-1) + P1, L(p-1, k+1) + P1,
//!                         min over i of L(p-1, i) + P2) - min over i of L(p-1, i)
//! ```
//!
//! so no total exceeds the largest cost plus P2, and most fit a byte. All candidates of a pixel are neighboring lanes:
//! those at `k-1` and `k+1` are unaligned loads of what the step before has stored, between two runs out of reach. What
//! a step waits for is the minimum of the one before; so several paths are extended in turn, four rows of the
//! horizontal passes and sixteen columns of the vertical ones.

use std::mem::swap;
use std::ops::Range;

use crate::cost::aggregation::PixelBlock;
use crate::error::Result;
use crate::optimization::Penalties;
use crate::optimization::edges::{Edges, Neighbor};
use crate::optimization::evidence::Evidence;
use crate::optimization::selection::{Minimum, PIXELS, Selection};
use crate::pipeline::memory::Memory;
use crate::simd::Loop;
use crate::value::{LANES, Lanes, Value, least_lane};

/// Rows whose horizontal paths are extended in turn.
const ROWS: usize = 4;

/// P1, and P2 by the jump of the gray values: the whole penalty, half, and a third of it, but not less than P1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AdaptivePenalties<T> {
    p1: T,
    p2: [T; 4],
}

impl<T: Value> AdaptivePenalties<T> {
    /// The penalties in an integer that holds them.
    pub fn new(penalties: Penalties) -> Self {
        let p2 = [1, 2, 3, 3].map(|part| T::truncated((penalties.p2 / part).max(penalties.p1)));
        Self { p1: T::truncated(penalties.p1), p2 }
    }
}

/// What paths go through: the penalties, and where P2 is lower.
#[derive(Debug, Clone, Copy)]
pub struct Smoothness<'a, T> {
    /// P1 and P2.
    pub penalties: AdaptivePenalties<T>,
    /// Jumps of the gray values.
    pub edges: &'a Edges,
}

impl<T: Value> Smoothness<'_, T> {
    /// P1, and P2 after a jump of the gray values.
    #[inline(always)]
    fn after(&self, jump: usize) -> [T; 2] {
        [self.penalties.p1, self.penalties.p2[jump]]
    }
}

/// Totals of up to [`PIXELS`] paths, each where it has come to.
#[derive(Debug, Default)]
struct Paths<T> {
    /// Of one path after another: a run of candidates out of reach, the totals, a run out of reach.
    before: Memory<T>,
    here: Memory<T>,
    /// The least total of each path in each lane at the pixel that it is extended by, and of all lanes at the one before.
    minima: [Lanes<T>; PIXELS],
    least: [T; PIXELS],
}

/// Values of one path: its totals and a run on either side.
#[inline(always)]
const fn span(runs: usize) -> usize {
    (runs + 2) * LANES
}

impl<T: Value> Paths<T> {
    /// Begins paths of pixels with so many runs of candidates: with nothing behind them.
    fn begin(&mut self, runs: usize) -> Result<()> {
        for totals in [&mut self.before, &mut self.here] {
            totals.resize(PIXELS * span(runs))?;
            totals.fill(T::FAR);
        }
        self.restart(runs);
        Ok(())
    }

    /// Begins all paths again.
    #[inline(always)]
    fn restart(&mut self, runs: usize) {
        self.least = [T::default(); PIXELS];
        for totals in self.before.chunks_exact_mut(span(runs)) {
            totals[LANES..][..runs * LANES].fill(T::default());
        }
    }

    /// Where the paths have come to and where they are extended to.
    #[inline(always)]
    fn step(&mut self) -> PathStep<'_, T> {
        let Self { before, here, minima, least } = self;
        PathStep { before, here, minima, least }
    }

    /// The first paths have come to the pixel that they were extended by.
    #[inline(always)]
    fn arrive(&mut self, paths: usize) {
        swap(&mut self.before, &mut self.here);
        for (least, minimum) in self.least.iter_mut().zip(&self.minima).take(paths) {
            *least = least_lane(minimum);
        }
    }
}

/// The step of [`Paths`].
struct PathStep<'a, T> {
    before: &'a [T],
    here: &'a mut [T],
    minima: &'a mut [Lanes<T>; PIXELS],
    least: &'a [T; PIXELS],
}

impl<T: Value> PathStep<'_, T> {
    /// Extends a path by a pixel of these costs; to be done with each, then [`Paths::arrive`].
    #[inline(always)]
    fn extend(
        &mut self,
        path: usize,
        [p1, p2]: [T; 2],
        costs: &[Lanes<T>],
        runs: usize,
        sink: &mut impl Sink<T>,
    ) {
        let places = path * span(runs)..(path + 1) * span(runs);
        let before = &self.before[places.clone()];
        let smaller = &before[LANES - 1..].as_chunks::<LANES>().0[..runs];
        let same = &before[LANES..].as_chunks::<LANES>().0[..runs];
        let larger = &before[LANES + 1..].as_chunks::<LANES>().0[..runs];
        let here = &mut self.here[places].as_chunks_mut::<LANES>().0[1..][..runs];
        let costs = &costs[..runs];

        let least = self.least[path];
        let from_least = least.plus(p2);
        let mut minimum = [T::FAR; LANES];
        for run in 0..runs {
            let mut totals = [T::default(); LANES];
            for j in 0..LANES {
                let changed = smaller[run][j].min(larger[run][j]).plus(p1);
                let best = same[run][j].min(from_least).min(changed);
                totals[j] = best.minus(least).plus(costs[run][j]);
                minimum[j] = minimum[j].min(totals[j]);
            }
            here[run] = totals;
            sink.take(run, totals);
        }
        self.minima[path] = minimum;
    }
}

/// What takes the totals of a pixel, one run of candidates after another.
trait Sink<T> {
    fn take(&mut self, run: usize, totals: Lanes<T>);
}

/// Nobody wants them.
struct Discard;

impl<T> Sink<T> for Discard {
    #[inline(always)]
    fn take(&mut self, _: usize, _: Lanes<T>) {}
}

/// Writes them.
struct StoreTotals<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for StoreTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        self.0[run] = totals;
    }
}

/// Writes the mean of them and of those that are there, rounded up.
struct AverageTotals<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for AverageTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        for (mean, total) in self.0[run].iter_mut().zip(totals) {
            *mean = mean.mean(total);
        }
    }
}

/// The paths along the rows of a band, panel by panel from the left.
#[derive(Debug, Default)]
pub struct Horizontal<T> {
    paths: Paths<T>,
    /// Totals of the paths from the left at the last column of the panel before, row by row, and the least of them.
    left: Memory<T>,
    least: Memory<T>,
    /// Half the sum of the totals of both paths, of the panel.
    means: Memory<Lanes<T>>,
}

impl<T: Value> Horizontal<T> {
    /// Begins a band of so many rows.
    pub fn begin(&mut self, rows: usize, panel: usize, runs: usize) -> Result<()> {
        self.left.resize(rows * runs * LANES)?;
        self.left.fill(T::default());
        self.least.resize(rows)?;
        self.least.fill(T::default());
        self.means.resize(rows * panel * runs)?;
        self.paths.begin(runs)
    }

    /// The means of the totals of both paths, row by row; they may be written over.
    pub fn means(&mut self) -> &mut [Lanes<T>] {
        &mut self.means
    }
}

/// A panel of columns of a band.
#[derive(Debug, Clone)]
pub struct Panel<'a, T> {
    /// The pixels of the band that are in it.
    pub block: PixelBlock,
    /// The rows whose costs are at hand, those of the band among them.
    pub seen: Range<usize>,
    /// The costs of all these rows.
    pub costs: &'a [Lanes<T>],
    /// The costs of the columns right of the panel, as many rows; and how many columns of each row they are.
    pub beyond: (&'a [Lanes<T>], usize),
    /// Runs of candidates of a pixel.
    pub runs: usize,
}

/// The values of one row of a block: so many, row after row.
#[inline(always)]
fn row_of<V>(values: &[V], row: usize, width: usize) -> &[V] {
    &values[row * width..(row + 1) * width]
}

#[inline(always)]
fn row_of_mut<V>(values: &mut [V], row: usize, width: usize) -> &mut [V] {
    &mut values[row * width..(row + 1) * width]
}

/// The costs of some columns of a row of a panel.
#[inline(always)]
fn costs_of<'a, T>(
    panel: &Panel<'a, T>,
    y: usize,
    columns: &Range<usize>,
    runs: usize,
) -> &'a [Lanes<T>] {
    let PixelBlock { columns: all, .. } = &panel.block;
    let costs = row_of(panel.costs, y - panel.seen.start, all.len() * runs);
    &costs[(columns.start - all.start) * runs..][..columns.len() * runs]
}

/// The paths along the rows through a panel: those from the right begin so many columns beyond it, those from the left
/// go on.
#[derive(Debug)]
pub struct HorizontalPass<'a, T> {
    /// Where paths are kept.
    pub horizontal: &'a mut Horizontal<T>,
    /// The panel.
    pub panel: &'a Panel<'a, T>,
    /// What paths go through.
    pub smoothness: Smoothness<'a, T>,
    /// The columns from where paths from the right come.
    pub start: usize,
}

impl<T: Value> Loop for HorizontalPass<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        // Where their number is known, runs are no loop.
        match self.panel.runs {
            1 => self.through(1),
            2 => self.through(2),
            3 => self.through(3),
            runs => self.through(runs),
        }
    }
}

impl<T: Value> HorizontalPass<'_, T> {
    #[inline(always)]
    fn through(&mut self, runs: usize) {
        let rows = self.panel.block.rows.clone();
        for first in rows.clone().step_by(ROWS) {
            let group = first..(first + ROWS).min(rows.end);
            self.leftward(group.clone(), runs);
            self.rightward(group, runs);
        }
    }

    /// Paths from the right, which go left, along a few rows.
    #[inline(always)]
    fn leftward(&mut self, rows: Range<usize>, runs: usize) {
        let Self { horizontal: Horizontal { paths, means, .. }, panel, smoothness, start } = self;
        let (PixelBlock { rows: all, columns }, (beyond, width_beyond)) =
            (&panel.block, panel.beyond);
        let width = columns.len() * runs;
        let mut near = PathRows::of(panel.costs, rows.clone(), panel.seen.start, width);
        let far = PathRows::of(beyond, rows.clone(), panel.seen.start, width_beyond * runs);
        for (edges, y) in near.edges.iter_mut().zip(rows.clone()) {
            // From the column on that a path comes to a pixel from: `edges[x + 1]` is between `x` and `x + 1`.
            *edges = &smoothness.edges.row(y)[columns.start + 1..*start];
        }
        let mut means = rows_mut(means, rows.start - all.start, width);
        // Before its first pixel all totals of a path are 0, whatever the penalties.
        let jump = |edges: &[u8], x: usize| {
            edges.get(x - columns.start).map_or(0, |edges| Neighbor::Left.jump(*edges))
        };

        paths.restart(runs);
        for x in (columns.end..*start).rev() {
            let place = (x - columns.end) * runs;
            let mut step = paths.step();
            for path in 0..rows.len() {
                let penalties = smoothness.after(jump(near.edges[path], x));
                let costs = &far.costs[path][place..place + runs];
                step.extend(path, penalties, costs, runs, &mut Discard);
            }
            paths.arrive(ROWS);
        }
        for x in columns.clone().rev() {
            let place = (x - columns.start) * runs;
            let mut step = paths.step();
            for (path, means) in means.iter_mut().enumerate().take(rows.len()) {
                let penalties = smoothness.after(jump(near.edges[path], x));
                let costs = &near.costs[path][place..place + runs];
                let mut sink = StoreTotals(&mut means[place..place + runs]);
                step.extend(path, penalties, costs, runs, &mut sink);
            }
            paths.arrive(ROWS);
        }
    }

    /// Paths from the left, which go right, along a few rows, from where they were at the end of the panel before.
    #[inline(always)]
    fn rightward(&mut self, rows: Range<usize>, runs: usize) {
        let Self { horizontal, panel, smoothness, .. } = self;
        let Horizontal { paths, left, least, means } = &mut **horizontal;
        let PixelBlock { rows: all, columns } = &panel.block;
        let width = columns.len() * runs;
        let mut near = PathRows::of(panel.costs, rows.clone(), panel.seen.start, width);
        let mut means = rows_mut(means, rows.start - all.start, width);
        for (path, y) in rows.clone().enumerate() {
            near.edges[path] = &smoothness.edges.row(y)[columns.clone()];
            let totals = &mut paths.before[path * span(runs) + LANES..][..runs * LANES];
            totals.copy_from_slice(row_of(left, y - all.start, runs * LANES));
            paths.least[path] = least[y - all.start];
        }
        for x in 0..columns.len() {
            let places = x * runs..(x + 1) * runs;
            let mut step = paths.step();
            for (path, means) in means.iter_mut().enumerate().take(rows.len()) {
                let penalties = smoothness.after(Neighbor::Left.jump(near.edges[path][x]));
                let costs = &near.costs[path][places.clone()];
                let mut sink = AverageTotals(&mut means[places.clone()]);
                step.extend(path, penalties, costs, runs, &mut sink);
            }
            paths.arrive(ROWS);
        }
        for (path, y) in rows.enumerate() {
            let totals = &paths.before[path * span(runs) + LANES..][..runs * LANES];
            row_of_mut(left, y - all.start, runs * LANES).copy_from_slice(totals);
            least[y - all.start] = paths.least[path];
        }
    }
}

/// Costs and jumps along the rows of a few paths.
struct PathRows<'a, T> {
    costs: [&'a [Lanes<T>]; ROWS],
    edges: [&'a [u8]; ROWS],
}

impl<'a, T> PathRows<'a, T> {
    /// Those of some rows of values that begin with row `first`.
    #[inline(always)]
    fn of(costs: &'a [Lanes<T>], rows: Range<usize>, first: usize, width: usize) -> Self {
        let mut found = Self { costs: [&[]; ROWS], edges: [&[]; ROWS] };
        for (row, y) in found.costs.iter_mut().zip(rows) {
            *row = row_of(costs, y - first, width);
        }
        found
    }
}

/// A few rows of values, from row `first` on.
#[inline(always)]
fn rows_mut<V>(values: &mut [V], first: usize, width: usize) -> [&mut [V]; ROWS] {
    let mut rows = values[first * width..].chunks_exact_mut(width);
    let mut found: [&mut [V]; ROWS] = Default::default();
    for (found, row) in found.iter_mut().zip(&mut rows) {
        *found = row;
    }
    found
}

/// The paths from row to row through a panel, and what is best by all paths.
#[derive(Debug, Default)]
pub struct Vertical<T: Value> {
    paths: Paths<T>,
    /// Totals of the paths from below, of the columns that are at hand.
    below: Memory<Lanes<T>>,
    /// The mean of all paths' totals, of the columns that are at hand, and what of that is least.
    sums: Memory<Lanes<T>>,
    selection: Selection<T>,
}

impl<T: Value> Vertical<T> {
    /// Begins a band of so many rows.
    pub fn begin(&mut self, rows: usize, runs: usize) -> Result<()> {
        self.paths.begin(runs)?;
        self.below.resize(rows * PIXELS * runs)?;
        self.sums.resize(PIXELS * runs)
    }
}

/// The paths from row to row through a panel, each from the first or last row that is seen.
#[derive(Debug)]
pub struct VerticalPass<'a, T: Value> {
    /// Where paths are kept.
    pub vertical: &'a mut Vertical<T>,
    /// The panel.
    pub panel: &'a Panel<'a, T>,
    /// Half the sums of the totals of the paths along the rows.
    pub means: &'a [Lanes<T>],
    /// What paths go through.
    pub smoothness: Smoothness<'a, T>,
    /// How many candidates there are.
    pub candidates: usize,
    /// What is found of the rows of the band.
    pub evidence: &'a mut Evidence,
}

impl<T: Value> Loop for VerticalPass<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        // Where their number is known, runs are no loop.
        match self.panel.runs {
            1 => self.through(1),
            2 => self.through(2),
            3 => self.through(3),
            runs => self.through(runs),
        }
    }
}

impl<T: Value> VerticalPass<'_, T> {
    #[inline(always)]
    fn through(&mut self, runs: usize) {
        let Range { start, end } = self.panel.block.columns;
        for first in (start..end).step_by(PIXELS) {
            let columns = first..(first + PIXELS).min(end);
            self.up(columns.clone(), runs);
            self.come_down(columns.clone(), runs);
            for y in self.panel.block.rows.clone() {
                self.down(y, columns.clone(), runs);
                self.select(y, columns.clone(), runs);
            }
        }
    }

    /// Paths from below through some columns.
    #[inline(always)]
    fn up(&mut self, columns: Range<usize>, runs: usize) {
        let (rows, last) = (self.panel.block.rows.clone(), self.panel.seen.end - 1);
        self.vertical.paths.restart(runs);
        for y in (rows.start..=last).rev() {
            // Before its first pixel all totals of a path are 0, whatever the penalties.
            let edges = &self.smoothness.edges.row((y + 1).min(last))[columns.clone()];
            let (smoothness, Vertical { paths, below, .. }) =
                (self.smoothness, &mut *self.vertical);
            let costs = costs_of(self.panel, y, &columns, runs);
            let mut step = paths.step();
            if y < rows.end {
                let below = row_of_mut(below, y - rows.start, PIXELS * runs);
                for (path, edges) in edges.iter().enumerate() {
                    let penalties = smoothness.after(Neighbor::Above.jump(*edges));
                    let mut sink = StoreTotals(row_of_mut(below, path, runs));
                    step.extend(path, penalties, row_of(costs, path, runs), runs, &mut sink);
                }
            } else {
                for (path, edges) in edges.iter().enumerate() {
                    let penalties = smoothness.after(Neighbor::Above.jump(*edges));
                    step.extend(path, penalties, row_of(costs, path, runs), runs, &mut Discard);
                }
            }
            paths.arrive(PIXELS);
        }
    }

    /// Paths from above through some columns, to the first row of the band.
    #[inline(always)]
    fn come_down(&mut self, columns: Range<usize>, runs: usize) {
        let Self { vertical: Vertical { paths, .. }, panel, smoothness, .. } = self;
        paths.restart(runs);
        for y in panel.seen.start..panel.block.rows.start {
            let costs = costs_of(panel, y, &columns, runs);
            let mut step = paths.step();
            for (path, edges) in smoothness.edges.row(y)[columns.clone()].iter().enumerate() {
                let penalties = smoothness.after(Neighbor::Above.jump(*edges));
                step.extend(path, penalties, row_of(costs, path, runs), runs, &mut Discard);
            }
            paths.arrive(PIXELS);
        }
    }

    /// Paths from above through a row of the band: with them all totals of its pixels are known.
    #[inline(always)]
    fn down(&mut self, y: usize, columns: Range<usize>, runs: usize) {
        let Self { vertical, panel, smoothness, means, .. } = self;
        let Vertical { paths, below, sums, selection } = &mut **vertical;
        let (all, row) = (&panel.block.columns, y - panel.block.rows.start);
        let costs = costs_of(panel, y, &columns, runs);
        let means = &row_of(means, row, all.len() * runs)[(columns.start - all.start) * runs..];
        let below = row_of(below, row, PIXELS * runs);
        let sums = &mut sums[..PIXELS * runs];
        let mut step = paths.step();
        for (path, edges) in smoothness.edges.row(y)[columns].iter().enumerate() {
            let penalties = smoothness.after(Neighbor::Above.jump(*edges));
            let mut sink = AverageAll {
                means: row_of(means, path, runs),
                below: row_of(below, path, runs),
                sums: row_of_mut(sums, path, runs),
                minimum: Minimum::of([T::FAR; LANES]),
            };
            step.extend(path, penalties, row_of(costs, path, runs), runs, &mut sink);
            selection.take(path, sink.minimum);
        }
        paths.arrive(PIXELS);
    }

    /// Selects for the pixels of a row of the band by what all paths come to.
    #[inline(always)]
    fn select(&mut self, y: usize, columns: Range<usize>, runs: usize) {
        let Vertical { sums, selection, .. } = &mut *self.vertical;
        let (sums, costs) = (&mut sums[..PIXELS * runs], costs_of(self.panel, y, &columns, runs));
        let (pixels, row) = (columns.len(), y - self.panel.block.rows.start);
        selection.settle(runs);
        selection.weigh(sums, Some(costs), (pixels, self.candidates, runs));
        selection.write(pixels, self.evidence, (row, columns.start));
    }
}

/// Writes the mean of the totals of all paths: of the mean of those along the row, and that of those from above and below.
struct AverageAll<'a, T> {
    means: &'a [Lanes<T>],
    below: &'a [Lanes<T>],
    sums: &'a mut [Lanes<T>],
    minimum: Minimum<T>,
}

impl<T: Value> Sink<T> for AverageAll<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        let (means, below) = (&self.means[run], &self.below[run]);
        let mut sums = [T::default(); LANES];
        for j in 0..LANES {
            sums[j] = means[j].mean(totals[j].mean(below[j]));
        }
        self.sums[run] = sums;
        self.minimum.see(run, sums);
    }
}

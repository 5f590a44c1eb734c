//! Path aggregation of semi-global matching: one step of a path, and the horizontal and vertical passes through a panel
//! (Hirschmüller, PAMI 2008, equation 13).
//!
//! A path goes from pixel to pixel `p-1`, `p`, ...; the total of candidate `k` at pixel `p` is
//!
//! ```text
//! L(p, k) = C(p, k) + min(L(p-1, k),
//!                         L(p-1, k-1) + P1, L(p-1, k+1) + P1,
//!                         min over i of L(p-1, i) + P2) - min over i of L(p-1, i)
//! ```
//!
//! The last term keeps totals below the largest cost plus P2, so most fit a byte.
//!
//! All candidates of a pixel are neighboring lanes. The totals of a path lie between two runs of [`Value::FAR`], so
//! those of `k-1` and `k+1` are unaligned loads that need no check at either end:
//!
//! ```text
//! FAR ... FAR | L(p-1, 0) L(p-1, 1) ... | FAR ... FAR
//! ```
//!
//! A step has to wait for the minimum of the one before. To keep the processor busy meanwhile, several paths are extended
//! in turn: four rows in the horizontal passes, sixteen columns in the vertical ones.

use std::ops::Range;

use crate::cost::aggregation::PixelBlock;
use crate::error::Result;
use crate::optimization::edges::{Edges, Neighbor};
use crate::optimization::evidence::Evidence;
use crate::optimization::selection::{Minimum, PIXELS, Selection};
use crate::optimization::{PANEL, Penalties, STRIP};
use crate::pipeline::memory::{Memory, RunMemory};
use crate::simd::Loop;
use crate::value::{LANES, Lanes, Value, least_lane};

/// Rows whose horizontal paths are extended in turn.
const ROWS: usize = 8;

/// P1, and P2 by the jump of the gray values: the whole of it, half, and a third, but not less than P1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AdaptivePenalties<T> {
    p1: T,
    p2: [T; 4],
}

impl<T: Value> AdaptivePenalties<T> {
    /// The penalties in the integers of the totals.
    pub fn new(penalties: Penalties) -> Self {
        // Jumps are 0 to 2; a fourth entry spares the check of an index of two bits.
        let p2 = [1, 2, 3, 3].map(|part| T::truncated((penalties.p2 / part).max(penalties.p1)));

        Self { p1: T::truncated(penalties.p1), p2 }
    }
}

/// The smoothness term: the penalties, and where P2 is lower.
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

/// Totals of up to [`PIXELS`] paths, each at the last pixel that it has reached.
#[derive(Debug)]
struct Paths<T> {
    /// Totals at the last pixel and at the next one, in either order: one path after another, each a run of
    /// [`Value::FAR`], the totals, and a run of [`Value::FAR`].
    totals: Memory<T>,
    /// Whether the totals at the last pixel come second.
    is_swapped: bool,
    /// The least total of each path in each lane at the next pixel.
    minima: [Lanes<T>; PIXELS],
    /// The least total of each path at the last pixel.
    least: [T; PIXELS],
}

impl<T: Value> Default for Paths<T> {
    fn default() -> Self {
        Self {
            totals: Memory::default(),
            is_swapped: false,
            minima: [[T::default(); LANES]; PIXELS],
            least: [T::default(); PIXELS],
        }
    }
}

/// Values of one path: its totals and a run on either side.
#[inline(always)]
const fn span(runs: usize) -> usize {
    (runs + 2) * LANES
}

impl<T: Value> Paths<T> {
    /// Sizes the buffers for so many runs of candidates and restarts all paths.
    fn begin(&mut self, runs: usize) -> Result<()> {
        self.totals.resize(2 * PIXELS * span(runs))?;
        self.totals.fill(T::FAR);
        self.restart(runs);

        Ok(())
    }

    /// Restarts all paths: before the first pixel every total is 0.
    #[inline(always)]
    fn restart(&mut self, runs: usize) {
        self.least = [T::default(); PIXELS];

        for totals in self.step().before.chunks_exact_mut(span(runs)) {
            totals[LANES..][..runs * LANES].fill(T::default());
        }
    }

    /// Takes up as many paths where they were left: `totals` and their `least`, of rows from `first` on.
    #[inline(always)]
    fn restore(&mut self, paths: usize, (totals, least): (&[T], &[T]), first: usize, runs: usize) {
        self.least[..paths].copy_from_slice(&least[first..][..paths]);

        for (path, before) in
            self.step().before.chunks_exact_mut(span(runs)).take(paths).enumerate()
        {
            let totals = row_of(totals, first + path, runs * LANES);
            before[LANES..][..runs * LANES].copy_from_slice(totals);
        }
    }

    /// Keeps the state of as many paths, for [`Self::restore`].
    #[inline(always)]
    fn save(
        &mut self,
        paths: usize,
        (totals, least): (&mut [T], &mut [T]),
        first: usize,
        runs: usize,
    ) {
        least[first..][..paths].copy_from_slice(&self.least[..paths]);

        for (path, before) in self.step().before.chunks_exact(span(runs)).take(paths).enumerate() {
            let totals = row_of_mut(totals, first + path, runs * LANES);
            totals.copy_from_slice(&before[LANES..][..runs * LANES]);
        }
    }

    /// The buffers of one step, from the last pixel to the next.
    #[inline(always)]
    fn step(&mut self) -> PathStep<'_, T> {
        let Self { totals, is_swapped, minima, least } = self;
        let half = totals.len() / 2;
        let (first, second) = totals.split_at_mut(half);
        let (before, here) = if *is_swapped { (second, first) } else { (first, second) };

        PathStep { before, here, minima, least }
    }

    /// Makes the next pixel the last one, for the first `paths` paths.
    #[inline(always)]
    fn arrive(&mut self, paths: usize) {
        self.is_swapped = !self.is_swapped;

        for (least, minimum) in self.least.iter_mut().zip(&self.minima).take(paths) {
            *least = least_lane(minimum);
        }
    }
}

/// The buffers of [`Paths`] during one step, borrowed apart so that they are known not to overlap.
struct PathStep<'a, T> {
    before: &'a mut [T],
    here: &'a mut [T],
    minima: &'a mut [Lanes<T>; PIXELS],
    least: &'a [T; PIXELS],
}

impl<T: Value> PathStep<'_, T> {
    /// Extends one path to a pixel of these costs. [`Paths::arrive`] follows once all paths are extended.
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

        // The recurrence of the module, a run of candidates at a time; `k-1` and `k+1` share the addition of P1.
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

/// Where the totals of a pixel go, one run of candidates after another.
trait Sink<T> {
    fn take(&mut self, run: usize, totals: Lanes<T>);
}

/// Drops the totals: the path only warms up in the look-ahead.
struct Discard;

impl<T> Sink<T> for Discard {
    #[inline(always)]
    fn take(&mut self, _: usize, _: Lanes<T>) {}
}

/// Writes the totals.
struct StoreTotals<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for StoreTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        self.0[run] = totals;
    }
}

/// Replaces the totals that are there by their mean with the new ones, rounded up.
struct AverageTotals<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for AverageTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        for (mean, total) in self.0[run].iter_mut().zip(totals) {
            *mean = mean.mean(total);
        }
    }
}

/// State of the horizontal paths of a band, which are followed panel by panel from the left.
#[derive(Debug, Default)]
pub struct Horizontal<T: Value> {
    paths: Paths<T>,
    /// Totals of the paths from the left at the last column of the previous panel, row by row.
    left: Memory<T>,
    /// The least total of each of these rows.
    least: Memory<T>,
    /// Half the sum of the totals of both paths, of the current panel.
    means: RunMemory<T>,
}

impl<T: Value> Horizontal<T> {
    /// Starts a band of so many rows: every path from the left restarts.
    pub fn begin(&mut self, rows: usize, runs: usize) -> Result<()> {
        self.left.resize(rows * runs * LANES)?;
        self.left.fill(T::default());

        self.least.resize(rows)?;
        self.least.fill(T::default());

        self.means.resize(rows * PANEL * runs)?;
        self.paths.begin(runs)
    }

    /// The means of the totals of both paths. The caller may overwrite them.
    pub fn means(&mut self) -> &mut [Lanes<T>] {
        &mut self.means
    }
}

/// A panel of columns of a band.
#[derive(Debug, Clone)]
pub struct Panel<'a, T> {
    /// The pixels of the band that are in it.
    pub block: PixelBlock,
    /// The pixels that have costs: these, the look-ahead rows and the look-ahead columns.
    pub seen: PixelBlock,
    /// The costs of all these pixels.
    pub costs: &'a [Lanes<T>],
    /// Runs of candidates of a pixel.
    pub runs: usize,
}

/// The values of a row of a strip of a block, of so many pixels.
#[inline(always)]
fn strip_row<'a, V>(
    values: &'a [V],
    block: &PixelBlock,
    (strip, y): (usize, usize),
    (pixels, runs): (usize, usize),
) -> &'a [V] {
    &values[block.place(strip, y - block.rows.start) * runs..][..pixels * runs]
}

/// Row `row` of values with `width` values to the row.
#[inline(always)]
fn row_of<V>(values: &[V], row: usize, width: usize) -> &[V] {
    &values[row * width..(row + 1) * width]
}

/// As [`row_of`], to be written.
#[inline(always)]
fn row_of_mut<V>(values: &mut [V], row: usize, width: usize) -> &mut [V] {
    &mut values[row * width..(row + 1) * width]
}

/// The horizontal paths through a panel: those from the right start in the look-ahead, those from the left go on from the
/// previous panel.
#[derive(Debug)]
pub struct HorizontalPass<'a, T: Value> {
    /// State of the paths.
    pub horizontal: &'a mut Horizontal<T>,
    /// The panel.
    pub panel: &'a Panel<'a, T>,
    /// The smoothness term.
    pub smoothness: Smoothness<'a, T>,
}

impl<T: Value> Loop for HorizontalPass<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        // Usual numbers of runs as constants, so that the loop over runs is unrolled.
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
        let Self { horizontal: Horizontal { paths, means, .. }, panel, smoothness } = self;
        let Panel { block, seen, .. } = panel;

        paths.restart(runs);
        for (strip, columns) in seen.strips().enumerate().rev() {
            let mut here = PathRows::of(panel, &rows, (strip, columns.len()), runs);
            // Pixel `x + 1` holds the jump between `x` and `x + 1`. At its first pixel a path has no jump to its right: all
            // totals before it are 0, so any penalty does.
            let jumps = columns.start + 1..(columns.end + 1).min(seen.columns.end);
            for (edges, y) in here.edges.iter_mut().zip(rows.clone()) {
                *edges = &smoothness.edges.row(y)[jumps.clone()];
            }

            // The look-ahead only warms the paths up; in the panel their totals are kept.
            let is_kept = columns.start < block.columns.end;
            let place = block.place(strip, rows.start - block.rows.start) * runs;
            let kept = if is_kept { &mut means[place..] } else { &mut [] };
            let kept = rows_of(kept, STRIP * runs);

            for x in (0..columns.len()).rev() {
                let places = x * runs..(x + 1) * runs;
                let mut step = paths.step();

                for path in 0..rows.len() {
                    let jump = here.edges[path].get(x..).and_then(<[u8]>::first);
                    let jump = jump.map_or(0, |edges| Neighbor::Left.jump(*edges));
                    let costs = &here.costs[path][places.clone()];

                    let penalties = smoothness.after(jump);
                    if is_kept {
                        let mut sink = StoreTotals(&mut kept[path][places.clone()]);
                        step.extend(path, penalties, costs, runs, &mut sink);
                    } else {
                        step.extend(path, penalties, costs, runs, &mut Discard);
                    }
                }

                paths.arrive(ROWS);
            }
        }
    }

    /// Paths from the left, which go right, along a few rows: on from where they were at the end of the previous panel.
    #[inline(always)]
    fn rightward(&mut self, rows: Range<usize>, runs: usize) {
        let Self { horizontal, panel, smoothness } = self;
        let Horizontal { paths, left, least, means } = &mut **horizontal;
        let block = &panel.block;

        paths.restore(rows.len(), (left, least), rows.start - block.rows.start, runs);

        // The totals of the paths from the right are there: the mean with them replaces them.
        for (strip, columns) in block.strips().enumerate() {
            let mut here = PathRows::of(panel, &rows, (strip, columns.len()), runs);
            for (edges, y) in here.edges.iter_mut().zip(rows.clone()) {
                *edges = &smoothness.edges.row(y)[columns.clone()];
            }

            let place = block.place(strip, rows.start - block.rows.start) * runs;
            let means = rows_of(&mut means[place..], STRIP * runs);

            for x in 0..columns.len() {
                let places = x * runs..(x + 1) * runs;
                let mut step = paths.step();

                for path in 0..rows.len() {
                    let penalties = smoothness.after(Neighbor::Left.jump(here.edges[path][x]));
                    let costs = &here.costs[path][places.clone()];
                    let mut sink = AverageTotals(&mut means[path][places.clone()]);
                    step.extend(path, penalties, costs, runs, &mut sink);
                }

                paths.arrive(ROWS);
            }
        }

        paths.save(rows.len(), (left, least), rows.start - block.rows.start, runs);
    }
}

/// Costs and jumps of the rows that a few paths run along, in one strip.
struct PathRows<'a, T> {
    costs: [&'a [Lanes<T>]; ROWS],
    edges: [&'a [u8]; ROWS],
}

impl<'a, T> PathRows<'a, T> {
    /// The costs of some rows of a strip with so many columns; no jumps yet.
    #[inline(always)]
    fn of(
        panel: &Panel<'a, T>,
        rows: &Range<usize>,
        (strip, pixels): (usize, usize),
        runs: usize,
    ) -> Self {
        let mut found = Self { costs: [&[]; ROWS], edges: [&[]; ROWS] };

        for (row, y) in found.costs.iter_mut().zip(rows.clone()) {
            *row = strip_row(panel.costs, &panel.seen, (strip, y), (pixels, runs));
        }

        found
    }
}

/// The first few rows of values with so many values to the row, to be written.
#[inline(always)]
fn rows_of<V>(values: &mut [V], width: usize) -> [&mut [V]; ROWS] {
    let mut rows = values.chunks_exact_mut(width);
    let mut found: [&mut [V]; ROWS] = Default::default();

    for (found, row) in found.iter_mut().zip(&mut rows) {
        *found = row;
    }

    found
}

/// State of the vertical paths of a panel.
#[derive(Debug, Default)]
pub struct Vertical<T: Value> {
    paths: Paths<T>,
    /// Totals of the paths from below, of the columns that are being worked on.
    below: RunMemory<T>,
    /// The means of all paths' totals of one row of these columns.
    sums: RunMemory<T>,
}

impl<T: Value> Vertical<T> {
    /// Sizes the buffers for a band of so many rows.
    pub fn begin(&mut self, rows: usize, runs: usize) -> Result<()> {
        self.paths.begin(runs)?;
        self.below.resize(rows * PIXELS * runs)?;
        self.sums.resize(PIXELS * runs)
    }
}

/// The vertical paths through a panel, each from the first or last row that has costs.
#[derive(Debug)]
pub struct VerticalPass<'a, T: Value> {
    /// State of the paths.
    pub vertical: &'a mut Vertical<T>,
    /// The panel.
    pub panel: &'a Panel<'a, T>,
    /// Half the sums of the totals of the horizontal paths.
    pub means: &'a [Lanes<T>],
    /// The smoothness term.
    pub smoothness: Smoothness<'a, T>,
    /// Candidates of each pixel.
    pub candidates: usize,
    /// Selects the candidates by all four paths.
    pub selection: &'a mut Selection<T>,
    /// What was found about the rows of the band.
    pub evidence: &'a mut Evidence,
}

impl<T: Value> Loop for VerticalPass<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        // Usual numbers of runs as constants, so that the loop over runs is unrolled.
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
        for place in self.panel.block.strips().enumerate() {
            self.upward(&place, runs);
            self.approach(&place, runs);

            for y in self.panel.block.rows.clone() {
                self.downward(y, &place, runs);
                self.select(y, &place, runs);
            }
        }
    }

    /// Paths from below through a strip; keeps their totals in the rows of the band.
    #[inline(always)]
    fn upward(&mut self, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Panel { block: PixelBlock { rows, .. }, seen, costs, .. } = self.panel;
        let last = seen.rows.end - 1;
        let smoothness = self.smoothness;
        let Vertical { paths, below, .. } = &mut *self.vertical;

        paths.restart(runs);
        for y in (rows.start..=last).rev() {
            // A row holds the jumps from the row above it, so these paths read the row below. At the first pixel any
            // penalty does: all totals before it are 0.
            let edges = &smoothness.edges.row((y + 1).min(last))[columns.clone()];
            let costs = strip_row(costs, seen, (*strip, y), (columns.len(), runs));
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

    /// Paths from above through a strip, from the look-ahead to the first row of the band.
    #[inline(always)]
    fn approach(&mut self, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Self { vertical: Vertical { paths, .. }, panel, smoothness, .. } = self;

        paths.restart(runs);
        for y in panel.seen.rows.start..panel.block.rows.start {
            let costs = strip_row(panel.costs, &panel.seen, (*strip, y), (columns.len(), runs));
            let mut step = paths.step();

            for (path, edges) in smoothness.edges.row(y)[columns.clone()].iter().enumerate() {
                let penalties = smoothness.after(Neighbor::Above.jump(*edges));
                step.extend(path, penalties, row_of(costs, path, runs), runs, &mut Discard);
            }

            paths.arrive(PIXELS);
        }
    }

    /// Paths from above through a row of the band: the last of the four, so the sums of all can be taken.
    #[inline(always)]
    fn downward(&mut self, y: usize, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Self { vertical, panel, smoothness, means, selection, .. } = self;
        let Vertical { paths, below, sums } = &mut **vertical;
        let row = y - panel.block.rows.start;

        let size = (columns.len(), runs);
        let costs = strip_row(panel.costs, &panel.seen, (*strip, y), size);
        let means = strip_row(means, &panel.block, (*strip, y), size);
        let below = row_of(below, row, PIXELS * runs);
        let sums = &mut sums[..PIXELS * runs];

        let mut step = paths.step();
        for (path, edges) in smoothness.edges.row(y)[columns.clone()].iter().enumerate() {
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

    /// Selects candidates for the pixels of a row of the band by the sums of all paths.
    #[inline(always)]
    fn select(&mut self, y: usize, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let selection = &mut *self.selection;
        let sums = &mut self.vertical.sums[..PIXELS * runs];
        let Panel { block, seen, costs, .. } = self.panel;
        let pixels = columns.len();
        let costs = strip_row(costs, seen, (*strip, y), (pixels, runs));
        let row = y - block.rows.start;

        selection.settle();
        selection.weigh(sums, Some(costs), (pixels, self.candidates, runs));
        selection.write(pixels, self.evidence, (row, columns.start));
    }
}

/// Writes the mean of the totals of all paths: the mean of the horizontal mean and the vertical one. Tracks the least.
struct AverageAll<'a, T> {
    means: &'a [Lanes<T>],
    below: &'a [Lanes<T>],
    sums: &'a mut [Lanes<T>],
    minimum: Minimum<T>,
}

impl<T: Value> Sink<T> for AverageAll<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        let means = &self.means[run];
        let below = &self.below[run];

        let mut sums = [T::default(); LANES];
        for j in 0..LANES {
            sums[j] = means[j].mean(totals[j].mean(below[j]));
        }

        self.sums[run] = sums;
        self.minimum.see(run, sums);
    }
}

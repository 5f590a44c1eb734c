//! Path aggregation of semi-global matching: one step of a path, and the horizontal and vertical passes
//! through a panel (Hirschmüller, PAMI 2008, equation 13).
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
//! All candidates of a pixel are neighboring lanes. The totals of a path lie between two runs of
//! [`Value::FAR`], so those of `k-1` and `k+1` are unaligned loads that need no check at either end:
//!
//! ```text
//! FAR ... FAR | L(p-1, 0) L(p-1, 1) ... | FAR ... FAR
//! ```
//!
//! The pixels of a panel lie in strips of [`STRIP`] columns, and in each strip row by row
//! ([`PixelBlock::place`]). So sixteen pixels of a row are neighbors, and the next row of the strip follows
//! them: paths along columns stay on few pages, too.
//!
//! A step has to wait for the minimum of the previous one. To keep the processor busy meanwhile, sixteen
//! paths along neighboring rows or columns are extended in turn.

use std::ops::Range;

use crate::base::error::Result;
use crate::base::memory::{LINE, Memory, RunMemory};
use crate::base::simd::{Loop, fetch};
use crate::base::value::{LANES, LaneRows, Lanes, Value};
use crate::choices::PANEL;
use crate::cost::aggregation::{GAP, PixelBlock};
use crate::optimization::edges::{Edges, Neighbor};
use crate::optimization::evidence::Evidence;
use crate::optimization::penalties::Penalties;
use crate::optimization::selection::{PIXELS, Selection};
use crate::pair::candidates::Searched;

/// Columns of a strip: the values of a panel are stored strip by strip, and in each strip row by row. So
/// paths along columns read neighboring memory, too, instead of jumping between pages, and take 2 to 4 % less
/// time.
pub const STRIP: usize = PIXELS;
/// Places from one row of a strip to the next: [`PixelBlock::stride`].
pub const STRIDE: usize = STRIP + GAP;

/// P1, and P2 by the jump of the gray values: all, half or a third of it, but at least P1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AdaptivePenalties<T> {
    p1: T,
    p2: [T; 4],
}

impl<T: Value> AdaptivePenalties<T> {
    /// The penalties in the integers of the totals.
    pub fn new(penalties: Penalties) -> Self {
        let [whole, half, third] = penalties.adaptive_p2().map(T::truncated);
        // Jumps are 0 to 2; a fourth entry avoids checking an index of two bits.
        let p2 = [whole, half, third, third];

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
    /// P1, and P2 for up to [`STRIP`] pixels after the jumps from the row above.
    #[inline(always)]
    fn after_jumps_from_above(&self, edges: &[u8]) -> (T, [T; STRIP]) {
        let AdaptivePenalties { p1, p2: [whole, half, third, _] } = self.penalties;
        let (to_half, to_third) = (whole.minus(half), half.minus(third));

        let mut jumps = [0; STRIP];
        match edges.first_chunk() {
            Some(all) => jumps = *all,
            None => jumps.iter_mut().zip(edges).for_each(|(jump, edges)| *jump = *edges),
        }

        // Arithmetic on all pixels at once: a look-up would go pixel by pixel. Each mask is 0, or all bits.
        let mut p2 = [whole; STRIP];
        for (p2, edges) in p2.iter_mut().zip(jumps) {
            let jump = Neighbor::Above.jump(edges);
            let any = T::default().minus(T::truncated(u64::from(jump.min(1))));
            let large = T::default().minus(T::truncated(u64::from(jump / 2)));
            *p2 = whole.minus(any.min(to_half)).minus(large.min(to_third));
        }

        (p1, p2)
    }

    /// P2 after the jump from the left.
    #[inline(always)]
    fn p2_after_jump_from_left(&self, edges: u8) -> T {
        self.penalties.p2[usize::from(Neighbor::Left.jump(edges))]
    }
}

/// Totals of up to [`STRIP`] paths, each at the last pixel it has reached.
#[derive(Debug)]
struct Paths<T> {
    /// Totals at the last pixel and at the next one, in either order: one path after another, each a run of
    /// [`Value::FAR`], the totals, and a run of [`Value::FAR`].
    totals: Memory<T>,
    /// Whether the totals at the last pixel come second.
    is_swapped: bool,
    /// The smallest total of each path at the last pixel ...
    least: [T; STRIP],
    /// ... and in each lane.
    lanes: LaneRows<T>,
}

impl<T: Value> Default for Paths<T> {
    fn default() -> Self {
        let (least, lanes) = ([T::default(); STRIP], LaneRows([[T::default(); LANES]; STRIP]));
        Self { totals: Memory::default(), is_swapped: false, least, lanes }
    }
}

/// The totals of paths at the last pixel, and those at the next one, which are written.
#[inline(always)]
fn halves<T>(totals: &mut [T], is_swapped: bool) -> [&mut [T]; 2] {
    let (first, second) = totals.split_at_mut(totals.len() / 2);
    if is_swapped { [second, first] } else { [first, second] }
}

/// Values of one path: its totals and a run on either side.
#[inline(always)]
const fn span(runs: usize) -> usize {
    (runs + 2) * LANES
}

impl<T: Value> Paths<T> {
    /// Sizes the buffers for `runs` of candidates and restarts all paths.
    fn begin(&mut self, runs: usize) -> Result<()> {
        self.totals.resize(2 * STRIP * span(runs))?;
        self.totals.fill(T::FAR);
        self.restart(runs);

        Ok(())
    }

    /// Restarts all paths: before the first pixel every total is 0.
    #[inline(always)]
    fn restart(&mut self, runs: usize) {
        self.least = [T::default(); STRIP];

        for totals in halves(&mut self.totals, self.is_swapped)[0].chunks_exact_mut(span(runs)) {
            totals[LANES..][..runs * LANES].fill(T::default());
        }
    }

    /// Continues `paths` of rows from `first` on where they stopped: `totals`, with places for `most` runs
    /// each, and their `least`.
    #[inline(always)]
    fn restore(
        &mut self,
        paths: usize,
        (totals, most): (&[T], usize),
        least: &[T],
        first: usize,
        runs: usize,
    ) {
        self.least[..paths].copy_from_slice(&least[first..][..paths]);

        for (path, before) in
            halves(&mut self.totals, self.is_swapped)[0].chunks_exact_mut(span(runs)).take(paths).enumerate()
        {
            let totals = row_of(totals, first + path, most * LANES);
            before[LANES..][..runs * LANES].copy_from_slice(&totals[..runs * LANES]);
        }
    }

    /// Keeps the state of `paths`, for [`Self::restore`].
    #[inline(always)]
    fn save(
        &mut self,
        paths: usize,
        (totals, most): (&mut [T], usize),
        least: &mut [T],
        first: usize,
        runs: usize,
    ) {
        least[first..][..paths].copy_from_slice(&self.least[..paths]);

        for (path, before) in
            halves(&mut self.totals, self.is_swapped)[0].chunks_exact(span(runs)).take(paths).enumerate()
        {
            let totals = row_of_mut(totals, first + path, most * LANES);
            totals[..runs * LANES].copy_from_slice(&before[LANES..][..runs * LANES]);
        }
    }

    /// Extends the paths that have costs to their next pixels, with these values of P2, these costs, and
    /// sinks for the totals.
    #[inline(always)]
    fn extend<'c>(
        &mut self,
        (p1, p2): (T, [T; STRIP]),
        costs: impl Iterator<Item = &'c [Lanes<T>]>,
        sinks: impl Iterator<Item = impl Sink<T>>,
        runs: usize,
    ) {
        let Self { totals, is_swapped, least, lanes } = self;
        let [before, here] = halves(totals, *is_swapped);
        let totals = before.chunks_exact(span(runs)).zip(here.chunks_exact_mut(span(runs)));
        let least_before = *least;
        let least_ones = lanes.0.iter_mut().zip(least_before.iter().zip(&p2));
        let paths = totals.zip(least_ones).zip(costs).zip(sinks);

        for ((((before, here), (minimum, (least, p2))), costs), mut sink) in paths {
            let smaller = &before[LANES - 1..].as_chunks::<LANES>().0[..runs];
            let same = &before[LANES..].as_chunks::<LANES>().0[..runs];
            let larger = &before[LANES + 1..].as_chunks::<LANES>().0[..runs];
            let here = &mut here.as_chunks_mut::<LANES>().0[1..][..runs];
            let costs = &costs[..runs];

            // The recurrence of the module, a run of candidates at a time; `k-1` and `k+1` share the addition
            // of P1. P2 is compared with the excess over the smallest total, so that nothing waits for the
            // smallest totals of all paths.
            let mut lanes = [T::FAR; LANES];
            for run in 0..runs {
                let mut totals = [T::default(); LANES];
                for j in 0..LANES {
                    let changed = smaller[run][j].min(larger[run][j]).plus(p1);
                    let best = same[run][j].min(changed).minus(*least).min(*p2);
                    totals[j] = best.plus(costs[run][j]);
                    lanes[j] = lanes[j].min(totals[j]);
                }

                here[run] = totals;
                sink.take(run, totals);
            }

            *minimum = lanes;
            sink.finish();
        }

        // The next pixels become the last ones.
        *is_swapped = !*is_swapped;
        *least = T::least_lanes(lanes);
    }
}

/// Receives the totals of a pixel, one run of candidates after another.
trait Sink<T> {
    fn take(&mut self, run: usize, totals: Lanes<T>);

    /// Called after the last run.
    #[inline(always)]
    fn finish(self)
    where
        Self: Sized,
    {
    }
}

/// Drops the totals: the path only warms up in the look-ahead.
struct Discard;

impl<T> Sink<T> for Discard {
    #[inline(always)]
    fn take(&mut self, _: usize, _: Lanes<T>) {}
}

/// One for each path.
#[inline(always)]
fn discards() -> impl Iterator<Item = Discard> {
    [(); STRIP].iter().map(|()| Discard)
}

/// Writes the totals of a pixel; the path's next one is this number of pixels further on.
struct StoreTotals<'a, T>(&'a mut [Lanes<T>], isize);

impl<T: Value> Sink<T> for StoreTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        fetch_next(self.0, run, self.1);
        self.0[run] = totals;
    }
}

/// Replaces the stored totals by their mean with the new ones, rounded up; the path's next pixel follows.
struct AverageTotals<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for AverageTotals<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        fetch_next(self.0, run, 1);
        for (mean, total) in self.0[run].iter_mut().zip(totals) {
            *mean = mean.mean(total);
        }
    }
}

/// Prefetches the same run of the pixel `pixels` further on, once for each cache line. Without it, paths wait
/// for the places where their totals go; processors prefetch costs by themselves.
#[inline(always)]
fn fetch_next<T>(lanes: &[Lanes<T>], run: usize, pixels: isize) {
    if (run * size_of::<Lanes<T>>()).is_multiple_of(LINE) {
        let further = pixels * (lanes.len() * LANES) as isize;
        fetch(lanes[run].as_ptr().wrapping_offset(further));
    }
}

/// State of the horizontal paths of a band, which are followed panel by panel from the left.
#[derive(Debug, Default)]
pub struct Horizontal<T: Value> {
    paths: Paths<T>,
    /// Totals of the paths from the left at the last column of the previous panel, row by row, with places
    /// for `most` runs.
    left: Memory<T>,
    most: usize,
    /// The smallest total of each of these rows.
    least: Memory<T>,
    /// Half the sum of the totals of both paths, for the current panel.
    means: RunMemory<T>,
    /// P2 at each pixel of a few rows of the current panel and its look-ahead columns, column by column.
    p2: Memory<T>,
}

impl<T: Value> Horizontal<T> {
    /// Starts a band of `rows`: all paths from the left restart, and no panel has more than `most` runs.
    pub fn begin(&mut self, rows: usize, most: usize) -> Result<()> {
        self.most = most;
        self.left.resize(rows * most * LANES)?;
        self.left.fill(T::default());

        self.least.resize(rows)?;
        self.least.fill(T::default());

        self.means.resize(rows * PANEL / STRIP * STRIDE * most)?;
        self.p2.resize((PANEL + 2 * STRIP) * STRIP)
    }

    /// Continues with other candidates than those `before`. Paths from the left reach newly searched
    /// candidates only by a jump; of those no longer searched they keep only the smallest total.
    pub fn search(&mut self, before: Option<Searched>, searched: Searched) -> Result<()> {
        if let Some(before) = before {
            let (ends, width) = (before.runs() * LANES, searched.runs() * LANES);
            for totals in self.left.chunks_exact_mut(self.most * LANES) {
                totals[ends..].fill(T::FAR);

                if searched.start >= before.start {
                    let skipped = (searched.start - before.start).min(ends);
                    totals.copy_within(skipped..ends, 0);
                    totals[ends - skipped..].fill(T::FAR);
                } else {
                    let added = (before.start - searched.start).min(width);
                    let kept = (width - added).min(ends);
                    totals.copy_within(..kept, added);
                    totals[..added].fill(T::FAR);
                }
                totals[searched.count..].fill(T::FAR);
            }
        }

        self.paths.begin(searched.runs())
    }

    /// The means of the totals of both paths. The caller may overwrite them.
    pub fn means(&mut self) -> &mut [Lanes<T>] {
        &mut self.means
    }
}

/// A panel of columns of a band.
#[derive(Debug, Clone)]
pub struct Panel<'a, T> {
    /// The pixels of the band in the panel.
    pub block: PixelBlock,
    /// The pixels that have costs: these, the look-ahead rows and the look-ahead columns.
    pub seen: PixelBlock,
    /// The costs of all these pixels.
    pub costs: &'a [Lanes<T>],
    /// The candidates of these costs.
    pub searched: Searched,
}

/// The values of some rows of a strip of a block.
#[inline(always)]
fn strip_rows<'a, V>(
    values: &'a [V],
    block: &PixelBlock,
    (strip, rows): (usize, &Range<usize>),
    runs: usize,
) -> &'a [V] {
    let place = block.place(strip, rows.start - block.rows.start);
    &values[place * runs..][..rows.len() * block.stride() * runs]
}

/// Like [`strip_rows`], writable.
#[inline(always)]
fn strip_rows_mut<'a, V>(
    values: &'a mut [V],
    block: &PixelBlock,
    (strip, rows): (usize, &Range<usize>),
    runs: usize,
) -> &'a mut [V] {
    let place = block.place(strip, rows.start - block.rows.start);
    &mut values[place * runs..][..rows.len() * block.stride() * runs]
}

/// Row `row` of values with `width` values to the row.
#[inline(always)]
fn row_of<V>(values: &[V], row: usize, width: usize) -> &[V] {
    &values[row * width..(row + 1) * width]
}

/// Like [`row_of`], writable.
#[inline(always)]
fn row_of_mut<V>(values: &mut [V], row: usize, width: usize) -> &mut [V] {
    &mut values[row * width..(row + 1) * width]
}

/// The horizontal paths through a panel: those from the right start in the look-ahead, those from the left
/// continue from the previous panel.
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
        // Common numbers of runs as constants, so that the loop over runs is unrolled.
        match self.panel.searched.runs() {
            1 if !T::IS_RARE => self.through(1),
            2 if !T::IS_RARE => self.through(2),
            3 if !T::IS_RARE => self.through(3),
            runs => self.through(runs),
        }
    }
}

impl<T: Value> HorizontalPass<'_, T> {
    #[inline(always)]
    fn through(&mut self, runs: usize) {
        let rows = self.panel.block.rows.clone();
        for first in rows.clone().step_by(STRIP) {
            let group = first..(first + STRIP).min(rows.end);
            self.find_p2(&group);
            self.leftward(group.clone(), runs);
            self.rightward(group, runs);
        }
    }

    /// Finds P2 of a few rows from the jumps from the left.
    #[inline(always)]
    fn find_p2(&mut self, rows: &Range<usize>) {
        let Self { horizontal, panel, smoothness } = self;

        for (strip, columns) in panel.seen.strips().enumerate() {
            let p2 = &mut horizontal.p2.as_chunks_mut::<STRIP>().0[strip * STRIP..][..STRIP];

            for (path, y) in rows.clone().enumerate() {
                let edges = &smoothness.edges.row(y)[columns.clone()];
                for (column, edges) in p2.iter_mut().zip(edges) {
                    column[path] = smoothness.p2_after_jump_from_left(*edges);
                }
            }
        }
    }

    /// Paths from the right, going left, along a few rows.
    #[inline(always)]
    fn leftward(&mut self, rows: Range<usize>, runs: usize) {
        let Self { horizontal: Horizontal { paths, means, p2, .. }, panel, smoothness } = self;
        let Panel { block, seen, .. } = panel;
        let p1 = smoothness.penalties.p1;

        paths.restart(runs);
        for (strip, columns) in seen.strips().enumerate().rev() {
            // Pixel `x + 1` holds the jump between `x` and `x + 1`. At its first pixel a path has no jump on
            // its right: all previous totals are 0, so any penalty will do.
            let p2 = &p2.as_chunks::<STRIP>().0[strip * STRIP + 1..];
            let costs = strip_rows(panel.costs, seen, (strip, &rows), runs);

            // The look-ahead only warms the paths up; in the panel their totals are kept.
            if columns.start >= block.columns.end {
                for x in (0..columns.len()).rev() {
                    let costs = column(costs, x, runs);
                    paths.extend((p1, p2[x]), costs, discards(), runs);
                }
            } else {
                let means = strip_rows_mut(means, block, (strip, &rows), runs);
                for x in (0..columns.len()).rev() {
                    let costs = column(costs, x, runs);
                    let sinks = column_mut(means, x, runs).map(|pixel| StoreTotals(pixel, -1));
                    paths.extend((p1, p2[x]), costs, sinks, runs);
                }
            }
        }
    }

    /// Paths from the left, going right, along a few rows, from where they were at the end of the previous
    /// panel.
    #[inline(always)]
    fn rightward(&mut self, rows: Range<usize>, runs: usize) {
        let Self { horizontal, panel, smoothness } = self;
        let Horizontal { paths, left, most, least, means, p2 } = &mut **horizontal;
        let Panel { block, seen, .. } = panel;
        let p1 = smoothness.penalties.p1;

        let first = rows.start - block.rows.start;
        paths.restore(rows.len(), (left, *most), least, first, runs);

        // The totals of the paths from the right are stored; the mean with them replaces them.
        for (strip, columns) in block.strips().enumerate() {
            let p2 = &p2.as_chunks::<STRIP>().0[strip * STRIP..];
            let costs = strip_rows(panel.costs, seen, (strip, &rows), runs);
            let means = strip_rows_mut(means, block, (strip, &rows), runs);

            for (x, p2) in p2.iter().enumerate().take(columns.len()) {
                let costs = column(costs, x, runs);
                let sinks = column_mut(means, x, runs).map(AverageTotals);
                paths.extend((p1, *p2), costs, sinks, runs);
            }
        }

        paths.save(rows.len(), (left, *most), least, first, runs);
    }
}

/// A pixel of each of some rows of a strip.
#[inline(always)]
fn column<V>(rows: &[V], x: usize, runs: usize) -> impl Iterator<Item = &[V]> {
    rows.chunks_exact(STRIDE * runs).map(move |row| &row[x * runs..][..runs])
}

/// Like [`column()`], writable.
#[inline(always)]
fn column_mut<V>(rows: &mut [V], x: usize, runs: usize) -> impl Iterator<Item = &mut [V]> {
    rows.chunks_exact_mut(STRIDE * runs).map(move |row| &mut row[x * runs..][..runs])
}

/// State of the vertical paths of a panel.
#[derive(Debug, Default)]
pub struct Vertical<T: Value> {
    paths: Paths<T>,
    /// Totals of the paths from below, of the current columns.
    below: RunMemory<T>,
    /// The means of all paths' totals of one row of these columns.
    sums: RunMemory<T>,
}

impl<T: Value> Vertical<T> {
    /// Sizes the buffers for a band of `rows`; no panel has more than `most` runs.
    pub fn begin(&mut self, rows: usize, most: usize) -> Result<()> {
        self.below.resize(rows * STRIP * most)?;
        self.sums.resize(STRIP * most)
    }

    /// Continues with other candidates.
    pub fn search(&mut self, searched: Searched) -> Result<()> {
        self.paths.begin(searched.runs())
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
    /// Selects the candidates by all four paths.
    pub selection: &'a mut Selection<T>,
    /// The evidence of the rows of the band.
    pub evidence: &'a mut Evidence,
}

impl<T: Value> Loop for VerticalPass<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        // Common numbers of runs as constants, so that the loop over runs is unrolled.
        match self.panel.searched.runs() {
            1 if !T::IS_RARE => self.through(1),
            2 if !T::IS_RARE => self.through(2),
            3 if !T::IS_RARE => self.through(3),
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
        let Self { vertical: Vertical { paths, below, .. }, panel, smoothness, .. } = self;
        let rows = &panel.block.rows;
        let last = panel.seen.rows.end - 1;

        paths.restart(runs);
        for y in (rows.start..=last).rev() {
            // A row holds the jumps from the row above it, so these paths read the row below. At the first
            // pixel any penalty will do: all previous totals are 0.
            let edges = &smoothness.edges.row((y + 1).min(last))[columns.clone()];
            let penalties = smoothness.after_jumps_from_above(edges);
            let costs = strip_rows(panel.costs, &panel.seen, (*strip, &(y..y + 1)), runs);
            let costs = costs.chunks_exact(runs);

            if y < rows.end {
                let below = row_of_mut(below, y - rows.start, STRIP * runs);
                let below = below.chunks_exact_mut(runs);
                let sinks = below.map(|pixel| StoreTotals(pixel, -(STRIP as isize)));
                paths.extend(penalties, costs, sinks, runs);
            } else {
                let sinks = discards();
                paths.extend(penalties, costs, sinks, runs);
            }
        }
    }

    /// Paths from above through a strip, from the look-ahead to the first row of the band.
    #[inline(always)]
    fn approach(&mut self, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Self { vertical: Vertical { paths, .. }, panel, smoothness, .. } = self;

        paths.restart(runs);
        for y in panel.seen.rows.start..panel.block.rows.start {
            let penalties = smoothness.after_jumps_from_above(&smoothness.edges.row(y)[columns.clone()]);
            let costs = strip_rows(panel.costs, &panel.seen, (*strip, &(y..y + 1)), runs);

            let sinks = discards();
            paths.extend(penalties, costs.chunks_exact(runs), sinks, runs);
        }
    }

    /// Paths from above through a row of the band: the last of the four, so all can be summed.
    #[inline(always)]
    fn downward(&mut self, y: usize, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Self { vertical, panel, smoothness, means, selection, .. } = self;
        let Vertical { paths, below, sums } = &mut **vertical;
        let row = y - panel.block.rows.start;

        let place = (*strip, &(y..y + 1));
        let costs = strip_rows(panel.costs, &panel.seen, place, runs).chunks_exact(runs);
        let means = strip_rows(means, &panel.block, place, runs).chunks_exact(runs);
        let below = row_of(below, row, STRIP * runs).chunks_exact(runs);
        let sums = sums[..STRIP * runs].chunks_exact_mut(runs);

        let others = means.zip(below).zip(sums.zip(selection.least()));
        let sinks = others.map(|((means, below), (sums, least))| AverageAll {
            means,
            below,
            sums,
            lanes: [T::FAR; LANES],
            least,
        });

        let penalties = smoothness.after_jumps_from_above(&smoothness.edges.row(y)[columns.clone()]);
        paths.extend(penalties, costs, sinks, runs);
    }

    /// Selects candidates for the pixels of a row of the band by the sums of all paths.
    #[inline(always)]
    fn select(&mut self, y: usize, (strip, columns): &(usize, Range<usize>), runs: usize) {
        let Self { vertical, panel, selection, .. } = self;
        let sums = &vertical.sums[..STRIP * runs];
        let costs = strip_rows(panel.costs, &panel.seen, (*strip, &(y..y + 1)), runs);
        let pixels = columns.len();
        let row = y - panel.block.rows.start;

        selection.settle(sums, runs);
        selection.weigh(sums, Some(costs), (panel.searched.count, runs));
        selection.number_from(panel.searched.start);
        selection.write(pixels, self.evidence, (row, columns.start));
    }
}

/// Writes the mean of the totals of all paths: the mean of the horizontal mean and the vertical one. Tracks
/// the minimum.
struct AverageAll<'a, T> {
    means: &'a [Lanes<T>],
    below: &'a [Lanes<T>],
    sums: &'a mut [Lanes<T>],
    lanes: Lanes<T>,
    least: &'a mut Lanes<T>,
}

impl<T: Value> Sink<T> for AverageAll<'_, T> {
    #[inline(always)]
    fn take(&mut self, run: usize, totals: Lanes<T>) {
        // The path's next pixel is in the next row.
        fetch_next(self.means, run, STRIDE as isize);
        fetch_next(self.below, run, STRIP as isize);
        let means = &self.means[run];
        let below = &self.below[run];

        let mut sums = [T::default(); LANES];
        for j in 0..LANES {
            sums[j] = means[j].mean(totals[j].mean(below[j]));
            self.lanes[j] = self.lanes[j].min(sums[j]);
        }

        self.sums[run] = sums;
    }

    #[inline(always)]
    fn finish(self) {
        *self.least = self.lanes;
    }
}

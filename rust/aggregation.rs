//! Costs -> sums over a window, of which the best of five counts (paper, section 2.3).
//!
//! A strip is swept from left to right, a few columns at a time, one candidate after another: sums down the
//! columns, then along the rows, then the least of the five. What the next columns need of these is kept.

use std::array::from_fn;
use std::ops::Range;

use crate::candidates::Candidates;
use crate::control::Control;
use crate::cost::{Costs, Operands};
use crate::error::Result;
use crate::memory::Memory;
use crate::plane::Plane;
use crate::settings::{LARGEST_WINDOW, Precision, Settings};
use crate::simd::{Kernel, Level};
use crate::strip::{BLOCK, Strip};
use crate::value::Value;

/// Columns of a tile: enough that what is kept between tiles is little, few enough for the caches.
/// Nanoseconds per (pixel, candidate) of 741x497 with 64 and 1920x1080 with 256 candidates, AVX2, Zen 3:
/// 8: 0.68, 0.58; 16: 0.60, 0.42; 24: 0.58, 0.40; 32: 0.58, 0.40; 48: 0.59, 0.43.
const TILE: usize = 32;
/// The next tile then has at most one window's width to come back to.
const _: () = assert!(TILE > LARGEST_WINDOW / 2);

/// Runs that are read and written side by side start so many places apart, or a multiple of it: then no load
/// looks like one of what was just stored, by the lowest bits of its address.
const PAGE: usize = 4096;

/// Candidates that are looked at together: as many answers fit into a byte.
pub const GROUP: usize = 8;

/// What is summed, and how.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Window {
    /// Rows of the image.
    pub rows: usize,
    /// Columns of the image.
    pub cols: usize,
    /// Candidates of each pixel.
    pub candidates: usize,
    /// Side of the window, odd.
    pub side: usize,
    /// Whether the best of five windows counts.
    pub shiftable: bool,
    /// The largest cost of one vote: what a pixel with no vote in its window pays per place.
    pub ceiling: u16,
    /// Lowest bits that are dropped from the sum of each column of a window.
    pub dropped: u32,
}

/// Largest sum over a window to the precision of bytes: two thirds of what a byte holds, so that it holds the
/// cost of a jump, too.
const LARGEST_BYTE_SUM: u64 = 170;

impl Window {
    /// The window of checked settings over the costs of a pair.
    pub fn new(
        (rows, cols): (usize, usize),
        candidates: usize,
        settings: &Settings,
        ceiling: u16,
    ) -> Self {
        let Settings { window: side, shiftable, .. } = *settings;
        let exact = Self { rows, cols, candidates, side, shiftable, ceiling, dropped: 0 };
        let fits = |dropped| Self { dropped, ..exact }.largest_sum() <= LARGEST_BYTE_SUM;
        match settings.precision {
            Precision::Full => exact,
            Precision::Byte => {
                Self { dropped: (0..u32::BITS).find(|bits| fits(*bits)).unwrap_or(0), ..exact }
            }
        }
    }

    /// Pixels from the window's centre to its side.
    pub fn radius(&self) -> usize {
        self.side / 2
    }

    /// Rows and columns by which a window may be shifted.
    pub fn reach(&self) -> usize {
        if self.shiftable { self.radius() } else { 0 }
    }

    /// Rows above and below its own that a strip needs.
    pub fn margin(&self) -> usize {
        self.radius() + self.reach()
    }

    /// Places in the window.
    pub fn area(&self) -> u32 {
        (self.side * self.side) as u32
    }

    /// What one unit of the mean cost comes to, of costs with so many steps to the unit.
    pub fn unit(&self, steps: u16) -> f64 {
        f64::from(self.area()) * f64::from(steps) / f64::from(1u32 << self.dropped)
    }

    /// The largest sum over one column of the window, before bits are dropped.
    pub fn largest_column(&self) -> u64 {
        self.side as u64 * u64::from(self.ceiling)
    }

    /// The largest sum over the window.
    pub fn largest_sum(&self) -> u64 {
        self.side as u64 * (self.largest_column() >> self.dropped)
    }

    /// The largest number that is met on the way to the aggregated costs.
    pub fn largest_value(&self, has_votes: bool) -> u64 {
        let votes = if has_votes { self.area().into() } else { 0 };
        self.largest_column().max(self.largest_sum()).max(votes)
    }

    /// A window without votes costs the most at each of its places; one with some, their mean.
    pub fn share(&self, sum: u64, votes: u64) -> u64 {
        match votes {
            0 => self.largest_sum(),
            // Rounded sums of a few columns may come to more than those of all.
            votes => {
                let mean = (sum * u64::from(self.area()) + votes / 2) / votes;
                mean.min(self.largest_sum())
            }
        }
    }

    /// Most columns that one step of the sweep over a strip can finish.
    fn columns_at_once(&self) -> usize {
        TILE + self.margin()
    }

    /// How the sweep over a strip goes on.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> {
        let Self { cols, .. } = *self;
        let (radius, reach) = (self.radius(), self.reach());
        let (mut summed, mut finished) = (0, 0);
        (0..cols).step_by(TILE).map(move |start| {
            let end = (start + TILE).min(cols);
            let until = |column: usize, back: usize| {
                if end == cols { cols } else { column.saturating_sub(back) }
            };
            let tile = Tile {
                entering: start..end,
                summed: summed..until(end, radius),
                finished: finished..until(until(end, radius), reach),
            };
            (summed, finished) = (tile.summed.end, tile.finished.end);
            tile
        })
    }
}

/// One step of the sweep over a strip: columns whose costs enter, those whose windows are then known, and
/// those whose five windows are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tile {
    /// Columns whose costs the step takes.
    pub entering: Range<usize>,
    summed: Range<usize>,
    /// Columns whose aggregated costs the step gives.
    pub finished: Range<usize>,
}

/// Aggregates the costs of one strip after another; its memory is used again.
#[derive(Debug, Default)]
pub struct Aggregator<V> {
    strip: Strip,
    window: Window,
    costs: BoxSums<V>,
    votes: BoxSums<V>,
    /// Sums over windows centred on the columns of a tile.
    centres: Memory<V>,
    /// The last of them that the next tile needs, of each candidate.
    kept: Memory<V>,
    /// Numbers of votes in those windows.
    counts: Memory<V>,
    /// The aggregated costs of a tile, in the order of [`Aggregated`].
    aggregated: Memory<V>,
}

/// The aggregated costs of a tile: by column, block of lanes, candidate, lane of the block.
#[derive(Debug, Clone, Copy)]
pub struct Aggregated<'a, V> {
    values: &'a [[V; BLOCK]],
    blocks: usize,
    candidates: usize,
    stride: usize,
}

/// The aggregated costs of a block of lanes in a column.
#[derive(Debug, Clone, Copy)]
pub struct AggregatedBlock<'a, V>(&'a [[V; BLOCK]]);

/// Places from one block of lanes to the next: of bytes an odd number of cache lines, so that not all of
/// them contend for the same few sets of the cache.
pub fn stride(candidates: usize) -> usize {
    2 * (candidates.div_ceil(2) | 1)
}

impl<'a, V: Value> Aggregated<'a, V> {
    /// Costs in this order, without gaps.
    pub fn new(values: &'a [[V; BLOCK]], blocks: usize, candidates: usize) -> Self {
        Self { values, blocks, candidates, stride: candidates }
    }

    /// The costs of a block of lanes in a column.
    #[inline(always)]
    pub fn of(&self, column: usize, block: usize) -> AggregatedBlock<'a, V> {
        let first = (column * self.blocks + block) * self.stride;
        AggregatedBlock(&self.values[first..][..self.candidates])
    }
}

impl<'a, V: Value> AggregatedBlock<'a, V> {
    /// Number of groups of candidates.
    #[inline(always)]
    pub fn groups(&self) -> usize {
        self.0.len().div_ceil(GROUP)
    }

    /// The costs of the candidates of a group; of the last group there may be fewer.
    #[inline(always)]
    pub fn group(&self, group: usize) -> &'a [[V; BLOCK]] {
        let first = group * GROUP;
        &self.0[first..(first + GROUP).min(self.0.len())]
    }

    /// The costs of every candidate.
    #[inline(always)]
    pub fn every(&self) -> &'a [[V; BLOCK]] {
        self.0
    }
}

impl<V: Value> Aggregator<V> {
    /// Begins a strip.
    pub fn begin(&mut self, window: Window, strip: Strip, has_votes: bool) -> Result<()> {
        (self.window, self.strip) = (window, strip);
        let (lanes, candidates, reach) = (strip.lanes(), window.candidates, window.reach());
        let most = window.columns_at_once();
        self.costs.begin(window, lanes)?;
        if has_votes {
            self.votes.begin(Window { dropped: 0, ..window }, lanes)?;
            self.counts.room(most * lanes)?;
        }
        self.centres.room((most + 3 * reach) * lanes + BLOCK)?;
        self.kept.room(candidates * 2 * reach * lanes)?;
        self.aggregated.room(most * strip.blocks() * stride(candidates) * BLOCK)
    }

    /// The aggregated costs of the tile that was swept last.
    pub fn aggregated(&self) -> Aggregated<'_, V> {
        let (values, blocks) = (self.aggregated.as_chunks().0, self.strip.blocks());
        let Window { candidates, .. } = self.window;
        Aggregated { values, blocks, candidates, stride: stride(candidates) }
    }

    #[inline(always)]
    fn sweep_candidate(&mut self, operands: &Operands, tile: &Tile, k: usize) {
        let lanes = self.strip.lanes();
        let before = 2 * self.window.reach() * lanes;
        let count = tile.summed.len() * lanes;
        operands.write_costs(tile.entering.clone(), k, self.costs.entering(tile));
        self.costs.sweep(tile, k, &mut self.centres[before..][..count]);
        if operands.has_votes() {
            self.share_among_votes(operands, tile, k);
        }
        self.repeat_edge_rows(tile);
        let kept = &mut self.kept[k * before..][..before];
        repeat_edges(
            &mut self.centres,
            kept,
            &tile.summed,
            self.window.cols,
            self.window.reach(),
            lanes,
        );
        self.write_least(tile, k);
        self.kept[k * before..][..before].copy_from_slice(&self.centres[count..][..before]);
    }

    #[inline(always)]
    fn share_among_votes(&mut self, operands: &Operands, tile: &Tile, k: usize) {
        let lanes = self.strip.lanes();
        let counts = &mut self.counts[..tile.summed.len() * lanes];
        operands.write_votes(tile.entering.clone(), k, self.votes.entering(tile));
        self.votes.sweep(tile, k, counts);
        let centres = &mut self.centres[2 * self.window.reach() * lanes..];
        for (sum, votes) in centres.iter_mut().zip(counts) {
            *sum = V::truncated(self.window.share(sum.widened(), votes.widened()));
        }
    }

    /// A window shifted above or below the image stays on its edge.
    #[inline(always)]
    fn repeat_edge_rows(&mut self, tile: &Tile) {
        let (lanes, reach) = (self.strip.lanes(), self.window.reach());
        let top = reach.saturating_sub(self.strip.first);
        let bottom = (self.strip.height - 1 + reach - self.strip.first).min(lanes - 1);
        if top == 0 && bottom == lanes - 1 {
            return;
        }
        let centres = &mut self.centres[2 * reach * lanes..][..tile.summed.len() * lanes];
        for column in centres.chunks_exact_mut(lanes) {
            let (first, last) = (column[top], column[bottom]);
            column[..top].fill(first);
            column[bottom..].fill(last);
        }
    }

    /// Writes the least of the five windows of each finished column.
    #[inline(always)]
    fn write_least(&mut self, tile: &Tile, k: usize) {
        let (lanes, reach) = (self.strip.lanes(), self.window.reach());
        let (blocks, across) = (self.strip.blocks(), reach * lanes);
        let stride = stride(self.window.candidates);
        let out = self.aggregated.as_chunks_mut::<BLOCK>().0.chunks_exact_mut(blocks * stride);
        // From the left window's lanes to the right one's.
        let span = 2 * across + lanes;
        let first = (tile.finished.start + reach - tile.summed.start) * lanes;
        let windows = self.centres[first..].windows(span).step_by(lanes.max(1));
        for (window, out) in windows.zip(out).take(tile.finished.len()) {
            let block_of = |place: usize| &window[place..].as_chunks::<BLOCK>().0[..blocks];
            let (left, right) = (block_of(reach), block_of(2 * across + reach));
            let (above, below) = (block_of(across), block_of(across + 2 * reach));
            let here = block_of(across + reach);
            for block in 0..blocks {
                out[block * stride + k] = if reach == 0 {
                    here[block]
                } else {
                    let around = [above[block], below[block], left[block], right[block]];
                    least_of_five(here[block], around)
                };
            }
        }
    }
}

/// Continues columns beyond the image by its edge: `columns` holds those of a tile behind so many kept ones.
#[inline(always)]
fn repeat_edges<V: Value>(
    columns: &mut [V],
    kept: &[V],
    new: &Range<usize>,
    cols: usize,
    reach: usize,
    lanes: usize,
) {
    let end = kept.len() + new.len() * lanes;
    if new.start > 0 {
        columns[..kept.len()].copy_from_slice(kept);
    } else if !new.is_empty() {
        let (before, first) = columns.split_at_mut(kept.len());
        before.chunks_exact_mut(lanes).for_each(|column| column.copy_from_slice(&first[..lanes]));
    }
    if new.end == cols {
        let (last, after) = columns.split_at_mut(end);
        let (last, after) = (&last[end - lanes..], &mut after[..reach * lanes]);
        after.chunks_exact_mut(lanes).for_each(|column| column.copy_from_slice(last));
    }
}

/// The costs of a tile of a strip, aggregated for every candidate.
#[derive(Debug)]
pub struct Sweep<'a, V> {
    /// Where sums are kept.
    pub aggregator: &'a mut Aggregator<V>,
    /// What is compared.
    pub operands: &'a Operands,
    /// The columns.
    pub tile: &'a Tile,
}

impl<V: Value> Kernel for Sweep<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for k in 0..self.aggregator.window.candidates {
            self.aggregator.sweep_candidate(self.operands, self.tile, k);
        }
    }
}

/// The aggregated costs of a whole volume.
pub fn aggregate(
    volume: &Plane<u16>,
    window: Window,
    level: Level,
    control: &Control,
) -> Result<Plane<u32>> {
    let Window { rows, cols, candidates, .. } = window;
    let costs =
        Costs::of_volume(volume, Candidates::new(0, candidates as i64, cols.max(candidates))?);
    let mut aggregated = Plane::new(rows, cols * candidates)?;
    let (mut operands, mut aggregator) = (Operands::default(), Aggregator::<u32>::default());
    for first in (0..rows).step_by(BLOCK) {
        let rows = BLOCK.min(rows - first);
        let strip = Strip { first, rows, margin: window.margin(), height: window.rows };
        operands.load(&costs, &strip)?;
        aggregator.begin(window, strip, false)?;
        for tile in window.tiles() {
            control.checkpoint()?;
            level.run(Sweep { aggregator: &mut aggregator, operands: &operands, tile: &tile });
            for (place, x) in tile.finished.clone().enumerate() {
                for (k, sums) in aggregator.aggregated().of(place, 0).every().iter().enumerate() {
                    for (y, sum) in strip.range().zip(sums) {
                        aggregated.row_mut(y)[x * candidates + k] = *sum;
                    }
                }
            }
        }
    }
    Ok(aggregated)
}

#[inline(always)]
fn least_of_five<V: Value>(here: [V; BLOCK], [a, b, c, d]: [[V; BLOCK]; 4]) -> [V; BLOCK] {
    from_fn(|i| here[i].min(a[i].min(b[i])).min(c[i].min(d[i])))
}

/// Sums over whole windows, of one tile after another.
#[derive(Debug, Default)]
struct BoxSums<V> {
    window: Window,
    lanes: usize,
    /// Four runs of columns: what enters; two of sums on the way; sums down whole columns of the window,
    /// behind those of the tile before.
    runs: Memory<V>,
    /// Places from one run to the next.
    run: usize,
    /// Sums down the columns to be kept for the next tile, of each candidate.
    kept: Memory<V>,
    /// The steps from one value to a side of the window.
    parts: Vec<Part>,
}

impl<V: Value> BoxSums<V> {
    fn begin(&mut self, window: Window, lanes: usize) -> Result<()> {
        (self.window, self.lanes) = (window, lanes);
        self.parts = Part::up_to(window.side).collect();
        let columns = TILE + 2 * window.side;
        // Sums down the columns reach beyond the last lane of the last column.
        self.run = (columns * lanes + window.side).next_multiple_of(PAGE);
        self.runs.room(4 * self.run)?;
        self.kept.room(window.candidates * (window.side - 1) * lanes)
    }

    /// Where the values of the columns that enter are to be written.
    #[inline(always)]
    fn entering(&mut self, tile: &Tile) -> &mut [V] {
        &mut self.runs[..tile.entering.len() * self.lanes]
    }

    /// Writes the sums over the windows centred on the columns `tile.summed`.
    #[inline(always)]
    fn sweep(&mut self, tile: &Tile, k: usize, sums: &mut [V]) {
        let (lanes, Window { side, dropped, .. }) = (self.lanes, self.window);
        let (entering, runs) = self.runs.split_at_mut(self.run);
        let (spare, runs) = runs.split_at_mut(self.run);
        let (more, columns) = runs.split_at_mut(self.run);
        let before = (side - 1) * lanes;
        let count = tile.entering.len() * lanes;
        sum_runs(entering, [spare, more], &self.parts, 1, dropped, &mut columns[before..][..count]);
        let kept = &mut self.kept[k * before..][..before];
        repeat_edges(columns, kept, &tile.entering, self.window.cols, side / 2, lanes);
        let first = (tile.summed.start + side / 2 - tile.entering.start) * lanes;
        sum_runs(&columns[first..], [spare, more], &self.parts, lanes, 0, sums);
        kept.copy_from_slice(&columns[count..][..before]);
    }
}

/// Sums of values that lie `step` apart, in `parts`, without the lowest bits; `spare` is for sums on the way.
#[inline(always)]
fn sum_runs<V: Value>(
    values: &[V],
    spare: [&mut [V]; 2],
    parts: &[Part],
    step: usize,
    dropped: u32,
    sums: &mut [V],
) {
    let [mut now, mut next] = spare;
    let side = parts.last().map_or(1, |part| part.sum);
    if side == 1 {
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum = value.shifted(dropped));
    }
    for part in parts {
        let source = if part.added == 1 { values } else { &*now };
        if part.sum == side {
            part.add(source, values, step, dropped, sums);
        } else {
            // What is still to be added to reaches beyond the last sum.
            let count = sums.len() + (side - part.sum) * step;
            part.add(source, values, step, 0, &mut next[..count]);
            std::mem::swap(&mut now, &mut next);
        }
    }
}

/// A step from sums of some values to sums of twice or thrice as many, or of one more than twice.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Part {
    added: usize,
    sum: usize,
}

impl Part {
    /// The steps from one value to `side` of them: thrice as many where that divides it.
    fn up_to(side: usize) -> impl Iterator<Item = Self> {
        let mut steps = [Self::default(); 8];
        let (mut sum, mut first) = (side, steps.len());
        while sum > 1 {
            let added = if sum.is_multiple_of(3) { sum / 3 } else { sum / 2 };
            first -= 1;
            steps[first] = Self { added, sum };
            sum = added;
        }
        steps.into_iter().skip(first)
    }

    /// Adds sums of `added` values, and where one more is needed that one; then drops the lowest bits.
    #[inline(always)]
    fn add<V: Value>(self, sums: &[V], values: &[V], step: usize, dropped: u32, out: &mut [V]) {
        let (second, third) = (&sums[self.added * step..], 2 * self.added * step);
        match (self.sum - 2 * self.added, dropped) {
            // Never the last step: sides are odd.
            (0, _) => add_two(sums, second, out),
            (1, 0) => add_three(sums, second, &values[third..], out),
            (1, _) => add_three_and_drop(sums, second, &values[third..], dropped, out),
            (_, 0) => add_three(sums, second, &sums[third..], out),
            (_, _) => add_three_and_drop(sums, second, &sums[third..], dropped, out),
        }
    }
}

#[inline(always)]
fn add_two<V: Value>(a: &[V], b: &[V], out: &mut [V]) {
    let n = out.len();
    let (a, b) = (&a[..n], &b[..n]);
    for i in 0..n {
        out[i] = a[i].plus(b[i]);
    }
}

#[inline(always)]
fn add_three<V: Value>(a: &[V], b: &[V], c: &[V], out: &mut [V]) {
    let n = out.len();
    let (a, b, c) = (&a[..n], &b[..n], &c[..n]);
    for i in 0..n {
        out[i] = a[i].plus(b[i]).plus(c[i]);
    }
}

#[inline(always)]
fn add_three_and_drop<V: Value>(a: &[V], b: &[V], c: &[V], dropped: u32, out: &mut [V]) {
    let n = out.len();
    let (a, b, c) = (&a[..n], &b[..n], &c[..n]);
    for i in 0..n {
        out[i] = a[i].plus(b[i]).plus(c[i]).shifted(dropped);
    }
}

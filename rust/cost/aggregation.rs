//! Costs -> sums over a window, of which the best of five counts (paper, section 2.3).
//!
//! A block of columns is gone through from the top down, all candidates of a pixel in neighboring lanes. The sums of
//! each column over the rows of the window go on from row to row, those over its columns from pixel to pixel:
//!
//! ```text
//! for y in rows:
//!     column[x][k] += cost[y + r][x][k] - cost[y - r - 1][x][k]              # a ring of 2 r + 2 rows of costs
//!     for x in columns:
//!         sum[k]   += (column[x + r][k] >> n) - (column[x - r - 1][k] >> n)    # n bits are dropped
//!         aggregated[y][x][k] = sum[k]
//! ```
//!
//! Beyond the image rows and columns repeat its edge. Shiftable windows look at the sums of five places, so there a ring
//! of rows of sums is kept as well. Where votes are missing their number is summed alike, and the mean of those that
//! are there counts.

use std::ops::Range;

use rayon::prelude::*;

use crate::cost::candidates::Candidates;
use crate::cost::{Costs, steps_of};
use crate::error::Result;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;
use crate::pipeline::memory::Memory;
use crate::settings::{Precision, Settings};
use crate::simd::{Level, Loop};
use crate::value::{LANES, Lanes, Value};

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
/// cost of a jump, too; where it does not, but would with one bit less, that is dropped as well.
const LARGEST_BYTE_SUM: u64 = 170;

/// Least sum over a window for which one bit more is dropped: with fewer steps costs would be too coarse.
const LEAST_BYTE_SUM: u64 = 80;

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
        let coarser = |dropped| Self { dropped, ..exact };
        match settings.precision {
            Precision::Full => exact,
            Precision::Byte => {
                let is_small = |bits: &u32| coarser(*bits).largest_sum() <= LARGEST_BYTE_SUM;
                let least = (0..u32::BITS).find(is_small).unwrap_or(0);
                let fits = |bits: &u32| {
                    let window = coarser(*bits);
                    let p2 = settings.p2 * window.unit(steps_of(settings.cost));
                    window.largest_sum() >= LEAST_BYTE_SUM
                        && window.largest_sum() as f64 + p2.round() <= f64::from(u8::MAX)
                };
                coarser([least, least + 1].into_iter().find(fits).unwrap_or(least))
            }
        }
    }

    /// Pixels from the window's center to its side.
    pub fn radius(&self) -> usize {
        self.side / 2
    }

    /// Rows and columns by which a window may be shifted.
    pub fn reach(&self) -> usize {
        if self.shiftable { self.radius() } else { 0 }
    }

    /// Rows and columns around a pixel whose costs count.
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
}

/// Pixels whose costs are aggregated together.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PixelBlock {
    /// Rows of the images.
    pub rows: Range<usize>,
    /// Columns of the left image.
    pub columns: Range<usize>,
}

/// Aggregates the costs of one block after another; its memory is used again.
#[derive(Debug, Default)]
pub struct Aggregator<V> {
    costs: BoxSums<V>,
    votes: BoxSums<V>,
    /// Sums over windows of as many rows as they may be shifted by.
    boxes: Memory<Lanes<V>>,
    /// Numbers of votes in the windows of a row.
    counts: Memory<Lanes<V>>,
}

impl<V: Value> Aggregator<V> {
    /// Writes the aggregated costs of a block, row by row, column by column, all candidates of one pixel after another;
    /// [`Value::FAR`] beyond the last of these.
    pub fn aggregate(
        &mut self,
        costs: &Costs,
        window: Window,
        block: PixelBlock,
        level: Level,
        out: &mut [Lanes<V>],
    ) -> Result<()> {
        let chunks = costs.chunks();
        let around = window.reach().min(1) * (block.columns.len() + 2 * window.reach());
        self.boxes.resize(around * window.side * chunks)?;
        self.costs.begin(window, &block.columns, chunks)?;
        if costs.has_votes() {
            self.votes.begin(Window { dropped: 0, ..window }, &block.columns, chunks)?;
            self.counts.resize((block.columns.len() + 2 * window.reach()) * chunks)?;
        }
        level.run(Aggregate { aggregator: self, costs, window, block, out });
        Ok(())
    }

    /// Writes the sums over centered windows of some columns of a row.
    #[inline(always)]
    fn write_boxes(
        sums: (&mut BoxSums<V>, &mut BoxSums<V>, &mut [Lanes<V>]),
        costs: &Costs,
        window: Window,
        (y, columns): (usize, Range<usize>),
        out: &mut [Lanes<V>],
    ) {
        let (of_costs, of_votes, counts) = sums;
        of_costs.center_on(y, Summed::Costs, costs);
        of_costs.write_row(columns.clone(), out);
        if costs.has_votes() {
            of_votes.center_on(y, Summed::Votes, costs);
            let counts = &mut counts[..out.len()];
            of_votes.write_row(columns, counts);
            for (sum, votes) in out.as_flattened_mut().iter_mut().zip(counts.as_flattened()) {
                *sum = V::truncated(window.share(sum.widened(), votes.widened()));
            }
        }
    }
}

/// The kernel of [`Aggregator::aggregate`].
struct Aggregate<'a, V> {
    aggregator: &'a mut Aggregator<V>,
    costs: &'a Costs<'a>,
    window: Window,
    block: PixelBlock,
    out: &'a mut [Lanes<V>],
}

impl<V: Value> Aggregate<'_, V> {
    /// One centered window for each pixel.
    #[inline(always)]
    fn centered(self) {
        let Self { aggregator, costs, window, block, out } = self;
        let Aggregator { costs: of_costs, votes, counts, .. } = aggregator;
        let width = block.columns.len() * costs.chunks();
        for (y, out) in block.rows.zip(out.chunks_exact_mut(width)) {
            let place = (y, block.columns.clone());
            Aggregator::write_boxes((of_costs, votes, counts), costs, window, place, out);
            fill_up(out, window.candidates);
        }
    }

    /// The best of five windows: sums of each row are kept until no window is shifted to it any more.
    #[inline(always)]
    fn shifted(self) {
        let Self { aggregator, costs, window, block, out } = self;
        let Aggregator { costs: of_costs, votes, boxes, counts } = aggregator;
        let (chunks, reach, PixelBlock { rows, columns }) = (costs.chunks(), window.reach(), block);
        let around = columns.start.saturating_sub(reach)..(columns.end + reach).min(window.cols);
        let width = around.len() * chunks;
        let last = window.rows - 1;
        let mut next = rows.start.saturating_sub(reach);
        for (y, out) in rows.zip(out.chunks_exact_mut(columns.len() * chunks)) {
            while next <= (y + reach).min(last) {
                let row = &mut boxes[next % window.side * width..][..width];
                let place = (next, around.clone());
                Aggregator::write_boxes((of_costs, votes, counts), costs, window, place, row);
                next += 1;
            }
            let row = |y: usize| &boxes[y % window.side * width..][..width];
            let (above, below) = (row(y.saturating_sub(reach)), row((y + reach).min(last)));
            for (x, out) in columns.clone().zip(out.chunks_exact_mut(chunks)) {
                let places = [x.saturating_sub(reach), (x + reach).min(window.cols - 1)];
                let [left, right] = places.map(|x| &row(y)[(x - around.start) * chunks..]);
                let place = (x - around.start) * chunks;
                let beside = [left, right, &above[place..], &below[place..]];
                let beside = beside.map(|sums| &sums[..chunks]);
                for (run, out) in out.iter_mut().enumerate() {
                    let mut best = row(y)[place + run];
                    for sums in beside {
                        for j in 0..LANES {
                            best[j] = best[j].min(sums[run][j]);
                        }
                    }
                    *out = best;
                }
            }
            fill_up(out, window.candidates);
        }
    }
}

impl<V: Value> Loop for Aggregate<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        if self.window.reach() == 0 { self.centered() } else { self.shifted() }
    }
}

/// Puts those candidates out of reach that only fill up the lanes.
#[inline(always)]
fn fill_up<V: Value>(costs: &mut [Lanes<V>], candidates: usize) {
    let used = candidates % LANES;
    if used > 0 {
        let chunks = candidates.div_ceil(LANES);
        for last in costs.iter_mut().skip(chunks - 1).step_by(chunks) {
            last[used..].fill(V::FAR);
        }
    }
}

/// What is summed over windows.
#[derive(Debug, Clone, Copy)]
enum Summed {
    Costs,
    Votes,
}

impl Summed {
    /// Writes what is summed of some columns of a row.
    #[inline(always)]
    fn write<V: Value>(self, costs: &Costs, y: usize, columns: Range<usize>, out: &mut [Lanes<V>]) {
        match self {
            Self::Costs => costs.write(y, columns, out),
            Self::Votes => costs.write_votes(y, columns, out),
        }
    }
}

/// Sums over a window that moves down a block of columns.
#[derive(Debug, Default)]
struct BoxSums<V> {
    window: Window,
    chunks: usize,
    /// The columns whose costs count, within the image.
    around: Range<usize>,
    /// The row on which the window is centered.
    center: Option<usize>,
    /// Costs of the rows of the window and of the one that has left it.
    rows: Memory<Lanes<V>>,
    /// Their sums over the rows of the window, for each column.
    columns: Memory<Lanes<V>>,
}

impl<V: Value> BoxSums<V> {
    fn begin(&mut self, window: Window, columns: &Range<usize>, chunks: usize) -> Result<()> {
        let margin = window.margin();
        self.around = columns.start.saturating_sub(margin)..(columns.end + margin).min(window.cols);
        (self.window, self.chunks, self.center) = (window, chunks, None);
        let width = self.around.len() * chunks;
        self.rows.resize((window.side + 1) * width)?;
        self.columns.resize(width)
    }

    /// Moves the window to a row, the next one unless it is the first.
    #[inline(always)]
    fn center_on(&mut self, y: usize, summed: Summed, costs: &Costs) {
        let (radius, side, width) = (self.window.radius(), self.window.side, self.columns.len());
        let last = self.window.rows - 1;
        // Rows lie in the ring by their places from `radius` rows above the image on.
        let slot = |place: usize| place % (side + 1) * width;
        let row = |place: usize| place.saturating_sub(radius).min(last);
        if self.center.replace(y).is_some() {
            let (entering, leaving) = (slot(y + 2 * radius), slot(y + 2 * radius + 1));
            let entered = &mut self.rows[entering..][..width];
            summed.write(costs, row(y + 2 * radius), self.around.clone(), entered);
            let entering = &self.rows[entering..][..width];
            let leaving = &self.rows[leaving..][..width];
            for ((sum, new), old) in self.columns.iter_mut().zip(entering).zip(leaving) {
                for j in 0..LANES {
                    sum[j] = sum[j].minus(old[j]).plus(new[j]);
                }
            }
            return;
        }
        self.columns.fill([V::default(); LANES]);
        for place in y..=y + 2 * radius {
            let here = &mut self.rows[slot(place)..][..width];
            summed.write(costs, row(place), self.around.clone(), here);
            for (sum, new) in self.columns.iter_mut().zip(here) {
                for j in 0..LANES {
                    sum[j] = sum[j].plus(new[j]);
                }
            }
        }
    }

    /// Writes the sums over the window about some columns, without the lowest bits of each column's.
    #[inline(always)]
    fn write_row(&self, columns: Range<usize>, out: &mut [Lanes<V>]) {
        let (radius, chunks, dropped) = (self.window.radius(), self.chunks, self.window.dropped);
        // Places, from `radius` columns left of the image on, of the column that it shows there; what would enter after
        // the last sum is not at hand and not needed.
        let (last, first) = (self.around.end - 1, self.around.start);
        let column = |place: usize| (place.saturating_sub(radius).min(last) - first) * chunks;
        for chunk in 0..chunks {
            let mut sum = [V::default(); LANES];
            for place in columns.start..=columns.start + 2 * radius {
                sum = added(sum, shifted(self.columns[column(place) + chunk], dropped));
            }
            for (x, out) in columns.clone().zip(out.iter_mut().skip(chunk).step_by(chunks)) {
                *out = sum;
                let leaving = shifted(self.columns[column(x) + chunk], dropped);
                let entering = shifted(self.columns[column(x + 1 + 2 * radius) + chunk], dropped);
                sum = added(subtracted(sum, leaving), entering);
            }
        }
    }
}

#[inline(always)]
fn shifted<V: Value>(mut values: Lanes<V>, bits: u32) -> Lanes<V> {
    for value in &mut values {
        *value = value.shifted(bits);
    }
    values
}

#[inline(always)]
fn added<V: Value>(mut values: Lanes<V>, others: Lanes<V>) -> Lanes<V> {
    for j in 0..LANES {
        values[j] = values[j].plus(others[j]);
    }
    values
}

#[inline(always)]
fn subtracted<V: Value>(mut values: Lanes<V>, others: Lanes<V>) -> Lanes<V> {
    for j in 0..LANES {
        values[j] = values[j].minus(others[j]);
    }
    values
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
    let blocks = aggregated.as_mut_slice().par_chunks_mut(ROWS * cols * candidates).enumerate();
    blocks.try_for_each(|(index, aggregated)| {
        control.checkpoint()?;
        let (mut aggregator, mut lanes) = (Aggregator::<u32>::default(), Memory::default());
        let rows = index * ROWS..((index + 1) * ROWS).min(rows);
        lanes.resize(rows.len() * cols * costs.chunks())?;
        aggregator.aggregate(
            &costs,
            window,
            PixelBlock { rows, columns: 0..cols },
            level,
            &mut lanes,
        )?;
        let pixels = lanes.as_flattened().chunks_exact(costs.chunks() * LANES);
        for (aggregated, lanes) in aggregated.chunks_exact_mut(candidates).zip(pixels) {
            aggregated.copy_from_slice(&lanes[..candidates]);
        }
        Ok(())
    })?;
    Ok(aggregated)
}

/// Rows of a volume that are aggregated together.
const ROWS: usize = 32;

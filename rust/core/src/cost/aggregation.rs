//! Costs -> sums over a window; of shiftable windows the least of five sums (paper, section 2.3).
//!
//! A block of columns is worked through from the top down, all candidates of a pixel in neighboring lanes. The sums of
//! each column over the rows of the window are updated from row to row, those over its columns from pixel to pixel:
//!
//! ```text
//! for y in rows:
//!     column[x][k] += cost[y + r][x][k] - cost[y - r - 1][x][k]      # a ring of 2 r + 2 rows of costs
//!     summand[x][k] = column[x][k] >> n                              # n bits are dropped
//!     for x in columns:
//!         sum[k]   += summand[x + r][k] - summand[x - r - 1][k]
//!         aggregated[y][x][k] = sum[k]
//! ```
//!
//! Beyond the image its edge rows and columns are repeated. A shiftable window takes the least of the sums at five
//! places, so a ring of rows of sums is kept as well. Under masks the valid pixels of each window are counted by the same
//! sums, and the mean of their costs stands for the whole window:
//!
//! ```text
//! aggregated[y][x][k] = sum[k] area / count[k], rounded, halves up
//! ```
//!
//! Most masks leave most pixels and all of their candidates valid. Only near the columns of a block where they do not,
//! counts are taken; elsewhere they would be the area of the window, and the mean times the area the sum itself.

use std::ops::Range;

use rayon::prelude::*;

use crate::cost::candidates::{Candidates, Searched};
use crate::cost::validity::Validity;
use crate::cost::{Costs, steps_of};
use crate::error::Result;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;
use crate::pipeline::memory::RunMemory;
use crate::settings::{Precision, Settings};
use crate::simd::{Level, Loop};
use crate::value::{LANES, Lanes, Value, nearest};

/// The window that costs are summed over, and the precision of the sums.
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
    /// Whether the least of five sums counts.
    pub shiftable: bool,
    /// The largest cost of one pixel: what each place of a window without a valid pixel costs.
    pub ceiling: u16,
    /// Lowest bits that are dropped from the sum of each column of a window.
    pub dropped: u32,
}

/// Largest sum over a window at byte precision: two thirds of a byte, so that P2 fits as well. Where P2 does not fit but
/// would with one bit less, that bit is dropped, too.
const LARGEST_BYTE_SUM: u64 = 170;

/// Least sum for which one further bit is dropped: below it costs would be too coarse.
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
    pub fn largest_shift(&self) -> usize {
        if self.shiftable { self.radius() } else { 0 }
    }

    /// Rows and columns around a pixel whose costs its sum depends on.
    pub fn halo(&self) -> usize {
        self.radius() + self.largest_shift()
    }

    /// Places in the window.
    pub fn area(&self) -> u32 {
        (self.side * self.side) as u32
    }

    /// One unit of the mean cost in steps of the sums, where a cost has `steps` steps to the unit.
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

    /// The largest number that aggregation computes.
    pub fn largest_value(&self, has_masks: bool) -> u64 {
        let support = if has_masks { self.area().into() } else { 0 };
        self.largest_column().max(self.largest_sum()).max(support)
    }

    /// Replaces sums by those over the whole window, from the numbers of valid pixels in it; without any, by the largest
    /// there is.
    #[inline(always)]
    fn scale<V: Value>(&self, counts: &[Lanes<V>], sums: &mut [Lanes<V>]) {
        let area = f64::from(self.area());
        let largest = self.largest_sum() as f64;
        // The mean rounded, halves up: fractions are multiples of 1 / count, so the next ones below a half stay below it.
        let tie = 0.25 / area;

        // The loops have no closures, which might not be inlined, and so not be compiled for the level. Bits are dropped from
        // the sum of each column, so the mean of a few may exceed the largest sum; without valid pixels it is NaN, which is
        // not less than that.
        let (sums, counts) = (sums.as_flattened_mut(), counts.as_flattened());
        if largest * area < f64::from(1 << 20) {
            // Registers have more lanes of single precision, whose roundings are less than `tie` here.
            let (area, largest, tie) = (area as f32, largest as f32, tie as f32);
            for (sum, count) in sums.iter_mut().zip(counts) {
                let mean = sum.widened() as i32 as f32 * area / count.widened() as i32 as f32;
                let least = if mean < largest { mean } else { largest };
                *sum = V::truncated(nearest_below_2_22(least + tie).into());
            }
        } else {
            for (sum, count) in sums.iter_mut().zip(counts) {
                let mean =
                    f64::from(sum.widened() as i32) * area / f64::from(count.widened() as i32);
                let least = if mean < largest { mean } else { largest };
                *sum = V::truncated(nearest(least + tie) as u64);
            }
        }
    }
}

/// The nearest integer of a number from 0 to `2^22`, as [`nearest`] finds it in double precision.
#[inline(always)]
fn nearest_below_2_22(value: f32) -> u32 {
    (value + 1.5 * (1u32 << 23) as f32).to_bits() & ((1 << 22) - 1)
}

/// Pixels whose costs are aggregated together.
///
/// Their values lie in strips of columns, one strip after another, and in each strip row by row: see [`Self::place`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PixelBlock {
    /// Rows of the images.
    pub rows: Range<usize>,
    /// Columns of the left image.
    pub columns: Range<usize>,
    /// Columns of a strip.
    pub strip: usize,
}

impl PixelBlock {
    /// Pixels that the block has places for: its last strip is as long as the others, however many columns it has.
    pub fn places(&self) -> usize {
        self.rows.len() * self.columns.len().next_multiple_of(self.strip)
    }

    /// The place of the first pixel of row `row` of a strip; those of the row follow.
    #[inline(always)]
    pub fn place(&self, strip: usize, row: usize) -> usize {
        (strip * self.rows.len() + row) * self.strip
    }

    /// The columns of every strip.
    #[inline(always)]
    pub fn strips(
        &self,
    ) -> impl ExactSizeIterator<Item = Range<usize>> + DoubleEndedIterator + use<> {
        let Self { columns: Range { start, end }, strip, .. } = *self;
        (0..(end - start).div_ceil(strip)).map(move |index| {
            let first = start + index * strip;
            first..(first + strip).min(end)
        })
    }
}

/// Aggregates block after block; its buffers are reused.
#[derive(Debug, Default)]
pub struct Aggregator<V> {
    /// Sums of the costs.
    costs: BoxSums<V>,
    /// Numbers of valid pixels, by stretches of columns in whose windows there are invalid ones ...
    validity: Vec<BoxSums<V>>,
    /// ... and these stretches.
    stretches: Vec<Range<usize>>,
    /// A ring of rows of sums, for shiftable windows: as many rows as a window has.
    boxes: RunMemory<V>,
    /// Numbers of valid pixels in the windows of a row.
    counts: RunMemory<V>,
}

impl<V: Value> Aggregator<V> {
    /// Writes the aggregated costs of a block into its places, the searched candidates of a pixel in neighboring lanes, and
    /// [`Value::FAR`] beyond the last one.
    pub fn aggregate(
        &mut self,
        costs: &Costs,
        window: Window,
        (block, searched): (PixelBlock, Searched),
        level: Level,
        out: &mut [Lanes<V>],
    ) -> Result<()> {
        let runs = searched.runs();
        let shift = window.largest_shift();
        let around = block.columns.len() + 2 * shift;
        // Fixed windows need no ring.
        let ring = if shift > 0 { window.side } else { 0 };
        self.boxes.resize(around * ring * runs)?;
        self.costs.begin(window, &block.columns, searched)?;

        self.stretches.clear();
        if let Some(validity) = costs.validity() {
            self.find_stretches(validity, window, &block);
            self.counts.resize(around * runs)?;
        }

        // Windows are counted where they are, and the shifted ones take the sums.
        let counted = Window { dropped: 0, shiftable: false, ..window };
        self.validity.resize_with(self.stretches.len().max(self.validity.len()), BoxSums::default);
        for (counts, columns) in self.validity.iter_mut().zip(&self.stretches) {
            counts.begin(counted, columns, searched)?;
        }

        level.run(Aggregate { aggregator: self, costs, window, block, out });
        Ok(())
    }

    /// Finds the columns around a block whose windows have an invalid pixel, or one of an invalid candidate, in some row.
    fn find_stretches(&mut self, validity: &Validity, window: Window, block: &PixelBlock) {
        let widened = |range: &Range<usize>, by: usize, end: usize| {
            range.start.saturating_sub(by)..(range.end + by).min(end)
        };
        let radius = window.radius();
        let around = widened(&block.columns, window.largest_shift(), window.cols);
        let seen = widened(&around, radius, window.cols);

        let mut is_whole = vec![true; seen.len()];
        for y in widened(&block.rows, window.halo(), window.rows) {
            let row = &validity.whole(y)[seen.clone()];
            is_whole.iter_mut().zip(row).for_each(|(all, whole)| *all &= whole);
        }

        for (x, _) in seen.zip(is_whole).filter(|(_, is_whole)| !is_whole) {
            let near = widened(&(x..x + 1), radius, around.end);
            let near = near.start.max(around.start)..near.end;
            match self.stretches.last_mut() {
                // Two stretches with little between them are one.
                Some(last) if near.start <= last.end + window.side => last.end = near.end,
                _ => self.stretches.push(near),
            }
        }
    }

    /// Moves the windows to a row.
    #[inline(always)]
    fn center_on(sums: (&mut BoxSums<V>, &mut [BoxSums<V>]), costs: &Costs, y: usize) {
        let (of_costs, of_validity) = sums;

        of_costs.center_on(y, Summed::Costs, costs);
        for counts in of_validity {
            counts.center_on(y, Summed::Validity, costs);
        }
    }

    /// Writes the sums over the windows of some columns of the row, scaled to the valid pixels where there are others.
    #[inline(always)]
    fn write_boxes(
        (of_costs, stretches): (&BoxSums<V>, &[Range<usize>]),
        (of_validity, counts): (&[BoxSums<V>], &mut [Lanes<V>]),
        columns: Range<usize>,
        out: &mut [Lanes<V>],
    ) {
        let runs = of_costs.searched.runs();
        of_costs.write_row(columns.clone(), out);

        for (stretch, validity) in stretches.iter().zip(of_validity) {
            let here = stretch.start.max(columns.start)..stretch.end.min(columns.end);
            if here.is_empty() {
                continue;
            }

            let counts = &mut counts[..here.len() * runs];
            let sums = &mut out[(here.start - columns.start) * runs..][..counts.len()];
            validity.write_row(here, counts);
            of_costs.window.scale(counts, sums);
        }
    }
}

/// The loop of [`Aggregator::aggregate`].
struct Aggregate<'a, V> {
    aggregator: &'a mut Aggregator<V>,
    costs: &'a Costs<'a>,
    window: Window,
    block: PixelBlock,
    out: &'a mut [Lanes<V>],
}

impl<V: Value> Aggregate<'_, V> {
    /// Writes the sum over the centered window of each pixel.
    #[inline(always)]
    fn centered(self) {
        let Self { aggregator, costs, block, out, .. } = self;
        let Aggregator { costs: of_costs, validity, stretches, counts, .. } = aggregator;
        let validity = &mut validity[..stretches.len()];
        let searched = of_costs.searched;
        let runs = searched.runs();

        for (row, y) in block.rows.clone().enumerate() {
            Aggregator::center_on((of_costs, validity), costs, y);

            for (strip, columns) in block.strips().enumerate() {
                let out = &mut out[block.place(strip, row) * runs..][..columns.len() * runs];
                let sums = (&*of_costs, &stretches[..]);
                Aggregator::write_boxes(sums, (validity, counts), columns, out);
                pad(out, searched.count);
            }
        }
    }

    /// Writes the least sum of the five windows of each pixel. Each row's sums stay in the ring as long as a window is
    /// shifted to them.
    #[inline(always)]
    fn shifted(self) {
        let Self { aggregator, costs, window, block, out } = self;
        let Aggregator { costs: of_costs, validity, stretches, boxes, counts } = aggregator;
        let validity = &mut validity[..stretches.len()];
        let PixelBlock { rows, columns, .. } = &block;
        let searched = of_costs.searched;
        let runs = searched.runs();
        let shift = window.largest_shift();
        let around = columns.start.saturating_sub(shift)..(columns.end + shift).min(window.cols);
        let width = around.len() * runs;
        let last = window.rows - 1;
        let mut next = rows.start.saturating_sub(shift);

        for (row, y) in rows.clone().enumerate() {
            // Each row is summed once, when the first window is shifted to it.
            while next <= (y + shift).min(last) {
                let boxes = &mut boxes[next % window.side * width..][..width];
                Aggregator::center_on((of_costs, validity), costs, next);
                let sums = (&*of_costs, &stretches[..]);
                Aggregator::write_boxes(sums, (validity, counts), around.clone(), boxes);
                next += 1;
            }

            let shifted_to = |y: usize| &boxes[y % window.side * width..][..width];
            let rows = [y, y.saturating_sub(shift), (y + shift).min(last)].map(shifted_to);

            for (strip, columns) in block.strips().enumerate() {
                let out = &mut out[block.place(strip, row) * runs..][..columns.len() * runs];
                let places = (columns, around.start, window);
                write_least(rows, places, runs, out);
                pad(out, searched.count);
            }
        }
    }
}

/// Writes the least of the sums at five places for some columns: here, above, below, left and right. The rows of sums begin
/// with column `first`.
#[inline(always)]
fn write_least<V: Value>(
    [here, above, below]: [&[Lanes<V>]; 3],
    (columns, first, window): (Range<usize>, usize, Window),
    runs: usize,
    out: &mut [Lanes<V>],
) {
    let shift = window.largest_shift();

    for (x, out) in columns.zip(out.chunks_exact_mut(runs)) {
        let left = (x.saturating_sub(shift) - first) * runs;
        let right = ((x + shift).min(window.cols - 1) - first) * runs;
        let place = (x - first) * runs;
        let others = [&here[left..], &here[right..], &above[place..], &below[place..]];

        for (run, out) in out.iter_mut().enumerate() {
            let mut best = here[place + run];
            for sums in others {
                for j in 0..LANES {
                    best[j] = best[j].min(sums[run][j]);
                }
            }
            *out = best;
        }
    }
}

impl<V: Value> Loop for Aggregate<'_, V> {
    type Output = ();
    const COUNTS_BITS: bool = true;

    #[inline(always)]
    fn run(self) {
        if self.window.largest_shift() == 0 { self.centered() } else { self.shifted() }
    }
}

/// Pads the last run of every pixel with [`Value::FAR`], which never wins.
#[inline(always)]
fn pad<V: Value>(costs: &mut [Lanes<V>], candidates: usize) {
    let used = candidates % LANES;
    if used > 0 {
        let runs = candidates.div_ceil(LANES);
        for last in costs.iter_mut().skip(runs - 1).step_by(runs) {
            last[used..].fill(V::FAR);
        }
    }
}

/// What is summed over windows: costs, or 1 where they are valid.
#[derive(Debug, Clone, Copy)]
enum Summed {
    Costs,
    Validity,
}

impl Summed {
    /// Writes the summands of some columns of a row.
    #[inline(always)]
    fn write<V: Value>(
        self,
        costs: &Costs,
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut [Lanes<V>],
    ) {
        match self {
            Self::Costs => costs.write(y, columns, searched, out),
            Self::Validity => costs.write_validity(y, columns, searched, out),
        }
    }
}

/// Sums over a window that moves down a block of columns, row by row.
#[derive(Debug, Default)]
struct BoxSums<V> {
    window: Window,
    searched: Searched,
    /// The columns of the block and its halo, within the image.
    around: Range<usize>,
    /// How many columns of the halo lie beyond the image, on the left.
    beyond: usize,
    /// The row on which the window is centered.
    center: Option<usize>,
    /// Costs of the rows of the window and of the one that has just left it: a ring.
    rows: RunMemory<V>,
    /// Their sums over the rows of the window, for each column.
    columns: RunMemory<V>,
    /// These sums without their lowest bits. Beyond the image its edge columns are repeated, so the halo is complete.
    summands: RunMemory<V>,
}

impl<V: Value> BoxSums<V> {
    /// Sizes the buffers for some columns, before the first row.
    fn begin(&mut self, window: Window, columns: &Range<usize>, searched: Searched) -> Result<()> {
        let runs = searched.runs();
        let halo = window.halo();
        self.around = columns.start.saturating_sub(halo)..(columns.end + halo).min(window.cols);
        self.beyond = halo.saturating_sub(columns.start);
        self.window = window;
        self.searched = searched;
        self.center = None;

        let width = self.around.len() * runs;
        self.rows.resize((window.side + 1) * width)?;
        self.columns.resize(width)?;
        self.summands.resize((columns.len() + 2 * halo) * runs)
    }

    /// Moves the window to row `y`: the next one, or any if it is the first.
    #[inline(always)]
    fn center_on(&mut self, y: usize, summed: Summed, costs: &Costs) {
        let radius = self.window.radius();
        let side = self.window.side;
        let width = self.columns.len();
        let last = self.window.rows - 1;
        // Places count rows from `radius` rows above the image on; beyond the image its edge is repeated.
        let slot = |place: usize| place % (side + 1) * width;
        let row = |place: usize| place.saturating_sub(radius).min(last);

        let mut entering = y + 2 * radius..y + 2 * radius + 1;
        if self.center.replace(y).is_none() {
            // Before the first row the window is empty, and all of its rows enter.
            entering.start = y;
            self.rows.fill([V::default(); LANES]);
            self.columns.fill([V::default(); LANES]);
        }

        for place in entering {
            let entered = &mut self.rows[slot(place)..][..width];
            summed.write(costs, (row(place), self.around.clone(), self.searched), entered);

            let entered = self.rows[slot(place)..][..width].as_flattened();
            let left = self.rows[slot(place + 1)..][..width].as_flattened();
            let sums = self.columns.as_flattened_mut().iter_mut();
            for ((sum, new), old) in sums.zip(entered).zip(left) {
                // Subtracts first, so that no sum exceeds the largest one of a window.
                *sum = sum.minus(*old).plus(*new);
            }
        }

        // Usual numbers as constants: bytes can only be shifted by constants in one instruction.
        match self.window.dropped {
            0 => self.drop_bits(0),
            1 => self.drop_bits(1),
            2 => self.drop_bits(2),
            3 => self.drop_bits(3),
            bits => self.drop_bits(bits),
        }
    }

    /// Writes the sums of the columns without their lowest bits.
    #[inline(always)]
    fn drop_bits(&mut self, bits: u32) {
        let Self { searched, beyond, columns, summands, .. } = self;
        let runs = searched.runs();

        let (left, rest) = summands.split_at_mut(*beyond * runs);
        let (within, right) = rest.split_at_mut(columns.len());

        let sums = columns.as_flattened();
        for (summand, sum) in within.as_flattened_mut().iter_mut().zip(sums) {
            *summand = sum.shifted(bits);
        }

        let (first, last) = (&within[..runs], &within[within.len() - runs..]);
        left.chunks_exact_mut(runs).for_each(|pixel| pixel.copy_from_slice(first));
        right.chunks_exact_mut(runs).for_each(|pixel| pixel.copy_from_slice(last));
    }

    /// Writes the sums over the windows of some columns.
    #[inline(always)]
    fn write_row(&self, columns: Range<usize>, out: &mut [Lanes<V>]) {
        // The first window begins `radius` columns left of its center, which may be beyond the image.
        let first = columns.start + self.beyond - self.window.radius() - self.around.start;
        let runs = self.searched.runs();
        let summands = &self.summands[first * runs..];

        // Usual numbers as constants, so that places are found without a multiplication.
        match runs {
            1 => sum_windows(summands, self.window.side, 1, out),
            2 => sum_windows(summands, self.window.side, 2, out),
            runs => sum_windows(summands, self.window.side, runs, out),
        }
    }
}

/// Writes the sums over neighboring windows of so many columns, of pixels with so many runs of candidates.
#[inline(always)]
fn sum_windows<V: Value>(columns: &[Lanes<V>], side: usize, runs: usize, out: &mut [Lanes<V>]) {
    for run in 0..runs {
        let mut sum = [V::default(); LANES];
        for column in columns.chunks_exact(runs).take(side - 1) {
            sum = added(sum, column[run]);
        }

        let entering = columns[(side - 1) * runs..].chunks_exact(runs);
        let leaving = columns.chunks_exact(runs);
        for ((out, entering), leaving) in out.chunks_exact_mut(runs).zip(entering).zip(leaving) {
            sum = added(sum, entering[run]);
            out[run] = sum;
            sum = subtracted(sum, leaving[run]);
        }
    }
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

/// The aggregated costs of a whole volume, rows of `columns x candidates`.
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
        let mut aggregator = Aggregator::<u32>::default();
        let mut lanes = RunMemory::default();
        let rows = index * ROWS..((index + 1) * ROWS).min(rows);
        lanes.resize(rows.len() * cols * costs.runs())?;

        aggregator.aggregate(
            &costs,
            window,
            (PixelBlock { rows, columns: 0..cols, strip: cols }, costs.searched()),
            level,
            &mut lanes,
        )?;

        let pixels = lanes.as_flattened().chunks_exact(costs.runs() * LANES);
        for (aggregated, lanes) in aggregated.chunks_exact_mut(candidates).zip(pixels) {
            aggregated.copy_from_slice(&lanes[..candidates]);
        }

        Ok(())
    })?;
    Ok(aggregated)
}

/// Rows of a volume that are aggregated together.
const ROWS: usize = 32;

//! Costs -> sums over a window; for shiftable windows, the smallest of five sums (paper, section 2.3).
//!
//! A block of columns is processed from top to bottom, with all candidates of a pixel in neighboring lanes.
//! The sum of each column over the rows of the window is updated from row to row, the sum over its columns
//! from pixel to pixel:
//!
//! ```text
//! for line in lines of candidates:
//!     for y in rows:
//!         column[x][k] += cost[y + r][x][k] - cost[y - r - 1][x][k]      # a ring of 2 r + 2 rows of costs
//!         for x in columns:
//!             sum[k]   += (column[x + r][k] >> n) - (column[x - r - 1][k] >> n)      # n bits are dropped
//!             aggregated[y][x][k] = sum[k]
//! ```
//!
//! A line of candidates fills a cache line: 64 bytes, or 32 integers of 16 bits. Line by line, the ring stays
//! in the first-level cache for any number of candidates, and all loops run over arrays of one length.
//!
//! Beyond the image, its edge rows and columns are repeated. A shiftable window takes the smallest of the
//! sums at five places, so a ring of rows of sums is kept as well. Under masks, the same sums count the valid
//! pixels of each window, and the mean of their costs represents the whole window:
//!
//! ```text
//! aggregated[y][x][k] = sum[k] area / count[k], rounded, halves up
//! ```
//!
//! Most masks are borders. In most columns of a block, each line of candidates is either all valid or all
//! invalid; only the windows in between need counts. Elsewhere the count is the area, and the scaled sum is
//! the sum itself; or the count is 0, and it is the largest possible one.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::memory::{Memory, RunMemory};
use crate::base::plane::{Plane, widened};
use crate::base::simd::{Level, Loop};
use crate::base::value::{LANES, Lanes, Value, nearest};
use crate::choices::{LARGEST_BYTE_SUM, LEAST_BYTE_SUM};
use crate::cost::validity::{BlockValidity, Extent};
use crate::cost::{Costs, Lines, RowPart, fill, line, steps_of};
use crate::pair::candidates::{Candidates, Searched};
use crate::pair::plan::{Plan, Stage};
use crate::settings::{Precision, Settings};

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
    /// The largest cost of one pixel: the cost of each place in a window without a valid pixel.
    pub ceiling: u16,
    /// Lowest bits that are dropped from the sum of each column of a window.
    pub dropped: u32,
}

/// The sums of costs over windows.
pub struct Aggregation;

impl Stage for Aggregation {
    fn reach(&self, plan: Plan) -> usize {
        Window::new((1, 1), 1, plan.settings, 0).halo()
    }
}

impl Window {
    /// The window that checked settings define over the costs of a pair.
    pub fn new((rows, cols): (usize, usize), candidates: usize, settings: &Settings, ceiling: u16) -> Self {
        let Settings { window: side, shiftable, .. } = *settings;
        let exact = Self { rows, cols, candidates, side, shiftable, ceiling, dropped: 0 };

        match settings.precision {
            Precision::Full => exact,
            Precision::Byte => exact.rounded_to_bytes(settings.p2, steps_of(settings)),
        }
    }

    /// The window with sums that fit a byte: it drops the fewest bits for which the largest sum is at most
    /// [`LARGEST_BYTE_SUM`]. P2 is in units of the cost, which has `steps` steps to the unit. If the largest
    /// sum and P2 together do not fit a byte but would with one bit less, that bit is dropped, too, unless
    /// the largest sum would fall below [`LEAST_BYTE_SUM`]. So the rounding of costs depends on P2.
    pub fn rounded_to_bytes(self, p2: f64, steps: u16) -> Self {
        let coarser = |dropped| Self { dropped, ..self };
        let is_small = |bits: &u32| coarser(*bits).largest_sum() <= LARGEST_BYTE_SUM;
        let least = (0..u32::BITS).find(is_small).unwrap_or(0);

        let fits = |bits: &u32| {
            let window = coarser(*bits);
            let p2 = p2 * window.unit(steps);
            window.largest_sum() >= LEAST_BYTE_SUM
                && window.largest_sum() as f64 + p2.round() <= f64::from(u8::MAX)
        };

        coarser([least, least + 1].into_iter().find(fits).unwrap_or(least))
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

    /// One unit of the mean cost in steps of the sums; a cost has `steps` steps to the unit.
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

    /// Scales sums to the whole window, by the numbers of valid pixels in it; without any, they become the
    /// largest possible.
    #[inline(always)]
    fn scale<V: Value, const L: usize>(&self, counts: &[V; L], sums: &mut [V; L]) {
        let area = f64::from(self.area());
        let largest = self.largest_sum() as f64;
        // The mean, rounded half up: fractions are multiples of 1 / count, so those just below a half stay
        // below it.
        let tie = 0.25 / area;

        // The loops have no closures: these might not be inlined, and so not be compiled for the level. Bits
        // are dropped from the sum of each column, so the mean of a few may exceed the largest sum; without
        // valid pixels it is NaN, which is not less than that.
        if largest * area < f64::from(1 << 20) {
            // Registers have more lanes of single precision, whose rounding errors are less than `tie` here.
            let (area, largest, tie) = (area as f32, largest as f32, tie as f32);
            for (sum, count) in sums.iter_mut().zip(counts) {
                let mean = sum.widened() as i32 as f32 * area / count.widened() as i32 as f32;
                let least = if mean < largest { mean } else { largest };
                *sum = V::truncated(nearest_below_2_22(least + tie).into());
            }
        } else {
            for (sum, count) in sums.iter_mut().zip(counts) {
                let mean = f64::from(sum.widened() as i32) * area / f64::from(count.widened() as i32);
                let least = if mean < largest { mean } else { largest };
                *sum = V::truncated(nearest(least + tie) as u64);
            }
        }
    }
}

/// The nearest integer to a number from 0 to `2^22`, as [`nearest`] computes it in double precision.
#[inline(always)]
fn nearest_below_2_22(value: f32) -> u32 {
    (value + 1.5 * (1u32 << 23) as f32).to_bits() & ((1 << 22) - 1)
}

/// Places left free after each row of a strip: rows of a power-of-two number of bytes share few sets of the
/// first-level cache.
pub const GAP: usize = 1;

/// Pixels whose costs are aggregated together.
///
/// Their values lie in strips of columns, and in each strip row by row: see [`Self::place`]. Strips lie one
/// after another, or in a ring, where the last ones of one block may be the first ones of the next.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PixelBlock {
    /// Rows of the images.
    pub rows: Range<usize>,
    /// Columns of the left image.
    pub columns: Range<usize>,
    /// Columns of a strip.
    pub strip: usize,
    /// Strips that fit in the ring ...
    ring: usize,
    /// ... and the place of the first strip among them.
    first: usize,
}

impl PixelBlock {
    /// A block whose strips lie one after another.
    pub fn new(rows: Range<usize>, columns: Range<usize>, strip: usize) -> Self {
        let ring = columns.len().div_ceil(strip);
        Self { rows, columns, strip, ring, first: 0 }
    }

    /// The same block with its strips in a ring of `ring` places, from place `first` on.
    pub fn in_ring(self, ring: usize, first: usize) -> Self {
        Self { ring, first: first % ring, ..self }
    }

    /// The block without its first strips.
    pub fn without(&self, strips: usize) -> Self {
        let start = (self.columns.start + strips * self.strip).min(self.columns.end);
        let block = Self { columns: start..self.columns.end, ..self.clone() };
        block.in_ring(self.ring, self.first + strips)
    }

    /// Places for pixels: the last strip is as long as the others, whatever its number of columns.
    pub fn places(&self) -> usize {
        self.ring * self.rows.len() * self.stride()
    }

    /// Places from one row of a strip to the next.
    #[inline(always)]
    pub fn stride(&self) -> usize {
        self.strip + GAP
    }

    /// The place of the first pixel of row `row` of a strip; those of the row follow.
    #[inline(always)]
    pub fn place(&self, strip: usize, row: usize) -> usize {
        let strip = self.first + strip;
        let strip = if strip < self.ring { strip } else { strip - self.ring };
        (strip * self.rows.len() + row) * self.stride()
    }

    /// The columns of every strip.
    #[inline(always)]
    pub fn strips(&self) -> impl ExactSizeIterator<Item = Range<usize>> + DoubleEndedIterator + use<> {
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
    windows: WindowedCosts<V>,
    /// A ring of rows of sums, for shiftable windows: the rows of a window.
    boxes: Memory<V>,
}

/// Sums over the windows of a row, scaled to the valid pixels.
#[derive(Debug, Default)]
struct WindowedCosts<V> {
    /// Sums of the costs.
    costs: BoxSums<V>,
    /// The validity around the block, unless all is valid ...
    around: Option<BlockValidity>,
    /// ... and the columns there in which some candidates of the line are invalid.
    masked: Vec<Range<usize>>,
    /// Stretches of columns with uniform windows, from left to right ...
    stretches: Vec<Stretch>,
    /// ... and the numbers of valid pixels for those with some invalid ones.
    validity: Vec<BoxSums<V>>,
    /// Numbers of valid pixels in the windows of a row.
    counts: Memory<V>,
}

/// Columns whose windows are all valid, all invalid, or mixed.
#[derive(Debug)]
struct Stretch {
    extent: Extent,
    columns: Range<usize>,
}

impl<V: Value> Aggregator<V> {
    /// Writes the aggregated costs of a block into its places, the searched candidates of a pixel in
    /// neighboring lanes, and [`Value::FAR`] beyond the last one.
    pub fn aggregate(
        &mut self,
        costs: &Costs,
        window: Window,
        (block, searched): (PixelBlock, Searched),
        level: Level,
        out: &mut [Lanes<V>],
    ) -> Result<()> {
        let halo = window.halo();
        let rows = widened(&block.rows, halo, window.rows);
        let columns = widened(&block.columns, halo, window.cols);
        let around = |validity| BlockValidity::new(validity, &rows, &columns, searched);
        self.windows.around = costs.validity().and_then(around);

        let (values, stride) = (out.as_flattened_mut(), searched.runs() * LANES);
        let mut first = 0;
        while first < stride {
            // A cache line holds two runs of bytes, or one of wider integers.
            let is_wide = size_of::<V>() == 1 && stride - first > LANES;
            let lanes = if is_wide { 2 * LANES } else { LANES };
            let part = searched.part(first, lanes);
            self.windows.begin(window, &block.columns, (part, lanes))?;
            // Fixed windows need no ring.
            let ring = if window.shiftable { window.side } else { 0 };
            self.boxes.resize((block.columns.len() + 2 * window.largest_shift()) * ring * lanes)?;

            let (aggregator, block) = (&mut *self, &block);
            if is_wide {
                let out = Lines::<V, { 2 * LANES }> { values, first, stride };
                level.run(Aggregate { aggregator, costs, window, block, out });
            } else {
                let out = Lines::<V, LANES> { values, first, stride };
                level.run(Aggregate { aggregator, costs, window, block, out });
            }

            first += lanes;
        }

        Ok(())
    }
}

impl<V: Value> WindowedCosts<V> {
    /// Sizes all buffers for some columns, candidates and lanes.
    fn begin(&mut self, window: Window, columns: &Range<usize>, line: (Searched, usize)) -> Result<()> {
        self.costs.begin(window, columns, line)?;

        self.find_stretches(window, columns, line.0);

        // Counts are those of the centered windows, and shifted ones take the sums.
        let counted = Window { dropped: 0, shiftable: false, ..window };
        let mut longest = 0;
        for (index, Stretch { columns, .. }) in mixed(&self.stretches).enumerate() {
            if self.validity.len() == index {
                self.validity.push(BoxSums::default());
            }
            self.validity[index].begin(counted, columns, line)?;
            longest = longest.max(columns.len());
        }
        self.counts.resize(longest * line.1)
    }

    /// Splits the columns that windows of a block may be centered on, by the validity of these windows.
    fn find_stretches(&mut self, window: Window, columns: &Range<usize>, searched: Searched) {
        let Self { around, masked, stretches, .. } = self;
        let extent = |columns: &Range<usize>| {
            around.as_ref().map_or(Extent::All, |around| around.extent(columns, searched))
        };

        masked.clear();
        for x in widened(columns, window.halo(), window.cols) {
            match masked.last_mut() {
                _ if extent(&(x..x + 1)) == Extent::All => {}
                Some(last) if last.end == x => last.end = x + 1,
                _ => masked.push(x..x + 1),
            }
        }

        stretches.clear();
        for x in widened(columns, window.largest_shift(), window.cols) {
            let extent = extent(&widened(&(x..x + 1), window.radius(), window.cols));
            match &mut stretches[..] {
                [.., last] if last.extent == extent => last.columns.end = x + 1,
                // Two counted stretches with little between them become one.
                [.., before, between]
                    if (before.extent, extent) == (Extent::Part, Extent::Part)
                        && between.columns.len() <= window.side =>
                {
                    before.columns.end = x + 1;
                    stretches.pop();
                }
                _ => stretches.push(Stretch { extent, columns: x..x + 1 }),
            }
        }
    }

    /// Moves the windows to a row.
    #[inline(always)]
    fn center_on<const L: usize>(&mut self, costs: &Costs, y: usize) {
        self.costs.center_on::<L>(y, Summed::Costs { masked: &self.masked }, costs);
        for (counts, _) in self.validity.iter_mut().zip(mixed(&self.stretches)) {
            counts.center_on::<L>(y, Summed::Validity, costs);
        }
    }

    /// Writes the sums over the windows of some columns of the row, scaled where some pixels are invalid.
    #[inline(always)]
    fn write_row<const L: usize>(&mut self, columns: Range<usize>, out: &mut Lines<V, L>) {
        let Self { costs, validity, stretches, counts, .. } = self;
        let mut validity = validity.iter();

        for Stretch { extent, columns: all } in stretches {
            let counted = if *extent == Extent::Part { validity.next() } else { None };
            let here = all.start.max(columns.start)..all.end.min(columns.end);
            if here.is_empty() {
                continue;
            }

            let length = here.len();
            let mut sums = out.part(here.start - columns.start, length);
            if *extent == Extent::Nothing {
                fill(&mut sums, V::truncated(costs.window.largest_sum()));
                continue;
            }

            costs.write_row(here.clone(), &mut sums);
            if let Some(counted) = counted {
                let values = &mut counts[..length * L];
                counted.write_counts(here, &mut Lines::<V, L> { values, first: 0, stride: L });
                for pixel in 0..length {
                    costs.window.scale(&counts.as_chunks().0[pixel], sums.line(pixel));
                }
            }
        }
    }
}

/// The stretches whose windows are counted.
fn mixed(stretches: &[Stretch]) -> impl Iterator<Item = &Stretch> {
    stretches.iter().filter(|stretch| stretch.extent == Extent::Part)
}

/// The loop of [`Aggregator::aggregate`], for a line of candidates.
struct Aggregate<'a, V, const L: usize> {
    aggregator: &'a mut Aggregator<V>,
    costs: &'a Costs<'a>,
    window: Window,
    block: &'a PixelBlock,
    out: Lines<'a, V, L>,
}

impl<V: Value, const L: usize> Aggregate<'_, V, L> {
    /// Writes the sum over the centered window of each pixel.
    #[inline(always)]
    fn centered(self) {
        let Self { aggregator: Aggregator { windows, .. }, costs, block, mut out, .. } = self;

        for (row, y) in block.rows.clone().enumerate() {
            windows.center_on::<L>(costs, y);

            for (strip, columns) in block.strips().enumerate() {
                let mut out = out.part(block.place(strip, row), columns.len());
                windows.write_row(columns, &mut out);
                pad(&mut out, windows.costs.searched);
            }
        }
    }

    /// Writes the smallest sum of the five windows of each pixel. Each row's sums stay in the ring as long as
    /// some window is shifted to them.
    #[inline(always)]
    fn shifted(self) {
        let Self { aggregator: Aggregator { windows, boxes }, costs, window, block, mut out } = self;
        let PixelBlock { rows, columns, .. } = block;
        let shift = window.largest_shift();
        let around = widened(columns, shift, window.cols);
        let width = around.len() * L;
        let last = window.rows - 1;
        let mut next = rows.start.saturating_sub(shift);

        for (row, y) in rows.clone().enumerate() {
            // Each row is summed once, when the first window is shifted to it.
            while next <= (y + shift).min(last) {
                windows.center_on::<L>(costs, next);
                let values = &mut boxes[next % window.side * width..][..width];
                let mut out = Lines::<V, L> { values, first: 0, stride: L };
                windows.write_row(around.clone(), &mut out);
                next += 1;
            }

            let shifted_to = |y: usize| boxes[y % window.side * width..][..width].as_chunks().0;
            let rows = [y, y.saturating_sub(shift), (y + shift).min(last)].map(shifted_to);

            for (strip, columns) in block.strips().enumerate() {
                let mut out = out.part(block.place(strip, row), columns.len());
                write_least(rows, (columns, around.start, window), &mut out);
                pad(&mut out, windows.costs.searched);
            }
        }
    }
}

/// Writes the smallest of the sums at five places for some columns: here, above, below, left and right. The
/// rows of sums begin at column `first`.
#[inline(always)]
fn write_least<V: Value, const L: usize>(
    [here, above, below]: [&[[V; L]]; 3],
    (columns, first, window): (Range<usize>, usize, Window),
    out: &mut Lines<V, L>,
) {
    let shift = window.largest_shift();

    for (pixel, x) in columns.enumerate() {
        let left = x.saturating_sub(shift) - first;
        let right = (x + shift).min(window.cols - 1) - first;
        let place = x - first;

        let along = lesser(here[left], here[right]);
        *out.line(pixel) = lesser(here[place], lesser(along, lesser(above[place], below[place])));
    }
}

impl<V: Value, const L: usize> Loop for Aggregate<'_, V, L> {
    type Output = ();
    const COUNTS_BITS: bool = !V::IS_RARE;

    #[inline(always)]
    fn run(self) {
        if self.window.largest_shift() == 0 { self.centered() } else { self.shifted() }
    }
}

/// Pads lines with [`Value::FAR`], which never wins, beyond the last candidate.
#[inline(always)]
fn pad<V: Value, const L: usize>(out: &mut Lines<V, L>, searched: Searched) {
    if searched.count < L {
        let mut beyond = [V::FAR; L];
        beyond[..searched.count].fill(V::default());
        for pixel in 0..out.count() {
            let line = out.line(pixel);
            for (value, least) in line.iter_mut().zip(beyond) {
                *value = (*value).max(least);
            }
        }
    }
}

/// The summands of windows: costs, which are 0 where invalid in the `masked` columns; or 1 where they are
/// valid.
#[derive(Debug, Clone, Copy)]
enum Summed<'a> {
    Costs { masked: &'a [Range<usize>] },
    Validity,
}

impl Summed<'_> {
    /// Writes the summands of some columns of a row.
    #[inline(always)]
    fn write<V: Value, const L: usize>(
        self,
        costs: &Costs,
        (y, columns, searched): RowPart,
        values: &mut [V],
    ) {
        let mut lines = Lines::<V, L> { values, first: 0, stride: L };
        match self {
            Self::Costs { masked } => {
                costs.write_lines((y, columns.clone(), searched), &mut lines);
                for range in masked {
                    let mut part = lines.part(range.start - columns.start, range.len());
                    costs.mask((y, range.clone(), searched), &mut part);
                }
            }
            Self::Validity => costs.write_validity((y, columns, searched), &mut lines),
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
    /// Columns of the halo that lie beyond the image, on the left.
    beyond: usize,
    /// The row on which the window is centered.
    center: Option<usize>,
    /// Costs of the rows of the window and of the one that has just left it, in a ring.
    rows: Memory<V>,
    /// Their sums over the rows of the window, for each column. Beyond the image its edge columns are
    /// repeated, so the halo is complete.
    columns: Memory<V>,
}

impl<V: Value> BoxSums<V> {
    /// Sizes the buffers for some columns, candidates and lanes, before the first row.
    fn begin(
        &mut self,
        window: Window,
        columns: &Range<usize>,
        (searched, lanes): (Searched, usize),
    ) -> Result<()> {
        let halo = window.halo();
        self.around = widened(columns, halo, window.cols);
        self.beyond = halo.saturating_sub(columns.start);
        self.window = window;
        self.searched = searched;
        self.center = None;

        self.rows.resize((window.side + 1) * self.around.len() * lanes)?;
        self.columns.resize((columns.len() + 2 * halo) * lanes)
    }

    /// Moves the window to row `y`: the next one, or any if it is the first.
    #[inline(always)]
    fn center_on<const L: usize>(&mut self, y: usize, summed: Summed, costs: &Costs) {
        let Self { window, searched, around, beyond, center, rows, columns } = self;
        let (radius, side) = (window.radius(), window.side);
        let width = around.len() * L;
        let last = window.rows - 1;
        // Places count rows from `radius` rows above the image; beyond the image its edge is repeated.
        let slot = |place: usize| place % (side + 1) * width;
        let row = |place: usize| place.saturating_sub(radius).min(last);

        let mut entering = y + 2 * radius..y + 2 * radius + 1;
        if center.replace(y).is_none() {
            // Before the first row the window is empty, and all its rows enter.
            entering.start = y;
            rows.fill(V::default());
            columns.fill(V::default());
        }

        let sums = &mut columns[*beyond * L..][..width];
        for place in entering {
            let block = (row(place), around.clone(), *searched);
            summed.write::<V, L>(costs, block, &mut rows[slot(place)..][..width]);

            let entered = &rows[slot(place)..][..width];
            let left = &rows[slot(place + 1)..][..width];
            for ((sum, new), old) in sums.iter_mut().zip(entered).zip(left) {
                // Subtracts first, so that no sum exceeds the largest of a window.
                *sum = sum.minus(*old).plus(*new);
            }
        }

        let columns: &mut [[V; L]] = columns.as_chunks_mut().0;
        let (left, rest) = columns.split_at_mut(*beyond);
        let (within, right) = rest.split_at_mut(around.len());
        left.fill(within[0]);
        right.fill(within[within.len() - 1]);
    }

    /// Writes the sums over the windows of some columns.
    #[inline(always)]
    fn write_row<const L: usize>(&self, columns: Range<usize>, out: &mut Lines<V, L>) {
        let (sums, side) = (self.first_window(&columns), self.window.side);

        // Common numbers as constants: bytes can be shifted in one instruction only by constants.
        match (self.window.dropped, size_of::<V>()) {
            (0, _) => sum_windows(sums, side, 0, out),
            (1, 1) => sum_windows(sums, side, 1, out),
            (2, 1) => sum_windows(sums, side, 2, out),
            (3, 1) => sum_windows(sums, side, 3, out),
            (bits, _) => sum_windows(sums, side, bits, out),
        }
    }

    /// Like [`Self::write_row`], for counts, which drop no bits.
    #[inline(always)]
    fn write_counts<const L: usize>(&self, columns: Range<usize>, out: &mut Lines<V, L>) {
        sum_windows(self.first_window(&columns), self.window.side, 0, out);
    }

    /// The sums of columns from the first window on: it begins `radius` columns left of its center, possibly
    /// beyond the image.
    #[inline(always)]
    fn first_window<const L: usize>(&self, columns: &Range<usize>) -> &[[V; L]] {
        let first = columns.start + self.beyond - self.window.radius() - self.around.start;
        &self.columns.as_chunks().0[first..]
    }
}

/// Writes the sums over neighboring windows of `side` columns, each column without its lowest bits.
#[inline(always)]
fn sum_windows<V: Value, const L: usize>(columns: &[[V; L]], side: usize, bits: u32, out: &mut Lines<V, L>) {
    let mut sum = [V::default(); L];
    for column in &columns[..side - 1] {
        sum = added(sum, shifted(*column, bits));
    }

    let (pixels, first) = out.pixels();
    for ((pixel, entering), leaving) in pixels.zip(&columns[side - 1..]).zip(columns) {
        sum = added(sum, shifted(*entering, bits));
        *line(pixel, first) = sum;
        sum = subtracted(sum, shifted(*leaving, bits));
    }
}

#[inline(always)]
fn shifted<V: Value, const L: usize>(mut values: [V; L], bits: u32) -> [V; L] {
    for value in &mut values {
        *value = value.shifted(bits);
    }
    values
}

#[inline(always)]
fn added<V: Value, const L: usize>(mut values: [V; L], others: [V; L]) -> [V; L] {
    for j in 0..L {
        values[j] = values[j].plus(others[j]);
    }
    values
}

#[inline(always)]
fn subtracted<V: Value, const L: usize>(mut values: [V; L], others: [V; L]) -> [V; L] {
    for j in 0..L {
        values[j] = values[j].minus(others[j]);
    }
    values
}

#[inline(always)]
fn lesser<V: Value, const L: usize>(mut values: [V; L], others: [V; L]) -> [V; L] {
    for j in 0..L {
        values[j] = values[j].min(others[j]);
    }
    values
}

/// The aggregated costs of a whole volume, rows of `columns x candidates`.
pub fn aggregate(volume: &Plane<u16>, window: Window, level: Level, control: &Control) -> Result<Plane<u32>> {
    let Window { rows, cols, candidates, .. } = window;
    let costs = Costs::of_volume(volume, Candidates::new(0, candidates as i64, cols.max(candidates))?);

    let mut aggregated = Plane::new(rows, cols * candidates)?;
    let blocks = aggregated.as_mut_slice().par_chunks_mut(ROWS * cols * candidates).enumerate();
    blocks.try_for_each(|(index, aggregated)| {
        control.checkpoint()?;
        let mut aggregator = Aggregator::<u32>::default();
        let mut lanes = RunMemory::default();
        let rows = index * ROWS..((index + 1) * ROWS).min(rows);
        let block = PixelBlock::new(rows, 0..cols, cols);
        lanes.resize(block.places() * costs.runs())?;
        let stride = block.stride() * costs.runs() * LANES;

        aggregator.aggregate(&costs, window, (block, costs.searched()), level, &mut lanes)?;

        let rows = lanes.as_flattened().chunks_exact(stride);
        for (aggregated, lanes) in aggregated.chunks_exact_mut(cols * candidates).zip(rows) {
            let pixels = lanes.chunks_exact(costs.runs() * LANES);
            for (aggregated, lanes) in aggregated.chunks_exact_mut(candidates).zip(pixels) {
                aggregated.copy_from_slice(&lanes[..candidates]);
            }
        }

        Ok(())
    })?;
    Ok(aggregated)
}

/// Rows of a volume that are aggregated together.
const ROWS: usize = 32;

//! Rows of aggregated costs -> the index of each pixel's disparity (paper, section 2.3).
//!
//! Every lane is a row of its own, so nothing has to be found out across lanes. For each pixel and candidate
//! three answers are kept, in the bits of one number for many candidates; the way back reads them.

use std::array::from_fn;

use crate::aggregation::{Aggregated, AggregatedBlock, GROUP, Tile, Window};
use crate::control::Control;
use crate::error::Result;
use crate::memory::Memory;
use crate::plane::Plane;
use crate::settings::{Penalty, Rule};
use crate::simd::{Kernel, Level};
use crate::strip::{BLOCK, Strip};
use crate::value::Value;

/// Penalties in steps of the aggregated costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Steps {
    /// For an index one larger than the left neighbour's; without the ordering constraint also one smaller.
    pub near: u64,
    /// For a smaller index than the left neighbour's; without the ordering constraint for any other.
    pub far: u64,
}

impl Steps {
    /// The penalties of checked settings against costs summed over a window, `steps` to the unit.
    pub fn new(penalty: Penalty, window: Window, steps: u16) -> Self {
        let unit = window.unit(steps);
        let rounded = |value: f64| (value * unit).round() as u64;
        Self { near: rounded(penalty.near), far: rounded(penalty.far) }
    }

    /// What the dearest change of a disparity costs.
    pub fn largest_change(self) -> u64 {
        self.far.max(self.near)
    }

    /// The largest total that the rule can meet on rows of `cols` pixels that cost so much at most.
    pub fn largest_total(self, rule: Rule, cols: usize, largest_cost: u64) -> u64 {
        match rule {
            Rule::WinnerTakesAll => largest_cost,
            Rule::ScanlineOptimization => largest_cost.saturating_add(self.largest_change()),
            // Not to change at all is always a way.
            Rule::DynamicProgramming => {
                largest_cost.saturating_mul(cols as u64).saturating_add(self.largest_change())
            }
        }
    }
}

/// A value for each lane of a block.
type Block<T> = [T; BLOCK];

/// Three answers for each lane and each of `T::BITS` candidates, the first of which has the lowest bit.
///
/// The first two tell how the best path came: it stayed (yes, yes), rose by one (yes, no), fell by one (no,
/// yes) or came from elsewhere (no, no). The third: its total is not above that of any larger candidate.
type Answers<T> = [Block<T>; 3];

/// Chooses candidates along the rows of one strip after another; its memory is used again.
#[derive(Debug, Default)]
pub struct Scanline<T> {
    rule: Rule,
    steps: Steps,
    candidates: usize,
    cols: usize,
    blocks: usize,
    /// Cost of the best path to each candidate of the column at hand, of one block after another; before the
    /// first candidate one that is out of reach.
    totals: Memory<T>,
    /// The least of these, of one block after another.
    least: Memory<T>,
    /// How the paths to each column came: of one block after another, column after column, the largest
    /// candidates first, as they are written.
    answers: Memory<T>,
    /// The index chosen, of one block after another, column after column.
    chosen: Memory<u16>,
}

impl<T: Value> Scanline<T> {
    /// Begins a strip.
    pub fn begin(&mut self, window: Window, strip: Strip, rule: Rule, steps: Steps) -> Result<()> {
        (self.rule, self.steps) = (rule, steps);
        (self.candidates, self.cols, self.blocks) =
            (window.candidates, window.cols, strip.blocks());
        let pixels = self.cols * self.blocks;
        let groups = self.groups();
        self.chosen.room(pixels * BLOCK)?;
        self.answers.room(pixels * groups * 3 * BLOCK)?;
        self.totals.room(self.blocks * (1 + self.candidates) * BLOCK)?;
        self.least.room(self.blocks * BLOCK)?;
        self.totals.fill(T::default());
        self.least.fill(T::default());
        Ok(())
    }

    /// The index chosen for each pixel: of one block after another, column after column, lane by lane.
    pub fn chosen(&self) -> &[u16] {
        &self.chosen
    }

    fn groups(&self) -> usize {
        self.candidates.div_ceil(T::BITS)
    }

    #[inline(always)]
    fn advance<V: Value>(&mut self, tile: &Tile, costs: Aggregated<V>) {
        let (groups, steps) = (self.groups(), self.steps);
        let totals = self.totals.as_chunks_mut().0.chunks_exact_mut(1 + self.candidates);
        let least = self.least.as_chunks_mut().0;
        let answers = self.answers.as_chunks_mut().0.as_chunks_mut().0;
        for (block, (totals, least)) in totals.zip(least).enumerate() {
            for (place, column) in tile.finished.clone().enumerate() {
                let costs = costs.of(place, block);
                let answers = &mut answers[(block * self.cols + column) * groups..][..groups];
                match self.rule {
                    Rule::DynamicProgramming => in_order(totals, costs, steps, answers),
                    Rule::ScanlineOptimization => {
                        *least = freely(totals, *least, costs, steps, answers);
                    }
                    Rule::WinnerTakesAll => take_all(costs, answers),
                }
            }
        }
    }

    /// Goes back from the best end of each row and writes down the way.
    pub fn trace_back(&mut self) {
        let groups = self.groups();
        let answers = self.answers.as_chunks().0.as_chunks().0;
        let chosen = self.chosen.as_chunks_mut().0;
        for block in 0..self.blocks {
            let mut index = [0; BLOCK];
            let mut next: &[Answers<T>] = &[];
            for column in (0..self.cols).rev() {
                let at = block * self.cols + column;
                let here = &answers[at * groups..][..groups];
                for (lane, index) in index.iter_mut().enumerate() {
                    *index = self.rule.origin(*index, lane, next, here);
                }
                chosen[at] = index;
                next = here;
            }
        }
    }
}

impl Rule {
    /// The index before `index`, from the answers about the column of `index` (none: it was the last) and
    /// about the column before.
    fn origin<T: Value>(
        self,
        index: u16,
        lane: usize,
        next: &[Answers<T>],
        here: &[Answers<T>],
    ) -> u16 {
        if next.is_empty() || self == Self::WinnerTakesAll {
            return first_least(here, 0, lane);
        }
        let [first, second, _] = answered(next, index, lane);
        match (self, first, second) {
            (_, true, true) => index,
            (_, true, false) => index - 1,
            (Self::DynamicProgramming, ..) => first_least(here, index + 1, lane),
            (_, false, true) => index + 1,
            _ => first_least(here, 0, lane),
        }
    }
}

/// The first index from `from` on whose total is not above that of any larger one.
fn first_least<T: Value>(answers: &[Answers<T>], from: u16, lane: usize) -> u16 {
    let (first, bit) = (usize::from(from) / T::BITS, usize::from(from) % T::BITS);
    let groups = answers.iter().rev().enumerate().skip(first);
    let met = groups.map(|(group, [.., met])| {
        let bits = met[lane].widened();
        (group, if group == first { bits >> bit << bit } else { bits })
    });
    let found = met.into_iter().find(|(_, bits)| *bits != 0);
    found.map_or(from, |(group, bits)| (group * T::BITS) as u16 + bits.trailing_zeros() as u16)
}

/// The answers about one index.
fn answered<T: Value>(answers: &[Answers<T>], index: u16, lane: usize) -> [bool; 3] {
    let (group, bit) = (usize::from(index) / T::BITS, usize::from(index) % T::BITS);
    answers[answers.len() - 1 - group].map(|answer| answer[lane].widened() >> bit & 1 == 1)
}

/// The columns of a tile, searched for the best paths to them.
#[derive(Debug)]
pub struct Advance<'a, V, T> {
    /// Where paths are kept.
    pub scanline: &'a mut Scanline<T>,
    /// The columns.
    pub tile: &'a Tile,
    /// What they cost.
    pub costs: Aggregated<'a, V>,
}

impl<V: Value, T: Value> Kernel for Advance<'_, V, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.scanline.advance(self.tile, self.costs);
    }
}

/// The chosen indices of a whole volume of aggregated costs.
pub fn optimize(
    volume: &Plane<u32>,
    candidates: usize,
    rule: Rule,
    steps: Steps,
    level: Level,
    control: &Control,
) -> Result<Plane<u16>> {
    let (rows, cols) = (volume.rows(), volume.cols() / candidates);
    let window = Window { rows, cols, candidates, side: 1, ..Window::default() };
    let mut chosen = Plane::new(rows, cols)?;
    let (mut lanes, mut scanline) = (Memory::default(), Scanline::<u64>::default());
    for first in (0..rows).step_by(BLOCK) {
        let strip = Strip { first, rows: BLOCK.min(rows - first), margin: 0, height: rows };
        scanline.begin(window, strip, rule, steps)?;
        for tile in window.tiles() {
            control.checkpoint()?;
            let columns = tile.finished.clone();
            let places: Vec<_> = (columns.start * candidates..columns.end * candidates).collect();
            strip.transpose(&places, |y| volume.row(y), |cost| cost, &mut lanes)?;
            let costs = Aggregated::new(lanes.as_chunks().0, 1, candidates);
            level.run(Advance { scanline: &mut scanline, tile: &tile, costs });
        }
        scanline.trace_back();
        for y in strip.range() {
            let indices = scanline.chosen().iter().skip(y - first).step_by(BLOCK);
            chosen.row_mut(y).iter_mut().zip(indices).for_each(|(out, index)| *out = *index);
        }
    }
    Ok(chosen)
}

/// Extends the best paths by one pixel under the ordering constraint `d(x + 1) <= d(x) + 1`: an index stays,
/// rises by one or drops to any smaller one. Of equal costs staying wins, then the smaller origin.
#[inline(always)]
fn in_order<V: Value, T: Value>(
    totals: &mut [Block<T>],
    costs: AggregatedBlock<V>,
    steps: Steps,
    answers: &mut [Answers<T>],
) {
    let (rise, drop) = (T::truncated(steps.near), T::truncated(steps.far));
    let (mut larger, mut least) = ([T::FAR; BLOCK], [T::FAR; BLOCK]);
    totals[0] = [T::FAR; BLOCK];
    let mut here = totals[totals.len() - 1];
    let [mut first, mut second, mut met] = [[T::default(); BLOCK]; 3];
    let mut answers = answers.iter_mut();
    for group in (0..costs.groups()).rev() {
        let costs = costs.group(group);
        let totals = &mut totals[group * GROUP..][..=costs.len()];
        for i in (0..costs.len()).rev() {
            let smaller = totals[i];
            let (cost, mut total) = (costs[i], [T::default(); BLOCK]);
            for j in 0..BLOCK {
                let risen = smaller[j].plus_penalty(rise);
                let dropped = larger[j].plus_penalty(drop);
                let best = here[j].min(risen).min(dropped);
                let (stays, is_risen) = (best == here[j], best == risen);
                first[j] = first[j].then(stays | is_risen);
                second[j] = second[j].then(stays);
                larger[j] = larger[j].min(here[j]);
                total[j] = best.plus(T::truncated(cost[j].widened()));
                least[j] = least[j].min(total[j]);
                met[j] = met[j].then(total[j] == least[j]);
                here[j] = smaller[j];
            }
            totals[i + 1] = total;
        }
        if is_complete::<T>(group) {
            answers.next().into_iter().for_each(|answers| *answers = [first, second, met]);
        }
    }
}

/// Extends the best paths by one pixel, free to change in either direction: an index stays, rises or falls
/// by one, or jumps from the first of those whose total is least. Of equal costs the first named here wins.
/// Totals are relative to the least of their column, which this takes (`before`) and returns.
#[inline(always)]
fn freely<V: Value, T: Value>(
    totals: &mut [Block<T>],
    before: Block<T>,
    costs: AggregatedBlock<V>,
    steps: Steps,
    answers: &mut [Answers<T>],
) -> Block<T> {
    let (near, far) = (T::truncated(steps.near), T::truncated(steps.far));
    let relative = |total: &Block<T>| -> Block<T> { from_fn(|j| total[j].minus(before[j])) };
    let (mut larger, mut least) = ([T::FAR; BLOCK], [T::FAR; BLOCK]);
    // Out of reach it stays when it is taken relative to the least.
    totals[0] = from_fn(|j| T::FAR.plus(before[j]));
    let mut here = relative(&totals[totals.len() - 1]);
    let [mut first, mut second, mut met] = [[T::default(); BLOCK]; 3];
    let mut answers = answers.iter_mut();
    for group in (0..costs.groups()).rev() {
        let costs = costs.group(group);
        let totals = &mut totals[group * GROUP..][..=costs.len()];
        for i in (0..costs.len()).rev() {
            let smaller = relative(&totals[i]);
            let (cost, mut total) = (costs[i], [T::default(); BLOCK]);
            for j in 0..BLOCK {
                let risen = smaller[j].plus_penalty(near);
                let fallen = larger[j].plus_penalty(near);
                let best = here[j].min(far).min(risen.min(fallen));
                let (stays, is_risen) = (best == here[j], best == risen);
                first[j] = first[j].then(stays | is_risen);
                let is_fallen = (best == fallen) & (best != risen);
                second[j] = second[j].then(stays | is_fallen);
                total[j] = best.plus(T::truncated(cost[j].widened()));
                least[j] = least[j].min(total[j]);
                met[j] = met[j].then(total[j] == least[j]);
                larger[j] = here[j];
                here[j] = smaller[j];
            }
            totals[i + 1] = total;
        }
        if is_complete::<T>(group) {
            answers.next().into_iter().for_each(|answers| *answers = [first, second, met]);
        }
    }
    least
}

/// Only asks where the cost is least.
#[inline(always)]
fn take_all<V: Value, T: Value>(costs: AggregatedBlock<V>, answers: &mut [Answers<T>]) {
    let (mut least, mut met) = ([T::FAR; BLOCK], [T::default(); BLOCK]);
    let mut answers = answers.iter_mut();
    for group in (0..costs.groups()).rev() {
        for &cost in costs.group(group).iter().rev() {
            for j in 0..BLOCK {
                let cost = T::truncated(cost[j].widened());
                least[j] = least[j].min(cost);
                met[j] = met[j].then(cost == least[j]);
            }
        }
        if is_complete::<T>(group) {
            answers.next().into_iter().for_each(|answers| answers[2] = met);
        }
    }
}

/// Whether a number full of answers ends with this group; what the number held before was pushed out.
#[inline(always)]
fn is_complete<T: Value>(group: usize) -> bool {
    (group * GROUP).is_multiple_of(T::BITS)
}

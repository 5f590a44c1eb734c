//! Areas that match outside the run of disparities that most of a pair has: small, near or thin things.
//!
//! Where pixels cost much along the run, every disparity within reach is tried, on copies of the images, by the codes of
//! small neighborhoods summed over small windows: things a few pixels wide fill them. A rough match of the run says first
//! where that may be: most pixels cost little at the disparities that it found.
//!
//! ```text
//! sum(y, x, d)    = bits in which the codes of left (y, x) and right (y, x - d) differ, summed over WINDOW around them
//! guessed         = the same sum, but each pixel of the window has the disparity that the rough match found there; if that
//!                   is one of smaller copies, the least of those that this may stand for
//! median          = that of guessed, of the pixels that see the middle of the run
//! doubtful block  = guessed is above the median plus DEAR in MANY of its pixels
//! block           = searched if it is doubtful, and so is the least sum along the run in MANY of its pixels
//! own, d          = min, argmin of sum(y, x, d) over the d outside the run
//! along           = min of sum(y, x, d) over the run
//! elsewhere       = min of sum(y, x, d') over all d' but d and those NEXT to it
//! stands out      = own < 7/8 min(along, elsewhere)
//! area            = pixels that stand out, connected over at most GAP rows and columns by disparities that differ by 1
//!                   at most
//! seen            = the same search from the right image at x - d finds -d, or one NEXT to it
//! gain            = sum of min(along, elsewhere) - own over an area: by how many bits it is better explained
//! ```

use std::ops::Range;

use rayon::prelude::*;

use super::overview::{Guess, Overview, Span};
use crate::estimation::blur::rough::{as_view, raised};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::both;
use phasestereo_match::base::simd::Loop;
use phasestereo_match::base::value::{LANES, Lanes, least_lane, nearest};
use phasestereo_match::cost::Costs;
use phasestereo_match::descriptor::describe_as;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;

/// Rows, and columns, on either side of the middle of a window: tall ones lie within upright things. Sums over them of
/// codes of 8 bits fit a byte.
const AROUND: (usize, usize) = (4, 1);
/// Rows and columns of a window.
const WINDOW: (usize, usize) = (2 * AROUND.0 + 1, 2 * AROUND.1 + 1);
/// Rows of a task that sums at the guessed disparities.
const GUESSED_ROWS: usize = 64;
/// Columns that are searched together: sums over them stay in the first-level cache.
const LONGEST: usize = 64;
/// Side of the blocks of pixels that are searched or left out together.
const BLOCK: usize = 8;
/// Pixels of a block that cost much along the run, from which on it is searched.
const MANY: usize = 10;
/// Bits above the median that are much: an eighth of those of a window.
const DEAR: usize = 27;
/// Disparities that see the same match.
const NEXT: usize = 2;
/// Rows and columns between neighbors: single pixels that do not stand out divide no area.
const GAP: usize = 2;
/// Fewest pixels of an area.
const LEAST_SIZE: usize = 12;

/// An area that matches outside the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// Its rows in the copy.
    pub rows: Range<usize>,
    /// Its columns in the copy.
    pub columns: Range<usize>,
    /// Its least and largest disparity, pixels of the copy.
    pub span: Span,
    /// Number of pixels.
    pub size: usize,
    /// How many of them are found again from the right image.
    pub seen: usize,
    /// By how many bits its pixels are better explained than by any other disparity.
    pub gain: u64,
}

/// A pixel that stands out.
#[derive(Debug, Clone, Copy)]
struct Found {
    /// The candidate with the least sum outside the run.
    chosen: u16,
    /// By how many bits nothing else fits as well.
    gain: u16,
}

/// A pixel that stands out, and its place in the copy.
type Member = (usize, Found);

/// The blocks of an image that are searched.
struct Blocks {
    /// Rows of pixels.
    rows: usize,
    /// Blocks of a row.
    cols: usize,
    is_searched: Vec<bool>,
}

/// What is searched: the codes of both copies, and the run.
struct Search<'a> {
    codes: [Plane<u8>; 2],
    /// Whether the pixels of the left copy are valid.
    valid: &'a Plane<bool>,
    run: Span,
    runtime: Runtime<'a>,
}

/// The areas that match outside a run of disparities of the copies, from the top left. `low` to `high` are tried.
pub fn areas(
    copies: &Overview,
    guess: Guess,
    run: Span,
    (low, high): Span,
    field: Option<&Alignment>,
    runtime: Runtime,
) -> Result<Vec<Area>> {
    let search = Search::new(copies, run, field, runtime)?;
    let Some(blocks) = search.blocks(guess)? else {
        return Ok(vec![]);
    };

    let cols = search.codes[0].cols();
    let tried = candidates((low, high), cols)?;
    let found = search.outside(tried, &blocks)?;
    let areas = connected(&found, cols);

    // The same from the right image, where disparities are negative.
    let mirrored = candidates((-tried.disparity(tried.count() - 1), -tried.min()), cols)?;
    let [left, right] = &search.codes;
    let back = Costs::of_codes([right, left], mirrored)?;
    let is_seen = |(at, found): &&Member| {
        let x = tried.column(at % cols, found.chosen.into(), cols);
        let choose = Choose { costs: &back, rows: left.rows(), cols, y: at / cols, x };
        let there = mirrored.disparity(runtime.execution.level.run(choose));
        (there + tried.disparity(found.chosen.into())).unsigned_abs() <= NEXT
    };

    let area = |members: &Vec<Member>| {
        runtime.control.checkpoint()?;
        let bounds = |of: &dyn Fn(&Member) -> usize| {
            let values = members.iter().map(of);
            let least = values.clone().min().unwrap_or_default();
            (least, values.max().unwrap_or_default())
        };
        let (top, bottom) = bounds(&|(at, _)| at / cols);
        let (first, last) = bounds(&|(at, _)| at % cols);
        let (nearest, farthest) = bounds(&|(_, found)| found.chosen.into());

        Ok(Area {
            rows: top..bottom + 1,
            columns: first..last + 1,
            span: (tried.disparity(nearest), tried.disparity(farthest)),
            size: members.len(),
            seen: members.iter().filter(is_seen).count(),
            gain: members.iter().map(|(_, found)| u64::from(found.gain)).sum(),
        })
    };
    areas.par_iter().map(area).collect()
}

/// The candidates of a span, cut to what the width of the copies allows.
fn candidates((low, high): Span, cols: usize) -> Result<Candidates> {
    let count = (high - low + 1).clamp(1, cols as isize);
    let low = low.clamp(1 - cols as isize - (count - 1), cols as isize - 1);
    Candidates::new(low as i64, count as i64, cols)
}

impl<'a> Search<'a> {
    fn new(
        copies: &'a Overview,
        run: Span,
        field: Option<&Alignment>,
        runtime: Runtime<'a>,
    ) -> Result<Self> {
        let Runtime { execution, control, .. } = runtime;
        let codes = both(|side| {
            let plane = &copies.planes[side];
            let view = match field {
                Some(field) if side == 1 => as_view(&raised(plane, field, copies.factor, control)?),
                _ => as_view(plane),
            };
            describe_as(&Gray::of_view(&view), &codes(), None, execution.level, control)
        })?;
        Ok(Self { codes, valid: &copies.valid, run, runtime })
    }

    /// The blocks with enough pixels that cost much along the run, of those that see the middle of it; `None`: there are
    /// none.
    fn blocks(&self, guess: Guess) -> Result<Option<Blocks>> {
        let [left, right] = &self.codes;
        let (rows, cols) = (left.rows(), left.cols());
        let Runtime { execution, control, .. } = self.runtime;

        let mut sums = Plane::new(rows, cols)?;
        sums.write_bands(GUESSED_ROWS, |top, band| {
            control.checkpoint()?;
            band.fill(u8::MAX);
            // A disparity of smaller copies stands for several here.
            let within = guess.finer as i32 / 2;
            for off in -within..=within {
                let (codes, run) = ([left, right], self.run);
                execution.level.run(SumGuessed { codes, guess, run, off, top, sums: &mut *band });
            }
            Ok(())
        })?;

        let middle = (self.run.0 + self.run.1).div_euclid(2);
        // The columns whose matches in the middle of the run lie within the image.
        let seen = middle.clamp(0, cols as isize) as usize
            ..(cols as isize + middle).clamp(0, cols as isize) as usize;
        let judged = |y: usize| {
            let columns = seen.start.min(seen.end)..seen.end;
            let valid = &self.valid.row(y)[columns.clone()];
            columns.zip(valid).filter(|(_, valid)| **valid).map(|(x, _)| x)
        };

        let mut counts = [0usize; u8::MAX as usize + 1];
        for y in 0..rows {
            judged(y).for_each(|x| counts[usize::from(sums.row(y)[x])] += 1);
        }
        let half = counts.iter().sum::<usize>() / 2;
        let mut sum = 0;
        let median = counts.iter().position(|count| {
            sum += count;
            sum > half
        });
        let most = median.unwrap_or_default() + DEAR;

        let mut doubtful = Blocks::none(rows, cols);
        doubtful.search_where(|y| {
            let sums = sums.row(y);
            judged(y).filter(move |x| usize::from(sums[*x]) > most)
        });
        if !doubtful.is_searched.contains(&true) {
            return Ok(None);
        }

        // Most of these are errors of the rough match.
        let least = self.along(&doubtful)?;
        let mut blocks = Blocks::none(rows, cols);
        blocks.search_where(|y| {
            let least = least.row(y);
            judged(y).filter(move |x| usize::from(least[*x]) > most)
        });
        Ok(blocks.is_searched.contains(&true).then_some(blocks))
    }

    /// The least sums along the run in these blocks, 0 elsewhere.
    fn along(&self, blocks: &Blocks) -> Result<Plane<u8>> {
        let [left, right] = &self.codes;
        let (rows, cols) = (left.rows(), left.cols());
        let costs = Costs::of_codes([left, right], candidates(self.run, cols)?)?;
        let borders = Borders::new(&costs, cols, 0..0);

        let mut least = Plane::new(rows, cols)?;
        least.write_bands(BLOCK, |top, band| {
            self.runtime.control.checkpoint()?;
            for columns in blocks.stretches(top / BLOCK, cols) {
                let windows =
                    Windows { costs: &costs, rows, cols, top, count: band.len() / cols, columns };
                let each = |y: usize, x: usize, sums: &[Lanes<u8>]| {
                    band[y * cols + x] = borders.least(sums, x)[0];
                };
                self.runtime.execution.level.run(Visit { windows, each });
            }
            Ok(())
        })?;
        Ok(least)
    }

    /// The pixels of these blocks that stand out, row after row.
    fn outside(&self, tried: Candidates, blocks: &Blocks) -> Result<Vec<Member>> {
        let [left, right] = &self.codes;
        let (rows, cols) = (left.rows(), left.cols());
        let costs = Costs::of_codes([left, right], tried)?;
        let index =
            |disparity: isize| (disparity - tried.min()).clamp(0, tried.count() as isize) as usize;
        let borders = Borders::new(&costs, cols, index(self.run.0 - 1)..index(self.run.1 + 2));

        let of_row = |row: usize| -> Result<Vec<Member>> {
            self.runtime.control.checkpoint()?;
            let top = row * BLOCK;
            let count = BLOCK.min(rows - top);
            let mut found = vec![];
            for columns in blocks.stretches(row, cols) {
                let windows = Windows { costs: &costs, rows, cols, top, count, columns };
                let each = |y: usize, x: usize, sums: &[Lanes<u8>]| {
                    let one = borders.outside(sums, x);
                    found.extend(one.map(|one| ((top + y) * cols + x, one)));
                };
                self.runtime.execution.level.run(Visit { windows, each });
            }
            found.sort_unstable_by_key(|(at, _)| *at);
            Ok(found)
        };

        let found: Result<Vec<_>> = (0..rows.div_ceil(BLOCK)).into_par_iter().map(of_row).collect();
        Ok(found?.concat())
    }
}

impl Blocks {
    /// None of the blocks of an image.
    fn none(rows: usize, cols: usize) -> Self {
        let cols = cols.div_ceil(BLOCK);
        Self { rows, cols, is_searched: vec![false; rows.div_ceil(BLOCK) * cols] }
    }

    /// Searches those with [`MANY`] of these pixels, whose columns are given by row.
    fn search_where<I: Iterator<Item = usize>>(&mut self, columns: impl Fn(usize) -> I) {
        for (row, blocks) in self.is_searched.chunks_exact_mut(self.cols).enumerate() {
            let mut counts = vec![0; self.cols];
            for y in row * BLOCK..((row + 1) * BLOCK).min(self.rows) {
                columns(y).for_each(|x| counts[x / BLOCK] += 1);
            }
            blocks.iter_mut().zip(counts).for_each(|(block, count)| *block = count >= MANY);
        }
    }

    /// The columns of neighboring blocks of a row of blocks that are searched.
    fn stretches(&self, row: usize, cols: usize) -> Vec<Range<usize>> {
        let mut stretches: Vec<Range<usize>> = vec![];
        for (block, is_searched) in
            self.is_searched[row * self.cols..(row + 1) * self.cols].iter().enumerate()
        {
            let (start, end) = (block * BLOCK, ((block + 1) * BLOCK).min(cols));
            match stretches.last_mut() {
                Some(last) if *is_searched && last.end == start && last.len() < LONGEST => {
                    last.end = end;
                }
                _ if *is_searched => stretches.push(start..end),
                _ => {}
            }
        }
        stretches
    }
}

/// The settings of the codes: those of 8 bits, of the smallest neighborhoods.
fn codes() -> Settings {
    Settings { neighborhood: 3, frequencies: (1, 1), ..Preset::Paper.settings() }
}

/// Lowers sums to those so far off the guessed disparities, of a band of rows from `top` on.
struct SumGuessed<'a> {
    codes: [&'a Plane<u8>; 2],
    guess: Guess<'a>,
    run: Span,
    off: i32,
    top: usize,
    sums: &'a mut [u8],
}

impl Loop for SumGuessed<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, guess, run, off, top, sums } = self;
        let (rows, cols) = (codes[0].rows(), codes[0].cols());
        let clamped = |y: usize| y.saturating_sub(AROUND.0).min(rows - 1);

        // The differences of the rows of a window, in turns, and their sums by column.
        let mut lines = vec![0u8; WINDOW.0 * cols];
        let mut columns = vec![0u8; cols];
        for (row, sums) in sums.chunks_exact_mut(cols).enumerate() {
            let y = top + row;
            let begun = if row == 0 { 0..WINDOW.0 } else { WINDOW.0 - 1..WINDOW.0 };
            for number in begun {
                let line = &mut lines[(y + number) % WINDOW.0 * cols..][..cols];
                for x in 0..cols {
                    columns[x] = columns[x].wrapping_sub(line[x]);
                }
                guess.differences(codes, run, off, clamped(y + number), line);
                for x in 0..cols {
                    columns[x] = columns[x].wrapping_add(line[x]);
                }
            }

            for x in 1..cols - 1 {
                sums[x] = sums[x].min(columns[x - 1] + columns[x] + columns[x + 1]);
            }
            // At the border the last pixel is repeated.
            sums[0] = sums[0].min(2 * columns[0] + columns[1]);
            sums[cols - 1] = sums[cols - 1].min(columns[cols - 2] + 2 * columns[cols - 1]);
        }
    }
}

impl Guess<'_> {
    /// Writes the bits in which the codes of a row differ from those so far off the guessed disparities. Where there is
    /// no disparity, the last one to the left counts, or else the middle of the run.
    #[inline(always)]
    fn differences(
        &self,
        [left, right]: [&Plane<u8>; 2],
        run: Span,
        off: i32,
        y: usize,
        line: &mut [u8],
    ) {
        let share = self.finer as f32 / self.by as f32;
        // The others may lack what is left of a division.
        let last = (self.disparity.rows() - 1, self.disparity.cols() - 1);
        let guessed = self.disparity.row((y * self.by / self.finer).min(last.0));
        let reduced = self.finer.ilog2();
        let (left, right) = (left.row(y), right.row(y));
        let last_column = left.len() as i32 - 1;

        let mut disparity = (run.0 + run.1) as i32 / 2;
        for x in 0..line.len() {
            let guess = guessed[((x * self.by) >> reduced).min(last.1)];
            disparity = if guess.is_nan() { disparity } else { nearest((guess * share).into()) };
            let column = (x as i32 - disparity - off).clamp(0, last_column) as usize;
            line[x] = (left[x] ^ right[column]).count_ones() as u8;
        }
    }
}

/// Sums of neighboring columns of a row of blocks, of which `top` is the first of `count` rows.
struct Windows<'a> {
    costs: &'a Costs<'a>,
    rows: usize,
    cols: usize,
    top: usize,
    count: usize,
    columns: Range<usize>,
}

/// Calls `each(row, column, sums of all candidates)` for every pixel of the windows.
struct Visit<'a, F> {
    windows: Windows<'a>,
    each: F,
}

impl<F: FnMut(usize, usize, &[Lanes<u8>])> Loop for Visit<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { windows: Windows { costs, rows, cols, top, count, columns }, mut each } = self;
        let runs = costs.runs();

        // The windows reach beyond the columns; at the border of the image its last pixel is repeated.
        let first = columns.start.saturating_sub(AROUND.1);
        let wide = first..(columns.end + AROUND.1).min(cols);
        let length = wide.len() * runs;
        let clamped = |y: usize| y.saturating_sub(AROUND.0).min(rows - 1);

        let mut line = vec![[0u8; LANES]; length];
        let mut sums = vec![[0u8; LANES]; length];
        let mut window = vec![[0u8; LANES]; runs];
        for y in top..top + count {
            if y > top {
                costs.write::<u8>(clamped(y - 1), wide.clone(), costs.searched(), &mut line);
                add(&mut sums, &line, u8::wrapping_sub);
            }
            let begun = if y == top { 0..WINDOW.0 } else { WINDOW.0 - 1..WINDOW.0 };
            for number in begun {
                costs.write::<u8>(clamped(y + number), wide.clone(), costs.searched(), &mut line);
                add(&mut sums, &line, u8::wrapping_add);
            }

            for x in columns.clone() {
                let column = |x: usize| {
                    let at =
                        x.saturating_sub(AROUND.1).clamp(wide.start, wide.end - 1) - wide.start;
                    &sums[at * runs..][..runs]
                };
                let [before, here, after] = [column(x), column(x + 1), column(x + 2)];
                window.copy_from_slice(here);
                add(&mut window, before, u8::wrapping_add);
                add(&mut window, after, u8::wrapping_add);
                each(y - top, x, &window);
            }
        }
    }
}

/// Adds, or subtracts, every lane.
#[inline(always)]
fn add(sums: &mut [Lanes<u8>], terms: &[Lanes<u8>], step: impl Fn(u8, u8) -> u8) {
    // Whole runs by value: the compiler does not know that sums and terms are apart.
    for (sums, terms) in sums.iter_mut().zip(terms) {
        let (mut summed, terms) = (*sums, *terms);
        for lane in 0..LANES {
            summed[lane] = step(summed[lane], terms[lane]);
        }
        *sums = summed;
    }
}

/// Which candidates see the right image, and which lie along the run.
struct Borders {
    cols: usize,
    count: usize,
    /// From place `cols - 1 - x` on, for candidate after candidate: 0 where column `x` sees the right image, else 255.
    beyond: Vec<u8>,
    /// 255 for the candidates along the run, else 0; and 255 for those outside it. Lanes beyond the last one have 255.
    excluded: [Vec<Lanes<u8>>; 2],
}

impl Borders {
    fn new(costs: &Costs, cols: usize, along: Range<usize>) -> Self {
        let (candidates, lanes) = (costs.candidates(), costs.runs() * LANES);
        let is_within =
            |place: usize| (0..cols as isize).contains(&(place as isize + candidates.min()));
        let byte = |is_none: bool| if is_none { u8::MAX } else { 0 };

        let beyond = (0..cols + lanes).map(|place| byte(!is_within(place))).collect();
        let excluded = [true, false].map(|is_excluded| {
            let is_one = |k: usize| k >= candidates.count() || along.contains(&k) == is_excluded;
            let bytes: Vec<u8> = (0..lanes).map(|k| byte(is_one(k))).collect();
            bytes.as_chunks().0.to_vec()
        });
        Self { cols, count: candidates.count(), beyond, excluded }
    }

    /// The least sums of column `x` outside the run and along it.
    #[inline(always)]
    fn least(&self, sums: &[Lanes<u8>], x: usize) -> [u8; 2] {
        let beyond = self.beyond[self.cols - 1 - x..].as_chunks::<LANES>().0;
        let (mut outside, mut along) = ([u8::MAX; LANES], [u8::MAX; LANES]);

        for run in 0..sums.len() {
            let (sums, beyond) = (sums[run], beyond[run]);
            let excluded = [self.excluded[0][run], self.excluded[1][run]];
            for lane in 0..LANES {
                let sum = sums[lane] | beyond[lane];
                outside[lane] = outside[lane].min(sum | excluded[0][lane]);
                along[lane] = along[lane].min(sum | excluded[1][lane]);
            }
        }
        [least_lane(&outside), least_lane(&along)]
    }

    /// What stands out outside the run.
    #[inline(always)]
    fn outside(&self, sums: &[Lanes<u8>], x: usize) -> Option<Found> {
        let [own, along] = self.least(sums, x);
        if 8 * u32::from(own) >= 7 * u32::from(along) {
            return None;
        }

        let beyond = &self.beyond[self.cols - 1 - x..][..self.count];
        let sums = &sums.as_flattened()[..self.count];
        let is_along = &self.excluded[0].as_flattened()[..self.count];
        let chosen = (0..self.count).find(|k| sums[*k] | beyond[*k] | is_along[*k] == own)?;

        let least = |within: Range<usize>| {
            let known = sums[within.clone()].iter().zip(&beyond[within]);
            known.fold(u8::MAX, |least, (sum, beyond)| least.min(sum | beyond))
        };
        let before = least(0..chosen.saturating_sub(NEXT));
        let after = least((chosen + NEXT + 1).min(self.count)..self.count);
        let others = along.min(before).min(after);

        let stands_out = 8 * u32::from(own) < 7 * u32::from(others);
        stands_out.then(|| Found { chosen: chosen as u16, gain: u16::from(others - own) })
    }
}

/// The candidate of a pixel with the least sum, of those that see the other image.
struct Choose<'a> {
    costs: &'a Costs<'a>,
    rows: usize,
    cols: usize,
    y: usize,
    x: usize,
}

impl Loop for Choose<'_> {
    type Output = usize;

    #[inline(always)]
    fn run(self) -> usize {
        let Self { costs, rows, cols, y, x } = self;
        let (candidates, runs) = (costs.candidates(), costs.runs());
        let mut line = vec![[0u8; LANES]; runs];
        let mut sums = vec![[0u8; LANES]; runs];

        for dy in 0..WINDOW.0 {
            let y = (y + dy).saturating_sub(AROUND.0).min(rows - 1);
            for dx in 0..WINDOW.1 {
                let x = (x + dx).saturating_sub(AROUND.1).min(cols - 1);
                costs.write::<u8>(y, x..x + 1, costs.searched(), &mut line);
                add(&mut sums, &line, u8::wrapping_add);
            }
        }

        // x - d is a column from 0 on, and before the last.
        let index = |disparity: isize| {
            (disparity - candidates.min()).clamp(0, candidates.count() as isize) as usize
        };
        let (start, end) = (index(x as isize + 1 - cols as isize), index(x as isize + 1));
        let sums = &sums.as_flattened()[start..end];
        let least = sums.iter().enumerate().min_by_key(|(_, sum)| **sum);
        start + least.map_or(0, |(k, _)| k)
    }
}

/// The pixels of each area; those that stand out are in the order of their places.
fn connected(found: &[Member], cols: usize) -> Vec<Vec<Member>> {
    let mut is_open = vec![true; found.len()];
    let mut areas = vec![];

    for start in 0..found.len() {
        if !is_open[start] {
            continue;
        }
        is_open[start] = false;
        let mut members = vec![found[start]];
        let mut next = 0;

        while let Some((at, one)) = members.get(next).copied() {
            next += 1;
            let (y, x) = (at / cols, at % cols);
            for row in y.saturating_sub(GAP)..=y + GAP {
                let columns = x.saturating_sub(GAP)..(x + GAP + 1).min(cols);
                let first = found.partition_point(|(at, _)| *at < row * cols + columns.start);
                let end = row * cols + columns.end;

                for neighbor in (first..found.len()).take_while(|index| found[*index].0 < end) {
                    let apart = found[neighbor].1.chosen.abs_diff(one.chosen);
                    if is_open[neighbor] && apart <= 1 {
                        is_open[neighbor] = false;
                        members.push(found[neighbor]);
                    }
                }
            }
        }

        if members.len() >= LEAST_SIZE {
            areas.push(members);
        }
    }

    areas
}

//! Areas that match outside the run of disparities of most of the pair: small, near or thin objects.
//!
//! Where pixels cost much along the run, every disparity within reach is tried, on copies of the images, with
//! the codes of small neighborhoods summed over small windows, which objects a few pixels wide fill. A rough
//! match of the run first shows where that may be: most pixels cost little at the disparities that it found.
//!
//! ```text
//! sum(y, x, d)    = bits in which the codes of left (y, x) and right (y, x - d) differ,
//!                   summed over a window around them
//! guessed         = the same sum, but each pixel of the window has the disparity that the rough match
//!                   found there; if that is one of smaller copies, the least of those that it stands for
//! usual           = the median of guessed, of the pixels that see the middle of the run
//! much            = usual + bits of the window / DEAR
//! doubtful pixel  = guessed is above much in MANY pixels of its block,
//!                   and so is the least sum along the run of the pixel
//! block           = searched if it has MANY doubtful pixels
//! own, d          = min, argmin of sum(y, x, d) over the d outside the run
//! along           = min of sum(y, x, d) over the run
//! elsewhere       = min of sum(y, x, d') over all d' but d and those NEXT to it
//! stands out      = own < 7/8 min(along, elsewhere)
//! area            = pixels that stand out, connected over at most GAP rows and columns
//!                   by disparities that differ by 1 at most
//! seen            = the same search from the right image at x - d finds -d, or one NEXT to it
//! gain            = sum of min(along, elsewhere) - own over an area: by how many bits it is better explained
//! ```
//!
//! Objects of a few pixels are lost in copies of half the size: on a bar of 4 px, the true disparity costs 83
//! of 216 bits there, the best along the run 55; at full size 41 and 68 of 200. The finest copies are too
//! large to be searched wherever the smaller ones cost much. Votes of sparse pixels nominate the blocks to
//! search:
//!
//! ```text
//! chance          = the median of the least sums along the run where the right image has other rows
//! much            = at most halfway from usual to chance
//! vote(block, d)  = bits in which the codes of the doubtful pixels of a block of the finest copies differ,
//!                   of every VOTING-th row
//! nominated       = blocks whose vote stands out, with their neighbors,
//!                   where those that agree gain NOMINATED bits
//! ```

mod blocks;
mod sums;

use std::ops::Range;

use rayon::prelude::*;

pub use self::blocks::{BLOCK, Blocks, SAMPLED};
use self::sums::{BlockWindows, Borders, SumGuessed, choose, visit};
pub use self::sums::{NEXT, Voters, vote};
use super::extent::Span;
use super::overview::{Guess, Overview};
use crate::estimation::blur::rough::{raised, rough_gray};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::both;
use phasestereo_match::base::value::Lanes;
use phasestereo_match::cost::phase::ByteDistances;
use phasestereo_match::descriptor::describe_roughly;
use phasestereo_match::matcher::Execution;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;

/// Rows and columns on either side of the middle of a window. Sums over it of 8-bit codes fit into a byte.
pub type Around = (usize, usize);
/// Tall windows lie within upright objects, ...
const TALL: Around = (4, 1);
/// ... flat ones within horizontal bars, ...
const FLAT: Around = (1, 2);
/// ... and small ones of the finest copies within both.
const SQUARE: Around = (2, 2);
/// Rows of a task that sums at the guessed disparities.
const GUESSED_ROWS: usize = 64;
/// Sums above the median by more than a window's bits divided by this are much.
const DEAR: usize = 8;
/// Bits by which the votes of neighboring blocks must agree to be searched. Not swept.
const NOMINATED: u64 = 15;
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
    /// Number of them that are found again from the right image.
    pub seen: usize,
    /// Bits by which its pixels are better explained than by any other disparity.
    pub gain: u64,
}

/// A pixel that stands out.
#[derive(Debug, Clone, Copy)]
pub struct Standout {
    /// The candidate with the least sum outside the run.
    pub chosen: u16,
    /// Bits by which it fits better than anything else.
    pub gain: u16,
}

/// A pixel that stands out, and its place in the copy.
type Member = (usize, Standout);

/// The search: the codes of both copies, and the run.
struct AreaSearch<'a> {
    codes: [Plane<u8>; 2],
    /// Whether the pixels of the left copy are valid.
    valid: &'a Plane<bool>,
    run: Span,
    around: Around,
    runtime: Runtime<'a>,
}

/// The areas that match outside a run of disparities of the copies, among those tried, from the top left.
pub fn areas(
    copies: &Overview,
    guess: Guess,
    run: Span,
    tried: Span,
    field: Option<&Alignment>,
    runtime: Runtime,
) -> Result<Vec<Area>> {
    let search = AreaSearch::new(copies, run, TALL, field, runtime)?;
    let doubtful = search.doubtful(guess, false)?;
    search.areas(tried, &Blocks::of(&doubtful))
}

/// The areas of the finest copies: of objects so small or thin that copies of half their size, or of the
/// same, hardly show them. `guess` is for `copies`, `run` and `tried` are disparities of the finest.
pub fn fine_areas(
    [finest, copies]: [&Overview; 2],
    guess: Guess,
    run: Span,
    tried: Span,
    field: Option<&Alignment>,
    runtime: Runtime,
) -> Result<Vec<Area>> {
    let by = copies.factor / finest.factor;
    let coarse = (run.0.div_euclid(by as isize), run.1.div_euclid(by as isize));
    let doubtful = AreaSearch::new(copies, coarse, FLAT, field, runtime)?.doubtful(guess, true)?;
    if !doubtful.as_slice().contains(&true) {
        return Ok(vec![]);
    }

    let search = AreaSearch::new(finest, run, SQUARE, field, runtime)?;
    search.areas(tried, &search.nominated(tried, &doubtful, by)?)
}

impl<'a> AreaSearch<'a> {
    fn new(
        copies: &'a Overview,
        run: Span,
        around: Around,
        field: Option<&Alignment>,
        runtime: Runtime<'a>,
    ) -> Result<Self> {
        let codes = codes_of(copies, field, runtime)?;
        Ok(Self { codes, valid: &copies.valid, run, around, runtime })
    }

    /// The areas in these blocks, with a span of disparities tried.
    fn areas(&self, tried: Span, blocks: &Blocks) -> Result<Vec<Area>> {
        if !blocks.is_searched.contains(&true) {
            return Ok(vec![]);
        }
        let Runtime { execution, control, .. } = self.runtime;
        let [left, right] = &self.codes;
        let cols = left.cols();
        let tried = Candidates::of_span(tried, cols)?;
        let mut areas = connected(&self.outside(tried, blocks)?, cols);
        areas.retain(|members| members.len() >= LEAST_SIZE);

        // The same from the right image, where disparities are negative.
        let mirrored = Candidates::of_span((-tried.max(), -tried.min()), cols)?;
        let back = ByteDistances::new([right, left], mirrored)?;
        let is_seen = |(at, found): &&Member| {
            let x = tried.column(at % cols, found.chosen.into(), cols);
            let there = mirrored.disparity(choose(
                execution.level,
                &back,
                left.rows(),
                cols,
                at / cols,
                x,
                self.around,
            ));
            (there + tried.disparity(found.chosen.into())).unsigned_abs() <= NEXT
        };

        let area = |members: &Vec<Member>| {
            control.checkpoint()?;
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

    /// The pixels that cost much along the run, in blocks with enough of them, among those that see its
    /// middle. With `is_halved`, much is at most halfway to the cost of unlike rows.
    fn doubtful(&self, guess: Guess, is_halved: bool) -> Result<Plane<bool>> {
        let (rows, cols) = self.codes[0].size();
        let sums = self.guessed(guess)?;

        let middle = (self.run.0 + self.run.1).div_euclid(2);
        // The columns whose matches in the middle of the run lie within the image.
        let column = |x: isize| x.clamp(0, cols as isize) as usize;
        let seen = column(middle)..column(cols as isize + middle);
        let seen = seen.start.min(seen.end)..seen.end;
        let judged = |y: usize| {
            let places = sums.row(y)[seen.clone()].iter().zip(&self.valid.row(y)[seen.clone()]);
            places.filter(|(_, is_valid)| **is_valid).map(|(sum, _)| *sum)
        };
        let usual = median((0..rows).flat_map(judged));
        let bits = 8 * (2 * self.around.0 + 1) * (2 * self.around.1 + 1);
        let mut most = usual + bits / DEAR;
        if is_halved {
            most = most.min(usize::midpoint(usual, self.chance()?));
        }

        let much = |sums: &Plane<u8>| -> Result<Plane<bool>> {
            let mut much = Plane::new(rows, cols)?;
            for y in 0..rows {
                let [valid, asked] = [self.valid, guess.judged.unwrap_or(self.valid)].map(|all| all.row(y));
                let [valid, asked] = [valid, asked].map(|all| &all[seen.clone()]);
                let places = sums.row(y)[seen.clone()].iter().zip(valid).zip(asked);
                for (is_much, ((sum, valid), asked)) in much.row_mut(y)[seen.clone()].iter_mut().zip(places) {
                    *is_much = valid & asked & (usize::from(*sum) > most);
                }
            }
            Ok(much)
        };
        // Most of these are errors of the rough match.
        let blocks = Blocks::of(&much(&sums)?);
        if !blocks.is_searched.contains(&true) {
            return Plane::new(rows, cols);
        }
        let [left, right] = &self.codes;
        much(&self.along([left, right], &blocks)?)
    }

    /// The median of the least sums along the run of unrelated rows.
    fn chance(&self) -> Result<usize> {
        let [left, right] = &self.codes;
        let (rows, cols) = left.size();
        let (above, below) = right.as_slice().split_at(rows / 2 * cols);
        let other = Plane::from_vec(rows, cols, [below, above].concat())?;
        let least = self.along([left, &other], &Blocks::sampled(rows, cols))?;
        Ok(median(least.as_slice().iter().copied().filter(|sum| *sum > 0)))
    }

    /// The sums at the guessed disparities.
    fn guessed(&self, guess: Guess) -> Result<Plane<u8>> {
        let [left, right] = &self.codes;
        let Runtime { execution, control, .. } = self.runtime;

        let mut sums = Plane::new(left.rows(), left.cols())?;
        sums.write_bands(GUESSED_ROWS, |top, band| {
            control.checkpoint()?;
            band.fill(u8::MAX);
            // A disparity of smaller copies represents several here.
            let within = guess.finer as i32 / 2;
            for off in -within..=within {
                let (codes, run, around) = ([left, right], self.run, self.around);
                let sums = &mut *band;
                execution.level.run(SumGuessed { codes, guess, run, around, off, top, sums });
            }
            Ok(())
        })?;
        Ok(sums)
    }

    /// The least sums along the run in these blocks, 0 elsewhere.
    fn along(&self, codes: [&Plane<u8>; 2], blocks: &Blocks) -> Result<Plane<u8>> {
        let (rows, cols) = codes[0].size();
        let costs = ByteDistances::new(codes, Candidates::of_span(self.run, cols)?)?;
        let borders = Borders::new(&costs, cols, 0..0);

        let mut least = Plane::new(rows, cols)?;
        least.write_bands(BLOCK, |top, band| {
            self.runtime.control.checkpoint()?;
            let (count, around) = (band.len() / cols, self.around);
            for columns in blocks.stretches(top / BLOCK, cols) {
                let windows = BlockWindows { costs: &costs, rows, cols, top, count, columns, around };
                let each = |y: usize, x: usize, sums: &[Lanes<u8>]| {
                    band[y * cols + x] = borders.least(sums, x)[0];
                };
                visit(self.runtime.level(), windows, each);
            }
            Ok(())
        })?;
        Ok(least)
    }

    /// The blocks whose doubtful pixels agree with those of their neighbors on a disparity outside the run.
    fn nominated(&self, tried: Span, doubtful: &Plane<bool>, by: usize) -> Result<Blocks> {
        let [left, right] = &self.codes;
        let cols = left.cols();
        let tried = Candidates::of_span(tried, cols)?;
        let costs = ByteDistances::new([left, right], tried)?;
        let borders = self.borders(&costs);
        let blocks = Blocks::of_larger(doubtful, by, (left.rows(), cols));
        let voters = Voters { doubtful, by, rows: left.rows(), cols };

        let of_row = |row: usize| -> Result<Vec<Member>> {
            self.runtime.control.checkpoint()?;
            let vote = |column: usize| {
                let block = (row * BLOCK, column * BLOCK);
                let sums = vote(self.runtime.level(), &costs, voters, block);
                let found = borders.outside(&sums, block.1)?;
                Some((row * blocks.cols + column, found))
            };
            let is_asked = |column: &usize| blocks.is_searched[row * blocks.cols + column];
            Ok((0..blocks.cols).filter(is_asked).filter_map(vote).collect())
        };
        let height = blocks.is_searched.len() / blocks.cols;
        let found: Result<Vec<_>> = (0..height).into_par_iter().map(of_row).collect();

        let mut nominated = Blocks::none(left.rows(), cols);
        for members in connected(&found?.concat(), blocks.cols) {
            let gain: u64 = members.iter().map(|(_, found)| u64::from(found.gain)).sum();
            if gain >= NOMINATED {
                for (at, _) in members {
                    nominated.search_around(at);
                }
            }
        }
        Ok(nominated)
    }

    /// Which of the candidates lie along the run.
    fn borders(&self, costs: &ByteDistances) -> Borders {
        let tried = costs.candidates();
        let along = tried.index(self.run.0 - 1)..tried.index(self.run.1 + 2);
        Borders::new(costs, self.codes[0].cols(), along)
    }

    /// The pixels of these blocks that stand out, row after row.
    fn outside(&self, tried: Candidates, blocks: &Blocks) -> Result<Vec<Member>> {
        let [left, right] = &self.codes;
        let (rows, cols) = left.size();
        let costs = ByteDistances::new([left, right], tried)?;
        let borders = self.borders(&costs);

        let of_row = |row: usize| -> Result<Vec<Member>> {
            self.runtime.control.checkpoint()?;
            let top = row * BLOCK;
            let (count, around) = (BLOCK.min(rows - top), self.around);
            let mut found = vec![];
            for columns in blocks.stretches(row, cols) {
                let windows = BlockWindows { costs: &costs, rows, cols, top, count, columns, around };
                let each = |y: usize, x: usize, sums: &[Lanes<u8>]| {
                    let one = borders.outside(sums, x);
                    found.extend(one.map(|one| ((top + y) * cols + x, one)));
                };
                visit(self.runtime.level(), windows, each);
            }
            found.sort_unstable_by_key(|(at, _)| *at);
            Ok(found)
        };

        let found: Result<Vec<_>> = (0..rows.div_ceil(BLOCK)).into_par_iter().map(of_row).collect();
        Ok(found?.concat())
    }
}

/// The codes of both copies, the right one resampled by a field.
pub fn codes_of(copies: &Overview, field: Option<&Alignment>, runtime: Runtime) -> Result<[Plane<u8>; 2]> {
    let Runtime { execution: Execution { level, .. }, control, .. } = runtime;
    both(|side| {
        let plane = &copies.planes[side];
        let gray = match field {
            Some(field) if side == 1 => rough_gray(&raised(plane, field, copies.factor, control)?, runtime),
            _ => rough_gray(plane, runtime),
        };
        describe_roughly(&gray?, &codes(), level, control)
    })
}

/// The settings of the codes: 8 bits, from the smallest neighborhoods.
fn codes() -> Settings {
    Settings { neighborhood: 3, frequencies: (1, 1), ..Preset::Paper.settings() }
}

/// The median of sums; 0 without any.
pub fn median(sums: impl Iterator<Item = u8>) -> usize {
    let mut counts = [0usize; u8::MAX as usize + 1];
    sums.for_each(|sum| counts[usize::from(sum)] += 1);
    let half = counts.iter().sum::<usize>() / 2;
    let mut sum = 0;
    let at = counts.iter().position(|count| {
        sum += count;
        sum > half
    });
    at.unwrap_or_default()
}

/// The pixels of each area; `found` is in the order of places.
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

        areas.push(members);
    }

    areas
}

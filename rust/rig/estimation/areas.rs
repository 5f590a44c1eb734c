//! Areas that match outside the run of disparities that most of a pair has: small, near or thin things.
//!
//! Where pixels cost much along the run, every disparity within reach is tried, on copies of the images, by the codes of
//! small neighborhoods summed over small windows: things a few pixels wide fill them.
//!
//! ```text
//! sum(y, x, d)    = bits in which the codes of left (y, x) and right (y, x - d) differ, summed over WINDOW around them
//! block           = searched if in MANY of its pixels the least sum along the run is above the median plus DEAR
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

use super::overview::{Overview, Span};
use crate::cost::Costs;
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::image::plane::Plane;
use crate::image::view::View;
use crate::rig::alignment::Alignment;
use crate::rig::blur::parts::Means;
use crate::rig::blur::rough::{as_view, raised};
use crate::settings::Settings;
use crate::settings::presets::Preset;
use crate::simd::Loop;
use crate::value::{LANES, Lanes};

/// Rows, and columns, on either side of the middle of a window: tall ones lie within upright things. Sums over them of
/// codes of 8 bits fit a byte.
const AROUND: (usize, usize) = (4, 1);
/// Rows and columns of a window.
const WINDOW: (usize, usize) = (2 * AROUND.0 + 1, 2 * AROUND.1 + 1);
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

/// What is known of a pixel of the copies.
#[derive(Debug, Clone, Copy)]
struct Best {
    /// The candidate with the least sum outside the run.
    chosen: u16,
    /// That sum.
    own: u8,
    /// The least sum along the run.
    along: u8,
    /// The least sum of all candidates not next to the chosen one.
    elsewhere: u8,
}

impl Best {
    /// Not searched.
    const NONE: Self = Self { chosen: 0, own: u8::MAX, along: 0, elsewhere: 0 };

    /// Whether nothing else fits nearly as well.
    fn stands_out(self) -> bool {
        8 * u32::from(self.own) < 7 * u32::from(self.along.min(self.elsewhere))
    }

    /// By how many bits nothing else fits as well.
    fn gain(self) -> u64 {
        self.along.min(self.elsewhere).saturating_sub(self.own).into()
    }
}

/// The blocks of an image that are searched.
struct Blocks {
    cols: usize,
    is_searched: Vec<bool>,
}

/// The areas that match outside a run of disparities of the copies, from the top left. `low` to `high` are tried.
pub fn areas(
    copies: &Overview,
    run: Span,
    (low, high): Span,
    field: Option<&Alignment>,
    means: Means,
) -> Result<Vec<Area>> {
    let [left, right] = &copies.planes;
    let (rows, cols) = (left.rows(), left.cols());
    let right = match field {
        Some(field) => raised(right, field, copies.factor, means.control)?,
        None => right.clone(),
    };
    let views = [as_view(left.clone()), as_view(right)];
    let [left, right] = &views;

    let candidates = |(low, high): Span| {
        let count = (high - low + 1).clamp(1, cols as isize);
        let low = low.clamp(1 - cols as isize - (count - 1), cols as isize - 1);
        Candidates::new(low as i64, count as i64, cols)
    };
    let blocks = Blocks::searched([left, right], copies, candidates(run)?, run, means)?;
    if !blocks.is_searched.contains(&true) {
        return Ok(vec![]);
    }

    let tried = candidates((low, high))?;
    let index =
        |disparity: isize| (disparity - tried.min()).clamp(0, tried.count() as isize) as usize;
    let along = index(run.0 - 1)..index(run.1 + 2);

    let found = searched([left, right], tried, along, &blocks, means)?;
    let areas = connected(&found, (rows, cols), |at| found[at].stands_out());
    if areas.is_empty() {
        return Ok(vec![]);
    }

    // The same from the right image, only where these areas are seen there.
    let mut is_hit = Plane::new(rows, cols)?;
    let at_right = |at: usize| {
        let column = tried.column(at % cols, usize::from(found[at].chosen), cols);
        (at / cols, column)
    };
    for at in areas.iter().flatten() {
        let (y, x) = at_right(*at);
        is_hit.row_mut(y)[x] = true;
    }
    // From the right image, disparities are negative.
    let mirrored = candidates((-tried.disparity(tried.count() - 1), -tried.min()))?;
    let blocks = Blocks::with_at_least(1, &is_hit);
    let back = searched([right, left], mirrored, 0..0, &blocks, means)?;
    let is_seen = |at: usize| {
        let (y, x) = at_right(at);
        let expected = tried.count() - 1 - usize::from(found[at].chosen);
        usize::from(back[y * cols + x].chosen).abs_diff(expected) <= NEXT
    };

    let area = |pixels: &Vec<usize>| {
        let bounds = |of: &dyn Fn(usize) -> usize| {
            let values = pixels.iter().map(|at| of(*at));
            let least = values.clone().min().unwrap_or_default();
            (least, values.max().unwrap_or_default())
        };
        let (top, bottom) = bounds(&|at| at / cols);
        let (first, last) = bounds(&|at| at % cols);
        let (nearest, farthest) = bounds(&|at| usize::from(found[at].chosen));

        Area {
            rows: top..bottom + 1,
            columns: first..last + 1,
            span: (tried.disparity(nearest), tried.disparity(farthest)),
            size: pixels.len(),
            seen: pixels.iter().filter(|at| is_seen(**at)).count(),
            gain: pixels.iter().map(|at| found[*at].gain()).sum(),
        }
    };

    Ok(areas.iter().map(area).collect())
}

impl Blocks {
    /// The blocks with enough pixels that cost much along a run, of those that see the middle of it.
    fn searched(
        views: [&View; 2],
        copies: &Overview,
        candidates: Candidates,
        run: Span,
        means: Means,
    ) -> Result<Self> {
        let (rows, cols, _) = views[0].image.shape();
        let all = Self::with_at_least(0, &Plane::new(rows, cols)?);
        let found = searched(views, candidates, 0..0, &all, means)?;

        let middle = (run.0 + run.1).div_euclid(2);
        let is_judged = |y: usize, x: usize| {
            copies.valid.row(y)[x] && (0..cols as isize).contains(&(x as isize - middle))
        };
        let mut counts = [0usize; u8::MAX as usize + 1];
        for (at, best) in found.iter().enumerate() {
            counts[usize::from(best.own)] += usize::from(is_judged(at / cols, at % cols));
        }
        let half = counts.iter().sum::<usize>() / 2;
        let mut sum = 0;
        let median = counts.iter().position(|count| {
            sum += count;
            sum > half
        });

        let most = median.unwrap_or_default() + DEAR;
        let costs_much =
            |y: usize, x: usize| is_judged(y, x) && usize::from(found[y * cols + x].own) > most;
        Ok(Self::with_at_least(MANY, &Plane::from_fn(rows, cols, costs_much)))
    }

    /// The blocks with so many of these pixels.
    fn with_at_least(least: usize, pixels: &Plane<bool>) -> Self {
        let cols = pixels.cols().div_ceil(BLOCK);
        let mut counts = vec![0; pixels.rows().div_ceil(BLOCK) * cols];

        for y in 0..pixels.rows() {
            for (x, is_one) in pixels.row(y).iter().enumerate() {
                counts[y / BLOCK * cols + x / BLOCK] += usize::from(*is_one);
            }
        }

        let is_searched = counts.into_iter().map(|count| count >= least).collect();
        Self { cols, is_searched }
    }

    /// The columns of neighboring blocks of a row of blocks that are searched.
    fn stretches(&self, row: usize, cols: usize) -> Vec<Range<usize>> {
        let mut stretches: Vec<Range<usize>> = vec![];
        for (block, is_searched) in
            self.is_searched[row * self.cols..(row + 1) * self.cols].iter().enumerate()
        {
            let (start, end) = (block * BLOCK, ((block + 1) * BLOCK).min(cols));
            match stretches.last_mut() {
                Some(last) if *is_searched && last.end == start => last.end = end,
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

/// The best candidates of the pixels of these blocks.
fn searched(
    views: [&View; 2],
    candidates: Candidates,
    along: Range<usize>,
    blocks: &Blocks,
    Means { how, control, .. }: Means,
) -> Result<Vec<Best>> {
    let (rows, cols, _) = views[0].image.shape();
    let costs = Costs::new(views, candidates, &codes(), None, how.level, control)?;

    let mut found = vec![Best::NONE; rows * cols];
    found.par_chunks_mut(BLOCK * cols).enumerate().try_for_each(|(row, found)| {
        control.checkpoint()?;
        for columns in blocks.stretches(row, cols) {
            let along = along.clone();
            let top = row * BLOCK;
            let search = SearchStretch { costs: &costs, along, rows, cols, top, columns, found };
            how.level.run(search);
        }
        Ok(())
    })?;

    Ok(found)
}

/// Searches neighboring columns of a row of blocks, of which `top` is the first row.
struct SearchStretch<'a> {
    costs: &'a Costs<'a>,
    along: Range<usize>,
    rows: usize,
    cols: usize,
    top: usize,
    columns: Range<usize>,
    /// All columns of the row of blocks.
    found: &'a mut [Best],
}

impl Loop for SearchStretch<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { costs, along, rows, cols, top, columns, found } = self;
        let runs = costs.runs();

        // The windows of the stretch reach beyond it; at the border of the image its last pixel is repeated.
        let first = columns.start.saturating_sub(AROUND.1);
        let wide = first..(columns.end + AROUND.1).min(cols);
        let length = wide.len() * runs;
        let clamped = |y: usize| y.saturating_sub(AROUND.0).min(rows - 1);

        // The costs of the rows of a window, in turns, and their sums.
        let mut lines = vec![[0u8; LANES]; WINDOW.0 * length];
        let mut sums = vec![[0u8; LANES]; length];
        let mut window = vec![[0u8; LANES]; runs];

        for y in top..top + found.len() / cols {
            let begun = if y == top { 0..WINDOW.0 } else { WINDOW.0 - 1..WINDOW.0 };
            for number in begun {
                let line = &mut lines[(y + number) % WINDOW.0 * length..][..length];
                add(&mut sums, line, u8::wrapping_sub);
                costs.write::<u8>(clamped(y + number), wide.clone(), line);
                add(&mut sums, line, u8::wrapping_add);
            }

            // The sums of a column of the stretch.
            let column = |x: usize| {
                let at = x.saturating_sub(AROUND.1).clamp(wide.start, wide.end - 1) - wide.start;
                &sums[at * runs..][..runs]
            };
            window.fill([0; LANES]);
            for number in 0..WINDOW.1 {
                add(&mut window, column(columns.start + number), u8::wrapping_add);
            }

            for x in columns.clone() {
                found[(y - top) * cols + x] = best(&window, costs.candidates(), &along, x, cols);
                add(&mut window, column(x), u8::wrapping_sub);
                add(&mut window, column(x + WINDOW.1), u8::wrapping_add);
            }
        }
    }
}

/// Adds, or subtracts, every lane.
#[inline(always)]
fn add(sums: &mut [Lanes<u8>], terms: &[Lanes<u8>], step: impl Fn(u8, u8) -> u8) {
    for (sums, terms) in sums.iter_mut().zip(terms) {
        for lane in 0..LANES {
            sums[lane] = step(sums[lane], terms[lane]);
        }
    }
}

/// The best candidate of column `x` outside the run, of those that see the right image.
#[inline(always)]
fn best(
    window: &[Lanes<u8>],
    candidates: Candidates,
    along: &Range<usize>,
    x: usize,
    cols: usize,
) -> Best {
    let sums = &window.as_flattened()[..candidates.count()];
    let index = |disparity: isize| {
        (disparity - candidates.min()).clamp(0, candidates.count() as isize) as usize
    };
    // x - d is a column from 0 on, and before the last.
    let (start, end) = (index(x as isize + 1 - cols as isize), index(x as isize + 1));
    let along = along.start.clamp(start, end)..along.end.clamp(start, end);

    let below = least(&sums[start..along.start]);
    let above = least(&sums[along.end..end]);
    let own = below.min(above);
    let within = if below <= above { start..along.start } else { along.end..end };
    let Some(place) = sums[within.clone()].iter().position(|sum| *sum == own) else {
        return Best::NONE;
    };
    let chosen = within.start + place;

    let before = start..chosen.saturating_sub(NEXT).max(start);
    let after = (chosen + NEXT + 1).min(end)..end;
    let elsewhere = least(&sums[before]).min(least(&sums[after]));
    Best { chosen: chosen as u16, own, along: least(&sums[along]), elsewhere }
}

/// The least of some sums.
#[inline(always)]
fn least(sums: &[u8]) -> u8 {
    sums.iter().fold(u8::MAX, |least, sum| least.min(*sum))
}

/// The pixels of each area.
fn connected(
    found: &[Best],
    (rows, cols): (usize, usize),
    is_found: impl Fn(usize) -> bool,
) -> Vec<Vec<usize>> {
    let mut is_open: Vec<bool> = (0..rows * cols).map(is_found).collect();
    let mut areas = vec![];

    for start in 0..rows * cols {
        if !is_open[start] {
            continue;
        }
        is_open[start] = false;
        let mut pixels = vec![start];
        let mut next = 0;

        while let Some(at) = pixels.get(next).copied() {
            next += 1;
            let (y, x) = (at / cols, at % cols);
            for row in y.saturating_sub(GAP)..(y + GAP + 1).min(rows) {
                for neighbor in
                    row * cols + x.saturating_sub(GAP)..row * cols + (x + GAP + 1).min(cols)
                {
                    let apart = found[neighbor].chosen.abs_diff(found[at].chosen);
                    if is_open[neighbor] && apart <= 1 {
                        is_open[neighbor] = false;
                        pixels.push(neighbor);
                    }
                }
            }
        }

        if pixels.len() >= LEAST_SIZE {
            areas.push(pixels);
        }
    }

    areas
}

//! Loops over sums of the bits in which codes differ: at the guessed disparities, for all candidates, and for
//! blocks.

use std::ops::Range;

use super::blocks::BLOCK;
use super::{Around, Standout};
use crate::estimation::extent::Span;
use crate::estimation::overview::Guess;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, Loop, leveled};
use phasestereo_match::base::value::{LANES, Lanes, least_lane, nearest};
use phasestereo_match::cost::phase::ByteDistances;

/// Disparities this near see the same match.
pub const NEXT: usize = 2;
/// One in this many rows of a block votes: neighboring rows mostly agree. Not swept.
const VOTING: usize = 2;

/// Lowers sums to those at this offset from the guessed disparities, for a band of rows from `top` on.
pub struct SumGuessed<'a> {
    pub codes: [&'a Plane<u8>; 2],
    pub guess: Guess<'a>,
    pub run: Span,
    pub around: Around,
    pub off: i32,
    pub top: usize,
    pub sums: &'a mut [u8],
}

impl Loop for SumGuessed<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { codes, guess, run, around, off, top, sums } = self;
        let (rows, cols) = codes[0].size();
        let clamped = |y: usize| y.saturating_sub(around.0).min(rows - 1);
        let height = 2 * around.0 + 1;

        // The differences of the rows of a window, in turns, and their sums by column; at the border the last
        // pixel is repeated.
        let mut lines = vec![0u8; height * cols];
        let mut columns = vec![0u8; cols + 2 * around.1];
        let mut window = vec![0u8; cols];
        for (row, sums) in sums.chunks_exact_mut(cols).enumerate() {
            let y = top + row;
            let begun = if row == 0 { 0..height } else { height - 1..height };
            let within = &mut columns[around.1..][..cols];
            for number in begun {
                let line = &mut lines[(y + number) % height * cols..][..cols];
                for x in 0..cols {
                    within[x] = within[x].wrapping_sub(line[x]);
                }
                guess.differences(codes, run, off, clamped(y + number), line);
                for x in 0..cols {
                    within[x] = within[x].wrapping_add(line[x]);
                }
            }

            let (first, last) = (within[0], within[cols - 1]);
            columns[..around.1].fill(first);
            columns[around.1 + cols..].fill(last);
            window.fill(0);
            for columns in columns.windows(cols) {
                for x in 0..cols {
                    window[x] += columns[x];
                }
            }
            for x in 0..cols {
                sums[x] = sums[x].min(window[x]);
            }
        }
    }
}

impl Guess<'_> {
    /// Writes the bits in which the codes of a row differ from those at this offset from the guessed
    /// disparities. Where a disparity is missing, the last one to the left counts, otherwise the middle of
    /// the run.
    #[inline(always)]
    fn differences(&self, [left, right]: [&Plane<u8>; 2], run: Span, off: i32, y: usize, line: &mut [u8]) {
        let share = self.finer as f32 / self.by as f32;
        // The other copies may not include the remainder of a division.
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

/// Sums for neighboring columns of a row of blocks with `count` rows from `top` on.
pub struct BlockWindows<'a> {
    pub costs: &'a ByteDistances,
    pub rows: usize,
    pub cols: usize,
    pub top: usize,
    pub count: usize,
    pub columns: Range<usize>,
    pub around: Around,
}

/// Calls `each(row, column, sums of all candidates)` for every pixel of the windows.
#[leveled]
pub fn visit<F: FnMut(usize, usize, &[Lanes<u8>])>(level: Level, windows: BlockWindows<'_>, each: F) {
    let mut each = each;
    let BlockWindows { costs, rows, cols, top, count, columns, around } = windows;
    let runs = costs.runs();

    // The windows reach beyond the columns; at the border of the image its last pixel is repeated.
    let first = columns.start.saturating_sub(around.1);
    let wide = first..(columns.end + around.1).min(cols);
    let length = wide.len() * runs;
    let clamped = |y: usize| y.saturating_sub(around.0).min(rows - 1);
    let (height, width) = (2 * around.0 + 1, 2 * around.1 + 1);

    let mut line = vec![[0u8; LANES]; length];
    let mut sums = vec![[0u8; LANES]; length];
    let mut window = vec![[0u8; LANES]; runs];
    for y in top..top + count {
        if y > top {
            costs.write(clamped(y - 1), wide.clone(), &mut line);
            add(&mut sums, &line, u8::wrapping_sub);
        }
        let begun = if y == top { 0..height } else { height - 1..height };
        for number in begun {
            costs.write(clamped(y + number), wide.clone(), &mut line);
            add(&mut sums, &line, u8::wrapping_add);
        }

        for x in columns.clone() {
            let column = |x: usize| {
                let at = x.saturating_sub(around.1).clamp(wide.start, wide.end - 1) - wide.start;
                &sums[at * runs..][..runs]
            };
            window.copy_from_slice(column(x));
            for number in 1..width {
                add(&mut window, column(x + number), u8::wrapping_add);
            }
            each(y - top, x, &window);
        }
    }
}

/// The doubtful pixels of an image: those of smaller copies, each representing several.
#[derive(Clone, Copy)]
pub struct Voters<'a> {
    /// Whether a pixel of the copies votes.
    pub doubtful: &'a Plane<bool>,
    /// The factor by which the image is larger.
    pub by: usize,
    /// Its rows.
    pub rows: usize,
    /// Its columns.
    pub cols: usize,
}

/// The sums over the doubtful pixels of a block. `costs`: those of the image. `voters`: the pixels that vote.
/// `block`: its first row and column.
#[leveled]
pub fn vote(
    level: Level,
    costs: &ByteDistances,
    voters: Voters<'_>,
    block: (usize, usize),
) -> Vec<Lanes<u8>> {
    let Voters { doubtful, by, rows, cols } = voters;
    let (top, first) = block;
    let columns = first..(first + BLOCK).min(cols);
    let runs = costs.runs();
    let mut line = vec![[0u8; LANES]; runs * columns.len()];
    let mut sums = vec![[0u8; LANES]; runs];

    for y in (top..(top + BLOCK).min(rows)).step_by(VOTING) {
        let Some(is_asked) = (y / by < doubtful.rows()).then(|| doubtful.row(y / by)) else {
            break;
        };
        let is_one = |x: usize| is_asked.get(x / by).is_some_and(|is_one| *is_one);
        if columns.clone().any(is_one) {
            costs.write(y, columns.clone(), &mut line);
            for (line, _) in line.chunks_exact(runs).zip(columns.clone()).filter(|(_, x)| is_one(*x)) {
                add(&mut sums, line, u8::saturating_add);
            }
        }
    }
    sums
}

/// Adds or subtracts every lane.
#[inline(always)]
pub fn add(sums: &mut [Lanes<u8>], terms: &[Lanes<u8>], step: impl Fn(u8, u8) -> u8) {
    // Whole runs by value: the compiler does not know that sums and terms do not overlap.
    for (sums, terms) in sums.iter_mut().zip(terms) {
        let (mut summed, terms) = (*sums, *terms);
        for lane in 0..LANES {
            summed[lane] = step(summed[lane], terms[lane]);
        }
        *sums = summed;
    }
}

/// Which candidates see the right image, and which lie along the run.
pub struct Borders {
    pub cols: usize,
    pub count: usize,
    /// From place `cols - 1 - x` on, for each candidate in turn: 0 where column `x` sees the right image,
    /// otherwise 255.
    pub beyond: Vec<u8>,
    /// 255 for the candidates along the run, otherwise 0; and 255 for those outside it. Lanes beyond the last
    /// one are 255.
    pub excluded: [Vec<Lanes<u8>>; 2],
}

impl Borders {
    pub fn new(costs: &ByteDistances, cols: usize, along: Range<usize>) -> Self {
        let (candidates, lanes) = (costs.candidates(), costs.runs() * LANES);
        let is_within = |place: usize| (0..cols as isize).contains(&(place as isize + candidates.min()));
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
    pub fn least(&self, sums: &[Lanes<u8>], x: usize) -> [u8; 2] {
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

    /// The standout outside the run.
    #[inline(always)]
    pub fn outside(&self, sums: &[Lanes<u8>], x: usize) -> Option<Standout> {
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
        stands_out.then(|| Standout { chosen: chosen as u16, gain: u16::from(others - own) })
    }
}

/// The candidate of a pixel with the least sum, among those that see the other image.
#[leveled]
pub fn choose(
    level: Level,
    costs: &ByteDistances,
    rows: usize,
    cols: usize,
    y: usize,
    x: usize,
    around: Around,
) -> usize {
    let (candidates, runs) = (costs.candidates(), costs.runs());
    let mut line = vec![[0u8; LANES]; runs];
    let mut sums = vec![[0u8; LANES]; runs];

    for dy in 0..=2 * around.0 {
        let y = (y + dy).saturating_sub(around.0).min(rows - 1);
        for dx in 0..=2 * around.1 {
            let x = (x + dx).saturating_sub(around.1).min(cols - 1);
            costs.write(y, x..x + 1, &mut line);
            add(&mut sums, &line, u8::wrapping_add);
        }
    }

    // x - d is a column: at least 0, at most the last.
    let (start, end) = (candidates.index(x as isize + 1 - cols as isize), candidates.index(x as isize + 1));
    let sums = &sums.as_flattened()[start..end];
    let least = sums.iter().enumerate().min_by_key(|(_, sum)| **sum);
    start + least.map_or(0, |(k, _)| k)
}

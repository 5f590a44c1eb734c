//! What is burnt into both images at the same place: clocks, captions, logos. It belongs to no scene, and
//! matches at disparity 0.
//!
//! Sharp steps along the rows that are in both images at the same place count, and one side of which, at
//! least, is equal; what stands in one of the images only, or moves from one to the other, has none. Those of
//! an overlay are close to each other. Cells of `CELL` pixels with many of them are joined to areas, and an
//! area is an overlay if
//!
//! ```text
//! steps >= CLEAR_STEPS chance,  steps log2(steps / chance) - (steps - chance) / ln 2 >= CERTAIN_STEPS
//!     chance = the most at other rows, or of the same ones with both sides equal at another disparity: what is
//!              of the scene is found there
//! share of steps with a side in one of COLORS gray levels >= PAINTED, more if fewer than OUTLINE are equal
//!     on one side alone: a thing of its own has other things beside it, a box around letters is plain
//! beside(d) >= CERTAIN_BESIDE for a disparity d,  beside(0) <= beside(d) / ELSEWHERE
//!     beside(d) = n (1 - H(share of equal signs)) bits of the n other steps among and around it, however faint,
//!                 that both images have at disparity d: what lies around it is elsewhere
//! ```
//!
//! The last keeps what is far away, and is at disparity 0, where so is all that lies around it: a thing farther
//! than all others hides none of them.

use std::f64::consts::LN_2;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::math;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::choices::{
    CERTAIN_BESIDE, CERTAIN_STEPS, CLEAR_STEPS, COLOR, COLORS, ELSEWHERE, EQUAL, FAINT, LEAST_BORDERED,
    LEAST_STEPS, MOST_OVERLAID, OUTLINE, PAINTED, SHARP,
};
use crate::image::view::{Mask, View};
use crate::pair::source::{Source, bands, widened};

/// Side of a cell, pixels: that of the blocks of JPEG.
const CELL: usize = 8;
/// Columns from one side of a step to the other: the edge of a letter is softened over one between them.
const ACROSS: usize = 2;
/// Rows and columns of cells at which two of them still belong to one area.
const JOINED: (usize, usize) = (3, 5);
/// Rows that are off, where an area has no more equal steps than by chance.
const OFF: [isize; 4] = [-24, -12, 12, 24];
/// Cells around an area in which the scene is looked for.
const AROUND: usize = 3;
/// Rows and columns beside a step of both images whose own steps may belong to it.
const BESIDE: (usize, usize) = (1, 3);
/// One in how many columns is the largest disparity that is tried, on either side.
const REACH: usize = 4;
/// What stands for a step that is equal on both sides, where 1 is one that is on one.
const BOTH: u8 = 16;
/// Values of gray levels of 8 bits.
const LEVELS: usize = 256;

/// A rectangle of both images that shows an overlay.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Overlay {
    /// Its rows.
    pub rows: Range<usize>,
    /// Its columns.
    pub columns: Range<usize>,
}

/// Steps of one place in both images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Not sharp, not at the same place, or unlike on both sides.
    None,
    /// Equal on one side: the first or the second.
    One(bool),
    /// Equal on both.
    Both,
}

/// What steps of both images are measured in.
#[derive(Debug, Clone, Copy)]
struct Units {
    /// Gray steps of a level.
    level: i32,
    least: i32,
}

/// Equal steps of cells: on one side, and on both.
struct Counts {
    size: (usize, usize),
    one: Vec<u16>,
    both: Vec<u16>,
}

/// Some rows of both images.
struct Part<'a> {
    views: [&'a View; 2],
    /// The first of the rows in the image.
    first: usize,
    units: Units,
}

/// Cells that belong together.
type Area = Vec<(usize, usize)>;

impl Units {
    /// The units of two views, if those of both are the same: of floats, pixels of one value have several.
    fn of(views: [&View; 2]) -> Option<Self> {
        let [one, other] = views.map(View::scale);
        let is_same = one.step().is_some() && one.step() == other.step() && one.ends() == other.ends();
        let level = one.steps(one.level()).round() as i32;
        (is_same && level > 0).then_some(Self { level, least: one.ends()[0] })
    }

    /// The gray level of 8 bits.
    fn level_of(self, gray: i32) -> usize {
        ((gray - self.least) / self.level).clamp(0, LEVELS as i32 - 1) as usize
    }

    /// The steps from two pixels to two others.
    #[inline(always)]
    fn step(self, left: [i32; 2], right: [i32; 2]) -> Step {
        let (of_left, of_right) = (left[1] - left[0], right[1] - right[0]);
        let height = of_left.abs().min(of_right.abs());
        if height < SHARP * self.level || (of_left ^ of_right) < 0 {
            return Step::None;
        }
        let most = (height >> 3).max(EQUAL * self.level);
        let is_equal = [0, 1].map(|side| (left[side] - right[side]).abs() <= most);
        match is_equal {
            [true, true] => Step::Both,
            [false, false] => Step::None,
            [first, _] => Step::One(!first),
        }
    }
}

impl Counts {
    fn new((rows, cols): (usize, usize)) -> Self {
        let size = (rows / CELL, cols / CELL);
        Self { size, one: vec![0; size.0 * size.1], both: vec![0; size.0 * size.1] }
    }

    /// Counts the steps of rows from `first` on.
    fn add(&mut self, views: [&View; 2], first: usize, units: Units) {
        let is_masked = views.iter().any(|view| view.mask().is_some());
        let rows = (self.size.0 * CELL).saturating_sub(first).min(views[0].size().0);
        let mut kinds = vec![0; views[0].size().1];
        for y in 0..rows {
            if is_masked {
                self.add_masked_row(views, y, first, units);
            } else {
                self.add_row(views.map(|view| view.gray().row(y)), first + y, units, &mut kinds);
            }
        }
    }

    /// Counts the steps between valid pixels of a row.
    fn add_masked_row(&mut self, views: [&View; 2], y: usize, first: usize, units: Units) {
        for x in 0..self.size.1 * CELL {
            let at = (first + y) / CELL * self.size.1 + x / CELL;
            match step_of(views, [y, y], [x, x], units) {
                Step::None => {}
                Step::One(_) => self.one[at] += 1,
                Step::Both => self.both[at] += 1,
            }
        }
    }

    /// The same where all pixels are valid; `kinds` has room for its columns.
    fn add_row(&mut self, rows: [&[i32]; 2], y: usize, units: Units, kinds: &mut [u8]) {
        let [left, right] = rows;
        find_kinds(Level::best(), kinds, left, right, units);
        let cells = y / CELL * self.size.1..;
        let counts = self.one[cells.clone()].iter_mut().zip(&mut self.both[cells]);
        for ((one, both), kinds) in counts.zip(kinds.as_chunks::<CELL>().0) {
            // No sum of eight is more than a half byte holds.
            let sum: u8 = kinds.iter().sum();
            *one += u16::from(sum % BOTH);
            *both += u16::from(sum / BOTH);
        }
    }

    /// Of each cell the most of squares of four cells, all steps of these.
    fn squares(&self, count: impl Fn(usize) -> u32) -> Vec<u32> {
        let (rows, cols) = self.size;
        let mut most = vec![0; rows * cols];
        for (y, x) in (1..rows).flat_map(|y| (1..cols).map(move |x| (y, x))) {
            let at = y * cols + x;
            let square = [at, at - 1, at - cols, at - cols - 1];
            let sum = square.iter().map(|at| count(*at)).sum();
            for at in square {
                most[at] = most[at].max(sum);
            }
        }
        most
    }

    /// The areas with many steps, how many of these are equal on one side, and how many there are.
    fn areas(&self) -> Vec<(Area, [u32; 2])> {
        let of_one = |at: usize| u32::from(self.one[at]);
        if self.squares(of_one).iter().all(|most| *most < LEAST_STEPS) {
            return vec![];
        }
        let of_all = |at: usize| of_one(at) + u32::from(self.both[at]);
        let squares = self.squares(of_all);
        let mut is_open: Vec<bool> =
            (0..squares.len()).map(|at| squares[at] >= LEAST_STEPS && of_all(at) > 0).collect();

        let (rows, cols) = self.size;
        let mut areas = vec![];
        for start in 0..is_open.len() {
            if !is_open[start] {
                continue;
            }
            is_open[start] = false;
            let mut area = vec![(start / cols, start % cols)];
            let mut next = 0;
            while let Some((y, x)) = area.get(next).copied() {
                next += 1;
                let columns = x.saturating_sub(JOINED.1)..(x + JOINED.1 + 1).min(cols);
                for y in y.saturating_sub(JOINED.0)..(y + JOINED.0 + 1).min(rows) {
                    for x in columns.clone().filter(|x| is_open[y * cols + x]) {
                        area.push((y, x));
                    }
                    is_open[y * cols + columns.start..y * cols + columns.end].fill(false);
                }
            }

            let of_area =
                |count: &dyn Fn(usize) -> u32| -> u32 { area.iter().map(|(y, x)| count(y * cols + x)).sum() };
            let overlay = rectangle(&area);
            let size = overlay.rows.len() * overlay.columns.len();
            let is_small = size as f64 <= MOST_OVERLAID * (rows * cols * CELL * CELL) as f64;
            if of_area(&of_one) >= LEAST_STEPS && is_small {
                areas.push((area.clone(), [of_area(&of_one), of_area(&of_all)]));
            }
        }
        areas
    }
}

impl Part<'_> {
    /// The steps of an area, with those `off` rows lower in the right image.
    fn steps(&self, area: &Area, off: isize, mut visit: impl FnMut(Step, usize, usize)) {
        let height = self.views[0].size().0;
        for (cell_y, cell_x) in area {
            for y in cell_y * CELL..(cell_y + 1) * CELL {
                let here = y - self.first;
                let Some(other) = here.checked_add_signed(off).filter(|y| *y < height) else {
                    continue;
                };
                for x in cell_x * CELL..(cell_x + 1) * CELL {
                    visit(step_of(self.views, [here, other], [x, x], self.units), here, x);
                }
            }
        }
    }

    /// How many of the steps of an area there would be by chance: the most at other rows, and of these that are
    /// at another disparity, too, with both sides equal.
    fn chance(&self, area: &Area) -> u32 {
        let mut most = 1;
        for off in OFF {
            let mut count = 0;
            self.steps(area, off, |step, _, _| count += u32::from(step != Step::None));
            most = most.max(count);
        }

        let mut places = vec![];
        self.steps(area, 0, |step, y, x| places.extend((step != Step::None).then_some((y, x))));
        for disparity in disparities(self.views[0].size().1).filter(|disparity| *disparity != 0) {
            let is_there = |(y, x): &(usize, usize)| {
                let at = x.checked_add_signed(-disparity);
                at.is_some_and(|at| step_of(self.views, [*y; 2], [*x, at], self.units) == Step::Both)
            };
            most = most.max(places.iter().filter(|place| is_there(place)).count() as u32);
        }
        most
    }

    /// The share of steps with a side in one of the few gray levels that most have.
    fn painted(&self, area: &Area) -> f64 {
        let mut sides: Vec<[usize; 2]> = vec![];
        let mut counts = [0u32; LEVELS];
        self.steps(area, 0, |step, y, x| {
            if step == Step::None {
                return;
            }
            let row = self.views[0].gray().row(y);
            let levels = [row[x], row[x + ACROSS]].map(|gray| self.units.level_of(gray));
            match step {
                Step::None => {}
                Step::One(second) => sides.push([levels[usize::from(second)]; 2]),
                Step::Both => sides.push(levels),
            }
            counts[levels[0]] += u32::from(step != Step::One(true));
            counts[levels[1]] += u32::from(step != Step::One(false));
        });

        let mut is_color = [false; LEVELS];
        let near = |level: usize| level.saturating_sub(COLOR)..(level + COLOR + 1).min(LEVELS);
        for _ in 0..COLORS {
            let sum = |level: usize| counts[near(level)].iter().sum::<u32>();
            let best = (0..LEVELS).rev().max_by_key(|level| sum(*level)).unwrap_or(0);
            is_color[near(best)].fill(true);
            counts[near(best)].fill(0);
        }
        let painted = sides.iter().filter(|levels| levels.iter().any(|level| is_color[*level]));
        painted.count() as f64 / sides.len().max(1) as f64
    }

    /// Bits by which other steps among and around an area agree at disparity 0, and the most at another.
    fn beside(&self, area: &Area, overlay: &Overlay) -> [f64; 2] {
        let cols = self.views[0].size().1;
        let around = AROUND * CELL;
        let columns = widened(&overlay.columns, around, cols);
        let mut is_around = Plane::from_fn(self.views[0].size().0, columns.len(), |_, _| false);
        for (cell_y, cell_x) in area {
            let rows = widened(&(cell_y * CELL..(cell_y + 1) * CELL), around, usize::MAX);
            let places = widened(&(cell_x * CELL..(cell_x + 1) * CELL), around, cols);
            let places = places.start - columns.start..places.end - columns.start;
            for y in rows.start.max(self.first)..rows.end.min(self.first + is_around.rows()) {
                is_around.row_mut(y - self.first)[places.clone()].fill(true);
            }
        }

        let (rows, level) = (self.views[0].size().0, self.units.level);
        let mut is_open = Plane::from_fn(rows, cols, |_, _| true);
        for (y, x) in (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))) {
            if step_of(self.views, [y; 2], [x; 2], self.units) != Step::None {
                let columns = widened(&(x..x + 1), BESIDE.1, cols);
                for y in widened(&(y..y + 1), BESIDE.0, rows) {
                    is_open.row_mut(y)[columns.clone()].fill(false);
                }
            }
        }
        let [left, right] = self.views.map(|view| signs(view, &is_open, level));
        let agreeing = |disparity: isize| {
            let (mut sum, mut count) = (0, 0);
            // Columns that the right image has as well.
            let first = columns.start.max(disparity.max(0) as usize);
            let last = columns.end.min(cols.saturating_add_signed(disparity));
            for y in (0..left.rows()).filter(|_| first < last) {
                let at = first.saturating_add_signed(-disparity);
                let right = &right.row(y)[at..at + last - first];
                let is_around = &is_around.row(y)[first - columns.start..last - columns.start];
                for ((left, right), is_around) in left.row(y)[first..last].iter().zip(right).zip(is_around) {
                    let product = i32::from(left * right * i8::from(*is_around));
                    sum += product;
                    count += product.abs();
                }
            }
            bits(f64::from(sum), f64::from(count))
        };
        let others = disparities(cols).filter(|disparity| disparity.abs() > 1).map(agreeing);
        [agreeing(0), others.fold(0.0, f64::max)]
    }

    /// Whether an area is an overlay; `steps`: those that are equal on one side, and all.
    fn is_overlay(&self, area: &Area, steps: [u32; 2], overlay: &Overlay) -> bool {
        let [own, steps] = steps.map(f64::from);
        let chance = f64::from(self.chance(area));
        let painted = PAINTED[usize::from(own < OUTLINE * steps)];
        if steps < CLEAR_STEPS * chance || !is_certain(steps, chance) || self.painted(area) < painted {
            return false;
        }
        let [here, elsewhere] = self.beside(area, overlay);
        elsewhere >= CERTAIN_BESIDE && here * ELSEWHERE <= elsewhere
    }
}

/// Finds the kinds of the steps of a row: 0, 1, or [`BOTH`].
#[leveled]
fn find_kinds(level: Level, kinds: &mut [u8], left: &[i32], right: &[i32], units: Units) {
    let left = left.iter().zip(&left[left.len().min(ACROSS)..]);
    let right = right.iter().zip(&right[right.len().min(ACROSS)..]);
    for (kind, (left, right)) in kinds.iter_mut().zip(left.zip(right)) {
        let (of_left, of_right) = (left.1 - left.0, right.1 - right.0);
        let height = of_left.abs().min(of_right.abs());
        let is_sharp = (height >= SHARP * units.level) & ((of_left ^ of_right) >= 0);
        let most = (height >> 3).max(EQUAL * units.level);
        let first = (left.0 - right.0).abs() <= most;
        let second = (left.1 - right.1).abs() <= most;
        let one = u8::from(is_sharp & (first ^ second));
        *kind = one | (u8::from(is_sharp & first & second) * BOTH);
    }
}

/// Finds the overlays of a pair.
pub fn overlays(source: &dyn Source, control: &Control) -> Result<Vec<Overlay>> {
    let (height, cols) = source.size();
    if height.min(cols) < LEAST_BORDERED {
        return Ok(vec![]);
    }

    let mut counts = Counts::new((height, cols));
    for rows in bands(source) {
        control.checkpoint()?;
        let pair = source.rows(rows.clone())?;
        let [left, right] = pair.views();
        let Some(units) = Units::of([left, right]) else { return Ok(vec![]) };
        counts.add([left, right], rows.start, units);
    }

    let mut found = vec![];
    // Most have too few steps, even if chance has none.
    let many = counts.areas().into_iter().filter(|(_, [_, all])| is_certain((*all).into(), 1.0));
    for (area, steps) in many {
        let overlay = rectangle(&area);
        let rows = widened(&overlay.rows, AROUND * CELL + BESIDE.0, height);
        let pair = source.rows(rows.clone())?;
        let Some(units) = Units::of(pair.views()) else { continue };
        let part = Part { views: pair.views(), first: rows.start, units };
        if part.is_overlay(&area, steps, &overlay) {
            found.push(overlay);
        }
    }
    Ok(found)
}

/// Which pixels of a view are valid and in no overlay.
pub fn mask(overlays: &[Overlay], view: &View) -> Mask {
    let (rows, cols) = view.size();
    let mut mask = view.mask().cloned().unwrap_or_else(|| Plane::from_fn(rows, cols, |_, _| true));
    for Overlay { rows, columns } in overlays {
        rows.clone().for_each(|y| mask.row_mut(y)[columns.clone()].fill(false));
    }
    mask
}

/// Whether this many steps, of which there would be this many by chance, are not there by chance.
fn is_certain(steps: f64, chance: f64) -> bool {
    steps * math::ln(steps / chance) - (steps - chance) >= CERTAIN_STEPS * LN_2
}

/// The disparities that are tried in images of this width.
fn disparities(cols: usize) -> impl Iterator<Item = isize> {
    let reach = (cols / REACH) as isize;
    -reach..=reach
}

/// The rectangle around the cells of an area.
fn rectangle(area: &Area) -> Overlay {
    let around = |at: fn(&(usize, usize)) -> usize| {
        let (first, last) =
            area.iter().map(at).fold((usize::MAX, 0), |(first, last), at| (first.min(at), last.max(at)));
        first * CELL..(last + 1) * CELL
    };
    Overlay { rows: around(|(y, _)| *y), columns: around(|(_, x)| *x) }
}

/// The step at a row and a column of either image.
fn step_of(views: [&View; 2], y: [usize; 2], x: [usize; 2], units: Units) -> Step {
    let is_step = |side: usize| {
        x[side] + ACROSS < views[side].size().1
            && views[side].is_valid(y[side], x[side])
            && views[side].is_valid(y[side], x[side] + ACROSS)
    };
    if !is_step(0) || !is_step(1) {
        return Step::None;
    }
    let [left, right] = [0, 1].map(|side| {
        let row = views[side].gray().row(y[side]);
        [row[x[side]], row[x[side] + ACROSS]]
    });
    units.step(left, right)
}

/// The signs of the steps of a view where none of both images is near; 0 where it has none.
fn signs(view: &View, is_open: &Plane<bool>, level: i32) -> Plane<i8> {
    let (rows, cols) = view.size();
    Plane::from_fn(rows, cols, |y, x| {
        let row = view.gray().row(y);
        if x + ACROSS >= cols || !is_open.row(y)[x] {
            return 0;
        }
        let step = row[x + ACROSS] - row[x];
        let is_step = step.abs() >= FAINT * level && view.is_valid(y, x) && view.is_valid(y, x + ACROSS);
        if is_step { step.signum() as i8 } else { 0 }
    })
}

/// Bits by which this many signs agree more often than by chance, of which the sum of products is this.
fn bits(sum: f64, count: f64) -> f64 {
    if sum <= 0.0 {
        return 0.0;
    }
    let entropy = |share: f64| if share > 0.0 { -share * math::ln(share) / LN_2 } else { 0.0 };
    let share = 0.5 + 0.5 * sum / count;
    count * (1.0 - entropy(share) - entropy(1.0 - share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::pixels::{Image, Input};
    use crate::pair::Pair;
    use ndarray::Array3;

    const SIZE: (usize, usize) = (160, 240);
    const DISPARITY: usize = 20;
    /// Strokes of letters, 5 x 7.
    const LETTERS: [[u8; 7]; 4] = [
        [14, 17, 19, 21, 25, 17, 14],
        [4, 12, 4, 4, 4, 4, 14],
        [14, 17, 1, 2, 4, 8, 31],
        [30, 1, 1, 14, 1, 1, 30],
    ];

    /// Numbers from 0 to 1 that have nothing to do with each other.
    fn chance(y: usize, x: usize, seed: u64) -> f64 {
        let mut state = (y * 4096 + x) as u64 + (seed << 40);
        for _ in 0..3 {
            state = (state ^ (state >> 29)).wrapping_add(77).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        }
        (state >> 40) as f64 / f64::from(1u32 << 24)
    }

    /// A texture with gray values between those of corners, 6 pixels from each other.
    fn texture(y: usize, x: usize) -> f64 {
        let at = |y: usize, x: usize| 60.0 + 100.0 * chance(y, x, 1);
        let (row, column) = (y / 6, x / 6);
        let [down, along] = [y % 6, x % 6].map(|part| part as f64 / 6.0);
        let above = at(row, column) * (1.0 - along) + at(row, column + 1) * along;
        let below = at(row + 1, column) * (1.0 - along) + at(row + 1, column + 1) * along;
        above * (1.0 - down) + below * down
    }

    /// Whether a caption has ink here: strokes of 2 x 2 pixels.
    fn is_ink(y: usize, x: usize) -> bool {
        let (Some(y), Some(x)) = (y.checked_sub(120), x.checked_sub(40)) else { return false };
        let (letter, column, row) = (x / 2 / 6, x / 2 % 6, y / 2);
        letter < 12 && row < 7 && column < 5 && LETTERS[letter * 7 % 4][row] >> (4 - column) & 1 == 1
    }

    /// A pair with a scene at this disparity, with noise, and what is drawn on both images.
    fn pair(at: usize, draw: impl Fn(usize, usize) -> Option<u8>) -> Pair {
        let inputs = [0, 1].map(|side| {
            let pixels = Array3::from_shape_fn((SIZE.0, SIZE.1, 1), |(y, x, _)| {
                let noise = 3.0 * chance(y, x, 2 + side as u64) - 1.5;
                let scene = texture(y, x + side * at) + noise;
                draw(y, x).unwrap_or(scene.round().clamp(0.0, 255.0) as u8)
            });
            Input::from(Image::U8(pixels))
        });
        Pair::of_any(inputs, 0, 32).expect("legal")
    }

    #[test]
    fn a_caption_is_found_and_masked() {
        let pair = pair(DISPARITY, |y, x| is_ink(y, x).then_some(255));
        let [Overlay { rows, columns }] = pair.overlays() else {
            panic!("{:?}", pair.overlays());
        };
        assert!(rows.start <= 120 && (134..=144).contains(&rows.end), "{rows:?}");
        assert!((24..=40).contains(&columns.start) && (182..=200).contains(&columns.end), "{columns:?}");
        for (y, x) in (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))) {
            let is_outside = !(rows.contains(&y) && columns.contains(&x));
            assert!(pair.views().iter().all(|view| view.is_valid(y, x) == is_outside));
        }
    }

    #[test]
    fn a_scene_is_no_overlay() {
        for at in [0, 1, DISPARITY] {
            assert_eq!(pair(at, |_, _| None).overlays(), []);
        }
        // The same letters in the scene, and at disparity 0 where all is.
        let inputs = [0, 1].map(|side| {
            let pixels = Array3::from_shape_fn((SIZE.0, SIZE.1, 1), |(y, x, _)| {
                let x = x + side * DISPARITY;
                if is_ink(y, x) { 255 } else { texture(y, x) as u8 }
            });
            Input::from(Image::U8(pixels))
        });
        assert_eq!(Pair::of_any(inputs, 0, 32).expect("legal").overlays(), []);
        assert_eq!(pair(0, |y, x| is_ink(y, x).then_some(255)).overlays(), []);
    }

    #[test]
    fn what_is_masked_already_is_not_looked_at() {
        let caption = pair(DISPARITY, |y, x| is_ink(y, x).then_some(255));
        assert_eq!(overlays(&caption, &Control::default()).expect("memory"), []);
    }

    #[test]
    fn rows_are_counted_as_step_by_step_and_in_parts() {
        let pair = pair(DISPARITY, |y, x| (is_ink(y, x) || (y + x) % 17 == 0).then_some(200));
        let views = pair.views();
        let units = Units::of(views).expect("bytes");
        let fresh = || Counts::new(SIZE);

        let mut slow = fresh();
        for y in 0..SIZE.0 {
            slow.add_masked_row(views, y, 0, units);
        }
        let (mut whole, mut parts) = (fresh(), fresh());
        let mut kinds = vec![0; SIZE.1];
        for y in 0..SIZE.0 {
            whole.add_row(views.map(|view| view.gray().row(y)), y, units, &mut kinds);
        }
        for rows in [0..5, 5..77, 77..SIZE.0] {
            let part = pair.of_rows(rows.clone());
            parts.add(part.views(), rows.start, units);
        }
        assert!(slow.one.iter().any(|count| *count > 0) && slow.both.iter().any(|count| *count > 0));
        for other in [whole, parts] {
            assert_eq!((&slow.one, &slow.both), (&other.one, &other.both));
        }
    }

    #[test]
    fn signs_that_agree_are_evidence_by_their_number() {
        for (sum, count, expected) in
            [(0.0, 0.0, 0.0), (-9.0, 10.0, 0.0), (64.0, 64.0, 64.0), (32.0, 64.0, 12.078_3)]
        {
            assert!((bits(sum, count) - expected).abs() < 1e-3, "{}", bits(sum, count));
        }
    }
}

//! Overlays: clocks, captions and logos that a camera or a recorder has burned into both images at the same
//! pixels. They are not part of the scene, and match at disparity 0.
//!
//! An overlay shows by its edges. Along the rows, a sharp edge counts if both images have it at the same
//! pixels, with the same sign, and the gray values on at least one side of it are equal. Cells of
//! `OVERLAY_CELL` pixels with many such edges that are close to each other form an area. An area is an
//! overlay if
//!
//! ```text
//! edges >= CLEAR_EDGES chance,  edges log2(edges / chance) - (edges - chance) / ln 2 >= CERTAIN_EDGES
//!     chance = the most edges of this kind that it has if the right image is some rows off, or the most
//!              of its edges equal on both sides at another disparity: edges of the scene are found there
//! share of edges with a side in one of OVERLAY_COLORS gray levels >= LEAST_PAINTED, higher if less than
//!     LEAST_OUTLINE of them are equal on one side only: letters have the scene around them, a box is plain
//! beside(d) >= CERTAIN_BESIDE for a disparity d,  beside(0) <= beside(d) / ELSEWHERE
//!     beside(d) = n (1 - H(share of equal signs)) bits of the n other edges in and around the area,
//!                 however faint, that both images have at disparity d: the scene around it is not at 0
//! ```
//!
//! The last test keeps scenery at infinity: its surroundings are at disparity 0, too.

use std::f64::consts::LN_2;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::math;
use crate::base::plane::{Plane, around, widened};
use crate::base::simd::{Level, leveled};
use crate::choices::{
    CELLS_AROUND, CERTAIN_BESIDE, CERTAIN_EDGES, CLEAR_EDGES, COLOR_LEVELS, EDGE_MARGIN, EDGE_WIDTH,
    ELSEWHERE, EQUAL_LEVELS, FAINT_EDGE, JOINED_CELLS, LEAST_EDGES, LEAST_MASKED, LEAST_OUTLINE,
    LEAST_PAINTED, MOST_OVERLAID, OVERLAY_CELL, OVERLAY_COLORS, OVERLAY_REACH, ROWS_OFF, SHARP_EDGE,
};
use crate::image::view::{Mask, View};
use crate::pair::source::{Source, bands};

/// The count of an edge that is equal on both sides; an edge equal on one side counts 1.
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

/// The units in which edges of both images are measured.
#[derive(Debug, Clone, Copy)]
struct Units {
    /// Gray steps of a level.
    level: i32,
    least: i32,
}

/// Numbers of edges of cells: equal on one side, and on both.
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
    /// The units of two views, if they are the same for both: in float images, equal pixels may have several
    /// values.
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

    /// Whether both images have a sharp edge between two pixels, and which of its sides are equal.
    #[inline(always)]
    fn equal_sides(self, left: [i32; 2], right: [i32; 2]) -> [bool; 2] {
        let (of_left, of_right) = (left[1] - left[0], right[1] - right[0]);
        let height = of_left.abs().min(of_right.abs());
        let is_sharp = (height >= SHARP_EDGE * self.level) & ((of_left ^ of_right) >= 0);
        let most = (height >> 3).max(EQUAL_LEVELS * self.level);
        [0, 1].map(|side| is_sharp & ((left[side] - right[side]).abs() <= most))
    }
}

impl Counts {
    fn new((rows, cols): (usize, usize)) -> Self {
        let size = (rows / OVERLAY_CELL, cols / OVERLAY_CELL);
        Self { size, one: vec![0; size.0 * size.1], both: vec![0; size.0 * size.1] }
    }

    /// Counts the edges of rows from `first` on.
    fn add(&mut self, views: [&View; 2], first: usize, units: Units) {
        let (height, cols) = views[0].size();
        let rows = (self.size.0 * OVERLAY_CELL).saturating_sub(first).min(height);
        let mut kinds = vec![0; cols];
        for y in 0..rows {
            let [left, right] = views.map(|view| view.gray().row(y));
            find_kinds(Level::best(), &mut kinds, left, right, units);
            for mask in views.iter().filter_map(|view| view.mask()) {
                let ends = mask.row(y).iter().zip(&mask.row(y)[cols.min(EDGE_WIDTH)..]);
                let invalid =
                    kinds.iter_mut().zip(ends).filter(|(_, (first, second))| !(**first && **second));
                invalid.for_each(|(kind, _)| *kind = 0);
            }

            let cells = (first + y) / OVERLAY_CELL * self.size.1..;
            let counts = self.one[cells.clone()].iter_mut().zip(&mut self.both[cells]);
            for ((one, both), kinds) in counts.zip(kinds.as_chunks::<OVERLAY_CELL>().0) {
                // No sum of eight exceeds a half byte.
                let sum: u8 = kinds.iter().sum();
                *one += u16::from(sum % BOTH);
                *both += u16::from(sum / BOTH);
            }
        }
    }

    /// For each cell, the largest sum over a square of four cells that contains it.
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

    /// The areas with many edges, with the number of edges equal on one side only, and of all.
    fn areas(&self) -> Vec<(Area, [u32; 2])> {
        let of_one = |at: usize| u32::from(self.one[at]);
        if self.squares(of_one).iter().all(|most| *most < LEAST_EDGES) {
            return vec![];
        }
        let of_all = |at: usize| of_one(at) + u32::from(self.both[at]);
        let squares = self.squares(of_all);
        let mut is_open: Vec<bool> =
            (0..squares.len()).map(|at| squares[at] >= LEAST_EDGES && of_all(at) > 0).collect();

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
                let columns = around(x, JOINED_CELLS.1, cols);
                for y in around(y, JOINED_CELLS.0, rows) {
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
            let is_small = size as f64 <= MOST_OVERLAID * (rows * cols * OVERLAY_CELL * OVERLAY_CELL) as f64;
            if of_area(&of_one) >= LEAST_EDGES && is_small {
                areas.push((area.clone(), [of_area(&of_one), of_area(&of_all)]));
            }
        }
        areas
    }
}

impl Part<'_> {
    /// Visits the edges of an area, with the right image `off` rows lower.
    fn edges(&self, area: &Area, off: isize, mut visit: impl FnMut([bool; 2], usize, usize)) {
        let height = self.views[0].size().0;
        for (cell_y, cell_x) in area {
            for y in cell_y * OVERLAY_CELL..(cell_y + 1) * OVERLAY_CELL {
                let here = y - self.first;
                let Some(other) = here.checked_add_signed(off).filter(|y| *y < height) else {
                    continue;
                };
                for x in cell_x * OVERLAY_CELL..(cell_x + 1) * OVERLAY_CELL {
                    visit(equal_sides(self.views, [here, other], [x, x], self.units), here, x);
                }
            }
        }
    }

    /// The number of the area's edges expected by chance: the most with other rows, and the most that are
    /// equal on both sides at another disparity, too.
    fn chance(&self, area: &Area) -> u32 {
        let mut most = 1;
        for off in ROWS_OFF {
            let mut count = 0;
            self.edges(area, off, |[first, second], _, _| count += u32::from(first | second));
            most = most.max(count);
        }

        let mut places = vec![];
        self.edges(area, 0, |[first, second], y, x| places.extend((first | second).then_some((y, x))));
        for disparity in disparities(self.views[0].size().1).filter(|disparity| *disparity != 0) {
            let is_there = |(y, x): &(usize, usize)| {
                let at = x.checked_add_signed(-disparity);
                at.is_some_and(|at| equal_sides(self.views, [*y; 2], [*x, at], self.units) == [true; 2])
            };
            most = most.max(places.iter().filter(|place| is_there(place)).count() as u32);
        }
        most
    }

    /// The share of edges with a side in one of the few most common gray levels.
    fn painted(&self, area: &Area) -> f64 {
        let mut sides: Vec<[usize; 2]> = vec![];
        let mut counts = [0u32; LEVELS];
        self.edges(area, 0, |is_equal, y, x| {
            if is_equal == [false; 2] {
                return;
            }
            let row = self.views[0].gray().row(y);
            let levels = [row[x], row[x + EDGE_WIDTH]].map(|gray| self.units.level_of(gray));
            for side in 0..2 {
                counts[levels[side]] += u32::from(is_equal[side]);
            }
            match is_equal {
                [true, true] => sides.push(levels),
                [is_first, _] => sides.push([levels[usize::from(!is_first)]; 2]),
            }
        });

        let mut is_color = [false; LEVELS];
        let near = |level: usize| around(level, COLOR_LEVELS, LEVELS);
        for _ in 0..OVERLAY_COLORS {
            let sum = |level: usize| counts[near(level)].iter().sum::<u32>();
            let best = (0..LEVELS).rev().max_by_key(|level| sum(*level)).unwrap_or(0);
            is_color[near(best)].fill(true);
            counts[near(best)].fill(0);
        }
        let painted = sides.iter().filter(|levels| levels.iter().any(|level| is_color[*level]));
        painted.count() as f64 / sides.len().max(1) as f64
    }

    /// Bits by which other edges among and around those of an area agree at disparity 0, and the most at any
    /// other disparity.
    fn beside(&self, area: &Area, overlay: &Overlay) -> [f64; 2] {
        let cols = self.views[0].size().1;
        let around = CELLS_AROUND * OVERLAY_CELL;
        let columns = widened(&overlay.columns, around, cols);
        let mut is_around = Plane::from_fn(self.views[0].size().0, columns.len(), |_, _| false);
        for (cell_y, cell_x) in area {
            let rows = widened(&(cell_y * OVERLAY_CELL..(cell_y + 1) * OVERLAY_CELL), around, usize::MAX);
            let places = widened(&(cell_x * OVERLAY_CELL..(cell_x + 1) * OVERLAY_CELL), around, cols);
            let places = places.start - columns.start..places.end - columns.start;
            for y in rows.start.max(self.first)..rows.end.min(self.first + is_around.rows()) {
                is_around.row_mut(y - self.first)[places.clone()].fill(true);
            }
        }

        let (rows, level) = (self.views[0].size().0, self.units.level);
        let mut is_open = Plane::from_fn(rows, cols, |_, _| true);
        for (y, x) in (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))) {
            if equal_sides(self.views, [y; 2], [x; 2], self.units) != [false; 2] {
                let columns = widened(&(x..x + 1), EDGE_MARGIN.1, cols);
                for y in widened(&(y..y + 1), EDGE_MARGIN.0, rows) {
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

    /// Whether an area is an overlay; `edges`: those equal on one side only, and all.
    fn is_overlay(&self, area: &Area, edges: [u32; 2], overlay: &Overlay) -> bool {
        let [outline, edges] = edges.map(f64::from);
        let least = LEAST_PAINTED[usize::from(outline < LEAST_OUTLINE * edges)];
        if self.painted(area) < least {
            return false;
        }
        let chance = f64::from(self.chance(area));
        if edges < CLEAR_EDGES * chance || !is_certain(edges, chance) {
            return false;
        }
        let [here, elsewhere] = self.beside(area, overlay);
        elsewhere >= CERTAIN_BESIDE && here * ELSEWHERE <= elsewhere
    }
}

/// Finds the kinds of the edges of a row: 0, 1 if one side is equal, or [`BOTH`].
#[leveled]
fn find_kinds(level: Level, kinds: &mut [u8], left: &[i32], right: &[i32], units: Units) {
    let left = left.iter().zip(&left[left.len().min(EDGE_WIDTH)..]);
    let right = right.iter().zip(&right[right.len().min(EDGE_WIDTH)..]);
    for (kind, (left, right)) in kinds.iter_mut().zip(left.zip(right)) {
        let [first, second] = units.equal_sides([*left.0, *left.1], [*right.0, *right.1]);
        *kind = u8::from(first ^ second) | (u8::from(first & second) * BOTH);
    }
}

/// Finds the overlays of a pair.
pub fn overlays(source: &dyn Source, control: &Control) -> Result<Vec<Overlay>> {
    let (height, cols) = source.size();
    if height.min(cols) < LEAST_MASKED {
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
    // Most have too few edges, even if chance gives none.
    let many = counts.areas().into_iter().filter(|(_, [_, all])| is_certain((*all).into(), 1.0));
    for (area, edges) in many {
        let overlay = rectangle(&area);
        let rows = widened(&overlay.rows, CELLS_AROUND * OVERLAY_CELL + EDGE_MARGIN.0, height);
        let pair = source.rows(rows.clone())?;
        let Some(units) = Units::of(pair.views()) else { continue };
        let part = Part { views: pair.views(), first: rows.start, units };
        if part.is_overlay(&area, edges, &overlay) {
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

/// Whether a number of edges is too large for chance, which gives `chance` on average.
fn is_certain(edges: f64, chance: f64) -> bool {
    edges * math::ln(edges / chance) - (edges - chance) >= CERTAIN_EDGES * LN_2
}

/// The disparities to try in images of this width.
fn disparities(cols: usize) -> impl Iterator<Item = isize> {
    let reach = (cols / OVERLAY_REACH) as isize;
    -reach..=reach
}

/// The rectangle around the cells of an area.
fn rectangle(area: &Area) -> Overlay {
    let around = |at: fn(&(usize, usize)) -> usize| {
        let (first, last) =
            area.iter().map(at).fold((usize::MAX, 0), |(first, last), at| (first.min(at), last.max(at)));
        first * OVERLAY_CELL..(last + 1) * OVERLAY_CELL
    };
    Overlay { rows: around(|(y, _)| *y), columns: around(|(_, x)| *x) }
}

/// [`Units::equal_sides`] for the edge at a row and a column of either image; none where it is masked.
fn equal_sides(views: [&View; 2], y: [usize; 2], x: [usize; 2], units: Units) -> [bool; 2] {
    let ends = [0, 1].map(|side| {
        let (view, y, x) = (views[side], y[side], x[side]);
        let is_inside = x + EDGE_WIDTH < view.size().1;
        let is_valid = is_inside && view.is_valid(y, x) && view.is_valid(y, x + EDGE_WIDTH);
        is_valid.then(|| [view.gray().row(y)[x], view.gray().row(y)[x + EDGE_WIDTH]])
    });
    let [Some(left), Some(right)] = ends else { return [false; 2] };
    units.equal_sides(left, right)
}

/// The signs of the edges of a view, including faint ones, away from edges that both images share; 0
/// elsewhere.
fn signs(view: &View, is_open: &Plane<bool>, level: i32) -> Plane<i8> {
    let (rows, cols) = view.size();
    Plane::from_fn(rows, cols, |y, x| {
        let row = view.gray().row(y);
        if x + EDGE_WIDTH >= cols || !is_open.row(y)[x] {
            return 0;
        }
        let height = row[x + EDGE_WIDTH] - row[x];
        let is_edge =
            height.abs() >= FAINT_EDGE * level && view.is_valid(y, x) && view.is_valid(y, x + EDGE_WIDTH);
        if is_edge { height.signum() as i8 } else { 0 }
    })
}

/// Bits by which this many signs agree more often than by chance, given the sum of their products.
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

    /// Unrelated numbers from 0 to 1.
    fn chance(y: usize, x: usize, seed: u64) -> f64 {
        let mut state = (y * 4096 + x) as u64 + (seed << 40);
        for _ in 0..3 {
            state = (state ^ (state >> 29)).wrapping_add(77).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        }
        (state >> 40) as f64 / f64::from(1u32 << 24)
    }

    /// A texture with gray values interpolated between corners 6 pixels apart.
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

    /// A pair with a scene at this disparity, with noise, and something drawn on both images.
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
    fn an_area_may_touch_the_ends_of_rows() {
        let pair = pair(DISPARITY, |_, x| (234..236).contains(&x).then_some(255));
        let units = Units::of(pair.views()).expect("bytes");
        let part = Part { views: pair.views(), first: 0, units };
        let area: Area = (0..SIZE.0 / 8).map(|y| (y, SIZE.1 / 8 - 1)).collect();
        assert!(part.painted(&area) > 0.9);
        assert!(part.chance(&area) >= 1);
    }

    #[test]
    fn a_scene_is_not_an_overlay() {
        for at in [0, 1, DISPARITY] {
            assert_eq!(pair(at, |_, _| None).overlays(), []);
        }
        // The same letters in the scene, and at disparity 0 where everything is.
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

    /// The edges of cells of 8 x 8 pixels, two columns wide, 24 gray levels high, and equal within 3 levels
    /// or an eighth of their height on one side, and on both: one after another.
    fn counted(views: [&View; 2]) -> [Vec<u16>; 2] {
        let ((rows, cols), [left, right]) = (SIZE, views);
        let mut counts = [vec![0; rows / 8 * (cols / 8)], vec![0; rows / 8 * (cols / 8)]];
        for (y, x) in (0..rows).flat_map(|y| (0..cols - 2).map(move |x| (y, x))) {
            if views.iter().any(|view| !view.is_valid(y, x) || !view.is_valid(y, x + 2)) {
                continue;
            }
            let gray = |view: &View, x: usize| f64::from(view.gray().row(y)[x]);
            let heights = [left, right].map(|view| gray(view, x + 2) - gray(view, x));
            let height = heights[0].abs().min(heights[1].abs());
            let same = [x, x + 2]
                .into_iter()
                .filter(|x| (gray(left, *x) - gray(right, *x)).abs() <= (height / 8.0).floor().max(3.0))
                .count();
            if height >= 24.0 && heights[0] * heights[1] > 0.0 && same > 0 {
                counts[same - 1][y / 8 * (cols / 8) + x / 8] += 1;
            }
        }
        counts
    }

    #[test]
    fn edges_are_counted_as_one_after_another_masked_and_in_parts() {
        let plain = pair(DISPARITY, |y, x| (is_ink(y, x) || (y + x) % 17 == 0).then_some(200));
        let mask = Mask::from_fn(SIZE.0, SIZE.1, |y, x| (3 * y + x) % 11 != 0);
        let masked = plain.views().map(|view| view.clone().with_mask(Some(mask.clone())));
        for pair in [plain.clone(), plain.with_views(masked)] {
            let units = Units::of(pair.views()).expect("bytes");
            let (mut whole, mut parts) = (Counts::new(SIZE), Counts::new(SIZE));
            whole.add(pair.views(), 0, units);
            for rows in [0..5, 5..77, 77..SIZE.0] {
                let part = pair.of_rows(rows.clone());
                parts.add(part.views(), rows.start, units);
            }

            let [one, both] = counted(pair.views());
            assert!(one.iter().any(|count| *count > 0) && both.iter().any(|count| *count > 0));
            for other in [whole, parts] {
                assert_eq!((&one, &both), (&other.one, &other.both));
            }
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

//! Blocks of the left image that are located in the right one, in both directions, with sub-pixel precision.
//!
//! A block of the left image is correlated with the nine right ones around its expected place, then with
//! those around the best of the nine, until the best is the middle one. The peak of the nine gives the
//! fractions ([`Peak`]).
//!
//! ```text
//! c(dx, dy) = sum l(x, y) r(x + dx, y + dy) / sqrt(sum l^2 sum r^2)  less means, after a 5 x 5 binomial
//! (dx, dy) += offset of the largest c of the nine, until that is the middle
//! ```

use std::array::from_fn;
use std::borrow::Cow;

use rayon::prelude::*;

use crate::estimation::blur::parts::{PairRows, Part, Strips};
use crate::estimation::blur::rough::{is_mostly_valid, reduced};
use crate::estimation::overview::Overview;
use crate::estimation::registration::Peak;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, Loop, leveled};
use phasestereo_match::matcher::runtime::Runtime;

/// Rows above and below the center of a block that its search may read.
pub const AROUND: usize = BLOCK / 2 + SEARCH + SMOOTH + 1;
/// Side of a block, pixels of the reduced copy.
pub const BLOCK: usize = 24;
/// Largest distance of a block from its expected place along either axis.
const SEARCH: usize = 4;
/// Side of the part of the right image that is searched.
const AREA: usize = BLOCK + 2 * SEARCH;
/// Pixels that the binomial filter reads on either side.
const SMOOTH: usize = 2;
/// Least correlation of blocks that show the same thing.
const LEAST_CORRELATION: f32 = 0.5;

/// The expected place of a block: its center in the left image, and the offset to the center in the right
/// one, pixels of the full images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seed {
    /// Column of the center.
    pub x: f64,
    /// Row of the center.
    pub y: f64,
    /// Columns from the left center to the right one.
    pub dx: f64,
    /// Rows from the left center to the right one.
    pub dy: f64,
}

/// A block that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Its place in both images, with sub-pixel precision.
    pub place: Seed,
    /// Inverse variance of `dy`, of arbitrary scale: how precisely the correlation determines it.
    pub weight: f64,
}

/// A smoothed part of an image, minus its mean.
struct Patch<const SIDE: usize> {
    values: [[f32; SIDE]; SIDE],
}

/// Searches every block around its expected place, in copies of the images reduced by a factor, and leaves
/// out those that are not found. The seeds are in the order of their rows.
pub fn follow(
    rows: &PairRows,
    overview: &Overview,
    seeds: &[Seed],
    factor: usize,
    runtime: Runtime,
) -> Result<Vec<Track>> {
    // Rows of the copy above and below the center that the correlation may read.
    let top = |seed: &Seed| (in_copy(seed.y, factor) - AROUND as isize).max(0) as usize * factor;
    let mut tops: Vec<usize> = seeds.iter().map(top).collect();
    tops.dedup();

    let largest = seeds.iter().fold(0.0f64, |most, seed| most.max(seed.dy.abs()));
    let halo = largest.ceil() as usize + crate::estimation::blur::parts::HALO;
    let strips = Strips { tops: &tops, rows: 2 * AROUND * factor, halo, unit: factor };

    let mut found = vec![];
    rows.visit(strips, runtime, |part, visited| {
        // Seeds are sorted by their top rows, so those of this part are a range.
        let wanted = &tops[visited];
        let first = seeds.partition_point(|seed| top(seed) < wanted[0]);
        let end = seeds.partition_point(|seed| top(seed) <= wanted[wanted.len() - 1]);

        let copies = ReducedPair::new(part, overview, factor, runtime)?;
        let here = |seed: &Seed| track(&copies, part, seed, runtime.level());

        let tracks: Vec<Option<Track>> = seeds[first..end].par_iter().map(here).collect();
        found.extend(tracks.into_iter().flatten());
        Ok(())
    })?;

    Ok(found)
}

/// The same in an unreduced part of the pair that contains the rows in which all these blocks are searched.
pub fn follow_here(part: &Part, seeds: &[Seed], level: Level) -> Vec<Track> {
    let planes = part.grays.each_ref().map(Cow::Borrowed);
    let copies = ReducedPair { planes, factor: 1, first: part.first as isize };

    let tracks: Vec<Option<Track>> = seeds.par_iter().map(|seed| track(&copies, part, seed, level)).collect();
    tracks.into_iter().flatten().collect()
}

/// Both images, reduced by a factor: all of them or a part.
struct ReducedPair<'a> {
    planes: [Cow<'a, Plane<f32>>; 2],
    factor: usize,
    /// The row of the whole copies that is the first one here.
    first: isize,
}

impl<'a> ReducedPair<'a> {
    /// The copies of a part; those of the overview if it has this factor.
    fn new(part: &'a Part, overview: &'a Overview, factor: usize, runtime: Runtime) -> Result<Self> {
        if factor == overview.factor {
            let planes = overview.planes.each_ref().map(Cow::Borrowed);
            return Ok(Self { planes, factor, first: 0 });
        }

        let copy = |side: usize| -> Result<Cow<'a, Plane<f32>>> {
            let plane = &part.grays[side];
            if factor == 1 {
                return Ok(Cow::Borrowed(plane));
            }
            Ok(Cow::Owned(reduced(plane, factor, runtime)?))
        };

        let first = (part.first / factor) as isize;
        Ok(Self { planes: [copy(0)?, copy(1)?], factor, first })
    }
}

/// The row or column of a copy that contains a place of the full image.
fn in_copy(place: f64, factor: usize) -> isize {
    ((place + 0.5) / factor as f64).floor() as isize
}

/// Searches one block.
fn track(copies: &ReducedPair, part: &Part, seed: &Seed, level: Level) -> Option<Track> {
    let ReducedPair { planes: [left, right], factor, first } = copies;
    let factor = *factor;

    // Places in the whole copies.
    let (x, y) = (in_copy(seed.x, factor), in_copy(seed.y, factor));
    let shift = [seed.dx, seed.dy].map(|by| (by / factor as f64).round() as isize);
    let (right_x, right_y) = (x + shift[0], y + shift[1]);

    let above = (part.first / factor) as isize;
    let is_valid =
        is_valid(part, (x, y - above), factor, 0) && is_valid(part, (right_x, right_y - above), factor, 1);
    if !is_valid {
        return None;
    }

    let block = level.run(CutPatch::<BLOCK> { image: left, x, y: y - first })?;
    let area = level.run(CutPatch::<AREA> { image: right, x: right_x, y: right_y - first })?;
    let (offset, weight) = climb(level, &block, &area)?;

    // The center of a block of an even side lies between pixels.
    let place = |at: isize| factor as f64 * at as f64 - 0.5;
    let [dx, dy] = [0, 1].map(|axis| factor as f64 * (shift[axis] as f64 + offset[axis]));
    let place = Seed { x: place(x), y: place(y), dx, dy };
    Some(Track { place, weight })
}

/// Whether most pixels of a block are valid.
fn is_valid(part: &Part, (x, y): (isize, isize), factor: usize, side: usize) -> bool {
    let span = |at: isize, length: usize| {
        // The pixels of the image under the block, clipped at the border.
        let half = (BLOCK / 2) as isize;
        let end = |at: isize| (at * factor as isize).clamp(0, length as isize) as usize;
        end(at - half)..end(at + half)
    };

    let view = part.pair.views()[side];
    let (rows, cols) = view.size();
    is_mostly_valid(view, span(y, rows), span(x, cols))
}

/// Cuts out a smoothed part around a place; `None` if it would leave the image.
struct CutPatch<'a, const SIDE: usize> {
    image: &'a Plane<f32>,
    x: isize,
    y: isize,
}

impl<const SIDE: usize> Loop for CutPatch<'_, SIDE> {
    type Output = Option<Patch<SIDE>>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { image, x, y } = self;
        let corner = |at: isize| usize::try_from(at - (SIDE / 2 + SMOOTH) as isize).ok();
        let (left, top) = (corner(x)?, corner(y)?);

        let side = SIDE + 2 * SMOOTH;
        if left + side > image.cols() || top + side > image.rows() {
            return None;
        }

        // The binomial is separable: first along the rows, then along the columns.
        let mut along = [[0.0f32; SIDE]; AREA + 2 * SMOOTH];
        for (row, out) in along[..side].iter_mut().enumerate() {
            let pixels = &image.row(top + row)[left..left + side];
            for (at, out) in out.iter_mut().enumerate() {
                *out = binomial(from_fn(|tap| pixels[at + tap]));
            }
        }

        let mut values = [[0.0f32; SIDE]; SIDE];
        let mut sums = [0.0f32; SIDE];
        for (row, out) in values.iter_mut().enumerate() {
            let rows: [&[f32; SIDE]; 2 * SMOOTH + 1] = from_fn(|tap| &along[row + tap]);
            for at in 0..SIDE {
                out[at] = binomial(from_fn(|tap| rows[tap][at]));
                sums[at] += out[at];
            }
        }

        let mean = total(sums) / (SIDE * SIDE) as f32;
        for row in &mut values {
            for value in row {
                *value -= mean;
            }
        }

        Some(Patch { values })
    }
}

/// The mean of five values with the weights 1, 4, 6, 4, 1 of the binomial.
#[inline(always)]
fn binomial(values: [f32; 2 * SMOOTH + 1]) -> f32 {
    0.0625 * (values[0] + values[4]) + 0.25 * (values[1] + values[3]) + 0.375 * values[2]
}

/// Climbs from the middle of the searched part to the largest correlation.
#[leveled]
fn climb(level: Level, block: &Patch<BLOCK>, area: &Patch<AREA>) -> Option<([f64; 2], f64)> {
    let mut squares = [0.0f32; BLOCK];
    for row in &block.values {
        for at in 0..BLOCK {
            squares[at] += row[at] * row[at];
        }
    }

    let energy = total(squares);
    // Steps overlap, so correlations are cached.
    let mut known = [[f32::NAN; 2 * SEARCH + 1]; 2 * SEARCH + 1];
    let (mut x, mut y) = (SEARCH, SEARCH);

    loop {
        let mut nine = [0.0; 9];
        for (index, value) in nine.iter_mut().enumerate() {
            let (x, y) = (x + index % 3 - 1, y + index / 3 - 1);
            if known[y][x].is_nan() {
                known[y][x] = correlation(block, area, energy, x, y);
            }
            *value = known[y][x];
        }
        // The middle among equal ones: then the climb ends.
        let best = (0..9).fold(4, |best, at| if nine[at] > nine[best] { at } else { best });
        if best == 4 {
            if nine[4] <= LEAST_CORRELATION {
                return None;
            }
            let peak = Peak::new(nine.map(f64::from))?;
            let at = [x, y].map(|at| at as f64 - SEARCH as f64);
            let offset = [at[0] + peak.offset[0], at[1] + peak.offset[1]];
            return Some((offset, peak.precision()[1]));
        }
        (x, y) = (x + best % 3 - 1, y + best / 3 - 1);

        let inside = 1..2 * SEARCH;
        if !inside.contains(&x) || !inside.contains(&y) {
            return None;
        }
    }
}

/// The sum of a multiple of eight values: eight lanes at a time, then their halves, which takes few dependent
/// steps.
#[inline(always)]
fn total<const COUNT: usize>(lanes: [f32; COUNT]) -> f32 {
    let mut eight = [0.0f32; 8];
    for first in (0..COUNT).step_by(8) {
        for lane in 0..8 {
            eight[lane] += lanes[first + lane];
        }
    }

    let mut four = [0.0f32; 4];
    for lane in 0..4 {
        four[lane] = eight[lane] + eight[lane + 4];
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

/// The normalized correlation of a block with the block of the searched part that begins at `(x, y)`.
#[inline(always)]
fn correlation(block: &Patch<BLOCK>, area: &Patch<AREA>, energy: f32, x: usize, y: usize) -> f32 {
    let (mut products, mut squares, mut sums) = ([0.0f32; BLOCK], [0.0f32; BLOCK], [0.0f32; BLOCK]);
    for row in 0..BLOCK {
        let (left, right) = (&block.values[row], &area.values[y + row][x..x + BLOCK]);
        for at in 0..BLOCK {
            products[at] += left[at] * right[at];
            squares[at] += right[at] * right[at];
            sums[at] += right[at];
        }
    }

    let (product, square, sum) = (total(products), total(squares), total(sums));
    // The block has zero mean, so the product needs no subtraction; the squares of the right one do.
    let norm = energy * (square - sum * sum / (BLOCK * BLOCK) as f32);
    if norm > f32::MIN_POSITIVE { product / norm.sqrt() } else { 0.0 }
}

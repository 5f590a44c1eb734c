//! Blocks of the rectified left image, located in the rectified right one by correlation, to a fraction of a
//! pixel.
//!
//! ```text
//! even = (image - mean) / sqrt(variance + 9)         # over 31 x 31: removes light and contrast
//! c(dx, dy) = correlation of the 24 x 24 block around a corner with the block at (dx, dy) of the right image
//!     at half size within 12 columns and 7 rows of the place by the nearest matches (for the nearest corner
//!     far enough from the ends for a block), then at full size within 4 px
//! (dx, dy) = the largest c, and the peak of the nine around it
//! kept if c > 0.7, unique and curved enough along y
//! ```
//!
//! Images are integers from `even` on, so correlations are exact up to their single division.

use std::array::from_fn;

use super::cameras::{Backward, Cameras, Point};
use super::corners::{Corner, corners};
use super::filters::{gradients, reduced, smoothed};
use super::matches::{CornerMatch, SUMMED, scalar_product};
use crate::estimation::registration::Peak;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::base::statistics::median;
use phasestereo_match::image::window_sums::Windows;

/// Number of corners with blocks, and how near they may be to the border.
const CORNERS: usize = 2000;
const BORDER: usize = 16;
/// Side of a block.
const SIDE: usize = 24;
const _: () = assert!((SIDE * SIDE).is_multiple_of(SUMMED), "a product leaves out pixels of a block");
/// Places that are computed at once.
const LANES: usize = 16;
/// How many columns and rows away blocks are searched for at half size and at full size. With 4 rows at half
/// size, one of 12 toed-in pairs is not rectified; 12 take half as long again and gain nothing.
const SEARCH: [[usize; 2]; 2] = [[12, 7], [4, 4]];
/// Radius of the windows over which light is removed, and the amount added to the variance.
const EVEN: (usize, f64) = (15, 9.0);
/// Rows that one task evens out; it also reads those of the windows above and below.
const BAND: usize = 128;
/// Gray values in steps of 1 / 8; deviations in steps of 1 / 64 and at most this many.
const STEPS: [f32; 2] = [8.0, 64.0];
const LARGEST: f32 = 1023.0;
/// Smoothing of images, and of those that corners are searched in, pixels.
const SMOOTHING: [f64; 2] = [0.8, 1.0];
/// Least correlation.
const LEAST: f64 = 0.7;
/// Correlations farther from the best one belong to other places, pixels; the best must be short of 1 by less
/// than this share of what they are short of it.
const ELSEWHERE: usize = 3;
const UNIQUE: f64 = 0.7;
/// Least curvature of the correlation along y, and that of full weight.
const CURVATURE: (f64, f64) = (0.03, 0.1);
/// Nearest matches whose median predicts the place of a block.
const NEAREST: usize = 3;
/// Blocks nearer to the ends of a raw image are left out, pixels.
const MARGIN: f64 = 8.0;

/// A block that was found.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// The place of its middle in both raw images.
    pub places: CornerMatch,
    /// How precisely its row is known, up to 1.
    pub weight: f64,
}

/// Locates blocks of a gray pair, given its cameras and matches.
pub fn blocks(
    pair: [&Plane<f32>; 2],
    cameras: &Cameras,
    matches: &[CornerMatch],
    level: Level,
) -> Result<Vec<Block>> {
    let [left, right] = [warped(pair[0], cameras, 0, level)?, warped(pair[1], cameras, 1, level)?];
    let (rows, cols) = left.size();
    let found = corners(&gradients(&smoothed(&left, SMOOTHING[1], level)?, level)?, CORNERS, BORDER, level)?;
    let guesses = guesses(&found, cameras, matches);

    let half = |image: &Plane<f32>| -> Result<Plane<i16>> {
        even(&smoothed(&reduced(image, (rows / 2, cols / 2))?, SMOOTHING[0], level)?, level)
    };
    let whole = |image: &Plane<f32>| even(&smoothed(image, SMOOTHING[0], level)?, level);
    let (halves, wholes) = ([half(&left)?, half(&right)?], [whole(&left)?, whole(&right)?]);

    let mut blocks = vec![];
    for (corner, guess) in found.iter().zip(guesses) {
        let [x, y] = corner.pixel;
        let to = guess.map(|by| (by / 2.0).round() as isize);
        // Near the ends of the image, a place farther in shows the motion.
        let inward = |at: usize, size: usize| at.clamp(SIDE / 2, (size - SIDE / 2).max(SIDE / 2));
        let middle = [inward(x / 2, halves[0].cols()), inward(y / 2, halves[0].rows())];
        let Some(rough) = correlated(&halves, middle, to, SEARCH[0], level) else { continue };
        let to = rough.by.map(|by| (2.0 * by).round() as isize);
        let Some(fine) = correlated(&wholes, [x, y], to, SEARCH[1], level) else { continue };

        // The middle of a block of even side lies between pixels.
        let place = [x as f64 - 0.5, y as f64 - 0.5];
        let other = [place[0] + fine.by[0], place[1] + fine.by[1]];
        let (Some(left), Some(right)) = (cameras.raw(place, 0), cameras.raw(other, 1)) else {
            continue;
        };
        if [(left, pair[0]), (right, pair[1])].iter().all(|(place, image)| is_inside(*place, image)) {
            let weight = (fine.curvature / CURVATURE.1).min(1.0);
            blocks.push(Block { places: CornerMatch { left, right }, weight });
        }
    }

    Ok(blocks)
}

fn is_inside([x, y]: Point, image: &Plane<f32>) -> bool {
    let (right, bottom) = ((image.cols() - 1) as f64, (image.rows() - 1) as f64);
    (MARGIN..=right - MARGIN).contains(&x) && (MARGIN..=bottom - MARGIN).contains(&y)
}

/// The columns and rows by which each corner is expected to move to the right image.
fn guesses(corners: &[Corner], cameras: &Cameras, matches: &[CornerMatch]) -> Vec<[f64; 2]> {
    let known: Vec<[Point; 2]> =
        matches.iter().map(|one| [cameras.rectified(one.left, 0), cameras.rectified(one.right, 1)]).collect();

    let guess = |corner: &Corner| {
        let [x, y] = corner.pixel.map(|at| at as f64);
        let mut nearest: [Option<(f64, &[Point; 2])>; NEAREST] = [None; NEAREST];
        for one in &known {
            let far = (one[0][0] - x).powi(2) + (one[0][1] - y).powi(2);
            let is_nearer = |than: &Option<(f64, _)>| than.is_none_or(|(than, _)| far < than);
            if is_nearer(&nearest[NEAREST - 1]) {
                let at = nearest.partition_point(|than| !is_nearer(than));
                nearest[at..].rotate_right(1);
                nearest[at] = Some((far, one));
            }
        }

        let near = |axis: usize| {
            let by = |(_, [left, right]): &(f64, &[Point; 2])| right[axis] - left[axis];
            median(nearest.iter().flatten().map(by)).unwrap_or(0.0)
        };
        [near(0), near(1)]
    };
    corners.iter().map(guess).collect()
}

/// The rectified image by bicubic interpolation; 0 beyond the raw one.
fn warped(image: &Plane<f32>, cameras: &Cameras, side: usize, level: Level) -> Result<Plane<f32>> {
    let backward = cameras.backward(side);
    let mut out = Plane::new(image.rows(), image.cols())?;
    for y in 0..image.rows() {
        warp_row(level, image, backward, y, out.row_mut(y));
    }
    Ok(out)
}

/// A row of the rectified image.
#[leveled]
fn warp_row(level: Level, image: &Plane<f32>, backward: Backward, y: usize, out: &mut [f32]) {
    let mut places = [[0.0; 2]; LANES];
    for (index, out) in out.chunks_mut(LANES).enumerate() {
        for (x, place) in (index * LANES..).zip(&mut places) {
            *place = backward.place([x as f64, y as f64]);
        }
        for (value, place) in out.iter_mut().zip(places) {
            *value = bicubic(image, place);
        }
    }
}

/// The value between pixels by R. Keys' cubic convolution (1981); 0 beyond the image.
#[inline(always)]
fn bicubic(image: &Plane<f32>, [x, y]: Point) -> f32 {
    let is_inside = x >= 1.0
        && y >= 1.0
        && x < image.cols().saturating_sub(2) as f64
        && y < image.rows().saturating_sub(2) as f64;
    if !is_inside {
        return 0.0;
    }

    let (column, row) = (x as usize, y as usize);
    let (along, down) = (keys((x - column as f64) as f32), keys((y - row as f64) as f32));
    let cols = image.cols();
    let pixels = &image.as_slice()[(row - 1) * cols + column - 1..][..3 * cols + 4];
    let mut sum = 0.0;
    for (k, weight) in down.iter().enumerate() {
        let taps = &pixels[k * cols..][..4];
        sum += weight * (along[0] * taps[0] + along[1] * taps[1] + along[2] * taps[2] + along[3] * taps[3]);
    }
    sum
}

#[inline(always)]
fn keys(t: f32) -> [f32; 4] {
    let (square, cube) = (t * t, t * t * t);
    [
        0.5 * (-t + 2.0 * square - cube),
        0.5 * (2.0 - 5.0 * square + 3.0 * cube),
        0.5 * (t + 4.0 * square - 3.0 * cube),
        0.5 * (cube - square),
    ]
}

/// The image without light and contrast.
fn even(image: &Plane<f32>, level: Level) -> Result<Plane<i16>> {
    let size = image.size();
    let step = f64::from(STEPS[0]);
    // Sums of integers are exact, also as doubles, which are added side by side.
    let gray = image.map(|value| (value * STEPS[0]).round().clamp(-4096.0, 4096.0));

    let windows = Windows::new(size, EVEN.0);
    let values = |y: usize| {
        let row = gray.row(y).iter().map(|value| f64::from(*value));
        row.map(|value| [value, value * value])
    };
    let even = |y: usize, x: usize, [sum, squares]: [f64; 2]| {
        let share = 1.0 / f64::from(windows.pixels(y, x));
        let mean = sum * share;
        let variance = (squares * share - mean * mean).max(0.0);
        let deviation = (variance + EVEN.1 * step * step).sqrt();
        let even = (f64::from(gray.row(y)[x]) - mean) / deviation;
        (even as f32 * STEPS[1]).clamp(-LARGEST, LARGEST).round() as i16
    };
    Plane::by_bands(size, BAND, |first, band| windows.write((first, band), values, even, level))
}

/// The place where a block was found.
struct Located {
    /// Columns and rows from its place in the left image.
    by: [f64; 2],
    /// Curvature of the correlation along y, with x free to follow.
    curvature: f64,
}

/// Finds the block around a pixel of the left image within `search` pixels of its expected place.
fn correlated(
    images: &[Plane<i16>; 2],
    [x, y]: [usize; 2],
    to: [isize; 2],
    search: [usize; 2],
    level: Level,
) -> Option<Located> {
    let half = (SIDE / 2) as isize;
    let (rows, cols) = (images[0].rows() as isize, images[0].cols() as isize);
    let [left, top] = [x as isize - half, y as isize - half];
    let ends =
        |left: isize, top: isize| left >= 0 && top >= 0 && left + 2 * half <= cols && top + 2 * half <= rows;
    if !ends(left, top) || !ends(left + to[0], top + to[1]) {
        return None;
    }

    let block = cut(&images[0], [left, top], [SIDE; 2]);
    let first = [left + to[0] - search[0] as isize, top + to[1] - search[1] as isize];
    let area = cut(&images[1], first, search.map(|reach| SIDE + 2 * reach));
    let products = products(level, &block, &area, search);
    let surface = correlate(level, &block, &area, &products, search);

    let peak = peak(&surface, search.map(|reach| 2 * reach + 1))?;
    let by = from_fn(|axis| to[axis] as f64 - search[axis] as f64 + peak.by[axis]);
    Some(Located { by, ..peak })
}

/// A part of an image, of this many columns and rows; 0 beyond it.
fn cut(image: &Plane<i16>, [left, top]: [isize; 2], [cols, rows]: [usize; 2]) -> Vec<i16> {
    let mut out = vec![0; cols * rows];
    for (y, out) in (top..).zip(out.chunks_exact_mut(cols)) {
        let row = image.row_or_nothing(y);
        let skip = (-left).clamp(0, cols as isize) as usize;
        let start = left.max(0) as usize;
        let inside = row.get(start.min(row.len())..).unwrap_or_default();
        for (out, value) in out[skip..].iter_mut().zip(inside) {
            *out = *value;
        }
    }
    out
}

/// The correlations of a block with all blocks of an area.
#[leveled]
fn correlate(level: Level, block: &[i16], area: &[i16], products: &[i32], search: [usize; 2]) -> Vec<f64> {
    let [across, down] = search.map(|reach| 2 * reach + 1);
    let width = across + SIDE - 1;
    let pixels = (SIDE * SIDE) as i64;

    // Sums over the columns of a block slide down, those over a block slide along.
    let mut columns = vec![[0i32; 2]; width];
    for row in area.chunks_exact(width).take(SIDE - 1) {
        add_row(&mut columns, row, 1);
    }

    let (own, own_squares) = sums(block);
    let own_variance = pixels * own_squares - own * own;
    let mut out = Vec::with_capacity(across * down);
    for dy in 0..down {
        add_row(&mut columns, &area[(dy + SIDE - 1) * width..][..width], 1);
        let (mut sum, mut squares) = (0i64, 0i64);
        for column in &columns[..SIDE - 1] {
            sum += i64::from(column[0]);
            squares += i64::from(column[1]);
        }

        for dx in 0..across {
            sum += i64::from(columns[dx + SIDE - 1][0]);
            squares += i64::from(columns[dx + SIDE - 1][1]);

            let variance = pixels * squares - sum * sum;
            let together = pixels * i64::from(products[dy * across + dx]) - own * sum;
            let scale = (own_variance as f64 * variance as f64).sqrt();
            out.push(if scale > 0.0 { together as f64 / scale } else { 0.0 });

            sum -= i64::from(columns[dx][0]);
            squares -= i64::from(columns[dx][1]);
        }
        add_row(&mut columns, &area[dy * width..][..width], -1);
    }

    out
}

/// The products of a block with all blocks of an area. The blocks at one column lie one after another in a
/// strip of the area.
#[leveled]
fn products(level: Level, block: &[i16], area: &[i16], search: [usize; 2]) -> Vec<i32> {
    let [across, down] = search.map(|reach| 2 * reach + 1);
    let mut products = vec![0; across * down];
    let mut strip = Vec::with_capacity((down + SIDE - 1) * SIDE);
    for dx in 0..across {
        strip.clear();
        for row in area.chunks_exact(across + SIDE - 1) {
            strip.extend_from_slice(&row[dx..][..SIDE]);
        }
        for dy in 0..down {
            let other = &strip[dy * SIDE..][..SIDE * SIDE];
            products[dy * across + dx] = scalar_product(&block[..SIDE * SIDE], other);
        }
    }
    products
}

#[inline(always)]
fn add_row(columns: &mut [[i32; 2]], row: &[i16], sign: i32) {
    for (column, value) in columns.iter_mut().zip(row) {
        let value = i32::from(*value);
        column[0] += sign * value;
        column[1] += sign * value * value;
    }
}

/// The sum, and the sum of the squares.
#[inline(always)]
fn sums(values: &[i16]) -> (i64, i64) {
    values.iter().fold((0, 0), |(sum, squares), value| {
        let value = i64::from(*value);
        (sum + value, squares + value * value)
    })
}

/// The largest of `across x down` correlations, if it is large, inside, unique and curved enough; in columns
/// and rows from the first.
fn peak(surface: &[f64], [across, down]: [usize; 2]) -> Option<Located> {
    let larger = |best: usize, at: usize| if surface[at] > surface[best] { at } else { best };
    let best = (0..surface.len()).fold(0, larger);
    let (y, x, top) = (best / across, best % across, surface[best]);
    let is_inside = (1..down - 1).contains(&y) && (1..across - 1).contains(&x);
    if !is_inside || top <= LEAST {
        return None;
    }

    let mut other: f64 = -1.0;
    for (row, values) in surface.chunks_exact(across).enumerate() {
        let near = if row.abs_diff(y) > ELSEWHERE { 0 } else { ELSEWHERE + 1 };
        let before = &values[..(x + 1).saturating_sub(near)];
        let after = values.get(x + near..).unwrap_or_default();
        other = before.iter().chain(after).copied().fold(other, f64::max);
    }

    let nine = from_fn(|at| surface[best + at / 3 * across + at % 3 - across - 1]);
    let peak = Peak::new(nine)?;
    let curvature = peak.curvature[1];
    let is_good = curvature > CURVATURE.0 && 1.0 - top < UNIQUE * (1.0 - other);
    let by = [x as f64 + peak.offset[0], y as f64 + peak.offset[1]];
    is_good.then_some(Located { by, curvature })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::levels;

    fn noise(rows: usize, cols: usize, seed: usize) -> Plane<i16> {
        Plane::from_fn(rows, cols, |y, x| {
            let mixed = (y * 7919 + x * 104_729 + seed).wrapping_mul(2_654_435_761) >> 7;
            (mixed % 801) as i16 - 400
        })
    }

    /// The correlation of two blocks by definition.
    fn plain(one: &[i16], other: &[i16]) -> f64 {
        let mean =
            |values: &[i16]| values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
        let (a, b) = (mean(one), mean(other));
        let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            one.iter().zip(other).map(|(x, y)| f(f64::from(*x) - a, f64::from(*y) - b)).sum()
        };
        sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
    }

    #[test]
    fn correlations_are_those_of_every_block() {
        let (image, search) = (noise(60, 60, 1), [4, 3]);
        let block = cut(&image, [20, 18], [SIDE; 2]);
        let area = cut(&image, [14, 15], [SIDE + 8, SIDE + 6]);
        for level in levels() {
            let name = level.name();
            let products = products(level, &block, &area, search);
            let found = correlate(level, &block, &area, &products, search);
            for (index, value) in found.iter().enumerate() {
                let at = [14 + (index % 9) as isize, 15 + (index / 9) as isize];
                let expected = plain(&block, &cut(&image, at, [SIDE; 2]));
                assert!((value - expected).abs() < 1e-9, "{name} {at:?}");
            }
        }
    }

    #[test]
    fn beyond_an_image_there_is_nothing() {
        let image = noise(30, 30, 2);
        let found = cut(&image, [-2, -1], [4; 2]);
        assert_eq!(found[..6], [0; 6]);
        assert_eq!(found[6..8], image.row(0)[..2]);
        assert_eq!(cut(&image, [28, 29], [3; 2])[..3], [image.row(29)[28], image.row(29)[29], 0]);
        assert_eq!(cut(&image, [40, 3], [2; 2]), [0; 4]);
    }

    #[test]
    fn light_and_contrast_are_taken_out_of_every_window() {
        let image = Plane::from_fn(40, 50, |y, x| ((y * 13 + x * x * 7) % 97) as f32);
        let found = even(&image, Level::best()).expect("memory");
        for (y, x) in [(0usize, 0usize), (3, 20), (20, 25), (39, 49), (33, 2)] {
            let rows = y.saturating_sub(15)..(y + 16).min(40);
            let window = rows.flat_map(|row| &image.row(row)[x.max(15) - 15..(x + 16).min(50)]);
            let values: Vec<f64> = window.map(|value| f64::from(*value)).collect();
            let count = values.len() as f64;
            let mean = values.iter().sum::<f64>() / count;
            let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count;
            let expected = (f64::from(image.row(y)[x]) - mean) / (variance + 9.0).sqrt() * 64.0;
            assert!((f64::from(found.row(y)[x]) - expected).abs() <= 0.51, "{y} {x}");
        }
    }

    #[test]
    fn a_moved_block_is_found_between_pixels() {
        let wave = |x: f64, y: f64| {
            100.0 + 30.0 * (math(0.31 * x + 0.11 * y) + math(0.17 * x - 0.41 * y) + math(0.5 * y))
        };
        let image = |by: [f64; 2]| {
            let plane = Plane::from_fn(80, 90, |y, x| wave(x as f64 - by[0], y as f64 - by[1]) as f32);
            even(&plane, Level::best())
        };
        let images = [image([0.0; 2]).expect("memory"), image([-5.3, 1.4]).expect("memory")];
        let found = correlated(&images, [45, 40], [-4, 0], [4; 2], Level::best()).expect("a block");
        assert!((found.by[0] + 5.3).abs() < 0.05 && (found.by[1] - 1.4).abs() < 0.05);
        assert!(correlated(&images, [5, 40], [0, 0], [4; 2], Level::best()).is_none(), "at the border");
    }

    fn math(angle: f64) -> f64 {
        phasestereo_match::base::math::sin(angle)
    }
}

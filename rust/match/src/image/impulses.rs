//! Impulses: pixels unrelated to their neighbors, such as hot, dead and stuck pixels, salt and pepper.
//!
//! An impulse lies far outside the range of its eight neighbors. A one-pixel detail hardly ever does, since
//! the optics spread it. With the sorted neighbors n:
//!
//! ```text
//! spread = n[6] - n[1]
//! beyond = max(pixel - n[6], n[1] - pixel)
//! if beyond > spread + height: pixel = median(n)
//! ```
//!
//! An image has impulses if enough of its pixels are impulses beyond doubt ([`count_doubtless`]). It
//! continues by reflection without repeating its outermost pixels, so that these are not their own neighbors.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled};

/// Rows above and below a pixel whose values count.
pub const REACH: usize = 1;
/// Least height of an impulse above or below its neighbors in an image that has impulses; gray levels, 255
/// from black to white.
pub const HEIGHT: f64 = 20.0;
/// Least height of an impulse beyond doubt ...
const DOUBTLESS_HEIGHT: f64 = 40.0;
/// ... plus this many times the spread of its neighbors.
const DOUBTLESS_SPREADS: i32 = 3;
/// Share of pixels beyond doubt above which there are impulses. Clean pairs have at most half of it; noisy,
/// JPEG and soft ones less.
const LEAST_SHARE: f64 = 4e-5;

/// Gray values without impulses of at least this height, in steps.
pub fn repaired(plane: &Plane<i32>, height: i32, level: Level, control: &Control) -> Result<Plane<i32>> {
    let (rows, cols) = (plane.rows(), plane.cols());
    Plane::by_bands((rows, cols), 1, |y, out| {
        control.checkpoint()?;
        repair_row(level, around(plane, y), height, out);
        Ok(())
    })
}

/// The number of impulses beyond doubt in some rows, for this many steps per gray level.
pub fn count_doubtless(
    plane: &Plane<i32>,
    rows: std::ops::Range<usize>,
    steps: f64,
    level: Level,
) -> Result<u64> {
    let mut count = 0;
    let mut found = zeroed(plane.cols())?;
    let height = (DOUBTLESS_HEIGHT * steps) as i32;

    for y in rows {
        count += u64::from(doubtless(level, around(plane, y), height, &mut found));
    }

    Ok(count)
}

/// Whether there are more pixels beyond doubt than in a clean image.
pub fn has_impulses(doubtless: u64, pixels: usize) -> bool {
    doubtless as f64 > LEAST_SHARE * pixels as f64
}

/// Reflects an index at most one beyond `0..length`: `c b | a b c | b a`.
#[inline(always)]
pub fn mirrored(index: isize, length: usize) -> usize {
    let last = length as isize - 1;
    let inside = if index > last { 2 * last - index } else { index.abs() };
    inside.clamp(0, last) as usize
}

/// The row above row `y`, itself, and the one below it.
fn around(plane: &Plane<i32>, y: usize) -> [&[i32]; 3] {
    [-1, 0, 1].map(|by| plane.row(mirrored(y as isize + by, plane.rows())))
}

/// The first and the last column: some of their neighbors are outside the row.
#[inline(always)]
fn ends(cols: usize) -> [usize; 2] {
    [0, cols - 1]
}

/// The pixels of three rows from the one before column `x` to the one after it.
#[inline(always)]
fn neighbors(rows: [&[i32]; 3], x: usize) -> [[i32; 3]; 3] {
    rows.map(|row| [-1, 0, 1].map(|by| row[mirrored(x as isize + by, row.len())]))
}

/// Writes a row without impulses.
#[leveled]
fn repair_row(level: Level, rows: [&[i32]; 3], height: i32, out: &mut [i32]) {
    let cols = out.len();

    for x in ends(cols) {
        let [above, own, below] = &neighbors(rows, x);
        repair([above, own, below], height, &mut out[x..=x]);
    }
    if cols > 2 {
        repair(rows, height, &mut out[1..cols - 1]);
    }
}

/// Writes pixels from the second one of these rows on. Outputs and inputs are separate arguments, so that the
/// vectorizer sees that they do not overlap.
#[inline(always)]
fn repair([above, own, below]: [&[i32]; 3], height: i32, out: &mut [i32]) {
    let n = out.len();
    let (above, own, below) = (&above[..n + 2], &own[..n + 2], &below[..n + 2]);

    for x in 0..n {
        let (beyond, spread, middle) = compared(above, own, below, x);
        out[x] = if beyond - spread > height { middle } else { own[x + 1] };
    }
}

/// Writes 1 for impulses beyond doubt, else 0, and counts them.
#[leveled]
fn doubtless(level: Level, rows: [&[i32]; 3], height: i32, found: &mut [u32]) -> u32 {
    let cols = found.len();

    for x in ends(cols) {
        let [above, own, below] = &neighbors(rows, x);
        find_doubtless([above, own, below], height, &mut found[x..=x]);
    }
    if cols > 2 {
        find_doubtless(rows, height, &mut found[1..cols - 1]);
    }

    found.iter().sum()
}

/// The vectorized part of [`doubtless`], with separate arguments as in [`repair`].
#[inline(always)]
fn find_doubtless([above, own, below]: [&[i32]; 3], height: i32, found: &mut [u32]) {
    let n = found.len();
    let (above, own, below) = (&above[..n + 2], &own[..n + 2], &below[..n + 2]);

    for (x, found) in found.iter_mut().enumerate() {
        let (beyond, spread, _) = compared(above, own, below, x);
        *found = u32::from(beyond - DOUBTLESS_SPREADS * spread > height);
    }
}

/// How far a pixel lies beyond its neighbors, their spread, and their median.
#[inline(always)]
fn compared(above: &[i32], own: &[i32], below: &[i32], x: usize) -> (i32, i32, i32) {
    let (low, middle, high) = ranks([
        above[x],
        above[x + 1],
        above[x + 2],
        own[x],
        own[x + 2],
        below[x],
        below[x + 1],
        below[x + 2],
    ]);

    let pixel = own[x + 1];
    ((pixel - high).max(low - pixel), high - low, middle)
}

/// Of eight values, the second smallest, the mean of the middle two, rounded down, and the second largest.
#[inline(always)]
#[expect(clippy::many_single_char_names, reason = "places of a network that sorts")]
fn ranks(values: [i32; 8]) -> (i32, i32, i32) {
    let [a, b, c, d, e, f, g, h] = values;

    // Batcher's odd-even merge sort, without the unused outputs.
    let ((a, b), (c, d), (e, f), (g, h)) = (sorted(a, b), sorted(c, d), sorted(e, f), sorted(g, h));
    let ((a, c), (b, d), (e, g), (f, h)) = (sorted(a, c), sorted(b, d), sorted(e, g), sorted(f, h));
    let ((b, c), (f, g)) = (sorted(b, c), sorted(f, g));
    let ((_, e), (b, f), (c, g), (d, _)) = (sorted(a, e), sorted(b, f), sorted(c, g), sorted(d, h));
    let ((c, e), (d, f)) = (sorted(c, e), sorted(d, f));
    let ((b, _), (d, e), (_, g)) = (sorted(b, c), sorted(d, e), sorted(f, g));

    (b, (d + e) >> 1, g)
}

/// Two values in rising order.
#[inline(always)]
fn sorted(a: i32, b: i32) -> (i32, i32) {
    (a.min(b), a.max(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_those_of_the_sorted() {
        // Networks that sort zeros and ones sort anything; two bits per value also distinguish a rank from
        // its neighbors.
        for code in 0..1 << 16 {
            let values: [i32; 8] = std::array::from_fn(|i| code >> (2 * i) & 3);
            let mut sorted = values;
            sorted.sort_unstable();
            let expected = (sorted[1], (sorted[3] + sorted[4]) >> 1, sorted[6]);
            assert_eq!(ranks(values), expected, "{values:?}");
        }
    }

    #[test]
    fn mirrors_leave_the_edge_out() {
        let reached: Vec<_> = (-1..4).map(|i| mirrored(i, 3)).collect();
        assert_eq!(reached, [1, 0, 1, 2, 1]);
        assert_eq!([mirrored(-1, 1), mirrored(1, 1)], [0, 0]);
        assert_eq!([mirrored(-1, 2), mirrored(2, 2)], [1, 0]);
    }
}

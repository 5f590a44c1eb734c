//! Medians of a map's neighboring disparities.
//!
//! Disparities are compared as integers in the same order, for which all instruction sets have vector
//! instructions. A median is a fixed sequence of minima and maxima, compiled for many pixels side by side.

use std::array::from_fn;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::pair::plan::{Plan, Stage};
use crate::refinement::window_rows::{BAND, WindowRows, missing_rows};

/// The key of a missing disparity, below all others.
pub const NONE: i32 = i32::MIN;
/// Rows above and below a pixel that its median covers.
pub const REACH: usize = 1;

/// Rows and columns of a window.
const SIDE: usize = 2 * REACH + 1;

/// The median of disparities.
pub struct Median;

impl Stage for Median {
    fn reach(&self, plan: Plan) -> usize {
        if plan.settings.median > 0 { REACH } else { 0 }
    }
}

/// The median of the 3 x 3 disparities around each pixel; beyond the border the map repeats its edge.
///
/// For neighbors without a disparity, the pixel's own counts. A pixel without one stays without.
pub fn smooth(
    disparity: &Plane<f32>,
    smoothed: &mut Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let cols = disparity.cols();
    smoothed.write_bands(BAND, |first, smoothed| {
        control.checkpoint()?;

        let keys = WindowRows::new(cols, NONE)?;
        medians(level, disparity, first, keys, smoothed);
        Ok(())
    })
}

/// The integer by which a disparity is compared.
#[inline(always)]
pub fn key(disparity: f32) -> i32 {
    if disparity.is_nan() { NONE } else { flipped(disparity.to_bits().cast_signed()) }
}

/// The disparity of a key.
#[inline(always)]
pub fn disparity(key: i32) -> f32 {
    if key == NONE { f32::NAN } else { f32::from_bits(flipped(key).cast_unsigned()) }
}

/// The smaller a negative float, the larger its bits: flips all of them but the sign. Its own inverse.
#[inline(always)]
fn flipped(bits: i32) -> i32 {
    bits ^ (bits >> 31 & i32::MAX)
}

/// Writes the medians of a band that begins at row `first`. `keys`: row `y` of the map has number `y +
/// REACH`.
#[leveled]
fn medians(
    level: Level,
    disparity: &Plane<f32>,
    first: usize,
    keys: WindowRows<i32, SIDE>,
    smoothed: &mut [f32],
) {
    let mut keys = keys;
    let (rows, cols) = (disparity.rows(), disparity.cols());

    for (y, smoothed) in (first..).zip(smoothed.chunks_mut(cols)) {
        for number in missing_rows::<SIDE>(y, first) {
            let y = number.saturating_sub(REACH).min(rows - 1);
            write_keys(disparity.row(y), keys.row_mut(number));
            keys.repeat_ends(number);
        }

        write_medians(from_fn(|dy| keys.row(y + dy, REACH)), smoothed);
    }
}

/// Writes the keys of a row.
#[inline(always)]
fn write_keys(disparity: &[f32], keys: &mut [i32]) {
    for (key, disparity) in keys.iter_mut().zip(disparity) {
        *key = self::key(*disparity);
    }
}

/// Writes the medians of a row of windows.
#[inline(always)]
fn write_medians(keys: [&[i32]; SIDE], smoothed: &mut [f32]) {
    let cols = smoothed.len();
    let keys = keys.map(|row| &row[..cols + 2 * REACH]);

    for x in 0..cols {
        let center = keys[REACH][x + REACH];

        let mut window = [NONE; SIDE * SIDE];
        for (place, value) in window.iter_mut().enumerate() {
            let key = keys[place / SIDE][x + place % SIDE];
            // For neighbors without a disparity, the pixel's own counts.
            *value = if key == NONE { center } else { key };
        }

        let median = median9(window);
        smoothed[x] = self::disparity(if center == NONE { NONE } else { median });
    }
}

/// The median of 9 values, by excluding extremes: of any six of them, neither the smallest nor the largest is
/// the median of all. Each step excludes both and includes one more value; three values remain. The steps are
/// listed, since only a constant number of values stays in registers.
#[inline(always)]
pub fn median9(mut values: [i32; 9]) -> i32 {
    extremes_to_ends::<6>(&mut values, 0);
    values[5] = values[6];
    extremes_to_ends::<5>(&mut values, 1);
    values[5] = values[7];
    extremes_to_ends::<4>(&mut values, 2);
    values[5] = values[8];
    extremes_to_ends::<3>(&mut values, 3);
    values[4]
}

/// Moves the smallest of `COUNT` values from `first` on to the front, and the largest to the end.
#[inline(always)]
fn extremes_to_ends<const COUNT: usize>(values: &mut [i32], first: usize) {
    let values = &mut values[first..][..COUNT];
    let last = COUNT - 1;
    let half = COUNT.div_ceil(2);

    // After this, the lower half contains the smallest value, the upper half the largest.
    for i in 0..COUNT / 2 {
        order(values, i, last - i);
    }

    for i in 1..half {
        order(values, 0, i);
    }
    for i in last + 1 - half..last {
        order(values, i, last);
    }
}

/// Swaps two values if they are out of order.
#[inline(always)]
fn order(values: &mut [i32], lower: usize, upper: usize) {
    let (a, b) = (values[lower], values[upper]);
    (values[lower], values[upper]) = (a.min(b), a.max(b));
}

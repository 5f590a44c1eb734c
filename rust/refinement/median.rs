//! Medians of a map's neighboring disparities, many pixels side by side.
//!
//! Disparities are compared as integers of the same order, for which every instruction set has vector instructions. Loops
//! over lanes are written out: closures of this size are no longer inlined, and what is not inlined is not compiled for
//! the level.

use crate::error::Result;
use crate::image::plane::{Plane, parts};
use crate::pipeline::control::Control;
use crate::simd::{Level, Loop};

/// Pixels whose medians are found at once.
pub const LANES: usize = 32;
/// The key of no disparity, below all others.
pub const NONE: i32 = i32::MIN;
/// Rows above and below a pixel that its median is taken over.
pub const REACH: usize = 1;

/// Columns that the windows of [`LANES`] pixels reach.
const SPAN: usize = LANES + 2 * REACH;

/// Keys of [`LANES`] neighboring pixels.
pub type KeyLanes = [i32; LANES];

/// The median of the 3 x 3 disparities around each pixel; beyond the border the map repeats its edge.
///
/// Neighbors without a disparity count as the pixel itself. A pixel without one stays without.
pub fn smooth(
    disparity: &Plane<f32>,
    smoothed: &mut Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<()> {
    smoothed.write_bands(1, |y, smoothed| {
        control.checkpoint()?;
        let rows = [y.saturating_sub(1), y, (y + 1).min(disparity.rows() - 1)];
        level.run(MedianRow { rows: rows.map(|y| disparity.row(y)), smoothed });
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

/// Negative floats have the larger bits the smaller they are: flips all bits but their sign. Its own inverse.
#[inline(always)]
fn flipped(bits: i32) -> i32 {
    bits ^ (bits >> 31 & i32::MAX)
}

/// Writes the medians of one row, from the rows above, at and below it.
struct MedianRow<'a> {
    rows: [&'a [f32]; 3],
    smoothed: &'a mut [f32],
}

impl Loop for MedianRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut buffer = [[0.0; SPAN]; 3];

        for (index, out) in self.smoothed.chunks_mut(LANES).enumerate() {
            let first = (index * LANES) as isize - REACH as isize;

            let nearest = |row: &[f32], x: isize| row[x.clamp(0, row.len() as isize - 1) as usize];
            let rows: [[i32; SPAN]; 3] = keys_of(parts(self.rows, first, &mut buffer, nearest));
            let center = lanes(&rows[1], REACH);

            // Neighbors without a disparity count as the pixel itself.
            let mut keys = [[NONE; LANES]; 9];
            for (place, keys) in keys.iter_mut().enumerate() {
                *keys = lanes(&rows[place / 3], place % 3);

                for j in 0..LANES {
                    keys[j] = if keys[j] == NONE { center[j] } else { keys[j] };
                }
            }

            let median = median9(keys);

            let mut smoothed = [0.0; LANES];
            for j in 0..LANES {
                smoothed[j] = disparity(if center[j] == NONE { NONE } else { median[j] });
            }

            out.copy_from_slice(&smoothed[..out.len()]);
        }
    }
}

/// The keys of some rows.
#[inline(always)]
pub fn keys_of<const ROWS: usize, const COUNT: usize>(
    rows: [&[f32]; ROWS],
) -> [[i32; COUNT]; ROWS] {
    let mut keys = [[NONE; COUNT]; ROWS];
    for (keys, row) in keys.iter_mut().zip(rows) {
        let row = &row[..COUNT];
        for j in 0..COUNT {
            keys[j] = key(row[j]);
        }
    }
    keys
}

/// [`LANES`] keys of a row from `x` on.
#[inline(always)]
pub fn lanes(row: &[i32], x: usize) -> KeyLanes {
    row[x..].first_chunk().copied().unwrap_or([0; LANES])
}

/// Leaves the median of the values in the middle one of `N` values, by excluding extremes.
///
/// Of any `N / 2 + 2` of `N` values neither the least nor the largest is the median of all. Each step excludes both and
/// includes one value more; three values are left at the end. The steps are listed, since only a constant number of
/// values stays in registers.
macro_rules! exclude_extremes {
    ($values:ident, $half:literal: $($count:literal)*) => {
        $(
            extremes_to_ends::<{ $half + 2 - $count }>(&mut $values, $count);
            if $count + 1 < $half {
                $values[$half + 1] = $values[$half + 2 + $count];
            }
        )*
    };
}

/// The medians of 9 values.
#[inline(always)]
pub fn median9(mut values: [KeyLanes; 9]) -> KeyLanes {
    exclude_extremes!(values, 4: 0 1 2 3);
    values[4]
}

/// The medians of 25 values.
#[inline(always)]
pub fn median25(mut values: [KeyLanes; 25]) -> KeyLanes {
    exclude_extremes!(values, 12: 0 1 2 3 4 5 6 7 8 9 10 11);
    values[12]
}

/// Of `COUNT` values from the `first` on, moves the least to the front and the largest to the end.
#[inline(always)]
fn extremes_to_ends<const COUNT: usize>(values: &mut [KeyLanes], first: usize) {
    let values = &mut values[first..][..COUNT];
    let last = COUNT - 1;
    let half = COUNT.div_ceil(2);

    // After this the lower half has the least value, the upper half the largest.
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

/// Swaps two values where they are out of order.
#[inline(always)]
fn order(values: &mut [KeyLanes], lower: usize, upper: usize) {
    let (a, b) = (values[lower], values[upper]);

    for j in 0..LANES {
        (values[lower][j], values[upper][j]) = (a[j].min(b[j]), a[j].max(b[j]));
    }
}

//! Medians of a map's neighboring disparities, many pixels side by side.
//!
//! Disparities are compared as integers of the same order: that is one instruction wherever there are lanes.
//! Loops over lanes are spelt out here: closures of such size are no longer inlined, and what is not inlined
//! is not compiled for the level.

use crate::error::Result;
use crate::image::plane::{Plane, parts};
use crate::pipeline::control::Control;
use crate::simd::{Level, Loop};

/// Pixels whose medians are found at once.
pub const LANES: usize = 32;
/// The key of no disparity, below all others.
pub const NONE: i32 = i32::MIN;
/// Rows above and below that a median is of.
pub const REACH: usize = 1;

/// Columns about some pixels that their medians are of.
const SPAN: usize = LANES + 2 * REACH;

/// A number for each of some neighboring pixels.
pub type KeyLanes = [i32; LANES];

/// The median of 3 x 3 disparities about each pixel; beyond the border the map is continued by its last values.
///
/// Neighbors without a disparity count as the pixel itself; where there is none, none is made up.
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

/// The larger a negative float, the smaller are its bits: all but the sign are turned over, or turned back.
#[inline(always)]
fn flipped(bits: i32) -> i32 {
    bits ^ (bits >> 31 & i32::MAX)
}

/// One row, from those above, at and below it.
struct MedianRow<'a> {
    rows: [&'a [f32]; 3],
    smoothed: &'a mut [f32],
}

impl Loop for MedianRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut room = [[0.0; SPAN]; 3];
        for (index, out) in self.smoothed.chunks_mut(LANES).enumerate() {
            let first = (index * LANES) as isize - REACH as isize;
            let nearest = |row: &[f32], x: isize| row[x.clamp(0, row.len() as isize - 1) as usize];
            let rows: [[i32; SPAN]; 3] = keys_of(parts(self.rows, first, &mut room, nearest));
            let center = lanes(&rows[1], REACH);
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

/// The lanes of a row from `x` on.
#[inline(always)]
pub fn lanes(row: &[i32], x: usize) -> KeyLanes {
    row[x..].first_chunk().copied().unwrap_or([0; LANES])
}

/// Puts the extremes of some values aside, again and again, each time with another value in place of the last.
///
/// Of any N / 2 + 2 of N values neither the least nor the largest is the median of all: at the end there are
/// three of them. It is spelt out how often, since only known numbers of values stay in registers.
macro_rules! put_aside {
    ($values:ident, $half:literal: $($count:literal)*) => {
        $(
            put_apart::<{ $half + 2 - $count }>(&mut $values, $count);
            if $count + 1 < $half {
                $values[$half + 1] = $values[$half + 2 + $count];
            }
        )*
    };
}

/// The medians of 9 values.
#[inline(always)]
pub fn median9(mut values: [KeyLanes; 9]) -> KeyLanes {
    put_aside!(values, 4: 0 1 2 3);
    values[4]
}

/// The medians of 25 values.
#[inline(always)]
pub fn median25(mut values: [KeyLanes; 25]) -> KeyLanes {
    put_aside!(values, 12: 0 1 2 3 4 5 6 7 8 9 10 11);
    values[12]
}

/// Of `COUNT` values from the `first` on, brings the least to the front and the largest to the end.
#[inline(always)]
fn put_apart<const COUNT: usize>(values: &mut [KeyLanes], first: usize) {
    let values = &mut values[first..][..COUNT];
    let (last, half) = (COUNT - 1, COUNT.div_ceil(2));
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

#[inline(always)]
fn order(values: &mut [KeyLanes], lower: usize, upper: usize) {
    let (a, b) = (values[lower], values[upper]);
    for j in 0..LANES {
        (values[lower][j], values[upper][j]) = (a[j].min(b[j]), a[j].max(b[j]));
    }
}

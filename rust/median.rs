//! Medians of a map's neighbouring disparities, many pixels side by side.
//!
//! Disparities are compared as integers of the same order: that is one instruction wherever there are lanes.
//! Loops over lanes are spelt out here: closures of such size are no longer inlined, and what is not inlined
//! is not compiled for the level.

use std::ops::Range;

use crate::control::Control;
use crate::error::Result;
use crate::memory::Memory;
use crate::plane::Plane;
use crate::simd::{Kernel, Level};

/// Pixels whose medians are found at once.
pub const LANES: usize = 32;
/// The key of no disparity, below all others.
pub const NONE: i32 = i32::MIN;
/// Rows of a band: of as many the values beside the image are made up at a time.
pub const BAND: usize = 32;
/// Rows above and below that a median is of.
pub const REACH: usize = 1;

/// A number for each of some neighbouring pixels.
pub type Lanes = [i32; LANES];

/// The median of 3 x 3 disparities about each pixel; beyond the border the map is continued by its last values.
///
/// Neighbours without a disparity count as the pixel itself; where there is none, none is made up.
pub fn smooth(disparity: &Plane<f32>, level: Level, control: &Control) -> Result<Plane<f32>> {
    let size = (disparity.rows(), disparity.cols());
    Plane::by_bands(size, BAND, |first, out| {
        control.checkpoint()?;
        let rows = first as isize - 1..(first + out.len() / size.1) as isize + 1;
        let padded = Padded::new(disparity, rows, 1, key, |key| key)?;
        for (y, out) in out.chunks_mut(size.1).enumerate() {
            level.run(Smooth { rows: [0, 1, 2].map(|dy| padded.row(y + dy)), out });
        }
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

/// Rows of a plane as integers, with so many more columns on either side that no neighbour is missing.
#[derive(Debug)]
pub struct Padded {
    values: Memory<i32>,
    cols: usize,
}

impl Padded {
    /// Of these rows and `margin` columns beside them, what `inside` makes of what the plane has, or `beyond`
    /// of the last number before; on the right as many more as lanes may reach.
    pub fn new<T: Copy>(
        plane: &Plane<T>,
        rows: Range<isize>,
        margin: usize,
        inside: impl Fn(T) -> i32,
        beyond: impl Fn(i32) -> i32,
    ) -> Result<Self> {
        let cols = plane.cols() + 2 * margin + LANES;
        let mut values = Memory::default();
        values.room(rows.len() * cols)?;
        for (y, out) in rows.zip(values.chunks_exact_mut(cols)) {
            let nearest = y.clamp(0, plane.rows() as isize - 1);
            let (before, out) = out.split_at_mut(margin);
            let (middle, after) = out.split_at_mut(plane.cols());
            for (out, value) in middle.iter_mut().zip(plane.row(nearest as usize)) {
                let number = inside(*value);
                *out = if y == nearest { number } else { beyond(number) };
            }
            before.fill(beyond(middle[0]));
            after.fill(beyond(middle[middle.len() - 1]));
        }
        Ok(Self { values, cols })
    }

    /// The `index`-th of the rows.
    pub fn row(&self, index: usize) -> &[i32] {
        &self.values[index * self.cols..][..self.cols]
    }
}

/// One row, from the keys of those above, at and below it, with one column more on either side.
struct Smooth<'a> {
    rows: [&'a [i32]; 3],
    out: &'a mut [f32],
}

impl Kernel for Smooth<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (chunk, out) in self.out.chunks_mut(LANES).enumerate() {
            let x = chunk * LANES;
            let centre = lanes(self.rows[1], x + 1);
            let mut keys = [[NONE; LANES]; 9];
            for (place, keys) in keys.iter_mut().enumerate() {
                *keys = lanes(self.rows[place / 3], x + place % 3);
                for j in 0..LANES {
                    keys[j] = if keys[j] == NONE { centre[j] } else { keys[j] };
                }
            }
            let median = median9(keys);
            let mut smoothed = [0.0; LANES];
            for j in 0..LANES {
                smoothed[j] = disparity(if centre[j] == NONE { NONE } else { median[j] });
            }
            out.copy_from_slice(&smoothed[..out.len()]);
        }
    }
}

/// The lanes of a row from `x` on.
#[inline(always)]
pub fn lanes(row: &[i32], x: usize) -> Lanes {
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
pub fn median9(mut values: [Lanes; 9]) -> Lanes {
    put_aside!(values, 4: 0 1 2 3);
    values[4]
}

/// The medians of 25 values.
#[inline(always)]
pub fn median25(mut values: [Lanes; 25]) -> Lanes {
    put_aside!(values, 12: 0 1 2 3 4 5 6 7 8 9 10 11);
    values[12]
}

/// Of `COUNT` values from the `first` on, brings the least to the front and the largest to the end.
#[inline(always)]
fn put_apart<const COUNT: usize>(values: &mut [Lanes], first: usize) {
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
fn order(values: &mut [Lanes], lower: usize, upper: usize) {
    let (a, b) = (values[lower], values[upper]);
    for j in 0..LANES {
        (values[lower][j], values[upper][j]) = (a[j].min(b[j]), a[j].max(b[j]));
    }
}

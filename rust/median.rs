//! Medians of a map's neighbouring disparities, many pixels side by side.

use std::array::from_fn;
use std::ops::Range;

use crate::control::Control;
use crate::error::Result;
use crate::memory::Memory;
use crate::plane::Plane;
use crate::simd::{Kernel, Level};

/// Pixels whose medians are found at once.
pub const LANES: usize = 16;
/// Rows of a band: of as many the values beside the image are made up at a time.
pub const BAND: usize = 32;

/// A value for each of some neighbouring pixels.
pub type Lanes<T> = [T; LANES];

/// The median of 3 x 3 disparities about each pixel; beyond the border the map is continued by its last values.
///
/// Neighbours without a disparity count as the pixel itself; where there is none, none is made up.
pub fn smooth(disparity: &Plane<f32>, level: Level, control: &Control) -> Result<Plane<f32>> {
    let size = (disparity.rows(), disparity.cols());
    Plane::by_bands(size, BAND, |first, out| {
        control.checkpoint()?;
        let rows = first as isize - 1..(first + out.len() / size.1) as isize + 1;
        let padded = Padded::new(disparity, rows, 1, |value| value)?;
        for (y, out) in out.chunks_mut(size.1).enumerate() {
            level.run(Smooth { rows: [0, 1, 2].map(|dy| padded.row(y + dy)), out });
        }
        Ok(())
    })
}

/// Rows of a plane with so many more columns on either side that no neighbour is missing.
#[derive(Debug)]
pub struct Padded<T> {
    values: Memory<T>,
    cols: usize,
}

impl<T: Copy + Default> Padded<T> {
    /// Of these rows and `margin` columns beside them, what the plane has, or `beyond` of the last value that it
    /// has; on the right as many more as lanes may reach.
    pub fn new(
        plane: &Plane<T>,
        rows: Range<isize>,
        margin: usize,
        beyond: impl Fn(T) -> T,
    ) -> Result<Self> {
        let cols = plane.cols() + 2 * margin + LANES;
        let mut values = Memory::default();
        values.room(rows.len() * cols)?;
        for (y, out) in rows.zip(values.chunks_exact_mut(cols)) {
            let nearest = y.clamp(0, plane.rows() as isize - 1);
            let row = plane.row(nearest as usize);
            let (before, out) = out.split_at_mut(margin);
            let (inside, after) = out.split_at_mut(row.len());
            before.fill(beyond(row[0]));
            inside.copy_from_slice(row);
            after.fill(beyond(row[row.len() - 1]));
            if y != nearest {
                inside.iter_mut().for_each(|value| *value = beyond(*value));
            }
        }
        Ok(Self { values, cols })
    }

    /// The `index`-th of the rows.
    pub fn row(&self, index: usize) -> &[T] {
        &self.values[index * self.cols..][..self.cols]
    }
}

/// One row, from those above, at and below it, with one column more on either side.
struct Smooth<'a> {
    rows: [&'a [f32]; 3],
    out: &'a mut [f32],
}

impl Kernel for Smooth<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (chunk, out) in self.out.chunks_mut(LANES).enumerate() {
            let x = chunk * LANES;
            let centre = lanes(self.rows[1], x + 1);
            let values: [_; 9] = from_fn(|place| {
                let value = lanes(self.rows[place / 3], x + place % 3);
                from_fn(|j| if value[j].is_nan() { centre[j] } else { value[j] })
            });
            let median = median(values);
            for (j, out) in out.iter_mut().enumerate() {
                *out = if centre[j].is_nan() { centre[j] } else { median[j] };
            }
        }
    }
}

/// The lanes of a row from `x` on.
#[inline(always)]
pub fn lanes<T: Copy + Default>(row: &[T], x: usize) -> Lanes<T> {
    row[x..].first_chunk().copied().unwrap_or([T::default(); LANES])
}

/// The median, lane by lane, of an odd number of values from 3 on, none of them NaN.
///
/// Of any N / 2 + 2 of N values neither the least nor the largest is the median of all, so these two are put
/// aside and another one joins, until there are three.
#[inline(always)]
pub fn median<const N: usize>(mut values: [Lanes<f32>; N]) -> Lanes<f32> {
    let last = N / 2 + 1;
    for first in 0..last - 1 {
        put_apart(&mut values[first..=last]);
        if first < last - 2 {
            values[last] = values[last + 1 + first];
        }
    }
    values[last - 1]
}

/// Brings the least of some values to the front and the largest to the end.
#[inline(always)]
fn put_apart(values: &mut [Lanes<f32>]) {
    let last = values.len() - 1;
    let half = values.len().div_ceil(2);
    for i in 0..values.len() / 2 {
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
fn order(values: &mut [Lanes<f32>], lower: usize, upper: usize) {
    let (a, b) = (values[lower], values[upper]);
    values[lower] = from_fn(|j| if a[j] < b[j] { a[j] } else { b[j] });
    values[upper] = from_fn(|j| if a[j] < b[j] { b[j] } else { a[j] });
}

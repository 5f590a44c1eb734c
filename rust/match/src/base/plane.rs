//! `Plane<T>`: rows x columns, row-major and contiguous; all stages read and write it.
//!
//! A cost volume is a plane too: one row holds `width x candidates` values, candidate innermost.

use std::fmt;
use std::ops::Range;

use ndarray::Axis;
use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::{Error, Result};

/// Rows that one task works on: enough that starting a task is little work, few enough that all threads have
/// tasks.
pub const TASK_ROWS: usize = 32;

/// A rectangle of values, row-major and contiguous.
#[derive(Clone, PartialEq, Eq)]
pub struct Plane<T> {
    rows: usize,
    cols: usize,
    data: Vec<T>,
}

/// Shows the size and the first values: all of them would fill screens.
impl<T: fmt::Debug> fmt::Debug for Plane<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let first = &self.data[..self.data.len().min(8)];
        write!(f, "{} x {} of {first:?}", self.rows, self.cols)
    }
}

impl<T> Plane<T> {
    /// Wraps `data`, whose length must be `rows * cols`.
    pub fn from_vec(rows: usize, cols: usize, data: Vec<T>) -> Result<Self> {
        if rows.checked_mul(cols) == Some(data.len()) {
            return Ok(Self { rows, cols, data });
        }

        Err(Error::value("plane", format!("{} values", data.len()), format!("{rows} x {cols}")))
    }

    /// A plane of `value(y, x)` at every place.
    pub fn from_fn(rows: usize, cols: usize, mut value: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(rows * cols);
        for y in 0..rows {
            data.extend((0..cols).map(|x| value(y, x)));
        }

        Self { rows, cols, data }
    }

    /// The plane turned by 90 degrees counterclockwise: columns become rows, the last one the first row.
    pub fn turned(&self) -> Self
    where
        T: Copy,
    {
        Self::from_fn(self.cols, self.rows, |y, x| self.row(x)[self.cols - 1 - y])
    }

    /// The plane turned by 90 degrees clockwise: the inverse of [`Self::turned`].
    pub fn turned_back(&self) -> Self
    where
        T: Copy,
    {
        Self::from_fn(self.cols, self.rows, |y, x| self.row(self.rows - 1 - x)[y])
    }

    /// The plane with its rows (axis 0) or columns (axis 1) in reverse order.
    pub fn reversed(&self, axis: Axis) -> Self
    where
        T: Copy,
    {
        let (rows, cols) = self.size();
        Self::from_fn(rows, cols, |y, x| match axis {
            Axis(0) => self.row(rows - 1 - y)[x],
            _ => self.row(y)[cols - 1 - x],
        })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Numbers of rows and of columns.
    pub fn size(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.cols..][..self.cols]
    }

    /// Row `y`; empty above and below the plane.
    #[doc(hidden)]
    pub fn row_or_nothing(&self, y: isize) -> &[T] {
        usize::try_from(y).ok().filter(|y| *y < self.rows).map_or(&[], |y| self.row(y))
    }

    /// Row `y`, writable.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.cols..][..self.cols]
    }

    /// All values, row after row.
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// All values, row after row, writable.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Takes out the values, row after row.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// Keeps some of the rows, and frees the memory of the others.
    #[doc(hidden)]
    pub fn of_rows(mut self, rows: Range<usize>) -> Self {
        if rows != (0..self.rows) {
            // The end goes first, so that fewer values are moved.
            self.data.truncate(rows.end * self.cols);
            self.data.drain(..rows.start * self.cols);
            self.data.shrink_to_fit();
        }

        Self { rows: rows.len(), ..self }
    }

    /// A copy of some of the rows.
    #[doc(hidden)]
    pub fn copy_of_rows(&self, rows: Range<usize>) -> Self
    where
        T: Clone,
    {
        let data = self.data[rows.start * self.cols..rows.end * self.cols].to_vec();
        Self { rows: rows.len(), cols: self.cols, data }
    }

    /// The same rectangle with `f` applied to every value.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Plane<U> {
        Plane { rows: self.rows, cols: self.cols, data: self.data.iter().map(f).collect() }
    }
}

impl<T: Clone + Default> Plane<T> {
    /// A plane of default values; an error, not an abort, if memory runs out.
    pub fn new(rows: usize, cols: usize) -> Result<Self> {
        let count = rows.checked_mul(cols).ok_or(Error::OutOfMemory { bytes: usize::MAX })?;

        Ok(Self { rows, cols, data: zeroed(count)? })
    }
}

#[doc(hidden)]
impl<T: Send> Plane<T> {
    /// Overwrites bands of `band_rows` rows by `write(first_row, values)`, on the threads of the current
    /// pool.
    pub fn write_bands(
        &mut self,
        band_rows: usize,
        write: impl Fn(usize, &mut [T]) -> Result<()> + Sync,
    ) -> Result<()> {
        let bands = self.data.par_chunks_mut(band_rows * self.cols).enumerate();
        bands.try_for_each(|(band, values)| write(band * band_rows, values))
    }
}

#[doc(hidden)]
impl<T: Clone + Default + Send> Plane<T> {
    /// A plane whose bands of `band_rows` rows are written by `write(first_row, values)`, on the threads of
    /// the current pool.
    pub fn by_bands(
        (rows, cols): (usize, usize),
        band_rows: usize,
        write: impl Fn(usize, &mut [T]) -> Result<()> + Sync,
    ) -> Result<Self> {
        let mut plane = Self::new(rows, cols)?;
        plane.write_bands(band_rows, write)?;
        Ok(plane)
    }

    /// Like [`Self::by_bands`], with buffers that are reused from band to band; there may be more of them
    /// than threads.
    pub fn by_bands_with<B>(
        (rows, cols): (usize, usize),
        band_rows: usize,
        buffers: impl Fn() -> Result<B> + Send + Sync,
        write: impl Fn(&mut B, usize, &mut [T]) -> Result<()> + Send + Sync,
    ) -> Result<Self> {
        let mut plane = Self::new(rows, cols)?;

        let bands = plane.data.par_chunks_mut(band_rows * cols).enumerate();
        bands.try_for_each_init(buffers, |buffers, (band, values)| {
            let buffers = buffers.as_mut().map_err(|error| error.clone())?;
            write(buffers, band * band_rows, values)
        })?;

        Ok(plane)
    }

    /// A plane whose rows are written by `write(y, row)`, on the threads of the current pool.
    pub fn by_rows(
        size: (usize, usize),
        control: &Control,
        write: impl Fn(usize, &mut [T]) + Sync,
    ) -> Result<Self> {
        Self::by_bands(size, 1, |y, row| {
            control.checkpoint()?;
            write(y, row);
            Ok(())
        })
    }

    /// A plane of `value(y, x)`, on the threads of the current pool.
    pub fn by_pixels(
        size: (usize, usize),
        control: &Control,
        value: impl Fn(usize, usize) -> T + Sync,
    ) -> Result<Self> {
        Self::by_rows(size, control, |y, row: &mut [T]| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = value(y, x));
        })
    }
}

/// `count` default values; an error, not an abort, if memory runs out.
pub fn zeroed<T: Clone + Default>(count: usize) -> Result<Vec<T>> {
    let mut data = Vec::new();
    data.try_reserve_exact(count)
        .map_err(|_| Error::OutOfMemory { bytes: count.saturating_mul(size_of::<T>()) })?;

    data.resize(count, T::default());
    Ok(data)
}

/// Reserves capacity for `count` more values; an error, not an abort, if memory runs out.
pub fn reserve<T>(data: &mut Vec<T>, count: usize) -> Result<()> {
    let bytes = (data.len().saturating_add(count)).saturating_mul(size_of::<T>());
    data.try_reserve(count).map_err(|_| Error::OutOfMemory { bytes })
}

/// `COUNT` values of each row from column `first` on: taken from the row itself if it has all of them, else
/// copied to `buffer`, with `beyond(row, x)` at columns outside the row.
#[inline(always)]
pub fn parts<'a, T: Copy, const ROWS: usize, const COUNT: usize>(
    rows: [&'a [T]; ROWS],
    first: isize,
    buffer: &'a mut [[T; COUNT]; ROWS],
    beyond: impl Fn(&[T], isize) -> T,
) -> [&'a [T]; ROWS] {
    let mut parts = rows;
    for (part, buffer) in parts.iter_mut().zip(buffer) {
        let row = *part;

        // Values have to be copied only at the ends of a row.
        let inside = usize::try_from(first).ok().and_then(|first| row.get(first..first + COUNT));

        *part = if let Some(inside) = inside {
            inside
        } else {
            for (x, value) in (first..).zip(buffer.iter_mut()) {
                let inside = usize::try_from(x).ok().and_then(|x| row.get(x));
                *value = inside.copied().unwrap_or_else(|| beyond(row, x));
            }
            buffer
        };
    }

    parts
}

/// The places of `0..length` at most `reach` from some.
#[inline]
pub fn widened(places: &Range<usize>, reach: usize, length: usize) -> Range<usize> {
    places.start.saturating_sub(reach)..(places.end + reach).min(length)
}

/// The places of `0..length` at most `reach` from `place`.
#[inline]
pub fn around(place: usize, reach: usize, length: usize) -> Range<usize> {
    place.saturating_sub(reach)..(place + reach + 1).min(length)
}

/// Continues `0..length` by reflection, the edge repeated: `d c b a | a b c d | d c b a`.
#[inline]
pub fn reflect(index: isize, length: usize) -> usize {
    if let Some(inside) = usize::try_from(index).ok().filter(|inside| *inside < length) {
        return inside;
    }
    let length = length as isize;
    let folded = index.rem_euclid(2 * length);
    folded.min(2 * length - 1 - folded) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflection_repeats_the_edge() {
        let reached: Vec<_> = (-5..7).map(|i| reflect(i, 3)).collect();
        assert_eq!(reached, [1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0]);
        assert!((-9..9).all(|i| reflect(i, 1) == 0));
    }

    #[test]
    fn a_plane_refuses_the_wrong_number_of_values() {
        assert!(Plane::from_vec(2, 3, vec![0; 5]).is_err());
        assert!(Plane::from_vec(usize::MAX, 2, vec![0; 5]).is_err());
    }

    #[test]
    fn memory_that_cannot_be_had_is_an_error() {
        assert!(matches!(Plane::<u64>::new(1 << 40, 1 << 20), Err(Error::OutOfMemory { .. })));
        assert!(matches!(Plane::<u64>::new(usize::MAX, 2), Err(Error::OutOfMemory { .. })));
    }
}

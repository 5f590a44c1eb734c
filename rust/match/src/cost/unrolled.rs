//! Rows of the right image, reversed and clamped at both ends, so that candidates are neighboring values.

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::value::LANES;
use crate::pair::candidates::{Candidates, Searched};

/// Rows that are unrolled together.
const ROWS: usize = 32;

/// The layout of a row of the right image, reversed and clamped at both ends: column `x` meets candidate `k`
/// at place `cols - 1 - x + k`. Whole runs of [`LANES`] candidates can be read anywhere.
#[derive(Clone, Copy)]
pub struct Unrolled {
    /// Places of a row.
    pub width: usize,
    /// First places, which lie right of the image ...
    beyond: usize,
    /// ... and the columns, from the first one on, at the next places. The others lie left of it.
    seen: usize,
}

impl Unrolled {
    /// The layout for rows of `cols` columns.
    pub fn new(cols: usize, candidates: Candidates) -> Self {
        // The last run of candidates reads up to `LANES - 1` places beyond the last candidate.
        let width = cols + candidates.count().next_multiple_of(LANES) - 1;
        // Place 0 would show column `cols - 1 - min` if the image had no border.
        let beyond = (-candidates.min()).clamp(0, width as isize) as usize;
        let first = cols as isize - 1 - candidates.min();
        let seen = (first + 1 - beyond as isize).clamp(0, cols as isize) as usize;

        Self { width, beyond, seen }
    }

    /// Writes the unrolled row of pixel values.
    #[inline(always)]
    pub fn write<T: Copy, U: Clone>(&self, pixels: &[T], value: impl Fn(T) -> U, row: &mut [U]) {
        let (right, rest) = row.split_at_mut(self.beyond);
        let (within, left) = rest.split_at_mut(self.seen.min(self.width - self.beyond));

        right.fill(value(pixels[pixels.len() - 1]));
        within.iter_mut().zip(pixels[..self.seen].iter().rev()).for_each(|(out, pixel)| *out = value(*pixel));
        left.fill(value(pixels[0]));
    }
}

/// An unrolled right image.
#[derive(Debug)]
pub struct UnrolledPlane<T> {
    plane: Plane<T>,
    /// Columns of the image.
    cols: usize,
}

impl<T: Clone + Default + Send> UnrolledPlane<T> {
    /// Unrolls the pixel values of a plane.
    pub fn new<P: Copy + Sync>(
        plane: &Plane<P>,
        candidates: Candidates,
        value: impl Fn(P) -> T + Sync,
    ) -> Result<Self> {
        let cols = plane.cols();
        let unrolled = Unrolled::new(cols, candidates);

        let plane = Plane::by_bands((plane.rows(), unrolled.width), ROWS, |top, band| {
            for (y, row) in (top..).zip(band.chunks_exact_mut(unrolled.width)) {
                unrolled.write(plane.row(y), &value, row);
            }
            Ok(())
        })?;
        Ok(Self { plane, cols })
    }
}

impl<T> UnrolledPlane<T> {
    /// The values under `L` candidates of column `x` of row `y`.
    #[inline(always)]
    pub fn under<const L: usize>(&self, y: usize, x: usize, searched: Searched) -> &[T; L] {
        leading(&self.row(y)[self.cols - 1 - x + searched.start..])
    }

    /// Row `y`.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &[T] {
        self.plane.row(y)
    }

    /// All rows.
    pub fn plane(&self) -> &Plane<T> {
        &self.plane
    }

    /// Other values for the same places.
    pub fn like<U>(&self, plane: Plane<U>) -> UnrolledPlane<U> {
        UnrolledPlane { plane, cols: self.cols }
    }

    /// All rows.
    pub fn into_plane(self) -> Plane<T> {
        self.plane
    }
}

/// The first `L` values.
#[inline(always)]
pub fn leading<T, const L: usize>(values: &[T]) -> &[T; L] {
    &values.as_chunks().0[0]
}

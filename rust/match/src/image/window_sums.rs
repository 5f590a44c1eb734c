//! Sums over the square windows around pixels. The windows slide, so the cost does not depend on their size:
//!
//! ```text
//! column[y, x] = column[y - 1, x] + value[y + radius, x] - value[y - radius - 1, x]
//! sum[y, x]    = sum[y, x - 1] + column[y, x + radius] - column[y, x - radius - 1]
//!
//! columns = sums of the rows of the first window, except its last one
//! for each row y:
//!     columns += values[y + radius]
//!     sum = the columns of the first window, except its last one, added up
//!     for each x:
//!         sum += columns[x + radius]
//!         sum is that of the window around (y, x)
//!         sum -= columns[x - radius]
//!     columns -= values[y - radius]
//! ```
//!
//! Values are integers, so sums are exact, whatever bands of rows a plane is cut into.

use std::ops::{AddAssign, SubAssign};

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, TASK_ROWS, reflect, zeroed};
use crate::base::simd::{Level, Loop, whole};

/// Steps per 1 of values whose mean is taken.
const STEPS: f32 = (1 << 20) as f32;
/// Rows of a band of means. The sums of its first window are extra work.
const BAND: usize = 64;

/// The windows around the pixels of a plane.
#[derive(Debug, Clone, Copy)]
pub struct Windows {
    /// Rows and columns of the plane.
    pub size: (usize, usize),
    /// How far a window reaches to either side of its pixel.
    pub radius: usize,
    /// The contents of windows beyond the plane.
    pub beyond: Beyond,
}

/// The contents of windows beyond the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// Nothing: they end with it.
    Nothing,
    /// Its reflection, the edge repeated.
    Reflection,
}

impl Windows {
    /// Windows that end with the plane.
    pub fn new(size: (usize, usize), radius: usize) -> Self {
        Self { size, radius, beyond: Beyond::Nothing }
    }

    /// The plane of `result(y, x, sums)` at all pixels; the other arguments are as in [`Self::write`]. Both
    /// functions are copied into the loop over pixels, which keeps values they captured by copy in registers.
    pub fn plane<T, const N: usize, V, R>(
        self,
        values: impl Fn(usize) -> V + Copy + Sync,
        result: impl Fn(usize, usize, [T; N]) -> R + Copy + Sync,
        level: Level,
        control: &Control,
    ) -> Result<Plane<R>>
    where
        T: Copy + Default + AddAssign + SubAssign,
        V: Iterator<Item = [T; N]>,
        R: Clone + Default + Send,
    {
        Plane::by_bands(self.size, TASK_ROWS, |first, band| {
            control.checkpoint()?;
            self.write((first, band), values, result, level)
        })
    }

    /// Writes `result(y, x, sums)` for the pixels of a band that begins at row `first`. `values(y)` are the
    /// values of a row, one value for each sum at each pixel.
    pub fn write<T, const N: usize, V, R>(
        self,
        (first, band): (usize, &mut [R]),
        values: impl Fn(usize) -> V,
        result: impl Fn(usize, usize, [T; N]) -> R,
        level: Level,
    ) -> Result<()>
    where
        T: Copy + Default + AddAssign + SubAssign,
        V: Iterator<Item = [T; N]>,
    {
        let cols = self.size.1;
        let (columns, sums) = (zeroed(cols * N)?, zeroed(cols * N)?);
        level.run(WriteBand { windows: self, first, band, columns, sums, values, result });
        Ok(())
    }

    /// The number of pixels of the plane in the window around one.
    #[inline(always)]
    pub fn pixels(self, y: usize, x: usize) -> u32 {
        let reach = |place: usize, length: usize| {
            ((place + self.radius + 1).min(length) - place.saturating_sub(self.radius)) as u32
        };
        reach(y, self.size.0) * reach(x, self.size.1)
    }

    /// The same for neighbors in a row, from column `first` on; beyond the last column, that of the last one.
    #[inline(always)]
    pub fn pixels_along<const N: usize>(self, y: usize, first: usize) -> [u32; N] {
        let mut pixels = [0; N];
        for (x, pixels) in (first..).zip(&mut pixels) {
            *pixels = self.pixels(y, x.min(self.size.1 - 1));
        }
        pixels
    }

    /// Adds up the columns of every window of a row.
    #[inline(always)]
    fn add_along<T, const N: usize>(self, columns: &[[T; N]], sums: &mut [[T; N]])
    where
        T: Copy + Default + AddAssign + SubAssign,
    {
        let (reach, cols) = (self.radius as isize, columns.len());
        let column = |x: isize| self.place(x, cols).map(|x| columns[x]);

        let mut sum = [T::default(); N];
        for x in -reach..reach {
            if let Some(values) = column(x) {
                add(&mut sum, values);
            }
        }
        let slide = |sum: &mut [T; N], first: usize, sums: &mut [[T; N]]| {
            for (x, out) in (first as isize..).zip(sums) {
                if let Some(values) = column(x + reach) {
                    add(sum, values);
                }
                *out = *sum;
                if let Some(values) = column(x - reach) {
                    subtract(sum, values);
                }
            }
        };

        // Most windows lie within the row.
        let ends = if cols > 2 * self.radius { self.radius } else { cols };
        let (left, rest) = sums.split_at_mut(ends);
        let (inside, right) = rest.split_at_mut(rest.len().saturating_sub(ends));
        slide(&mut sum, 0, left);
        let outer = columns.iter().zip(columns.iter().skip(2 * self.radius));
        for (out, (first, last)) in inside.iter_mut().zip(outer) {
            add(&mut sum, *last);
            *out = sum;
            subtract(&mut sum, *first);
        }
        slide(&mut sum, cols - right.len(), right);
    }

    /// The place in the plane whose values count at this one, which may lie beyond it.
    #[inline(always)]
    fn place(self, place: isize, length: usize) -> Option<usize> {
        match usize::try_from(place) {
            Ok(inside) if inside < length => Some(inside),
            _ => (self.beyond == Beyond::Reflection).then(|| reflect(place, length)),
        }
    }
}

#[inline(always)]
fn add<T: AddAssign, const N: usize>(sums: &mut [T; N], values: [T; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

#[inline(always)]
fn subtract<T: SubAssign, const N: usize>(sums: &mut [T; N], values: [T; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum -= value);
}

/// Writes a band that begins at row `first`.
struct WriteBand<'a, T, R, F, G> {
    windows: Windows,
    first: usize,
    band: &'a mut [R],
    /// The sums of each column over the rows of the windows, and those over the windows of a row.
    columns: Vec<T>,
    sums: Vec<T>,
    values: F,
    result: G,
}

impl<T, const N: usize, V, R, F, G> Loop for WriteBand<'_, T, R, F, G>
where
    T: Copy + Default + AddAssign + SubAssign,
    V: Iterator<Item = [T; N]>,
    F: Fn(usize) -> V,
    G: Fn(usize, usize, [T; N]) -> R,
{
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { windows, first, band, mut columns, mut sums, values, result } = self;
        let (rows, cols) = windows.size;
        let columns: &mut [[T; N]] = columns.as_chunks_mut().0;
        let sums: &mut [[T; N]] = sums.as_chunks_mut().0;
        let row = |y: isize| windows.place(y, rows).map(&values);
        let reach = windows.radius as isize;

        let start = first as isize;
        for values in (start - reach..start + reach).filter_map(row) {
            columns.iter_mut().zip(values).for_each(|(sums, values)| add(sums, values));
        }
        for (y, out) in (first..).zip(band.chunks_exact_mut(cols)) {
            if let Some(values) = row(y as isize + reach) {
                columns.iter_mut().zip(values).for_each(|(sums, values)| add(sums, values));
            }
            // Each sum follows from the one before; their results are computed side by side.
            windows.add_along(columns, sums);
            for (x, (out, sums)) in out.iter_mut().zip(&*sums).enumerate() {
                *out = result(y, x, *sums);
            }
            if let Some(values) = row(y as isize - reach) {
                columns.iter_mut().zip(values).for_each(|(sums, values)| subtract(sums, values));
            }
        }
    }
}

/// The means of values from 0 to 1, rounded down to steps, over windows of a radius up to 31 that end with
/// the plane. `values(y)` are those of a row.
pub fn window_means<V: Iterator<Item = f32>>(
    size: (usize, usize),
    radius: usize,
    values: impl Fn(usize) -> V + Sync,
    level: Level,
) -> Result<Plane<f32>> {
    let windows = Windows::new(size, radius);
    // The sums of 63 x 63 of them fit.
    let steps = |y: usize| values(y).map(|value| [whole(value * STEPS) as u32]);

    Plane::by_bands(size, BAND, |first, band| {
        let mean = |y: usize, x: usize, [sum]: [u32; 1]| {
            (f64::from(sum) / f64::from(windows.pixels(y, x))) as f32 / STEPS
        };
        windows.write((first, band), steps, mean, level)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_equal_those_of_every_window_by_itself() {
        let (rows, cols) = (9_usize, 7_usize);
        let value = |y: usize, x: usize| [(y * 31 + x * 17) as i32 % 11 - 5, (y + x) as i32 % 3];
        let values = |y: usize| (0..cols).map(move |x| value(y, x));

        let naive = |windows: Windows, y: usize, x: usize| {
            let reach = windows.radius as isize;
            let mut sums = [0, 0];
            for v in y as isize - reach..=y as isize + reach {
                for u in x as isize - reach..=x as isize + reach {
                    let is_inside = (0..rows as isize).contains(&v) && (0..cols as isize).contains(&u);
                    if is_inside || windows.beyond == Beyond::Reflection {
                        let one = value(reflect(v, rows), reflect(u, cols));
                        sums = [sums[0] + one[0], sums[1] + one[1]];
                    }
                }
            }
            sums
        };

        for (radius, beyond) in [0, 1, 3, 12]
            .into_iter()
            .flat_map(|radius| [Beyond::Nothing, Beyond::Reflection].map(|beyond| (radius, beyond)))
        {
            let windows = Windows { size: (rows, cols), radius, beyond };
            for wanted in [0..rows, 0..1, 3..8] {
                let mut found = vec![[0, 0]; wanted.len() * cols];
                let place = (wanted.start, found.as_mut_slice());
                let best = Level::best();
                windows.write(place, values, |_, _, sums| sums, best).expect("enough memory");

                let all = wanted.flat_map(|y| (0..cols).map(move |x| (y, x)));
                let expected: Vec<_> = all.map(|(y, x)| naive(windows, y, x)).collect();
                assert_eq!(found, expected, "{windows:?}");
            }
        }
    }
}

//! Sums over the square windows around pixels. They slide, so they cost the same whatever the size of the windows:
//!
//! ```text
//! column[y, x] = column[y - 1, x] + value[y + radius, x] - value[y - radius - 1, x]
//! sum[y, x]    = sum[y, x - 1] + column[y, x + radius] - column[y, x - radius - 1]
//!
//! columns = values of the rows of the first window but its last one, added up
//! for each row y:
//!     columns += values[y + radius]
//!     sum = the columns of the first window but its last one, added up
//!     for each x:
//!         sum += columns[x + radius]
//!         sum is that of the window around (y, x)
//!         sum -= columns[x - radius]
//!     columns -= values[y - radius]
//! ```
//!
//! Both are the same loop, once over rows and once over columns. Values are integers, so that sums have no error, in
//! whatever bands of rows a plane is cut.

use std::ops::{AddAssign, Range, SubAssign};

use crate::error::Result;
use crate::image::plane::{Plane, reflect, zeroed};

/// Steps of a value of 1 whose mean is taken.
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
    /// What windows hold beyond the plane.
    pub beyond: Beyond,
}

/// What windows hold beyond the plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// Nothing: they end with it.
    Nothing,
    /// Its reflection, the edge repeated.
    Reflection,
}

/// What happens to the values of a place as a window slides on.
#[derive(Debug, Clone, Copy)]
enum Change {
    Enters,
    Leaves,
}

impl Windows {
    /// Writes `result(y, x, sums)` for the pixels of a band of rows that begins with row `first`. `values(y)` are the values
    /// of a row, of each pixel as many as there are sums.
    pub fn write<T, const N: usize, V, R>(
        self,
        (first, band): (usize, &mut [R]),
        values: impl Fn(usize) -> V,
        result: impl Fn(usize, usize, [T; N]) -> R,
    ) -> Result<()>
    where
        T: Copy + Default + AddAssign + SubAssign,
        V: Iterator<Item = [T; N]>,
    {
        let (rows, cols) = self.size;
        let band_rows = first..first + band.len() / cols;

        let change_row = |columns: &mut Vec<T>, y: usize, change: Change| {
            for (sums, values) in columns.as_chunks_mut().0.iter_mut().zip(values(y)) {
                change.apply(sums, values);
            }
        };

        self.slide(band_rows, rows, zeroed(cols * N)?, change_row, |y, columns| {
            let columns = columns.as_chunks().0;
            let out = &mut band[(y - first) * cols..][..cols];

            let change_column = |sums: &mut _, x: usize, change: Change| {
                change.apply(sums, columns[x]);
            };
            self.slide(0..cols, cols, [T::default(); N], change_column, |x, sums| {
                out[x] = result(y, x, *sums);
            });
        });

        Ok(())
    }

    /// The pixels of the plane that lie in the window around one.
    pub fn pixels(self, y: usize, x: usize) -> usize {
        let reach = |place: usize, length: usize| {
            (place + self.radius + 1).min(length) - place.saturating_sub(self.radius)
        };
        reach(y, self.size.0) * reach(x, self.size.1)
    }

    /// Slides a window over `places` of `0..length`: `change` adds to the sum what enters and takes off what leaves, and
    /// `take` sees the sum of each place.
    #[inline(always)]
    fn slide<S>(
        self,
        places: Range<usize>,
        length: usize,
        mut sum: S,
        change: impl Fn(&mut S, usize, Change),
        mut take: impl FnMut(usize, &S),
    ) {
        let radius = self.radius as isize;
        let first = places.start as isize;

        for place in first - radius..first + radius {
            if let Some(place) = self.place(place, length) {
                change(&mut sum, place, Change::Enters);
            }
        }

        for center in places {
            if let Some(place) = self.place(center as isize + radius, length) {
                change(&mut sum, place, Change::Enters);
            }
            take(center, &sum);
            if let Some(place) = self.place(center as isize - radius, length) {
                change(&mut sum, place, Change::Leaves);
            }
        }
    }

    /// The place of the plane whose values count at this one, which may lie beyond it.
    #[inline(always)]
    fn place(self, place: isize, length: usize) -> Option<usize> {
        match usize::try_from(place) {
            Ok(inside) if inside < length => Some(inside),
            _ => (self.beyond == Beyond::Reflection).then(|| reflect(place, length)),
        }
    }
}

impl Change {
    #[inline(always)]
    fn apply<T: AddAssign + SubAssign, const N: usize>(self, sums: &mut [T; N], values: [T; N]) {
        for (sum, value) in sums.iter_mut().zip(values) {
            match self {
                Self::Enters => *sum += value,
                Self::Leaves => *sum -= value,
            }
        }
    }
}

/// The means of values from 0 to 1, rounded down to steps, over windows that end with the plane. `values(y)` are those of
/// a row.
pub fn window_means<V: Iterator<Item = f32>>(
    size: (usize, usize),
    radius: usize,
    values: impl Fn(usize) -> V + Sync,
) -> Result<Plane<f32>> {
    let windows = Windows { size, radius, beyond: Beyond::Nothing };
    let steps = |y: usize| values(y).map(|value| [u64::from((value * STEPS) as u32)]);

    Plane::by_bands(size, BAND, |first, band| {
        windows.write((first, band), steps, |y, x, [sum]| {
            (sum as f64 / windows.pixels(y, x) as f64) as f32 / STEPS
        })
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
                    let is_inside =
                        (0..rows as isize).contains(&v) && (0..cols as isize).contains(&u);
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
                windows.write(place, values, |_, _, sums| sums).expect("enough memory");

                let all = wanted.flat_map(|y| (0..cols).map(move |x| (y, x)));
                let expected: Vec<_> = all.map(|(y, x)| naive(windows, y, x)).collect();
                assert_eq!(found, expected, "{windows:?}");
            }
        }
    }
}

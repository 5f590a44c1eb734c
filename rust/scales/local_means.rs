//! Means over square windows, as far as they lie within the plane, in exact arithmetic.
//!
//! Values from 0 to 1 become integers, so their sums are the same in any order. Each band of rows keeps the sums of the
//! columns of its window, adds the row that enters and takes off the row that leaves; along the row, a second running
//! sum does the same with columns.

use crate::error::Result;
use crate::image::plane::{Plane, zeroed};

/// Steps of a value of 1.
const STEPS: f32 = (1 << 20) as f32;
/// Rows of a band. The sums of its first window are extra work.
const BAND: usize = 64;

/// The mean of values from 0 to 1 over the squares that reach `radius` pixels to either side of each pixel.
/// `write` writes the values of a row.
pub fn local_means(
    (rows, cols): (usize, usize),
    radius: usize,
    write: impl Fn(usize, &mut [f32]) + Sync,
) -> Result<Plane<f32>> {
    Plane::by_bands((rows, cols), BAND, |first, band| {
        let mut values = zeroed(cols)?;
        let mut columns: Vec<u64> = zeroed(cols)?;
        let mut change = |columns: &mut [u64], y: usize, is_entering: bool| {
            write(y, &mut values);
            for (sum, value) in columns.iter_mut().zip(&values) {
                let steps = u64::from((value * STEPS) as u32);
                *sum = if is_entering { *sum + steps } else { *sum - steps };
            }
        };

        for y in first.saturating_sub(radius)..(first + radius).min(rows) {
            change(&mut columns, y, true);
        }

        for (y, means) in (first..).zip(band.chunks_mut(cols)) {
            if y + radius < rows {
                change(&mut columns, y + radius, true);
            }
            if y > radius && y > first {
                change(&mut columns, y - radius - 1, false);
            }

            let height = (y + radius + 1).min(rows) - y.saturating_sub(radius);
            write_means(&columns, height, radius, means);
        }

        Ok(())
    })
}

/// Writes the means of a row from the sums of columns of this height.
fn write_means(columns: &[u64], height: usize, radius: usize, means: &mut [f32]) {
    let cols = columns.len();
    let mut sum: u64 = columns[..radius.min(cols)].iter().sum();

    for (x, mean) in means.iter_mut().enumerate() {
        sum += columns.get(x + radius).copied().unwrap_or_default();
        if x > radius {
            sum -= columns[x - radius - 1];
        }

        let width = (x + radius + 1).min(cols) - x.saturating_sub(radius);
        *mean = (sum as f64 / (height * width) as f64) as f32 / STEPS;
    }
}

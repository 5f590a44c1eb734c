//! Small filters of gray images: stretching, reduction, Gaussians, gradients. Images continue by reflection.
//!
//! ```text
//! stretched   v -> 255 (v - low) / (high - low), clipped    # low, high: the percentiles 0.5 and 99.5
//! reduced     the mean over the area that a pixel of the smaller image covers
//! smoothed    along rows, then along columns: sum over k of weights[|k|] image[x + k]
//! gradients   Sobel: [-1 0 1] along one axis, [1 2 1] along the other, over 8
//! ```
//!
//! Sums have a fixed order, so the bits do not depend on threads or instructions.

use std::array::from_fn;

use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::{Plane, reflect, zeroed};
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::base::statistics::quantile;

/// Percentiles that become black and white: a few pixels at the ends may be mistakes.
const ENDS: [f64; 2] = [0.005, 0.995];
/// Every this many rows and columns, one is sampled for them.
const STRIDE: usize = 4;
/// A Gaussian is cut off at this many standard deviations.
const REACH: f64 = 3.0;
/// Values that are summed at once.
const LANES: usize = 64;

/// The image with its values stretched to 0 to 255. Non-finite values become black.
pub fn stretched(image: &Plane<f32>) -> Plane<f32> {
    let rows = (0..image.rows()).step_by(STRIDE);
    let mut values: Vec<f32> = rows.flat_map(|y| image.row(y).iter().step_by(STRIDE).copied()).collect();
    values.retain(|value| value.is_finite());
    let [Some(low), Some(high)] = ENDS.map(|share| quantile(&mut values, share)) else {
        return image.map(|_| 0.0);
    };

    let scale = 255.0 / (high - low).max(1e-6);
    image.map(|value| if *value > low { ((value - low) * scale).min(255.0) } else { 0.0 })
}

/// The image without the last rows and columns, so that the size is a multiple of a factor.
pub fn cropped(image: &Plane<f32>, factor: usize) -> Result<Plane<f32>> {
    let (rows, cols) = (image.rows() / factor * factor, image.cols() / factor * factor);
    let mut out = Plane::new(rows, cols)?;
    (0..rows).for_each(|y| out.row_mut(y).copy_from_slice(&image.row(y)[..cols]));
    Ok(out)
}

/// The image reduced to this many rows and columns.
pub fn reduced(image: &Plane<f32>, (rows, cols): (usize, usize)) -> Result<Plane<f32>> {
    if (rows, cols) == image.size() {
        return Ok(image.clone());
    }
    let (above, beside) = (shares(image.rows(), rows), shares(image.cols(), cols));
    let mut out = Plane::new(rows, cols)?;
    let mut mean = zeroed(image.cols())?;

    for (y, (first, weights)) in above.iter().enumerate() {
        mean.fill(0.0);
        for (weight, row) in weights.iter().zip(*first..) {
            add_weighted(&mut mean, *weight, image.row(row));
        }

        for (value, (first, weights)) in out.row_mut(y).iter_mut().zip(&beside) {
            let covered = &mean[*first..][..weights.len()];
            *value = covered.iter().zip(weights).fold(0.0, |sum, (value, weight)| sum + value * weight);
        }
    }

    Ok(out)
}

fn add_weighted(sums: &mut [f32], weight: f32, values: &[f32]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

/// For each of `to` pixels, the first of the `from` pixels that it covers, and their shares of it.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let step = from as f64 / to as f64;
    let share = |index: usize| {
        let (start, end) = (index as f64 * step, ((index + 1) as f64 * step).min(from as f64));
        let first = start.floor() as usize;
        let last = (end.ceil() as usize).clamp(first + 1, from);

        let part = |at: usize| end.min((at + 1) as f64) - start.max(at as f64);
        let all: f64 = (first..last).map(part).sum();
        (first, (first..last).map(|at| (part(at) / all) as f32).collect())
    };

    (0..to).map(share).collect()
}

/// A symmetric kernel along both axes, for images of several values side by side in each pixel.
pub struct Kernel {
    /// The weights of the middle and of one side.
    weights: Vec<f32>,
    channels: usize,
}

impl Kernel {
    /// A Gaussian of a standard deviation in pixels.
    pub fn gaussian(sigma: f64, channels: usize) -> Self {
        let radius = (REACH * sigma).ceil() as usize;
        let mut weights: Vec<f64> =
            (0..=radius).map(|k| math::exp(-0.5 * (k as f64 / sigma).powi(2))).collect();
        let all = 2.0 * weights.iter().sum::<f64>() - weights[0];
        for weight in &mut weights {
            *weight /= all;
        }
        Self { weights: weights.iter().map(|weight| *weight as f32).collect(), channels }
    }

    /// The sum over a square of this radius.
    pub fn sum(radius: usize) -> Self {
        Self { weights: vec![1.0; radius + 1], channels: 1 }
    }

    fn radius(&self) -> usize {
        self.weights.len() - 1
    }

    /// The rows that `write` writes, each under the kernel along it.
    pub fn along(
        &self,
        (rows, cols): (usize, usize),
        level: Level,
        write: impl Fn(usize, &mut [f32]),
    ) -> Result<Plane<f32>> {
        let (radius, channels) = (self.radius(), self.channels);
        let (margin, pixels) = (radius * channels, cols / channels);
        let mut along = Plane::new(rows, cols)?;
        let mut wide = zeroed(cols + 2 * margin)?;

        for y in 0..rows {
            write(y, &mut wide[margin..margin + cols]);
            for at in (-(radius as isize)..0).chain(pixels as isize..(pixels + radius) as isize) {
                let from = margin + reflect(at, pixels) * channels;
                let to = (margin as isize + at * channels as isize) as usize;
                wide.copy_within(from..from + channels, to);
            }
            let tap = |k: isize| &wide[((radius as isize + k) as usize) * channels..][..cols];
            let sides: Vec<_> = (1..=radius as isize).map(|k| [tap(-k), tap(k)]).collect();
            mix(level, &self.weights, tap(0), &sides, along.row_mut(y));
        }
        Ok(along)
    }

    /// Row `y`, under the kernel along columns, of an image already under the kernel along rows.
    pub fn down(&self, along: &Plane<f32>, y: usize, level: Level, out: &mut [f32]) {
        let tap = |k: isize| along.row(reflect(y as isize + k, along.rows()));
        let sides: Vec<_> = (1..=self.radius() as isize).map(|k| [tap(-k), tap(k)]).collect();
        mix(level, &self.weights, tap(0), &sides, out);
    }

    /// `N` values of that row, starting at `first`.
    #[inline(always)]
    pub fn down_at<const N: usize>(&self, along: &Plane<f32>, y: usize, first: usize) -> [f32; N] {
        let tap = |k: isize| &along.row(reflect(y as isize + k, along.rows()))[first..][..N];
        let mut out = from_fn(|at| self.weights[0] * tap(0)[at]);
        for (k, weight) in (1..).zip(&self.weights[1..]) {
            for (out, (one, other)) in out.iter_mut().zip(tap(-k).iter().zip(tap(k))) {
                *out += weight * (one + other);
            }
        }
        out
    }
}

/// The image under a Gaussian of a standard deviation in pixels.
pub fn smoothed(image: &Plane<f32>, sigma: f64, level: Level) -> Result<Plane<f32>> {
    let (size, kernel) = (image.size(), Kernel::gaussian(sigma, 1));
    let along = kernel.along(size, level, |y, out| out.copy_from_slice(image.row(y)))?;
    let mut out = Plane::new(size.0, size.1)?;
    for y in 0..size.0 {
        kernel.down(&along, y, level, out.row_mut(y));
    }
    Ok(out)
}

/// The weighted sum of a row and of pairs of rows to its sides.
#[leveled]
fn mix(level: Level, weights: &[f32], middle: &[f32], sides: &[[&[f32]; 2]], out: &mut [f32]) {
    let mut chunks = out.chunks_exact_mut(LANES);
    let mut first = 0;
    for out in &mut chunks {
        mix_from(first, weights, middle, sides, out);
        first += LANES;
    }
    mix_from(first, weights, middle, sides, chunks.into_remainder());
}

/// The same, starting at a value. With a known number of values, the sums stay in registers.
#[inline(always)]
fn mix_from(first: usize, weights: &[f32], middle: &[f32], sides: &[[&[f32]; 2]], out: &mut [f32]) {
    let count = out.len();
    let mut sums = [0.0; LANES];
    for (sum, middle) in sums.iter_mut().zip(&middle[first..][..count]) {
        *sum = weights[0] * middle;
    }
    for (weight, [one, other]) in weights[1..].iter().zip(sides) {
        let both = one[first..][..count].iter().zip(&other[first..][..count]);
        for (sum, (one, other)) in sums.iter_mut().zip(both) {
            *sum += weight * (one + other);
        }
    }
    out.copy_from_slice(&sums[..count]);
}

/// The gradients along rows and along columns; 0 at the borders.
pub fn gradients(image: &Plane<f32>, level: Level) -> Result<[Plane<f32>; 2]> {
    let (rows, cols) = image.size();
    let (mut along, mut down) = (Plane::new(rows, cols)?, Plane::new(rows, cols)?);

    for y in 1..rows.saturating_sub(1) {
        let three = [y - 1, y, y + 1].map(|y| image.row(y));
        write_gradients(level, three, along.row_mut(y), down.row_mut(y));
    }

    Ok([along, down])
}

/// The gradients of the middle one of three rows.
#[leveled]
fn write_gradients(level: Level, three: [&[f32]; 3], along: &mut [f32], down: &mut [f32]) {
    let cols = along.len();
    let [above, here, below] = three.map(|row| &row[..cols]);
    let down = &mut down[..cols];
    for x in 1..cols.saturating_sub(1) {
        let column = |x: usize| above[x] + 2.0 * here[x] + below[x];
        let row = |row: &[f32]| row[x - 1] + 2.0 * row[x] + row[x + 1];
        along[x] = (column(x + 1) - column(x - 1)) / 8.0;
        down[x] = (row(below) - row(above)) / 8.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(rows: usize, cols: usize) -> Plane<f32> {
        Plane::from_fn(rows, cols, |y, x| ((31 * y * y + 17 * x + 7 * x * y) % 251) as f32)
    }

    #[test]
    fn smoothing_is_a_sum_over_all_neighbors() {
        let (image, sigma) = (image(9, 14), 1.3);
        let found = smoothed(&image, sigma, Level::best()).expect("memory");

        let weight = |k: isize| math::exp(-0.5 * (k as f64 / sigma).powi(2));
        let all: f64 = (-4..=4).map(weight).sum();
        for (y, x) in (0..9).flat_map(|y| (0..14).map(move |x| (y, x))) {
            let mut sum = 0.0;
            for (j, i) in (-4..=4).flat_map(|j| (-4..=4).map(move |i| (j, i))) {
                let value = image.row(reflect(y as isize + j, 9))[reflect(x as isize + i, 14)];
                sum += weight(j) * weight(i) * f64::from(value) / (all * all);
            }
            assert!((f64::from(found.row(y)[x]) - sum).abs() < 1e-3, "{y} {x}");
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let image = image(20, 37);
        let all = Level::all().filter_map(|(_, level)| level);
        let all: Vec<_> = all.map(|level| smoothed(&image, 2.5, level).expect("memory")).collect();
        assert!(all.iter().all(|one| *one == all[0]));
    }

    #[test]
    fn a_smaller_image_has_the_means_of_areas() {
        let image = image(6, 10);
        let found = reduced(&image, (3, 4)).expect("memory");
        for (y, x) in (0..3).flat_map(|y| (0..4).map(move |x| (y, x))) {
            // Each pixel covers 2 rows and 2.5 columns.
            let start = 2.5 * x as f64;
            let share = |at: usize| {
                let at = at as f64;
                (at + 1.0).min(start + 2.5) - at.max(start)
            };
            let mut sum = 0.0;
            for (row, column) in (2 * y..2 * y + 2).flat_map(|row| (0..10).map(move |c| (row, c))) {
                sum += share(column).max(0.0) * f64::from(image.row(row)[column]) / 5.0;
            }
            assert!((f64::from(found.row(y)[x]) - sum).abs() < 1e-3, "{y} {x}");
        }
    }

    #[test]
    fn gray_values_are_stretched_and_nan_is_black() {
        let mut image = Plane::from_fn(40, 40, |y, _| 100.0 + y as f32);
        image.row_mut(8)[8] = f32::NAN;
        let found = stretched(&image);
        assert!(found.row(0)[0].abs() < 1e-6 && found.row(8)[8].abs() < 1e-6);
        assert!((found.row(39)[0] - 255.0).abs() < 1e-6);
        assert!(found.row(20)[5] > 120.0 && found.row(20)[5] < 150.0);
        assert!(stretched(&image.map(|_| f32::NAN)).as_slice().iter().all(|value| value.abs() < 1e-6));
    }
}

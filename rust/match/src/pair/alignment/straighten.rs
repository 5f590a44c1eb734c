//! The right image with its rows aligned to those of the left one: resampled along its columns.
//!
//! Pixel `(x, y)` becomes a weighted mean of the eight pixels of its column about `y + v(x, y)`, rounded to 1/64 of a
//! row. The weights are those of a Lanczos kernel. It keeps fine texture, where linear interpolation would blur it and
//! so make one image softer than the other (bad-1.0 of 12 scenes rotated by 1 degree: see `docs`). Rows beyond the
//! image repeat its first or last one.
//!
//! ```text
//! place = y + v(x, y);  row = floor(place);  weights = WEIGHTS[64 (place - row)]
//! out(x, y) = sum over k in 0..8 of weights[k] right(x, row - 3 + k)
//! ```
//!
//! Rows are resampled one by one. Fields change slowly, so a row is divided into runs of pixels with one offset, whose
//! eight source rows and weights are the same. Integer images are summed in integers, floats in double precision in a
//! fixed order.

use std::sync::OnceLock;

use ndarray::Array3;

use super::{Alignment, RowPolynomial};
use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::math;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, Loop};
use crate::base::value::nearest;
use crate::image::intensity::Gray;
use crate::image::intensity_range::IntensityRange;
use crate::image::view::{Image, View};

/// Number of pixels that a resampled one is a mean of.
pub const TAPS: usize = 8;
/// Steps between two rows to which offsets are rounded.
pub const STEPS: i32 = 64;
/// Weights are multiples of `2^-WEIGHT_BITS`.
pub const WEIGHT_BITS: u32 = 14;
/// The tap at the rounded-down row itself.
pub const CENTER: isize = TAPS as isize / 2 - 1;

/// The weights at every step; the eight of a step have the sum `2^WEIGHT_BITS`.
pub fn weights() -> &'static [[i32; TAPS]; STEPS as usize] {
    static WEIGHTS: OnceLock<[[i32; TAPS]; STEPS as usize]> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        let mut all = [[0; TAPS]; STEPS as usize];
        for (step, weights) in all.iter_mut().enumerate() {
            let exact: Vec<f64> = (0..TAPS).map(|tap| lanczos(tap, step)).collect();
            let scale = f64::from(1 << WEIGHT_BITS) / exact.iter().sum::<f64>();
            for (weight, exact) in weights.iter_mut().zip(exact) {
                *weight = (exact * scale).round() as i32;
            }

            // The nearest tap takes the rounding error.
            let nearest = if 2 * step <= STEPS as usize { CENTER } else { CENTER + 1 } as usize;
            weights[nearest] += (1 << WEIGHT_BITS) - weights.iter().sum::<i32>();
        }
        all
    })
}

/// The Lanczos kernel, `sinc(t) sinc(t / 4)`, at the distance of a tap from a step.
fn lanczos(tap: usize, step: usize) -> f64 {
    let sinc = |t: f64| if t == 0.0 { 1.0 } else { math::sin(t * PI) / (t * PI) };

    let distance = tap as f64 - CENTER as f64 - step as f64 / f64::from(STEPS);
    sinc(distance) * sinc(distance / (TAPS / 2) as f64)
}

const PI: f64 = std::f64::consts::PI;

/// The straightened right view. One with impulses becomes gray, and its impulses are repaired, since they would spread.
pub fn straightened(
    view: &View,
    alignment: &Alignment,
    level: Level,
    control: &Control,
) -> Result<View> {
    // Impulses and masked pixels must not spread over the taps.
    let whole;
    let view = if view.impulses > 0.0 {
        whole = without_impulses(view, level, control)?;
        &whole
    } else if view.mask.is_some() {
        whole = without_masked(view, control)?;
        &whole
    } else {
        view
    };

    let image = match &view.image {
        Image::U8(pixels) => Image::U8(resampled(pixels, alignment, level, control)?),
        Image::U16(pixels) => Image::U16(resampled(pixels, alignment, level, control)?),
        Image::F32(pixels) => Image::F32(resampled(pixels, alignment, level, control)?),
        Image::F64(pixels) => Image::F64(resampled(pixels, alignment, level, control)?),
    };

    let mask = view.mask.as_ref();
    let mask = mask.map(|mask| straightened_mask(mask, alignment, level, control));
    Ok(View { image, mask: mask.transpose()?, impulses: 0.0, ..*view })
}

/// The mask of the straightened view: a pixel is valid if the one nearest to its place is.
fn straightened_mask(
    mask: &Plane<bool>,
    alignment: &Alignment,
    level: Level,
    control: &Control,
) -> Result<Plane<bool>> {
    let last = mask.rows() as isize - 1;
    Plane::by_bands((mask.rows(), mask.cols()), 1, |y, out| {
        control.checkpoint()?;
        let offsets = offsets(alignment, y, out.len(), level)?;

        for (x, valid) in out.iter_mut().enumerate() {
            let nearest = y as isize + (offsets[x] + STEPS / 2).div_euclid(STEPS) as isize;
            *valid = mask.row(nearest.clamp(0, last) as usize)[x];
        }

        Ok(())
    })
}

/// The offsets of the pixels of row `y`: steps below the row itself.
fn offsets(alignment: &Alignment, y: usize, cols: usize, level: Level) -> Result<Vec<i32>> {
    let mut offsets = zeroed(cols)?;
    level.run(WriteOffsets { along: alignment.along(y as f64), offsets: &mut offsets });
    Ok(offsets)
}

/// Computes the offsets of a row.
struct WriteOffsets<'a> {
    along: RowPolynomial,
    offsets: &'a mut [i32],
}

impl Loop for WriteOffsets<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (x, offset) in (0i32..).zip(self.offsets) {
            *offset = nearest(self.along.at(f64::from(x)) * f64::from(STEPS));
        }
    }
}

/// A pixel that can be resampled.
trait ResampledPixel: Copy + Default + Send + Sync {
    /// Writes the weighted means of the pixels of eight rows.
    fn write_means(rows: &[&[Self]; TAPS], weights: &[i32; TAPS], out: &mut [Self]);
}

macro_rules! integer_pixel {
    ($pixel:ty) => {
        impl ResampledPixel for $pixel {
            #[inline(always)]
            fn write_means(rows: &[&[Self]; TAPS], weights: &[i32; TAPS], out: &mut [Self]) {
                let rows = rows.map(|row| &row[..out.len()]);
                for (at, out) in out.iter_mut().enumerate() {
                    let mut sum = 1 << (WEIGHT_BITS - 1);
                    for tap in 0..TAPS {
                        sum += weights[tap] * i32::from(rows[tap][at]);
                    }
                    *out = (sum >> WEIGHT_BITS).clamp(0, <$pixel>::MAX.into()) as $pixel;
                }
            }
        }
    };
}

macro_rules! float_pixel {
    ($pixel:ty) => {
        impl ResampledPixel for $pixel {
            #[inline(always)]
            fn write_means(rows: &[&[Self]; TAPS], weights: &[i32; TAPS], out: &mut [Self]) {
                let rows = rows.map(|row| &row[..out.len()]);
                for (at, out) in out.iter_mut().enumerate() {
                    let mut sum = 0.0;
                    for tap in 0..TAPS {
                        sum += f64::from(weights[tap]) * f64::from(rows[tap][at]);
                    }
                    *out = (sum / f64::from(1 << WEIGHT_BITS)) as $pixel;
                }
            }
        }
    };
}

integer_pixel!(u8);
integer_pixel!(u16);
float_pixel!(f32);
float_pixel!(f64);

fn resampled<T: ResampledPixel>(
    pixels: &Array3<T>,
    alignment: &Alignment,
    level: Level,
    control: &Control,
) -> Result<Array3<T>> {
    let (rows, cols, channels) = pixels.dim();
    let pixels = pixels.as_standard_layout();
    let source = pixels.as_slice().unwrap_or_default();

    let out = Plane::by_bands((rows, cols * channels), 1, |y, out: &mut [T]| {
        control.checkpoint()?;
        let offsets = &offsets(alignment, y, cols, level)?;
        level.run(Resample { source, rows, channels, y, offsets, out });
        Ok(())
    })?;

    // The plane has as many values as the shape says.
    Ok(Array3::from_shape_vec((rows, cols, channels), out.into_vec()).unwrap_or_default())
}

/// One row of the resampled image.
struct Resample<'a, T> {
    /// All rows of the image.
    source: &'a [T],
    rows: usize,
    channels: usize,
    y: usize,
    offsets: &'a [i32],
    out: &'a mut [T],
}

impl<T: ResampledPixel> Loop for Resample<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { source, rows, channels, y, offsets, out } = self;
        let weights = weights();
        let (width, last) = (out.len(), rows as isize - 1);

        let mut end = 0;
        // Each run is a weighted sum of eight contiguous pieces of rows, which the compiler vectorizes.
        for run in offsets.chunk_by(|a, b| a == b) {
            let start = end;
            end += run.len() * channels;

            let above = y as isize + run[0].div_euclid(STEPS) as isize;
            let mut taps = [&[][..]; TAPS];
            for (tap, pixels) in (0..).zip(&mut taps) {
                let row = (above - CENTER + tap).clamp(0, last) as usize;
                *pixels = &source[row * width..][start..end];
            }

            T::write_means(
                &taps,
                &weights[run[0].rem_euclid(STEPS) as usize],
                &mut out[start..end],
            );
        }
    }
}

/// The gray values of a view, with impulses repaired and masked pixels filled, in the unit of its image.
fn without_impulses(view: &View, level: Level, control: &Control) -> Result<View> {
    let gray = Gray::new(view, level, control)?;

    let unit = gray.steps(view.unit);
    let (rows, cols) = gray.size();

    let plane = gray.plane(level, control)?;
    let values = plane.map(|value| f64::from(*value) / unit).into_vec();

    let pixels = Array3::from_shape_vec((rows, cols, 1), values).unwrap_or_default();

    // Ranges are in thousandths of the unit.
    let range = Some(IntensityRange::about_zero(1000.0 * f64::from(gray.reach()) / unit));

    let image = Image::F64(pixels);
    Ok(View { image, mask: view.mask.clone(), range, impulses: 0.0, unit: view.unit })
}

/// The view with masked pixels, which may be NaN, replaced by the nearest valid ones of their column within the taps,
/// or else by zero.
pub fn without_masked(view: &View, control: &Control) -> Result<View> {
    let Some(mask) = &view.mask else {
        return Ok(view.clone());
    };

    let image = match &view.image {
        Image::U8(pixels) => Image::U8(filled(pixels, mask, control)?),
        Image::U16(pixels) => Image::U16(filled(pixels, mask, control)?),
        Image::F32(pixels) => Image::F32(filled(pixels, mask, control)?),
        Image::F64(pixels) => Image::F64(filled(pixels, mask, control)?),
    };

    Ok(View { image, mask: Some(mask.clone()), impulses: 0.0, ..*view })
}

fn filled<T: ResampledPixel>(
    pixels: &Array3<T>,
    mask: &Plane<bool>,
    control: &Control,
) -> Result<Array3<T>> {
    let (rows, cols, channels) = pixels.dim();
    let mut values = zeroed(rows * cols * channels)?;

    for y in 0..rows {
        control.checkpoint()?;
        for x in 0..cols {
            // The row itself, then those above and below it, nearest first.
            let near = (0..TAPS).flat_map(|by| [y.checked_sub(by), Some(y + by)]).flatten();
            let Some(from) = near.filter(|row| *row < rows).find(|row| mask.row(*row)[x]) else {
                continue;
            };

            for c in 0..channels {
                values[(y * cols + x) * channels + c] = pixels[(from, x, c)];
            }
        }
    }
    Ok(Array3::from_shape_vec((rows, cols, channels), values).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(coefficients: &[f64], size: (usize, usize)) -> Alignment {
        let mut all = [0.0; super::super::TERMS];
        all[..coefficients.len()].copy_from_slice(coefficients);
        Alignment::new(all, size).expect("legal")
    }

    fn view(rows: usize, cols: usize, value: impl Fn(usize, usize) -> f64) -> View {
        let pixels = Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| value(y, x));
        View::from(Image::F64(pixels))
    }

    fn values(view: &View) -> &Array3<f64> {
        match &view.image {
            Image::F64(pixels) => pixels,
            _ => unreachable!("made of doubles"),
        }
    }

    #[test]
    fn weights_are_symmetric_and_of_one_sum() {
        for (step, weights) in weights().iter().enumerate() {
            assert_eq!(weights.iter().sum::<i32>(), 1 << WEIGHT_BITS);
            if step > 0 {
                let mirrored = &super::weights()[STEPS as usize - step];
                assert!((0..TAPS).all(|tap| (weights[tap] - mirrored[TAPS - 1 - tap]).abs() <= 4));
            }
        }
    }

    #[test]
    fn whole_offsets_copy_rows() {
        let image = view(20, 5, |y, x| ((31 * y + 17 * x) % 23) as f64);
        let found =
            straightened(&image, &field(&[3.0], (20, 5)), Level::best(), &Control::default());

        let found = found.expect("memory");

        for (y, x) in (0..20).flat_map(|y| (0..5).map(move |x| (y, x))) {
            let moved = values(&image)[((y + 3).min(19), x, 0)];
            assert!((values(&found)[(y, x, 0)] - moved).abs() < 1e-12);
        }
    }

    #[test]
    fn a_smooth_image_is_what_it_is_between_its_rows() {
        let wave = |y: f64, x: f64| math::sin(0.5 * y + 0.1 * x);
        let image = view(60, 40, |y, x| wave(y as f64, x as f64));
        let field = field(&[0.4, 1.5, -0.7], (60, 40));

        let found =
            straightened(&image, &field, Level::best(), &Control::default()).expect("memory");

        for (y, x) in (10..50).flat_map(|y| (0..40).map(move |x| (y, x))) {
            let exact = wave(y as f64 + field.at(x as f64, y as f64), x as f64);
            assert!((values(&found)[(y, x, 0)] - exact).abs() < 0.01, "{y} {x}");
        }
    }

    #[test]
    fn masked_pixels_do_not_spread() {
        let mut image = view(30, 4, |y, _| y as f64);
        let masked = Plane::from_fn(30, 4, |y, x| !(x == 2 && (10..14).contains(&y)));
        if let Image::F64(pixels) = &mut image.image {
            (10..14).for_each(|y| pixels[(y, 2, 0)] = f64::NAN);
        }
        image.mask = Some(masked);

        let found =
            straightened(&image, &field(&[0.5], (30, 4)), Level::best(), &Control::default());
        let found = found.expect("memory");
        assert!(values(&found).iter().all(|value| value.is_finite()));

        let mask = found.mask.expect("there is one");
        for y in 0..30 {
            assert_eq!(mask.row(y)[2], !(9..13).contains(&y), "{y}");
            assert!(mask.row(y)[1]);
        }
    }
}

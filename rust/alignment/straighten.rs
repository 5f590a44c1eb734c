//! The right image with its rows where the left one has them: resampled along its columns.
//!
//! Pixel `(x, y)` becomes a weighted mean of the eight pixels of its column about `y + v(x, y)`, rounded to a
//! sixty-fourth of a row: the weights are those of Lanczos' kernel, which keeps fine texture where linear interpolation
//! would blur it and so make one image softer than the other (bad-1.0 of 12 scenes turned by 1 degree: see `docs`).
//! Rows beyond the image repeat its first or last one.
//!
//! ```text
//! place = y + v(x, y);  row = floor(place);  weights = WEIGHTS[64 (place - row)]
//! out(x, y) = sum over k in 0..8 of weights[k] right(x, row - 3 + k)
//! ```
//!
//! Rows are worked out one by one. Along a row the eight source rows change only where `place` passes a whole number, so
//! it is cut into runs with the same eight. Integer images are summed in integers, floats in double precision in a fixed
//! order.

use std::sync::OnceLock;

use ndarray::Array3;

use super::Alignment;
use crate::control::Control;
use crate::error::Result;
use crate::intensity::{Gray, Range};
use crate::plane::{Plane, zeroed};
use crate::simd::Level;
use crate::view::{Image, View};

/// Pixels that a resampled one is a mean of.
pub const TAPS: usize = 8;
/// Places between two rows.
const STEPS: usize = 64;
/// Weights are multiples of `2^-WEIGHT_BITS`.
const WEIGHT_BITS: u32 = 14;
/// The tap at the place itself.
const CENTER: isize = TAPS as isize / 2 - 1;

/// Where the pixels of a row come from: the row above each place, and the step from it.
struct Places {
    rows: Vec<isize>,
    steps: Vec<u8>,
}

/// The weights at every step; each eight have the sum `2^WEIGHT_BITS`.
fn weights() -> &'static [[i32; TAPS]; STEPS] {
    static WEIGHTS: OnceLock<[[i32; TAPS]; STEPS]> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        let mut all = [[0; TAPS]; STEPS];
        for (step, weights) in all.iter_mut().enumerate() {
            let exact: Vec<f64> = (0..TAPS).map(|tap| lanczos(tap, step)).collect();
            let scale = f64::from(1 << WEIGHT_BITS) / exact.iter().sum::<f64>();
            for (weight, exact) in weights.iter_mut().zip(exact) {
                *weight = (exact * scale).round() as i32;
            }
            // What rounding leaves goes to the tap that is nearest.
            let nearest = if 2 * step <= STEPS { CENTER } else { CENTER + 1 } as usize;
            weights[nearest] += (1 << WEIGHT_BITS) - weights.iter().sum::<i32>();
        }
        all
    })
}

/// Lanczos' kernel, `sinc(t) sinc(t / 4)`, at the distance of a tap from a step.
fn lanczos(tap: usize, step: usize) -> f64 {
    let sinc = |t: f64| if t == 0.0 { 1.0 } else { (t * PI).sin() / (t * PI) };
    let distance = tap as f64 - CENTER as f64 - step as f64 / STEPS as f64;
    sinc(distance) * sinc(distance / (TAPS / 2) as f64)
}

const PI: f64 = std::f64::consts::PI;

/// The straightened right view; one with impulses comes out gray and without them, or they would spread.
pub fn straightened(
    view: &View,
    alignment: &Alignment,
    level: Level,
    control: &Control,
) -> Result<View> {
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
        Image::U8(pixels) => Image::U8(resampled(pixels, alignment, control)?),
        Image::U16(pixels) => Image::U16(resampled(pixels, alignment, control)?),
        Image::F32(pixels) => Image::F32(resampled(pixels, alignment, control)?),
        Image::F64(pixels) => Image::F64(resampled(pixels, alignment, control)?),
    };
    let mask = view.mask.as_ref().map(|mask| straightened_mask(mask, alignment, control));
    Ok(View { image, mask: mask.transpose()?, range: view.range, impulses: 0.0 })
}

/// A pixel is valid if the one that is nearest to its place is.
fn straightened_mask(
    mask: &Plane<bool>,
    alignment: &Alignment,
    control: &Control,
) -> Result<Plane<bool>> {
    let last = mask.rows() as isize - 1;
    Plane::by_rows((mask.rows(), mask.cols()), control, |y, out| {
        let Places { rows, steps } = places(alignment, y, out.len());
        for (x, valid) in out.iter_mut().enumerate() {
            let nearest = rows[x] + isize::from(usize::from(steps[x]) >= STEPS / 2);
            *valid = mask.row(nearest.clamp(0, last) as usize)[x];
        }
    })
}

/// Where the pixels of row `y` come from.
fn places(alignment: &Alignment, y: usize, cols: usize) -> Places {
    let along = alignment.along(y as f64);
    let exact = |x: usize| floored(along.at(x as f64) * STEPS as f64 + 0.5);
    let offsets: Vec<isize> = (0..cols).map(exact).collect();
    let rows = offsets.iter().map(|offset| y as isize + offset.div_euclid(STEPS as isize));
    let steps = offsets.iter().map(|offset| offset.rem_euclid(STEPS as isize) as u8);
    Places { rows: rows.collect(), steps: steps.collect() }
}

/// The largest integer that is not above a number, without a call of the platform's library for each pixel.
#[inline(always)]
pub fn floored(value: f64) -> isize {
    let whole = value as isize;
    whole - isize::from(whole as f64 > value)
}

/// A pixel that can be resampled.
trait Sample: Copy + Default + Send + Sync {
    /// The weighted mean of the pixels of `rows` at one place, whose weights are those of a step.
    fn mean(rows: &[&[Self]; TAPS], at: usize, weights: &[i32; TAPS]) -> Self;
}

macro_rules! integer_sample {
    ($pixel:ty) => {
        impl Sample for $pixel {
            #[inline(always)]
            fn mean(rows: &[&[Self]; TAPS], at: usize, weights: &[i32; TAPS]) -> Self {
                let mut sum = 1 << (WEIGHT_BITS - 1);
                for tap in 0..TAPS {
                    sum += weights[tap] * i32::from(rows[tap][at]);
                }
                (sum >> WEIGHT_BITS).clamp(0, <$pixel>::MAX.into()) as $pixel
            }
        }
    };
}

macro_rules! float_sample {
    ($pixel:ty) => {
        impl Sample for $pixel {
            #[inline(always)]
            fn mean(rows: &[&[Self]; TAPS], at: usize, weights: &[i32; TAPS]) -> Self {
                let mut sum = 0.0;
                for tap in 0..TAPS {
                    sum += f64::from(weights[tap]) * f64::from(rows[tap][at]);
                }
                (sum / f64::from(1 << WEIGHT_BITS)) as $pixel
            }
        }
    };
}

integer_sample!(u8);
integer_sample!(u16);
float_sample!(f32);
float_sample!(f64);

fn resampled<T: Sample>(
    pixels: &Array3<T>,
    alignment: &Alignment,
    control: &Control,
) -> Result<Array3<T>> {
    let (rows, cols, channels) = pixels.dim();
    let pixels = pixels.as_standard_layout();
    let source = pixels.as_slice().unwrap_or_default();
    let width = cols * channels;
    let out = Plane::by_rows((rows, width), control, |y, out: &mut [T]| {
        let places = places(alignment, y, cols);
        let mut start = 0;
        for run in places.rows.chunk_by(|a, b| a == b) {
            let steps = &places.steps[start..start + run.len()];
            let row = |tap: usize| {
                let row = (run[0] - CENTER + tap as isize).clamp(0, rows as isize - 1) as usize;
                &source[row * width + start * channels..][..run.len() * channels]
            };
            let taps = [row(0), row(1), row(2), row(3), row(4), row(5), row(6), row(7)];
            let out = &mut out[start * channels..][..run.len() * channels];
            for (x, step) in steps.iter().enumerate() {
                let weights = &weights()[usize::from(*step)];
                let pixel = &mut out[x * channels..(x + 1) * channels];
                for (channel, value) in pixel.iter_mut().enumerate() {
                    *value = T::mean(&taps, x * channels + channel, weights);
                }
            }
            start += run.len();
        }
    })?;
    // The plane has as many values as the shape says.
    Ok(Array3::from_shape_vec((rows, cols, channels), out.into_vec()).unwrap_or_default())
}

/// The gray values of a view, impulses repaired and masked pixels filled, in the unit of its pixels.
fn without_impulses(view: &View, level: Level, control: &Control) -> Result<View> {
    let gray = Gray::new(view, level, control)?;
    let ((rows, cols), unit) = (gray.size(), gray.steps(1.0));
    let plane = gray.plane(level, control)?;
    let values = plane.map(|value| f64::from(*value) / unit).into_vec();
    let pixels = Array3::from_shape_vec((rows, cols, 1), values).unwrap_or_default();
    // In thousandths.
    let white = 1000.0 * f64::from(gray.reach()) / unit;
    let range = Some(Range { black: -white, white });
    Ok(View { image: Image::F64(pixels), mask: view.mask.clone(), range, impulses: 0.0 })
}

/// The view with masked pixels, which may be NaN, replaced by the nearest valid ones of their column within the reach of
/// the taps, or else by zero.
fn without_masked(view: &View, control: &Control) -> Result<View> {
    let Some(mask) = &view.mask else { return Ok(view.clone()) };
    let image = match &view.image {
        Image::U8(pixels) => Image::U8(filled(pixels, mask, control)?),
        Image::U16(pixels) => Image::U16(filled(pixels, mask, control)?),
        Image::F32(pixels) => Image::F32(filled(pixels, mask, control)?),
        Image::F64(pixels) => Image::F64(filled(pixels, mask, control)?),
    };
    Ok(View { image, mask: Some(mask.clone()), range: view.range, impulses: 0.0 })
}

fn filled<T: Sample>(
    pixels: &Array3<T>,
    mask: &Plane<bool>,
    control: &Control,
) -> Result<Array3<T>> {
    let (rows, cols, channels) = pixels.dim();
    let mut values = zeroed(rows * cols * channels)?;
    for y in 0..rows {
        control.checkpoint()?;
        for x in 0..cols {
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
        View { image: Image::F64(pixels), mask: None, range: None, impulses: 0.0 }
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
                let mirrored = &super::weights()[STEPS - step];
                assert!((0..TAPS).all(|tap| (weights[tap] - mirrored[TAPS - 1 - tap]).abs() <= 4));
            }
        }
    }

    #[test]
    fn whole_rows_move_as_they_are() {
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
        let wave = |y: f64, x: f64| (0.5 * y + 0.1 * x).sin();
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
    fn what_is_masked_spreads_nothing() {
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

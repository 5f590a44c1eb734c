//! The right image with its rows aligned to those of the left one: resampled along its columns.
//!
//! Pixel `(x, y)` becomes a weighted mean of the eight pixels of its column around `y + v(x, y)`, rounded to
//! 1/64 of a row ([`crate::image::resampling`]). Rows beyond the image repeat its first or last one. A pixel
//! whose place is nearest to such a row is masked: the right image does not show it.
//!
//! ```text
//! place = y + v(x, y);  row = floor(place);  weights = WEIGHTS[64 (place - row)]
//! out(x, y) = sum over k in 0..8 of weights[k] right(x, row - 3 + k)
//! ```
//!
//! Rows are resampled one by one. Fields change slowly, so a row is divided into runs of pixels with equal
//! offsets, which share their eight source rows and weights.

use std::ops::{AddAssign, Mul, Shr};

use super::{Alignment, RowPolynomial};
use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, leveled};
use crate::base::value::nearest;
use crate::image::resampling::{CENTER, STEPS, TAPS, WEIGHT_BITS, weights};
use crate::image::view::View;

/// The straightened right view.
pub fn straightened(view: &View, alignment: &Alignment, level: Level, control: &Control) -> Result<View> {
    // Masked pixels must not spread over the taps.
    let source = view.filled_along_columns(TAPS);
    let (rows, cols) = view.size();
    let ends = view.scale().ends();
    // The sum of the weights' magnitudes is below 2.
    let is_small = u64::from(view.scale().reach()) << (WEIGHT_BITS + 1) <= 1 << 30;

    let gray = Plane::by_bands((rows, cols), 1, |y, out: &mut [i32]| {
        control.checkpoint()?;
        let source = Source { pixels: &source, rows, is_small, ends };
        resample(level, source, y, &offsets(alignment, y, cols, level)?, out);
        Ok(())
    })?;

    let mask = straightened_mask(view, alignment, level, control)?;
    Ok(View::new(gray, Some(mask), view.scale()))
}

/// The mask of the straightened view: a pixel is valid if the one nearest to its place is in the image, and
/// valid.
fn straightened_mask(
    view: &View,
    alignment: &Alignment,
    level: Level,
    control: &Control,
) -> Result<Plane<bool>> {
    let (rows, cols) = view.size();
    let reach = alignment.bound().ceil() as usize;
    Plane::by_bands((rows, cols), 1, |y, out| {
        control.checkpoint()?;
        if view.mask().is_none() && y >= reach && y + reach < rows {
            out.fill(true);
            return Ok(());
        }
        let offsets = offsets(alignment, y, out.len(), level)?;

        for (x, valid) in out.iter_mut().enumerate() {
            let nearest = y as isize + (offsets[x] + STEPS / 2).div_euclid(STEPS) as isize;
            *valid = (0..rows as isize).contains(&nearest) && view.is_valid(nearest as usize, x);
        }

        Ok(())
    })
}

/// The offsets of the pixels of row `y`: steps below the row itself.
fn offsets(alignment: &Alignment, y: usize, cols: usize, level: Level) -> Result<Vec<i32>> {
    let mut offsets = zeroed(cols)?;
    write_offsets(level, alignment.along(y as f64), &mut offsets);
    Ok(offsets)
}

/// Computes the offsets of a row.
#[leveled]
fn write_offsets(level: Level, along: RowPolynomial, offsets: &mut [i32]) {
    for (x, offset) in (0i32..).zip(offsets) {
        *offset = nearest(along.at(f64::from(x)) * f64::from(STEPS));
    }
}

/// The image that is resampled.
#[derive(Clone, Copy)]
struct Source<'a> {
    /// All of its rows.
    pixels: &'a [i32],
    rows: usize,
    /// Whether sums of weighted pixels fit 32 bits.
    is_small: bool,
    /// Least and largest value.
    ends: [i32; 2],
}

/// One row of the resampled image.
#[leveled]
fn resample(level: Level, source: Source<'_>, y: usize, offsets: &[i32], out: &mut [i32]) {
    let weights = weights();
    let (width, last) = (out.len(), source.rows as isize - 1);

    let mut end = 0;
    // Each run is a weighted sum of eight contiguous pieces of rows, which the compiler vectorizes.
    for run in offsets.chunk_by(|a, b| a == b) {
        let start = end;
        end += run.len();

        let above = y as isize + run[0].div_euclid(STEPS) as isize;
        let mut taps = [&[][..]; TAPS];
        for (tap, pixels) in (0..).zip(&mut taps) {
            let row = (above - CENTER + tap).clamp(0, last) as usize;
            *pixels = &source.pixels[row * width..][start..end];
        }

        let weights = &weights[run[0].rem_euclid(STEPS) as usize];
        let out = &mut out[start..end];
        if source.is_small {
            write_means::<i32>(&taps, weights, source.ends, out);
        } else {
            write_means::<i64>(&taps, weights, source.ends, out);
        }
    }
}

/// Writes the weighted means of the pixels of eight rows, by sums of this type.
#[inline(always)]
fn write_means<T>(rows: &[&[i32]; TAPS], weights: &[i32; TAPS], ends: [i32; 2], out: &mut [i32])
where
    T: Copy + Ord + From<i32> + Into<i64> + AddAssign + Mul<Output = T> + Shr<u32, Output = T>,
{
    let rows = rows.map(|row| &row[..out.len()]);
    let [least, largest] = ends.map(T::from);
    for (at, out) in out.iter_mut().enumerate() {
        let mut sum = T::from(1 << (WEIGHT_BITS - 1));
        for tap in 0..TAPS {
            sum += T::from(weights[tap]) * T::from(rows[tap][at]);
        }
        *out = (sum >> WEIGHT_BITS).clamp(least, largest).into() as i32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math;
    use crate::image::gray_scale::GrayScale;

    fn field(coefficients: &[f64], size: (usize, usize)) -> Alignment {
        let mut all = [0.0; super::super::TERMS];
        all[..coefficients.len()].copy_from_slice(coefficients);
        Alignment::new(all, size).expect("legal")
    }

    /// Values in steps of a millionth.
    fn view(
        (rows, cols): (usize, usize),
        mask: Option<Plane<bool>>,
        value: impl Fn(usize, usize) -> f64,
    ) -> View {
        let gray = Plane::from_fn(rows, cols, |y, x| (1e6 * value(y, x)) as i32);
        View::new(gray, mask, GrayScale::of_steps(30_000_000))
    }

    fn value(view: &View, y: usize, x: usize) -> f64 {
        f64::from(view.gray().row(y)[x]) / 1e6
    }

    #[test]
    fn whole_offsets_copy_rows() {
        let image = view((20, 5), None, |y, x| ((31 * y + 17 * x) % 23) as f64);
        let found = straightened(&image, &field(&[3.0], (20, 5)), Level::best(), &Control::default());

        let found = found.expect("memory");

        for (y, x) in (0..20).flat_map(|y| (0..5).map(move |x| (y, x))) {
            let moved = value(&image, (y + 3).min(19), x);
            assert!((value(&found, y, x) - moved).abs() < 1e-12);
            assert_eq!(found.is_valid(y, x), y + 3 < 20, "what lies beyond the image is masked");
        }
    }

    #[test]
    fn a_smooth_image_is_what_it_is_between_its_rows() {
        let wave = |y: f64, x: f64| math::sin(0.5 * y + 0.1 * x);
        let image = view((60, 40), None, |y, x| wave(y as f64, x as f64));
        let field = field(&[0.4, 1.5, -0.7], (60, 40));

        let found = straightened(&image, &field, Level::best(), &Control::default()).expect("memory");

        for (y, x) in (10..50).flat_map(|y| (0..40).map(move |x| (y, x))) {
            let exact = wave(y as f64 + field.at(x as f64, y as f64), x as f64);
            assert!((value(&found, y, x) - exact).abs() < 0.01, "{y} {x}");
        }
    }

    #[test]
    fn masked_pixels_do_not_spread() {
        let is_masked = |y: usize, x: usize| x == 2 && (10..14).contains(&y);
        let mask = Plane::from_fn(30, 4, |y, x| !is_masked(y, x));
        // Values of other columns are far from those of this one.
        let image = view((30, 4), Some(mask), |y, x| if x == 2 { y as f64 / 10.0 } else { 29.0 });

        let found = straightened(&image, &field(&[0.5], (30, 4)), Level::best(), &Control::default());
        let found = found.expect("memory");
        let mask = found.mask().expect("there is one");
        assert!((0..30).all(|y| !mask.row(y)[2] || value(&found, y, 2) < 3.5));
        for y in 0..30 {
            let is_inside = y < 29;
            assert_eq!(mask.row(y)[2], is_inside && !(9..13).contains(&y), "{y}");
            assert_eq!(mask.row(y)[1], is_inside, "half a row below the last one is beyond it");
        }
    }
}

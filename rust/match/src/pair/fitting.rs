//! The views of a pair brought together: pixels of one type, and the right one at the size of the left one.
//!
//! ```text
//! scale = left size / right size, along x and along y    # of images of one shape: only their resolution differs;
//!         a whole factor, from the first pixel on, where the size was rounded up
//!       = 1, or the ratio of the widths, along both      # of others: the right one lies over the middle of the left one
//! place(x) = (x + 0.5 - offset) / scale - 0.5;   offset = (left size - scale * right size) / 2
//! out(x) = sum over i of weight(i - place(x)) in(i) / sum of weights    # along columns, then along rows
//! weight(t) = sinc(t / s) sinc(t / 4s);   s = max(1, 1 / scale)         # Lanczos, which smooths where it reduces
//! valid if all pixels within s / 2 of the place are
//! ```
//!
//! Weights are multiples of `2^-14`, so that the sums of integers are exact. Images of two types become floats in units of the
//! left one:
//!
//! ```text
//! white = 255 for bytes; 1 for floats up to 1; else the least of 255, 1023, 4095, 16383, 65535 that no pixel exceeds, as
//!         cameras of 8 to 16 bits have it, or the largest pixel
//! right = right * left white / right white
//! ```
//!
//! Phase codes need no such scale, but noise is compared between the images.

use std::mem;

use ndarray::Array3;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::math;
use crate::base::plane::{Plane, zeroed};
use crate::image::view::{Image, View};
use crate::pair::alignment::straighten::{WEIGHT_BITS, without_masked};

/// Most that one image may have more rows or columns than the other.
const LARGEST_RATIO: f64 = 8.0;
/// Images of other shapes whose sides differ by less are cut out of one of the same resolution.
const CUT: f64 = 1.25;
/// The white of 8, 10, 12, 14 and 16 bits.
const WHITES: [f64; 5] = [255.0, 1023.0, 4095.0, 16383.0, 65535.0];
/// Half the width of the kernel in pixels of the coarser image.
const REACH: f64 = 4.0;

/// How a right image of another size lies over the left one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Rows and columns of the right image as it came.
    pub from: (usize, usize),
    /// Rows and columns of the left one.
    pub to: (usize, usize),
    /// Whether both have the same shape.
    pub is_alike: bool,
    /// Left rows and columns for one of the right image.
    pub scale: [f64; 2],
    /// Left rows and columns before its first one.
    offset: [f64; 2],
}

/// Both views with pixels of one type and of the size of the left one, and how the right one was fitted; `None`: it is of
/// this size already.
pub fn fitted(left: View, right: View) -> Result<([View; 2], Option<Fit>)> {
    let [to, from] = [&left, &right].map(|view| (view.image.shape().0, view.image.shape().1));
    let fit = (from != to).then(|| Fit::new(from, to)).transpose()?;
    let right = match &fit {
        Some(fit) => fit.apply(&right)?,
        None => right,
    };

    if mem::discriminant(&left.image) == mem::discriminant(&right.image) {
        return Ok(([left, right], fit));
    }

    let ratio = white(&left) / white(&right);
    let is_wide = [&left, &right].iter().any(|view| matches!(view.image, Image::F64(_)));
    Ok(([scaled(left, 1.0, is_wide), scaled(right, ratio, is_wide)], fit))
}

impl Fit {
    #[expect(clippy::float_cmp, reason = "whole numbers are exact")]
    fn new(from: (usize, usize), to: (usize, usize)) -> Result<Self> {
        let ratios = [to.0 as f64 / from.0 as f64, to.1 as f64 / from.1 as f64];
        if ratios.iter().any(|ratio| ratio.max(1.0 / ratio) > LARGEST_RATIO) {
            let got = format!("{} x {} pixels", from.0, from.1);
            let accepts = format!(
                "up to {LARGEST_RATIO} times as many or as few rows and columns as left's {} x {}",
                to.0, to.1
            );
            return Err(Error::value("right", got, accepts));
        }

        // Sizes of reduced images are rounded, by up to a pixel.
        let [down, along] = ratios;
        let off = (to.0 as f64 - along * from.0 as f64).abs();
        let is_alike = off <= down.max(along).max(1.0);
        let is_cut = ratios.iter().all(|ratio| ratio.max(1.0 / ratio) < CUT);
        let scale = match (is_alike, is_cut) {
            (true, _) => ratios,
            (false, true) => [1.0; 2],
            (false, false) => [along; 2],
        };
        let centered = |to: usize, from: usize, scale: f64| (to as f64 - scale * from as f64) / 2.0;
        let offset = [centered(to.0, from.0, scale[0]), centered(to.1, from.1, scale[1])];
        let fit = Self { from, to, is_alike, scale, offset };

        // Sizes are rounded up where the last row or column is made up, not where an image is squeezed.
        let factor = whole(along);
        let (larger, smaller, by) =
            if factor < 1.0 { (from, to, factor.recip()) } else { (to, from, factor) };
        let is_up = |small: usize, large: usize| small as f64 * by > large as f64;
        let is_rounded_up = is_up(smaller.0, larger.0) || is_up(smaller.1, larger.1);
        let is_exact = is_alike && (factor == 1.0 || is_rounded_up);
        Ok(if is_exact { fit.scaled_by(factor) } else { fit })
    }

    /// The fit of an image that was reduced or enlarged by an exact factor, from its first row and column on.
    fn scaled_by(&self, factor: f64) -> Self {
        Self { scale: [factor; 2], offset: [0.0; 2], ..*self }
    }

    /// The taps of all pixels along rows (0) or columns (1).
    fn taps(&self, axis: usize) -> Vec<Taps> {
        let (from, to) = ([self.from.0, self.from.1][axis], [self.to.0, self.to.1][axis]);
        let scale = self.scale[axis];
        let offset = self.offset[axis];

        let place = |at: usize| (at as f64 + 0.5 - offset) / scale - 0.5;
        (0..to).map(|at| Taps::new(place(at), scale.recip().max(1.0), from)).collect()
    }

    /// The view at the new size.
    fn apply(&self, view: &View) -> Result<View> {
        // Masked pixels, which may be NaN, must not spread.
        let source = without_masked(view, &Control::default())?;
        let taps = [self.taps(0), self.taps(1)];
        let image = match &source.image {
            Image::U8(pixels) => {
                Image::U8(resampled(pixels, &taps, |v| v.round().clamp(0.0, 255.0) as u8)?)
            }
            Image::U16(pixels) => {
                Image::U16(resampled(pixels, &taps, |v| v.round().clamp(0.0, 65535.0) as u16)?)
            }
            Image::F32(pixels) => Image::F32(resampled(pixels, &taps, |v| v as f32)?),
            Image::F64(pixels) => Image::F64(resampled(pixels, &taps, |v| v)?),
        };

        let [down, along] = &taps;
        let is_valid = |y: usize, x: usize| {
            let (rows, cols) = (down[y].core.clone(), along[x].core.clone());
            let is_inside = !rows.is_empty() && !cols.is_empty();
            is_inside && rows.into_iter().all(|y| cols.clone().all(|x| view.is_valid(y, x)))
        };
        let is_covered = view.mask.is_none() && taps.iter().flatten().all(|t| !t.core.is_empty());
        let mask = (!is_covered).then(|| Plane::from_fn(self.to.0, self.to.1, is_valid));
        Ok(View { image, mask, range: None, ..*view })
    }
}

/// The nearest whole number or its reciprocal.
fn whole(ratio: f64) -> f64 {
    if ratio < 1.0 { ratio.recip().round().recip() } else { ratio.round() }
}

/// The pixels of a row or a column that make one, and their weights.
#[derive(Debug)]
struct Taps {
    weights: Vec<(usize, f64)>,
    /// Those about its place, which must be valid; none beyond the image.
    core: std::ops::Range<usize>,
}

impl Taps {
    fn new(place: f64, s: f64, length: usize) -> Self {
        let end = length as f64;
        let clamp = |at: f64| at.clamp(0.0, end - 1.0) as usize;
        let first = (place - REACH * s).ceil();
        let count = ((place + REACH * s).floor() - first) as usize + 1;
        let exact: Vec<f64> =
            (0..count).map(|tap| lanczos((first + tap as f64 - place) / s)).collect();

        let unit = f64::from(1u32 << WEIGHT_BITS);
        let scale = unit / exact.iter().sum::<f64>();
        let mut weights: Vec<(usize, f64)> = (0..count)
            .map(|tap| (clamp(first + tap as f64), (exact[tap] * scale).round()))
            .collect();
        // The nearest pixel takes the rounding error.
        let nearest = (place.round() - first) as usize;
        weights[nearest].1 += unit - weights.iter().map(|tap| tap.1).sum::<f64>();
        for tap in &mut weights {
            tap.1 /= unit;
        }

        let is_inside = (-0.5..=end - 0.5).contains(&place);
        let half = (s - 1.0) / 2.0;
        let core = clamp((place - half).round())..clamp((place + half).round()) + 1;
        Self { weights, core: if is_inside { core } else { 0..0 } }
    }
}

/// The Lanczos kernel, `sinc(t) sinc(t / 4)`.
fn lanczos(t: f64) -> f64 {
    let sinc = |t: f64| {
        let angle = t * std::f64::consts::PI;
        if t == 0.0 { 1.0 } else { math::sin(angle) / angle }
    };
    sinc(t) * sinc(t / REACH)
}

fn resampled<T: Copy + Default + Into<f64>>(
    pixels: &Array3<T>,
    [down, along]: &[Vec<Taps>; 2],
    nearest: impl Fn(f64) -> T,
) -> Result<Array3<T>> {
    let (_, cols, channels) = pixels.dim();
    let pixels = pixels.as_standard_layout();
    let source = pixels.as_slice().unwrap_or_default();
    let width = cols * channels;

    let mut out = zeroed(down.len() * along.len() * channels)?;
    let mut sums = zeroed(width)?;
    for (taps, out) in down.iter().zip(out.chunks_exact_mut(along.len() * channels)) {
        sums.fill(0.0);
        for (y, weight) in &taps.weights {
            for (sum, value) in sums.iter_mut().zip(&source[y * width..][..width]) {
                *sum += weight * (*value).into();
            }
        }

        for (taps, out) in along.iter().zip(out.chunks_exact_mut(channels)) {
            for (c, out) in out.iter_mut().enumerate() {
                let terms = taps.weights.iter().map(|(x, weight)| weight * sums[x * channels + c]);
                *out = nearest(terms.sum());
            }
        }
    }
    Ok(Array3::from_shape_vec((down.len(), along.len(), channels), out).unwrap_or_default())
}

/// White in units of an image's pixels.
fn white(view: &View) -> f64 {
    let most = match &view.image {
        Image::U8(_) => return WHITES[0],
        Image::U16(pixels) => largest(pixels, view),
        Image::F32(pixels) => largest(pixels, view),
        Image::F64(pixels) => largest(pixels, view),
    };

    let is_fraction = !matches!(view.image, Image::U16(_)) && most <= 1.0;
    let white = WHITES.into_iter().find(|white| most <= *white);
    if is_fraction { 1.0 } else { white.unwrap_or(most) }
}

/// The largest magnitude of a valid pixel.
fn largest<T: Copy + Into<f64>>(pixels: &Array3<T>, view: &View) -> f64 {
    let values = pixels.indexed_iter().filter(|((y, x, _), _)| view.is_valid(*y, *x));
    values.fold(0.0, |most, (_, value)| most.max((*value).into().abs()))
}

/// The view with pixels of floats, in double precision if that is wide, times a factor.
fn scaled(view: View, factor: f64, is_wide: bool) -> View {
    let image = match &view.image {
        Image::U8(pixels) => floats(pixels, factor, is_wide),
        Image::U16(pixels) => floats(pixels, factor, is_wide),
        Image::F32(pixels) => floats(pixels, factor, is_wide),
        Image::F64(pixels) => floats(pixels, factor, is_wide),
    };
    View { image, ..view }
}

fn floats<T: Copy + Into<f64>>(pixels: &Array3<T>, factor: f64, is_wide: bool) -> Image {
    if is_wide {
        Image::F64(pixels.mapv(|value| value.into() * factor))
    } else {
        Image::F32(pixels.mapv(|value| (value.into() * factor) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(rows: usize, cols: usize, by: f64) -> Image {
        let value = |(y, x, _): (usize, usize, usize)| {
            let [u, v] = [x, y].map(|at| (at as f64 + 0.5) * by);
            100.0 + 50.0 * math::sin(0.09 * u + 0.05 * v)
        };
        Image::F64(Array3::from_shape_fn((rows, cols, 1), value))
    }

    #[test]
    fn an_image_of_another_resolution_shows_the_same_at_the_same_place() {
        let left = View::from(wave(90, 120, 1.0));
        for by in [0.5, 2.0, 3.0] {
            let right = wave((90.0 / by) as usize, (120.0 / by) as usize, by);
            let ([left, right], fit) = fitted(left.clone(), View::from(right)).expect("fits");
            let [Image::F64(left), Image::F64(right)] = [left.image, right.image] else {
                unreachable!("both are doubles")
            };
            assert!(fit.is_some_and(|fit| fit.is_alike));

            for (y, x) in (15..75).flat_map(|y| (15..105).map(move |x| (y, x))) {
                let off = (left[(y, x, 0)] - right[(y, x, 0)]).abs();
                assert!(off < 0.3, "{off} at {y} {x} by {by}");
            }
        }
    }

    #[test]
    #[expect(clippy::float_cmp, reason = "the same values are meant, to the bit")]
    fn sizes_say_how_they_were_rounded() {
        let of = |from, to| Fit::new(from, to).expect("legal").scale;
        assert_eq!(of((50, 62), (100, 123)), [2.0; 2]);
        assert_eq!(of((50, 61), (100, 123)), [2.0, 123.0 / 61.0]);
        assert_eq!(of((100, 122), (100, 123)), [1.0; 2]);
        assert_eq!(of((199, 247), (100, 124)), [0.5; 2]);
    }

    #[test]
    fn what_a_cut_out_does_not_show_is_masked_and_masks_follow() {
        let ones = |rows, cols| Image::U8(Array3::from_elem((rows, cols, 1), 200));
        let left = View::from(ones(100, 100));
        let ([_, right], fit) = fitted(left.clone(), View::from(ones(100, 90))).expect("fits");
        assert_eq!(fit.map(|fit| (fit.is_alike, fit.scale)), Some((false, [1.0; 2])));
        let mask = right.mask.expect("columns are missing");
        assert_eq!(mask.row(50).iter().filter(|valid| !**valid).count(), 10);
        assert!(mask.row(50)[5] && !mask.row(50)[4]);

        let mut pixels = Array3::from_elem((50, 50, 1), 7.0f32);
        pixels[(20, 30, 0)] = f32::NAN;
        let mask = Plane::from_fn(50, 50, |y, x| (y, x) != (20, 30));
        let right = View { mask: Some(mask), ..View::from(Image::F32(pixels)) };
        let ([left, right], _) = fitted(left, right).expect("fits");
        let [Image::F32(left), Image::F32(pixels)] = [left.image, right.image] else {
            unreachable!("bytes beside floats become floats")
        };
        assert!(left.iter().all(|value| (value - 200.0).abs() < 1e-6));
        assert!(pixels.iter().all(|value| (value - 7.0).abs() < 1e-6));
        let mask = right.mask.expect("there was one");
        assert!(!mask.row(40)[61] && mask.row(38)[61] && mask.row(40)[63]);
    }

    #[test]
    fn images_of_two_types_are_in_units_of_the_left_one() {
        let bytes = Array3::from_shape_fn((16, 16, 1), |(y, x, _)| (16 * y + x) as u8);
        let others = [
            Image::U16(bytes.mapv(|byte| 257 * u16::from(byte))),
            Image::F32(bytes.mapv(|byte| f32::from(byte) / 255.0)),
            Image::F64(bytes.mapv(f64::from)),
        ];
        for other in others {
            let views = (View::from(Image::U8(bytes.clone())), View::from(other));
            let ([left, right], fit) = fitted(views.0, views.1).expect("of one size");
            assert!(fit.is_none());
            for found in [left.image, right.image] {
                let found = match found {
                    Image::F32(pixels) => pixels.mapv(f64::from),
                    Image::F64(pixels) => pixels,
                    _ => unreachable!("both are floats"),
                };
                let same = |(found, byte): (&f64, &u8)| (found - f64::from(*byte)).abs() < 1e-4;
                assert!(found.iter().zip(&bytes).all(same));
            }
        }
    }

    #[test]
    fn sizes_that_no_pair_has_are_refused() {
        let image = |rows| View::from(Image::U8(Array3::zeros((rows, 90, 1))));
        let refused = fitted(image(90), image(11)).expect_err("too few rows").to_string();
        assert!(
            refused.starts_with("right: got 11 x 90 pixels; accepts up to 8 times"),
            "{refused}"
        );
    }
}

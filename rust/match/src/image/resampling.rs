//! Images read between their pixels: one Lanczos kernel, `sinc(t) sinc(t / 4)`, for all images that are
//! matched.
//!
//! ```text
//! out(x) = sum over i of weight(i - place(x)) in(i)        weight(t) = sinc(t / s) sinc(t / 4s) / sum of all
//! ```
//!
//! `s` is 1, or the factor by which an image is reduced, which also smooths it. Weights are multiples of
//! `2^-14` with sum 1, so sums of integers are exact in any order. The kernel keeps fine texture; linear
//! interpolation would blur it and make one image softer than the other.

use std::ops::Range;
use std::sync::OnceLock;

use crate::base::error::Result;
use crate::base::math;
use crate::base::plane::zeroed;

/// Number of pixels averaged for a resampled one, along each axis.
pub const TAPS: usize = 8;
/// Steps between two pixels to which places are rounded, if an image is neither reduced nor enlarged.
pub const STEPS: i32 = 64;
/// Weights are multiples of `2^-WEIGHT_BITS`.
pub const WEIGHT_BITS: u32 = 14;
/// The tap at the rounded-down place.
pub const CENTER: isize = TAPS as isize / 2 - 1;
/// Half the width of the kernel, in pixels of the coarser image.
const REACH: f64 = (TAPS / 2) as f64;

/// The weights at every step; each set of eight has the sum `2^WEIGHT_BITS`.
pub fn weights() -> &'static [[i32; TAPS]; STEPS as usize] {
    static WEIGHTS: OnceLock<[[i32; TAPS]; STEPS as usize]> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        std::array::from_fn(|step| {
            let share = step as f64 / f64::from(STEPS);
            let exact: [f64; TAPS] = std::array::from_fn(|tap| lanczos(tap as f64 - CENTER as f64 - share));
            let mut weights = [0; TAPS];
            let nearest = if 2 * step <= STEPS as usize { CENTER } else { CENTER + 1 } as usize;
            quantize(&exact, nearest, &mut weights);
            weights
        })
    })
}

/// The Lanczos kernel, `sinc(t) sinc(t / 4)`.
fn lanczos(t: f64) -> f64 {
    let sinc = |t: f64| {
        let angle = t * std::f64::consts::PI;
        if t == 0.0 { 1.0 } else { math::sin(angle) / angle }
    };
    sinc(t) * sinc(t / REACH)
}

/// Writes weights with the sum `2^WEIGHT_BITS`; the nearest pixel takes the rounding error.
fn quantize(exact: &[f64], nearest: usize, weights: &mut [i32]) {
    let unit = 1 << WEIGHT_BITS;
    let scale = f64::from(unit) / exact.iter().sum::<f64>();
    for (weight, exact) in weights.iter_mut().zip(exact) {
        *weight = (exact * scale).round() as i32;
    }
    weights[nearest] += unit - weights.iter().sum::<i32>();
}

/// The pixels of a row or a column that contribute to one, and their weights.
#[derive(Debug)]
pub struct LanczosTaps {
    weights: Vec<(usize, f64)>,
    /// Those around its place, which must be valid; none beyond the image.
    pub core: Range<usize>,
}

impl LanczosTaps {
    /// The pixels around a place in a row or a column of this length; `s`, if above 1, is the factor by which
    /// the image is reduced.
    pub fn new(place: f64, s: f64, length: usize) -> Self {
        let end = length as f64;
        let clamp = |at: f64| at.clamp(0.0, end - 1.0) as usize;
        let first = (place - REACH * s).ceil();
        let count = ((place + REACH * s).floor() - first) as usize + 1;

        let exact: Vec<f64> = (0..count).map(|tap| lanczos((first + tap as f64 - place) / s)).collect();
        let mut quantized = vec![0; count];
        quantize(&exact, (place.round() - first) as usize, &mut quantized);
        let unit = f64::from(1u32 << WEIGHT_BITS);
        let weight = |(tap, weight)| (clamp(first + tap as f64), f64::from(weight) / unit);
        let weights = quantized.into_iter().enumerate().map(weight).collect();

        let is_inside = (-0.5..=end - 0.5).contains(&place);
        let half = (s - 1.0) / 2.0;
        let core = clamp((place - half).round())..clamp((place + half).round()) + 1;
        Self { weights, core: if is_inside { core } else { 0..0 } }
    }
}

/// An image resampled along columns, then along rows. Rows hold pixels of `channels` values; `nearest` rounds
/// a value.
pub fn resized<T: Copy + Default + Into<f64>>(
    source: &[T],
    (cols, channels): (usize, usize),
    [down, along]: &[Vec<LanczosTaps>; 2],
    nearest: impl Fn(f64) -> T,
) -> Result<Vec<T>> {
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
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_symmetric_and_of_one_sum() {
        for (step, weights) in weights().iter().enumerate() {
            assert_eq!(weights.iter().sum::<i32>(), 1 << WEIGHT_BITS);
            assert!(weights.iter().map(|weight| weight.abs()).sum::<i32>() < 2 << WEIGHT_BITS);
            if step > 0 {
                let mirrored = &super::weights()[STEPS as usize - step];
                assert!((0..TAPS).all(|tap| (weights[tap] - mirrored[TAPS - 1 - tap]).abs() <= 4));
            }
        }
    }
}

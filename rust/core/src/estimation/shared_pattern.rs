//! The same faint pattern in both images: the fixed pattern noise of one moved camera, dust, film grain, a
//! mesh.
//!
//! It matches at disparity 0, everywhere, better than faint texture does at its own. The signs of fine detail
//! show what the images share at the same place. In copies of a quarter, a pattern averages out, but a scene
//! at disparity 0 does not. So a pattern leads clearly more at the scale of pixels:
//!
//! ```text
//! fine     = g - (1 4 6 4 1)/16 x (1 4 6 4 1)/16 * g
//! same(k)  = mean of sign(fine of left[y, x]) sign(fine of right[y, x - k])
//! lead     = same(0) - max of same(-3), same(-2), same(2), same(3)
//! shared   = lead > LEAST_LEAD, and lead of copies of a quarter < QUARTER lead
//!
//! common   = the smaller one of the fine values where their signs agree, at most MOST gray levels; else 0
//! strength = sqrt(mean of the products of both fine values) / GAIN
//! ```
//!
//! The common part is subtracted from both images.

use ndarray::Array3;
use rayon::prelude::*;

use super::overview::LEAST_SIZE;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, reflect};
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;

/// Least lead of a pattern. In 42 pairs without one (12 scenes sharp, compressed, noisy; table tops, planes,
/// streets) the largest is 0.024; with white patterns of 1, 2 and 4 gray levels and noise of 0.7, 9, 12 and
/// 12 of 12 scenes are above it.
const LEAST_LEAD: f64 = 0.04;
/// The lead of copies stays below this share: 0.24 with white patterns; where much of the scene is at
/// disparity 0, 1.4 and more.
const QUARTER: f64 = 0.5;
/// Side of the squares that become one pixel of a copy.
const COPY: usize = 4;
/// Gray levels of 8 bits: larger common parts are not faint.
const MOST: f64 = 12.0;
/// Standard deviation of the fine part of white noise of 1.
const GAIN: f64 = 0.891;
/// Disparities at which patterns are compared: first that of a pattern.
const SHIFTS: [isize; 5] = [0, -3, -2, 2, 3];
/// Enough pixels: by chance, their means deviate by 0.005.
const ENOUGH: usize = 1 << 16;
/// Weights along an axis; their sum is 16.
const WEIGHTS: [i32; 5] = [1, 4, 6, 4, 1];
const WHOLE: i32 = 256;

/// The pair without a pattern that both images share, and its strength, in units of the pixels; `None`: no
/// pattern.
pub fn removed(pair: &Pair) -> Result<Option<(Pair, f64)>> {
    let (rows, cols) = pair.size();
    if rows.min(cols) < LEAST_SIZE {
        return Ok(None);
    }

    let grays = pair.views().map(|view| (view.gray(), view.scale().surplus()));
    let lead_here = lead(grays, (rows * cols / ENOUGH).max(1));
    if lead_here <= LEAST_LEAD {
        return Ok(None);
    }
    let copies = grays.map(quarter);
    if lead(copies.each_ref().map(|copy| (copy, 0)), 1) >= QUARTER * lead_here {
        return Ok(None);
    }

    let levels = pair.views().map(|view| view.scale().steps(view.scale().level()));
    let fine = |side: usize| {
        let gray = pair.views()[side].gray();
        Plane::from_fn(rows, cols, |y, x| fine_at(gray, y, x) / levels[side])
    };
    let (left, right) = rayon::join(|| fine(0), || fine(1));

    let both = || left.as_slice().iter().zip(right.as_slice());
    let product: f64 = both().map(|(a, b)| a.clamp(-MOST, MOST) * b.clamp(-MOST, MOST)).sum();
    let strength = (product / (rows * cols) as f64).max(0.0).sqrt() / GAIN;
    let common: Vec<f64> = both().map(|(a, b)| common(*a, *b)).collect();

    let inputs = [0, 1].map(|side| without(pair.views()[side], &common, levels[side]));
    let (min, count) = pair.candidates().numbers();
    let clean = Pair::of_inputs(inputs, min, count)?;
    let unit = pair.views()[0].scale().level();
    Ok(Some((pair.with_views(clean.views().map(View::clone)), strength * unit)))
}

/// Gray values, and how many of their lowest bits are dropped so that sums over windows fit.
type Short<'a> = (&'a Plane<i32>, u32);

/// The sums of squares.
fn quarter((gray, surplus): Short) -> Plane<i32> {
    Plane::from_fn(gray.rows() / COPY, gray.cols() / COPY, |y, x| {
        let square = |y: usize| &gray.row(y)[COPY * x..COPY * (x + 1)];
        let row = |y: usize| square(y).iter().map(|gray| gray >> surplus).sum::<i32>();
        (COPY * y..COPY * (y + 1)).map(row).sum()
    })
}

/// By how much signs agree better at the same place than beside it, in one row in `every`.
fn lead(grays: [Short; 2], every: usize) -> f64 {
    let (rows, cols) = grays[0].0.size();
    let sampled: Vec<usize> = (2..rows.saturating_sub(2)).step_by(every).collect();
    let agreeing = |y: &usize| {
        let [left, right] = grays.map(|gray| signs(gray, *y));
        SHIFTS.map(|shift| {
            let (from, to) = (shift.max(0) as usize, (-shift).max(0) as usize);
            let places = left[from..].iter().zip(&right[to..]);
            places.map(|(a, b)| i64::from(a * b)).sum::<i64>()
        })
    };
    let add = |a: [i64; 5], b: [i64; 5]| [0, 1, 2, 3, 4].map(|k| a[k] + b[k]);
    let sums = sampled.par_iter().map(agreeing).reduce(|| [0; 5], add);

    let mean = |k: usize| {
        let count = sampled.len() * cols.saturating_sub(SHIFTS[k].unsigned_abs());
        sums[k] as f64 / count.max(1) as f64
    };
    mean(0) - (1..SHIFTS.len()).map(mean).fold(f64::NEG_INFINITY, f64::max)
}

/// The signs of the fine detail of a row with two above and below it.
fn signs((gray, surplus): Short, y: usize) -> Vec<i32> {
    let cols = gray.cols();
    let mut sums = vec![0; cols];
    for (row, weight) in (y - 2..=y + 2).zip(WEIGHTS) {
        let grays = sums.iter_mut().zip(gray.row(row));
        grays.for_each(|(sum, gray)| *sum += weight * (gray >> surplus));
    }
    let mut signs = vec![0; cols];
    let inner = signs[2..].iter_mut().zip(&gray.row(y)[2..]).zip(sums.windows(WEIGHTS.len()));
    for ((sign, gray), sums) in inner {
        let smooth: i32 = sums.iter().zip(WEIGHTS).map(|(sum, weight)| sum * weight).sum();
        *sign = (WHOLE * (gray >> surplus) - smooth).signum();
    }
    signs
}

/// The fine detail of a pixel, in steps.
fn fine_at(gray: &Plane<i32>, y: usize, x: usize) -> f64 {
    let places = |at: usize, count: usize| [0, 1, 2, 3, 4].map(|k| reflect(at as isize + k - 2, count));
    let columns = places(x, gray.cols());
    let mut smooth = 0;
    for (y, weight) in places(y, gray.rows()).into_iter().zip(WEIGHTS) {
        let row = gray.row(y);
        let sum = |(x, weight): (&usize, i32)| i64::from(row[*x]) * i64::from(weight);
        smooth += i64::from(weight) * columns.iter().zip(WEIGHTS).map(sum).sum::<i64>();
    }
    f64::from(gray.row(y)[x]) - smooth as f64 / f64::from(WHOLE)
}

/// The common part of two fine values.
fn common(a: f64, b: f64) -> f64 {
    if a * b > 0.0 { a.signum() * a.abs().min(b.abs()).min(MOST) } else { 0.0 }
}

/// An image without this part of its gray levels, in finer steps.
fn without(view: &View, common: &[f64], level: f64) -> Input {
    let (scale, cols) = (view.scale(), view.size().1);
    let gray = |y: usize, x: usize| f64::from(view.gray().row(y)[x]) - common[y * cols + x] * level;
    let size = (view.size().0, cols, 1);
    let [least, largest] = scale.ends().map(f64::from);

    let (image, unit) = if scale.step().is_some() {
        let step = (largest - least) / f64::from(u16::MAX);
        let pixel = |(y, x, _)| ((gray(y, x) - least) / step).round() as u16;
        (Image::U16(Array3::from_shape_fn(size, pixel)), step / scale.steps(1.0))
    } else {
        (Image::F64(Array3::from_shape_fn(size, |(y, x, _)| scale.pixel(gray(y, x)))), 1.0)
    };
    Input { image, mask: view.mask().cloned(), unit }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::self_check::scenes::{Fault, pair};

    const SIZE: (usize, usize) = (240, 320);

    /// A pair with `pattern` added to every pixel of both images.
    fn with(fault: Fault, pattern: impl Fn(usize, usize) -> i32) -> Pair {
        let inputs = pair(fault, SIZE, 0).map(|input| {
            let Image::U8(pixels) = input.image else { unreachable!("gray bytes") };
            let more = |((y, x, _), pixel): ((usize, usize, usize), &u8)| {
                (i32::from(*pixel) + pattern(y, x)).clamp(0, 255) as u8
            };
            let changed: Vec<u8> = pixels.indexed_iter().map(more).collect();
            let pixels = Array3::from_shape_vec(pixels.dim(), changed).expect("as many");
            Input::from(Image::U8(pixels))
        });
        Pair::of_inputs(inputs, 0, 32).expect("legal")
    }

    /// White noise of this standard deviation in gray levels.
    fn white(strength: f64) -> impl Fn(usize, usize) -> i32 {
        move |y, x| {
            let mut state = (y * SIZE.1 + x) as u64;
            for _ in 0..2 {
                state = (state ^ (state >> 29)).wrapping_add(77).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            }
            let share = (state >> 40) as f64 / f64::from(1u32 << 24) - 0.5;
            (strength * 12f64.sqrt() * share).round() as i32
        }
    }

    #[test]
    fn a_pattern_is_found_and_subtracted() {
        for strength in [4.0, 8.0] {
            let before = with(Fault::None, white(strength));
            let (after, found) = removed(&before).expect("memory").expect("a pattern");
            assert!((found / strength - 1.0).abs() < 0.35, "{found} of {strength}");

            let lead_of =
                |pair: &Pair| lead(pair.views().map(|view| (view.gray(), view.scale().surplus())), 1);
            assert!(lead_of(&after) < 0.3 * lead_of(&before), "{}", lead_of(&after));
            assert_eq!(after.candidates(), before.candidates());
        }
    }

    #[test]
    fn a_scene_is_no_pattern() {
        for fault in [Fault::None, Fault::Noise, Fault::Plain, Fault::Fence, Fault::Twice] {
            assert!(removed(&with(fault, |_, _| 0)).expect("memory").is_none(), "{fault:?}");
        }
    }

    #[test]
    fn the_common_part_is_the_smaller_one() {
        let cases = [(2.0, 3.0, 2.0), (-4.0, -3.0, -3.0), (2.0, -3.0, 0.0), (50.0, 40.0, MOST)];
        for (a, b, expected) in cases {
            assert_eq!(common(a, b).to_bits(), f64::to_bits(expected), "{a}, {b}");
        }
    }
}

//! The same pattern in both images, at the same place: the fixed pattern noise of one moved camera, dust, film
//! grain, a mesh; a reflection, or the other view shining through (crosstalk).
//!
//! It matches at disparity 0, everywhere, better than faint texture does at its own. The signs of fine detail
//! show what the images share at the same place:
//!
//! ```text
//! fine     = g - (1 4 6 4 1)/16 x (1 4 6 4 1)/16 * g
//! same(k)  = mean of sign(fine of left[y, x]) sign(fine of right[y, x - k])
//! lead     = same(0) - max of same(-3), same(-2), same(2), same(3)
//! ```
//!
//! So does a scene at disparity 0. Two signs distinguish them. In copies of a quarter, a pattern of pixels
//! averages out, but a scene does not: such a pattern is found before the match. And where a match has found
//! other disparities, a scene is nowhere else: what leads there is a pattern, however coarse, and the pair is
//! matched again without it.
//!
//! ```text
//! before:  lead > LEAST_LEAD, and lead of copies of a quarter < QUARTER lead
//! after:   lead > LEAST_LEAD; and of the trusted pixels with |disparity| > ELSEWHERE, lead and
//!          same(0) - mean of sign(fine of left[y, x]) sign(fine of left[y, x + disparity])
//!              > LEAST_LEAD + ERRORS / sqrt(their number)
//!
//! rest = g
//! for spacing in SPACINGS, as long as lead > LEAST_LEAD:       # of the taps of the kernel, pixels
//!     fine = rest - kernel * rest;  rest = kernel * rest
//!     common = the smaller one of the fine values where their signs agree, else 0
//!     both images -= common
//! strength = rms of all that is subtracted
//! ```
//!
//! What is left of it may still match at disparity 0 ([`rest`]).

use ndarray::Array3;
use rayon::prelude::*;

use super::overview::LEAST_SIZE;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::refinement::filling::is_trusted;

/// Least lead of a pattern. In 42 pairs without one (12 scenes sharp, compressed, noisy; table tops, planes,
/// streets) the largest is 0.024; with white patterns of 1, 2 and 4 gray levels and noise of 0.7, 9, 12 and
/// 12 of 12 scenes are above it. After the match, where disparities are beyond ELSEWHERE: at most 0.036 for
/// 21 scenes, sharp, with noise of 5 and 20, and shifted so that much is at disparity 0; 0.065 or more with
/// crosstalk of 5 %.
const LEAST_LEAD: f64 = 0.04;
/// Standard errors of a mean of signs by which the lead after the match is larger.
const ERRORS: f64 = 3.0;
/// The lead of copies stays below this share: 0.24 with white patterns; where much of the scene is at
/// disparity 0, 1.4 and more.
const QUARTER: f64 = 0.5;
/// Side of the squares that become one pixel of a copy.
const COPY: usize = 4;
/// Pixels between the taps of the kernel, band after band. Of 10 scenes with white noise of 8 gray levels,
/// smooth noise of 8, and crosstalk of .2, 31, 45 and 24 % of the pixels are wrong with two bands, 29, 37 and
/// 21 % with three, 29, 36 and 22 % with four.
const SPACINGS: [usize; 3] = [1, 2, 4];
/// Pixels: the matches of a pattern are at most this far from disparity 0, by the tolerance of errors.
const AT_ZERO: f32 = 1.0;
/// Pixels: disparities beyond are not those of a pattern, nor of its mean with a scene. Not swept.
const ELSEWHERE: f32 = 4.0;
/// Disparities at which patterns are compared: first that of a pattern.
const SHIFTS: [isize; 5] = [0, -3, -2, 2, 3];
/// Enough pixels: by chance, their means deviate by 0.005.
const ENOUGH: usize = 1 << 16;
/// Weights along an axis; their sum is 16.
const WEIGHTS: [i32; 5] = [1, 4, 6, 4, 1];
const WHOLE: i32 = 256;

/// The fine detail that both images show at the same place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SameDetail {
    /// Hardly any.
    None,
    /// That of a scene at disparity 0, or of a pattern.
    Some,
    /// That of a pattern, which is finer than the scene.
    Pattern,
}

/// The fine detail that both images show at the same place.
pub fn same_detail(pair: &Pair) -> SameDetail {
    let (rows, cols) = pair.size();
    if rows.min(cols) < LEAST_SIZE {
        return SameDetail::None;
    }

    let grays = pair.views().map(Gray::of_view);
    let lead_here = lead(grays.each_ref(), 1);
    if lead_here <= LEAST_LEAD {
        return SameDetail::None;
    }
    let copies = grays.map(|gray| quarter(&gray));
    let is_finer = lead(copies.each_ref(), 1) < QUARTER * lead_here;
    if is_finer { SameDetail::Pattern } else { SameDetail::Some }
}

/// Whether the images of a match also show the same at the same place where it found another disparity. A
/// texture that repeats itself does, too, but the left image then agrees with itself as well.
pub fn shows_through(pair: &Pair, map: &Disparity) -> bool {
    let is_elsewhere = |y: usize, x: usize| is_elsewhere(map.disparity.row(y)[x], map.flags.row(y)[x]);
    let grays = pair.views().map(Gray::of_view);
    let (same, count) = same(grays.each_ref(), 1, is_elsewhere);

    let repeated = |y: usize| -> i64 {
        let signs = signs(&grays[0], 1, y);
        let places = signs.iter().enumerate().filter(|(x, _)| is_elsewhere(y, *x));
        let products = places.map(|(x, sign)| {
            let there = (x as f32 + map.disparity.row(y)[x]).round();
            sign * signs.get(there as usize).filter(|_| there >= 0.0).copied().unwrap_or(0)
        });
        products.map(i64::from).sum()
    };
    let repeated: i64 = sampled(map.disparity.size(), 1).into_par_iter().map(repeated).sum();
    let repeated = repeated as f64 / count.max(1) as f64;
    led(same).min(same[0] - repeated) > LEAST_LEAD + ERRORS / (count as f64).sqrt()
}

/// Whether the larger part of a map is where a pattern matches.
pub fn is_at_zero(map: &Disparity) -> bool {
    let disparities = map.disparity.as_slice();
    2 * disparities.iter().filter(|disparity| disparity.abs() <= AT_ZERO).count() > disparities.len()
}

/// The share of a map that is trusted, and where no pattern matches.
pub fn elsewhere(map: &Disparity) -> f64 {
    let (disparities, flags) = (map.disparity.as_slice(), map.flags.as_slice());
    let count = disparities.iter().zip(flags).filter(|(disparity, flags)| is_elsewhere(**disparity, **flags));
    count.count() as f64 / disparities.len() as f64
}

fn is_elsewhere(disparity: f32, flags: u16) -> bool {
    is_trusted(disparity, flags) && disparity.abs() > ELSEWHERE
}

/// The pair without the pattern that both images share, and the strength of the pattern, in units of the
/// pixels.
pub fn removed(pair: &Pair, runtime: Runtime) -> Result<(Pair, f64)> {
    let Runtime { execution, control, .. } = runtime;
    let (rows, cols) = pair.size();
    let units = pair.views().map(|view| view.scale().level());

    let mut rest = pair.views().map(Gray::of_view);
    let mut shared = Plane::<f64>::new(rows, cols)?;
    for spacing in SPACINGS {
        if lead(rest.each_ref(), spacing) <= LEAST_LEAD {
            break;
        }
        let kernel = kernel(spacing)?;
        let smooth = |side: usize| rest[side].convolved(&kernel, execution.level, control);
        let smooth = [smooth(0)?, smooth(1)?];

        let level = |gray: &Gray, side: usize, y: usize, x: usize| {
            f64::from(gray.row(y)[x]) / gray.steps(units[side])
        };
        let fine = |side, y, x| level(&rest[side], side, y, x) - level(&smooth[side], side, y, x);
        shared = Plane::by_pixels((rows, cols), control, |y, x| {
            shared.row(y)[x] + common(fine(0, y, x), fine(1, y, x))
        })?;
        rest = smooth;
    }

    let inputs = [0, 1].map(|side| without(pair.views()[side], &shared, units[side]));
    let (min, count) = pair.candidates().numbers();
    let clean = Pair::of_inputs(inputs, min, count)?;
    let squares: f64 = shared.as_slice().iter().map(|common| common * common).sum();
    let strength = (squares / (rows * cols) as f64).sqrt();
    Ok((pair.with_views(clean.views().map(View::clone)), strength * units[0]))
}

/// Where the map of a pair without its pattern probably matches the rest of it: at disparity 0, if more than
/// half of what is there exceeds what is in an equal interval beside it.
pub fn rest(map: &Disparity) -> Option<Plane<bool>> {
    let count = |middle: f32| {
        let disparities = map.disparity.as_slice().iter();
        disparities.filter(|disparity| (*disparity - middle).abs() <= AT_ZERO).count()
    };
    let beside = count(-2.0 * AT_ZERO).max(count(2.0 * AT_ZERO));
    (count(0.0) > 2 * beside).then(|| map.disparity.map(|disparity| disparity.abs() <= AT_ZERO))
}

/// The kernel of WEIGHTS along both axes, this many pixels apart.
fn kernel(spacing: usize) -> Result<Kernel> {
    let mut taps = vec![0.0; (WEIGHTS.len() - 1) * spacing + 1];
    for (k, weight) in WEIGHTS.into_iter().enumerate() {
        taps[k * spacing] = f64::from(weight) / 16.0;
    }
    Kernel::separable(&taps, &taps)
}

/// The sums of squares of pixels.
fn quarter(gray: &Gray) -> Gray<'static> {
    let (rows, cols) = gray.size();
    let surplus = surplus(gray);
    let sums = Plane::from_fn(rows / COPY, cols / COPY, |y, x| {
        let square = |y: usize| &gray.row(y)[COPY * x..COPY * (x + 1)];
        let row = |y: usize| square(y).iter().map(|gray| gray >> surplus).sum::<i32>();
        (COPY * y..COPY * (y + 1)).map(row).sum()
    });
    Gray::within((gray.reach() >> surplus) * (COPY * COPY) as u32, sums)
}

/// How many of the lowest bits of gray values are dropped so that sums over windows fit.
fn surplus(gray: &Gray) -> u32 {
    (u32::BITS - gray.reach().leading_zeros()).saturating_sub(22)
}

/// The rows that are examined.
fn sampled((rows, cols): (usize, usize), spacing: usize) -> Vec<usize> {
    let every = (rows * cols / ENOUGH).max(1);
    (2 * spacing..rows.saturating_sub(2 * spacing)).step_by(every).collect()
}

/// How well the signs of some pixels agree at each of SHIFTS, and the number of these pixels; in large images,
/// of some rows. `spacing`: that of the kernel.
fn same(grays: [&Gray; 2], spacing: usize, is_one: impl Fn(usize, usize) -> bool + Sync) -> ([f64; 5], i64) {
    let agreeing = |y: usize| {
        let [mut left, right] = grays.map(|gray| signs(gray, spacing, y));
        let mut count = 0;
        for (x, sign) in left.iter_mut().enumerate() {
            let is_one = is_one(y, x);
            count += i64::from(is_one);
            *sign *= i32::from(is_one);
        }
        let sums = SHIFTS.map(|shift| {
            let by = |shift: isize| shift.max(0) as usize * spacing;
            let places = left[by(shift)..].iter().zip(&right[by(-shift)..]);
            places.map(|(a, b)| i64::from(a * b)).sum::<i64>()
        });
        (sums, count)
    };
    let none = || ([0; 5], 0);
    let add =
        |(a, m): ([i64; 5], i64), (b, n): ([i64; 5], i64)| ([0, 1, 2, 3, 4].map(|k| a[k] + b[k]), m + n);
    let (sums, count) = sampled(grays[0].size(), spacing).into_par_iter().map(agreeing).reduce(none, add);
    (sums.map(|sum| sum as f64 / count.max(1) as f64), count)
}

/// By how much signs agree better at the same place than beside it.
fn led([here, beside @ ..]: [f64; 5]) -> f64 {
    here - beside.into_iter().fold(f64::NEG_INFINITY, f64::max)
}

/// The lead of all pixels.
fn lead(grays: [&Gray; 2], spacing: usize) -> f64 {
    led(same(grays, spacing, |_, _| true).0)
}

/// The signs of the fine detail of a row.
fn signs(gray: &Gray, spacing: usize, y: usize) -> Vec<i32> {
    let (cols, surplus, reach) = (gray.size().1, surplus(gray), 2 * spacing);
    let mut sums = vec![0; cols];
    for (row, weight) in (y - reach..=y + reach).step_by(spacing).zip(WEIGHTS) {
        let grays = sums.iter_mut().zip(gray.row(row));
        grays.for_each(|(sum, gray)| *sum += weight * (gray >> surplus));
    }
    let mut signs = vec![0; cols];
    let inner = signs[reach..].iter_mut().zip(&gray.row(y)[reach..]).zip(sums.windows(2 * reach + 1));
    for ((sign, gray), sums) in inner {
        let smooth: i32 = WEIGHTS.iter().enumerate().map(|(k, weight)| sums[k * spacing] * weight).sum();
        *sign = (WHOLE * (gray >> surplus) - smooth).signum();
    }
    signs
}

/// The common part of two fine values.
fn common(a: f64, b: f64) -> f64 {
    if a * b > 0.0 { a.signum() * a.abs().min(b.abs()) } else { 0.0 }
}

/// An image without this part of its gray levels, which have this size, in finer steps.
fn without(view: &View, common: &Plane<f64>, unit: f64) -> Input {
    let (scale, cols) = (view.scale(), view.size().1);
    let level = scale.steps(unit);
    let gray = |y: usize, x: usize| f64::from(view.gray().row(y)[x]) - common.row(y)[x] * level;
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
    use crate::testing::on_a_thread;
    use phasestereo_match::base::simd::Level;
    use phasestereo_match::matcher::Timings;
    use phasestereo_match::refinement::flag;

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

    fn lead_of(pair: &Pair) -> f64 {
        lead(pair.views().map(Gray::of_view).each_ref(), 1)
    }

    #[test]
    fn a_pattern_is_found_and_subtracted() {
        for strength in [4.0, 8.0, 16.0] {
            let before = with(Fault::None, white(strength));
            assert_eq!(same_detail(&before), SameDetail::Pattern);
            let (after, found) =
                on_a_thread(Level::best(), |runtime| removed(&before, runtime)).expect("memory");
            assert!((found / strength - 1.0).abs() < 0.35, "{found} of {strength}");
            assert!(lead_of(&after) < 0.35 * lead_of(&before), "{} {}", lead_of(&after), lead_of(&before));
            assert_eq!(after.candidates(), before.candidates());
        }
    }

    #[test]
    fn a_scene_is_not_a_pattern() {
        for fault in [Fault::None, Fault::Noise, Fault::Plain, Fault::Fence] {
            assert_eq!(same_detail(&with(fault, |_, _| 0)), SameDetail::None, "{fault:?}");
        }
        assert_eq!(same_detail(&with(Fault::Twice, |_, _| 0)), SameDetail::Some);
    }

    /// A map with a disparity, but for a column in `every`, where it is 0.
    fn map(disparity: f32, every: usize) -> Disparity {
        let (rows, cols) = SIZE;
        Disparity {
            disparity: Plane::from_fn(rows, cols, |_, x| if x % every == 0 { 0.0 } else { disparity }),
            flags: Plane::new(rows, cols).expect("memory"),
            confidence: None,
            uncertainty: None,
            wrong: None,
            detail: None,
            timings: Timings::default(),
        }
    }

    #[test]
    fn what_both_images_show_where_a_match_is_elsewhere_shines_through() {
        let [clean, spoiled] = [0.0, 4.0].map(|strength| with(Fault::None, white(strength)));
        assert!(shows_through(&spoiled, &map(5.0, 9)) && !shows_through(&clean, &map(5.0, 9)));
        assert!(!shows_through(&spoiled, &map(2.0, 9)), "too near");
        let mut flagged = map(5.0, 9);
        flagged.flags = flagged.flags.map(|_| flag::MISMATCHED);
        assert!(!shows_through(&spoiled, &flagged), "not to be trusted");

        let bars = |_: usize, x: usize| 60 * ((x % 6) as i32 / 3);
        let repeated = with(Fault::Plain, bars);
        assert!(lead_of(&repeated) > LEAST_LEAD && !shows_through(&repeated, &map(6.0, 9)));
    }

    #[test]
    fn a_crowd_at_zero_is_the_rest_of_a_pattern() {
        let is_crowd = |disparity, every| rest(&map(disparity, every)).is_some();
        assert!(is_crowd(5.0, 4) && !is_crowd(2.0, 4) && is_crowd(-2.0, 1));
        let marked = rest(&map(5.0, 4)).expect("a crowd");
        assert_eq!(marked.row(3)[..5], [true, false, false, false, true]);

        assert!(is_at_zero(&map(5.0, 1)) && !is_at_zero(&map(5.0, 2)) && is_at_zero(&map(0.5, 2)));
        for (disparity, every, share) in [(5.0, 2, 0.5), (5.0, 4, 0.75), (3.0, 4, 0.0)] {
            assert_eq!(elsewhere(&map(disparity, every)).to_bits(), f64::to_bits(share));
        }
    }

    #[test]
    fn the_common_part_is_the_smaller_one() {
        let cases = [(2.0, 3.0, 2.0), (-4.0, -3.0, -3.0), (2.0, -3.0, 0.0), (50.0, 40.0, 40.0)];
        for (a, b, expected) in cases {
            assert_eq!(common(a, b).to_bits(), f64::to_bits(expected), "{a}, {b}");
        }
    }
}

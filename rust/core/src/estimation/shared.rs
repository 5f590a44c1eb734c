//! What both images show at the same place: a pattern, such as the fixed pattern noise of one moved camera, dust,
//! film grain or a mesh; or each other, by crosstalk or a reflection ([`super::crosstalk`]).
//!
//! It matches at disparity 0, everywhere, better than faint texture does at its own. Fine detail shows it: it
//! agrees better at the same place than beside it, by its lead ([`super::fine_detail`]). So does that of a scene
//! at disparity 0, but in copies of a quarter, a pattern of pixels averages out, and a scene does not: such a
//! pattern is found before the match. And where a match has found other disparities, a scene is nowhere else:
//! what leads there is shared, and the pair is matched again without it.
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
//! What is left may still match at disparity 0 ([`rest`]).

use ndarray::Array3;
use rayon::prelude::*;

use super::crosstalk;
use super::fine_detail::{kernel, lead, led, same, sampled, signs, surplus};
use super::overview::LEAST_SIZE;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
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
/// Standard errors of a mean of signs by which the lead after the match is larger: 1 in 740 by chance.
const ERRORS: f64 = 3.0;
/// The lead of copies stays below this share: 0.24 with white patterns; where much of the scene is at
/// disparity 0, 1.4 and more.
const QUARTER: f64 = 0.5;
/// Side of the squares that become one pixel of a copy.
const COPY: usize = 4;
/// Pixels between the taps of the kernel, band after band. Of 10 scenes with white and with smooth noise of 8
/// gray levels, 31 and 45 % of the pixels are wrong with two bands, 29 and 37 % with three, 29 and 36 % with
/// four.
const SPACINGS: [usize; 3] = [1, 2, 4];
/// Pixels: the matches of a pattern are at most this far from disparity 0, by the tolerance of errors.
const AT_ZERO: f32 = 1.0;
/// Pixels: disparities beyond are not those of a pattern, nor of its mean with a scene. Not swept.
const ELSEWHERE: f32 = 4.0;

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

/// What both images of a pair share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shared {
    /// A pattern.
    Pattern,
    /// This share of each other.
    Crosstalk(f64),
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
    let is_elsewhere = |y: usize, x: usize| is_elsewhere_at(map, y, x);
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

/// Whether a pixel of a map is trusted, and where no pattern matches.
pub fn is_elsewhere_at(map: &Disparity, y: usize, x: usize) -> bool {
    is_elsewhere(map.disparity.row(y)[x], map.flags.row(y)[x])
}

fn is_elsewhere(disparity: f32, flags: u16) -> bool {
    is_trusted(disparity, flags) && disparity.abs() > ELSEWHERE
}

/// The part of both images that they share.
#[derive(Debug, Clone)]
pub struct SharedPart {
    /// It, in gray levels of the left image.
    levels: Plane<f64>,
    /// One gray level of each image, in units of its pixels; with the opposite sign if it is added.
    units: [f64; 2],
}

impl SharedPart {
    /// What both images share.
    pub fn new(pair: &Pair, shared: Shared, runtime: Runtime) -> Result<Self> {
        match shared {
            Shared::Pattern => Self::of_pattern(pair, runtime),
            Shared::Crosstalk(share) => {
                let [left, right] = pair.views().map(|view| view.scale().level());
                let levels = crosstalk::levels(pair, share, runtime.control)?;
                Ok(Self { levels, units: [left, -right] })
            }
        }
    }

    /// A pattern that both images show at the same place.
    fn of_pattern(pair: &Pair, runtime: Runtime) -> Result<Self> {
        let Runtime { execution, control, .. } = runtime;
        let units = pair.views().map(|view| view.scale().level());

        let mut rest = pair.views().map(Gray::of_view);
        let mut levels = Plane::<f64>::new(pair.size().0, pair.size().1)?;
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
            levels = Plane::by_pixels(pair.size(), control, |y, x| {
                levels.row(y)[x] + common(fine(0, y, x), fine(1, y, x))
            })?;
            rest = smooth;
        }
        Ok(Self { levels, units })
    }

    /// Its standard deviation, in units of the pixels of the left image.
    pub fn strength(&self) -> f64 {
        let levels = self.levels.as_slice();
        let squares: f64 = levels.iter().map(|level| level * level).sum();
        (squares / levels.len() as f64).sqrt() * self.units[0]
    }

    /// The pair without it.
    pub fn removed(&self, pair: &Pair) -> Result<Pair> {
        let inputs = [0, 1].map(|side| self.subtracted(pair.views()[side], side));
        let (min, count) = pair.candidates().numbers();
        let clean = Pair::of_inputs(inputs, min, count)?;
        Ok(pair.with_views(clean.views().map(View::clone)))
    }

    /// The left (0) or right (1) image, or a channel of it, minus this, in finer steps.
    pub fn subtracted(&self, view: &View, side: usize) -> Input {
        let (scale, (rows, cols)) = (view.scale(), view.size());
        let level = scale.steps(self.units[side]);
        let gray = |y: usize, x: usize| f64::from(view.gray().row(y)[x]) - self.levels.row(y)[x] * level;
        let [least, largest] = scale.ends().map(f64::from);

        let (image, unit) = if scale.step().is_some() {
            let step = (largest - least) / f64::from(u16::MAX);
            let pixel = |(y, x, _)| ((gray(y, x) - least) / step).round() as u16;
            (Image::U16(Array3::from_shape_fn((rows, cols, 1), pixel)), step / scale.steps(1.0))
        } else {
            (Image::F64(Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| scale.pixel(gray(y, x)))), 1.0)
        };
        Input { image, mask: view.mask().cloned(), unit }
    }
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

/// The common part of two fine values.
fn common(a: f64, b: f64) -> f64 {
    if a * b > 0.0 { a.signum() * a.abs().min(b.abs()) } else { 0.0 }
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
            let found =
                on_a_thread(Level::best(), |runtime| SharedPart::new(&before, Shared::Pattern, runtime));
            let found = found.expect("memory");
            let (after, found) = (found.removed(&before).expect("memory"), found.strength());
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

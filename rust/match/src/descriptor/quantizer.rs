//! A spectral component -> the bits of its quantized phase (paper, eq. 3).
//!
//! Levels lie on a circle. Each is written in a Johnson code (a circular thermometer), whose Hamming distance
//! *is* the distance around the circle (eq. 4), for any number of bits. Each bit is the side of a line
//! through zero on which the component lies, so a code takes a few comparisons, the same for every pixel.
//! With two bits, for example:
//!
//! ```text
//! quadrant   1     2     3     4
//! code      00    01    11    10        # bit 0: left of the imaginary axis, bit 1: below the real axis
//! ```
//!
//! With a weak level, each real and each imaginary part is negative, weak or positive. Two bits mark it as
//! clearly negative and clearly positive, so opposite signs differ in both bits, a weak and a clear part in
//! one.

use std::array::from_fn;

use crate::descriptor::spectrum::{Lane, Word};
use crate::settings::Settings;

/// Tangents of the multiples of 90 / 8 degrees inside the first quadrant.
const TANGENTS: [f64; 7] = [
    0.198_912_367_379_658,
    0.414_213_562_373_095_05,
    0.668_178_637_919_298_9,
    1.0,
    1.496_605_762_665_489,
    2.414_213_562_373_095,
    5.027_339_492_125_846,
];

/// Cuts the complex plane into sectors and gives each a code.
///
/// The sectors of a quadrant begin where the quotient of the coordinates, correctly rounded, reaches a
/// tangent. It depends only on their ratio, so scaling an image changes nothing.
#[derive(Debug, Clone)]
pub struct Quantizer {
    /// The power `k` of the spectrum.
    power: usize,
    /// Bits of each code: half the number of levels.
    code_length: usize,
    /// Magnitude up to which a real or imaginary part of `F^k` is weak, a whole number; `None`: no weak
    /// level.
    weak: Option<f64>,
}

impl Quantizer {
    /// Sectors and codes for `b` bits of the phase of `F^k`.
    pub fn new(settings: &Settings) -> Self {
        let code_length = 1 << (settings.bits - 1);
        Self { power: settings.power, code_length, weak: None }
    }

    /// The quantizer with a weak level, for `b` = 2: parts of `F` are weak up to `threshold`, a whole number,
    /// and parts of `F^2` up to its square.
    pub fn with_weak_level(self, threshold: f64) -> Self {
        debug_assert!(self.code_length == 2 && threshold >= 0.0);
        Self { code_length: 4, weak: Some(threshold.powi(self.power as i32)), ..self }
    }

    /// Bits of one component's code, `2^(b-1)`; with a weak level 4.
    pub fn code_length(&self) -> usize {
        self.code_length
    }

    /// Writes the codes of one component of neighboring pixels into their words, from bit `shift` on. These
    /// bits must be 0. A boundary belongs to the sector counterclockwise of it, zero to the first sector.
    #[inline(always)]
    pub fn add<T: Lane>(&self, re: &[T], im: &[T], shift: usize, words: &mut [T::Word]) {
        if let Some(threshold) = self.weak {
            return self.add_three_levels(re, im, shift, words, threshold);
        }

        // If the diagonal is the only boundary, no division is needed. The maximum with 1 keeps zero below
        // it.
        let diagonal = |x: T, y: T| y.minus(if x < T::from(1) { T::from(1) } else { x });
        let quotient = |x: T, y: T| y.into() / x.into();
        let zero = T::default();
        let three = tangents::<3>();
        let seven = tangents::<7>();

        match (self.power, self.code_length) {
            (1, 1) => add_each(re, im, shift, words, |place| place.below.into()),
            (1, 2) => add_each(re, im, shift, words, |place| place.halves(quotient, [])),
            (1, 4) => add_each(re, im, shift, words, |place| place.halves(diagonal, [zero])),
            (1, 8) => add_each(re, im, shift, words, |place| place.halves(quotient, three)),
            (2, 1) => add_each(re, im, shift, words, |place| place.doubled(quotient, [])),
            (2, 2) => add_each(re, im, shift, words, |place| place.doubled(diagonal, [zero])),
            (2, 4) => add_each(re, im, shift, words, |place| place.doubled(quotient, three)),
            (2, 8) => add_each(re, im, shift, words, |place| place.doubled(quotient, seven)),
            _ => unreachable!("settings are checked"),
        }
    }

    /// Like [`Self::add`], with a weak level.
    #[inline(always)]
    fn add_three_levels<T: Lane>(
        &self,
        re: &[T],
        im: &[T],
        shift: usize,
        words: &mut [T::Word],
        threshold: f64,
    ) {
        let n = words.len();
        let (re, im) = (&re[..n], &im[..n]);

        if self.power == 1 {
            let bounds = [-threshold, threshold].map(T::nearest);
            for i in 0..n {
                words[i] = words[i] | three_levels::<T, T::Word>([re[i], im[i]], bounds) << shift;
            }
        } else {
            for i in 0..n {
                let parts = squared(re[i].into(), im[i].into());
                words[i] = words[i] | three_levels::<f64, T::Word>(parts, [-threshold, threshold]) << shift;
            }
        }
    }
}

/// The square of a component in double precision: the codes are defined by these parts, rounding included.
#[inline(always)]
fn squared(re: f64, im: f64) -> [f64; 2] {
    [(re - im) * (re + im), 2.0 * re * im]
}

/// The code of the parts of a component: bits 0 and 1 for those below the weak level, bits 2 and 3 for those
/// above it.
#[inline(always)]
fn three_levels<P: PartialOrd + Copy, W: Word>([re, im]: [P; 2], [low, high]: [P; 2]) -> W {
    let negative = W::from(re < low) | W::from(im < low) << 1;

    negative | W::from(re > high) << 2 | W::from(im > high) << 3
}

/// Tangents, rising, of the `B` boundaries that cut a quadrant into equal sectors.
#[inline(always)]
fn tangents<const B: usize>() -> [f64; B] {
    from_fn(|m| TANGENTS[(m + 1) * (TANGENTS.len() + 1) / (B + 1) - 1])
}

/// Writes the codes of one component of neighboring pixels, by their positions.
#[inline(always)]
fn add_each<T: Lane>(
    re: &[T],
    im: &[T],
    shift: usize,
    words: &mut [T::Word],
    code: impl Fn(PhasePosition<T>) -> T::Word,
) {
    let n = words.len();
    let (re, im) = (&re[..n], &im[..n]);

    for i in 0..n {
        words[i] = words[i] | code(PhasePosition::new(re[i], im[i])) << shift;
    }
}

/// The position of a component: its half planes, and its place in its quadrant.
///
/// A half plane includes the half of its border that begins it counterclockwise, but not zero.
#[derive(Debug, Clone, Copy)]
struct PhasePosition<T> {
    /// Left of the imaginary axis.
    left: bool,
    /// Below the real axis.
    below: bool,
    /// Coordinates after the quadrant is turned into the first one.
    turned: (T, T),
}

impl<T: Lane> PhasePosition<T> {
    #[inline(always)]
    fn new(re: T, im: T) -> Self {
        let zero = T::default();
        // Components are integers, so less than 1 means 0 or less, which includes the border.
        let bound = |with_border: bool| if with_border { T::from(1) } else { zero };
        let left = re < bound(im > zero);
        let below = im < bound(re < zero);

        let (x, y) = (re.magnitude(), im.magnitude());
        Self { left, below, turned: if left ^ below { (y, x) } else { (x, y) } }
    }

    /// In the second or the fourth quadrant.
    #[inline(always)]
    fn in_even_quadrant(self) -> bool {
        self.left ^ self.below
    }

    /// The code of the phase with `B` boundaries inside each quadrant: those whose bounds the `measure` of
    /// the coordinates reaches. Each bit stands for one of the half planes defined by the boundaries.
    #[inline(always)]
    fn halves<M: PartialOrd, const B: usize>(self, measure: impl Fn(T, T) -> M, bounds: [M; B]) -> T::Word {
        let even = self.in_even_quadrant();
        let below = self.below;
        let measured = measure(self.turned.0, self.turned.1);

        let mut code = T::Word::from(self.left) << B | T::Word::from(below) << (2 * B + 1);
        for (m, bound) in bounds.into_iter().enumerate() {
            let reached = measured >= bound;
            code = code | T::Word::from((even | reached) ^ below) << m;
            code = code | T::Word::from((even & reached) ^ below) << (B + 1 + m);
        }

        code
    }

    /// Like [`Self::halves`], for twice the phase: two quadrants make one full circle.
    #[inline(always)]
    fn doubled<M: PartialOrd, const B: usize>(self, measure: impl Fn(T, T) -> M, bounds: [M; B]) -> T::Word {
        let even = self.in_even_quadrant();
        let measured = measure(self.turned.0, self.turned.1);

        let mut code = T::Word::from(even) << B;
        for (m, bound) in bounds.into_iter().enumerate() {
            code = code | T::Word::from(even ^ (measured >= bound)) << m;
        }

        code
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math;

    #[test]
    fn tangents_are_those_of_an_eighth_of_a_right_angle() {
        for (m, tangent) in (1..).zip(TANGENTS) {
            let angle = std::f64::consts::FRAC_PI_2 * f64::from(m) / 8.0;
            let exact = math::sin(angle) / math::cos(angle);
            assert!((tangent / exact - 1.0).abs() < 1e-15, "{m}: {tangent}, {exact}");
        }
    }
}

//! A spectral component -> the bits of its quantized phase (paper, eq. 3).
//!
//! Levels lie on a circle. Each is written in a Johnson code (a circular thermometer), whose Hamming distance *is* the
//! distance around the circle (eq. 4), for any number of bits. Each bit says on which side of a line through zero the
//! component lies, so a code takes a few comparisons, the same for every pixel. With two bits, for example:
//!
//! ```text
//! quadrant   1     2     3     4
//! code      00    01    11    10        # bit 0: left of the imaginary axis, bit 1: below the real axis
//! ```
//!
//! With a weak level each real and each imaginary part is negative, weak or positive. Two bits say whether it is clearly
//! negative and whether it is clearly positive, so opposite signs differ in both bits, a weak and a clear part in one.

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

/// Cuts the complex plane into sectors and gives each its code.
///
/// The sectors of a quadrant begin where the quotient of its coordinates, correctly rounded, reaches a tangent. It depends
/// on their ratio only, so scaling an image changes nothing.
#[derive(Debug, Clone)]
pub struct Quantizer {
    /// The power `k` of the spectrum.
    power: usize,
    /// Bits of each code: half the number of levels.
    code_length: usize,
    /// Magnitude up to which a real or an imaginary part of `F^k` is weak, a whole number; `None`: none is.
    weak: Option<f64>,
}

impl Quantizer {
    /// Sectors and codes for `b` bits of the phase of `F^k`.
    pub fn new(settings: &Settings) -> Self {
        let code_length = 1 << (settings.bits - 1);
        Self { power: settings.power, code_length, weak: None }
    }

    /// The quantizer for which parts of `F` are weak up to `threshold`, a whole number, and those of `F^2` up to its
    /// square; for `b` = 2.
    pub fn with_weak_level(self, threshold: f64) -> Self {
        debug_assert!(self.code_length == 2 && threshold >= 0.0);
        Self { code_length: 4, weak: Some(threshold.powi(self.power as i32)), ..self }
    }

    /// Bits of one component's code, `2^(b-1)`; with a weak level 4.
    pub fn code_length(&self) -> usize {
        self.code_length
    }

    /// Reference implementation of [`Self::add`]: the code of the component `re + i im`. A boundary belongs to the sector
    /// counter-clockwise of it, zero to the first sector. With a weak level: the clearly negative parts, then the clearly
    /// positive ones.
    pub fn code(&self, re: i64, im: i64) -> u64 {
        if let Some(threshold) = self.weak {
            let [re, im] = if self.power == 1 {
                [re as f64, im as f64]
            } else {
                squared(re as f64, im as f64)
            };
            return three_levels::<f64, u64>([re, im], [-threshold, threshold]);
        }

        // Turns the quadrant into the first one.
        let (quadrant, x, y) = match (re, im) {
            (0, 0) => return 0,
            (1.., 0..) => (0, re, im),
            (..=0, 1..) => (1, im, -re),
            (..=-1, ..=0) => (2, -re, -im),
            (0.., ..=-1) => (3, -im, re),
        };

        let quotient = y as f64 / x as f64;

        // Boundaries strictly inside the first quadrant. Doubling the phase folds the circle: F^2 passes its levels twice
        // while F turns once.
        let tangents = match self.code_length * self.power / 2 {
            0 | 1 => vec![],
            2 => tangents::<1>().to_vec(),
            4 => tangents::<3>().to_vec(),
            _ => tangents::<7>().to_vec(),
        };
        let inside = tangents.iter().filter(|tangent| quotient >= **tangent).count();

        let levels = 2 * self.code_length;
        // For k = b = 1 two quadrants share a sector.
        let quadrants_per_sector = (4 / (levels * self.power)).max(1);
        let sector = (quadrant * (tangents.len() + 1) + inside) / quadrants_per_sector;
        johnson(sector % levels, self.code_length)
    }

    /// Writes the codes of one component of neighboring pixels into their words, from bit `shift` on. These bits must be 0.
    #[inline(always)]
    pub fn add<T: Lane>(&self, re: &[T], im: &[T], shift: usize, words: &mut [T::Word]) {
        if let Some(threshold) = self.weak {
            return self.add_three_levels(re, im, shift, words, threshold);
        }

        // With the diagonal as only boundary no division is needed. The maximum with 1 keeps zero below it.
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

    /// As [`Self::add`], with a weak level.
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
                words[i] = words[i]
                    | three_levels::<f64, T::Word>(parts, [-threshold, threshold]) << shift;
            }
        }
    }
}

/// The square of a component in double precision: the codes are defined by these parts, rounding included.
#[inline(always)]
fn squared(re: f64, im: f64) -> [f64; 2] {
    [(re - im) * (re + im), 2.0 * re * im]
}

/// The code of the parts of a component: bits 0 and 1 for those below the weak level, bits 2 and 3 for those above it.
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
/// A half plane includes the half of its border that begins it counter-clockwise, but not zero.
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
        // Components are integers, so less than 1 is 0 or less: that includes the border.
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

    /// The code of the phase with `B` boundaries inside each quadrant: those whose bounds the `measure` of the coordinates
    /// reaches. Each bit stands for one of the half planes that the boundaries open.
    #[inline(always)]
    fn halves<M: PartialOrd, const B: usize>(
        self,
        measure: impl Fn(T, T) -> M,
        bounds: [M; B],
    ) -> T::Word {
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

    /// As [`Self::halves`], of twice the phase: two quadrants are once around the circle.
    #[inline(always)]
    fn doubled<M: PartialOrd, const B: usize>(
        self,
        measure: impl Fn(T, T) -> M,
        bounds: [M; B],
    ) -> T::Word {
        let even = self.in_even_quadrant();
        let measured = measure(self.turned.0, self.turned.1);

        let mut code = T::Word::from(even) << B;
        for (m, bound) in bounds.into_iter().enumerate() {
            code = code | T::Word::from(even ^ (measured >= bound)) << m;
        }

        code
    }
}

/// The Johnson code of `level` on a circle of `2 * length` levels: ones enter at the low end until
/// the word is full, then zeros do.
fn johnson(level: usize, length: usize) -> u64 {
    let ones = |count: usize| (1u64 << count) - 1;
    if level < length { ones(level) } else { ones(length) & !ones(level - length) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;
    use crate::settings::presets::Preset;

    fn quantizer(power: usize, bits: usize) -> Quantizer {
        Quantizer::new(&Settings { power, bits, ..Preset::Paper.settings() })
    }

    #[test]
    fn hamming_distance_of_johnson_codes_is_the_distance_around_the_circle() {
        for bits in 1..=4 {
            let half = 1usize << (bits - 1);
            for (a, b) in (0..2 * half).flat_map(|a| (0..2 * half).map(move |b| (a, b))) {
                let apart = a.abs_diff(b);
                let around = apart.min(2 * half - apart);
                let hamming = (johnson(a, half) ^ johnson(b, half)).count_ones() as usize;

                assert_eq!(hamming, around, "b = {bits}: levels {a} and {b}");
            }
        }
    }

    #[test]
    fn two_bits_are_the_gray_code() {
        let codes: Vec<_> = (0..4).map(|level| johnson(level, 2)).collect();

        assert_eq!(codes, [0b00, 0b01, 0b11, 0b10]);
    }

    #[test]
    fn sectors_follow_the_argument() {
        for (power, bits) in [1, 2].into_iter().flat_map(|k| (1..=4).map(move |b| (k, b))) {
            let quantizer = quantizer(power, bits);
            let half = 1i64 << (bits - 1);

            for step in 0..720 {
                // Boundaries lie at multiples of 11.25 degrees, none of which this meets.
                let angle = (0.5 * f64::from(step) + 0.1).to_radians();
                let (re, im) = ((math::cos(angle) * 1e9) as i64, (math::sin(angle) * 1e9) as i64);
                let turned = angle * power as f64 / std::f64::consts::PI;
                let level = ((half as f64 * turned).floor() as i64).rem_euclid(2 * half);

                let expected = johnson(level as usize, half as usize);
                assert_eq!(quantizer.code(re, im), expected, "k = {power}, b = {bits}, {step}");
            }
        }
    }

    #[test]
    fn boundaries_are_where_they_should_be_to_a_millionth() {
        for (power, bits) in [1, 2].into_iter().flat_map(|k| (2..=4).map(move |b| (k, b))) {
            let sectors = power << bits;
            let code = |boundary: usize, off: f64| {
                let angle = std::f64::consts::TAU * boundary as f64 / sectors as f64 + off;
                quantizer(power, bits)
                    .code((math::cos(angle) * 1e12) as i64, (math::sin(angle) * 1e12) as i64)
            };

            for boundary in 0..sectors {
                let johnson = |sector: usize| johnson(sector % (1 << bits), 1 << (bits - 1));

                assert_eq!(code(boundary, 1e-6), johnson(boundary), "k = {power}, b = {bits}");
                assert_eq!(
                    code(boundary, -1e-6),
                    johnson(boundary + sectors - 1),
                    "k = {power}, b = {bits}"
                );
            }
        }
    }

    #[test]
    fn rows_of_either_arithmetic_hold_the_codes_of_their_components() {
        fn row<T: Lane>(quantizer: &Quantizer, components: &[(i32, i32)]) -> Vec<u64> {
            let re: Vec<T> = components.iter().map(|(re, _)| T::from(*re)).collect();
            let im: Vec<T> = components.iter().map(|(_, im)| T::from(*im)).collect();
            let mut words = vec![T::Word::default(); components.len()];
            quantizer.add(&re, &im, 3, &mut words);
            words.into_iter().map(|word| word.into() >> 3).collect()
        }

        let near = (-9..=9).flat_map(|re| (-9..=9).map(move |im| (re, im)));
        let far = near.clone().map(|(re, im)| (re * 150_000_001, im * 150_000_000));
        let components: Vec<_> = near.chain(far).collect();

        for (power, bits) in [1, 2].into_iter().flat_map(|k| (1..=4).map(move |b| (k, b))) {
            let quantizer = quantizer(power, bits);
            let code = |(re, im): &(i32, i32)| quantizer.code((*re).into(), (*im).into());
            let expected: Vec<_> = components.iter().map(code).collect();

            assert_eq!(row::<i32>(&quantizer, &components), expected, "k = {power}, b = {bits}");
            assert_eq!(row::<f64>(&quantizer, &components), expected, "k = {power}, b = {bits}");
        }

        for (power, threshold) in
            [1, 2].into_iter().flat_map(|k| [0.0, 4.0, 450_000_000.0, 1e12].map(|t| (k, t)))
        {
            let quantizer = quantizer(power, 2).with_weak_level(threshold);
            let code = |(re, im): &(i32, i32)| quantizer.code((*re).into(), (*im).into());
            let expected: Vec<_> = components.iter().map(code).collect();

            assert_eq!(
                row::<i32>(&quantizer, &components),
                expected,
                "k = {power}, t = {threshold}"
            );
            assert_eq!(
                row::<f64>(&quantizer, &components),
                expected,
                "k = {power}, t = {threshold}"
            );
        }
    }

    /// The levels of the parts of `(re + i im)^k` by whole numbers: -1, 0 or 1.
    fn levels(power: usize, re: i32, im: i32, threshold: i32) -> [i128; 2] {
        let [re, im, threshold] = [re, im, threshold].map(i128::from);
        let level = |part: i128, weak: i128| if part.abs() <= weak { 0 } else { part.signum() };

        match power {
            1 => [re, im].map(|part| level(part, threshold)),
            _ => [re * re - im * im, 2 * re * im].map(|part| level(part, threshold.pow(2))),
        }
    }

    #[test]
    fn parts_are_weak_up_to_the_threshold() {
        let places = (-9..=9).flat_map(|re| (-9..=9).map(move |im| (re, im)));
        let places: Vec<_> =
            places.flat_map(|(re, im)| [(re, im), (re * 9973, im * 10_007)]).collect();
        for (power, threshold) in [1, 2].into_iter().flat_map(|k| [0, 1, 3, 29_919].map(|t| (k, t)))
        {
            let quantizer = quantizer(power, 2).with_weak_level(threshold.into());
            for &(re, im) in &places {
                let code = quantizer.code(re.into(), im.into());
                let [a, b] = levels(power, re, im, threshold);
                let bits = [a < 0, b < 0, a > 0, b > 0].map(u64::from);
                let expected = (0..).zip(bits).map(|(place, bit)| bit << place).sum::<u64>();

                assert_eq!(code, expected, "k = {power}, t = {threshold}: {re}, {im}");
            }
        }
    }

    #[test]
    fn opposite_signs_differ_in_two_bits_and_weak_parts_from_clear_ones_in_one() {
        let quantizer = quantizer(1, 2).with_weak_level(2.0);
        let parts: Vec<_> =
            [-3, 0, 3].into_iter().flat_map(|re| [-3, 0, 3].map(|im| (re, im))).collect();

        for (a, b) in parts.iter().flat_map(|a| parts.iter().map(move |b| (a, b))) {
            let apart = (quantizer.code(a.0, a.1) ^ quantizer.code(b.0, b.1)).count_ones();

            assert_eq!(
                u64::from(apart),
                (a.0.abs_diff(b.0) + a.1.abs_diff(b.1)) / 3,
                "{a:?}, {b:?}"
            );
        }
    }

    #[test]
    fn tangents_are_those_of_an_eighth_of_a_right_angle() {
        for (m, tangent) in (1..).zip(TANGENTS) {
            let exact = math::tan(std::f64::consts::FRAC_PI_2 * f64::from(m) / 8.0);
            assert!((tangent / exact - 1.0).abs() < 1e-15, "{m}: {tangent}, {exact}");
        }
    }

    #[test]
    fn ties_are_those_of_floor_on_half_open_arguments() {
        let level = |re, im| quantizer(1, 2).code(re, im);
        assert_eq!(level(0, 0), johnson(0, 2), "zero");
        assert_eq!(level(5, 0), johnson(0, 2), "positive real axis");
        assert_eq!(level(0, 5), johnson(1, 2), "positive imaginary axis");
        assert_eq!(level(-5, 0), johnson(2, 2), "negative real axis: level -2");
        assert_eq!(level(0, -5), johnson(3, 2), "negative imaginary axis: level -1");
        assert_eq!(quantizer(1, 3).code(5, 5), johnson(1, 4), "the diagonal is exact");
    }
}

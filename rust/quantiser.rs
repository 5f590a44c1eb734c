//! A spectral component -> the bits of its quantised phase (paper, eq. 3).
//!
//! Levels lie on a circle. Each is written in a Johnson code (a circular thermometer), whose Hamming
//! distance *is* the distance around the circle (eq. 4), for any number of bits.

use std::f64::consts::FRAC_PI_2;

use crate::settings::Settings;

/// Amplitude of the boundaries' direction vectors, as a power of two.
const DIRECTION_LOG2: u32 = 30;

/// Cuts the complex plane into sectors and names each by its code.
#[derive(Debug, Clone)]
pub struct Quantiser {
    /// Directions of the boundaries strictly inside the first quadrant: (cosine, sine), rising.
    boundaries: Vec<(i128, i128)>,
    /// Sectors that share one quadrant; or, below one, quadrants that share a sector.
    quadrants_per_sector: usize,
    /// Code of each sector, counter-clockwise from the positive real axis.
    codes: Vec<u64>,
    /// Bits of each code.
    code_length: usize,
}

impl Quantiser {
    /// Sectors and codes for `b` bits of the phase of `F^k`.
    pub fn new(settings: &Settings) -> Self {
        let levels = 1 << settings.bits;
        // Doubling the phase folds the circle onto itself: F^2 passes its levels twice while F turns once.
        let sectors = levels * settings.power;
        let per_quadrant = (sectors / 4).max(1);
        let direction = |m: usize| {
            let angle = FRAC_PI_2 * m as f64 / per_quadrant as f64;
            let scaled = |value: f64| (value * f64::from(1u32 << DIRECTION_LOG2)).round() as i128;
            (scaled(angle.cos()), scaled(angle.sin()))
        };
        Self {
            boundaries: (1..per_quadrant).map(direction).collect(),
            quadrants_per_sector: (4 / sectors).max(1),
            codes: (0..sectors).map(|sector| johnson(sector % levels, levels / 2)).collect(),
            code_length: levels / 2,
        }
    }

    /// Bits of one component's code, `2^(b-1)`.
    pub fn code_length(&self) -> usize {
        self.code_length
    }

    /// Code of the component `re + i im`; a boundary belongs to the sector counter-clockwise of it, and
    /// zero to the first sector.
    pub fn code(&self, re: i128, im: i128) -> u64 {
        let (quadrant, x, y) = match (re, im) {
            (0, 0) => return self.codes[0],
            (1.., 0..) => (0, re, im),
            (..=0, 1..) => (1, im, -re),
            (..=-1, ..=0) => (2, -re, -im),
            (0.., ..=-1) => (3, -im, re),
        };
        let inside = self.boundaries.iter().filter(|(cos, sin)| y * cos >= x * sin).count();
        let sector = quadrant * (self.boundaries.len() + 1) / self.quadrants_per_sector + inside;
        self.codes[sector]
    }
}

/// The Johnson code of `level` on a circle of `2 * length` levels: ones enter at the low end until the
/// word is full, then leave there.
fn johnson(level: usize, length: usize) -> u64 {
    let ones = |count: usize| (1u64 << count) - 1;
    if level < length { ones(level) } else { ones(length) & !ones(level - length) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantiser(power: usize, bits: usize) -> Quantiser {
        Quantiser::new(&Settings { power, bits, ..Settings::default() })
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
            let (quantiser, half) = (quantiser(power, bits), 1i64 << (bits - 1));
            for step in 0..720 {
                // Boundaries lie at multiples of 11.25 degrees, none of which this meets.
                let angle = (0.5 * f64::from(step) + 0.1).to_radians();
                let (re, im) = ((angle.cos() * 1e9) as i128, (angle.sin() * 1e9) as i128);
                let turned = angle * power as f64 / std::f64::consts::PI;
                let level = ((half as f64 * turned).floor() as i64).rem_euclid(2 * half);
                let expected = johnson(level as usize, half as usize);
                assert_eq!(quantiser.code(re, im), expected, "k = {power}, b = {bits}, {step}");
            }
        }
    }

    #[test]
    fn boundaries_are_where_they_should_be_to_a_millionth() {
        for (power, bits) in [1, 2].into_iter().flat_map(|k| (2..=4).map(move |b| (k, b))) {
            let sectors = power << bits;
            let code = |boundary: usize, off: f64| {
                let angle = std::f64::consts::TAU * boundary as f64 / sectors as f64 + off;
                quantiser(power, bits)
                    .code((angle.cos() * 1e12) as i128, (angle.sin() * 1e12) as i128)
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
    fn ties_are_those_of_floor_on_half_open_arguments() {
        let level = |re, im| quantiser(1, 2).code(re, im);
        assert_eq!(level(0, 0), johnson(0, 2), "zero");
        assert_eq!(level(5, 0), johnson(0, 2), "positive real axis");
        assert_eq!(level(0, 5), johnson(1, 2), "positive imaginary axis");
        assert_eq!(level(-5, 0), johnson(2, 2), "negative real axis: level -2");
        assert_eq!(level(0, -5), johnson(3, 2), "negative imaginary axis: level -1");
        assert_eq!(quantiser(1, 3).code(5, 5), johnson(1, 4), "the diagonal is exact");
    }
}

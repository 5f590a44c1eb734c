//! Codes of phases: the reference by angles and whole numbers, the core compared with the reference.

use crate::reference::quantize;
use phasestereo_match::base::math;
use phasestereo_match::descriptor::quantizer::Quantizer;
use phasestereo_match::descriptor::spectrum::Lane;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;

/// Every power of the spectrum with every number of bits.
fn kinds() -> impl Iterator<Item = (usize, usize)> {
    [1, 2].into_iter().flat_map(|power| (1..=4).map(move |bits| (power, bits)))
}

/// The Johnson code of a level: ones enter a word of half as many bits as levels at the low end, then zeros
/// do.
fn johnson(level: usize, bits: usize) -> u64 {
    let length = 1usize << (bits - 1);
    (0..length).map(|bit| u64::from((bit + 1..=bit + length).contains(&level)) << bit).sum()
}

#[test]
fn hamming_distance_of_codes_is_the_distance_around_the_circle() {
    for bits in 1..=4 {
        let levels = 1usize << bits;
        for (a, b) in (0..levels).flat_map(|a| (0..levels).map(move |b| (a, b))) {
            let around = a.abs_diff(b).min(levels - a.abs_diff(b));
            let hamming = (johnson(a, bits) ^ johnson(b, bits)).count_ones() as usize;

            assert_eq!(hamming, around, "b = {bits}: levels {a} and {b}");
        }
    }
}

#[test]
fn sectors_follow_the_argument_to_a_millionth() {
    for (power, bits) in kinds() {
        let sectors = power << bits;
        let code = |angle: f64| {
            let part = |value: f64| (value * 1e12) as i64;
            quantize(part(math::cos(angle)), part(math::sin(angle)), (power, bits), None).0
        };

        for boundary in 0..sectors {
            let angle = std::f64::consts::TAU * boundary as f64 / sectors as f64;
            let [before, after] =
                [boundary + sectors - 1, boundary].map(|sector| johnson(sector % (1 << bits), bits));
            let inside = std::f64::consts::PI / sectors as f64;

            assert_eq!(code(angle + 1e-6), after, "k = {power}, b = {bits}, from {boundary}");
            assert_eq!(code(angle + inside), after, "k = {power}, b = {bits}, in {boundary}");
            assert_eq!(code(angle - 1e-6), before, "k = {power}, b = {bits}, up to {boundary}");
        }
    }
}

#[test]
fn a_boundary_belongs_to_the_sector_after_it_and_zero_to_the_first_one() {
    let code = |re, im| quantize(re, im, (1, 2), None).0;
    let axes = [(0, 0), (5, 0), (0, 5), (-5, 0), (0, -5)].map(|(re, im)| code(re, im));

    assert_eq!(axes, [0b00, 0b00, 0b01, 0b11, 0b10]);
    assert_eq!(quantize(5, 5, (1, 3), None).0, johnson(1, 3), "the diagonal is exact");
}

#[test]
fn parts_are_weak_up_to_the_threshold() {
    // Negative, weak or positive: the parts of `(re + i im)^k`, by whole numbers.
    let level = |part: i64, weak: i64| if part.abs() <= weak { 0 } else { part.signum() };
    let places = (-9i64..=9).flat_map(|re| (-9..=9).map(move |im| (re, im)));
    let places: Vec<_> = places.flat_map(|(re, im)| [(re, im), (re * 9973, im * 10_007)]).collect();

    for (power, weak) in [1, 2].into_iter().flat_map(|k| [0, 1, 3, 29_919].map(|t| (k, t))) {
        for &(re, im) in &places {
            let [a, b] = match power {
                1 => [level(re, weak), level(im, weak)],
                _ => [re * re - im * im, 2 * re * im].map(|part| level(part, weak * weak)),
            };
            let bits = [a < 0, b < 0, a > 0, b > 0].map(u64::from);
            let expected = bits.iter().rev().fold(0, |code, bit| code << 1 | bit);

            let found = quantize(re, im, (power, 2), Some(weak as f64));
            assert_eq!(found, (expected, 4), "k = {power}, t = {weak}: {re}, {im}");
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
    let weak = [0.0, 4.0, 450_000_000.0, 1e12].map(Some).into_iter();
    let weak: Vec<_> = weak.flat_map(|weak| [((1, 2), weak), ((2, 2), weak)]).collect();

    for (kind, weak) in kinds().map(|kind| (kind, None)).chain(weak) {
        let settings = Settings { power: kind.0, bits: kind.1, ..Preset::Paper.settings() };
        let quantizer = Quantizer::new(&settings);
        let quantizer = match weak {
            Some(threshold) => quantizer.with_weak_level(threshold),
            None => quantizer,
        };
        let code = |(re, im): &(i32, i32)| quantize((*re).into(), (*im).into(), kind, weak);
        let expected: Vec<_> = components.iter().map(code).collect();

        assert!(expected.iter().all(|(_, length)| *length == quantizer.code_length()));
        let expected: Vec<_> = expected.into_iter().map(|(code, _)| code).collect();
        assert_eq!(row::<i32>(&quantizer, &components), expected, "{kind:?}, {weak:?}");
        assert_eq!(row::<f64>(&quantizer, &components), expected, "{kind:?}, {weak:?}");
    }
}

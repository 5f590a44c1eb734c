//! Codes: the separable, banded, threaded computation at every level, compared with the double sum of the
//! definition.

use crate::common::naive::weak_threshold;
use crate::common::{descriptors, every_descriptor, grays, noise, noises, random, weak_descriptors};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::descriptor::basis::ROUGH_REACH;
use phasestereo_match::descriptor::{Codes, describe, describe_roughly};
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::matcher::on_threads;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{Settings, Taper};
use proptest::prelude::*;

/// The largest magnitude that a plane may declare.
const REACH: u32 = 1 << 25;

/// Codes of a plane, which must be the same in either arithmetic and at every level of this machine.
fn codes(plane: &Plane<i32>, settings: &Settings) -> Codes {
    noisy_codes(plane, settings, 0.0)
}

/// The codes of a plane whose noise has this deviation.
fn noisy_codes(plane: &Plane<i32>, settings: &Settings, noise: f64) -> Codes {
    let largest = plane.as_slice().iter().map(|value| value.unsigned_abs()).max();

    let mut found = [largest.expect("a pixel"), REACH].into_iter().flat_map(|reach| {
        let gray = Gray::within(reach, plane.clone());
        Level::all().filter_map(move |(name, level)| {
            let codes = describe(&gray, settings, Some(noise), level?, &Control::default());
            Some((name, codes.expect("not cancelled")))
        })
    });

    let (_, first) = found.next().expect("a level");
    found.for_each(|(name, codes)| assert_eq!(codes, first, "{name}, {settings:?}"));

    first
}

#[test]
fn every_family_equals_its_definition() {
    for (name, _) in Level::all().filter(|(_, level)| level.is_none()) {
        println!("{name}: not run, this machine does not have it");
    }

    let gray = noise(4, 5);

    for settings in [3, 5, 7, 9, 11].into_iter().flat_map(every_descriptor) {
        let expected = reference::describe(&gray, &settings, 0.0);
        assert_eq!(codes(&gray, &settings).widened(), expected, "{settings:?}");
    }
}

#[test]
fn rough_codes_equal_their_definition() {
    let gray = noise(9, 37);
    let settings = Settings { neighborhood: 3, frequencies: (1, 1), ..Preset::Paper.settings() };
    for (name, level) in Level::all().filter_map(|(name, level)| Some((name, level?))) {
        let gray = Gray::within(ROUGH_REACH, gray.clone());
        let codes = describe_roughly(&gray, &settings, level, &Control::default()).expect("not cancelled");
        let expected = reference::describe_roughly(gray.plane(), &settings);
        assert_eq!(codes.map(|&code| code.into()), expected, "{name}");
    }
}

#[test]
fn rows_of_any_length_equal_their_definition() {
    // Besides awkward lengths: more columns than are computed together.
    for cols in [1, 2, 15, 16, 17, 1023, 1024, 1025, 1041] {
        let gray = noise(2, cols);

        for settings in [3, 7, 63].map(|neighborhood| Settings {
            neighborhood,
            frequencies: (1, 1),
            ..Preset::Paper.settings()
        }) {
            assert_eq!(codes(&gray, &settings).widened(), reference::describe(&gray, &settings, 0.0));
        }
    }
}

#[test]
fn the_largest_neighborhood_holds_the_brightest_image() {
    let extremes = Plane::from_fn(3, 70, |_, x| if x % 3 == 0 { 32_767_500 } else { -32_767_500 });
    for taper in [Taper::Uniform, Taper::Gaussian, Taper::Hann] {
        let settings =
            Settings { neighborhood: 63, taper, frequencies: (4, 4), bits: 1, ..Preset::Paper.settings() };
        assert_eq!(codes(&extremes, &settings).widened(), reference::describe(&extremes, &settings, 0.0));
    }
}

#[test]
fn the_strongest_component_there_can_be_does_not_overflow() {
    // A square wave in step with u = 4: rows and columns of one sign add up to 2 / pi of the largest sum.
    let wave = |x: usize| math::cos(std::f64::consts::TAU * 4.0 * x as f64 / 63.0) > 0.0;
    let gray = Plane::from_fn(1, 126, |_, x| if wave(x) { 32_767_500 } else { -32_767_500 });

    let settings = Settings { neighborhood: 63, frequencies: (4, 0), bits: 4, ..Preset::Paper.settings() };

    assert_eq!(codes(&gray, &settings).widened(), reference::describe(&gray, &settings, 0.0));
}

/// The definition, including tables and their rounding, is part of the format of stored codes.
#[test]
fn codes_are_those_of_every_version() {
    let gray = noise(40, 50);
    let digest = |taper, neighborhood, bits| {
        let settings = Settings { taper, neighborhood, bits, ..Preset::Paper.settings() };
        let codes = codes(&gray, &settings).widened();
        codes
            .as_slice()
            .iter()
            .fold(0xcbf2_9ce4_8422_2325u64, |hash, &code| (hash ^ code).wrapping_mul(0x0100_0000_01b3))
    };

    let cases = [
        (Taper::Uniform, 7, 2),
        (Taper::Uniform, 15, 4),
        (Taper::Uniform, 63, 2),
        (Taper::Gaussian, 9, 3),
        (Taper::Hann, 9, 3),
    ];
    let found =
        cases.map(|(taper, neighborhood, bits)| format!("{:016x}", digest(taper, neighborhood, bits)));
    let known =
        ["6b1370774e5aec1c", "2021661834640c57", "cf851e9992b59aa2", "59f534626beaa2ef", "83a4eb98aa243dec"];
    assert_eq!(found, known);
}

#[test]
fn bands_and_threads_leave_no_seam() {
    let gray = noise(300, 9);
    for taper in [Taper::Uniform, Taper::Hann] {
        let settings = Settings { taper, ..Preset::Paper.settings() };

        let expected = reference::describe(&gray, &settings, 0.0);
        for threads in 1..=8 {
            let found = on_threads(threads, || codes(&gray, &settings)).expect("threads start");
            assert_eq!(found.widened(), expected, "{threads} threads");
        }
    }
}

#[test]
fn words_are_the_narrowest_that_hold_the_code() {
    let gray = noise(2, 2);
    let with = |frequencies, bits| {
        codes(&gray, &Settings { neighborhood: 9, frequencies, bits, ..Preset::Paper.settings() })
    };

    assert!(matches!(with((2, 1), 2), Codes::U16(_)), "14 bits");
    assert!(matches!(with((2, 0), 4), Codes::U16(_)), "16 bits");
    assert!(matches!(with((1, 1), 4), Codes::U32(_)), "32 bits");
    assert!(matches!(with((2, 1), 4), Codes::U64(_)), "56 bits");
}

#[test]
fn flat_images_have_the_code_of_zero() {
    for settings in [3, 7, 15].into_iter().flat_map(every_descriptor) {
        let flat = codes(&Plane::from_fn(5, 6, |_, _| 12_345), &settings).widened();
        assert!(flat.as_slice().iter().all(|&code| code == 0), "{settings:?}");
    }
}

#[test]
fn a_cancelled_description_stops() {
    let control = Control::default();
    control.cancel();

    let gray = Gray::within(REACH, noise(3, 3));
    let stopped = describe(&gray, &Preset::Paper.settings(), None, Level::best(), &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

#[test]
fn a_weak_level_needs_the_noise() {
    let settings = Settings { noise_threshold: 1.0, ..Preset::Paper.settings() };
    let gray = Gray::within(REACH, noise(3, 3));
    let refused = |noise| {
        let codes = describe(&gray, &settings, noise, Level::best(), &Control::default());
        codes.expect_err("must be refused").to_string()
    };

    assert!(refused(None).starts_with("noise: got None; accepts"));

    for value in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(Some(value)).starts_with("noise: got"));
    }
}

#[test]
fn noise_of_its_own_deviation_is_weak_to_two_thirds() {
    // Uniform noise of 256 levels: the sums of many pixels are normal, and 68 % lie within one deviation.
    let gray = noise(200, 200);
    let deviation = 256.0 / 12f64.sqrt();

    for taper in [Taper::Uniform, Taper::Gaussian, Taper::Hann] {
        let settings = Settings {
            taper,
            neighborhood: 9,
            frequencies: (2, 2),
            noise_threshold: 1.0,
            ..Preset::Paper.settings()
        };

        let clear: u32 = noisy_codes(&gray, &settings, deviation)
            .widened()
            .as_slice()
            .iter()
            .map(|code| code.count_ones())
            .sum();

        let parts = 200.0 * 200.0 * 2.0 * settings.components() as f64;
        let weak = 1.0 - f64::from(clear) / parts;

        let about = if taper == Taper::Uniform { 0.66..0.70 } else { 0.6..0.8 };
        assert!(about.contains(&weak), "{taper:?}: {weak}");
    }
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn any_weak_level_equals_its_definition(
        gray in grays(10),
        settings in weak_descriptors(),
        noise in noises(),
    ) {
        let threshold =
            weak_threshold(&Gray::within(REACH, gray.clone()), &settings, noise[0]);

        let expected = reference::describe(&gray, &settings, threshold);
        prop_assert_eq!(noisy_codes(&gray, &settings, noise[0]).widened(), expected);
    }

    #[test]
    fn any_image_equals_its_definition(gray in grays(12), settings in descriptors()) {
        prop_assert_eq!(codes(&gray, &settings).widened(), reference::describe(&gray, &settings, 0.0));
    }

    #[test]
    fn offset_and_scale_change_no_code(
        gray in grays(9),
        settings in descriptors(),
        offset in -100_000..100_000,
        factor in 2..7,
    ) {
        let small = gray.map(|value| value / 8);
        let changed = small.map(|value| value * factor + offset);
        prop_assert_eq!(codes(&small, &settings), codes(&changed, &settings));
    }
}

//! The interface of the crate returns the results of the stages, and its errors name the arguments.

use phasestereo::internals::estimation::facts::{Fact, Facts};
use phasestereo::internals::match_pair::match_pair;
use phasestereo::{Error, Image, Matcher, Preset, verdict};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{self, Input};
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{self, Execution};
use phasestereo_match::pair::Pair;

const SIZE: (usize, usize) = (80, 120);

/// Texture, moved left by this many columns.
fn texture(shift: usize) -> Vec<u8> {
    let (rows, cols) = SIZE;
    let gray = |i: usize| ((i % cols + shift) * 89 % 251) as u8 ^ (i / cols * 37 % 256) as u8;
    (0..rows * cols).map(gray).collect()
}

fn images() -> [Image; 2] {
    [0, 5].map(|shift| Image::from_vec(texture(shift), SIZE).expect("an image"))
}

#[test]
fn a_match_of_slices_is_that_of_the_stages() {
    let settings = Preset::Robust.settings();
    let [left, right] = images();
    let matcher = Matcher::new(settings.clone(), 2).expect("a matcher");
    let found = matcher.match_pair(left, right, 0..16).expect("a match");

    let (rows, cols) = SIZE;
    let input = |shift| {
        let pixels = ndarray::Array3::from_shape_vec((rows, cols, 1), texture(shift));
        Input::from(pixels::Image::U8(pixels.expect("so many pixels")))
    };
    let pair = Pair::of_inputs([input(0), input(5)], 0, 16).expect("a pair");
    let candidates = Some(Fact::given(pair.candidates()));
    let facts = &Facts { candidates, ..Facts::default() };
    let core = matcher::Matcher::new(1).expect("a matcher");
    let execution = Execution { threads: 1, level: Level::best() };
    let runtime = Runtime { matcher: &core, execution, control: &Control::default() };
    let whole = match_pair(pair, facts, &settings, runtime).expect("a match");
    let (map, estimates) = (whole.map, whole.prepared.estimates);
    assert!(found.rectified.is_none() && whole.rectified.is_none(), "its rows correspond");

    let bits = |plane: &phasestereo::Plane<f32>| -> Vec<u32> {
        plane.as_slice().iter().map(|value| value.to_bits()).collect()
    };
    assert_eq!(bits(&found.disparity), bits(&map.disparity));
    assert_eq!(found.flags, map.flags);
    assert_eq!(found.confidence.as_ref().map(bits), map.confidence.as_ref().map(bits));
    assert_eq!(found.estimates.findings, estimates.findings);
    assert_eq!(found.estimates.disparities(), 0..16);
}

#[test]
fn the_map_of_the_right_image_is_that_of_the_exchanged_mirrored_pair() {
    let (rows, cols) = SIZE;
    let back = |i: usize| i / cols * cols + cols - 1 - i % cols;
    let colors: [Vec<u16>; 2] = [0, 5].map(|shift| {
        let gray = texture(shift).into_iter().map(u16::from);
        gray.flat_map(|value| [value, 2 * value, 300 - value]).collect()
    });
    let valid: Vec<bool> = (0..rows * cols).map(|i| i % cols < 100).collect();
    let [left, right] = colors.each_ref().map(|pixels| {
        let image = Image::from_slice(pixels, SIZE).expect("an image");
        image.with_mask(&valid).expect("a mask")
    });
    let mirrored = colors.each_ref().map(|pixels| {
        let pixel = |i: usize| &pixels[3 * back(i)..][..3];
        let pixels: Vec<u16> = (0..rows * cols).flat_map(pixel).copied().collect();
        let valid: Vec<bool> = (0..rows * cols).map(|i| valid[back(i)]).collect();
        Image::from_slice(&pixels, SIZE).expect("an image").with_mask(&valid).expect("a mask")
    });

    for preset in [Preset::Robust, Preset::Fast] {
        let matcher = Matcher::new(preset.settings(), 2).expect("a matcher");
        let found = matcher.match_right(left.clone(), right.clone(), 0..16).expect("a match");
        let [first, second] = mirrored.clone();
        let expected = matcher.match_pair(second, first, 0..16).expect("a match");
        let same = |map: &phasestereo::Plane<f32>, other: &phasestereo::Plane<f32>| {
            (0..rows * cols).all(|i| map.as_slice()[i].to_bits() == other.as_slice()[back(i)].to_bits())
        };
        assert!(same(&found.disparity, &expected.disparity));
        let both = [(&found.confidence, &expected.confidence), (&found.uncertainty, &expected.uncertainty)];
        assert!(both.iter().all(|(own, other)| match (own, other) {
            (Some(own), Some(other)) => same(own, other),
            (own, other) => own.is_none() && other.is_none(),
        }));
        assert!((0..rows * cols).all(|i| found.flags.as_slice()[i] == expected.flags.as_slice()[back(i)]));
        assert!((found.disparity.row(40)[60] - 5.0).abs() < 0.25, "right less left columns");
    }
}

#[test]
fn masked_pixels_have_no_disparity() {
    let [left, right] = images();
    let valid: Vec<bool> = (0..SIZE.0 * SIZE.1).map(|i| i % SIZE.1 < 100).collect();
    let left = left.with_mask(&valid).expect("a mask");

    let matcher = Matcher::new(Preset::Fast.settings(), 1).expect("a matcher");
    let found = matcher.match_pair(left, right, 0..16).expect("a match");

    assert!(found.disparity.row(40)[100..].iter().all(|value| value.is_nan()));
    assert!(found.disparity.row(40)[20..90].iter().all(|value| (value - 5.0).abs() < 1.0));
}

#[test]
fn the_range_is_estimated_unless_it_is_given() {
    let matcher = Matcher::new(Preset::Robust.settings(), 1).expect("a matcher");

    let [left, right] = images();
    let estimates = matcher.check(left, right, None).expect("estimates");
    assert!(estimates.range.is_some() || estimates.disparities() == (0..40), "a third of the width");

    let [left, right] = images();
    let estimates = matcher.check(left, right, -3..9).expect("estimates");
    assert_eq!(estimates.disparities(), -3..9);
}

#[test]
fn a_map_is_refuted_where_the_images_say_so() {
    let matcher = Matcher::new(Preset::Robust.settings(), 1).expect("a matcher");
    let judged = |claim: f32| {
        let [left, right] = images();
        let map = phasestereo::Plane::from_fn(SIZE.0, SIZE.1, |_, _| claim);
        matcher.verify(left, right, &map).expect("a verification").verdicts
    };

    assert_eq!(judged(5.0).row(40)[60], verdict::SUPPORTED);
    assert_eq!(judged(12.0).row(40)[60], verdict::REFUTED);
}

#[test]
fn what_is_refused_is_named() {
    let matcher = Matcher::new(Preset::Fast.settings(), 1).expect("a matcher");
    let refused = |error: Error| error.to_string();

    let [left, right] = images();
    let message = matcher.match_pair(left, right, 0..0).map_err(refused).expect_err("no disparity");
    assert!(message.starts_with("num_disparities: got 0"), "{message}");

    let [left, _] = images();
    let other = Image::from_slice(&[0u8; 12], (3, 4)).expect("an image");
    let message = matcher.match_pair(left, other, 0..4).map_err(refused).expect_err("sizes");
    assert!(message.starts_with("right: got 3 x 4 pixels"), "{message}");

    let message = Matcher::new(Preset::Fast.settings(), 0).map_err(refused).expect_err("threads");
    assert!(message.starts_with("threads: got 0"), "{message}");

    let mut settings = Preset::Fast.settings();
    settings.set("window", "4").expect("a number");
    assert!(Matcher::new(settings.clone(), 1).map_err(refused).expect_err("even").contains("window"));
    assert!(settings.set("no such", "4").map_err(refused).expect_err("no field").contains("median"));

    let control = phasestereo::Control::default();
    control.cancel();
    let [left, right] = images();
    let ended = matcher.match_controlled(left, right, 0..16, &control);
    assert_eq!(ended.expect_err("cancelled"), Error::Cancelled);
}

//! Confidences: rows of all pixels at once compared with each pixel by itself, and the meaning of
//! confidences.

#![allow(clippy::float_cmp, reason = "what is compared for equality is exact by its definition")]

use crate::common::maps::drawn;
use crate::common::{at_every_level, hash, levels, random};
use crate::reference::{self, RawMap};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::texture::{Roughness, Texture};
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::calibration::{
    ConfidenceCalibration, Faults, Tally, Weights, sampled, traits,
};
use phasestereo_match::refinement::confidence::{CostMargin, VotedMap, confidence, similar, vote};
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::Optimizer;
use proptest::prelude::*;

/// The planes of a map with votes.
#[derive(Debug)]
struct Planes {
    disparity: Plane<f32>,
    votes: Plane<f32>,
    texture: Texture<'static>,
}

impl Planes {
    fn map(&self) -> VotedMap<'_> {
        VotedMap { disparity: &self.disparity, votes: &self.votes, texture: &self.texture }
    }

    /// The confidences, which must be the same at every level.
    fn confidences(&self) -> Plane<f32> {
        let control = Control::default();
        drawn(&self.disparity, |out, level| self.map().confidences(out, level, &control))
    }

    /// A flat surface, on which all votes are the same.
    fn flat((rows, cols): (usize, usize), vote: f32) -> Self {
        Self {
            disparity: Plane::from_fn(rows, cols, |_, _| 7.0),
            votes: Plane::from_fn(rows, cols, |_, _| vote),
            texture: Texture::new(Plane::from_fn(rows, cols, |y, x| (hash(1, y, x) % 256) as i32)),
        }
    }
}

fn planes() -> impl Strategy<Value = Planes> {
    let width = prop_oneof![1usize..=11, Just(40)];
    let contrast = prop_oneof![Just(1u64), Just(2), Just(256), Just(1 << 30)];
    let size = (1usize..=20, width);
    (size, contrast, any::<u64>()).prop_map(|((rows, cols), contrast, seed)| Planes {
        // Quarters of pixels, so that some differ by just 1; some are missing.
        disparity: Plane::from_fn(rows, cols, |y, x| match hash(seed, y, x) % 20 {
            0 => f32::NAN,
            part => part as f32 / 4.0,
        }),
        votes: Plane::from_fn(rows, cols, |y, x| (hash(!seed, y, x) % 101) as f32 / 100.0),
        texture: Texture::new(Plane::from_fn(rows, cols, |y, x| {
            (hash(seed.rotate_left(32), y, x) % contrast) as i32
        })),
    })
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn every_pixel_equals_the_reference(planes in planes()) {
        let found = planes.confidences();

        prop_assert_eq!(&found, &reference::confidences(planes.map()));
        prop_assert!(found.as_slice().iter().all(|confidence| (0.0..=1.0).contains(confidence)));

        let missing = planes.disparity.as_slice().iter().zip(found.as_slice());
        prop_assert!(missing.filter(|(d, _)| d.is_nan()).all(|(_, confidence)| *confidence == 0.0));
    }

    #[test]
    fn votes_that_all_agree_are_the_support(rows in 1usize..20, cols in 1usize..20, percent in 0u8..=100) {
        let share = f32::from(percent) / 100.0;
        let found = Planes::flat((rows, cols), share).confidences();

        let expected = confidence(share);
        prop_assert!(found.as_slice().iter().all(|found| (found - expected).abs() < 1e-5));
    }

    #[test]
    fn neither_contrast_nor_brightness_matters(seed in any::<u64>()) {
        let mut planes = Planes::flat((12, 12), 0.5);
        planes.disparity = Plane::from_fn(12, 12, |y, x| (hash(seed, y, x) % 9) as f32);

        let found = planes.confidences();

        planes.texture = Texture::new(planes.texture.gray.map(|gray| 64 * gray + 1000));
        let scaled = planes.confidences();

        let pairs = found.as_slice().iter().zip(scaled.as_slice());
        prop_assert!(pairs.into_iter().all(|(one, other)| (one - other).abs() < 1e-5));
    }

    #[test]
    fn a_vote_grows_with_the_cost_margin(
        own in 0u32..1 << 30,
        ahead in 0u32..1 << 30,
        unit in 1u16..,
    ) {
        let unit = f32::from(unit);
        let margin = |ahead| CostMargin { best: own, second_best: Some(own + ahead) };

        let [less, more] = [ahead, 2 * ahead + 1].map(|ahead| vote(margin(ahead), unit));

        prop_assert!(0.0 <= less && less <= more && more <= 1.0);
    }
}

#[test]
fn half_a_vote_is_four_units_ahead() {
    let margin = |best, second_best| CostMargin { best, second_best };
    assert_eq!(vote(margin(100, Some(900)), 200.0), 0.5);
    assert_eq!(vote(margin(0, Some(0)), 200.0), 0.0);
    assert_eq!(vote(margin(100, None), 200.0), 0.0, "there is no other candidate");
    assert_eq!(vote(margin(100, Some(90)), 200.0), 0.0, "another candidate is cheaper");
}

#[test]
fn half_of_the_disparities_with_the_support_of_a_fifth_are_right() {
    assert_eq!(confidence(0.0), 0.0);
    assert!((confidence(0.215_443_47) - 0.5).abs() < 1e-6);
    assert!((confidence(1.0) - 1.0 / 1.01).abs() < 1e-6);
}

#[test]
fn differences_count_relative_to_the_mean_one() {
    let ramp = Plane::from_fn(3, 5, |y, x| (10 * x + 1000 * y) as i32);
    let similar = |gray: &Plane<i32>| similar(Roughness::of_rows(gray.as_slice(), gray.cols()));

    assert_eq!(similar(&ramp), 400.0, "twice 10, squared");
    assert_eq!(similar(&ramp.map(|_| 3)), 1.0, "at least one step");
    assert_eq!(similar(&Plane::from_fn(4, 1, |y, _| y as i32)), 1.0, "no neighbors");
}

#[test]
fn a_firm_pixel_that_stands_alone_is_not_trusted_and_a_weak_one_among_firm_ones_is() {
    let mut planes = Planes::flat((11, 11), 0.6);
    planes.texture = Texture::new(planes.texture.gray.map(|_| 100));
    planes.disparity.row_mut(5)[5] = 9.0;
    planes.votes.row_mut(5)[5] = 1.0;

    let alone = planes.confidences();

    assert!(alone.row(5)[5] < 0.01 && alone.row(5)[4] > 0.9);

    planes.disparity.row_mut(5)[5] = 7.0;
    planes.votes.row_mut(5)[5] = 0.0;

    assert!(planes.confidences().row(5)[5] > 0.9);
}

#[test]
fn the_surface_of_the_same_gray_value_counts_most() {
    let mut planes = Planes::flat((20, 20), 0.6);
    // A depth edge to the right of the edge in the image: the pixels between them belong to fattened
    // foreground.
    planes.texture = Texture::new(Plane::from_fn(20, 20, |_, x| if x < 10 { 20 } else { 200 }));

    planes.disparity = Plane::from_fn(20, 20, |_, x| if x < 12 { 9.0 } else { 3.0 });

    let found = planes.confidences();

    assert!(found.row(10)[11] < found.row(10)[9] / 2.0, "{found:?}");
}

#[test]
fn missing_neighbors_speak_neither_for_nor_against() {
    let mut planes = Planes::flat((9, 9), 0.4);

    let all = planes.confidences().row(4)[4];

    for y in 0..4 {
        planes.disparity.row_mut(y).fill(f32::NAN);
    }

    assert!((planes.confidences().row(4)[4] - all).abs() < 1e-6);
}

#[test]
fn a_cancelled_search_stops() {
    let control = Control::default();
    control.cancel();

    let planes = Planes::flat((2, 2), 1.0);
    let stopped = planes.map().confidences(&mut planes.votes.clone(), levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

/// A raw map of some size, with random confidences and flags.
fn raw_map(seed: u64, (rows, cols): (usize, usize)) -> (Plane<f32>, Plane<u16>, Plane<f32>) {
    // Runs of columns are alike: some pixels are beside an outline, others are not.
    let disparity = Plane::from_fn(rows, cols, |y, x| match hash(seed, y, x / 12) % 50 {
        0 => f32::NAN,
        part => part as f32 / 4.0 - 1.0,
    });
    let flags = Plane::from_fn(rows, cols, |y, x| match hash(seed ^ 7, y, x) % 6 {
        0 => flag::OCCLUDED | flag::FILLED,
        1 => flag::SPECKLE,
        2 => flag::OUTSIDE | flag::FILLED,
        _ => 0,
    });
    // Both ends belong to it.
    let raw = |y, x| (hash(!seed, y, x) % 1001) as f32 / 1000.0;
    (disparity, flags, Plane::from_fn(rows, cols, raw))
}

proptest! {
    #![proptest_config(random(48))]

    #[test]
    fn calibration_is_that_of_the_reference(
        seed in any::<u64>(),
        size in prop_oneof![(1usize..40, 1usize..60), (760usize..1200, 1usize..4)],
        (first, count) in (-12i64..6, 1i64..14),
        noise in prop_oneof![Just(None), (0.0..30.0f64, 0.0..30.0f64).prop_map(Some)],
        scale in -3.0..3.0f64,
        gray_level in 0.001..300.0f64,
    ) {
        let (disparity, flags, raw) = raw_map(seed, size);
        let candidates = Candidates::new(first, count, 64).expect("legal");
        let known = noise.map(|(left, right)| {
            let known = BlurCompensation::of_noise([left, right]).expect("legal");
            known.with_smoothing([right / 3.0, 0.0]).expect("legal")
        });
        // Weights of any kind: learned ones may hide inputs that they ignore.
        let part = |place: usize| (hash(seed ^ 0x63, place, 0) % 2001) as f64 / 1000.0 - 1.0;
        let weights = Weights {
            odds: std::array::from_fn(|i| std::array::from_fn(|j| scale * part(5 * i + j))),
            knots: std::array::from_fn(|i| std::array::from_fn(|j| part(100 + 10 * i + j))),
            bars: std::array::from_fn(|i| part(200 + i)),
        };

        for weights in [&weights, Weights::of(Optimizer::SemiGlobal)] {
            let tally = Tally::of_sample(&raw, &disparity, &flags, candidates);
            let calibration = ConfidenceCalibration::new(&traits(tally, Faults::new(known.as_ref(), gray_level)), weights);
            let found = at_every_level(|level| {
                let mut confidence = raw.clone();
                let bars = calibration.apply(&mut confidence, &disparity, &flags, level).expect("memory");
                [confidence, bars].map(|plane| plane.map(|value| value.to_bits()))
            });

            let map = RawMap { disparity: &disparity, flags: &flags, confidence: &raw };
            let expected = reference::calibrated(map, candidates, (known.as_ref(), gray_level), weights);
            prop_assert_eq!(found, expected.map(|plane| plane.map(|value| value.to_bits())));
        }
    }
}

#[test]
fn rows_of_the_tally_lie_within_the_image_and_apart() {
    for height in [1, 768] {
        assert!(sampled(height).into_iter().eq(std::iter::once(0..height)));
    }
    for height in 769..3000 {
        let rows = sampled(height);
        assert!(rows.windows(2).all(|pair| pair[0].end <= pair[1].start), "{height}");
        assert!(rows.iter().all(|rows| rows.len() == 96 && rows.end <= height), "{height}");
    }
}

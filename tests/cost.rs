//! Costs: rows of whole words against single bits, levels and pixels.

mod common;

use common::{descriptors, grays, level_pair, views};
use phasestereo::candidates::Candidates;
use phasestereo::control::Control;
use phasestereo::cost::Costs;
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::settings::{CostKind, Settings};
use phasestereo::view::{Image, View};
use phasestereo::votes::Votes;
use proptest::prelude::*;

fn view(gray: &Plane<i32>) -> View {
    let pixel = |(y, x, _): (usize, usize, usize)| gray.row(y)[x] as u8;
    let pixels = ndarray::Array3::from_shape_fn((gray.rows(), gray.cols(), 1), pixel);
    View { image: Image::U8(pixels), mask: None }
}

fn volume(views: [&View; 2], candidates: Candidates, settings: &Settings) -> Plane<u16> {
    let costs =
        Costs::new(views, candidates, settings, &Control::default()).expect("not cancelled");
    let (rows, cols, _) = views[0].image.shape();
    let volume =
        costs.volume(rows, cols * candidates.count(), &Control::default()).expect("memory");
    assert!(volume.as_slice().iter().all(|&cost| cost <= costs.ceiling()));
    volume
}

/// The level that a Johnson code stands for, by counting around the circle.
fn level(code: u64, length: usize) -> usize {
    let ones = code.count_ones() as usize;
    if code & 1 == 1 || ones == 0 { ones } else { 2 * length - ones }
}

/// Similarity of two descriptors by its definition (paper, eq. 4 to 6).
fn circular_distance(a: u64, b: u64, settings: &Settings) -> usize {
    let half = 1 << (settings.bits - 1);
    let part = |code: u64, c: usize| (code >> (c * half)) & ((1 << half) - 1);
    let around = |c| {
        let apart = level(part(a, c), half).abs_diff(level(part(b, c), half));
        if apart <= half { apart } else { 2 * half - apart }
    };
    (0..settings.components()).map(around).sum()
}

#[test]
fn ceilings_and_steps_are_those_of_the_unit() {
    let colour = View { image: Image::U8(ndarray::Array3::zeros((1, 1, 3))), mask: None };
    let candidates = Candidates::new(0, 1, 1).expect("in reach");
    let scale = |cost, bits| {
        let settings = Settings { cost, bits, ..Settings::default() };
        let costs = Costs::new([&colour, &colour], candidates, &settings, &Control::default());
        costs.map(|costs| (costs.ceiling(), costs.steps()))
    };
    assert_eq!(scale(CostKind::Phase, 2), Ok((14, 1)), "bits");
    assert_eq!(scale(CostKind::Phase, 3), Ok((28, 1)), "bits");
    assert_eq!(scale(CostKind::Sad, 2), Ok((3 * 3 * 255 * 16, 16)), "sixteenths of gray levels");
    assert_eq!(scale(CostKind::NormalisedSad, 2), Ok((3 * 32 * 256, 256)), "256ths of deviations");
}

proptest! {
    #[test]
    fn popcount_is_the_circular_distance_of_eq_6(
        gray in grays(8),
        settings in descriptors(),
        min in -4i64..4,
    ) {
        let count = (gray.cols() as i64).min(5);
        let Ok(candidates) = Candidates::new(min, count, gray.cols()) else { return Ok(()) };
        let (left, right) = (view(&gray), view(&gray.map(|value| value / 3)));
        let [a, b] = [&left, &right].map(|view| reference::describe(&common::gray(view), &settings));
        let volume = volume([&left, &right], candidates, &settings);
        prop_assert_eq!(&volume, &reference::phase_costs(&a, &b, candidates));
        for (place, &cost) in volume.as_slice().iter().enumerate() {
            let (pixel, k) = (place / candidates.count(), place % candidates.count());
            let (y, x) = (pixel / gray.cols(), pixel % gray.cols());
            let column = candidates.column(x, k, gray.cols());
            let expected = circular_distance(a.row(y)[x], b.row(y)[column], &settings);
            prop_assert_eq!(usize::from(cost), expected);
        }
    }

    #[test]
    fn absolute_differences_are_summed_over_channels(
        left in views(3, 7, 0),
        right in views(3, 7, 0),
        min in -6i64..6,
    ) {
        let (left, right) = (View { mask: None, ..left }, View { mask: None, ..right });
        let candidates = Candidates::new(min, 4, 7).expect("in reach");
        let settings = Settings { cost: CostKind::Sad, ..Settings::default() };
        let [a, b] = level_pair([&left, &right], None);
        let expected = reference::absolute_differences(&a, &b, candidates);
        prop_assert_eq!(volume([&left, &right], candidates, &settings), expected);
    }

    #[test]
    fn both_pixels_of_a_vote_are_valid(left in views(2, 6, 0), right in views(2, 6, 0)) {
        let candidates = Candidates::new(-1, 4, 6).expect("in reach");
        let Some(votes) = Votes::new([&left, &right], candidates) else { return Ok(()) };
        let valid = |view: &View, y, x| view.mask.as_ref().is_none_or(|mask| mask.row(y)[x]);
        let mut row = vec![0; 24];
        for y in 0..2 {
            votes.write_row(y, &mut row);
            for (place, &vote) in row.iter().enumerate() {
                let (x, k) = (place / 4, place % 4);
                let both = valid(&left, y, x) && valid(&right, y, candidates.column(x, k, 6));
                prop_assert_eq!(vote, u16::from(both));
            }
        }
    }
}

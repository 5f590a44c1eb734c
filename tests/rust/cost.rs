//! Costs: lanes of bytes and words compared with single bits, levels and pixels.

use crate::common::{COUNTS, descriptors, gray_of, grays, hash, levels, mask, naive, random, view, views};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::cost::validity::{BlockValidity, Extent, Validity};
use phasestereo_match::image::pixels::Image;
use phasestereo_match::image::view::View;
use phasestereo_match::pair::candidates::{Candidates, Searched};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Settings};
use proptest::prelude::*;

/// The costs of a pair, which must be the same at every level.
fn volume(views: [&View; 2], candidates: Candidates, settings: &Settings) -> Plane<u16> {
    let control = Control::default();
    let (rows, _) = views[0].size();

    let at = |level| {
        let costs = Costs::new(views, candidates, settings, None, level, &control).expect("memory");
        let volume = costs.volume(rows, level, &control).expect("memory");
        assert!(volume.as_slice().iter().all(|&cost| cost <= costs.ceiling()));

        volume
    };

    let volumes: Vec<_> = levels().into_iter().map(at).collect();

    assert!(volumes.iter().all(|volume| *volume == volumes[0]), "levels differ");
    volumes.into_iter().next().expect("every machine has one level")
}

/// The level that a Johnson code stands for, by counting around the circle.
fn level(code: u64, length: usize) -> usize {
    let ones = code.count_ones() as usize;
    if code & 1 == 1 || ones == 0 { ones } else { 2 * length - ones }
}

/// Similarity of two descriptors by definition (paper, eq. 4 to 6).
fn circular_distance(a: u64, b: u64, settings: &Settings) -> usize {
    let half = 1 << (settings.bits - 1);

    let part = |code: u64, c: usize| (code >> (c * half)) & ((1 << half) - 1);

    let around = |c| {
        let apart = level(part(a, c), half).abs_diff(level(part(b, c), half));
        if apart <= half { apart } else { 2 * half - apart }
    };

    (0..settings.components()).map(around).sum()
}

/// A pair of different views, with or without masks.
fn unlike(rows: usize, cols: usize, is_masked: bool) -> [View; 2] {
    [1, 2].map(|seed| {
        let view = view(rows, cols, |y, x| hash(seed, y, x) as u8);
        view.with_mask(is_masked.then(|| mask(rows, cols, 80, seed)))
    })
}

#[test]
fn ceilings_and_steps_are_those_of_the_unit() {
    let color = gray_of(Image::U8(ndarray::Array3::zeros((1, 1, 3))));

    let candidates = Candidates::new(0, 1, 1).expect("in reach");

    let scale = |cost, bits| {
        let settings = Settings { cost, bits, ..Preset::Paper.settings() };
        let costs =
            Costs::new([&color, &color], candidates, &settings, None, levels()[0], &Control::default());

        costs.map(|costs| (costs.ceiling(), costs.steps()))
    };

    assert_eq!(scale(CostKind::Phase, 2), Ok((14, 1)), "bits");
    assert_eq!(scale(CostKind::Phase, 3), Ok((28, 1)), "bits");
    assert_eq!(scale(CostKind::Sad, 2), Ok((3 * 255 * 16, 16)), "sixteenths of gray levels");
    assert_eq!(scale(CostKind::NormalizedSad, 2), Ok((32 * 256, 256)), "256ths of deviations");
    assert_eq!(scale(CostKind::Zncc, 2), Ok((2 * 256, 256)), "256ths of a correlation");
}

#[test]
fn codes_of_one_to_eight_bytes_fill_any_lanes() {
    let few = [(1, 0, 1), (1, 0, 4), (2, 1, 2), (2, 0, 4), (3, 1, 2), (3, 0, 4), (4, 1, 2)];
    let many = [(1, 1, 4), (3, 2, 2), (4, 4, 1), (2, 2, 3), (2, 1, 4), (4, 3, 2)];
    let mut bytes = [false; 8];

    for (r, s, bits) in few.into_iter().chain(many) {
        let frequencies = (r, s);
        let settings = Settings { neighborhood: 9, frequencies, bits, ..Preset::Paper.settings() };

        bytes[settings.code_length().div_ceil(8) - 1] = true;

        for (rows, cols, min, count) in [(33, 9, -2, 9), (2, 35, 1, 17), (1, 1, 0, 1)] {
            let [left, right] = unlike(rows, cols, false);
            let candidates = Candidates::new(min, count, cols).expect("in reach");
            let expected = naive::costs([&left, &right], candidates, &settings, None);
            assert_eq!(volume([&left, &right], candidates, &settings), expected, "{settings:?}");
        }
    }

    assert_eq!(bytes, [true; 8]);
}

#[test]
fn any_number_of_candidates_at_any_offset_equals_the_reference() {
    for (cost, rows, count) in CostKind::ALL
        .iter()
        .flat_map(|cost| COUNTS.into_iter().map(move |count| (*cost, 1 + count % 3, count)))
    {
        let settings = Settings { cost, neighborhood: 5, window: 3, ..Preset::Paper.settings() };
        for (cols, is_masked) in [(count, true), (count + 65, false)] {
            let [left, right] = unlike(rows, cols, is_masked);
            let (far_left, far_right) = (2 - (cols + count) as i64, cols as i64 - 1);
            for min in [far_left, -3, 0, 2, far_right] {
                let Ok(candidates) = Candidates::new(min, count as i64, cols) else { continue };
                let expected = naive::costs([&left, &right], candidates, &settings, None);
                let found = volume([&left, &right], candidates, &settings);
                assert_eq!(found, expected, "{cost:?}, {count} from {min} in {cols} columns");
            }
        }
    }
}

#[test]
fn cancelled_costs_stop() {
    let [left, right] = unlike(3, 4, false);
    let candidates = Candidates::new(0, 2, 4).expect("in reach");

    let control = Control::default();
    let costs =
        Costs::new([&left, &right], candidates, &Preset::Paper.settings(), None, levels()[0], &control)
            .expect("not cancelled");

    control.cancel();
    assert_eq!(costs.volume(3, levels()[0], &control), Err(Error::Cancelled));
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn popcount_is_the_circular_distance_of_eq_6(
        gray in grays(8),
        settings in descriptors(),
        min in -4i64..4,
    ) {
        let count = (gray.cols() as i64).min(5);
        let Ok(candidates) = Candidates::new(min, count, gray.cols()) else { return Ok(()) };

        let left = view(gray.rows(), gray.cols(), |y, x| gray.row(y)[x] as u8);
        let right = view(gray.rows(), gray.cols(), |y, x| (gray.row(y)[x] / 3) as u8);
        let [a, b] = [&left, &right].map(|view| reference::describe(view.gray(), &settings, 0.0));

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
    fn costs_of_levels_are_those_of_gray(
        left in views(3, 7, 0),
        right in views(3, 7, 0),
        min in -6i64..6,
        cost in prop::sample::select(&CostKind::ALL[1..]),
    ) {
        let candidates = Candidates::new(min, 4, 7).expect("in reach");
        let settings = Settings { cost, window: 5, ..Preset::Paper.settings() };

        let expected = naive::costs([&left, &right], candidates, &settings, None);
        prop_assert_eq!(volume([&left, &right], candidates, &settings), expected);
    }

    #[test]
    fn both_pixels_of_a_valid_pair_are_valid(left in views(2, 6, 0), right in views(2, 6, 0)) {
        let candidates = Candidates::new(-1, 4, 6).expect("in reach");
        let validity = Validity::new([&left, &right], candidates).expect("memory");
        prop_assert_eq!(validity.is_none(), left.mask().is_none() && right.mask().is_none());
        let Some(validity) = validity else { return Ok(()) };

        for (y, x) in (0..2).flat_map(|y| (0..6).map(move |x| (y, x))) {
            prop_assert_eq!(validity.is_masked(y, x), !left.is_valid(y, x));

            for k in 0..4 {
                let column = candidates.column(x, k, 6);
                let both = left.is_valid(y, x) && right.is_valid(y, column);
                prop_assert_eq!(validity.is_valid(y, x, k), both);
            }
        }
    }

    #[test]
    fn extents_of_blocks_are_those_of_their_pairs(
        left in views(4, 6, 0),
        right in views(4, 6, 0),
        (top, high) in (0usize..4, 1usize..=4),
        (from, wide) in (0usize..6, 1usize..=6),
        (start, count) in (0usize..5, 1usize..=5),
    ) {
        let candidates = Candidates::new(-1, 5, 6).expect("in reach");
        let validity = Validity::new([&left, &right], candidates).expect("memory");
        let Some(validity) = validity else { return Ok(()) };

        let (rows, columns) = (top..(top + high).min(4), from..(from + wide).min(6));
        let searched = Searched { start, count: count.min(5 - start) };
        let pairs = || rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x))).flat_map(|(y, x)| {
            (start..start + searched.count).map(move |k| (y, x, k))
        });
        let is_valid = |(y, x, k)| validity.is_valid(y, x, k);
        let no_left = pairs().all(|(y, x, _)| !left.is_valid(y, x));
        let no_right = pairs().all(|(y, x, k)| !right.is_valid(y, candidates.column(x, k, 6)));

        let all = Searched::all(5);
        let found = match BlockValidity::new(&validity, &rows, &(0..6), all) {
            Some(block) => block.extent(&columns, searched),
            None => Extent::All,
        };
        prop_assert_eq!(found == Extent::All, pairs().all(is_valid));
        prop_assert_eq!(found == Extent::Nothing, no_left || no_right);
    }
}

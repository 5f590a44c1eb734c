//! Whole matches: every thread count and banding against the chain of the naive twins.

mod common;

use common::{gray, level_pair, settings, views};
use phasestereo::aggregation::Window;
use phasestereo::control::Control;
use phasestereo::cost::Costs;
use phasestereo::error::{Error, Result};
use phasestereo::matcher::{Disparity, Execution, Pair, on_threads, run};
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::refinement::{confidence, flag};
use phasestereo::scanline::Steps;
use phasestereo::settings::{CostKind, Optimizer, Settings};
use phasestereo::view::{Image, View};
use phasestereo::votes::Votes;
use proptest::prelude::*;

/// What a caller sees of a match; NaN compared by its bits.
type Seen = (Vec<u32>, Vec<u16>, Vec<u32>);

fn seen(map: Disparity) -> Seen {
    let bits = |plane: Plane<f32>| plane.into_vec().into_iter().map(f32::to_bits).collect();
    (bits(map.disparity), map.flags.into_vec(), bits(map.confidence))
}

fn matched(pair: &Pair, settings: &Settings, threads: usize, band_rows: Option<usize>) -> Seen {
    let how = Execution { threads, band_rows };
    seen(run(pair, settings, how, &Control::default()).expect("a legal match"))
}

/// Costs of the naive twins before any vote is taken out.
fn naive_costs(pair: &Pair, settings: &Settings) -> Plane<u16> {
    let ([left, right], told) = (pair.views(), settings.intensity_range);
    if settings.cost == CostKind::Phase {
        let codes = [left, right].map(|view| reference::describe(&gray(view), settings));
        return reference::phase_costs(&codes[0], &codes[1], pair.candidates());
    }
    let [left, right] = level_pair([left, right], told).map(|channels| {
        let flatten = |plane: &Plane<u16>| match settings.cost {
            CostKind::NormalisedSad => reference::normalise(plane, settings.window),
            _ => plane.clone(),
        };
        channels.iter().map(flatten).collect::<Vec<_>>()
    });
    reference::absolute_differences(&left, &right, pair.candidates())
}

/// Whether left pixel and candidate are both valid, by definition.
fn naive_vote(pair: &Pair, y: usize, x: usize, k: usize) -> bool {
    let valid = |view: &View, x: usize| view.mask.as_ref().is_none_or(|mask| mask.row(y)[x]);
    let column = pair.candidates().column(x, k, pair.size().1);
    valid(pair.views()[0], x) && valid(pair.views()[1], column)
}

fn naive_match(pair: &Pair, settings: &Settings) -> Result<Seen> {
    let ((rows, cols), candidates) = (pair.size(), pair.candidates());
    let count = candidates.count();
    let scale = Costs::new(pair.views(), candidates, settings, &Control::default())?;
    let window = Window::new((rows, cols), count, settings, scale.ceiling());
    let steps = Steps::new(settings.penalty, window, scale.steps());
    let votes = Plane::from_fn(rows, cols * count, |y, place| {
        u16::from(naive_vote(pair, y, place / count, place % count))
    });
    let mut costs = naive_costs(pair, settings);
    costs.as_mut_slice().iter_mut().zip(votes.as_slice()).for_each(|(cost, vote)| *cost *= vote);
    let aggregated = reference::aggregate(&costs, &votes, window);
    let mut result = (vec![], vec![], vec![]);
    for y in 0..rows {
        let row = aggregated.row(y);
        let chosen = match settings.optimizer {
            Optimizer::DynamicProgramming => reference::dynamic_programming(row, count, steps),
            Optimizer::WinnerTakesAll => reference::winner_takes_all(row, count),
        };
        for (x, &index) in chosen.iter().enumerate() {
            let (index, costs) = (usize::from(index), &row[x * count..][..count]);
            let flags = naive_flags(pair, y, x, index);
            let missing = flags & flag::MISSING != 0 || flags != 0 && !settings.fill;
            let disparity = if missing { f32::NAN } else { candidates.disparity(index) as f32 };
            let trust = if missing { 0.0 } else { confidence(costs, index) };
            result.0.push(disparity.to_bits());
            result.1.push(flags);
            result.2.push(trust.to_bits());
        }
    }
    Ok(result)
}

fn naive_flags(pair: &Pair, y: usize, x: usize, chosen: usize) -> u16 {
    let (candidates, width) = (pair.candidates(), pair.size().1);
    let masked = pair.views()[0].mask.as_ref().is_some_and(|mask| !mask.row(y)[x]);
    if masked {
        return flag::MASKED;
    }
    if !(0..candidates.count()).any(|k| naive_vote(pair, y, x, k)) {
        return flag::NO_CANDIDATE;
    }
    let outside = if candidates.is_outside(x, chosen, width) { flag::OUTSIDE } else { 0 };
    let masked = if naive_vote(pair, y, x, chosen) { 0 } else { flag::MATCH_MASKED };
    outside | masked
}

fn pairs() -> impl Strategy<Value = Pair> {
    (1usize..=14, 1usize..=14, 0u8..4).prop_flat_map(|(rows, cols, kind)| {
        let range = (-(cols as i64)..cols as i64, 1..=cols as i64);
        (views(rows, cols, kind), views(rows, cols, kind), range)
            .prop_filter_map("every candidate outside", |(left, right, (min, count))| {
                Pair::new(left, right, min, count).ok()
            })
    })
}

proptest! {
    #[test]
    fn any_match_equals_the_naive_chain(
        pair in pairs(),
        settings in settings(),
        threads in 1usize..=8,
        band_rows in prop::option::of(1usize..=15),
    ) {
        let expected = naive_match(&pair, &settings).expect("a legal match");
        prop_assert_eq!(matched(&pair, &settings, threads, band_rows), expected);
    }
}

fn noise_pair(rows: usize, cols: usize, count: i64) -> Pair {
    let gray = common::noise(rows, cols + 5);
    let view = |shift: usize| {
        let pixel = |(y, x, _)| gray.row(y)[x + shift] as u8;
        View {
            image: Image::U8(ndarray::Array3::from_shape_fn((rows, cols, 1), pixel)),
            mask: None,
        }
    };
    Pair::new(view(0), view(3), 0, count).expect("a legal pair")
}

#[test]
fn every_thread_count_and_banding_gives_the_same_bits() {
    let (pair, settings) = (noise_pair(131, 67, 16), Settings::default());
    let expected = matched(&pair, &settings, 1, Some(131));
    for threads in 1..=8 {
        for band_rows in [None, Some(1), Some(7), Some(64), Some(usize::MAX)] {
            assert_eq!(
                matched(&pair, &settings, threads, band_rows),
                expected,
                "{threads} {band_rows:?}"
            );
        }
    }
}

#[test]
fn a_shifted_image_is_found_again() {
    let pair = noise_pair(40, 80, 9);
    let map = run(
        &pair,
        &Settings::default(),
        Execution { threads: 2, band_rows: None },
        &Control::default(),
    )
    .expect("a legal match");
    for y in 0..40 {
        assert!(map.disparity.row(y)[8..].iter().all(|d| d.to_bits() == 3f32.to_bits()), "row {y}");
        assert!(map.flags.row(y)[8..].iter().all(|&flags| flags == 0), "row {y}");
    }
}

#[test]
fn a_cancelled_match_stops_and_threads_are_counted() {
    let pair = noise_pair(20, 20, 5);
    let control = Control::default();
    control.cancel();
    let how = Execution { threads: 2, band_rows: None };
    assert_eq!(run(&pair, &Settings::default(), how, &control), Err(Error::Cancelled));
    for threads in [0, 1025] {
        let refused = on_threads(threads, || ()).expect_err("refused");
        assert!(refused.to_string().starts_with("threads: got"), "{refused}");
    }
}

#[test]
fn rows_are_counted_as_they_are_done() {
    let control = Control::default();
    let how = Execution { threads: 3, band_rows: Some(4) };
    run(&noise_pair(21, 30, 5), &Settings::default(), how, &control).expect("a legal match");
    assert_eq!(control.rows_done(), 21);
}

#[test]
fn images_of_two_sizes_or_types_are_refused() {
    let view = |rows, image: fn(ndarray::Array3<u8>) -> Image| View {
        image: image(ndarray::Array3::zeros((rows, 4, 1))),
        mask: None,
    };
    let refused =
        |right| Pair::new(view(3, Image::U8), right, 0, 1).expect_err("refused").to_string();
    assert_eq!(
        refused(view(2, Image::U8)),
        "right: got 2 x 4 pixels; accepts the size of left, 3 x 4"
    );
    let wide = view(3, |pixels| Image::U16(pixels.mapv(u16::from)));
    assert_eq!(refused(wide), "right: got pixels of another type; accepts the type of left");
}

#[test]
fn without_masks_nobody_is_asked_to_vote() {
    let pair = noise_pair(4, 9, 3);
    assert!(Votes::new(pair.views(), pair.candidates()).is_none());
}

//! Offsets between candidates compared with their definition, and smoothing with a sum pair by pair.

#![expect(clippy::float_cmp, reason = "what is compared here is exact, or the same to the bit")]

use crate::common::maps::drawn;
use crate::common::{hash, levels, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::optimization::subpixel::{evidence, offset};
use phasestereo_match::refinement::surfaces::smooth;
use proptest::prelude::*;

fn smoothed(disparity: &Plane<f32>) -> Plane<f32> {
    drawn(disparity, |out, level| smooth(disparity, out, level, &Control::default()))
}

/// Any costs, or costs close together.
fn costs() -> impl Strategy<Value = (u32, u32, u32)> {
    let close = (0u32..1 << 20).prop_flat_map(|base| {
        let near = move || base..base + 40;
        (near(), near(), near())
    });

    let any = || 0..=i32::MAX as u32;

    prop_oneof![(any(), any(), any()), close]
}

/// Disparities in steps of an eighth, some of them missing, on surfaces close together or far apart.
fn disparities() -> impl Strategy<Value = Plane<f32>> {
    let steps = prop_oneof![Just(8u64), Just(12), Just(40)];
    (1usize..=9, 1usize..=50, steps, any::<u64>()).prop_map(|(rows, cols, steps, seed)| {
        Plane::from_fn(rows, cols, |y, x| match hash(seed, y, x) % (steps + 2) {
            0 => f32::NAN,
            step => step as f32 / 8.0 - 2.0,
        })
    })
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn the_offset_is_that_of_its_definition((below, own, above) in costs()) {
        let found = offset(below, own, above);

        prop_assert_eq!(found, reference::offset(below, own, above));
        prop_assert!((-0.5..=0.5).contains(&found));
    }

    #[test]
    fn mirrored_costs_mirror_the_offset((below, own, above) in costs()) {
        prop_assert_eq!(offset(below, own, above), -offset(above, own, below));
    }

    #[test]
    fn the_cheaper_a_neighbor_the_nearer_the_match(
        (below, own, above) in costs(),
        less in 1u32..1000,
    ) {
        // Up to the rounding of costs beyond 2^24, which floats do not hold exactly.
        let nearer = offset(below, own, above.saturating_sub(less));
        prop_assert!(nearer >= offset(below, own, above) - 1e-6);
    }

    #[test]
    fn an_offset_does_not_depend_on_the_unit_of_cost(
        (own, below, above) in (0u32..1000, 1u32..1000, 1u32..1000),
        (factor, base) in (1u32..1000, 0u32..1_000_000),
    ) {
        let cost = |cost: u32| base + factor * (own + cost);

        let expected = offset(own + below, own, own + above);
        prop_assert_eq!(offset(cost(below), cost(0), cost(above)), expected);
    }

    #[test]
    fn smoothing_equals_its_definition(disparity in disparities()) {
        let bits = |plane: Plane<f32>| plane.map(|d| if d.is_nan() { None } else { Some(d.to_bits()) });
        let expected = bits(reference::smooth_surfaces(&disparity));

        prop_assert!(bits(smoothed(&disparity)) == expected);
    }

    /// In steps that floats hold exactly.
    #[test]
    fn slanted_surfaces_stay_as_they_are_up_to_an_edge(
        (horizontal, vertical) in (-16i32..=16, -16i32..=16),
        edge in 0usize..40,
    ) {
        let plane = Plane::from_fn(12, 40, |y, x| {
            let slanted = (horizontal * x as i32 + vertical * y as i32) as f32 / 64.0;
            if x < edge { slanted } else { slanted + 20.0 }
        });

        prop_assert_eq!(smoothed(&plane), plane);
    }
}

#[test]
fn offsets_by_hand() {
    assert_eq!(offset(9, 5, 9), 0.0, "alike on both sides");
    assert_eq!(offset(9, 5, 5), 0.5, "as good as the next one");
    assert_eq!(offset(5, 5, 9), -0.5);
    assert_eq!(offset(7, 5, 9), -0.2875, "a quarter, plus 0.3 of its half");
    assert_eq!(offset(5, 5, 5), 0.0, "no preference");
    assert_eq!(offset(2, 5, 9), -0.5, "the neighbor is better");
    assert_eq!(offset(2, 9, 3), -0.5, "both neighbors are better");
    assert_eq!(offset(i32::MAX as u32, 0, 0), 0.5);
    assert_eq!(offset(0, i32::MAX as u32, 0), 0.0);
}

#[test]
fn the_costs_count_twice() {
    assert_eq!(evidence(1000, 10), 1020);
    assert_eq!(evidence(1, u32::MAX), i32::MAX as u32, "and never overflow");
    assert_eq!(evidence(u32::MAX, 0), i32::MAX as u32);
}

#[test]
fn only_neighbors_within_a_pixel_on_either_side_count() {
    // Of thirty-fifths of a power of two, sevenths and fifths are exact.
    let own = 35.0 / 64.0;
    let mut row = Plane::from_fn(1, 9, |_, x| if x == 4 { own } else { 0.0 });

    let at = |row: &Plane<f32>, x: usize| smoothed(row).row(0)[x];
    assert_eq!(at(&row, 4), own / 7.0);

    row.row_mut(0)[5] = 2.25;
    assert_eq!(at(&row, 4), own / 5.0, "nor does the opposite pixel");

    row.row_mut(0)[3] = f32::NAN;
    assert_eq!(at(&row, 4), own / 5.0);

    row.row_mut(0)[4] = f32::NAN;
    assert!(at(&row, 4).is_nan());
}

#[test]
fn the_reach_is_a_square_of_three_pixels_on_either_side() {
    let (size, center) = (13, 6);
    let spot = Plane::from_fn(size, size, |y, x| f32::from(u8::from((y, x) == (center, center))));
    let found = smoothed(&spot);

    for (y, x) in (0..size).flat_map(|y| (0..size).map(move |x| (y, x))) {
        let is_reached = y.abs_diff(center) <= 3 && x.abs_diff(center) <= 3;

        assert_eq!(found.row(y)[x] > 0.0, is_reached, "{y} {x}");
    }
}

#[test]
fn a_cancelled_smoothing_stops() {
    let control = Control::default();
    control.cancel();

    let plane = Plane::from_fn(2, 3, |_, _| 1.0);
    let stopped = smooth(&plane, &mut plane.clone(), levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

//! Medians of 3 x 3 disparities, compared with sorting.

use crate::common::maps::{bits, drawn, maps, row};
use crate::common::{levels, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::refinement::median::{NONE, disparity, key, median9, smooth};
use proptest::prelude::*;

fn smoothed(disparity: &Plane<f32>) -> Plane<f32> {
    drawn(disparity, |out, level| smooth(disparity, out, level, &Control::default()))
}

/// The median of some numbers.
fn middle(numbers: &[i32]) -> i32 {
    let mut numbers = numbers.to_vec();
    numbers.sort_unstable();
    numbers[numbers.len() / 2]
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn maps_are_smoothed_like_by_the_reference(map in maps()) {
        prop_assert_eq!(bits(&smoothed(&map.disparity)), bits(&reference::smooth(&map.disparity)));
    }

    #[test]
    fn the_median_is_in_the_middle(numbers: [i8; 9]) {
        let numbers = numbers.map(i32::from);
        prop_assert_eq!(median9(numbers), middle(&numbers));
    }

    #[test]
    fn keys_have_the_order_of_disparities(a: f32, b: f32) {
        prop_assert_eq!(key(a).cmp(&key(b)), a.total_cmp(&b));
        prop_assert_eq!(disparity(key(a)).to_bits(), a.to_bits());
    }
}

#[test]
fn a_lone_pixel_goes_and_an_edge_stays() {
    let scene = Plane::from_fn(9, 40, |_, x| if x < 20 { 2.0 } else { 9.5 });

    let mut lone = scene.clone();

    lone.row_mut(4)[7] = 30.0;
    lone.row_mut(0)[39] = 0.0;

    assert_eq!(smoothed(&lone), scene);
}

#[test]
fn missing_disparities_stay_missing_and_do_not_count() {
    let smoothed = smoothed(&row(&[1.0, f32::NAN, 5.0, 6.0, 0.0])).into_vec();

    assert!(smoothed[1].is_nan());
    assert_eq!(smoothed[..1], [1.0]);
    assert_eq!(smoothed[2..], [5.0, 5.0, 0.0]);
}

#[test]
fn no_disparity_has_a_key_of_its_own() {
    assert!(key(f32::NAN) == NONE && key(-f32::NAN) == NONE && disparity(NONE).is_nan());
    assert!(key(f32::NEG_INFINITY) > NONE);
}

#[test]
fn a_cancelled_median_stops() {
    let control = Control::default();
    control.cancel();

    let stopped = smooth(&row(&[1.0]), &mut row(&[0.0]), levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

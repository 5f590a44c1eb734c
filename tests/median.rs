//! Medians of 3 x 3 disparities, against sorting.

mod common;

use common::levels;
use common::maps::{bits, maps, row};
use phasestereo::control::Control;
use phasestereo::error::Error;
use phasestereo::median::{LANES, median, smooth};
use phasestereo::plane::Plane;
use phasestereo::reference;
use proptest::prelude::*;

fn smoothed(disparity: &Plane<f32>) -> Plane<f32> {
    let planes = levels()
        .into_iter()
        .map(|level| smooth(disparity, level, &Control::default()).expect("memory"));
    planes
        .reduce(|one, other| {
            assert_eq!(bits(&one), bits(&other));
            one
        })
        .expect("a level")
}

fn check_median<const N: usize>(values: &[i8]) {
    let mut values: [_; N] = std::array::from_fn(|i| f32::from(values[i]));
    let found = median(values.map(|value| [value; LANES]));
    values.sort_by(f32::total_cmp);
    assert_eq!(found, [values[N / 2]; LANES]);
}

proptest! {
    #[test]
    fn maps_are_smoothed_like_by_the_twin(map in maps()) {
        prop_assert_eq!(bits(&smoothed(&map.disparity)), bits(&reference::smooth(&map.disparity)));
    }

    #[test]
    fn the_median_is_in_the_middle(values in prop::collection::vec(any::<i8>(), 25)) {
        check_median::<3>(&values);
        check_median::<5>(&values);
        check_median::<9>(&values);
        check_median::<25>(&values);
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
fn none_is_made_up_and_none_is_mixed_in() {
    let smoothed = smoothed(&row(&[1.0, f32::NAN, 5.0, 6.0, 0.0])).into_vec();
    assert!(smoothed[1].is_nan());
    assert_eq!(smoothed[0], 1.0);
    assert_eq!(smoothed[2..], [5.0, 5.0, 0.0]);
}

#[test]
fn a_cancelled_median_stops() {
    let control = Control::default();
    control.cancel();
    assert_eq!(smooth(&row(&[1.0]), levels()[0], &control), Err(Error::Cancelled));
}

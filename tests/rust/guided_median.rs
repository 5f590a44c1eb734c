//! Medians of similar pixels near jumps, against sorting.

use crate::common::maps::{FlaggedMap, bits, drawn, maps, patches};
use crate::common::{hash, random};
use crate::reference;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::image::texture::{Roughness, Texture};
use phasestereo::internals::pipeline::control::Control;
use phasestereo::internals::refinement::guided_median::{guide, likeness};
use proptest::prelude::*;
use proptest::sample::select;

fn guided(disparity: &Plane<f32>, gray: &Plane<i32>) -> Plane<f32> {
    let texture = Texture::new(gray.clone());
    let control = Control::default();

    drawn(disparity, |out, level| guide(disparity, &texture, out, level, &control))
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn maps_are_guided_like_by_the_reference(
        map in maps(),
        largest in select(vec![0, 1, 3, 255, 1 << 25]),
        seed: u64,
    ) {
        let FlaggedMap { disparity, .. } = map;
        let gray = patches(disparity.rows(), disparity.cols(), largest, seed);

        prop_assert_eq!(
            bits(&guided(&disparity, &gray)),
            bits(&reference::guide(&disparity, &gray))
        );
    }
}

/// Two surfaces of their own gray value with a border that the map has up to two pixels off.
#[test]
fn an_edge_is_drawn_to_that_of_the_image() {
    let noise = |y, x| (hash(3, y, x) % 5) as i32;
    let gray = Plane::from_fn(40, 60, |y, x| if x < 30 { noise(y, x) } else { 90 + noise(y, x) });
    let edge = |at| Plane::from_fn(40, 60, |_, x| if x < at { 4.0 } else { 11.0 });

    for off in [28, 29, 30, 31, 32] {
        assert_eq!(guided(&edge(off), &gray), edge(30), "{off}");
    }
}

#[test]
fn contrast_and_offset_change_nothing() {
    let FlaggedMap { disparity, .. } = FlaggedMap::random((33, 50), 20, 77);
    let gray = patches(33, 50, 255, 8);

    let guided_by = |factor: i32, offset: i32| {
        bits(&guided(&disparity, &gray.map(|value| value * factor + offset)))
    };

    let noise = Plane::from_fn(33, 50, |y, x| if (x + y) % 2 == 0 { 0 } else { 10 });

    assert_eq!(likeness(Roughness::of_rows(noise.as_slice(), 50)), 10);

    assert_eq!(guided_by(1, 0), guided_by(1, 1000));
    assert_eq!(guided_by(-1, 0), guided_by(1, 0));
}

#[test]
fn slopes_stay_as_they_are() {
    let slope = Plane::from_fn(20, 40, |y, x| (x + y) as f32 * 0.97);
    assert_eq!(guided(&slope, &patches(20, 40, 255, 1)), slope);
}

#[test]
fn differences_of_the_largest_grays_are_counted() {
    let gray = Plane::from_fn(2, 3, |_, x| if x == 1 { 1 << 25 } else { -(1 << 25) });
    let of = |gray: &Plane<i32>| likeness(Roughness::of_rows(gray.as_slice(), gray.cols()));

    assert_eq!(of(&gray), 1 << 26);
    assert_eq!(of(&Plane::from_fn(3, 1, |y, _| y as i32)), 0, "no neighbors");
    assert_eq!(of(&Plane::from_fn(1, 4, |_, x| i32::from(x == 3))), 1, "rounded up");
}

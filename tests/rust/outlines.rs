//! Weighted medians near jumps, against sorting.

use crate::common::maps::{FlaggedMap, bits, drawn, maps, patches};
use crate::common::{hash, random};
use crate::reference;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::image::texture::Texture;
use phasestereo::internals::pipeline::control::Control;
use phasestereo::internals::refinement::outlines::{NEAR, draw};
use proptest::prelude::*;
use proptest::sample::select;

fn outlined(disparity: &Plane<f32>, gray: &Plane<i32>) -> Plane<f32> {
    let texture = Texture::new(gray.clone());
    let control = Control::default();

    drawn(disparity, |out, level| draw(disparity, &texture, out, level, &control))
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn outlines_are_drawn_like_by_the_reference(
        map in maps(),
        largest in select(vec![0, 1, 3, 255, 1 << 25]),
        far in select(vec![1.0, 1.0, 900.0, 16_384.0]),
        seed: u64,
    ) {
        let disparity = map.disparity.map(|value| value * far);
        let gray = patches(disparity.rows(), disparity.cols(), largest, seed);
        let texture = Texture::new(gray.clone());

        prop_assert_eq!(
            bits(&outlined(&disparity, &gray)),
            bits(&reference::outline(&disparity, &gray, texture.roughness))
        );
    }
}

/// Two surfaces of their own gray value with a border that the map has up to three pixels off.
#[test]
fn an_edge_is_drawn_to_that_of_the_image() {
    let noise = |y, x| (hash(3, y, x) % 5) as i32;
    let gray = Plane::from_fn(60, 60, |y, x| if x < 30 { noise(y, x) } else { 90 + noise(y, x) });
    let edge = |at| Plane::from_fn(60, 60, |_, x| if x < at { 4.0 } else { 11.0 });

    for off in 27..=33 {
        assert_eq!(outlined(&edge(off), &gray), edge(30), "{off}");
    }
}

#[test]
fn pixels_far_from_jumps_stay_as_they_are() {
    let slope = Plane::from_fn(30, 70, |y, x| (x + y) as f32 * 0.97);
    assert_eq!(outlined(&slope, &patches(30, 70, 255, 1)), slope);

    let FlaggedMap { disparity: noisy, .. } = FlaggedMap::random((30, 70), 0, 5);
    let half = Plane::from_fn(30, 70, |y, x| if x < 20 { noisy.row(y)[x] } else { 7.0 });

    let drawn = outlined(&half, &patches(30, 70, 255, 2));
    let is_kept = |y: usize, x: usize| drawn.row(y)[x].to_bits() == half.row(y)[x].to_bits();

    assert!((0..30).all(|y| (20 + NEAR..70).all(|x| is_kept(y, x))));
}

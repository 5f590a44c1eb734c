//! Weighted medians near jumps, compared with sorting.

use crate::common::maps::{FlaggedMap, bits, drawn, maps, patches};
use crate::common::{hash, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::texture::Texture;
use phasestereo_match::refinement::guided_median::GuidedMedian;
use proptest::prelude::*;
use proptest::sample::select;

const BOTH: [GuidedMedian; 2] = [GuidedMedian::Narrow, GuidedMedian::Wide];

fn outlined(filter: GuidedMedian, disparity: &Plane<f32>, gray: &Plane<i32>) -> Plane<f32> {
    let texture = Texture::new(gray.clone());
    let control = Control::default();

    drawn(disparity, |out, level| filter.filter(disparity, &texture, out, level, &control))
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

        for outlines in BOTH {
            prop_assert_eq!(
                bits(&outlined(outlines, &disparity, &gray)),
                bits(&reference::guided_median(&disparity, &gray, outlines == GuidedMedian::Wide))
            );
        }
    }
}

/// Two surfaces, each with its own gray value; the map's border is off by up to two or three pixels.
#[test]
fn an_edge_is_drawn_to_that_of_the_image() {
    let noise = |y, x| (hash(3, y, x) % 5) as i32;
    let gray = Plane::from_fn(60, 60, |y, x| if x < 30 { noise(y, x) } else { 90 + noise(y, x) });
    let edge = |at| Plane::from_fn(60, 60, |_, x| if x < at { 4.0 } else { 11.0 });

    for (outlines, most) in [(GuidedMedian::Narrow, 2), (GuidedMedian::Wide, 3)] {
        for off in 30 - most..=30 + most {
            assert_eq!(outlined(outlines, &edge(off), &gray), edge(30), "{outlines:?}: {off}");
        }
    }
}

#[test]
fn contrast_changes_nothing() {
    let FlaggedMap { disparity, .. } = FlaggedMap::random((33, 50), 20, 77);
    let gray = patches(33, 50, 255, 8);

    for outlines in BOTH {
        let by = |factor| bits(&outlined(outlines, &disparity, &gray.map(|value| value * factor)));
        assert_eq!(by(1), by(4));
        assert_eq!(by(1), by(-1));
    }
}

#[test]
fn pixels_far_from_jumps_stay_as_they_are() {
    let slope = Plane::from_fn(30, 70, |y, x| (x + y) as f32 * 0.97);
    for outlines in BOTH {
        assert_eq!(outlined(outlines, &slope, &patches(30, 70, 255, 1)), slope);
    }

    let FlaggedMap { disparity: noisy, .. } = FlaggedMap::random((30, 70), 0, 5);
    let half = Plane::from_fn(30, 70, |y, x| if x < 20 { noisy.row(y)[x] } else { 7.0 });

    for (outlines, near) in BOTH.into_iter().zip([4, 8]) {
        let drawn = outlined(outlines, &half, &patches(30, 70, 255, 2));
        let is_kept = |y: usize, x: usize| drawn.row(y)[x].to_bits() == half.row(y)[x].to_bits();
        assert!((0..30).all(|y| (20 + near..70).all(|x| is_kept(y, x))), "{outlines:?}");
    }
}

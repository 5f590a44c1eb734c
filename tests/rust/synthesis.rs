//! Maps that best explain a soft image, compared with the reference implementation.

use crate::common::maps::{FlaggedMap, bits, drawn};
use crate::common::naive::synthesized;
use crate::common::parts::compensated;
use crate::common::{blur_compensation, hash, random, robust, view, views, weak_descriptors};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::refinement::synthesis::{BlurredPair, is_asked_for};
use phasestereo_match::settings::Settings;
use proptest::prelude::*;

fn pair([left, right]: [View; 2], compensation: BlurCompensation) -> Pair {
    compensated(Pair::new(left, right, 0, 1).expect("a legal pair"), compensation)
}

/// The redrawn map; the map itself, if there is nothing to synthesize.
fn redrawn(disparity: &Plane<f32>, pair: &Pair, settings: &Settings) -> Plane<f32> {
    let control = Control::default();
    let rows = pair.size().0;

    drawn(disparity, |out, level| {
        let views = pair.views();
        let compensation = pair.blur_compensation();
        let Some(pair) = BlurredPair::new(views, compensation, 0..rows, settings, level, &control)? else {
            out.as_mut_slice().copy_from_slice(disparity.as_slice());
            return Ok(());
        };

        pair.redraw(disparity, out, level, &control)
    })
}

/// A pair of any type, with any kernels in any areas, and a map.
fn scenes() -> impl Strategy<Value = (Pair, FlaggedMap)> {
    let rows = prop_oneof![4 => 1usize..=24, 1 => 120usize..=140];
    let size = (rows, 1usize..=40, 0u8..=3);
    let of = |(rows, cols, kind)| (views(rows, cols, kind), views(rows, cols, kind));

    (size, blur_compensation(), any::<u64>()).prop_flat_map(move |(size, compensation, seed)| {
        of(size).prop_map(move |(left, right)| {
            let map = FlaggedMap::random((size.0, size.1), seed % 20, seed);
            (pair([left, right], compensation.clone()), map)
        })
    })
}

proptest! {
    #![proptest_config(random(40))]

    #[test]
    fn maps_are_redrawn_like_by_the_reference((pair, map) in scenes(), settings in weak_descriptors()) {
        let settings = Settings { synthesis: true, ..settings };
        prop_assume!(is_asked_for(&settings, pair.blur_compensation()));
        prop_assert_eq!(
            bits(&redrawn(&map.disparity, &pair, &settings)),
            bits(&synthesized(&map.disparity, &pair, &settings))
        );
    }
}

const SIZE: (usize, usize) = (70, 90);
/// Disparities of the background and of the square in front of it.
const LAYERS: [f32; 2] = [3.0, 9.0];

/// A map with a square that is `by` pixels larger on every side than it should be.
fn square(by: usize) -> Plane<f32> {
    let is_near = |at: usize, from: usize, to: usize| (from - by..to + by).contains(&at);

    Plane::from_fn(SIZE.0, SIZE.1, |y, x| LAYERS[usize::from(is_near(y, 20, 50) && is_near(x, 30, 65))])
}

/// The pair that shows the square, with one soft image.
fn soft_pair(side: usize) -> Pair {
    let truth = square(0);
    let texture = |y, x, layer| (hash(layer, y / 2, x / 2) % 200) as u8;

    let left = |y: usize, x: usize| {
        let is_near = truth.row(y)[x] == LAYERS[1];
        texture(y, x, u64::from(is_near))
    };

    let right = |y: usize, x: usize| {
        let near = x + LAYERS[1] as usize;
        let is_near = near < SIZE.1 && truth.row(y)[near] == LAYERS[1];
        if is_near { texture(y, near, 1) } else { texture(y, x + LAYERS[0] as usize, 0) }
    };

    let images = [Plane::from_fn(SIZE.0, SIZE.1, left), Plane::from_fn(SIZE.0, SIZE.1, right)];

    let views = [0, 1].map(|which| {
        let sharp = &images[which];

        let mean = |y: usize, x: usize| {
            let near = |at: usize, length| at.max(3) - 3..(at + 4).min(length);
            let rows = near(y, SIZE.0).flat_map(|y| near(x, SIZE.1).map(move |x| (y, x)));
            let values: Vec<_> = rows.map(|(y, x)| u32::from(sharp.row(y)[x])).collect();
            (values.iter().sum::<u32>() / values.len() as u32) as u8
        };

        view(SIZE.0, SIZE.1, |y, x| if which == side { mean(y, x) } else { sharp.row(y)[x] })
    });

    let kernel = Kernel::new(&Plane::from_fn(7, 7, |_, _| 1.0 / 49.0)).expect("legal");
    let kernels = if side == 0 { [None, Some(kernel)] } else { [Some(kernel), None] };
    let labels = Plane::from_fn(1, 1, |_, _| 0);

    pair(views, BlurCompensation::new([1.0; 2], vec![kernels], labels, 1).expect("legal"))
}

#[test]
fn fattened_surfaces_shrink_to_their_size() {
    for side in [0, 1] {
        let pair = soft_pair(side);
        let settings = Settings { neighborhood: 5, sizes: 1, ..robust() };

        let wrong = |map: &Plane<f32>| {
            let truth = square(0);
            let pairs = map.as_slice().iter().zip(truth.as_slice());
            pairs.filter(|(found, there)| (*found - *there).abs() > 0.0).count()
        };

        let before = square(4);
        let after = redrawn(&before, &pair, &settings);

        assert!(wrong(&after) * 4 < wrong(&before), "{side}: {} of {}", wrong(&after), wrong(&before));
        assert!(wrong(&redrawn(&square(0), &pair, &settings)) < 60, "{side}: stays");
    }
}

#[test]
fn only_one_sided_kernels_need_synthesis() {
    let asks = |compensation, settings: &Settings| is_asked_for(settings, Some(&compensation));

    let noise = BlurCompensation::of_noise([1.0; 2]).expect("legal");
    assert!(!asks(noise, &robust()));

    let soft = soft_pair(0).blur_compensation().expect("kernels").clone();
    assert!(asks(soft.clone(), &robust()));
    assert!(!asks(soft, &Settings { synthesis: false, ..robust() }));

    assert!(!is_asked_for(&robust(), None));
}

//! The guided filter, compared with each window by itself.

use crate::common::{at_every_level, grays, hash, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::smoothing::smooth;
use phasestereo_match::matcher::on_threads;
use proptest::prelude::*;
use proptest::sample::select;

const REACH: u32 = 1 << 25;

fn smoothed(values: &Plane<i32>, deviation: f64, scale: f64) -> Plane<i32> {
    let gray = Gray::within(REACH, values.clone());

    at_every_level(|level| {
        smooth(&gray, deviation, scale, level, &Control::default()).expect("not cancelled")
    })
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn images_are_smoothed_like_by_the_reference(
        values in grays(80),
        deviation in prop_oneof![
            4 => 1e-3..1e8f64,
            1 => select(vec![f64::MIN_POSITIVE, 1e-300, 1e300, f64::INFINITY]),
        ],
        scale in select(vec![0.016, 1.0, 4.0, 16.0]),
    ) {
        let scale = if values.as_slice().iter().any(|value| value.abs() > 2) { 1.0 } else { scale };

        prop_assert_eq!(
            smoothed(&values, deviation, scale),
            reference::smooth_gray(&values, deviation, scale)
        );
    }
}

#[test]
fn bands_and_threads_leave_no_seam() {
    let values = Plane::from_fn(200, 37, |y, x| (hash(1, y, x) % 256) as i32);
    let expected = reference::smooth_gray(&values, 9.0, 16.0);

    for threads in 1..=4 {
        let found = on_threads(threads, || smoothed(&values, 9.0, 16.0)).expect("threads start");
        assert_eq!(found, expected, "{threads} threads");
    }
}

#[test]
fn noise_goes_and_edges_stay() {
    let noise = |y, x| (hash(2, y, x) % 9) as i32 - 4;
    let side = |x| if x < 30 { 1000 } else { 1400 };
    let values = Plane::from_fn(60, 60, |y, x| side(x) + noise(y, x));

    let found = smoothed(&values, 2.0 * 2.6, 1.0);

    let mut most = 0;
    let mut sum = [0.0; 2];

    for (y, x) in (0..60).flat_map(|y| (0..60).map(move |x| (y, x))) {
        let left = found.row(y)[x] - side(x);

        most = most.max(left.abs());
        sum[0] += f64::from(left * left);
        sum[1] += f64::from(noise(y, x).pow(2));
    }

    assert!(most <= 6, "{most}");
    assert!(sum[0] < 0.2 * sum[1], "{sum:?}");
}

#[test]
fn flat_images_and_images_almost_without_noise_stay() {
    let flat = Plane::from_fn(9, 9, |_, _| 77);
    assert_eq!(smoothed(&flat, 5.0, 1.0), flat);

    let values = Plane::from_fn(20, 30, |y, x| (hash(3, y, x) % 256) as i32);
    assert_eq!(smoothed(&values, 1e-6, 1.0), values);
}

#[test]
fn smoothed_images_have_steps_as_fine_as_32_bits_hold() {
    let bytes = 128 << 4;
    let reaches = [(128, bytes), (2048, bytes), (1 << 13, 1 << 17), (1 << 15, 1 << 17), (1 << 25, 1 << 25)];

    for (reach, expected) in reaches {
        let gray = Gray::within(reach, Plane::from_fn(5, 5, |y, x| (100 * x + y) as i32));
        let control = Control::default();
        let found = gray.smoothed(1.0, phasestereo_match::base::simd::Level::best(), &control);
        let found = found.expect("not cancelled");

        let scale = f64::from(expected) / f64::from(reach);

        assert_eq!((found.reach(), found.steps(1.0)), (expected, scale));
        assert_eq!(*found.plane(), reference::smooth_gray(gray.plane(), 1.0, scale));
    }
}

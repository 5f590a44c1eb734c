//! Calibrated cameras are rectified as in OpenCV 5.0: `stereoRectify` and `initUndistortRectifyMap` gave
//! these numbers.

use phasestereo::internals::rectification::calibration::Calibration;
use phasestereo::internals::rectification::cameras::{Cameras, NUMBERS};
use phasestereo::internals::rectification::warp;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::math;

const SIZE: (usize, usize) = (480, 640);
const CAMERA: [[[f64; 3]; 3]; 2] = [
    [[520.0, 0.0, 331.0], [0.0, 518.0, 236.0], [0.0, 0.0, 1.0]],
    [[531.0, 0.0, 309.0], [0.0, 533.0, 247.0], [0.0, 0.0, 1.0]],
];
const DISTORTION: [[f64; 12]; 2] = [
    [-0.21, 0.11, 0.0021, -0.0013, -0.034, 0.013, -0.021, 0.017, 0.0031, -0.0017, 0.0023, 0.0011],
    [0.13, -0.09, -0.0017, 0.0023, 0.028, 0.019, 0.015, -0.011, -0.0021, 0.0013, -0.0027, 0.0019],
];
/// By 3.7 degrees, with the digits of a file.
const ROTATION: [[f64; 3]; 3] = [
    [0.998_384_06, -0.023_789_64, -0.051_607_28],
    [0.022_178_21, 0.999_255_26, -0.031_576_13],
    [0.052_320_04, 0.030_380_54, 0.998_168_14],
];
const TRANSLATION: [f64; 3] = [-0.12, 0.007, 0.011];
const NONE: [[f64; 12]; 2] = [[0.0; 12]; 2];
const STRAIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn assert_near(found: &[f64], expected: &[f64], most: f64) {
    assert_eq!(found.len(), expected.len());
    let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart <= most && !found.iter().any(|value| value.is_nan()), "{found:?}: {apart}");
}

#[test]
fn cameras_are_rectified_as_by_opencv() {
    let turned = (ROTATION, TRANSLATION);
    let found = Calibration::new(CAMERA, DISTORTION, turned, SIZE).expect("legal");

    let left = [
        [0.986_488_396_389, -0.084_367_874_526, -0.140_437_550_315],
        [0.082_142_217_648, 0.996_386_943_268, -0.021_580_439_411],
        [0.141_750_837_283, 0.009_753_001_244, 0.989_854_322_159],
    ];
    let right = [
        [0.994_148_977_483, -0.057_992_023_687, -0.091_130_322_936],
        [0.059_419_497_646, 0.998_148_088_273, 0.013_027_554_515],
        [0.090_206_063_372, -0.018_366_248_009, 0.995_753_758_248],
    ];
    assert_near(found.rotation.as_flattened().as_flattened(), [left, right].concat().as_flattened(), 2e-8);

    let (focal, [cx, cy]) = (525.5, [410.544_809_341, 246.502_849_579]);
    let projection = |last| [[focal, 0.0, cx, last], [0.0, focal, cy, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let both = [projection(0.0), projection(-63.431_137_011)];
    assert_near(found.projection.as_flattened().as_flattened(), both.concat().as_flattened(), 1e-4);

    let q = found.q().expect("side by side").expect("at a distance");
    let last = [0.0, 0.0, 8.284_574_812, 0.0];
    let expected = [[1.0, 0.0, 0.0, -cx], [0.0, 1.0, 0.0, -cy], [0.0, 0.0, 0.0, focal], last];
    assert_near(q.as_flattened(), expected.as_flattened(), 1e-4);

    let places = found.places(SIZE, &Control::default()).expect("memory");
    let expected = [
        [
            ((0, 0), [44.427_113, 69.563_629]),
            ((0, 639), [596.233_887, -7.664_801]),
            ((240, 320), [316.012_238, 242.109_421]),
            ((479, 0), [72.297_119, 462.168_06]),
            ((479, 639), [639.668_335, 447.209_747]),
        ],
        [
            ((0, 0), [-60.979_279, 16.308_939]),
            ((0, 639), [596.703_735, -52.577_728]),
            ((240, 320), [266.017_853, 236.055_161]),
            ((479, 0), [-27.822_239, 486.149_323]),
            ((479, 639), [622.666_382, 474.321_136]),
        ],
    ];
    for (places, expected) in places.iter().zip(expected) {
        for ((y, x), expected) in expected {
            assert_near(&places.row(y)[x].map(f64::from), &expected, 1e-3);
        }
    }
}

#[test]
fn cameras_that_are_straight_stay_as_they_are() {
    let camera = [[520.0, 0.0, 331.0], [0.0, 520.0, 236.0], [0.0, 0.0, 1.0]];
    let turned = (STRAIGHT, [-0.1, 0.0, 0.0]);
    let found = Calibration::new([camera; 2], NONE, turned, SIZE).expect("legal");
    assert_eq!(found.rotation, [STRAIGHT; 2]);

    for (projection, last) in found.projection.into_iter().zip([0.0, -52.0]) {
        let expected: Vec<f64> =
            camera.iter().zip([last, 0.0, 0.0]).flat_map(|([a, b, c], last)| [*a, *b, *c, last]).collect();
        assert_near(projection.as_flattened(), &expected, 1e-4);
    }
}

#[test]
fn cameras_that_were_estimated_show_the_same_pixels() {
    let mut cameras = Cameras::new([0.4; NUMBERS], [0.1; NUMBERS], SIZE);
    cameras.shifts = [[3.0, -2.0], [-5.0, 7.0]];
    let found = Calibration::of_cameras(&cameras);
    assert_eq!(found.q(), Ok(None));

    let control = Control::default();
    let places = found.places(SIZE, &control).expect("memory");
    for (side, places) in places.iter().enumerate() {
        let expected = warp::places(&cameras, side, SIZE, &control).expect("memory");
        for (y, x) in [(0, 100), (100, 0), (240, 320), (470, 500)] {
            let [found, expected] = [places, &expected].map(|all| all.row(y)[x].map(f64::from));
            assert_near(&found, &expected, 1e-3);
        }
    }
}

#[test]
fn what_are_no_cameras_side_by_side_is_refused() {
    let of = |rotation, translation| {
        Calibration::new(CAMERA, NONE, (rotation, translation), SIZE).map(|found| found.q())
    };
    assert!(matches!(of(STRAIGHT, [-0.1, 0.09, 0.0]), Ok(Ok(Some(_)))));
    // One above the other, at no distance, and swapped.
    assert!(of(STRAIGHT, [-0.1, 0.1, 0.0]).is_err() && of(STRAIGHT, [0.0; 3]).is_err());
    assert!(of(STRAIGHT, [f64::NAN, 0.0, 0.0]).is_err());
    assert!(matches!(of(STRAIGHT, [0.1, 0.0, 0.0]), Ok(Err(_))));

    let about_y = |degrees: f64| {
        let (sin, cos) = math::sin_cos(degrees.to_radians());
        [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
    };
    assert!(of(about_y(60.0), [-0.1, 0.0, 0.0]).is_ok());
    assert!(of(about_y(91.0), [-0.1, 0.0, 0.0]).is_err());
    let scaled = about_y(10.0).map(|row| row.map(|value| 1.002 * value));
    assert!(of(scaled, [-0.1, 0.0, 0.0]).is_err(), "no rotation");
    assert!(of([[0.0; 3]; 3], [-0.1, 0.0, 0.0]).is_err());

    let mut flat = Calibration::new(CAMERA, NONE, (STRAIGHT, [-0.1, 0.0, 0.0]), SIZE).expect("legal");
    flat.projection[0][0][0] = 0.0;
    assert!(flat.places((4, 4), &Control::default()).is_err());
}

//! The estimation of relative blur: on pairs with known blur, of any type and size, bit-identical however the
//! work is cut up, and on images that contain no evidence.

use crate::common::estimates::estimate;
use crate::common::{hash, levels};
use ndarray::Array3;
use phasestereo::internals::estimation::blur::psf::Psf;
use phasestereo::internals::estimation::blur::taps::{Taps, path};
use phasestereo::internals::estimation::blur::{BlurSignature, Estimate, Side, is_as_before};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::{Plane, reflect};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::Mask;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::Pair;

const SIZE: (usize, usize) = (160, 224);
/// Disparity of every pixel of the scene.
const SHIFT: usize = 6;

/// Squares of many sizes, seen by one of the cameras.
fn scene(shift: usize) -> Plane<f32> {
    Plane::from_fn(SIZE.0, SIZE.1, |y, x| {
        let shade = |side: usize| hash(side as u64, y / side, (x + shift) / side) % 256;

        let weighed = [(13, 0.3), (7, 0.25), (4, 0.2), (2, 0.15), (1, 0.1)];
        weighed.iter().map(|(side, weight)| weight * shade(*side) as f32).sum()
    })
}

/// An image under a kernel.
fn convolved(image: &Plane<f32>, taps: &Taps) -> Plane<f32> {
    Plane::from_fn(image.rows(), image.cols(), |y, x| {
        let tap = |(dy, dx, value): (isize, isize, f64)| {
            let row = image.row(reflect(y as isize - dy, image.rows()));
            row[reflect(x as isize - dx, image.cols())] * value as f32
        };

        taps.places().map(tap).sum()
    })
}

/// The scene from the left and from the right, one view blurred, both with a little noise.
fn shots(side: Side, taps: Option<&Taps>) -> [Plane<f32>; 2] {
    [(Side::Left, 0), (Side::Right, SHIFT)].map(|(of, shift)| {
        let sharp = scene(shift);
        let taken = taps.filter(|_| of == side).map_or(sharp.clone(), |taps| convolved(&sharp, taps));

        Plane::from_fn(SIZE.0, SIZE.1, |y, x| {
            let grain = (hash(90 + of as u64, y, x) % 1001) as f32 / 500.0 - 1.0;
            (taken.row(y)[x] + 1.5 * grain).round()
        })
    })
}

/// Pixels of some type.
fn array<T>(plane: &Plane<f32>, pixel: impl Fn(f32) -> T) -> Array3<T> {
    Array3::from_shape_fn((plane.rows(), plane.cols(), 1), |(y, x, _)| pixel(plane.row(y)[x]))
}

fn bytes(plane: &Plane<f32>) -> Input {
    Image::U8(array(plane, |value| value as u8)).into()
}

fn floats(plane: &Plane<f32>) -> Input {
    Image::F32(array(plane, |value| value)).into()
}

fn pair(shots: &[Plane<f32>; 2], input: impl Fn(&Plane<f32>) -> Input) -> Pair {
    pair_of(shots.each_ref().map(input), 0, 16)
}

fn pair_of(inputs: [Input; 2], min: i64, count: i64) -> Pair {
    Pair::of_inputs(inputs, min, count).expect("a legal pair")
}

fn execution(threads: usize, level: Level) -> Execution {
    Execution { threads, level }
}

/// The estimate of a pair, on one thread.
fn estimated(pair: &Pair) -> Estimate {
    let matcher = Matcher::new(1).expect("a thread");
    estimate(pair, &matcher, execution(1, Level::best()), &Control::default()).expect("it runs")
}

/// Whether neither image is blurred relative to the other.
fn is_none(found: &Estimate) -> bool {
    found.blurs.len() == 1 && found.blurs[0].side.is_none() && found.blurs[0].taps.is_none()
}

/// Whether the pair has no estimate at all.
fn is_unknown(found: &Estimate, (rows, cols): (usize, usize)) -> bool {
    is_none(found)
        && found.certainty == 0.0
        && (found.gain, found.labels.as_slice(), found.tile) == (1.0, &[0][..], rows.max(cols))
}

/// Compares an estimate of one blur with the expected one.
fn check(found: &Estimate, side: Side, expected: Psf) {
    let [blur] = &found.blurs[..] else { panic!("{found:?}") };
    let psf = blur.psf.unwrap_or_else(|| panic!("{expected:?}: {found:?}"));

    assert_eq!((blur.side, psf.family), (Some(side), expected.family), "{expected:?}: {psf:?}");

    assert!((psf.size - expected.size).abs() <= (0.1 * expected.size).max(0.3), "{expected:?}: {psf:?}");

    let turn = (psf.angle - expected.angle + 90.0).rem_euclid(180.0) - 90.0;
    assert!(turn.abs() <= 5.0, "{expected:?}: {psf:?}");

    assert_eq!(blur.taps.as_ref(), Some(&psf.taps()));
    assert_eq!(found.labels.as_slice(), [0]);
    assert!(found.certainty > 0.5, "{found:?}");
}

#[test]
fn every_family_is_found_in_either_image() {
    let psfs = [
        Psf::gaussian(1.4),
        Psf::gaussian(3.0),
        Psf::disk(3.4),
        Psf::disk(5.0),
        Psf::motion(9.0, 0.0),
        Psf::motion(13.0, 110.0),
    ];

    for expected in psfs {
        for side in [Side::Left, Side::Right] {
            let shots = shots(side, Some(&expected.taps()));
            check(&estimated(&pair(&shots, bytes)), side, expected);
        }
    }
}

#[test]
fn there_is_none_where_neither_or_both_are_soft() {
    let sharp = estimated(&pair(&shots(Side::Left, None), bytes));
    assert!(is_none(&sharp) && sharp.certainty > 0.3, "{sharp:?}");

    let taps = Psf::disk(3.0).taps();

    let [left, _] = shots(Side::Left, Some(&taps));
    let [_, right] = shots(Side::Right, Some(&taps));

    let soft = estimated(&pair(&[left, right], bytes));
    assert!(is_none(&soft), "{soft:?}");
}

#[test]
fn a_kernel_of_no_family_is_measured() {
    let down = (0..110).map(|i| (f64::from(i) / 15.0 - 5.0, -2.0));
    let along = (0..90).map(|i| (2.3, f64::from(i) / 15.0 - 2.0));

    let hook = path(down.chain(along));

    for side in [Side::Left, Side::Right] {
        let found = estimated(&pair(&shots(side, Some(&hook)), bytes));
        let [blur] = &found.blurs[..] else { panic!("{found:?}") };

        assert_eq!((blur.side, blur.psf), (Some(side), None), "{found:?}");
        let taps = blur.taps.as_ref().expect("there is a blur");

        assert!((taps.values.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!((taps.radius() - hook.radius()).abs() < 0.7, "{} {}", taps.radius(), hook.radius());
    }
}

#[test]
fn contrast_is_that_of_the_left_image_to_the_right_one() {
    for side in [Side::Left, Side::Right] {
        for taps in [None, Some(Psf::disk(3.0).taps())] {
            let [left, right] = shots(side, taps.as_ref());

            let dim = left.map(|value| 0.5 * value + 20.0);
            let found = estimated(&pair(&[dim, right], floats));
            assert!(math::ln(found.gain / 0.5).abs() < 0.1, "{found:?}");
        }
    }
}

#[test]
fn noise_is_in_the_unit_of_the_pixels() {
    let shots = shots(Side::Left, Some(&Psf::disk(5.0).taps()));

    // Uniform in +-1.5 and rounded, the noise is 0.91. Fine texture of the sharp image counts as noise, too.
    let found = estimated(&pair(&shots, bytes));
    assert!((0.6..1.3).contains(&found.noise[0]) && found.noise[1] > found.noise[0], "{found:?}");

    let found = estimated(&pair(&shots, |plane| floats(&plane.map(|value| value * 1e-3))));
    assert!((6e-4..1.3e-3).contains(&found.noise[0]), "{found:?}");
}

/// How a plane becomes an image.
type MakeInput = Box<dyn Fn(&Plane<f32>) -> Input>;

#[test]
fn the_type_and_the_scale_of_the_pixels_hardly_matter() {
    let expected = Psf::disk(4.0);
    let shots = shots(Side::Right, Some(&expected.taps()));
    let plain = estimated(&pair(&shots, bytes));

    let inputs: [MakeInput; 6] = [
        Box::new(|plane| {
            let image = Image::U16(array(plane, |value| 257 * value as u16));
            image.into()
        }),
        Box::new(|plane| {
            let image = Image::U16(array(plane, |value| value as u16));
            image.into()
        }),
        Box::new(|plane| floats(&plane.map(|value| value * 1e-6))),
        Box::new(|plane| floats(&plane.map(|value| value * 1e6 - 1e7))),
        Box::new(|plane| {
            let image = Image::F64(array(plane, |value| f64::from(value) * 1e30));
            image.into()
        }),
        Box::new(|plane| {
            let gray = array(plane, |value| value as u8);
            let colors = (plane.rows(), plane.cols(), 3);
            let image = Image::U8(Array3::from_shape_fn(colors, |(y, x, _)| gray[(y, x, 0)]));
            image.into()
        }),
    ];

    for input in inputs {
        let found = estimated(&pair(&shots, input));
        check(&found, Side::Right, expected);

        let [one, other] = [&plain, &found].map(|found| found.blurs[0].psf.map_or(0.0, |psf| psf.size));
        assert!((one / other - 1.0).abs() < 0.01, "{one} {other}");
        assert!((plain.certainty - found.certainty).abs() < 0.01);
    }
}

#[test]
fn nothing_depends_on_threads_or_instructions() {
    let mixed = {
        let [soft, _] = shots(Side::Left, Some(&Psf::disk(4.0).taps()));
        let [sharp, right] = shots(Side::Left, None);
        let left =
            Plane::from_fn(
                SIZE.0,
                SIZE.1,
                |y, x| {
                    if x < SIZE.1 / 2 { soft.row(y)[x] } else { sharp.row(y)[x] }
                },
            );
        [left, right]
    };

    let curve = path((0..200).map(|i| {
        let turn = f64::from(i) / 50.0;
        (4.0 * math::sin(turn), 3.0 * math::cos(turn))
    }));

    for shots in [mixed, shots(Side::Right, Some(&curve))] {
        let pair = pair(&shots, bytes);
        let expected = estimated(&pair);
        assert!(!is_none(&expected), "{expected:?}");

        for threads in 1..=4 {
            let matcher = Matcher::new(threads).expect("threads");
            for level in levels() {
                let found = estimate(&pair, &matcher, execution(threads, level), &Control::default());
                assert_eq!(found.expect("it runs"), expected, "{threads} {}", level.name());
            }
        }
    }
}

#[test]

fn areas_of_different_blur_are_told_apart() {
    let [soft, _] = shots(Side::Left, Some(&Psf::disk(4.0).taps()));
    let [sharp, right] = shots(Side::Left, None);

    let edge = SIZE.1 / 2;
    let left = Plane::from_fn(SIZE.0, SIZE.1, |y, x| if x < edge { soft.row(y)[x] } else { sharp.row(y)[x] });

    let found = estimated(&pair(&[left, right], bytes));
    assert_eq!(found.blurs.len(), 2, "{found:?}");

    let disk = found.blurs.iter().position(|blur| blur.side == Some(Side::Left));
    let disk = disk.expect("a blur of the left image") as u8;

    let ((rows, cols), labels) = (found.labels.size(), found.labels.as_slice());
    assert_eq!((rows, cols), (SIZE.0.div_ceil(found.tile), SIZE.1.div_ceil(found.tile)));

    let right_ones =
        (0..rows * cols).filter(|tile| (labels[*tile] == disk) == (tile % cols * found.tile < edge)).count();
    assert!(right_ones * 100 >= 85 * rows * cols, "{right_ones} of {}", rows * cols);
}

#[test]

fn roles_and_directions_may_be_swapped() {
    let expected = Psf::motion(11.0, 30.0);
    let [left, right] = shots(Side::Left, Some(&expected.taps()));
    let swapped = pair_of([bytes(&right), bytes(&left)], -15, 16);
    check(&estimated(&swapped), Side::Right, expected);

    let mirror = |plane: &Plane<f32>| Plane::from_fn(SIZE.0, SIZE.1, |y, x| plane.row(y)[SIZE.1 - 1 - x]);
    let mirrored = pair(&[mirror(&right), mirror(&left)], bytes);
    check(&estimated(&mirrored), Side::Right, Psf::motion(11.0, 150.0));
}

#[test]
fn what_a_mask_covers_does_not_count() {
    let expected = Psf::gaussian(2.5);
    let shots = shots(Side::Left, Some(&expected.taps()));
    let covered = |y: usize, x: usize| y < 40 || (y * x).is_multiple_of(61);

    for fill in [f32::NAN, 1e9, f32::INFINITY] {
        let view = |plane: &Plane<f32>| {
            let pixel = |y: usize, x: usize| if covered(y, x) { fill } else { plane.row(y)[x] };
            let mask = Mask::from_fn(SIZE.0, SIZE.1, |y, x| !covered(y, x));
            Input { mask: Some(mask), ..floats(&Plane::from_fn(SIZE.0, SIZE.1, pixel)) }
        };

        check(&estimated(&pair(&shots, view)), Side::Left, expected);
    }
}

#[test]
fn images_without_texture_have_no_estimate() {
    let view = |rows, cols, pixel: fn(usize, usize) -> f32| bytes(&Plane::from_fn(rows, cols, pixel));
    let noise: fn(usize, usize) -> f32 = |y, x| (hash(5, y, x) % 256) as f32;
    let flat: fn(usize, usize) -> f32 = |_, _| 77.0;

    let pairs = [
        (1, 1, noise, noise),
        (63, 64, noise, noise),
        (64, 63, noise, noise),
        (1, 500, noise, noise),
        (80, 90, flat, flat),
        (160, 200, flat, noise),
        (160, 200, noise, flat),
    ];

    for (rows, cols, left, right) in pairs {
        let (left, right) = (view(rows, cols, left), view(rows, cols, right));
        let pair = pair_of([left, right], 0, 1);

        let found = estimated(&pair);
        assert!(is_unknown(&found, (rows, cols)), "{rows} x {cols}: {found:?}");
    }
}

#[test]
fn flat_floats_have_no_estimate() {
    for value in [0.0, -3.5, 1e-30, 1e30] {
        let view = |plane: &Plane<f32>| floats(&plane.map(|_| value));
        let found = estimated(&pair(&shots(Side::Left, None), view));
        assert!(is_unknown(&found, SIZE), "{value}: {found:?}");
    }
}

#[test]
fn images_without_valid_pixels_have_no_estimate() {
    let shots = shots(Side::Left, Some(&Psf::disk(4.0).taps()));

    for masked in [[true, true], [true, false], [false, true]] {
        let inputs = [0, 1].map(|side| Input {
            mask: masked[side].then(|| Mask::from_fn(SIZE.0, SIZE.1, |_, _| false)),
            ..bytes(&shots[side])
        });

        let found = estimated(&pair_of(inputs, 0, 16));
        assert!(is_unknown(&found, SIZE), "{masked:?}: {found:?}");
    }
}

#[test]
fn a_single_row_of_texture_is_no_blur() {
    let row = |y: usize, x: usize| if y == 70 { (hash(5, 0, x) % 256) as f32 } else { 90.0 };
    let view = bytes(&Plane::from_fn(160, 200, row));
    let found = estimated(&pair_of([view.clone(), view], 0, 16));
    assert!(is_none(&found), "{found:?}");
}

#[test]
fn the_least_image_has_a_single_block() {
    let image = Plane::from_fn(64, 64, |y, x| scene(0).row(y)[x]);
    let soft = convolved(&image, &Psf::disk(3.0).taps());

    let found = estimated(&pair_of([bytes(&soft), bytes(&image)], 0, 1));
    assert_eq!(found.blurs[0].side, Some(Side::Left), "{found:?}");
}

#[test]
fn disparities_beyond_all_blocks_have_no_estimate() {
    let [left, right] = shots(Side::Left, None);
    let pair = pair_of([bytes(&left), bytes(&right)], 200, 20);
    assert!(is_unknown(&estimated(&pair), SIZE));
}

/// Whether a quick comparison finds the blur of a pair unchanged.
fn looks_as(before: &BlurSignature, shots: &[Plane<f32>; 2], level: Level) -> bool {
    let pair = pair(shots, bytes);
    let (matcher, control) = (Matcher::new(1).expect("a thread"), Control::default());

    let runtime = Runtime { matcher: &matcher, execution: execution(1, level), control: &control };
    is_as_before(&pair, before, runtime).expect("it runs")
}

#[test]
fn a_glance_sees_whether_blur_has_changed() {
    let disk = Psf::disk(3.0).taps();
    let states = [None, Some(&disk)].map(|taps| shots(Side::Left, taps));

    for (now, state) in states.iter().enumerate() {
        let before = estimated(&pair(state, bytes)).signature;

        for (then, other) in states.iter().enumerate() {
            assert!(levels().into_iter().all(|level| looks_as(&before, other, level) == (now == then)));
        }

        let brighter = state.each_ref().map(|plane| plane.map(|value| 0.9 * value + 12.0));
        assert!(looks_as(&before, &brighter, Level::best()), "both images are brighter");

        let [left, right] = state.clone();
        assert!(!looks_as(&before, &[left.map(|value| 0.7 * value), right], Level::best()));
    }
}

#[test]
fn a_glance_sees_a_patch_in_one_image() {
    let [left, right] = shots(Side::Left, None);
    let before = estimated(&pair(&[left.clone(), right.clone()], bytes)).signature;

    let [soft, _] = shots(Side::Left, Some(&Psf::disk(4.0).taps()));
    let patched = Plane::from_fn(SIZE.0, SIZE.1, |y, x| {
        let is_soft = y < SIZE.0 / 2 && x > SIZE.1 / 2;
        if is_soft { soft.row(y)[x] } else { left.row(y)[x] }
    });

    assert!(!looks_as(&before, &[patched, right], Level::best()));
}

#[test]
fn a_glance_at_nothing_or_at_smaller_images_finds_a_change() {
    let whole = shots(Side::Left, None);
    let before = estimated(&pair(&whole, bytes)).signature;

    assert!(looks_as(&before, &whole, Level::best()));
    assert!(!looks_as(&BlurSignature::default(), &whole, Level::best()));

    let part = whole.map(|plane| Plane::from_fn(SIZE.0 - 1, SIZE.1, |y, x| plane.row(y)[x]));
    assert!(!looks_as(&before, &part, Level::best()));
}

#[test]
fn an_estimation_can_be_cancelled() {
    let control = Control::default();
    control.cancel();

    let matcher = Matcher::new(1).expect("a thread");
    let pair = pair(&shots(Side::Left, None), bytes);

    let found = estimate(&pair, &matcher, execution(1, Level::best()), &control);
    assert!(matches!(found, Err(Error::Cancelled)), "{found:?}");
}

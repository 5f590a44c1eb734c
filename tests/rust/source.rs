//! Pairs that are read a few rows at a time: their results equal those of whole ones, bit for bit.

use crate::common::estimates::{estimate, estimate_by_rows};
use crate::common::parts::{Slow, Stored};
use crate::common::{hash, levels, mask, random};
use ndarray::Array3;
use phasestereo::internals::estimation::blur::psf::Psf;
use phasestereo::internals::estimation::blur::taps::{Taps, path};
use phasestereo::internals::estimation::blur::{Blur, Estimate};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::{Plane, reflect};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::conversion::Conversion;
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::texture::{Roughness, Texture};
use phasestereo_match::image::view::{Mask, View};
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::source::roughness;
use proptest::prelude::*;
use proptest::sample::select;

/// Disparity of every pixel of a scene.
const SHIFT: usize = 6;
/// The fewest rows that an estimation of blur requests at a time: those of a block.
const LEAST_ROWS: usize = 64;

/// Squares of many sizes, seen by a camera `shift` pixels further left.
fn scene((rows, cols): (usize, usize), shift: usize) -> Plane<f32> {
    Plane::from_fn(rows, cols, |y, x| {
        let shade = |side: usize| hash(side as u64, y / side, (x + shift) / side) % 256;

        let weighed = [(13, 0.3), (7, 0.25), (4, 0.2), (2, 0.15), (1, 0.1)];
        weighed.iter().map(|(side, weight)| weight * shade(*side) as f32).sum()
    })
}

/// An image under a kernel.
fn blurred(image: &Plane<f32>, taps: &Taps) -> Plane<f32> {
    Plane::from_fn(image.rows(), image.cols(), |y, x| {
        let tap = |(dy, dx, value): (isize, isize, f64)| {
            let row = image.row(reflect(y as isize - dy, image.rows()));
            row[reflect(x as isize - dx, image.cols())] * value as f32
        };

        taps.places().map(tap).sum()
    })
}

/// Both images of a scene, the left one blurred where `is_soft`, with a little noise.
fn shots(
    size: (usize, usize),
    taps: Option<&Taps>,
    is_soft: impl Fn(usize, usize) -> bool,
) -> [Plane<f32>; 2] {
    let [sharp, right] = [0, SHIFT].map(|shift| scene(size, shift));
    let soft = taps.map(|taps| blurred(&sharp, taps));

    let left = Plane::from_fn(size.0, size.1, |y, x| {
        let soft = soft.as_ref().filter(|_| is_soft(y, x));
        soft.unwrap_or(&sharp).row(y)[x]
    });

    let mut seed = 90;
    [left, right].map(|plane| {
        seed += 1;
        Plane::from_fn(size.0, size.1, |y, x| {
            (plane.row(y)[x] + 1.5 * ((hash(seed, y, x) % 1001) as f32 / 500.0 - 1.0)).round()
        })
    })
}

/// Pixels of some type.
fn array<T>(plane: &Plane<f32>, pixel: impl Fn(f32) -> T) -> Array3<T> {
    Array3::from_shape_fn((plane.rows(), plane.cols(), 1), |(y, x, _)| pixel(plane.row(y)[x]))
}

/// An image of pixels of one type that no narrower one holds: 0 bytes, 1 words, 2 and 3 floats.
fn input(plane: &Plane<f32>, kind: usize) -> Input {
    let image = match kind {
        0 => Image::U8(array(plane, |value| value as u8)),
        1 => Image::U16(array(plane, |value| 200 * value as u16 + 1)),
        2 => Image::F32(array(plane, |value| 1e-3 * value - 7.0)),
        _ => Image::F64(array(plane, |value| 1e6 * f64::from(value) + math::sin(f64::from(value)))),
    };

    Input::from(image)
}

fn pair(inputs: [Input; 2]) -> Stored {
    let count = inputs[0].size().1.min(16) as i64;
    Stored::new(inputs, 0, count)
}

/// Rows in which nothing is valid: at both ends of the image, around the borders of parts, further than
/// masked rows copy from.
fn empty_rows(y: usize, rows: usize) -> bool {
    y < 3 || (60..70).contains(&y) || (190..320).contains(&y) || y + 40 > rows
}

fn with_masks([left, right]: [Input; 2], percent: u64) -> [Input; 2] {
    [(left, 5), (right, 6)].map(|(input, seed)| {
        let (rows, cols) = input.size();
        let some = mask(rows, cols, percent, seed);
        let mask = Mask::from_fn(rows, cols, |y, x| some.row(y)[x] && !empty_rows(y, rows));
        Input { mask: Some(mask), ..input }
    })
}

fn execution(threads: usize, level: Level) -> Execution {
    Execution { threads, level }
}

/// The estimate of a pair, in memory or read by at most this many rows.
fn estimated(stored: &Stored, most_rows: Option<usize>, threads: usize) -> Estimate {
    let matcher = Matcher::new(threads).expect("threads");
    let execution = execution(threads, Level::best());
    let control = Control::default();

    let found = match most_rows {
        None => estimate(&stored.pair, &matcher, execution, &control),
        Some(most) => {
            let source = Slow::new(stored, most);

            let found = estimate_by_rows(&source, &matcher, execution, &control);

            let longest = source.asked().iter().map(ExactSizeIterator::len).max();
            let margins = 2 * (97 + 4);
            assert!(longest <= Some(most.max(LEAST_ROWS) + margins), "{longest:?}");
            found
        }
    };

    found.expect("it runs")
}

/// Compares estimates by rows with that of the whole.
fn check(pair: &Stored, expected: &Estimate) {
    for (most, threads) in [(1, 1), (64, 1), (100, 2), (161, 3), (10_000, 1)] {
        assert_eq!(estimated(pair, Some(most), threads), *expected, "{most} rows at a time");
    }
}

#[test]
fn blur_of_every_kind_is_that_of_the_whole() {
    let curve = curve();

    let (disk, motion) = (Psf::disk(4.0).taps(), Psf::motion(9.0, 30.0).taps());
    let size = (420, 150);

    let kinds = [(None, 1), (Some(&disk), 1), (Some(&motion), 1), (Some(&curve), 1)];
    for (kind, (taps, count)) in kinds.into_iter().enumerate() {
        let pair = pair(shots(size, taps, |_, _| true).map(|plane| input(&plane, kind)));

        let expected = estimated(&pair, None, 1);
        assert_eq!(expected.blurs.len(), count, "{expected:?}");
        assert_eq!(expected.blurs[0].taps.is_some(), taps.is_some(), "{expected:?}");
        let is_measured = expected.blurs[0].taps.is_some() && expected.blurs[0].psf.is_none();
        assert_eq!(is_measured, kind == 3, "{expected:?}");

        check(&pair, &expected);
    }
}

#[test]
fn maps_of_blur_are_those_of_the_whole() {
    let disk = Psf::disk(4.0).taps();
    let shots = shots((640, 130), Some(&disk), |y, _| (150..400).contains(&y));
    for kind in 0..4 {
        let pair = pair(shots.each_ref().map(|plane| input(plane, kind)));
        let expected = estimated(&pair, None, 1);

        assert_eq!(expected.blurs.len(), 2, "{expected:?}");
        assert!(expected.labels.rows() > 1, "{expected:?}");

        check(&pair, &expected);
    }
}

/// A motion along a curve, which no family explains.
fn curve() -> Taps {
    path((0..200).map(|i| {
        let turn = f64::from(i) / 50.0;
        (4.0 * math::sin(turn), 3.0 * math::cos(turn))
    }))
}

/// Each of several blurs is measured on its best tiles, which may be anywhere.
#[test]
fn measured_kernels_of_some_rows_are_those_of_the_whole() {
    let even = Taps::new(3, vec![1.0; 49]);
    let mut are_measured = vec![];

    for (taps, soft) in [(&even, 180..420), (&even, 0..230), (&curve(), 180..420)] {
        let shots = shots((420, 130), Some(taps), |y, _| soft.contains(&y));
        let pair = pair(shots.map(|plane| input(&plane, 0)));

        let expected = estimated(&pair, None, 1);
        let is_measured = |blur: &Blur| blur.taps.is_some() && blur.psf.is_none();
        are_measured.push(expected.blurs.len() > 1 && expected.blurs.iter().any(is_measured));

        check(&pair, &expected);
    }

    assert!(are_measured.contains(&true), "{are_measured:?}");
}

#[test]
fn blur_beside_masks_is_that_of_the_whole() {
    let disk = Psf::disk(3.0).taps();

    let shots = shots((500, 150), Some(&disk), |y, _| y > 350);

    for (kind, percent) in [(0, 100), (1, 97), (2, 97), (3, 60)] {
        let views = with_masks(shots.each_ref().map(|plane| input(plane, kind)), percent);
        let pair = pair(views);
        check(&pair, &estimated(&pair, None, 1));
    }
}

#[test]
fn images_without_texture_or_valid_pixels_have_no_estimate() {
    let sizes = [(1, 1), (63, 200), (200, 63), (64, 64), (300, 70)];
    for size in sizes {
        let flat = pair([70.0, 71.0].map(|value| input(&Plane::from_fn(size.0, size.1, |_, _| value), 0)));

        let expected = estimated(&flat, None, 1);
        assert!(expected.certainty <= 0.0);
        check(&flat, &expected);
    }

    let views = shots((200, 100), None, |_, _| true).map(|plane| input(&plane, 2));
    let nowhere =
        pair(views.map(|input| Input { mask: Some(Mask::from_fn(200, 100, |_, _| false)), ..input }));
    check(&nowhere, &estimated(&nowhere, None, 1));
}

/// The image as if compressed in blocks of 8 x 8 pixels, which begin anywhere: each is off by its own gray
/// value.
fn in_blocks(plane: &Plane<f32>, seed: u64) -> Plane<f32> {
    Plane::from_fn(plane.rows(), plane.cols(), |y, x| {
        let off = hash(seed, (y + 3) / 8, (x + 6) / 8) % 7;

        (plane.row(y)[x] * 0.8 + 20.0 + off as f32).round()
    })
}

/// The image with one pixel in 300 black or white.
fn with_impulses(plane: &Plane<f32>, seed: u64) -> Plane<f32> {
    Plane::from_fn(plane.rows(), plane.cols(), |y, x| match hash(seed, y, x) % 600 {
        0 => 0.0,
        1 => 255.0,
        _ => plane.row(y)[x],
    })
}

/// Surfaces without much detail.
fn smooth_shots(size: (usize, usize)) -> [Plane<f32>; 2] {
    let taps = Psf::gaussian(1.5).taps();
    [0, SHIFT].map(|shift| blurred(&scene(size, shift), &taps))
}

#[test]
fn impulses_and_blocks_are_those_of_the_whole() {
    let [left, right] = smooth_shots((300, 150));
    let shots = [with_impulses(&left, 4), in_blocks(&right, 5)];

    for (kind, percent) in [(0, 100), (0, 97), (1, 100), (1, 97), (2, 100), (3, 97)] {
        let views = shots.each_ref().map(|plane| input(plane, kind));
        let pair = pair(if percent < 100 { with_masks(views, percent) } else { views });
        let expected = estimated(&pair, None, 1);

        // 255 times 200 takes all 16 bits.
        let level = [1.0, 256.0, 1e-3 * 255.0 / 256.0, 1e6 * 255.0 / 256.0][kind];

        let height = expected.impulses[0] / (20.0 * level);
        assert!((height - 1.0).abs() < 0.1, "{:?}", expected.impulses);
        assert!(expected.impulses[1] <= 0.0, "{:?}", expected.impulses);

        let coding = expected.coding.map(|coding| coding / [1.0, 200.0, 1e-3, 1e6][kind]);
        // Masked pixels take the values of others, across borders of blocks; and the levels of floats are
        // those of the

        // image's own range.
        let least = if percent == 100 && kind < 2 { 1.0 } else { 0.0 };
        assert!(coding[0] < 0.5 && coding[1] > least, "{kind} {percent} {coding:?}");

        check(&pair, &expected);
    }
}

#[test]
fn images_without_impulses_or_blocks_have_none() {
    for (kind, taps) in [(0, None), (1, None), (2, Some(Psf::disk(3.0).taps()))] {
        let shots = shots((200, 150), taps.as_ref(), |_, _| true);
        let found = estimated(&pair(shots.map(|plane| input(&plane, kind))), None, 1);

        assert!(found.impulses.iter().all(|height| *height <= 0.0), "{:?}", found.impulses);
    }
}

/// Noise, with whole rows masked.
fn noise(rows: usize, cols: usize, kind: usize, percent: Option<u64>, seed: u64) -> Input {
    let plane = Plane::from_fn(rows, cols, |y, x| (hash(seed, y, x) % 251) as f32);
    let mask = percent.map(|percent| {
        let some = mask(rows, cols, percent, seed);
        let lost = seed as usize % (rows + 1);

        Mask::from_fn(rows, cols, |y, x| {
            some.row(y)[x] && !(lost..lost + rows / 2).contains(&y) && !hash(seed, y, cols).is_multiple_of(9)
        })
    });

    Input { mask, ..input(&plane, kind) }
}

/// Reference implementation of the range of a float image: of all its valid pixels, or of every n-th one of a
/// large image.
fn range_of(input: &Input) -> IntensityRange {
    let (rows, cols) = input.size();
    let stride = (rows * cols).div_ceil(1 << 16);

    let of_every = |stride: usize| {
        let places = (0..rows * cols).step_by(stride).map(|place| (place / cols, place % cols));
        let valid = places.filter(|(y, x)| input.is_valid(*y, *x));
        let thousandths = |y: usize, x: usize| match &input.image {
            Image::F32(pixels) => 1000.0 * f64::from(pixels[(y, x, 0)]),
            Image::F64(pixels) => 1000.0 * pixels[(y, x, 0)],
            _ => unreachable!("floats"),
        };
        let mut values: Vec<_> = valid.map(|(y, x)| thousandths(y, x)).collect();
        values.sort_by(f64::total_cmp);

        values
    };

    let sample = of_every(stride);
    if let Some(last) = sample.len().checked_sub(1) {
        let outliers = last / 1000;
        let (black, white) = (sample[outliers], sample[last - outliers]);
        if black < white {
            return IntensityRange { black, white };
        }
    }

    match &of_every(1)[..] {
        [] => IntensityRange { black: 0.0, white: 0.0 },
        all => IntensityRange { black: all[0], white: all[all.len() - 1] },
    }
}

/// The roughness of a whole view.
fn roughness_of(view: &View) -> Roughness {
    Texture::new(view.gray().clone()).roughness
}

/// Compares conversions and roughness, read by at most this many rows, with those of the whole. Every row is
/// read once, in order, for its range, and only until it is clear that the pixels are floats.
fn check_scales(stored: &Stored, most_rows: usize) -> std::result::Result<(), TestCaseError> {
    let source = Slow::new(stored, most_rows);
    let control = Control::default();
    let pair = &stored.pair;

    let found = source.conversions(&control).expect("all rows");
    prop_assert_eq!(found, Conversion::of_pair(stored.inputs.each_ref()));
    if found[0].integers.is_none() {
        let ranges = stored.inputs.each_ref().map(range_of);
        prop_assert_eq!(found.map(|conversion| conversion.range), ranges.map(Some));
    }

    let parts = pair.size().0.div_ceil(most_rows);
    prop_assert!(source.asked().len() <= 2 * parts);

    for level in levels() {
        let source = Slow::new(stored, most_rows);
        let rough = roughness(&source, 0.0, level, &control).expect("all rows");
        prop_assert_eq!(rough, roughness_of(pair.views()[0]));

        if pair.views()[0].mask().is_none() {
            prop_assert_eq!(source.asked().len(), parts);
        }
    }

    Ok(())
}

proptest! {
    #![proptest_config(random(100))]

    #[test]
    fn ranges_and_roughness_are_those_of_the_whole(
        (rows, cols) in (1usize..=330, 1usize..=40),
        kind in 2usize..=3,
        percents in [0, 1].map(|_| prop::option::of(select(vec![0, 3, 60, 99, 100]))),
        most_rows in 1usize..=100,
        seed in any::<u64>(),
    ) {
        let [left, right] = percents;
        let views = [noise(rows, cols, kind, left, seed), noise(rows, cols, kind, right, !seed)];
        check_scales(&pair(views), most_rows)?;
    }
}

#[test]
fn ranges_of_large_images_are_those_of_their_sample() {
    for cols in [257, 700] {
        let views = [Some(90), None].map(|percent| noise(400, cols, 2, percent, 4));
        for most_rows in [1, 77, 400] {
            check_scales(&pair(views.clone()), most_rows).expect("that of the sample");
        }
    }
}

#[test]
fn an_image_whose_sample_is_of_one_value_has_the_range_of_all() {
    // Every fourth of 256 x 1024 pixels is sampled.
    let odd = |value: f32| Plane::from_fn(256, 1024, |y, x| if (y, x) == (200, 2) { value } else { 9.0 });
    for (value, most_rows) in [(30.0, 64), (-30.0, 256), (9.0, 64)] {
        let views = [odd(value), odd(9.5)].map(|plane| input(&plane, 2));
        check_scales(&pair(views), most_rows).expect("that of all pixels");
    }
}

#[test]
fn integers_are_as_rough_in_parts_as_on_the_whole() {
    for kind in 0..2 {
        for percent in [None, Some(50), Some(0)] {
            let pair = pair([percent, None].map(|percent| noise(301, 33, kind, percent, 8)));

            for most_rows in [1, 95, 150] {
                for impulses in [0.0, 3.0, 2000.0] {
                    let source = Slow::new(&pair, most_rows);
                    let found = roughness(&source, impulses, Level::best(), &Control::default());

                    let (level, control) = (Level::best(), Control::default());
                    let left = pair.pair.views()[0].repaired(impulses, level, &control);
                    assert_eq!(found.expect("all rows"), roughness_of(&left.expect("memory")));
                }
            }
        }
    }
}

/// Empty rows up to the largest distance that rows copy from, and beyond, where they are zero.
#[test]
fn empty_rows_are_as_rough_as_those_they_copy_from_other_parts() {
    for (lost, above) in [(95, 1), (96, 1), (190, 0)] {
        let rows = 1 + lost + 40;
        let valid = |y: usize| y < above || y > lost;
        let mask = Mask::from_fn(rows, 20, |y, _| valid(y));

        let left = Input { mask: Some(mask), ..noise(rows, 20, 0, None, 3) };
        let pair = pair([left, noise(rows, 20, 0, None, 4)]);

        let expected = roughness_of(pair.pair.views()[0]);
        for most_rows in (1..=5).chain(lost - 2..=lost + 3) {
            let source = Slow::new(&pair, most_rows);
            let found = roughness(&source, 0.0, Level::best(), &Control::default());
            let found = found.expect("all rows");
            assert_eq!(found, expected, "{lost} empty rows, {most_rows} at a time");
        }
    }
}

/// Work on a source, by rows.
type RowWork = fn(&Slow, &Matcher, &Control) -> Result<()>;

/// Everything that is computed by rows.
const ROW_WORKS: [RowWork; 3] = [
    |source, _, control| source.conversions(control).map(drop),
    |source, _, control| roughness(source, 0.0, Level::best(), control).map(drop),
    |source, matcher, control| {
        estimate_by_rows(source, matcher, execution(2, Level::best()), control).map(drop)
    },
];

#[test]
fn an_error_of_a_source_is_passed_on() {
    let disk = Psf::disk(4.0).taps();
    let views = shots((330, 100), Some(&disk), |_, _| true).map(|plane| input(&plane, 2));
    let pair = pair(with_masks(views, 99));
    let matcher = Matcher::new(2).expect("threads");

    for work in ROW_WORKS {
        let whole = Slow::new(&pair, 64);

        work(&whole, &matcher, &Control::default()).expect("all rows");

        let count = whole.asked().len();
        assert!(count > 3, "{count}");

        // The first read, an early one, one in the middle, and the last.
        for broken in [0, 1, count / 2, count - 1] {
            let source = Slow { broken: Some(broken), ..Slow::new(&pair, 64) };
            let refused = work(&source, &matcher, &Control::default()).expect_err("it is torn");

            assert_eq!(refused, Error::value("read", "a torn tape", "a whole one"));
            assert_eq!(source.asked().len(), broken + 1, "nothing is read after the error");
        }
    }
}

#[test]
fn work_by_rows_can_be_cancelled() {
    let views = shots((200, 100), None, |_, _| true).map(|plane| input(&plane, 2));
    let pair = pair(views);
    let matcher = Matcher::new(1).expect("a thread");

    let control = Control::default();
    control.cancel();

    for work in ROW_WORKS {
        let stopped = work(&Slow::new(&pair, 64), &matcher, &control);
        assert_eq!(stopped, Err(Error::Cancelled));
    }
}

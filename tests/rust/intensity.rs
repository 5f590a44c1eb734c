//! Intensities: scale, offset and type of the pixels must not change anything.

use crate::common::{gray_of, inputs, level_pair, random, views};
use ndarray::Array3;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::conversion::{Conversion, Integers};
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::{Mask, View};
use proptest::prelude::*;

fn view(image: Image) -> View {
    gray_of(image)
}

/// The gray values of pixels as these integers of 16 bits, or as floats, whatever their values.
fn converted(image: Image, integers: Option<Integers>) -> View {
    let conversion = Conversion { integers, is_gray: false, range: None };
    conversion.view(image.into()).expect("memory")
}

const WORDS: Option<Integers> = Some(Integers { step: 1.0, bits: 16 });

fn gray(view: &View) -> Plane<i32> {
    view.gray().clone()
}

fn bytes(rows: usize, cols: usize, channels: usize) -> impl Strategy<Value = Array3<u8>> {
    prop::collection::vec(any::<u8>(), rows * cols * channels)
        .prop_map(move |data| Array3::from_shape_vec((rows, cols, channels), data).expect("the right length"))
}

/// A gray float image of one row.
fn row(values: &[f64]) -> View {
    let shape = (1, values.len(), 1);
    let pixels = Array3::from_shape_vec(shape, values.to_vec()).expect("the right length");
    converted(Image::F64(pixels), None)
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn scaling_floats_by_a_power_of_two_changes_nothing(
        left in inputs(5, 6, 3),
        right in inputs(5, 6, 3),
        power in -900i32..900,
    ) {
        let scaled = |input: &Input| match &input.image {
            Image::F64(pixels) => gray_of(Input {
                image: Image::F64(pixels.mapv(|p| p * 2f64.powi(power))),
                ..input.clone()
            }),
            _ => unreachable!("kind 3 is double precision"),
        };

        let (far_left, far_right) = (scaled(&left), scaled(&right));
        let [left, right] = [left, right].map(gray_of);

        prop_assert_eq!(gray(&left), gray(&far_left));
        prop_assert_eq!(level_pair([&left, &right], None), level_pair([&far_left, &far_right], None));
    }

    #[test]
    fn an_offset_of_a_float_image_changes_no_gray_value(
        pixels in bytes(4, 5, 3),
        offset in -1000i16..1000,
    ) {
        let float = |offset: i16| {
            converted(Image::F32(pixels.mapv(|p| f32::from(p) + f32::from(offset))), None)
        };
        prop_assert_eq!(gray(&float(0)), gray(&float(offset)));
    }

    #[test]
    fn luminances_of_integers_are_nearest_sixteenths(pixels in bytes(3, 4, 3)) {
        let bytes = Some(Integers { step: 1.0, bits: 8 });
        let narrow = gray(&converted(Image::U8(pixels.clone()), bytes));
        let wide = gray(&converted(Image::U16(pixels.mapv(u16::from)), WORDS));

        for ((y, x), _) in pixels.index_axis(ndarray::Axis(2), 0).indexed_iter() {
            let [r, g, b] = [0, 1, 2].map(|c| i32::from(pixels[(y, x, c)]));
            let sixteenths = 16.0 * f64::from(9798 * r + 19235 * g + 3735 * b) / 32768.0;
            let nearest = (sixteenths + 0.5).floor() as i32;
            prop_assert_eq!(narrow.row(y)[x], nearest - 16 * 128);
            prop_assert_eq!(wide.row(y)[x], nearest - 16 * 32_768);
        }
    }

    #[test]
    fn gray_integers_keep_their_unit(pixels in bytes(3, 4, 1)) {
        let narrow = gray(&view(Image::U8(pixels.clone())));
        let wide = gray(&converted(Image::U16(pixels.mapv(u16::from)), WORDS));

        for ((y, x, _), &pixel) in pixels.indexed_iter() {
            prop_assert_eq!(narrow.row(y)[x], i32::from(pixel) - 128);
            prop_assert_eq!(wide.row(y)[x], i32::from(pixel) - 32_768);
        }
    }

    #[test]
    fn no_gray_value_is_beyond_the_announced_reach(view in (0u8..4).prop_flat_map(|kind| views(4, 5, kind))) {
        let reach = view.scale().reach();

        prop_assert!(gray(&view).as_slice().iter().all(|value| value.unsigned_abs() <= reach));
    }

    #[test]
    fn levels_are_sixteenths_of_gray_levels_above_black(pixels in bytes(2, 3, 1)) {
        let one = view(Image::U8(pixels.clone()));
        let [levels, _] = level_pair([&one, &one], None);

        let expected: Vec<u16> = pixels.iter().map(|&p| 16 * (255 + u16::from(p))).collect();
        prop_assert_eq!(levels.as_slice(), &expected[..]);
    }
}

#[test]
fn blurred_images_keep_fractions_and_their_unit() {
    let thirds = Kernel::new(&Plane::from_fn(1, 3, |_, _| 1.0 / 3.0)).expect("a legal kernel");
    let convolved = |view: View| {
        let gray = Gray::of_view(&view);
        let blurred = gray.convolved(&thirds, Level::best(), &Control::default()).expect("memory");
        (gray.plane().clone(), blurred.plane().clone(), blurred.steps(1.0) / gray.steps(1.0))
    };

    let pixels = Array3::from_shape_fn((1, 60, 3), |(_, x, c)| (x * x * (c + 1) % 251) as u8);
    let gray = pixels.slice(ndarray::s![.., .., ..1]).to_owned();

    for (image, finer) in [
        (view(Image::U8(gray.clone())), 16.0),
        (view(Image::U8(pixels.clone())), 16.0),
        (converted(Image::U16(gray.mapv(|p| 257 * u16::from(p))), WORDS), 16.0),
        (converted(Image::U16(pixels.mapv(|p| 257 * u16::from(p))), WORDS), 16.0),
        (converted(Image::F32(gray.mapv(|p| f32::from(p) / 255.0)), None), 2.0),
    ] {
        let (sharp, blurred, unit) = convolved(image);

        assert!((unit - finer).abs() < 1e-9, "{unit}, {finer}");

        for x in 1..59 {
            let around = [x - 1, x, x + 1].map(|x| f64::from(sharp.row(0)[x]));
            let mean = around.iter().sum::<f64>() / 3.0;
            let most = around.map(f64::abs).iter().sum::<f64>();

            // Quantized weights are off by a third of 2^-14.
            let error = f64::from(blurred.row(0)[x]) / unit - mean;
            assert!(error.abs() <= 0.5 / unit + 1e-4 * most, "{x}: {error}");
        }
    }
}

#[test]
fn noise_is_converted_to_steps_of_the_pixels_unit() {
    let bytes = view(Image::U8(Array3::zeros((1, 2, 1))));
    assert!((bytes.scale().steps(2.0) - 2.0).abs() < 1e-9);
    let words = converted(Image::U16(Array3::zeros((1, 2, 3))), WORDS);
    assert!((words.scale().steps(2.0) - 32.0).abs() < 1e-9, "sixteenths");

    for white in [1.0, 1e-200, 3e250] {
        let ramp = Array3::from_shape_fn((1, 1000, 1), |(_, x, _)| white / 999.0 * x as f64);
        let view = converted(Image::F64(ramp), None);
        let row = view.gray().row(0);
        assert!((view.scale().steps(white) / f64::from(row[999] - row[0]) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn masked_pixels_have_no_effect() {
    let mask = Mask::from_fn(3, 3, |y, x| (y, x) != (1, 1));

    let with = |hidden: f32| {
        let pixel = |(y, x, _)| if (y, x) == (1, 1) { hidden } else { (3 * y + x) as f32 };
        let image = Image::F32(Array3::from_shape_fn((3, 3, 1), pixel));
        Input { mask: Some(mask.clone()), ..image.into() }
    };

    for hidden in [f32::NAN, f32::INFINITY, 1e30] {
        assert_eq!(gray_of(with(hidden)), gray_of(with(0.0)));
        assert!(with(hidden).check("left").is_ok());
    }
}

#[test]
fn a_dead_pixel_does_not_coarsen_a_float_image() {
    let with = |dead: f64| {
        let pixel = |(y, x, _)| if (y, x) == (9, 9) { dead } else { (y * 40 + x) as f64 };
        gray(&converted(Image::F64(Array3::from_shape_fn((40, 40, 1), pixel)), None))
    };

    let (clean, dead) = (with(0.0), with(1e200));
    let apart = |y, x: usize| (clean.row(y)[x] - dead.row(y)[x]) - (clean.row(0)[0] - dead.row(0)[0]);

    // The range, which has 2^22 steps, ends a pixel earlier or later: by less than 0.1 %.
    assert!((0..40).all(|y| (0..40).all(|x| (y, x) == (9, 9) || apart(y, x).abs() <= 4096)));
    assert_eq!(dead.row(9)[9], 1 << 24, "clamped");
}

#[test]
fn a_thousandth_of_the_pixels_at_either_end_is_outside_the_range() {
    // 1001 pixels: one outlier at either end is left out, a second one is not.
    let ramp = |outliers: &[f64]| {
        let mut values: Vec<f64> = (0..1001 - outliers.len()).map(|value| value as f64).collect();
        values.extend(outliers);
        level_pair([&row(&values), &row(&values)], None)[0].row(0).to_vec()
    };

    let black = 255 * 16;
    assert_eq!(ramp(&[1e9])[1], black, "0 is left out: the second darkest is black");
    assert_eq!(ramp(&[1e9])[999], 2 * black, "1e9 is left out: the second brightest is white");
    assert_eq!(ramp(&[1e9, 1e9])[998], black, "one of two outliers stays: all else is black");
}

#[test]
fn a_large_image_is_sampled_evenly() {
    let pixel = |(y, x, _): (usize, usize, usize)| (y * 2048 + x) as f32;
    let image = Image::F32(Array3::from_shape_fn((1024, 2048, 1), pixel));

    let span = gray(&converted(image, None));

    let (first, last) = (span.row(0)[0], span.row(1023)[2047]);
    // Of every 32nd value the 65 least and the 65 largest are left out; the rest of the range has 2^22 steps.
    assert_eq!(last - first, 4_202_702);
}

#[test]
fn the_darker_image_of_two_sets_black() {
    let [left, right] = level_pair([&row(&[10.0, 20.0]), &row(&[0.0, 5.0])], None);

    assert_eq!(left.row(0), [255 * 16 + 2040, 2 * 255 * 16]);
    assert_eq!(right.row(0), [255 * 16, 255 * 16 + 1020]);
}

#[test]
fn pixels_that_are_not_numbers_are_refused_by_place_and_name() {
    for fault in [f32::NAN, f32::INFINITY] {
        let pixel = |(y, x, _)| if (y, x) == (1, 2) { fault } else { 0.0 };
        let image = Image::F32(Array3::from_shape_fn((2, 3, 1), pixel));

        let message = Input::from(image).check("right").expect_err("refused").to_string();
        for part in ["right: got", "row 1, column 2"] {
            assert!(message.contains(part), "{message}");
        }
    }
}

#[test]
fn constant_images_have_some_scale() {
    assert_eq!(gray(&row(&[7.0, 7.0])), gray(&row(&[-1e30, -1e30])));

    let [left, right] = level_pair([&row(&[7.0]), &row(&[7.0])], None);
    assert_eq!(left, right);
}

#[test]
fn a_given_range_sets_black_and_white() {
    let image = row(&[0.0, 1.0, 2.0, 3.0]);

    let [levels, _] = level_pair([&image, &image], Some((0.0, 255.0)));
    assert_eq!(levels.as_slice(), [0, 1, 2, 3].map(|level| 16 * (255 + level)));

    let [levels, _] = level_pair([&image, &image], Some((1.0, 2.0)));
    assert_eq!(levels.as_slice(), [0, 1, 2, 3].map(|range| 16 * 255 * range));
}

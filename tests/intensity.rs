//! Intensities: what scale, offset and type of the pixels must not change, and how masks are covered.

mod common;

use common::{gray_pair, grays, level_pair, views, volumes};
use ndarray::Array3;
use phasestereo::control::Control;
use phasestereo::masking::fill_masked;
use phasestereo::normalisation::normalise;
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::view::{Image, Mask, View};
use proptest::prelude::*;

fn view(image: Image) -> View {
    View { image, mask: None }
}

fn bytes(rows: usize, cols: usize, channels: usize) -> impl Strategy<Value = Array3<u8>> {
    prop::collection::vec(any::<u8>(), rows * cols * channels).prop_map(move |data| {
        Array3::from_shape_vec((rows, cols, channels), data).expect("the right length")
    })
}

proptest! {
    #[test]
    fn scaling_a_float_pair_by_a_power_of_two_changes_nothing(
        left in views(5, 6, 2),
        right in views(5, 6, 2),
        power in -60i32..60,
    ) {
        let scaled = |view: &View| match &view.image {
            Image::F32(pixels) => {
                View { image: Image::F32(pixels.mapv(|p| p * 2f32.powi(power))), ..view.clone() }
            }
            _ => unreachable!("kind 2 is single precision"),
        };
        let (far_left, far_right) = (scaled(&left), scaled(&right));
        prop_assert_eq!(gray_pair([&left, &right], None), gray_pair([&far_left, &far_right], None));
        prop_assert_eq!(level_pair([&left, &right], None), level_pair([&far_left, &far_right], None));
    }

    #[test]
    fn an_offset_of_one_float_image_changes_no_gray_value(
        left in bytes(4, 5, 3),
        right in bytes(4, 5, 3),
        offset in -1000i16..1000,
    ) {
        let float = |pixels: &Array3<u8>, offset: i16| {
            view(Image::F32(pixels.mapv(|p| f32::from(p) + f32::from(offset))))
        };
        let plain = gray_pair([&float(&left, 0), &float(&right, 0)], None);
        prop_assert_eq!(plain, gray_pair([&float(&left, offset), &float(&right, 0)], None));
    }

    #[test]
    fn gray_is_exact_for_integers(pixels in bytes(3, 4, 3)) {
        let [gray, _] = gray_pair([&view(Image::U8(pixels.clone())), &view(Image::U8(pixels.clone()))], None);
        let wide = pixels.mapv(u16::from);
        let [wide, _] = gray_pair([&view(Image::U16(wide.clone())), &view(Image::U16(wide))], None);
        for ((y, x), _) in pixels.index_axis(ndarray::Axis(2), 0).indexed_iter() {
            let [r, g, b] = [0, 1, 2].map(|c| i32::from(pixels[(y, x, c)]));
            let thousandths = 299 * r + 587 * g + 114 * b;
            prop_assert_eq!(gray.row(y)[x], thousandths - 127_500);
            prop_assert_eq!(wide.row(y)[x], thousandths - 32_767_500);
        }
    }

    #[test]
    fn levels_are_sixteenths_of_gray_levels_above_black(pixels in bytes(2, 3, 1)) {
        let one = view(Image::U8(pixels.clone()));
        let [levels, _] = level_pair([&one, &one], None);
        let expected: Vec<u16> = pixels.iter().map(|&p| 16 * (255 + u16::from(p))).collect();
        prop_assert_eq!(levels[0].as_slice(), &expected[..]);
    }

    #[test]
    fn masked_pixels_take_the_nearest_valid_value(gray in grays(8), seed in any::<u64>()) {
        let mask = Mask::from_fn(gray.rows(), gray.cols(), |y, x| seed >> ((y * 8 + x) % 64) & 1 == 1);
        let mut filled = gray.clone();
        fill_masked(&mut filled, &mask);
        prop_assert_eq!(filled, reference::fill_masked(&gray, &mask));
    }

    #[test]
    fn normalisation_equals_its_definition(plane in volumes(7, 6, 1, 12_240), radius in 0usize..=9) {
        let window = 2 * radius + 1;
        prop_assert_eq!(normalise(&plane, window, &Control::default()), Ok(reference::normalise(&plane, window)));
    }
}

#[test]
fn what_a_mask_covers_has_no_effect() {
    let mask = Mask::from_fn(3, 3, |y, x| (y, x) != (1, 1));
    let with = |hidden: f32| {
        let pixel = |(y, x, _)| if (y, x) == (1, 1) { hidden } else { (3 * y + x) as f32 };
        let image = Image::F32(Array3::from_shape_fn((3, 3, 1), pixel));
        View { image, mask: Some(mask.clone()) }
    };
    for hidden in [f32::NAN, f32::INFINITY, 1e30] {
        assert_eq!(
            gray_pair([&with(hidden), &with(0.0)], None),
            gray_pair([&with(0.0), &with(0.0)], None)
        );
        assert!(with(hidden).check("left").is_ok());
    }
}

#[test]
fn a_dead_pixel_does_not_coarsen_a_float_image() {
    let with = |dead: f64| {
        let pixel = |(y, x, _)| if (y, x) == (9, 9) { dead } else { (y * 40 + x) as f64 };
        view(Image::F64(Array3::from_shape_fn((40, 40, 1), pixel)))
    };
    let [clean, dead] = gray_pair([&with(0.0), &with(1e200)], None);
    let apart =
        |y, x: usize| (clean.row(y)[x] - dead.row(y)[x]) - (clean.row(0)[0] - dead.row(0)[0]);
    assert!((0..40).all(|y| (0..40).all(|x| (y, x) == (9, 9) || apart(y, x) == 0)));
    assert_eq!(dead.row(9)[9], 1 << 24, "clamped");
}

#[test]
fn pixels_that_are_no_numbers_are_refused_by_place_and_name() {
    for fault in [f32::NAN, f32::INFINITY] {
        let pixel = |(y, x, _)| if (y, x) == (1, 2) { fault } else { 0.0 };
        let image = Image::F32(Array3::from_shape_fn((2, 3, 1), pixel));
        let message = view(image).check("right").expect_err("refused").to_string();
        for part in ["right: got", "row 1, column 2", "right_mask"] {
            assert!(message.contains(part), "{message}");
        }
    }
}

#[test]
fn constant_images_have_some_scale() {
    let flat = |value: f32| view(Image::F32(Array3::from_elem((2, 2, 1), value)));
    let [left, right] = gray_pair([&flat(7.0), &flat(-1e30)], None);
    assert_eq!(left, right);
    let [left, right] = level_pair([&flat(7.0), &flat(7.0)], None);
    assert_eq!(left, right);
}

#[test]
fn a_told_range_sets_the_step() {
    let image = |white: f32| {
        view(Image::F32(Array3::from_shape_fn((1, 4, 1), |(_, x, _)| white * x as f32)))
    };
    let [half, _] = gray_pair([&image(0.5), &image(0.5)], Some((0.0, 1.0)));
    let [whole, _] = gray_pair([&image(1.0), &image(1.0)], Some((0.0, 1.0)));
    let doubled: Vec<i32> = half.as_slice().iter().map(|value| 2 * value).collect();
    assert_eq!(whole.as_slice(), &doubled[..]);
    let levels: Vec<Plane<u16>> =
        level_pair([&image(1.0), &image(1.0)], Some((0.0, 255.0)))[0].clone();
    assert_eq!(levels[0].as_slice(), [0, 1, 2, 3].map(|level| 16 * (255 + level)));
}

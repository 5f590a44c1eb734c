//! Impulses, compared with sorting the neighbors of every pixel.

use crate::common::{at_every_level, gray_of, grays, hash, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::impulses::{count_doubtless, has_impulses, repaired};
use phasestereo_match::image::pixels::{Image, Input};
use proptest::prelude::*;
use proptest::sample::select;

fn repair(plane: &Plane<i32>, height: i32) -> Plane<i32> {
    at_every_level(|level| repaired(plane, height, level, &Control::default()).expect("not cancelled"))
}

/// Gray values with little noise and some impulses.
fn spoilt(rows: usize, cols: usize, seed: u64) -> Plane<i32> {
    Plane::from_fn(rows, cols, |y, x| match hash(seed, y, x) % 40 {
        0 => 255,
        1 => 0,
        lot => 100 + (x / 7) as i32 + (lot % 5) as i32,
    })
}

proptest! {
    #![proptest_config(random(512))]

    #[test]
    fn impulses_are_repaired_like_by_the_reference(
        plane in grays(40),
        height in select(vec![0, 1, 20, 20_000, 1 << 24, i32::MAX]),
    ) {
        prop_assert_eq!(repair(&plane, height), reference::repair(&plane, height));
    }

    #[test]
    fn impulses_are_counted_like_by_the_reference(
        rows in 1usize..=30,
        cols in 1usize..=40,
        seed: u64,
        steps in select(vec![0.0, 0.5, 1.0, 2.25]),
    ) {
        let plane = spoilt(rows, cols, seed);
        let cut = seed as usize % (rows + 1);

        let found = at_every_level(|level| {
            let part = |rows| count_doubtless(&plane, rows, steps, level).expect("memory");
            part(0..cut) + part(cut..rows)
        });

        prop_assert_eq!(found, reference::doubtless(&plane, (40.0 * steps) as i32));
    }
}

#[test]
fn impulses_go_and_edges_stay() {
    let plane = Plane::from_fn(30, 40, |y, x| {
        let spoilt = [(0, 0), (12, 9), (29, 39), (7, 0)].contains(&(y, x));
        if spoilt {
            255
        } else if x < 20 {
            40
        } else {
            120
        }
    });

    let clean = Plane::from_fn(30, 40, |_, x| if x < 20 { 40 } else { 120 });

    assert_eq!(repair(&plane, 20), clean);
    assert_eq!(repair(&clean, 0), clean);

    assert_eq!(count_doubtless(&plane, 0..30, 1.0, Level::best()), Ok(4));
}

#[test]
fn a_few_outliers_are_details() {
    assert!(!has_impulses(0, 10) && !has_impulses(40, 1_000_000));
    assert!(has_impulses(41, 1_000_000));
}

#[test]
fn gray_values_are_repaired_once_masked_pixels_are_filled() {
    let mut pixels = ndarray::Array3::from_elem((9, 9, 3), 50u8);
    pixels.slice_mut(ndarray::s![4, 4, ..]).fill(250);
    pixels.slice_mut(ndarray::s![0, 0, ..]).fill(250);

    let mask = Plane::from_fn(9, 9, |y, x| (y, x) != (0, 0));

    let view = gray_of(Input { mask: Some(mask), ..Image::U8(pixels).into() });
    let gray = |impulses| {
        let repaired = view.repaired(impulses, Level::best(), &Control::default());
        repaired.expect("memory").gray().clone()
    };

    assert!(gray(20.0).as_slice().iter().all(|value| *value == 50 - 128));
    assert_eq!(gray(0.0).row(4)[4], 250 - 128);
    assert_eq!(gray(200.0).row(4)[4], 250 - 128, "200 are not above 200");
}

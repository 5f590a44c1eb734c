//! The grid of blocks, compared with the means of every phase.

use crate::common::{at_every_level, hash, random};
use crate::reference;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::blocking::Extra;
use proptest::prelude::*;
use proptest::sample::select;

/// The jump of a plane that is read in parts, each with two more rows on either side.
fn by_parts(plane: &Plane<i32>, steps: f64, cuts: &[usize], level: Level) -> f64 {
    let height = plane.rows();

    let parts = cuts.windows(2).map(|ends| {
        let read = ends[0].saturating_sub(2)..(ends[1] + 2).min(height);
        let part = plane.clone().of_rows(read.clone());
        let rows = ends[0] - read.start..ends[1] - read.start;
        Extra::of_rows(&part, rows, (read.start, height), steps, level).expect("memory")
    });

    parts.fold(Extra::default(), Extra::and).jump()
}

/// Gray values in blocks of 8 x 8 pixels that begin anywhere.
fn blocks(rows: usize, cols: usize, seed: u64) -> Plane<i32> {
    let (top, left) = (seed as usize % 8, seed as usize / 8 % 8);

    Plane::from_fn(rows, cols, |y, x| {
        let block = hash(seed, (y + top) / 8, (x + left) / 8) % 20;
        (block + hash(!seed, y, x) % 9) as i32 * 100
    })
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn jumps_are_those_of_the_reference(
        rows in 1usize..=40,
        cols in 1usize..=40,
        seed: u64,
        steps in select(vec![0.0, 1.0, 37.5, 1000.0]),
        cut in 0usize..=40,
    ) {
        let plane = blocks(rows, cols, seed);
        let cut = cut.min(rows);

        let found = at_every_level(|level| by_parts(&plane, steps, &[0, cut, rows], level).to_bits());

        let expected = reference::jump(&plane, (8.0 * steps) as i32);
        prop_assert_eq!(found, expected.to_bits());
    }
}

#[test]
fn a_grid_is_found_wherever_it_begins() {
    for seed in 0..64 {
        let found = by_parts(&blocks(200, 200, seed), 100.0, &[0, 77, 200], Level::best());
        assert!(found > 100.0, "{seed}: {found}");
    }
}

#[test]
fn images_without_a_grid_have_none() {
    let noise = Plane::from_fn(200, 200, |y, x| (hash(1, y, x) % 2000) as i32);
    assert!(by_parts(&noise, 100.0, &[0, 200], Level::best()) < 20.0);

    let stripes = Plane::from_fn(200, 200, |_, x| if x % 16 < 8 { 0 } else { 1000 });
    assert!(by_parts(&stripes, 100.0, &[0, 200], Level::best()) <= 0.0, "along rows only");

    let small = Plane::from_fn(9, 11, |_, x| x as i32);
    assert!(by_parts(&small, 1.0, &[0, 9], Level::best()) <= 0.0);
}

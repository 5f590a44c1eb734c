//! Pixels filled from the trusted ones of their row, compared with a search for each pixel.

use crate::common::maps::{FlaggedMap, bits, maps, row};
use crate::common::{at_every_level, hash, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::refinement::filling::fill;
use phasestereo_match::refinement::flag;
use proptest::prelude::*;

/// Most rows to one that is copied.
const REACH: usize = 32;

const NAN: f32 = f32::NAN;

fn filled(map: &FlaggedMap) -> (Plane<f32>, Plane<u16>) {
    let (disparity, flags) = at_every_level(|level| {
        let FlaggedMap { mut disparity, mut flags } = map.clone();
        fill(&mut disparity, &mut flags, level, &Control::default()).expect("memory");
        (bits(&disparity), flags)
    });
    (disparity.map(|bits| f32::from_bits(*bits)), flags)
}

/// A row filled, with these flags.
fn filled_row(values: &[f32], flags: &[u16]) -> (Vec<f32>, Vec<u16>) {
    let flags = Plane::from_vec(1, flags.len(), flags.to_vec()).expect("one row");
    let (disparity, flags) = filled(&FlaggedMap { disparity: row(values), flags });
    (disparity.into_vec(), flags.into_vec())
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn maps_are_filled_like_by_the_reference(map in maps()) {

        let ((fast, fast_flags), (naive, naive_flags)) =
            (filled(&map), reference::fill(&map.disparity, &map.flags));

        prop_assert_eq!(bits(&fast), bits(&naive));
        prop_assert_eq!(fast_flags, naive_flags);
    }
}

#[test]
fn the_background_fills_gaps_and_the_only_neighbor_the_ends() {
    let (occluded, outside) = (flag::OCCLUDED, flag::OUTSIDE);
    let flags = [outside, 0, occluded, flag::SPECKLE, 0, flag::LOW_CONFIDENCE];

    let (values, found) = filled_row(&[9.0, 2.0, 9.0, 1.0, 5.0, 7.0], &flags);
    assert_eq!(values, [2.0, 2.0, 2.0, 2.0, 5.0, 5.0]);

    let expected = flags.map(|flags| if flags == 0 { 0 } else { flags | flag::FILLED });
    assert_eq!(found, expected);
}

#[test]
fn pixels_without_candidates_are_filled_and_masked_ones_are_not() {
    let flags = [0, flag::NO_CANDIDATE, flag::MASKED, flag::MASKED | flag::OCCLUDED];

    let (values, found) = filled_row(&[3.0, NAN, NAN, 4.0], &flags);

    assert_eq!(values[..2], [3.0, 3.0]);
    assert!(values[2..].iter().all(|value| value.is_nan()), "{values:?}");
    assert_eq!(found, [0, flags[1] | flag::FILLED, flags[2], flags[3]]);
}

#[test]
fn empty_rows_take_the_values_of_the_nearest_row() {
    let values = [[1.0, 2.0], [8.0, 8.0], [8.0, 8.0], [8.0, 8.0], [3.0, 9.0]];
    let lost = [flag::OCCLUDED; 2];
    let flags = [[0, 0], lost, lost, lost, [0, flag::MISMATCHED]];
    let plane = |values: &[f32]| Plane::from_vec(5, 2, values.to_vec()).expect("all rows");
    let map = FlaggedMap {
        disparity: plane(values.as_flattened()),
        flags: Plane::from_vec(5, 2, flags.as_flattened().to_vec()).expect("all rows"),
    };

    let (disparity, _) = filled(&map);
    assert_eq!(disparity, plane(&[1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0]));
}

#[test]
fn a_map_without_a_trusted_pixel_stays() {
    let flags = [flag::NO_CANDIDATE, flag::OCCLUDED, flag::MASKED];

    let (values, found) = filled_row(&[NAN, 4.0, NAN], &flags);

    assert!(values[0].is_nan() && values[2].is_nan());
    assert_eq!(values[1..2], [4.0]);
    assert_eq!(found, flags);
}

/// A tall map in which these rows have a trusted pixel.
fn tall(rows: usize, is_trusted: impl Fn(usize) -> bool) -> FlaggedMap {
    let disparity = Plane::from_fn(rows, 3, |y, x| 1.0 + (hash(4, y, x) % 1000) as f32);
    let trusted = |y: usize, x: usize| x as u64 == hash(5, y, 0) % 3;

    let flags =
        Plane::from_fn(rows, 3, |y, x| if is_trusted(y) && trusted(y, x) { 0 } else { flag::OCCLUDED });

    FlaggedMap { disparity, flags }
}

#[test]
fn empty_rows_copy_up_to_the_largest_distance() {
    let seeds = [0, 2 * REACH, 4 * REACH + 2];
    let map = tall(5 * REACH + 10, |y| seeds.contains(&y));
    let (disparity, flags) = filled(&map);

    let stays = |y: usize| disparity.row(y) == map.disparity.row(y) && flags.row(y) == [flag::OCCLUDED; 3];

    let of = |y: usize, seed: usize| {
        disparity.row(y) == disparity.row(seed) && flags.row(y) == [flag::OCCLUDED | flag::FILLED; 3]
    };

    let [first, second, third] = seeds;

    assert!(of(first + REACH, first), "of two rows at one distance the upper one");
    assert!(of(first + REACH + 1, second));
    assert!(of(second + REACH, second));
    assert!(stays(second + REACH + 1), "one row too far from both");
    assert!(of(second + REACH + 2, third));
    assert!(of(third + REACH, third));
    assert!(stays(third + REACH + 1));

    let reference = reference::fill(&map.disparity, &map.flags);
    assert_eq!((bits(&disparity), flags), (bits(&reference.0), reference.1));
}

proptest! {
    #![proptest_config(random(40))]

    #[test]
    fn tall_maps_are_filled_like_by_the_reference(rows in 1usize..=300, seed in any::<u64>(), rare in 1u64..=100) {
        let map = tall(rows, |y| hash(seed, y, 0).is_multiple_of(rare));

        let ((fast, fast_flags), (naive, naive_flags)) =
            (filled(&map), reference::fill(&map.disparity, &map.flags));
        prop_assert_eq!(bits(&fast), bits(&naive));
        prop_assert_eq!(fast_flags, naive_flags);
    }
}

//! Owners of right pixels, compared with a search of the whole row.

use crate::common::{hash, random};
use crate::reference;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;
use phasestereo_match::refinement::left_right_check::{Checker, Choices};
use proptest::prelude::*;
use proptest::sample::select;

fn checked(choices: Choices, most: u16, flags: &[u16]) -> Vec<u16> {
    let mut checker = Checker::default();

    // A longer row first, whose buffers are reused.
    let longer = Choices { chosen: &[0; 300], costs: &[0; 300], ..choices };
    checker.resize(300).expect("memory");
    checker.check(longer, 1, &mut [0; 300]);

    let mut flags = flags.to_vec();
    checker.resize(flags.len()).expect("memory");
    checker.check(choices, most, &mut flags);
    flags
}

/// The flags of a row for which these disparities were chosen at these costs.
fn row_flags(disparities: &[u16], costs: &[u32], most: u16) -> Vec<u16> {
    let candidates = Candidates::new(0, disparities.len() as i64, disparities.len());
    let candidates = candidates.expect("legal");

    let outside = |(x, &d): (usize, &u16)| if usize::from(d) > x { flag::OUTSIDE } else { 0 };
    let flags: Vec<_> = disparities.iter().enumerate().map(outside).collect();

    checked(Choices { chosen: disparities, costs, candidates }, most, &flags)
}

proptest! {
    #![proptest_config(random(512))]

    #[test]
    fn rows_are_checked_like_the_reference(
        cols in prop_oneof![3 => 1usize..=12, 1 => 13usize..=90],
        (min, count) in (-9i64..=9, 1i64..=12),
        (most, largest) in (select(vec![0u16, 1, 2, 300]), select(vec![1u64, 3, u64::from(u32::MAX)])),
        seed: u64,
    ) {
        let Ok(candidates) = Candidates::new(min, count, cols) else { return Ok(()) };

        let count = candidates.count() as u64;
        let chosen: Vec<_> = (0..cols).map(|x| (hash(seed, x / 3, x % 2) % count) as u16).collect();
        let costs: Vec<_> = (0..cols).map(|x| (hash(!seed, 0, x) % (largest + 1)) as u32).collect();

        // The flags do not have to name all matches that are outside.
        let flags: Vec<_> = (0..cols)
            .map(|x| match hash(seed, 1, x) % 8 {
                lot @ 0..=3 if seed % 3 > 0 => 1 << lot,
                4 => flag::LOW_CONFIDENCE,
                _ => 0,
            })
            .collect();

        let choices = Choices { chosen: &chosen, costs: &costs, candidates };
        prop_assert_eq!(checked(choices, most, &flags), reference::check_row(choices, most, &flags));
    }
}

#[test]
fn a_row_of_one_surface_is_consistent() {
    let outside = |x: usize| if x < 3 { flag::OUTSIDE } else { 0 };
    let expected: Vec<_> = (0..20).map(outside).collect();
    assert_eq!(row_flags(&[3; 20], &[5; 20], 0), expected);
}

/// A surface at disparity 5 in front of one at 0: five pixels of the latter are occluded on the right.
#[test]
fn pixels_behind_a_nearer_surface_are_occluded_except_the_rims() {
    let chosen: Vec<_> = (0..24).map(|x| if x >= 12 { 5 } else { 0 }).collect();
    let costs: Vec<_> = (0..24).map(|x| if x >= 12 { 3 } else { 4 }).collect();

    let flags = row_flags(&chosen, &costs, 1);
    let (rim, hidden) = (flag::MISMATCHED, flag::OCCLUDED);

    assert_eq!(flags[7..12], [rim, hidden, hidden, hidden, rim]);
    assert!(flags[..7].iter().chain(&flags[12..]).all(|&flags| flags == 0));
}

#[test]
fn the_least_cost_owns_and_among_equal_ones_the_nearer_surface() {
    // Left pixels 2 and 4 have chosen right pixel 2.
    let both = [0, 0, 0, 0, 2, 0];
    let owner = |costs: [u32; 6]| {
        let flags = row_flags(&both, &costs, 1);
        [flags[2], flags[4]].map(|flags| flags == 0)
    };

    assert_eq!(owner([1, 1, 7, 1, 8, 1]), [true, false]);
    assert_eq!(owner([1, 1, 8, 1, 7, 1]), [false, true]);
    assert_eq!(owner([1, 1, 7, 1, 7, 1]), [false, true]);
}

/// A slanted surface is longer on the left: two of its pixels choose the same right pixel.
#[test]
fn a_slope_is_consistent_within_a_pixel() {
    let slope = [0, 0, 0, 1, 1, 1, 2, 2, 2];

    assert!(row_flags(&slope, &[1; 9], 1).iter().all(|&flags| flags == 0));
    assert!(row_flags(&slope, &[1; 9], 0).contains(&flag::MISMATCHED));
}

#[test]
fn missing_pixels_own_nothing() {
    let candidates = Candidates::new(0, 4, 4).expect("legal");
    let choices = Choices { chosen: &[0, 0, 0, 3], costs: &[5, 5, 5, 1], candidates };

    assert_eq!(checked(choices, 1, &[0; 4]), [flag::MISMATCHED, 0, 0, 0]);
    assert_eq!(checked(choices, 1, &[0, 0, 0, flag::MASKED]), [0, 0, 0, flag::MASKED]);
}

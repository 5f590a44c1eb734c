//! The values of masked pixels, compared with a search of the whole image.

use crate::common::{grays, hash, random};
use crate::reference;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::masking::fill_masked;
use phasestereo_match::image::view::Mask;
use proptest::prelude::*;

/// Most rows to one that is copied: the reach of the largest kernel and the largest window.
const REACH: usize = 64 + 31;

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn masked_pixels_take_the_nearest_valid_value(gray in grays(8), seed in any::<u64>(), few in 0u32..3) {
        // Sparse masks leave whole rows without a valid pixel.

        let lot = |y: usize, x: usize| seed.rotate_left((y * 8 + x) as u32) & ((2u64 << few) - 1);
        let mask = Mask::from_fn(gray.rows(), gray.cols(), |y, x| lot(y, x) == 1);

        let mut filled = gray.clone();
        fill_masked(&mut filled, &mask);

        prop_assert_eq!(filled, reference::fill_masked(&gray, &mask));
    }
}

/// A tall plane in which these rows have a valid pixel or two.
fn tall(rows: usize, seeded: impl Fn(usize) -> bool) -> (Plane<i32>, Mask) {
    let gray = Plane::from_fn(rows, 5, |y, x| (hash(4, y, x) % 1000) as i32 + 1);
    let valid = |y: usize, x: usize| x as u64 % 3 == hash(5, y, 0) % 3;

    (gray, Mask::from_fn(rows, 5, |y, x| seeded(y) && valid(y, x)))
}

fn filled(gray: &Plane<i32>, mask: &Mask) -> Plane<i32> {
    let mut filled = gray.clone();
    fill_masked(&mut filled, mask);

    filled
}

#[test]
fn empty_rows_copy_up_to_the_largest_distance() {
    // Only these rows have a valid pixel: those in the middle are equally far from both.
    let seeds = [0, 2 * REACH, 4 * REACH + 2];
    let (gray, mask) = tall(5 * REACH + 10, |y| seeds.contains(&y));
    let filled = filled(&gray, &mask);

    let is_empty = |y: usize| filled.row(y) == [0; 5];

    let [first, second, third] = seeds;

    assert_eq!(filled.row(first + REACH), filled.row(first), "of two rows at one distance the upper one");
    assert_eq!(filled.row(first + REACH + 1), filled.row(second));
    assert_eq!(filled.row(second + REACH), filled.row(second));
    assert!(is_empty(second + REACH + 1), "one row too far from both");
    assert_eq!(filled.row(second + REACH + 2), filled.row(third));
    assert_eq!(filled.row(third + REACH), filled.row(third));
    assert!(is_empty(third + REACH + 1));

    assert_ne!(filled.row(first), filled.row(second));
    assert_ne!(filled.row(second), filled.row(third));

    assert_eq!(filled, reference::fill_masked(&gray, &mask));
}

proptest! {
    #![proptest_config(random(40))]

    #[test]
    fn tall_images_are_filled_like_by_the_reference(rows in 1usize..=600, seed in any::<u64>(), rare in 1u64..=200) {
        let (gray, mask) = tall(rows, |y| hash(seed, y, 0).is_multiple_of(rare));
        prop_assert_eq!(filled(&gray, &mask), reference::fill_masked(&gray, &mask));
    }
}

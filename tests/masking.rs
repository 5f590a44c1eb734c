//! Masked pixels: what they are replaced by, against a search of the whole image.

mod common;

use common::grays;
use phasestereo::control::Control;
use phasestereo::masking::fill_masked;
use phasestereo::reference;
use phasestereo::view::Mask;
use proptest::prelude::*;

proptest! {
    #[test]
    fn masked_pixels_take_the_nearest_valid_value(gray in grays(8), seed in any::<u64>(), few in 0u32..3) {
        // Sparse masks leave whole rows without a valid pixel.
        let lot = |y: usize, x: usize| seed.rotate_left((y * 8 + x) as u32) & ((2u64 << few) - 1);
        let mask = Mask::from_fn(gray.rows(), gray.cols(), |y, x| lot(y, x) == 1);
        let mut filled = gray.clone();
        fill_masked(&mut filled, &mask, &Control::default()).expect("not cancelled");
        prop_assert_eq!(filled, reference::fill_masked(&gray, &mask));
    }
}

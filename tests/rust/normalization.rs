//! Local contrast: sliding sums in bands compared with each window summed by itself.

use crate::common::{noise, random, volumes};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::simd::Level;
use phasestereo_match::cost::normalized_sad::normalize;
use proptest::prelude::*;

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn normalization_equals_its_definition(plane in volumes(7, 6, 1, 12_240), radius in 0usize..=9) {
        let window = 2 * radius + 1;
        let expected = reference::normalize(&plane, window);

        prop_assert_eq!(normalize(&plane, window, Level::best(), &Control::default()), Ok(expected));
    }
}

#[test]
fn bands_leave_no_seam() {
    let plane = noise(300, 5).map(|&value| value as u16);
    let expected = reference::normalize(&plane, 9);

    assert_eq!(normalize(&plane, 9, Level::best(), &Control::default()), Ok(expected));
}

//! What the tests of several stages draw from: settings, images and volumes, awkward ones included.

#![allow(dead_code, reason = "each test file uses its own part of this")]

use ndarray::Array3;
use phasestereo::control::Control;
use phasestereo::intensity::{gray_plane, level_planes};
use phasestereo::plane::Plane;
use phasestereo::settings::{CostKind, Optimizer, Penalty, Settings, Taper};
use phasestereo::view::{Image, Mask, View};
use proptest::prelude::*;

/// Legal descriptors of any family; sizes lean to the small, where frequencies meet their bounds.
pub fn descriptors() -> impl Strategy<Value = Settings> {
    let size = prop_oneof![6 => 1usize..=5, 1 => 6usize..=31].prop_map(|radius| 2 * radius + 1);
    let taper = prop_oneof![
        3 => Just(Taper::Uniform),
        1 => Just(Taper::Gaussian),
        1 => Just(Taper::Hann)
    ];
    (size, taper, 0usize..=4, 0usize..=4, 1usize..=2, 1usize..=4).prop_filter_map(
        "no legal descriptor",
        |(neighborhood, taper, r, s, power, bits)| {
            let frequencies = (r, s);
            let settings =
                Settings { neighborhood, taper, frequencies, power, bits, ..Settings::default() };
            settings.check().is_ok().then_some(settings)
        },
    )
}

/// Legal settings of the whole matcher.
pub fn settings() -> impl Strategy<Value = Settings> {
    let cost = prop_oneof![
        3 => Just(CostKind::Phase),
        1 => Just(CostKind::Sad),
        1 => Just(CostKind::NormalisedSad)
    ];
    let optimizer =
        prop_oneof![3 => Just(Optimizer::DynamicProgramming), 1 => Just(Optimizer::WinnerTakesAll)];
    let penalty = (0.0..4.0, 0.0..4.0).prop_map(|(rise, drop)| Penalty { rise, drop });
    (descriptors(), cost, 0usize..=5, any::<bool>(), optimizer, penalty, any::<bool>()).prop_map(
        |(descriptor, cost, radius, shiftable, optimizer, penalty, fill)| Settings {
            cost,
            window: 2 * radius + 1,
            shiftable,
            optimizer,
            penalty,
            fill,
            ..descriptor
        },
    )
}

/// Every legal (L, r, s, k, b) of one size.
pub fn every_descriptor(neighborhood: usize) -> impl Iterator<Item = Settings> {
    let frequencies = (0..=4).flat_map(|r| (0..=4).map(move |s| (r, s)));
    let families = frequencies.flat_map(|f| (1..=2).map(move |k| (f, k)));
    families.flat_map(|(f, k)| (1..=4).map(move |b| (f, k, b))).filter_map(
        move |(frequencies, power, bits)| {
            let settings =
                Settings { neighborhood, frequencies, power, bits, ..Settings::default() };
            settings.check().is_ok().then_some(settings)
        },
    )
}

/// Gray planes from 1x1 up, of full range or of so few values that ties abound.
pub fn grays(largest: usize) -> impl Strategy<Value = Plane<i32>> {
    let values = prop_oneof![Just(0..=2), Just(-32_767_500..=32_767_500)];
    (1..=largest, 1..=largest, values).prop_flat_map(|(rows, cols, values)| {
        prop::collection::vec(values, rows * cols)
            .prop_map(move |data| Plane::from_vec(rows, cols, data).expect("the right length"))
    })
}

/// A volume of small values with `candidates` for each pixel.
pub fn volumes(
    rows: usize,
    cols: usize,
    candidates: usize,
    largest: u16,
) -> impl Strategy<Value = Plane<u16>> {
    let length = cols * candidates;
    prop::collection::vec(0..=largest, rows * length)
        .prop_map(move |data| Plane::from_vec(rows, length, data).expect("the right length"))
}

/// A view of random pixels of any type, perhaps masked here and there.
pub fn views(rows: usize, cols: usize, kind: u8) -> impl Strategy<Value = View> {
    let channels = prop_oneof![Just(1usize), Just(3usize)];
    let pixels = channels.prop_flat_map(move |channels| {
        (Just(channels), prop::collection::vec(any::<u16>(), rows * cols * channels))
    });
    let mask = prop::option::of(prop::collection::vec(prop::bool::weighted(0.8), rows * cols));
    (pixels, mask).prop_map(move |((channels, pixels), mask)| {
        let array =
            Array3::from_shape_vec((rows, cols, channels), pixels).expect("the right length");
        let image = match kind {
            0 => Image::U8(array.mapv(|value| value as u8)),
            1 => Image::U16(array),
            2 => Image::F32(array.mapv(|value| f32::from(value) / 65_535.0)),
            _ => Image::F64(array.mapv(|value| f64::from(value) * 1e6 - 3.0)),
        };
        let mask = mask.map(|mask| Mask::from_vec(rows, cols, mask).expect("the right length"));
        View { image, mask }
    })
}

/// The gray plane of a view.
pub fn gray(view: &View) -> Plane<i32> {
    gray_plane(view, &Control::default()).expect("not cancelled")
}

/// The channel planes of a pair.
pub fn level_pair(views: [&View; 2], told: Option<(f64, f64)>) -> [Vec<Plane<u16>>; 2] {
    level_planes(views, told, &Control::default()).expect("not cancelled")
}

/// A gray plane of pseudo-random values, for the tests that need a size of their own.
pub fn noise(rows: usize, cols: usize) -> Plane<i32> {
    let mut state = 1u32;
    Plane::from_fn(rows, cols, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as i32
    })
}

//! Disparity maps to refine: patches, slopes and noise, with flags and missing estimates.

use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::refinement::flag;
use proptest::prelude::*;
use proptest::sample::select;

use super::{at_every_level, hash};

/// A map and its flags.
#[derive(Debug, Clone)]
pub struct FlaggedMap {
    pub disparity: Plane<f32>,
    pub flags: Plane<u16>,
}

/// Every flag that a pixel may have before refinement, and none.
const REASONS: [u16; 9] = [
    0,
    flag::MASKED,
    flag::NO_CANDIDATE,
    flag::OUTSIDE,
    flag::MATCH_MASKED,
    flag::OCCLUDED,
    flag::MISMATCHED | flag::LOW_CONFIDENCE,
    flag::LOW_CONFIDENCE,
    flag::SPECKLE,
];

impl FlaggedMap {
    /// A map of this many rows and columns. About `percent` of the pixels have a flag or no estimate, singly
    /// and in rows.
    pub fn random((rows, cols): (usize, usize), percent: u64, seed: u64) -> Self {
        let patch = 1 + (seed % 5) as usize;
        let is_slope = seed & 64 != 0;

        let disparity = Plane::from_fn(rows, cols, |y, x| {
            let patch = (hash(seed, y / patch, x / patch) % 9) as f32 - 3.0;
            let slope = if is_slope { 0.45 * x as f32 } else { 0.0 };
            let noise = (hash(!seed, y, x) % 5) as f32 / 4.0;
            let is_none = hash(seed ^ 1, y, x) % 400 < percent;

            if is_none { f32::NAN } else { patch + slope + noise }
        });

        let flags = Plane::from_fn(rows, cols, |y, x| {
            let is_flagged = |y, x, odds| hash(seed ^ 2, y, x) % odds < percent;
            let lot = hash(seed ^ 3, y, x) as usize % REASONS.len();
            let is_flagged = is_flagged(y, x, 100) || is_flagged(y, cols, 300);

            if is_flagged { REASONS[lot.max(usize::from(percent > 20))] } else { 0 }
        });

        Self { disparity, flags }
    }
}

/// Heights around those of bands, and small ones.
pub fn heights() -> impl Strategy<Value = usize> {
    prop_oneof![3 => 1usize..=11, 1 => select(vec![31, 32, 33, 64, 65])]
}

/// Widths around numbers of lanes, and small ones.
pub fn widths() -> impl Strategy<Value = usize> {
    prop_oneof![3 => 1usize..=12, 1 => select(vec![15, 16, 17, 31, 32, 33, 50])]
}

/// Maps of any size and with any share of flags.
pub fn maps() -> impl Strategy<Value = FlaggedMap> {
    let percent = select(vec![0, 3, 20, 60, 97, 100]);
    (heights(), widths(), percent, any::<u64>())
        .prop_map(|(rows, cols, percent, seed)| FlaggedMap::random((rows, cols), percent, seed))
}

/// The bits of values, so that NaN equals NaN.
pub fn bits(plane: &Plane<f32>) -> Plane<u32> {
    plane.map(|value| value.to_bits())
}

/// The map that a stage writes over another of the same size; it must be the same at every level.
pub fn drawn(like: &Plane<f32>, draw: impl Fn(&mut Plane<f32>, Level) -> Result<()>) -> Plane<f32> {
    let drawn = at_every_level(|level| {
        let mut plane = like.map(|_| -77.0);
        draw(&mut plane, level).expect("memory");
        bits(&plane)
    });
    drawn.map(|bits| f32::from_bits(*bits))
}

/// A map of one row.
pub fn row(values: &[f32]) -> Plane<f32> {
    Plane::from_vec(1, values.len(), values.to_vec()).expect("one row")
}

/// Gray values in patches with some noise, up to a magnitude.
pub fn patches(rows: usize, cols: usize, largest: i32, seed: u64) -> Plane<i32> {
    let part = |lot: u64| (lot % (2 * largest as u64 + 1)) as i32 - largest;
    Plane::from_fn(rows, cols, |y, x| {
        (part(hash(seed, y / 4, x / 5)) + part(hash(!seed, y, x)) / 8).clamp(-largest, largest)
    })
}

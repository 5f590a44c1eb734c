//! Statistics of a whole disparity map, which indicate whether to trust the match.

use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled, whole};
use crate::matcher::Disparity;
use crate::pair::candidates::Candidates;
use crate::refinement::calibration::{FAILED, PART, STEPS};
use crate::refinement::flag;

/// Shares of the pixels of a map, and their mean confidence.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// Share with an estimate.
    pub estimated: f64,
    /// Share that fails the left-right check or is a speckle.
    pub flagged: f64,
    /// Share with an estimate of its own at the smallest searched disparity.
    pub at_low: f64,
    /// Share with one at the largest.
    pub at_high: f64,
    /// Mean confidence; NaN if no confidence was computed.
    pub confidence: f64,
    /// Estimated share of the pixels with an estimate whose disparity is off by more than 1 px: 1 minus their
    /// mean confidence, or without confidences from that of some rows. NaN if unknown.
    pub wrong: f64,
    /// Share whose disparity is that of a smaller copy.
    pub coarse: f64,
    /// Share whose disparity is that of a plane drawn into a flat area.
    pub inferred: f64,
    /// Share whose disparity is that of a second map.
    pub second: f64,
    /// Where smaller copies decided, the finest detail of the images, pixels; NaN if none did.
    pub detail: f64,
    /// Whether the budget left no time for smaller copies and planes.
    pub is_cut_short: bool,
}

/// Numbers of pixels.
#[derive(Clone, Copy, Default)]
struct PixelCounts {
    estimated: u64,
    flagged: u64,
    at_low: u64,
    at_high: u64,
    coarse: u64,
    inferred: u64,
    second: u64,
    /// The sum, in units of 2^-20: integers sum to the same in any order.
    confidence: u64,
    /// The sum over pixels with an estimate.
    right: u64,
}

/// Flags of pixels whose disparity does not come from a match within the image.
const FOREIGN: u16 = flag::OUTSIDE | flag::FILLED | flag::INFERRED | flag::COARSE | flag::SECOND;

impl Summary {
    /// The summary of a map whose disparities were searched among these candidates.
    #[doc(hidden)]
    pub fn new(map: &Disparity, candidates: Candidates) -> Self {
        let (disparity, flags) = (map.disparity.as_slice(), map.flags.as_slice());
        let confidence = map.confidence.as_ref().map(Plane::as_slice);

        let ends = [0, candidates.count() - 1].map(|k| candidates.disparity(k) as f32);
        let counts = PixelCounts::new(disparity, flags, confidence, ends);
        let share = |count: u64| count as f64 / flags.len().max(1) as f64;

        Self {
            estimated: share(counts.estimated),
            flagged: share(counts.flagged),
            at_low: share(counts.at_low),
            at_high: share(counts.at_high),
            confidence: confidence.map_or(f64::NAN, |_| share(counts.confidence) / f64::from(STEPS)),
            coarse: share(counts.coarse),
            inferred: share(counts.inferred),
            second: share(counts.second),
            detail: map.detail.unwrap_or(f64::NAN),
            is_cut_short: map.timings.is_cut_short,
            wrong: confidence.map_or(map.wrong.unwrap_or(f64::NAN), |_| {
                1.0 - counts.right as f64 / f64::from(STEPS) / counts.estimated.max(1) as f64
            }),
        }
    }
}

impl PixelCounts {
    fn new(disparity: &[f32], flags: &[u16], confidence: Option<&[f32]>, ends: [f32; 2]) -> Self {
        let mut counts = Self::default();
        let level = Level::best();

        // Sub-pixel disparities lie up to half a pixel from their candidate.
        let ends = [ends[0] + 0.5, ends[1] - 0.5];
        for (disparity, flags) in disparity.chunks(PART).zip(flags.chunks(PART)) {
            let part = count_part(level, disparity, flags, ends);
            let [estimated, flagged, at_low, at_high, coarse, inferred, second] = part.map(u64::from);
            counts.estimated += estimated;
            counts.flagged += flagged;
            counts.at_low += at_low;
            counts.at_high += at_high;
            counts.coarse += coarse;
            counts.inferred += inferred;
            counts.second += second;
        }

        let confidence = confidence.unwrap_or_default().chunks(PART);
        for (confidence, disparity) in confidence.zip(disparity.chunks(PART)) {
            let [all, right] = sum_part(level, confidence, disparity);
            counts.confidence += u64::from(all);
            counts.right += u64::from(right);
        }

        counts
    }
}

/// Counts pixels with an estimate, flagged ones, those at either end, coarse, inferred and second ones.
#[leveled]
fn count_part(level: Level, disparity: &[f32], flags: &[u16], ends: [f32; 2]) -> [u32; 7] {
    let [mut estimated, mut flagged, mut at_low, mut at_high] = [0; 4];
    let [mut coarse, mut inferred, mut second] = [0; 3];

    for (disparity, flags) in disparity.iter().zip(flags) {
        let is_own = flags & FOREIGN == 0;
        estimated += u32::from(!disparity.is_nan());
        flagged += u32::from(flags & FAILED != 0);
        at_low += u32::from(is_own & (*disparity < ends[0]));
        at_high += u32::from(is_own & (*disparity > ends[1]));
        coarse += u32::from(flags & flag::COARSE != 0);
        inferred += u32::from(flags & flag::INFERRED != 0);
        second += u32::from(flags & flag::SECOND != 0);
    }
    [estimated, flagged, at_low, at_high, coarse, inferred, second]
}

/// Sums confidences, in steps: of all pixels, and of those with an estimate.
#[leveled]
fn sum_part(level: Level, confidence: &[f32], disparity: &[f32]) -> [u32; 2] {
    let [mut all, mut right] = [0; 2];

    for (confidence, disparity) in confidence.iter().zip(disparity) {
        let steps = whole(confidence * STEPS) as u32;
        all += steps;
        right += if disparity.is_nan() { 0 } else { steps };
    }
    [all, right]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matcher::Timings;

    #[test]
    fn shares_are_those_of_all_pixels() {
        let candidates = Candidates::new(2, 4, 100).expect("legal");
        let disparity = [f32::NAN, 2.0, 2.4, 3.0, 5.0, 4.6, 5.0, 2.0];
        let filled = flag::OCCLUDED | flag::FILLED;
        let flags = [flag::MASKED, 0, flag::SPECKLE, 0, 0, 0, flag::OUTSIDE, filled];
        let confidence = [0.0, 1.0, 0.5, 0.5, 1.0, 1.0, 0.0, 0.0];

        let row = |values: &[f32]| Plane::from_vec(1, 8, values.to_vec()).expect("legal");
        let map = Disparity {
            disparity: row(&disparity),
            flags: Plane::from_vec(1, 8, flags.to_vec()).expect("legal"),
            confidence: Some(row(&confidence)),
            uncertainty: None,
            wrong: None,
            detail: None,
            timings: Timings::default(),
        };

        let found = Summary::new(&map, candidates);
        assert_eq!(
            (found.estimated, found.flagged, found.at_low, found.at_high, found.confidence),
            (7.0 / 8.0, 2.0 / 8.0, 2.0 / 8.0, 2.0 / 8.0, 0.5)
        );

        let without = Disparity { confidence: None, ..map };
        assert!(Summary::new(&without, candidates).confidence.is_nan());
    }
}

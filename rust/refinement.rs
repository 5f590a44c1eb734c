//! Chosen candidates -> what the caller gets: disparities, flags that say why, and confidence.

use crate::candidates::Candidates;
use crate::settings::Settings;
use crate::votes::Votes;

/// Why an estimate is missing or not to be trusted; bits of the flags.
pub mod flag {
    /// The left pixel is masked: there is no estimate.
    pub const MASKED: u16 = 1;
    /// No candidate has a valid pixel in the right image: there is no estimate.
    pub const NO_CANDIDATE: u16 = 2;
    /// The match lies outside the right image.
    pub const OUTSIDE: u16 = 4;
    /// The match lies on a masked pixel of the right image.
    pub const MATCH_MASKED: u16 = 8;

    /// Those that leave nothing to estimate.
    pub const MISSING: u16 = MASKED | NO_CANDIDATE;
}

/// One row of the result, to be written.
#[derive(Debug)]
pub struct ResultRow<'a> {
    /// Disparity, pixels; NaN where there is none.
    pub disparity: &'a mut [f32],
    /// Reasons, from [`flag`].
    pub flags: &'a mut [u16],
    /// From 0 to 1.
    pub confidence: &'a mut [f32],
}

/// What is known about one row when its result is written.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// Row of the image.
    pub y: usize,
    /// Index of the candidate chosen for each pixel.
    pub chosen: &'a [u16],
    /// Aggregated costs, candidate innermost.
    pub aggregated: &'a [u32],
    /// Which (pixel, candidate) pairs are valid; `None`: all.
    pub votes: Option<&'a Votes<'a>>,
}

impl ResultRow<'_> {
    /// Fills the row in.
    pub fn write(&mut self, evidence: Evidence, candidates: Candidates, settings: &Settings) {
        self.flag_pixels(evidence, candidates);
        let distrusted = if settings.fill { flag::MISSING } else { !0 };
        let costs = evidence.aggregated.chunks_exact(candidates.count());
        for (x, (chosen, costs)) in evidence.chosen.iter().zip(costs).enumerate() {
            let index = usize::from(*chosen);
            let missing = self.flags[x] & distrusted != 0;
            self.disparity[x] = if missing { f32::NAN } else { candidates.disparity(index) as f32 };
            self.confidence[x] = if missing { 0.0 } else { confidence(costs, index) };
        }
    }

    fn flag_pixels(&mut self, evidence: Evidence, candidates: Candidates) {
        let width = evidence.chosen.len();
        for (x, &chosen) in evidence.chosen.iter().enumerate() {
            let outside = candidates.is_outside(x, chosen.into(), width);
            self.flags[x] = if outside { flag::OUTSIDE } else { 0 };
        }
        let Some(votes) = evidence.votes else { return };
        for (x, &chosen) in evidence.chosen.iter().enumerate() {
            if votes.is_masked(evidence.y, x) {
                self.flags[x] = flag::MASKED;
            } else if !(0..candidates.count()).any(|k| votes.has(evidence.y, x, k)) {
                self.flags[x] = flag::NO_CANDIDATE;
            } else if !votes.has(evidence.y, x, chosen.into()) {
                self.flags[x] |= flag::MATCH_MASKED;
            }
        }
    }
}

/// The margin of the chosen cost below the least cost elsewhere (not next to it, where the same match
/// shows again), relative to the latter, clipped to `[0, 1]`; 0 where there is no elsewhere.
pub fn confidence(costs: &[u32], chosen: usize) -> f32 {
    let elsewhere = costs[..chosen.saturating_sub(1)].iter().chain(costs.iter().skip(chosen + 2));
    match elsewhere.min() {
        None | Some(0) => 0.0,
        Some(&second) => {
            let margin = second.saturating_sub(costs[chosen]);
            (f64::from(margin) / f64::from(second)) as f32
        }
    }
}

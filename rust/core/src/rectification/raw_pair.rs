//! Pairs of which nobody knows the cameras, and that are farther from rectified than their rows can be aligned: they are rectified
//! by what their images show.
//!
//! Where the rows of raw images correspond about as well as can be measured, nothing is tried: a pair that is hard to match for
//! other reasons, as noise or blur, would only be resampled once more. Blocks that were followed often show that before any
//! cameras are looked for, which takes ten times as long as a match.

use std::sync::Arc;

use super::{Negative, Raw, Refusal, gray, rectify, warp};
use crate::estimation::facts::Facts;
use crate::estimation::{Estimates, complete};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::Settings;

/// Pairs whose low-resolution match has this mean confidence are left as they are.
const GOOD: f64 = 0.70;
/// By how much it must rise once the pair is rectified.
const LEAST_RISE: f64 = 0.03;
/// By how much it may fall where lenses distort: small copies hardly see that.
const LARGEST_FALL: f64 = 0.02;
/// Rows of raw images that differ by less, rms in pixels, are left to be aligned.
const LEAST_ROWS: f64 = 0.5;

/// What came of the attempt to rectify a pair.
pub enum Attempt {
    /// There was no need, or it did not help.
    None,
    /// The images do not show how.
    Refused(Refusal),
    /// It was rectified.
    Done(Box<RectifiedPair>),
}

/// A pair that was rectified by what its images show.
pub struct RectifiedPair {
    /// The rectified pair.
    pub pair: Pair,
    /// The estimates of it.
    pub estimates: Estimates,
    /// What is known of it.
    pub facts: Facts,
    /// Its cameras.
    pub raw: Arc<Raw>,
}

/// Rectifies a pair with these estimates, if it needs to be.
pub fn rectify_if_needed(
    pair: &Pair,
    before: &Estimates,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Attempt> {
    let Some(confidence) = before.confidence else { return Ok(Attempt::None) };
    let is_distorted = is_distorted(before);
    let may_help = is_distorted || confidence < GOOD && !correspond(before);
    if !may_help || !can_be_tried(before, facts, settings) {
        return Ok(Attempt::None);
    }

    let started = Instant::now();
    let Runtime { execution, control, .. } = runtime;
    let [left, right] = pair.views();
    let grays = [gray(left, control)?, gray(right, control)?];
    // Given disparities are not moved.
    let negative = if facts.candidates.is_none() { Negative::Moved } else { Negative::Kept };
    let found = rectify(&[grays], negative, execution.level, control)?;
    let rectification = match found {
        Ok(found) if found.rows >= LEAST_ROWS => found,
        Ok(_) => return Ok(Attempt::None),
        Err(refusal) => return Ok(Attempt::Refused(refusal)),
    };

    let raw = Arc::new(Raw::new(rectification, pair.size()));
    let pair = resampled(pair, raw.places(control)?, control)?;
    let facts =
        Facts { candidates: facts.candidates.clone(), noise: facts.noise, ..Facts::default() };
    let (pair, mut estimates) = complete(pair, &facts, settings, runtime)?;
    let least = confidence + if is_distorted { -LARGEST_FALL } else { LEAST_RISE };
    if estimates.confidence.is_none_or(|after| after < least) {
        return Ok(Attempt::None);
    }

    estimates.time += before.time + started.elapsed();
    Ok(Attempt::Done(Box::new(RectifiedPair { pair, estimates, facts, raw })))
}

/// Whether rows are bent as by lenses that distort.
fn is_distorted(estimates: &Estimates) -> bool {
    estimates.offsets.as_ref().is_some_and(|found| found.distortion().is_some())
}

/// Whether blocks show that rows correspond well enough to be left to alignment.
fn correspond(estimates: &Estimates) -> bool {
    let rows = estimates.offsets.as_ref();
    rows.is_some_and(|found| found.field.rms() + found.error < LEAST_ROWS)
}

/// Whether a pair may be resampled: nothing that is known of it says otherwise.
fn can_be_tried(estimates: &Estimates, facts: &Facts, settings: &Settings) -> bool {
    let is_same = estimates.range.as_ref().is_some_and(|range| range.identical);
    settings.self_rectify && !is_same && !facts.is_of_these_pixels() && !estimates.is_inverted
}

/// A pair whose pixels are at these places of the raw images.
pub fn resampled(pair: &Pair, places: &[Plane<[f32; 2]>; 2], control: &Control) -> Result<Pair> {
    let [left, right] = pair.views();
    let read = |view, side: usize| {
        warp::rectified(view, &places[side], warp::Interpolation::Lanczos, control)
    };
    Ok(pair.with_views([read(left, 0)?, read(right, 1)?]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::rows::RowOffsets;
    use phasestereo_match::pair::alignment::sway::INTERVALS;
    use phasestereo_match::pair::alignment::{Alignment, TERMS};
    use phasestereo_match::pair::candidates::Candidates;

    #[test]
    fn rows_correspond_if_blocks_tell_so_to_half_a_pixel() {
        let estimates = |offset: f64, error: f64| {
            let mut coefficients = [0.0; TERMS];
            coefficients[0] = offset;
            let field = Alignment::new(coefficients, (100, 100)).expect("a legal field");
            let errors = [error; INTERVALS];
            let offsets = RowOffsets { field, error, errors, blocks: 100, spread: 0.1 };
            let candidates = Candidates::new(0, 16, 100).expect("a legal range");
            Estimates { offsets: Some(offsets), ..Estimates::of_candidates(candidates) }
        };

        assert!(correspond(&estimates(0.3, 0.1)) && correspond(&estimates(-0.1, 0.3)));
        assert!(!correspond(&estimates(0.45, 0.1)) && !correspond(&estimates(-3.0, 0.1)));
        assert!(!correspond(&Estimates { offsets: None, ..estimates(0.0, 0.1) }));
    }
}

//! Pairs with unknown cameras that are too far from rectified for their rows to be aligned: they are
//! rectified from their images.
//!
//! ```text
//! apart  = the row differences that the best field of offsets leaves, pixels    # crate::estimation::rows
//! try, if lenses distort, or apart >= TRIED and blocks do not show that rows correspond;
//!      give up at once if corners do not show that rows differ      # crate::rectification
//! accept, if the cameras explain the rows: block row differences were LEAST_RATIO times those that remain,
//!                  and the evidence favors the cameras over the field; distorting lenses do not need it
//!                  and small copies of the rectified pair match about as well;
//!         or if these match much better;
//!         but not if rows differ by less than the difference in softness of the images
//! ```
//!
//! If rows are off but rectification is not tried, only the axis is checked ([`super::axis`]).
//!
//! All of it is in pixels of the full images: the evidence of reduced copies about rows depends on their
//! size.
//!
//! A pair that is hard to match for other reasons, such as noise or blur, would only be resampled once more.
//! Followed blocks often show this before any search for cameras, and matched corners before the fit to
//! blocks, which takes longer than a match.

use std::sync::Arc;

use super::cameras::NUMBERS;
use super::{Aim, Grays, Negative, Raw, Rectification, Refusal, gray, rectify, shown_axis, warp};
use crate::estimation::blur::Blur;
use crate::estimation::facts::{Facts, INDEPENDENT, SUFFICIENT, evidence};
use crate::estimation::{Estimates, complete};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::TERMS;
use phasestereo_match::settings::Settings;

/// Least row differences, pixels, that the best field of offsets leaves if raw cameras are suspected. None of
/// 12 aligned scenes is then rectified: sharp, with rows off by 1 px, with noise of 20 gray levels, or with
/// both images out of focus.
const TRIED: f64 = 0.4;
/// Least offset of rows, rms in pixels, for which the axis is checked. Not swept; rows of aligned scenes are
/// off by .4 px at most.
const OFF: f64 = 1.0;
/// Smaller row differences of raw images, rms in pixels, are left to alignment.
const LEAST_ROWS: f64 = 0.5;
/// Least ratio of the row differences of blocks to those that the cameras leave. Not swept.
const LEAST_RATIO: f64 = 3.0;
/// Most by which the mean confidence of small copies may fall after rectification: they hardly see
/// distortion. Not swept.
const LARGEST_FALL: f64 = 0.02;
/// A rise of the mean confidence with which cameras need no evidence of rows. Not swept.
const LARGE_RISE: f64 = 0.10;
/// Most time of a match as a multiple of that of its estimates: 1.2 to 2.7 for 12 scenes and a pair of 6
/// megapixels.
const REST: u32 = 3;

/// The result of the attempt to rectify a pair.
pub enum Attempt {
    /// It was not needed, or did not help.
    None,
    /// The images do not determine how.
    Refused(Refusal),
    /// It was rectified.
    Done(Box<RectifiedPair>),
}

/// A pair that was rectified from its images.
pub struct RectifiedPair {
    /// The rectified pair.
    pub pair: Pair,
    /// The estimates of the rectified pair.
    pub estimates: Estimates,
    /// The known facts about the rectified pair.
    pub facts: Facts,
    /// Its cameras.
    pub raw: Arc<Raw>,
}

/// Rectifies a pair with these estimates, if needed, and if the budget leaves time for it and for the match.
pub fn rectify_if_needed(
    pair: &Pair,
    before: &Estimates,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Attempt> {
    let control = runtime.control.aside_leaving(before.time * REST);
    match attempt(pair, before, facts, settings, Runtime { control: &control, ..runtime }) {
        Err(Error::Cancelled) if !runtime.control.is_cancelled() => Ok(Attempt::Refused(Refusal::Late)),
        attempt => attempt,
    }
}

fn attempt(
    pair: &Pair,
    before: &Estimates,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Attempt> {
    let Some(confidence) = before.confidence else { return Ok(Attempt::None) };
    let is_distorted = is_distorted(before);
    let may_help = is_distorted || before.rows_apart >= TRIED && !correspond(before);
    if !(may_help || is_off(before)) || !can_be_tried(before, facts, settings) {
        return Ok(Attempt::None);
    }

    let started = Instant::now();
    let control = runtime.control;
    let [left, right] = pair.views();
    let grays = [gray(left, control)?, gray(right, control)?];
    if !may_help {
        // Rows at a single distance can be straightened, although the distance is what moves them.
        let shown = shown_axis(&grays, runtime)?;
        let clear = shown.filter(|axis| axis.is_along_columns());
        return Ok(clear.map_or(Attempt::None, |axis| Attempt::Refused(Refusal::Axis(axis))));
    }
    // Given disparities are not moved.
    let negative = if facts.candidates.is_none() { Negative::Moved } else { Negative::Kept };
    let aim = Aim { negative, is_only_if_needed: true };
    let rectification = match rectified_at_some_size(&grays, aim, runtime)? {
        Ok(found) if found.rows >= LEAST_ROWS.max(softness(before)) => found,
        Ok(_) | Err(Refusal::NotNeeded) => return Ok(Attempt::None),
        // Differences between rows also differ between corners, whatever their distance.
        Err(Refusal::Axis(_)) if before.sways() => return Ok(Attempt::None),
        Err(refusal) => return Ok(Attempt::Refused(refusal)),
    };

    let raw = Arc::new(Raw::new(rectification, pair.size()));
    let pair = resampled(pair, raw.places(control)?, control)?;
    let facts = Facts {
        axis: facts.axis.clone(),
        candidates: facts.candidates.clone(),
        noise: facts.noise,
        ..Facts::default()
    };
    let (pair, mut estimates) = complete(pair, &facts, settings, runtime)?;
    let rise = estimates.confidence.map_or(f64::NEG_INFINITY, |after| after - confidence);
    let is_explained = explains(&raw.rectification, before.rows_apart, is_distorted);
    if rise < if is_explained { -LARGEST_FALL } else { LARGE_RISE } {
        return Ok(Attempt::None);
    }

    estimates.time += before.time + started.elapsed();
    Ok(Attempt::Done(Box::new(RectifiedPair { pair, estimates, facts, raw })))
}

/// The cameras of a pair; if images of this size do not show them, for example because of noise, those that
/// images of half the size show.
fn rectified_at_some_size(
    grays: &Grays,
    aim: Aim,
    runtime: Runtime,
) -> Result<std::result::Result<Rectification, Refusal>> {
    let pairs = std::slice::from_ref(grays);
    let found = rectify(pairs, 1, aim, runtime)?;
    let Err(refusal) = found else { return Ok(found) };
    if let Refusal::Axis(_) | Refusal::NotNeeded = refusal {
        return Ok(Err(refusal));
    }
    let again = rectify(pairs, 2, aim, runtime)?;
    Ok(again.map_err(|_| refusal))
}

/// Whether cameras explain the rows of a pair better than the best field of offsets, which leaves them
/// `apart`.
fn explains(found: &Rectification, apart: f64, is_distorted: bool) -> bool {
    let left = math::hypot(found.error, found.rms);
    let more = NUMBERS.saturating_sub(TERMS);
    let is_better = is_distorted || evidence(apart, left, more, INDEPENDENT) >= SUFFICIENT;
    is_better && found.rows >= LEAST_RATIO * found.rms
}

/// Whether rows are so far off that the images may come from cameras one above the other. Swaying rows
/// explain it otherwise.
fn is_off(estimates: &Estimates) -> bool {
    !estimates.sways() && estimates.offsets.as_ref().is_some_and(|found| found.field.rms() >= OFF)
}

/// Whether rows are bent as if by distorting lenses.
fn is_distorted(estimates: &Estimates) -> bool {
    estimates.offsets.as_ref().is_some_and(|found| found.distortion().is_some())
}

/// The standard deviation of the blur that most of one image has in addition to the other's, pixels: blocks
/// of such images are off by a share of it, which cameras would explain, too.
fn softness(estimates: &Estimates) -> f64 {
    let blurs = estimates.blur.as_ref().map_or(&[][..], |blur| &blur.blurs);
    blurs.first().map_or(0.0, Blur::spread)
}

/// Whether blocks show that rows correspond well enough to be left to alignment.
fn correspond(estimates: &Estimates) -> bool {
    let rows = estimates.offsets.as_ref();
    rows.is_some_and(|found| found.field.rms() + found.error < LEAST_ROWS)
}

/// Whether a pair may be resampled: no known fact rules it out.
fn can_be_tried(estimates: &Estimates, facts: &Facts, settings: &Settings) -> bool {
    let is_same = estimates.is_one_image();
    settings.self_rectify && !is_same && !facts.is_of_these_pixels() && !estimates.is_inverted
}

/// The pair with its pixels taken from these places of the raw images.
pub fn resampled(pair: &Pair, places: &[Plane<[f32; 2]>; 2], control: &Control) -> Result<Pair> {
    let [left, right] = pair.views();
    let views = [warp::rectified(left, &places[0], control)?, warp::rectified(right, &places[1], control)?];
    Ok(pair.with_views(views))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::rows::RowOffsets;
    use phasestereo_match::pair::alignment::Alignment;
    use phasestereo_match::pair::alignment::sway::INTERVALS;
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

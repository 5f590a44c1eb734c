//! Pairs of which nobody knows the cameras, and that are farther from rectified than their rows can be
//! aligned: they are rectified by what their images show.
//!
//! ```text
//! apart  = how far apart rows stay by the best field of offsets, pixels    # crate::estimation::rows
//! try, if lenses distort, or apart >= TRIED and blocks do not show that rows correspond;
//!      give up at once where corners do not show that rows differ      # crate::rectification
//! accept, if the cameras explain the rows: the rows of blocks were LEAST_RATIO times what the cameras leave of them, and the
//!                  cameras have evidence over the field; lenses that distort need none
//!                  and small copies of the rectified pair match about as well;
//!         or if these match much better;
//!         but not if rows differ by less than one image is softer than the other
//! ```
//!
//! Where rows are not tried but are off, the axis alone is looked at ([`super::axis`]).
//!
//! All of it is in pixels of the images: what copies of a large image say of its rows depends on their size.
//!
//! A pair that is hard to match for other reasons, as noise or blur, would only be resampled once more.
//! Blocks that were followed often show that before any cameras are looked for, and matched corners before
//! they are fitted to blocks, which takes longer than a match.

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

/// Rows that stay farther apart by the best field of offsets, pixels, may be those of raw cameras. None of 12
/// aligned scenes is rectified then: sharp, with rows off by 1 px, with noise of 20 gray levels, or with both
/// images out of focus.
const TRIED: f64 = 0.4;
/// From this offset of rows on, rms in pixels, the axis is looked at. Not swept; rows of aligned scenes are
/// off by .4 px at most.
const OFF: f64 = 1.0;
/// Rows of raw images that differ by less, rms in pixels, are left to be aligned.
const LEAST_ROWS: f64 = 0.5;
/// The rows of blocks differ by this multiple of what the cameras leave, at least. Not swept.
const LEAST_RATIO: f64 = 3.0;
/// By how much the mean confidence of small copies may fall once the pair is rectified: they hardly see
/// distortion. Not swept.
const LARGEST_FALL: f64 = 0.02;
/// A rise of the mean confidence with which cameras need no evidence of rows. Not swept.
const LARGE_RISE: f64 = 0.10;
/// A match takes this multiple of the time of its estimates, at most: 1.2 to 2.7 of 12 scenes and a pair of 6
/// megapixels.
const REST: u32 = 3;

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

/// Rectifies a pair with these estimates, if it needs to be, and if the budget has time for it and for the
/// match.
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
        // Rows of one distance can be straightened, although they are off because of it.
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
        // What differs from row to row differs among corners, too, whatever their distance.
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

/// The cameras of a pair; where images of this size do not show them, as with noise, those that images of
/// half the size show.
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

/// Whether cameras explain the rows of a pair better than the best field of offsets, by which they stay
/// `apart`.
fn explains(found: &Rectification, apart: f64, is_distorted: bool) -> bool {
    let left = math::hypot(found.error, found.rms);
    let more = NUMBERS.saturating_sub(TERMS);
    let is_better = is_distorted || evidence(apart, left, more, INDEPENDENT) >= SUFFICIENT;
    is_better && found.rows >= LEAST_RATIO * found.rms
}

/// Whether rows are off so far that the images may be those of cameras one above the other. Rows that sway
/// are explained by that.
fn is_off(estimates: &Estimates) -> bool {
    !estimates.sways() && estimates.offsets.as_ref().is_some_and(|found| found.field.rms() >= OFF)
}

/// Whether rows are bent as by lenses that distort.
fn is_distorted(estimates: &Estimates) -> bool {
    estimates.offsets.as_ref().is_some_and(|found| found.distortion().is_some())
}

/// The standard deviation of the blur that most of one image has more than the other, pixels: blocks of such
/// images are off by a share of it, which cameras would explain, too.
fn softness(estimates: &Estimates) -> f64 {
    let blurs = estimates.blur.as_ref().map_or(&[][..], |blur| &blur.blurs);
    blurs.first().map_or(0.0, Blur::spread)
}

/// Whether blocks show that rows correspond well enough to be left to alignment.
fn correspond(estimates: &Estimates) -> bool {
    let rows = estimates.offsets.as_ref();
    rows.is_some_and(|found| found.field.rms() + found.error < LEAST_ROWS)
}

/// Whether a pair may be resampled: nothing that is known of it says otherwise.
fn can_be_tried(estimates: &Estimates, facts: &Facts, settings: &Settings) -> bool {
    let is_same = estimates.is_one_image();
    settings.self_rectify && !is_same && !facts.is_of_these_pixels() && !estimates.is_inverted
}

/// A pair whose pixels are at these places of the raw images.
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

//! A whole match: what the pair lacks is estimated, and it is matched as it was prepared. A pair that is farther from rectified than
//! its rows can be straightened is rectified by what its images show, and its map given back in the pixels of the raw left
//! image.
//!
//! ```text
//! if an image is interlaced:
//!     its odd rows become the means of the even ones beside them
//! if the rough match of a pair has little confidence, or its rows are bent as by lenses that distort:
//!     cameras = those that its images show                    # crate::rectification; or nothing, with a reason
//!     rectified = both images as these cameras would see them
//!     if the rough match of the rectified pair has more confidence:
//!         map = match(rectified), in the pixels of the raw left image
//! ```
//!
//! Where the rows of raw images correspond about as well as can be told, nothing is tried: a pair that is hard to match for other
//! reasons, as noise or blur, would only be resampled once more. Blocks that were followed often tell that before any cameras
//! are looked for, which takes ten times as long as a match.

use std::sync::Arc;

use crate::estimation::estimates::Estimates;
use crate::estimation::photometry::Photometry;
use crate::estimation::{Known, Prepared, estimated, prepared};
use crate::findings::{self, Finding, Topic};
use crate::rectification::Raw;
use crate::rectification::{Negative, Refusal, gray, rectify, warp};
use crate::scales::match_over_scales;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::summary::Summary;
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::Settings;

/// Pairs whose rough match has this mean confidence are left as they are.
const GOOD: f64 = 0.70;
/// By how much it must rise once the pair is rectified; where lenses distort, it may fall a little: small copies hardly see that.
const RISE: [f64; 2] = [0.03, -0.02];
/// Rows of raw images that differ by less, rms in pixels, are left to be straightened.
const LEAST_ROWS: f64 = 0.5;

/// What became of a pair that was rectified for its match.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Rectified {
    /// The cameras by which it was.
    #[doc(hidden)]
    pub raw: Arc<Raw>,
    /// The map of the rectified pair.
    #[doc(hidden)]
    pub map: Disparity,
    /// By how many rows each pixel of the raw left image is lower in the raw right one; NaN where there is no disparity.
    pub rows: Plane<f32>,
}

/// A pair that was prepared and matched.
#[derive(Debug)]
pub struct Matched {
    /// The map, in pixels of the left image as it came.
    pub map: Disparity,
    /// The pair as it was matched: that of the rectified images, if it was rectified.
    pub prepared: Prepared,
    /// What became of a pair that had to be rectified; `None`: it did not.
    pub rectified: Option<Rectified>,
}

impl Rectified {
    /// Where each pixel of the rectified left and right image is in the raw one: column and row,
    /// NaN where no ray comes from.
    pub fn places(&self) -> &[Plane<[f32; 2]>; 2] {
        &self.raw.places
    }
}

impl Matched {
    /// The map of a rectified pair, given back in the pixels of the raw left image.
    pub fn of_rectified(
        raw: Arc<Raw>,
        map: Disparity,
        prepared: Prepared,
        runtime: Runtime,
    ) -> Result<Self> {
        let Runtime { matcher, control, .. } = runtime;
        let cameras = &raw.rectification.cameras;
        let (own, rows) = matcher.install(|| warp::raw(&map, cameras, control))?;
        Ok(Self { map: own, prepared, rectified: Some(Rectified { raw, map, rows }) })
    }

    /// Shares of the pixels of the map as it was matched.
    pub fn summary(&self) -> Summary {
        let map = self.rectified.as_ref().map_or(&self.map, |rectified| &rectified.map);
        Summary::new(map, self.prepared.estimates.candidates)
    }
}

/// Estimates what the settings ask for and the caller does not know, and matches the pair as it was prepared; one that is too far
/// from rectified is rectified for that.
pub fn prepare_and_match(
    pair: Pair,
    known: Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Matched> {
    let (pair, estimates) = estimated(pair, &known, settings, runtime)?;
    let (pair, mut estimates) = progressive(pair, estimates, &known, settings, runtime)?;
    let attempt = attempt(&pair, &estimates, &known, settings, runtime)?;
    estimates.findings.extend(attempt.finding(&estimates));
    if let Attempt::Done(matched) = attempt {
        return Ok(*matched);
    }

    let prepared = prepared(pair, estimates, known, settings, runtime)?;
    let map = match_over_scales(&prepared, settings, runtime)?;
    Ok(Matched { map, prepared, rectified: None })
}

/// A pair with these estimates; where an image is interlaced, its even rows alone, and the estimates of that.
fn progressive(
    pair: Pair,
    before: Estimates,
    known: &Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    let fields = before.photometry.map_or([0; 2], |found| found.fields);
    let is_known = known.alignment.is_some() || known.compensation.is_some();
    if fields == [0; 2] || is_known || before.is_inverted || !settings.align_rows {
        return Ok((pair, before));
    }

    let [left, right] = pair.views();
    let of_rows = |view: &View, shift| if shift == 0 { view.clone() } else { view.of_even_rows() };
    let views = [of_rows(left, fields[0]), of_rows(right, fields[1])];
    let (pair, mut after) = estimated(pair.with_views(views), known, settings, runtime)?;

    // What is said of fields, and what is known of them, is of the pair as it came.
    after.photometry = after.photometry.map(|found| Photometry { fields, ..found });
    let is_of_fields = |one: &Finding| one.topic == Topic::Interlacing;
    after.findings.extend(before.findings.into_iter().filter(is_of_fields));
    after.time += before.time;
    Ok((pair, after))
}

/// What came of the attempt to rectify a pair.
enum Attempt {
    /// There was no need, or it did not help.
    None,
    /// The images do not say how.
    Refused(Refusal),
    /// It was rectified and matched.
    Done(Box<Matched>),
}

/// Rectifies and matches a pair with these estimates, if it needs to be.
fn attempt(
    pair: &Pair,
    before: &Estimates,
    known: &Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Attempt> {
    let Some(confidence) = before.confidence else { return Ok(Attempt::None) };
    let is_distorted = is_distorted(before);
    let may_help = is_distorted || confidence < GOOD && !correspond(before);
    if !may_help || !can_be_tried(before, known, settings) {
        return Ok(Attempt::None);
    }

    let started = Instant::now();
    let Runtime { matcher, execution, control } = runtime;
    let [left, right] = pair.views();
    let grays =
        matcher.install(|| -> Result<_> { Ok([gray(left, control)?, gray(right, control)?]) })?;
    // Given disparities are not moved.
    let negative = if known.candidates.is_none() { Negative::Moved } else { Negative::Kept };
    let found = matcher.install(|| rectify(&[grays], negative, execution.level, control))?;
    let rectification = match found {
        Ok(found) if found.rows >= LEAST_ROWS => found,
        Ok(_) => return Ok(Attempt::None),
        Err(refusal) => return Ok(Attempt::Refused(refusal)),
    };

    let raw = matcher.install(|| Raw::new(rectification, pair.size(), control))?;
    let resampled = matcher.install(|| resampled(pair, &raw.places, control))?;
    let given = Known { candidates: known.candidates, noise: known.noise, ..Known::default() };
    let (resampled, mut after) = estimated(resampled, &given, settings, runtime)?;
    let least = confidence + RISE[usize::from(is_distorted)];
    if after.confidence.is_none_or(|after| after < least) {
        return Ok(Attempt::None);
    }

    after.findings.push(findings::rectified(&raw.rectification));
    after.time += before.time + started.elapsed();
    let prepared = prepared(resampled, after, given, settings, runtime)?;
    let map = match_over_scales(&prepared, settings, runtime)?;
    Ok(Attempt::Done(Box::new(Matched::of_rectified(Arc::new(raw), map, prepared, runtime)?)))
}

/// Whether rows are bent as by lenses that distort.
fn is_distorted(estimates: &Estimates) -> bool {
    estimates.offsets.as_ref().is_some_and(|found| found.distortion().is_some())
}

/// Whether blocks tell that rows correspond so well that they would be left as they are.
fn correspond(estimates: &Estimates) -> bool {
    let rows = estimates.offsets.as_ref();
    rows.is_some_and(|found| found.field.rms() + found.error < LEAST_ROWS)
}

/// Whether a pair may be resampled: nothing that is known of it says otherwise.
fn can_be_tried(estimates: &Estimates, known: &Known, settings: &Settings) -> bool {
    let is_same = estimates.range.as_ref().is_some_and(|range| range.identical);
    let is_known = known.alignment.is_some() || known.compensation.is_some();
    settings.self_rectify && !is_same && !is_known && !estimates.is_inverted
}

/// A pair whose pixels are at these places of the raw images.
pub fn resampled(pair: &Pair, places: &[Plane<[f32; 2]>; 2], control: &Control) -> Result<Pair> {
    let [left, right] = pair.views();
    let read = |view, side: usize| {
        warp::rectified(view, &places[side], warp::Interpolation::Lanczos, control)
    };
    Ok(pair.with_views([read(left, 0)?, read(right, 1)?]))
}

impl Attempt {
    /// What is to be said where a pair could not be rectified and hardly matches either.
    fn finding(&self, estimates: &Estimates) -> Option<Finding> {
        let Self::Refused(refusal) = self else { return None };
        findings::not_rectified(estimates, refusal)
    }
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

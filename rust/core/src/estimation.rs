//! Estimation of what a pair lacks, from the two images alone: how their rows correspond, which disparities there are,
//! and which image is the softer one.
//!
//! 1. Both images are reduced to some hundred columns and matched there over all disparities ([`overview`]): that gives
//!    the range to search ([`range`]).
//! 2. Some hundred blocks of the left image are found again in the right one, first in the reduced images, then in the
//!    whole ones ([`tracks`]); a smooth field of vertical offsets is fitted to them, robustly ([`rows`]).
//! 3. The relative blur is estimated ([`crate::estimation::blur`]) from blocks that show the same things: those of the right
//!    image are taken from where the field says, not from the resampled image, since resampling changes the spectrum.
//! 4. Offsets that are significant beside their error straighten the right image.
//! 5. What the gray values say is counted and fitted ([`crate::estimation::photometry`]), and what it all means is said
//!    (`crate::findings`).
//!
//! Where nothing matches, the reduced images are tried once more with the negative of one. If that matches, all of the
//! above is repeated with the negative of the right image, which is then matched, too.
//!
//! Everything is computed in a fixed order, and a pair that is read a few rows at a time gives the same to the bit.

pub mod areas;
pub mod blur;
pub mod compensation_plan;
pub mod estimates;
pub mod overview;
pub mod photometry;
pub mod range;
pub mod rows;
pub mod tracks;

use std::borrow::Cow;
use std::ops::Range;
use std::time::Duration;

use self::compensation_plan::CompensationPlan;
pub use self::estimates::Estimates;
use self::overview::{Overview, RoughMap};
use self::range::{LeftOut, SearchRange};
use self::rows::RowOffsets;
use crate::estimation::blur::defects::{self, Defects, Repaired};
use crate::estimation::blur::parts::{PairRows, Part};
use crate::estimation::blur::rough::{self, RoughMatch};
use crate::estimation::photometry::{Contrast, Photometry, Scales};
use crate::findings;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::image::packing::Packing;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::Source;
use phasestereo_match::settings::Settings;

/// Where the range is unknown, one in so many columns is the number of disparities to search.
const DEFAULT_SHARE: usize = 3;

/// What is to be estimated, and what is known that the estimates depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Request<'a> {
    /// How blur is compensated, if that is known.
    compensation: Option<&'a BlurCompensation>,
    /// The disparities to search, if they are known.
    candidates: Option<Candidates>,
    /// Standard deviations of the noise, if they are known.
    noise: Option<[f64; 2]>,
    /// Whether to estimate how rows correspond.
    rows: bool,
    /// Whether to estimate noise and blur.
    blur: bool,
}

/// What the caller knows of a pair. The rest is estimated, as far as the settings ask for it.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// The disparities to search; `None`: the range is estimated.
    pub candidates: Option<Candidates>,
    /// Standard deviations of the noise, left and right.
    pub noise: Option<[f64; 2]>,
    /// How blur is compensated before pixels are compared; if given, neither blur nor noise is estimated.
    pub compensation: Option<BlurCompensation>,
    /// The field of vertical offsets; if given, none is estimated.
    pub alignment: Option<Alignment>,
    /// Whether the images match once one of them is inverted.
    pub is_inverted: bool,
}

/// A pair with all that a match needs.
#[derive(Debug)]
pub struct Prepared {
    /// The pair, straightened and with its blur compensation.
    pub pair: Pair,
    /// The settings that suit it.
    pub settings: Settings,
    /// What was estimated.
    pub estimates: Estimates,
}

/// Estimates what the settings ask for and the caller does not know, and prepares the pair for its match.
pub fn prepare(
    pair: Pair,
    known: Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Prepared> {
    let (pair, estimates) = estimated(pair, &known, settings, runtime)?;
    prepared(pair, estimates, known, settings, runtime)
}

/// The estimates of a pair, and the pair that they are of, in the narrowest type that holds it.
pub fn estimated(
    pair: Pair,
    known: &Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    settings.check()?;

    let Some(fit) = pair.fit() else { return packed_and_estimated(pair, known, settings, runtime) };

    let (mut fitted, mut estimates) = packed_and_estimated(pair.clone(), known, settings, runtime)?;
    if let Some(exact) =
        estimates.offsets.as_ref().and_then(|rows| fit.exact(&rows.field, rows.error))
    {
        let pair = pair.fitted_again(exact)?;
        (fitted, estimates) = packed_and_estimated(pair, known, settings, runtime)?;
    }
    estimates.findings.push(findings::fitted(&fit));
    Ok((fitted, estimates))
}

/// The estimates of a pair, and the pair in the narrowest type that holds it.
fn packed_and_estimated(
    pair: Pair,
    known: &Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    let packing = Packing::of_views(pair.views(), runtime.control)?;
    estimate(pair.packed(&packing), known, settings, runtime)
}

/// A pair prepared by its estimates.
pub fn prepared(
    pair: Pair,
    estimates: Estimates,
    known: Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Prepared> {
    // What the caller knows comes before what was estimated.
    let compensation = match (&estimates.compensation, known.compensation) {
        (_, Some(compensation)) => Some(compensation),
        (Some(plan), None) => Some(plan.blur_compensation()?),
        (None, None) => known.noise.map(BlurCompensation::of_noise).transpose()?,
    };
    let mut pair = pair.searched(estimates.candidates).with_blur_compensation(compensation);

    if let Some(field) = &estimates.alignment {
        let Runtime { matcher, execution, control } = runtime;
        pair = matcher.install(|| pair.straightened(field, execution.level, control))?;
    }

    let suited = estimates.compensation.as_ref().map(|plan| plan.settings.clone());
    Ok(Prepared { pair, settings: suited.unwrap_or_else(|| settings.clone()), estimates })
}

/// The estimates of a pair, and the pair that they are of: with its ranges, and inverted if it matches so.
fn estimate(
    mut pair: Pair,
    known: &Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    let started = Instant::now();
    let request = known.request(settings);

    // Parts of the pair, and its negative, have to be scaled like the whole.
    if !request.is_empty() || known.is_inverted {
        pair = pair.with_own_ranges(runtime.control)?;
    }
    if known.is_inverted {
        pair = pair.inverted();
    }
    if request.is_empty() {
        let estimates = Estimates::none(pair.candidates(), known);
        return Ok((pair, estimates));
    }

    let mut found =
        runtime.matcher.install(|| Estimates::of_pair(&pair, &request, settings, runtime))?;
    if settings.compensate_blur && found.is_inverted && !known.is_inverted {
        pair = pair.inverted();
        let negative =
            runtime.matcher.install(|| Estimates::of_pair(&pair, &request, settings, runtime))?;
        found = found.with_negative(negative);
    }

    let size = pair.size();
    Ok((pair, found.with_known(known, size, settings, started)))
}

/// The estimates of [`prepare`], to the bit, for a pair that is read a part at a time.
pub fn prepare_by_rows(
    source: &dyn Source,
    known: Known,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Estimates> {
    settings.check()?;

    let started = Instant::now();
    let request = known.request(settings);
    if request.is_empty() {
        return Ok(Estimates::none(source.candidates(), &known));
    }

    let inverted = Inverted(source);
    let source = if known.is_inverted { &inverted } else { source };
    let mut found =
        runtime.matcher.install(|| Estimates::of_source(source, &request, settings, runtime))?;

    if settings.compensate_blur && found.is_inverted && !known.is_inverted {
        let estimate = || Estimates::of_source(&inverted, &request, settings, runtime);
        found = found.with_negative(runtime.matcher.install(estimate)?);
    }

    Ok(found.with_known(&known, source.size(), settings, started))
}

/// A source with the negative of the right image.
struct Inverted<'a>(&'a dyn Source);

impl Source for Inverted<'_> {
    fn size(&self) -> (usize, usize) {
        self.0.size()
    }

    fn candidates(&self) -> Candidates {
        self.0.candidates()
    }

    fn most_rows(&self) -> usize {
        self.0.most_rows()
    }

    fn rows(&self, rows: Range<usize>) -> Result<Pair> {
        Ok(self.0.rows(rows)?.inverted())
    }
}

impl Known {
    /// What the settings ask for and is not known.
    fn request(&self, settings: &Settings) -> Request<'_> {
        let needs_noise = settings.has_weak() && self.noise.is_none();
        let needs_blur =
            settings.compensate_blur || settings.despike || settings.denoise || needs_noise;

        Request {
            compensation: self.compensation.as_ref(),
            candidates: self.candidates,
            noise: self.noise,
            rows: settings.align_rows && self.alignment.is_none(),
            blur: self.compensation.is_none() && needs_blur,
        }
    }
}

impl Request<'_> {
    fn is_empty(&self) -> bool {
        self.candidates.is_some() && !self.rows && !self.blur
    }
}

impl Estimates {
    /// The estimates of a pair in memory.
    fn of_pair(
        pair: &Pair,
        request: &Request,
        settings: &Settings,
        runtime: Runtime,
    ) -> Result<Self> {
        let levels = defects::levels_of_pair(pair, runtime)?;
        let needs_defects = request.blur && blur::is_enough(pair.size());
        let defects = needs_defects.then(|| Defects::of_pair(pair, levels, runtime)).transpose()?;
        let defects = defects.unwrap_or_default();

        let repaired = defects.repaired(pair);
        let part = Part::new(0, Cow::Borrowed(&*repaired), runtime)?;
        let sample = Sample { pair: &repaired, scales: Scales::new(&repaired, levels, runtime)? };
        Self::new(PairRows::Kept(&part), &sample, request, defects, settings, runtime)
    }

    /// The estimates of a pair that is read a part at a time.
    fn of_source(
        source: &dyn Source,
        request: &Request,
        settings: &Settings,
        runtime: Runtime,
    ) -> Result<Self> {
        let levels = defects::levels_of_source(source, runtime)?;
        let needs_defects = request.blur && blur::is_enough(source.size());
        let defects =
            needs_defects.then(|| Defects::of_source(source, levels, runtime)).transpose()?;
        let defects = defects.unwrap_or_default();

        let first = source.rows(0..1)?;
        let sample = Sample { pair: &first, scales: Scales::new(&first, levels, runtime)? };
        let repaired = Repaired { source, impulses: defects.impulses };
        Self::new(PairRows::Read(&repaired), &sample, request, defects, settings, runtime)
    }

    /// The estimates that are requested.
    fn new(
        rows: PairRows,
        sample: &Sample,
        request: &Request,
        defects: Defects,
        settings: &Settings,
        runtime: Runtime,
    ) -> Result<Self> {
        let geometry = Geometry::new(rows, request, runtime)?;
        let geometry = geometry.as_ref();
        let range = geometry.and_then(Geometry::range);
        let alignment = geometry.and_then(|geometry| geometry.alignment.clone());

        let width = rows.size().1;
        let candidates = match (request.candidates, &range) {
            (Some(candidates), _) => candidates,
            (None, Some(range)) => range.candidates(width)?,
            (None, None) => Candidates::new(0, width.div_ceil(DEFAULT_SHARE) as i64, width)?,
        };

        // Blur is compared where both images show the same, so it comes after the geometry. What most of the images show may not
        // be among the known disparities.
        let seen = geometry.and_then(Geometry::seen).map(|range| range.candidates(width));
        let seen = seen.transpose()?.unwrap_or(candidates);
        let blur = || {
            let known = rough::Correspondence { candidates: seen, alignment: alignment.clone() };
            let rough = geometry.map(Geometry::rough_match);
            blur::estimate(rows, sample.pair, known, rough, runtime)
        };
        let blur = || request.blur.then(blur).transpose();
        let remarks = || geometry.map(|found| found.remarks(sample, request, runtime)).transpose();

        let (blur, remarks) = rayon::join(blur, remarks);
        let blur = blur?.map(|blur| blur.with(defects));
        let Remarks { left_out, is_inverted, contrast } = remarks?.unwrap_or_default();

        let noise = blur.as_ref().map(|blur| blur.noise).or(request.noise).unwrap_or_default();
        let photometry =
            Photometry::new(rows, &sample.scales, noise, candidates.count(), contrast, runtime)?;

        let compensation = match (&blur, request.noise) {
            _ if request.compensation.is_some() => None,
            (Some(blur), noise) => {
                Some(CompensationPlan::new(blur, noise, photometry.range, settings)?)
            }
            (None, Some(noise)) => Some(CompensationPlan::of_noise(noise, settings)?),
            (None, None) => None,
        };

        Ok(Self {
            candidates,
            confidence: geometry.map(|geometry| geometry.matched().confidence),
            is_inverted,
            range,
            left_out,
            offsets: geometry.and_then(|geometry| geometry.offsets.clone()),
            alignment,
            blur,
            photometry: Some(photometry),
            compensation,
            findings: vec![],
            time: Duration::ZERO,
        })
    }

    /// The estimates of the pair with the negative of the right image, but for the pixels as they are.
    fn with_negative(self, negative: Self) -> Self {
        let saturation = self.photometry.map(|own| own.saturation);
        let photometry = negative.photometry.zip(saturation);
        let photometry = photometry.map(|(found, saturation)| Photometry { saturation, ..found });

        Self { is_inverted: true, photometry, ..negative }
    }

    /// The same with what the caller knows, what there is to say of it, and the time since the start.
    fn with_known(
        mut self,
        known: &Known,
        size: (usize, usize),
        settings: &Settings,
        started: Instant,
    ) -> Self {
        self.alignment = self.alignment.or_else(|| known.alignment.clone());
        self.is_inverted |= known.is_inverted;
        self.findings = findings::of_pair(&self, size, known.candidates.is_some(), settings);

        Self { time: started.elapsed(), ..self }
    }

    /// No estimates of a pair whose disparities are known.
    #[cfg(test)]
    pub fn of_candidates(candidates: Candidates) -> Self {
        Self::none(candidates, &Known::default())
    }

    /// The estimates where nothing is requested: what the caller knows.
    fn none(candidates: Candidates, known: &Known) -> Self {
        Self {
            candidates: known.candidates.unwrap_or(candidates),
            confidence: None,
            is_inverted: known.is_inverted,
            range: None,
            left_out: vec![],
            offsets: None,
            alignment: known.alignment.clone(),
            blur: None,
            photometry: None,
            compensation: None,
            findings: vec![],
            time: Duration::ZERO,
        }
    }
}

/// How the reduced images correspond.
struct Geometry {
    /// The images, reduced ...
    copies: Overview,
    /// ... and reduced more, if others of the usual size are finer.
    usual: Option<Overview>,
    /// The rough match of the known disparities, or else of all that are tried.
    rough: RoughMap,
    /// That of all that are tried, where the known ones match badly.
    wide: Option<RoughMap>,
    offsets: Option<RowOffsets>,
    alignment: Option<Alignment>,
    found: Option<range::Found>,
}

/// What else the reduced images show, as the fields of [`Estimates`] say; neither geometry nor blur depends on it.
#[derive(Default)]
struct Remarks {
    left_out: Vec<LeftOut>,
    is_inverted: bool,
    contrast: Option<Contrast>,
}

/// Some rows of a pair, and its scales.
struct Sample<'a> {
    pair: &'a Pair,
    scales: Scales,
}

impl Geometry {
    /// Matches the reduced images; `None`: they are not needed or too small.
    fn new(rows: PairRows, request: &Request, runtime: Runtime) -> Result<Option<Self>> {
        let is_needed = request.candidates.is_none() || request.rows;
        // The ends of an unknown range are found on finer copies.
        let copies = |runtime| match request.candidates {
            Some(_) => Overview::new(rows, runtime),
            None => Overview::fine(rows, runtime),
        };
        let Some(copies) = is_needed.then(|| copies(runtime)).transpose()?.flatten() else {
            return Ok(None);
        };
        let usual = copies.usual(runtime)?;
        let overview = usual.as_ref().unwrap_or(&copies);

        let mut rough = overview.rough(request.candidates, None, runtime)?;
        let (mut offsets, mut alignment) = (None, None);
        if request.rows {
            let found = rows::offsets(rows, overview, &rough, request.candidates, runtime)?;
            offsets = found.offsets;
            let significant = offsets.as_ref().filter(|offsets| offsets.is_significant());
            alignment = significant.map(|offsets| offsets.field.clone());

            if let Some(field) = &alignment {
                rough = found.map.unwrap_or(rough);
                if !rows::is_straight(overview, &rough, field) {
                    rough = overview.rough(request.candidates, Some(field), runtime)?;
                }
            }
        }

        // Where known disparities match badly, a finding names those that would match better.
        let is_poor = request.candidates.is_some() && rough.confidence < overview::GOOD_CONFIDENCE;
        let wide =
            is_poor.then(|| overview.rough(None, alignment.as_ref(), runtime)).transpose()?;

        let last = wide.as_ref().unwrap_or(&rough);
        let is_asked = request.candidates.is_none() || is_poor;
        let found = is_asked.then(|| range::range(&copies, overview, last, runtime)).transpose()?;
        let found = found.flatten();

        Ok(Some(Self { copies, usual, rough, wide, offsets, alignment, found }))
    }

    fn overview(&self) -> &Overview {
        self.usual.as_ref().unwrap_or(&self.copies)
    }

    fn range(&self) -> Option<SearchRange> {
        self.found.as_ref().map(|found| found.range)
    }

    /// The range of the match of all disparities that are tried, where the known ones match badly, and these well.
    fn seen(&self) -> Option<SearchRange> {
        let is_good = |wide: &RoughMap| wide.confidence >= overview::GOOD_CONFIDENCE;
        self.wide.as_ref().filter(|wide| is_good(wide)).and(self.range())
    }

    /// The rough match that is better: of all disparities where [`Self::seen`] has a range, else of the known ones.
    fn matched(&self) -> &RoughMap {
        self.wide.as_ref().filter(|_| self.seen().is_some()).unwrap_or(&self.rough)
    }

    fn rough_match(&self) -> RoughMatch {
        let (disparity, factor) = (self.matched().unsure.clone(), self.overview().factor);
        RoughMatch::of_whole(disparity, factor, self.alignment.clone())
    }

    fn remarks(&self, sample: &Sample, request: &Request, runtime: Runtime) -> Result<Remarks> {
        let (overview, rough) = (self.overview(), &self.rough);
        let last = self.wide.as_ref().unwrap_or(rough);

        let left_out = match (request.candidates, &self.found) {
            (Some(given), _) => range::left_out(overview, rough, given, runtime)?,
            (None, Some(found)) => found.left_out.clone(),
            (None, None) => vec![],
        };

        let negative = |candidates| -> Result<f64> {
            Ok(overview.inverted().rough(candidates, None, runtime)?.confidence)
        };
        let is_inverted = if self.found.is_none() && last.confidence < range::LEAST_CONFIDENCE {
            negative(None)? >= overview::GOOD_CONFIDENCE
        } else if request.candidates.is_some() && overview.is_opposite(rough) {
            // Of few candidates some always match: then it is the gray levels that tell.
            negative(request.candidates)? >= rough.confidence.max(overview::GOOD_CONFIDENCE)
        } else {
            false
        };

        Ok(Remarks { left_out, is_inverted, contrast: sample.scales.contrast(overview, last) })
    }
}

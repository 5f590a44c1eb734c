//! Estimation of the unknown properties of a pair, from its images alone: how their rows correspond, which
//! disparities occur, and which image is softer.
//!
//! 1. Both images are reduced to some hundred columns and matched there over all disparities ([`overview`]);
//!    this gives the range to search ([`range`]).
//! 2. Some hundred blocks of the left image are located in the right one, first in the reduced images, then
//!    in the full ones ([`tracks`]); a smooth field of vertical offsets is fitted to them, robustly
//!    ([`rows`]).
//! 3. The relative blur is estimated ([`crate::estimation::blur`]) from blocks that show the same things:
//!    those of the right image are taken from the places given by the field, not from the resampled image,
//!    since resampling changes the spectrum.
//! 4. If the offsets are significant compared with their error, the rows of the right image are aligned by
//!    them.
//! 5. Gray values are counted and fitted ([`crate::estimation::photometry`]).
//!
//! If nothing matches, the reduced images are tried once more with the negative of one. If that matches,
//! everything above is repeated with the negative of the right image, which is then also matched. If an image
//! is interlaced, or the raw mosaic of a color sensor, it is resolved ([`raster`]), and everything is
//! repeated. For pairs in memory, what both images share is subtracted before all this ([`shared`],
//! [`crosstalk`]).
//!
//! Everything is computed in a fixed order, and a pair that is read a few rows at a time gives bit-identical
//! results.

pub mod areas;
pub mod blur;
pub mod compensation_plan;
pub mod crosstalk;
pub mod estimates;
pub mod extent;
pub mod facts;
pub mod fine_detail;
pub mod means;
pub mod order;
pub mod overview;
pub mod periods;
pub mod photometry;
pub mod range;
pub mod raster;
pub mod registration;
pub mod rows;
pub mod shared;
pub mod tracks;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use self::blur::defects::Defects;
pub use self::blur::defects::gray_levels;
use self::blur::parts::PairRows;
use self::blur::rough::{self, RoughMatch};
use self::compensation_plan::CompensationPlan;
pub use self::estimates::Estimates;
use self::facts::{Fact, Facts, Rows};
use self::overview::{Overview, RoughMap, Seen};
use self::photometry::{Contrast, Photometry, Scales};
use self::range::{Copies, LeftOut, SearchRange};
use self::raster::{Raster, resolved};
use self::rows::RowOffsets;
use self::shared::{SameDetail, Shared, SharedPart};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::matcher::Execution;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::Source;
use phasestereo_match::settings::Settings;

/// If the range is unknown, the number of disparities to search is the number of columns divided by this.
const DEFAULT_SHARE: usize = 3;

/// A pair with everything that a match needs.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The pair, with aligned rows and its blur compensation.
    pub pair: Pair,
    /// The settings adapted to it.
    pub settings: Settings,
    /// The estimates.
    pub estimates: Estimates,
}

/// What to estimate: properties that the settings ask for and that are unknown.
struct Request<'a> {
    facts: &'a Facts,
    /// Whether to estimate how rows correspond.
    rows: bool,
    /// Whether to estimate noise and blur.
    blur: bool,
}

/// Estimates the unknown properties of a pair that the settings ask for. Returns the pair that the estimates
/// describe: inverted, or with even rows only, if the images require it.
pub fn complete(
    pair: Pair,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    let (pair, before) = completed(pair, facts, settings, runtime)?;
    let Some(found) = before.photometry.filter(|_| may_resolve(&before, facts, settings)) else {
        return Ok((pair, before));
    };
    let rasters = Raster::of(&found);
    if rasters == [Raster::Whole; 2] {
        return Ok((pair, before));
    }

    let (pair, after) = completed(resolved(&pair, rasters)?, facts, settings, runtime)?;
    let time = before.time + after.time;
    Ok((pair, Estimates { time, ..after.of_resolved(rasters, before.photometry) }))
}

/// What both images of a pair share, as far as is known before the match.
#[derive(Debug)]
pub struct Examined {
    /// The fine detail that they show at the same place, if it was to be found.
    pub same: SameDetail,
    /// What is subtracted from them, and its standard deviation in units of the pixels.
    pub shared: Option<(Shared, f64)>,
    /// The pair without it.
    pub clean: Option<Pair>,
}

/// Examines what both images share, and subtracts it if it is known or certain.
pub fn without_shared(pair: &Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Examined> {
    let is_asked = !facts.is_of_these_pixels() && !Request::new(facts, settings).is_empty();
    let same = if facts.shared.is_none() && is_asked { shared::same_detail(pair) } else { SameDetail::None };
    let shared = facts.shared.or((same == SameDetail::Pattern).then_some(Shared::Pattern));
    let Some(shared) = shared else { return Ok(Examined { same, shared: None, clean: None }) };

    let part = SharedPart::new(pair, shared, runtime)?;
    Ok(Examined { same, shared: Some((shared, part.strength())), clean: Some(part.removed(pair)?) })
}

/// [`complete`] for a pair without interlaced images.
fn completed(
    mut pair: Pair,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Pair, Estimates)> {
    let estimates = complete_source(&pair, facts, settings, runtime)?;
    if takes_negative(facts, settings, &estimates) {
        pair = pair.inverted();
    }
    Ok((pair, estimates))
}

/// Whether the negative of the right image is matched.
pub fn takes_negative(facts: &Facts, settings: &Settings, estimates: &Estimates) -> bool {
    facts.is_inverted || settings.compensate_blur && estimates.is_inverted
}

/// The estimates of [`complete`], bit for bit, for a pair that is read a part at a time. A difference between
/// its fields is only reported.
pub fn complete_source(
    source: &dyn Source,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Estimates> {
    settings.check()?;

    let started = Instant::now();
    let request = Request::new(facts, settings);
    if request.is_empty() {
        let given = facts.candidates.clone();
        let candidates = given.unwrap_or_else(|| Fact::estimated(source.candidates()));
        return Ok(Estimates::of_facts(candidates, facts));
    }

    let inverted = Changed::new(source, |pair| Ok(Cow::Owned(pair.inverted())));
    let source = if facts.is_inverted { &inverted } else { source };
    let mut found = Estimates::of_source(source, &request, settings, runtime)?;
    if settings.compensate_blur && found.is_inverted && !facts.is_inverted {
        let negative = Estimates::of_source(&inverted, &request, settings, runtime)?;
        found = found.with_negative(negative);
    }

    found.is_inverted |= facts.is_inverted;
    Ok(Estimates { time: started.elapsed(), ..found })
}

/// Whether fields and mosaics are to be compensated.
fn may_resolve(estimates: &Estimates, facts: &Facts, settings: &Settings) -> bool {
    settings.align_rows && !facts.is_of_these_pixels() && !estimates.is_inverted
}

/// Prepares a pair for its match, by the known facts and the estimates.
pub fn prepare(
    pair: Pair,
    estimates: Estimates,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Prepared> {
    // Known facts take precedence over estimates.
    let compensation = match (&facts.compensation, &estimates.compensation) {
        (Some(known), _) => Some(known.clone()),
        (None, Some(plan)) => Some(plan.blur_compensation()?),
        (None, None) => facts.noise.map(BlurCompensation::of_noise).transpose()?,
    };
    let Runtime { execution: Execution { level, .. }, control, .. } = runtime;
    let pair = pair.searched(estimates.candidates.value);
    let mut pair = pair.with_blur_compensation(compensation, level, control)?;

    if let Some(field) = &estimates.alignment {
        pair = pair.straightened(field, level, control)?;
    }

    let suited = estimates.compensation.as_ref().map(|plan| plan.settings.clone());
    Ok(Prepared { pair, settings: suited.unwrap_or_else(|| settings.clone()), estimates })
}

/// A source whose pairs are changed after they are read.
struct Changed<'a, F> {
    source: &'a dyn Source,
    change: F,
}

impl<'a, F: for<'b> Fn(Cow<'b, Pair>) -> Result<Cow<'b, Pair>> + Sync> Changed<'a, F> {
    fn new(source: &'a dyn Source, change: F) -> Self {
        Self { source, change }
    }
}

impl<F: for<'b> Fn(Cow<'b, Pair>) -> Result<Cow<'b, Pair>> + Sync> Source for Changed<'_, F> {
    fn size(&self) -> (usize, usize) {
        self.source.size()
    }

    fn candidates(&self) -> Candidates {
        self.source.candidates()
    }

    fn most_rows(&self) -> usize {
        self.source.most_rows()
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Pair>> {
        (self.change)(self.source.rows(rows)?)
    }
}

impl<'a> Request<'a> {
    fn new(facts: &'a Facts, settings: &Settings) -> Self {
        let needs_noise = settings.has_weak() && facts.noise.is_none();
        let needs_blur = settings.compensate_blur || settings.despike || settings.denoise || needs_noise;
        let rows = match facts.rows {
            Rows::Unknown => settings.align_rows,
            Rows::Wanted => true,
            Rows::Known(_) => false,
        };

        Self { facts, rows, blur: facts.compensation.is_none() && needs_blur }
    }

    fn is_empty(&self) -> bool {
        self.facts.candidates.is_some() && !self.rows && !self.blur
    }
}

impl Estimates {
    /// The requested estimates of a pair.
    fn of_source(
        source: &dyn Source,
        request: &Request,
        settings: &Settings,
        runtime: Runtime,
    ) -> Result<Self> {
        let levels = gray_levels(source)?;
        let needs_defects = request.blur && blur::is_enough(source.size());
        let defects = needs_defects.then(|| Defects::new(source, levels, runtime)).transpose()?;
        let defects = defects.unwrap_or_default();

        let source = &Changed::new(source, |pair| {
            if defects.impulses.iter().all(|height| *height <= 0.0) {
                return Ok(pair);
            }
            let repaired = pair.repaired(defects.impulses, runtime.level(), runtime.control)?;
            Ok(Cow::Owned(repaired.into_owned()))
        });
        let rows = &PairRows::new(source, runtime)?;
        let sample = &*rows.sample()?;
        let scales = &Scales::new(sample);

        let facts = request.facts;
        let geometry = CopyGeometry::new(rows, request, runtime)?;
        let geometry = geometry.as_ref();
        let range = geometry.and_then(CopyGeometry::range);
        let alignment = geometry.and_then(|geometry| geometry.alignment.clone());

        let width = rows.size().1;
        let candidates = match (&facts.candidates, &range) {
            (Some(known), _) => known.clone(),
            (None, Some(range)) => Fact::estimated(range.candidates(width)?),
            (None, None) => Fact::estimated(Candidates::new(0, width.div_ceil(DEFAULT_SHARE) as i64, width)?),
        };

        // Blur is compared where both images show the same things, so it comes after the geometry. The known
        // disparities may not include those of most of the images.
        let seen = geometry.and_then(CopyGeometry::seen).map(|range| range.candidates(width));
        let seen = seen.transpose()?.unwrap_or(candidates.value);
        let blur = || {
            let known = rough::Correspondence { candidates: seen, alignment: alignment.clone() };
            blur::estimate(rows, sample, known, geometry.map(CopyGeometry::rough_match), runtime)
        };
        let blur = || request.blur.then(blur).transpose();
        let remarks = || geometry.map(|found| found.remarks(scales, facts, runtime)).transpose();

        let (blur, remarks) = rayon::join(blur, remarks);
        let blur = blur?.map(|blur| blur.with(defects));
        let Remarks { left_out, is_inverted, contrast } = remarks?.unwrap_or_default();

        let noise = blur.as_ref().map(|blur| blur.noise).or(facts.noise).unwrap_or_default();
        let count = candidates.value.count();
        let photometry = Photometry::new(rows, scales, noise, count, contrast, runtime)?;

        let compensation = match (&blur, facts.noise) {
            _ if facts.compensation.is_some() => None,
            (Some(blur), noise) => Some(CompensationPlan::new(blur, noise, photometry.range, settings)?),
            (None, Some(noise)) => Some(CompensationPlan::of_noise(noise, settings)?),
            (None, None) => None,
        };

        Ok(Self {
            confidence: geometry.map(|geometry| geometry.matched().confidence),
            is_inverted,
            seen: geometry.map(|geometry| Arc::new(geometry.seen_disparities())),
            range,
            left_out,
            offsets: geometry.and_then(|geometry| geometry.offsets.clone()),
            rows_apart: geometry.map_or(f64::INFINITY, |geometry| geometry.rows_apart),
            alignment: alignment.or_else(|| facts.aligned().cloned().flatten()),
            blur,
            photometry: Some(photometry),
            compensation,
            ..Self::of_facts(candidates, facts)
        })
    }

    /// The estimates of the pair with the negative of the right image, but with the saturation of the
    /// original pixels.
    fn with_negative(self, negative: Self) -> Self {
        let saturation = self.photometry.map(|own| own.saturation);
        let photometry = negative.photometry.zip(saturation);
        let photometry = photometry.map(|(found, saturation)| Photometry { saturation, ..found });

        Self { is_inverted: true, photometry, ..negative }
    }

    /// Estimates of a pair for which only the disparities are known.
    #[cfg(test)]
    pub fn of_candidates(candidates: Candidates) -> Self {
        Self::of_facts(Fact::estimated(candidates), &Facts::default())
    }

    /// The known facts, when nothing is requested.
    fn of_facts(candidates: Fact<Candidates>, facts: &Facts) -> Self {
        Self {
            axis: facts.axis.clone(),
            candidates,
            confidence: None,
            is_inverted: facts.is_inverted,
            rasters: [Raster::Whole; 2],
            seen: None,
            borders: [0.0; 2],
            overlays: vec![],
            range: None,
            left_out: vec![],
            offsets: None,
            rows_apart: f64::INFINITY,
            shared: None,
            alignment: facts.aligned().cloned().flatten(),
            blur: None,
            photometry: None,
            compensation: None,
            findings: vec![],
            time: Duration::ZERO,
        }
    }
}

/// How the reduced images correspond.
struct CopyGeometry {
    /// The images, reduced ...
    copies: Overview,
    /// ... and reduced further, if the others are finer than usual.
    usual: Option<Overview>,
    /// The rough match over the known disparities, or otherwise over all that are tried.
    rough: RoughMap,
    /// The rough match over all, if the known ones match badly.
    wide: Option<RoughMap>,
    offsets: Option<RowOffsets>,
    rows_apart: f64,
    alignment: Option<Alignment>,
    found: Option<range::FoundRange>,
}

/// Other properties shown by the reduced images, as in the fields of [`Estimates`]; neither geometry nor blur
/// depends on them.
#[derive(Default)]
struct Remarks {
    left_out: Vec<LeftOut>,
    is_inverted: bool,
    contrast: Option<Contrast>,
}

impl CopyGeometry {
    /// Matches the reduced images; `None`: they are not needed or too small.
    fn new(rows: &PairRows, request: &Request, runtime: Runtime) -> Result<Option<Self>> {
        let facts = request.facts;
        let is_needed = facts.candidates.is_none() || request.rows;
        // The ends of an unknown range are found on finer copies.
        let copies = |runtime| match facts.candidates {
            Some(_) => Overview::new(rows, runtime),
            None => Overview::fine(rows, runtime),
        };
        let Some(copies) = is_needed.then(|| copies(runtime)).transpose()?.flatten() else {
            return Ok(None);
        };
        let usual = copies.usual(runtime)?;
        let overview = usual.as_ref().unwrap_or(&copies);

        let mut rough = overview.rough(facts.searched(), None, runtime)?;
        let (mut offsets, mut rows_apart, mut alignment) = (None, f64::INFINITY, None);
        if request.rows {
            let found = rows::offsets(rows, overview, &rough, facts.searched(), runtime)?;
            offsets = found.offsets;
            rows_apart = found.apart;
            let significant = offsets.as_ref().filter(|offsets| offsets.is_significant());
            alignment = significant.map(|offsets| offsets.field.clone());

            if let Some(field) = &alignment {
                rough = found.map.unwrap_or(rough);
                if !rows::is_straight(overview, &rough, field) {
                    rough = overview.rough(facts.searched(), Some(field), runtime)?;
                }
            }
        }

        // If known disparities match badly, a finding names those that would match better.
        let is_poor = facts.candidates.is_some() && rough.confidence < overview::GOOD_CONFIDENCE;
        let wide = is_poor.then(|| overview.rough(None, alignment.as_ref(), runtime)).transpose()?;

        let last = wide.as_ref().unwrap_or(&rough);
        let is_asked = facts.candidates.is_none() || is_poor;
        let found = || {
            let finest = copies.finest(rows, runtime)?;
            let finest = finest.as_ref().unwrap_or(&copies);
            range::range(Copies { finest, fine: &copies, overview }, last, facts.turns(), runtime)
        };
        let found = is_asked.then(found).transpose()?.flatten();

        Ok(Some(Self { copies, usual, rough, wide, offsets, rows_apart, alignment, found }))
    }

    fn overview(&self) -> &Overview {
        self.usual.as_ref().unwrap_or(&self.copies)
    }

    fn range(&self) -> Option<SearchRange> {
        self.found.as_ref().map(|found| found.range)
    }

    /// The range from the match over all disparities, if the known ones match badly, and these well.
    fn seen(&self) -> Option<SearchRange> {
        let is_good = |wide: &RoughMap| wide.confidence >= overview::GOOD_CONFIDENCE;
        self.wide.as_ref().filter(|wide| is_good(wide)).and(self.range())
    }

    /// The better rough match: over all disparities if [`Self::seen`] has a range, else over the known ones.
    fn matched(&self) -> &RoughMap {
        self.wide.as_ref().filter(|_| self.seen().is_some()).unwrap_or(&self.rough)
    }

    /// The better rough match, in pixels of the whole images.
    fn seen_disparities(&self) -> Seen {
        self.matched().seen(self.overview().factor)
    }

    fn rough_match(&self) -> RoughMatch {
        let (disparity, factor) = (self.matched().unsure.clone(), self.overview().factor);
        RoughMatch::of_whole(disparity, factor, self.alignment.clone())
    }

    fn remarks(&self, scales: &Scales, facts: &Facts, runtime: Runtime) -> Result<Remarks> {
        let (overview, rough) = (self.overview(), &self.rough);
        let last = self.wide.as_ref().unwrap_or(rough);

        let left_out = match (facts.searched(), &self.found) {
            (Some(given), _) => range::left_out(overview, rough, given, runtime)?,
            (None, Some(found)) => found.left_out.clone(),
            (None, None) => vec![],
        };

        let negative = |candidates| -> Result<f64> {
            Ok(overview.inverted().rough(candidates, None, runtime)?.confidence)
        };
        let is_inverted = if self.found.is_none() && last.confidence < range::LEAST_CONFIDENCE {
            negative(None)? >= overview::GOOD_CONFIDENCE
        } else if facts.candidates.is_some() && overview.is_opposite(rough) {
            // Among few candidates some always match: then gray levels decide.
            negative(facts.searched())? >= rough.confidence.max(overview::GOOD_CONFIDENCE)
        } else {
            false
        };

        Ok(Remarks { left_out, is_inverted, contrast: scales.contrast(overview, self.matched()) })
    }
}

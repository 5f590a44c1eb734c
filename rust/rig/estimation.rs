//! What a match is not told is found out from the two images: where their rows lie, which disparities there are, and
//! which image is the softer one.
//!
//! 1. Both images are reduced to some hundred columns and matched there over all disparities ([`overview`]): that tells
//!    the range to search ([`range`]).
//! 2. Some hundred blocks of the left image are found again in the right one, first in the reduced images, then in the
//!    whole ones ([`tracks`]); a smooth field of vertical offsets is fitted to them, robustly ([`rows`]).
//! 3. The relative blur is estimated ([`crate::rig::blur`]) from blocks that lie on the same things: those of the right image are
//!    taken from where the field says, not from the resampled image, whose spectrum is another.
//! 4. If the offsets are significant, some bands are matched with and without them ([`trial`]). The right image is
//!    straightened only if the match gets better by it.
//!
//! Where nothing matches, the reduced images are tried once more with the negative of one: if that matches, all of the above
//! is done with the negative of the right image, which is matched, too.
//!
//! Everything is in a fixed order, and the same for a pair that is read a few rows at a time.

pub mod compensation;
pub mod overview;
pub mod range;
pub mod rows;
pub mod tracks;
pub mod trial;

use std::borrow::Cow;
use std::ops::Range;
use std::time::Duration;

use self::compensation::Compensation;
use self::overview::Overview;
use self::range::SearchRange;
use self::rows::Offsets;
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::pipeline::matcher::{Disparity, Pair};
use crate::pipeline::platform::Instant;
use crate::pipeline::source::Source;
use crate::rig::alignment::Alignment;
use crate::rig::blur;
use crate::rig::blur::defects::{Defects, Repaired};
pub use crate::rig::blur::parts::Means;
use crate::rig::blur::parts::{Part, Rows};
use crate::rig::blur::rough;
use crate::rig::blur_compensation::BlurCompensation;
use crate::settings::Settings;

/// Share of the width that is searched where nothing tells the range.
const DEFAULT_SHARE: usize = 3;

/// What is to be found out.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked<'a> {
    /// How blur is evened out before pixels are compared, if they are told.
    compensation: Option<&'a BlurCompensation>,
    /// The disparities, which are told already; `None`: they are to be found.
    pub candidates: Option<Candidates>,
    /// Standard deviations of the noise, which are told already.
    pub noise: Option<[f64; 2]>,
    /// Whether it is to be found how rows correspond.
    pub rows: bool,
    /// Whether noise and blur are to be found.
    pub blur: bool,
}

/// What is known of a pair before it is looked at.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// The disparities to search; `None`: they are to be found.
    pub candidates: Option<Candidates>,
    /// Standard deviations of the noise.
    pub noise: Option<[f64; 2]>,
    /// How blur is evened out before pixels are compared: there is nothing to be found of blur and noise then.
    pub compensation: Option<BlurCompensation>,
    /// The field of the rows: there is nothing to be found of it then.
    pub alignment: Option<Alignment>,
    /// Whether the images match once one of them is inverted.
    pub is_inverted: bool,
}

/// What was found out of a pair, and what suits it.
#[derive(Debug, Clone)]
pub struct Estimates {
    /// The disparities to search.
    pub candidates: Candidates,
    /// Mean confidence of a rough match of small copies, if there was one.
    pub confidence: Option<f64>,
    /// Whether the images match once one of them is inverted, and not before; with `compensate_blur`, all else was found out with
    /// the negative of the right one.
    pub is_inverted: bool,
    /// What the images say about the disparities, if they were to be found, or match badly.
    pub range: Option<SearchRange>,
    /// Where the rows lie, if that was asked and there is enough to see it by.
    pub offsets: Option<Offsets>,
    /// The field that the right image is straightened by.
    pub alignment: Option<Alignment>,
    /// Noise and blur, if that was asked.
    pub blur: Option<blur::Estimate>,
    /// What suits them, and noise that is told.
    pub compensation: Option<Compensation>,
    /// Wall-clock time.
    pub time: Duration,
}

/// A pair with all that a match needs.
#[derive(Debug)]
pub struct Prepared {
    /// The pair, straightened and with how blur is evened out.
    pub pair: Pair,
    /// The settings that suit it.
    pub settings: Settings,
    /// What was found out.
    pub found: Estimates,
}

/// Finds out of a pair what the settings ask for and nobody told, and has it ready to be matched.
pub fn prepare(pair: Pair, known: Known, settings: &Settings, means: Means) -> Result<Prepared> {
    settings.check()?;
    let asked = known.asked(settings);
    let Means { how, control, .. } = means;
    let (started, mut pair) = (Instant::now(), pair);
    if asked.is_anything() || known.is_inverted {
        pair = pair.with_own_ranges(means.control)?;
    }
    if known.is_inverted {
        pair = pair.inverted();
    }
    let found = if asked.is_anything() {
        let mut found = means.matcher.install(|| estimate_pair(&pair, &asked, settings, means))?;
        if settings.compensate_blur && found.is_inverted && !known.is_inverted {
            pair = pair.inverted();
            found = means.matcher.install(|| estimate_pair(&pair, &asked, settings, means))?;
            found.is_inverted = true;
        }
        found.finished(&known, started)
    } else {
        Estimates::nothing(pair.candidates(), &known)
    };
    let compensation = match (&found.compensation, known.compensation) {
        (_, Some(compensation)) => Some(compensation),
        (Some(compensation), None) => Some(compensation.blur_compensation()?),
        (None, None) => known.noise.map(BlurCompensation::of_noise).transpose()?,
    };
    let mut pair = pair.searched(found.candidates).with_blur_compensation(compensation);
    if let Some(field) = &found.alignment {
        pair = means.matcher.install(|| pair.straightened(field, how.level, control))?;
    }
    let suited = found.compensation.as_ref().map(|found| found.settings.clone());
    Ok(Prepared { pair, settings: suited.unwrap_or_else(|| settings.clone()), found })
}

/// Finds out of a pair what the settings ask for and nobody told, and matches it.
pub fn prepare_and_match(
    pair: Pair,
    known: Known,
    settings: &Settings,
    means: Means,
) -> Result<(Disparity, Estimates)> {
    let Prepared { pair, settings, found } = prepare(pair, known, settings, means)?;
    Ok((means.matcher.run(&pair, &settings, means.how, means.control)?, found))
}

/// Finds out the same of a pair that is read a part at a time, to the bit.
pub fn prepare_by_rows(
    source: &dyn Source,
    known: Known,
    settings: &Settings,
    means: Means,
) -> Result<Estimates> {
    settings.check()?;
    let (asked, started) = (known.asked(settings), Instant::now());
    if !asked.is_anything() {
        return Ok(Estimates::nothing(source.candidates(), &known));
    }
    let inverted = Inverted(source);
    let source = if known.is_inverted { &inverted } else { source };
    let mut found = means.matcher.install(|| estimate_by_rows(source, &asked, settings, means))?;
    if settings.compensate_blur && found.is_inverted && !known.is_inverted {
        found = means.matcher.install(|| estimate_by_rows(&inverted, &asked, settings, means))?;
        found.is_inverted = true;
    }
    Ok(found.finished(&known, started))
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

/// Finds out what is asked of a pair in memory.
fn estimate_pair(
    pair: &Pair,
    asked: &Asked,
    settings: &Settings,
    means: Means,
) -> Result<Estimates> {
    let is_asked = asked.blur && blur::is_enough(pair.size());
    let defects = is_asked.then(|| Defects::of_pair(pair, means)).transpose()?.unwrap_or_default();
    let repaired = defects.repaired(pair);
    let part = Part::new(0, Cow::Borrowed(&*repaired), means)?;
    estimate(Rows::Kept(&part), &repaired, asked, defects, settings, means)
}

/// Finds out what is asked of a pair that is read a part at a time.
fn estimate_by_rows(
    source: &dyn Source,
    asked: &Asked,
    settings: &Settings,
    means: Means,
) -> Result<Estimates> {
    let is_asked = asked.blur && blur::is_enough(source.size());
    let defects = is_asked.then(|| Defects::of_source(source, means)).transpose()?;
    let defects = defects.unwrap_or_default();
    let (sample, impulses) = (source.rows(0..1)?, defects.impulses);
    let repaired = Repaired { source, impulses };
    estimate(Rows::Read(&repaired), &sample, asked, defects, settings, means)
}

impl Known {
    fn asked(&self, settings: &Settings) -> Asked<'_> {
        let needs_noise = settings.has_weak() && self.noise.is_none();
        Asked {
            compensation: self.compensation.as_ref(),
            candidates: self.candidates,
            noise: self.noise,
            rows: settings.align_rows && self.alignment.is_none(),
            blur: self.compensation.is_none()
                && (settings.compensate_blur
                    || settings.despike
                    || settings.denoise
                    || needs_noise),
        }
    }
}

impl Asked<'_> {
    fn is_anything(&self) -> bool {
        self.candidates.is_none() || self.rows || self.blur
    }
}

impl Estimates {
    /// With what is told, and the time since the start.
    fn finished(self, known: &Known, started: Instant) -> Self {
        let alignment = self.alignment.or_else(|| known.alignment.clone());
        let is_inverted = self.is_inverted || known.is_inverted;
        Self { alignment, is_inverted, time: started.elapsed(), ..self }
    }

    fn nothing(candidates: Candidates, known: &Known) -> Self {
        Self {
            candidates: known.candidates.unwrap_or(candidates),
            confidence: None,
            is_inverted: known.is_inverted,
            range: None,
            offsets: None,
            alignment: known.alignment.clone(),
            blur: None,
            compensation: None,
            time: Duration::ZERO,
        }
    }
}

/// Finds out what is asked. `sample` is any part of the pair.
fn estimate(
    rows: Rows,
    sample: &Pair,
    asked: &Asked,
    defects: Defects,
    settings: &Settings,
    means: Means,
) -> Result<Estimates> {
    let width = rows.size().1;
    let is_overview_needed = asked.candidates.is_none() || asked.rows;
    let overview = is_overview_needed.then(|| Overview::new(rows, means)).transpose()?.flatten();
    let (mut offsets, mut alignment, mut range, mut confidence) = (None, None, None, None);
    let mut is_inverted = false;
    if let Some(overview) = &overview {
        let mut rough = overview.rough(asked.candidates, None, means)?;
        if asked.rows {
            offsets = rows::offsets(rows, overview, &rough, asked.candidates, means)?;
            let significant = offsets.as_ref().filter(|found| found.is_significant());
            alignment = significant.map(|found| found.field.clone());
        }
        if alignment.is_some() {
            rough = overview.rough(asked.candidates, alignment.as_ref(), means)?;
        }
        confidence = Some(rough.confidence);
        // Where disparities that are told match badly, it is worth knowing which ones would do better.
        if asked.candidates.is_some() && rough.confidence < overview::GOOD_CONFIDENCE {
            rough = overview.rough(None, alignment.as_ref(), means)?;
            range = range::range(overview, &rough);
        } else if asked.candidates.is_none() {
            range = range::range(overview, &rough);
        }
        is_inverted = range.is_none()
            && rough.confidence < range::LEAST_CONFIDENCE
            && overview.inverted().rough(None, None, means)?.confidence
                >= overview::GOOD_CONFIDENCE;
    }
    let candidates = match (asked.candidates, &range) {
        (Some(candidates), _) => candidates,
        (None, Some(range)) => range.candidates(width)?,
        (None, None) => Candidates::new(0, width.div_ceil(DEFAULT_SHARE) as i64, width)?,
    };
    let known = rough::Known { candidates, alignment: alignment.clone() };
    let blur = asked.blur.then(|| blur::estimate(rows, sample, known, means)).transpose()?;
    let blur = blur.map(|found| found.with(defects));
    let compensation = match (&blur, asked.noise) {
        _ if asked.compensation.is_some() => None,
        (Some(blur), noise) => Some(Compensation::new(blur, noise, settings)?),
        (None, Some(noise)) => Some(Compensation::of_noise(noise, settings)?),
        (None, None) => None,
    };
    let mut found = Estimates {
        candidates,
        confidence,
        is_inverted,
        range,
        offsets,
        alignment,
        blur,
        compensation,
        time: Duration::ZERO,
    };
    if !trial::confirms(rows, &found, asked.compensation, settings, means)? {
        found.alignment = None;
    }
    Ok(found)
}

//! A whole match: unknown properties of a pair are estimated; the pair is prepared with them, matched, and
//! decided over scales.
//!
//! ```text
//! if disparities are known to be along columns:  turn the pair
//! what both images share is subtracted, if it is known or found     # estimation::shared, crosstalk
//! estimates = the unknown properties of the pair                   # crate::estimation
//! if the images show disparities along columns: turn the pair, and start over  # rectification::axis
//! if its rows are too far off to be aligned, and its images show the cameras:
//!     pair, estimates = those of the rectified pair                # crate::rectification::raw_pair
//! map = match(pair, prepared with its estimates)          # crate::scales, phasestereo_match::matcher
//! if the map shows that both images share something:  start over without it, and take the better map
//! if the pair was rectified: map in the pixels of the raw left image;  if it was turned: turned back
//! ```

use std::sync::Arc;

use crate::estimation::facts::{Direction, Fact, Facts, INDEPENDENT, SUFFICIENT, evidence};
use crate::estimation::raster::Raster;
use crate::estimation::shared::{self, SameDetail, Shared};
use crate::estimation::{Estimates, Examined, Prepared, complete, crosstalk, prepare, without_shared};
use crate::findings;
use crate::rectification::axis::Axis;
use crate::rectification::raw_pair::{Attempt, rectify_if_needed};
use crate::rectification::{Raw, Refusal, warp};
use crate::scales::{match_copy, match_over_scales};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::summary::Summary;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;

/// Matches a pair, given the known facts about it.
pub fn match_pair(pair: Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Matched> {
    Ok(match_as_turned(pair, facts, settings, runtime)?.turned_back())
}

/// [`match_pair`], but returns the map of the pair as it was matched: turned, if its disparities are along
/// columns.
pub fn match_as_turned(pair: Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Matched> {
    runtime.control.begin(settings.budget);
    match ready_and_matched(pair, facts, settings, runtime)? {
        (_, Some(matched)) => Ok(matched),
        (ready, None) => ready.matched(settings, runtime),
    }
}

/// The pair, turned so that its rows are searched if its disparities are known to be along columns. Given
/// disparities are checked against the columns.
pub fn turned(pair: Pair, facts: &Facts) -> Result<Pair> {
    if !facts.turns() || pair.is_turned() {
        return Ok(pair);
    }
    let known = facts.searched().map_or((0, 1), Candidates::numbers);
    pair.turned(known.0, known.1)
}

/// A pair that is ready to be matched.
#[derive(Debug, Clone)]
pub struct Ready {
    /// The pair that will be matched, with its estimates: the rectified one, if it was rectified.
    pub prepared: Prepared,
    /// The cameras used to rectify it; `None`: it was not rectified.
    pub raw: Option<Arc<Raw>>,
    /// Whether the odd rows of the images, before rectification, became means of the even ones.
    pub rasters: [Raster; 2],
    /// The pair as it came, if its images show the same fine detail at the same place.
    suspect: Option<Pair>,
}

/// The changes made to a pair to get it ready for its match.
#[derive(Debug, Clone, Copy)]
pub struct Treatment<'a> {
    /// The pair that will be matched, with its estimates.
    pub prepared: &'a Prepared,
    /// The cameras used to rectify it.
    pub raw: Option<&'a Raw>,
    /// See [`Ready::rasters`].
    pub rasters: [Raster; 2],
}

impl Ready {
    /// Matches the pair.
    pub fn matched(mut self, settings: &Settings, runtime: Runtime) -> Result<Matched> {
        let map = match_over_scales(&self.prepared, settings, runtime)?;
        let failure = runtime.matcher.engine_failure();
        let failed = failure.iter().map(|reason| findings::device_failed(reason));
        self.prepared.estimates.findings.extend(failed);
        let raw = self.raw.map(|raw| (raw, self.rasters));
        Matched::new(raw, map, self.prepared, runtime.control)
    }

    /// The changes made to the pair.
    pub fn treatment(&self) -> Treatment<'_> {
        let Self { prepared, raw, rasters, .. } = self;
        Treatment { prepared, raw: raw.as_deref(), rasters: *rasters }
    }
}

/// Makes a pair ready for its match, given the known facts about it.
pub fn made_ready(pair: Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Ready> {
    // Its progress is separate from that of the map.
    let control = &runtime.control.aside();
    Ok(ready_and_matched(pair, facts, settings, Runtime { control, ..runtime })?.0)
}

/// A pair that is ready for its match. If its images show the same fine detail at the same place, also the
/// match: it shows whether that is a scene, a pattern or crosstalk.
///
/// ```text
/// first  = match(pair)                                # without a pattern that the estimates have found
/// others = match(pair without crosstalk), match(pair without a pattern)
/// result = the one with the largest share of trusted disparities away from 0; if the first one is mostly at 0,
///          another one only with more than half of its pixels there
/// ```
fn ready_and_matched(
    pair: Pair,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Ready, Option<Matched>)> {
    let mut ready = ready_by_estimates(pair, facts, settings, runtime)?;
    let Some(pair) = ready.suspect.take() else { return Ok((ready, None)) };

    let first = ready.clone().matched(settings, runtime)?;
    let is_elsewhere = |y: usize, x: usize| shared::is_elsewhere_at(&first.map, y, x);
    let is_pattern = ready.prepared.estimates.shared.is_some();
    let is_certain = is_pattern || shared::shows_through(&pair, &first.map);
    if !is_certain && !shared::is_at_zero(&first.map) {
        return Ok((ready, Some(first)));
    }

    let share = crosstalk::share(&pair, |y, x| !is_certain || is_elsewhere(y, x));
    let others = share.map(Shared::Crosstalk).into_iter().chain((!is_pattern).then_some(Shared::Pattern));
    let time = first.prepared.estimates.time + first.map.timings.total();
    let mut most = if is_certain { shared::elsewhere(&first.map) } else { 0.5 };
    let mut best = (ready, Some(first));
    for other in others {
        if !runtime.control.has_time_for(time) {
            break;
        }
        let facts = Facts { shared: Some(other), ..facts.clone() };
        // Its progress is separate from that of the first match.
        let control = &runtime.control.aside();
        let runtime = Runtime { control, ..runtime };
        let ready = ready_by_estimates(pair.clone(), &facts, settings, runtime)?;
        let matched = ready.clone().matched(settings, runtime)?;
        let elsewhere = shared::elsewhere(&matched.map);
        if elsewhere > most {
            most = elsewhere;
            best = (ready, Some(matched));
        }
    }
    Ok(best)
}

/// Makes a pair ready for its match by the known facts and the estimates.
fn ready_by_estimates(pair: Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Ready> {
    let pair = turned(pair, facts)?;
    let Examined { same, shared, clean } = without_shared(&pair, facts, settings, runtime)?;
    let is_suspect = same != SameDetail::None;
    let (suspect, pair) = match clean {
        Some(clean) => (Some(pair), clean),
        None => (is_suspect.then(|| pair.clone()), pair),
    };
    let (pair, estimates) = complete(pair, facts, settings, runtime)?;
    let estimates = Estimates { shared, ..estimates };
    let rasters = estimates.rasters;
    let is_as_it_came = rasters == [Raster::Whole; 2] && !estimates.is_inverted;
    let suspect = suspect.filter(|_| is_suspect && is_as_it_came && !estimates.is_one_image());
    let attempt = rectify_if_needed(&pair, &estimates, facts, settings, runtime)?;
    if let Attempt::Refused(Refusal::Axis(axis)) = attempt
        && let Some(ready) = along_columns(&pair, &estimates, axis, facts, settings, runtime)?
    {
        return Ok(ready);
    }
    let (pair, mut estimates, facts, raw, refusal) = match attempt {
        Attempt::None => (pair, estimates, facts.clone(), None, None),
        Attempt::Refused(refusal) => (pair, estimates, facts.clone(), None, Some(refusal)),
        Attempt::Done(done) => {
            let estimates = Estimates { shared, ..done.estimates };
            (done.pair, estimates, done.facts, Some(done.raw), None)
        }
    };

    if let Some(Refusal::Axis(_)) = refusal {
        // Offsets that look like misaligned rows are disparities.
        estimates.alignment = None;
    }
    estimates = findings::with_findings(estimates, &pair, settings);
    let refused = refusal.and_then(|refusal| findings::not_rectified(&estimates, pair.is_turned(), &refusal));
    estimates.findings.extend(refused);
    estimates.findings.extend(raw.iter().map(|raw| findings::rectified(&raw.rectification)));

    let prepared = prepare(pair, estimates, &facts, settings, runtime)?;
    Ok(Ready { prepared, raw, rasters, suspect })
}

/// The findings of a match's estimates, by topic. If the match of a small copy of the pair failed, the reason
/// comes first: estimates alone do not show how well a pair matches.
pub fn diagnosed(pair: Pair, facts: &Facts, settings: &Settings, runtime: Runtime) -> Result<Estimates> {
    let Ready { prepared, .. } = made_ready(pair, facts, settings, runtime)?;
    let (own, summary, size) = match_copy(&prepared, settings, runtime)?;

    let Prepared { pair, mut estimates, .. } = prepared;
    estimates.findings = findings::by_topic(estimates.findings);
    let is_smaller = size != pair.size();
    let failed = findings::of_copy(own, &summary, size, is_smaller, &estimates.findings);
    estimates.findings.splice(0..0, failed);
    Ok(estimates)
}

/// Makes a pair ready to be matched along its columns. `None`: it is known whether disparities are along rows
/// or columns, or columns correspond no better than rows.
fn along_columns(
    pair: &Pair,
    before: &Estimates,
    axis: Axis,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Option<Ready>> {
    // Lines or a pattern that were repaired along rows cannot be repaired along columns.
    let is_as_it_came = before.rasters == [Raster::Whole; 2] && before.shared.is_none();
    let fits = |all: Candidates| Candidates::new(all.numbers().0, all.numbers().1, pair.size().0).is_ok();
    let can_be = facts.axis.is_none() && facts.searched().is_none_or(fits);
    if !can_be || !axis.is_along_columns() || !is_as_it_came {
        return Ok(None);
    }

    let facts = Facts { axis: Some(Fact::estimated(Direction::Columns)), ..facts.clone() };
    let mut ready = ready_by_estimates(pair.clone(), &facts, settings, runtime)?;
    let estimates = &mut ready.prepared.estimates;
    if evidence(before.rows_apart, estimates.rows_apart, 0, INDEPENDENT) < SUFFICIENT {
        return Ok(None);
    }
    estimates.time += before.time;
    estimates.findings.push(findings::along_columns(axis));
    ready.suspect = None;
    runtime.control.expect_rows(ready.prepared.pair.size().0);
    Ok(Some(ready))
}

/// The result of rectifying a pair for its match.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Rectified {
    /// The cameras used to rectify it.
    pub raw: Arc<Raw>,
    /// The map of the rectified pair.
    pub map: Disparity,
    /// How many rows lower each pixel of the raw left image is in the raw right one; NaN without a disparity.
    pub rows: Plane<f32>,
    /// Whether the odd rows of the raw images became means of the even ones.
    pub rasters: [Raster; 2],
}

/// A pair that was prepared and matched.
#[derive(Debug)]
pub struct Matched {
    /// The map, in pixels of the left image as it was given or turned.
    pub map: Disparity,
    /// The pair that was matched: that of the rectified images, if it was rectified.
    pub prepared: Prepared,
    /// The rectification; `None`: the pair was matched without one.
    pub rectified: Option<Rectified>,
}

impl Rectified {
    /// The raw place of each pixel of the rectified left and right image: column and row, NaN where no ray
    /// comes from. The match has already computed it.
    pub fn places(&self) -> Result<&[Plane<[f32; 2]>; 2]> {
        self.raw.places(&Control::default())
    }
}

impl Matched {
    /// The map of a pair, converted to the pixels of the raw left image if these cameras rectified it, after
    /// odd rows of its images became means of the even ones.
    pub fn new(
        raw: Option<(Arc<Raw>, [Raster; 2])>,
        map: Disparity,
        prepared: Prepared,
        control: &Control,
    ) -> Result<Self> {
        let Some((raw, rasters)) = raw else {
            return Ok(Self { map, prepared, rectified: None });
        };
        let (own, rows) = warp::raw(&map, &raw.rectification.cameras, control)?;
        let rectified = Some(Rectified { raw, map, rows, rasters });
        Ok(Self { map: own, prepared, rectified })
    }

    /// The changes made to the pair before its match.
    pub fn treatment(&self) -> Treatment<'_> {
        let Self { prepared, rectified, .. } = self;
        let (raw, rasters) = match rectified {
            Some(Rectified { raw, rasters, .. }) => (Some(&**raw), *rasters),
            None => (None, prepared.estimates.rasters),
        };
        Treatment { prepared, raw, rasters }
    }

    /// The map of the pair that was matched: that of the rectified images, if it was rectified.
    pub fn own(&self) -> &Disparity {
        self.rectified.as_ref().map_or(&self.map, |rectified| &rectified.map)
    }

    /// The same, with the map in the pixels of the original images, if these were turned. The rectification
    /// stays that of the turned pair.
    pub fn turned_back(self) -> Self {
        if !self.prepared.pair.is_turned() {
            return self;
        }
        Self { map: self.map.turned_back(), ..self }
    }

    /// Shares of the pixels of the map of the pair that was matched.
    pub fn summary(&self) -> Summary {
        Summary::new(self.own(), self.prepared.estimates.candidates.value)
    }
}

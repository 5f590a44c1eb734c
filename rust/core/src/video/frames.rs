//! The frames of two cameras, one after another: each is matched with the facts from earlier frames, and adds
//! to them.
//!
//! ```text
//! first frame, or one of another size:  estimate all, match               # crate::match_pair
//! other frames:
//!     field += drift;  cameras, field and range are those of the rig
//!     blur, noise and light: unchanged, if they look so at a glance and are recent; else estimated
//!     match; locate some blocks of the map again
//!     if their rows have moved:          the field is opened and updated, and the frame is matched once more
//!     if all rows then disagree again, or sway:
//!                                        rows are estimated, also in all later frames while they sway
//!     if things reach the end of the range: it grows, and the frame is matched once more
//!     if the map got much worse:         all is estimated again; the result counts if it matches better
//!     the rig is updated from the map: rows, disparities, which image is softer, how much is wrong
//! ```
//!
//! A frame that fails changes nothing.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use crate::estimation::blur;
use crate::estimation::blur::parts::Part;
use crate::estimation::facts::{Direction, Fact, Facts, Rows};
use crate::estimation::range::{self, Asked};
use crate::estimation::raster::{Raster, resolved};
use crate::estimation::rows::RowOffsets;
use crate::estimation::shared::{Shared, SharedPart};
use crate::estimation::tracks::{AROUND, follow_here};
use crate::estimation::{Estimates, Prepared, complete, prepare};
use crate::finding::{Finding, Severity};
use crate::findings;
use crate::match_pair::{Matched, match_as_turned, turned};
use crate::rectification::Raw;
use crate::rectification::raw_pair::resampled;
use crate::scales::match_over_scales;
use crate::video::choices::{LONGEST_WAIT, MOST_MATCHES, NEAR_END, WORSE};
use crate::video::rig::events::{Steady, Subject};
use crate::video::rig::field::{Innovation, seeds};
use crate::video::rig::sensors::Sensors;
use crate::video::rig::{Appearance, Geometry, Rig};
use crate::video::temporal::TemporalFilter;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{self, Plane};
use phasestereo_match::base::platform::Instant;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::summary::Summary;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::settings::Settings;

/// How frames are matched.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// The caller's known facts about every frame.
    pub facts: &'a Facts,
    /// The settings of the matches.
    pub settings: &'a Settings,
    /// Frames after which blur is estimated again; 1: every frame is matched by itself.
    pub reestimate: u64,
}

/// A frame that was matched.
#[derive(Debug)]
pub struct Frame {
    /// The match.
    pub matched: Matched,
    /// Shares of the pixels of the map of the pair that was matched.
    pub summary: Summary,
    /// Whether the estimates of an earlier frame were reused.
    pub is_reused: bool,
    /// How many frames support each disparity, and the time that a temporal filter took.
    pub support: Option<(Plane<u8>, Duration)>,
}

impl Frame {
    /// The frame with its maps in the pixels of the original images, if these were turned.
    pub fn turned_back(self) -> Self {
        if !self.matched.prepared.pair.is_turned() {
            return self;
        }
        let support = self.support.map(|(frames, time)| (frames.turned_back(), time));
        Self { matched: self.matched.turned_back(), support, ..self }
    }
}

/// Matches the next frame of a rig, which learns from it.
pub fn match_frame(
    rig: &mut Rig,
    pair: Pair,
    options: Options,
    filter: Option<&mut TemporalFilter>,
    runtime: Runtime,
) -> Result<Frame> {
    Ok(match_frame_as_turned(rig, pair, options, filter, runtime)?.turned_back())
}

/// [`match_frame`], but returns the maps of the pair as it was matched: turned, if its disparities are along
/// columns.
pub fn match_frame_as_turned(
    rig: &mut Rig,
    pair: Pair,
    options: Options,
    filter: Option<&mut TemporalFilter>,
    runtime: Runtime,
) -> Result<Frame> {
    runtime.control.begin(options.settings.budget);
    // A failure halfway must not leave anything half learned.
    let mut next = rig.clone();
    if let Some(sentence) = next.stopped.update(&pair) {
        next.events.push(Subject::Cameras, next.frames, sentence);
    }
    let facts = &next.facts(options.facts);
    let options = Options { facts, ..options };
    let pair = turned(pair, facts)?;
    next.suit(pair.size(), pair.is_turned(), options.settings);

    // Each frame by itself, if everything is to be estimated for each.
    let frame = match next.geometry.take().filter(|_| options.reestimate > 1) {
        Some(geometry) => {
            Followed { rig: &mut next, pair: &pair, options, runtime }.frame(geometry, filter)?
        }
        None => next.begin(pair, options, filter, runtime)?,
    };

    next.frames += 1;
    *rig = next;
    Ok(frame)
}

impl Rig {
    /// The known facts about a frame, including the axis from earlier frames.
    fn facts(&self, known: &Facts) -> Facts {
        let of_geometry = |geometry: &Geometry| {
            let axis = if geometry.is_turned { Direction::Columns } else { Direction::Rows };
            Fact::remembered(axis)
        };
        let axis = known.axis.clone().or_else(|| self.geometry.as_ref().map(of_geometry));
        Facts { axis, ..known.clone() }
    }

    /// Matches a frame without known facts, and learns the geometry of the cameras if the match is reliable.
    fn begin(
        &mut self,
        pair: Pair,
        options: Options,
        filter: Option<&mut TemporalFilter>,
        runtime: Runtime,
    ) -> Result<Frame> {
        let mut matched = match_as_turned(pair, options.facts, options.settings, runtime)?;
        let size = matched.prepared.pair.size();
        let summary = matched.summary();

        let estimates = &matched.prepared.estimates;
        let said = findings::of_match(estimates, &summary, size);
        let is_trusted = is_trusted(&said);
        let raw = matched.rectified.as_ref().map(|rectified| Arc::clone(&rectified.raw));
        // Cameras that rectify a pair count even if noise spoils its match.
        if is_trusted || raw.is_some() {
            let is_found = options.facts.axis.is_none();
            if is_found && matched.prepared.pair.is_turned() {
                let sentence = "one camera is above the other: columns are matched from here on";
                self.events.push(Subject::Cameras, self.frames, sentence);
            }
            if let Some(raw) = &raw {
                let rows = raw.rectification.rms;
                let sentence = format!("raw images are rectified from here on: rows to {rows:.2} px");
                self.events.push(Subject::Cameras, self.frames, sentence);
            }

            self.geometry = Some(Geometry::new(&matched.prepared.pair, estimates, raw));
        }
        if is_trusted {
            self.remember(estimates, options.settings, matched.treatment().rasters);
        }
        self.settle(estimates.blur.as_ref().filter(|_| is_trusted), summary.wrong);

        let filter = filter.filter(|_| matched.rectified.is_none());
        let Matched { map, prepared, .. } = &mut matched;
        let support = filter.map(|filter| steadied(filter, map, prepared, runtime)).transpose()?;
        let summary = if support.is_some() { matched.summary() } else { summary };
        Ok(Frame { matched, summary, is_reused: false, support })
    }

    /// Keeps the estimates from this frame.
    fn remember(&mut self, estimates: &Estimates, settings: &Settings, rasters: [Raster; 2]) {
        let (settings, frame) = (settings.clone(), self.frames);
        let appearance = Appearance { estimates: estimates.clone(), rasters, settings, frame };
        self.appearance = Some(Arc::new(appearance));
        self.sensors = Sensors::new(estimates, self.frames).or(self.sensors.take());
    }

    /// What the images of these cameras share, and its standard deviation, as far as known.
    fn shared(&self) -> Option<(Shared, f64)> {
        self.appearance.as_ref().and_then(|appearance| appearance.estimates.shared)
    }

    /// How the images of these cameras are read, as far as known.
    fn rasters(&self) -> [Raster; 2] {
        self.appearance.as_ref().map_or([Raster::Whole; 2], |appearance| appearance.rasters)
    }
}

/// Filters a map over time.
fn steadied(
    filter: &mut TemporalFilter,
    map: &mut Disparity,
    prepared: &Prepared,
    runtime: Runtime,
) -> Result<(Plane<u8>, Duration)> {
    let started = Instant::now();
    let Prepared { pair, settings, .. } = prepared;
    let frames = filter.apply(pair, settings, map, runtime)?;
    Ok((frames, started.elapsed()))
}

/// A frame of known cameras.
struct Followed<'a, 'b> {
    rig: &'a mut Rig,
    pair: &'a Pair,
    options: Options<'a>,
    runtime: Runtime<'b>,
}

/// The frame after rectification by these cameras.
struct RectifiedFrame<'a> {
    pair: Cow<'a, Pair>,
    /// Whether the estimates of an earlier frame still hold.
    is_as_before: bool,
}

/// A match of the frame.
struct FrameMatch {
    map: Disparity,
    prepared: Prepared,
    summary: Summary,
    innovation: Option<Innovation>,
}

impl FrameMatch {
    /// Whether the match is reliable.
    fn is_trusted(&self, size: (usize, usize)) -> bool {
        is_trusted(&findings::of_match(&self.prepared.estimates, &self.summary, size))
    }
}

/// The evidence of a match about the cameras.
enum Verdict {
    /// They are unchanged.
    Known,
    /// Their rows have moved.
    Moved,
    /// Their rows sway.
    Swaying,
    /// There are things beyond the searched disparities.
    Beyond,
    /// Much more is wrong than before.
    Lost,
}

impl<'a> Followed<'a, '_> {
    /// Matches the frame.
    fn frame(mut self, mut geometry: Geometry, filter: Option<&mut TemporalFilter>) -> Result<Frame> {
        geometry.field.predict();
        let input = self.input(&geometry)?;
        self.rig.changes.update(input.pair.views()[0])?;
        let mut is_reused = input.is_as_before;
        let mut result = self.match_known(&geometry, &input, false)?;
        let mut is_anew = false;

        for _ in 0..MOST_MATCHES {
            match self.verdict(&mut geometry, &result)? {
                Verdict::Known => break,
                Verdict::Moved if !is_anew => {
                    self.reopen(&mut geometry, &result);
                    is_anew = true;
                    result = self.match_known(&geometry, &input, is_anew)?;
                }
                // Rows that were moved as a whole agree with each other.
                Verdict::Moved | Verdict::Swaying => {
                    result = self.rows_anew(&mut geometry, &input)?;
                    is_anew = true;
                    break;
                }
                Verdict::Beyond => result = self.match_known(&geometry, &input, is_anew)?,
                Verdict::Lost => {
                    if let Some((found, better)) = self.anew(&geometry, result.summary.wrong)? {
                        (geometry, result) = (found, better);
                        (is_reused, is_anew) = (false, true);
                    }
                    break;
                }
            }
        }

        self.learn(geometry, &result, is_reused);
        self.finished(result, is_reused, filter, is_anew)
    }

    /// The pair without what these images share, resolved.
    fn repaired(&self) -> Result<Cow<'a, Pair>> {
        let mut pair = Cow::Borrowed(self.pair);
        if let Some((shared, _)) = self.rig.shared() {
            pair = Cow::Owned(SharedPart::new(&pair, shared, self.runtime)?.removed(&pair)?);
        }
        let rasters = self.rig.rasters();
        if rasters != [Raster::Whole; 2] {
            pair = Cow::Owned(resolved(&pair, rasters)?);
        }
        Ok(pair)
    }

    /// The rectified pair, and whether it looks like before.
    fn input(&self, geometry: &Geometry) -> Result<RectifiedFrame<'a>> {
        let Runtime { execution, control, .. } = self.runtime;
        let mut pair = self.repaired()?;
        if let Some(raw) = &geometry.cameras {
            pair = Cow::Owned(resampled(&pair, raw.places(control)?, control)?);
        }
        if geometry.is_inverted && self.options.settings.compensate_blur {
            pair = Cow::Owned(pair.inverted());
        }

        let appearance = self.rig.appearance.as_deref();
        let appearance =
            appearance.filter(|appearance| self.rig.frames - appearance.frame < self.options.reestimate);
        let blur = appearance.and_then(|appearance| appearance.estimates.blur.as_ref());

        let is_as_before = match (appearance, blur) {
            (None, _) => false,
            (Some(_), None) => true,
            (Some(_), Some(blur)) => {
                let repaired = pair.repaired(blur.impulses, execution.level, control)?;
                blur::is_as_before(&repaired, &blur.signature, self.runtime)?
            }
        };
        Ok(RectifiedFrame { pair, is_as_before })
    }

    /// Matches the frame by the known facts; `is_again`: afterward, blocks of all rows are located.
    fn match_known(&self, geometry: &Geometry, input: &RectifiedFrame, is_again: bool) -> Result<FrameMatch> {
        let facts = self.options.facts;
        let mut pair = Pair::clone(&input.pair);
        let candidates = match &facts.candidates {
            Some(given) => given.clone(),
            None => Fact::remembered(geometry.columns.candidates(pair.size().1)?),
        };
        // Rows are followed whatever the settings, and estimated if they sway.
        let sways = geometry.sways.state == 1;
        let rows = if sways { Rows::Wanted } else { Rows::known(Fact::remembered(geometry.alignment()?)) };
        let facts = Facts { candidates: Some(candidates.clone()), rows, ..facts.clone() };

        let estimates = match &self.rig.appearance {
            Some(appearance) if input.is_as_before => {
                let rows = sways.then(|| self.rows(&pair, &appearance.estimates, &facts));
                let (alignment, offsets) = match rows {
                    Some(found) => found?,
                    None => (geometry.alignment()?, geometry.field.offsets()?),
                };
                Estimates {
                    candidates,
                    alignment,
                    offsets,
                    findings: still_said(&appearance.estimates),
                    time: Duration::ZERO,
                    ..appearance.estimates.clone()
                }
            }
            _ => {
                let (changed, estimates) = self.estimates(pair, geometry, &facts)?;
                pair = changed;
                estimates
            }
        };

        let mut result = self.matched(pair, estimates, &facts)?;
        if !sways {
            result.innovation = self.innovation(&result.map, &input.pair, geometry, is_again)?;
        }
        Ok(result)
    }

    /// The rows of a pair with unchanged blur and noise.
    fn rows(
        &self,
        pair: &Pair,
        appearance: &Estimates,
        facts: &Facts,
    ) -> Result<(Option<Alignment>, Option<RowOffsets>)> {
        let mut facts = facts.clone();
        if let Some(plan) = &appearance.compensation {
            facts.compensation = Some(plan.blur_compensation()?);
        }
        let (_, found) = complete(pair.clone(), &facts, self.options.settings, self.runtime)?;
        Ok((found.alignment, found.offsets))
    }

    /// The evidence about rows from blocks of a map, located in the pair without straightening.
    fn innovation(
        &self,
        map: &Disparity,
        pair: &Pair,
        geometry: &Geometry,
        has_all: bool,
    ) -> Result<Option<Innovation>> {
        let level = self.runtime.level();
        let field = geometry.field.field()?;
        let reach = AROUND + field.bound().ceil() as usize;
        let rows = pair.size().0;

        let mut tracks = vec![];
        for seeds in seeds(&map.disparity, &map.flags, &field, self.rig.frames, has_all) {
            let Some(first) = seeds.first() else { continue };
            let y = first.y as usize;
            let around = plane::around(y, reach, rows);
            let part = Part::new(around.start, Cow::Owned(pair.of_rows(around)), self.runtime)?;
            tracks.extend(follow_here(&part, &seeds, level));
        }
        Ok(geometry.field.innovation(&tracks))
    }

    /// Estimates blur, noise and light of a pair with known geometry, and resolves it.
    fn estimates(&self, pair: Pair, geometry: &Geometry, facts: &Facts) -> Result<(Pair, Estimates)> {
        let settings = self.options.settings;
        let (changed, mut found) = complete(pair.clone(), facts, settings, self.runtime)?;
        let pair = if found.rasters == [Raster::Whole; 2] { pair } else { changed };
        if let Some(appearance) = &self.rig.appearance {
            let before = &appearance.estimates;
            if appearance.rasters != [Raster::Whole; 2] {
                // The pair was resolved before, and no longer shows it.
                found = found.of_resolved(before.rasters, before.photometry);
            }
            found.shared = before.shared;
            found.confidence = before.confidence;
            found.range = before.range;
            found.left_out.clone_from(&before.left_out);
        }

        found.is_inverted = geometry.is_inverted;
        if facts.aligned().is_some() {
            found.offsets = geometry.field.offsets()?;
        }
        found = findings::with_findings(found, &pair, settings);
        if let Some(raw) = &geometry.cameras {
            found.findings.push(findings::rectified(&raw.rectification));
        }
        Ok((pair, found))
    }

    /// Matches a pair with these estimates.
    fn matched(&self, pair: Pair, estimates: Estimates, facts: &Facts) -> Result<FrameMatch> {
        let settings = self.options.settings;
        let prepared = prepare(pair, estimates, facts, settings, self.runtime)?;
        let map = match_over_scales(&prepared, settings, self.runtime)?;
        let summary = Summary::new(&map, prepared.estimates.candidates.value);
        Ok(FrameMatch { map, prepared, summary, innovation: None })
    }

    /// The evidence of a match about the cameras. The range grows if necessary.
    fn verdict(&mut self, geometry: &mut Geometry, result: &FrameMatch) -> Result<Verdict> {
        let is_worse = self.rig.health.is_some_and(|health| result.summary.wrong > health + WORSE);
        if result.innovation.as_ref().is_some_and(|found| found.is_moved) {
            return Ok(Verdict::Moved);
        }
        if result.innovation.as_ref().is_some_and(|found| found.sways) {
            return Ok(Verdict::Swaying);
        }
        if self.options.facts.candidates.is_none() && self.has_entered(geometry, result)? {
            return Ok(Verdict::Beyond);
        }
        if is_worse && self.rig.frames >= self.rig.doubt.1 {
            return Ok(Verdict::Lost);
        }
        if self.options.facts.candidates.is_none() && result.summary.at_high > NEAR_END {
            let width = geometry.size.1;
            let mut wider = geometry.columns.clone();
            if wider.update(&result.map, width) {
                geometry.columns.extend(wider.searched.end);
                return Ok(Verdict::Beyond);
            }
        }
        Ok(Verdict::Known)
    }

    /// Whether something has entered beyond the searched disparities, which then grow.
    fn has_entered(&mut self, geometry: &mut Geometry, result: &FrameMatch) -> Result<bool> {
        let prepared = &result.prepared;
        let known = prepared.estimates.candidates.value;
        let asked = Asked { turn: self.rig.frames as usize, changed: self.rig.changes.squares.as_ref() };
        let map = &result.map.disparity;
        let places = range::entered(&prepared.pair, map, known, asked, self.runtime)?;
        let low = places.iter().map(|place| place.low.floor() as i64).min();
        let high = places.iter().map(|place| place.high.ceil() as i64).max();
        let (Some(low), Some(high)) = (low, high) else { return Ok(false) };
        if !geometry.columns.include(low..high + 1, geometry.size.1) {
            return Ok(false);
        }
        let Range { start, end } = geometry.columns.searched;
        let sentence = format!("things entered: disparities from {start} to {} are searched", end - 1);
        self.rig.events.renew(Subject::Range, self.rig.frames, sentence);
        Ok(true)
    }

    /// Opens the field where rows have moved, and updates it with them.
    fn reopen(&mut self, geometry: &mut Geometry, result: &FrameMatch) {
        let Some(found) = &result.innovation else { return };
        geometry.field.reopen(found);
        geometry.straighten_at_once();
        let sentence = format!("rows moved by {:.2} px rms", found.moved);
        self.rig.events.push(Subject::Rows, self.rig.frames, sentence);
    }

    /// Matches the frame with newly estimated rows, also in later frames if they sway.
    fn rows_anew(&mut self, geometry: &mut Geometry, input: &RectifiedFrame) -> Result<FrameMatch> {
        geometry.sways = Steady::new(1);
        let result = self.match_known(geometry, input, true)?;

        let estimates = &result.prepared.estimates;
        let sways = estimates.sways() && result.is_trusted(geometry.size);
        geometry.take_rows(estimates);
        geometry.sways = Steady::new(sways.into());
        let sentence = if sways {
            "rows sway from here on, as those of a rolling shutter that shakes: they are found in each frame"
        } else {
            "rows moved, and were estimated anew"
        };
        self.rig.events.renew(Subject::Rows, self.rig.frames, sentence);
        Ok(result)
    }

    /// Estimates everything again; `None`: the result does not match better than this wrong share.
    fn anew(&mut self, geometry: &Geometry, wrong: f64) -> Result<Option<(Geometry, FrameMatch)>> {
        let now = self.rig.frames;
        let is_better = |(_, result): &(Geometry, FrameMatch)| {
            result.is_trusted(geometry.size) && result.summary.wrong + WORSE / 2.0 < wrong
        };

        // Cameras that were turned a little are still close to the known ones.
        let rectified = geometry.cameras.as_ref().map(|raw| self.rectified_anew(raw));
        let found = match rectified.transpose()?.filter(is_better) {
            Some(found) => Some(found),
            None => Some(self.whole_anew()?).filter(is_better),
        };

        if found.is_some() {
            self.rig.doubt = (0, now);
            let sentence = "rows and range were estimated anew, since much was wrong";
            self.rig.events.push(Subject::Rows, now, sentence);
        } else {
            // It may be night, or dirt: repeated every time, this would cost as much as the matches.
            let wait = (2 * self.rig.doubt.0 + 1).min(LONGEST_WAIT);
            self.rig.doubt = (wait, now + wait);
        }
        Ok(found)
    }

    /// The known facts about every frame, with rows to be estimated: all may have moved.
    fn facts_anew(&self) -> Facts {
        Facts { rows: Rows::Wanted, ..self.options.facts.clone() }
    }

    /// Estimates everything again except the cameras that rectify the pair.
    fn rectified_anew(&self, raw: &Arc<Raw>) -> Result<(Geometry, FrameMatch)> {
        let facts = &self.facts_anew();
        let pair = resampled(&*self.repaired()?, raw.places(self.runtime.control)?, self.runtime.control)?;

        let settings = self.options.settings;
        let (pair, estimates) = complete(pair, facts, settings, self.runtime)?;
        let estimates = Estimates { shared: self.rig.shared(), ..estimates };
        let estimates = findings::with_findings(estimates, &pair, settings);
        let found = Geometry::new(&pair, &estimates, Some(Arc::clone(raw)));
        Ok((found, self.matched(pair, estimates, facts)?))
    }

    /// Estimates everything again, as for a first frame.
    fn whole_anew(&self) -> Result<(Geometry, FrameMatch)> {
        let pair = self.pair.clone();
        let whole = match_as_turned(pair, &self.facts_anew(), self.options.settings, self.runtime)?;

        let summary = whole.summary();
        let Matched { map, prepared, rectified } = whole;
        let raw = rectified.as_ref().map(|rectified| Arc::clone(&rectified.raw));
        let map = rectified.map_or(map, |rectified| rectified.map);
        let found = Geometry::new(&prepared.pair, &prepared.estimates, raw);
        Ok((found, FrameMatch { map, prepared, summary, innovation: None }))
    }

    /// Updates a given or found range with the disparities of a match.
    fn learn_range(&mut self, geometry: &mut Geometry, map: &Disparity) {
        let rig = &mut *self.rig;
        if let Some(given) = &self.options.facts.candidates {
            geometry.columns.watch(given.value, map);
        } else if geometry.columns.update(map, geometry.size.1) {
            let most = geometry.columns.searched.end - 1;
            let sentence = format!("things came nearer: disparities up to {most} are searched");
            rig.events.renew(Subject::Range, rig.frames, sentence);
        }
    }

    /// Updates the rig with the evidence of the frame.
    fn learn(&mut self, mut geometry: Geometry, result: &FrameMatch, is_reused: bool) {
        let rig = &mut *self.rig;
        let estimates = &result.prepared.estimates;
        let is_trusted = result.is_trusted(geometry.size);

        if is_trusted {
            if geometry.sways.state == 1 && geometry.take_rows(estimates) {
                rig.events.push(Subject::Rows, rig.frames, "rows sway no more");
            }
            if let Some(found) = &result.innovation {
                geometry.field.update(found);
            }
            self.learn_range(&mut geometry, &result.map);
            if !is_reused {
                let is_raw = geometry.cameras.is_some();
                let rasters = if is_raw { self.rig.rasters() } else { estimates.rasters };
                self.rig.remember(estimates, self.options.settings, rasters);
            }
        }
        let rig = &mut *self.rig;
        rig.geometry = Some(geometry);
        rig.settle(estimates.blur.as_ref().filter(|_| is_trusted), result.summary.wrong);
    }

    /// The frame in its returned form.
    fn finished(
        &self,
        result: FrameMatch,
        is_reused: bool,
        filter: Option<&mut TemporalFilter>,
        is_anew: bool,
    ) -> Result<Frame> {
        let FrameMatch { mut map, prepared, mut summary, .. } = result;
        let support = filter.map(|filter| {
            if is_anew {
                *filter = TemporalFilter::new();
            }
            steadied(filter, &mut map, &prepared, self.runtime)
        });
        let support = support.transpose()?;
        if support.is_some() {
            summary = Summary::new(&map, prepared.estimates.candidates.value);
        }

        let cameras = self.rig.geometry.as_ref().and_then(|geometry| geometry.cameras.clone());
        let cameras = cameras.map(|raw| (raw, self.rig.rasters()));
        let matched = Matched::new(cameras, map, prepared, self.runtime.control)?;
        Ok(Frame { matched, summary, is_reused, support })
    }
}

/// Whether a match with these findings is reliable.
fn is_trusted(said: &[Finding]) -> bool {
    !said.iter().any(|one| one.severity == Severity::Warning && one.topic.is_decisive())
}

/// Lasting findings about the pair: those that make a match unreliable belong to each match.
fn still_said(estimates: &Estimates) -> Vec<Finding> {
    estimates.findings.iter().filter(|one| !one.topic.is_decisive()).cloned().collect()
}

//! Chosen candidates -> the result: disparities, flags that explain them, and confidences.

pub mod calibration;
pub mod confidence;
pub mod filling;
pub mod flag;
pub mod guided_median;
pub mod jumps;
pub mod left_right_check;
pub mod median;
pub mod sample;
pub mod speckles;
pub mod surfaces;
pub mod synthesis;
mod window_rows;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::cost::validity::Validity;
use crate::image::texture::Texture;
use crate::optimization::evidence::{EvidenceRow, NONE};
use crate::pair::candidates::Candidates;
use crate::pair::plan::{Bytes, Demand, Plan, Stage};
use crate::refinement::confidence::{CostMargin, VotedMap};
use crate::refinement::filling::fill;
use crate::refinement::guided_median::GuidedMedian;
use crate::refinement::left_right_check::{Checker, Choices};
use crate::refinement::speckles::flag_speckles;
use crate::settings::Settings;

/// Writes disparities, flags and votes of a row from its evidence. It holds the data shared by all rows.
#[derive(Debug, Clone, Copy)]
pub struct MapWriter<'a> {
    /// The searched disparities.
    pub candidates: Candidates,
    /// Columns of the image.
    pub cols: usize,
    /// Which (pixel, candidate) pairs are valid; `None`: all.
    pub validity: Option<&'a Validity>,
    /// Whether estimates lie between candidates.
    pub subpixel: bool,
    /// Most pixels by which the disparities of two left pixels with one match differ; `None`: no left-right
    /// check.
    pub consistency: Option<u16>,
    /// Percent of the second-best cost by which the cost of the choice must be lower; 0: no check.
    pub uniqueness: u64,
    /// One unit of the mean cost, in steps of the aggregated costs.
    pub unit: f32,
    /// The cost of a match of unrelated pixels, in these steps. It replaces the second-best cost if all
    /// candidates are next to the choice. [`NONE`]: unknown.
    pub unrelated: u32,
}

/// One row of the result, writable.
#[derive(Debug)]
pub struct ResultRow<'a> {
    /// Disparities, pixels; NaN: none.
    pub disparity: &'a mut [f32],
    /// Reasons, from [`flag`].
    pub flags: &'a mut [u16],
    /// Votes for the disparities, from 0 to 1, if confidences need them.
    pub votes: Option<&'a mut [f32]>,
}

impl MapWriter<'_> {
    /// Writes row `y`. The checks only flag; refinement decides whether flagged pixels keep an estimate.
    pub fn write(
        &self,
        y: usize,
        found: EvidenceRow,
        checker: &mut Checker,
        row: ResultRow,
        level: Level,
    ) -> Result<()> {
        if self.consistency.is_some() {
            checker.resize(self.cols)?;
        }

        write_map_row(level, *self, y, found, checker, row);
        Ok(())
    }

    /// The disparity of a chosen candidate; NaN if nothing can be estimated.
    #[inline(always)]
    fn disparity(&self, chosen: u16, flags: u16) -> f32 {
        if flags & flag::MISSING == 0 { self.candidates.disparity(chosen.into()) as f32 } else { f32::NAN }
    }

    /// Flags matches outside the right image.
    #[inline(always)]
    fn flag_outside(&self, chosen: &[u16], flags: &mut [u16]) {
        let (candidates, cols) = (self.candidates, self.cols as u32);
        for (x, (&chosen, flags)) in (0..).zip(chosen.iter().zip(flags)) {
            let is_inside = candidates.column_or_beyond(x, chosen) < cols;
            *flags = if is_inside { 0 } else { flag::OUTSIDE };
        }
    }

    /// The flags of pixel `(y, x)`, which is invalid or has an invalid match; `outside` is its flag for a
    /// match outside.
    fn flag_invalid(validity: &Validity, (y, x): (usize, usize), outside: u16) -> u16 {
        if validity.is_masked(y, x) {
            flag::MASKED
        } else if validity.has_candidate(y, x) {
            outside | flag::MATCH_MASKED
        } else {
            // A choice without valid candidates is meaningless.
            flag::NO_CANDIDATE
        }
    }
}

/// Writes one row, each step for all its pixels, so that each step is a loop over arrays.
#[leveled]
fn write_map_row(
    level: Level,
    writer: MapWriter<'_>,
    y: usize,
    found: EvidenceRow<'_>,
    checker: &mut Checker,
    row: ResultRow<'_>,
) {
    let ResultRow { disparity, flags, votes } = row;

    writer.flag_outside(found.chosen, flags);
    if let Some(validity) = writer.validity {
        for (x, (&chosen, flags)) in found.chosen.iter().zip(&mut *flags).enumerate() {
            if !validity.is_valid(y, x, chosen.into()) {
                *flags = MapWriter::flag_invalid(validity, (y, x), *flags);
            }
        }
    }

    if let Some(most) = writer.consistency {
        let chosen = &found.chosen[..writer.cols];
        let costs = &found.best[..writer.cols];
        checker.check(Choices { chosen, costs, candidates: writer.candidates }, most, flags);
    }

    if writer.uniqueness > 0 {
        let margins = found.best.iter().zip(found.second_best);
        for (flags, (&best, &second_best)) in flags.iter_mut().zip(margins) {
            let is_ambiguous = CostMargin::new(best, second_best).is_ambiguous(writer.uniqueness);
            let is_estimated = *flags & flag::MISSING == 0;
            *flags |= if is_estimated & is_ambiguous { flag::AMBIGUOUS } else { 0 };
        }
    }

    for ((disparity, chosen), flags) in disparity.iter_mut().zip(found.chosen).zip(&*flags) {
        *disparity = writer.disparity(*chosen, *flags);
    }
    if writer.subpixel {
        for (disparity, offset) in disparity.iter_mut().zip(found.offset) {
            *disparity += offset;
        }
    }

    if let Some(votes) = votes {
        for (vote, (&best, &second_best)) in votes.iter_mut().zip(found.best.iter().zip(found.second_best)) {
            let second_best = if second_best == NONE { writer.unrelated } else { second_best };
            *vote = confidence::vote(CostMargin::new(best, second_best), writer.unit);
        }
        // A choice without valid candidates is meaningless, however large its margin.
        if writer.validity.is_some() {
            for (vote, flags) in votes.iter_mut().zip(&*flags) {
                *vote = if flags & flag::MISSING == 0 { *vote } else { 0.0 };
            }
        }
    }
}

/// The stages of [`Draft::refine`], in order.
pub const STAGES: [&dyn Stage; 8] = [
    &speckles::Speckles,
    &filling::Filling,
    &GuidedMedian::Narrow,
    &median::Median,
    &synthesis::Synthesis,
    &GuidedMedian::Wide,
    &surfaces::Surfaces,
    &confidence::Confidences,
];

/// Bytes of a pixel of the map, and of the second map with which it alternates during refinement.
const MAP_BYTES: usize = 24;
/// Bytes of a pixel of gray values, and of the values that stages derive from them.
const TEXTURE_BYTES: usize = 20;

/// All of [`STAGES`]: each reads the output of the one before.
pub struct Refinement;

impl Stage for Refinement {
    fn reach(&self, plan: Plan) -> usize {
        STAGES.iter().map(|stage| stage.reach(plan)).sum()
    }

    fn bytes(&self, demand: &Demand) -> Bytes {
        let texture = if Texture::is_needed(demand.plan.settings) { TEXTURE_BYTES } else { 0 };
        let maps = Bytes { mapped: (MAP_BYTES + texture) * demand.cols, ..Bytes::default() };
        STAGES.iter().map(|stage| stage.bytes(demand)).fold(maps, Bytes::and)
    }
}

/// A map before the stages that work on the whole map.
#[derive(Debug)]
pub struct Draft<'a> {
    /// Disparities, pixels.
    pub disparity: Plane<f32>,
    /// Reasons, from [`flag`].
    pub flags: &'a mut Plane<u16>,
    /// Votes for the disparities, if confidences need them.
    pub votes: Option<&'a Plane<f32>>,
    /// The left image, if the settings need it.
    pub texture: Option<&'a Texture<'a>>,
    /// The pair, if one of its images is to be synthesized.
    pub blurred_pair: Option<&'a synthesis::BlurredPair<'a>>,
}

impl Draft<'_> {
    /// Runs the [`STAGES`]. Returns disparities and, from votes, raw confidences.
    pub fn refine(
        self,
        settings: &Settings,
        level: Level,
        control: &Control,
    ) -> Result<(Plane<f32>, Option<Plane<f32>>)> {
        let Self { mut disparity, flags, votes, texture, blurred_pair } = self;

        if settings.speckle_size > 0 {
            let region = (settings.speckle_size, settings.speckle_range as f32);
            flag_speckles(&disparity, flags, region, level, control)?;
        }

        // Filling comes after all checks: it spreads only disparities that have passed them.
        if settings.has_checks() {
            fill(&mut disparity, flags, level, control)?;
        }

        let mut spare = None;
        if let (true, Some(texture)) = (settings.guided_median, texture) {
            replace(&mut disparity, &mut spare, |from, to| {
                GuidedMedian::Narrow.filter(from, texture, to, level, control)
            })?;
        }

        if settings.median > 0 {
            replace(&mut disparity, &mut spare, |from, to| median::smooth(from, to, level, control))?;
        }

        if let (Some(pair), Some(texture)) = (blurred_pair, texture) {
            replace(&mut disparity, &mut spare, |from, to| pair.redraw(from, to, level, control))?;
            replace(&mut disparity, &mut spare, |from, to| {
                GuidedMedian::Wide.filter(from, texture, to, level, control)
            })?;
        }

        if settings.subpixel {
            let smooth = |from: &_, to: &mut _| surfaces::smooth(from, to, level, control);
            replace(&mut disparity, &mut spare, smooth)?;
        }

        // Confidences come last: they are those of the final disparities.
        let confidences = match (votes, texture) {
            (Some(votes), Some(texture)) => {
                let map = VotedMap { disparity: &disparity, votes, texture };
                let mut confidences = taken(&mut spare, &disparity)?;

                map.confidences(&mut confidences, level, control)?;

                Some(confidences)
            }
            _ => None,
        };

        Ok((disparity, confidences))
    }
}

/// Replaces a map by the result of a stage. Two planes alternate: a plane for every stage would have to be
/// cleared first, and all of them together would take more memory than the result.
fn replace(
    disparity: &mut Plane<f32>,
    spare: &mut Option<Plane<f32>>,
    draw: impl FnOnce(&Plane<f32>, &mut Plane<f32>) -> Result<()>,
) -> Result<()> {
    let mut drawn = taken(spare, disparity)?;
    draw(disparity, &mut drawn)?;

    *spare = Some(std::mem::replace(disparity, drawn));
    Ok(())
}

/// The spare plane, if any, or a new plane of the size of `like`.
fn taken(spare: &mut Option<Plane<f32>>, like: &Plane<f32>) -> Result<Plane<f32>> {
    spare.take().map_or_else(|| Plane::new(like.rows(), like.cols()), Ok)
}

/// Invalidates estimates with too little confidence and, unless holes are filled, untrusted ones.
pub fn invalidate(
    settings: &Settings,
    disparity: &mut [f32],
    flags: &mut [u16],
    confidences: Option<&[f32]>,
    uncertainties: Option<&mut [f32]>,
) {
    if settings.fill && settings.min_confidence <= 0.0 {
        return;
    }

    for (x, (disparity, flags)) in disparity.iter_mut().zip(flags).enumerate() {
        let confidence = confidences.map_or(1.0, |confidences| confidences[x]);

        // An invalid disparity no longer comes from elsewhere, so that flag is cleared as well.
        if f64::from(confidence) < settings.min_confidence && !disparity.is_nan() {
            *flags = (*flags | flag::LOW_CONFIDENCE) & !(flag::FILLED | flag::SECOND);
            *disparity = f32::NAN;
        }

        if !settings.fill && *flags & flag::UNTRUSTED != 0 {
            *flags &= !(flag::FILLED | flag::SECOND);
            *disparity = f32::NAN;
        }
    }

    for (uncertainty, disparity) in uncertainties.into_iter().flatten().zip(disparity) {
        *uncertainty = if disparity.is_nan() { f32::NAN } else { *uncertainty };
    }
}

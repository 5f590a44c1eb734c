//! A trial whether a pair is matched better with its rows straightened, on a few bands.
//!
//! The estimated field is not always right: in scenes with few textures it may claim three tenths of a pixel that are not
//! there, and a match would lose by it. So some bands are matched both ways, with the codes and the paths of the match
//! itself, and the right image is straightened only if confidence rises and the left-right check fails no more often. Most
//! fields are so large beside their error that they need no trial.

use std::iter;
use std::ops::Range;

use super::Estimates;
use super::compensation_plan::CompensationPlan;
use crate::error::Result;
use crate::pipeline::halo::Halo;
use crate::pipeline::matcher::Disparity;
use crate::pipeline::pair::Pair;
use crate::pipeline::runtime::Runtime;
use crate::pipeline::section::Section;
use crate::pipeline::source::widened;
use crate::refinement::flag;
use crate::rig::blur::parts::PairRows;
use crate::rig::blur_compensation::BlurCompensation;
use crate::settings::{Optimizer, Settings};

/// Number of bands that are tried, and rows of each.
const BANDS: (usize, usize) = (3, 24);
/// Least rise of the mean confidence.
const LEAST_RISE: f64 = 0.001;
/// Largest fall of the share of pixels that pass the left-right check: a tenth of a percent is chance ...
const CHANCE: f64 = 0.001;
/// ... or this share of the rise of confidence, which accepts pairs that gain and that the first bound would refuse.
const OF_RISE: f64 = 0.3;
/// A field of at least so many pixels, root mean square, ...
const LARGE: f64 = 0.2;
/// ... and so many standard errors is right without a trial: fields that are not there have fewer.
const SURE: f64 = 4.0;

/// How well some rows are matched, as sums over their pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Score {
    confidence: f64,
    /// Pixels that pass the left-right check.
    consistent: f64,
    pixels: f64,
}

/// Whether the right image is to be straightened: the estimated field is large beside its error, or bands are matched
/// better with it, under the blur compensation that the caller knows, or else the estimated one.
pub fn confirms(
    rows: PairRows,
    estimates: &Estimates,
    known: Option<&BlurCompensation>,
    settings: &Settings,
    runtime: Runtime,
) -> Result<bool> {
    let (Some(field), Some(offsets)) = (&estimates.alignment, &estimates.offsets) else {
        return Ok(false);
    };

    if field.rms() >= LARGE.max(SURE * offsets.error) {
        return Ok(true);
    }
    let Runtime { matcher, execution, control } = runtime;

    let plan = estimates.compensation.as_ref();
    let compensation =
        known.cloned().or(plan.map(CompensationPlan::blur_compensation).transpose()?);
    let settings = tried(plan.map_or(settings, |plan| &plan.settings).clone());
    let halo = Halo::new(&settings, compensation.as_ref(), None).description;

    let mut scores = [Score::default(); 2];
    for band in bands(rows.size().0) {
        // The match reads `inner` rows; straightening them reads `outer` ones.
        let inner = widened(&band, halo, rows.size().0);
        let outer = widened(&inner, field.halo(), rows.size().0);

        let compensation = compensation.clone().map(|all| all.starting_at_row(outer.start));
        let pair = rows
            .pair(outer.clone())?
            .searched(estimates.candidates)
            .with_blur_compensation(compensation);
        let field = field.clone().starting_at_row(outer.start);
        let straightened = pair.straightened(&field, execution.level, control)?;

        let wanted = band.start - inner.start..band.end - inner.start;
        let matched = |pair: &Pair| {
            let pair = pair.of_rows(inner.start - outer.start..inner.end - outer.start);
            let section = Section { rows: wanted.clone(), ..Section::whole(&pair) };
            matcher.match_alone(&pair, &section, &settings, execution, &control.aside())
        };

        // A band is too narrow for several threads.
        let (as_it_is, straight) = rayon::join(|| matched(&pair), || matched(&straightened));
        scores[0].add(&as_it_is?);
        scores[1].add(&straight?);
    }

    Ok(scores[1].is_better_than(scores[0]))
}

/// The settings with paths along the rows alone, so that bands need a small halo, and of refinement with no more than the
/// left-right check and the confidence.
fn tried(settings: Settings) -> Settings {
    Settings {
        optimizer: match settings.optimizer {
            Optimizer::SemiGlobal => Optimizer::ScanlineOptimization,
            other => other,
        },
        lr_check: Some(1),
        uniqueness: 0,
        speckle_size: 0,
        synthesis: false,
        guided_median: false,
        median: 0,
        subpixel: false,
        fill: true,
        confidence: true,
        min_confidence: 0.0,
        ..settings
    }
}

/// Bands spread evenly over the image.
fn bands(height: usize) -> Vec<Range<usize>> {
    let (count, rows) = BANDS;
    if height <= count * rows {
        return iter::once(0..height).collect();
    }

    let first = |index: usize| (2 * index + 1) * height / (2 * count) - rows / 2;
    (0..count).map(|index| first(index)..first(index) + rows).collect()
}

impl Score {
    fn add(&mut self, map: &Disparity) {
        for y in 0..map.flags.rows() {
            let confidence = map.confidence.iter().flat_map(|plane| plane.row(y));
            self.confidence += confidence.map(|value| f64::from(*value)).sum::<f64>();

            let is_consistent = |flags: &&u16| **flags & (flag::OCCLUDED | flag::MISMATCHED) == 0;
            self.consistent += map.flags.row(y).iter().filter(is_consistent).count() as f64;
            self.pixels += map.flags.row(y).len() as f64;
        }
    }

    /// Whether confidence rises: that pays for a small fall of consistency.
    fn is_better_than(self, before: Self) -> bool {
        let rise = (self.confidence - before.confidence) / before.pixels;
        let fall = (before.consistent - self.consistent) / before.pixels;
        rise > LEAST_RISE && fall <= CHANCE.max(OF_RISE * rise)
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use ndarray::Array3;

    use super::*;
    use crate::image::view::{Image, View};
    use crate::pipeline::control::Control;
    use crate::pipeline::matcher::{Execution, Matcher};
    use crate::rig::alignment::Alignment;
    use crate::rig::alignment::sway::INTERVALS;
    use crate::rig::blur::parts::Part;
    use crate::rig::estimation::rows::RowOffsets;
    use crate::settings::presets::Preset;
    use crate::simd::Level;

    #[test]
    fn rising_confidence_pays_for_a_little_consistency() {
        let score = |confidence, consistent| Score { confidence, consistent, pixels: 1000.0 };
        let is_better = |confidence, consistent| {
            score(confidence, consistent).is_better_than(score(500.0, 900.0))
        };
        assert!(is_better(501.1, 900.0) && !is_better(500.9, 950.0));
        assert!(is_better(502.0, 899.0) && !is_better(502.0, 898.9));
        assert!(is_better(520.0, 894.1) && !is_better(520.0, 893.9));
    }

    #[test]
    fn a_field_is_right_if_it_is_large_or_bands_match_better_by_it() {
        let size = (150, 160);
        // A plane that is 0 in the middle, whatever rows a band begins with.
        let field = |slope: f64| Alignment::new([0.0, 0.0, slope, 0.0, 0.0, 0.0, 0.0, 0.0], size);
        let random = |y: f64, x: f64| {
            let (y, x) = ((y + 50.0) as usize, x as usize);
            ((((y * 7919 + x * 104_729) * 2_654_435_761) >> 20) % 1000) as f64
        };
        // Squares of two pixels, smooth between their corners.
        let scene = |y: f64, x: f64| {
            let (y, x) = (0.5 * y, 0.5 * x);
            let (top, left) = (y.floor(), x.floor());
            let along = |y: f64| {
                let [first, last] = [random(y, left), random(y, left + 1.0)];
                first + (x - left) * (last - first)
            };
            along(top) + (y - top) * (along(top + 1.0) - along(top))
        };
        let (matcher, control) = (Matcher::new(1).expect("a thread"), Control::default());
        let execution = Execution { threads: 1, level: Level::best() };
        let runtime = Runtime { matcher: &matcher, execution, control: &control };
        let settings = Settings { confidence: true, ..Preset::Paper.settings() };

        let is_right = |injected: f64, claimed: f64, error: f64| {
            let off = field(injected).expect("legal");
            let view = |is_right: bool| {
                let pixel = |(y, x, _)| {
                    let (y, x) = (y as f64, x as f64);
                    let row = if is_right { y - off.at(x, y) } else { y };
                    scene(row, x + if is_right { 7.0 } else { 0.0 }) as f32
                };
                View::from(Image::F32(Array3::from_shape_fn((size.0, size.1, 1), pixel)))
            };
            let pair = Pair::new(view(false), view(true), 0, 16).expect("legal");
            let pair = pair.with_own_ranges(&control).expect("legal");

            let field = field(claimed).expect("legal");
            let errors = [error; INTERVALS];
            let offsets =
                RowOffsets { field: field.clone(), error, blocks: 100, spread: 0.1, errors };
            let estimates = Estimates {
                alignment: (claimed != 0.0).then_some(field),
                offsets: Some(offsets),
                ..Estimates::of_candidates(pair.candidates())
            };
            let part = Part::new(0, Cow::Owned(pair), runtime).expect("memory");
            confirms(PairRows::Kept(&part), &estimates, None, &settings, runtime).expect("it runs")
        };

        assert!(is_right(1.5, 1.5, 0.5) && is_right(-1.5, -1.5, 0.5));
        assert!(!is_right(0.0, 1.5, 0.5) && !is_right(1.5, -1.5, 0.5) && !is_right(0.0, 0.0, 0.5));
        // Of the root mean square 0.87.
        assert!(is_right(0.0, 1.5, 0.2) && !is_right(0.0, 0.3, 0.01));
    }

    #[test]
    fn bands_are_spread_evenly() {
        assert!(bands(40).into_iter().eq(iter::once(0..40)));
        assert_eq!(bands(600), [88..112, 288..312, 488..512]);
    }
}

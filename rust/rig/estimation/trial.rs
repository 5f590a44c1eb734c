//! Whether a pair is matched better with its rows straightened: tried on a few bands.
//!
//! What blocks say of rows is not always so: in scenes of few textures they say three tenths of a pixel that are not there,
//! and a match would lose by it. So some bands are matched both ways, by the codes and the paths of the match itself, and the
//! right image is straightened only if confidence rises and the left-right check fails no oftener.

use std::iter;
use std::ops::Range;

use super::Estimates;
use super::compensation::Compensation;
use crate::error::Result;
use crate::pipeline::halo::Halo;
use crate::pipeline::matcher::Disparity;
use crate::pipeline::section::Section;
use crate::pipeline::source::widened;
use crate::refinement::flag;
use crate::rig::blur::parts::{Means, Rows};
use crate::rig::blur_compensation::BlurCompensation;
use crate::settings::{Optimizer, Settings};

/// Bands that are tried, and rows of each.
const BANDS: (usize, usize) = (3, 24);
/// By how much the mean confidence has to rise.
const LEAST_RISE: f64 = 0.001;
/// By how much the share of pixels that pass the left-right check may fall: a tenth of a percent is chance ...
const CHANCE: f64 = 0.001;
/// ... or so much of what confidence rises by. Of 288 pairs with rows that were moved, this accepts 8 that gain and that the
/// first would refuse.
const OF_RISE: f64 = 0.3;

/// How well some rows are matched.
#[derive(Debug, Clone, Copy, Default)]
struct Score {
    confidence: f64,
    agreeing: f64,
    pixels: f64,
}

/// Whether bands are matched better with the field that was found, with the blur evened out as is given, or else as suits.
pub fn confirms(
    rows: Rows,
    found: &Estimates,
    told: Option<&BlurCompensation>,
    settings: &Settings,
    means: Means,
) -> Result<bool> {
    let Some(field) = &found.alignment else { return Ok(false) };
    let Means { matcher, how, control } = means;
    let suited = found.compensation.as_ref();
    let compensation = told.cloned().or(suited.map(Compensation::blur_compensation).transpose()?);
    let settings = tried(suited.map_or(settings, |found| &found.settings).clone());
    let described = Halo::new(&settings, compensation.as_ref(), None).description;
    let mut scores = [Score::default(); 2];
    for band in bands(rows.size().0) {
        let inner = widened(&band, described, rows.size().0);
        let outer = widened(&inner, field.reach(), rows.size().0);
        let compensation = compensation.clone().map(|all| all.starting_at_row(outer.start));
        let pair = rows
            .pair(outer.clone())?
            .searched(found.candidates)
            .with_blur_compensation(compensation);
        let field = field.clone().starting_at_row(outer.start);
        let straightened = pair.straightened(&field, how.level, control)?;
        let wanted = band.start - inner.start..band.end - inner.start;
        for (pair, score) in [pair, straightened].into_iter().zip(&mut scores) {
            let pair = pair.of_rows(inner.start - outer.start..inner.end - outer.start);
            let section = Section { rows: wanted.clone(), ..Section::whole(&pair) };
            score.add(&matcher.run_alone(&pair, &section, &settings, how, &control.aside())?);
        }
    }
    let [before, after] = scores;
    let rise = (after.confidence - before.confidence) / before.pixels;
    let fall = (before.agreeing - after.agreeing) / before.pixels;
    Ok(rise > LEAST_RISE && fall <= CHANCE.max(OF_RISE * rise))
}

/// The settings with paths along the rows alone, so that bands need few rows around them, and without what comes after
/// the choice but for the left-right check and the confidence.
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

/// Bands all over the image.
fn bands(height: usize) -> Vec<Range<usize>> {
    let (count, rows) = BANDS;
    if height <= count * rows {
        return iter::once(0..height).collect();
    }
    let first = |index: usize| (2 * index + 1) * height / (2 * count) - rows / 2;
    (0..count).map(|index| first(index)..first(index) + rows).collect()
}

impl Score {
    fn add(&mut self, found: &Disparity) {
        for y in 0..found.flags.rows() {
            let confidence = found.confidence.iter().flat_map(|plane| plane.row(y));
            self.confidence += confidence.map(|value| f64::from(*value)).sum::<f64>();
            let is_checked = |flags: &&u16| **flags & (flag::OCCLUDED | flag::MISMATCHED) == 0;
            self.agreeing += found.flags.row(y).iter().filter(is_checked).count() as f64;
            self.pixels += found.flags.row(y).len() as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_lie_all_over_the_image() {
        assert!(bands(40).into_iter().eq(iter::once(0..40)));
        assert_eq!(bands(600), [88..112, 288..312, 488..512]);
    }
}

//! The estimates from a pair.

use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use super::compensation_plan::CompensationPlan;
use super::facts::{Direction, Fact};
use super::overview::Seen;
use super::range::{LeftOut, SearchRange};
use super::rows::RowOffsets;
use crate::estimation::blur;
use crate::estimation::photometry::Photometry;
use crate::estimation::raster::Raster;
use crate::estimation::shared::Shared;
use crate::finding::Finding;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::overlay::Overlay;

/// The estimates from a pair, and the settings and kernels adapted to them.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Estimates {
    /// The axis of the disparities, if given or found; `None`: along rows, as far as is known. If it is along
    /// columns, all other estimates describe the turned images.
    pub axis: Option<Fact<Direction>>,
    /// The disparities to search.
    pub candidates: Fact<Candidates>,
    /// Mean confidence of the rough match of the reduced images, if there was one: over the known
    /// disparities, unless these match badly and others well.
    pub confidence: Option<f64>,
    /// Whether the images match only after one of them is inverted. With `compensate_blur`, everything else
    /// was then estimated with the negative of the right image.
    pub is_inverted: bool,
    /// How the pixels of the left and of the right image were read: fields and mosaics were resolved.
    pub(crate) rasters: [Raster; 2],
    /// The disparities seen by the rough match of the reduced images, if there was one.
    pub(crate) seen: Option<Arc<Seen>>,
    /// Shares of the left and of the right image that are black borders, which are masked.
    pub borders: [f64; 2],
    /// Overlays of both images, such as clocks, which are masked.
    pub overlays: Vec<Overlay>,
    /// The range of disparities, if it was to be estimated, or if the known one matches badly.
    pub range: Option<SearchRange>,
    /// Places whose disparities seem to be outside the searched range.
    pub left_out: Vec<LeftOut>,
    /// The vertical offsets, if they were to be estimated and enough blocks were found in both images.
    pub offsets: Option<RowOffsets>,
    /// The row differences that the best field of offsets leaves, reliable or not, pixels: infinite without
    /// one.
    pub rows_apart: f64,
    /// What both images shared, and the standard deviation of it, in units of the pixels. It is subtracted:
    /// everything else is estimated without it.
    pub shared: Option<(Shared, f64)>,
    /// The field by which the right image is straightened.
    pub alignment: Option<Alignment>,
    /// Noise and blur, if they were to be estimated.
    pub blur: Option<blur::Estimate>,
    /// The estimates from gray values, if any were requested.
    pub photometry: Option<Photometry>,
    /// The settings and kernels adapted to the blur and the noise, of which one or both are estimated or
    /// known.
    pub compensation: Option<CompensationPlan>,
    /// Findings about the pair, in a fixed order of topics.
    pub findings: Vec<Finding>,
    /// Wall-clock time.
    pub time: Duration,
}

impl Estimates {
    /// The estimates of a pair after its rasters were resolved; `before` is what its gray values showed: now
    /// it has neither fields nor a mosaic, and other values.
    pub(crate) fn of_resolved(self, rasters: [Raster; 2], before: Option<Photometry>) -> Self {
        let photometry = self.photometry.zip(before).map(|(after, before)| {
            let Photometry { black, range, saturation, fields, mosaic, .. } = before;
            Photometry { black, range, saturation, fields, mosaic, ..after }
        });
        Self { rasters, photometry, ..self }
    }

    /// The disparities to search, half-open: the given ones, or otherwise those that were found.
    pub fn disparities(&self) -> Range<i64> {
        let (min, count) = self.candidates.value.numbers();
        min..min + count
    }

    /// Whether the right image is straightened, since its rows do not correspond to those of the left one.
    pub fn is_straightened(&self) -> bool {
        self.alignment.is_some()
    }

    /// Whether the pair was matched along its columns.
    pub fn is_vertical(&self) -> bool {
        self.axis.as_ref().is_some_and(|axis| axis.value == Direction::Columns)
    }

    /// Whether both images are the same, up to noise: they show no depth.
    pub fn is_one_image(&self) -> bool {
        self.range.as_ref().is_some_and(|range| range.identical)
    }

    /// Whether rows sway.
    pub fn sways(&self) -> bool {
        self.offsets.as_ref().is_some_and(|found| found.field.sway().is_some())
    }

    /// Standard deviations of the noise, left and right, in units of the pixels; `None`: not estimated.
    pub fn noise(&self) -> Option<[f64; 2]> {
        self.blur.as_ref().map(|blur| blur.noise)
    }

    /// Standard deviations of the noise, or of the noise that would do the same harm as compression, if that
    /// is larger, left and right, in units of the pixels; 0 if neither was estimated.
    pub fn harm(&self) -> [f64; 2] {
        let known = || self.compensation.as_ref().map_or([0.0; 2], |plan| plan.noise);
        self.blur.as_ref().map_or_else(known, |blur| blur.harm(blur.noise))
    }
}

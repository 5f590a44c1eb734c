//! How many rows above and below its own a disparity depends on: what parts of an image need beyond their own rows, to
//! come out as parts of the whole.

use crate::cost::aggregation::Window;
use crate::image::impulses;
use crate::image::masking;
use crate::image::smoothing;
use crate::optimization::{BAND, LOOKAHEAD_ROWS};
use crate::refinement::confidence;
use crate::refinement::filling;
use crate::refinement::guided_median;
use crate::refinement::median;
use crate::refinement::subpixel;
use crate::refinement::synthesis;
use crate::rig::alignment::Alignment;
use crate::rig::blur_compensation::BlurCompensation;
use crate::settings::{CostKind, Optimizer, Settings};

/// Rows on either side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Halo {
    /// Rows of the images around one that is described and summed over windows.
    pub description: usize,
    /// Rows of the images around one whose disparities are chosen.
    pub images: usize,
    /// Rows of what was chosen around one that is refined.
    pub map: usize,
    /// Rows of the images around one of gray values, some of which are of masked rows.
    pub masked: usize,
}

impl Halo {
    /// That of checked settings, for images whose blur is evened out so, the right one straightened.
    pub fn new(
        settings: &Settings,
        compensation: Option<&BlurCompensation>,
        alignment: Option<&Alignment>,
    ) -> Self {
        let window = Window::new((1, 1), 1, settings, 0).halo();
        let description = match settings.cost {
            CostKind::Phase => {
                settings.largest_neighborhood() / 2 + compensation.map_or(0, described)
            }
            CostKind::Sad => 0,
            CostKind::NormalizedSad => settings.window / 2,
        };
        // The rest of the band that a row lies in, and what its paths see beyond.
        let paths = match settings.optimizer {
            Optimizer::SemiGlobal => BAND - 1 + LOOKAHEAD_ROWS,
            _ => 0,
        };
        // Gray values are compared with those of the row above.
        let description = window + description;
        let beside = compensation.map_or(0, repaired) + alignment.map_or(0, Alignment::reach);
        let images = (description + paths).max(1) + beside;
        Self {
            description,
            images,
            map: refinement(settings, compensation),
            masked: masking::REACH,
        }
    }

    /// Rows of the images around one whose disparities are refined.
    pub fn rows(self) -> usize {
        self.images + self.map
    }
}

/// How far the stages look that follow one another. A region that is no larger than a speckle has no more rows than
/// pixels.
fn refinement(settings: &Settings, compensation: Option<&BlurCompensation>) -> usize {
    let asked =
        compensation.filter(|compensation| synthesis::is_asked_for(settings, Some(compensation)));
    let synthesis = asked.map_or(0, |compensation| synthesis::reach(settings, compensation));
    let stages = [
        (settings.speckle_size > 0, settings.speckle_size),
        (settings.has_checks(), filling::REACH),
        (synthesis > 0, synthesis),
        // A jump is one to the next row.
        (settings.guided_median, guided_median::REACH + 1),
        (settings.median > 0, median::REACH),
        (settings.subpixel, subpixel::REACH),
        (settings.needs_confidence(), confidence::RADIUS),
    ];
    stages.into_iter().filter(|(is_used, _)| *is_used).map(|(_, rows)| rows).sum()
}

/// Rows on either side of one of gray values that are smoothed and blurred.
fn described(compensation: &BlurCompensation) -> usize {
    largest_radius(compensation) + if compensation.smooths() { smoothing::REACH } else { 0 }
}

/// Rows on either side of one whose impulses are repaired.
fn repaired(compensation: &BlurCompensation) -> usize {
    if compensation.repairs() { impulses::REACH } else { 0 }
}

/// Rows on either side of the largest kernel.
fn largest_radius(compensation: &BlurCompensation) -> usize {
    compensation.every_kernel().map(|kernel| kernel.radii().0).max().unwrap_or(0)
}

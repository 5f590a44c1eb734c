//! The halo: how many rows above and below its own a disparity depends on. A part of a pair with its halo is matched to
//! the bit as in the whole pair.

use crate::cost::aggregation::Window;
use crate::image::impulses;
use crate::image::masking;
use crate::image::smoothing;
use crate::optimization::{BAND, LOOKAHEAD_ROWS};
use crate::pair::alignment::Alignment;
use crate::pair::blur_compensation::BlurCompensation;
use crate::refinement::confidence;
use crate::refinement::filling;
use crate::refinement::median;
use crate::refinement::outlines::Outlines;
use crate::refinement::surfaces;
use crate::refinement::synthesis;
use crate::settings::{CostKind, Optimizer, Settings};

/// Rows on either side of a row of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Halo {
    /// Rows of the images that the descriptor and the window of one row cover.
    pub description: usize,
    /// Rows of the images on which the unrefined disparities of one row depend.
    pub images: usize,
    /// Rows of the unrefined map on which one refined row depends.
    pub map: usize,
    /// Further rows of the images on which gray values depend where rows are masked.
    pub masked: usize,
}

impl Halo {
    /// The halo of checked settings, for a pair whose blur is compensated and whose right image is straightened so.
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

        // The rows of a band are chosen together, and their vertical paths start some rows beyond the band.
        let paths = match settings.optimizer {
            Optimizer::SemiGlobal => BAND - 1 + LOOKAHEAD_ROWS,
            _ => 0,
        };

        let description = window + description;
        // At least one row: gray values are compared with those of the row above.
        let beside = compensation.map_or(0, repaired) + alignment.map_or(0, Alignment::halo);
        let images = (description + paths).max(1) + beside;

        Self {
            description,
            images,
            map: refinement(settings, compensation),
            masked: masking::REACH,
        }
    }

    /// Rows of the images on which one refined row depends.
    pub fn rows(self) -> usize {
        self.images + self.map
    }
}

/// The sum of the halos of the refinement's stages. A region that is no larger than a speckle has no more rows than
/// pixels.
fn refinement(settings: &Settings, compensation: Option<&BlurCompensation>) -> usize {
    let asked =
        compensation.filter(|compensation| synthesis::is_asked_for(settings, Some(compensation)));
    let synthesis = asked.map_or(0, |compensation| synthesis::reach(settings, compensation));

    let stages = [
        (settings.speckle_size > 0, settings.speckle_size),
        (settings.has_checks(), filling::REACH),
        (synthesis > 0, synthesis),
        (settings.guided_median, Outlines::Crisp.reach()),
        (settings.median > 0, median::REACH),
        (settings.subpixel, surfaces::REACH),
        (settings.needs_confidence(), confidence::RADIUS),
    ];

    stages.into_iter().filter(|(is_used, _)| *is_used).map(|(_, rows)| rows).sum()
}

/// Rows on either side that smoothing and blurring of gray values read.
fn described(compensation: &BlurCompensation) -> usize {
    largest_radius(compensation) + if compensation.smooths() { smoothing::REACH } else { 0 }
}

/// Rows on either side that the repair of impulses reads.
fn repaired(compensation: &BlurCompensation) -> usize {
    if compensation.repairs() { impulses::REACH } else { 0 }
}

/// Rows on either side of the largest kernel.
fn largest_radius(compensation: &BlurCompensation) -> usize {
    compensation.every_kernel().map(|kernel| kernel.radii().0).max().unwrap_or(0)
}

//! The halo: the rows above and below its own that a disparity depends on. A part of a pair with its halo is
//! matched bit for bit as in the whole pair.

use crate::cost::Description;
use crate::cost::aggregation::Aggregation;
use crate::image::masking;
use crate::optimization::edges::TextureAndEdges;
use crate::optimization::memory::Search;
use crate::pair::Images;
use crate::pair::plan::{Plan, Stage};
use crate::refinement::Refinement;

/// Rows on either side of a row of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Halo {
    /// Rows of the images on which the unrefined disparities of one row depend.
    pub images: usize,
    /// Rows of the unrefined map on which one refined row depends.
    pub map: usize,
    /// Further rows of the images that gray values depend on, if rows are masked.
    pub masked: usize,
}

impl Halo {
    /// The halo of a match: the sum of the reaches of its stages.
    pub fn new(plan: Plan) -> Self {
        let description = Description.reach(plan) + Aggregation.reach(plan);
        // The texture is read in parallel to the costs.
        let compared = (description + Search.reach(plan)).max(TextureAndEdges.reach(plan));
        let images = compared + Images.reach(plan);

        Self { images, map: Refinement.reach(plan), masked: masking::REACH }
    }

    /// Rows of the images on which one refined row depends.
    pub fn rows(self) -> usize {
        self.images + self.map
    }
}

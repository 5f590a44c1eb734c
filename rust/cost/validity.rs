//! Which pairs of a pixel and a candidate count: those whose pixels are valid in both images.

use crate::cost::candidates::Candidates;
use crate::image::view::{Mask, View};

/// The valid pairs of two images of which at least one image is masked.
#[derive(Debug)]
pub struct Validity<'a> {
    masks: [Option<&'a Mask>; 2],
    width: usize,
    candidates: Candidates,
}

impl<'a> Validity<'a> {
    /// The valid pairs of two images; `None` if neither has a mask.
    pub fn new([left, right]: [&'a View; 2], candidates: Candidates) -> Option<Self> {
        let masks = [left.mask.as_ref(), right.mask.as_ref()];
        let width = left.image.shape().1;

        masks.iter().any(Option::is_some).then_some(Self { masks, width, candidates })
    }

    /// Whether the left pixel is masked.
    pub fn is_masked(&self, y: usize, x: usize) -> bool {
        self.masks[0].is_some_and(|mask| !mask.row(y)[x])
    }

    /// Whether the left pixel and its candidate `k` are both valid.
    pub fn is_valid(&self, y: usize, x: usize, k: usize) -> bool {
        let column = self.candidates.column(x, k, self.width);
        !self.is_masked(y, x) && self.masks[1].is_none_or(|mask| mask.row(y)[column])
    }

    /// The masks of the left and of the right image; `None`: valid everywhere.
    pub fn masks(&self) -> [Option<&'a Mask>; 2] {
        self.masks
    }
}

//! Which pairs of a pixel and a candidate count: those whose pixels are valid in both images.

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::image::view::{Mask, View};
use crate::pair::candidates::Candidates;

/// The valid pairs of two images of which at least one image is masked.
#[derive(Debug)]
pub struct Validity<'a> {
    masks: [Option<&'a Mask>; 2],
    width: usize,
    candidates: Candidates,
    /// Whether the left pixel and all of its candidates are valid: nearly everywhere, under usual masks.
    whole: Plane<bool>,
}

impl<'a> Validity<'a> {
    /// The valid pairs of two images; `None` if neither has a mask.
    pub fn new([left, right]: [&'a View; 2], candidates: Candidates) -> Result<Option<Self>> {
        let masks = [left.mask(), right.mask()];
        if masks.iter().all(Option::is_none) {
            return Ok(None);
        }

        let (rows, width) = left.size();
        let whole = Plane::by_bands((rows, width), 1, |y, row| {
            let [left, right] = masks.map(|mask| mask.map(|mask| mask.row(y)));
            write_whole([left, right], candidates, row);
            Ok(())
        })?;
        Ok(Some(Self { masks, width, candidates, whole }))
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

    /// Whether any candidate of a left pixel is valid.
    pub fn has_candidate(&self, y: usize, x: usize) -> bool {
        // Columns fall as disparities rise.
        let column = |k: usize| self.candidates.column(x, k, self.width);
        let columns = column(self.candidates.count() - 1)..=column(0);
        self.masks[1].is_none_or(|mask| mask.row(y)[columns].contains(&true))
    }

    /// Whether each pixel of row `y` and all of its candidates are valid.
    pub fn whole(&self, y: usize) -> &[bool] {
        self.whole.row(y)
    }

    /// The masks of the left and of the right image; `None`: valid everywhere.
    pub fn masks(&self) -> [Option<&'a Mask>; 2] {
        self.masks
    }
}

/// Writes where the pixels of a row and all of their candidates are valid.
fn write_whole([left, right]: [Option<&[bool]>; 2], candidates: Candidates, out: &mut [bool]) {
    match left {
        Some(left) => out.copy_from_slice(left),
        None => out.fill(true),
    }

    let Some(right) = right.filter(|right| right.contains(&false)) else { return };
    // The first masked column at or beyond each one, from right to left.
    let mut next = usize::MAX;
    let mut masked_from = vec![usize::MAX; right.len()];
    for (x, valid) in right.iter().enumerate().rev() {
        next = if *valid { next } else { x };
        masked_from[x] = next;
    }

    for (x, whole) in out.iter_mut().enumerate() {
        // Columns fall as disparities rise.
        let last = candidates.column(x, 0, right.len());
        let first = candidates.column(x, candidates.count() - 1, right.len());
        *whole &= masked_from[first] > last;
    }
}

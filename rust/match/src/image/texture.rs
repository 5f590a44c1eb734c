//! The gray values of the left image, for the stages that compare them. The mean difference from one pixel to
//! the next is the unit of these comparisons, so neither the contrast nor the unit of gray values matters.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use crate::base::plane::Plane;
use crate::image::view::View;
use crate::settings::Settings;

/// Gray values, and the roughness of their image.
#[derive(Debug, Clone)]
pub struct Texture<'a> {
    /// Gray values, in any unit, below 2^30.
    pub gray: Cow<'a, Plane<i32>>,
    /// The roughness of the whole image, if this is a part of one.
    pub roughness: Roughness,
}

/// The differences of horizontal neighbors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Roughness {
    /// The sum of the differences.
    pub sum: u64,
    /// The number of differences.
    pub pairs: u64,
}

impl Roughness {
    /// The roughness of some rows.
    pub fn of_rows(rows: &[i32], cols: usize) -> Self {
        let row = |row: &[i32]| -> u64 {
            let pairs = row.iter().zip(&row[1..]);
            pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum()
        };

        let pairs = rows.len() / cols * (cols - 1);

        Self { sum: rows.par_chunks(cols).map(row).sum(), pairs: pairs as u64 }
    }

    /// The roughness of both parts.
    pub fn and(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, pairs: self.pairs + other.pairs }
    }

    /// The mean difference; 0 without neighbors.
    pub fn mean(self) -> f64 {
        self.sum as f64 / self.pairs.max(1) as f64
    }
}

impl<'a> Texture<'a> {
    /// The texture of a whole image.
    pub fn new(gray: Plane<i32>) -> Self {
        let roughness = Roughness::of_rows(gray.as_slice(), gray.cols());
        Self { gray: Cow::Owned(gray), roughness }
    }

    /// The texture of some rows; the roughness stays that of the whole.
    pub fn of_rows(self, rows: Range<usize>) -> Self {
        if rows == (0..self.gray.rows()) {
            return self;
        }
        Self { gray: Cow::Owned(self.gray.copy_of_rows(rows)), ..self }
    }

    /// Whether the settings need a texture.
    pub fn is_needed(settings: &Settings) -> bool {
        let is_compared = settings.guided_median || settings.synthesis;
        settings.adaptive_p2 > 0.0 || is_compared || settings.needs_confidence()
    }

    /// The texture of a view, if the settings need one; `known` is the roughness of the whole image, if the
    /// view is a part.
    pub fn of_view(view: &'a View, settings: &Settings, known: Option<Roughness>) -> Option<Self> {
        Self::is_needed(settings).then(|| {
            let gray = view.gray();
            let of_image = || Roughness::of_rows(gray.as_slice(), gray.cols());
            let roughness = known.unwrap_or_else(of_image);
            Self { gray: Cow::Borrowed(gray), roughness }
        })
    }
}

//! Two images, the disparities to search, and how the images are made comparable: resampled to one size and to rows that
//! correspond, blurred alike.

pub mod alignment;
pub mod blur_compensation;
pub mod candidates;
pub mod fitting;
pub mod plan;
pub mod source;

use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::simd::Level;
use crate::image::intensity_range::IntensityRange;
use crate::image::packing::Packing;
use crate::image::view::View;
use crate::image::{impulses, intensity};
use crate::pair::alignment::Alignment;
use crate::pair::alignment::straighten::straightened;
use crate::pair::blur_compensation::BlurCompensation;
use crate::pair::candidates::Candidates;
use crate::pair::fitting::{Fit, fitted};
use crate::pair::plan::{Bytes, Demand, Plan, Stage};

/// Two images and the disparities to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    left: View,
    right: View,
    candidates: Candidates,
    compensation: Option<BlurCompensation>,
    fit: Option<Fit>,
}

/// The images of a pair, straightened and repaired.
pub struct Images;

impl Stage for Images {
    fn reach(&self, Plan { compensation, alignment, .. }: Plan) -> usize {
        let repairs = compensation.is_some_and(BlurCompensation::repairs);
        let repaired = if repairs { impulses::REACH } else { 0 };
        repaired + alignment.map_or(0, Alignment::halo)
    }

    fn bytes(&self, demand: &Demand) -> Bytes {
        // Both images and their masks, twice; the right one once more, or twice, if it is straightened.
        let copies = if demand.plan.alignment.is_some() { 6 } else { 4 };
        Bytes { read: demand.cols * copies * (demand.pixel + 1), ..Bytes::default() }
    }
}

impl Pair {
    /// A pair that can be matched: images of one size and type, with valid pixels and a reachable range.
    pub fn new(left: View, right: View, min_disparity: i64, num_disparities: i64) -> Result<Self> {
        left.check("left")?;
        right.check("right")?;

        let (rows, cols, _) = left.image.shape();
        let (right_rows, right_cols, _) = right.image.shape();
        if (rows, cols) != (right_rows, right_cols) {
            let got = format!("{right_rows} x {right_cols} pixels");
            return Err(Error::value("right", got, format!("the size of left, {rows} x {cols}")));
        }

        if std::mem::discriminant(&left.image) != std::mem::discriminant(&right.image) {
            return Err(Error::value("right", "pixels of another type", "the type of left"));
        }

        let candidates = Candidates::new(min_disparity, num_disparities, cols)?;
        Ok(Self { left, right, candidates, compensation: None, fit: None })
    }

    /// A pair of any two images: the right one is brought to the size of the left one, and both to one type.
    pub fn of_any(
        left: View,
        right: View,
        min_disparity: i64,
        num_disparities: i64,
    ) -> Result<Self> {
        left.check("left")?;
        right.check("right")?;

        let ([left, right], fit) = fitted(left, right)?;
        Ok(Self { fit, ..Self::new(left, right, min_disparity, num_disparities)? })
    }

    /// How the right image was brought to the size of the left one; `None`: it came so.
    pub fn fit(&self) -> Option<Fit> {
        self.fit
    }

    /// The pair with how its blur is compensated before pixels are compared. The compensation gives the impulses, too.
    pub fn with_blur_compensation(self, compensation: impl Into<Option<BlurCompensation>>) -> Self {
        let compensation = compensation.into();
        let impulses = compensation.as_ref().map_or([0.0; 2], BlurCompensation::impulses);
        Self { compensation, ..self }.with_impulses(impulses)
    }

    /// The pair with impulses in both images that stand out by at least so much; 0: there are none.
    pub fn with_impulses(mut self, [left, right]: [f64; 2]) -> Self {
        (self.left.impulses, self.right.impulses) = (left, right);
        self
    }

    /// The pair with its values in the narrowest type that holds them: how it is matched depends on the values alone.
    pub fn packed(self, packing: &Packing) -> Self {
        let [left, right] =
            [(self.left, 0), (self.right, 1)].map(|(view, i)| packing.packed(view, i));
        Self { left, right, ..self }
    }

    /// The pair as a part of a larger one whose left and right pixels, unless they are bytes, lie in these ranges.
    pub fn with_ranges(mut self, ranges: [Option<IntensityRange>; 2]) -> Self {
        let [left, right] = ranges;
        (self.left.range, self.right.range) = (left, right);
        self
    }

    /// The pair with other disparities to search.
    pub fn searched(self, candidates: Candidates) -> Self {
        Self { candidates, ..self }
    }

    /// The pair with the negative of its right image.
    pub fn inverted(&self) -> Self {
        Self { right: self.right.inverted(), ..self.clone() }
    }

    /// The pair with the right image resampled so that its rows correspond to those of the left one.
    pub fn straightened(
        &self,
        alignment: &Alignment,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        let right = straightened(&self.right, alignment, level, control)?;
        Ok(Self { right, ..self.clone() })
    }

    /// The pair with other views of the same size and type.
    pub fn with_views(&self, [left, right]: [View; 2]) -> Self {
        Self { left, right, candidates: self.candidates, compensation: None, fit: self.fit }
    }

    /// Some rows of the images; their ranges should be known already.
    pub fn of_rows(&self, rows: Range<usize>) -> Self {
        let [left, right] = [&self.left, &self.right].map(|view| view.of_rows(rows.clone()));
        let compensation =
            self.compensation.clone().map(|compensation| compensation.below(rows.start));

        Self { left, right, candidates: self.candidates, compensation, fit: self.fit }
    }

    /// The pair with its ranges computed, so that any part of it is a part of the whole.
    pub fn with_own_ranges(self, control: &Control) -> Result<Self> {
        let range = |view: &View| intensity::intensity_range(view, control).map(Some);

        let ranges = [range(&self.left)?, range(&self.right)?];
        Ok(self.with_ranges(ranges))
    }

    /// Left and right view.
    pub fn views(&self) -> [&View; 2] {
        [&self.left, &self.right]
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// How blur is compensated before pixels are compared; `None`: not at all.
    pub fn blur_compensation(&self) -> Option<&BlurCompensation> {
        self.compensation.as_ref()
    }

    /// Rows and columns of either image.
    pub fn size(&self) -> (usize, usize) {
        let (rows, cols, _) = self.left.image.shape();
        (rows, cols)
    }
}

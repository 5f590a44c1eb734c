//! Two images in gray, the disparities to search, and the corrections that make the images comparable: one
//! size, corresponding rows, equal blur.

pub mod alignment;
pub mod blur_compensation;
pub mod candidates;
pub mod fitting;
pub mod overlay;
pub mod plan;
pub mod source;

use std::borrow::Cow;
use std::mem;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::simd::Level;
use crate::image::border::without_border;
use crate::image::conversion::Conversion;
use crate::image::impulses;
use crate::image::pixels::Input;
use crate::image::view::View;
use crate::pair::alignment::Alignment;
use crate::pair::alignment::straighten::straightened;
use crate::pair::blur_compensation::BlurCompensation;
use crate::pair::candidates::Candidates;
use crate::pair::fitting::{Fit, fitted, white};
use crate::pair::overlay::{Overlay, overlays};
use crate::pair::plan::{Bytes, Demand, Plan, Stage};

/// Two images and the disparities to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    left: View,
    right: View,
    candidates: Candidates,
    compensation: Option<BlurCompensation>,
    fit: Option<Fit>,
    borders: [f64; 2],
    overlays: Vec<Overlay>,
    is_turned: bool,
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
        // Both images with their masks, as read, and in gray; the right one once more, or twice, if it is
        // straightened.
        let copies = if demand.plan.alignment.is_some() { 4 } else { 2 };
        let gray = size_of::<i32>() + 1;
        Bytes { read: demand.cols * (2 * (demand.pixel + 1) + copies * gray), ..Bytes::default() }
    }
}

impl Pair {
    /// A pair that can be matched: views of one size, and a reachable range.
    pub fn new(left: View, right: View, min_disparity: i64, num_disparities: i64) -> Result<Self> {
        check_sizes(left.size(), right.size())?;

        let candidates = Candidates::new(min_disparity, num_disparities, left.size().1)?;
        Ok(Self {
            left,
            right,
            candidates,
            compensation: None,
            fit: None,
            borders: [0.0; 2],
            overlays: vec![],
            is_turned: false,
        })
    }

    /// A pair of images of one size and type, with valid pixels.
    pub fn of_inputs(inputs: [Input; 2], min_disparity: i64, num_disparities: i64) -> Result<Self> {
        check(inputs.each_ref())?;

        let conversions = Conversion::of_pair(inputs.each_ref());
        Self::converted(inputs, conversions, min_disparity, num_disparities)
    }

    /// A part of a pair, given how the whole is converted.
    pub fn converted(
        inputs: [Input; 2],
        [of_left, of_right]: [Conversion; 2],
        min_disparity: i64,
        num_disparities: i64,
    ) -> Result<Self> {
        let [left, right] = inputs;
        Self::new(of_left.view(left)?, of_right.view(right)?, min_disparity, num_disparities)
    }

    /// A pair of any two images: the right one is scaled to the size of the left one, and its pixels to the
    /// unit of the left ones. Black borders and overlays are masked.
    pub fn of_any([left, right]: [Input; 2], min_disparity: i64, num_disparities: i64) -> Result<Self> {
        left.check("left")?;
        right.check("right")?;

        let (left, border) = without_border(left)?;
        let (mut right, other) = without_border(right)?;
        let [of_left, of_right] = if is_same_type(&left, &right) {
            Conversion::of_pair([&left, &right])
        } else {
            right.unit = white(&left) / white(&right);
            [&left, &right].map(|input| Conversion::of_pair([input, input])[0])
        };

        let left = of_left.view(left)?;
        let (right, fit) = fitted(&left, of_right.view(right)?)?;
        let borders = [border, other];
        let pair = Self { fit, borders, ..Self::new(left, right, min_disparity, num_disparities)? };
        pair.without_overlays()
    }

    /// How the right image was scaled to the size of the left one; `None`: it already had this size.
    pub fn fit(&self) -> Option<Fit> {
        self.fit
    }

    /// The shares of the left and the right image that were masked as black borders.
    pub fn borders(&self) -> [f64; 2] {
        self.borders
    }

    /// The pair with its overlays masked.
    fn without_overlays(self) -> Result<Self> {
        let overlays = overlays(&self, &Control::default())?;
        if overlays.is_empty() {
            return Ok(self);
        }
        let [left, right] = [self.left, self.right].map(|view| {
            let mask = overlay::mask(&overlays, &view);
            view.with_mask(Some(mask))
        });
        Ok(Self { left, right, overlays, ..self })
    }

    /// The overlays of the original images, which are masked.
    pub fn overlays(&self) -> &[Overlay] {
        &self.overlays
    }

    /// The pair with this blur compensation before pixels are compared. Impulses that it specifies are
    /// repaired.
    pub fn with_blur_compensation(
        self,
        compensation: Option<BlurCompensation>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        let impulses = compensation.as_ref().map_or([0.0; 2], BlurCompensation::impulses);
        let repaired = match self.repaired(impulses, level, control)? {
            Cow::Owned(repaired) => Some(repaired),
            Cow::Borrowed(_) => None,
        };
        Ok(Self { compensation, ..repaired.unwrap_or(self) })
    }

    /// The pair without impulses of at least these heights in the left and the right image; 0: none.
    pub fn repaired(
        &self,
        [left, right]: [f64; 2],
        level: Level,
        control: &Control,
    ) -> Result<Cow<'_, Self>> {
        if left <= 0.0 && right <= 0.0 {
            return Ok(Cow::Borrowed(self));
        }

        let left = self.left.repaired(left, level, control)?.into_owned();
        let right = self.right.repaired(right, level, control)?.into_owned();
        let compensation = self.compensation.clone();
        let overlays = self.overlays.clone();
        Ok(Cow::Owned(Self { left, right, compensation, overlays, ..*self }))
    }

    /// The pair with other disparities to search.
    pub fn searched(self, candidates: Candidates) -> Self {
        Self { candidates, ..self }
    }

    /// The pair with the negative of its right image.
    pub fn inverted(&self) -> Self {
        Self { right: self.right.inverted(), ..self.clone() }
    }

    /// The pair turned by 90 degrees counterclockwise, to search these disparities along former columns:
    /// pixel (x, y) of the left image is (x, y - d) of the right one.
    pub fn turned(&self, min_disparity: i64, num_disparities: i64) -> Result<Self> {
        let candidates = Candidates::new(min_disparity, num_disparities, self.size().0)?;
        let (left, right) = (self.left.turned(), self.right.turned());
        let overlays = self.overlays.clone();
        let is_turned = true;
        Ok(Self { left, right, candidates, compensation: None, overlays, is_turned, ..*self })
    }

    /// The pair with the right image resampled so that its rows correspond to those of the left one.
    pub fn straightened(self, alignment: &Alignment, level: Level, control: &Control) -> Result<Self> {
        let right = straightened(&self.right, alignment, level, control)?;
        Ok(Self { right, ..self })
    }

    /// The pair with other views of the same size.
    pub fn with_views(&self, [left, right]: [View; 2]) -> Self {
        Self { left, right, compensation: None, overlays: self.overlays.clone(), ..*self }
    }

    /// Some rows of the images.
    pub fn of_rows(&self, rows: Range<usize>) -> Self {
        let [left, right] = [&self.left, &self.right].map(|view| view.of_rows(rows.clone()));
        let compensation = self.compensation.clone().map(|compensation| compensation.below(rows.start));

        Self { left, right, compensation, overlays: self.overlays.clone(), ..*self }
    }

    /// Left and right view.
    pub fn views(&self) -> [&View; 2] {
        [&self.left, &self.right]
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// Whether rows and columns are exchanged, so that former columns are searched.
    pub fn is_turned(&self) -> bool {
        self.is_turned
    }

    /// How blur is compensated before pixels are compared; `None`: not at all.
    pub fn blur_compensation(&self) -> Option<&BlurCompensation> {
        self.compensation.as_ref()
    }

    /// Rows and columns of either image.
    pub fn size(&self) -> (usize, usize) {
        self.left.size()
    }
}

/// Refuses images of two sizes or types, and those with faulty pixels.
pub fn check([left, right]: [&Input; 2]) -> Result<()> {
    left.check("left")?;
    right.check("right")?;
    check_sizes(left.size(), right.size())?;

    if is_same_type(left, right) {
        return Ok(());
    }
    Err(Error::value("right", "pixels of another type", "the type of left"))
}

fn check_sizes((rows, cols): (usize, usize), right: (usize, usize)) -> Result<()> {
    if (rows, cols) == right {
        return Ok(());
    }

    let got = format!("{} x {} pixels", right.0, right.1);
    Err(Error::value("right", got, format!("the size of left, {rows} x {cols}")))
}

/// Whether the pixels of both images have the same type.
pub fn is_same_type(left: &Input, right: &Input) -> bool {
    mem::discriminant(&left.image) == mem::discriminant(&right.image)
}

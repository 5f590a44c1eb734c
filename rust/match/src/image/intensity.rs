//! Gray values of an image, for the phase codes, and gray levels of a pair, for SAD.
//!
//! All arithmetic after [`crate::image::conversion`] is exact, so results do not depend on how the work is
//! cut into bands. Scaling an image scales all spectral components by the same factor and changes no code.

use std::borrow::Cow;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::image::view::View;

/// Largest magnitude of a gray value: sums of products with it are exact in double precision.
pub const LARGEST_REACH: u32 = 1 << 25;
/// Fixed-point steps per gray level of a plane of levels, where black to white is 255 gray levels.
pub const LEVEL_STEPS: u16 = 16;
/// Black to white in steps of a plane of levels.
const LEVEL_RANGE: f64 = 255.0 * LEVEL_STEPS as f64;
/// Black in a plane of levels, above 0: float images may have pixels darker than the black of their robust
/// range.
const LEVEL_BLACK: f64 = LEVEL_RANGE;
/// Largest value of a plane of levels.
pub const LEVEL_CEILING: u16 = 3 * 255 * LEVEL_STEPS;

/// The gray values that phase codes are computed from. Each image may have its own scale, since codes compare
/// directions, not lengths.
#[derive(Debug)]
pub struct Gray<'a> {
    plane: Cow<'a, Plane<i32>>,
    reach: u32,
    /// Steps per unit of the caller's pixels, as the product of two, since it may overflow.
    unit: [f64; 2],
}

impl<'a> Gray<'a> {
    /// The gray values of a view.
    pub fn of_view(view: &'a View) -> Self {
        let scale = view.scale();
        Self { plane: Cow::Borrowed(view.gray()), reach: scale.reach(), unit: scale.factors() }
    }

    /// All gray values.
    pub fn plane(&self) -> &Plane<i32> {
        &self.plane
    }

    /// Gray values of magnitude up to `reach`, at most [`LARGEST_REACH`], with one step to a unit.
    pub fn within(reach: u32, plane: Plane<i32>) -> Self {
        debug_assert!(reach <= LARGEST_REACH);

        Self { plane: Cow::Owned(plane), reach, unit: [1.0, 1.0] }
    }

    /// These gray values after processing, in other steps, with magnitudes up to `reach`.
    pub fn scaled(&self, reach: u32, plane: Plane<i32>) -> Gray<'static> {
        let [unit, rest] = self.unit;
        let unit = [unit * (f64::from(reach) / f64::from(self.reach)), rest];

        Gray { unit, ..Gray::within(reach, plane) }
    }

    /// Other gray values on the same scale.
    pub fn like(&self, plane: Plane<i32>) -> Gray<'static> {
        Gray { unit: self.unit, ..Gray::within(self.reach, plane) }
    }

    /// Steps of this image per step of another.
    pub fn steps_to(&self, other: &Self) -> f64 {
        let [a, b] = [0, 1].map(|i| self.unit[i] / other.unit[i]);
        a * b
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.plane.rows(), self.plane.cols())
    }

    /// The largest magnitude that gray values may have.
    pub fn reach(&self) -> u32 {
        self.reach
    }

    /// A difference in intensity, in steps.
    pub fn steps(&self, difference: f64) -> f64 {
        difference * self.unit[0] * self.unit[1]
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &[i32] {
        self.plane.row(y)
    }
}

/// The gray levels of both images, for SAD, in steps of `1 / LEVEL_STEPS` above `LEVEL_BLACK`. `given` is the
/// user's intensity range, in units of the caller's pixels; without it, the union of those of both images.
pub fn level_planes(
    views: [&View; 2],
    given: Option<(f64, f64)>,
    control: &Control,
) -> Result<[Plane<u16>; 2]> {
    let ends = |view: &View| view.scale().range().map(|end| view.scale().pixel(end.into()));
    let [[a, b], [c, d]] = views.map(ends);
    let (black, white) = given.unwrap_or((a.min(c), b.max(d)));

    let levels = |view: &View| {
        let [black, white] = [black, white].map(|pixel| view.scale().gray(pixel));
        // A pair of constant images has a range of zero width; any step will do.
        let step = if white > black { (white - black) / LEVEL_RANGE } else { 1.0 };
        let level = |gray: i32| ((f64::from(gray) - black) / step).round() + LEVEL_BLACK;
        Plane::by_rows(view.size(), control, |y, row: &mut [u16]| {
            for (row, gray) in row.iter_mut().zip(view.gray().row(y)) {
                *row = level(*gray).clamp(0.0, f64::from(LEVEL_CEILING)) as u16;
            }
        })
    };

    Ok([levels(views[0])?, levels(views[1])?])
}

//! The field of vertical offsets between the images of a pair, and the right image resampled so that its rows
//! correspond.
//!
//! In a pair that is not quite rectified, a point in left row `y` lies at `y + v` in the right image. The
//! field `v(x, y)`, of the column `x` in the right image and the row `y` of the left one, is smooth: a shift,
//! a rotation and a difference in focal length make it linear; keystone and the rest of lens distortion add
//! terms up to the third degree. It does not depend on depth as long as the baseline is level. A shaking
//! rolling shutter adds a component shared by all columns of a row, a spline of the row ([`sway`]). The
//! straightened right image is
//!
//! ```text
//! straightened(x, y) = right(x, y + v(x, y))
//! ```
//!
//! The estimation of the field is described in the crate `phasestereo`, `estimation::rows`.

pub mod straighten;
pub mod sway;

use std::array::from_fn;

use self::sway::KNOTS;
use crate::base::error::{Error, Result};
use crate::image::impulses;
use crate::image::resampling::TAPS;

/// Terms of the field.
pub const TERMS: usize = 8;
/// Terms of a linear field.
pub const LINEAR: usize = 3;
/// The first term that only lens distortion has.
pub const CUBIC: usize = 6;
/// Places along each axis over which averages of a field are taken.
const SAMPLES: usize = 20;
/// Largest vertical offset there can be, pixels.
pub const LARGEST_OFFSET: f64 = 16_384.0;

/// A field of vertical offsets over an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    coefficients: [f64; TERMS],
    /// The factors of the spline of the row; zero without one.
    sway: [f64; KNOTS],
    size: (usize, usize),
    /// The row of the image with the field that is the first row of this pair.
    first: usize,
}

impl Alignment {
    /// The field with these coefficients of [`terms`], pixels, over an image of this many rows and columns.
    pub fn new(coefficients: [f64; TERMS], size: (usize, usize)) -> Result<Self> {
        check("coefficients", &coefficients)?;
        Ok(Self { coefficients, sway: [0.0; KNOTS], size, first: 0 })
    }

    /// The field with a spline of the row that has these factors, pixels.
    pub fn with_sway(self, sway: [f64; KNOTS]) -> Result<Self> {
        check("factors of a spline", &sway)?;
        Ok(Self { sway, ..self })
    }

    /// The field without the spline of the row.
    pub fn without_sway(self) -> Self {
        Self { sway: [0.0; KNOTS], ..self }
    }

    /// The difference of two fields of the same images.
    pub fn less(&self, other: &Self) -> Self {
        Self {
            coefficients: from_fn(|term| self.coefficients[term] - other.coefficients[term]),
            sway: from_fn(|knot| self.sway[knot] - other.sway[knot]),
            ..self.clone()
        }
    }

    /// The field for a pair that begins at row `first` of the one with the field.
    pub fn starting_at_row(self, first: usize) -> Self {
        Self { first, ..self }
    }

    /// The coefficients of [`terms`], pixels.
    pub fn coefficients(&self) -> &[f64; TERMS] {
        &self.coefficients
    }

    /// The factors of the spline of the row, pixels, if there is one.
    pub fn sway(&self) -> Option<&[f64; KNOTS]> {
        self.sway.iter().any(|factor| *factor != 0.0).then_some(&self.sway)
    }

    /// The largest magnitude of the spline of the row, pixels, ignoring its first and last interval, where
    /// few blocks determine it.
    pub fn largest_sway(&self) -> f64 {
        let margin = self.size.0.div_ceil(sway::INTERVALS);
        let offset = |row| sway::at(&self.sway, (row as f64 + 0.5) / self.size.0 as f64).abs();
        (margin..self.size.0.saturating_sub(margin)).map(offset).fold(0.0, f64::max)
    }

    /// Rows and columns of the image with the field.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The offset of right column `x` at left row `y` of this pair, pixels: positive if the right image shows
    /// the same point lower.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        self.along(y).at(x)
    }

    /// The offsets along left row `y` of this pair.
    pub fn along(&self, y: f64) -> RowPolynomial {
        let (rows, cols) = self.size;
        let sway = sway::at(&self.sway, (y + self.first as f64 + 0.5) / rows as f64);
        let y = (y + self.first as f64 + 0.5) / (rows as f64 / 2.0) - 1.0;

        // The terms as powers of x, with coefficients that are polynomials of y.
        let [shift, slope_x, slope_y, twist, bend_x, bend_y, radial_y, radial_x] = self.coefficients;
        let powers = [
            shift + y * (slope_y + y * (bend_y + y * radial_y)) + sway,
            slope_x + y * (twist + y * radial_x),
            bend_x + y * radial_y,
            radial_x,
        ];

        RowPolynomial { powers, half: cols as f64 / 2.0 }
    }

    /// The offset at a place, given as -1 to 1 along both axes.
    fn at_fraction(&self, x: f64, y: f64) -> f64 {
        let smooth: f64 = self.coefficients.iter().zip(terms(x, y)).map(|(a, b)| a * b).sum();
        smooth + sway::at(&self.sway, 0.5 * (y + 1.0))
    }

    /// Root mean square of the offsets over the image, pixels.
    pub fn rms(&self) -> f64 {
        let squares: f64 = places().map(|(x, y)| self.at_fraction(x, y).powi(2)).sum();
        (squares / (SAMPLES * SAMPLES) as f64).sqrt()
    }

    /// An upper bound of the magnitude of the offsets, pixels.
    pub fn bound(&self) -> f64 {
        // No term exceeds 1, except those of the third degree, which are at most 2.
        let [.., y3, x3] = self.coefficients;
        let smooth: f64 = self.coefficients.iter().map(|value| value.abs()).sum();
        let sway = self.sway.iter().fold(0.0f64, |most, factor| most.max(factor.abs()));
        smooth + y3.abs() + x3.abs() + sway
    }

    /// The rows of the right image on either side of one that its straightened row depends on; masked ones
    /// are filled from others.
    pub fn halo(&self) -> usize {
        self.bound().ceil() as usize + TAPS / 2 + TAPS + impulses::REACH
    }
}

/// Refuses numbers that are not finite, or that make offsets too large.
fn check(what: &str, values: &[f64]) -> Result<()> {
    let most: f64 = values.iter().map(|value| value.abs()).sum();
    // The range does not contain NaN, so this refuses it, too.
    if !(0.0..=LARGEST_OFFSET).contains(&most) {
        let accepts = format!("finite {what} of sum up to {LARGEST_OFFSET}");
        return Err(Error::value("alignment", format!("{values:?}"), accepts));
    }

    Ok(())
}

/// The offsets along a row: a polynomial of the column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowPolynomial {
    /// Coefficients of the powers of the column, which runs from -1 to 1.
    powers: [f64; 4],
    /// Half of the number of columns.
    half: f64,
}

impl RowPolynomial {
    /// The offset of right column `x`, pixels.
    #[inline(always)]
    pub fn at(self, x: f64) -> f64 {
        let x = (x + 0.5) / self.half - 1.0;

        let [constant, linear, square, cube] = self.powers;
        constant + x * (linear + x * (square + x * cube))
    }
}

/// The terms of a field at a place, given as -1 to 1 along both axes: shift, the two slopes, then those of
/// keystone (`x y`, `x^2`, `y^2`) and of distortion (`y r^2`, `x r^2`).
pub fn terms(x: f64, y: f64) -> [f64; TERMS] {
    let square = x * x + y * y;
    [1.0, x, y, x * y, x * x, y * y, y * square, x * square]
}

/// Places all over an image, from -1 to 1 along both axes.
pub fn places() -> impl Iterator<Item = (f64, f64)> {
    let place = |index: usize| 2.0 * (index as f64 + 0.5) / SAMPLES as f64 - 1.0;
    (0..SAMPLES * SAMPLES).map(move |i| (place(i % SAMPLES), place(i / SAMPLES)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_linear_about_the_center() {
        let field = Alignment::new([1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 0.0, 0.0], (100, 200));
        let field = field.expect("legal");
        assert!((field.at(99.5, 49.5) - 1.0).abs() < 1e-12);
        assert!((field.at(199.5, 49.5) - 3.0).abs() < 1e-12);
        assert!((field.at(99.5, 99.5) + 2.0).abs() < 1e-12);
        assert!((field.rms() - (1.0f64 + 13.0 / 3.0 * 0.9975).sqrt()).abs() < 1e-3);
        assert!(field.bound() >= 6.0);

        let field = Alignment::new([1.0, -2.0, 3.0, 0.5, 0.25, -1.5, 0.75, 2.5], (100, 200));
        let field = field.expect("legal");

        let (x, y) = (31.0, 77.0);
        let exact = field.at_fraction((x + 0.5) / 100.0 - 1.0, (y + 0.5) / 50.0 - 1.0);
        assert!((field.at(x, y) - exact).abs() < 1e-12);

        let field = field.with_sway(from_fn(|knot| [0.3, -0.9, 2.0][knot % 3])).expect("legal");
        assert!((field.clone().starting_at_row(30).at(5.0, 7.0) - field.at(5.0, 37.0)).abs() < 1e-12);
    }

    #[test]
    fn a_field_that_sways_lies_within_its_bound() {
        let smooth = Alignment::new([1.0; TERMS], (90, 100)).expect("legal");
        let field = smooth.clone().with_sway(from_fn(|knot| 2.0 - knot as f64 % 5.0));
        let field = field.expect("legal");

        let most = (0..90).map(|y| field.at(99.0, f64::from(y))).fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(most <= field.bound() && field.halo() >= smooth.halo() + 2);
        assert!(field.less(&field).rms() < 1e-12 && field.less(&smooth).rms() > 0.5);
        assert!(field.less(&smooth).largest_sway() <= 2.0);
        assert_eq!(field.without_sway(), smooth);
    }

    #[test]
    fn illegal_fields_are_refused() {
        for value in [f64::NAN, f64::INFINITY, 1e6] {
            let mut coefficients = [0.0; TERMS];
            coefficients[3] = value;
            let refused = Alignment::new(coefficients, (10, 10)).expect_err("must be refused");
            assert!(refused.to_string().starts_with("alignment: got"));

            let field = Alignment::new([0.0; TERMS], (10, 10)).expect("legal");
            let refused = field.with_sway([value; KNOTS]).expect_err("must be refused");
            assert!(refused.to_string().starts_with("alignment: got"));
        }
    }
}

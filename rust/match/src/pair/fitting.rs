//! Brings the views of a pair together: the right one to the size of the left one, and both to one unit.
//!
//! ```text
//! scale = left size / right size, along x and along y    # if both have one shape: only resolution differs;
//!         a whole factor, from the first pixel on, where the size was rounded up
//!       = 1, or the ratio of the widths, along both      # else: the right one is centered over the left one
//! place(x) = (x + 0.5 - offset) / scale - 0.5;   offset = (left size - scale * right size) / 2
//! out(x) = resampled by the kernel of crate::image::resampling, where s = max(1, 1 / scale)
//! valid if all pixels within s / 2 of the place are
//! ```
//!
//! Pixels of two types are in units of the left ones:
//!
//! ```text
//! white = 255 for bytes; 1 for floats up to 1; else the least of 255, 1023, 4095, 16383, 65535 that no pixel
//!         exceeds, as in cameras of 8 to 16 bits, or the largest pixel
//! right = right * left white / right white
//! ```
//!
//! Phase codes do not need this scale, but noise is compared between the images.

use crate::base::error::{Error, Result};
use crate::base::plane::Plane;
use crate::image::masking::Mask;
use crate::image::pixels::{Image, Input, Resampler};
use crate::image::resampling::{LanczosTaps, TAPS, resized};
use crate::image::view::View;

/// Largest ratio of the rows or columns of the two images.
const LARGEST_RATIO: f64 = 8.0;
/// Images of other shapes whose sides differ by less are taken as cut from one of the same resolution.
const CUT: f64 = 1.25;
/// The white of 8, 10, 12, 14 and 16 bits.
const WHITES: [f64; 5] = [255.0, 1023.0, 4095.0, 16383.0, 65535.0];

/// How a right image of another size lies over the left one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Rows and columns of the original right image.
    pub from: (usize, usize),
    /// Rows and columns of the left image.
    pub to: (usize, usize),
    /// Whether both have the same shape.
    pub is_alike: bool,
    /// Left rows and columns per row and column of the right image.
    pub scale: [f64; 2],
    /// Left rows and columns before its first one.
    offset: [f64; 2],
}

/// Both views at the size of the left one, and how the right one was fitted; `None`: it already has this
/// size.
pub fn fitted(left: &View, right: View) -> Result<(View, Option<Fit>)> {
    if right.size() == left.size() {
        return Ok((right, None));
    }

    let fit = Fit::new(right.size(), left.size())?;
    Ok((fit.apply(&right)?, Some(fit)))
}

impl Fit {
    /// How a right image of these rows and columns lies over a left one.
    #[expect(clippy::float_cmp, reason = "whole numbers are exact")]
    pub fn new(from: (usize, usize), to: (usize, usize)) -> Result<Self> {
        let ratios = [to.0 as f64 / from.0 as f64, to.1 as f64 / from.1 as f64];
        if ratios.iter().any(|ratio| ratio.max(1.0 / ratio) > LARGEST_RATIO) {
            let got = format!("{} x {} pixels", from.0, from.1);
            let accepts = format!(
                "up to {LARGEST_RATIO} times as many or as few rows and columns as left's {} x {}",
                to.0, to.1
            );
            return Err(Error::value("right", got, accepts));
        }

        // Sizes of reduced images are rounded, by up to a pixel.
        let [down, along] = ratios;
        let off = (to.0 as f64 - along * from.0 as f64).abs();
        let is_alike = off <= down.max(along).max(1.0);
        let is_cut = ratios.iter().all(|ratio| ratio.max(1.0 / ratio) < CUT);
        let scale = match (is_alike, is_cut) {
            (true, _) => ratios,
            (false, true) => [1.0; 2],
            (false, false) => [along; 2],
        };
        let centered = |to: usize, from: usize, scale: f64| (to as f64 - scale * from as f64) / 2.0;
        let offset = [centered(to.0, from.0, scale[0]), centered(to.1, from.1, scale[1])];
        let fit = Self { from, to, is_alike, scale, offset };

        // Sizes are rounded up where the last row or column is padded, not where an image is squeezed.
        let factor = whole(along);
        let (larger, smaller, by) =
            if factor < 1.0 { (from, to, factor.recip()) } else { (to, from, factor) };
        let is_rounded = |small: usize, large: usize| {
            let beyond = small as f64 * by - large as f64;
            if by == 1.0 { beyond.abs() <= 1.0 } else { (0.0..by).contains(&beyond) }
        };
        let is_exact = is_rounded(smaller.0, larger.0) && is_rounded(smaller.1, larger.1);
        Ok(if is_alike && is_exact { fit.scaled_by(factor) } else { fit })
    }

    /// The fit of an image that was reduced or enlarged by an exact factor, aligned at its first row and
    /// column.
    fn scaled_by(&self, factor: f64) -> Self {
        Self { scale: [factor; 2], offset: [0.0; 2], ..*self }
    }

    /// The taps of all pixels along rows (0) or columns (1).
    fn taps(&self, axis: usize) -> Vec<LanczosTaps> {
        let (from, to) = ([self.from.0, self.from.1][axis], [self.to.0, self.to.1][axis]);
        let scale = self.scale[axis];
        let offset = self.offset[axis];

        let place = |at: usize| (at as f64 + 0.5 - offset) / scale - 0.5;
        (0..to).map(|at| LanczosTaps::new(place(at), scale.recip().max(1.0), from)).collect()
    }

    /// The view at the new size.
    fn apply(&self, view: &View) -> Result<View> {
        // Masked pixels must not spread.
        let source = view.filled_along_columns(TAPS);
        let scale = view.scale();
        let shape = (self.from.0, self.from.1, 1);
        let gray = self.resampled(&source, shape, |gray| scale.nearest(gray))?;
        let gray = Plane::from_vec(self.to.0, self.to.1, gray)?;

        let mask = self.mask(view.mask());
        Ok(View::new(gray, mask, scale))
    }

    /// The mask at the new size, from the one before; `None`: all valid.
    fn mask(&self, valid: Option<&Mask>) -> Option<Mask> {
        let taps = [self.taps(0), self.taps(1)];
        let [down, along] = &taps;
        let is_valid = |y: usize, x: usize| {
            let (rows, cols) = (down[y].core.clone(), along[x].core.clone());
            let is_inside = !rows.is_empty() && !cols.is_empty();
            is_inside
                && valid.is_none_or(|valid| {
                    rows.into_iter().all(|y| valid.row(y)[cols.clone()].iter().all(|is| *is))
                })
        };
        let is_covered = valid.is_none() && taps.iter().flatten().all(|t| !t.core.is_empty());
        (!is_covered).then(|| Plane::from_fn(self.to.0, self.to.1, is_valid))
    }

    /// The matrix that maps columns and rows of the right image to those at the new size.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        let along = |axis: usize| {
            let (scale, offset) = (self.scale[axis], self.offset[axis]);
            (scale, 0.5 * scale + offset - 0.5)
        };
        let ((down, top), (across, left)) = (along(0), along(1));
        [[across, 0.0, left], [0.0, down, top], [0.0, 0.0, 1.0]]
    }
}

impl Resampler for Fit {
    fn size(&self) -> (usize, usize) {
        self.to
    }

    fn resampled<T: Copy + Default + Send + Sync + Into<f64>>(
        &self,
        pixels: &[T],
        (_, cols, channels): (usize, usize, usize),
        nearest: impl Fn(f64) -> T + Sync,
    ) -> Result<Vec<T>> {
        resized(pixels, (cols, channels), &[self.taps(0), self.taps(1)], nearest)
    }
}

/// The right image of any type, with its valid pixels, at the size of the left one, and the matrix that maps
/// its columns and rows there.
pub fn resized_right([left, right]: [&Input; 2]) -> Result<(Input, [[f64; 3]; 3])> {
    let fit = Fit::new(right.size(), left.size())?;
    let resized = right.resampled(&fit, fit.mask(right.mask.as_ref()))?;
    Ok((resized, fit.matrix()))
}

/// The nearest whole number or its reciprocal.
fn whole(ratio: f64) -> f64 {
    if ratio < 1.0 { ratio.recip().round().recip() } else { ratio.round() }
}

/// White in units of an image's pixels.
pub fn white(input: &Input) -> f64 {
    if matches!(input.image, Image::U8(_)) {
        return WHITES[0];
    }

    let most = input.largest();
    let is_fraction = !matches!(input.image, Image::U16(_)) && most <= 1.0;
    let white = WHITES.into_iter().find(|white| most <= *white);
    if is_fraction { 1.0 } else { white.unwrap_or(most) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math;
    use crate::image::conversion::view_of_input;
    use crate::pair::Pair;
    use ndarray::Array3;

    fn view(image: Image) -> View {
        view_of_input(image.into()).expect("memory")
    }

    fn pixel(view: &View, y: usize, x: usize) -> f64 {
        view.scale().pixel(view.gray().row(y)[x].into())
    }

    fn wave(rows: usize, cols: usize, by: f64) -> Image {
        let value = |(y, x, _): (usize, usize, usize)| {
            let [u, v] = [x, y].map(|at| (at as f64 + 0.5) * by);
            100.0 + 50.0 * math::sin(0.09 * u + 0.05 * v)
        };
        Image::F64(Array3::from_shape_fn((rows, cols, 1), value))
    }

    #[test]
    fn an_image_of_another_resolution_shows_the_same_at_the_same_place() {
        let left = view(wave(90, 120, 1.0));
        for by in [0.5, 0.75, 1.25, 1.5, 2.0, 3.0] {
            let right = wave((90.0 / by) as usize, (120.0 / by) as usize, by);
            let (right, fit) = fitted(&left, view(right)).expect("fits");
            assert!(fit.is_some_and(|fit| fit.is_alike));

            for (y, x) in (15..75).flat_map(|y| (15..105).map(move |x| (y, x))) {
                let off = (pixel(&left, y, x) - pixel(&right, y, x)).abs();
                assert!(off < 0.3, "{off} at {y} {x} by {by}");
            }
        }
    }

    #[test]
    #[expect(clippy::float_cmp, reason = "the same values are meant, to the bit")]
    fn sizes_say_how_they_were_rounded() {
        let of = |from, to| Fit::new(from, to).expect("legal").scale;
        assert_eq!(of((50, 62), (100, 123)), [2.0; 2]);
        assert_eq!(of((50, 61), (100, 123)), [2.0, 123.0 / 61.0]);
        assert_eq!(of((100, 122), (100, 123)), [1.0; 2]);
        assert_eq!(of((199, 247), (100, 124)), [0.5; 2]);
        assert_eq!(of((600, 800), (480, 640)), [0.8; 2]);
        assert_eq!(of((720, 960), (480, 640)), [2.0 / 3.0; 2]);
    }

    #[test]
    fn what_a_cut_out_does_not_show_is_masked_and_masks_follow() {
        let ones = |rows, cols| Image::U8(Array3::from_elem((rows, cols, 1), 200));
        let left = view(ones(100, 100));
        let (right, fit) = fitted(&left, view(ones(100, 90))).expect("fits");
        assert_eq!(fit.map(|fit| (fit.is_alike, fit.scale)), Some((false, [1.0; 2])));
        let mask = right.mask().expect("columns are missing");
        assert_eq!(mask.row(50).iter().filter(|valid| !**valid).count(), 10);
        assert!(mask.row(50)[5] && !mask.row(50)[4]);

        let mut pixels = Array3::from_elem((50, 50, 1), 7.0f32);
        pixels[(20, 30, 0)] = f32::NAN;
        let mask = Plane::from_fn(50, 50, |y, x| (y, x) != (20, 30));
        let right = Input { mask: Some(mask), ..Image::F32(pixels).into() };
        let (right, _) = fitted(&left, view_of_input(right).expect("memory")).expect("fits");
        assert!((0..100).all(|at| (pixel(&right, at, 99 - at) - 7.0).abs() < 1e-6));
        let mask = right.mask().expect("there was one");
        assert!(!mask.row(40)[61] && mask.row(38)[61] && mask.row(40)[63]);
    }

    #[test]
    fn images_of_two_types_are_in_units_of_the_left_one() {
        let bytes = Array3::from_shape_fn((16, 16, 1), |(y, x, _)| (16 * y + x) as u8);
        let others = [
            Image::U16(bytes.mapv(|byte| 257 * u16::from(byte))),
            Image::F32(bytes.mapv(|byte| f32::from(byte) / 255.0)),
            Image::F64(bytes.mapv(f64::from)),
        ];
        for other in others {
            let inputs = [Image::U8(bytes.clone()), other].map(Input::from);
            let pair = Pair::of_any(inputs, 0, 1).expect("of one size");
            assert!(pair.fit().is_none());
            let [left, right] = pair.views();
            assert_eq!(left.gray(), right.gray());
            for view in [left, right] {
                let same = |((y, x, _), byte): ((usize, usize, usize), &u8)| {
                    (pixel(view, y, x) - f64::from(*byte)).abs() < 1e-4
                };
                assert!(bytes.indexed_iter().all(same));
                assert!((view.scale().level() - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn sizes_that_no_pair_has_are_refused() {
        let image = |rows| view(Image::U8(Array3::zeros((rows, 90, 1))));
        let refused = fitted(&image(90), image(11)).expect_err("too few rows").to_string();
        assert!(refused.starts_with("right: got 11 x 90 pixels; accepts up to 8 times"), "{refused}");
    }
}

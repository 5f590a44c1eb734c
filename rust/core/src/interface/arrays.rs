//! Images from views of arrays, with any strides; part of the feature `ndarray`.

use ndarray::{ArrayView2, ArrayView3, Axis};

use super::image::{Image, Pixel};
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::zeroed;

/// A gray image: a copy of an array of rows and columns.
///
/// ```
/// use ndarray::{Array2, s};
///
/// let frame = Array2::<u16>::zeros((480, 1280)); // left and right image beside each other
/// let left = phasestereo::Image::try_from(frame.slice(s![.., ..640]))?;
/// let upside_down = phasestereo::Image::try_from(frame.slice(s![..;-1, 640..]))?;
/// # Ok::<(), phasestereo::Error>(())
/// ```
impl<T: Pixel> TryFrom<ArrayView2<'_, T>> for Image {
    type Error = Error;

    fn try_from(pixels: ArrayView2<'_, T>) -> Result<Self> {
        Self::try_from(pixels.insert_axis(Axis(2)))
    }
}

/// A gray or color image: a copy of an array of rows, columns and channels (1 or 3).
impl<T: Pixel> TryFrom<ArrayView3<'_, T>> for Image {
    type Error = Error;

    fn try_from(pixels: ArrayView3<'_, T>) -> Result<Self> {
        let (rows, cols, _) = pixels.dim();
        let mut copy = zeroed(pixels.len())?;
        for (copy, value) in copy.iter_mut().zip(&pixels) {
            *copy = *value;
        }
        Self::from_vec(copy, (rows, cols))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, s};

    #[test]
    fn views_with_any_strides_are_copied_in_their_order() {
        let all = Array3::from_shape_fn((4, 6, 3), |(y, x, c)| (100 * y + 10 * x + c) as u16);
        let view = all.slice(s![..;-2, 1..;2, ..;-1]);
        let expected: Vec<u16> = view.iter().copied().collect();
        let image = Image::try_from(view).expect("an image");
        assert_eq!(image.pixels::<u16>(), Some(&expected[..]));
        assert_eq!((image.valid().rows(), image.valid().cols()), (2, 3));

        let gray = Image::try_from(all.slice(s![.., .., 1])).expect("an image");
        assert_eq!(gray.pixels::<u16>().map(<[u16]>::len), Some(24));
        let refused = Image::try_from(all.slice(s![.., .., ..2])).expect_err("two channels");
        assert_eq!(
            refused.to_string(),
            "pixels: got 48 values; accepts 1 or 3 for each of 4 x 6 pixels, one at least"
        );
    }
}

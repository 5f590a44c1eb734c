//! Images in the caller's form: slices of pixels.

use ndarray::{Array3, Axis};

use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::{Plane, zeroed};
use phasestereo_match::image::pixels::{self, Input};

/// A gray or color image, some pixels of which may be masked.
#[derive(Debug, Clone, PartialEq)]
pub struct Image(Input);

mod sealed {
    pub trait Sealed: Sized {
        fn image(pixels: ndarray::Array3<Self>) -> phasestereo_match::image::pixels::Image;
        fn pixels(image: &phasestereo_match::image::pixels::Image) -> Option<&[Self]>;
    }
}

/// The types of a pixel's channel: `u8`, `u16`, `f32` and `f64`.
pub trait Pixel: sealed::Sealed + Copy + Default {}

macro_rules! pixels {
    ($($kind:ty: $variant:ident),*) => {
        $(impl sealed::Sealed for $kind {
            fn image(pixels: Array3<Self>) -> pixels::Image {
                pixels::Image::$variant(pixels)
            }

            fn pixels(image: &pixels::Image) -> Option<&[Self]> {
                if let pixels::Image::$variant(pixels) = image { pixels.as_slice() } else { None }
            }
        }

        impl Pixel for $kind {})*
    };
}

pixels!(u8: U8, u16: U16, f32: F32, f64: F64);

impl Image {
    /// A copy of the pixels of an image with this many rows and columns, row after row: one value each, or
    /// three (red, green and blue).
    pub fn from_slice<T: Pixel>(pixels: &[T], size: (usize, usize)) -> Result<Self> {
        let mut copy = zeroed(pixels.len())?;
        copy.copy_from_slice(pixels);

        Self::from_vec(copy, size)
    }

    /// Like [`Self::from_slice`], without a copy.
    pub fn from_vec<T: Pixel>(pixels: Vec<T>, (rows, cols): (usize, usize)) -> Result<Self> {
        let refused = |count: usize| {
            let accepts = format!("1 or 3 for each of {rows} x {cols} pixels, one at least");
            Error::value("pixels", format!("{count} values"), accepts)
        };

        let count = pixels.len();
        let channels = match rows.checked_mul(cols) {
            Some(all) if all > 0 && count == all => 1,
            Some(all) if all > 0 && all.checked_mul(3) == Some(count) => 3,
            _ => return Err(refused(count)),
        };

        let pixels = Array3::from_shape_vec((rows, cols, channels), pixels);
        Ok(Self(Input::from(T::image(pixels.map_err(|_| refused(count))?))))
    }

    /// The image with only these pixels valid, row after row, out of those that are already valid.
    pub fn with_mask(self, valid: &[bool]) -> Result<Self> {
        let (rows, cols) = self.0.size();
        let mut mask = zeroed(valid.len())?;
        mask.copy_from_slice(valid);

        let mut mask = Plane::from_vec(rows, cols, mask).map_err(|error| error.about("mask"))?;
        if let Some(before) = &self.0.mask {
            let both = mask.as_mut_slice().iter_mut().zip(before.as_slice());
            both.for_each(|(valid, before)| *valid &= before);
        }
        Ok(Self(Input { mask: Some(mask), ..self.0 }))
    }

    /// The image with only these opaque pixels, row after row; the others are masked. If none is opaque, all
    /// stay valid, since a fourth channel of zeros may only be padding.
    pub fn with_alpha(self, opaque: &[bool]) -> Result<Self> {
        if opaque.contains(&true) && opaque.contains(&false) { self.with_mask(opaque) } else { Ok(self) }
    }

    /// The pixels, row after row, one value each or three; `None`: they have another type.
    pub fn pixels<T: Pixel>(&self) -> Option<&[T]> {
        T::pixels(&self.0.image)
    }

    /// Which pixels are valid.
    pub fn valid(&self) -> Plane<bool> {
        let (rows, cols) = self.0.size();
        Plane::from_fn(rows, cols, |y, x| self.0.is_valid(y, x))
    }

    /// The image with its rows or columns in reverse order.
    pub(crate) fn reversed(&self, axis: Axis) -> Self {
        Self(self.0.reversed(axis))
    }

    pub(crate) fn into_input(self) -> Input {
        self.0
    }

    pub(crate) fn of_input(input: Input) -> Self {
        Self(input)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_values_gives_the_channels() {
        for (count, channels) in [(6, Some(1)), (18, Some(3)), (0, None), (5, None), (12, None)] {
            let image = Image::from_slice(&vec![0u8; count], (2, 3));
            let shape = image.map(|image| image.0.image.shape());
            assert_eq!(shape.ok(), channels.map(|channels| (2, 3, channels)));
        }

        assert!(Image::from_vec(Vec::<f32>::new(), (0, 3)).is_err());
        let gray = Image::from_vec(vec![0u16; 6], (2, 3)).expect("an image");
        let refused = gray.with_mask(&[true; 5]).expect_err("must be refused").to_string();
        assert_eq!(refused, "mask: got 5 values; accepts 2 x 3");
    }
}

//! Images decoded by the crate `image`; part of the feature of this name.

use image::DynamicImage;

use super::image::{Image, Pixel};
use phasestereo_match::base::error::{Error, Result};

/// Gray and color images of 8 and 16 bits and of floats. Alpha has the meaning of [`Image::with_alpha`].
impl TryFrom<DynamicImage> for Image {
    type Error = Error;

    fn try_from(image: DynamicImage) -> Result<Self> {
        let size = (image.height() as usize, image.width() as usize);
        match image {
            DynamicImage::ImageLuma8(image) => Self::from_vec(image.into_raw(), size),
            DynamicImage::ImageLuma16(image) => Self::from_vec(image.into_raw(), size),
            DynamicImage::ImageRgb8(image) => Self::from_vec(image.into_raw(), size),
            DynamicImage::ImageRgb16(image) => Self::from_vec(image.into_raw(), size),
            DynamicImage::ImageRgb32F(image) => Self::from_vec(image.into_raw(), size),
            DynamicImage::ImageLumaA8(image) => with_alpha::<u8, 2>(image.as_raw(), size),
            DynamicImage::ImageLumaA16(image) => with_alpha::<u16, 2>(image.as_raw(), size),
            DynamicImage::ImageRgba8(image) => with_alpha::<u8, 4>(image.as_raw(), size),
            DynamicImage::ImageRgba16(image) => with_alpha::<u16, 4>(image.as_raw(), size),
            DynamicImage::ImageRgba32F(image) => with_alpha::<f32, 4>(image.as_raw(), size),
            other => {
                let accepts = "gray or color of 8 or 16 bits, or of floats";
                Err(Error::value("image", format!("{:?}", other.color()), accepts))
            }
        }
    }
}

/// An image of these pixels; the last of `N` channels is alpha.
fn with_alpha<T: Pixel + PartialEq, const N: usize>(pixels: &[T], size: (usize, usize)) -> Result<Image> {
    let (pixels, _) = pixels.as_chunks::<N>();
    let colors: Vec<T> = pixels.iter().flat_map(|pixel| &pixel[..N - 1]).copied().collect();
    let opaque: Vec<bool> = pixels.iter().map(|pixel| pixel[N - 1] != T::default()).collect();
    Image::from_vec(colors, size)?.with_alpha(&opaque)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayAlphaImage, Rgb32FImage, RgbaImage};

    #[test]
    fn channels_are_kept_and_alpha_is_a_mask() {
        let colors = RgbaImage::from_raw(2, 1, vec![1, 2, 3, 0, 4, 5, 6, 255]).expect("two pixels");
        let image = Image::try_from(DynamicImage::from(colors)).expect("an image");
        assert_eq!(image.pixels::<u8>(), Some(&[1, 2, 3, 4, 5, 6][..]));
        assert_eq!(image.valid().as_slice(), [false, true]);

        let filled = GrayAlphaImage::from_raw(1, 2, vec![7, 0, 8, 0]).expect("two pixels");
        let image = Image::try_from(DynamicImage::from(filled)).expect("an image");
        assert_eq!(image.pixels::<u8>(), Some(&[7, 8][..]));
        assert_eq!(image.valid().as_slice(), [true, true]);

        let floats = Rgb32FImage::from_raw(1, 1, vec![0.5, 0.25, 1.0]).expect("a pixel");
        let image = Image::try_from(DynamicImage::from(floats)).expect("an image");
        assert_eq!(image.pixels::<f32>(), Some(&[0.5, 0.25, 1.0][..]));
        assert!(Image::try_from(DynamicImage::new_rgb8(0, 3)).is_err());
    }
}

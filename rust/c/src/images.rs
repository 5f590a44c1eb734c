//! Images from C, which are copied in, and planes of disparity maps, which are copied out.

use std::cell::LazyCell;
use std::ffi::c_void;
use std::mem::offset_of;

use phasestereo::{Error, Keep, Match, Pixel, Plane, Result, flag};
use phasestereo_match::base::plane::zeroed;

use crate::sized::Growing;

/// One channel.
pub const PHASESTEREO_GRAY: u32 = 0;
/// Red, green, blue.
pub const PHASESTEREO_RGB: u32 = 1;
/// Red, green, blue, and alpha: pixels with alpha 0 are invalid, unless it is 0 everywhere.
pub const PHASESTEREO_RGBA: u32 = 2;
/// Blue, green, red, as in `OpenCV`.
pub const PHASESTEREO_BGR: u32 = 3;
/// Blue, green, red, and alpha: pixels with alpha 0 are invalid, unless it is 0 everywhere.
pub const PHASESTEREO_BGRA: u32 = 4;

/// No candidate has a valid pixel in the right image: no estimate.
pub const PHASESTEREO_NO_CANDIDATE: u16 = 2;
/// The match lies outside the right image.
pub const PHASESTEREO_OUTSIDE: u16 = 4;
/// The right image does not show the left pixel: the right pixel of its match belongs to another one.
pub const PHASESTEREO_OCCLUDED: u16 = 16;
/// The match belongs to another left pixel, although the right image shows this one, too.
pub const PHASESTEREO_MISMATCHED: u16 = 32;
/// The confidence is below the lowest one that was asked for.
pub const PHASESTEREO_LOW_CONFIDENCE: u16 = 64;
/// The pixel belongs to a small region that differs from everything around it.
pub const PHASESTEREO_SPECKLE: u16 = 128;
/// The disparity comes from other pixels: this one's own is not trusted.
pub const PHASESTEREO_FILLED: u16 = 256;
/// A disparity elsewhere fits nearly as well.
pub const PHASESTEREO_AMBIGUOUS: u16 = 512;
/// The disparity is that of a plane drawn into a flat area without evidence of its own.
pub const PHASESTEREO_INFERRED: u16 = 1024;
/// The disparity comes from a smaller copy of the pair; the other flags are those of the copy.
pub const PHASESTEREO_COARSE: u16 = 2048;

/// Every disparity is written.
pub const PHASESTEREO_ALL: u32 = 0;
/// Only disparities that are probably within 1 px of the true ones are written: use this for depths.
pub const PHASESTEREO_TRUSTED: u32 = 1;
/// Only trusted disparities without a flag are written: fewer, but more of them are right.
pub const PHASESTEREO_CHECKED: u32 = 2;
const _: () = {
    assert!(PHASESTEREO_NO_CANDIDATE == flag::NO_CANDIDATE);
    assert!(PHASESTEREO_OUTSIDE == flag::OUTSIDE);
    assert!(PHASESTEREO_OCCLUDED == flag::OCCLUDED);
    assert!(PHASESTEREO_MISMATCHED == flag::MISMATCHED);
    assert!(PHASESTEREO_LOW_CONFIDENCE == flag::LOW_CONFIDENCE);
    assert!(PHASESTEREO_SPECKLE == flag::SPECKLE);
    assert!(PHASESTEREO_FILLED == flag::FILLED);
    assert!(PHASESTEREO_AMBIGUOUS == flag::AMBIGUOUS);
    assert!(PHASESTEREO_INFERRED == flag::INFERRED);
    assert!(PHASESTEREO_COARSE == flag::COARSE);
};

/// An image in memory; it is read only during the call.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Image {
    /// `sizeof(phasestereo_image)`.
    pub struct_size: usize,
    /// The first pixel of the first row.
    pub data: *const c_void,
    /// Bytes from one row to the next, at least those of a row: negative if the last row comes first in
    /// memory.
    pub stride: isize,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Channels, side by side: `PHASESTEREO_GRAY`, `PHASESTEREO_RGB` and so on
    pub channels: u32,
    /// Bits of a channel: 8, or 16 in the byte order of the machine.
    pub bits: u32,
    /// One byte per pixel, 0 where the image is invalid; NULL: all of it is valid.
    pub mask: *const u8,
    /// Bytes from one row of the mask to the next.
    pub mask_stride: isize,
}

/// The memory that a disparity map is written to: planes with the rows and columns of the images. NULL: not
/// wanted.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Map {
    /// `sizeof(phasestereo_map)`.
    pub struct_size: usize,
    /// Disparities, pixels; NaN: none.
    pub disparity: *mut f32,
    /// Bytes from one row to the next, as for an image.
    pub disparity_stride: isize,
    /// Flags: the sum of `PHASESTEREO_OUTSIDE`, `PHASESTEREO_OCCLUDED` and so on.
    pub flags: *mut u16,
    /// Bytes from one row to the next.
    pub flags_stride: isize,
    /// Confidences from 0 to 1; all NaN if the settings, such as those of "fast", do not compute them.
    pub confidence: *mut f32,
    /// Bytes from one row to the next.
    pub confidence_stride: isize,
    /// Error bars, pixels: half the width of the interval around the disparity that holds the true one with a
    /// probability of 90 %. NaN without a disparity; all NaN without confidences.
    pub uncertainty: *mut f32,
    /// Bytes from one row to the next.
    pub uncertainty_stride: isize,
    /// How many pairs of a steadied rig support each disparity, 1 to 8; all 0 for any other match.
    pub support: *mut u8,
    /// Bytes from one row to the next.
    pub support_stride: isize,
    /// Which disparities and error bars are written, as a choice between accuracy and density:
    /// `PHASESTEREO_ALL`, `PHASESTEREO_TRUSTED` or `PHASESTEREO_CHECKED`. The others are NaN; flags and
    /// confidences are written for all.
    pub keep: u32,
}

// SAFETY: both begin with their sizes; zeros are numbers and NULL.
unsafe impl Growing for Image {
    const LEAST: usize = offset_of!(Self, mask);
}

// SAFETY: as above.
unsafe impl Growing for Map {
    const LEAST: usize = offset_of!(Self, flags);
}

/// The layout of a pixel: the number of its channels, and the indices of those that are kept.
type Layout = (usize, &'static [usize]);

impl Image {
    /// A copy of the image.
    ///
    /// # Safety
    ///
    /// The fields of the image are true.
    pub unsafe fn copied(&self, argument: &'static str) -> Result<phasestereo::Image> {
        let refused = |got: String, accepts| Err(Error::value(argument, got, accepts));
        if self.data.is_null() {
            return refused("data that are NULL".into(), "a pointer to pixels");
        }
        if self.width == 0 || self.height == 0 {
            let got = format!("{} x {} pixels", self.height, self.width);
            return refused(got, "at least one pixel");
        }
        if self.channels > PHASESTEREO_BGRA {
            return refused(format!("channels {}", self.channels), "PHASESTEREO_GRAY to _BGRA");
        }
        check_stride((argument, "stride"), self.stride, self.row_bytes(), self.height as usize)?;

        // SAFETY: as the caller promises, with this many bytes.
        let (image, opaque) = unsafe {
            match self.bits {
                8 => self.read(|[value]: [u8; 1]| value)?,
                16 => self.read(u16::from_ne_bytes)?,
                bits => return refused(format!("{bits} bits a channel"), "8 or 16"),
            }
        };
        let image = image.with_alpha(&opaque)?;
        if self.mask.is_null() {
            return Ok(image);
        }

        let (rows, cols) = self.size();
        check_stride((argument, "mask_stride"), self.mask_stride, self.width.into(), rows)?;
        let mut valid = zeroed(rows.saturating_mul(cols))?;
        for (y, row) in valid.chunks_exact_mut(cols).enumerate() {
            for (x, valid) in row.iter_mut().enumerate() {
                let at = self.mask.wrapping_offset(y as isize * self.mask_stride).wrapping_add(x);
                // SAFETY: as the caller promises.
                *valid = unsafe { *at } != 0;
            }
        }
        image.with_mask(&valid)
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.height as usize, self.width as usize)
    }

    /// The bytes of a row.
    pub fn row_bytes(&self) -> u64 {
        u64::from(self.width) * self.layout().0 as u64 * u64::from(self.bits / 8)
    }

    fn layout(&self) -> Layout {
        match self.channels {
            PHASESTEREO_GRAY => (1, &[0]),
            PHASESTEREO_RGB => (3, &[0, 1, 2]),
            PHASESTEREO_RGBA => (4, &[0, 1, 2]),
            PHASESTEREO_BGR => (3, &[2, 1, 0]),
            _ => (4, &[2, 1, 0]),
        }
    }

    /// Copies out an image of the same size as this one, with its channels and bits; NULL: not wanted.
    ///
    /// # Safety
    ///
    /// There is space for each row, this many bytes from one to the next.
    pub unsafe fn write(&self, image: &phasestereo::Image, target: *mut c_void, stride: isize) {
        if target.is_null() {
            return;
        }
        // SAFETY: as the caller promises.
        unsafe {
            match self.bits {
                8 => self.write_pixels::<u8>(image, target, stride),
                _ => self.write_pixels::<u16>(image, target, stride),
            }
        }
    }

    /// [`Self::write`] for one type.
    ///
    /// # Safety
    ///
    /// As for [`Self::write`].
    unsafe fn write_pixels<T: Pixel>(&self, image: &phasestereo::Image, target: *mut c_void, stride: isize) {
        let (channels, taken) = self.layout();
        let (_, cols) = self.size();
        let rows = image.pixels::<T>().unwrap_or_default().chunks_exact(cols * taken.len());
        for (y, row) in rows.enumerate() {
            let start = target.cast::<u8>().wrapping_offset(y as isize * stride).cast::<T>();
            for (x, pixel) in row.chunks_exact(taken.len()).enumerate() {
                for (value, &channel) in pixel.iter().zip(taken) {
                    // SAFETY: as the caller promises; channels may lie anywhere.
                    unsafe { start.wrapping_add(x * channels + channel).write_unaligned(*value) };
                }
            }
        }
    }

    /// Copies the kept channels; `value` makes one from its bytes, which need not be aligned.
    ///
    /// # Safety
    ///
    /// The fields of the image are true, with channels of `N` bytes.
    unsafe fn read<T: Pixel, const N: usize>(
        &self,
        value: impl Fn([u8; N]) -> T,
    ) -> Result<(phasestereo::Image, Vec<bool>)> {
        let ((channels, taken), (rows, cols)) = (self.layout(), self.size());
        let mut opaque = vec![];
        let mut pixels = zeroed(rows.saturating_mul(cols).saturating_mul(taken.len()))?;

        for (y, row) in pixels.chunks_exact_mut(cols * taken.len()).enumerate() {
            let start = self.data.cast::<u8>().wrapping_offset(y as isize * self.stride);
            // SAFETY: as the caller promises, row `y` begins there and has this many bytes.
            let bytes = unsafe { std::slice::from_raw_parts(start, cols * channels * N) };
            // Pixels may lie anywhere in memory, so channels are built from bytes.
            let (values, _) = bytes.as_chunks::<N>();
            for (pixel, values) in row.chunks_exact_mut(taken.len()).zip(values.chunks_exact(channels)) {
                for (copy, &channel) in pixel.iter_mut().zip(taken) {
                    *copy = value(values[channel]);
                }
            }
            if channels > taken.len() {
                let alpha = values.chunks_exact(channels).map(|values| values[taken.len()]);
                opaque.extend(alpha.map(|alpha| alpha != [0; N]));
            }
        }

        Ok((phasestereo::Image::from_vec(pixels, (rows, cols))?, opaque))
    }
}

impl Map {
    /// Refuses overlapping rows.
    pub fn check(&self, (rows, cols): (usize, usize)) -> Result<()> {
        for (is_wanted, name, stride, bytes) in [
            (!self.disparity.is_null(), "disparity_stride", self.disparity_stride, 4),
            (!self.flags.is_null(), "flags_stride", self.flags_stride, 2),
            (!self.confidence.is_null(), "confidence_stride", self.confidence_stride, 4),
            (!self.uncertainty.is_null(), "uncertainty_stride", self.uncertainty_stride, 4),
            (!self.support.is_null(), "support_stride", self.support_stride, 1),
        ] {
            if is_wanted {
                check_stride(("map", name), stride, bytes * cols as u64, rows)?;
            }
        }
        Ok(())
    }

    /// Which disparities are requested.
    pub fn keep(&self) -> Result<Keep> {
        match self.keep {
            PHASESTEREO_ALL => Ok(Keep::All),
            PHASESTEREO_TRUSTED => Ok(Keep::Trusted),
            PHASESTEREO_CHECKED => Ok(Keep::Checked),
            other => {
                let accepts = "PHASESTEREO_ALL, PHASESTEREO_TRUSTED or PHASESTEREO_CHECKED";
                Err(Error::value("map", format!("a keep of {other}"), accepts))
            }
        }
    }

    /// Copies a map out.
    ///
    /// # Safety
    ///
    /// The planes are as large as the map, or NULL.
    pub unsafe fn write(&self, found: &Match) {
        let none = LazyCell::new(|| found.disparity.map(|_| f32::NAN));
        let confidence = found.confidence.as_ref().unwrap_or_else(|| &none);
        let uncertainty = found.uncertainty.as_ref().unwrap_or_else(|| &none);
        let alone = LazyCell::new(|| found.disparity.map(|_| 0));
        let support = found.support.as_ref().unwrap_or_else(|| &alone);

        // SAFETY: as the caller promises.
        unsafe {
            write(&found.disparity, self.disparity, self.disparity_stride);
            write(&found.flags, self.flags, self.flags_stride);
            write(confidence, self.confidence, self.confidence_stride);
            write(uncertainty, self.uncertainty, self.uncertainty_stride);
            write(support, self.support, self.support_stride);
        }
    }
}

/// Refuses a stride for rows of this many bytes that makes them overlap, or reach beyond memory.
pub fn check_stride(
    (argument, name): (&'static str, &str),
    stride: isize,
    row: u64,
    rows: usize,
) -> Result<()> {
    let apart = stride.unsigned_abs() as u64;
    let reach = apart.saturating_mul(rows as u64 - 1).saturating_add(row);
    if (rows > 1 && apart < row) || reach > isize::MAX as u64 {
        let accepts = format!("at least {row}, or at most -{row}, and all of it in memory");
        return Err(Error::value(argument, format!("a {name} of {stride} bytes"), accepts));
    }
    Ok(())
}

/// Copies rows out, to memory that need not be aligned.
///
/// # Safety
///
/// There is space for each row of the plane, this many bytes from one to the next; or the pointer is NULL.
pub unsafe fn write<T>(plane: &Plane<T>, target: *mut T, stride: isize) {
    if target.is_null() {
        return;
    }

    for y in 0..plane.rows() {
        let row = plane.row(y);
        let start = target.cast::<u8>().wrapping_offset(y as isize * stride);
        // SAFETY: as the caller promises; the caller's memory is not the plane's.
        unsafe { row.as_ptr().cast::<u8>().copy_to_nonoverlapping(start, size_of_val(row)) };
    }
}

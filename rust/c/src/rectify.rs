//! Calibrations as C structures, and rectification of images with them.

use std::ffi::c_void;

use phasestereo::{Error, Interpolation, Result};

use crate::images::{Image, check_stride, write};
use crate::sized::{self, Growing};
use crate::{Matcher, Status, ours, read_images, reference, status, told};

/// Images are interpolated between the four pixels around a place, with 0 beyond the image, like OpenCV's
/// `remap` by default.
pub const PHASESTEREO_LINEAR: u32 = 0;
/// Images are interpolated from 8 x 8 pixels, which keeps them sharp.
pub const PHASESTEREO_LANCZOS: u32 = 1;

/// Two cameras and the rectification of their images; left and right, matrices row by row, as in OpenCV.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Calibration {
    /// `sizeof(phasestereo_calibration)`.
    pub struct_size: usize,
    /// K1 and K2: focal lengths and principal points, pixels, each for its own original image.
    pub camera: [[[f64; 3]; 3]; 2],
    /// D1 and D2: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4; 0 for those that a calibration does not
    /// have.
    pub distortion: [[f64; 12]; 2],
    /// R1 and R2: from the raw camera to the rectified one.
    pub rotation: [[[f64; 3]; 3]; 2],
    /// P1 and P2: of the rectified images, pixels; the last column of P2 is minus the distance of the cameras
    /// times the focal length, 0 if unknown.
    pub projection: [[[f64; 4]; 3]; 2],
}

/// The memory that rectified images are written to, left and right: both with the rows and columns of the
/// given left one, and each with the channels and bits of its own input. NULL: not wanted.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Rectified {
    /// `sizeof(phasestereo_rectified)`.
    pub struct_size: usize,
    /// The images; a fourth channel is left unchanged.
    pub image: [*mut c_void; 2],
    /// Bytes from one row to the next, as for an image.
    pub stride: [isize; 2],
    /// One byte per pixel: 1 where it is valid, 0 where it lies outside the given image.
    pub mask: [*mut u8; 2],
    /// Bytes from one row to the next.
    pub mask_stride: [isize; 2],
    /// Written by the call: OpenCV's matrix Q, in the unit of the calibration's translation; NaN if the
    /// distance of the cameras is unknown.
    pub q: [[f64; 4]; 4],
}

// SAFETY: it begins with its size; all others are numbers.
unsafe impl Growing for Calibration {
    const LEAST: usize = size_of::<Self>();
}

// SAFETY: it begins with its size; zeros are numbers and NULL.
unsafe impl Growing for Rectified {
    const LEAST: usize = size_of::<Self>();
}

impl Calibration {
    /// The calibration in the form of the core.
    pub fn known(&self) -> phasestereo::Calibration {
        let Self { camera, distortion, rotation, projection, .. } = *self;
        phasestereo::Calibration { camera, distortion, rotation, projection }
    }

    fn new(known: &phasestereo::Calibration) -> Self {
        let phasestereo::Calibration { camera, distortion, rotation, projection } = *known;
        Self { struct_size: size_of::<Self>(), camera, distortion, rotation, projection }
    }
}

impl Rectified {
    /// Refuses overlapping rows.
    fn check(&self, given: &[Image; 2]) -> Result<()> {
        let (rows, cols) = given[0].size();
        for (side, image) in given.iter().enumerate() {
            if !self.image[side].is_null() {
                check_stride(("rectified", "stride"), self.stride[side], image.row_bytes(), rows)?;
            }
            if !self.mask[side].is_null() {
                check_stride(("rectified", "mask_stride"), self.mask_stride[side], cols as u64, rows)?;
            }
        }
        Ok(())
    }
}

/// Fills in `rotation` and `projection` of a calibration with given `camera` and `distortion`, as OpenCV's
/// `stereoRectify` does with `CALIB_ZERO_DISPARITY` and `alpha` -1. `rotation`, 9 numbers row by row, and
/// `translation`, 3 of any unit, map the left camera's points to the right one: `X_right = R X_left + T`. The
/// cameras are side by side. Rectified images have the size of the left ones, `width` and `height`; right
/// ones may have another size.
///
/// # Safety
///
/// Pointers are valid for their types, `rotation` for 9 numbers and `translation` for 3.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_stereo_rectify(
    calibration: *mut Calibration,
    rotation: *const f64,
    translation: *const f64,
    width: u32,
    height: u32,
    right_width: u32,
    right_height: u32,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let (given, size, pose) = unsafe {
            let rotation = *reference(rotation.cast::<[[f64; 3]; 3]>(), "rotation")?;
            let translation = *reference(translation.cast::<[f64; 3]>(), "translation")?;
            let given = sized::read(calibration, "calibration")?;
            (given, sized::size(calibration, "calibration")?, (rotation, translation))
        };

        let sizes = [(width, height), (right_width, right_height)];
        let sizes = sizes.map(|(cols, rows)| (rows as usize, cols as usize));
        let phasestereo::Calibration { camera, distortion, .. } = given.known().fitted(sizes)?;
        let made = phasestereo::Calibration::new(camera, distortion, pose, sizes[0])?;

        let made = Calibration { camera: given.camera, ..Calibration::new(&made) };
        // SAFETY: as above.
        unsafe { sized::write(calibration, size, &made) };
        Ok(())
    })
}

/// Fills in a whole calibration from two raw images alone; it holds for all images of these cameras. The
/// distance of the cameras remains unknown. `phasestereo_get_finding` returns the findings.
///
/// # Safety
///
/// Pointers are valid for their types.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_estimate_calibration(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    calibration: *mut Calibration,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let (matcher, size) = unsafe { (ours(matcher)?, sized::size(calibration, "calibration")?) };
        // SAFETY: as above.
        let ([left, right], _) = unsafe { read_images([left, right])? };

        let (found, findings) = matcher.calibrate(left, right)?;

        // SAFETY: as above.
        unsafe { sized::write(calibration, size, &Calibration::new(&found)) };
        told::keep(findings);
        Ok(())
    })
}

/// Rectifies two raw images, so that points that both show lie on the same row; a right image of another size
/// is scaled to that of the left one. `interpolation` is `PHASESTEREO_LINEAR` or `PHASESTEREO_LANCZOS`. The
/// outputs may be passed as the images to match, with their masks. If the call fails, nothing is written.
///
/// # Safety
///
/// Pointers are valid for their types; the planes of `rectified` have the rows and columns of the left image.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rectify(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    calibration: *const Calibration,
    interpolation: u32,
    rectified: *mut Rectified,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let (matcher, calibration, size, mut places) = unsafe {
            let size = sized::size(rectified, "rectified")?;
            let calibration = sized::read(calibration, "calibration")?.known();
            (ours(matcher)?, calibration, size, sized::read(rectified, "rectified")?)
        };
        let interpolation = match interpolation {
            PHASESTEREO_LINEAR => Interpolation::Linear,
            PHASESTEREO_LANCZOS => Interpolation::Lanczos,
            other => {
                let accepts = "PHASESTEREO_LINEAR or PHASESTEREO_LANCZOS";
                return Err(Error::value("interpolation", other, accepts));
            }
        };

        // SAFETY: as above.
        let ([left, right], mut given) = unsafe { read_images([left, right])? };
        [given[1].width, given[1].height] = [given[0].width, given[0].height];
        places.check(&given)?;

        let q = calibration.q()?;
        let images = matcher.rectify(left, right, &calibration, interpolation)?;

        for (side, image) in images.iter().enumerate() {
            let valid = image.valid().map(|valid| u8::from(*valid));
            // SAFETY: as above.
            unsafe {
                given[side].write(image, places.image[side], places.stride[side]);
                write(&valid, places.mask[side], places.mask_stride[side]);
            }
        }
        places.q = q.unwrap_or([[f64::NAN; 4]; 4]);
        // SAFETY: as above.
        unsafe { sized::write(rectified, size, &places) };
        Ok(())
    })
}

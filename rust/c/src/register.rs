//! Depths in the frame of a third camera, such as a color camera beside the pair.

use phasestereo::{Error, LeftCamera, Lens, Plane, Result, ThirdCamera};

use crate::images::{check_stride, write};
use crate::prepare::copied;
use crate::rectify::Calibration;
use crate::sized::{self, Growing};
use crate::{Matcher, Status, ours, status};

/// A camera beside a rectified pair, and its pose; matrices row by row.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Camera {
    /// `sizeof(phasestereo_camera)`.
    pub struct_size: usize,
    /// Focal lengths and principal point, pixels.
    pub matrix: [[f64; 3]; 3],
    /// In the form of `cv::projectPoints`: k1, k2, p1, p2, k3 to k6, s1 to s4, tau x, tau y; 0 for those that
    /// a calibration does not have.
    pub distortion: [f64; 14],
    /// `rotation X + translation` maps the rectified left camera's points to this one.
    pub rotation: [[f64; 3]; 3],
    /// In the unit of depths.
    pub translation: [f64; 3],
    /// Columns of its images.
    pub width: u32,
    /// Rows of its images.
    pub height: u32,
    /// 1: the first four numbers of the distortion are those of `cv::fisheye`. 0: they are not.
    pub fisheye: u32,
}

/// Maps of the rectified left camera, each with `height` rows of `width` values. All except the depths may be
/// NULL.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Depths {
    /// `sizeof(phasestereo_depths)`.
    pub struct_size: usize,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Depths, in the unit of the distance of the cameras: the focal length times that distance, divided by
    /// the disparity plus the difference of the principal points, right - left. Non-finite values are
    /// missing.
    pub depth: *const f32,
    /// Bytes from one row to the next, for all of them.
    pub stride: isize,
    /// Depths at the near end of the error bars.
    pub near: *const f32,
    /// Depths at the far end.
    pub far: *const f32,
    /// Confidences.
    pub confidence: *const f32,
}

/// The memory that a third camera's view is written to, of its size. NULL: not wanted.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Registered {
    /// `sizeof(phasestereo_registered)`.
    pub struct_size: usize,
    /// Depths along the axis of the third camera; NaN where it sees none.
    pub depth: *mut f32,
    /// Bytes from one row to the next, for this and the three after it.
    pub stride: isize,
    /// The near end of the error bars.
    pub near: *mut f32,
    /// The far end.
    pub far: *mut f32,
    /// Confidences.
    pub confidence: *mut f32,
    /// The pixel of the left image, as an index into a map without gaps between its rows; -1 without a depth.
    pub source: *mut i64,
    /// Bytes from one row to the next.
    pub source_stride: isize,
    /// 1 where the left camera sees something whose depth is missing.
    pub holes: *mut u8,
    /// 1 where something hides the scene from the left camera.
    pub occluded: *mut u8,
    /// Bytes from one row to the next, for the last two.
    pub flags_stride: isize,
}

// SAFETY: it begins with its size; zeros are numbers.
unsafe impl Growing for Camera {
    const LEAST: usize = size_of::<Self>();
}

// SAFETY: it begins with its size; zeros are numbers and NULL.
unsafe impl Growing for Depths {
    const LEAST: usize = size_of::<Self>();
}

// SAFETY: it begins with its size; zeros are numbers and NULL.
unsafe impl Growing for Registered {
    const LEAST: usize = size_of::<Self>();
}

impl Camera {
    fn known(&self) -> Result<ThirdCamera> {
        let Self { width, height, fisheye, .. } = *self;
        if width == 0 || height == 0 {
            let got = format!("{width} x {height} pixels");
            return Err(Error::value("camera", got, "at least one pixel"));
        }
        if fisheye > 1 {
            return Err(Error::value("camera", format!("a fisheye of {fisheye}"), "0 or 1"));
        }
        let [[fx, _, _], [_, fy, _], _] = self.matrix;
        let numbers = [self.matrix, self.rotation].into_iter().flatten().flatten();
        let is_finite = numbers.chain(self.translation).all(f64::is_finite);
        if !(is_finite && fx > 0.0 && fy > 0.0) {
            let got = format!("focal lengths {fx} and {fy}, or what is not finite");
            return Err(Error::value("camera", got, "finite numbers, and positive focal lengths"));
        }

        let used = if fisheye == 1 { 4 } else { self.distortion.len() };
        let is_straight = self.distortion.iter().all(|number| *number == 0.0);
        let lens =
            if is_straight { Lens::Pinhole } else { Lens::new(&self.distortion[..used], fisheye == 1)? };
        let pose = (self.rotation, self.translation);
        Ok(ThirdCamera::new(&self.matrix, lens, pose, (height as usize, width as usize)))
    }
}

impl Depths {
    /// A copy of one of the maps; `None`: it is NULL.
    ///
    /// # Safety
    ///
    /// The map is as large as the fields say, or NULL.
    unsafe fn read(&self, map: *const f32) -> Result<Option<Plane<f32>>> {
        if map.is_null() {
            return Ok(None);
        }
        let size = (self.height as usize, self.width as usize);
        // SAFETY: as the caller promises.
        unsafe { copied(map, self.stride, size) }.map(Some)
    }
}

impl Registered {
    /// Refuses overlapping rows.
    fn check(&self, camera: &Camera) -> Result<()> {
        let (cols, rows) = (u64::from(camera.width), camera.height as usize);
        let numbers = [self.depth, self.near, self.far, self.confidence];
        let flags = [self.holes, self.occluded];
        for (is_wanted, name, stride, bytes) in [
            (numbers.iter().any(|map| !map.is_null()), "stride", self.stride, 4),
            (!self.source.is_null(), "source_stride", self.source_stride, 8),
            (flags.iter().any(|map| !map.is_null()), "flags_stride", self.flags_stride, 1),
        ] {
            if is_wanted {
                check_stride(("registered", name), stride, bytes * cols, rows)?;
            }
        }
        Ok(())
    }
}

/// Writes depths of the rectified left camera, their error bars and confidences as seen by a third camera,
/// taking the nearest of several. `calibration` is that of the rectified pair; only its `projection` is read,
/// with the distance of the cameras in P2. Error bars and confidences that are not given are NaN. If the call
/// fails, nothing is written.
///
/// # Safety
///
/// Pointers are valid for their types, maps for this many rows and columns.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_register(
    matcher: *const Matcher,
    depths: *const Depths,
    calibration: *const Calibration,
    camera: *const Camera,
    registered: *const Registered,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let (matcher, depths, rig, camera, places) = unsafe {
            (
                ours(matcher)?,
                sized::read(depths, "depths")?,
                sized::read(calibration, "calibration")?.known(),
                sized::read(camera, "camera")?,
                sized::read(registered, "registered")?,
            )
        };
        let (third, left) = (camera.known()?, left_camera(&rig)?);
        places.check(&camera)?;
        let Depths { width, height, depth, stride, .. } = depths;
        if width == 0 || height == 0 || depth.is_null() {
            let got = format!("{width} x {height} values, or a depth that is NULL");
            return Err(Error::value("depths", got, "at least one value"));
        }
        check_stride(("depths", "stride"), stride, 4 * u64::from(width), height as usize)?;

        // SAFETY: as above.
        let (map, near, far, confidence) = unsafe {
            let map = copied(depth, stride, (height as usize, width as usize))?;
            let [near, far, confidence] = [depths.near, depths.far, depths.confidence];
            (map, depths.read(near)?, depths.read(far)?, depths.read(confidence)?)
        };
        let found = matcher.register(&map, &left, &third)?;
        let moved = |map: Option<Plane<f32>>| {
            let map = map.map(|map| third.moved(&map, &found.source, &left));
            map.unwrap_or_else(|| found.depth.map(|_| f32::NAN))
        };
        let picked = |map: Option<Plane<f32>>| {
            let value = |index: i64| {
                let at = usize::try_from(index).ok()?;
                map.as_ref()?.as_slice().get(at).copied()
            };
            found.source.map(|index| value(*index).unwrap_or(f32::NAN))
        };
        let (near, far, confidence) = (moved(near), moved(far), picked(confidence));
        let [holes, occluded] = [&found.holes, &found.occluded].map(|map| map.map(|is| u8::from(*is)));

        // SAFETY: as above.
        unsafe {
            write(&found.depth, places.depth, places.stride);
            write(&near, places.near, places.stride);
            write(&far, places.far, places.stride);
            write(&confidence, places.confidence, places.stride);
            write(&found.source, places.source, places.source_stride);
            write(&holes, places.holes, places.flags_stride);
            write(&occluded, places.occluded, places.flags_stride);
        }
        Ok(())
    })
}

/// The rectified left camera of a calibration that contains the distance of the cameras.
fn left_camera(rig: &phasestereo::Calibration) -> Result<LeftCamera> {
    let [[[fx, _, cx, _], [_, fy, cy, _], _], [[focal, _, _, shift], ..]] = rig.projection;
    let baseline = 0.0 - shift / focal;
    if !(fx > 0.0 && fy > 0.0 && baseline > 0.0 && baseline.is_finite()) {
        let got = format!("focal lengths {fx} and {fy}, a distance of the cameras of {baseline}");
        return Err(Error::value("calibration", got, "positive ones"));
    }
    Ok(LeftCamera { focal: [fx, fy], center: [cx, cy], baseline })
}

//! Pairs prepared for other matchers, and the conversion of their maps, for C.

use std::ffi::{CString, c_char, c_void};
use std::ptr;

use phasestereo::{Error, Pixel, Plane, PreparedPair, Result};
use phasestereo_match::base::plane::zeroed;

use crate::images::{Image, PHASESTEREO_GRAY, PHASESTEREO_RGB, check_stride, write};
use crate::sized;
use crate::{Matcher, Status, guarded, ours, read_disparities, read_images, reference, status, told};

/// A pair that any other matcher can use, and the conversion of its maps back. Any number of threads may use
/// one at the same time.
#[derive(Debug)]
pub struct Prepared {
    pair: PreparedPair,
    done: Vec<CString>,
}

/// Prepares a pair for any other matcher, using the estimates of a match: the images are rectified, with
/// corresponding rows, equally sharp and bright. `max_disparity` is the largest disparity that the other
/// matcher can return, pixels; images are cropped and reduced to it; 0: any number. Everything else is as for
/// `phasestereo_match`. NULL if it fails: see `phasestereo_error`. `phasestereo_get_finding` returns the
/// findings.
///
/// # Safety
///
/// Pointers are valid for their types.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_prepare(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    min_disparity: i32,
    num_disparities: i32,
    max_disparity: u32,
) -> *mut Prepared {
    let made = guarded(|| {
        // SAFETY: as the caller promises.
        let matcher = unsafe { ours(matcher)? };
        let disparities = read_disparities(min_disparity, num_disparities)?;
        // SAFETY: as above.
        let ([left, right], _) = unsafe { read_images([left, right])? };

        let most = (max_disparity != 0).then_some(max_disparity.into());
        let mut pair = matcher.prepare(left, right, disparities, most)?;
        told::keep(std::mem::take(&mut pair.findings));
        let text = |text: &String| CString::new(text.as_str()).unwrap_or_default();
        Ok(Prepared { done: pair.done.iter().map(text).collect(), pair })
    });

    made.map_or(ptr::null_mut(), |prepared| Box::into_raw(Box::new(prepared)))
}

/// Frees a prepared pair with its images. NULL is ignored.
///
/// # Safety
///
/// The pair comes from `phasestereo_prepare`, no call is using it, and none will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_prepared_free(prepared: *mut Prepared) {
    if !prepared.is_null() {
        // SAFETY: as the caller promises.
        drop(unsafe { Box::from_raw(prepared) });
    }
}

/// Describes the prepared left image (`side` 0) or right one (1): gray or RGB, without a mask. Its pixels
/// belong to the pair and are valid until it is freed.
///
/// # Safety
///
/// The pair comes from `phasestereo_prepare`, and `image` points to memory for an image, with its size set.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_prepared_image(
    prepared: *const Prepared,
    side: u32,
    image: *mut Image,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let (pair, room) = unsafe { (&reference(prepared, "prepared")?.pair, sized::size(image, "image")?) };
        let found = pair.images.get(side as usize);
        let found = found.ok_or_else(|| Error::value("side", side, "0, left, or 1, right"))?;

        let view = view_of::<u8>(found).or_else(|| view_of::<u16>(found));
        let view = view.ok_or_else(|| Error::value("prepared", "other pixels", "8 or 16 bits"))?;
        // SAFETY: as above.
        unsafe { sized::write(image, room, &view) };
        Ok(())
    })
}

/// The number of disparities of a prepared pair, starting at 0; 0 for NULL.
///
/// # Safety
///
/// The pair comes from `phasestereo_prepare`, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_prepared_disparities(prepared: *const Prepared) -> u32 {
    // SAFETY: as the caller promises.
    unsafe { prepared.as_ref() }.map_or(0, |prepared| prepared.pair.num_disparities as u32)
}

/// The changes made to a pair, one sentence after another; NULL beyond the last one. The text belongs to the
/// pair.
///
/// # Safety
///
/// The pair comes from `phasestereo_prepare`, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_prepared_done(prepared: *const Prepared, index: u32) -> *const c_char {
    // SAFETY: as the caller promises.
    let done = unsafe { prepared.as_ref() }.and_then(|prepared| prepared.done.get(index as usize));
    done.map_or(ptr::null(), |text| text.as_ptr())
}

/// Converts a disparity map of a prepared pair to the original left image, in pixels. Non-finite values of
/// `map` are missing; if it has another size than the prepared images, its disparities are in its own pixels.
/// Missing results are NaN. If the call fails, nothing is written.
///
/// # Safety
///
/// The pair comes from `phasestereo_prepare`; `map` has `height` rows of `width` values, `map_stride` bytes
/// from one to the next; `disparity` has the rows and columns of the left image.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_restore(
    prepared: *const Prepared,
    map: *const f32,
    map_stride: isize,
    width: u32,
    height: u32,
    disparity: *mut f32,
    disparity_stride: isize,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let pair = unsafe { &reference(prepared, "prepared")?.pair };
        let (rows, cols) = (height as usize, width as usize);
        if map.is_null() || disparity.is_null() || rows == 0 || cols == 0 {
            let got = format!("{rows} x {cols} values, or a place that is NULL");
            return Err(Error::value("map", got, "at least one value, and a place for the result"));
        }
        check_stride(("map", "map_stride"), map_stride, 4 * u64::from(width), rows)?;
        let (all, wide) = pair.size();
        check_stride(("disparity", "disparity_stride"), disparity_stride, 4 * wide as u64, all)?;

        // SAFETY: as above.
        let given = unsafe { copied(map, map_stride, (rows, cols))? };
        let found = pair.restore(&given)?;
        // SAFETY: as above.
        unsafe { write(&found, disparity, disparity_stride) };
        Ok(())
    })
}

/// A C image in memory that C does not own; `None`: its pixels have another type.
fn view_of<T: Pixel>(image: &phasestereo::Image) -> Option<Image> {
    let pixels = image.pixels::<T>()?;
    let valid = image.valid();
    let (rows, cols) = valid.size();
    let channels = pixels.len() / (rows * cols);
    Some(Image {
        struct_size: size_of::<Image>(),
        data: pixels.as_ptr().cast::<c_void>(),
        stride: (cols * channels * size_of::<T>()) as isize,
        width: cols as u32,
        height: rows as u32,
        channels: if channels == 3 { PHASESTEREO_RGB } else { PHASESTEREO_GRAY },
        bits: 8 * size_of::<T>() as u32,
        mask: ptr::null(),
        mask_stride: 0,
    })
}

/// A copy of rows of memory that need not be aligned.
///
/// # Safety
///
/// The memory holds these rows and columns, with `stride` bytes from one row to the next.
pub unsafe fn copied(map: *const f32, stride: isize, (rows, cols): (usize, usize)) -> Result<Plane<f32>> {
    let mut values = zeroed(rows.saturating_mul(cols))?;
    for (y, row) in values.chunks_exact_mut(cols).enumerate() {
        let start = map.cast::<u8>().wrapping_offset(y as isize * stride);
        // SAFETY: as the caller promises, with this many bytes.
        let bytes = unsafe { std::slice::from_raw_parts(start, 4 * cols) };
        for (value, bytes) in row.iter_mut().zip(bytes.as_chunks().0) {
            *value = f32::from_ne_bytes(*bytes);
        }
    }
    Plane::from_vec(rows, cols, values)
}

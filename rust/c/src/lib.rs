//! The C interface: `rust/c/phasestereo.h` is generated from this crate, and documents the arguments of each
//! function.
//!
//! Images are copied in and maps are copied out, so no call keeps a pointer of its caller. No panic leaves a
//! call: like every failure it becomes an error, whose message the calling thread can read. Structures begin
//! with their size, so a program works with a library that has more fields without recompiling.

#![allow(unsafe_code, reason = "what C hands over are pointers, which only unsafe code can read")]

mod found;
mod images;
#[cfg(not(target_family = "wasm"))]
mod prepare;
// A page matches one pair, and the core rectifies it: without these modules it is a tenth smaller.
#[cfg(not(target_family = "wasm"))]
mod rectify;
#[cfg(not(target_family = "wasm"))]
mod register;
#[cfg(not(target_family = "wasm"))]
mod rig;
mod sized;
mod told;
#[cfg(target_family = "wasm")]
mod web;

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::{mem, process, ptr};

use phasestereo::{Error, Preset, Result};

pub use self::found::Found;
pub use self::images::{Image, Map};
#[cfg(not(target_family = "wasm"))]
pub use self::prepare::Prepared;
#[cfg(not(target_family = "wasm"))]
pub use self::rectify::{Calibration, Rectified};
#[cfg(not(target_family = "wasm"))]
pub use self::register::{Camera, Depths, Registered};
#[cfg(not(target_family = "wasm"))]
pub use self::rig::Rig;

thread_local! {
    /// The message of the last failed call on this thread.
    static ERROR: RefCell<CString> = RefCell::default();
}

/// Settings, threads and working memory; any number of threads may use one at the same time.
#[derive(Debug)]
pub struct Matcher {
    matcher: phasestereo::Matcher,
    /// The process that owns its threads.
    process: u32,
}

/// The images of a pair.
type Images = [phasestereo::Image; 2];

/// This process; a browser has only one.
fn this_process() -> u32 {
    if cfg!(target_family = "wasm") { 0 } else { process::id() }
}

/// A setting by its name, both as text that ends with a zero. Names, meanings and ranges are those of the
/// class `Settings` of the Python package; values are written in the same way, except for lowercase "none",
/// "true" and "false", and pairs as "0, 4095". No field will ever be added, so it has no size.
#[derive(Debug)]
#[repr(C)]
pub struct Setting {
    /// Its name, such as "median".
    pub name: *const c_char,
    /// Its value, such as "3".
    pub value: *const c_char,
}

/// The result of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// Success.
    Ok = 0,
    /// An argument is invalid: `phasestereo_error` names it, its value and the accepted values.
    InvalidArgument = 1,
    /// The working memory could not be allocated.
    OutOfMemory = 2,
    /// The system refused to start the threads.
    Threads = 3,
    /// A bug in the library, which should be reported.
    Internal = 4,
}

/// The version of the library, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn phasestereo_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The message of the last failed call on this thread; empty if there was none. It is valid until the next
/// call that fails.
#[unsafe(no_mangle)]
pub extern "C" fn phasestereo_error() -> *const c_char {
    ERROR.with_borrow(|message| message.as_ptr())
}

/// Makes a matcher with the settings of a preset, "robust", "fast" or "paper" (NULL: "robust"), changed by
/// the listed settings. One more setting is "vertical": "true" if the right camera is below the left one,
/// "false" if it is beside it, "none" (the default) to match columns if a pair clearly shows the former.
/// `threads` is 1 to 1024, or 0: all processors available to the process. NULL if it fails: see
/// `phasestereo_error`.
///
/// # Safety
///
/// Texts end with a zero; `settings` points to `count` of them, or is NULL if `count` is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_new(
    preset: *const c_char,
    settings: *const Setting,
    count: usize,
    threads: u32,
) -> *mut Matcher {
    let made = guarded(|| {
        // SAFETY: as the caller promises.
        let (preset, listed) = unsafe { (text(preset, "preset")?, list(settings, count)?) };
        let mut settings = Preset::named(preset.unwrap_or(Preset::Robust.name()))?.settings();

        let mut vertical = None;
        for Setting { name, value } in listed {
            // SAFETY: as the caller promises.
            let (name, value) = unsafe { (text(*name, "name")?, text(*value, "value")?) };
            let (name, value) = (name.unwrap_or_default(), value.unwrap_or_default());
            if name == "vertical" {
                vertical = read_vertical(value)?;
            } else {
                settings.set(name, value)?;
            }
        }

        let threads = (threads != 0).then_some(threads as usize);
        let matcher = phasestereo::Matcher::new(settings, threads)?.with_vertical(vertical);
        Ok(Matcher { matcher, process: this_process() })
    });

    made.map_or(ptr::null_mut(), |matcher| Box::into_raw(Box::new(matcher)))
}

/// Frees a matcher with its threads and its memory. NULL is ignored, and so is a matcher made before a fork,
/// whose threads belong to the other process.
///
/// # Safety
///
/// The matcher comes from `phasestereo_new`, no call is using it, and none will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_free(matcher: *mut Matcher) {
    if !matcher.is_null() {
        // SAFETY: as the caller promises.
        let matcher = unsafe { Box::from_raw(matcher) };
        // A panic while threads end gives the caller nothing to act on.
        let _ = guarded(move || {
            if matcher.process == this_process() {
                drop(matcher);
            } else {
                mem::forget(matcher);
            }
            Ok(())
        });
    }
}

/// The number of threads of a matcher; 0 for NULL.
///
/// # Safety
///
/// The matcher comes from `phasestereo_new`, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_threads(matcher: *const Matcher) -> u32 {
    // SAFETY: as the caller promises.
    unsafe { matcher.as_ref() }.map_or(0, |handle| handle.matcher.threads() as u32)
}

/// The most bytes of working memory for a match of images where each pixel, all channels together, takes
/// `pixel_bytes`; 0 if an argument is invalid. The caller's images and maps are not included, nor the codes
/// of the right image that are kept for each kind of compensated blur.
///
/// # Safety
///
/// The matcher comes from `phasestereo_new`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_memory(
    matcher: *const Matcher,
    width: u32,
    height: u32,
    pixel_bytes: u32,
    num_disparities: u32,
) -> u64 {
    let bytes = guarded(|| {
        // SAFETY: as the caller promises.
        let Matcher { matcher, .. } = unsafe { reference(matcher, "matcher")? };
        let size = (height as usize, width as usize);
        matcher.working_memory(size, pixel_bytes as usize, num_disparities as usize)
    });

    bytes.unwrap_or(0)
}

/// Matches a rectified pair; a right image of another size or number of bits is converted to those of the
/// left one. The disparities [`min_disparity`, `min_disparity` + `num_disparities`) are searched, with
/// `num_disparities` from 1 to the width; with 0 the range is estimated, and `min_disparity` must be 0. Left
/// pixel (x, y) corresponds to right pixel (x - d, y). The estimates from the pair are written to `found`,
/// unless that is NULL; `phasestereo_get_finding` explains them. If the call fails, nothing is written.
///
/// # Safety
///
/// Pointers are valid for their types; the planes of `map` have the rows and columns of the left image.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_match(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    min_disparity: i32,
    num_disparities: i32,
    map: *const Map,
    found: *mut Found,
) -> Status {
    // SAFETY: as the caller promises.
    status(|| unsafe {
        let disparities = (min_disparity, num_disparities);
        matched(matcher, [left, right], disparities, (0, map), found, |matcher, [left, right], range| {
            matcher.match_pair(left, right, range)
        })
    })
}

/// Matches the same pair from the right image: right pixel (x, y) corresponds to left pixel (x + d, y), with
/// disparities of the same range. It is the map of the exchanged, mirrored pair, mirrored back; `found`
/// describes that pair, and it takes as long as another match. The planes of `map` have the size of the right
/// image.
///
/// # Safety
///
/// Pointers are valid for their types; the planes of `map` have the rows and columns of the right image.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_match_right(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    min_disparity: i32,
    num_disparities: i32,
    map: *const Map,
    found: *mut Found,
) -> Status {
    // SAFETY: as the caller promises.
    status(|| unsafe {
        let disparities = (min_disparity, num_disparities);
        matched(matcher, [left, right], disparities, (1, map), found, |matcher, [left, right], range| {
            matcher.match_right(left, right, range)
        })
    })
}

/// Diagnoses a pair: estimates everything that a match with these settings would estimate (the disparities,
/// if they are not given, the correspondence of rows, blur, noise), and matches a copy of at most 0.4
/// megapixels. If that match fails, the first finding is a warning about it. The arguments are those of
/// `phasestereo_match`.
///
/// # Safety
///
/// Pointers are valid for their types.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_check(
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    min_disparity: i32,
    num_disparities: i32,
    found: *mut Found,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let matcher = unsafe { ours(matcher)? };
        // SAFETY: as above.
        let found = unsafe { place(found)? };
        let disparities = read_disparities(min_disparity, num_disparities)?;
        // SAFETY: as above.
        let ([left, right], _) = unsafe { read_images([left, right])? };

        let estimates = matcher.check(left, right, disparities.clone())?;

        // SAFETY: as above.
        unsafe { write(found, &Found::new(&estimates, disparities.is_some())) };
        told::keep(estimates.findings);
        Ok(())
    })
}

/// Matches a pair with `by`, and writes the results; the map is that of the left (0) or the right image (1).
///
/// # Safety
///
/// As for [`phasestereo_match`].
unsafe fn matched(
    matcher: *const Matcher,
    images: [*const Image; 2],
    (min_disparity, num_disparities): (i32, i32),
    (side, map): (usize, *const Map),
    found: *mut Found,
    by: impl FnOnce(&phasestereo::Matcher, Images, Option<Range<i64>>) -> Result<phasestereo::Match>,
) -> Result<()> {
    // SAFETY: as the caller promises.
    let matcher = unsafe { ours(matcher)? };
    // SAFETY: as above.
    let (map, found) = unsafe { (sized::read(map, "map")?, place(found)?) };
    let disparities = read_disparities(min_disparity, num_disparities)?;
    // SAFETY: as above.
    let (images, given) = unsafe { read_images(images)? };
    map.check(given[side].size())?;
    let keep = map.keep()?;

    let result = by(matcher, images, disparities.clone())?.kept(keep);

    // SAFETY: as above.
    unsafe {
        map.write(&result);
        write(found, &Found::new(&result.estimates, disparities.is_some()));
    }
    told::keep(result.findings);
    Ok(())
}

/// Whether the right camera is below the left one, if given.
fn read_vertical(value: &str) -> Result<Option<bool>> {
    match value {
        "true" => Ok(Some(true)),
        "false" => Ok(Some(false)),
        "none" => Ok(None),
        other => Err(Error::value("vertical", format!("'{other}'"), "true, false or none")),
    }
}

/// The disparities, if given.
fn read_disparities(min_disparity: i32, num_disparities: i32) -> Result<Option<Range<i64>>> {
    if num_disparities != 0 {
        let (min, count) = (i64::from(min_disparity), i64::from(num_disparities));
        return Ok(Some(min..min + count));
    }

    if min_disparity != 0 {
        let accepts = "0 where num_disparities is 0, since the whole range is then estimated";
        return Err(Error::value("min_disparity", min_disparity, accepts));
    }

    Ok(None)
}

/// Both images, and their descriptions.
///
/// # Safety
///
/// The fields of the images are true, or the pointers are NULL.
unsafe fn read_images([left, right]: [*const Image; 2]) -> Result<(Images, [Image; 2])> {
    // SAFETY: as the caller promises.
    let given = unsafe { [sized::read(left, "left")?, sized::read(right, "right")?] };
    // SAFETY: as above.
    Ok((unsafe { [given[0].copied("left")?, given[1].copied("right")?] }, given))
}

/// The matcher of a caller; one made before a fork is refused, since it would wait for its threads forever.
///
/// # Safety
///
/// The pointer is to a matcher that outlives `'a`, or NULL.
unsafe fn ours<'a>(matcher: *const Matcher) -> Result<&'a phasestereo::Matcher> {
    // SAFETY: as the caller promises.
    let Matcher { matcher, process } = unsafe { reference(matcher, "matcher")? };
    if *process != this_process() {
        let got = format!("one of process {process}");
        return Err(Error::value("matcher", got, "one that was made after the fork"));
    }
    Ok(matcher)
}

/// The value that a pointer points to; NULL is refused.
///
/// # Safety
///
/// The pointer is to a value that outlives `'a`, or NULL.
unsafe fn reference<'a, T>(pointer: *const T, argument: &'static str) -> Result<&'a T> {
    // SAFETY: as the caller promises.
    unsafe { pointer.as_ref() }.ok_or_else(|| Error::value(argument, "NULL", "a pointer"))
}

/// A list of `count` settings; if `count` is 0, the pointer is not read.
///
/// # Safety
///
/// The pointer is to this many values that outlive `'a`, or NULL.
unsafe fn list<'a>(settings: *const Setting, count: usize) -> Result<&'a [Setting]> {
    if count == 0 {
        return Ok(&[]);
    }

    // SAFETY: as the caller promises.
    unsafe {
        reference(settings, "settings")?;
        Ok(std::slice::from_raw_parts(settings, count))
    }
}

/// A text; `None` for NULL.
///
/// # Safety
///
/// The pointer is to a text that ends with a zero and outlives `'a`, or NULL.
unsafe fn text<'a>(pointer: *const c_char, argument: &'static str) -> Result<Option<&'a str>> {
    if pointer.is_null() {
        return Ok(None);
    }

    // SAFETY: as the caller promises.
    let text = unsafe { CStr::from_ptr(pointer) };

    let refused = |_| Error::value(argument, format!("{text:?}"), "text in UTF-8");
    text.to_str().map(Some).map_err(refused)
}

/// The caller's memory for estimates, with its size; `None` for NULL.
///
/// # Safety
///
/// The pointer is to at least the number of bytes in its first field, or NULL.
unsafe fn place(found: *mut Found) -> Result<Option<(*mut Found, usize)>> {
    // SAFETY: as the caller promises.
    let size = |found| unsafe { sized::size(found, "found") };
    if found.is_null() { Ok(None) } else { Ok(Some((found, size(found)?))) }
}

/// Writes the estimates, if they fit into memory.
///
/// # Safety
///
/// As for [`place`].
unsafe fn write(place: Option<(*mut Found, usize)>, found: &Found) {
    if let Some((place, size)) = place {
        // SAFETY: as the caller promises.
        unsafe { sized::write(place, size, found) };
    }
}

fn status(work: impl FnOnce() -> Result<()>) -> Status {
    guarded(work).err().unwrap_or(Status::Ok)
}

/// Runs the work of a call; the message of a failure, including a panic, is kept for `phasestereo_error`.
fn guarded<T>(work: impl FnOnce() -> Result<T>) -> std::result::Result<T, Status> {
    let (status, message) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(done)) => return Ok(done),
        Ok(Err(error)) => (Status::from(&error), error.to_string()),
        Err(panic) => {
            (Status::Internal, format!("internal error, please report it: {}", message_of(&*panic)))
        }
    };

    // C texts end at the first zero.
    let message = CString::new(message.replace('\0', " ")).unwrap_or_default();
    ERROR.set(message);
    Err(status)
}

/// The message of a panic.
fn message_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();

    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("a panic")
}

impl From<&Error> for Status {
    fn from(error: &Error) -> Self {
        match error {
            Error::Value { .. } => Self::InvalidArgument,
            Error::OutOfMemory { .. } => Self::OutOfMemory,
            Error::Threads(_) => Self::Threads,
            // Nothing cancels a call; later variants are not faults of its arguments.
            _ => Self::Internal,
        }
    }
}

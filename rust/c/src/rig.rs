//! Two cameras that take one pair after another, for C.

use std::ffi::c_char;
use std::ptr;
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use phasestereo::{Error, Result};

use crate::found::Found;
use crate::images::{Image, Map};
use crate::{Matcher, Status, guarded, matched, reference, status, text};

/// Facts about two cameras, learned from pair to pair, and the temporal filter of their video. Pairs are
/// matched one after another: of two simultaneous calls, one is refused. It has no threads, and survives a
/// fork.
#[derive(Debug)]
pub struct Rig(Mutex<phasestereo::Rig>);

/// Makes a new rig, or restores one from a `text` that `phasestereo_rig_text` wrote (NULL: new). With
/// `steadied` 1, disparities of its pairs are filtered over time where neither image changes; with 0, they
/// are not. Blur is estimated again after at most `reestimate` pairs, 0: 30; with 1 every pair is matched by
/// itself. NULL if it fails.
///
/// # Safety
///
/// The text ends with a zero, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rig_new(
    text: *const c_char,
    steadied: u32,
    reestimate: u32,
) -> *mut Rig {
    let made = guarded(|| {
        let reestimate = if reestimate == 0 { phasestereo::Rig::REESTIMATE } else { reestimate.into() };
        let rig = phasestereo::Rig::new(steadied != 0, reestimate);
        // SAFETY: as the caller promises.
        let rig = match unsafe { self::text(text, "text")? } {
            Some(written) => rig.with_text(written)?,
            None => rig,
        };
        Ok(Rig(Mutex::new(rig)))
    });

    made.map_or(ptr::null_mut(), |rig| Box::into_raw(Box::new(rig)))
}

/// Frees a rig. NULL is ignored.
///
/// # Safety
///
/// The rig comes from `phasestereo_rig_new`, no call is using it, and none will.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rig_free(rig: *mut Rig) {
    if !rig.is_null() {
        // SAFETY: as the caller promises.
        drop(unsafe { Box::from_raw(rig) });
    }
}

/// Matches the next pair of a rig, which learns from it; everything else is as for `phasestereo_match`. It
/// learns nothing from a call that fails. The matcher may differ from pair to pair.
///
/// # Safety
///
/// As for `phasestereo_match`; the rig comes from `phasestereo_rig_new`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rig_match(
    rig: *mut Rig,
    matcher: *const Matcher,
    left: *const Image,
    right: *const Image,
    min_disparity: i32,
    num_disparities: i32,
    map: *const Map,
    found: *mut Found,
) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        let mut rig = unsafe { held(rig)? };
        let disparities = (min_disparity, num_disparities);
        // SAFETY: as above.
        unsafe {
            matched(matcher, [left, right], disparities, (0, map), found, |matcher, [left, right], range| {
                matcher.match_frame(&mut rig, left, right, range)
            })
        }
    })
}

/// Forgets all pairs of a rig, and the facts from a text: it is like a new one.
///
/// # Safety
///
/// The rig comes from `phasestereo_rig_new`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rig_reset(rig: *mut Rig) -> Status {
    status(|| {
        // SAFETY: as the caller promises.
        unsafe { held(rig)? }.reset();
        Ok(())
    })
}

/// Writes the known facts about the cameras as text that ends with a zero, if it fits into `room` bytes, and
/// returns its size in bytes; 0 if it fails. `text` may be NULL if `room` is 0. `phasestereo_rig_new` and
/// Python's `Rig.load` read it; the temporal filter is left out.
///
/// # Safety
///
/// The rig comes from `phasestereo_rig_new`, and `text` points to `room` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_rig_text(rig: *const Rig, text: *mut c_char, room: usize) -> usize {
    let written = guarded(|| {
        // SAFETY: as the caller promises.
        let written = unsafe { held(rig)? }.text()? + "\0";
        if written.len() <= room {
            // SAFETY: as above.
            unsafe {
                reference(text, "text")?;
                written.as_ptr().copy_to_nonoverlapping(text.cast(), written.len());
            }
        }
        Ok(written.len())
    });

    written.unwrap_or(0)
}

/// The rig of a caller, unless another call is using it.
///
/// # Safety
///
/// The pointer is to a rig that outlives `'a`, or NULL.
unsafe fn held<'a>(rig: *const Rig) -> Result<MutexGuard<'a, phasestereo::Rig>> {
    // SAFETY: as the caller promises.
    let Rig(rig) = unsafe { reference(rig, "rig")? };
    match rig.try_lock() {
        Ok(held) => Ok(held),
        Err(TryLockError::Poisoned(held)) => Ok(PoisonError::into_inner(held)),
        Err(TryLockError::WouldBlock) => {
            Err(Error::value("rig", "one that is in use", "one that no other call is using"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_calls_at_the_same_time_one_is_refused() {
        // SAFETY: the rig comes from the first call, and the last one frees it.
        unsafe {
            let rig = phasestereo_rig_new(ptr::null(), 1, 0);
            let other = held(rig).expect("nobody holds it");
            assert_eq!(phasestereo_rig_reset(rig), Status::InvalidArgument);
            drop(other);
            assert_eq!(phasestereo_rig_reset(rig), Status::Ok);
            phasestereo_rig_free(rig);
        }
    }
}

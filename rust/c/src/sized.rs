//! Structures that begin with their size when the program was compiled: they can grow at their end.
//!
//! If a program's structure is smaller, only its bytes are read or written, and missing ones are zero. If it
//! is larger, from a newer header, the rest is written as zeros, and must be zero when read.

use std::mem::MaybeUninit;

use phasestereo::{Error, Result};

/// The smallest and largest possible size: anything else is memory that was never written.
const MOST: usize = 4096;

/// A structure whose fields are never moved; new ones are added at its end.
///
/// # Safety
///
/// It is `repr(C)`, its first field is its size as a `usize`, and its bytes may be zeros.
pub unsafe trait Growing: Copy {
    /// Bytes up to the last field that all versions have.
    const LEAST: usize;
}

/// A caller's structure, as this version defines it.
///
/// # Safety
///
/// The pointer is to at least the number of bytes in its first field, or NULL.
pub unsafe fn read<T: Growing>(place: *const T, argument: &'static str) -> Result<T> {
    // SAFETY: as the caller promises.
    let size = unsafe { size(place, argument)? };
    let mut known = MaybeUninit::<T>::zeroed();

    // SAFETY: both have this number of bytes; zeros are a value of the type.
    let (known, rest) = unsafe {
        place.cast::<u8>().copy_to_nonoverlapping(known.as_mut_ptr().cast(), size.min(size_of::<T>()));
        let start = place.cast::<u8>().wrapping_add(size_of::<T>());
        (known.assume_init(), std::slice::from_raw_parts(start, size.saturating_sub(size_of::<T>())))
    };

    if rest.iter().any(|byte| *byte != 0) {
        let got = format!("fields that version {} does not know", env!("CARGO_PKG_VERSION"));
        return Err(Error::value(argument, got, "zeros in them"));
    }
    Ok(known)
}

/// Writes the part of a structure that fits the caller's; its size stays.
///
/// # Safety
///
/// As for [`read`]; the size comes from [`size`], and the pointer is not NULL.
pub unsafe fn write<T: Growing>(place: *mut T, size: usize, value: &T) {
    let (place, value) = (place.cast::<u8>(), std::ptr::from_ref(value).cast::<u8>());
    let (start, end) = (size_of::<usize>(), size.min(size_of::<T>()));

    // SAFETY: as the caller promises.
    unsafe {
        value.add(start).copy_to_nonoverlapping(place.add(start), end - start);
        place.add(end).write_bytes(0, size - end);
    }
}

/// The size of a caller's structure, in bytes.
///
/// # Safety
///
/// The pointer is to a structure whose first field is written, or NULL.
pub unsafe fn size<T: Growing>(place: *const T, argument: &'static str) -> Result<usize> {
    if place.is_null() {
        return Err(Error::value(argument, "NULL", "a pointer"));
    }

    // SAFETY: as the caller promises.
    let size = unsafe { place.cast::<usize>().read() };
    if !(T::LEAST..=MOST).contains(&size) {
        let (least, whole) = (T::LEAST, size_of::<T>());
        let accepts = format!("its sizeof: {whole}, and at least {least}");
        return Err(Error::value(argument, format!("a struct_size of {size}"), accepts));
    }
    Ok(size)
}

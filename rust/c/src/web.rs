//! Memory of the module for a page's script, to write images into and to read maps from.

use std::alloc::{Layout, alloc, dealloc};
use std::ptr;

/// Suffices for numbers of any type.
const ALIGNMENT: usize = 16;

fn layout(bytes: usize) -> Option<Layout> {
    Layout::from_size_align(bytes.max(1), ALIGNMENT).ok()
}

/// Allocates uninitialized bytes; NULL where there is not enough memory.
#[unsafe(no_mangle)]
pub extern "C" fn phasestereo_allocate(bytes: usize) -> *mut u8 {
    // SAFETY: the layout is not empty.
    layout(bytes).map_or(ptr::null_mut(), |layout| unsafe { alloc(layout) })
}

/// Frees bytes.
///
/// # Safety
///
/// They are those of [`phasestereo_allocate`], which was called with the same number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_release(start: *mut u8, bytes: usize) {
    if let Some(layout) = layout(bytes).filter(|_| !start.is_null()) {
        // SAFETY: as the caller promises.
        unsafe { dealloc(start, layout) };
    }
}

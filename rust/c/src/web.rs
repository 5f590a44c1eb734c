//! Functions only for a page's script: memory to write images into and to read maps from, and searches on its
//! GPU.

use std::alloc::{Layout, alloc, dealloc};
use std::ops::Range;
use std::ptr;
use std::sync::{Arc, OnceLock};

use phasestereo::{Engine, Result};
use phasestereo_match::optimization::engine::Chunk;
use phasestereo_match::optimization::evidence::Evidence;
use phasestereo_match::optimization::kernels::{self, FOUND, MOST_BYTES, SHADER};
use phasestereo_match::optimization::tasks::{self, Limits, Task};

use crate::Matcher;

/// Sufficient for numbers of any type.
const ALIGNMENT: usize = 16;
/// Most bytes of the reason for a failure.
const REASON: usize = 1000;

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Runs a task on the page's GPU while WebAssembly waits. Returns 0, or the length in bytes of the reason
    /// for a failure. The plan is JSON; places are pairs of a start and a number of bytes:
    ///
    /// - `words`: those of the candidates of a pixel, for which kernels are compiled
    /// - `source`: the place of their text in WGSL
    /// - `inputs`: the places of the contents of the first buffers
    /// - `sizes`: bytes of each buffer
    /// - `kernels`, `groups`: those to run one after another, and the workgroups of each
    /// - `found`, `reason`: the places for the contents of the last buffer and for a reason
    fn phasestereo_search(plan: *const u8, bytes: usize) -> usize;
}

fn layout(bytes: usize) -> Option<Layout> {
    Layout::from_size_align(bytes.max(1), ALIGNMENT).ok()
}

/// Allocates uninitialized bytes; NULL if there is not enough memory.
#[unsafe(no_mangle)]
pub extern "C" fn phasestereo_allocate(bytes: usize) -> *mut u8 {
    // SAFETY: the layout is not empty.
    layout(bytes).map_or(ptr::null_mut(), |layout| unsafe { alloc(layout) })
}

/// Frees bytes.
///
/// # Safety
///
/// They come from [`phasestereo_allocate`], called with the same number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_release(start: *mut u8, bytes: usize) {
    if let Some(layout) = layout(bytes).filter(|_| !start.is_null()) {
        // SAFETY: as the caller promises.
        unsafe { dealloc(start, layout) };
    }
}

/// Lets a matcher search on the page's GPU, whose workgroups have this many threads and whose buffers this
/// many bytes (JavaScript numbers). Returns the matcher; its old pointer becomes invalid.
///
/// # Safety
///
/// The matcher comes from `phasestereo_new`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_with_gpu(
    matcher: *mut Matcher,
    threads: f64,
    buffer: f64,
) -> *mut Matcher {
    // SAFETY: as the caller promises.
    let Matcher { matcher, process } = *unsafe { Box::from_raw(matcher) };
    let limits = Limits { threads: threads as u64, buffer: buffer as u64, volume: MOST_BYTES };
    let gpu = PageGpu { limits, failure: OnceLock::new() };
    let matcher = matcher.with_engine(Arc::new(gpu));
    Box::into_raw(Box::new(Matcher { matcher, process }))
}

/// The GPU of the page. The first failure ends its use.
#[derive(Debug)]
struct PageGpu {
    limits: Limits,
    failure: OnceLock<String>,
}

impl PageGpu {
    /// The result of a task; `None`: it failed.
    fn run(&self, task: &Task) -> Option<Vec<u32>> {
        let source = kernels::constants(task.words()) + SHADER;
        let mut found = vec![0_u32; task.found_words()];
        let mut reason = vec![0; REASON];

        let place = |bytes: &[u8]| [bytes.as_ptr().expose_provenance(), bytes.len()];
        let numbers = [task.numbers.as_ptr().expose_provenance(), size_of_val(&task.numbers)];
        let inputs = [numbers, place(task.left), place(task.right), place(task.pixels)];
        let sizes = kernels::sizes(task);
        let (names, groups): (Vec<_>, Vec<_>) = kernels::steps(task).into_iter().unzip();
        let plan = format!(
            r#"{{"words": {}, "source": {:?}, "inputs": {inputs:?}, "sizes": {sizes:?}, "kernels": {names:?},
            "groups": {groups:?}, "found": {:?}, "reason": {:?}}}"#,
            task.words(),
            place(source.as_bytes()),
            [found.as_mut_ptr().expose_provenance(), sizes[FOUND] as usize],
            [reason.as_mut_ptr().expose_provenance(), REASON],
        );

        // SAFETY: the script writes only to the two places, which nothing else refers to meanwhile.
        let length = unsafe { phasestereo_search(plan.as_ptr(), plan.len()) };
        if length == 0 {
            return Some(found);
        }
        reason.truncate(length);
        let _ = self.failure.set(String::from_utf8_lossy(&reason).into_owned());
        None
    }
}

impl Engine for PageGpu {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        if self.failure.get().is_some() {
            return Ok(false);
        }
        tasks::choose(rows, chunk, self.limits, evidence, |task| self.run(task))
    }

    fn failure(&self) -> Option<String> {
        self.failure.get().cloned()
    }
}

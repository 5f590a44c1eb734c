//! Findings for C, one at a time.

use std::cell::RefCell;
use std::ffi::{CString, c_char};

use phasestereo::Severity;

use crate::guarded;
use crate::sized::{self, Growing};

/// All is well.
pub const PHASESTEREO_OK: u32 = 0;
/// Worth knowing.
pub const PHASESTEREO_NOTE: u32 = 1;
/// To be fixed; for a match: it is unreliable as a whole.
pub const PHASESTEREO_WARNING: u32 = 2;

thread_local! {
    /// The findings of the last match, check, preparation or estimate on this thread.
    static FINDINGS: RefCell<Vec<Kept>> = RefCell::default();
}

/// One statement about a pair or its match. Texts end with a zero.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Finding {
    /// `sizeof(phasestereo_finding)`, to be set before the call.
    pub struct_size: usize,
    /// Its topic, such as "range"; the names are those of the Python package.
    pub topic: *const c_char,
    /// Plain words, with numbers.
    pub sentence: *const c_char,
    /// `PHASESTEREO_OK`, `PHASESTEREO_NOTE` or `PHASESTEREO_WARNING`.
    pub severity: u32,
}

// SAFETY: it begins with its size; zeros are numbers and NULL.
unsafe impl Growing for Finding {
    const LEAST: usize = size_of::<Self>();
}

/// A finding whose texts are kept.
struct Kept {
    topic: CString,
    sentence: CString,
    severity: u32,
}

impl From<phasestereo::Finding> for Kept {
    fn from(found: phasestereo::Finding) -> Self {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let severity = match found.severity {
            Severity::Ok => PHASESTEREO_OK,
            Severity::Note => PHASESTEREO_NOTE,
            Severity::Warning => PHASESTEREO_WARNING,
        };

        Self { topic: text(found.topic.name()), sentence: text(&found.sentence), severity }
    }
}

/// Keeps the findings of a call for its thread.
pub fn keep(findings: Vec<phasestereo::Finding>) {
    FINDINGS.set(findings.into_iter().map(Kept::from).collect());
}

/// Writes a finding of the last successful match, check, preparation or estimate on this thread, and
/// returns 1; 0 if there are fewer, or `finding` is invalid. A match has noteworthy findings, the worst first;
/// a check has one for everything examined, in a fixed order. Texts are valid until the next such call on
/// this thread.
///
/// # Safety
///
/// The pointer is to memory for a finding.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn phasestereo_get_finding(index: u32, finding: *mut Finding) -> u32 {
    // SAFETY: as the caller promises.
    let size = guarded(|| unsafe { sized::size(finding, "finding") });
    let Ok(size) = size else { return 0 };

    FINDINGS.with_borrow(|kept| {
        let Some(Kept { topic, sentence, severity }) = kept.get(index as usize) else { return 0 };
        let (topic, sentence) = (topic.as_ptr(), sentence.as_ptr());
        let told = Finding { struct_size: size, topic, sentence, severity: *severity };
        // SAFETY: as the caller promises.
        unsafe { sized::write(finding, size, &told) };
        1
    })
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;
    use std::ptr;

    use super::*;
    use phasestereo::Topic;

    #[test]
    fn findings_are_read_one_after_another() {
        let found = phasestereo::Finding::new(Topic::Range, Severity::Warning, "too short");
        keep(vec![phasestereo::Finding::new(Topic::Noise, Severity::Note, "noisy"), found]);

        let struct_size = size_of::<Finding>();
        let mut read = Finding { struct_size, topic: ptr::null(), sentence: ptr::null(), severity: 9 };
        // SAFETY: the pointer is to memory for a finding, or NULL, which is refused.
        unsafe {
            assert_eq!(phasestereo_get_finding(2, &raw mut read), 0);
            assert_eq!(phasestereo_get_finding(0, ptr::null_mut()), 0);
            assert_eq!(phasestereo_get_finding(1, &raw mut read), 1);
        }

        // SAFETY: the texts end with a zero and are kept until the next call.
        let texts = unsafe { [CStr::from_ptr(read.topic), CStr::from_ptr(read.sentence)] };
        assert_eq!((texts, read.severity), ([c"range", c"too short"], PHASESTEREO_WARNING));
    }
}

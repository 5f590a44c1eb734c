//! What one call of Python carries over to the next one: the temporal filter of a video.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use pyo3::prelude::*;

use phasestereo::Error;
use phasestereo::internals::video::temporal::TemporalFilter as Filter;

/// A filter that a running call and Python both hold.
pub type Shared = Arc<Mutex<Filter>>;

/// The filter of one video.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug, Default)]
pub struct TemporalFilter(Shared);

#[pymethods]
impl TemporalFilter {
    #[new]
    fn new() -> Self {
        Self::default()
    }
}

impl TemporalFilter {
    /// The filter, for a call.
    pub fn shared(&self) -> Shared {
        Arc::clone(&self.0)
    }
}

/// What a running call holds of something that Python holds, too. It is not waited for: frames come one after another, and in a
/// forked child the holder may not exist.
pub fn held<'a, T>(
    shared: &'a Mutex<T>,
    argument: &'static str,
) -> phasestereo::Result<MutexGuard<'a, T>> {
    match shared.try_lock() {
        Ok(held) => Ok(held),
        Err(TryLockError::Poisoned(held)) => Ok(PoisonError::into_inner(held)),
        Err(TryLockError::WouldBlock) => {
            let accepts = "one that no other match is using: it is of one video";
            Err(Error::value(argument, "one that is in use", accepts))
        }
    }
}

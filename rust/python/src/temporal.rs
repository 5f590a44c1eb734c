//! What one call of Python carries over to the next one: the temporal filter of a video.

use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::time::Duration;

use pyo3::prelude::*;

use phasestereo::Error;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::pipeline::matcher::Disparity;
use phasestereo::internals::pipeline::pair::Pair;
use phasestereo::internals::pipeline::platform::Instant;
use phasestereo::internals::pipeline::runtime::Runtime;
use phasestereo::internals::pipeline::temporal::TemporalFilter as Filter;
use phasestereo::internals::settings::Settings;

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

/// Filters the map of the next frame on the threads of a matcher; returns how many frames support each disparity, and
/// the time.
pub fn apply(
    filter: &Shared,
    pair: &Pair,
    settings: &Settings,
    map: &mut Disparity,
    runtime: Runtime,
) -> phasestereo::Result<(Plane<u8>, Duration)> {
    let started = Instant::now();

    // The lock is not waited for: frames come one after another, and in a forked child the holder may not exist.
    let mut held = match filter.try_lock() {
        Ok(filter) => filter,
        Err(TryLockError::Poisoned(filter)) => PoisonError::into_inner(filter),
        Err(TryLockError::WouldBlock) => {
            let accepts = "one that no other match is using: a filter is of one video";
            return Err(Error::value("temporal_filter", "a filter that is in use", accepts));
        }
    };

    let Runtime { matcher, execution, control } = runtime;
    let filter = &mut *held;
    let frames = matcher.install(|| filter.apply(pair, settings, map, execution.level, control))?;
    Ok((frames, started.elapsed()))
}

//! State that a Python call carries over to the next one, and the temporal filter of a video.

use std::mem;
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;

use phasestereo::Error;
use phasestereo::internals::video::temporal::TemporalFilter as Filter;

/// A value that matches change one after another. A match works on a copy and puts it back, so the lock is
/// held only for moments, and by a thread that is attached to Python: no child is forked meanwhile.
#[derive(Debug, Default)]
pub struct Carried<T> {
    value: Mutex<T>,
    /// The process of the match that has the turn; 0: no match has it.
    holder: AtomicU32,
}

/// The turn of one match, until it is dropped.
#[derive(Debug)]
pub struct Turn<'a, T>(&'a Carried<T>);

impl<T> Carried<T> {
    /// A value that no match has changed yet.
    pub fn new(value: T) -> Self {
        Self { value: Mutex::new(value), holder: AtomicU32::new(0) }
    }

    /// The value as the last match left it.
    pub fn value(&self) -> MutexGuard<'_, T> {
        self.value.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The turn of a match, unless another one of this process has it. In a forked child, a match of the
    /// parent does not continue, so its turn has ended.
    pub fn turn(&self, argument: &'static str) -> phasestereo::Result<Turn<'_, T>> {
        let ours = process::id();
        let take = |holder| (holder != ours).then_some(ours);
        let taken = self.holder.fetch_update(Ordering::AcqRel, Ordering::Acquire, take);
        if taken.is_ok() {
            return Ok(Turn(self));
        }
        let accepts = "one that no other match is using: it is of one video";
        Err(Error::value(argument, "one that is in use", accepts))
    }
}

impl<T> Turn<'_, T> {
    /// Replaces the value, and returns the previous one.
    pub fn replace(&self, value: T) -> T {
        mem::replace(&mut *self.0.value(), value)
    }

    /// The value as the last match left it.
    pub fn value(&self) -> MutexGuard<'_, T> {
        self.0.value()
    }
}

impl<T> Drop for Turn<'_, T> {
    fn drop(&mut self) {
        self.0.holder.store(0, Ordering::Release);
    }
}

/// The filter of one video.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug, Default)]
pub struct TemporalFilter(Carried<Filter>);

#[pymethods]
impl TemporalFilter {
    #[new]
    fn new() -> Self {
        Self::default()
    }
}

impl TemporalFilter {
    /// The turn of a match. If it does not put its filter back, for example after an interruption, the filter
    /// is new.
    pub fn turn(&self) -> phasestereo::Result<Turn<'_, Filter>> {
        self.0.turn("temporal_filter")
    }
}

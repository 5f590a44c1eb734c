//! Progress, cancellation and the time limit of a running match.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use crate::base::error::{Error, Result};
use crate::base::platform::Instant;

/// Progress and cancellation, shared by the threads that match and the one that waits for them.
#[derive(Debug, Default)]
pub struct Control {
    cancelled: Arc<AtomicBool>,
    rows_done: AtomicUsize,
    rows_expected: AtomicUsize,
    /// When the match began, and its time limit.
    budget: OnceLock<(Instant, Duration)>,
    /// The time that checkpoints keep in reserve.
    reserved: Option<Duration>,
}

impl Control {
    /// A control for work whose rows do not belong to the disparity map: it is cancelled together with this
    /// one, but counts its own rows.
    #[doc(hidden)]
    pub fn aside(&self) -> Self {
        let (cancelled, budget) = (Arc::clone(&self.cancelled), self.budget.clone());
        Self { cancelled, budget, ..Self::default() }
    }

    /// Like [`Self::aside`], but checkpoints return [`Error::Cancelled`] once only this much of the budget is
    /// left.
    #[doc(hidden)]
    pub fn aside_leaving(&self, reserved: Duration) -> Self {
        Self { reserved: Some(reserved), ..self.aside() }
    }

    /// Starts the clock of a match that may take this many seconds. If the clock is already running, it keeps
    /// running.
    #[doc(hidden)]
    pub fn begin(&self, budget: Option<f64>) {
        if let Some(seconds) = budget {
            self.budget.get_or_init(|| (Instant::now(), Duration::from_secs_f64(seconds)));
        }
    }

    /// Whether this work fits in the rest of the budget.
    #[doc(hidden)]
    pub fn has_time_for(&self, work: Duration) -> bool {
        self.budget.get().is_none_or(|(begun, budget)| begun.elapsed() + work <= *budget)
    }

    /// Whether [`Self::cancel`] was called.
    #[doc(hidden)]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Asks all threads to stop at their next checkpoints.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// An error after [`Self::cancel`], or once the reserve would be used; long loops call this every few
    /// milliseconds.
    #[doc(hidden)]
    pub fn checkpoint(&self) -> Result<()> {
        let is_late = self.reserved.is_some_and(|reserved| !self.has_time_for(reserved));
        if is_late || self.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Adds finished rows of the disparity map.
    #[doc(hidden)]
    pub fn finish_rows(&self, rows: usize) {
        self.rows_done.fetch_add(rows, Ordering::Relaxed);
    }

    /// Sets the number of rows of the map if it is not that of the left image, since the pair was turned.
    #[doc(hidden)]
    pub fn expect_rows(&self, rows: usize) {
        self.rows_expected.store(rows, Ordering::Relaxed);
    }

    /// The number of rows of a turned pair's map; `None`: that of the left image.
    pub fn rows_expected(&self) -> Option<usize> {
        Some(self.rows_expected.load(Ordering::Relaxed)).filter(|rows| *rows > 0)
    }

    /// Number of finished rows of the disparity map.
    pub fn rows_done(&self) -> usize {
        self.rows_done.load(Ordering::Relaxed)
    }
}

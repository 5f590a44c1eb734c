//! Progress and cancellation of a running match.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::base::error::{Error, Result};

/// Progress and cancellation, shared between the threads that match and the one that waits for them.
#[derive(Debug, Default)]
pub struct Control {
    cancelled: Arc<AtomicBool>,
    rows_done: AtomicUsize,
    rows_expected: AtomicUsize,
}

impl Control {
    /// A control for work whose rows are not those of the disparity map: it is cancelled together with this
    /// one, and its rows are counted apart.
    #[doc(hidden)]
    pub fn aside(&self) -> Self {
        Self { cancelled: Arc::clone(&self.cancelled), ..Self::default() }
    }

    /// Asks every thread to stop at its next checkpoint.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// An error once [`Self::cancel`] was called; long loops call this every few milliseconds.
    #[doc(hidden)]
    pub fn checkpoint(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Adds finished rows of the disparity map.
    #[doc(hidden)]
    pub fn finish_rows(&self, rows: usize) {
        self.rows_done.fetch_add(rows, Ordering::Relaxed);
    }

    /// Says that the map will have this many rows: not those of the left image, since the pair was turned.
    #[doc(hidden)]
    pub fn expect_rows(&self, rows: usize) {
        self.rows_expected.store(rows, Ordering::Relaxed);
    }

    /// The rows of the map of a pair that was turned; `None`: those of the left image.
    pub fn rows_expected(&self) -> Option<usize> {
        Some(self.rows_expected.load(Ordering::Relaxed)).filter(|rows| *rows > 0)
    }

    /// Number of finished rows of the disparity map.
    pub fn rows_done(&self) -> usize {
        self.rows_done.load(Ordering::Relaxed)
    }
}

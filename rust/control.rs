//! How a running match is watched and stopped from outside.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// Shared between the threads that match and the one that waits for them.
#[derive(Debug, Default)]
pub struct Control {
    cancelled: AtomicBool,
    rows_done: AtomicUsize,
}

impl Control {
    /// Asks every thread to stop at its next checkpoint.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// An error once [`Self::cancel`] was called; to be asked at least once per image row.
    pub fn checkpoint(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// Counts one finished row of the disparity map.
    pub fn row_done(&self) {
        self.rows_done.fetch_add(1, Ordering::Relaxed);
    }

    /// Finished rows of the disparity map.
    pub fn rows_done(&self) -> usize {
        self.rows_done.load(Ordering::Relaxed)
    }
}

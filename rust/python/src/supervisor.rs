//! The supervision of a running call: while the interpreter is released, Ctrl-C and progress are handled.

use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;

use super::internal;
use crate::failure::{Failure, Result};
use crate::workers::{Pool, Work};

use phasestereo_match::base::control::Control;
use phasestereo_match::matcher::runtime::Runtime;

/// How often a running call checks for Ctrl-C and reports its progress.
const TICK: Duration = Duration::from_millis(50);
/// How long to wait for a cancelled call. It ends within milliseconds once it has started, but before that it
/// may have to wait for others.
const PATIENCE: Duration = Duration::from_millis(500);

/// Runs `work` on the threads of a pool. An exception, whether Ctrl-C or from `progress`, cancels it.
pub fn supervised<T: Send + 'static>(
    py: Python<'_>,
    pool: &Arc<Pool>,
    rows: usize,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(Runtime<'_>) -> phasestereo::Result<T> + Send + 'static,
) -> Result<T> {
    let result = Arc::new(Mutex::new(None));
    let written = Arc::clone(&result);
    let work = move |runtime: Runtime| {
        let found = work(runtime)?;
        *written.lock().unwrap_or_else(PoisonError::into_inner) = Some(found);
        Ok(())
    };

    // Only the code above is compiled for each type of result.
    supervise(py, pool, rows, progress.map(Bound::unbind), Box::new(work))?;
    let found = result.lock().unwrap_or_else(PoisonError::into_inner).take();
    found.ok_or_else(|| internal("a call that succeeded left no result"))
}

fn supervise(
    py: Python<'_>,
    pool: &Arc<Pool>,
    rows: usize,
    progress: Option<Py<PyAny>>,
    work: Box<Work>,
) -> Result<()> {
    let control = Arc::new(Control::default());

    let report = |py: Python<'_>| -> Result<()> {
        py.check_signals()?;
        let Some(progress) = &progress else {
            return Ok(());
        };

        progress.call1(py, (control.rows_done(), control.rows_expected().unwrap_or(rows)))?;
        Ok(())
    };

    py.detach(|| {
        // While the call waits for its turn, Ctrl-C works the same as later.
        let turn = loop {
            match pool.turn(TICK) {
                Some(turn) => break turn,
                None => Python::attach(report)?,
            }
        };

        let finished = turn.start(&control, work);
        loop {
            match finished.recv_timeout(TICK) {
                Ok(outcome) => return outcome.map_err(Failure::from),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(internal("a worker thread panicked"));
                }
                Err(RecvTimeoutError::Timeout) => Python::attach(report).inspect_err(|_| {
                    control.cancel();
                    // Waits briefly for the threads to stop; the result is no longer wanted.
                    let _ = finished.recv_timeout(PATIENCE);
                })?,
            }
        }
    })?;

    // The last report has all rows, and a Ctrl-C during the last tick counts, too.
    report(py)
}

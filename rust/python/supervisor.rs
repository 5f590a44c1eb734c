//! A running match beside the interpreter, which it lets go: Ctrl-C and progress are minded meanwhile.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use super::internal;
use crate::control::Control;
use crate::error::{Error, Result};

/// How often a running match looks for Ctrl-C and reports its progress.
const TICK: Duration = Duration::from_millis(50);

/// Runs `work` on a thread of its own. An exception, be it Ctrl-C or from `progress`, cancels it.
pub fn supervised<T: Send>(
    py: Python<'_>,
    control: &Control,
    rows: usize,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    let progress = progress.map(Bound::unbind);
    let report = |py: Python<'_>| -> PyResult<()> {
        py.check_signals()?;
        let Some(progress) = &progress else { return Ok(()) };
        progress.call1(py, (control.rows_done(), rows)).map(drop)
    };
    let outcome = py.detach(|| {
        thread::scope(|scope| {
            let (finish, finished) = channel::<()>();
            let worker = thread::Builder::new().spawn_scoped(scope, move || {
                // Dropped when the work ends, even by a panic: that wakes the supervisor.
                let _finish = finish;
                work()
            });
            let worker = worker.map_err(|error| Error::Threads(error.to_string()))?;
            let mut interruption = Ok(());
            while interruption.is_ok()
                && finished.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout)
            {
                interruption = Python::attach(report);
            }
            if interruption.is_err() {
                control.cancel();
            }
            let outcome = worker.join().map_err(|_| internal("a worker thread panicked"))?;
            interruption.and(outcome.map_err(PyErr::from))
        })
    })?;
    report(py)?;
    Ok(outcome)
}

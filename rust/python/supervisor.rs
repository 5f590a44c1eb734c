//! The supervision of a running call: while the interpreter is released, Ctrl-C and progress are handled.

use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use pyo3::prelude::*;

use super::internal;
use super::workers::Pool;
use crate::error::Result;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::Matcher;

/// How often a running call checks for Ctrl-C and reports its progress.
const TICK: Duration = Duration::from_millis(50);
/// How long to wait for a cancelled call. It ends within milliseconds once it has begun, and until then it may have to
/// wait for others.
const PATIENCE: Duration = Duration::from_millis(500);

/// Does `work` on the threads of a pool. An exception, be it Ctrl-C or from `progress`, cancels it.
pub fn supervised<T: Send + 'static>(
    py: Python<'_>,
    pool: &Arc<Pool>,
    rows: usize,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(&Matcher, &Control) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let progress = progress.map(Bound::unbind);
    let control = Arc::new(Control::default());

    let report = |py: Python<'_>| -> PyResult<()> {
        py.check_signals()?;
        let Some(progress) = &progress else {
            return Ok(());
        };

        progress.call1(py, (control.rows_done(), rows)).map(drop)
    };

    let outcome = py.detach(|| {
        let turn = loop {
            match pool.turn(TICK) {
                Some(turn) => break turn,
                None => Python::attach(report)?,
            }
        };

        let finished = turn.start(&control, work);

        loop {
            match finished.recv_timeout(TICK) {
                Ok(outcome) => return outcome.map_err(PyErr::from),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(internal("a worker thread panicked"));
                }
                Err(RecvTimeoutError::Timeout) => Python::attach(report).inspect_err(|_| {
                    control.cancel();
                    // Its result is no longer wanted.
                    let _ = finished.recv_timeout(PATIENCE);
                })?,
            }
        }
    })?;

    report(py)?;

    Ok(outcome)
}

//! `phasestereo_gpu._gpu`: the stub beside the Python package documents the arguments and results of each
//! function.

use std::process;

use phasestereo_match::base::error::Error;
use phasestereo_match::optimization::engine::Engine;
use phasestereo_match::optimization::tasks::{MOST_RADIUS, Task};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::device::{self, Adapter, Kind};

/// Name, kind, interface and driver of an adapter.
type Described = (String, &'static str, &'static str, String);

#[pymodule(gil_used = false)]
mod _gpu {
    #[pymodule_export]
    use super::{Gpu, adapters};

    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "as Python spells it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}

/// All adapters, in the order in which they are tried.
#[pyfunction]
fn adapters(py: Python<'_>) -> Vec<Described> {
    py.detach(|| device::adapters().iter().map(described).collect())
}

fn described(adapter: &Adapter) -> Described {
    let kind = match adapter.kind {
        Kind::Discrete => "discrete",
        Kind::Integrated => "integrated",
        Kind::Virtual => "virtual",
        Kind::Other => "other",
        Kind::Processor => "cpu",
    };
    (adapter.name.clone(), kind, adapter.backend, adapter.driver.clone())
}

/// An open adapter, which belongs to the process that opened it.
#[pyclass(module = "phasestereo_gpu", frozen)]
#[derive(Debug)]
struct Gpu {
    gpu: Option<crate::Gpu>,
    process: u32,
}

#[pymethods]
impl Gpu {
    #[new]
    fn new(py: Python<'_>, name: Option<&str>) -> PyResult<Self> {
        let opened = py.detach(|| crate::Gpu::new(name));
        let gpu = opened.map_err(|error| match error {
            Error::Value { .. } => PyValueError::new_err(error.to_string()),
            other => PyRuntimeError::new_err(other.to_string()),
        })?;
        Ok(Self { gpu: Some(gpu), process: process::id() })
    }

    #[getter]
    fn name(&self) -> PyResult<&str> {
        Ok(&self.ours()?.adapter().name)
    }

    #[getter]
    fn limits(&self) -> PyResult<(u64, u64, u64)> {
        let limits = self.ours()?.limits();
        Ok((limits.threads, limits.buffer, limits.volume))
    }

    fn search<'py>(
        &self,
        py: Python<'py>,
        numbers: [u32; 20],
        left: &[u8],
        right: &[u8],
        pixels: &[u8],
    ) -> PyResult<Bound<'py, PyBytes>> {
        let gpu = self.ours()?;
        let task = checked(Task { numbers, left, right, pixels })?;
        let found = py.detach(|| gpu.run(&task)).ok_or_else(|| {
            let reason = gpu.failure();
            PyRuntimeError::new_err(reason.unwrap_or_else(|| "another call panicked".to_owned()))
        })?;
        Ok(PyBytes::new(py, bytemuck::cast_slice(&found)))
    }
}

impl Gpu {
    fn ours(&self) -> PyResult<&crate::Gpu> {
        let gpu = self.gpu.as_ref().filter(|_| self.process == process::id());
        let reason = "the device was opened before this process was forked";
        gpu.ok_or_else(|| PyRuntimeError::new_err(reason))
    }
}

impl Drop for Gpu {
    /// Leaks the device of another process, whose threads are not here.
    fn drop(&mut self) {
        if self.process != process::id() {
            std::mem::forget(self.gpu.take());
        }
    }
}

/// A task whose numbers agree with its bytes, so that no size exceeds its data.
fn checked(task: Task) -> PyResult<Task> {
    let [cols, rows, candidates, code, places, radius, ..] = task.numbers.map(u64::from);
    let [top, bottom, start, end] = [12, 13, 14, 15].map(|at| u64::from(task.numbers[at]));
    let is_whole = cols > 0
        && (1..=1 << 16).contains(&candidates)
        && radius <= MOST_RADIUS as u64
        && top <= start
        && start < end
        && end <= bottom
        && bottom <= rows
        && [task.left, task.right, task.pixels].iter().all(|bytes| bytes.len() % 4 == 0)
        && task.left.len() as u64 >= (rows * cols).saturating_mul(code)
        && task.right.len() as u64 >= (rows * places).saturating_mul(code)
        && task.pixels.len() as u64 >= rows * cols;
    is_whole.then_some(task).ok_or_else(|| {
        PyValueError::new_err(
            "numbers: got sizes that are not those of the bytes; accepts a task of phasestereo",
        )
    })
}

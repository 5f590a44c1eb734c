//! A device that searches: an object of another distribution that is called with the words of a task.

use std::ops::Range;
use std::sync::OnceLock;

use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::failure::Result;
use phasestereo::Engine;
use phasestereo_match::base::error;
use phasestereo_match::optimization::engine::Chunk;
use phasestereo_match::optimization::evidence::Evidence;
use phasestereo_match::optimization::tasks::{self, Limits, Task};

/// An object with `limits`, the numbers of [`Limits`], and a method `search` that takes the numbers, left and
/// right codes and pixels of a [`Task`] and returns the resulting words as bytes. The first exception ends
/// its use.
#[derive(Debug)]
pub struct Device {
    object: Py<PyAny>,
    limits: Limits,
    failure: OnceLock<String>,
}

impl Device {
    pub fn new(object: Bound<'_, PyAny>) -> Result<Self> {
        let (threads, buffer, volume) = object.getattr("limits")?.extract()?;
        let limits = Limits { threads, buffer, volume };
        Ok(Self { object: object.unbind(), limits, failure: OnceLock::new() })
    }

    /// The result of a task; `None`: it failed.
    fn run(&self, task: &Task) -> Option<Vec<u32>> {
        let called = Python::try_attach(|py| -> PyResult<Vec<u32>> {
            let bytes = |bytes| PyBytes::new(py, bytes);
            let arguments = (task.numbers, bytes(task.left), bytes(task.right), bytes(task.pixels));
            let found = self.object.bind(py).call_method1("search", arguments)?;
            let words = found.cast::<PyBytes>()?.as_bytes().chunks_exact(4);
            Ok(words.map(|word| u32::from_ne_bytes(word.try_into().unwrap_or_default())).collect())
        });
        // Without an interpreter, nobody waits for the match.
        let reason = match called? {
            Ok(found) if found.len() == task.found_words() => return Some(found),
            Ok(found) => format!("{} words instead of {}", found.len(), task.found_words()),
            Err(exception) => exception.to_string(),
        };
        let _ = self.failure.set(reason);
        None
    }
}

impl Engine for Device {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> error::Result<bool> {
        if self.failure.get().is_some() {
            return Ok(false);
        }
        tasks::choose(rows, chunk, self.limits, evidence, |task| self.run(task))
    }

    fn failure(&self) -> Option<String> {
        self.failure.get().cloned()
    }
}

//! What two cameras are, learned from frame to frame, as Python holds it.

use std::process;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::Result;
use crate::objects::{self, Object};
use phasestereo::Error;
use phasestereo::internals::video::limits::{self, Check};
use phasestereo::internals::video::rig::events::Event;
use phasestereo::internals::video::rig::text;
use phasestereo::internals::video::rig::{Geometry, Rig as State};
use phasestereo_match::base::control::Control;

const FREE: u32 = 0; // the number of no process that runs Python

/// The cameras of one rig: what is known after the last match. A match works on a copy, so that readers never wait for one, and
/// the lock is only held by a thread that is attached to Python: a forked child finds it open.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug, Default)]
pub struct Rig {
    last: Mutex<State>,
    /// The process in which a match is running.
    user: AtomicU32,
}

/// A match that is running: others are refused until it is dropped.
#[derive(Debug)]
pub struct Turn<'a>(&'a Rig);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.user.store(FREE, Ordering::Release);
    }
}

#[pymethods]
impl Rig {
    /// A rig of a text; None: one that has seen nothing.
    #[new]
    fn new(written: Option<&str>) -> Result<Self> {
        let state = written.map(|written| text::read(written, &Control::default())).transpose()?;
        Ok(Self { last: Mutex::new(state.unwrap_or_default()), ..Self::default() })
    }

    /// The rig as text.
    #[getter]
    fn text(&self) -> String {
        text::written(&self.last())
    }

    /// Frames so far.
    #[getter]
    fn frames(&self) -> u64 {
        self.last().frames
    }

    /// The share of the match that is probably wrong.
    #[getter]
    fn health(&self) -> f64 {
        self.last().health.unwrap_or(f64::NAN)
    }

    /// What happened: the subject of each event, its frame, and a sentence.
    #[getter]
    fn events(&self) -> Vec<(&'static str, u64, String)> {
        let event = |event: &Event| (event.subject.name(), event.frame, event.sentence.clone());
        self.last().events.all().iter().map(event).collect()
    }

    /// The least and the number of the disparities; None: nothing is known.
    #[getter]
    fn disparities(&self) -> Option<(i64, i64)> {
        let range = |geometry: &Geometry| {
            let searched = &geometry.columns.searched;
            (searched.start, searched.end - searched.start)
        };
        self.last().geometry.as_ref().map(range)
    }

    /// The field of rows; None: nothing is known.
    #[getter]
    fn field<'py>(&self, py: Python<'py>) -> Result<Option<Object<'py>>> {
        let rig = self.last();
        let Some(geometry) = &rig.geometry else { return Ok(None) };
        let Some(offsets) = geometry.field.offsets()? else { return Ok(None) };
        objects::alignment_of(py, &offsets, geometry.straightens.state == 1).map(Some)
    }

    /// Its quantities against limits: name, unit, what it is, value (NaN: unknown), limit, and whether it is kept (None: that
    /// cannot be told, and need not be).
    #[pyo3(signature = (limits, focal))]
    #[expect(clippy::type_complexity, reason = "what Python unpacks")]
    #[expect(clippy::needless_pass_by_value, reason = "an argument that Python gives")]
    fn check(
        &self,
        limits: Vec<(String, f64)>,
        focal: Option<f64>,
    ) -> Result<Vec<(&'static str, &'static str, &'static str, f64, f64, Option<bool>)>> {
        let rig = self.last();
        let row = |check: Check| {
            let [name, unit, what] = check.quantity.words();
            (name, unit, what, check.value.unwrap_or(f64::NAN), check.limit, check.passed)
        };
        Ok(limits::check(&rig, &limits, focal)?.into_iter().map(row).collect())
    }

    /// The cameras of raw images, and the size of these; None: images are rectified, or nothing is known.
    #[getter]
    #[expect(clippy::type_complexity, reason = "what Python unpacks")]
    fn cameras<'py>(
        &self,
        py: Python<'py>,
    ) -> Result<Option<(Bound<'py, PyDict>, (usize, usize))>> {
        let rig = self.last();
        let geometry = rig.geometry.as_ref();
        let raw = geometry.and_then(|geometry| Some((geometry.cameras.as_ref()?, geometry.size)));
        let cameras = raw
            .map(|(raw, size)| Ok((objects::calibration(py, &raw.rectification.cameras)?, size)));
        cameras.transpose()
    }
}

impl Rig {
    /// What is known after the last match.
    pub fn last(&self) -> MutexGuard<'_, State> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The right to match, unless another thread of this process is matching: in a forked child, that thread does not exist.
    pub fn turn(&self) -> phasestereo::Result<Turn<'_>> {
        let (process, user) = (process::id(), self.user.load(Ordering::Acquire));
        let is_free = user != process
            && self
                .user
                .compare_exchange(user, process, Ordering::AcqRel, Ordering::Acquire)
                .is_ok();
        if is_free {
            return Ok(Turn(self));
        }
        let accepts = "one that no other match is using: frames come one after another";
        Err(Error::value("rig", "one that is in use", accepts))
    }
}

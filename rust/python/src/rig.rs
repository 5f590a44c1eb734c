//! Facts about two cameras, learned from frame to frame, for Python.

use std::sync::MutexGuard;

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::Result;
use crate::objects::{self, Object};
use crate::temporal::{Carried, Turn};
use phasestereo::internals::video::limits::{self, Check};
use phasestereo::internals::video::rig::events::Event;
use phasestereo::internals::video::rig::text;
use phasestereo::internals::video::rig::{Geometry, Rig as State};

/// The cameras of one rig: the facts known after the last match.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug, Default)]
pub struct Rig(Carried<State>);

#[pymethods]
impl Rig {
    /// A rig from a text; None: a new one.
    #[new]
    fn new(written: Option<&str>) -> Result<Self> {
        let state = written.map(text::read).transpose()?;
        Ok(Self(Carried::new(state.unwrap_or_default())))
    }

    /// The rig as text.
    #[getter]
    fn text(&self) -> Result<String> {
        Ok(text::written(&self.last())?)
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

    /// The events: the subject of each, its frame, and a sentence.
    #[getter]
    fn events(&self) -> Vec<(&'static str, u64, String)> {
        let event = |event: &Event| (event.subject.name(), event.frame, event.sentence.clone());
        self.last().events.all().iter().map(event).collect()
    }

    /// The smallest disparity and the number of disparities; None: unknown.
    #[getter]
    fn disparities(&self) -> Option<(i64, i64)> {
        let range = |geometry: &Geometry| {
            let searched = &geometry.columns.searched;
            (searched.start, searched.end - searched.start)
        };
        self.last().geometry.as_ref().map(range)
    }

    /// The field of rows; None: unknown.
    #[getter]
    fn field<'py>(&self, py: Python<'py>) -> Result<Option<Object<'py>>> {
        let rig = self.last();
        let Some(geometry) = &rig.geometry else { return Ok(None) };
        let Some(offsets) = geometry.field.offsets()? else { return Ok(None) };
        objects::alignment_of(py, &offsets, geometry.straightens.state == 1).map(Some)
    }

    /// Its quantities against limits: name, unit, description, value (NaN: unknown), limit, and whether it is
    /// within the limit (None: unknown, and not needed).
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

    /// The cameras of raw images, and their size; None: images are rectified, or nothing is known.
    #[getter]
    #[expect(clippy::type_complexity, reason = "what Python unpacks")]
    fn cameras<'py>(&self, py: Python<'py>) -> Result<Option<(Bound<'py, PyDict>, (usize, usize))>> {
        let rig = self.last();
        let geometry = rig.geometry.as_ref();
        let raw = geometry.and_then(|geometry| Some((geometry.cameras.as_ref()?, geometry.size)));
        let cameras =
            raw.map(|(raw, size)| Ok((objects::calibration(py, &raw.rectification.cameras)?, size)));
        cameras.transpose()
    }
}

impl Rig {
    /// The facts known after the last match.
    fn last(&self) -> MutexGuard<'_, State> {
        self.0.value()
    }

    /// The turn of a match, which works on a copy.
    pub fn turn(&self) -> phasestereo::Result<Turn<'_, State>> {
        self.0.turn("rig")
    }
}

//! The second opinion on a disparity map, for Python.

use ndarray::Dimension;
use numpy::{PyArray2, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::{Matched, SummaryTuple, disparity_to_py, summary_to_py, wrap};
use crate::arguments::{Both, read_images, values};
use crate::estimates::{EstimatesTuple, FindingTuple, estimates_to_py, findings_to_py};
use crate::failure::Result;
use crate::supervisor::supervised;
use crate::workers::Pool;
use phasestereo::internals::findings;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::pipeline::matcher::Execution;
use phasestereo::internals::pipeline::summary::Summary;
use phasestereo::internals::rig::estimation::Means;
use phasestereo::internals::settings::Settings;
use phasestereo::internals::simd::Level;
use phasestereo::internals::verification::{Verification, verify};

/// Verdicts and better disparities.
type Judged<'py> = (Bound<'py, PyArray2<u8>>, Bound<'py, PyArray2<f32>>);

/// Verdicts and better disparities, findings on the map, and the own match with what was found out for it.
type Verified<'py> = (
    Judged<'py>,
    Vec<FindingTuple>,
    Matched<'py>,
    SummaryTuple,
    EstimatesTuple<'py>,
    Vec<FindingTuple>,
);

/// Judges a disparity map; the own match is as `match_pair` returns it.
#[pyfunction]
pub fn verify_map<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparity: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
) -> Result<Verified<'py>> {
    let pair = read_images(&images, &masks, None)?;
    let map = read_map(disparity)?;

    let pool = Pool::for_argument(threads)?;
    let (rows, cols) = pair.size();
    let how = Execution { threads: pool.threads(), level: Level::best() };
    let (judged, summary) = supervised(py, &pool, rows, progress, move |matcher, control| {
        let means = Means { matcher, how, control };
        let judged = verify(pair, &map, &Settings::default(), means)?;
        let summary = Summary::new(&judged.own, judged.prepared.estimates.candidates);
        Ok((judged, summary))
    })?;

    let Verification { verdicts, better, findings, own, prepared, .. } = judged;
    let said = findings::of_match(&prepared.estimates, &summary, (rows, cols));

    Ok((
        (wrap(py, verdicts)?, wrap(py, better)?),
        findings_to_py(findings),
        disparity_to_py(py, own)?,
        summary_to_py(summary),
        estimates_to_py(py, prepared.estimates)?,
        findings_to_py(said),
    ))
}

/// Reads the map that is judged.
fn read_map(disparity: &Bound<'_, PyAny>) -> Result<Plane<f32>> {
    let Ok(array) = disparity.cast::<PyArray2<f32>>() else {
        let message = "disparity: accepts a 2-D array of float32";
        return Err(PyTypeError::new_err(message).into());
    };

    let (rows, cols) = array.dims().into_pattern();
    Ok(Plane::from_vec(rows, cols, values(array)?)?)
}

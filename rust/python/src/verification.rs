//! The second opinion on a disparity map, for Python.

use pyo3::prelude::*;

use crate::arguments::{Both, read_any_images};
use crate::failure::Result;
use crate::known::read_known;
use crate::objects::{Asked, Object, verification};
use crate::preparation::read_map;
use crate::settings::read_settings;
use crate::supervisor::supervised;
use crate::workers::Pool;
use phasestereo::internals::findings;
use phasestereo::internals::verification::verify;
use phasestereo_match::matcher::summary::Summary;

/// Judges a disparity map; the own match is as `match_pair` returns it.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arguments that Python names")]
pub fn verify_map<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparity: &Bound<'py, PyAny>,
    settings: Object<'py>,
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
    known: Object<'py>,
) -> Result<Object<'py>> {
    let pair = read_any_images(&images, &masks, None)?;
    let map = read_map(disparity)?;
    let (rows, cols) = pair.size();

    let asked = read_settings(&settings)?;
    let told = read_known(&known, (rows, cols), None)?;

    let pool = Pool::for_argument(threads)?;
    let (judged, summary) = supervised(py, &pool, rows, progress, move |means| {
        let judged = verify(pair, &map, &told, &asked, means)?;
        let summary = Summary::new(&judged.own, judged.prepared.estimates.candidates.value);
        Ok((judged, summary))
    })?;

    let said = findings::of_match(&judged.prepared.estimates, &summary, (rows, cols));
    let asked = Asked { settings, known, is_searched: false, is_reused: false };
    verification(py, judged, summary, said, &asked)
}

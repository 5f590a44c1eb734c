//! The second opinion on a disparity map, for Python.

use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;

use crate::arguments::{Both, read_any_images};
use crate::failure::Result;
use crate::known::read_known;
use crate::objects::{self, Asked, Object, verification};
use crate::preparation::{Ready, read_map};
use crate::settings::read_settings;
use crate::supervisor::supervised;
use crate::workers::Pool;
use phasestereo::internals::estimation::facts::Facts;
use phasestereo::internals::findings;
use phasestereo::internals::match_pair::Matched;
use phasestereo::internals::verification::traits::{TRAITS, Values};
use phasestereo::internals::verification::{judged, observe, verify};
use phasestereo_match::base::plane::Plane;

/// Judges a disparity map; the own match has the form that `match_pair` returns. A pair that is ready, by the
/// same settings, is not estimated again.
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
    ready: Option<PyRef<'py, Ready>>,
) -> Result<Object<'py>> {
    let pair = read_any_images(&images, &masks, None)?;
    let map = read_map(disparity, "disparity")?;
    let (rows, cols) = pair.size();

    let asked = read_settings(&settings)?;
    let told = read_known(&known, (rows, cols), None, None)?;

    let pool = Pool::for_argument(threads)?;
    let ready = ready.map(|ready| ready.0.clone());
    let (found, summary) = supervised(py, &pool, rows, progress, move |means| {
        let found = match ready {
            Some(ready) => judged(ready, &map, &asked, means)?,
            None => verify(pair, &map, &told, &asked, means)?,
        };
        let summary = found.matched.summary();
        Ok((found, summary))
    })?;

    let said = findings::of_match(&found.matched.prepared.estimates, &summary, (rows, cols));
    let asked = Asked { settings, known, is_searched: false, is_reused: false };
    verification(py, found, summary, said, &asked)
}

/// A match and, for several maps, the traits for judging their claims: float32 (height, width, traits), NaN
/// without a claim.
#[pyfunction]
pub fn observe_maps<'py>(
    py: Python<'py>,
    images: Both<'py>,
    maps: Vec<Bound<'py, PyAny>>,
    settings: Object<'py>,
    threads: &Bound<'py, PyAny>,
) -> Result<(Object<'py>, Vec<Object<'py>>)> {
    let none = py.None().into_bound(py);
    let pair = read_any_images(&images, &(none.clone(), none.clone()), None)?;
    let maps = maps.iter().map(|map| read_map(map, "maps")).collect::<Result<Vec<_>>>()?;
    let size = pair.size();

    let asked = read_settings(&settings)?;
    let pool = Pool::for_argument(threads)?;
    let (matched, traits) = supervised(py, &pool, size.0, None, move |means| {
        observe(pair, &maps, &Facts::default(), &asked, means)
    })?;

    let wrapped = |values: Plane<Values>| -> Result<Object<'py>> {
        let values = values.into_vec().into_flattened();
        let shape = (size.0, size.1, TRAITS);
        Ok(values.into_pyarray(py).reshape(shape)?.into_any())
    };
    let traits = traits.into_iter().map(wrapped).collect::<Result<_>>()?;

    let summary = matched.summary();
    let Matched { map, prepared, rectified, .. } = matched;
    let estimates = prepared.estimates;
    let (support, second, findings) = (None, None, vec![]);
    let found = objects::Matched { map, summary, estimates, support, second, findings, rectified };
    let asked = Asked { settings, known: none, is_searched: false, is_reused: false };
    Ok((objects::result(py, found, &asked)?, traits))
}

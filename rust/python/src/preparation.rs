//! Pairs prepared for other matchers, and the conversion of their maps, for Python.

use ndarray::Dimension;
use numpy::{PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyNone, PyType};

use crate::arguments::{Both, read_inputs, read_search, values, wrong_type};
use crate::failure::Result;
use crate::known::read_known;
use crate::objects::{Asked, Object, estimates, pixels};
use crate::settings::read_settings;
use crate::supervisor::supervised;
use crate::workers::Pool;
use crate::wrap;
use phasestereo::internals::match_pair;
use phasestereo::internals::preparation::back;
use phasestereo::internals::preparation::{Preparation, prepared_for_others};
use phasestereo_match::base::plane::Plane;

/// The conversion of maps of a prepared pair to the original image.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug)]
pub struct Back(back::Back);

#[pymethods]
impl Back {
    /// Reads it from text.
    #[new]
    fn new(written: &str) -> Result<Self> {
        Ok(Self(back::Back::read(written)?))
    }

    /// Writes it as text.
    #[getter]
    fn text(&self) -> Result<String> {
        Ok(self.0.written()?)
    }

    /// Rows and columns of the original left image.
    #[getter]
    fn size(&self) -> (usize, usize) {
        self.0.size()
    }

    /// Rows and columns of the prepared images.
    #[getter]
    fn prepared_size(&self) -> (usize, usize) {
        self.0.prepared_size()
    }

    /// A map of the prepared pair, converted to the original left image.
    fn restored<'py>(
        &self,
        py: Python<'py>,
        disparity: &Bound<'py, PyAny>,
    ) -> Result<Bound<'py, PyArray2<f32>>> {
        let map = read_map(disparity, "disparity")?;
        let (back, size) = (self.0.clone(), self.0.size());
        let found = supervised(py, &Pool::new(1)?, size.0, None, move |runtime| {
            back.restored(&map, runtime.control)
        })?;
        wrap(py, found)
    }
}

/// A pair that is ready to be matched. It pickles as None: everything is estimated again.
#[pyclass(module = "phasestereo._core", frozen)]
#[derive(Debug)]
pub struct Ready(pub match_pair::Ready);

#[pymethods]
impl Ready {
    fn __reduce__(slf: Bound<'_, Self>) -> (Bound<'_, PyType>, ()) {
        (PyNone::get(slf.py()).get_type(), ())
    }
}

/// A pair for other matchers: both images (None: unchanged), sentences, the number of disparities, the
/// conversion of maps, the pair that is ready to be matched, and the estimates.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arguments that Python names")]
#[expect(clippy::type_complexity, reason = "what Python unpacks")]
pub fn prepare_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    max_disparity: Option<i64>,
    settings: Object<'py>,
    threads: &Bound<'py, PyAny>,
    known: Object<'py>,
) -> Result<([Option<Bound<'py, PyAny>>; 2], Vec<String>, usize, Back, Ready, Object<'py>)> {
    let asked = read_settings(&settings)?;
    let search = read_search(&disparities)?;
    let inputs = read_inputs(&images, &masks)?;
    let size = inputs[0].size();
    let told = read_known(&known, size, search, None)?;

    let pool = Pool::for_argument(threads)?;
    let made = supervised(py, &pool, size.0, None, move |runtime| {
        prepared_for_others(inputs, &told, max_disparity, &asked, runtime)
    })?;

    let (Preparation { images, changed, done, num_disparities, back }, ready) = made;
    let mut changes = changed.into_iter();
    let images = images.map(|image| changes.next()?.then(|| pixels(py, image.image)));
    let asked = Asked { settings, known, is_searched: search.is_some(), is_reused: false };
    let found = estimates(py, ready.prepared.estimates.clone(), &asked)?;
    Ok((images, done, num_disparities, Back(back), Ready(ready), found))
}

/// Reads a map of disparities or depths, the argument of this name.
pub fn read_map(map: &Bound<'_, PyAny>, name: &str) -> Result<Plane<f32>> {
    let Ok(array) = map.cast::<PyArray2<f32>>() else {
        return Err(wrong_type(map, name, "a 2-D array of float32"));
    };

    let (rows, cols) = array.dims().into_pattern();
    Ok(Plane::from_vec(rows, cols, values(array)?)?)
}

//! The choice between accuracy and density, for Python.

use ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::failure::Result;
use crate::internal;
use phasestereo::{Error, Keep};

/// The pixels that a choice keeps, in a map with the share `wrong` of wrong disparities; NaN: unknown.
#[pyfunction]
pub fn kept_pixels<'py>(
    py: Python<'py>,
    keep: &str,
    disparity: &Bound<'py, PyArray2<f32>>,
    flags: &Bound<'py, PyArray2<u16>>,
    confidence: Option<&Bound<'py, PyArray2<f32>>>,
    wrong: f64,
) -> Result<Bound<'py, PyArray2<bool>>> {
    let keep = Keep::named(keep)?;
    let disparity = disparity.try_readonly().map_err(internal)?;
    let flags = flags.try_readonly().map_err(internal)?;
    let confidence = confidence.map(PyArrayMethods::try_readonly).transpose().map_err(internal)?;

    let (disparity, flags) = (disparity.as_array(), flags.as_array());
    let confidence = confidence.as_ref().map(|array| array.as_array());
    let size = disparity.dim();
    let others = [("flags", Some(flags.dim())), ("confidence", confidence.map(|map| map.dim()))];
    for (name, other) in others {
        if let Some(other) = other.filter(|other| *other != size) {
            let accepts = format!("that of disparity, {size:?}");
            return Err(Error::value(name, format!("shape {other:?}"), accepts).into());
        }
    }

    let kept = Array2::from_shape_fn(size, |at| {
        keep.keeps(disparity[at], flags[at], confidence.map(|map| map[at]), wrong)
    });
    Ok(kept.into_pyarray(py))
}

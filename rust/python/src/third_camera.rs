//! Depths in the frame of a third camera, for Python.

use numpy::PyArray2;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

use crate::failure::Result;
use crate::preparation::read_map;
use crate::supervisor::supervised;
use crate::workers::Pool;
use crate::wrap;
use phasestereo::internals::third_camera::{LeftCamera, Lens, ThirdCamera, register};
use phasestereo_match::base::plane::Plane;

/// Sources, depths, holes and occlusions as seen by a third camera, and other depths at the same pixels, such
/// as the ends of error bars. The left camera: focal lengths, principal point, baseline; the lens of the
/// third one: matrix, distortion, whether it is a fisheye lens.
#[pyfunction]
pub fn register_depths<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    others: Vec<Bound<'py, PyAny>>,
    left: ([f64; 2], [f64; 2], f64),
    lens: ([[f64; 3]; 3], Vec<f64>, bool),
    pose: ([[f64; 3]; 3], [f64; 3]),
    size: (usize, usize),
) -> Result<Bound<'py, PyAny>> {
    let depth = read_map(depth, "depth")?;
    let others = others.iter().map(|other| read_map(other, "others")).collect::<Result<Vec<_>>>()?;
    let (focal, center, baseline) = left;
    let left = LeftCamera { focal, center, baseline };
    let (matrix, lens, is_fisheye) = lens;
    let lens = Lens::new(&lens, is_fisheye)?;
    let camera = ThirdCamera::new(&matrix, lens, pose, size);

    let pool = Pool::for_argument(&py.None().into_bound(py))?;
    let (found, others) = supervised(py, &pool, depth.rows(), None, move |means| {
        let found = register(&depth, &left, &camera, means.control)?;
        let others: Vec<_> = others.iter().map(|depth| camera.moved(depth, &found.source, &left)).collect();
        Ok((found, others))
    })?;

    let others = others.into_iter().map(|depth| wrap(py, depth)).collect::<Result<Vec<_>>>()?;
    let (source, depth) = (wrap(py, found.source)?, wrap(py, found.depth)?);
    let (holes, occluded) = (wrap(py, found.holes)?, wrap(py, found.occluded)?);
    Ok((source, depth, holes, occluded, others).into_bound_py_any(py)?)
}

/// x and y of the rays of depth 1 of pixels, one row each; NaN where the lens shows nothing.
#[pyfunction]
pub fn rays_of_pixels(
    py: Python<'_>,
    pixels: Vec<[f64; 2]>,
    lens: ([[f64; 3]; 3], Vec<f64>, bool),
) -> Result<Bound<'_, PyArray2<f64>>> {
    let (matrix, lens, is_fisheye) = lens;
    let none = ([[0.0; 3]; 3], [0.0; 3]);
    let camera = ThirdCamera::new(&matrix, Lens::new(&lens, is_fisheye)?, none, (1, 1));
    let flat = pixels.iter().flat_map(|pixel| camera.flat(*pixel).unwrap_or([f64::NAN; 2]));
    wrap(py, Plane::from_vec(pixels.len(), 2, flat.collect())?)
}

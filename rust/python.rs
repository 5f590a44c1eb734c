//! The Python face: validate, copy in, detach from the interpreter, run, wrap out.
//!
//! Both images are copied before the interpreter is let go: a borrow would not stop another Python thread
//! from writing into them.

mod arguments;
mod found;
mod reader;
mod supervisor;
mod temporal;
mod workers;

use std::sync::Arc;

use ndarray::{Array2, Array3};
use numpy::{Element, IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use self::arguments::{
    Both, KnownOfPair, Statistics, candidates_of, read_blur_compensation, read_images, read_known,
    read_noise, read_pair, read_preset, read_search, read_settings, read_view, read_volume,
    write_settings,
};
use self::found::{Field, Found, Seen, found_to_py, read_field, read_glance};
use self::reader::{Ranges, Reader};
use self::supervisor::supervised;
use self::temporal::{Shared, TemporalFilter};
use self::workers::{Pool, Workers};
use crate::cost::Costs;
use crate::cost::aggregation::{Window, aggregate};
use crate::cost::candidates::Candidates;
use crate::descriptor::{Codes, describe};
use crate::error::Error;
use crate::image::intensity::Gray;
use crate::image::plane::Plane;
use crate::image::texture::Roughness;
use crate::optimization::{BAND, Steps, optimize};
use crate::pipeline::footprint::Demand;
use crate::pipeline::halo::Halo;
use crate::pipeline::matcher::{Disparity, Execution, on_threads};
use crate::pipeline::section::Section;
use crate::pipeline::source;
use crate::pipeline::summary::Summary;
use crate::refinement::flag;
use crate::rig::blur;
use crate::rig::estimation::compensation::{LARGER, MUCH_LARGER};
use crate::rig::estimation::overview::LEAST_SIZE;
use crate::rig::estimation::{Known, Means, Prepared, prepare, prepare_by_rows};
use crate::settings::presets::Preset;
use crate::simd::Level;

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        match error {
            Error::Value { .. } => PyValueError::new_err(message),
            Error::OutOfMemory { .. } => PyMemoryError::new_err(message),
            Error::Cancelled | Error::Threads(_) => PyRuntimeError::new_err(message),
        }
    }
}

/// `phasestereo._core`: see the stub beside the Python modules for what each function takes and returns.
///
/// It needs no GIL: what several calls share is behind mutexes (`Workers`, the shared pool, the spare memory
/// of a matcher) or made once (tables), and there is no unsafe code but in `simd.rs`, which shares nothing.
/// Arrays are copied in before a call matches anything; one that another thread changes meanwhile is copied
/// half changed, as by `NumPy` itself.
#[pymodule(gil_used = false)]
mod _core {
    use super::{
        BAND, Bound, LARGER, LEAST_SIZE, MUCH_LARGER, Preset, PyDict, PyDictMethods, PyModule,
        PyModuleMethods, PyResult, flag, warm_up,
    };

    #[pymodule_export]
    use super::{
        TemporalFilter, Workers, aggregate_volume, blur_is_as_before, check_blur_compensation,
        check_settings, cost_volume, descriptor, estimate_pair, estimate_pair_by_rows, find_ranges,
        find_roughness, halo, match_pair, match_rows, optimize_volume, preset, simd_level,
        summarize, working_memory,
    };

    #[pymodule_init]
    fn constants(module: &Bound<'_, PyModule>) -> PyResult<()> {
        warm_up(module.py())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("PRESETS", Preset::ALL.map(Preset::name))?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))?;
        module.add("BAND_ROWS", BAND)?;
        module.add("LARGER", LARGER)?;
        module.add("MUCH_LARGER", MUCH_LARGER)?;
        module.add("LEAST_SIZE", LEAST_SIZE)?;
        let flags = PyDict::new(module.py());
        flags.set_item("MASKED", flag::MASKED)?;
        flags.set_item("NO_CANDIDATE", flag::NO_CANDIDATE)?;
        flags.set_item("OUTSIDE", flag::OUTSIDE)?;
        flags.set_item("MATCH_MASKED", flag::MATCH_MASKED)?;
        flags.set_item("OCCLUDED", flag::OCCLUDED)?;
        flags.set_item("MISMATCHED", flag::MISMATCHED)?;
        flags.set_item("LOW_CONFIDENCE", flag::LOW_CONFIDENCE)?;
        flags.set_item("AMBIGUOUS", flag::AMBIGUOUS)?;
        flags.set_item("SPECKLE", flag::SPECKLE)?;
        flags.set_item("FILLED", flag::FILLED)?;
        module.add("FLAGS", flags)
    }
}

/// Has everything that is set up once and for all be set up now, by the thread that imports.
///
/// A process that is forked while another thread does so inherits a job half done and waits for its end
/// for ever: the tables of the array interface, those of the thread pool and of the estimation of blur, the instructions
/// there are.
fn warm_up(py: Python<'_>) -> PyResult<()> {
    PyArray2::<u8>::zeros(py, (1, 1), false).try_readonly().map_err(internal)?;
    Level::best();
    blur::prepare();
    Ok(on_threads(1, || ())?)
}

#[pyfunction]
fn simd_level() -> &'static str {
    Level::best().name()
}

#[pyfunction]
fn check_settings(settings: &Bound<'_, PyAny>) -> PyResult<()> {
    read_settings(settings).map(drop)
}

/// The settings of a preset, by name.
#[pyfunction]
fn preset<'py>(py: Python<'py>, name: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    write_settings(py, &read_preset(name)?.settings())
}

#[pyfunction]
fn check_blur_compensation(compensation: &Bound<'_, PyAny>) -> PyResult<()> {
    read_blur_compensation(compensation).map(drop)
}

/// Disparity, flags, confidence if it was worked out, and timings of a pair.
type Matched<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u16>>,
    Option<Bound<'py, PyArray2<f32>>>,
    Bound<'py, PyDict>,
);

/// How many frames support each disparity, and seconds.
type Supported<'py> = (Bound<'py, PyArray2<u8>>, f64);

#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python tells by name")]
fn match_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
    known: KnownOfPair<'py>,
    temporal: Option<PyRef<'py, TemporalFilter>>,
) -> PyResult<(Matched<'py>, Found<'py>, Option<Supported<'py>>)> {
    let (settings, search) = (read_settings(settings)?, read_search(&disparities)?);
    let pair = read_images(&images, &masks, search)?;
    let known = read_known(&known, pair.size(), search)?;
    let (pool, rows) = (Pool::of(threads)?, pair.size().0);
    let how = Execution { threads: pool.threads(), level: Level::best() };
    let filter = temporal.map(|filter| filter.shared());
    let (map, found, support) = supervised(py, &pool, rows, progress, move |matcher, control| {
        let means = Means { matcher, how, control };
        let Prepared { pair, settings, found } = prepare(pair, known, &settings, means)?;
        let mut map = matcher.run(&pair, &settings, how, control)?;
        let apply = |filter: Shared| temporal::apply(&filter, &pair, &settings, &mut map, means);
        let support = filter.map(apply).transpose()?;
        Ok((map, found, support))
    })?;
    let support = support.map(|(frames, time)| Ok::<_, PyErr>((wrap(py, frames)?, time)));
    Ok((disparity_to_py(py, map)?, found_to_py(py, found)?, support.transpose()?))
}

fn disparity_to_py(py: Python<'_>, found: Disparity) -> PyResult<Matched<'_>> {
    let Disparity { disparity, flags, confidence, timings: found } = found;
    let timings = PyDict::new(py);
    timings.set_item("description", found.description.as_secs_f64())?;
    timings.set_item("matching", found.matching.as_secs_f64())?;
    timings.set_item("refinement", found.refinement.as_secs_f64())?;
    let confidence = confidence.map(|plane| wrap(py, plane)).transpose()?;
    Ok((wrap(py, disparity)?, wrap(py, flags)?, confidence, timings))
}

/// What is found out of a pair without matching it.
#[pyfunction]
fn estimate_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
) -> PyResult<Found<'py>> {
    let (settings, search) = (read_settings(settings)?, read_search(&disparities)?);
    let pair = read_images(&images, &masks, search)?;
    let known = Known { candidates: candidates_of(&pair, search), ..Known::default() };
    let (pool, rows) = (Pool::of(threads)?, pair.size().0);
    let how = Execution { threads: pool.threads(), level: Level::best() };
    let found = supervised(py, &pool, rows, None, move |matcher, control| {
        let means = Means { matcher, how, control };
        Ok(prepare(pair, known, &settings, means)?.found)
    })?;
    found_to_py(py, found)
}

/// Whether blur is as it was at a glance before.
#[pyfunction]
fn blur_is_as_before<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    glance: Seen<'py>,
    impulses: [f64; 2],
    threads: &Bound<'py, PyAny>,
) -> PyResult<bool> {
    let pair = read_images(&images, &masks, None)?.with_impulses(impulses);
    let before = read_glance(glance)?;
    let (pool, rows) = (Pool::of(threads)?, pair.size().0);
    let how = Execution { threads: pool.threads(), level: Level::best() };
    supervised(py, &pool, rows, None, move |matcher, control| {
        blur::is_as_before(&pair, &before, matcher, how, control)
    })
}

/// The same of a pair that is read by rows.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python tells by name")]
fn estimate_pair_by_rows<'py>(
    py: Python<'py>,
    read: Bound<'py, PyAny>,
    size: (usize, usize),
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    ranges: Option<Ranges>,
    threads: &Bound<'py, PyAny>,
    known: KnownOfPair<'py>,
) -> PyResult<Found<'py>> {
    let (settings, search) = (read_settings(settings)?, read_search(&disparities)?);
    let known = read_known(&known, size, search)?;
    let (reader, pool) = (Reader::new(read, size, search, ranges)?, Pool::of(threads)?);
    let how = Execution { threads: pool.threads(), level: Level::best() };
    let source = Arc::clone(&reader);
    let found = supervised(py, &pool, size.0, None, move |matcher, control| {
        let means = Means { matcher, how, control };
        prepare_by_rows(&*source, known, &settings, means)
    });
    found_to_py(py, found.map_err(|failure| reader.reason(failure))?)
}

/// Where the pixels lie of images of floats that are read by rows.
#[pyfunction]
fn find_ranges(
    py: Python<'_>,
    read: Bound<'_, PyAny>,
    size: (usize, usize),
    disparities: Both<'_>,
) -> PyResult<Ranges> {
    let reader = Reader::new(read, size, read_search(&disparities)?, None)?;
    let source = Arc::clone(&reader);
    let found = supervised(py, &Pool::new(1)?, size.0, None, move |_, control| {
        source::ranges(&*source, control)
    });
    let [left, right] = found.map_err(|failure| reader.reason(failure))?;
    Ok(((left.black, left.white), (right.black, right.white)))
}

/// The roughness of a left image that is read by rows: a sum of differences, and of how many.
#[pyfunction]
fn find_roughness(
    py: Python<'_>,
    read: Bound<'_, PyAny>,
    size: (usize, usize),
    disparities: Both<'_>,
    ranges: Option<Ranges>,
    impulses: f64,
) -> PyResult<(u64, u64)> {
    let reader = Reader::new(read, size, read_search(&disparities)?, ranges)?;
    let source = Arc::clone(&reader);
    let found = supervised(py, &Pool::new(1)?, size.0, None, move |_, control| {
        source::roughness(&*source, impulses, Level::best(), control)
    });
    let Roughness { sum, pairs } = found.map_err(|failure| reader.reason(failure))?;
    Ok((sum, pairs))
}

/// How many rows of the images on either side a disparity depends on, and how many more next to masked rows.
#[pyfunction]
fn halo(
    settings: &Bound<'_, PyAny>,
    compensation: &Bound<'_, PyAny>,
    alignment: Option<Field>,
) -> PyResult<(usize, usize)> {
    let (settings, compensation) =
        (read_settings(settings)?, read_blur_compensation(compensation)?);
    let field = read_field(alignment)?;
    let halo = Halo::new(&settings, compensation.as_ref(), field.as_ref());
    Ok((halo.rows(), halo.masked))
}

/// The bytes that `match_rows` takes at most, of so many rows; of images whose pixels take so many bytes.
#[pyfunction]
fn working_memory(
    statistics: &Bound<'_, PyAny>,
    rows: usize,
    threads: usize,
    itemsize: usize,
) -> PyResult<u64> {
    let whole = Statistics::read(statistics)?;
    let (_, cols): (usize, usize) = statistics.getattr("size")?.extract()?;
    let candidates: usize = whole.disparities.1.extract()?;
    let demand = Demand {
        settings: &whole.settings,
        compensation: whole.compensation.as_ref(),
        alignment: whole.alignment.as_ref(),
        cols,
        candidates,
        pixel: itemsize,
        threads,
    };
    Ok(demand.bytes(rows))
}

#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "what Python tells by name")]
fn match_rows<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    statistics: &Bound<'py, PyAny>,
    first: usize,
    rows: (usize, usize),
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Matched<'py>> {
    let whole = Statistics::read(statistics)?;
    let pair = read_pair(&images, &masks, &whole.disparities)?
        .with_blur_compensation(
            whole.compensation.map(|compensation| compensation.starting_at_row(first)),
        )
        .with_ranges(whole.ranges);
    let pair = if whole.is_inverted { pair.inverted() } else { pair };
    let field = whole.alignment.map(|field| field.starting_at_row(first));
    let section = Section {
        rows: rows.0.saturating_sub(first)..rows.1.saturating_sub(first),
        roughness: whole.roughness,
        first,
    };
    let (settings, pool) = (whole.settings, Pool::of(threads)?);
    let how = Execution { threads: pool.threads(), level: Level::best() };
    let chosen = section.widened(Halo::new(&settings, pair.blur_compensation(), None).map, &pair);
    let found = supervised(py, &pool, chosen.len(), progress, move |matcher, control| {
        let pair = match &field {
            Some(field) => pair.straightened(field, how.level, control)?,
            None => pair,
        };
        matcher.run_rows(&pair, &section, &settings, how, control)
    })?;
    disparity_to_py(py, found)
}

/// Shares with an estimate, flagged, at the least and at the largest disparity; mean confidence.
#[pyfunction]
fn summarize(
    disparity: PyReadonlyArray2<'_, f32>,
    flags: PyReadonlyArray2<'_, u16>,
    confidence: Option<PyReadonlyArray2<'_, f32>>,
    disparities: (i64, i64),
) -> PyResult<(f64, f64, f64, f64, f64)> {
    let (rows, cols) = disparity.as_array().dim();
    let confidence = confidence.as_ref();
    let is_like = |shape: (usize, usize)| shape == (rows, cols);
    if !is_like(flags.as_array().dim()) || !confidence.is_none_or(|c| is_like(c.as_array().dim())) {
        return Err(PyValueError::new_err("flags, confidence: accept the shape of disparity"));
    }
    let candidates = Candidates::new(disparities.0, disparities.1, cols)?;
    let confidence = confidence.map(|confidence| confidence.as_slice()).transpose();
    let (disparity, flags) = (disparity.as_slice(), flags.as_slice());
    let contiguous = |_| PyValueError::new_err("disparity, flags, confidence: accept C order");
    let found = Summary::new(
        disparity.map_err(contiguous)?,
        flags.map_err(contiguous)?,
        confidence.map_err(contiguous)?,
        candidates,
    );
    let Summary { estimated, flagged, at_low, at_high, confidence } = found;
    Ok((estimated, flagged, at_low, at_high, confidence))
}

#[pyfunction]
fn descriptor<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    mask: &Bound<'py, PyAny>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let (settings, noise) = (read_settings(settings)?, read_noise(noise)?);
    let view = read_view(image, mask, "image")?;
    view.check("image")?;
    let rows = view.image.shape().0;
    let codes = supervised(py, &Pool::of(threads)?, rows, None, move |_, control| {
        let level = Level::best();
        describe(&Gray::new(&view, level, control)?, &settings, noise, level, control)
    })?;
    Ok(match codes {
        Codes::U16(codes) => wrap(py, codes)?.into_any(),
        Codes::U32(codes) => wrap(py, codes)?.into_any(),
        Codes::U64(codes) => wrap(py, codes)?.into_any(),
    })
}

#[pyfunction]
fn cost_volume<'py>(
    py: Python<'py>,
    images: Both<'py>,
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    compensation: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<u16>>> {
    let settings = read_settings(settings)?;
    let none = py.None().into_bound(py);
    let pair = read_pair(&images, &(none.clone(), none), &disparities)?;
    let pair = pair.with_blur_compensation(read_blur_compensation(compensation)?);
    let ((rows, cols), count) = (pair.size(), pair.candidates().count());
    let costs = supervised(py, &Pool::of(threads)?, rows, None, move |_, control| {
        let level = Level::best();
        let (views, candidates) = (pair.views(), pair.candidates());
        let costs =
            Costs::new(views, candidates, &settings, pair.blur_compensation(), level, control)?;
        costs.volume(rows, level, control)
    })?;
    let array = Array3::from_shape_vec((rows, cols, count), costs.into_vec());
    Ok(array.map_err(internal)?.into_pyarray(py))
}

#[pyfunction]
fn aggregate_volume<'py>(
    py: Python<'py>,
    costs: &Bound<'py, PyArray3<u16>>,
    settings: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray3<u32>>> {
    let settings = read_settings(settings)?;
    let (costs, (rows, cols, count)) = read_volume(costs, "costs")?;
    let window = Window::new((rows, cols), count, &settings, u16::MAX);
    let aggregated = supervised(py, &Pool::new(1)?, rows, None, move |_, control| {
        aggregate(&costs, window, Level::best(), control)
    })?;
    let array = Array3::from_shape_vec((rows, cols, count), aggregated.into_vec());
    Ok(array.map_err(internal)?.into_pyarray(py))
}

#[pyfunction]
fn optimize_volume<'py>(
    py: Python<'py>,
    costs: &Bound<'py, PyArray3<u32>>,
    settings: &Bound<'py, PyAny>,
    p1: u64,
    p2: u64,
) -> PyResult<Bound<'py, PyArray2<u16>>> {
    let settings = read_settings(settings)?;
    let (costs, (rows, _, count)) = read_volume(costs, "costs")?;
    let steps = Steps { p1, p2 };
    let chosen = supervised(py, &Pool::new(1)?, rows, None, move |_, control| {
        optimize(&costs, count, settings.optimizer, steps, Level::best(), control)
    })?;
    wrap(py, chosen)
}

fn wrap<T: Element>(py: Python<'_>, plane: Plane<T>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let (rows, cols) = (plane.rows(), plane.cols());
    Ok(Array2::from_shape_vec((rows, cols), plane.into_vec()).map_err(internal)?.into_pyarray(py))
}

/// For what cannot happen: an exception that asks for a report, rather than a panic.
fn internal(fault: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!("internal error, please report it: {fault}"))
}

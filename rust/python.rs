//! The Python face: validate, copy in, detach from the interpreter, run, wrap out.
//!
//! Both images are copied before the interpreter is let go: a borrow would not stop another Python thread
//! from writing into them.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use ndarray::{Array2, Array3};
use numpy::{Element, IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};

use crate::aggregation::{Window, aggregate};
use crate::control::Control;
use crate::cost::Costs;
use crate::descriptor::{Codes, describe};
use crate::error::Error;
use crate::intensity::gray_plane;
use crate::matcher::{Execution, MOST_THREADS, Pair, on_threads, run};
use crate::plane::Plane;
use crate::refinement::flag;
use crate::scanline::{Steps, optimize};
use crate::settings::{CostKind, MOST_DISPARITIES, Optimizer, Penalty, Settings, Taper};
use crate::view::{Image, Mask, View};

/// How often a running match looks for Ctrl-C and reports its progress.
const TICK: Duration = Duration::from_millis(50);

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
#[pymodule]
mod _core {
    use super::{Bound, PyDict, PyDictMethods, PyModule, PyModuleMethods, PyResult, flag};

    #[pymodule_export]
    use super::{
        aggregate_volume, check_settings, cost_volume, descriptor, match_pair, optimize_volume,
    };

    #[pymodule_init]
    fn constants(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))?;
        let flags = PyDict::new(module.py());
        flags.set_item("MASKED", flag::MASKED)?;
        flags.set_item("NO_CANDIDATE", flag::NO_CANDIDATE)?;
        flags.set_item("OUTSIDE", flag::OUTSIDE)?;
        flags.set_item("MATCH_MASKED", flag::MATCH_MASKED)?;
        module.add("FLAGS", flags)
    }
}

/// Something of the left and the same of the right image, or any other two things.
type Both<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

#[pyfunction]
fn check_settings(settings: &Bound<'_, PyAny>) -> PyResult<()> {
    read_settings(settings).map(drop)
}

/// Disparity, flags, confidence and timings of a pair.
type Matched<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u16>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyDict>,
);

#[pyfunction]
#[pyo3(signature = (images, masks, disparities, settings, threads, progress))]
fn match_pair<'py>(
    py: Python<'py>,
    images: Both<'py>,
    masks: Both<'py>,
    disparities: Both<'py>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Matched<'py>> {
    let settings = read_settings(settings)?;
    let pair = read_pair(&images, &masks, &disparities)?;
    let how = Execution { threads: read_threads(threads)?, band_rows: None };
    let control = Control::default();
    let rows = pair.size().0;
    let map = supervised(py, &control, rows, progress, || run(&pair, &settings, how, &control))?;
    let timings = PyDict::new(py);
    timings.set_item("description", map.timings.description.as_secs_f64())?;
    timings.set_item("matching", map.timings.matching.as_secs_f64())?;
    Ok((wrap(py, map.disparity)?, wrap(py, map.flags)?, wrap(py, map.confidence)?, timings))
}

#[pyfunction]
fn descriptor<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    mask: &Bound<'py, PyAny>,
    settings: &Bound<'py, PyAny>,
    threads: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let settings = read_settings(settings)?;
    let view = read_view(image, mask, "image")?;
    view.check("image")?;
    let (threads, control) = (read_threads(threads)?, Control::default());
    let rows = view.image.shape().0;
    let codes = supervised(py, &control, rows, None, || {
        on_threads(threads, || {
            let gray = gray_plane(&view, settings.intensity_range, &control)?;
            describe(&gray, &settings, &control)
        })?
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
) -> PyResult<Bound<'py, PyArray3<u16>>> {
    let settings = read_settings(settings)?;
    let none = py.None().into_bound(py);
    let pair = read_pair(&images, &(none.clone(), none), &disparities)?;
    let (threads, control) = (read_threads(threads)?, Control::default());
    let ((rows, cols), count) = (pair.size(), pair.candidates().count());
    let costs = supervised(py, &control, rows, None, || {
        on_threads(threads, || {
            let costs = Costs::new(pair.views(), pair.candidates(), &settings, &control)?;
            costs.volume(rows, cols * count, &control)
        })?
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
    let control = Control::default();
    let work = || aggregate(&costs, window, &control);
    let aggregated = supervised(py, &control, rows, None, work)?;
    let array = Array3::from_shape_vec((rows, cols, count), aggregated.into_vec());
    Ok(array.map_err(internal)?.into_pyarray(py))
}

#[pyfunction]
fn optimize_volume<'py>(
    py: Python<'py>,
    costs: &Bound<'py, PyArray3<u32>>,
    settings: &Bound<'py, PyAny>,
    penalty: (u64, u64),
) -> PyResult<Bound<'py, PyArray2<u16>>> {
    let settings = read_settings(settings)?;
    let (costs, (rows, _, count)) = read_volume(costs, "costs")?;
    let steps = Steps { rise: penalty.0, drop: penalty.1 };
    let control = Control::default();
    let work = || optimize(&costs, count, settings.optimizer, steps, &control);
    wrap(py, supervised(py, &control, rows, None, work)?)
}

/// Runs `work` beside the interpreter, which it lets go, and meanwhile minds Ctrl-C and progress.
fn supervised<T: Send>(
    py: Python<'_>,
    control: &Control,
    rows: usize,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce() -> crate::error::Result<T> + Send,
) -> PyResult<T> {
    let progress = progress.map(Bound::unbind);
    let report = |py: Python<'_>| -> PyResult<()> {
        py.check_signals()?;
        let Some(progress) = &progress else { return Ok(()) };
        progress.call1(py, (control.rows_done(), rows)).map(drop)
    };
    let outcome = py.detach(|| {
        thread::scope(|scope| {
            let (finish, finished) = channel::<()>();
            let worker = thread::Builder::new().spawn_scoped(scope, move || {
                // Dropped when the work ends, even by a panic: that wakes the supervisor.
                let _finish = finish;
                work()
            });
            let worker = worker.map_err(|error| Error::Threads(error.to_string()))?;
            let mut interruption = Ok(());
            while interruption.is_ok()
                && finished.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout)
            {
                interruption = Python::attach(report);
            }
            if interruption.is_err() {
                control.cancel();
            }
            let outcome = worker.join().map_err(|_| internal("a worker thread panicked"))?;
            interruption.and(outcome.map_err(PyErr::from))
        })
    })?;
    report(py)?;
    Ok(outcome)
}

fn read_pair(
    (left, right): &Both<'_>,
    masks: &Both<'_>,
    (min, count): &Both<'_>,
) -> PyResult<Pair> {
    let (min, count) = (integer(min, "min_disparity")?, integer(count, "num_disparities")?);
    let left = read_view(left, &masks.0, "left")?;
    let right = read_view(right, &masks.1, "right")?;
    Ok(Pair::new(left, right, min, count)?)
}

/// An image of rows x columns x channels, 1 or 3 of them, and its mask or None.
fn read_view(image: &Bound<'_, PyAny>, mask: &Bound<'_, PyAny>, name: &str) -> PyResult<View> {
    let image = if let Ok(array) = image.cast::<PyArray3<u8>>() {
        Image::U8(copied(array)?)
    } else if let Ok(array) = image.cast::<PyArray3<u16>>() {
        Image::U16(copied(array)?)
    } else if let Ok(array) = image.cast::<PyArray3<f32>>() {
        Image::F32(copied(array)?)
    } else if let Ok(array) = image.cast::<PyArray3<f64>>() {
        Image::F64(copied(array)?)
    } else {
        let message = format!("{name}: accepts 3-D arrays of uint8, uint16, float32 or float64");
        return Err(PyTypeError::new_err(message));
    };
    let (rows, cols, channels) = image.shape();
    if rows == 0 || cols == 0 || !matches!(channels, 1 | 3) {
        let message = format!(
            "{name}: got shape {:?}; accepts at least one pixel, 1 or 3 channels",
            image.shape()
        );
        return Err(PyValueError::new_err(message));
    }
    Ok(View { image, mask: read_mask(mask, (rows, cols), name)? })
}

fn read_mask(mask: &Bound<'_, PyAny>, size: (usize, usize), name: &str) -> PyResult<Option<Mask>> {
    if mask.is_none() {
        return Ok(None);
    }
    let Ok(array) = mask.cast::<PyArray2<bool>>() else {
        return Err(PyTypeError::new_err(format!("{name}_mask: accepts 2-D arrays of bool")));
    };
    let array = array.try_readonly().map_err(internal)?.as_array().to_owned();
    if array.dim() != size {
        let message =
            format!("{name}_mask: got shape {:?}; accepts the image's {size:?}", array.dim());
        return Err(PyValueError::new_err(message));
    }
    Ok(Some(Plane::from_vec(size.0, size.1, array.iter().copied().collect())?))
}

fn copied<T: Element + Clone>(array: &Bound<'_, PyArray3<T>>) -> PyResult<Array3<T>> {
    Ok(array.try_readonly().map_err(internal)?.as_array().to_owned())
}

/// A volume of rows x columns x candidates as a plane whose rows hold columns x candidates.
fn read_volume<T: Element + Copy>(
    volume: &Bound<'_, PyArray3<T>>,
    name: &'static str,
) -> PyResult<(Plane<T>, (usize, usize, usize))> {
    let array = copied(volume)?;
    let (rows, cols, count) = array.dim();
    if rows * cols == 0 || !(1..=MOST_DISPARITIES).contains(&count) {
        let accepts = format!("at least one pixel, 1 to {MOST_DISPARITIES} candidates");
        return Err(Error::value(name, format!("shape {:?}", array.dim()), accepts).into());
    }
    let plane = Plane::from_vec(rows, cols * count, array.iter().copied().collect())?;
    Ok((plane, (rows, cols, count)))
}

fn read_settings(settings: &Bound<'_, PyAny>) -> PyResult<Settings> {
    let field = |name: &str| settings.getattr(name);
    let settings = Settings {
        cost: choice(&field("cost")?, "cost", &COSTS)?,
        neighborhood: natural(&field("neighborhood")?, "neighborhood")?,
        taper: choice(&field("taper")?, "taper", &TAPERS)?,
        frequencies: {
            let (r, s) = both(&field("frequencies")?, "frequencies", "a pair of integers (r, s)")?;
            (natural(&r, "frequencies")?, natural(&s, "frequencies")?)
        },
        power: natural(&field("power")?, "power")?,
        bits: natural(&field("bits")?, "bits")?,
        window: natural(&field("window")?, "window")?,
        shiftable: boolean(&field("shiftable")?, "shiftable")?,
        optimizer: choice(&field("optimizer")?, "optimizer", &OPTIMIZERS)?,
        penalty: read_penalty(&field("penalty")?)?,
        intensity_range: match field("intensity_range")? {
            range if range.is_none() => None,
            range => {
                let (black, white) =
                    both(&range, "intensity_range", "a pair of numbers (black, white) or None")?;
                Some((number(&black, "intensity_range")?, number(&white, "intensity_range")?))
            }
        },
        fill: boolean(&field("fill")?, "fill")?,
    };
    settings.check()?;
    Ok(settings)
}

/// One number for both changes, or a pair.
fn read_penalty(penalty: &Bound<'_, PyAny>) -> PyResult<Penalty> {
    if let Ok(both) = number(penalty, "penalty") {
        return Ok(Penalty { rise: both, drop: both });
    }
    let (rise, drop) = both(penalty, "penalty", "a number or a pair of them (rise, drop)")?;
    Ok(Penalty { rise: number(&rise, "penalty")?, drop: number(&drop, "penalty")? })
}

const COSTS: [(&str, CostKind); 3] =
    [("phase", CostKind::Phase), ("sad", CostKind::Sad), ("nsad", CostKind::NormalisedSad)];
const TAPERS: [(&str, Taper); 3] =
    [("uniform", Taper::Uniform), ("gaussian", Taper::Gaussian), ("hann", Taper::Hann)];
const OPTIMIZERS: [(&str, Optimizer); 2] =
    [("dp", Optimizer::DynamicProgramming), ("wta", Optimizer::WinnerTakesAll)];

fn read_threads(threads: &Bound<'_, PyAny>) -> PyResult<usize> {
    if threads.is_none() {
        return Ok(thread::available_parallelism().map_or(1, Into::into).min(MOST_THREADS));
    }
    natural(threads, "threads")
}

fn choice<T: Copy>(
    value: &Bound<'_, PyAny>,
    name: &'static str,
    choices: &[(&str, T)],
) -> PyResult<T> {
    let Ok(word) = value.extract::<String>() else {
        return Err(wrong_type(value, name, "a string"));
    };
    let found = choices.iter().find(|(name, _)| *name == word).map(|(_, choice)| *choice);
    let names =
        || choices.iter().map(|(name, _)| format!("'{name}'")).collect::<Vec<_>>().join(", ");
    found.ok_or_else(|| Error::value(name, format!("'{word}'"), names()).into())
}

fn integer(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<i64> {
    let whole = value.call_method0("__index__");
    match whole {
        Ok(whole) if !value.is_instance_of::<PyBool>() => whole
            .extract()
            .map_err(|_| Error::value(name, &whole, "an integer of at most 64 bits").into()),
        _ => Err(wrong_type(value, name, "an integer")),
    }
}

fn natural(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<usize> {
    let whole = integer(value, name)?;
    usize::try_from(whole).map_err(|_| Error::value(name, whole, "no negative integers").into())
}

fn number(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<f64> {
    match value.extract() {
        Ok(number) if !value.is_instance_of::<PyBool>() => Ok(number),
        _ => Err(wrong_type(value, name, "a number")),
    }
}

fn boolean(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<bool> {
    value.extract().map_err(|_| wrong_type(value, name, "True or False"))
}

fn both<'py>(value: &Bound<'py, PyAny>, name: &str, accepts: &str) -> PyResult<Both<'py>> {
    value.extract().map_err(|_| wrong_type(value, name, accepts))
}

fn wrong_type(value: &Bound<'_, PyAny>, name: &str, accepts: &str) -> PyErr {
    let kind = value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: got {kind}; accepts {accepts}"))
}

fn wrap<T: Element>(py: Python<'_>, plane: Plane<T>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let (rows, cols) = (plane.rows(), plane.cols());
    Ok(Array2::from_shape_vec((rows, cols), plane.into_vec()).map_err(internal)?.into_pyarray(py))
}

/// For what cannot happen: an exception that asks for a report, rather than a panic.
fn internal(fault: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(format!("internal error, please report it: {fault}"))
}

//! Arguments from Python: converted to the types of the core, or refused by an exception that names the argument.

use ndarray::{Array3, Dimension};
use numpy::{Element, PyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict};

use super::internal;
use crate::estimates::{Field, read_field, read_findings};
use crate::failure::{Failure, Result};
use crate::reader::{as_packing, as_ranges};
use phasestereo::Error;
use phasestereo::internals::cost::candidates::Candidates;
use phasestereo::internals::image::convolution::Kernel;
use phasestereo::internals::image::intensity_range::IntensityRange;
use phasestereo::internals::image::packing::Packing;
use phasestereo::internals::image::plane::{Plane, zeroed};
use phasestereo::internals::image::texture::{Roughness, Texture};
use phasestereo::internals::image::view::{Image, Mask, View};
use phasestereo::internals::pipeline::matcher::usable_threads;
use phasestereo::internals::pipeline::pair::Pair;
use phasestereo::internals::refinement::calibration::Tally;
use phasestereo::internals::rig::alignment::Alignment;
use phasestereo::internals::rig::blur_compensation::{BlurCompensation, check_noise};
use phasestereo::internals::rig::estimation::Known;
use phasestereo::internals::settings::presets::Preset;
use phasestereo::internals::settings::{
    COSTS, CostKind, MOST_DISPARITIES, OPTIMIZERS, Optimizer, PRECISIONS, Precision, Settings,
    TAPERS, Taper, with_every_setting,
};

/// A pair of Python objects, usually for the left and for the right image.
pub type Both<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

const KERNELS: &str = "pairs (left, right) of 2-D arrays of float32, or None";

/// Least disparity and number of disparities; `None`: the range is estimated.
pub type Disparities = Option<(i64, i64)>;

/// Reads (`min_disparity`, `num_disparities`), the latter an integer or None.
pub fn read_search((min, count): &Both<'_>) -> Result<Disparities> {
    let min = integer(min, "min_disparity")?;
    if !count.is_none() {
        return Ok(Some((min, integer(count, "num_disparities")?)));
    }

    if min != 0 {
        let accepts = "0 where num_disparities is None, since the whole range is then estimated";
        return Err(Error::value("min_disparity", min, accepts).into());
    }

    Ok(None)
}

/// The disparities of a pair, unless the range is estimated.
pub fn candidates_of(pair: &Pair, search: Disparities) -> Option<Candidates> {
    search.map(|_| pair.candidates())
}

/// Reads both images, their masks, and (`min_disparity`, `num_disparities`).
pub fn read_pair(images: &Both<'_>, masks: &Both<'_>, disparities: &Both<'_>) -> Result<Pair> {
    let (min, count) = disparities;
    let search = (integer(min, "min_disparity")?, integer(count, "num_disparities")?);

    read_images(images, masks, Some(search))
}

/// Reads both images and their masks. The pair is searched over these disparities, or over one until the range is
/// known.
pub fn read_images(
    (left, right): &Both<'_>,
    masks: &Both<'_>,
    search: Disparities,
) -> Result<Pair> {
    let (min, count) = search.unwrap_or((0, 1));
    let left = read_view(left, &masks.0, "left")?;
    let right = read_view(right, &masks.1, "right")?;

    Ok(Pair::new(left, right, min, count)?)
}

/// Reads an image of rows x columns x channels, 1 or 3 of them, and its mask or None.
pub fn read_view(image: &Bound<'_, PyAny>, mask: &Bound<'_, PyAny>, name: &str) -> Result<View> {
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
        return Err(PyTypeError::new_err(message).into());
    };

    let (rows, cols, channels) = image.shape();
    if rows == 0 || cols == 0 || !matches!(channels, 1 | 3) {
        let message = format!(
            "{name}: got shape {:?}; accepts at least one pixel, 1 or 3 channels",
            image.shape()
        );
        return Err(PyValueError::new_err(message).into());
    }

    Ok(View { mask: read_mask(mask, (rows, cols), name)?, ..View::from(image) })
}

/// Reads a mask of a given size, or None. True is whatever byte is not 0, as `NumPy` has it: arrays of bool may be views of
/// any bytes, and most of those are no `bool` of Rust.
fn read_mask(mask: &Bound<'_, PyAny>, size: (usize, usize), name: &str) -> Result<Option<Mask>> {
    if mask.is_none() {
        return Ok(None);
    }

    let Ok(array) = mask.cast::<PyArray2<bool>>() else {
        let message = format!("{name}_mask: accepts 2-D arrays of bool");
        return Err(PyTypeError::new_err(message).into());
    };

    let shape: (usize, usize) = array.dims().into_pattern();
    if shape != size {
        let message = format!("{name}_mask: got shape {shape:?}; accepts the image's {size:?}");
        return Err(PyValueError::new_err(message).into());
    }

    let bytes = mask.call_method1("view", ("uint8",))?;
    let bytes = values(bytes.cast::<PyArray2<u8>>().map_err(PyErr::from)?)?;
    Ok(Some(Plane::from_vec(size.0, size.1, bytes.into_iter().map(|byte| byte != 0).collect())?))
}

/// A copy of the pixels of an image.
fn copied<T: Element + Copy + Default>(array: &Bound<'_, PyArray3<T>>) -> Result<Array3<T>> {
    let dimensions = array.dims();
    Array3::from_shape_vec(dimensions, values(array)?).map_err(internal)
}

/// The values of an array in the order of its indices; an exception, not an abort, without the memory.
pub fn values<T, D>(array: &Bound<'_, PyArray<T, D>>) -> Result<Vec<T>>
where
    T: Element + Copy + Default,
    D: Dimension,
{
    let array = array.try_readonly().map_err(internal)?;

    let mut copy = zeroed(array.as_array().len())?;
    match array.as_slice() {
        Ok(values) => copy.copy_from_slice(values),
        Err(_) => copy.iter_mut().zip(array.as_array()).for_each(|(copy, value)| *copy = *value),
    }

    Ok(copy)
}

/// Reads a volume of rows x columns x candidates as a plane whose rows hold columns x candidates.
pub fn read_volume<T: Element + Copy + Default>(
    volume: &Bound<'_, PyArray3<T>>,
    name: &'static str,
) -> Result<(Plane<T>, (usize, usize, usize))> {
    let (rows, cols, count) = volume.dims().into_pattern();
    if rows * cols == 0 || !(1..=MOST_DISPARITIES).contains(&count) {
        let accepts = format!("at least one pixel, 1 to {MOST_DISPARITIES} candidates");
        return Err(Error::value(name, format!("shape {:?}", (rows, cols, count)), accepts).into());
    }

    let plane = Plane::from_vec(rows, cols * count, values(volume)?)?;
    Ok((plane, (rows, cols, count)))
}

macro_rules! settings_by_name {
    ($($name:ident),* $(,)?) => {
        /// The settings as a dictionary of the fields of `phasestereo.Settings`, which [`read_settings`] reads.
        pub fn write_settings<'py>(
            py: Python<'py>,
            settings: &Settings,
        ) -> Result<Bound<'py, PyDict>> {
            let fields = PyDict::new(py);
            $(fields.set_item(stringify!($name), settings.$name.to_py())?;)*
            Ok(fields)
        }

        /// Reads the fields of `phasestereo.Settings` and checks them.
        pub fn read_settings(settings: &Bound<'_, PyAny>) -> Result<Settings> {
            let settings = Settings {
                $($name: SettingValue::from_py(&settings.getattr(stringify!($name))?, stringify!($name))?),*
            };
            settings.check()?;
            Ok(settings)
        }
    };
}

with_every_setting!(settings_by_name);

/// The type of a setting, converted from and to Python.
trait SettingValue: Sized {
    /// The type in Python.
    type Python;

    /// Reads the value of a setting; an exception names the setting.
    fn from_py(value: &Bound<'_, PyAny>, name: &'static str) -> Result<Self>;

    /// The value for Python.
    fn to_py(&self) -> Self::Python;
}

macro_rules! plain_settings {
    ($($kind:ty: $read:ident),*) => {
        $(impl SettingValue for $kind {
            type Python = Self;

            fn from_py(value: &Bound<'_, PyAny>, name: &'static str) -> Result<Self> {
                $read(value, name)
            }

            fn to_py(&self) -> Self {
                *self
            }
        })*
    };
}

plain_settings!(
    usize: natural,
    f64: number,
    bool: boolean,
    (usize, usize): frequencies,
    Option<(f64, f64)>: intensities,
    Option<usize>: natural_or_none
);

macro_rules! choices {
    ($($kind:ty: $choices:ident),*) => {
        $(impl SettingValue for $kind {
            type Python = Option<&'static str>;

            fn from_py(value: &Bound<'_, PyAny>, name: &'static str) -> Result<Self> {
                choice(value, name, &$choices)
            }

            fn to_py(&self) -> Self::Python {
                $choices.iter().find(|(_, choice)| choice == self).map(|(name, _)| *name)
            }
        })*
    };
}

choices!(CostKind: COSTS, Taper: TAPERS, Precision: PRECISIONS, Optimizer: OPTIMIZERS);

fn frequencies(value: &Bound<'_, PyAny>, name: &'static str) -> Result<(usize, usize)> {
    let (r, s) = both(value, name, "a pair of integers (r, s)")?;
    Ok((natural(&r, name)?, natural(&s, name)?))
}

fn intensities(value: &Bound<'_, PyAny>, name: &'static str) -> Result<Option<(f64, f64)>> {
    if value.is_none() {
        return Ok(None);
    }

    let (black, white) = both(value, name, "a pair of numbers (black, white) or None")?;
    Ok(Some((number(&black, name)?, number(&white, name)?)))
}

fn natural_or_none(value: &Bound<'_, PyAny>, name: &'static str) -> Result<Option<usize>> {
    if value.is_none() { Ok(None) } else { natural(value, name).map(Some) }
}

/// What a caller knows of a pair: noise, blur compensation, the field of vertical offsets, whether the right image is
/// inverted, and what was said about an earlier pair.
pub type KnownOfPair<'py> =
    (Bound<'py, PyAny>, Bound<'py, PyAny>, Option<Field>, bool, Vec<(String, String, String)>);

/// Reads what a caller knows of a pair of this size.
pub fn read_known(
    (noise, compensation, field, is_inverted, findings): &KnownOfPair<'_>,
    size: (usize, usize),
    search: Disparities,
) -> Result<Known> {
    let noise = if noise.is_none() {
        None
    } else {
        let (left, right) = both(noise, "noise", "a number, a pair of them, or None")?;
        Some([check_noise(number(&left, "noise")?)?, check_noise(number(&right, "noise")?)?])
    };

    let alignment = read_field(*field)?;
    if alignment.as_ref().is_some_and(|field| field.size() != size) {
        let accepts = format!("a field for images of {} x {} pixels", size.0, size.1);
        return Err(Error::value("alignment", "a field for images of another size", accepts).into());
    }

    let candidates = search.map(|(min, count)| Candidates::new(min, count, size.1)).transpose()?;
    let compensation = read_blur_compensation(compensation)?;
    let is_inverted = *is_inverted;

    let findings = read_findings(findings)?;

    Ok(Known { candidates, noise, compensation, alignment, is_inverted, findings })
}

/// The fields of `phasestereo_large.PairStatistics`: the statistics of a whole pair that the match of its parts needs.
pub struct Statistics<'py> {
    pub settings: Settings,
    pub compensation: Option<BlurCompensation>,
    pub alignment: Option<Alignment>,
    pub is_inverted: bool,
    pub disparities: Both<'py>,
    pub packing: Packing,
    pub ranges: [Option<IntensityRange>; 2],
    pub roughness: Option<Roughness>,
    pub tally: Option<Tally>,
}

impl<'py> Statistics<'py> {
    /// Reads the fields and checks them.
    pub fn read(statistics: &Bound<'py, PyAny>) -> Result<Self> {
        let settings = read_settings(&statistics.getattr("settings")?)?;

        let roughness: Option<(u64, u64)> = statistics.getattr("roughness")?.extract()?;
        if roughness.is_none() && Texture::is_needed(&settings) {
            let accepts = "the roughness of the whole left image, with these settings";
            return Err(Error::value("roughness", "None", accepts).into());
        }

        let tally: Option<(u64, u64, u64, u64, u64)> = statistics.getattr("tally")?.extract()?;

        Ok(Self {
            settings,
            compensation: read_blur_compensation(&statistics.getattr("blur_compensation")?)?,
            alignment: read_field(statistics.getattr("field")?.extract()?)?,
            is_inverted: statistics.getattr("is_inverted")?.extract()?,
            disparities: (
                statistics.getattr("min_disparity")?,
                statistics.getattr("num_disparities")?,
            ),
            packing: as_packing(statistics.getattr("packing")?.extract()?),
            ranges: as_ranges(statistics.getattr("ranges")?.extract()?),
            roughness: roughness.map(|(sum, pairs)| Roughness { sum, pairs }),
            tally: tally.map(|(confidence, own, failed, ends, pixels)| Tally {
                confidence,
                own,
                failed,
                ends,
                pixels,
            }),
        })
    }
}

/// Reads a standard deviation, or None.
pub fn read_noise(noise: &Bound<'_, PyAny>) -> Result<Option<f64>> {
    if noise.is_none() {
        return Ok(None);
    }

    Ok(Some(check_noise(number(noise, "noise")?)?))
}

/// Reads the fields of `phasestereo.BlurCompensation` and checks them; or None.
pub fn read_blur_compensation(compensation: &Bound<'_, PyAny>) -> Result<Option<BlurCompensation>> {
    if compensation.is_none() {
        return Ok(None);
    }

    let field = |name: &str| compensation.getattr(name);

    let (left, right) = both(&field("noise")?, "noise", "a pair of numbers (left, right)")?;

    let mut kernels = vec![];
    let listed = field("kernels")?;
    for pair in listed.try_iter().map_err(|_| wrong_type(&listed, "kernels", KERNELS))? {
        let (left, right) = both(&pair?, "kernels", KERNELS)?;
        kernels.push([read_kernel(&left)?, read_kernel(&right)?]);
    }

    let labels = field("labels")?;
    let Ok(labels) = labels.cast::<PyArray2<u8>>() else {
        return Err(wrong_type(&labels, "labels", "2-D arrays of uint8"));
    };
    let (rows, cols) = labels.dims().into_pattern();
    let labels = Plane::from_vec(rows, cols, values(labels)?)?;

    let noise = [number(&left, "noise")?, number(&right, "noise")?];
    let compensation =
        BlurCompensation::new(noise, kernels, labels, natural(&field("tile")?, "tile")?)?;

    let deviations = |name: &'static str| -> Result<[f64; 2]> {
        let (left, right) = both(&field(name)?, name, "a pair of numbers (left, right)")?;
        Ok([number(&left, name)?, number(&right, name)?])
    };

    let compensation = compensation.with_impulses(deviations("impulses")?)?;
    Ok(Some(compensation.with_smoothing(deviations("smoothing")?)?))
}

/// Reads a kernel, or None.
fn read_kernel(kernel: &Bound<'_, PyAny>) -> Result<Option<Kernel>> {
    if kernel.is_none() {
        return Ok(None);
    }

    let Ok(taps) = kernel.cast::<PyArray2<f32>>() else {
        return Err(wrong_type(kernel, "kernels", KERNELS));
    };

    let (rows, cols) = taps.dims().into_pattern();
    let taps = values(taps)?.into_iter().map(f64::from).collect();
    let kernel = Plane::from_vec(rows, cols, taps).and_then(|taps| Kernel::new(&taps));
    Ok(Some(kernel.map_err(|error| error.about("kernels"))?))
}

/// Reads the name of a preset.
pub fn read_preset(name: &Bound<'_, PyAny>) -> Result<Preset> {
    let Ok(word) = name.extract::<String>() else {
        return Err(wrong_type(name, "preset", "a string"));
    };

    Ok(Preset::named(&word)?)
}

/// Reads a number of threads; None: that of `RAYON_NUM_THREADS`, or as many as the process may use.
pub fn read_threads(threads: &Bound<'_, PyAny>) -> Result<usize> {
    if threads.is_none() { Ok(usable_threads()) } else { natural(threads, "threads") }
}

/// Reads one of the words of a setting.
fn choice<T: Copy>(
    value: &Bound<'_, PyAny>,
    name: &'static str,
    choices: &[(&str, T)],
) -> Result<T> {
    let Ok(word) = value.extract::<String>() else {
        return Err(wrong_type(value, name, "a string"));
    };

    let found = choices.iter().find(|(name, _)| *name == word).map(|(_, choice)| *choice);
    let names =
        || choices.iter().map(|(name, _)| format!("'{name}'")).collect::<Vec<_>>().join(", ");
    found.ok_or_else(|| Error::value(name, format!("'{word}'"), names()).into())
}

/// Reads an integer of any type, but no bool.
fn integer(value: &Bound<'_, PyAny>, name: &'static str) -> Result<i64> {
    match value.call_method0("__index__") {
        // A huge integer is not printed: Python may refuse to.
        Ok(whole) if !value.is_instance_of::<PyBool>() => whole
            .extract()
            .map_err(|_| Error::value(name, "an integer beyond 64 bits", "a smaller one").into()),
        Err(error) if !error.is_instance_of::<PyException>(value.py()) => Err(error.into()),
        _ => Err(wrong_type(value, name, "an integer")),
    }
}

fn natural(value: &Bound<'_, PyAny>, name: &'static str) -> Result<usize> {
    let whole = integer(value, name)?;
    usize::try_from(whole)
        .map_err(|_| Error::value(name, whole, "an integer that is not negative").into())
}

fn number(value: &Bound<'_, PyAny>, name: &'static str) -> Result<f64> {
    // NumPy's numbers are registered as real ones; bool is one, too, but is refused.
    let real = value.py().import("numbers")?.getattr("Real")?;
    if !value.is_instance(&real)? || value.is_instance_of::<PyBool>() {
        return Err(wrong_type(value, name, "a number"));
    }

    let beyond = |_| Error::value(name, "a number beyond any float", "a smaller one").into();
    value.extract().map_err(beyond)
}

fn boolean(value: &Bound<'_, PyAny>, name: &'static str) -> Result<bool> {
    value.extract().map_err(|_| wrong_type(value, name, "True or False"))
}

fn both<'py>(value: &Bound<'py, PyAny>, name: &str, accepts: &str) -> Result<Both<'py>> {
    value.extract().map_err(|_| wrong_type(value, name, accepts))
}

fn wrong_type(value: &Bound<'_, PyAny>, name: &str, accepts: &str) -> Failure {
    let kind = value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: got {kind}; accepts {accepts}")).into()
}

//! Arguments from Python: converted to the types of the core, or refused by an exception that names the
//! argument.

use ndarray::{Array3, Dimension};
use numpy::{Element, PyArray, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyTuple};

use super::internal;
use crate::failure::{Failure, Result};
use crate::reader::as_conversions;
use crate::settings::read_settings;
use phasestereo::Error;
use phasestereo_match::base::plane::{Plane, zeroed};
use phasestereo_match::image::conversion::Conversion;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::texture::{Roughness, Texture};
use phasestereo_match::image::view::Mask;
use phasestereo_match::matcher::usable_threads;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::{Alignment, TERMS};
use phasestereo_match::pair::blur_compensation::{BlurCompensation, check_noise};
use phasestereo_match::refinement::calibration::Tally;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{MOST_DISPARITIES, Settings};

/// A pair of Python objects, usually for the left and the right image.
pub type Both<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

const KERNELS: &str = "pairs (left, right) of 2-D arrays of float32, or None";

/// Smallest disparity and number of disparities; `None`: the range is estimated.
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

/// Reads both images, their masks, and (`min_disparity`, `num_disparities`).
pub fn read_pair(images: &Both<'_>, masks: &Both<'_>, disparities: &Both<'_>) -> Result<Pair> {
    read_images(images, masks, Some(read_range(disparities)?))
}

/// Reads (`min_disparity`, `num_disparities`).
pub fn read_range((min, count): &Both<'_>) -> Result<(i64, i64)> {
    Ok((integer(min, "min_disparity")?, integer(count, "num_disparities")?))
}

/// Reads both images and their masks. The pair is searched over these disparities, or over one until the
/// range is known.
pub fn read_images(images: &Both<'_>, masks: &Both<'_>, search: Disparities) -> Result<Pair> {
    let (min, count) = search.unwrap_or((0, 1));
    let inputs = read_inputs(images, masks)?;

    Ok(images.0.py().detach(|| Pair::of_inputs(inputs, min, count))?)
}

/// The same for images of any sizes and types.
pub fn read_any_images(images: &Both<'_>, masks: &Both<'_>, search: Disparities) -> Result<Pair> {
    let (min, count) = search.unwrap_or((0, 1));
    let inputs = read_inputs(images, masks)?;

    Ok(images.0.py().detach(|| Pair::of_any(inputs, min, count))?)
}

/// Reads both images and their masks.
pub fn read_inputs((left, right): &Both<'_>, masks: &Both<'_>) -> Result<[Input; 2]> {
    Ok([read_input(left, &masks.0, "left")?, read_input(right, &masks.1, "right")?])
}

/// Reads an image of rows x columns x channels, 1 or 3 of them, and its mask or None.
pub fn read_input(image: &Bound<'_, PyAny>, mask: &Bound<'_, PyAny>, name: &str) -> Result<Input> {
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
        let message =
            format!("{name}: got shape {:?}; accepts at least one pixel, 1 or 3 channels", image.shape());
        return Err(PyValueError::new_err(message).into());
    }

    Ok(Input { mask: read_mask(mask, (rows, cols), name)?, ..Input::from(image) })
}

/// Reads a mask of a given size, or None. Any nonzero byte is true, as in `NumPy`: arrays of bool may be
/// views of any bytes, and most of those are not a valid `bool` in Rust.
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

/// The values of an array in the order of its indices; an exception, not an abort, if memory runs out.
pub fn values<T, D>(array: &Bound<'_, PyArray<T, D>>) -> Result<Vec<T>>
where
    T: Element + Copy + Default,
    D: Dimension,
{
    let array = array.try_readonly().map_err(internal)?;

    let mut copy = zeroed(array.as_array().len())?;
    // Fortran arrays are contiguous, too, in another order.
    match array.as_slice() {
        Ok(values) if array.is_c_contiguous() => copy.copy_from_slice(values),
        _ => copy.iter_mut().zip(array.as_array()).for_each(|(copy, value)| *copy = *value),
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

/// The fields of `phasestereo_large.PairStatistics`: the statistics of a whole pair that the match of its
/// parts needs.
pub struct Statistics<'py> {
    pub settings: Settings,
    pub compensation: Option<BlurCompensation>,
    pub alignment: Option<Alignment>,
    pub is_inverted: bool,
    pub disparities: Both<'py>,
    pub conversions: [Conversion; 2],
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
            alignment: read_alignment(&statistics.getattr("alignment")?)?,
            is_inverted: statistics.getattr("is_inverted")?.extract()?,
            disparities: (statistics.getattr("min_disparity")?, statistics.getattr("num_disparities")?),
            conversions: as_conversions(
                statistics.getattr("packing")?.extract()?,
                statistics.getattr("ranges")?.extract()?,
            ),
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

/// Reads the fields of `phasestereo.Alignment`; `None` for None, and if it is not applied.
pub fn read_alignment(alignment: &Bound<'_, PyAny>) -> Result<Option<Alignment>> {
    if alignment.is_none() || !alignment.getattr("applied")?.is_truthy()? {
        return Ok(None);
    }

    let coefficients = alignment.getattr("coefficients")?;
    let factors: [f64; TERMS] = coefficients
        .extract()
        .map_err(|_| wrong_type(&coefficients, "alignment", "eight coefficients, in a tuple of floats"))?;
    let field = Alignment::new(factors, alignment.getattr("size")?.extract()?)?;

    let sway = alignment.getattr("sway")?;
    let factors: Vec<f64> = sway.extract().unwrap_or_default();
    if factors.is_empty() && sway.is_instance_of::<PyTuple>() && sway.is_empty()? {
        return Ok(Some(field));
    }
    let factors = factors
        .try_into()
        .map_err(|_| wrong_type(&sway, "alignment", "as sway an empty tuple, or 19 floats in a tuple"))?;
    Ok(Some(field.with_sway(factors)?))
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

    if !compensation.hasattr("kernels")? {
        return Err(wrong_type(compensation, "blur_compensation", "BlurCompensation or None"));
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
    let compensation = BlurCompensation::new(noise, kernels, labels, natural(&field("tile")?, "tile")?)?;

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

/// Reads a number of threads; None: that of `RAYON_NUM_THREADS`, or all processors of the process.
pub fn read_threads(threads: &Bound<'_, PyAny>) -> Result<usize> {
    if threads.is_none() { Ok(usable_threads()) } else { natural(threads, "threads") }
}

/// Reads an integer of any type except bool.
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

pub fn natural(value: &Bound<'_, PyAny>, name: &'static str) -> Result<usize> {
    let whole = integer(value, name)?;
    usize::try_from(whole).map_err(|_| Error::value(name, whole, "an integer that is not negative").into())
}

pub fn number(value: &Bound<'_, PyAny>, name: &'static str) -> Result<f64> {
    // NumPy's numbers are registered as real ones; bool is one, too, but is refused.
    let real = value.py().import("numbers")?.getattr("Real")?;
    if !value.is_instance(&real)? || value.is_instance_of::<PyBool>() {
        return Err(wrong_type(value, name, "a number"));
    }

    let beyond = |_| Error::value(name, "a number beyond any float", "a smaller one").into();
    value.extract().map_err(beyond)
}

pub fn both<'py>(value: &Bound<'py, PyAny>, name: &str, accepts: &str) -> Result<Both<'py>> {
    value.extract().map_err(|_| wrong_type(value, name, accepts))
}

pub fn wrong_type(value: &Bound<'_, PyAny>, name: &str, accepts: &str) -> Failure {
    let kind = value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: got {kind}; accepts {accepts}")).into()
}

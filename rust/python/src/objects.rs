//! Python objects for the results of the core: the dataclasses of the package, made only here, by the names
//! of their fields.

use std::time::Duration;

use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple};

use super::wrap;
use crate::failure::Result;
use phasestereo::Finding;
use phasestereo::found::{
    Blur, BlurEstimate, Cameras, CompensationPlan, Contrast, Photometry, Psf, RowOffsets, Side, Taps,
};
use phasestereo::internals::estimation::facts::Origin;
use phasestereo::internals::match_pair;
use phasestereo::internals::verification::Verification;
use phasestereo::{Calibration, Estimates, Rectified};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::pixels::Image;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::summary::Summary;

/// An object of Python.
pub type Object<'py> = Bound<'py, PyAny>;

/// A dictionary of fields: the bracketed ones are copied from the fields of a struct with the same names;
/// others have values.
macro_rules! fields {
    ($py:expr, $([$from:ident: $($same:ident),*])? $($name:ident: $value:expr),* $(,)?) => {{
        let fields = PyDict::new($py);
        $($(fields.set_item(stringify!($same), $from.$same)?;)*)?
        $(fields.set_item(stringify!($name), $value)?;)*
        fields
    }};
}

/// An object of a class, with such fields.
macro_rules! object {
    ($py:expr, $module:literal, $class:literal, $($fields:tt)*) => {
        object($module, $class, &fields!($py, $($fields)*))
    };
}

/// An object of a class of a module of the package.
fn object<'py>(module: &str, class: &str, fields: &Bound<'py, PyDict>) -> Result<Object<'py>> {
    let class = fields.py().import(format!("phasestereo.{module}"))?.getattr(class)?;
    Ok(class.call((), Some(fields))?)
}

/// A copy of a dataclass with some other fields.
fn replaced<'py>(object: &Object<'py>, fields: &Bound<'py, PyDict>) -> Result<Object<'py>> {
    let dataclasses = object.py().import("dataclasses")?;
    Ok(dataclasses.call_method("replace", (object,), Some(fields))?)
}

/// The request of a call, which results repeat.
pub struct Asked<'py> {
    /// The settings.
    pub settings: Object<'py>,
    /// The known facts about the pair, or None.
    pub known: Object<'py>,
    /// Whether the disparities to search were given.
    pub is_searched: bool,
    /// Whether blur and noise are those of an earlier frame.
    pub is_reused: bool,
}

/// A matched pair.
pub struct Matched {
    /// The map.
    pub map: Disparity,
    /// Its summary.
    pub summary: Summary,
    /// The estimates from the pair.
    pub estimates: Estimates,
    /// How many frames support each disparity, and the time that a temporal filter took.
    pub support: Option<(Plane<u8>, Duration)>,
    /// The time that a second map took.
    pub second: Option<Duration>,
    /// The findings.
    pub findings: Vec<Finding>,
    /// The rectification of a pair that needed one.
    pub rectified: Option<Rectified>,
}

/// The result of a match.
pub fn result<'py>(py: Python<'py>, found: Matched, asked: &Asked<'py>) -> Result<Object<'py>> {
    let Matched { map, summary, estimates, support, second, findings, rectified } = found;

    let fields = map_fields(py, map, estimates.time)?;
    fields.set_item("vertical", estimates.is_vertical())?;
    let timings = fields.as_any().get_item("timings")?;
    fields.update(estimated(py, estimates, asked)?.cast::<PyMapping>().map_err(PyErr::from)?)?;

    if let Some(rectified) = rectified {
        fields.set_item("rectified", rectified_of(py, rectified)?)?;
        // The remaining field is one of the rectified pair.
        fields.set_item("alignment", py.None())?;
    }
    if let Some((frames, time)) = support {
        fields.set_item("temporal_support", wrap(py, frames)?)?;
        timings.set_item("temporal filter", time.as_secs_f64())?;
    }
    if let Some(time) = second {
        timings.set_item("second", time.as_secs_f64())?;
    }

    let summary = object!(py, "result", "Summary",
        [summary: estimated, flagged, at_low, at_high, confidence, wrong, coarse, inferred, second, detail]
    )?;
    fields.set_item("summary", summary)?;
    fields.set_item("findings", findings_of(py, findings)?)?;
    object("result", "Result", &fields)
}

/// The result of a match of some rows of a pair with these statistics.
pub fn result_of_rows<'py>(map: Disparity, statistics: &Object<'py>) -> Result<Object<'py>> {
    let fields = map_fields(statistics.py(), map, Duration::ZERO)?;
    for name in ["settings", "search", "blur", "alignment", "blur_compensation"] {
        fields.set_item(name, statistics.getattr(name)?)?;
    }
    object("result", "Result", &fields)
}

/// A second opinion on a map; `said` holds the findings about the own match.
pub fn verification<'py>(
    py: Python<'py>,
    judged: Verification,
    summary: Summary,
    said: Vec<Finding>,
    asked: &Asked<'py>,
) -> Result<Object<'py>> {
    let Verification { verdicts, better, confidence, uncertainty, findings, matched, .. } = judged;
    let every = findings.into_iter().chain(said.iter().cloned()).collect();

    let match_pair::Matched { map, prepared, rectified, .. } = matched;
    let estimates = prepared.estimates;
    let findings = said;
    let own = Matched { map, summary, estimates, support: None, second: None, findings, rectified };
    object!(py, "verification", "Verification",
        verdict: wrap(py, verdicts)?, better: wrap(py, better)?,
        confidence: wrap(py, confidence)?, uncertainty: wrap(py, uncertainty)?,
        findings: findings_of(py, every)?, result: result(py, own, asked)?
    )
}

/// The estimates of a pair.
pub fn estimates<'py>(py: Python<'py>, found: Estimates, asked: &Asked<'py>) -> Result<Object<'py>> {
    let photometry = found.photometry.as_ref().map(|all| photometry_of(py, all)).transpose()?;
    let findings = findings_of(py, found.findings.clone())?;

    let fields = estimated(py, found, asked)?;
    fields.set_item("photometry", photometry)?;
    fields.set_item("findings", findings)?;
    object("rig.estimates", "Estimates", &fields)
}

/// The maps of a match, and the durations of its stages, after an estimation of that time.
fn map_fields(py: Python<'_>, map: Disparity, estimation: Duration) -> Result<Bound<'_, PyDict>> {
    let times = map.timings;
    let timings = PyDict::new(py);
    for (stage, time, is_optional) in [
        ("estimation", estimation, true),
        ("description", times.description, false),
        ("matching", times.matching, false),
        ("refinement", times.refinement, false),
        ("scales", times.scales, true),
    ] {
        if !(is_optional && time.is_zero()) {
            timings.set_item(stage, time.as_secs_f64())?;
        }
    }

    let optional = |map: Option<Plane<f32>>| map.map(|map| wrap(py, map)).transpose();
    Ok(fields!(py,
        disparity: wrap(py, map.disparity)?, flags: wrap(py, map.flags)?,
        confidence: optional(map.confidence)?, uncertainty: optional(map.uncertainty)?,
        timings: timings
    ))
}

/// The fields that estimates and results share.
fn estimated<'py>(py: Python<'py>, found: Estimates, asked: &Asked<'py>) -> Result<Bound<'py, PyDict>> {
    let search = search_of(py, &found, asked.is_searched)?;
    let is_applied = found.alignment.is_some();
    let alignment = found.offsets.map(|offsets| alignment_of(py, &offsets, is_applied));
    let contrast = found.photometry.and_then(|all| all.contrast);
    let blur = found.blur.map(|blur| blur_estimate(py, blur, contrast.as_ref(), asked.is_reused));

    let (settings, compensation) = match found.compensation {
        Some(plan) => suited(py, plan, &asked.settings)?,
        None if asked.known.is_none() => (asked.settings.clone(), asked.known.clone()),
        None => (asked.settings.clone(), asked.known.getattr("blur_compensation")?),
    };

    let fields = fields!(py,
        settings: settings, search: &search, blur_compensation: compensation,
        alignment: alignment.transpose()?, blur: blur.transpose()?
    );

    Ok(fields)
}

fn search_of<'py>(py: Python<'py>, found: &Estimates, is_given: bool) -> Result<Object<'py>> {
    let Estimates { candidates, confidence, range, left_out, is_inverted, .. } = found;
    let places = left_out.iter().map(|place| {
        let (rows, columns) = (&place.rows, &place.columns);
        object!(py, "rig.search_range", "LeftOut",
            [place: low, high] rows: (rows.start, rows.end), columns: (columns.start, columns.end)
        )
    });
    let places = PyTuple::new(py, places.collect::<Result<Vec<_>>>()?)?;

    let fields = match range {
        Some(range) => {
            let fields = fields!(py, [range: low, high, negative, mixed, identical]);
            fields.set_item("swapped", range.is_swapped())?;
            fields
        }
        None => PyDict::new(py),
    };
    fields.set_item("min_disparity", candidates.value.min())?;
    fields.set_item("num_disparities", candidates.value.count())?;
    let is_known = range.is_some() || candidates.origin == Origin::Remembered;
    let found = if is_known { "found" } else { "default" };
    fields.set_item("origin", if is_given { "given" } else { found })?;
    fields.set_item("confidence", confidence.unwrap_or(f64::NAN))?;
    fields.set_item("inverted", is_inverted)?;
    fields.set_item("left_out", places)?;
    object("rig.search_range", "SearchRange", &fields)
}

/// The rectified pair in place of one that is far from rectified.
fn rectified_of(py: Python<'_>, found: Rectified) -> Result<Object<'_>> {
    let Rectified { raw, map, rows, .. } = found;

    let mut maps = vec![];
    for places in raw.places(&Control::default())? {
        let [x, y] = [0, 1].map(|axis| wrap(py, places.map(|at| at[axis])));
        maps.push((x?, y?));
    }

    object!(py, "rig.rectified", "Rectified",
        disparity: wrap(py, map.disparity)?, rows: wrap(py, rows)?, maps: PyTuple::new(py, maps)?,
        calibration: calibration(py, &raw.rectification.cameras)?, error: raw.rectification.rms
    )
}

/// Cameras in OpenCV's form, by name.
pub fn calibration<'py>(py: Python<'py>, cameras: &Cameras) -> Result<Bound<'py, PyDict>> {
    let by_name = PyDict::new(py);
    let Calibration { camera, distortion, rotation, projection } = Calibration::of_cameras(cameras);
    let matrix = |values: &[f64]| wrap(py, Plane::from_vec(3, values.len() / 3, values.to_vec())?);
    for side in 0..2 {
        let name = |letter: &str| format!("{letter}{}", side + 1);
        by_name.set_item(name("K"), matrix(camera[side].as_flattened())?)?;
        by_name.set_item(name("D"), distortion[side][..4].to_vec().into_pyarray(py))?;
        by_name.set_item(name("R"), matrix(rotation[side].as_flattened())?)?;
        by_name.set_item(name("P"), matrix(projection[side].as_flattened())?)?;
    }

    Ok(by_name)
}

/// The field of rows.
pub fn alignment_of<'py>(py: Python<'py>, offsets: &RowOffsets, is_applied: bool) -> Result<Object<'py>> {
    object!(py, "rig.alignment", "Alignment", [offsets: error, blocks, spread]
        coefficients: PyTuple::new(py, offsets.field.coefficients())?,
        sway: PyTuple::new(py, offsets.field.sway().map_or(&[][..], |all| &all[..]))?,
        errors: PyTuple::new(py, offsets.errors)?,
        size: offsets.field.size(), applied: is_applied
    )
}

/// The settings and the compensation adapted to a blur.
fn suited<'py>(
    py: Python<'py>,
    plan: CompensationPlan,
    settings: &Object<'py>,
) -> Result<(Object<'py>, Object<'py>)> {
    let kernel = |taps: Option<Plane<f32>>| taps.map(|taps| wrap(py, taps)).transpose();
    let kernels = plan.kernels.into_iter().map(|[left, right]| Ok((kernel(left)?, kernel(right)?)));
    let kernels = kernels.collect::<Result<Vec<_>>>()?;

    let suits = plan.settings;
    let settings = replaced(settings, &fields!(py, [suits: neighborhood, window]))?;
    let compensation = object!(py, "rig.compensation", "BlurCompensation", [plan: tile]
        noise: pair(plan.noise), impulses: pair(plan.impulses), smoothing: pair(plan.smoothing),
        kernels: kernels, labels: wrap(py, plan.labels)?
    )?;
    Ok((settings, compensation))
}

/// A pair of numbers: an array would become a list.
fn pair<T>([left, right]: [T; 2]) -> (T, T) {
    (left, right)
}

fn blur_estimate<'py>(
    py: Python<'py>,
    found: BlurEstimate,
    contrast: Option<&Contrast>,
    is_reused: bool,
) -> Result<Object<'py>> {
    let blurs = found.blurs.iter().map(|blur| blur_of(py, blur)).collect::<Result<Vec<_>>>()?;

    object!(py, "rig.blur", "BlurEstimate", [found: tile, certainty]
        noise: pair(found.noise), impulses: pair(found.impulses), coding: pair(found.coding),
        blurs: PyTuple::new(py, blurs)?, contrast: found.gain, reused: is_reused,
        labels: wrap(py, found.labels)?,
        gain: contrast.map_or(f64::NAN, |curve| curve.gain),
        gamma: contrast.map_or(f64::NAN, |curve| curve.gamma)
    )
}

fn blur_of<'py>(py: Python<'py>, blur: &Blur) -> Result<Object<'py>> {
    let name = |side: Option<Side>| side.map_or("none", Side::name);
    let of_family = |psf: Psf| (psf.family.traits().name, psf.size, psf.angle);
    let own = match (blur.psf, &blur.taps) {
        (Some(psf), _) => of_family(psf),
        (None, Some(taps)) => ("other", taps.radius(), 0.0),
        (None, None) => ("none", 0.0, 0.0),
    };

    let one = |side, (kind, size, angle), taps: Option<&Taps>, other: Option<Object<'py>>| {
        let kernel = |taps: &Taps| Plane::from_vec(taps.side(), taps.side(), taps.values.clone());
        let kernel = taps.map(kernel).transpose()?.map(|kernel| wrap(py, kernel));
        object!(py, "rig.blur", "Blur",
            side: side, kind: kind, size: size, angle: angle, psf: kernel.transpose()?, other: other
        )
    };
    let other =
        blur.other.map(|psf| one(name(blur.side.map(Side::other)), of_family(psf), Some(&psf.taps()), None));
    one(name(blur.side), own, blur.taps.as_ref(), other.transpose()?)
}

fn photometry_of<'py>(py: Python<'py>, found: &Photometry) -> Result<Object<'py>> {
    let [left, right] =
        found.saturation.map(|side| object!(py, "rig.photometry", "Saturation", [side: dark, bright]));
    let contrast =
        found.contrast.map(|curve| object!(py, "rig.photometry", "Contrast", [curve: gain, gamma, ratio]));

    object!(py, "rig.photometry", "Photometry",
        intensity_range: found.range, saturation: (left?, right?), contrast: contrast.transpose()?,
        low_texture: pair(found.flat), smeared: pair(found.smeared),
        repeated: pair(found.repeated), fields: pair(found.fields), mosaic: pair(found.mosaic)
    )
}

fn findings_of(py: Python<'_>, findings: Vec<Finding>) -> Result<Bound<'_, PyTuple>> {
    let findings = findings.into_iter().map(|found| {
        object!(py, "rig.findings", "Finding", [found: sentence]
            topic: found.topic.name(), severity: found.severity.name()
        )
    });
    Ok(PyTuple::new(py, findings.collect::<Result<Vec<_>>>()?)?)
}

/// An image as an array, rows x columns x channels.
pub fn pixels(py: Python<'_>, image: Image) -> Bound<'_, PyAny> {
    match image {
        Image::U8(pixels) => pixels.into_pyarray(py).into_any(),
        Image::U16(pixels) => pixels.into_pyarray(py).into_any(),
        Image::F32(pixels) => pixels.into_pyarray(py).into_any(),
        Image::F64(pixels) => pixels.into_pyarray(py).into_any(),
    }
}

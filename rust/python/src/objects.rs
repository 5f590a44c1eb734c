//! Python's objects of what the core returns: the dataclasses of the package, made here alone, by the names of their
//! fields.

use std::time::Duration;

use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple};

use super::wrap;
use crate::arguments::Disparities;
use crate::failure::Result;
use phasestereo::internals::findings::Finding;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::pipeline::matcher::Disparity;
use phasestereo::internals::pipeline::summary::Summary;
use phasestereo::internals::rig::blur::{self, BlockPlace, Blur, Glance, Side};
use phasestereo::internals::rig::estimation::Estimates;
use phasestereo::internals::rig::estimation::compensation_plan::CompensationPlan;
use phasestereo::internals::rig::estimation::range::LeftOut;
use phasestereo::internals::rig::estimation::rows::RowOffsets;
use phasestereo::internals::rig::photometry::{Contrast, Photometry};
use phasestereo::internals::rig::psf::{Family, Psf, Taps};
use phasestereo::internals::verification::Verification;

/// An object of Python.
pub type Object<'py> = Bound<'py, PyAny>;

/// A dictionary of fields, by their names.
macro_rules! fields {
    ($py:expr, { $($name:ident: $value:expr),* $(,)? }) => {{
        let fields = PyDict::new($py);
        $(fields.set_item(stringify!($name), $value)?;)*
        fields
    }};
}

/// What a call was asked for, as it comes back in results.
pub struct Asked<'py> {
    /// The settings.
    pub settings: Object<'py>,
    /// The blur compensation, or None.
    pub compensation: Object<'py>,
    /// Whether the disparities to search were given.
    pub is_searched: bool,
    /// The earlier result whose estimates hold.
    pub before: Option<Object<'py>>,
}

impl<'py> Asked<'py> {
    /// What a call with these settings, with what is known of the pair, and with this search was asked for.
    pub fn new(settings: Object<'py>, known: &Object<'py>, search: Disparities) -> Result<Self> {
        let compensation = known.getattr("blur_compensation")?;
        Ok(Self { compensation, ..Self::nothing(settings, search) })
    }

    /// The same where nothing is known.
    pub fn nothing(settings: Object<'py>, search: Disparities) -> Self {
        let compensation = settings.py().None().into_bound(settings.py());
        Self { settings, compensation, is_searched: search.is_some(), before: None }
    }
}

/// A matched pair.
pub struct Matched {
    /// The map.
    pub map: Disparity,
    /// Its summary.
    pub summary: Summary,
    /// What was estimated of the pair.
    pub estimates: Estimates,
    /// How many frames support each disparity, and the time that a temporal filter took.
    pub support: Option<(Plane<u8>, Duration)>,
    /// What there is to say.
    pub findings: Vec<Finding>,
}

/// An object of a class of a module of the package.
fn object<'py>(module: &str, class: &str, fields: &Bound<'py, PyDict>) -> Result<Object<'py>> {
    let class = fields.py().import(format!("phasestereo.{module}"))?.getattr(class)?;
    Ok(class.call((), Some(fields))?)
}

/// The result of a match.
pub fn result<'py>(py: Python<'py>, found: Matched, asked: &Asked<'py>) -> Result<Object<'py>> {
    let Matched { map, summary, estimates, support, findings } = found;

    let fields = map_fields(py, map, estimates.time)?;
    let timings = fields.as_any().get_item("timings")?;
    fields.update(estimated(py, estimates, asked)?.cast::<PyMapping>().map_err(PyErr::from)?)?;

    if let Some((frames, time)) = support {
        fields.set_item("temporal_support", wrap(py, frames)?)?;
        timings.set_item("temporal filter", time.as_secs_f64())?;
    }
    fields.set_item("findings", findings_of(py, findings)?)?;

    let shares = fields!(py, {
        estimated: summary.estimated,
        flagged: summary.flagged,
        at_low: summary.at_low,
        at_high: summary.at_high,
        confidence: summary.confidence,
        wrong: summary.wrong,
        coarse: summary.coarse,
        inferred: summary.inferred,
        detail: summary.detail,
    });
    fields.set_item("summary", object("result", "Summary", &shares)?)?;
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

/// A second opinion on a map.
pub fn verification<'py>(
    py: Python<'py>,
    judged: Verification,
    summary: Summary,
    said: Vec<Finding>,
    asked: &Asked<'py>,
) -> Result<Object<'py>> {
    let Verification { verdicts, better, findings, own, prepared, .. } = judged;
    let every = findings.into_iter().chain(said.iter().cloned()).collect();

    let estimates = prepared.estimates;
    let own = Matched { map: own, summary, estimates, support: None, findings: said };
    let fields = fields!(py, {
        verdict: wrap(py, verdicts)?,
        better: wrap(py, better)?,
        findings: findings_of(py, every)?,
        result: result(py, own, asked)?,
    });
    object("verification", "Verification", &fields)
}

/// The estimates of a pair.
pub fn estimates<'py>(
    py: Python<'py>,
    found: Estimates,
    asked: &Asked<'py>,
) -> Result<Object<'py>> {
    let photometry = found.photometry.as_ref().map(|all| photometry_of(py, all)).transpose()?;
    let findings = findings_of(py, found.findings.clone())?;

    let fields = estimated(py, found, asked)?;
    fields.set_item("photometry", photometry)?;
    fields.set_item("findings", findings)?;
    object("rig.estimates", "Estimates", &fields)
}

/// The maps of a match, and how long its stages took, after an estimation of that time.
fn map_fields(py: Python<'_>, map: Disparity, estimation: Duration) -> Result<Bound<'_, PyDict>> {
    let Disparity { disparity, flags, confidence, uncertainty, timings: times, .. } = map;

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

    Ok(fields!(py, {
        disparity: wrap(py, disparity)?,
        flags: wrap(py, flags)?,
        confidence: confidence.map(|plane| wrap(py, plane)).transpose()?,
        uncertainty: uncertainty.map(|plane| wrap(py, plane)).transpose()?,
        timings: timings,
    }))
}

/// The fields that estimates and results share.
fn estimated<'py>(
    py: Python<'py>,
    found: Estimates,
    asked: &Asked<'py>,
) -> Result<Bound<'py, PyDict>> {
    let search = search_of(py, &found, asked.is_searched)?;
    let (settings, compensation) = match found.compensation {
        Some(plan) => suited(py, plan, &asked.settings)?,
        None => (asked.settings.clone(), asked.compensation.clone()),
    };

    let is_applied = found.alignment.is_some();
    let alignment = found.offsets.map(|offsets| alignment_of(py, &offsets, is_applied));
    let contrast = found.photometry.and_then(|all| all.contrast);
    let blur = found.blur.map(|blur| blur_estimate(py, blur, contrast.as_ref()));

    let fields = fields!(py, {
        settings: settings,
        search: &search,
        alignment: alignment.transpose()?,
        blur: blur.transpose()?,
        blur_compensation: compensation,
    });

    if let Some(before) = &asked.before {
        for name in ["settings", "alignment", "blur_compensation"] {
            fields.set_item(name, before.getattr(name)?)?;
        }
        fields
            .set_item("blur", replaced(&before.getattr("blur")?, &fields!(py, {reused: true}))?)?;

        // The earlier range says how it was found, but a call may give another one.
        let earlier = before.getattr("search")?;
        if !earlier.is_none() && range_of(&earlier)? == range_of(&search)? {
            fields.set_item("search", earlier)?;
        }
    }

    Ok(fields)
}

/// Least disparity and number of disparities.
fn range_of(search: &Object<'_>) -> Result<(i64, i64)> {
    let bound = |name| search.getattr(name)?.extract();
    Ok((bound("min_disparity")?, bound("num_disparities")?))
}

/// A copy of a dataclass with some other fields.
fn replaced<'py>(object: &Object<'py>, fields: &Bound<'py, PyDict>) -> Result<Object<'py>> {
    let dataclasses = object.py().import("dataclasses")?;
    Ok(dataclasses.call_method("replace", (object,), Some(fields))?)
}

fn search_of<'py>(py: Python<'py>, found: &Estimates, is_given: bool) -> Result<Object<'py>> {
    let Estimates { candidates, confidence, range, left_out, .. } = found;
    let range = range.as_ref();
    let is = |flag: fn(&_) -> bool| range.is_some_and(flag);

    let places = left_out.iter().map(|place| left_out_of(py, place)).collect::<Result<Vec<_>>>()?;
    let fields = fields!(py, {
        min_disparity: candidates.min(),
        num_disparities: candidates.count(),
        origin: if is_given { "given" } else if range.is_some() { "found" } else { "default" },
        confidence: confidence.unwrap_or(f64::NAN),
        low: range.map_or(f64::NAN, |range| range.low),
        high: range.map_or(f64::NAN, |range| range.high),
        swapped: is(|range| range.swapped),
        mixed: is(|range| range.mixed),
        identical: is(|range| range.identical),
        inverted: found.is_inverted,
        left_out: PyTuple::new(py, places)?,
    });
    object("rig.search_range", "SearchRange", &fields)
}

fn left_out_of<'py>(py: Python<'py>, place: &LeftOut) -> Result<Object<'py>> {
    let LeftOut { rows, columns, low, high } = place;
    let fields = fields!(py, {
        rows: (rows.start, rows.end),
        columns: (columns.start, columns.end),
        low: low,
        high: high,
    });
    object("rig.search_range", "LeftOut", &fields)
}

fn alignment_of<'py>(
    py: Python<'py>,
    offsets: &RowOffsets,
    is_applied: bool,
) -> Result<Object<'py>> {
    let fields = fields!(py, {
        coefficients: PyTuple::new(py, offsets.field.coefficients())?,
        error: offsets.error,
        blocks: offsets.blocks,
        spread: offsets.spread,
        wobble: offsets.wobble,
        size: offsets.field.size(),
        applied: is_applied,
    });
    object("rig.alignment", "Alignment", &fields)
}

/// The settings and the compensation that suit a blur.
fn suited<'py>(
    py: Python<'py>,
    plan: CompensationPlan,
    settings: &Object<'py>,
) -> Result<(Object<'py>, Object<'py>)> {
    let kernel = |taps: Option<Plane<f32>>| taps.map(|taps| wrap(py, taps)).transpose();
    let kernels = plan.kernels.into_iter().map(|[left, right]| Ok((kernel(left)?, kernel(right)?)));
    let compensation = fields!(py, {
        noise: <(f64, f64)>::from(plan.noise),
        kernels: kernels.collect::<Result<Vec<_>>>()?,
        labels: wrap(py, plan.labels)?,
        tile: plan.tile,
        impulses: <(f64, f64)>::from(plan.impulses),
        smoothing: <(f64, f64)>::from(plan.smoothing),
    });

    let sides = fields!(py, {
        neighborhood: plan.settings.neighborhood,
        window: plan.settings.window,
    });
    let compensation = object("rig.compensation", "BlurCompensation", &compensation)?;
    Ok((replaced(settings, &sides)?, compensation))
}

fn blur_estimate<'py>(
    py: Python<'py>,
    found: blur::Estimate,
    contrast: Option<&Contrast>,
) -> Result<Object<'py>> {
    let blurs = found.blurs.iter().map(|blur| blur_of(py, blur)).collect::<Result<Vec<_>>>()?;
    let (rows, cols, labels) = found.labels;

    let fields = fields!(py, {
        blurs: PyTuple::new(py, blurs)?,
        labels: wrap(py, Plane::from_vec(rows, cols, labels)?)?,
        tile: found.tile,
        certainty: found.certainty,
        contrast: found.gain,
        noise: <(f64, f64)>::from(found.noise),
        gain: contrast.map_or(f64::NAN, |curve| curve.gain),
        gamma: contrast.map_or(f64::NAN, |curve| curve.gamma),
        glance: glance_of(py, found.glance)?,
        impulses: <(f64, f64)>::from(found.impulses),
        coding: <(f64, f64)>::from(found.coding),
    });
    object("rig.blur", "BlurEstimate", &fields)
}

fn blur_of<'py>(py: Python<'py>, blur: &Blur) -> Result<Object<'py>> {
    let (side, opposite) = match blur.side {
        None => ("none", "none"),
        Some(Side::Left) => ("left", "right"),
        Some(Side::Right) => ("right", "left"),
    };
    let (family, size, angle) = match (blur.psf, &blur.taps) {
        (Some(psf), _) => (family_name(psf.family), psf.size, psf.angle),
        (None, Some(taps)) => ("other", taps.radius(), 0.0),
        (None, None) => ("none", 0.0, 0.0),
    };

    let other = |psf: Psf| {
        let kind = (family_name(psf.family), psf.size, psf.angle);
        kind_of(py, opposite, kind, Some(&psf.taps()), None)
    };
    let other = blur.other.map(other).transpose()?;
    kind_of(py, side, (family, size, angle), blur.taps.as_ref(), other)
}

fn kind_of<'py>(
    py: Python<'py>,
    side: &str,
    (family, size, angle): (&str, f64, f64),
    taps: Option<&Taps>,
    other: Option<Object<'py>>,
) -> Result<Object<'py>> {
    let kernel =
        |taps: &Taps| wrap(py, Plane::from_vec(taps.side(), taps.side(), taps.values.clone())?);

    let fields = fields!(py, {
        side: side,
        kind: family,
        size: size,
        angle: angle,
        psf: taps.map(kernel).transpose()?,
        other: other,
    });
    object("rig.blur", "Blur", &fields)
}

fn family_name(family: Family) -> &'static str {
    match family {
        Family::Gaussian => "gaussian",
        Family::Disk => "disk",
        Family::Motion => "motion",
        Family::Annulus => "annulus",
    }
}

fn glance_of(py: Python<'_>, Glance { places, excess }: Glance) -> Result<Object<'_>> {
    let corners = |place: &BlockPlace| [place.top, place.left, place.right_top, place.right];
    let values = places.iter().flat_map(corners).map(|value| value as u32).collect();

    let fields = fields!(py, {
        places: wrap(py, Plane::from_vec(places.len(), 4, values)?)?,
        excess: excess.into_pyarray(py),
    });
    object("rig.blur", "Glance", &fields)
}

fn photometry_of<'py>(py: Python<'py>, found: &Photometry) -> Result<Object<'py>> {
    let saturation = found.saturation.each_ref().map(|side| {
        let fields = fields!(py, { dark: side.dark, bright: side.bright });
        object("rig.photometry", "Saturation", &fields)
    });
    let [left, right] = saturation;

    let contrast = found.contrast.map(|curve| {
        let fields = fields!(py, { gain: curve.gain, gamma: curve.gamma, ratio: curve.ratio });
        object("rig.photometry", "Contrast", &fields)
    });

    let fields = fields!(py, {
        intensity_range: found.range,
        saturation: (left?, right?),
        low_texture: <(f64, f64)>::from(found.flat),
        smeared: <(f64, f64)>::from(found.smeared),
        repeated: <(f64, f64)>::from(found.repeated),
        fields: <(i32, i32)>::from(found.fields),
        contrast: contrast.transpose()?,
    });
    object("rig.photometry", "Photometry", &fields)
}

fn findings_of(py: Python<'_>, findings: Vec<Finding>) -> Result<Bound<'_, PyTuple>> {
    let findings = findings.into_iter().map(|Finding { topic, severity, sentence, .. }| {
        let (topic, severity) = (topic.name(), severity.name());
        let fields = fields!(py, { topic: topic, severity: severity, sentence: sentence });
        object("rig.findings", "Finding", &fields)
    });
    Ok(PyTuple::new(py, findings.collect::<Result<Vec<_>>>()?)?)
}

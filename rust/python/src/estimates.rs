//! Estimates of a pair, converted to Python, and what Python hands back.

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use super::{internal, wrap};
use crate::failure::Result;
use phasestereo::Error;
use phasestereo::internals::findings::{Finding, Severity, Topic};
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::rig::alignment::{Alignment, TERMS};
use phasestereo::internals::rig::blur::{self, BlockPlace, Glance, Side};
use phasestereo::internals::rig::estimation::Estimates;
use phasestereo::internals::rig::estimation::compensation_plan::CompensationPlan;
use phasestereo::internals::rig::estimation::range::{LeftOut, SearchRange};
use phasestereo::internals::rig::estimation::rectified::Rectified;
use phasestereo::internals::rig::estimation::rows::RowOffsets;
use phasestereo::internals::rig::photometry::Photometry;
use phasestereo::internals::rig::psf::{Family, Psf, Taps};
use phasestereo::internals::rig::rectification::cameras::Camera;

/// Family, size, angle and kernel of a blur.
type KernelTuple<'py> = (&'static str, f64, f64, Option<Bound<'py, PyArray2<f64>>>);

/// Softer image (0 none, 1 left, 2 right), its blur, and that of the other image, if this one lacks something as well.
type BlurTuple<'py> = (u8, KernelTuple<'py>, Option<KernelTuple<'py>>);

/// Rows of places (top, left, top and left of the right one), and the statistics of their blocks.
pub type GlanceTuple<'py> = (Bound<'py, PyArray2<u32>>, Bound<'py, PyArray1<f32>>);

/// The kinds of blur, their map, the side of its tiles, certainty, gain; noise, impulses and coding, each left and
/// right; and a glance.
type EstimateTuple<'py> = (
    Vec<BlurTuple<'py>>,
    Bound<'py, PyArray2<u8>>,
    usize,
    f32,
    f64,
    [(f64, f64); 3],
    GlanceTuple<'py>,
);

/// The kernels of the left and of the right image.
type Kernels<'py> = (Option<Bound<'py, PyArray2<f32>>>, Option<Bound<'py, PyArray2<f32>>>);

/// Noise, impulses and smoothing, kernels, labels and tile of a blur compensation; neighborhood and window that suit
/// it.
type PlanTuple<'py> =
    ([(f64, f64); 3], Vec<Kernels<'py>>, Bound<'py, PyArray2<u8>>, usize, (usize, usize));

/// Least disparity, number of disparities, low and high end, swapped, mixed, identical.
type RangeTuple = (i64, i64, f64, f64, bool, bool, bool);

/// Rows and columns, both half-open, and the low and the high end of the disparities of a place that is left out.
type LeftOutTuple = ((usize, usize), (usize, usize), f64, f64);

/// A field of vertical offsets: its coefficients, rows and columns of its image, and the column of it that is the first
/// of the pair.
pub type Field = ([f64; TERMS], (usize, usize), usize);

/// A field, its standard error, the number of blocks that agree, their spread, and what of this rows have in common.
type OffsetsTuple = (Field, f64, usize, f64, f64);

/// A value of the left and one of the right image.
type Both = (f64, f64);

/// White less black; the shares of dark and of bright pixels of both images, of their areas without texture, and of those
/// with smeared and with repeated texture; the shift between their fields; gain, gamma and ratio of their gray levels.
type PhotometryTuple = (f64, (Both, Both), Both, Both, Both, (i32, i32), Option<(f64, f64, f64)>);

/// Topic, severity and sentence.
pub type FindingTuple = (&'static str, &'static str, String);

/// Disparities (least, number), the confidence of a rough match, whether one image is inverted, the range, what it leaves
/// out, the offsets that were estimated, the field that is applied, blur, the plan of its compensation, wall-clock
/// seconds, what the gray values say, and findings on the pair.
pub type EstimatesTuple<'py> = (
    (i64, i64),
    Option<f64>,
    bool,
    Option<RangeTuple>,
    Vec<LeftOutTuple>,
    Option<OffsetsTuple>,
    Option<Field>,
    Option<EstimateTuple<'py>>,
    Option<PlanTuple<'py>>,
    f64,
    Option<PhotometryTuple>,
    Vec<FindingTuple>,
);

/// Focal length, principal point, distortion and rotation of a camera, and the principal point of its rectified image.
type CameraTuple = (f64, [f64; 2], [f64; 2], [[f64; 3]; 3], [f64; 2]);

/// Columns and rows of the raw left and right image under rectified pixels, the disparities of the rectified pair, rows of raw
/// pixels, both cameras, the focal length of the rectified images, and the error of their rows.
pub type RectifiedTuple<'py> = (
    Vec<Bound<'py, PyArray2<f32>>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    [CameraTuple; 2],
    f64,
    f64,
);

/// What became of a pair that was rectified, for Python.
pub fn rectified_to_py(py: Python<'_>, rectified: Rectified) -> Result<RectifiedTuple<'_>> {
    let Rectified { rectification, places, map, rows, .. } = rectified;
    let cameras = &rectification.cameras;

    let camera = |side: usize| {
        let Camera { focal, center, distortion, rotation, .. } = &cameras.sides()[side];
        (*focal, *center, *distortion, *rotation, cameras.center(side))
    };
    let maps = places.iter().flat_map(|places| [0, 1].map(|axis| places.map(|at| at[axis])));
    let maps: Result<_> = maps.map(|plane| wrap(py, plane)).collect();

    let cameras = ([0, 1].map(camera), cameras.focal());
    let disparity = wrap(py, map.disparity)?;
    Ok((maps?, disparity, wrap(py, rows)?, cameras.0, cameras.1, rectification.rms))
}

/// The estimates for Python.
pub fn estimates_to_py(py: Python<'_>, estimates: Estimates) -> Result<EstimatesTuple<'_>> {
    let Estimates { candidates, confidence, is_inverted, range, left_out, .. } = estimates;
    let Estimates { offsets, alignment, blur, photometry, compensation, .. } = estimates;
    let Estimates { findings, time, .. } = estimates;

    let blur = blur.map(|blur| estimate_to_py(py, blur)).transpose()?;
    let compensation = compensation.map(|plan| compensation_to_py(py, plan)).transpose()?;

    Ok((
        (candidates.min() as i64, candidates.count() as i64),
        confidence,
        is_inverted,
        range.as_ref().map(range_to_py),
        left_out.iter().map(left_out_to_py).collect(),
        offsets.as_ref().map(offsets_to_py),
        alignment.as_ref().map(field_to_py),
        blur,
        compensation,
        time.as_secs_f64(),
        photometry.as_ref().map(photometry_to_py),
        findings_to_py(findings),
    ))
}

/// Findings for Python.
pub fn findings_to_py(findings: Vec<Finding>) -> Vec<FindingTuple> {
    let tuple = |one: Finding| (one.topic.name(), one.severity.name(), one.sentence);
    findings.into_iter().map(tuple).collect()
}

/// The findings that Python hands back.
pub fn read_findings(findings: &[(String, String, String)]) -> phasestereo::Result<Vec<Finding>> {
    let read = |(topic, severity, sentence): &(String, String, String)| {
        let refused =
            || Error::value("findings", format!("'{severity}: {topic}'"), "those of a match");
        let topic = Topic::named(topic).ok_or_else(refused)?;
        let severity = Severity::named(severity).ok_or_else(refused)?;
        Ok(Finding::new(topic, severity, sentence))
    };

    findings.iter().map(read).collect()
}

fn photometry_to_py(found: &Photometry) -> PhotometryTuple {
    let [left, right] = found.saturation.map(|side| (side.dark, side.bright));
    let [flat, smeared, repeated] = [found.flat, found.smeared, found.repeated].map(Both::from);
    let contrast = found.contrast.map(|contrast| (contrast.gain, contrast.gamma, contrast.ratio));

    (found.range, (left, right), flat, smeared, repeated, found.fields.into(), contrast)
}

fn range_to_py(range: &SearchRange) -> RangeTuple {
    let SearchRange { min, count, low, high, swapped, mixed, identical } = *range;
    (min, count, low, high, swapped, mixed, identical)
}

fn left_out_to_py(place: &LeftOut) -> LeftOutTuple {
    let LeftOut { rows, columns, low, high } = place;
    ((rows.start, rows.end), (columns.start, columns.end), *low, *high)
}

fn offsets_to_py(offsets: &RowOffsets) -> OffsetsTuple {
    (field_to_py(&offsets.field), offsets.error, offsets.blocks, offsets.spread, offsets.wobble)
}

fn field_to_py(field: &Alignment) -> Field {
    (*field.coefficients(), field.size(), 0)
}

/// The field that Python hands back.
pub fn read_field(field: Option<Field>) -> phasestereo::Result<Option<Alignment>> {
    let field = field.map(|(coefficients, size, first)| {
        Ok(Alignment::new(coefficients, size)?.starting_at_column(first))
    });

    field.transpose()
}

fn compensation_to_py(py: Python<'_>, plan: CompensationPlan) -> Result<PlanTuple<'_>> {
    let sides = (plan.settings.neighborhood, plan.settings.window);

    let kernel = |taps: Option<Plane<f32>>| taps.map(|taps| wrap(py, taps)).transpose();
    let kernels = plan.kernels.into_iter().map(|[left, right]| Ok((kernel(left)?, kernel(right)?)));
    let kernels: Result<Vec<_>> = kernels.collect();

    let both = [plan.noise, plan.impulses, plan.smoothing].map(|[left, right]| (left, right));

    Ok((both, kernels?, wrap(py, plan.labels)?, plan.tile, sides))
}

fn estimate_to_py(py: Python<'_>, estimate: blur::Estimate) -> Result<EstimateTuple<'_>> {
    let blurs: Result<_> = estimate.blurs.iter().map(|blur| blur_to_py(py, blur)).collect();

    let (rows, cols, labels) = estimate.labels;
    let labels = wrap(py, Plane::from_vec(rows, cols, labels)?)?;

    let both =
        [estimate.noise, estimate.impulses, estimate.coding].map(|[left, right]| (left, right));
    let glance = glance_to_py(py, estimate.glance)?;

    Ok((blurs?, labels, estimate.tile, estimate.certainty, estimate.gain, both, glance))
}

fn blur_to_py<'py>(py: Python<'py>, blur: &blur::Blur) -> Result<BlurTuple<'py>> {
    let kernel = |taps: &Taps| {
        let kernel = Plane::from_vec(taps.side(), taps.side(), taps.values.clone())?;
        wrap(py, kernel)
    };

    let softer = match blur.side {
        None => 0,
        Some(Side::Left) => 1,
        Some(Side::Right) => 2,
    };
    let (family, size, angle) = match (blur.psf, &blur.taps) {
        (Some(psf), _) => (family_name(psf.family), psf.size, psf.angle),
        (None, Some(taps)) => ("other", taps.radius(), 0.0),
        (None, None) => ("none", 0.0, 0.0),
    };

    let own = (family, size, angle, blur.taps.as_ref().map(kernel).transpose()?);
    let other = |psf: Psf| -> Result<_> {
        let kernel = kernel(&psf.taps())?;
        Ok((family_name(psf.family), psf.size, psf.angle, Some(kernel)))
    };

    Ok((softer, own, blur.other.map(other).transpose()?))
}

fn family_name(family: Family) -> &'static str {
    match family {
        Family::Gaussian => "gaussian",
        Family::Disk => "disk",
        Family::Motion => "motion",
        Family::Annulus => "annulus",
    }
}

/// The glance that Python hands back.
pub fn read_glance((places, excess): GlanceTuple) -> Result<Glance> {
    let places: Vec<u32> = places.to_vec().map_err(internal)?;
    let (places, _) = places.as_chunks();

    let place = |corners: &[u32; 4]| {
        let [top, left, right_top, right] = corners.map(|value| value as usize);
        BlockPlace { top, left, right_top, right }
    };

    let places = places.iter().map(place).collect();
    Ok(Glance { places, excess: excess.to_vec().map_err(internal)? })
}

fn glance_to_py(py: Python<'_>, Glance { places, excess }: Glance) -> Result<GlanceTuple<'_>> {
    let corners = |place: &BlockPlace| [place.top, place.left, place.right_top, place.right];
    let values = places.iter().flat_map(corners).map(|value| value as u32).collect();

    Ok((wrap(py, Plane::from_vec(places.len(), 4, values)?)?, excess.into_pyarray(py)))
}

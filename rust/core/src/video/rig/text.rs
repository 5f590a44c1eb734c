//! A rig as text: a line with the version and a checksum, then one of JSON. Every number is read back bit for
//! bit.
//!
//! The kernels that compensate blur are left out: blur changes while a rig is off, and is estimated from the
//! first frame. A text may come from anyone, so each number is checked against the values that frames can
//! produce.

use super::events::{Event, Steady};
use super::sensors::{BlurKind, BlurMap, Sensors};
use super::{Geometry, Rig};
use crate::rectification::{Raw, Rectification};
use crate::saved::{LARGEST, MOST_PIXELS, is_moderate};
use crate::video::choices::MOST_EVENTS;
use phasestereo_match::base::digest::Digest;
use phasestereo_match::base::error::{Error, Result};

/// The beginning of the first line.
const HEAD: &str = "phasestereo rig 2";
/// Largest count of frames and other things: none overflows while more are added.
const MOST: u64 = 1 << 48;

/// A rig as text.
pub fn written(rig: &Rig) -> Result<String> {
    let json = serde_json::to_string(rig).map_err(|error| wrong(&error.to_string()))?;
    Ok(format!("{HEAD} {}\n{json}\n", checksum(&json)))
}

/// Reads the rig from a text.
pub fn read(text: &str) -> Result<Rig> {
    let (head, json) = text.split_once('\n').unwrap_or((text, ""));
    let Some(sum) = head.strip_prefix(HEAD) else { return Err(wrong(head)) };
    let json = json.trim_end_matches('\n');
    if sum.trim_start() != checksum(json) {
        return Err(wrong("a text whose checksum is another one"));
    }

    let rig: Rig = serde_json::from_str(json).map_err(|error| wrong(&error.to_string()))?;
    match fault(&rig) {
        Some(what) => Err(wrong(&format!("{what} out of range"))),
        None => Ok(rig),
    }
}

fn checksum(json: &str) -> String {
    let mut digest = Digest::default();
    digest.add(json.bytes());
    format!("{:016x}", digest.value())
}

fn wrong(got: &str) -> Error {
    let got: String = got.chars().take(80).collect();
    Error::value("rig", format!("'{got}'"), format!("a saved rig, which begins with '{HEAD}'"))
}

/// The value of a rig that is out of its range, if any.
fn fault(rig: &Rig) -> Option<&'static str> {
    let is_event = |event: &Event| event.frame <= rig.frames;
    let is_soft = rig.soft.is_none_or(|one| is_state(one, 2));
    let checks = [
        ("frames", rig.frames <= MOST && rig.doubt.0 <= MOST && rig.doubt.1 <= MOST),
        ("health", rig.health.is_none_or(|share| (0.0..=1.0).contains(&share))),
        ("blur", is_soft),
        ("health", rig.ill.is_none_or(|one| is_state(one, 1))),
        ("events", rig.events.all().len() <= MOST_EVENTS && rig.events.all().iter().all(is_event)),
    ];
    first(&checks)
        .or_else(|| fault_of_geometry(rig.geometry.as_ref()?))
        .or_else(|| fault_of_sensors(rig.sensors.as_ref()?, rig.frames))
}

/// The first of the checks that failed.
fn first(checks: &[(&'static str, bool)]) -> Option<&'static str> {
    checks.iter().find(|(_, is_well)| !is_well).map(|(what, _)| *what)
}

/// Whether a state is a number from 0 to the largest.
fn is_state(steady: Steady, largest: i64) -> bool {
    (0..=largest).contains(&steady.state) && (0..=largest).contains(&steady.next)
}

fn fault_of_geometry(geometry: &Geometry) -> Option<&'static str> {
    let (rows, cols) = geometry.size;
    let pixels = rows.saturating_mul(cols);
    // The others depend on the size.
    if pixels == 0 || pixels > MOST_PIXELS {
        return Some("size");
    }
    let checks = [
        ("rows", is_state(geometry.straightens, 1) && is_state(geometry.sways, 1)),
        ("field", geometry.field.is_sound(geometry.size)),
        ("disparities", geometry.columns.is_sound(cols)),
        ("cameras", geometry.cameras.as_ref().is_none_or(|raw| are_cameras(raw, geometry.size))),
    ];
    first(&checks)
}

fn are_cameras(raw: &Raw, size: (usize, usize)) -> bool {
    let Rectification {
        cameras,
        matches,
        blocks,
        rows,
        rms,
        error,
        disparities,
        pairs,
        moved,
        distortion,
        ..
    } = &raw.rectification;
    let measured = [*rows, *rms, *error, *moved].into_iter().chain(*disparities);
    let measured: Vec<f64> =
        measured.chain(distortion.iter().flat_map(|(bent, error)| [*bent, *error])).collect();
    let is_size = |(there, here): (usize, usize)| there.abs_diff(here) <= here / 2;

    raw.size == size
        && is_size((cameras.size().0, size.0))
        && is_size((cameras.size().1, size.1))
        && is_moderate(cameras.numbers())
        && cameras.spreads().iter().all(|spread| (0.0..=1.0).contains(spread))
        && is_moderate(cameras.shifts.as_flattened())
        && is_moderate(&measured)
        && [matches[0], matches[1], *blocks, *pairs].iter().all(|count| *count as u64 <= MOST)
}

fn fault_of_sensors(sensors: &Sensors, frames: u64) -> Option<&'static str> {
    let is_finite = |value: &f64| value.is_finite();
    let is_noise = |value: &f64| value.is_finite() && *value >= 0.0;
    let checks = [
        ("sensors", sensors.frame <= frames && is_finite(&sensors.range) && sensors.range > 0.0),
        ("noise", sensors.noise.iter().flatten().all(is_noise)),
        ("response", sensors.response.iter().flatten().all(is_finite)),
        ("blur", sensors.blur.as_ref().is_none_or(is_blur_map)),
    ];
    first(&checks)
}

fn is_blur_map(BlurMap { kinds, tiles, side, labels, certainty }: &BlurMap) -> bool {
    let is_kind = |BlurKind { side, psf, spread }: &BlurKind| {
        let sizes = psf.map_or([0.0; 3], |psf| [psf.size, psf.angle, psf.inner]);
        *side <= 2 && (0.0..=LARGEST).contains(spread) && is_moderate(&sizes)
    };
    kinds.iter().all(is_kind)
        && tiles.0.checked_mul(tiles.1) == Some(labels.len())
        && *side as u64 <= MOST
        && labels.iter().all(|label| usize::from(*label) < kinds.len())
        && (0.0..=1.0).contains(certainty)
}

//! A rig as text, one entry a line: its name, then its values. Read back, every number is the same to the bit.
//!
//! The kernels that even out blur are left out: blur changes while a rig is off, and is estimated of the first frame.

use std::collections::BTreeMap;
use std::fmt::{Debug, Write};
use std::str::FromStr;
use std::sync::Arc;

use super::columns::Columns;
use super::events::{Events, Steady, Subject};
use super::field::FieldFilter;
use super::sensors::{BlurMap, Kind, Sensors};
use super::{Geometry, Rig};
use crate::estimation::blur::psf::{Family, Psf};
use crate::rectification::Raw;
use crate::rectification::Rectification;
use crate::rectification::cameras::{Cameras, NUMBERS};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::pair::alignment::TERMS;
use phasestereo_match::settings::MOST_DISPARITIES;

/// What the first line says.
const HEAD: &str = "phasestereo rig 1";
/// Point-spread functions, by number.
const FAMILIES: [Family; 4] = [Family::Gaussian, Family::Disk, Family::Motion, Family::Annulus];
/// Most rows or columns of an image.
const LARGEST: usize = 1 << 20;

/// A rig as text.
pub fn written(rig: &Rig) -> String {
    let mut out = Lines(format!("{HEAD}\n"));
    out.line("frames", [rig.frames]);
    out.line("health", rig.health);
    out.line("doubt", [rig.doubt.0, rig.doubt.1]);
    out.steady("soft", rig.soft);
    out.steady("ill", rig.ill);

    if let Some(geometry) = &rig.geometry {
        out.line("size", [geometry.size.0, geometry.size.1]);
        out.line("inverted", [u8::from(geometry.is_inverted)]);
        out.steady("straightens", Some(geometry.straightens));
        out.steady("sways", Some(geometry.sways));

        let (value, drift, covariance, (blocks, spread)) = geometry.field.numbers();
        out.line("field", *value);
        out.line("drift", *drift);
        out.line("covariance", covariance.concat());
        out.line("blocks", [blocks]);
        out.line("spread", [spread]);
        out.line("start", [geometry.columns.searched.start]);
        out.line("shares", geometry.columns.shares().iter().copied());
        out.line("idle", [geometry.columns.idle()]);

        if let Some(raw) = &geometry.cameras {
            let Rectification {
                cameras, matches, blocks, rows, rms, error, moved, distortion, ..
            } = &raw.rectification;
            out.line("numbers", *cameras.numbers());
            out.line("spreads", *cameras.spreads());
            out.line("shifts", cameras.shifts.concat());
            out.line("counts", [matches[0], matches[1], *blocks, raw.rectification.pairs]);
            out.line("disparities", raw.rectification.disparities);
            let [left, right] = distortion;
            out.line("errors", [*rows, *rms, *error, *moved, left.0, left.1, right.0, right.1]);
        }
    }

    if let Some(sensors) = &rig.sensors {
        out.sensors(sensors);
    }
    for event in rig.events.all() {
        let _ =
            writeln!(out.0, "event {} {} {}", event.subject.name(), event.frame, event.sentence);
    }
    out.0
}

/// The rig of a text.
pub fn read(text: &str, control: &Control) -> Result<Rig> {
    let mut lines = text.lines();
    if lines.next() != Some(HEAD) {
        return Err(wrong(text.lines().next().unwrap_or("nothing")));
    }

    let (mut values, mut events) = (BTreeMap::new(), Events::default());
    for line in lines {
        let (name, rest) = line.split_once(' ').unwrap_or((line, ""));
        if name == "event" {
            push_event(&mut events, rest).ok_or_else(|| wrong(line))?;
        } else if values.insert(name, rest).is_some() {
            return Err(wrong(line));
        }
    }

    let entries = Entries(values);
    let [wait, from] = entries.some("doubt")?;
    let health: Vec<f64> = entries.all("health")?;
    Ok(Rig {
        frames: entries.some::<u64, 1>("frames")?[0],
        geometry: entries
            .0
            .contains_key("size")
            .then(|| geometry(&entries, control))
            .transpose()?,
        look: None,
        sensors: entries.0.contains_key("sensors").then(|| sensors(&entries)).transpose()?,
        events,
        health: health.first().copied().filter(|value| (0.0..=1.0).contains(value)),
        soft: entries.steady("soft")?,
        ill: entries.steady("ill")?,
        doubt: (wait, from),
    })
}

fn geometry(entries: &Entries, control: &Control) -> Result<Geometry> {
    let [rows, cols] = entries.some("size")?;
    if rows == 0 || cols == 0 || rows > LARGEST || cols > LARGEST {
        return Err(wrong(&format!("size {rows} {cols}")));
    }
    let size = (rows, cols);

    let covariance: [f64; TERMS * TERMS] = entries.some("covariance")?;
    let (matrix, _) = covariance.as_chunks::<TERMS>();
    let mut square = [[0.0; TERMS]; TERMS];
    square.copy_from_slice(matrix);
    if covariance.iter().any(|value| !value.is_finite()) {
        return Err(wrong("covariance"));
    }

    let shares: Vec<i64> = entries.all("shares")?;
    let [start] = entries.some::<i64, 1>("start")?;
    if shares.is_empty() || shares.len() > MOST_DISPARITIES || start.unsigned_abs() > LARGEST as u64
    {
        return Err(wrong(&format!("{} shares from {start}", shares.len())));
    }
    let columns = Columns::of_numbers(start, shares, entries.some::<u32, 1>("idle")?[0]);
    columns.candidates(cols).map_err(|error| error.about("rig"))?;

    let agreement = (entries.some::<usize, 1>("blocks")?[0], entries.some::<f64, 1>("spread")?[0]);
    let (value, drift) = (entries.some("field")?, entries.some("drift")?);
    let field = FieldFilter::of_numbers(size, value, drift, square, agreement);
    let cameras = entries.0.contains_key("numbers").then(|| raw(entries, size, control));
    Ok(Geometry {
        size,
        cameras: cameras.transpose()?.map(Arc::new),
        field: field.map_err(|error| error.about("rig"))?,
        straightens: entries.steady("straightens")?.ok_or_else(|| wrong("straightens"))?,
        sways: entries.steady("sways")?.ok_or_else(|| wrong("sways"))?,
        columns,
        is_inverted: entries.some::<u8, 1>("inverted")? == [1],
    })
}

fn raw(entries: &Entries, size: (usize, usize), control: &Control) -> Result<Raw> {
    let (numbers, spreads): ([f64; NUMBERS], [f64; NUMBERS]) =
        (entries.some("numbers")?, entries.some("spreads")?);
    let shifts: [f64; 4] = entries.some("shifts")?;
    let errors: [f64; 8] = entries.some("errors")?;
    let is_finite = |values: &[f64]| values.iter().all(|value| value.abs() < 1e6);
    if !is_finite(&numbers) || !is_finite(&spreads) || !is_finite(&shifts) {
        return Err(wrong("cameras that are not finite"));
    }

    let mut cameras = Cameras::new(numbers, spreads, size);
    cameras.shifts = [[shifts[0], shifts[1]], [shifts[2], shifts[3]]];
    let [left, right, blocks, pairs] = entries.some("counts")?;
    let [rows, rms, error, moved, bent_left, error_left, bent_right, error_right] = errors;
    let rectification = Rectification {
        cameras,
        matches: [left, right],
        blocks,
        rows,
        rms,
        error,
        disparities: entries.some("disparities")?,
        pairs,
        // Pairs of a rig are inverted before they are rectified.
        is_inverted: false,
        moved,
        distortion: [(bent_left, error_left), (bent_right, error_right)],
    };
    Raw::new(rectification, size, control)
}

fn sensors(entries: &Entries) -> Result<Sensors> {
    let [frame] = entries.some("sensors")?;
    let [range] = entries.some::<f64, 1>("range")?;
    let noise: Vec<f64> = entries.all("noise")?;
    let response: Vec<f64> = entries.all("response")?;
    let is_finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
    if !(range > 0.0 && is_finite(&[range]) && is_finite(&noise) && is_finite(&response)) {
        return Err(wrong("sensors that are not finite"));
    }

    let blur = entries.0.contains_key("kinds").then(|| blur(entries)).transpose()?;
    Ok(Sensors {
        frame,
        range,
        noise: noise.try_into().ok(),
        response: response.try_into().ok(),
        blur,
    })
}

fn blur(entries: &Entries) -> Result<BlurMap> {
    let numbers: Vec<f64> = entries.all("kinds")?;
    let (rows, rest) = numbers.as_chunks::<6>();
    let kinds: Option<Vec<Kind>> = rows.iter().map(kind).collect();
    let kinds = kinds.filter(|_| rest.is_empty()).ok_or_else(|| wrong("kinds"))?;

    let [rows, cols, side] = entries.some::<usize, 3>("tiles")?;
    let labels: Vec<u8> = entries.all("labels")?;
    let is_known = labels.iter().all(|label| usize::from(*label) < kinds.len());
    if rows.checked_mul(cols) != Some(labels.len()) || !is_known {
        return Err(wrong(&format!("{} labels", labels.len())));
    }
    let [certainty] = entries.some("certainty")?;
    Ok(BlurMap { kinds, tiles: (rows, cols), side, labels, certainty })
}

/// A kind of blur by its numbers: side, family, size, angle, inner radius, spread.
fn kind(&[side, family, length, angle, inner, spread]: &[f64; 6]) -> Option<Kind> {
    let is_finite = [length, angle, inner, spread].iter().all(|value| value.is_finite());
    let side = (0..3).find(|one| (f64::from(*one) - side).abs() < 0.5).filter(|_| is_finite)?;
    let family = FAMILIES.iter().enumerate().find(|(at, _)| (*at as f64 - family).abs() < 0.5);
    let psf = family.map(|(_, family)| Psf { family: *family, size: length, angle, inner });
    Some(Kind { side, psf, spread })
}

fn push_event(events: &mut Events, rest: &str) -> Option<()> {
    let mut words = rest.splitn(3, ' ');
    let name = words.next()?;
    let subject = Subject::ALL.into_iter().find(|subject| subject.name() == name)?;
    events.push(subject, words.next()?.parse().ok()?, words.next()?);
    Some(())
}

fn wrong(got: &str) -> Error {
    let got: String = got.chars().take(80).collect();
    Error::value("rig", format!("'{got}'"), format!("a saved rig, which begins with '{HEAD}'"))
}

/// The lines of a text.
struct Lines(String);

impl Lines {
    fn line<T: Debug>(&mut self, name: &str, values: impl IntoIterator<Item = T>) {
        self.0.push_str(name);
        for value in values {
            // The shortest digits that are read back as the same number.
            let _ = write!(self.0, " {value:?}");
        }
        self.0.push('\n');
    }

    fn sensors(&mut self, Sensors { frame, range, noise, response, blur }: &Sensors) {
        self.line("sensors", [frame]);
        self.line("range", [range]);
        self.line("noise", noise.iter().flatten());
        self.line("response", response.iter().flatten());

        if let Some(BlurMap { kinds, tiles, side, labels, certainty }) = blur {
            let numbers = kinds.iter().flat_map(|Kind { side, psf, spread }| {
                let family = psf.and_then(|psf| FAMILIES.iter().position(|one| *one == psf.family));
                let family = family.map_or(-1.0, |at| at as f64);
                let [size, angle, inner] =
                    psf.map_or([0.0; 3], |psf| [psf.size, psf.angle, psf.inner]);
                [f64::from(*side), family, size, angle, inner, *spread]
            });
            self.line("kinds", numbers);
            self.line("tiles", [tiles.0, tiles.1, *side]);
            self.line("labels", labels);
            self.line("certainty", [certainty]);
        }
    }

    fn steady(&mut self, name: &str, steady: Option<Steady>) {
        let numbers = steady.map(|one| [one.state, one.next, one.frames.into()]);
        self.line(name, numbers.into_iter().flatten());
    }
}

/// The values by name.
struct Entries<'a>(BTreeMap<&'a str, &'a str>);

impl Entries<'_> {
    fn all<T: FromStr>(&self, name: &str) -> Result<Vec<T>> {
        let values = self.0.get(name).ok_or_else(|| wrong(&format!("no entry {name}")))?;
        let parsed = values.split_whitespace().map(|value| value.parse().ok());
        parsed.collect::<Option<_>>().ok_or_else(|| wrong(&format!("{name} {values}")))
    }

    fn some<T: FromStr, const COUNT: usize>(&self, name: &str) -> Result<[T; COUNT]> {
        let values: Vec<T> = self.all(name)?;
        let count = values.len();
        values.try_into().map_err(|_| wrong(&format!("{count} values of {name}")))
    }

    fn steady(&self, name: &str) -> Result<Option<Steady>> {
        match self.all::<i64>(name)?[..] {
            [] => Ok(None),
            [state, next, frames] => {
                let frames = frames.try_into().map_err(|_| wrong(name))?;
                Ok(Some(Steady { state, next, frames }))
            }
            _ => Err(wrong(name)),
        }
    }
}

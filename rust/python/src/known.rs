//! What a caller knows of a pair: `phasestereo.Known`, read for the core.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arguments::{
    Disparities, number, read_alignment, read_blur_compensation, values, wrong_type,
};
use crate::failure::Result;
use crate::settings::read_settings;
use phasestereo::Error;
use phasestereo::internals::cost::candidates::Candidates;
use phasestereo::internals::findings::{Finding, Severity, Topic};
use phasestereo::internals::rig::blur::{BlockPlace, BlurSignature};
use phasestereo::internals::rig::blur_compensation::check_noise;
use phasestereo::internals::rig::estimation::{Before, Known};
use phasestereo::internals::settings::Settings;

/// Reads `known.noise`: a number, or a pair of them for the left and for the right image.
pub fn read_noise_of_pair(noise: &Bound<'_, PyAny>) -> Result<[f64; 2]> {
    let (left, right) = noise.extract().unwrap_or_else(|_| (noise.clone(), noise.clone()));

    let read = |value: &Bound<'_, PyAny>| -> Result<f64> {
        let value = number(value, "known.noise")?;
        Ok(check_noise(value).map_err(|error| error.about("known.noise"))?)
    };
    Ok([read(&left)?, read(&right)?])
}

/// Reads what is known of a pair, but for an earlier one; None: nothing is.
pub fn read_known(
    known: &Bound<'_, PyAny>,
    size: (usize, usize),
    search: Disparities,
) -> Result<Known> {
    let candidates = search.map(|(min, count)| Candidates::new(min, count, size.1)).transpose()?;
    if known.is_none() {
        return Ok(Known { candidates, ..Known::default() });
    }

    let noise = known.getattr("noise")?;
    Ok(Known {
        candidates,
        noise: if noise.is_none() { None } else { Some(read_noise_of_pair(&noise)?) },
        compensation: read_blur_compensation(&known.getattr("blur_compensation")?)?,
        ..Known::default()
    })
}

/// Reads what holds for a pair if its blur is that of an earlier result; `None`: nothing does, as where the settings are
/// others.
pub fn read_before(
    known: &Bound<'_, PyAny>,
    size: (usize, usize),
    search: Disparities,
    asked: &Settings,
) -> Result<Option<Before>> {
    let before = known.getattr("before")?;
    if before.is_none() || before.getattr("blur")?.is_none() {
        return Ok(None);
    }
    // What was estimated then is of a pair that was rectified first.
    if !before.getattr("rectified")?.is_none() {
        return Ok(None);
    }

    let blur = before.getattr("blur")?;
    let Some(signature) = read_signature(&blur.getattr("signature")?)? else {
        return Ok(None);
    };
    let impulses: (f64, f64) = blur.getattr("impulses")?.extract()?;

    // The earlier sizes are those that suit the blur. Its field holds, so none is estimated, even if there was none.
    let earlier = read_settings(&before.getattr("settings")?)?;
    let Settings { neighborhood, window, .. } = earlier;
    let settings = Settings { neighborhood, window, align_rows: false, ..asked.clone() };
    if settings != (Settings { align_rows: false, ..earlier }) {
        return Ok(None);
    }

    let range = before.getattr("search")?;
    let search = match search {
        None if !range.is_none() => Some((
            range.getattr("min_disparity")?.extract()?,
            range.getattr("num_disparities")?.extract()?,
        )),
        given => given,
    };
    let candidates = search.map(|(min, count)| Candidates::new(min, count, size.1)).transpose();
    let alignment = read_alignment(&before.getattr("alignment")?)?;

    // What was estimated of images of another size does not hold.
    let fits = alignment.as_ref().is_none_or(|field| field.size() == size);
    let (Ok(candidates), true) = (candidates, fits) else {
        return Ok(None);
    };

    // Rows that sway do so in every frame in another way.
    let sways = alignment.as_ref().is_some_and(|field| field.sway().is_some());
    let alignment = alignment.filter(|_| !sways);
    let settings = Settings { align_rows: sways && asked.align_rows, ..settings };

    let is_inverted = !range.is_none() && range.getattr("inverted")?.is_truthy()?;
    let findings = before.getattr("findings")?.try_iter()?.map(|one| read_finding(&one?));

    let known = Known {
        candidates,
        noise: None,
        compensation: read_blur_compensation(&before.getattr("blur_compensation")?)?,
        alignment,
        is_inverted: is_inverted && settings.compensate_blur,
        findings: findings.collect::<Result<_>>()?,
    };
    Ok(Some(Before { signature, impulses: impulses.into(), known, settings }))
}

fn read_finding(finding: &Bound<'_, PyAny>) -> Result<Finding> {
    let text = |name| -> Result<String> { Ok(finding.getattr(name)?.extract()?) };
    let (topic, severity) = (text("topic")?, text("severity")?);

    let found = Topic::named(&topic).zip(Severity::named(&severity));
    let (topic, severity) = found.ok_or_else(|| {
        Error::value("known.before", format!("'{severity}: {topic}'"), "findings of a match")
    })?;
    Ok(Finding::new(topic, severity, &text("sentence")?))
}

fn read_signature(signature: &Bound<'_, PyAny>) -> Result<Option<BlurSignature>> {
    if signature.is_none() {
        return Ok(None);
    }

    let (places, excess) = (signature.getattr("places")?, signature.getattr("excess")?);
    let (Ok(places), Ok(excess)) = (places.cast::<PyArray2<u32>>(), excess.cast::<PyArray1<f32>>())
    else {
        return Err(wrong_type(
            signature,
            "known.before",
            "a signature of its estimate of the blur",
        ));
    };

    let corners = values(places)?;
    let place = |corners: &[u32; 4]| {
        let [top, left, right_top, right] = corners.map(|value| value as usize);
        BlockPlace { top, left, right_top, right }
    };
    let places = corners.as_chunks().0.iter().map(place).collect();
    Ok(Some(BlurSignature { places, excess: values(excess)? }))
}

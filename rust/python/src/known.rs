//! A caller's known facts about a pair: `phasestereo.Known`, read for the core.

use pyo3::prelude::*;

use crate::arguments::{Disparities, number, read_blur_compensation};
use crate::failure::Result;
use phasestereo::internals::estimation::facts::{Direction, Fact, Facts};
use phasestereo_match::pair::blur_compensation::check_noise;
use phasestereo_match::pair::candidates::Candidates;

/// Reads `known.noise`: a number, or a pair of them for the left and the right image.
pub fn read_noise_of_pair(noise: &Bound<'_, PyAny>) -> Result<[f64; 2]> {
    let (left, right) = noise.extract().unwrap_or_else(|_| (noise.clone(), noise.clone()));

    let read = |value: &Bound<'_, PyAny>| -> Result<f64> {
        let value = number(value, "known.noise")?;
        Ok(check_noise(value).map_err(|error| error.about("known.noise"))?)
    };
    Ok([read(&left)?, read(&right)?])
}

/// Reads the known facts about a pair, whose size is that of the turned images if it is vertical; None: there
/// are none.
pub fn read_known(
    known: &Bound<'_, PyAny>,
    size: (usize, usize),
    search: Disparities,
    vertical: Option<bool>,
) -> Result<Facts> {
    let direction = |is_vertical| if is_vertical { Direction::Columns } else { Direction::Rows };
    let axis = vertical.map(direction).map(Fact::given);
    let candidates = search.map(|(min, count)| Candidates::new(min, count, size.1)).transpose()?;
    let candidates = candidates.map(Fact::given);
    if known.is_none() {
        return Ok(Facts { axis, candidates, ..Facts::default() });
    }

    let noise = known.getattr("noise")?;
    Ok(Facts {
        axis,
        candidates,
        noise: if noise.is_none() { None } else { Some(read_noise_of_pair(&noise)?) },
        compensation: read_blur_compensation(&known.getattr("blur_compensation")?)?,
        ..Facts::default()
    })
}

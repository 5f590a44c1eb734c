//! Second maps, for Python: given, or returned by another matcher.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use crate::failure::Result;
use crate::objects::{Object, pixels};
use crate::preparation::read_map;
use crate::supervisor::supervised;
use crate::workers::Pool;
use phasestereo::internals::match_pair::Matched;
use phasestereo::internals::preparation::{Preparation, prepared_as};
use phasestereo::internals::verification::second::{Second, fused};
use phasestereo::internals::video::frames::Frame;
use phasestereo::{Error, Finding};
use phasestereo_match::image::pixels::Input;

/// A frame, not turned back, fused with a second map; the findings about that, and the time it took.
///
/// `second` is an array of float32. If both original images are given, with whether the match used the
/// negative of the right one, it is a matcher: an object with a `name`, and its largest `max_disparity` or
/// None. It is called with `(left, right, num_disparities)` and returns an array of float32, or a text with
/// the reason for a failure. During this call, no thread of the pool is in use.
pub fn with_second<'py>(
    py: Python<'py>,
    frame: Frame,
    second: &Object<'py>,
    images: Option<([Input; 2], bool)>,
    pool: &Arc<Pool>,
) -> Result<(Frame, Vec<Finding>, Option<Duration>)> {
    let started = Instant::now();
    let (matched, second) = match images {
        Some(images) => answered(py, frame.matched, second, images, pool)?,
        None => (frame.matched, Second::Map(read_map(second, "second")?)),
    };

    let rows = matched.prepared.pair.size().0;
    let (matched, said) = supervised(py, pool, rows, None, move |runtime| fused(matched, second, runtime))?;
    let summary = matched.summary();
    Ok((Frame { matched, summary, ..frame }, said, Some(started.elapsed())))
}

/// The answer of another matcher to a pair as its match prepared it.
fn answered<'py>(
    py: Python<'py>,
    matched: Matched,
    other: &Object<'py>,
    (inputs, is_inverted): ([Input; 2], bool),
    pool: &Arc<Pool>,
) -> Result<(Matched, Second)> {
    let name: String = other.getattr("name")?.extract()?;
    let most: Option<i64> = other.getattr("max_disparity")?.extract()?;

    let rows = inputs[0].size().0;
    let (matched, made) = supervised(py, pool, rows, None, move |runtime| {
        let is_turned = matched.prepared.pair.is_turned();
        let inputs = if is_turned { inputs.each_ref().map(Input::turned) } else { inputs };
        match prepared_as(&inputs, matched.treatment(), is_inverted, most, runtime) {
            // Its disparities are beyond those that the matcher can return.
            Err(error @ Error::Value { .. }) => Ok((matched, Err(error.to_string()))),
            made => Ok((matched, Ok(made?))),
        }
    })?;

    let answer = match made {
        Err(reason) => Err(reason),
        Ok(Preparation { images: [left, right], num_disparities, back, .. }) => {
            let (left, right) = (pixels(py, left.image), pixels(py, right.image));
            let answer = other.call1((left, right, num_disparities))?;
            match answer.extract::<String>() {
                Ok(reason) => Err(reason),
                Err(_) => Ok((read_map(&answer, "second")?, back)),
            }
        }
    };
    Ok((matched, Second::Answer { name, answer: Box::new(answer) }))
}

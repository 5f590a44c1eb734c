//! The estimate of a pair before it is matched.

use phasestereo::internals::error::Result;
use phasestereo::internals::pipeline::control::Control;
use phasestereo::internals::pipeline::matcher::{Execution, Matcher};
use phasestereo::internals::pipeline::pair::Pair;
use phasestereo::internals::pipeline::runtime::Runtime;
use phasestereo::internals::pipeline::source::Source;
use phasestereo::internals::rig::blur::Estimate;
use phasestereo::internals::rig::estimation::{Known, prepare, prepare_by_rows};
use phasestereo::internals::settings::Settings;
use phasestereo::internals::settings::presets::Preset;

/// Settings that only need noise and blur.
pub fn of_blur() -> Settings {
    Settings { compensate_blur: true, ..Preset::Paper.settings() }
}

/// Noise and blur of a pair whose disparities are known.
pub fn estimate(
    pair: &Pair,
    matcher: &Matcher,
    execution: Execution,
    control: &Control,
) -> Result<Estimate> {
    let known = Known { candidates: Some(pair.candidates()), ..Known::default() };
    let runtime = Runtime { matcher, execution, control };

    let found = prepare(pair.clone(), known, &of_blur(), runtime)?.estimates;
    Ok(found.blur.expect("it was asked for"))
}

/// Noise and blur of a pair that is read by rows.
pub fn estimate_by_rows(
    source: &dyn Source,
    matcher: &Matcher,
    execution: Execution,
    control: &Control,
) -> Result<Estimate> {
    let known = Known { candidates: Some(source.candidates()), ..Known::default() };
    let runtime = Runtime { matcher, execution, control };

    let found = prepare_by_rows(source, known, &of_blur(), runtime)?;
    Ok(found.blur.expect("it was asked for"))
}

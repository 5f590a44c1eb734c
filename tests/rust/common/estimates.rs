//! The estimate of a pair before it is matched.

use phasestereo::internals::estimation::blur::Estimate;
use phasestereo::internals::estimation::facts::{Fact, Facts};
use phasestereo::internals::estimation::{complete, complete_source};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::source::Source;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;

/// Settings that only need noise and blur.
pub fn of_blur() -> Settings {
    Settings { compensate_blur: true, ..Preset::Paper.settings() }
}

/// Noise and blur of a pair whose disparities are known.
pub fn estimate(pair: &Pair, matcher: &Matcher, execution: Execution, control: &Control) -> Result<Estimate> {
    let candidates = Some(Fact::given(pair.candidates()));
    let facts = &Facts { candidates, ..Facts::default() };
    let runtime = Runtime { matcher, execution, control };

    let (_, found) = complete(pair.clone(), facts, &of_blur(), runtime)?;
    Ok(found.blur.expect("it was asked for"))
}

/// Noise and blur of a pair that is read by rows.
pub fn estimate_by_rows(
    source: &dyn Source,
    matcher: &Matcher,
    execution: Execution,
    control: &Control,
) -> Result<Estimate> {
    let candidates = Some(Fact::given(source.candidates()));
    let facts = &Facts { candidates, ..Facts::default() };
    let runtime = Runtime { matcher, execution, control };

    let found = complete_source(source, facts, &of_blur(), runtime)?;
    Ok(found.blur.expect("it was asked for"))
}

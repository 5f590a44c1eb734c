//! Matching over scales: results that do not depend on the sampling of the sensor.
//!
//! The windows of codes and costs are a few pixels wide. On a plain wall in a large image, they contain only
//! noise. In a copy of half the size, they reach twice as far and noise is halved, so they contain what the
//! image shows. So each map, coarse to fine, is combined with that of such a copy, by the probability that
//! each is right:
//!
//! ```text
//! decided(pair):
//!     map = match(pair)                             calibrated confidences; ranges of panels: ranges.rs
//!     if many pixels are in doubt, and a copy is not too small:
//!         coarse = decided(pair / 2)
//!         map = choice of map and coarse            (choice.rs)
//!     return map
//!
//! map = decided(pair); if some pixels were in doubt, flat areas become planes (planes.rs)
//! ```
//!
//! Where the original map has evidence, nothing changes: the fine scale decides thin objects and edges. The
//! number of scales follows from where doubt ends; it is not chosen.
//!
//! Passing a left-right check at a smaller scale, or a higher raw confidence there, is not evidence: filled
//! pixels at the full size are often right where the copy matches by mistake. Calibrated confidences account
//! for both.

pub mod choice;
pub mod choices;
pub mod detail;
pub mod flat_areas;
pub mod planes;
pub mod ranges;
pub mod reduction;

use std::iter;

use crate::estimation::facts::{Fact, Facts, Rows};
use crate::estimation::{Estimates, Prepared, complete, prepare, shared};
use crate::scales::choice::Doubt;
use crate::scales::choices::UNSEEN;
use crate::scales::ranges::panel_ranges;
use crate::scales::reduction::halved;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::platform::Instant;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::summary::Summary;
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::Settings;

/// Share of the pixels in doubt above which planes are searched.
const SOME: f64 = 0.01;
/// Share of the pixels in doubt above which a smaller copy is matched: in sharp pairs with fewer, it decides
/// less than 1 %.
const MANY: f64 = 0.05;
/// Most pixels of the copy that a diagnosis matches: this takes about as long as the estimates.
const MOST_OF_COPY: usize = 400_000;

/// Matches a prepared pair as [`phasestereo_match::matcher::Matcher::match_pair`] does, and decides over
/// scales if the settings from which it was prepared ask for it.
pub fn match_over_scales(prepared: &Prepared, settings: &Settings, runtime: Runtime) -> Result<Disparity> {
    let Prepared { pair, settings: suited, estimates } = prepared;
    let Runtime { matcher, execution, control } = runtime;

    let mut map = if settings.scales {
        decided(pair, suited, settings, estimates.harm()[0], runtime)?
    } else {
        matcher.match_calibrated(pair, &Section::whole(pair), suited, execution, control)?
    };
    if estimates.shared.is_some()
        && let Some(rest) = shared::rest(&map)
    {
        planes::doubt(&mut map, &rest);
    }
    if estimates.is_one_image() {
        // Everything agrees at disparity 0, which no object has.
        let all = map.disparity.map(|_| true);
        planes::doubt(&mut map, &all);
        map.wrong = map.wrong.map(|wrong| wrong.max(f64::from(1.0 - UNSEEN)));
    }

    Ok(map.returned(suited))
}

/// Matches a pair with the settings adapted to it, and decides over scales with those it was prepared from.
/// `noise`: its standard deviation in the left image, in units of the pixels; 0: unknown.
fn decided(
    pair: &Pair,
    suited: &Settings,
    settings: &Settings,
    noise: f64,
    runtime: Runtime,
) -> Result<Disparity> {
    let mut map = matched(pair, suited, runtime)?;

    let started = Instant::now();
    if let Some(doubt) = Doubt::of_map(&map, runtime.level())?
        && doubt.share() > SOME
    {
        // Copies take about as long as the match, planes less.
        map.timings.is_cut_short = !runtime.control.has_time_for(map.timings.total());
        if !map.timings.is_cut_short {
            decide(&mut map, doubt, pair, settings, runtime)?;
            planes::draw(&mut map, pair, noise, runtime)?;
        }
        choice::conclude(&mut map);
    }
    map.timings.scales += started.elapsed();
    Ok(map)
}

/// Draws planes into a map fused with others, as into that of a match.
pub fn draw_planes(map: &mut Disparity, prepared: &Prepared, runtime: Runtime) -> Result<()> {
    let doubt = Doubt::of_map(map, runtime.level())?.map_or(0.0, |doubt| doubt.share());
    if prepared.settings.scales && doubt > SOME {
        planes::draw(map, &prepared.pair, prepared.estimates.harm()[0], runtime)?;
    }
    Ok(())
}

/// Matches the pair itself, each panel over its expected disparities.
fn matched(pair: &Pair, settings: &Settings, runtime: Runtime) -> Result<Disparity> {
    let started = Instant::now();
    let ranges = panel_ranges(pair, settings.optimizer, runtime)?;
    let narrowing = started.elapsed();

    let Runtime { matcher, execution, control } = runtime;
    let section = Section { ranges, ..Section::whole(pair) };
    let mut map = matcher.match_calibrated(pair, &section, settings, execution, control)?;
    map.timings.scales = narrowing;

    Ok(map)
}

/// Matches a copy of a prepared pair with at most `MOST_OF_COPY` pixels, or the pair itself if it is that
/// small. Returns the estimates of the copy, the shares of its pixels, and its size.
pub fn match_copy(
    prepared: &Prepared,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Estimates, Summary, (usize, usize))> {
    let control = runtime.control.aside();
    let runtime = Runtime { control: &control, ..runtime };
    let is_small = |(rows, cols): (usize, usize)| rows * cols <= MOST_OF_COPY;

    let halves = iter::successors(Some(prepared.pair.clone()), |pair| {
        if is_small(pair.size()) { None } else { halved(pair) }
    });
    let copy = halves.last().filter(|copy| copy.size() != prepared.pair.size());
    let copy = copy.map(|copy| prepared_copy(copy, settings, runtime)).transpose()?;
    let copy = copy.as_ref().unwrap_or(prepared);

    let map = match_over_scales(copy, settings, runtime)?;
    let summary = Summary::new(&map, copy.estimates.candidates.value);
    Ok((copy.estimates.clone(), summary, copy.pair.size()))
}

/// Prepares a smaller copy of a prepared pair. Its rows already correspond. Its noise and blur differ: they
/// are those of means.
fn prepared_copy(copy: Pair, settings: &Settings, runtime: Runtime) -> Result<Prepared> {
    let facts = Facts {
        candidates: Some(Fact::scaled(copy.candidates())),
        rows: Rows::known(Fact::scaled(None)),
        ..Facts::default()
    };
    let (copy, estimates) = complete(copy, &facts, settings, runtime)?;
    prepare(copy, estimates, &facts, settings, runtime)
}

/// Decides between a map and that of the pair at half the size, if many pixels are in doubt.
fn decide(
    map: &mut Disparity,
    doubt: Doubt,
    pair: &Pair,
    settings: &Settings,
    runtime: Runtime,
) -> Result<()> {
    let copy = if doubt.share() > MANY { halved(pair) } else { None };
    let Some(copy) = copy else { return Ok(()) };

    // Its progress is separate from the map's.
    let control = runtime.control.aside();
    let runtime = Runtime { control: &control, ..runtime };
    let Prepared { pair: copy, settings: suited, .. } = prepared_copy(copy, settings, runtime)?;
    let mut coarse = matched(&copy, &suited, runtime)?;
    if let Some(doubt) = Doubt::of_map(&coarse, runtime.level())? {
        decide(&mut coarse, doubt, &copy, settings, runtime)?;
    }

    choice::choose(map, &doubt, &coarse, pair.candidates(), runtime.level())
}

//! A pair that any matcher can use, from the estimates; and the conversion of the maps of other matchers to
//! the original left image.
//!
//! ```text
//! ready = the pair to match: rectified, rows aligned, impulses repaired, negative undone   # match_pair.rs
//! out = each channel of both images, through all of that
//! out = smoothed, if there is much noise; blurred by area as in the match                # channels.rs
//! out = the right one with the gray levels of the left one, if they differ
//! out = moved so that no disparity is negative, reduced if disparities would be too large  # back.rs
//! ```
//!
//! Only properties that a match estimates are estimated. An image that needs no change stays bit for bit the
//! same.
//!
//! A match compares each left pixel with the version of the right image that suits the left pixel's blur.
//! Other matchers take one right image: each of its pixels has the blur of the left pixel that the rough
//! match sees there.

pub mod back;
mod channels;
mod words;

use crate::estimation::estimates::Estimates;
use crate::estimation::facts::{Facts, Origin};
use crate::estimation::shared::SharedPart;
use crate::estimation::takes_negative;
use crate::match_pair::{Ready, Treatment, made_ready};
use crate::preparation::back::Back;
use crate::preparation::channels::{Channels, Tone};
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::image::pixels::Input;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::{Pair, is_same_type};
use phasestereo_match::settings::Settings;

/// Least smoothing that is applied, as a share of black to white: that for noise of some 10 gray levels. With
/// less, bad-1.0 of networks rises: `HITNet` on 12 sharp pairs 9.6 %, smoothed 10.6.
const SMOOTHED_FROM: f64 = 20.0 / 255.0;
/// Gains and gammas that differ from 1 by more are undone; smaller ones are within the error of the estimate,
/// 9 and 7 %.
const GAIN: f64 = 0.10;
const GAMMA: f64 = 0.15;
/// Share of the confident disparities below which negative ones are mistakes, and the disparity that is
/// clearly negative, pixels. Moving a pair without need costs `HITNet` 1 point.
const FEW: f64 = 0.03;
const CLEARLY: f32 = -1.0;
/// The largest factor by which images are reduced.
const MOST_REDUCED: usize = 64;

/// A pair for other matchers.
#[derive(Debug)]
pub struct Preparation {
    /// Both images; an unchanged one is the original.
    pub images: [Input; 2],
    /// Whether each image was changed.
    pub changed: [bool; 2],
    /// The changes, in sentences.
    pub done: Vec<String>,
    /// Number of disparities of the prepared pair, starting at 0.
    pub num_disparities: usize,
    /// The conversion of maps of the prepared pair to the original image.
    pub back: Back,
}

/// Prepares two original images for other matchers, whose largest disparity may be known; also returns the
/// pair that is ready to be matched.
pub fn prepared_for_others(
    inputs: [Input; 2],
    facts: &Facts,
    max_disparity: Option<i64>,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Preparation, Ready)> {
    if let Some(most) = max_disparity.filter(|most| *most < 1) {
        return Err(Error::value("max_disparity", most, "an integer from 1, or nothing"));
    }

    // The pair needs some range until its own is estimated.
    let known = facts.candidates.as_ref().map(|known| known.value);
    let (min, count) = known.map_or((0, 1), Candidates::numbers);
    let pair = Pair::of_any(inputs.clone(), min, count)?;
    // Other matchers search rows.
    let facts = &facts.along_rows();
    let ready = made_ready(pair, facts, settings, runtime)?;
    let is_inverted = takes_negative(facts, settings, &ready.prepared.estimates);
    let made = prepared_as(&inputs, ready.treatment(), is_inverted, max_disparity, runtime)?;
    Ok((made, ready))
}

/// Prepares two images for other matchers by the changes made for a match: images as given, or turned, if the
/// match turned them.
pub fn prepared_as(
    inputs: &[Input; 2],
    ready: Treatment,
    is_inverted: bool,
    max_disparity: Option<i64>,
    runtime: Runtime,
) -> Result<Preparation> {
    let back = Back::new(ready, placement(&ready.prepared.estimates, max_disparity)?);
    let mut channels = Channels::new(ready, is_inverted, runtime)?;
    let tone = tone(&ready.prepared.estimates);
    channels.tone = tone.as_ref();
    let part = |(shared, _)| SharedPart::new(&Pair::of_any(inputs.clone(), 0, 1)?, shared, runtime);
    let part = ready.prepared.estimates.shared.map(part).transpose()?;
    channels.shared = part.as_ref();

    let is_converted = !is_same_type(&inputs[0], &inputs[1]);
    let work = words::WorkDone::new(ready, &channels, &back, is_converted);
    let changed = [0, 1].map(|side| work.changes(side));
    let made = |side: usize| -> Result<Input> {
        if changed[side] { channels.image(inputs, side, &back, runtime) } else { Ok(inputs[side].clone()) }
    };
    let images = [made(0)?, made(1)?];

    let candidates = ready.prepared.estimates.candidates.value;
    let last = candidates.max() as i64;
    Ok(Preparation {
        images,
        changed,
        done: work.sentences(),
        num_disparities: back.prepared(last).max(0) as usize + 1,
        back,
    })
}

/// The increase of disparities, and the factor by which images are reduced.
fn placement(estimates: &Estimates, max_disparity: Option<i64>) -> Result<(i64, usize)> {
    let searched = estimates.candidates.value;
    let (low, count) = searched.numbers();

    let is_given = !matches!(estimates.candidates.origin, Origin::Estimated);
    let shift = if low < 0 && (is_given || has_negative(estimates)) { -low } else { 0 };
    let Some(most) = max_disparity.filter(|most| low + shift + count - 1 > *most) else {
        return Ok((shift, 1));
    };

    let mut factor = 1;
    while (count - 1 + factor - 1) / factor > most && factor < MOST_REDUCED as i64 {
        factor *= 2;
    }
    if (count - 1 + factor - 1) / factor > most {
        let accepts = format!("at least one in {MOST_REDUCED} of the {count} disparities");
        return Err(Error::value("max_disparity", most, accepts));
    }
    Ok((-low, factor as usize))
}

/// Whether the share of confident disparities that are clearly negative is too large for mistakes.
fn has_negative(estimates: &Estimates) -> bool {
    let sure = estimates.seen.iter().flat_map(|seen| seen.sure.as_slice());
    let (mut below, mut all) = (0usize, 0usize);
    for disparity in sure.filter(|disparity| disparity.is_finite()) {
        below += usize::from(*disparity < CLEARLY);
        all += 1;
    }
    below as f64 > FEW * all as f64
}

/// The conversion of the right image's gray levels to those of the left one, if they differ.
fn tone(estimates: &Estimates) -> Option<Tone> {
    let found = estimates.photometry?;
    let curve = found.contrast?;
    let differs = (curve.gain - 1.0).abs() > GAIN || (curve.gamma - 1.0).abs() > GAMMA;
    differs.then(|| Tone::new(&found, curve))
}

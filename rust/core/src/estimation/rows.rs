//! How the rows of a pair correspond: a smooth field of vertical offsets, fitted to blocks that were found in
//! both images, plus a spline of the row if rows sway, like those of a shaking rolling shutter.
//!
//! Blocks mislead where the images do not show the same things, above all at jumps in depth, so the fit is
//! robust ([`robust`]). Blocks are followed from the reduced copies, which withstand blur and noise, to the
//! full images, which are exact; the fit with the smallest standard error is kept. The field is linear unless
//! keystone and distortion explain much more.
//!
//! If the residuals of the smooth field give evidence of a spline, it is fitted along with the field, and
//! kept if there is then much evidence. The blocks that determine a smooth field are too few for a spline,
//! and those that were followed from copies do not reach the borders: so both are fitted once more to four
//! times as many blocks.

pub mod robust;

use self::robust::{Equation, Model, RobustFit};
use super::overview::{GOOD_CONFIDENCE, Overview, RoughMap};
use super::tracks::{BLOCK, Seed, Track, follow};
use crate::estimation::blur::parts::PairRows;
use crate::estimation::facts::SUFFICIENT;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::statistics::median;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::alignment::sway::INTERVALS;
use phasestereo_match::pair::alignment::{Alignment, CUBIC, LINEAR, TERMS};
use phasestereo_match::pair::candidates::Candidates;

/// Number of blocks that are followed.
const BLOCKS: usize = 400;
/// Fewest blocks to fit a field to.
const LEAST_BLOCKS: usize = 24;
/// Fewest blocks to fit a field with all terms to.
const ENOUGH_BLOCKS: usize = 60;
/// Fields with a larger standard error, pixels, are not used.
const LARGEST_ERROR: f64 = 0.5;
/// Times that the rough match is repeated with the last field; rows that were far off come closer each time.
const ROUNDS: usize = 3;
/// Vertical offsets, in rows of the copy, that a rough match withstands.
const TOLERATED: f64 = 0.4;
/// ... and those that hardly change it: confidences of 36 pairs with rows up to 1 px off change by 0.002 on
/// average, and by 0.006 at most.
const HARDLY: f64 = 0.25;
/// All terms are used if their field differs from the linear one by this many standard errors,
const RICHER: f64 = 2.0;
/// ... each of which is at least this many pixels.
const LEAST_RICHER: f64 = 0.02;
/// Error that averaging over blocks does not remove, as a share of a pixel of the copy.
const BIAS: f64 = 0.02;
/// Least evidence in the residuals of a smooth field for which a spline of the row is fitted, too: in 60
/// pairs of 12 scenes without swaying rows, sharp, with noise, compressed, turned and with keystone, up to
/// 1.0; 55 of them have less.
pub const SUSPICION: f64 = 0.5;
/// Offsets below this, pixels root mean square, are ignored: on 12 aligned scenes up to 0.05 are found.
const LEAST_RMS: f64 = 0.12;
/// ... and so are offsets of fewer standard errors than this.
const LEAST_ERRORS: f64 = 2.0;

/// Lens distortion is reported at this many pixels or more, and this many standard errors: in 10 pairs
/// without any, up to 2.6.
pub const DISTORTED: (f64, f64) = (2.0, 3.0);

/// The vertical offsets of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct RowOffsets {
    /// The vertical offset at every place.
    pub field: Alignment,
    /// Its standard error, root mean square over the image, pixels.
    pub error: f64,
    /// Number of blocks that agree with it.
    pub blocks: usize,
    /// Robust standard deviation of the blocks from it, pixels.
    pub spread: f64,
    /// Standard error in the middle of every interval of the spline of the row, root mean square over the
    /// columns.
    pub errors: [f64; INTERVALS],
}

impl RowOffsets {
    /// The largest offset at a border due to the terms that only lens distortion has, pixels, if it is large
    /// and clearly larger than its own error.
    pub fn distortion(&self) -> Option<f64> {
        let terms = &self.field.coefficients()[CUBIC..];
        let most = terms.iter().fold(0.0f64, |most, value| most.max(value.abs()));
        (most >= DISTORTED.0.max(DISTORTED.1 * self.error)).then_some(most)
    }

    /// Whether the offsets are too large to be an error of the estimate.
    pub fn is_significant(&self) -> bool {
        let rms = self.field.rms();
        rms > LEAST_RMS && rms > LEAST_ERRORS * self.error
    }
}

/// The results about the rows of a pair.
pub struct FoundRows {
    /// The offsets; `None` if there is too little texture or too little in common.
    pub offsets: Option<RowOffsets>,
    /// The row differences that the best field leaves, reliable or not: its standard error and the spread of
    /// the blocks around it, pixels. Infinite without one.
    pub apart: f64,
    /// The last rough match on the way, if there was another one.
    pub map: Option<RoughMap>,
}

/// Estimates the field of a pair from a rough match of the unaligned pair.
pub fn offsets(
    rows: &PairRows,
    overview: &Overview,
    rough: &RoughMap,
    candidates: Option<Candidates>,
    runtime: Runtime,
) -> Result<FoundRows> {
    let mut map = None;
    let found = first(rows, overview, rough, &mut map, candidates, runtime)?;
    let Some((mut fit, mut tracks)) = found else {
        return Ok(FoundRows { offsets: None, apart: f64::INFINITY, map });
    };
    let mut fits = vec![fit.clone()];
    let mut spaced = Spaced { factor: overview.factor, distance: spacing(overview), most: tracks.len() };

    // Coarse to fine: each field places the blocks in copies four times as large.
    while spaced.factor > 1 {
        let Some(found) = spaced.finer(rows, overview, &mut tracks, &fit.field, runtime)? else {
            break;
        };
        fit = found;
        fits.push(fit.clone());
    }

    let mut best = best(fits);
    if let Some(fit) = best.as_ref().filter(|fit| fit.field.sway().is_some()) {
        let denser = denser(rows, overview, &fit.field, candidates, runtime)?;
        map = Some(denser.0);
        best = denser.1;
    }

    let apart = best.as_ref().map_or(f64::INFINITY, |fit| math::hypot(fit.error, fit.spread));
    let offsets = best.filter(|fit| fit.error < LARGEST_ERROR && typical(fit) < LARGEST_ERROR);
    Ok(FoundRows { offsets, apart, map })
}

/// The fit with the least standard error.
fn best(fits: Vec<RowOffsets>) -> Option<RowOffsets> {
    fits.into_iter().min_by(|a, b| typical(a).total_cmp(&typical(b)))
}

/// The standard error at the typical row: a spline is unknown at the borders before blocks reach them.
fn typical(fit: &RowOffsets) -> f64 {
    match fit.field.sway() {
        Some(_) => median(fit.errors).unwrap_or(fit.error),
        None => fit.error,
    }
}

/// Fits the field and the spline of the row once more, to four times as many blocks, up to the borders: a
/// spline has many factors. With a known field, blocks are found in the full images at once.
fn denser(
    rows: &PairRows,
    overview: &Overview,
    field: &Alignment,
    candidates: Option<Candidates>,
    runtime: Runtime,
) -> Result<(RoughMap, Option<RowOffsets>)> {
    let map = overview.rough(candidates, Some(field), runtime)?;
    let distance = (spacing(overview) / overview.factor / 2).max(1) * overview.factor;
    let mut seeds = seeds(overview, &map, Some(field), distance);

    let mut fits: Vec<RowOffsets> = vec![];
    let mut spaced = Spaced { factor: overview.factor, distance, most: 0 };
    loop {
        let tracks = follow(rows, overview, &seeds, spaced.factor, runtime)?;
        spaced.most = spaced.most.max(tracks.len());
        let Some(fit) = fitted(&tracks, rows.size(), spaced) else { break };
        for seed in &mut seeds {
            seed.dy = fit.field.at(seed.x + seed.dx, seed.y);
        }
        fits.push(fit);
        if spaced.factor == 1 {
            break;
        }
        spaced.factor = (spaced.factor / 4).max(1);
    }

    Ok((map, best(fits)))
}

/// Blocks in copies that are reduced by a factor.
#[derive(Clone, Copy)]
struct Spaced {
    /// The factor.
    factor: usize,
    /// Their distance, pixels of the whole image.
    distance: usize,
    /// The largest number of them found in any copies. If only few are found again, as in a blurred image,
    /// these may be chance: the error grows in proportion.
    most: usize,
}

impl Spaced {
    /// The field from the same blocks in copies four times as large.
    fn finer(
        &mut self,
        rows: &PairRows,
        overview: &Overview,
        tracks: &mut Vec<Track>,
        field: &Alignment,
        runtime: Runtime,
    ) -> Result<Option<RowOffsets>> {
        self.factor = (self.factor / 4).max(1);
        let seed = |track: &Track| {
            let Seed { x, y, dx, .. } = track.place;
            Seed { x, y, dx, dy: field.at(x + dx, y) }
        };
        let seeds: Vec<Seed> = tracks.iter().map(seed).collect();

        *tracks = follow(rows, overview, &seeds, self.factor, runtime)?;
        self.most = self.most.max(tracks.len());
        Ok(fitted(tracks, rows.size(), *self))
    }
}

/// Whether a rough match hardly changes if its rows are straightened by a field.
pub fn is_straight(overview: &Overview, map: &RoughMap, field: &Alignment) -> bool {
    difference(field, map.field.as_ref()) < HARDLY * overview.factor as f64
}

/// The field in the reduced copies, and the blocks that it was fitted to. Further rough matches are stored in
/// `map`.
fn first(
    rows: &PairRows,
    overview: &Overview,
    rough: &RoughMap,
    map: &mut Option<RoughMap>,
    candidates: Option<Candidates>,
    runtime: Runtime,
) -> Result<Option<(RowOffsets, Vec<Track>)>> {
    let (mut field, mut best) = (None, None);
    // A poor match may mean that the rows are far off.
    if rough.confidence < GOOD_CONFIDENCE {
        field = overview.shift(candidates, rows.size(), runtime)?;
    }

    // A better field gives a better map, which gives more and better blocks.
    for round in 1.. {
        if field.is_some() {
            *map = Some(overview.rough(candidates, field.as_ref(), runtime)?);
        }

        let distance = spacing(overview);
        let seeds = seeds(overview, map.as_ref().unwrap_or(rough), field.as_ref(), distance);
        let tracks = follow(rows, overview, &seeds, overview.factor, runtime)?;
        let spaced = Spaced { factor: overview.factor, distance, most: tracks.len() };
        let Some(found) = fitted(&tracks, rows.size(), spaced) else { break };
        let tolerated = TOLERATED * overview.factor as f64;
        let is_near = difference(&found.field, field.as_ref()) < tolerated;
        field = Some(found.field.clone());
        best = Some((found, tracks));

        if is_near || round == ROUNDS {
            break;
        }
    }

    Ok(best)
}

/// Distance of neighboring blocks, pixels of the full image, so that about [`BLOCKS`] cover it.
fn spacing(overview: &Overview) -> usize {
    let size = overview.planes[0].as_slice().len();

    (((size / BLOCKS) as f64).sqrt() as usize).max(1) * overview.factor
}

/// Blocks all over the image, this many of its pixels apart, wherever the disparity is known.
fn seeds(overview: &Overview, map: &RoughMap, field: Option<&Alignment>, distance: usize) -> Vec<Seed> {
    let factor = overview.factor;
    let step = distance / factor;
    // The center of a pixel of the copy, in pixels of the whole image.
    let center = |at: usize| factor as f64 * (at as f64 + 0.5) - 0.5;

    let mut seeds = vec![];
    for row in (step / 2..map.disparity.rows()).step_by(step) {
        for col in (step / 2..map.disparity.cols()).step_by(step) {
            let disparity = f64::from(map.disparity.row(row)[col]);
            if disparity.is_finite() {
                let (x, y) = (center(col), center(row));
                let dx = -disparity * factor as f64;
                let dy = field.map_or(0.0, |field| field.at(x + dx, y));
                seeds.push(Seed { x, y, dx, dy });
            }
        }
    }

    seeds
}

/// Root mean square of the difference of two fields, pixels.
fn difference(field: &Alignment, other: Option<&Alignment>) -> f64 {
    other.map_or_else(|| field.rms(), |other| field.less(other).rms())
}

/// The field through blocks that were found.
fn fitted(
    tracks: &[Track],
    (rows, cols): (usize, usize),
    Spaced { factor, distance, most }: Spaced,
) -> Option<RowOffsets> {
    if tracks.len() < LEAST_BLOCKS {
        return None;
    }

    let points: Vec<Equation> =
        tracks.iter().map(|track| Equation::of_track(track, (rows, cols), factor)).collect();

    // Errors of overlapping blocks are not independent, so there are fewer independent points than blocks.
    let overlap = ((BLOCK * factor) as f64 / distance as f64).max(1.0);
    let excess = overlap * most as f64 / points.len() as f64;
    let fit = fit(&points, excess)?;

    // A field that less than half of the blocks agree with may be one of several.
    if fit.agreeing < LEAST_BLOCKS.max(points.len() / 2) {
        return None;
    }

    let floor = BIAS * factor as f64;
    Some(RowOffsets {
        field: Alignment::new(fit.coefficients, (rows, cols)).ok()?.with_sway(fit.sway).ok()?,
        error: math::hypot(fit.error, floor),
        errors: fit.errors.map(|error| math::hypot(error, floor)),
        blocks: fit.agreeing,
        spread: fit.spread,
    })
}

/// The field with the fewest sufficient terms, and with a spline of the row if there is evidence of one.
fn fit(points: &[Equation], excess: f64) -> Option<RobustFit> {
    let (model, smooth) = smooth(points, excess, false)?;
    if points.len() < ENOUGH_BLOCKS || model.evidence(points, &smooth) < SUSPICION {
        return Some(smooth);
    }

    // Offsets that a spline explains do not need terms of higher degree.
    let Some((model, swaying)) = self::smooth(points, excess, true) else { return Some(smooth) };
    let is_sure = model.evidence(points, &swaying) >= SUFFICIENT;
    Some(if is_sure { swaying } else { smooth })
}

/// The field with linear terms, or all of them if that explains much more; with a spline of the row or
/// without.
fn smooth(points: &[Equation], excess: f64, sways: bool) -> Option<(Model, RobustFit)> {
    let [linear, all] = [LINEAR, TERMS].map(|smooth| Model { smooth, sways, excess });
    let is_enough = points.len() >= ENOUGH_BLOCKS;
    let fit_all = || is_enough.then(|| all.fitted(points)).flatten();
    let (least, most) = rayon::join(|| linear.fitted(points), fit_all);
    let least = least?;

    if let Some(most) = most
        && most.difference(&least) > RICHER * most.error.max(LEAST_RICHER)
    {
        return Some((all, most));
    }
    Some((linear, least))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_count_beyond_an_eighth_of_a_pixel_and_two_standard_errors() {
        let is_significant = |offset: f64, error: f64| {
            let coefficients = [offset, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            let field = Alignment::new(coefficients, (100, 100)).expect("a legal field");
            let errors = [error; INTERVALS];
            RowOffsets { field, error, errors, blocks: 100, spread: 0.1 }.is_significant()
        };

        assert!(is_significant(0.125, 0.01) && !is_significant(0.115, 0.01));
        assert!(is_significant(1.0, 0.49) && !is_significant(1.0, 0.51));
    }
}

//! Which image is blurrier than the other, where and by what, from the images alone.
//!
//! 1. The pair is matched at a quarter of its size (`rough`), where little is left of the blur: that tells
//!    which blocks of the two images show the same things.
//! 2. Of each such pair of blocks the power spectra are taken (`spectrum`), in bins (`bins`). What they
//!    differ by is gain, noise, and the response of the relative blur, whatever the blocks show.
//! 3. Each of a bank of blurs (`bank`) is fitted to every pair of blocks (`fit`); the fewest that explain
//!    the tiles of the image are kept (`regions`).
//! 4. Of each kind that was found, size and direction are refined (`refine`) on the powers of all its
//!    blocks together; where no family explains these well, the kernel is measured (`measured`).
//! 5. If there are several kinds, the map of them is drawn again, finer.
//!
//! All sums are in a fixed order, and nothing depends on threads or instructions.

mod bank;
pub(crate) mod bins;
pub(crate) mod defects;
mod fit;
mod glance;
mod measured;
pub(crate) mod parts;
mod refine;
pub mod regions;
pub(crate) mod rough;
mod search;
mod spectrum;
mod transform;

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

pub use self::bank::Side;
use self::bank::bank;
use self::bins::{SIDE, bins};
use self::defects::Defects;
use self::fit::{BlurEvidence, Fit, Response};
pub use self::glance::Glance;
use self::measured::{look, measured};
use self::parts::{Means, Part, ROUGHEST, Rows, blocks};
use self::refine::refine;
use self::regions::{Losses, MOST};
use self::rough::{Known, Rough, Scale, shades_per_unit};
use self::search::{Blocks, Choice, flat, searched};
pub use self::spectrum::Place;
use self::spectrum::{Cross, Powers, powers, response};
use crate::error::Result;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::{Execution, Matcher, Pair};
use crate::rig::psf::{Psf, Taps};
use crate::simd::Level;

/// The match by which a kernel is measured: means of bad-1.0 over 12 scenes with an arc of 15 px and 270 degrees after
/// one such kernel, by factor and neighborhood: 4, 9: 22.7 %; 2, 9: 18.1 %; 2, 15: 18.5 %; true kernel: 17.6.
const ROUGH: Scale = Scale { factor: 2, neighborhood: 9 };
/// Blocks that are enough to see whether there is blur.
const ENOUGH_BLOCKS: usize = 110;
/// Blocks that are enough of the largest images, too.
const MOST_BLOCKS: usize = 400;
/// Pixels between blocks at first, at least, and at most unless there were too many of them.
const SPACING: (usize, usize) = (32, 64);
/// Side of the tiles of a map, pixels, unless there were too many of them.
const TILE: usize = 16;
/// Most tiles of a map.
const MOST_TILES: usize = 6000;
/// Blurs of less spread than this, pixels, are none: real pairs differ by as much.
const LEAST_SPREAD: f64 = 0.6;
/// Families that explain powers worse than this, nepers, may be wrong: then the kernel is measured.
const DOUBTFUL: f32 = 0.3;
/// ... given this many blocks to measure it on
const LEAST_BLOCKS: usize = 12;
/// ... that are a good part of all: it takes another match, which is not worth it for a little of a large image
const LEAST_PART: usize = 20;
/// ... and unless what is measured explains them worse than the family by this factor.
const MUCH_WORSE: f32 = 1.5;
/// Of so many blocks one is tried with all blurs, whatever the others are explained by ...
const SAMPLE: usize = 4;
/// ... unless there would be fewer than this.
const LEAST_SAMPLE: usize = 12;
/// The least tenth of the blocks tells the noise.
const QUIET: usize = 10;
/// What the noise is more than in the quietest tenth of the blocks, in the quietest of eight directions:
/// measured for noise of a known level on the suite's scenes.
const QUIET_BIAS: f32 = 1.28;

/// A kind of relative blur.
#[derive(Debug, Clone, PartialEq)]
pub struct Blur {
    /// The softer image; `None`: both are alike.
    pub side: Option<Side>,
    /// The function, if a family explains it.
    pub psf: Option<Psf>,
    /// The kernel which the sharper image lacks; `None`: there is none.
    pub taps: Option<Taps>,
}

/// What the images tell about their blur.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Its kinds, that of the largest area first; never empty.
    pub blurs: Vec<Blur>,
    /// The kind of every tile: rows, columns, values row after row.
    pub labels: (usize, usize, Vec<u8>),
    /// Side of a tile, pixels.
    pub tile: usize,
    /// From 0 to 1: by how much the first kind explains its blocks better than its contrary does.
    pub certainty: f32,
    /// Contrast of the left image relative to the right one's.
    pub gain: f64,
    /// Standard deviations of the noise, left and right, in units of the pixels.
    pub noise: [f64; 2],
    /// By how much impulses of the left and of the right image stand out at least, in units of the pixels; 0: there are
    /// none.
    pub impulses: [f64; 2],
    /// Standard deviations of a noise that would do as much harm as what compression has lost, left and right, in units of
    /// the pixels.
    pub coding: [f64; 2],
    /// What a later pair of the same cameras is compared with.
    pub glance: Glance,
}

/// A grid of tiles, and the blocks about their centers.
struct Grid {
    /// Side of a tile, pixels.
    step: usize,
    rows: usize,
    cols: usize,
    places: Vec<Option<Place>>,
    powers: Vec<Powers>,
}

/// All that the steps have in common.
struct Scene<'a> {
    rows: Rows<'a>,
    /// Rough disparities of rows that are in memory.
    rough: Option<Rough>,
    known: Known,
    size: (usize, usize),
    /// How many of the gray values of either image make one unit of its pixels.
    units: [f64; 2],
    means: Means<'a>,
}

/// A kind of blur with what its blocks have to say.
struct Kind {
    blur: Blur,
    response: Response,
    fit: Fit,
    powers: Powers,
}

/// Has all tables made that there are but once, among them the responses of the bank.
pub fn prepare() {
    flat();
    bank();
}

/// Estimates the relative blur of a pair, on the threads at hand. `sample` is any part of it.
pub(crate) fn estimate(rows: Rows, sample: &Pair, known: Known, means: Means) -> Result<Estimate> {
    let size = rows.size();
    if !is_enough(size) {
        return Ok(Estimate::nothing(size));
    }
    Scene::new(rows, sample, known, means)?.estimate()
}

/// Whether the blur of a pair, with impulses repaired as they were known then, is what it was in an earlier one that was
/// estimated. Sizes that change by less than a fifth or so, and what comes on in less than a sixteenth of the image, are missed.
pub fn is_as_before(
    pair: &Pair,
    before: &Glance,
    matcher: &Matcher,
    how: Execution,
    control: &Control,
) -> Result<bool> {
    if !before.fits(pair.size()) {
        return Ok(false);
    }
    matcher.install(|| {
        let part = Part::new(0, Cow::Borrowed(pair), Means { matcher, how, control })?;
        let images = part.shades.each_ref().map(|shades| &shades.plane);
        let powers = powers(images, &before.places, how.level, control)?;
        Ok(before.is_like(&Glance::new(before.places.clone(), &powers, pair.size())))
    })
}

/// Whether there is room for a block.
pub(crate) fn is_enough((rows, cols): (usize, usize)) -> bool {
    rows >= SIDE && cols >= SIDE
}

impl<'a> Scene<'a> {
    /// `sample` is any part of the pair.
    fn new(rows: Rows<'a>, sample: &Pair, known: Known, means: Means<'a>) -> Result<Self> {
        let [left, right] = sample.views();
        let unit = |view| shades_per_unit(view, means.how.level, means.control);
        let units = [unit(left)?, unit(right)?];
        let rough = match rows {
            Rows::Kept(part) => Some(part.rough(&known, ROUGHEST, means)?),
            Rows::Read(_) => None,
        };
        Ok(Self { rows, rough, known, size: rows.size(), units, means })
    }

    /// Has blocks looked at whose top rows are these, from the first one down.
    fn look(
        &self,
        tops: &[usize],
        scale: Scale,
        mut at: impl FnMut(&Part, &Rough, Range<usize>) -> Result<()>,
    ) -> Result<()> {
        self.rows.look(blocks(tops, &self.known), self.means, |part, looked| match &self.rough {
            Some(rough) if scale == ROUGHEST => at(part, rough, looked),
            _ => at(part, &part.rough(&self.known, scale, self.means)?, looked),
        })
    }

    fn estimate(&self) -> Result<Estimate> {
        let grid = self.grid(self.spacing(), |_| true)?;
        let noise = grid.noise();
        let blocks = grid.blocks(noise, self.level());
        let chosen = grid.searched(&blocks, self.level()).chosen();
        let choices: Vec<Choice> = chosen.iter().map(|choice| Choice::at(*choice)).collect();
        let only = grid.losses(&blocks, &choices, self.level());
        let mut kinds = Vec::new();
        for (index, Choice { side, .. }) in choices.into_iter().enumerate() {
            let members = only.best_members(index);
            // What was chosen later may have taken all the tiles of what was chosen first.
            if side.is_none() || !members.is_empty() {
                kinds.push(self.kind(&grid, &members, noise, side)?);
            }
        }
        merge(&mut kinds);
        if kinds.is_empty() {
            let nothing = Estimate::nothing(self.size);
            return Ok(Estimate { noise: self.in_units(noise), ..nothing });
        }
        let map = if kinds.len() > 1 {
            self.map(&kinds, noise, &grid, &blocks)?
        } else {
            Map::uniform(self.size)
        };
        let places = grid.places.into_iter().flatten().collect();
        let glance = Glance::new(places, &grid.powers, self.size);
        Ok(Estimate { glance, ..self.told(kinds, map, noise) })
    }

    fn level(&self) -> Level {
        self.means.how.level
    }

    /// The spacing of the first blocks.
    fn spacing(&self) -> usize {
        let (rows, cols) = self.size;
        let even = |blocks: usize| {
            let spacing = ((rows * cols / blocks) as f64).sqrt();
            (spacing / 16.0).round() as usize * 16
        };
        even(ENOUGH_BLOCKS).clamp(SPACING.0, SPACING.1.max(even(MOST_BLOCKS)))
    }

    /// Tiles of so many pixels, and the blocks of those that are wanted, by row and column.
    fn grid(&self, step: usize, is_wanted: impl Fn((usize, usize)) -> bool) -> Result<Grid> {
        let (height, width) = self.size;
        let corner = |tile: usize, length: usize| {
            (tile * step + step / 2).saturating_sub(SIDE / 2).min(length - SIDE)
        };
        let (rows, cols) = (height.div_ceil(step), width.div_ceil(step));
        let tops: Vec<usize> = (0..rows).map(|y| corner(y, height)).collect();
        let (mut places, mut found) = (vec![], vec![]);
        self.look(&tops, ROUGHEST, |part, rough, rows| {
            let tiles = rows.flat_map(|y| (0..cols).map(move |x| (y, x)));
            let place = |(y, x): (usize, usize)| {
                is_wanted((y, x)).then(|| part.place(rough, tops[y], corner(x, width)))?
            };
            let new: Vec<_> = tiles.map(place).collect();
            let images = part.shades.each_ref().map(|shades| &shades.plane);
            let there = part.local(new.iter().flatten());
            found.extend(powers(images, &there, self.level(), self.means.control)?);
            places.extend(new);
            Ok(())
        })?;
        Ok(Grid { step, rows, cols, places, powers: found })
    }

    /// What the blocks of these tiles say together.
    fn kind(
        &self,
        grid: &Grid,
        tiles: &[usize],
        noise: [f32; 2],
        side: Option<Side>,
    ) -> Result<Kind> {
        let powers = grid.together(tiles);
        let none = Kind::none(&powers, noise, self.level());
        let Some(side) = side else { return Ok(none) };
        let [left, right] = BlurEvidence::of_both(&powers, noise, self.level());
        let evidence = if side == Side::Left { left } else { right };
        let found = refine(&evidence, self.level());
        if found.entry.psf.spread() < LEAST_SPREAD && found.fit.loss <= DOUBTFUL {
            return Ok(none);
        }
        let blur = Blur {
            side: Some(side),
            psf: Some(found.entry.psf),
            taps: Some(found.entry.psf.taps()),
        };
        let family = Kind { blur, response: found.entry.response, fit: found.fit, powers };
        let least = LEAST_BLOCKS.max(grid.powers.len() / LEAST_PART);
        if family.fit.loss <= DOUBTFUL || tiles.len() < least {
            return Ok(family);
        }
        self.measured(grid, tiles, &evidence, family)
    }

    /// The kernel as it is measured, if it explains the powers much better than the family does.
    fn measured(
        &self,
        grid: &Grid,
        tiles: &[usize],
        evidence: &BlurEvidence,
        family: Kind,
    ) -> Result<Kind> {
        let Some(side) = family.blur.side else { return Ok(family) };
        // Rows are looked at from the top down, whatever order the tiles were chosen in.
        let mut tiles = tiles.to_vec();
        tiles.sort_unstable();
        let places: Vec<Place> = tiles.iter().filter_map(|tile| grid.places[*tile]).collect();
        let mut rows: Vec<usize> = places.iter().map(|place| place.top).collect();
        rows.dedup();
        let mut sums = Cross::default();
        self.look(&rows, ROUGH, |part, rough, looked| {
            let here = &rows[looked];
            let there = places.iter().filter(|place| here.contains(&place.top));
            look(
                &part.shades,
                rough,
                &part.local(there),
                &mut sums,
                self.level(),
                self.means.control,
            )
        })?;
        let Some(taps) = measured(&sums, side, self.level()) else { return Ok(family) };
        let response = response(&taps, self.level());
        let fit = evidence.fit(&response, self.level());
        if fit.loss > MUCH_WORSE * family.fit.loss {
            return Ok(family);
        }
        let blur = Blur { side: Some(side), psf: None, taps: Some(taps) };
        Ok(Kind { blur, response, fit, powers: family.powers })
    }

    /// The map of the kinds: finer than the first blocks where these are not all of one kind.
    fn map(&self, kinds: &[Kind], noise: [f32; 2], first: &Grid, blocks: &[Blocks]) -> Result<Map> {
        let ((rows, cols), choices) = (self.size, choices(kinds));
        let even = ((rows * cols / MOST_TILES) as f64).sqrt() as usize;
        let tile = even.next_multiple_of(TILE).max(TILE);
        let rough = first.losses(blocks, &choices, self.level());
        let at = |length: usize| (length * tile + tile / 2) / first.step;
        let around = |(y, x)| at(y).min(first.rows - 1) * first.cols + at(x).min(first.cols - 1);
        let grid = self.grid(tile, |place| rough.is_boundary(around(place)))?;
        let mut losses = grid.losses(&grid.blocks(noise, self.level()), &choices, self.level());
        for (index, tile) in losses.values.chunks_mut(choices.len()).enumerate() {
            let there = around((index / grid.cols, index % grid.cols));
            if !rough.is_boundary(there) {
                tile.copy_from_slice(rough.of(there));
            }
        }
        let labels = losses.steadied().labels();
        Ok(Map { rows: grid.rows, cols: grid.cols, labels, tile })
    }

    fn in_units(&self, noise: [f32; 2]) -> [f64; 2] {
        [0, 1].map(|side| f64::from(noise[side]).sqrt() / self.units[side])
    }

    fn told(&self, kinds: Vec<Kind>, map: Map, noise: [f32; 2]) -> Estimate {
        let (map, order) = map.by_area(kinds.len());
        let first = &kinds[order[0]];
        let units = self.units[1] / self.units[0];
        let gain = match first.blur.side {
            Some(Side::Right) => 1.0 / f64::from(first.fit.gain()).sqrt(),
            _ => f64::from(first.fit.gain()).sqrt(),
        };
        Estimate {
            certainty: first.certainty(noise, self.level()),
            gain: gain * units,
            noise: self.in_units(noise),
            blurs: order.iter().map(|kind| kinds[*kind].blur.clone()).collect(),
            labels: (map.rows, map.cols, map.labels),
            tile: map.tile,
            impulses: [0.0; 2],
            coding: [0.0; 2],
            glance: Glance::default(),
        }
    }
}

impl Grid {
    /// The power of the noise of either image.
    fn noise(&self) -> [f32; 2] {
        [0, 1].map(|side| {
            let mut highs: Vec<f32> =
                self.powers.iter().map(|powers| powers.least_high[side]).collect();
            let quiet = highs.len() / QUIET;
            if highs.is_empty() {
                return 0.0;
            }
            *highs.select_nth_unstable_by(quiet, f32::total_cmp).1 * QUIET_BIAS
        })
    }

    /// What the pairs of blocks have to say.
    fn blocks(&self, noise: [f32; 2], level: Level) -> Vec<Blocks> {
        self.powers.par_iter().map(|powers| Blocks::new(powers, noise, level)).collect()
    }

    /// How badly every choice explains every tile.
    fn losses(&self, blocks: &[Blocks], choices: &[Choice], level: Level) -> Losses {
        let of = |blocks: &Blocks| -> Vec<f32> {
            choices.iter().map(|choice| blocks.loss(*choice, level)).collect()
        };
        self.on_tiles(choices.len(), blocks.par_iter().map(of).collect())
    }

    /// How badly each of all blurs explains every tile, where it is worth trying.
    fn searched(&self, blocks: &[Blocks], level: Level) -> Losses {
        let told = self.places.iter().enumerate().filter(|(_, place)| place.is_some());
        // In every row, and not below those of the row above.
        let is_sample = told.map(|(tile, _)| {
            let (y, x) = (tile / self.cols, tile % self.cols);
            blocks.len() <= LEAST_SAMPLE * SAMPLE || (x + 2 * y).is_multiple_of(SAMPLE)
        });
        let is_sample: Vec<bool> = is_sample.collect();
        self.on_tiles(1 + 2 * bank().len(), searched(blocks, &is_sample, level))
    }

    /// Losses of blocks as those of the tiles; some have none.
    fn on_tiles(&self, choices: usize, losses: Vec<Vec<f32>>) -> Losses {
        let (mut losses, untold) = (losses.into_iter(), vec![f32::INFINITY; choices]);
        let of_tile = |place: &Option<Place>| {
            place.and_then(|_| losses.next()).unwrap_or_else(|| untold.clone())
        };
        let values = self.places.iter().flat_map(of_tile).collect();
        Losses { rows: self.rows, cols: self.cols, choices, values }
    }

    /// The sums of the powers of these tiles, all of which have blocks.
    fn together(&self, tiles: &[usize]) -> Powers {
        let mut index = 0;
        let mut indices = vec![0; self.places.len()];
        for (tile, place) in self.places.iter().enumerate() {
            indices[tile] = index;
            index += usize::from(place.is_some());
        }
        let mut sums = Powers {
            binned: [vec![0.0; bins().count()], vec![0.0; bins().count()]],
            least_high: [0.0; 2],
        };
        let share = 1.0 / tiles.len().max(1) as f32;
        for tile in tiles.iter().filter(|tile| self.places[**tile].is_some()) {
            let powers = &self.powers[indices[*tile]];
            for (sums, values) in sums.binned.iter_mut().zip(&powers.binned) {
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
            }
        }
        sums
    }
}

impl Kind {
    fn none(powers: &Powers, noise: [f32; 2], level: Level) -> Self {
        let blur = Blur { side: None, psf: None, taps: None };
        let fit = Blocks::new(powers, noise, level).none();
        Self { blur, response: flat().clone(), fit, powers: powers.clone() }
    }

    /// By how much its blocks are explained better than by its contrary: no blur, or any blur.
    fn certainty(&self, noise: [f32; 2], level: Level) -> f32 {
        let blocks = Blocks::new(&self.powers, noise, level);
        let contrary = match self.blur.side {
            Some(_) => blocks.none().loss,
            None => blocks.losses(level)[1..].iter().copied().fold(f32::INFINITY, f32::min),
        };
        (1.0 - self.fit.loss / contrary.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    }
}

fn choices(kinds: &[Kind]) -> Vec<Choice<'_>> {
    kinds.iter().map(|kind| Choice { side: kind.blur.side, response: &kind.response }).collect()
}

/// Keeps one of the kinds that came out as no blur.
fn merge(kinds: &mut Vec<Kind>) {
    let mut seen = false;
    kinds.retain(|kind| {
        let keep = kind.blur.side.is_some() || !seen;
        seen |= kind.blur.side.is_none();
        keep
    });
}

/// Which kind of blur each tile has.
struct Map {
    rows: usize,
    cols: usize,
    labels: Vec<u8>,
    tile: usize,
}

impl Map {
    fn uniform((rows, cols): (usize, usize)) -> Self {
        Self { rows: 1, cols: 1, labels: vec![0], tile: rows.max(cols) }
    }

    /// The map with kinds numbered by area, without those of none, and which kinds these are.
    fn by_area(mut self, kinds: usize) -> (Self, Vec<usize>) {
        let mut areas = vec![0; kinds];
        self.labels.iter().for_each(|label| areas[usize::from(*label)] += 1);
        let mut order: Vec<usize> = (0..kinds).filter(|kind| areas[*kind] > 0).collect();
        order.sort_by_key(|kind| std::cmp::Reverse(areas[*kind]));
        let mut number = [0; MOST];
        order.iter().enumerate().for_each(|(index, kind)| number[*kind] = index as u8);
        self.labels.iter_mut().for_each(|label| *label = number[usize::from(*label)]);
        (self, order)
    }
}

impl Estimate {
    /// The same with what else is wrong.
    pub(crate) fn with(self, Defects { impulses, coding }: Defects) -> Self {
        Self { impulses, coding, ..self }
    }

    /// That of images which tell nothing.
    fn nothing((rows, cols): (usize, usize)) -> Self {
        Self {
            blurs: vec![Blur { side: None, psf: None, taps: None }],
            labels: (1, 1, vec![0]),
            tile: rows.max(cols),
            certainty: 0.0,
            gain: 1.0,
            noise: [0.0; 2],
            impulses: [0.0; 2],
            coding: [0.0; 2],
            glance: Glance::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_numbered_by_area_and_those_of_none_left_out() {
        let map = Map { rows: 1, cols: 6, labels: vec![3, 0, 0, 0, 3, 2], tile: 16 };
        let (map, order) = map.by_area(4);
        assert_eq!((map.labels, order), (vec![1, 0, 0, 0, 1, 2], vec![0, 3, 2]));
    }
}

//! The relative blur of a pair, from the images alone: which image is softer, where, and by how much.
//!
//! 1. The pair is matched at a quarter of its size (`rough`), where little is left of the blur: this finds
//!    blocks of the two images that show the same things.
//! 2. The power spectra of each such pair of blocks are computed (`spectrum`) and averaged in bins (`bins`).
//!    Their quotient consists of gain, noise, and the response of the relative blur, whatever the blocks
//!    show.
//! 3. Each of a bank of blurs (`bank`) is fitted to all blocks together, then to every pair of blocks
//!    (`fit`); the fewest that explain the tiles of the image are kept (`regions`). If none explains all
//!    blocks together, the whole bank is fitted only to pairs that one of a few blurs explains better than
//!    none, and to no pair unless that helps a sample. If no blur of one image explains all blocks together,
//!    one of each image may (`two_sided`).
//! 4. Size and direction of each kind are refined (`refine`) on the powers of all its blocks together; if no
//!    family explains these well, the kernel is measured (`measured`).
//! 5. If there are several kinds, their map is drawn again on finer tiles.
//!
//! If disks whose radii follow the disparities explain the blocks (`depth`), these replace 4 and 5.
//!
//! All sums have a fixed order, so the result does not depend on threads or instructions.

mod bank;
pub(crate) mod bins;
pub(crate) mod defects;
mod depth;
mod fit;
mod measured;
pub mod parts;
pub mod psf;
mod refine;
pub mod regions;
mod response;
pub(crate) mod rough;
mod search;
mod signature;
mod spectrum;
pub mod taps;
mod tiles;
mod transform;
mod two_sided;

use std::borrow::Cow;
use std::iter;
use std::ops::Range;

use rayon::prelude::*;

pub use self::bank::Side;
use self::bank::{Entry, bank};
use self::bins::{SIDE, bins};
use self::defects::Defects;
use self::depth::{BlurByDepth, DEPTHS, Defocus};
use self::fit::{BlurEvidence, BlurFit};
use self::measured::{add_cross_spectra, measured};
use self::parts::{PairRows, Part, ROUGHEST, blocks};
use self::psf::Psf;
use self::refine::refine;
use self::regions::{Losses, first};
use self::response::{Response, response};
use self::rough::{Correspondence, RoughMatch, RoughScale, grays_per_unit};
use self::search::{BlockPair, Choice, flat, searched};
pub use self::signature::BlurSignature;
pub use self::spectrum::BlockPlace;
use self::spectrum::{Cross, Powers, powers};
use self::taps::Taps;
use self::tiles::Tiling;
use self::two_sided::{TwoSided, find_two_sided};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::{Plane, around};
use phasestereo_match::base::simd::Level;
use phasestereo_match::base::statistics::ranked;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;

/// The rough match for measuring a kernel: at half the size it shows the kernel nearly as well as the true
/// disparities would, at a quarter it does not.
const ROUGH: RoughScale = RoughScale { factor: 2, ..RoughScale::ROUGH };
/// Number of blocks sufficient to detect blur. About this many are used, or fewer; more only in images where
/// they would be further apart than [`SPACING`].
const ENOUGH_BLOCKS: usize = 110;
/// Number of blocks sufficient even for the largest images.
const MOST_BLOCKS: usize = 400;
/// Smallest and largest initial distance of blocks, pixels; the largest grows if there would be too many
/// blocks.
const SPACING: (usize, usize) = (32, 64);
/// Side of the tiles of a map, pixels; larger if there would be too many tiles.
const TILE: usize = 16;
/// Most tiles of a map.
const MOST_TILES: usize = 6000;
/// Blurs with less spread than this, pixels, are ignored: real pairs differ by this much.
const LEAST_SPREAD: f64 = 0.6;
/// Families that leave a larger loss than this, nepers, may be wrong: then the kernel is measured.
const DOUBTFUL: f32 = 0.3;
/// Blurs of both images are accepted if their loss is at most this share of that of the best blur of one
/// image, if the latter is doubtful. True blurs of both, motions and disks, have less; arcs of one image,
/// which no family explains, have more.
const CLEARLY_BETTER: f32 = 0.7;
/// A kernel is measured, and blurs of both images are searched, on at least this many blocks;
const LEAST_BLOCKS: usize = 12;
/// ... a kernel on at least one in this many of all blocks: it takes another match, which is not worthwhile
/// for a small part of a large image,
const LEAST_PART: usize = 20;
/// ... and is discarded if its loss exceeds the family's by this factor.
const MUCH_WORSE: f32 = 1.5;
/// One block in this many is fitted to all blurs, whatever explains the others,
const SAMPLE: usize = 4;
/// ... unless there would be fewer than this.
const LEAST_SAMPLE: usize = 12;
/// The quietest one in this many blocks determines the noise.
const QUIET: usize = 10;
/// The ratio of the noise to that of the quietest tenth of the blocks, in the quietest of eight directions:
/// measured for noise of a known level on the suite's scenes.
const QUIET_BIAS: f32 = 1.28;

/// Share of texture with a period of 4 pixels that a slight blur leaves.
const SLIGHT: f64 = 0.3;

/// A kind of relative blur.
#[derive(Debug, Clone, PartialEq)]
pub struct Blur {
    /// The softer image; `None`: both are equally sharp.
    pub side: Option<Side>,
    /// The point-spread function, if a family explains the blur.
    pub psf: Option<Psf>,
    /// The kernel to convolve the sharper image with; `None`: no blur.
    pub taps: Option<Taps>,
    /// The blur of the sharper image, if it also has one that the softer image does not: the softer one has
    /// to be convolved with it.
    pub other: Option<Psf>,
}

impl Blur {
    /// No blur.
    pub(crate) const NONE: Self = Self { side: None, psf: None, taps: None, other: None };

    /// A blur of one image by a function.
    pub(crate) fn of(side: Side, psf: Psf) -> Self {
        Self { side: Some(side), psf: Some(psf), taps: Some(psf.taps()), other: None }
    }

    /// Whether both images are equally sharp, or the blur is so slight that applying it to the sharper image,
    /// too, would cost more detail than the difference does: codes are phases, which a symmetric blur does
    /// not change.
    pub fn is_slight(&self) -> bool {
        let leaves_most = |taps: &Taps| taps.least_response() >= SLIGHT;
        self.other.is_none() && self.taps.as_ref().is_none_or(leaves_most)
    }

    /// The softer image as a number: 0 neither, 1 left, 2 right.
    pub(crate) fn softer(&self) -> u8 {
        self.side.map_or(0, |side| side as u8 + 1)
    }

    /// The standard deviation of its kernel along an axis, pixels.
    pub fn spread(&self) -> f64 {
        match (self.psf, &self.taps) {
            (Some(psf), _) => psf.spread(),
            (None, Some(taps)) => taps.radius() / 2f64.sqrt(),
            (None, None) => 0.0,
        }
    }
}

/// The relative blur and the noise of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The kinds of blur, that of the largest area first; never empty.
    pub blurs: Vec<Blur>,
    /// The kind of every tile.
    pub labels: Plane<u8>,
    /// Side of a tile, pixels.
    pub tile: usize,
    /// Certainty from 0 to 1: the share of the loss of the opposite assumption that the first kind avoids;
    /// for blur that follows depth, its share of the explanation that a separate blur for each tile would
    /// give.
    pub certainty: f32,
    /// Contrast of the left image relative to the right one's.
    pub gain: f64,
    /// Standard deviations of the noise, left and right, in units of the pixels.
    pub noise: [f64; 2],
    /// The least height of impulses of the left and of the right image, in units of the pixels; 0: there are
    /// none.
    pub impulses: [f64; 2],
    /// Standard deviations of a noise that would do the same harm as the loss from compression, left and
    /// right, in units of the pixels.
    pub coding: [f64; 2],
    /// Statistics with which a later pair of the same cameras is compared.
    pub signature: BlurSignature,
}

/// A grid of tiles, and the blocks around their centers.
struct Grid {
    tiling: Tiling,
    places: Vec<Option<BlockPlace>>,
    powers: Vec<Powers>,
}

/// The blocks of a grid together.
struct AllBlocks {
    /// Their mean powers.
    powers: Powers,
    /// The evidence of these powers.
    blocks: BlockPair,
    /// The loss of every choice.
    losses: Vec<f32>,
}

/// The pair, and the data that all steps of its estimation share.
struct BlurEstimation<'a> {
    rows: &'a PairRows<'a>,
    /// Rough disparities of the whole pair; `None`: they are found part by part.
    rough: Option<RoughMatch>,
    known: Correspondence,
    size: (usize, usize),
    /// Gray values per unit of the pixels of either image.
    units: [f64; 2],
    runtime: Runtime<'a>,
}

/// A kind of blur, fitted to the mean powers of its blocks.
struct FittedBlur {
    blur: Blur,
    response: Response,
    fit: BlurFit,
    powers: Powers,
}

/// Computes all tables that are made only once, among them the responses of the bank.
pub fn prepare() {
    flat();
    bank();
}

/// Estimates the relative blur of a pair on the current threads. `sample` is any part of the pair; `whole`
/// are rough disparities of all of it, if available.
pub(crate) fn estimate(
    rows: &PairRows,
    sample: &Pair,
    known: Correspondence,
    whole: Option<RoughMatch>,
    runtime: Runtime,
) -> Result<Estimate> {
    let size = rows.size();
    if !is_enough(size) {
        return Ok(Estimate::unknown(size));
    }

    BlurEstimation::new(rows, sample, known, whole, runtime)?.estimate()
}

/// Whether the blur of a pair, with impulses repaired as in an earlier one, is still that of the earlier one.
/// Size changes below about a fifth, and blur that appears in less than a sixteenth of the image, are missed.
pub fn is_as_before(pair: &Pair, before: &BlurSignature, runtime: Runtime) -> Result<bool> {
    let size = pair.size();
    if !before.fits(size) {
        return Ok(false);
    }

    let part = Part::new(0, Cow::Borrowed(pair), runtime)?;
    let images = part.grays.each_ref();
    let powers = powers(images, &before.places, runtime)?;
    Ok(before.is_like(&BlurSignature::new(before.places.clone(), &powers, size)))
}

/// Whether an image of this size holds a block.
pub(crate) fn is_enough((rows, cols): (usize, usize)) -> bool {
    rows >= SIDE && cols >= SIDE
}

impl<'a> BlurEstimation<'a> {
    /// `sample` is any part of the pair.
    fn new(
        rows: &'a PairRows<'a>,
        sample: &Pair,
        known: Correspondence,
        whole: Option<RoughMatch>,
        runtime: Runtime<'a>,
    ) -> Result<Self> {
        let [left, right] = sample.views();
        let units = [left, right].map(grays_per_unit);

        // Existing disparities save a match.
        let rough = match (whole.filter(|whole| whole.factor() == ROUGHEST.factor), rows.whole()) {
            (Some(whole), _) => Some(whole),
            (None, Some(part)) => Some(part.rough(&known, ROUGHEST, runtime)?),
            (None, None) => None,
        };

        Ok(Self { rows, rough, known, size: rows.size(), units, runtime })
    }

    /// Visits the blocks with these top rows, from the first one down, with their rough disparities and the
    /// row of the image where these begin.
    fn visit(
        &self,
        tops: &[usize],
        scale: RoughScale,
        mut visit: impl FnMut(&Part, (&RoughMatch, usize), Range<usize>) -> Result<()>,
    ) -> Result<()> {
        self.rows.visit(blocks(tops, &self.known), self.runtime, |part, visited| match &self.rough {
            Some(rough) if scale == ROUGHEST => visit(part, (rough, 0), visited),
            _ => {
                let rough = part.rough(&self.known, scale, self.runtime)?;
                visit(part, (&rough, part.first), visited)
            }
        })
    }

    /// The estimate, step by step as in the module documentation.
    fn estimate(&self) -> Result<Estimate> {
        // Steps 1 and 2.
        let grid = self.grid(self.spacing(), |_| true)?;
        let noise = grid.noise();
        let all = AllBlocks::new(&grid, noise, self.level());
        if let Some(kind) = all.as_ref().and_then(|all| self.two_sided(all)) {
            return Ok(self.finished(vec![kind], RegionMap::uniform(self.size), grid, noise));
        }

        let blocks = grid.blocks(noise, self.level());

        // Step 3: which blurs explain the tiles, and which tiles each of them explains best.
        let is_sharp = all.is_some_and(|all| first(iter::once(&*all.losses)) == Some(0));
        let chosen = grid.searched(&blocks, is_sharp, self.level()).chosen();
        let choices: Vec<Choice> = chosen.iter().map(|choice| Choice::at(*choice)).collect();
        let losses = grid.losses(&blocks, &choices, self.level());

        if choices.iter().any(|choice| choice.side.is_some())
            && let Some((kinds, map, certainty)) = self.by_depth(&grid, &blocks, &losses, noise)?
        {
            // Blocks at jumps mix radii, which looks like gain, and the other way round if the other image is
            // softer.
            let gain = map.mean_gain(&kinds) * self.units[1] / self.units[0];
            return Ok(Estimate { certainty, gain, ..self.finished(kinds, map, grid, noise) });
        }

        // Step 4.
        let mut kinds = Vec::new();
        for (index, Choice { side, .. }) in choices.into_iter().enumerate() {
            let members = losses.best_members(index);
            // Choices that were added later may explain all tiles of an earlier one better.
            if side.is_none() || !members.is_empty() {
                kinds.push(self.fitted_blur(&grid, &members, noise, side)?);
            }
        }
        merge(&mut kinds);

        if kinds.is_empty() {
            let unknown = Estimate::unknown(self.size);
            return Ok(Estimate { noise: self.in_units(noise), ..unknown });
        }

        // Step 5.
        let map = if kinds.len() > 1 {
            self.map(&kinds, noise, &grid, &blocks)?
        } else {
            RegionMap::uniform(self.size)
        };

        Ok(self.finished(kinds, map, grid, noise))
    }

    fn finished(&self, kinds: Vec<FittedBlur>, map: RegionMap, grid: Grid, noise: [f32; 2]) -> Estimate {
        let places = grid.places.into_iter().flatten().collect();
        let signature = BlurSignature::new(places, &grid.powers, self.size);
        Estimate { signature, ..self.summary(kinds, map, noise) }
    }

    fn level(&self) -> Level {
        self.runtime.level()
    }

    /// The distance of the first blocks, which gives enough of them, but not too many.
    fn spacing(&self) -> usize {
        let (rows, cols) = self.size;
        let even = |blocks: usize| {
            let spacing = ((rows * cols / blocks) as f64).sqrt();
            // With the nearest multiple of 16 pixels there were up to 180 blocks, with the next one as few as
            // 70.
            (spacing / 8.0).ceil() as usize * 8
        };

        even(ENOUGH_BLOCKS).clamp(SPACING.0, SPACING.1.max(even(MOST_BLOCKS)))
    }

    /// Tiles of `step` pixels, and the blocks around the centers of those that are wanted, by row and column.
    fn grid(&self, step: usize, is_wanted: impl Fn((usize, usize)) -> bool) -> Result<Grid> {
        let tiling = Tiling::new(self.size, step);
        let mut places = vec![];
        let mut all_powers = vec![];
        self.visit(&tiling.tops(), ROUGHEST, |part, rough, rows| {
            let tiles = rows.flat_map(|y| (0..tiling.cols).map(move |x| (y, x)));
            let place =
                |tile: (usize, usize)| is_wanted(tile).then(|| part.place(rough, tiling.corner(tile)))?;
            let new: Vec<_> = tiles.map(place).collect();

            let images = part.grays.each_ref();
            let local = part.local(new.iter().flatten());
            all_powers.extend(powers(images, &local, self.runtime)?);
            places.extend(new);
            Ok(())
        })?;

        Ok(Grid { tiling, places, powers: all_powers })
    }

    /// The blurs of both images, if they explain all blocks together clearly better than any blur of one
    /// image.
    fn two_sided(&self, all: &AllBlocks) -> Option<FittedBlur> {
        let one_sided = all.losses.iter().copied().fold(f32::INFINITY, f32::min);
        if one_sided <= DOUBTFUL {
            return None;
        }

        let found = find_two_sided(&all.blocks.evidence, self.level())?;
        let is_slight = found.entries.iter().any(|entry| entry.psf.spread() < LEAST_SPREAD);
        if is_slight || found.loss() > CLEARLY_BETTER * one_sided {
            return None;
        }

        Some(FittedBlur::of_both_images(found, all.powers.clone()))
    }

    /// The joint blur of these tiles: from a family, or measured, or none.
    fn fitted_blur(
        &self,
        grid: &Grid,
        tiles: &[usize],
        noise: [f32; 2],
        side: Option<Side>,
    ) -> Result<FittedBlur> {
        let powers = grid.together(tiles);
        let none = FittedBlur::unblurred(&powers, noise, self.level());
        let Some(side) = side else {
            return Ok(none);
        };

        let evidence = &BlurEvidence::of_both(&powers, noise, self.level())[side.index()];
        // A blur with hardly any spread counts as no blur, unless no family explains the powers.
        let refined = refine(evidence, self.level());
        if refined.entry.psf.spread() < LEAST_SPREAD && refined.fit.loss <= DOUBTFUL {
            return Ok(none);
        }

        let blur = Blur::of(side, refined.entry.psf);
        let family = FittedBlur { blur, response: refined.entry.response, fit: refined.fit, powers };

        // A measurement takes another match: only if the family is doubtful and there are enough blocks.
        let least = LEAST_BLOCKS.max(grid.powers.len() / LEAST_PART);
        if family.fit.loss <= DOUBTFUL || tiles.len() < least {
            return Ok(family);
        }

        self.measured(grid, tiles, evidence, family)
    }

    /// The measured kernel, unless it explains the powers much worse than the family.
    fn measured(
        &self,
        grid: &Grid,
        tiles: &[usize],
        evidence: &BlurEvidence,
        family: FittedBlur,
    ) -> Result<FittedBlur> {
        let Some(side) = family.blur.side else {
            return Ok(family);
        };

        // Rows are visited from the top down, in whatever order the tiles were chosen.
        let mut tiles = tiles.to_vec();
        tiles.sort_unstable();
        let places: Vec<BlockPlace> = tiles.iter().filter_map(|tile| grid.places[*tile]).collect();
        let mut rows: Vec<usize> = places.iter().map(|place| place.top).collect();
        rows.dedup();

        let mut sums = Cross::default();
        self.visit(&rows, ROUGH, |part, (rough, _), visited| {
            let here = &rows[visited];
            let there = places.iter().filter(|place| here.contains(&place.top));
            add_cross_spectra(&part.grays, rough, &part.local(there), &mut sums, self.runtime)
        })?;

        let Some(taps) = measured(&sums, side, self.level()) else {
            return Ok(family);
        };
        let response = response(&taps, self.level());
        let fit = evidence.fit(&response, self.level());
        if fit.loss > MUCH_WORSE * family.fit.loss {
            return Ok(family);
        }

        let blur = Blur { side: Some(side), psf: None, taps: Some(taps), other: None };
        Ok(FittedBlur { blur, response, fit, powers: family.powers })
    }

    /// Disks that follow depth, their map, and their certainty, if the blocks show this.
    fn by_depth(
        &self,
        grid: &Grid,
        blocks: &[BlockPair],
        losses: &Losses,
        noise: [f32; 2],
    ) -> Result<Option<(Vec<FittedBlur>, RegionMap, f32)>> {
        let map = self.depths()?;

        // The values at the centers of the tiles with blocks, in the same order.
        let tiles = grid.with_block();
        let at_centers = |known: fn(&Depths, (usize, usize)) -> f32| -> Vec<f32> {
            let centers = tiles.iter().map(|tile| grid.tiling.center(grid.tiling.place(*tile)));
            centers.map(|center| known(&map, center)).collect()
        };
        let (known, spreads) = (at_centers(Depths::at), at_centers(Depths::spread));
        let apart = losses.mean_of_best();
        let Some(found) = BlurByDepth::new(blocks, &known, &spreads, apart, self.level()) else {
            return Ok(None);
        };

        // The disks that occur, each with the blocks of its disparities.
        let mut kinds: Vec<Defocus> = vec![];
        let labels = map.values.map(|disparity| {
            let disk = found.defocus(*disparity);
            let known = kinds.iter().position(|known| *known == disk).unwrap_or(kinds.len());
            if known == kinds.len() {
                kinds.push(disk);
            }
            known as u8
        });

        let fitted = kinds.iter().map(|kind| {
            let members = tiles.iter().zip(&known).filter(|(_, d)| found.defocus(**d) == *kind);
            let members: Vec<usize> = members.map(|(tile, _)| *tile).collect();
            let members = if members.is_empty() { &tiles } else { &members };
            FittedBlur::defocused(*kind, grid.together(members), noise, self.level())
        });
        Ok(Some((fitted.collect(), RegionMap { labels, tile: map.tile }, found.certainty)))
    }

    /// The disparities of tiles; those without one take that of the previous tile.
    fn depths(&self) -> Result<Depths> {
        let tiling = Tiling::new(self.size, self.tile());
        let mut values = vec![];
        let mut last = f32::NAN;
        self.visit(&tiling.tops(), DEPTHS, |_, (rough, first), visited| {
            for tile in visited.flat_map(|y| (0..tiling.cols).map(move |x| (y, x))) {
                let (y, x) = tiling.center(tile);
                last = rough.around(y - first, x).unwrap_or(last);
                values.push(last);
            }
            Ok(())
        })?;
        Ok(Depths { values: Plane::from_vec(tiling.rows, tiling.cols, values)?, tile: tiling.side })
    }

    /// The side of the tiles of a map: the smallest one, unless there would be too many tiles.
    fn tile(&self) -> usize {
        let (rows, cols) = self.size;
        let even = ((rows * cols / MOST_TILES) as f64).sqrt() as usize;
        even.next_multiple_of(TILE).max(TILE)
    }

    /// The map of the kinds. Its tiles are finer than those of the first blocks; of these, only those on a
    /// boundary are examined again.
    fn map(
        &self,
        kinds: &[FittedBlur],
        noise: [f32; 2],
        first: &Grid,
        blocks: &[BlockPair],
    ) -> Result<RegionMap> {
        let choices = choices(kinds);
        let tile = self.tile();

        let rough = first.losses(blocks, &choices, self.level());
        // The tile of the first grid under the center of a finer one.
        let at = |length: usize| (length * tile + tile / 2) / first.tiling.side;
        let around = |(y, x)| first.tiling.tile((at(y), at(x)));
        let grid = self.grid(tile, |place| rough.is_boundary(around(place)))?;

        let mut losses = grid.losses(&grid.blocks(noise, self.level()), &choices, self.level());
        for (index, tile) in losses.values.chunks_mut(choices.len()).enumerate() {
            let coarse = around(grid.tiling.place(index));
            if !rough.is_boundary(coarse) {
                tile.copy_from_slice(rough.of(coarse));
            }
        }

        let labels = losses.steadied().main_labels();
        Ok(RegionMap { labels: Plane::from_vec(grid.tiling.rows, grid.tiling.cols, labels)?, tile })
    }

    /// Standard deviations of noise of these powers, in units of the pixels.
    fn in_units(&self, noise: [f32; 2]) -> [f64; 2] {
        [0, 1].map(|side| f64::from(noise[side]).sqrt() / self.units[side])
    }

    fn summary(&self, kinds: Vec<FittedBlur>, map: RegionMap, noise: [f32; 2]) -> Estimate {
        let (map, order) = map.by_area(kinds.len());

        let first = &kinds[order[0]];
        let units = self.units[1] / self.units[0];

        Estimate {
            certainty: first.certainty(noise, self.level()),
            gain: first.gain() * units,
            noise: self.in_units(noise),
            blurs: order.iter().map(|kind| kinds[*kind].blur.clone()).collect(),
            labels: map.labels,
            tile: map.tile,
            impulses: [0.0; 2],
            coding: [0.0; 2],
            signature: BlurSignature::default(),
        }
    }
}

impl AllBlocks {
    /// `None` if there are few blocks.
    fn new(grid: &Grid, noise: [f32; 2], level: Level) -> Option<Self> {
        let tiles = grid.with_block();
        if tiles.len() < LEAST_BLOCKS {
            return None;
        }

        let powers = grid.together(&tiles);
        let blocks = BlockPair::new(&powers, noise, level);
        let losses = blocks.losses(level);
        Some(Self { powers, blocks, losses })
    }
}

impl Grid {
    /// The tiles with a block.
    fn with_block(&self) -> Vec<usize> {
        (0..self.places.len()).filter(|tile| self.places[*tile].is_some()).collect()
    }

    /// The power of the noise of either image, from its quietest blocks.
    fn noise(&self) -> [f32; 2] {
        [0, 1].map(|side| {
            // Texture only adds power, so the quietest blocks show the noise.
            let mut highs: Vec<f32> = self.powers.iter().map(|powers| powers.least_high[side]).collect();
            let quiet = highs.len() / QUIET;
            ranked(&mut highs, quiet).map_or(0.0, |power| power * QUIET_BIAS)
        })
    }

    /// The evidence of every pair of blocks.
    fn blocks(&self, noise: [f32; 2], level: Level) -> Vec<BlockPair> {
        self.powers.par_iter().map(|powers| BlockPair::new(powers, noise, level)).collect()
    }

    /// The loss of every choice on every tile.
    fn losses(&self, blocks: &[BlockPair], choices: &[Choice], level: Level) -> Losses {
        let losses_of = |blocks: &BlockPair| -> Vec<f32> {
            choices.iter().map(|choice| blocks.loss(*choice, level)).collect()
        };

        self.on_tiles(choices.len(), blocks.par_iter().map(losses_of).collect())
    }

    /// The loss of each of all blurs on every tile; some blocks are not fitted to all of them.
    fn searched(&self, blocks: &[BlockPair], is_sharp: bool, level: Level) -> Losses {
        // Samples lie in every row, shifted by half a sample from row to row.
        let is_sample = |tile: usize| {
            let (y, x) = self.tiling.place(tile);
            blocks.len() <= LEAST_SAMPLE * SAMPLE || (x + 2 * y).is_multiple_of(SAMPLE)
        };
        let is_sample: Vec<bool> = self.with_block().into_iter().map(is_sample).collect();

        self.on_tiles(1 + 2 * bank().len(), searched(blocks, &is_sample, is_sharp, level))
    }

    /// Losses of blocks as losses of tiles; infinite for tiles without a block.
    fn on_tiles(&self, choices: usize, losses: Vec<Vec<f32>>) -> Losses {
        let mut losses = losses.into_iter();
        let unknown = vec![f32::INFINITY; choices];
        let of_tile =
            |place: &Option<BlockPlace>| place.and_then(|_| losses.next()).unwrap_or_else(|| unknown.clone());

        let values = self.places.iter().flat_map(of_tile).collect();
        Losses { rows: self.tiling.rows, cols: self.tiling.cols, choices, values }
    }

    /// The mean powers of these tiles.
    fn together(&self, tiles: &[usize]) -> Powers {
        // Powers are stored only for the tiles with a block.
        let mut index = 0;
        let mut indices = vec![0; self.places.len()];
        for (tile, place) in self.places.iter().enumerate() {
            indices[tile] = index;
            index += usize::from(place.is_some());
        }

        let mut sums =
            Powers { binned: [vec![0.0; bins().count()], vec![0.0; bins().count()]], least_high: [0.0; 2] };

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

impl FittedBlur {
    fn unblurred(powers: &Powers, noise: [f32; 2], level: Level) -> Self {
        let fit = BlockPair::new(powers, noise, level).none();

        Self { blur: Blur::NONE, response: flat().clone(), fit, powers: powers.clone() }
    }

    /// A disk of one image, or none.
    fn defocused(disk: Defocus, powers: Powers, noise: [f32; 2], level: Level) -> Self {
        let Some((side, radius)) = disk else {
            return Self::unblurred(&powers, noise, level);
        };

        let entry = Entry::new(Psf::disk(radius), level);
        let fit = BlurEvidence::of_both(&powers, noise, level)[side.index()].fit(&entry.response, level);
        Self { blur: Blur::of(side, entry.psf), response: entry.response, fit, powers }
    }

    /// The blurs of both images; the softer image is the one with the wider blur.
    fn of_both_images(found: TwoSided, powers: Powers) -> Self {
        let [left, right] = found.entries;
        let (side, own, other) = if left.psf.spread() >= right.psf.spread() {
            (Side::Left, left, right)
        } else {
            (Side::Right, right, left)
        };

        let blur = Blur { other: Some(other.psf), ..Blur::of(side, own.psf) };
        // Responses distinguish kinds on tiles, and this kind is the only one.
        Self { blur, response: own.response, fit: found.fits[side.index()], powers }
    }

    /// The contrast of the left image relative to the right one, both in gray values.
    fn gain(&self) -> f64 {
        // A fit's gain is that of the softer image relative to the sharper one.
        let gain = f64::from(self.fit.gain()).sqrt();
        if self.blur.side == Some(Side::Right) { 1.0 / gain } else { gain }
    }

    /// The share of the loss of the opposite assumption that this one avoids: that of no blur, or of any
    /// blur.
    fn certainty(&self, noise: [f32; 2], level: Level) -> f32 {
        let blocks = BlockPair::new(&self.powers, noise, level);
        let opposite = match self.blur.side {
            Some(_) => blocks.none().loss,
            None => blocks.losses(level)[1..].iter().copied().fold(f32::INFINITY, f32::min),
        };

        (1.0 - self.fit.loss / opposite.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    }
}

/// The kinds as choices for tiles.
fn choices(kinds: &[FittedBlur]) -> Vec<Choice<'_>> {
    kinds.iter().map(|kind| Choice { side: kind.blur.side, response: &kind.response }).collect()
}

/// Keeps only the first of the kinds without blur.
fn merge(kinds: &mut Vec<FittedBlur>) {
    let mut seen = false;
    kinds.retain(|kind| {
        let keep = kind.blur.side.is_some() || !seen;
        seen |= kind.blur.side.is_none();
        keep
    });
}

/// The disparities of square tiles.
struct Depths {
    values: Plane<f32>,
    tile: usize,
}

impl Depths {
    /// The difference of the disparities of the tiles around a pixel.
    fn spread(&self, (y, x): (usize, usize)) -> f32 {
        let columns = around(x / self.tile, 1, self.values.cols());
        let rows = around(y / self.tile, 1, self.values.rows());
        let values = rows.flat_map(|row| &self.values.row(row)[columns.clone()]);
        let (low, high) =
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
        high - low
    }

    /// The disparity of the tile of a pixel.
    fn at(&self, (y, x): (usize, usize)) -> f32 {
        self.values.row(y / self.tile)[x / self.tile]
    }
}

/// The map of the kinds: the index of its kind for each tile.
struct RegionMap {
    labels: Plane<u8>,
    tile: usize,
}

impl RegionMap {
    fn uniform((rows, cols): (usize, usize)) -> Self {
        Self { labels: Plane::from_fn(1, 1, |_, _| 0), tile: rows.max(cols) }
    }

    /// The geometric mean of the gains of the kinds over the tiles.
    fn mean_gain(&self, kinds: &[FittedBlur]) -> f64 {
        let logarithms: Vec<f64> = kinds.iter().map(|kind| math::ln(kind.gain())).collect();
        let labels = self.labels.as_slice();
        let sum: f64 = labels.iter().map(|label| logarithms[usize::from(*label)]).sum();
        math::exp(sum / labels.len() as f64)
    }

    /// The map with its kinds numbered by decreasing area, without those that have no tile, and the old
    /// numbers of these.
    fn by_area(mut self, kinds: usize) -> (Self, Vec<usize>) {
        let mut areas = vec![0; kinds];

        self.labels.as_slice().iter().for_each(|label| areas[usize::from(*label)] += 1);
        let mut order: Vec<usize> = (0..kinds).filter(|kind| areas[*kind] > 0).collect();
        order.sort_by_key(|kind| std::cmp::Reverse(areas[*kind]));

        let mut number = vec![0; kinds];
        order.iter().enumerate().for_each(|(index, kind)| number[*kind] = index as u8);
        self.labels = self.labels.map(|label| number[usize::from(*label)]);

        (self, order)
    }
}

impl Estimate {
    /// The estimate with the defects of the images.
    pub(crate) fn with(self, Defects { impulses, coding }: Defects) -> Self {
        Self { impulses, coding, ..self }
    }

    /// The larger of these standard deviations of noise, left and right, and of the noise that would do the
    /// same harm as compression.
    pub fn harm(&self, noise: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|side| noise[side].max(self.coding[side]))
    }

    /// The share of the tiles of each kind of blur.
    pub fn shares(&self) -> impl Iterator<Item = f64> {
        let labels = self.labels.as_slice();
        (0..self.blurs.len()).map(|kind| {
            let tiles = labels.iter().filter(|label| usize::from(**label) == kind).count();
            tiles as f64 / labels.len() as f64
        })
    }

    /// The estimate without evidence.
    pub fn unknown((rows, cols): (usize, usize)) -> Self {
        Self {
            blurs: vec![Blur::NONE],
            labels: Plane::from_fn(1, 1, |_, _| 0),
            tile: rows.max(cols),
            certainty: 0.0,
            gain: 1.0,
            noise: [0.0; 2],
            impulses: [0.0; 2],
            coding: [0.0; 2],
            signature: BlurSignature::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_numbered_by_area_and_those_without_tiles_left_out() {
        let labels = Plane::from_vec(1, 6, vec![3, 0, 0, 0, 3, 2]).expect("six");

        let (map, order) = RegionMap { labels, tile: 16 }.by_area(4);
        assert_eq!((map.labels.as_slice(), order), (&[1, 0, 0, 0, 1, 2][..], vec![0, 3, 2]));
    }
}

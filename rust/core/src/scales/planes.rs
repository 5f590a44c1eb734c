//! Flat areas become planes where these are more likely to be right than the match.
//!
//! A table, a wall or a road has no texture to match, only an outline, and grain here and there. So a plane
//! is fitted to the confident disparities of each flat area and its outline. It competes with the map by
//! evidence of the same kind: the share of confident disparities that agree with it, in the area and nearby:
//!
//! ```text
//! weight    = confidence^2, in the area and RING pixels around it
//! samples   = the pixels with weight > LEAST_WEIGHT at which the sum of these reaches k / SAMPLES of all,
//!             k = 1, 2, ..
//! plane     = of TRIALS planes through three samples, the one that most samples are near;
//!             then least squares, three times, of the samples that are near
//! agree     = |disparity - plane| < 1
//! whole     = share of the weight that agrees; no plane unless it is the larger part
//! p         = TRUST (n near + PRIOR whole) / (n + PRIOR),
//!             n the mean weight, near the share that agrees, nearby
//! disparity = plane in the area where p > confidence, own and mean of a few pixels,
//!             and |disparity - plane| > 1/2
//!
//! trial:   sample i mod count, with i the upper 31 bits of the next state of Knuth's MMIX generator,
//!          which begins with 1
//! through: of two samples less the first one, (x, y, d) and (u, v, e):
//!          span = x v - y u, not below LEAST_SPAN
//!          slopes = (d v - y e) / span, (x e - d u) / span, not beyond STEEPEST
//! fitted:  of the samples less their mean, with xy the sum of x y: determinant = xx yy - xy xy, not below 1
//!          slopes = (xd yy - yd xy) / determinant, (yd xx - xd xy) / determinant
//! ```
//!
//! Sums of floats are taken in reading order; over areas, of tiles, which are counted from the corner of the
//! area and its ring.
//!
//! Drawn pixels are flagged as inferred and have the confidence p. Their error bar follows from it, if the
//! odds of an error fall in proportion to the tolerance: 9 (1 - p) / p px for 90 %.
//!
//! An outline is evidence only if it belongs to the area. That of a table does; that of a sky behind houses
//! belongs to the houses, and the surface of the sky continues outside. And where only noise is seen, nothing
//! is evidence (detail.rs):
//!
//! ```text
//! occluder   = share of the pixels OUTSIDE the area that are sure (weight > LEAST_WEIGHT)
//!              and within GOES_ON px of the plane
//! p          = at most UNSEEN where occluder > OCCLUDER,
//!              except for EVIDENCE_REACH px around what is sure and agrees
//! confidence = at most UNSEEN where nothing but noise is seen, of planes or not
//! ```
//!
//! An area without a plane may have wrong matches with hardly any detail. It gets a second attempt without
//! faint pixels. If this gives a plane, those that do not become it count as unseen, too.

use std::borrow::Cow;
use std::iter;
use std::ops::Range;

use rayon::prelude::*;

use crate::scales::choices::{EVIDENCE_REACH, GOES_ON, LEAST_AGREEING, OCCLUDER, OUTSIDE, TRUST, UNSEEN};
use crate::scales::detail::Detail;
use crate::scales::flat_areas::{FlatArea, flat_areas, grown};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, widened, zeroed};
use phasestereo_match::base::simd::{Level, leveled, whole};
use phasestereo_match::image::window_sums::window_means;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::refinement::flag;

/// Distance from an area within which pixels count for its plane.
const RING: usize = 4;
/// Distance from it within which the plane is drawn.
const DRAWN: usize = 2;
/// A plane is fitted to pixels of more than this weight.
const LEAST_WEIGHT: f32 = 0.25;
/// Fewest such pixels.
const LEAST_PIXELS: usize = 100;
/// Steps in a weight of 1.
const STEPS: f32 = (1 << 25) as f32;
/// Pixels whose weights are summed together: to less than 2^32 steps.
const GROUP: usize = 16;
/// Columns whose agreement is summed together.
const COLUMNS: usize = 64;
/// Pixels that a plane is fitted to, and number of planes tried.
const SAMPLES: usize = 2000;
const TRIALS: usize = 300;
/// Samples counted before a trial may end.
const COUNTED: usize = 128;
/// Distance from a plane within which samples are near, pixels.
const NEAR: f64 = 0.7;
/// Steepest planes, disparity by column and by row.
const STEEPEST: [f64; 2] = [0.5, 0.7];
/// Twice the least area that three samples span, pixels.
const LEAST_SPAN: f64 = 100.0;
/// Side of the tiles in which agreement is summed, pixels.
const TILE: usize = 4;
/// Reach of "nearby", tiles.
const NEARBY: usize = 7;
/// The mean weight nearby that counts as much as the whole area.
const PRIOR: f32 = 0.2;
/// Reach of the mean of the confidence that it competes with.
const FEW: usize = 4;
/// Larger differences are drawn, pixels.
const LEAST_CHANGE: f32 = 0.5;

/// `disparity = x slopes[0] + y slopes[1] + height`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Surface {
    slopes: [f64; 2],
    height: f64,
}

/// A pixel that a plane is fitted to: column, row and disparity.
type PlanePixel = [f64; 3];

/// The drawn part of a plane: columns and confidences, row by row.
struct Drawn {
    surface: Surface,
    rows: Vec<(usize, Vec<(u32, f32)>)>,
}

/// Draws the planes of a pair into its map, and doubts pixels that show only noise. `noise`: its standard
/// deviation in the left image, in units of the pixels; 0: unknown.
pub fn draw(map: &mut Disparity, pair: &Pair, noise: f64, runtime: Runtime) -> Result<()> {
    let Some(confidence) = &map.confidence else { return Ok(()) };
    let [left, _] = pair.views();
    let lost = left.scale().surplus();
    let gray = match lost {
        0 => Cow::Borrowed(left.gray()),
        _ => Cow::Owned(left.gray().map(|gray| gray >> lost)),
    };
    let areas = flat_areas(&gray, runtime)?;

    let steps = |pixels: f64| left.scale().steps(pixels) / f64::from(1u32 << lost);
    let step = left.scale().step().map_or(0.0, steps);
    let detail = Detail::new(&gray, steps(noise), step, runtime)?;
    let faint = if areas.is_empty() { None } else { detail.faint() };
    let unseen = detail.unseen(&map.flags, confidence, runtime)?;
    drop(gray);
    let scene = Scene {
        disparity: &map.disparity,
        flags: &map.flags,
        confidence,
        around: means_around(confidence, runtime.level())?,
        faint: None,
        // Nothing lies behind infinity.
        least: if pair.candidates().min() >= 0 { 0.0 } else { f32::NEG_INFINITY },
        runtime,
    };

    // Every plane competes with the original map.
    let drawn: Result<Vec<_>> = areas.par_iter().map(|area| scene.drawn(area)).collect();
    let (drawn, disproved) = scene.with_second_attempts(&areas, drawn?, faint)?;
    for drawn in drawn {
        drawn.write(map);
    }
    for doubted in [Some(unseen), disproved].into_iter().flatten() {
        doubt(map, &doubted);
    }
    Ok(())
}

/// Mean confidences of a few pixels.
fn means_around(confidence: &Plane<f32>, level: Level) -> Result<Plane<f32>> {
    let size = confidence.size();
    window_means(size, FEW, |y| confidence.row(y).iter().copied(), level)
}

/// Bounds the confidences of pixels without evidence, and adjusts their bars.
pub fn doubt(map: &mut Disparity, unseen: &Plane<bool>) {
    let Some(confidence) = &mut map.confidence else { return };
    let confidence = confidence.as_mut_slice().iter_mut();
    let bars = map.uncertainty.iter_mut().flat_map(|bars| bars.as_mut_slice().iter_mut().map(Some));
    let bars = bars.chain(iter::repeat_with(|| None));

    for ((confidence, bar), unseen) in confidence.zip(bars).zip(unseen.as_slice()) {
        if *unseen && *confidence > UNSEEN {
            *confidence = UNSEEN;
            if let Some(bar) = bar {
                *bar = bar.max(bar_of(UNSEEN));
            }
        }
    }
}

/// The error bar of an inferred disparity, pixels.
fn bar_of(confidence: f32) -> f32 {
    9.0 * (1.0 - confidence) / confidence
}

impl Drawn {
    /// Writes the drawn pixels into a map.
    fn write(self, map: &mut Disparity) {
        for (y, pixels) in self.rows {
            for (x, confidence) in pixels {
                let x = x as usize;
                // Pixels that the right image does not show may be anything.
                if map.flags.row(y)[x] & flag::MISSING != 0 {
                    continue;
                }
                map.disparity.row_mut(y)[x] = self.surface.disparity(y, x);
                let flags = &mut map.flags.row_mut(y)[x];
                let others = flag::FILLED | flag::COARSE | flag::SECOND;
                *flags = *flags & !others | flag::INFERRED;

                if let Some(plane) = &mut map.confidence {
                    plane.row_mut(y)[x] = confidence;
                }
                if let Some(plane) = &mut map.uncertainty {
                    plane.row_mut(y)[x] = bar_of(confidence);
                }
            }
        }
    }
}

/// The map that planes are fitted to and compete with.
struct Scene<'a> {
    disparity: &'a Plane<f32>,
    flags: &'a Plane<u16>,
    confidence: &'a Plane<f32>,
    /// Mean confidences of a few pixels.
    around: Plane<f32>,
    /// Pixels that do not count.
    faint: Option<&'a Plane<bool>>,
    /// Least disparity.
    least: f32,
    runtime: Runtime<'a>,
}

/// An area with the pixels around it.
struct Surroundings {
    rows: Range<usize>,
    cols: Range<usize>,
    /// Weights of the pixels, 0 far from the area.
    weights: Plane<f32>,
}

impl Scene<'_> {
    /// The drawn planes, after second attempts without faint pixels at areas without a plane, and the pixels
    /// doubted because of these attempts.
    fn with_second_attempts(
        self,
        areas: &[FlatArea],
        first: Vec<Option<Drawn>>,
        faint: Option<Plane<bool>>,
    ) -> Result<(Vec<Drawn>, Option<Plane<bool>>)> {
        // Without faint pixels in it, a second attempt would repeat the first.
        let is_other = |area: &FlatArea| {
            faint.as_ref().is_some_and(|faint| {
                let (mut rows, cols) = self.wider(area, RING);
                rows.any(|y| faint.row(y)[cols.clone()].contains(&true))
            })
        };
        let without = areas.iter().zip(&first).filter(|(_, drawn)| drawn.is_none());
        let without: Vec<_> = without.map(|(area, _)| area).filter(|area| is_other(area)).collect();
        let mut all: Vec<Drawn> = first.into_iter().flatten().collect();
        let Some(faint) = faint.filter(|_| !without.is_empty()) else { return Ok((all, None)) };

        let places = self.confidence.as_slice().iter().zip(faint.as_slice());
        let bounded = places.map(|(own, faint)| if *faint { own.min(UNSEEN) } else { *own });
        let mut confidence = Plane::new(faint.rows(), faint.cols())?;
        confidence.as_mut_slice().iter_mut().zip(bounded).for_each(|(to, from)| *to = from);
        drop(self.around);
        let around = means_around(&confidence, self.runtime.level())?;
        let scene = Scene { confidence: &confidence, around, faint: Some(&faint), ..self };

        let second: Result<Vec<_>> = without.par_iter().map(|area| scene.drawn(area)).collect();
        let mut unseen = None;
        for (area, drawn) in without.into_iter().zip(second?) {
            let Some(drawn) = drawn else { continue };
            let unseen = unseen.get_or_insert(Plane::new(faint.rows(), faint.cols())?);
            area.copy(&faint, unseen);
            // Pixels that become the plane get its confidence.
            for (y, pixels) in &drawn.rows {
                for (x, _) in pixels {
                    unseen.row_mut(*y)[*x as usize] = false;
                }
            }
            all.push(drawn);
        }

        Ok((all, unseen))
    }

    /// The drawn part of the plane of an area; `None`: it has no plane.
    fn drawn(&self, area: &FlatArea) -> Result<Option<Drawn>> {
        let frame = self.frame(area)?;
        let samples = self.samples(&frame)?;
        let Some(surface) = Surface::of_samples(&samples, self.runtime.level()) else { return Ok(None) };

        let tiles = self.tiles(&frame, surface)?;
        let size = tiles.size();
        let sum = |of: usize| tiles.as_slice().iter().map(|sums| f64::from(sums[of])).sum::<f64>();
        let whole = (sum(0) / sum(1)) as f32;
        if whole <= LEAST_AGREEING[usize::from(self.faint.is_some())] {
            return Ok(None);
        }

        let nearby = |of: usize| {
            let sums = |y: usize| tiles.row(y).iter().map(move |sums| sums[of]);
            window_means(size, NEARBY, sums, self.runtime.level())
        };
        let (agree, all) = (nearby(0)?, nearby(1)?);
        let inside = area.near((&frame.rows, &frame.cols), DRAWN, self.runtime)?;

        let (mut rows, mut chances) = (vec![], vec![]);
        let mut drawn = zeroed(frame.cols.len())?;
        for (row, y) in frame.rows.clone().enumerate() {
            if row.is_multiple_of(TILE) {
                // `all` is the mean of the weights nearby, `agree` the mean of those that agree.
                let sums = agree.row(row / TILE).iter().zip(all.row(row / TILE));
                let chance = |(agree, all)| TRUST * (agree + PRIOR * whole) / (all + PRIOR);
                chances.clear();
                chances.extend(sums.map(chance).flat_map(|chance| [chance; TILE]));
            }

            let [disparity, own, around] = [self.disparity, self.confidence, &self.around]
                .map(|plane| &plane.row(y)[frame.cols.clone()]);
            let place = (y, frame.cols.start);
            let (least, inside, chances) = (self.least, inside.row(row), &chances);
            let known = [disparity, own, around, chances];
            draw_row(self.runtime.level(), surface, place, known, inside, least, &mut drawn);

            let pixels = frame.cols.clone().zip(&drawn).filter(|(_, p)| **p > 0.0);
            let pixels: Vec<_> = pixels.map(|(x, p)| (x as u32, *p)).collect();
            if !pixels.is_empty() {
                rows.push((y, pixels));
            }
        }

        let mut drawn = Drawn { surface, rows };
        if !drawn.rows.is_empty() && self.goes_on(area, surface)? {
            self.bound(&mut drawn, &frame)?;
        }
        Ok(Some(drawn))
    }

    /// Whether a surface continues around an area, so that the outline belongs to something in front of it.
    fn goes_on(&self, area: &FlatArea, surface: Surface) -> Result<bool> {
        let [from, to] = OUTSIDE;
        let (rows, cols) = self.wider(area, to);
        let [near, far] = [from, to].map(|by| area.near((&rows, &cols), by, self.runtime));
        let (near, far) = (near?, far?);

        let (mut going_on, mut all) = (0u64, 0u64);
        for (row, y) in rows.enumerate() {
            let known = [self.disparity, self.confidence].map(|plane| &plane.row(y)[cols.clone()]);
            let rings = [near.row(row), far.row(row)];
            let flags = &self.flags.row(y)[cols.clone()];
            let [one, of] =
                count_going_on(self.runtime.level(), surface, (y, cols.start), known, flags, rings);
            going_on += u64::from(one);
            all += u64::from(of);
        }
        Ok(going_on as f64 > OCCLUDER * all as f64)
    }

    /// Bounds the confidences of drawn pixels far from pixels that agree.
    fn bound(&self, drawn: &mut Drawn, frame: &Surroundings) -> Result<()> {
        let agreeing = Plane::from_fn(frame.rows.len(), frame.cols.len(), |row, col| {
            let (y, x) = (frame.rows.start + row, frame.cols.start + col);
            let is_near = (self.disparity.row(y)[x] - drawn.surface.disparity(y, x)).abs() < 1.0;
            is_near && frame.weights.row(row)[col] > LEAST_WEIGHT
        });
        let near = grown(&agreeing, EVIDENCE_REACH, self.runtime)?;

        for (y, pixels) in &mut drawn.rows {
            let near = near.row(*y - frame.rows.start);
            for (x, confidence) in pixels {
                if !near[*x as usize - frame.cols.start] {
                    *confidence = confidence.min(UNSEEN);
                }
            }
        }
        Ok(())
    }

    /// The rows and columns that contain an area and the pixels up to this distance around it.
    fn wider(&self, area: &FlatArea, by: usize) -> (Range<usize>, Range<usize>) {
        let (rows, cols) = self.disparity.size();
        (widened(&area.rows, by, rows), widened(&area.cols, by, cols))
    }

    /// An area with the pixels that count for its plane.
    fn frame(&self, area: &FlatArea) -> Result<Surroundings> {
        let (rows, cols) = self.wider(area, RING);
        let near = area.near((&rows, &cols), RING, self.runtime)?;
        let size = (rows.len(), cols.len());
        let weights = Plane::by_rows(size, self.runtime.control, |row, weights: &mut [f32]| {
            let confidences = &self.confidence.row(rows.start + row)[cols.clone()];
            weigh(self.runtime.level(), confidences, near.row(row), weights);
            if let Some(faint) = self.faint {
                let faint = &faint.row(rows.start + row)[cols.clone()];
                weights.iter_mut().zip(faint).filter(|(_, faint)| **faint).for_each(|(w, _)| *w = 0.0);
            }
        })?;

        Ok(Surroundings { rows, cols, weights })
    }

    /// The means over tiles of the weights of the pixels that agree with a surface, and of all pixels.
    fn tiles(&self, frame: &Surroundings, surface: Surface) -> Result<Plane<[f32; 2]>> {
        let size = (frame.rows.len().div_ceil(TILE), frame.cols.len().div_ceil(TILE));

        Plane::by_rows(size, self.runtime.control, |tile, means: &mut [[f32; 2]]| {
            for row in tile * TILE..((tile + 1) * TILE).min(frame.rows.len()) {
                let y = frame.rows.start + row;
                let disparity = &self.disparity.row(y)[frame.cols.clone()];
                let (place, weights) = ((y, frame.cols.start), frame.weights.row(row));
                add_to_tiles(self.runtime.level(), surface, place, disparity, weights, means);
            }
        })
    }

    /// Pixels at even steps of the sum of weights.
    fn samples(&self, frame: &Surroundings) -> Result<Vec<PlanePixel>> {
        let weights = frame.weights.as_slice();
        let mut sums = zeroed(weights.len().div_ceil(GROUP))?;
        let pixels = sum_heavy(self.runtime.level(), weights, &mut sums);
        if pixels < LEAST_PIXELS {
            return Ok(vec![]);
        }

        let weight = |steps: u64| steps as f64 / f64::from(STEPS);
        let share = weight(sums.iter().map(|sum| u64::from(*sum)).sum()) / SAMPLES as f64;
        let (mut sum, mut samples) = (0, vec![]);
        for (group, (weights, more)) in weights.chunks(GROUP).zip(sums).enumerate() {
            // Many groups hold no sample.
            let next = share * (samples.len() + 1) as f64;
            if weight(sum + u64::from(more)) < next {
                sum += u64::from(more);
                continue;
            }

            for (place, steps) in (group * GROUP..).zip(weights.iter().map(|one| heavy(*one))) {
                sum += u64::from(steps);
                // A pixel heavier than a share counts more than once.
                while steps > 0 && weight(sum) >= share * (samples.len() + 1) as f64 {
                    let (row, col) = (place / frame.cols.len(), place % frame.cols.len());
                    let (y, x) = (frame.rows.start + row, frame.cols.start + col);
                    samples.push([x as f64, y as f64, f64::from(self.disparity.row(y)[x])]);
                }
            }
        }

        Ok(samples)
    }
}

/// The weight of a pixel that a plane is fitted to, otherwise 0, in steps: integers sum to the same in any
/// order. They are exact, since floats from [`LEAST_WEIGHT`] on have no finer steps.
#[inline(always)]
fn heavy(weight: f32) -> u32 {
    if weight > LEAST_WEIGHT { whole(weight * STEPS) as u32 } else { 0 }
}

/// Sums the weights of the pixels that a plane is fitted to, for every [`GROUP`] pixels, and counts these
/// pixels.
#[leveled]
fn sum_heavy(level: Level, weights: &[f32], sums: &mut [u32]) -> usize {
    let mut count = 0;
    for (sum, weights) in sums.iter_mut().zip(weights.chunks(GROUP)) {
        *sum = weights.iter().map(|weight| heavy(*weight)).sum();
        let heavy: u32 = weights.iter().map(|weight| u32::from(*weight > LEAST_WEIGHT)).sum();
        count += heavy as usize;
    }
    count
}

/// Writes the weights of a row.
#[leveled]
fn weigh(level: Level, confidences: &[f32], near: &[bool], weights: &mut [f32]) {
    let places = weights.iter_mut().zip(confidences).zip(near);
    for ((weight, confidence), is_near) in places {
        *weight = if *is_near { confidence * confidence } else { 0.0 };
    }
}

/// Counts the pixels of a row between two rings that are sure and near a surface, and all between them. The
/// row begins at `place`. `known`: disparities and confidences.
#[leveled]
fn count_going_on(
    level: Level,
    surface: Surface,
    place: (usize, usize),
    known: [&[f32]; 2],
    flags: &[u16],
    rings: [&[bool]; 2],
) -> [u32; 2] {
    let (y, first) = place;
    let [disparity, confidence] = known;
    let [mut going_on, mut all] = [0; 2];
    let known = disparity.iter().zip(confidence).zip(flags);
    let places = known.zip(rings[0].iter().zip(rings[1]));
    for (i, (((disparity, confidence), flags), (near, far))) in places.enumerate() {
        let is_between = far & !near;
        let is_near = (disparity - surface.disparity(y, first + i)).abs() < GOES_ON;
        // Disparities from a smaller copy have no outline.
        let is_sure = (confidence * confidence > LEAST_WEIGHT) & (flags & flag::COARSE == 0);
        all += u32::from(is_between);
        going_on += u32::from(is_between & is_near & is_sure);
    }
    [going_on, all]
}

/// Adds a row that begins at `place` to the means over tiles of the weights that agree with a surface, and of
/// all.
#[leveled]
fn add_to_tiles(
    level: Level,
    surface: Surface,
    place: (usize, usize),
    disparity: &[f32],
    weights: &[f32],
    means: &mut [[f32; 2]],
) {
    let (y, first) = place;
    let parts = disparity.chunks(COLUMNS).zip(weights.chunks(COLUMNS));
    for ((disparity, weights), (part, means)) in parts.zip(means.chunks_mut(COLUMNS / TILE).enumerate()) {
        let mut shares = [[0.0; COLUMNS]; 2];
        let [agreeing, all] = &mut shares;
        for (i, (disparity, weight)) in disparity.iter().zip(weights).enumerate() {
            let agrees = (disparity - surface.disparity(y, first + part * COLUMNS + i)).abs() < 1.0;
            let share = if *weight > 0.0 { weight / (TILE * TILE) as f32 } else { 0.0 };
            (agreeing[i], all[i]) = (if agrees { share } else { 0.0 }, share);
        }

        for (of, shares) in shares.iter().enumerate() {
            for (mean, shares) in means.iter_mut().zip(shares.as_chunks::<TILE>().0) {
                for share in shares {
                    mean[of] += share;
                }
            }
        }
    }
}

/// Writes the confidences of the drawn pixels of a row, and 0 for the others. The row begins at `place`.
/// `known`: disparities, their own confidences, the mean ones around, and the probabilities of the plane.
#[leveled]
fn draw_row(
    level: Level,
    surface: Surface,
    place: (usize, usize),
    known: [&[f32]; 4],
    inside: &[bool],
    least: f32,
    drawn: &mut [f32],
) {
    let (y, first) = place;
    let count = drawn.len();
    let [disparity, own, around, chances] = known.map(|values| &values[..count]);
    let inside = &inside[..count];

    for i in 0..count {
        let plane = surface.disparity(y, first + i);
        // A thin object may be sure by itself amid doubt.
        let sure = around[i].max(own[i]);
        let is_better = inside[i] & (sure < TRUST) & (chances[i] > sure) & (plane >= least);
        let is_drawn = is_better & ((disparity[i] - plane).abs() > LEAST_CHANGE);
        drawn[i] = if is_drawn { chances[i] } else { 0.0 };
    }
}

impl Surface {
    /// The disparity of a pixel.
    #[inline(always)]
    fn disparity(&self, y: usize, x: usize) -> f32 {
        self.at([x as u32, y as u32].map(f64::from)) as f32
    }

    #[inline(always)]
    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        x * self.slopes[0] + y * self.slopes[1] + self.height
    }

    #[inline(always)]
    fn is_near(&self, [x, y, disparity]: PlanePixel) -> bool {
        (disparity - self.at([x, y])).abs() < NEAR
    }

    /// The plane that most samples are near, fitted to these.
    fn of_samples(samples: &[PlanePixel], level: Level) -> Option<Self> {
        if samples.is_empty() {
            return None;
        }

        let columns = [0, 1, 2].map(|i| samples.iter().map(|sample| sample[i]).collect::<Vec<_>>());
        let mut random = Random(1);
        let (mut best, mut most) = (None, 0);
        for _ in 0..TRIALS {
            let three = [(); 3].map(|()| samples[random.below(samples.len())]);
            let Some(surface) = Self::through(three) else { continue };

            let count = count_near(level, surface, &columns, most);
            if count > most {
                (best, most) = (Some(surface), count);
            }
        }

        // The near samples change with the plane.
        (0..3).fold(best, |surface, _| surface.map(|surface| surface.fitted(samples).unwrap_or(surface)))
    }

    /// The plane through three samples, unless they are nearly on a line or it is too steep.
    fn through([[x, y, disparity], b, c]: [PlanePixel; 3]) -> Option<Self> {
        let [b, c] = [b, c].map(|other| [other[0] - x, other[1] - y, other[2] - disparity]);
        let span = b[0] * c[1] - b[1] * c[0];
        if span.abs() < LEAST_SPAN {
            return None;
        }

        let slopes = [(b[2] * c[1] - b[1] * c[2]) / span, (b[0] * c[2] - b[2] * c[0]) / span];
        let is_gentle = slopes.iter().zip(STEEPEST).all(|(slope, most)| slope.abs() <= most);
        is_gentle.then(|| Self { slopes, height: disparity - slopes[0] * x - slopes[1] * y })
    }

    /// The least-squares plane of the samples that are near this one.
    fn fitted(&self, samples: &[PlanePixel]) -> Option<Self> {
        let near: Vec<&PlanePixel> = samples.iter().filter(|sample| self.is_near(**sample)).collect();
        let mut sums = [0.0; 3];
        for sample in &near {
            sums.iter_mut().zip(*sample).for_each(|(sum, value)| *sum += value);
        }
        let [x, y, disparity] = sums.map(|sum| sum / near.len() as f64);

        // Relative to the mean, the slopes have two equations without the height.
        let [mut xx, mut xy, mut yy, mut xd, mut yd] = [0.0; 5];
        for sample in near {
            let [x, y, d] = [sample[0] - x, sample[1] - y, sample[2] - disparity];
            xx += x * x;
            xy += x * y;
            yy += y * y;
            xd += x * d;
            yd += y * d;
        }
        let determinant = xx * yy - xy * xy;
        if determinant < 1.0 {
            return None;
        }

        let slopes = [(xd * yy - yd * xy) / determinant, (yd * xx - xd * xy) / determinant];
        Some(Self { slopes, height: disparity - slopes[0] * x - slopes[1] * y })
    }
}

/// Counts the samples near a plane, as long as they may exceed `most`. `columns`: columns, rows and
/// disparities of the samples.
#[leveled]
fn count_near(level: Level, surface: Surface, columns: &[Vec<f64>; 3], most: usize) -> usize {
    let [x, y, disparity] = columns.each_ref().map(|column| column.chunks(COUNTED));
    let (mut count, mut rest) = (0, columns[0].len());

    for ((x, y), disparity) in x.zip(y).zip(disparity) {
        let samples = x.iter().zip(y).zip(disparity);
        let near: u64 = samples.map(|((x, y), d)| u64::from(surface.is_near([*x, *y, *d]))).sum();
        count += near as usize;
        rest -= x.len();
        if count + rest <= most {
            break;
        }
    }

    count
}

/// Random numbers, the same in every run.
struct Random(u64);

impl Random {
    /// A number below `count`. Knuth, MMIX.
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % count
    }
}

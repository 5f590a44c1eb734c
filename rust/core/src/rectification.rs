//! Rectification of a raw pair from its images alone: it finds the cameras that align the rows of both.
//!
//! 1. Corners of both images are described by codes and matched ([`corners`], [`codes`], [`mod@matches`]).
//! 2. Matches that agree on one viewing direction of the cameras are kept ([`consensus`]); if few do, one
//!    image is tried turned.
//! 3. Fourteen numbers that describe two cameras are fitted to them ([`cameras`], [`fit`]). If a pair is to
//!    be rectified only when needed, the cameras must explain the rows of these corners better than equal
//!    rows do, by evidence.
//! 4. Both images are rectified by these cameras, and blocks of them are correlated ([`blocks`]), which are
//!    more exact than corners; the numbers are fitted again. This step is repeated until they are stable.
//! 5. The rectified images are moved so that objects stay about where they were, and so that disparities are
//!    positive.
//!
//! If too little of a pair agrees, it is not rectified: a wrong rectification is worse than none. Several
//! pairs of the same cameras are matched separately and fitted together. Everything is computed in a fixed
//! order.

pub mod axis;
pub mod blocks;
pub mod calibration;
pub mod cameras;
pub mod codes;
pub mod consensus;
pub mod corners;
pub mod filters;
pub mod fit;
pub mod matches;
pub mod raw_pair;
#[cfg(test)]
pub mod scene;
pub mod warp;

use std::fmt;
use std::sync::OnceLock;

use serde::{Deserialize, Serialize};

use self::axis::Axis;
use self::blocks::Block;
use self::cameras::{Cameras, NUMBERS, Point};
use self::codes::Features;
use self::fit::Steps;
use self::matches::CornerMatch;
use crate::estimation::facts::{INDEPENDENT, SUFFICIENT, evidence};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::linear::{Cholesky, Normal};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::both;
use phasestereo_match::base::statistics::{deviation, median, quantile};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;

/// Wider images are reduced: their rows are determined as exactly as with this many columns.
const MOST_COLUMNS: usize = 1600;

/// Fewest corners of an image; fewest matches that agree, and as a share of all.
const LEAST_CORNERS: usize = 72;
const LEAST_AGREEING: (usize, f64) = (45, 0.30);
/// With this many agreeing matches, and this share of all, no image is tried turned.
const ENOUGH: (usize, f64) = (60, 0.5);
/// Angles by which the right image is tried turned, degrees.
const TURNS: [f64; 2] = [24.0, -24.0];
/// Fewest blocks to fit to, and fewest of a result.
const LEAST_BLOCKS: (usize, usize) = (40, 60);
/// At this spread or more, cameras other than those that explain the corners best are tried, too; pixels, and
/// share of the width.
const DOUBTFUL: (f64, f64) = (0.25, 0.00025);
/// Most rounds of blocks; the share of their spread by which the last round may move them: the selection of
/// blocks alone moves them by .1 to .2 of it. With .1 px instead, pairs turned by 15 degrees have .8 points
/// more errors.
const ROUNDS: usize = 8;
const STILL: f64 = 0.2;
/// Matches agree if their rows are at most this many spreads apart, or this share of the width.
const AGREE: (f64, f64) = (4.0, 0.003);
/// Largest share of blocks where the distortion folds the image.
const FOLDED: f64 = 0.05;
/// Largest spread of the rows of blocks, pixels of an image of up to 1000 columns, and as a share of wider
/// ones.
const SPREAD: (f64, f64) = (1.5, 0.0015);
/// Disparities separated from others by this share of the width are mistakes, if they are fewer than this
/// share of all.
const APART: (f64, f64) = (0.03, 0.05);
/// The errors of rows are evaluated at this many places along each side of the image, at these shares of the
/// disparities; the part of them that averaging cannot remove, pixels; and the largest that is accepted,
/// pixels of an image of up to 1000 columns.
const PLACES: usize = 16;
const ENDS: [f64; 3] = [0.02, 0.5, 0.98];
const BIAS: f64 = 0.03;
const LARGEST_ERROR: f64 = 1.0;
/// The share of disparities that lie below the smallest one that counts. Negative ones beyond this share of
/// the width are made positive, and begin at another.
const LEAST_SHARE: f64 = 0.01;
const NEGATIVE: (f64, f64) = (0.01, 0.02);

/// The longest focal length of toed-in cameras, in widths of the image.
const LONGEST: f64 = 1.5;
/// The term of rows, `x y`, of a camera that is turned toward the other.
pub const TWIST: usize = 3;

/// The treatment of negative disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Negative {
    /// They stay.
    Kept,
    /// Columns are moved so that they are positive, if the cameras are toed in; for exchanged images they
    /// stay.
    MovedIfToedIn,
    /// Columns are moved so that they are positive.
    Moved,
}

/// The purpose of a rectification.
#[derive(Debug, Clone, Copy)]
pub struct Aim {
    /// The treatment of negative disparities.
    pub negative: Negative,
    /// Whether a pair is left alone if its corners do not show that its rows differ.
    pub is_only_if_needed: bool,
}

impl Aim {
    /// An explicitly requested rectification.
    const ASKED: Self = Self { negative: Negative::MovedIfToedIn, is_only_if_needed: false };
}

/// A pair that was rectified.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Rectification {
    /// The cameras, including the shifts of the rectified images.
    pub cameras: Cameras,
    /// Numbers of matched corners, and of those that agree.
    pub matches: [usize; 2],
    /// Blocks that the last fit uses.
    pub blocks: usize,
    /// The row differences of these blocks in the raw images, rms in pixels.
    pub rows: f64,
    /// The same in the rectified images.
    pub rms: f64,
    /// The uncertainty of the rows that the blocks leave, rms in pixels over the area that both images show.
    pub error: f64,
    /// The disparities of the rectified images: nearly the smallest, the median and nearly the largest.
    pub disparities: [f64; 3],
    /// How many pairs were used.
    pub pairs: usize,
    /// Whether the right images had to be inverted.
    pub is_inverted: bool,
    /// The columns by which the right image was moved so that disparities are positive.
    pub moved: f64,
    /// How many pixels each lens moves a point at half the width from the middle, outward, and the standard
    /// error.
    pub distortion: [(f64, f64); 2],
}

/// Why a pair is not rectified.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Refusal {
    /// Too few corners: left and right.
    Corners([usize; 2]),
    /// Too few matched corners agree: those that agree, and all.
    Matches([usize; 2]),
    /// Rows of corners correspond about as well without cameras.
    NotNeeded,
    /// Disparities are along lines other than rows.
    Axis(Axis),
    /// Too few blocks are found in both rectified images.
    Blocks(usize),
    /// The best-fitting lenses would show some things twice.
    Folds,
    /// Rows remain apart by this many pixels.
    Rows(f64),
    /// Rows would be uncertain by this many pixels.
    Uncertain(f64),
    /// The budget leaves no time to find out.
    Late,
}

impl fmt::Display for Refusal {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Corners([left, right]) => {
                write!(to, "they have only {left} and {right} corners that could be compared")
            }
            Self::Matches([agreeing, all]) => {
                write!(to, "only {agreeing} of {all} corners that look alike agree on how the cameras look")
            }
            Self::NotNeeded => write!(to, "rows correspond about as well as they are"),
            Self::Axis(Axis { angle, ratio }) => write!(
                to,
                "by their distance, things move along lines at {angle:.0} degrees to the rows ({ratio:.1} times as much as \
                 across them)"
            ),
            Self::Blocks(found) => write!(to, "only {found} blocks of one are found in the other"),
            Self::Folds => write!(to, "the lenses that fit best would show some things twice"),
            Self::Rows(spread) => write!(to, "rows would still be {spread:.1} px apart"),
            Self::Late => write!(to, "the budget left no time for it"),
            Self::Uncertain(error) => write!(to, "they determine rows to {error:.1} px only"),
        }
    }
}

/// The gray images of pairs: left and right.
pub type Grays = [Plane<f32>; 2];

/// Rectifies pairs of views from the same cameras; the right ones may be negatives.
pub fn rectify_views(pairs: &[Pair], runtime: Runtime) -> Result<Rectification> {
    let mut grays = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let [left, right] = pair.views();
        grays.push([gray(left, runtime.control)?, gray(right, runtime.control)?]);
    }

    let refusal = match rectify(&grays, 1, Aim::ASKED, runtime)? {
        Ok(found) => return Ok(found),
        Err(refusal) => refusal,
    };
    if matches!(refusal, Refusal::Matches(_)) {
        for [_, right] in &mut grays {
            *right = right.map(|value| -value);
        }
        if let Ok(found) = rectify(&grays, 1, Aim::ASKED, runtime)? {
            return Ok(Rectification { is_inverted: true, ..found });
        }
    }

    let got = format!("images that do not show how to rectify them: {refusal}");
    let accepts = "two views of one scene, taken side by side; more pairs of the same cameras (others) help, and a \
                   calibration all";
    Err(Error::value("left, right", got, accepts))
}

/// The gray values of a view, in units of its pixels.
pub fn gray(view: &View, control: &Control) -> Result<Plane<f32>> {
    let scale = view.scale();
    Plane::by_rows(view.size(), control, |y, row: &mut [f32]| {
        for (gray, steps) in row.iter_mut().zip(view.gray().row(y)) {
            *gray = scale.pixel(f64::from(*steps)) as f32;
        }
    })
}

/// Rectifies pairs of gray images from the same cameras, all of one size, which are reduced at least by
/// `least`.
pub fn rectify(
    pairs: &[Grays],
    least: usize,
    aim: Aim,
    runtime: Runtime,
) -> Result<std::result::Result<Rectification, Refusal>> {
    let (rows, cols) = pairs[0][0].size();
    let factor = least * cols.div_ceil(MOST_COLUMNS).max(1);
    let size = (rows / factor, cols / factor);

    let mut reduced = Vec::with_capacity(pairs.len());
    for [left, right] in pairs {
        reduced.push([smaller(left, factor)?, smaller(right, factor)?]);
    }
    let found = rectify_small(&reduced, aim, runtime)?;
    Ok(found.map(|found| found.enlarged(factor, size)).map_err(|refusal| match refusal {
        Refusal::Rows(spread) => Refusal::Rows(spread * factor as f64),
        Refusal::Uncertain(error) => Refusal::Uncertain(error * factor as f64),
        other => other,
    }))
}

/// The axis of the disparities in a pair of gray images; `None`: they do not show it.
pub fn shown_axis([left, right]: &Grays, runtime: Runtime) -> Result<Option<Axis>> {
    let factor = left.cols().div_ceil(MOST_COLUMNS).max(1);
    let pair = [smaller(left, factor)?, smaller(right, factor)?];
    let (size, [left, right]) = (pair[0].size(), both(|side| Features::new(&pair[side], runtime))?);
    let codes = [left.codes(0.0, runtime.level()), right.codes(0.0, runtime.level())];
    let found = matches::matched([&left, &right], [&codes[0], &codes[1]], size.1, runtime.level());
    Ok(axis::axis(&found, size))
}

/// A gray image reduced by a factor.
fn smaller(image: &Plane<f32>, factor: usize) -> Result<Plane<f32>> {
    let image = filters::stretched(image);
    if factor == 1 {
        return Ok(image);
    }
    let size = (image.rows() / factor, image.cols() / factor);
    filters::reduced(&filters::cropped(&image, factor)?, size)
}

fn rectify_small(
    pairs: &[Grays],
    aim: Aim,
    runtime: Runtime,
) -> Result<std::result::Result<Rectification, Refusal>> {
    let size = pairs[0][0].size();
    let (mut views, mut agreeing, mut refusal) = (vec![], vec![], None);
    for pair in pairs {
        match matched(pair, runtime)? {
            Ok((matches, agree)) => {
                views.push(Views { pair: pair.each_ref(), matches });
                agreeing.extend(agree);
            }
            Err(why) => refusal = refusal.or(Some(why)),
        }
    }
    if let (true, Some(refusal)) = (views.is_empty(), refusal) {
        return Ok(Err(refusal));
    }

    let all: Vec<CornerMatch> = views.iter().flat_map(|views| &views.matches).copied().collect();
    let counts = [all.len(), agreeing.iter().filter(|is_in| **is_in).count()];

    let starts = fit::fitted(&all, &agreeing, size);
    if aim.is_only_if_needed && !is_needed(&all, &agreeing, &starts) {
        return Ok(Err(Refusal::NotNeeded));
    }

    let found = refined(&views, starts, runtime)?;
    if found.blocks.len() < LEAST_BLOCKS.1 {
        return Ok(Err(Refusal::Blocks(found.blocks.len())));
    }
    Ok(found.checked(&views, counts, aim.negative))
}

/// Whether some cameras explain the rows of the agreeing corners better than equal rows do.
fn is_needed(all: &[CornerMatch], agreeing: &[bool], cameras: &[(Cameras, f64)]) -> bool {
    let apart = |row: &dyn Fn(&CornerMatch) -> f64| {
        deviation(all.iter().zip(agreeing).filter(|(_, is_in)| **is_in).map(|(one, _)| row(one)))
    };
    let equal = apart(&|one| one.right[1] - one.left[1]);
    cameras.iter().any(|(cameras, _)| {
        let left = apart(&|one| cameras.row_difference([one.left, one.right]));
        evidence(equal, left, NUMBERS, INDEPENDENT) >= SUFFICIENT
    })
}

/// The images of a pair and their matched corners.
struct Views<'a> {
    pair: [&'a Plane<f32>; 2],
    matches: Vec<CornerMatch>,
}

impl Views<'_> {
    /// The matches whose rows are near each other with these cameras.
    fn near(&self, cameras: &Cameras, near: f64) -> Vec<CornerMatch> {
        let is_near = |one: &&CornerMatch| cameras.row_difference([one.left, one.right]).abs() < near;
        self.matches.iter().filter(is_near).copied().collect()
    }
}

/// Matched corners, and which of them agree.
type Agreement = (Vec<CornerMatch>, Vec<bool>);

/// Matches the corners of a pair, if enough of them agree.
fn matched(pair: &[Plane<f32>; 2], runtime: Runtime) -> Result<std::result::Result<Agreement, Refusal>> {
    let cols = pair[0].cols();
    let [left, right] = both(|side| Features::new(&pair[side], runtime))?;
    let corners = [left.places.len(), right.places.len()];
    if corners.iter().any(|count| *count < LEAST_CORNERS) {
        return Ok(Err(Refusal::Corners(corners)));
    }

    let codes = left.codes(0.0, runtime.level());
    let turned = |turn: f64| {
        let others = right.codes(turn.to_radians(), runtime.level());
        let found = matches::matched([&left, &right], [&codes, &others], cols, runtime.level());
        let agree = consensus::agreeing(&found, cols);
        (agree.iter().filter(|is_in| **is_in).count(), found, agree)
    };

    let mut best = turned(0.0);
    let shown = axis::axis(&best.1, pair[0].size());
    if let Some(axis) = shown.filter(|axis| !axis.is_along_rows()) {
        return Ok(Err(Refusal::Axis(axis)));
    }
    if best.0 < ENOUGH.0 || (best.0 as f64) <= ENOUGH.1 * best.1.len() as f64 {
        for turn in TURNS {
            let other = turned(turn);
            if other.0 > best.0 {
                best = other;
            }
        }
    }

    let (count, found, agree) = best;
    if count < LEAST_AGREEING.0 || (count as f64) < LEAST_AGREEING.1 * found.len() as f64 {
        return Ok(Err(Refusal::Matches([count, found.len()])));
    }
    Ok(Ok((found, agree)))
}

/// Cameras that blocks were fitted to.
struct Refined {
    cameras: Cameras,
    /// Corners agree if their rows are at most this far apart.
    near: f64,
    /// The blocks of the last round.
    blocks: Vec<Block>,
    /// The weight of each, 0 for mistakes.
    weights: Vec<f64>,
    /// The last fit; `None`: there were too few blocks.
    fit: Option<fit::CameraFit>,
    /// How far the last fit moved its blocks in rows, rms.
    change: f64,
}

/// Fits cameras to blocks repeatedly until they are stable. The first few that corners agree with find
/// blocks; the cameras that are most probable by these continue.
fn refined(views: &[Views], starts: [(Cameras, f64); 3], runtime: Runtime) -> Result<Refined> {
    let doubtful = DOUBTFUL.0.max(DOUBTFUL.1 * starts[0].0.size().1 as f64);
    let [(cameras, near), others @ ..] = starts;
    let mut blocks = found(views, &cameras, near, runtime)?;
    let mut best = Refined::new(views, cameras, near, blocks.clone());
    let mut is_sure = best.is_sure(doubtful);
    for (cameras, near) in others {
        if is_sure {
            break;
        }
        if blocks.len() < LEAST_BLOCKS.0 {
            blocks = found(views, &cameras, near, runtime)?;
        }
        let other = Refined::new(views, cameras, near, blocks.clone());
        is_sure = other.is_sure(doubtful);
        if other.improbability() <= best.improbability() {
            best = other;
        }
    }

    for _ in 1..ROUNDS {
        if best.fit.as_ref().is_none_or(|fit| best.change < STILL * fit.spread) {
            break;
        }
        let blocks = found(views, &best.cameras, best.near, runtime)?;
        best = Refined::new(views, best.cameras, best.near, blocks);
    }
    Ok(best)
}

/// The blocks found in the images that these cameras rectify, guided by corners with rows at most `near`
/// apart.
fn found(views: &[Views], cameras: &Cameras, near: f64, runtime: Runtime) -> Result<Vec<Block>> {
    let mut found = vec![];
    for views in views {
        runtime.control.checkpoint()?;
        found.extend(blocks::blocks(views.pair, cameras, &views.near(cameras, near), runtime.level())?);
    }
    Ok(found)
}

impl Refined {
    /// Cameras refitted to blocks that they have found, and to corners within `near`.
    fn new(views: &[Views], before: Cameras, near: f64, blocks: Vec<Block>) -> Self {
        let count = blocks.len();
        if count < LEAST_BLOCKS.0 {
            return Self { cameras: before, near, blocks, weights: vec![], fit: None, change: f64::INFINITY };
        }

        // Blocks alone, then with the corners, weighted down by how much more their rows spread.
        let corners: Vec<CornerMatch> = views.iter().flat_map(|views| views.near(&before, near)).collect();
        let mut places: Vec<CornerMatch> = blocks.iter().map(|block| block.places).collect();
        let mut weights: Vec<f64> = blocks.iter().map(|block| block.weight).collect();
        let alone = fit::fit(&places, &weights, &before, Steps(15, 3));

        let rows = |cameras: &Cameras, one: &CornerMatch| cameras.row_difference([one.left, one.right]);
        let spread = deviation(corners.iter().map(|one| rows(&alone.cameras, one))) + 0.05;
        places.extend(&corners);
        weights.resize(places.len(), (alone.spread / spread).powi(2).min(1.0));
        let both = fit::fit(&places, &weights, &alone.cameras, Steps(10, 0));

        let moved = |one: &CornerMatch| rows(&both.cameras, one) - rows(&before, one);
        Self {
            change: rms(places[..count].iter().map(moved)),
            near: (AGREE.0 * spread).max(AGREE.1 * before.size().1 as f64),
            cameras: both.cameras.clone(),
            weights: both.weights[..count].to_vec(),
            blocks,
            fit: Some(both),
        }
    }

    /// Whether the rows of blocks are too close for other cameras to be tried.
    fn is_sure(&self, doubtful: f64) -> bool {
        self.fit.as_ref().is_some_and(|fit| fit.spread < doubtful)
    }

    /// How improbable the cameras are by the blocks.
    fn improbability(&self) -> f64 {
        self.fit.as_ref().map_or(f64::INFINITY, fit::CameraFit::improbability)
    }

    /// The result; a [`Refusal`] if it is not credible.
    fn checked(
        self,
        views: &[Views],
        matches: [usize; 2],
        negative: Negative,
    ) -> std::result::Result<Rectification, Refusal> {
        if self.is_folded() {
            return Err(Refusal::Folds);
        }

        let good = self.agreeing();
        let Self { mut cameras, near, fit, .. } = self;
        let corners = views.iter().flat_map(|views| views.near(&cameras, near));
        let corners: Vec<CornerMatch> = corners.collect();
        let size = cameras.size();
        let cols = size.1 as f64;
        let vertical = good.iter().map(|one| cameras.row_difference([one.left, one.right]));
        let vertical: Vec<f64> = vertical.collect();
        let spread = deviation(vertical.iter().copied());
        if good.is_empty() || spread > SPREAD.0.max(SPREAD.1 * cols) {
            return Err(Refusal::Rows(spread));
        }

        cameras.shifts = shifts(&cameras, &good);
        let mut found = disparities(&cameras, good.iter().chain(&corners), cols);
        let mut found = |share: f64| quantile(&mut found, share).unwrap_or(0.0);
        let moved = negative.moved(&good, size, &mut found);
        cameras.shifts[1][0] -= moved;
        let disparities = ENDS.map(|share| found(share) + moved);

        let factor = fit.and_then(|fit| fit.normal.factor());
        let error = error(&cameras, size, disparities, factor.as_ref());
        if error > LARGEST_ERROR.max(LARGEST_ERROR * cols / 1000.0) {
            return Err(Refusal::Uncertain(error));
        }

        let raw = good.iter().map(|one| one.right[1] - one.left[1]);
        let distortion = [0, 1].map(|side| {
            let (moved, slope) = cameras.distortion(side);
            (moved, factor.map_or(f64::INFINITY, |factor| factor.variance(slope).sqrt()))
        });
        Ok(Rectification {
            matches,
            blocks: good.len(),
            rows: rms(raw),
            rms: rms(vertical.into_iter()),
            error,
            disparities,
            pairs: views.len(),
            is_inverted: false,
            moved,
            distortion,
            cameras,
        })
    }

    /// Whether the distortion folds the image at many blocks.
    fn is_folded(&self) -> bool {
        let is_folded = |block: &&Block| {
            let CornerMatch { left, right } = block.places;
            self.cameras.is_folded(left, 0) || self.cameras.is_folded(right, 1)
        };
        let folded = self.blocks.iter().filter(is_folded).count();
        folded as f64 > FOLDED * self.blocks.len() as f64
    }

    /// The blocks that agree with the cameras.
    fn agreeing(&self) -> Vec<CornerMatch> {
        let blocks = self.blocks.iter().zip(&self.weights);
        blocks.filter(|(_, weight)| **weight > 0.0).map(|(block, _)| block.places).collect()
    }
}

impl Negative {
    /// The columns by which the right image is moved so that disparities, whose quantiles are found, become
    /// positive.
    fn moved(self, good: &[CornerMatch], size: (usize, usize), found: &mut impl FnMut(f64) -> f64) -> f64 {
        let (cols, least) = (size.1 as f64, found(LEAST_SHARE));
        let is_moved = match self {
            Self::Kept => false,
            Self::MovedIfToedIn => found(0.5) < 0.0 && is_toed_in(good, size, least),
            Self::Moved => true,
        };
        let is_negative = least < -NEGATIVE.0 * cols;
        if is_moved && is_negative { (NEGATIVE.1 * cols - least).ceil() } else { 0.0 }
    }
}

impl Rectification {
    /// The same for images that are larger by this factor.
    fn enlarged(self, factor: usize, (rows, cols): (usize, usize)) -> Self {
        let times = factor as f64;
        Self {
            cameras: self.cameras.resized((rows * factor, cols * factor)),
            rows: self.rows * times,
            rms: self.rms * times,
            error: self.error * times,
            disparities: self.disparities.map(|disparity| disparity * times),
            moved: self.moved * times,
            distortion: self.distortion.map(|(moved, error)| (moved * times, error * times)),
            ..self
        }
    }
}

/// The root mean square of some values.
fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

/// The uncertainty of rows by the covariance of the numbers, rms over the area that both images show at these
/// disparities.
fn error(
    cameras: &Cameras,
    (rows, cols): (usize, usize),
    disparities: [f64; 3],
    factor: Option<&Cholesky<NUMBERS>>,
) -> f64 {
    let Some(factor) = factor else { return f64::INFINITY };
    let is_inside = |place: &Point| {
        (0.0..=(cols - 1) as f64).contains(&place[0]) && (0.0..=(rows - 1) as f64).contains(&place[1])
    };
    let along = |index: usize, count: usize| index as f64 * (count - 1) as f64 / (PLACES - 1) as f64;

    let mut variances = vec![];
    for index in 0..PLACES * PLACES {
        let [x, y] = [along(index % PLACES, cols), along(index / PLACES, rows)];
        for disparity in disparities {
            let raw = [cameras.raw([x, y], 0), cameras.raw([x - disparity, y], 1)];
            let [Some(left), Some(right)] = raw.map(|place| place.filter(is_inside)) else {
                continue;
            };
            let (_, slope) = cameras.row_derivatives([left, right]);
            variances.push(factor.variance(slope));
        }
    }
    math::hypot((variances.iter().sum::<f64>() / variances.len() as f64).sqrt(), BIAS)
}

/// The smallest [`TWIST`] of the rows of cameras turned toward each other far enough to cause these
/// disparities. A camera of focal length `f` that is turned moves columns by `s` and, at `(x, y)` from its
/// center, rows by `s x y / f^2`; exchanged images leave rows alone.
pub fn least_twist(disparity: f64, (rows, cols): (usize, usize)) -> f64 {
    -disparity * rows as f64 / (4.0 * LONGEST.powi(2) * cols as f64)
}

/// Whether rows of raw images are bent like those of cameras turned toward each other far enough to cause
/// these disparities.
fn is_toed_in(blocks: &[CornerMatch], (rows, cols): (usize, usize), least: f64) -> bool {
    const TERMS: usize = 6;
    let mut normal = Normal::<TERMS>::held([1e-9; TERMS]);
    for CornerMatch { left, right } in blocks {
        let x = 2.0 * right[0] / (cols - 1) as f64 - 1.0;
        let y = 2.0 * left[1] / (rows - 1) as f64 - 1.0;
        normal.add(&[1.0, x, y, x * y, x * x, y * y], right[1] - left[1], 1.0);
    }

    normal.solved().is_some_and(|terms| terms[TWIST] >= least_twist(least, (rows, cols)))
}

/// The shifts that keep things where they were, at the median. Rows are moved equally; columns separately,
/// since rows hardly determine a shift of all disparities, as from toed-in cameras.
fn shifts(cameras: &Cameras, blocks: &[CornerMatch]) -> [Point; 2] {
    let moved = |one: &CornerMatch, side: usize, axis: usize| {
        let raw = [one.left, one.right][side];
        raw[axis] - cameras.rectified(raw, side)[axis]
    };
    let typical = |of: &dyn Fn(&CornerMatch) -> f64| median(blocks.iter().map(of)).unwrap_or(0.0);

    let rows = typical(&|one| moved(one, 0, 1) + moved(one, 1, 1)) / 2.0;
    [0, 1].map(|side| [typical(&|one| moved(one, side, 0)), rows])
}

/// The disparities of matches, without clusters that are small and far from others.
fn disparities<'a>(cameras: &Cameras, matches: impl Iterator<Item = &'a CornerMatch>, cols: f64) -> Vec<f64> {
    let disparity =
        |one: &CornerMatch| cameras.rectified(one.left, 0)[0] - cameras.rectified(one.right, 1)[0];
    let mut all: Vec<f64> = matches.map(disparity).collect();
    all.sort_by(f64::total_cmp);

    let clusters = all.chunk_by(|one, next| next - one <= APART.0 * cols);
    let large = clusters.filter(|cluster| cluster.len() as f64 >= APART.1 * all.len() as f64);
    let kept: Vec<f64> = large.flatten().copied().collect();
    if kept.is_empty() { all } else { kept }
}

/// The cameras of raw images of one size.
#[derive(Debug, Serialize, Deserialize)]
pub struct Raw {
    /// The cameras.
    pub rectification: Rectification,
    /// Rows and columns of the raw images.
    pub size: (usize, usize),
    /// The place of each rectified pixel in the raw images, once a match has needed it.
    #[serde(skip)]
    places: OnceLock<[warp::Places; 2]>,
}

impl Raw {
    /// Cameras of raw images of this size, rows and columns. No place has been computed yet.
    pub fn new(rectification: Rectification, size: (usize, usize)) -> Self {
        Self { rectification, size, places: OnceLock::new() }
    }

    /// The place of each rectified pixel in the raw left and right image. The first call computes it on the
    /// threads of the current pool.
    pub fn places(&self, control: &Control) -> Result<&[warp::Places; 2]> {
        if let Some(places) = self.places.get() {
            return Ok(places);
        }
        let places = |side| warp::places(&self.rectification.cameras, side, self.size, control);
        let places = [places(0)?, places(1)?];
        Ok(self.places.get_or_init(|| places))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rectification::cameras::USUAL;
    use crate::testing::{levels, on_a_thread};
    use phasestereo_match::base::simd::Level;

    const SIZE: (usize, usize) = (300, 400);

    fn found(pair: &Grays, aim: Aim) -> std::result::Result<Rectification, Refusal> {
        let pairs = std::slice::from_ref(pair);
        on_a_thread(Level::best(), |runtime| rectify(pairs, 1, aim, runtime)).expect("memory")
    }

    /// The largest difference of rows, over the image, between points that both cameras see at the same
    /// place.
    fn rows_apart(truth: &Cameras, found: &Cameras) -> f64 {
        let place = |index: usize| [30.0 + 20.0 * (index % 17) as f64, 30.0 + 20.0 * (index / 17) as f64];
        let apart = |index: usize| {
            let [x, y] = place(index);
            let right = [x - scene::disparity(x, y, SIZE.1), y];
            let raw = [truth.raw([x, y], 0), truth.raw(right, 1)];
            match raw {
                [Some(left), Some(right)] => found.row_difference([left, right]).abs(),
                _ => 0.0,
            }
        };
        (0..17 * 12).map(apart).fold(0.0, f64::max)
    }

    #[test]
    fn turned_tilted_and_bent_cameras_are_found() {
        let turned = [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 1.0, 0.0, -2.0];
        let mut bent = [0.0; NUMBERS];
        bent[cameras::K1] = -1.0;
        for numbers in [turned, bent] {
            let truth = Cameras::new(numbers, USUAL, SIZE);
            let pair = scene::pair(&truth, SIZE, 1);
            let found = found(&pair, Aim::ASKED).expect("a pair");
            assert!(found.rms < 0.3 && found.rows > 0.4, "{} {}", found.rms, found.rows);
            let apart = rows_apart(&truth, &found.cameras);
            assert!(apart < 0.8, "{apart}");
        }
    }

    #[test]
    fn disparities_are_made_positive_if_that_is_asked_for() {
        let truth = Cameras::new([0.0; NUMBERS], USUAL, SIZE);
        let [left, right] = scene::pair(&truth, SIZE, 2);
        let pair = [right, left];
        let swapped =
            |negative: Negative| found(&pair, Aim { negative, ..Aim::ASKED }).expect("a pair").moved;
        let moved = swapped(Negative::Moved);
        assert!((12.0..40.0).contains(&moved), "{moved}");
        for negative in [Negative::Kept, Negative::MovedIfToedIn] {
            assert!(swapped(negative).abs() < 1e-12, "{negative:?}");
        }
    }

    #[test]
    fn a_pair_is_left_alone_only_if_its_rows_correspond() {
        let aim = Aim { is_only_if_needed: true, ..Aim::ASKED };
        let pair = |turn: f64| {
            let mut numbers = [0.0; NUMBERS];
            numbers[13] = turn;
            scene::pair(&Cameras::new(numbers, USUAL, SIZE), SIZE, 6)
        };
        assert_eq!(found(&pair(0.0), aim).err(), Some(Refusal::NotNeeded));
        let turned = found(&pair(-2.0), aim).expect("a pair");
        assert!(turned.rows > 3.0 * turned.rms, "{} {}", turned.rows, turned.rms);
    }

    #[test]
    fn what_is_not_a_pair_is_refused() {
        let found = |pair: &Grays| found(pair, Aim::ASKED);
        let truth = Cameras::new([0.0; NUMBERS], USUAL, SIZE);
        let [left, _] = scene::pair(&truth, SIZE, 3);
        let [other, _] = scene::pair(&truth, SIZE, 4);
        let flat = left.map(|_| 7.0);
        assert!(matches!(found(&[left.clone(), other]), Err(Refusal::Matches(_))));
        assert_eq!(found(&[left, flat.clone()]).err().map(|why| why.to_string().len() > 20), Some(true));
        assert!(matches!(found(&[flat.clone(), flat.map(|_| f32::NAN)]), Err(Refusal::Corners([0, 0]))));
        let tiny = Plane::from_fn(2, 3, |y, x| (x + y) as f32);
        assert!(found(&[tiny.clone(), tiny]).is_err());
    }

    #[test]
    fn threads_and_instructions_do_not_change_a_bit() {
        let mut numbers = [0.0; NUMBERS];
        numbers[13] = 1.0;
        let pair = scene::pair(&Cameras::new(numbers, USUAL, SIZE), SIZE, 5);
        let first = found(&pair, Aim::ASKED).expect("a pair").cameras;

        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
        for level in levels() {
            let pairs = std::slice::from_ref(&pair);
            let again = on_a_thread(level, |runtime| {
                pool.install(|| rectify(pairs, 1, Aim::ASKED, runtime)).expect("memory").expect("a pair")
            });
            assert_eq!(again.cameras, first, "{}", level.name());
        }
    }
}

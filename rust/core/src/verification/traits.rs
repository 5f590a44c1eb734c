//! Claims, the own match and the evidence -> traits of each claim, on which the probability depends that it
//! is right.
//!
//! ```text
//! gap       = |own - claim|
//! odds      = ln(p / (1 - p)) of the own confidence; of its means over 9 x 9 and 31 x 31 pixels
//! against   = the evidence against the claim, in mean costs of pixels that have nothing to do with each other
//! claimed   = mean cost of the claims over 5 x 5 and 13 x 13 pixels, in the same unit
//! lower     = claimed - the mean cost of the own disparities, over both windows
//! range     = largest - least value within 3 x 3 and 7 x 7 pixels, of the claims; within 7 x 7 of the own disparities
//! nowhere   = least |own - claim| over the own disparities within 7 x 7 pixels
//! agree     = share of the claims within 9 x 9 and 31 x 31 pixels that are within 1 px of the own disparity
//! texture   = ln(mean difference of horizontal neighbors over 9 x 9 pixels, in that of the whole image)
//! hidden    = 1 if the map has a nearer claim on the same right pixel
//! outside   = 1 if the claim lies outside the right image
//! failed, filled, inferred = 1 if the own disparity has such flags
//! pair      = odds of the mean own confidence, share of the claims that agree, mean cost of the own disparities,
//!             ln(standard deviation of the noise, in the mean difference of neighbors)
//! ```

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::ln;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::texture::Roughness;
use phasestereo_match::image::view::View;
use phasestereo_match::image::window_sums::{Beyond, Windows, window_means};
use phasestereo_match::matcher::Disparity;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::refinement::calibration::FAILED;
use phasestereo_match::refinement::flag;

use crate::verification::evidence::ClaimEvidence;
use crate::verification::hypotheses::right_column;

/// Traits of a claim.
pub const TRAITS: usize = 25;
/// The values of the traits of a pixel.
pub type Values = [f32; TRAITS];

/// Claims that differ by no more from the own disparity agree with it, pixels.
pub const AGREES: f32 = 1.0;
/// Pixels from the center to the side of small and large windows. Not swept, as those below: lines are
/// learned for what they give.
const NEAR: usize = 4;
const FAR: usize = 15;
/// The same of the windows in which ranges are looked for.
const RANGE: usize = 3;
/// Rows that one task works on.
const BAND: usize = 32;
/// Largest gap and range that count, pixels.
const LARGEST: f32 = 20.0;
/// Odds of probabilities are kept within those of this one and of what it lacks to 1.
const LEAST: f32 = 0.003;
/// The part of the mean difference of neighbors that is added before the logarithm is taken.
const LEAST_TEXTURE: f64 = 0.05;

/// What traits are computed from, and planes of some.
#[derive(Debug)]
pub struct Traits<'a> {
    map: &'a Plane<f32>,
    own: &'a Disparity,
    evidence: &'a ClaimEvidence,
    /// The mean cost of pixels that have nothing to do with each other, bits.
    unrelated: f32,
    /// Mean own confidences over small and large windows.
    sure: [Plane<f32>; 2],
    /// Shares of the claims that agree, over the same windows.
    agree: [Plane<f32>; 2],
    texture: Plane<f32>,
    /// Those of the whole pair.
    pair: [f32; 4],
}

/// A map and all that it is judged by.
#[derive(Debug, Clone, Copy)]
pub struct Judged<'a> {
    /// The claims; what is not finite claims nothing.
    pub map: &'a Plane<f32>,
    /// The own match, with confidences.
    pub own: &'a Disparity,
    /// What the costs say.
    pub evidence: &'a ClaimEvidence,
    /// The mean cost of pixels that have nothing to do with each other, bits.
    pub unrelated: f64,
}

impl<'a> Traits<'a> {
    /// The traits of the claims of a map, on the threads of the current pool.
    pub fn new(judged: Judged<'a>, pair: &Pair, level: Level, control: &Control) -> Result<Self> {
        let Judged { map, own, evidence, unrelated } = judged;
        let size = (map.rows(), map.cols());
        let confidence = |y: usize| (0..size.1).map(move |x| confidence(own, y, x));
        let sure = [
            window_means(size, NEAR, confidence, level)?,
            window_means(size, FAR, confidence, level)?,
        ];

        let near = Plane::by_rows(size, control, |y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let claim = map.row(y)[x];
                let is_near = (own.disparity.row(y)[x] - claim).abs() <= AGREES;
                *out = [u32::from(is_near), u32::from(claim.is_finite())];
            }
        })?;
        let agree = |radius| -> Result<Plane<f32>> {
            let windows = Windows { size, radius, beyond: Beyond::Nothing };
            Plane::by_bands(size, BAND, |first, band| {
                control.checkpoint()?;
                let values = |y: usize| near.row(y).iter().copied();
                windows.write((first, band), values, |_, _, sums| share(sums), level)
            })
        };

        let [left, _] = pair.views();
        let roughness = Roughness::of_rows(left.gray().as_slice(), size.1).mean();
        let noise = pair.blur_compensation().map_or([0.0; 2], BlurCompensation::noise);
        let noise = in_roughness(left.scale().steps(noise[0].max(noise[1])), roughness);
        let [sure_pair, agree_pair, cost] = pair_traits(own, &near, evidence, unrelated as f32);
        let pair = [sure_pair, agree_pair, cost, noise];
        let texture = texture(left, roughness, level, control)?;
        let unrelated = unrelated as f32;
        let agree = [agree(NEAR)?, agree(FAR)?];
        Ok(Self { map, own, evidence, unrelated, sure, agree, texture, pair })
    }

    /// The size of the map.
    pub fn size(&self) -> (usize, usize) {
        (self.map.rows(), self.map.cols())
    }

    /// Calls `write(x, traits)` for each pixel of a row that has a claim.
    pub fn of_row(&self, y: usize, mut write: impl FnMut(usize, Values)) {
        let mut nearest = vec![f32::NEG_INFINITY; self.map.cols()];
        for (x, claim) in self.map.row(y).iter().enumerate() {
            if let Some(column) = right_column(x, *claim, nearest.len()) {
                nearest[column] = nearest[column].max(*claim);
            }
        }

        for (x, claim) in self.map.row(y).iter().enumerate() {
            if claim.is_finite() {
                write(x, self.of_pixel(y, x, &nearest));
            }
        }
    }

    fn of_pixel(&self, y: usize, x: usize, nearest: &[f32]) -> Values {
        let (claim, own) = (self.map.row(y)[x], self.own.disparity.row(y)[x]);
        let flags = self.own.flags.row(y)[x];
        let of = |wanted: u16| if flags & wanted != 0 { 1.0 } else { 0.0 };
        let gap = if own.is_nan() { LARGEST } else { (own - claim).abs().min(LARGEST) };

        let [few, many] = self.evidence.means.each_ref().map(|means| self.in_unit(means.row(y)[x]));
        let around = self.around(y, x);
        let column = right_column(x, claim, nearest.len());
        let is_hidden = column.is_some_and(|column| nearest[column] > claim + 1.0);
        let [sure, surely] = self.sure.each_ref().map(|means| odds(means.row(y)[x]));
        let [agree, agreed] = self.agree.each_ref().map(|shares| shares.row(y)[x]);
        let [pair_sure, pair_agree, pair_cost, noise] = self.pair;

        [
            gap,
            odds(confidence(self.own, y, x)),
            sure,
            surely,
            self.evidence.against.row(y)[x] / self.unrelated,
            few[0],
            many[0],
            few[0] - few[1],
            many[0] - many[1],
            around.near_range,
            around.range,
            around.own_range,
            around.nowhere,
            agree,
            agreed,
            self.texture.row(y)[x],
            if is_hidden { 1.0 } else { 0.0 },
            if column.is_none() { 1.0 } else { 0.0 },
            of(FAILED),
            of(flag::FILLED),
            of(flag::INFERRED | flag::COARSE),
            pair_sure,
            pair_agree,
            pair_cost,
            noise,
        ]
    }

    /// Mean costs in those of pixels that have nothing to do with each other, as which unknown ones count.
    fn in_unit(&self, means: [f32; 2]) -> [f32; 2] {
        means.map(|cost| if cost.is_nan() { 1.0 } else { cost / self.unrelated })
    }

    /// What claims and own disparities around a pixel are like.
    fn around(&self, y: usize, x: usize) -> AroundClaim {
        let (map, own) = (self.map, &self.own.disparity);
        let columns = x.saturating_sub(RANGE)..(x + RANGE + 1).min(map.cols());
        let claim = map.row(y)[x];

        let (mut low, mut high) = (claim, claim);
        let (mut near_low, mut near_high) = (claim, claim);
        let (mut own_low, mut own_high) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut nowhere = LARGEST;
        for v in y.saturating_sub(RANGE)..(y + RANGE + 1).min(map.rows()) {
            let pixels = map.row(v)[columns.clone()].iter().zip(&own.row(v)[columns.clone()]);
            for (u, (other, own)) in columns.clone().zip(pixels) {
                let other = if other.is_finite() { *other } else { claim };
                (low, high) = (low.min(other), high.max(other));
                if v.abs_diff(y) <= 1 && u.abs_diff(x) <= 1 {
                    (near_low, near_high) = (near_low.min(other), near_high.max(other));
                }
                (own_low, own_high) = (own_low.min(*own), own_high.max(*own));
                nowhere = nowhere.min((own - claim).abs());
            }
        }

        let range = |high: f32, low: f32| (high - low).clamp(0.0, LARGEST);
        AroundClaim {
            near_range: range(near_high, near_low),
            range: range(high, low),
            own_range: range(own_high, own_low),
            nowhere,
        }
    }
}

/// What is around a pixel, pixels.
struct AroundClaim {
    /// Range of the claims within 3 x 3 and 7 x 7 pixels.
    near_range: f32,
    range: f32,
    /// Range of the own disparities within 7 x 7 pixels.
    own_range: f32,
    /// The least difference of an own disparity from the claim.
    nowhere: f32,
}

/// The own confidence of a pixel.
fn confidence(own: &Disparity, y: usize, x: usize) -> f32 {
    own.confidence.as_ref().map_or(0.0, |confidence| confidence.row(y)[x])
}

/// The share of the claims that agree.
fn share([near, claims]: [u32; 2]) -> f32 {
    near as f32 / claims.max(1) as f32
}

/// The logarithm of the odds of a probability.
pub fn odds(probability: f32) -> f32 {
    let probability = f64::from(probability.clamp(LEAST, 1.0 - LEAST));
    ln(probability / (1.0 - probability)) as f32
}

/// The traits of the whole pair: sums in reading order.
fn pair_traits(
    own: &Disparity,
    near: &Plane<[u32; 2]>,
    evidence: &ClaimEvidence,
    unrelated: f32,
) -> [f32; 3] {
    let own_confidences = own.confidence.as_ref().map_or(&[][..], Plane::as_slice);
    let sum: f64 = own_confidences.iter().copied().map(f64::from).sum();
    let sure = sum / own_confidences.len().max(1) as f64;

    let [agree, claims] =
        near.as_slice().iter().fold([0u64; 2], |[agree, claims], [near, claim]| {
            [agree + u64::from(*near), claims + u64::from(*claim)]
        });

    let (mut cost, mut known) = (0.0, 0u64);
    for [_, own] in evidence.means[0].as_slice().iter().filter(|means| !means[1].is_nan()) {
        cost += f64::from(*own);
        known += 1;
    }
    let cost = if known > 0 { (cost / known as f64) as f32 / unrelated } else { 1.0 };

    [odds(sure as f32), (agree as f64 / claims.max(1) as f64) as f32, cost]
}

/// The logarithm of a difference of gray values, in the mean one of neighbors.
fn in_roughness(difference: f64, roughness: f64) -> f32 {
    ln(LEAST_TEXTURE + if roughness > 0.0 { difference / roughness } else { 0.0 }) as f32
}

/// The texture around each pixel.
fn texture(left: &View, roughness: f64, level: Level, control: &Control) -> Result<Plane<f32>> {
    let (gray, size) = (left.gray(), left.size());
    let windows = Windows { size, radius: NEAR, beyond: Beyond::Nothing };

    Plane::by_bands(size, BAND, |first, band| {
        control.checkpoint()?;
        let values = |y: usize| {
            let row = gray.row(y);
            (0..size.1).map(move |x| [u64::from(row[x].abs_diff(row[x.saturating_sub(1)]))])
        };
        let texture = |y: usize, x: usize, [sum]: [u64; 1]| {
            in_roughness(sum as f64 / f64::from(windows.pixels(y, x)), roughness)
        };
        windows.write((first, band), values, texture, level)
    })
}

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
use phasestereo_match::base::simd::{Level, Loop};
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
    level: Level,
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
        Ok(Self { map, own, evidence, unrelated, sure, agree, texture, pair, level })
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

        let around = self.around(y);
        for (x, (claim, around)) in self.map.row(y).iter().zip(&around).enumerate() {
            if claim.is_finite() {
                write(x, self.of_pixel(y, x, around, &nearest));
            }
        }
    }

    fn of_pixel(&self, y: usize, x: usize, around: &AroundClaim, nearest: &[f32]) -> Values {
        let (claim, own) = (self.map.row(y)[x], self.own.disparity.row(y)[x]);
        let flags = self.own.flags.row(y)[x];
        let of = |wanted: u16| if flags & wanted != 0 { 1.0 } else { 0.0 };
        let gap = if own.is_nan() { LARGEST } else { (own - claim).abs().min(LARGEST) };

        let [few, many] = self.evidence.means.each_ref().map(|means| self.in_unit(means.row(y)[x]));
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

    /// What claims and own disparities around the pixels of a row are like.
    fn around(&self, y: usize) -> Vec<AroundClaim> {
        let (claims, own) = (self.map, &self.own.disparity);
        let range = |plane, radius| self.level.run(RangeAround { plane, y, radius });
        let near_ranges = range(claims, 1);
        let (ranges, own_ranges) = (range(claims, RANGE), range(own, RANGE));
        let nowhere = self.level.run(NearestAround { claims: claims.row(y), own, y });

        let ranges = ranges.into_iter().zip(own_ranges);
        let all = near_ranges.into_iter().zip(ranges).zip(nowhere);
        let made = |((near_range, (range, own_range)), nowhere)| AroundClaim {
            near_range,
            range,
            own_range,
            nowhere,
        };
        all.map(made).collect()
    }
}

/// The rows of a plane within a distance of one.
fn rows_around(y: usize, radius: usize, rows: usize) -> std::ops::Range<usize> {
    y.saturating_sub(radius)..(y + radius + 1).min(rows)
}

/// The ranges of the finite values within a distance of the pixels of a row; 0 without any, at most
/// [`LARGEST`].
struct RangeAround<'a> {
    plane: &'a Plane<f32>,
    y: usize,
    radius: usize,
}

impl Loop for RangeAround<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Self { plane, y, radius } = self;
        let cols = plane.cols();
        let [mut low, mut high] =
            [f32::INFINITY, f32::NEG_INFINITY].map(|none| vec![none; cols + 2 * radius]);
        for v in rows_around(y, radius, plane.rows()) {
            let columns = low[radius..].iter_mut().zip(&mut high[radius..]);
            for ((low, high), value) in columns.zip(plane.row(v)) {
                *low = low.min(if value.is_finite() { *value } else { f32::INFINITY });
                *high = high.max(if value.is_finite() { *value } else { f32::NEG_INFINITY });
            }
        }

        let mut found = [low[..cols].to_vec(), high[..cols].to_vec()];
        let [least, largest] = &mut found;
        for by in 1..=2 * radius {
            least.iter_mut().zip(&low[by..]).for_each(|(least, low)| *least = least.min(*low));
            largest.iter_mut().zip(&high[by..]).for_each(|(most, high)| *most = most.max(*high));
        }
        let [mut least, largest] = found;
        for (least, largest) in least.iter_mut().zip(largest) {
            *least = (largest - *least).clamp(0.0, LARGEST);
        }
        least
    }
}

/// The least difference of an own disparity around from the claims of a row, at most [`LARGEST`].
struct NearestAround<'a> {
    claims: &'a [f32],
    own: &'a Plane<f32>,
    y: usize,
}

impl Loop for NearestAround<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Self { claims, own, y } = self;
        let mut found = vec![LARGEST; claims.len()];
        for v in rows_around(y, RANGE, own.rows()) {
            for by in 0..=2 * RANGE {
                // Columns x and x + by - RANGE.
                let (here, there) = (RANGE.saturating_sub(by), by.saturating_sub(RANGE));
                let own = own.row(v).get(there..).unwrap_or_default();
                let claims = claims.get(here..).unwrap_or_default();
                let found = found.get_mut(here..).unwrap_or_default();
                for ((found, claim), own) in found.iter_mut().zip(claims).zip(own) {
                    *found = found.min((own - claim).abs());
                }
            }
        }
        found
    }
}

/// What is around a pixel, pixels.
struct AroundClaim {
    /// Range of the claims within 3 x 3 and 7 x 7 pixels.
    near_range: f32,
    range: f32,
    /// Range of the own disparities within 7 x 7 pixels.
    own_range: f32,
    /// The least difference of an own disparity within 7 x 7 pixels from the claim.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_around_a_row_is_that_of_each_pixel() {
        let value = |y: usize, x: usize, seed: usize| match (y * 31 + x * 17 + seed) % 29 {
            0 => f32::NAN,
            1 => 1e30,
            of => of as f32 / 2.0,
        };
        let [claims, own] =
            [3, 8].map(|seed| Plane::from_fn(11, 13, |y, x| value(y, x, seed * y + seed)));
        let window = |y: usize, x: usize, radius: usize| {
            let near = move |at: usize, of: usize| at.abs_diff(of) <= radius;
            let rows = (0..11).filter(move |v| near(*v, y));
            rows.flat_map(move |v| (0..13).filter(move |u| near(*u, x)).map(move |u| (v, u)))
        };

        for level in Level::all().filter_map(|(_, level)| level) {
            for (y, radius) in [(0, 1), (4, 3), (10, 3)] {
                let ranges = level.run(RangeAround { plane: &claims, y, radius });
                let nearest = level.run(NearestAround { claims: claims.row(y), own: &own, y });
                for x in 0..13 {
                    let all: Vec<f32> =
                        window(y, x, radius).map(|(v, u)| claims.row(v)[u]).collect();
                    let finite = all.iter().filter(|value| value.is_finite());
                    let low = finite.clone().copied().fold(f32::INFINITY, f32::min);
                    let high = finite.copied().fold(f32::NEG_INFINITY, f32::max);
                    let range = (high - low).clamp(0.0, LARGEST);
                    assert_eq!(ranges[x].to_bits(), range.to_bits(), "{y} {x}");

                    let by = |(v, u): (usize, usize)| (own.row(v)[u] - claims.row(y)[x]).abs();
                    let least = window(y, x, RANGE).map(by).fold(LARGEST, f32::min);
                    assert_eq!(nearest[x].to_bits(), least.to_bits(), "{y} {x}");
                }
            }
        }
    }
}

//! Claims and the own match -> traits of each claim, which determine the probability that it is right.
//!
//! ```text
//! gap       = |own - claim|
//! odds      = ln(p / (1 - p)) of the own confidence; of its means over 9 x 9 and 31 x 31 pixels
//! range     = largest - least value within 3 x 3 and 7 x 7 pixels of claims, 7 x 7 of own disparities
//! nowhere   = least |own - claim| over the own disparities within 7 x 7 pixels
//! agree     = share of the claims within 9 x 9 and 31 x 31 pixels that are within 1 px of the own disparity
//! texture   = ln(mean difference of horizontal neighbors over 9 x 9 pixels, in that of the whole image)
//! hidden    = 1 if the map has a nearer claim on the same right pixel
//! outside   = 1 if the claim lies outside the right image
//! failed, filled, inferred = 1 if the own disparity has such flags
//! pair      = odds of the mean own confidence, share of the claims that agree,
//!             ln(standard deviation of the noise, in the mean difference of neighbors)
//! ```
//!
//! The costs of claims and of own disparities are not included: on 210 spoiled pairs they change the area
//! under the curve by .001 where both maps agree and by .002 where they differ, and take half of the time.

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::ln_single;
use phasestereo_match::base::plane::{Plane, TASK_ROWS, around, zeroed};
use phasestereo_match::base::simd::{Level, leveled, whole};
use phasestereo_match::image::texture::Roughness;
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::refinement::calibration::{FAILED, STEPS};
use phasestereo_match::refinement::flag;

use crate::verification::hypotheses::right_column;

/// Traits of a claim.
pub const TRAITS: usize = LOCAL + PAIR;
/// Traits of a pixel.
pub const LOCAL: usize = 16;
/// Traits of the whole pair, which come last.
pub const PAIR: usize = 3;
/// The values of the traits of a pixel.
pub type Values = [f32; TRAITS];
/// Neighbors in a row that are computed side by side.
pub const WIDTH: usize = 64;
/// Their local traits.
pub type Stretch = [[f32; WIDTH]; LOCAL];

/// Claims that differ from the own disparity by at most this agree with it, pixels.
pub const AGREES: f32 = 1.0;
/// Odds of probabilities are limited to those of this one and of 1 minus it.
pub const LEAST: f32 = 0.003;
/// Pixels from the center to the side of small and large windows. Not swept, like those below: the lines are
/// learned for the resulting traits.
pub const NEAR: usize = 4;
const FAR: usize = 15;
/// The same for the windows in which ranges are determined.
pub const RANGE: usize = 3;
/// Largest gap and range that count, pixels.
const LARGEST: f32 = 20.0;
/// The share of the mean difference of neighbors that is added before the logarithm.
const LEAST_TEXTURE: f32 = 0.05;

/// The inputs of traits.
#[derive(Debug)]
pub struct Traits<'a> {
    map: &'a Plane<f32>,
    own: &'a Disparity,
    summed: Plane<Summed>,
    /// The mean difference of neighbors.
    roughness: f64,
    /// Traits of the whole pair.
    pub pair: [f32; PAIR],
    level: Level,
}

/// The traits of the claims of a row.
#[derive(Debug)]
pub struct RowTraits<'a> {
    of: &'a Traits<'a>,
    y: usize,
    /// Sums over small windows: of [`Summed::sure`], [`Summed::counts`] and [`Summed::texture`].
    near: &'a [[u32; 3]],
    /// Sums of the first two over large windows.
    far: &'a [[u32; 2]],
    around: AroundRow,
}

/// The values of a pixel that are summed.
#[derive(Debug, Clone, Copy, Default)]
struct Summed {
    /// Steps of its own confidence.
    sure: u32,
    /// In the upper half 1 if there is a claim, in the lower half 1 if it agrees: sums over windows fit.
    counts: u32,
    /// Difference from the neighbor to the left.
    texture: u32,
}

/// The surroundings of the claims of a row, pixels.
#[derive(Debug)]
struct AroundRow {
    /// Ranges of the claims within 3 x 3 and 7 x 7 pixels, of the own disparities within 7 x 7, and the
    /// smallest difference between one of these and the claim.
    ranges: [Vec<f32>; 4],
    right: RightColumns,
}

/// The right column of each claim of a row, and the nearest claim on each column: minus infinity without one.
#[derive(Debug)]
pub struct RightColumns {
    columns: Vec<Option<usize>>,
    nearest: Vec<f32>,
}

impl RightColumns {
    /// The columns for the claims of a row.
    pub fn new(claims: &[f32]) -> Self {
        let row = claims.iter().enumerate();
        let columns: Vec<_> = row.map(|(x, claim)| right_column(x, *claim, claims.len())).collect();
        let mut nearest = vec![f32::NEG_INFINITY; claims.len()];
        for (column, claim) in columns.iter().zip(claims) {
            if let Some(column) = column {
                nearest[*column] = nearest[*column].max(*claim);
            }
        }
        Self { columns, nearest }
    }

    /// Whether a nearer claim hides this one at column `x`.
    #[inline(always)]
    pub fn is_hidden(&self, x: usize, claim: f32) -> bool {
        self.columns[x].is_some_and(|column| self.nearest[column] > claim + 1.0)
    }
}

impl<'a> Traits<'a> {
    /// The traits of a map's claims, compared with an own match that has confidences, on the threads of the
    /// current pool.
    pub fn new(map: &'a Plane<f32>, own: &'a Disparity, pair: &Pair, runtime: Runtime) -> Result<Self> {
        let [left, _] = pair.views();
        let summed = summed(map, own, left.gray(), runtime.control)?;
        let roughness = Roughness::of_rows(left.gray().as_slice(), left.size().1).mean();
        let noise = pair.blur_compensation().map_or([0.0; 2], BlurCompensation::noise);
        let noise = in_roughness(left.scale().steps(noise[0].max(noise[1])) as f32, roughness);
        let [sure, agree] = pair_traits(&summed);

        Ok(Self { map, own, summed, roughness, pair: [sure, agree, noise], level: runtime.level() })
    }

    /// The share of the claims that agree with the own disparities.
    pub fn agreement(&self) -> f32 {
        self.pair[1]
    }

    /// A plane whose rows are written by `write(traits of the row, row)`.
    pub fn by_rows<T: Clone + Default + Send>(
        &self,
        control: &Control,
        write: impl Fn(&RowTraits<'_>, &mut [T]) + Sync,
    ) -> Result<Plane<T>> {
        let size @ (_, cols) = self.map.size();
        // Sums of a few rows are used while they are in a cache.
        Plane::by_bands(size, TASK_ROWS, |first, band| {
            control.checkpoint()?;
            let (mut near, mut far) = (zeroed(band.len())?, zeroed(band.len())?);
            let summed = |y: usize| self.summed.row(y).iter();
            // Four sums fill a register.
            let values = |y: usize| summed(y).map(|one| [one.sure, one.counts, one.texture, 0]);
            let kept = |_, _, [sure, counts, texture, _]: [u32; 4]| [sure, counts, texture];
            Windows::new(size, NEAR).write((first, &mut near), values, kept, self.level)?;
            let values = |y: usize| summed(y).map(|one| [one.sure, one.counts]);
            Windows::new(size, FAR).write((first, &mut far), values, |_, _, sums| sums, self.level)?;

            let sums = near.chunks_exact(cols).zip(far.chunks_exact(cols));
            for ((y, row), (near, far)) in (first..).zip(band.chunks_exact_mut(cols)).zip(sums) {
                write(&RowTraits { of: self, y, near, far, around: self.around(y) }, row);
            }
            Ok(())
        })
    }

    /// The surroundings of the claims of a row.
    fn around(&self, y: usize) -> AroundRow {
        let (claims, own) = (self.map, &self.own.disparity);
        let range = |plane, radius| range_around(self.level, plane, y, radius);
        let nowhere = nearest_around(self.level, claims.row(y), own, y);

        let ranges = [range(claims, 1), range(claims, RANGE), range(own, RANGE), nowhere];
        AroundRow { ranges, right: RightColumns::new(claims.row(y)) }
    }
}

impl RowTraits<'_> {
    /// Writes all traits, NaN for pixels without a claim.
    pub fn write(&self, row: &mut [Values]) {
        let mut traits = [[0.0; WIDTH]; LOCAL];
        for (first, pixels) in (0..).step_by(WIDTH).zip(row.chunks_mut(WIDTH)) {
            self.write_stretch(first, &mut traits);
            for (at, values) in pixels.iter_mut().enumerate() {
                let is_claim = self.of.map.row(self.y)[first + at].is_finite();
                let all = traits.iter().map(|line| line[at]).chain(self.of.pair);
                values.iter_mut().zip(all).for_each(|(out, value)| {
                    *out = if is_claim { value } else { f32::NAN };
                });
            }
        }
    }

    /// The claims, the own disparities, and their flags.
    #[inline(always)]
    pub fn known(&self) -> (&[f32], &[f32], &[u16]) {
        (self.of.map.row(self.y), self.of.own.disparity.row(self.y), self.of.own.flags.row(self.y))
    }

    /// Writes the local traits from column `first` on; undefined for pixels without a claim.
    #[inline(always)]
    pub fn write_stretch(&self, first: usize, traits: &mut Stretch) {
        let Self { of: Traits { map, own: matched, roughness, .. }, y, around, .. } = self;
        let columns = first..(first + WIDTH).min(map.cols());
        let own = &matched.disparity.row(*y)[columns.clone()];
        let claims = &map.row(*y)[columns.clone()];
        for (out, (own, claim)) in traits[0].iter_mut().zip(own.iter().zip(claims)) {
            let gap = (own - claim).abs();
            *out = if gap < LARGEST { gap } else { LARGEST };
        }
        if let Some(confidence) = &matched.confidence {
            let confidences = &confidence.row(*y)[columns.clone()];
            traits[1].iter_mut().zip(confidences).for_each(|(out, sure)| *out = odds(*sure));
        } else {
            traits[1].fill(odds(0.0));
        }

        let near = lanes(&self.near[columns.clone()]);
        let far = lanes(&self.far[columns.clone()]);
        let size = map.size();
        let pixels: [[u32; WIDTH]; 2] =
            [NEAR, FAR].map(|radius| Windows::new(size, radius).pixels_along(*y, first));
        for at in 0..WIDTH {
            traits[2][at] = odds(near[0][at] as f32 / STEPS / pixels[0][at] as f32);
            traits[3][at] = odds(far[0][at] as f32 / STEPS / pixels[1][at] as f32);
            traits[8][at] = share(near[1][at]);
            traits[9][at] = share(far[1][at]);
            traits[10][at] = in_roughness(near[2][at] as f32 / pixels[0][at] as f32, *roughness);
        }
        for (which, ranges) in (4..).zip(&around.ranges) {
            traits[which][..columns.len()].copy_from_slice(&ranges[columns.clone()]);
        }
        for (at, claim) in claims.iter().enumerate() {
            traits[11][at] = f32::from(u8::from(around.right.is_hidden(first + at, *claim)));
            traits[12][at] = f32::from(u8::from(around.right.columns[first + at].is_none()));
        }
        let kinds = [FAILED, flag::FILLED, flag::INFERRED | flag::COARSE];
        for (which, kind) in (13..).zip(kinds) {
            let flags = &matched.flags.row(*y)[columns.clone()];
            for (out, flags) in traits[which].iter_mut().zip(flags) {
                *out = if flags & kind != 0 { 1.0 } else { 0.0 };
            }
        }
    }
}

/// The values of each kind side by side; 0 beyond the last pixel.
#[inline(always)]
fn lanes<const N: usize>(pixels: &[[u32; N]]) -> [[u32; WIDTH]; N] {
    let mut lanes = [[0; WIDTH]; N];
    for (at, values) in pixels.iter().enumerate().take(WIDTH) {
        for (lane, value) in lanes.iter_mut().zip(values) {
            lane[at] = *value;
        }
    }
    lanes
}

/// The ranges of the finite values within a distance of the pixels of a row; 0 without any, at most
/// [`LARGEST`].
#[leveled]
fn range_around(level: Level, plane: &Plane<f32>, y: usize, radius: usize) -> Vec<f32> {
    let cols = plane.cols();
    let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY].map(|none| vec![none; cols + 2 * radius]);
    for v in around(y, radius, plane.rows()) {
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

/// The smallest difference between the claims of a row and surrounding own disparities, at most [`LARGEST`].
#[leveled]
fn nearest_around(level: Level, claims: &[f32], own: &Plane<f32>, y: usize) -> Vec<f32> {
    let mut found = vec![LARGEST; claims.len()];
    for v in around(y, RANGE, own.rows()) {
        for by in 0..=2 * RANGE {
            // Columns x and x + by - RANGE.
            let (here, there) = (RANGE.saturating_sub(by), by.saturating_sub(RANGE));
            let own = own.row(v).get(there..).unwrap_or_default();
            let claims = claims.get(here..).unwrap_or_default();
            let found = found.get_mut(here..).unwrap_or_default();
            for ((found, claim), own) in found.iter_mut().zip(claims).zip(own) {
                // Unlike `min`, one instruction: a NaN difference does not count.
                let by = (own - claim).abs();
                *found = if by < *found { by } else { *found };
            }
        }
    }
    found
}

/// The summed values of all pixels.
fn summed(map: &Plane<f32>, own: &Disparity, gray: &Plane<i32>, control: &Control) -> Result<Plane<Summed>> {
    Plane::by_rows(map.size(), control, |y, row: &mut [Summed]| {
        let disparities = map.row(y).iter().zip(own.disparity.row(y));
        for (out, (claim, own)) in row.iter_mut().zip(disparities) {
            let agrees = (own - claim).abs() <= AGREES;
            out.counts = u32::from(claim.is_finite()) << u16::BITS | u32::from(agrees);
        }
        if let Some(confidence) = &own.confidence {
            for (out, confidence) in row.iter_mut().zip(confidence.row(y)) {
                out.sure = whole(confidence * STEPS) as u32;
            }
        }
        let gray = gray.row(y);
        for (out, (left, right)) in row.iter_mut().skip(1).zip(gray.iter().zip(&gray[1..])) {
            out.texture = left.abs_diff(*right);
        }
    })
}

/// The share of the claims that agree.
#[inline(always)]
fn share(counts: u32) -> f32 {
    let [agree, claims] = unpacked(counts);
    agree as f32 / claims.max(1) as f32
}

/// The claims that agree, and all of them, of [`Summed::counts`].
#[inline(always)]
fn unpacked(counts: u32) -> [u32; 2] {
    [counts & u32::from(u16::MAX), counts >> u16::BITS]
}

/// The logarithm of the odds of a probability.
#[inline(always)]
pub fn odds(probability: f32) -> f32 {
    let probability = probability.clamp(LEAST, 1.0 - LEAST);
    ln_single(probability / (1.0 - probability))
}

/// The odds of the mean own confidence of the whole pair, and the share of claims that agree.
fn pair_traits(summed: &Plane<Summed>) -> [f32; 2] {
    let mut sums = [0u64; 3];
    for one in summed.as_slice() {
        let [agree, claims] = unpacked(one.counts);
        for (sum, value) in sums.iter_mut().zip([one.sure, agree, claims]) {
            *sum += u64::from(value);
        }
    }
    let [sure, agree, claims] = sums.map(|sum| sum as f64);
    let mean = sure / f64::from(STEPS) / summed.as_slice().len().max(1) as f64;
    [odds(mean as f32), (agree / claims.max(1.0)) as f32]
}

/// The logarithm of a difference of gray values, in units of the mean one of neighbors.
#[inline(always)]
fn in_roughness(difference: f32, roughness: f64) -> f32 {
    ln_single(LEAST_TEXTURE + if roughness > 0.0 { difference / roughness as f32 } else { 0.0 })
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
        let [claims, own] = [3, 8].map(|seed| Plane::from_fn(11, 13, |y, x| value(y, x, seed * y + seed)));
        let window = |y: usize, x: usize, radius: usize| {
            let near = move |at: usize, of: usize| at.abs_diff(of) <= radius;
            let rows = (0..11).filter(move |v| near(*v, y));
            rows.flat_map(move |v| (0..13).filter(move |u| near(*u, x)).map(move |u| (v, u)))
        };

        for level in Level::all().filter_map(|(_, level)| level) {
            for (y, radius) in [(0, 1), (4, 3), (10, 3)] {
                let ranges = range_around(level, &claims, y, radius);
                let nearest = nearest_around(level, claims.row(y), &own, y);
                for x in 0..13 {
                    let all: Vec<f32> = window(y, x, radius).map(|(v, u)| claims.row(v)[u]).collect();
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

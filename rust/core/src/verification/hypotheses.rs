//! Claims of a map as a whole: the disparities to search because of them, and whether its numbers have
//! another meaning.

use crate::verification::Counts;
use crate::verification::evidence::{STEPS, cost_at};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::MOST_DISPARITIES;

/// One of this many claims, at either end, does not widen the range: maps have outliers.
const OUTLIERS: usize = 200;
/// Pixels beyond the claims that are searched.
const MARGIN: i64 = 2;
/// Rows and columns that are sampled, at most, to find a misreading.
const SAMPLES: usize = 96;
/// Least advantage over pixels paired at random, as a share of their cost, of numbers with another meaning.
/// Right maps have 0.5 to 0.8 on sharp pairs, and 0.15 or more under noise of 20 gray levels.
const LEAST_ADVANTAGE: f64 = 0.1;
/// Least ratio to the advantage of the unchanged claims, and to that of 0 everywhere: divided numbers are
/// close to it.
const CLEARLY: f64 = 3.0;

/// The meaning of the numbers of a map, if they are not disparities in pixels that are positive in front of
/// infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Misreading {
    /// With the opposite sign.
    Sign,
    /// In fractions of a pixel: 16ths or 256ths.
    Parts(u16),
}

impl Misreading {
    const ALL: [Self; 3] = [Self::Sign, Self::Parts(16), Self::Parts(256)];

    /// The disparity that a number stands for.
    fn read(self, claim: f32) -> f32 {
        match self {
            Self::Sign => -claim,
            Self::Parts(parts) => claim / f32::from(parts),
        }
    }

    /// The meaning with which pixels match far better than with the unchanged numbers, and than without any
    /// disparity, if there is one; the costs must allow any two columns.
    pub fn of(sample: &Sample, costs: &Costs) -> Option<Self> {
        let random = sample.random(costs);
        let advantage = |reading: Option<Self>| {
            let read = |claim| reading.map_or(claim, |reading| reading.read(claim));
            sample.advantage(costs, random, read)
        };

        let nowhere = sample.advantage(costs, random, |_| 0.0);
        let plain = advantage(None).max(nowhere).max(0.0);
        let readings = Self::ALL.map(|reading| (reading, advantage(Some(reading))));
        let (reading, best) =
            readings.into_iter().reduce(|best, next| if next.1 > best.1 { next } else { best })?;

        (best > LEAST_ADVANTAGE.max(CLEARLY * plain)).then_some(reading)
    }
}

/// Some of the claims.
pub struct Sample {
    cols: usize,
    /// Row, column and claim.
    claims: Vec<(usize, usize, f32)>,
}

impl Sample {
    /// A sample of the claims of a map.
    pub fn new(map: &Plane<f32>) -> Self {
        let (rows, cols) = map.size();
        let [down, across] = [rows, cols].map(|length| length.div_ceil(SAMPLES));

        let places = (0..rows).step_by(down).flat_map(|y| {
            // The columns of one row lie between those of the next.
            let first = y / down % 2 * (across / 2);
            (first..cols).step_by(across).map(move |x| (y, x, map.row(y)[x]))
        });
        Self { cols, claims: places.filter(|(_, _, claim)| claim.is_finite()).collect() }
    }

    /// The numbers of claims, without verdicts, and of those outside the right image.
    pub fn counts(&self) -> Counts {
        let is_outside = |(_, x, claim): &&(usize, usize, f32)| right_column(*x, *claim, self.cols).is_none();
        let outside = self.claims.iter().filter(is_outside).count() as u64;
        Counts { verdicts: [0, self.claims.len() as u64, 0, 0], outside }
    }

    /// The sum of the costs when each sampled pixel is paired with another of its row, in the unit of
    /// [`cost_at`].
    fn random(&self, costs: &Costs) -> i64 {
        // A fixed stride pairs pixels as well as chance does.
        let pair = |(index, (y, x, _)): (usize, &(usize, usize, f32))| -> i64 {
            let other = (x + self.cols / 3 + index * 61 % self.cols.div_ceil(3)) % self.cols;
            i64::from(costs.between(*y, *x, other).unwrap_or_default()) * i64::from(STEPS)
        };
        self.claims.iter().enumerate().map(pair).sum()
    }

    /// The share by which the costs at some disparities are below those of pixels paired at random. Pixels
    /// whose match would be outside the right image cost the same as these.
    fn advantage(&self, costs: &Costs, random: i64, read: impl Fn(f32) -> f32) -> f64 {
        let found: Vec<_> = self
            .claims
            .iter()
            .filter_map(|(y, x, claim)| cost_at(costs, self.cols, (*y, *x), read(*claim)))
            .collect();

        let count = self.claims.len().max(1) as f64;
        let mean = random as f64 / count;
        let lower = found.len() as f64 * mean - found.iter().copied().map(i64::from).sum::<i64>() as f64;
        if mean > 0.0 { lower / (count * mean) } else { 0.0 }
    }
}

/// The range that was found, widened to nearly all claims whose match lies in the right image; unchanged if
/// that would exceed the searchable range.
pub fn widened(found: Candidates, map: &Plane<f32>) -> Candidates {
    let cols = map.cols();
    // Disparities from `1 - cols` to `cols - 1`.
    let mut counts = vec![0usize; 2 * cols - 1];
    for y in 0..map.rows() {
        for (x, claim) in map.row(y).iter().enumerate() {
            if let Some(right) = right_column(x, *claim, cols) {
                counts[x + cols - 1 - right] += 1;
            }
        }
    }

    let total: usize = counts.iter().sum();
    let few = total / OUTLIERS;
    let beyond_few = |passed: &mut usize, (index, count): (usize, &usize)| {
        *passed += count;
        (*passed > few).then_some(index as i64 + 1 - cols as i64)
    };
    let disparities = || counts.iter().enumerate();

    let low = disparities().scan(0, |passed, next| Some(beyond_few(passed, next))).flatten().next();
    let high = disparities().rev().scan(0, |passed, next| Some(beyond_few(passed, next))).flatten().next();
    let (Some(low), Some(high)) = (low, high) else { return found };

    let (first, last) = (found.min() as i64, found.max() as i64);
    // Only claims beyond the range that was found need a margin of their own.
    let low = if low < first { low - MARGIN } else { first }.max(1 - cols as i64);
    let high = if high > last { high + MARGIN } else { last }.min(cols as i64 - 1);
    let count = high - low + 1;

    if count > cols.min(MOST_DISPARITIES) as i64 {
        return found;
    }
    Candidates::new(low, count, cols).unwrap_or(found)
}

/// The right column nearest to the claimed match; `None` outside the image.
pub fn right_column(x: usize, claim: f32, cols: usize) -> Option<usize> {
    let right = (x as f32 - claim).round();
    let is_inside = right >= 0.0 && right < cols as f32;
    is_inside.then_some(right as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_covers_nearly_all_claims_and_what_was_found() {
        let found = Candidates::new(2, 6, 100).expect("legal");
        let claims = |far: f32| {
            Plane::from_fn(40, 100, |y, x| match (y, x) {
                (0, 70) => far,
                (_, 60..90) => 20.0,
                _ => f32::NAN,
            })
        };

        let range = widened(found, &claims(20.0));
        assert_eq!((range.min(), range.count()), (2, 21));
        // It is not widened by one outlier, or by claims outside the right image.
        assert_eq!(widened(found, &claims(65.0)), range);
        assert_eq!(widened(found, &claims(1e9)), range);
        assert_eq!(widened(found, &claims(20.0).map(|_| f32::NAN)), found);
        assert_eq!(widened(found, &claims(20.0).map(|_| -1e30)), found);
    }

    #[test]
    fn a_match_outside_the_right_image_has_no_column() {
        assert_eq!(right_column(5, 5.4, 10), Some(0));
        assert_eq!(right_column(5, 5.6, 10), None);
        assert_eq!(right_column(5, -4.0, 10), Some(9));
        assert_eq!(right_column(5, -5.0, 10), None);
        assert!([1e9, -1e9, f32::NAN, f32::MAX].map(|d| right_column(5, d, 10)).iter().all(Option::is_none));
    }
}

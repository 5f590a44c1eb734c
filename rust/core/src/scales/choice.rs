//! The choice, pixel by pixel, between a map and that of the pair at half the size.
//!
//! A confidence is the probability that a disparity is within 1 px of the true one. So the two are compared,
//! after that of the copy is converted to the pixels of the map, where the tolerance is half as large:
//!
//! ```text
//! same(c)  = c / (c + (1 - c) STRICTER)
//! doubt    = mean of 1 - c, of the copy of 1 - same(c), over the same surroundings
//! choice   = the copy's where c < same(c of the copy), doubt > LEAST_DOUBT
//!            and doubt > doubt of the copy + LEAST_GAIN
//! ```
//!
//! The surroundings decide, not only the pixel: a copy with one lucky pixel is not better. A copy searches
//! steps of 2 px, which may begin before the range of the pair and end after it; the range holds.
//!
//! Where copies decided, the images have no detail finer than the pixels of these copies:
//!
//! ```text
//! detail   = 2^(mean of halvings over the pixels of copies)
//! ```

use rayon::prelude::*;

use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::exp2;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::choices::JUMP;
use phasestereo_match::image::window_sums::window_means;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;

/// Reach of the surroundings, pixels of the map.
const RADIUS: usize = 15;
/// At or below this mean doubt nothing changes.
const LEAST_DOUBT: f32 = 0.4;
/// A copy must be better by more than this.
const LEAST_GAIN: f32 = 0.05;
/// The factor by which the odds of an error grow when the tolerance is halved: 1.9 to 3.3 on the maps of the
/// development scenes at half and a quarter of their size, plus caution.
const STRICTER: f32 = 3.0;
/// The same factor for disparities chosen because they seemed surer, and the factor by which their bars
/// widen: on the development scenes, sharp and under faults, a mean confidence of 0.57 to 0.67 corresponded
/// to 45 to 56 % right pixels.
const CHOSEN: (f32, f32) = (2.0, 1.25);
/// While scales are decided, the bits above all flags count how often the copy that gave the disparity was
/// halved: up to 15 times, more than for any image that fits into memory. Second maps, whose flag is one of
/// these bits, come later.
const HALVED: u16 = 1 << 12;
const _: () = assert!(flag::COARSE < HALVED, "a flag in the bits that count");

/// The mean doubt around each pixel of a map.
pub struct Doubt(Plane<f32>);

impl Doubt {
    /// The doubt of a map; `None` if it has no confidences.
    pub fn of_map(map: &Disparity, level: Level) -> Result<Option<Self>> {
        let Some(confidence) = &map.confidence else { return Ok(None) };
        Self::new(confidence, RADIUS, |confidence| 1.0 - confidence, level).map(Some)
    }

    fn new(
        confidence: &Plane<f32>,
        radius: usize,
        doubt: impl Fn(f32) -> f32 + Sync,
        level: Level,
    ) -> Result<Self> {
        let size = confidence.size();
        let doubts = |y: usize| confidence.row(y).iter().map(|confidence| doubt(*confidence));

        Ok(Self(window_means(size, radius, doubts, level)?))
    }

    /// The share of the pixels in doubt.
    pub fn share(&self) -> f64 {
        let doubts = self.0.as_slice();
        let count = doubts.iter().filter(|doubt| **doubt > LEAST_DOUBT).count();

        count as f64 / doubts.len() as f64
    }
}

/// The probability that a disparity of the copy is right within the tolerance of the larger map.
fn same(confidence: f32) -> f32 {
    lowered(confidence, STRICTER)
}

/// A confidence after the odds of an error are multiplied by this factor.
fn lowered(confidence: f32, factor: f32) -> f32 {
    confidence / (confidence + (1.0 - confidence) * factor)
}

/// Replaces what the copy knows better, within the disparities searched in the pair; it knows nothing about
/// pixels that the right image does not show.
pub fn choose(
    map: &mut Disparity,
    doubt: &Doubt,
    coarse: &Disparity,
    searched: Candidates,
    level: Level,
) -> Result<()> {
    let (Some(confidence), Some(uncertainty)) = (&mut map.confidence, &mut map.uncertainty) else {
        return Ok(());
    };
    let (Some(coarse_confidence), Some(coarse_uncertainty)) = (&coarse.confidence, &coarse.uncertainty)
    else {
        return Ok(());
    };
    // There, the same surroundings are half as wide.
    let coarse_doubt = Doubt::new(coarse_confidence, RADIUS / 2, |c| 1.0 - same(c), level)?;
    let (low, high) = (searched.min() as f32, searched.max() as f32);

    let cols = map.disparity.cols();
    let rows = map.disparity.as_mut_slice().par_chunks_mut(cols);
    let rows = rows.zip(map.flags.as_mut_slice().par_chunks_mut(cols));
    let rows = rows.zip(confidence.as_mut_slice().par_chunks_mut(cols));
    let rows = rows.zip(uncertainty.as_mut_slice().par_chunks_mut(cols));

    rows.enumerate().for_each(|(y, (((disparity, flags), confidence), uncertainty))| {
        let doubts = doubt.0.row(y);

        for x in 0..cols {
            let is_seen = flags[x] & flag::NO_CANDIDATE == 0;
            if doubts[x] <= LEAST_DOUBT || disparity[x].is_nan() || !is_seen {
                continue;
            }

            let around = Neighbors::new((y, x), &coarse.disparity);
            let sure = same(around.mean(coarse_confidence));
            let is_better = doubts[x] > around.mean(&coarse_doubt.0) + LEAST_GAIN;
            let found = around.disparity(&coarse.disparity);

            if is_better && sure > confidence[x] && !found.is_nan() {
                let (row, col) = around.nearest();
                disparity[x] = (2.0 * found).clamp(low, high);
                flags[x] = (coarse.flags.row(row)[col] | flag::COARSE) + HALVED;
                confidence[x] = sure;
                uncertainty[x] = 2.0 * coarse_uncertainty.row(row)[col];
            }
        }
    });

    Ok(())
}

/// How often the copy that gave a disparity was halved, by its flags, until the map is concluded.
pub fn halvings(flags: u16) -> usize {
    (flags / HALVED).into()
}

/// Concludes a map after all is decided: lowers the confidences of chosen disparities, since the surer one of
/// two is less sure than it seems, and sets how fine the detail is there.
pub fn conclude(map: &mut Disparity) {
    let (Some(confidence), Some(uncertainty)) = (&mut map.confidence, &mut map.uncertainty) else {
        return;
    };

    let (factor, wider) = CHOSEN;
    let (mut chosen, mut halved) = (0_u64, 0_u64);
    let places = confidence.as_mut_slice().iter_mut().zip(uncertainty.as_mut_slice());
    for ((confidence, bar), flags) in places.zip(map.flags.as_mut_slice()) {
        if *flags & flag::COARSE != 0 {
            *confidence = lowered(*confidence, factor);
            *bar *= wider;
            chosen += 1;
            halved += halvings(*flags) as u64;
        }
        *flags %= HALVED;
    }

    map.detail = (chosen > 0).then(|| exp2(halved as f64 / chosen as f64));
}

/// The four pixels of a copy nearest to a pixel: its own, and those beside, above or below, and diagonal.
struct Neighbors {
    rows: [usize; 2],
    cols: [usize; 2],
}

impl Neighbors {
    /// Those of the pixel `(y, x)`.
    fn new((y, x): (usize, usize), copy: &Plane<f32>) -> Self {
        let pair = |at: usize, count: usize| {
            let beside = if at.is_multiple_of(2) { (at / 2).saturating_sub(1) } else { at / 2 + 1 };
            [at / 2, beside].map(|place| place.min(count - 1))
        };

        Self { rows: pair(y, copy.rows()), cols: pair(x, copy.cols()) }
    }

    /// The pixel of the copy that contains the pixel.
    fn nearest(&self) -> (usize, usize) {
        (self.rows[0], self.cols[0])
    }

    fn values(&self, plane: &Plane<f32>) -> [f32; 4] {
        let [row, other] = self.rows.map(|y| plane.row(y));
        let [x, beside] = self.cols;
        [row[x], row[beside], other[x], other[beside]]
    }

    /// The interpolated values of a plane: the pixel's center is a quarter of a pixel off that of the copy's.
    fn mean(&self, plane: &Plane<f32>) -> f32 {
        let [a, b, c, d] = self.values(plane);
        (9.0 * a + 3.0 * (b + c) + d) / 16.0
    }

    /// The same for disparities, unless they belong to several surfaces: then that of the nearest pixel.
    fn disparity(&self, plane: &Plane<f32>) -> f32 {
        let values = self.values(plane);
        let is_one = values[1..].iter().all(|value| (value - values[0]).abs() <= JUMP);

        if is_one { self.mean(plane) } else { values[0] }
    }
}

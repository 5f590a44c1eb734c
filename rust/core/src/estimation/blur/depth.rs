//! Blur that follows depth: the lenses are in focus at different distances, or one of them has a wider
//! aperture.
//!
//! A lens blurs by a disk whose radius grows with the difference between the disparity and the one in focus.
//! Squared radii add up, so that of the relative blur, negative if the right image is softer, is a parabola:
//!
//! ```text
//! squared(d) = (a (d - focus of the left lens))^2 - (b (d - focus of the right lens))^2
//! loss       = mean over the blocks of the loss of a disk of radius sqrt |squared(disparity of the block)|
//! ```
//!
//! The parabola is given by its values at the smallest, the middle and the largest disparity. All
//! combinations of whole radii are tried, using sums of losses over blocks of similar disparities; the one
//! with the smallest loss is used, if it is clearly below that of any single radius. Each tile then has the
//! disk of its own disparity, from a match of copies that are small enough to show little of the blur.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::bank::Side;
use super::response::{Response, response};
use super::rough::RoughScale;
use super::search::{BlockPair, Choice};
use crate::estimation::blur::psf::Psf;
use phasestereo_match::base::simd::Level;
use phasestereo_match::base::statistics::ranked;

/// The match that gives the disparities: at half the size, too much of the blur is left. Small neighborhoods
/// find the outlines of objects.
pub const DEPTHS: RoughScale = RoughScale { factor: 4, neighborhood: 5, window: 5, subpixel: true };

/// Largest radius, pixels.
const LARGEST: usize = 10;
/// Radii that are tried: those of the left image, those of the right one, and none.
const RADII: usize = 2 * LARGEST + 1;
/// Steps from 0 to the largest radius, or its square, in which curves are tried.
const TRIALS: usize = 25;
/// Parts of the span of disparities whose blocks are combined.
const PARTS: usize = 16;
/// Share of the blocks at either end of the disparities that are outside the span.
const OUTSIDE: usize = 32;
/// Spread of the disparities of a block, as a share of the span, at which it counts half: its blur is a
/// mixture.
const EVEN: f32 = 0.1;
/// Fewest blocks;
const LEAST_BLOCKS: usize = 24;
/// ... and least span of their disparities, pixels.
const LEAST_SPAN: f32 = 2.0;
/// How much better radii that follow depth must explain the blocks than any one radius, nepers. On pairs with
/// other blurs, or none, the difference is at most 0.013; with lenses in focus 4 px apart, it is at least
/// 0.04.
const WORTH: f32 = 0.025;
/// ... and at least this share of the gain from a separate blur for each tile: areas may be blurred by
/// something else.
const SHARE: f32 = 0.5;

/// The smallest compensated radius, and the step between radii, pixels: steps of 1 do not help.
const FIRST: f32 = 2.0;
const STEP: f32 = 1.5;
/// Radii of either side that tiles may have.
const STEPS: usize = ((LARGEST as f32 - FIRST) / STEP) as usize + 1;

/// How the relative blur depends on the disparity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlurByDepth {
    /// The least and the largest disparity, pixels.
    span: (f32, f32),
    /// Squared radii at the smallest, the middle and the largest disparity; negative if the right image is
    /// softer.
    squared: [f32; 3],
    /// From 0.5 to 1: their share of the explanation that a separate blur for each tile would give.
    pub certainty: f32,
}

/// The softer image and the radius of its disk.
pub type Defocus = Option<(Side, f64)>;

/// The responses of disks of 1 to [`LARGEST`] pixels.
fn disks() -> &'static [Response] {
    static DISKS: OnceLock<Vec<Response>> = OnceLock::new();
    DISKS.get_or_init(|| {
        let disk = |radius: usize| Psf::disk(radius as f64);
        (1..=LARGEST).map(|radius| response(&disk(radius).taps(), Level::best())).collect()
    })
}

/// The losses of all radii, by their index.
fn losses(blocks: &BlockPair, level: Level) -> [f32; RADII] {
    std::array::from_fn(|index| {
        let disk = |by: usize| &disks()[by - 1];
        let choice = match index.checked_sub(LARGEST) {
            Some(0) => Choice::at(0),
            Some(by) => Choice { side: Some(Side::Left), response: disk(by) },
            None => Choice { side: Some(Side::Right), response: disk(LARGEST - index) },
        };
        blocks.loss(choice, level)
    })
}

impl BlurByDepth {
    /// How the blur of blocks depends on their disparities; `None`: it does not. Separate blurs explain the
    /// blocks with a mean loss of `apart`.
    pub fn new(
        blocks: &[BlockPair],
        disparities: &[f32],
        spreads: &[f32],
        apart: f32,
        level: Level,
    ) -> Option<Self> {
        let span = span(disparities)?;

        // Sums over the blocks of each part of the span.
        let of_blocks: Vec<_> = blocks.par_iter().map(|blocks| losses(blocks, level)).collect();
        let mut sums = [[0.0; RADII]; PARTS];
        let mut count = 0.0;
        for ((losses, disparity), spread) in of_blocks.iter().zip(disparities).zip(spreads) {
            let part = (share(span, *disparity) * PARTS as f32) as usize;
            let sums = &mut sums[part.min(PARTS - 1)];
            let weight = 1.0 / (1.0 + (spread / (EVEN * (span.1 - span.0))).powi(2));
            sums.iter_mut().zip(losses).for_each(|(sum, loss)| *sum += weight * loss);
            count += weight;
        }
        let uniform = |index: usize| sums.iter().map(|sums| sums[index]).sum::<f32>() / count;
        let uniform = (0..RADII).map(uniform).fold(f32::INFINITY, f32::min);

        let (best, least) = least(span, &sums)?;
        let gain = uniform - least / count;
        let certainty = gain / gain.max(uniform - apart);
        (gain >= WORTH && certainty >= SHARE).then_some(Self { certainty, ..best })
    }

    /// The signed radius at a share of the span.
    fn at(&self, share: f32) -> f32 {
        let [first, middle, last] = self.squared;
        let slope = 4.0 * middle - 3.0 * first - last;
        let squared = first + share * (slope + share * 2.0 * (first - 2.0 * middle + last));

        squared.abs().sqrt().copysign(squared)
    }

    /// The disk for a disparity: one of a few radii, or none.
    pub fn defocus(&self, disparity: f32) -> Defocus {
        let radius = self.at(share(self.span, disparity));
        if radius.is_nan() || radius.abs() < FIRST / 2.0 {
            return None;
        }

        let step = ((radius.abs() - FIRST) / STEP).round().clamp(0.0, (STEPS - 1) as f32);
        let side = if radius > 0.0 { Side::Left } else { Side::Right };
        Some((side, f64::from(FIRST + STEP * step)))
    }
}

/// The disparities of most blocks; `None` if they are too few or too similar.
fn span(disparities: &[f32]) -> Option<(f32, f32)> {
    if disparities.len() < LEAST_BLOCKS {
        return None;
    }

    let mut values = disparities.to_vec();
    let outside = values.len() / OUTSIDE;
    let low = ranked(&mut values, outside)?;
    let high = ranked(&mut values, disparities.len() - 1 - outside)?;
    (high - low >= LEAST_SPAN).then_some((low, high))
}

/// The position of a disparity in a span, from 0 to 1.
fn share((low, high): (f32, f32), disparity: f32) -> f32 {
    ((disparity - low) / (high - low)).clamp(0.0, 1.0)
}

/// The parabola with the smallest sum of losses, and that sum.
fn least(span: (f32, f32), sums: &[[f32; RADII]; PARTS]) -> Option<(BlurByDepth, f32)> {
    let steps = || (0..=2 * TRIALS).map(|step| step as f32 / TRIALS as f32 - 1.0);
    let ends = steps().flat_map(|first| steps().map(move |last| (first, last)));

    let curves = ends.flat_map(|(first, last)| {
        let largest = LARGEST as f32 * LARGEST as f32;
        let middle = 0.5 * (first + last);
        let one = [first, middle, last].map(|share| largest * share * share);
        let alike = [first, middle, last].map(|share| largest * share);
        [alike, one, one.map(|squared| -squared)]
    });
    let tried = curves.map(|squared| {
        let curve = BlurByDepth { span, squared, certainty: 1.0 };
        (curve, total(curve, sums))
    });
    tried.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The sum of the losses along a parabola, linear between radii.
fn total(curve: BlurByDepth, sums: &[[f32; RADII]; PARTS]) -> f32 {
    let of_part = |(part, losses): (usize, &[f32; RADII])| {
        let radius = curve.at((part as f32 + 0.5) / PARTS as f32);
        let place = (radius + LARGEST as f32).clamp(0.0, (RADII - 1) as f32);
        let below = (place as usize).min(RADII - 2);
        losses[below] + (place - below as f32) * (losses[below + 1] - losses[below])
    };
    sums.iter().enumerate().map(of_part).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_has_the_disk_nearest_to_the_radius_at_its_disparity() {
        let of_squared = |squared| BlurByDepth { span: (10.0, 30.0), squared, certainty: 1.0 };

        // Squared radii of -16 to 16.
        let found = of_squared([-16.0, 0.0, 16.0]);
        assert_eq!(found.defocus(10.0), Some((Side::Right, 3.5)));
        assert_eq!(found.defocus(20.0), None);
        assert_eq!(found.defocus(21.0), Some((Side::Left, 2.0)));
        assert_eq!(found.defocus(30.0), Some((Side::Left, 3.5)));
        assert_eq!(found.defocus(50.0), Some((Side::Left, 3.5)));

        // The left image only: 5 px at the middle, 10 at the end.
        let found = of_squared([0.0, 25.0, 100.0]);
        assert_eq!(found.defocus(20.0), Some((Side::Left, 5.0)));
        assert_eq!(found.defocus(30.0), Some((Side::Left, 9.5)));
    }
}

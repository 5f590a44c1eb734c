//! A quick comparison of the blur of a pair with that of an earlier one of the same cameras.
//!
//! The blocks at the places of an earlier estimate are transformed again. The quotient of their powers in
//! both images must be unchanged, in every part of the image and in every direction.

use super::bins::{DIRECTIONS, SIDE, bins};
use super::spectrum::{BlockPlace, Powers};
use phasestereo_match::base::math;

/// Parts of the image along each axis.
const PARTS: usize = 3;
/// Largest change of the powers of a part in a direction, nepers on average. On 13 sharp pairs and the same
/// pairs after a disk of 3 px: new noise never exceeds it, a view moved by 4 px once in 26 times, by 16 px 16
/// times. A Gaussian of 0.7 px always does, and so does a disk that changes to 2.5 or 4 px, or one of 4 px in
/// a sixteenth of the image; a disk of 3 px that changes to 3.5 px never does.
const SMALL: f32 = 0.3;

/// Statistics of the blocks of an estimate, for comparison with those of later pairs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BlurSignature {
    /// Places of the blocks.
    pub places: Vec<BlockPlace>,
    /// Logarithm of the quotient of left and right powers, nepers: by part and direction.
    pub excess: Vec<f32>,
}

impl BlurSignature {
    /// The statistics of blocks with these powers, in an image of this many rows and columns.
    pub fn new(places: Vec<BlockPlace>, powers: &[Powers], (rows, cols): (usize, usize)) -> Self {
        // The part of the image that the center of a block lies in.
        let part = |place: &BlockPlace| {
            let (y, x) = (place.top + SIDE / 2, place.left + SIDE / 2);
            y * PARTS / rows * PARTS + x * PARTS / cols
        };

        // Powers are summed over the blocks of a part before logarithms are taken: single blocks are noisy.
        let mut sums = vec![[vec![0.0; bins().count()], vec![0.0; bins().count()]]; PARTS * PARTS];
        for (place, powers) in places.iter().zip(powers) {
            for (sums, powers) in sums[part(place)].iter_mut().zip(&powers.binned) {
                sums.iter_mut().zip(powers).for_each(|(sum, power)| *sum += power);
            }
        }

        let excess = sums.iter().flat_map(|[left, right]| {
            let logarithms = left.iter().zip(right).map(|(left, right)| {
                let quotient = left.max(f32::MIN_POSITIVE) / right.max(f32::MIN_POSITIVE);
                math::ln(f64::from(quotient)) as f32
            });

            let logarithms: Vec<f32> = logarithms.collect();
            bins()
                .directions
                .each_ref()
                .map(|weights| weights.iter().zip(&logarithms).map(|(weight, value)| weight * value).sum())
        });

        let excess: Vec<f32> = excess.collect();
        debug_assert_eq!(excess.len(), PARTS * PARTS * DIRECTIONS);
        Self { places, excess }
    }

    /// Whether blocks at these places fit in an image of this many rows and columns; false without any
    /// places.
    pub fn fits(&self, (rows, cols): (usize, usize)) -> bool {
        let fits = |place: &BlockPlace| {
            place.top.max(place.right_top) + SIDE <= rows && place.left.max(place.right) + SIDE <= cols
        };

        !self.places.is_empty() && self.places.iter().all(fits)
    }

    /// Whether the statistics of the same places in another pair are nearly equal.
    pub fn is_like(&self, other: &Self) -> bool {
        let mut pairs = self.excess.iter().zip(&other.excess);
        self.excess.len() == other.excess.len() && pairs.all(|(one, two)| (one - two).abs() <= SMALL)
    }
}

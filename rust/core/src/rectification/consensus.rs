//! Finds the matches that agree on one viewing direction of two cameras: MSAC (P. Torr, A. Zisserman:
//! *MLESAC*, CVIU 2000).
//!
//! ```text
//! y' - y = a + b x' + c y + d (x - x')       # rows of cameras that are slightly moved, turned, zoomed
//! for each of 1500 samples of 4 matches:
//!     a, b, c, d = fitted to the sample;   cost = sum over the matches of min(|error| / near, 1)
//! agreeing = those within `near` of the cheapest
//! repeated with near from 2 to 1 % of the width: fit cubic terms, too;   agreeing = those within `near`
//! ```
//!
//! Coordinates are shares of the width from its middle. Samples come from a generator with a fixed start.

use super::matches::CornerMatch;
use phasestereo_match::base::linear::Normal;

/// Number of samples.
const SAMPLES: usize = 1500;
/// Fewest matches to sample from, and fewest that terms of third order are fitted to.
const LEAST: (usize, usize) = (8, 20);
/// How near agreeing rows are, as shares of the width: for samples, then for each fit.
const NEAR: f64 = 0.02;
const NEARER: [f64; 5] = [0.02, 0.02, 0.015, 0.012, 0.010];
/// A fit that loses more of the agreeing matches is rejected.
const KEPT: f64 = 0.8;
/// How strongly the terms are held at 0, in a sample and in a fit.
const HELD: [f64; 4] = [1e-9, 1e-3, 1e-3, 1e-2];
const HELD_CUBIC: [f64; 9] = [1e-6, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 0.02, 0.02];
/// Larger terms do not belong to two cameras that look about the same way: turn and zoom, and the part that
/// depends on disparity.
const LARGEST: [f64; 4] = [f64::INFINITY, 0.6, 0.6, 0.5];

/// The evidence of a match's rows about the cameras.
struct Observation {
    terms: [f64; 4],
    cubic: [f64; 9],
    /// How much lower it is in the right image.
    lower: f64,
}

impl Observation {
    fn new(found: &CornerMatch, cols: usize) -> Self {
        let [[x, y], [x_right, y_right]] =
            [found.left, found.right].map(|place| place.map(|at| at / cols as f64 - 0.5));
        let square = x_right * x_right + y * y;
        let terms = [1.0, x_right, y, x - x_right];
        let higher = [x_right * y, x_right * x_right, y * y, y * square, x_right * square];

        let mut cubic = [0.0; 9];
        cubic[..4].copy_from_slice(&terms);
        cubic[4..].copy_from_slice(&higher);
        Self { terms, cubic, lower: y_right - y }
    }

    fn error(&self, model: &[f64; 4]) -> f64 {
        (product(&self.terms, model) - self.lower).abs()
    }
}

/// Whether each match agrees with most others.
pub fn agreeing(matches: &[CornerMatch], cols: usize) -> Vec<bool> {
    let seen: Vec<_> = matches.iter().map(|found| Observation::new(found, cols)).collect();
    let Some(model) = sampled(&seen) else { return vec![false; seen.len()] };

    let mut agree: Vec<bool> = seen.iter().map(|one| one.error(&model) < NEAR).collect();
    for near in NEARER {
        let before = agree.iter().filter(|is_in| **is_in).count();
        if before < LEAST.1 {
            break;
        }

        let mut normal = Normal::held(HELD_CUBIC);
        for (one, _) in seen.iter().zip(&agree).filter(|(_, is_in)| **is_in) {
            normal.add(&one.cubic, one.lower, 1.0);
        }
        let Some(model) = normal.solved() else { break };

        let is_near = |one: &Observation| (product(&one.cubic, &model) - one.lower).abs() < near;
        let new: Vec<bool> = seen.iter().map(is_near).collect();
        if (new.iter().filter(|is_in| **is_in).count() as f64) < KEPT * before as f64 {
            break;
        }
        agree = new;
    }

    agree
}

/// The best model of a few matches.
fn sampled(seen: &[Observation]) -> Option<[f64; 4]> {
    if seen.len() < LEAST.0 {
        return None;
    }

    let mut chance = SplitMix(1);
    let mut best: Option<([f64; 4], f64)> = None;
    for _ in 0..SAMPLES {
        let mut normal = Normal::held(HELD);
        for _ in 0..4 {
            let one = &seen[chance.below(seen.len())];
            normal.add(&one.terms, one.lower, 1.0);
        }

        let Some(model) = normal.solved() else { continue };
        if model.iter().zip(LARGEST).any(|(term, largest)| term.abs() >= largest) {
            continue;
        }

        let cost: f64 = seen.iter().map(|one| (one.error(&model) / NEAR).min(1.0)).sum();
        if best.is_none_or(|(_, least)| cost < least) {
            best = Some((model, cost));
        }
    }

    best.map(|(model, _)| model)
}

fn product<const N: usize>(terms: &[f64; N], model: &[f64; N]) -> f64 {
    terms.iter().zip(model).map(|(term, factor)| term * factor).sum()
}

/// Pseudorandom numbers, always the same (`SplitMix64`: G. Steele et al., OOPSLA 2014).
struct SplitMix(u64);

impl SplitMix {
    /// A number below `end`.
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        let mixed = mixed ^ (mixed >> 31);
        ((u128::from(mixed) * end as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Matches of a right image that is turned, lower and bent; this many of each ten are outliers.
    fn matches(wrong: usize) -> Vec<CornerMatch> {
        let mut chance = SplitMix(7);
        let mut any = |end: usize| chance.below(end) as f64;
        let one = |index: usize| {
            let left = [any(640), any(480)];
            let [x, y] = [left[0] - any(60), left[1]];
            let (u, v) = (x - 320.0, y - 240.0);
            let lower = 12.0 + 0.2 * u + 0.1 * v + 3e-7 * v * (u * u + v * v);
            let right = if index % 10 < wrong { [any(640), any(480)] } else { [x, y + lower] };
            CornerMatch { left, right }
        };
        (0..400).map(one).collect()
    }

    #[test]
    fn matches_agree_in_spite_of_as_many_mistakes() {
        let agree = agreeing(&matches(5), 640);
        let right = agree.iter().enumerate().filter(|(index, _)| index % 10 >= 5);
        assert!(right.filter(|(_, is_in)| **is_in).count() >= 195);
        let wrong = agree.iter().enumerate().filter(|(index, _)| index % 10 < 5);
        assert!(wrong.filter(|(_, is_in)| **is_in).count() <= 20);
    }

    #[test]
    fn matches_anywhere_hardly_agree() {
        let agree = agreeing(&matches(10), 640);
        assert!(agree.iter().filter(|is_in| **is_in).count() <= 60);
        assert!(agreeing(&matches(0)[..7], 640).iter().all(|is_in| !is_in), "too few");
    }
}

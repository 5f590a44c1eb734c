//! Blur of both images in the same place: each of them has detail that is missing in the other, as after a
//! shake that moved both cameras differently.
//!
//! With the responses A of the left and B of the right blur, every bin has
//!
//! ```text
//! left - its noise = gain x A / B x (right - its noise)
//! ```
//!
//! If B is known, this is the model of one blur (`fit`) with right / B as the sharper image. So all pairs of
//! the bank are fitted first, then the blurs are refined in turn while the other one is kept. Of two
//! Gaussians only the difference is visible, which is a blur of one image.

use super::bank::{Entry, bank};
use super::fit::{BlurEvidence, BlurFit};
use super::refine::refine;
use phasestereo_match::base::simd::Level;

/// How often both blurs are refined in turn.
const ROUNDS: usize = 3;

/// The blurs of both images, and how well they explain the evidence.
#[derive(Debug, Clone)]
pub struct TwoSided {
    /// The blurs of the left and of the right image.
    pub entries: [Entry; 2],
    /// The fit of the left image's blur given the other one, and the other way round.
    pub fits: [BlurFit; 2],
}

impl TwoSided {
    /// Mean loss of both fits, nepers.
    pub fn loss(&self) -> f32 {
        0.5 * (self.fits[0].loss + self.fits[1].loss)
    }
}

/// The pair of blurs that best explains the missing detail of the left and the right image.
pub fn find_two_sided(evidence: &[BlurEvidence; 2], level: Level) -> Option<TwoSided> {
    let [mut left, mut right] = searched(evidence, level)?.map(Entry::clone);

    let [for_left, for_right] = evidence;
    for _ in 0..ROUNDS {
        left = refine(&for_left.against(&right.response), level).entry;
        right = refine(&for_right.against(&left.response), level).entry;
    }

    let fits = [
        for_left.against(&right.response).fit(&left.response, level),
        for_right.against(&left.response).fit(&right.response, level),
    ];
    Some(TwoSided { entries: [left, right], fits })
}

/// The best pair of the bank.
fn searched(evidence: &[BlurEvidence; 2], level: Level) -> Option<[&'static Entry; 2]> {
    let mut best = None;
    let mut least = f32::INFINITY;

    for known in bank() {
        for (side, evidence) in evidence.iter().enumerate() {
            let given = evidence.against(&known.response);
            let losses = given.losses(bank().iter().map(|entry| &entry.response), level);
            for (entry, loss) in bank().iter().zip(losses) {
                if loss < least {
                    least = loss;
                    best = Some(if side == 0 { [entry, known] } else { [known, entry] });
                }
            }
        }
    }

    best
}

//! Two maps of one pair -> one: the mean where they agree, elsewhere the one that is more likely right.
//!
//! ```text
//! near     = |own - claim| <= 1
//! claimed  = probability that the claim is right                       # crate::verification::judge
//! ahead    = ln(probability that the claim alone is right / that the own disparity alone is)
//! better   = sum of ahead > 0, over the pixels within 9 x 9 that are not near
//! fused    = near: own + SHARE (claim - own), SHARE_IF_POOR if more than POOR of the own map is wrong
//!            better, or the own disparity is missing and claimed > 1/2: claim;  else own
//! confidence = near, or a claim taken: claimed;  else min(claimed / exp(ahead), 1 - claimed, own)
//! bar      = near: the mean of both;  a claim taken: its own;  else that of claims of this confidence
//! ```
//!
//! The surroundings decide, not only the pixel: the differences around a pixel most likely form one mistake.
//!
//! The own confidence ignores the claim, so its value where both differ is learned, too. A differing claim
//! never raises it.

use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::exp_single;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::whole;
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::refinement::flag;

use crate::verification::judge::{Chance, bar, kept};
use crate::verification::traits::AGREES;

/// The weight of the claim in the mean of both: with it, the mean has the fewest errors beyond 0.5 px on the
/// development scenes.
const SHARE: f32 = 0.25;
/// The same, if the own map is poor.
const SHARE_IF_POOR: f32 = 0.5;
/// Share of the own map that is probably wrong above which it is poor. Not swept, like those below.
const POOR: f64 = 0.2;
/// Pixels from the center to the side of the window over which odds are summed.
const RADIUS: usize = 4;
/// Steps of odds that are summed, and the largest odds: integers give the same sum in any order.
const STEPS: f32 = 1024.0;
const LARGEST: f32 = 10.0;

/// A pixel of a map.
#[derive(Debug, Clone, Copy)]
struct MapPixel {
    disparity: f32,
    flags: u16,
    confidence: f32,
    bar: f32,
}

/// The fused map of an own match, with confidences, and of claims with these chances; `wrong` is the share of
/// the own map that is probably wrong.
pub fn fuse(
    mut map: Disparity,
    claims: &Plane<f32>,
    chances: &Plane<Chance>,
    wrong: f64,
    runtime: Runtime,
) -> Result<Disparity> {
    let steps = |chance: &Chance| [whole(chance.ahead.clamp(-LARGEST, LARGEST) * STEPS)];
    let values = |y: usize| chances.row(y).iter().map(steps);
    let windows = Windows::new(claims.size(), RADIUS);
    let ahead = windows.plane(values, |_, _, [sum]: [i32; 1]| sum, runtime.level(), runtime.control)?;

    let share = if wrong > POOR { SHARE_IF_POOR } else { SHARE };
    for y in 0..claims.rows() {
        runtime.control.checkpoint()?;
        let pixels = claims.row(y).iter().zip(chances.row(y)).zip(ahead.row(y));
        for (x, ((claim, chance), ahead)) in pixels.enumerate() {
            let own = MapPixel {
                disparity: map.disparity.row(y)[x],
                flags: map.flags.row(y)[x],
                confidence: map.confidence.as_ref().map_or(0.0, |all| all.row(y)[x]),
                bar: map.uncertainty.as_ref().map_or(f32::NAN, |all| all.row(y)[x]),
            };
            let Some(found) = own.fused(*claim, *chance, *ahead > 0, share) else { continue };
            map.disparity.row_mut(y)[x] = found.disparity;
            map.flags.row_mut(y)[x] = found.flags;
            if let Some(confidence) = &mut map.confidence {
                confidence.row_mut(y)[x] = found.confidence;
            }
            if let Some(uncertainty) = &mut map.uncertainty {
                uncertainty.row_mut(y)[x] = found.bar;
            }
        }
    }

    Ok(map)
}

impl MapPixel {
    /// A pixel of the own map and a claim -> a pixel of the fused map; `None`: unchanged.
    fn fused(self, claim: f32, chance: Chance, is_better: bool, share: f32) -> Option<Self> {
        let Self { disparity: matched, flags, confidence: own, bar: own_bar } = self;
        let Chance { confidence, ahead, bar: claimed_bar } = chance;
        if !claim.is_finite() || flags & flag::MASKED != 0 {
            return None;
        }

        if (matched - claim).abs() <= AGREES {
            let disparity = matched + share * (claim - matched);
            return Some(Self { disparity, confidence, bar: 0.5 * (claimed_bar + own_bar), ..self });
        }
        let is_taken = if matched.is_nan() { confidence > 0.5 } else { is_better };
        if is_taken {
            // If the right image does not show a pixel, this holds for a claim, too.
            let flags = flags & flag::UNSEEN | flag::SECOND;
            return Some(Self { disparity: claim, flags, confidence, bar: claimed_bar });
        }
        if matched.is_nan() {
            return None;
        }

        let rest = confidence / exp_single(ahead);
        let confidence = kept(rest.min(own).min(1.0 - confidence));
        Some(Self { confidence, bar: bar(confidence, flags), ..self })
    }
}

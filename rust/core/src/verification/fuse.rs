//! Two maps of one pair -> one: the mean where they agree, elsewhere the one that is more likely right.
//!
//! ```text
//! near     = |own - claim| <= 1
//! claimed  = probability that the claim is right                       # crate::verification::judge
//! ahead    = ln(probability that the claim alone is right / that the own disparity alone is)   # as claimed
//! better   = sum of ahead > 0, over the pixels within 9 x 9 that are not near
//! fused    = near: own + SHARE (claim - own), SHARE_IF_POOR if the own map has more than POOR of its pixels wrong
//!            better, or the own disparity is missing and the odds of the claim are positive: claim;  else own
//! confidence = near, and of claims that are taken: claimed;  else claimed / exp(ahead), at most 1 - claimed and the own one
//! bar      = near: the mean of both;  of claims that are taken: theirs;  else that of claims of this confidence
//! ```
//!
//! The surroundings decide, not the pixel alone: what differs around a pixel is most likely one mistake.
//!
//! The own confidence does not know of the claim, so what becomes of it where both differ is learned, too. A
//! claim that differs never makes it higher.

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math::exp;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::window_sums::{Beyond, Windows};
use phasestereo_match::matcher::Disparity;
use phasestereo_match::refinement::flag;

use crate::verification::judge::{Chance, bar, probability};
use crate::verification::traits::{AGREES, odds};

/// The weight of the claim in the mean of both: on the development scenes the mean has the fewest errors
/// beyond 0.5 px with it.
const SHARE: f32 = 0.25;
/// The same where the own map is poor.
const SHARE_IF_POOR: f32 = 0.5;
/// Share of the own map that is probably wrong from which on it is poor. Not swept, as those below.
const POOR: f64 = 0.2;
/// Pixels from the center to the side of the window over which odds are summed.
const RADIUS: usize = 4;
/// Steps of odds that are summed, and the largest ones: integers sum to the same in any order.
const STEPS: f32 = 1024.0;
const LARGEST: f32 = 10.0;
/// Rows that one task works on.
const BAND: usize = 32;
/// Flags that hold of a claim, too: the right image does not see the pixel.
const UNSEEN: u16 = flag::OUTSIDE | flag::MATCH_MASKED | flag::OCCLUDED;

/// Both maps of a pair, and what is known of them.
struct Maps<'a> {
    own: &'a Disparity,
    claims: &'a Plane<f32>,
    chances: &'a Plane<Chance>,
}

/// A pixel of the fused map.
#[derive(Debug, Clone, Copy)]
struct MapPixel {
    disparity: f32,
    flags: u16,
    chance: Chance,
}

/// The fused map of an own match, with confidences, and of claims with these chances; `wrong` is the share of
/// the own map that is probably wrong.
pub fn fuse(
    own: &Disparity,
    claims: &Plane<f32>,
    chances: &Plane<Chance>,
    wrong: f64,
    level: Level,
    control: &Control,
) -> Result<Disparity> {
    let size = (claims.rows(), claims.cols());
    let maps = Maps { own, claims, chances };
    let windows = Windows { size, radius: RADIUS, beyond: Beyond::Nothing };
    let ahead = Plane::by_bands(size, BAND, |first, band| {
        control.checkpoint()?;
        let maps = &maps;
        let values = |y: usize| (0..size.1).map(move |x| [maps.ahead(y, x)]);
        windows.write((first, band), values, |_, _, [sum]: [i64; 1]| sum, level)
    })?;

    let mut fused = own.clone();
    let share = if wrong > POOR { SHARE_IF_POOR } else { SHARE };
    for y in 0..size.0 {
        control.checkpoint()?;
        for x in 0..size.1 {
            let is_better = ahead.row(y)[x] > 0;
            let Some(found) = maps.fused(y, x, is_better, share) else { continue };
            fused.disparity.row_mut(y)[x] = found.disparity;
            fused.flags.row_mut(y)[x] = found.flags;
            if let Some(confidence) = &mut fused.confidence {
                confidence.row_mut(y)[x] = probability(found.chance.odds);
            }
            if let Some(uncertainty) = &mut fused.uncertainty {
                uncertainty.row_mut(y)[x] = found.chance.bar;
            }
        }
    }

    Ok(fused)
}

impl Maps<'_> {
    /// A pixel of the fused map; `None`: it stays as it is.
    fn fused(&self, y: usize, x: usize, is_better: bool, share: f32) -> Option<MapPixel> {
        let (matched, claim) = (self.own.disparity.row(y)[x], self.claims.row(y)[x]);
        let (flags, chance) = (self.own.flags.row(y)[x], self.chances.row(y)[x]);
        if !claim.is_finite() || flags & flag::MASKED != 0 {
            return None;
        }

        if (matched - claim).abs() <= AGREES {
            let own_bar = self.own.uncertainty.as_ref().map_or(f32::NAN, |all| all.row(y)[x]);
            let chance = Chance { bar: 0.5 * (chance.bar + own_bar), ..chance };
            return Some(MapPixel {
                disparity: matched + share * (claim - matched),
                flags,
                chance,
            });
        }
        let is_taken = if matched.is_nan() { chance.odds > 0.0 } else { is_better };
        if is_taken {
            let flags = flags & UNSEEN | flag::SECOND;
            return Some(MapPixel { disparity: claim, flags, chance });
        }
        if matched.is_nan() {
            return None;
        }

        let claimed = probability(chance.odds);
        let rest = claimed / exp(f64::from(chance.ahead)) as f32;
        let own = self.own.confidence.as_ref().map_or(0.0, |all| all.row(y)[x]);
        let odds = odds(rest.min(own).min(1.0 - claimed));
        let chance = Chance { odds, bar: bar(odds, flags), ..chance };
        Some(MapPixel { disparity: matched, flags, chance })
    }

    /// By how much the odds of a claim are ahead where both maps differ, in steps.
    fn ahead(&self, y: usize, x: usize) -> i64 {
        let by = (self.own.disparity.row(y)[x] - self.claims.row(y)[x]).abs();
        if !by.is_finite() || by <= AGREES {
            return 0;
        }
        (self.chances.row(y)[x].ahead.clamp(-LARGEST, LARGEST) * STEPS) as i64
    }
}

//! Two maps of one pair -> one: the mean where they agree, elsewhere the one that is more likely right.
//!
//! ```text
//! near     = |own - claim| <= 1
//! claimed  = probability that the claim is right                       # crate::verification::judge
//! ahead    = odds of claimed - (odds of the own confidence - DOUBTED)
//! better   = sum of ahead > 0, over the pixels within 9 x 9 that are not near
//! fused    = near: own + SHARE (claim - own), SHARE_IF_POOR if the own map has more than POOR of its pixels wrong
//!            better, or the own disparity is missing and the odds of the claim are positive: claim;  else own
//! confidence = near, and of claims that are taken: claimed;  else the own one (1 - claimed)
//! bar      = near: the mean of both;  of claims that are taken: theirs;  else that of claims of this confidence
//! ```
//!
//! The surroundings decide, not the pixel alone: what differs around a pixel is most likely one mistake.
//!
//! Only one of two that differ can be right, and the own confidence does not know of the claim: where the match
//! stays, it is 78, 61 and 68 %, times the probability that the claim is wrong 62, 47 and 53, and 54, 44 and
//! 51 % are right (`HITNet`'s maps of 12 development scenes: sharp, noise of 20 gray levels, one image out of
//! focus by a disk of 6 px).

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
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
/// The odds of the own confidence that a claim which differs takes away, a logarithm. With 0, 0.75, 1: sharp
/// 6.20, 6.11, 6.10 % wrong, noise 20 25.51, 25.48, 25.58, disk 6 17.65, 17.71, 17.85, JPEG 70 12.60, 12.19,
/// 12.03, both soft 12.05, 11.86, 11.78 (`HITNet`'s maps of 12 development scenes).
const DOUBTED: f32 = 1.0;
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

/// A pixel of one of the maps.
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
            let [matched, claim] = maps.pixels(y, x);
            if !claim.disparity.is_finite() || matched.flags & flag::MASKED != 0 {
                continue;
            }

            let own_bar = own.uncertainty.as_ref().map_or(f32::NAN, |all| all.row(y)[x]);
            let is_better = ahead.row(y)[x] > 0;
            let Some(found) = fused_pixel(matched, claim, own_bar, is_better, share) else {
                continue;
            };
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
    /// A pixel of both; the chance of the own one holds where they differ.
    fn pixels(&self, y: usize, x: usize) -> [MapPixel; 2] {
        let Self { own, claims, chances } = self;
        let (flags, chance) = (own.flags.row(y)[x], chances.row(y)[x]);
        let odds = odds(self.confidence(y, x) * (1.0 - probability(chance.odds)));

        let own = MapPixel {
            disparity: own.disparity.row(y)[x],
            flags,
            chance: Chance { odds, bar: bar(odds, flags) },
        };
        let flags = flags & UNSEEN | flag::SECOND;
        [own, MapPixel { disparity: claims.row(y)[x], flags, chance }]
    }

    /// The own confidence.
    fn confidence(&self, y: usize, x: usize) -> f32 {
        self.own.confidence.as_ref().map_or(0.0, |all| all.row(y)[x])
    }

    /// By how much the odds of a claim are ahead where both maps differ, in steps.
    fn ahead(&self, y: usize, x: usize) -> i64 {
        let by = (self.own.disparity.row(y)[x] - self.claims.row(y)[x]).abs();
        if !by.is_finite() || by <= AGREES {
            return 0;
        }
        let claimed = self.chances.row(y)[x].odds;
        let ahead = claimed - (odds(self.confidence(y, x)) - DOUBTED);
        (ahead.clamp(-LARGEST, LARGEST) * STEPS) as i64
    }
}

/// A pixel of the fused map; `None`: it has no disparity still.
fn fused_pixel(
    own: MapPixel,
    claim: MapPixel,
    own_bar: f32,
    is_better: bool,
    share: f32,
) -> Option<MapPixel> {
    if (own.disparity - claim.disparity).abs() <= AGREES {
        let bar = 0.5 * (claim.chance.bar + own_bar);
        let disparity = own.disparity + share * (claim.disparity - own.disparity);
        return Some(MapPixel { disparity, chance: Chance { bar, ..claim.chance }, ..own });
    }
    if own.disparity.is_nan() {
        return (claim.chance.odds > 0.0).then_some(claim);
    }
    Some(if is_better { claim } else { own })
}

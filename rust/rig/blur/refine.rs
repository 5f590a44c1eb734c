//! From the nearest of a coarse choice to the size and the direction of a blur.

use std::ops::RangeInclusive;

use super::bank::{Entry, bank};
use super::fit::{BlurEvidence, Fit};
use crate::rig::psf::{Family, Psf};
use crate::simd::Level;

/// First step of the size, as a share of it; halved until it is a fiftieth of that.
const STEP: f64 = 0.2;
/// First step of the direction, degrees; halved along with that of the size.
const TURN: f64 = 8.0;
/// Shares of the radius of an annulus that may be covered: one with a smaller hole is hardly any other than a disk.
const COVERED: RangeInclusive<f64> = 0.4..=0.9;
/// An annulus is believed where it has no more than this share of the loss of all other families: its many zeros resemble
/// what compression leaves of a blur, and areas of several blurs. On four scenes annuli 6/3 and 6/4.5 have 0.27 to 0.35 of
/// the loss of the best disk, annuli that are fitted to a Gaussian of 2 after JPEG of quality 70 have 0.76 to 1.
const CLEARLY: f32 = 0.5;
/// How often steps are halved.
const HALVINGS: usize = 5;
/// Families that start with more than this times the least loss (plus a little) do not come in question.
const HOPELESS: f32 = 1.6;

/// A blur and how well it explains the powers.
#[derive(Debug, Clone)]
pub struct Found {
    /// The blur.
    pub entry: Entry,
    /// How well.
    pub fit: Fit,
}

/// The blur of any family that explains the evidence best.
pub fn refine(evidence: &BlurEvidence, level: Level) -> Found {
    let judge = |entry: Entry| {
        let fit = evidence.fit(&entry.response, level);
        Found { entry, fit }
    };
    let judge_new = |psf| judge(Entry::new(psf, level));
    let families = [Family::Gaussian, Family::Disk, Family::Motion, Family::Annulus];
    let seeds = families.map(|family| {
        let members = bank().iter().filter(|entry| entry.psf.family == family);
        best(members.cloned().map(judge))
    });
    let (annuli, others): (Vec<_>, Vec<_>) =
        seeds.into_iter().flatten().partition(|found| found.entry.psf.family == Family::Annulus);
    let least = others.iter().map(|found| found.fit.loss).fold(f32::INFINITY, f32::min);
    let is_hopeful = |found: &Found| found.fit.loss <= HOPELESS * least + 0.02;
    let refined = others.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    // There is always the one with the least loss.
    let usual = best(refined).unwrap_or_else(|| judge(bank()[0].clone()));
    let annuli = annuli.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    best(annuli.filter(|found| found.fit.loss <= CLEARLY * usual.fit.loss)).unwrap_or(usual)
}

/// Goes where the loss falls, in ever smaller steps.
fn descend(seed: Found, judge: &impl Fn(Psf) -> Found) -> Found {
    let mut found = seed;
    for halving in 0..HALVINGS {
        let (grow, turn) = (STEP / f64::from(1 << halving), TURN / f64::from(1 << halving));
        while let Some(better) = best(neighbors(found.entry.psf, grow, turn).map(judge))
            .filter(|other| other.fit.loss < found.fit.loss)
        {
            found = better;
        }
    }
    found
}

fn neighbors(psf: Psf, grow: f64, turn: f64) -> impl Iterator<Item = Psf> {
    let sizes = [1.0 - grow, 1.0 + grow].map(|factor| Psf { size: psf.size * factor, ..psf });
    let angles = [turn, -turn].map(|by| Psf { angle: (psf.angle + by).rem_euclid(180.0), ..psf });
    let holes = [grow, -grow].map(|by| Psf { inner: psf.inner + by / 2.0, ..psf });
    let turns = if psf.family == Family::Motion { 2 } else { 0 };
    let covers = if psf.family == Family::Annulus { 2 } else { 0 };
    let within = |psf: &Psf| {
        let is_annulus = psf.family == Family::Annulus;
        psf.size <= largest(psf.family) && (!is_annulus || COVERED.contains(&psf.inner))
    };
    let shapes = angles.into_iter().take(turns).chain(holes.into_iter().take(covers));
    sizes.into_iter().chain(shapes).filter(within)
}

/// Blocks see no kernels that are larger than half of them.
fn largest(family: Family) -> f64 {
    match family {
        Family::Gaussian => 8.0,
        Family::Disk | Family::Annulus => 14.0,
        Family::Motion => 31.0,
    }
}

fn best(found: impl Iterator<Item = Found>) -> Option<Found> {
    found.reduce(|a, b| if b.fit.loss < a.fit.loss { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::super::bins::bins;
    use super::super::spectrum::Powers;
    use super::*;

    /// What blocks have to say whose blur is known.
    fn evidence(psf: Psf) -> BlurEvidence {
        let noise = 0.05;
        let scene = (0..bins().count()).map(|bin| 400.0 / (1.0 + bin as f32));
        let response = Entry::new(psf, Level::best()).response;
        let blurred =
            scene.clone().zip(response.values()).map(|(power, left)| power * left + noise);
        let binned = [blurred.collect(), scene.map(|power| power + noise).collect()];
        let powers = Powers { binned, least_high: [0.0; 2] };
        let [evidence, _] = BlurEvidence::of_both(&powers, [noise; 2], Level::best());
        evidence
    }

    #[test]
    fn sizes_and_angles_between_those_of_the_bank_are_found() {
        let psfs = [
            Psf::round(Family::Gaussian, 2.43),
            Psf::round(Family::Gaussian, 6.2),
            Psf::round(Family::Disk, 3.55),
            Psf::round(Family::Disk, 7.1),
            Psf::motion(12.1, 38.0),
            Psf::motion(8.3, 172.0),
            Psf::motion(19.6, 96.0),
            Psf::annulus(5.4, 0.62),
            Psf::annulus(7.3, 0.8),
        ];
        for psf in psfs {
            let found = refine(&evidence(psf), Level::best()).entry.psf;
            assert_eq!(found.family, psf.family, "{found:?}");
            assert!((found.size / psf.size - 1.0).abs() < 0.02, "{found:?}, {psf:?}");
            let turn = (found.angle - psf.angle + 90.0).rem_euclid(180.0) - 90.0;
            assert!(turn.abs() < 2.0, "{found:?}, {psf:?}");
            assert!((found.inner - psf.inner).abs() < 0.05, "{found:?}, {psf:?}");
        }
    }

    #[test]
    fn sizes_stay_within_what_blocks_see() {
        for psf in [
            Psf::round(Family::Gaussian, 16.0),
            Psf::round(Family::Disk, 28.0),
            Psf::motion(62.0, 0.0),
            Psf::annulus(28.0, 0.5),
        ] {
            let found = refine(&evidence(psf), Level::best()).entry.psf;
            assert!(found.size <= largest(found.family), "{found:?}");
        }
    }

    #[test]
    fn no_blur_becomes_a_very_small_one() {
        let found = refine(&evidence(Psf::round(Family::Gaussian, 0.1)), Level::best());
        assert!(found.entry.psf.spread() < 0.3, "{:?}", found.entry.psf);
    }
}

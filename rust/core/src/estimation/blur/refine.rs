//! Refinement of a coarse choice from the bank to the size and the direction of a blur.

use std::ops::RangeInclusive;

use super::bank::{Entry, bank};
use super::fit::{BlurEvidence, Fit};
use crate::estimation::blur::psf::{Family, Psf};
use phasestereo_match::base::simd::Level;

/// First step of the size, as a share of it.
const STEP: f64 = 0.2;
/// First step of the direction, degrees.
const TURN: f64 = 8.0;
/// Shares of the radius of an annulus that may be covered: one with a smaller hole hardly differs from a disk.
const COVERED: RangeInclusive<f64> = 0.4..=0.9;
/// An annulus is accepted if its loss is at most this share of that of all other families: its many zeros resemble
/// what compression leaves of a blur, and areas of several blurs. True annuli have about
/// a third of the loss of the best disk, mistaken ones more than two thirds.
const CLEARLY: f32 = 0.5;
/// How often the steps of size and direction are halved.
const HALVINGS: usize = 5;
/// Families whose first loss is more than the least one times this (plus a little) are not refined.
const HOPELESS: f32 = 1.6;

/// A blur and how well it explains the evidence.
#[derive(Debug, Clone)]
pub struct RefinedBlur {
    /// The blur.
    pub entry: Entry,
    /// How well.
    pub fit: Fit,
}

/// The blur of any family that explains the evidence best.
pub fn refine(evidence: &BlurEvidence, level: Level) -> RefinedBlur {
    let judge = |entry: Entry| {
        let fit = evidence.fit(&entry.response, level);
        RefinedBlur { entry, fit }
    };
    let judge_new = |psf| judge(Entry::new(psf, level));

    let families = [Family::Gaussian, Family::Disk, Family::Motion, Family::Annulus];
    // The best entry of the bank of each family.
    let seeds = families.map(|family| {
        let members = bank().iter().filter(|entry| entry.psf.family == family);
        best(members.cloned().map(judge))
    });

    let (annuli, others): (Vec<_>, Vec<_>) =
        seeds.into_iter().flatten().partition(|found| found.entry.psf.family == Family::Annulus);

    let least = others.iter().map(|found| found.fit.loss).fold(f32::INFINITY, f32::min);
    let is_hopeful = |found: &RefinedBlur| found.fit.loss <= HOPELESS * least + 0.02;

    let refined = others.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    // The family with the least loss passes the filter, so there is one unless all losses are NaN.
    let usual = best(refined).unwrap_or_else(|| judge(bank()[0].clone()));

    let annuli = annuli.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    best(annuli.filter(|found| found.fit.loss <= CLEARLY * usual.fit.loss)).unwrap_or(usual)
}

/// Pattern search: goes to the best neighbor while the loss falls, then halves the steps.
fn descend(seed: RefinedBlur, judge: &impl Fn(Psf) -> RefinedBlur) -> RefinedBlur {
    let mut found = seed;
    for halving in 0..HALVINGS {
        // The steps of both parameters shrink together.
        let (grow, turn) = (STEP / f64::from(1 << halving), TURN / f64::from(1 << halving));
        while let Some(better) = best(neighbors(found.entry.psf, grow, turn).map(judge))
            .filter(|other| other.fit.loss < found.fit.loss)
        {
            found = better;
        }
    }

    found
}

/// The blurs that differ from one by a step in one parameter, within what is allowed.
fn neighbors(psf: Psf, grow: f64, turn: f64) -> impl Iterator<Item = Psf> {
    let sizes = [1.0 - grow, 1.0 + grow].map(|factor| Psf { size: psf.size * factor, ..psf });
    let angles = [turn, -turn].map(|by| Psf { angle: (psf.angle + by).rem_euclid(180.0), ..psf });
    let holes = [grow, -grow].map(|by| Psf { inner: psf.inner + by / 2.0, ..psf });

    // Only motions have a direction, only annuli a hole.
    let turns = if psf.family == Family::Motion { 2 } else { 0 };
    let covers = if psf.family == Family::Annulus { 2 } else { 0 };

    let within = |psf: &Psf| {
        let is_annulus = psf.family == Family::Annulus;
        psf.size <= largest(psf.family) && (!is_annulus || COVERED.contains(&psf.inner))
    };
    let shapes = angles.into_iter().take(turns).chain(holes.into_iter().take(covers));
    sizes.into_iter().chain(shapes).filter(within)
}

/// The largest size: blocks are too small for kernels that are larger than half of them.
fn largest(family: Family) -> f64 {
    match family {
        Family::Gaussian => 8.0,
        Family::Disk | Family::Annulus => 14.0,
        Family::Motion => 31.0,
    }
}

fn best(found: impl Iterator<Item = RefinedBlur>) -> Option<RefinedBlur> {
    found.reduce(|a, b| if b.fit.loss < a.fit.loss { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::super::bins::bins;
    use super::super::spectrum::Powers;
    use super::*;

    /// Evidence of blocks with a known blur.
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
            Psf::round(Family::Disk, 0.6),
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
    fn a_disk_with_a_hole_must_be_clearly_better_than_one_without() {
        for (size, inner) in [(5.0, 0.1), (5.0, 0.25), (4.0, 0.3), (7.0, 0.3)] {
            let found = refine(&evidence(Psf::annulus(size, inner)), Level::best()).entry.psf;
            assert_eq!(found.family, Family::Disk, "{found:?}");
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

//! Refinement of a coarse choice from the bank to the size and the direction of a blur.

use super::bank::{Entry, bank};
use super::fit::{BlurEvidence, BlurFit};
use super::psf::{Family, Psf};
use phasestereo_match::base::simd::Level;

/// How often the steps of size and direction are halved.
const HALVINGS: u32 = 5;
/// Families whose first loss exceeds the smallest one times this (plus a little) are not refined.
const HOPELESS: f32 = 1.6;

/// A blur and how well it explains the evidence.
#[derive(Debug, Clone)]
pub struct RefinedBlur {
    /// The blur.
    pub entry: Entry,
    /// The quality of its fit.
    pub fit: BlurFit,
}

/// The blur of any family that explains the evidence best.
pub fn refine(evidence: &BlurEvidence, level: Level) -> RefinedBlur {
    let judge = |entry: Entry| {
        let fit = evidence.fit(&entry.response, level);
        RefinedBlur { entry, fit }
    };
    let judge_new = |psf| judge(Entry::new(psf, level));

    // The best entry of the bank of each family.
    let seeds = Family::all().map(|family| {
        let members = bank().iter().filter(|entry| entry.psf.family == family);
        best(members.cloned().map(judge))
    });

    let rarity = |found: &RefinedBlur| found.entry.psf.family.traits().rarity.as_ref();
    let (rare, others): (Vec<_>, Vec<_>) = seeds.flatten().partition(|found| rarity(found).is_some());

    let least = others.iter().map(|found| found.fit.loss).fold(f32::INFINITY, f32::min);
    let is_hopeful = |found: &RefinedBlur| found.fit.loss <= HOPELESS * least + 0.02;

    let refined = others.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    // The family with the least loss passes the filter, so there is one unless all losses are NaN.
    let usual = best(refined).unwrap_or_else(|| judge(bank()[0].clone()));

    let rare = rare.into_iter().filter(is_hopeful).map(|seed| descend(seed, &judge_new));
    let is_clear = |found: &RefinedBlur| {
        rarity(found).is_none_or(|rarity| found.fit.loss <= rarity.share * usual.fit.loss)
    };
    best(rare.filter(is_clear)).unwrap_or(usual)
}

/// Pattern search: moves to the best neighbor while the loss falls, then halves the steps.
fn descend(seed: RefinedBlur, judge: &impl Fn(Psf) -> RefinedBlur) -> RefinedBlur {
    let mut found = seed;
    for halving in 0..HALVINGS {
        while let Some(better) =
            best(found.entry.psf.steps(halving).map(judge)).filter(|other| other.fit.loss < found.fit.loss)
        {
            found = better;
        }
    }

    found
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

        let blurred = scene.clone().zip(&response.values).map(|(power, left)| power * left + noise);
        let binned = [blurred.collect(), scene.map(|power| power + noise).collect()];

        let powers = Powers { binned, least_high: [0.0; 2] };
        let [evidence, _] = BlurEvidence::of_both(&powers, [noise; 2], Level::best());
        evidence
    }

    #[test]
    fn sizes_and_angles_between_those_of_the_bank_are_found() {
        let psfs = [
            Psf::gaussian(2.43),
            Psf::gaussian(6.2),
            Psf::disk(0.6),
            Psf::disk(3.55),
            Psf::disk(7.1),
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
            assert_eq!(found.family, Psf::disk(1.0).family, "{found:?}");
        }
    }

    #[test]
    fn sizes_stay_within_what_blocks_see() {
        for psf in [Psf::gaussian(16.0), Psf::disk(28.0), Psf::motion(62.0, 0.0), Psf::annulus(28.0, 0.5)] {
            let found = refine(&evidence(psf), Level::best()).entry.psf;
            assert!(found.family.contains(&found), "{found:?}");
        }
    }

    #[test]
    fn no_blur_becomes_a_very_small_one() {
        let found = refine(&evidence(Psf::gaussian(0.1)), Level::best());
        assert!(found.entry.psf.spread() < 0.3, "{:?}", found.entry.psf);
    }
}

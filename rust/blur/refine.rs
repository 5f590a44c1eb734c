//! From the nearest of a coarse choice to the size and the direction of a blur.

use super::bank::{Entry, bank};
use super::fit::{Evidence, Fit};
use crate::psf::{Family, Psf};
use crate::simd::Level;

/// First step of the size, as a share of it; halved until it is a fiftieth of that.
const STEP: f64 = 0.2;
/// First step of the direction, degrees; halved along with that of the size.
const TURN: f64 = 8.0;
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
pub fn refine(evidence: &Evidence, level: Level) -> Found {
    let judge = |entry: Entry| {
        let fit = evidence.fit(&entry.response, level);
        Found { entry, fit }
    };
    let families = [Family::Gaussian, Family::Disk, Family::Motion];
    let seeds = families.map(|family| {
        let members = bank().iter().filter(|entry| entry.psf.family == family);
        best(members.cloned().map(judge))
    });
    let seeds: Vec<Found> = seeds.into_iter().flatten().collect();
    let least = seeds.iter().map(|found| found.fit.loss).fold(f32::INFINITY, f32::min);
    let hopeful = seeds.into_iter().filter(|found| found.fit.loss <= HOPELESS * least + 0.02);
    let refined = hopeful.map(|seed| descend(seed, &judge));
    // There is always the one with the least loss.
    best(refined).unwrap_or_else(|| judge(bank()[0].clone()))
}

/// Goes where the loss falls, in ever smaller steps.
fn descend(seed: Found, judge: &impl Fn(Entry) -> Found) -> Found {
    let mut found = seed;
    for halving in 0..HALVINGS {
        let (grow, turn) = (STEP / f64::from(1 << halving), TURN / f64::from(1 << halving));
        while let Some(better) =
            best(neighbours(found.entry.psf, grow, turn).map(Entry::new).map(judge))
                .filter(|other| other.fit.loss < found.fit.loss)
        {
            found = better;
        }
    }
    found
}

fn neighbours(psf: Psf, grow: f64, turn: f64) -> impl Iterator<Item = Psf> {
    let sizes = [1.0 - grow, 1.0 + grow].map(|factor| Psf { size: psf.size * factor, ..psf });
    let angles = [turn, -turn].map(|by| Psf { angle: (psf.angle + by).rem_euclid(180.0), ..psf });
    let turns = if psf.family == Family::Motion { 2 } else { 0 };
    let within = |psf: &Psf| psf.size <= largest(psf.family);
    sizes.into_iter().chain(angles.into_iter().take(turns)).filter(within)
}

/// Blocks see no kernels that are larger than half of them.
fn largest(family: Family) -> f64 {
    match family {
        Family::Gaussian => 8.0,
        Family::Disk => 14.0,
        Family::Motion => 31.0,
    }
}

fn best(found: impl Iterator<Item = Found>) -> Option<Found> {
    found.reduce(|a, b| if b.fit.loss < a.fit.loss { b } else { a })
}

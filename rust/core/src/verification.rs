//! A second opinion on a disparity map of any origin: which of its pixels the images refute, support, or cannot judge.
//!
//! The pair is prepared as for a match (rows, blur, light, noise) and matched over the disparities that were found and
//! those that the map claims. The match is one witness, the costs at the claims another; a claim is refuted by what both
//! say of the area around it:
//!
//! ```text
//! pair, estimates = prepare(pair)                         # as for a match
//! claims          = finite disparities of the map         # is their sign or their scale another one?
//! own             = match(pair, range found + range claimed)
//! for each pixel with a claim:
//!     refuted   if the score of `test` is high, and the own match holds the pixel for visible
//!     supported if own and claim differ by at most 1.5 px, and the own match is confident
//!     unknown   else
//! ```
//!
//! What the right image does not see it cannot refute, as far as the own match and the map know of it.

pub mod evidence;
mod findings;
pub mod hypotheses;
pub mod test;

use crate::estimation::facts::Facts;
use crate::estimation::{Prepared, complete, prepare};
use crate::finding::Finding;
use crate::findings::with_findings;
use crate::verification::evidence::Evidence;
use crate::verification::hypotheses::Misreading;
use crate::verification::test::Test;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;

/// What the images say of a claim.
pub mod verdict {
    /// The map claims no disparity here.
    pub const NO_CLAIM: u8 = 0;
    /// The images cannot judge the claim.
    pub const UNKNOWN: u8 = 1;
    /// The images support the claim.
    pub const SUPPORTED: u8 = 2;
    /// The images refute the claim.
    pub const REFUTED: u8 = 3;
}

/// What the images say of a disparity map.
#[derive(Debug)]
pub struct Verification {
    /// Codes of [`verdict`].
    pub verdicts: Plane<u8>,
    /// The disparity of the own match where the claim is refuted, NaN elsewhere.
    pub better: Plane<f32>,
    /// Numbers of pixels by verdict, and of claims that lie outside the right image.
    pub counts: Counts,
    /// What there is to say of the map as a whole, worst first.
    pub findings: Vec<Finding>,
    /// The own match.
    pub own: Disparity,
    /// The pair as it was matched, and what was estimated of it.
    pub prepared: Prepared,
}

/// Numbers of pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Pixels by their verdict.
    pub verdicts: [u64; 4],
    /// Pixels whose claim lies outside the right image.
    pub outside: u64,
}

impl Counts {
    /// Pixels with a claim.
    pub fn claims(self) -> u64 {
        self.verdicts[usize::from(verdict::UNKNOWN)..].iter().sum()
    }

    /// The share of the claims with a verdict.
    pub fn share(self, verdict: u8) -> f64 {
        self.verdicts[usize::from(verdict)] as f64 / self.claims().max(1) as f64
    }
}

/// Judges a disparity map of the left image, in pixels; what is not finite claims nothing.
pub fn verify(
    pair: Pair,
    map: &Plane<f32>,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Verification> {
    let (rows, cols) = pair.size();
    if (map.rows(), map.cols()) != (rows, cols) {
        let got = format!("{} x {} pixels", map.rows(), map.cols());
        return Err(Error::value(
            "disparity",
            got,
            format!("the size of the images, {rows} x {cols}"),
        ));
    }
    if !map.as_slice().iter().any(|claim| claim.is_finite()) {
        let accepts = "a map in which some pixel claims a disparity";
        return Err(Error::value("disparity", "no finite value", accepts));
    }

    // What is judged are the confidences of the own match, so it has some whatever the settings say.
    let settings = Settings { confidence: true, ..settings.clone() };
    let (pair, estimates) = complete(pair, facts, &settings, runtime)?;
    let estimates = with_findings(estimates, &pair, &settings);
    let mut prepared = prepare(pair, estimates, facts, &settings, runtime)?;
    let Runtime { matcher, execution, control } = runtime;
    let pair = &prepared.pair;
    // Any pair of columns can be compared where disparity 0 is a candidate.
    let any = Candidates::new(0, 1, cols)?;
    let compensation = pair.blur_compensation();
    let costs =
        Costs::new(pair.views(), any, &prepared.settings, compensation, execution.level, control)?;

    let misreading = Misreading::of(map, &costs);
    let found = prepared.estimates.candidates.value;
    let searched = match misreading {
        None => hypotheses::widened(found, map),
        Some(_) => found,
    };

    let pair = pair.clone().searched(searched);
    let own = matcher.match_pair(&pair, &prepared.settings, execution, control)?;

    let evidence = Evidence::new(map, &own, &costs, execution.level, control)?;
    let test = Test { map, own: &own, evidence: &evidence };
    let (verdicts, better, counts) = test.judge(execution.level, control)?;
    drop(costs);

    prepared.pair = pair;
    prepared.estimates.candidates.value = searched;
    let findings = findings::findings(counts, misreading);
    Ok(Verification { verdicts, better, counts, findings, own, prepared })
}

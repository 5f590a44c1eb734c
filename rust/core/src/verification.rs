//! A second opinion on a disparity map from any source: which of its pixels the images refute, support, or
//! cannot judge.
//!
//! The pair is prepared as for a match (rows, blur, light, noise) and matched over the disparities that were
//! found and those that the map claims. The match is one witness, the costs at the claims another; a claim is
//! refuted by the evidence of both in the area around it:
//!
//! ```text
//! pair, estimates = prepare(pair)                         # as for a match
//! claims          = finite disparities of the map         # possibly with another sign or scale
//! own             = match(pair, range found + range claimed)
//! for each pixel with a claim:
//!     refuted   if the score of `test` is high, and the own match considers the pixel visible
//!     supported if own and claim differ by at most 1.5 px, and the own match is confident
//!     unknown   else
//! ```
//!
//! The images cannot refute a claim about a point that the right image does not show, as far as the own match
//! and the map show this.

mod claims;
pub mod evidence;
mod findings;
pub mod fuse;
pub mod hypotheses;
pub mod judge;
pub mod second;
pub mod test;
pub mod traits;

use crate::estimation::facts::Facts;
use crate::finding::Finding;
use crate::match_pair::{Matched, Ready, made_ready};
use crate::verification::claims::Claims;
use crate::verification::hypotheses::{Misreading, Sample};
use crate::verification::test::Test;
use crate::verification::traits::{TRAITS, Traits, Values};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;

/// Verdicts of the images on a claim.
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

/// The verdict of the images on a disparity map, in the pixels of the original left image.
#[derive(Debug)]
pub struct Verification {
    /// Codes of [`verdict`].
    pub verdicts: Plane<u8>,
    /// The disparity of the own match where the claim is refuted, NaN elsewhere.
    pub better: Plane<f32>,
    /// The probability that the claim is within 1 px of the true disparity; 0 without a claim.
    pub confidence: Plane<f32>,
    /// The error bar of the claim, pixels: it holds 90 % of the errors; NaN without a claim.
    pub uncertainty: Plane<f32>,
    /// Numbers of pixels by verdict, and of claims that lie outside the right image.
    pub counts: Counts,
    /// Findings about the map as a whole, worst first.
    pub findings: Vec<Finding>,
    /// The own match.
    pub matched: Matched,
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

/// Judges a disparity map of the left image, in pixels; non-finite values make no claim.
pub fn verify(
    pair: Pair,
    map: &Plane<f32>,
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Verification> {
    let ready = made_ready(pair, &facts.along_rows(), settings, runtime)?;
    judged(ready, map, settings, runtime)
}

/// [`verify`] for a pair that is ready to be matched by these settings, along its rows.
pub fn judged(
    mut ready: Ready,
    map: &Plane<f32>,
    settings: &Settings,
    runtime: Runtime,
) -> Result<Verification> {
    // The judgment uses the confidences of the own match, so they are computed whatever the settings.
    let settings = Settings { confidence: true, ..settings.clone() };
    ready.prepared.settings.confidence = true;
    let size = ready.prepared.pair.size();
    let claims = Claims::new(map, size, ready.raw.as_deref(), runtime.control)?;

    let pair = ready.prepared.pair.clone();
    let costs = any_costs(&pair, &ready.prepared.settings, runtime)?;
    let misreading = Misreading::of(&Sample::new(&claims.matched), &costs);
    if misreading.is_none() {
        let estimates = &mut ready.prepared.estimates;
        estimates.candidates.value = hypotheses::widened(estimates.candidates.value, &claims.matched);
        ready.prepared.pair = pair.clone().searched(estimates.candidates.value);
    }

    let matched = ready.matched(&settings, runtime)?;
    let traits = Traits::new(&claims.matched, matched.own(), &pair, runtime)?;
    let chances = judge::chances(&traits, runtime)?;
    let against = evidence::against(&claims.matched, matched.own(), &costs, runtime)?;
    let test = Test { map: &claims.matched, own: matched.own(), against: &against };
    let (verdicts, counts) = test.judge(runtime)?;

    let mut verdicts = claims.raw(verdicts, verdict::NO_CLAIM);
    for (verdict, claim) in verdicts.as_mut_slice().iter_mut().zip(map.as_slice()) {
        // Claims outside the rectified image cannot be judged.
        if *verdict == verdict::NO_CLAIM && claim.is_finite() {
            *verdict = verdict::UNKNOWN;
        }
    }
    let mut better = matched.map.disparity.clone();
    for (better, verdict) in better.as_mut_slice().iter_mut().zip(verdicts.as_slice()) {
        if *verdict != verdict::REFUTED {
            *better = f32::NAN;
        }
    }

    Ok(Verification {
        verdicts,
        better,
        confidence: claims.raw(chances.map(|found| found.confidence), 0.0),
        uncertainty: claims.raw_lengths(chances.map(|found| found.bar)),
        counts,
        findings: findings::findings(counts, misreading),
        matched,
    })
}

/// A match, and the traits of the claims of several maps, in the original left image; NaN without a claim.
/// The weights of [`judge`] are learned from these.
pub fn observe(
    pair: Pair,
    maps: &[Plane<f32>],
    facts: &Facts,
    settings: &Settings,
    runtime: Runtime,
) -> Result<(Matched, Vec<Plane<Values>>)> {
    let settings = Settings { confidence: true, ..settings.clone() };
    let size = pair.size();
    let ready = made_ready(pair, &facts.along_rows(), &settings, runtime)?;
    let matched = ready.matched(&settings, runtime)?;
    let raw = matched.rectified.as_ref().map(|rectified| &*rectified.raw);
    let traits = |map| {
        let claims = Claims::new(map, size, raw, runtime.control)?;
        let pair = &matched.prepared.pair;
        let traits = Traits::new(&claims.matched, matched.own(), pair, runtime)?;
        let values = traits.by_rows(runtime.control, |traits, row: &mut [Values]| traits.write(row))?;
        Ok(claims.raw(values, [f32::NAN; TRAITS]))
    };
    let traits = maps.iter().map(traits).collect::<Result<_>>()?;
    Ok((matched, traits))
}

/// The costs of a pair, between any two columns.
fn any_costs<'a>(pair: &'a Pair, settings: &Settings, runtime: Runtime) -> Result<Costs<'a>> {
    let Runtime { execution, control, .. } = runtime;
    // That holds if disparity 0 is a candidate.
    let any = Candidates::new(0, 1, pair.size().1)?;
    Costs::new(pair.views(), any, settings, pair.blur_compensation(), execution.level, control)
}

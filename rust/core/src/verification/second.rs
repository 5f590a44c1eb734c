//! A match and a second map of the same pair -> the map of both.
//!
//! ```text
//! claims  = the second map, converted to the pair to match         # crate::preparation::back, claims.rs
//! no claims of a matcher, or numbers that are not pixels: the match stays unchanged, and a finding gives
//! the reason (a given map without claims is an error); another reports if many are outside the right image
//! chances = the chance that each claim is right                    # traits.rs, judge.rs
//! map     = the mean where both agree, else the one that is more likely right        # fuse.rs
//! flat areas of it become planes: both together have more evidence than the match    # crate::scales
//! ```

use crate::finding::Finding;
use crate::match_pair::Matched;
use crate::preparation::back::Back;
use crate::scales::draw_planes;
use crate::verification::claims::Claims;
use crate::verification::findings::{failed, of_second};
use crate::verification::fuse::fuse;
use crate::verification::hypotheses::{Misreading, Sample};
use crate::verification::traits::Traits;
use crate::verification::{any_costs, judge};
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::runtime::Runtime;

/// Least share of the claims that agree with the own disparities if they are disparities in pixels: claims of
/// another sign or scale agree by chance. Not swept.
const READ_RIGHT: f32 = 0.25;

/// The source of the second map of a match.
#[derive(Debug)]
pub enum Second {
    /// A given map of the original left image, in pixels; non-finite values make no claim.
    Map(Plane<f32>),
    /// The answer of a matcher to the prepared pair: a map, or a failure.
    Answer {
        /// The name of the matcher in findings.
        name: String,
        /// The map of the prepared left image and its conversion back, or the reason for the failure.
        answer: Box<std::result::Result<(Plane<f32>, Back), String>>,
    },
}

/// A match that is not turned back yet, fused with a second map; and the findings about that.
pub fn fused(matched: Matched, second: Second, runtime: Runtime) -> Result<(Matched, Vec<Finding>)> {
    let claims = match second.claims(&matched, runtime)? {
        Ok(claims) => claims,
        Err(finding) => return Ok((matched, vec![finding])),
    };

    let pair = &matched.prepared.pair;
    let traits = Traits::new(&claims, matched.own(), pair, runtime)?;
    let sample = Sample::new(&claims);
    let misreading = if traits.agreement() < READ_RIGHT {
        let costs = any_costs(pair, &matched.prepared.settings, runtime)?;
        Misreading::of(&sample, &costs)
    } else {
        None
    };
    let said = of_second(sample.counts(), misreading);
    if misreading.is_some() {
        return Ok((matched, said));
    }

    let chances = judge::chances(&traits, runtime)?;
    let wrong = matched.summary().wrong;
    let Matched { map, prepared, rectified, .. } = matched;
    let (own, raw) = match rectified {
        Some(rectified) => (rectified.map, Some((rectified.raw, rectified.rasters))),
        None => (map, None),
    };
    let mut map = fuse(own, &claims, &chances, wrong, runtime)?;
    draw_planes(&mut map, &prepared, runtime)?;

    let map = map.returned(&prepared.settings);
    Ok((Matched::new(raw, map, prepared, runtime.control)?, said))
}

impl Second {
    /// The claims about the pair to match; or the finding about a matcher that has none.
    fn claims(
        self,
        matched: &Matched,
        Runtime { control, .. }: Runtime,
    ) -> Result<std::result::Result<Plane<f32>, Finding>> {
        let (name, answer) = match self {
            Self::Map(map) => {
                let map = if matched.prepared.pair.is_turned() { map.turned() } else { map };
                let raw = matched.treatment().raw;
                let claims = Claims::new(&map, matched.prepared.pair.size(), raw, control);
                return Ok(Ok(claims.map_err(|error| error.about("second"))?.matched));
            }
            Self::Answer { name, answer } => (name, *answer),
        };

        let claims = match answer.map(|(map, back)| back.matched(&map, control)) {
            Ok(Err(error @ Error::Value { .. })) => Err(error.to_string()),
            Ok(claims) => Ok(claims?),
            Err(reason) => Err(reason),
        };
        let claims = claims.and_then(|claims| {
            let has_any = claims.as_slice().iter().any(|claim| claim.is_finite());
            if has_any { Ok(claims) } else { Err("no pixel has a disparity".to_owned()) }
        });
        Ok(claims.map_err(|reason| failed(&name, &reason)))
    }
}

//! A match and a second map of the same pair -> the map of both.
//!
//! ```text
//! claims  = the second map, of the pair as it is matched           # crate::preparation::back, claims.rs
//! none, or numbers that mean something else than pixels: the match stays as it is, and a finding says why;
//! one says, too, that many lie outside the right image
//! chances = how likely each claim is right                         # traits.rs, judge.rs
//! map     = the mean where both agree, else the one that is more likely right        # fuse.rs
//! flat areas of it become planes: what both know is more than the match knew         # crate::scales
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

/// Share of the claims that agree with the own disparities from which on these are disparities in pixels: claims
/// of another sign or scale agree by chance. Not swept.
const READ_RIGHT: f32 = 0.25;

/// Where the second map of a match comes from.
#[derive(Debug)]
pub enum Second {
    /// It is given: of the left image as it came, in pixels; what is not finite claims nothing.
    Map(Plane<f32>),
    /// A matcher has made it of the pair as it was prepared, or failed.
    Answer {
        /// What findings call the matcher.
        name: String,
        /// The map of the prepared left image and how it comes back, or the reason why it failed.
        answer: Box<std::result::Result<(Plane<f32>, Back), String>>,
    },
}

/// A match that is not turned back yet, with a second map taken in; and what there is to say of that.
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
        Some(rectified) => (rectified.map, Some((rectified.raw, rectified.even_rows))),
        None => (map, None),
    };
    let mut map = fuse(own, &claims, &chances, wrong, runtime)?;
    draw_planes(&mut map, &prepared, runtime)?;

    let map = map.returned(&prepared.settings);
    Ok((Matched::new(raw, map, prepared, runtime.control)?, said))
}

impl Second {
    /// The claims of the pair as it is matched; or what there is to say of a matcher without any.
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

//! Findings on a map as a whole.

use std::cmp::Reverse;

use crate::finding::{Finding, Severity, Topic};
use crate::verification::claims::Misreading;
use crate::verification::{Counts, verdict};

/// Shares of the claims that are refuted from which on that is noted, and warned of.
const MANY: [f64; 2] = [0.1, 0.3];
/// The same of claims outside the right image; occlusions at the left edge are seldom more.
const OUTSIDE: [f64; 2] = [0.15, 0.5];
/// Share of the claims that cannot be judged from which on that is noted.
const UNKNOWN: f64 = 0.5;

/// All there is to say, worst first.
pub fn findings(counts: Counts, misreading: Option<Misreading>) -> Vec<Finding> {
    let mut findings: Vec<_> =
        [misreading.map(meant), Some(shares(counts)), outside(counts), unknown(counts)]
            .into_iter()
            .flatten()
            .collect();

    // The order of sentences of one severity stays.
    findings.sort_by_key(|finding| Reverse(finding.severity));
    findings
}

fn meant(misreading: Misreading) -> Finding {
    let sentence = match misreading {
        Misreading::Sign => "the sign of the map is inverted: its negative fits the images, and a disparity is the left \
                             column minus the right one; pass -disparity"
            .into(),
        Misreading::Parts(parts) => {
            let who = if parts == 16 { "OpenCV's matchers return" } else { "KITTI's files have" };
            format!(
                "the map is {parts} times too large: it fits the images in {parts}ths of a pixel, as {who} them; pass \
                 disparity / {parts}"
            )
        }
    };

    Finding::warning(Topic::Map, sentence)
}

fn shares(counts: Counts) -> Finding {
    let [unknown, supported, refuted] =
        [verdict::UNKNOWN, verdict::SUPPORTED, verdict::REFUTED].map(|which| counts.share(which));

    let sentence = format!(
        "the images refute {} of the disparities, support {}, and cannot judge {}",
        percent(refuted),
        percent(supported),
        percent(unknown)
    );
    Finding::new(Topic::Map, Severity::of(refuted, MANY), sentence)
}

fn outside(counts: Counts) -> Option<Finding> {
    let share = counts.outside as f64 / counts.claims().max(1) as f64;
    let sentence = || {
        format!(
            "{} of the disparities lie outside the right image: are they pixels of this left image?",
            percent(share)
        )
    };

    let severity = Severity::of(share, OUTSIDE);
    (severity != Severity::Ok).then(|| Finding::new(Topic::Map, severity, sentence()))
}

fn unknown(counts: Counts) -> Option<Finding> {
    let share = counts.share(verdict::UNKNOWN);
    let sentence = "most of the map cannot be judged: the images show too little there, or the match is not sure either";

    (share > UNKNOWN).then(|| Finding::note(Topic::Map, sentence))
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

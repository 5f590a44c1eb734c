//! The findings about a map as a whole.

use std::cmp::Reverse;

use crate::finding::{Finding, Severity, Topic};
use crate::findings::table::Grade::{Levels, Warning};
use crate::findings::table::{Measured, Row, evaluated, table, value, when};
use crate::verification::hypotheses::Misreading;
use crate::verification::{Counts, verdict};

/// A map that was verified.
struct Verified {
    counts: Counts,
    misreading: Option<Misreading>,
}

/// Most characters of a reason.
const LONGEST: usize = 200;
const SHARES: &str = "the images refute {0} of the disparities, support {1}, and cannot judge {2}";

table! {
    /// All findings about a map.
    MAP of map: Verified;
    Map, Warning, when(map.misreading == Some(Misreading::Sign), []),
        "the sign of the map is inverted: its negative fits the images, and a disparity is the left column minus the \
         right one; pass -disparity";
    Map, Warning, parts(map),
        "the map is {0} times too large: it fits the images in {0}ths of a pixel, as {1} them; pass disparity / {0}";
    // A share of the disparities.
    Map, Levels([0.1, 0.3]), value(map.counts.share(verdict::REFUTED), shares(map.counts)), SHARES, well(SHARES);
    // A share of the disparities; occlusions at the left edge are seldom more.
    Map, Levels([0.15, 0.5]), outside(map.counts),
        "{0} of the disparities lie outside the right image: are they pixels of this left image?";
    // A share of the disparities.
    Map, Levels([0.5, f64::INFINITY]), value(map.counts.share(verdict::UNKNOWN), []),
        "most of the map cannot be judged: the images show too little there, or the match is not sure either";
}

/// The findings about a map, the worst first.
pub fn findings(counts: Counts, misreading: Option<Misreading>) -> Vec<Finding> {
    let map = Verified { counts, misreading };
    let mut findings = evaluated(MAP, |measure| measure(&map));
    findings.sort_by_key(|finding| Reverse(finding.severity));
    findings
}

/// The findings about a second map before it is judged: numbers that are not disparities in pixels, or many
/// outside the right image.
pub fn of_second(counts: Counts, misreading: Option<Misreading>) -> Vec<Finding> {
    let mut findings = findings(counts, misreading);
    findings.retain(|finding| finding.severity == Severity::Warning);
    findings
}

/// The finding about a second matcher that returned no map.
pub fn failed(name: &str, reason: &str) -> Finding {
    let reason: String = reason.lines().next().unwrap_or_default().chars().take(LONGEST).collect();
    let sentence =
        format!("the second matcher {name} failed, and the map is that of the match alone: {reason}");
    Finding::new(Topic::Map, Severity::Warning, sentence)
}

fn parts(map: &Verified) -> Vec<Measured> {
    let Some(Misreading::Parts(parts)) = map.misreading else { return vec![] };
    let who = if parts == 16 { "OpenCV's matchers return" } else { "KITTI's files have" };
    value(0.0, [parts.to_string(), who.to_owned()])
}

fn shares(counts: Counts) -> [String; 3] {
    [verdict::REFUTED, verdict::SUPPORTED, verdict::UNKNOWN].map(|which| percent(counts.share(which)))
}

fn outside(counts: Counts) -> Vec<Measured> {
    let share = counts.outside as f64 / counts.claims().max(1) as f64;
    value(share, [percent(share)])
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

//! Findings on a match: how much of it is wrong, and because of what.

use super::levels::{AT_END, FLAGGED, WRONG};
use super::{Finding, Severity, Topic};
use crate::pipeline::summary::Summary;
use crate::rig::estimation::Estimates;
use crate::rig::estimation::overview::LEAST_SIZE;

/// What to look at where no cause is known.
const ADVICE: &str =
    "check that rows correspond, the range of disparities, noise, focus and repeated texture";

/// What there is to say about a match of so many rows and columns, the worst first; nothing if all is well, or the images
/// are too small to tell.
pub fn of_match(
    estimates: &Estimates,
    summary: &Summary,
    (rows, cols): (usize, usize),
) -> Vec<Finding> {
    if rows.min(cols) < LEAST_SIZE {
        return vec![];
    }

    let mut findings: Vec<Finding> = estimates.findings.iter().filter_map(of_matched_pair).collect();
    findings.extend(ends(estimates, summary, &findings));
    findings.extend(failure(summary, &findings));

    // Of equal ones, the match comes first, then the topics as they are.
    findings.sort_by_key(|one| (std::cmp::Reverse(one.severity), one.topic != Topic::Match));
    findings
}

/// A finding on the pair as the match has it: what it has evened out or suffered from is no more than a note.
fn of_matched_pair(found: &Finding) -> Option<Finding> {
    let most = if found.topic.is_decisive() { Severity::Warning } else { Severity::Note };

    (found.severity != Severity::Ok && !found.is_unknown)
        .then(|| Finding { severity: found.severity.min(most), ..found.clone() })
}

/// That the range is too short at an end, unless that is said already.
fn ends(estimates: &Estimates, summary: &Summary, known: &[Finding]) -> Option<Finding> {
    if known.iter().any(|one| one.topic == Topic::Range) {
        return None;
    }

    let candidates = estimates.candidates;
    let (first, last) = (candidates.min(), candidates.disparity(candidates.count() - 1));
    let share = summary.at_low.max(summary.at_high);
    let end = if summary.at_low > summary.at_high { first } else { last };

    let severity = Severity::of(share, AT_END);
    (severity != Severity::Ok).then(|| {
        let share = 100.0 * share;
        let sentence = format!(
            "the range of {first} to {last} px is too short: {share:.0} % of the pixels are at its \
             end at {end} px; search more disparities there, or leave num_disparities out"
        );
        Finding::new(Topic::Range, severity, sentence)
    })
}

/// That much of the match is wrong, and because of what.
fn failure(summary: &Summary, known: &[Finding]) -> Option<Finding> {
    let causes = causes(known);
    let because =
        if causes.is_empty() { format!(": {ADVICE}") } else { format!(", because of {causes}") };

    if !summary.wrong.is_nan() {
        let share = 100.0 * summary.wrong;
        return (summary.wrong >= WRONG).then(|| {
            let sentence = format!("about {share:.0} % of the pixels are probably wrong{because}");
            Finding::warning(Topic::Match, sentence)
        });
    }

    let severity = Severity::of(summary.flagged, FLAGGED);
    (severity != Severity::Ok).then(|| {
        let share = 100.0 * summary.flagged;
        let sentence = format!("{share:.0} % of the pixels fail the left-right check{because}");
        Finding::new(Topic::Match, severity, sentence)
    })
}

/// The causes that the findings name, in words.
fn causes(known: &[Finding]) -> String {
    let mut causes: Vec<&str> = vec![];
    for one in known {
        let cause = cause(one);
        if !causes.contains(&cause) {
            causes.push(cause);
        }
    }

    match causes.as_slice() {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

fn cause(found: &Finding) -> &'static str {
    match found.topic {
        Topic::Match => "images that hardly match",
        Topic::Swap => "images that seem to be swapped",
        Topic::Range => "a range that is too short",
        Topic::Alignment => "rows that do not correspond",
        Topic::Blur => "blur",
        Topic::Contrast => "different exposure",
        Topic::Noise => "noise",
        Topic::Coding => "lossy compression",
        Topic::Saturation => "saturated areas",
        Topic::Texture => "areas without texture",
        Topic::Repetition => "texture that repeats itself",
        Topic::Interlacing => "interlaced fields",
    }
}

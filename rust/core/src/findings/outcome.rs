//! Findings on a match: how much of it is wrong, and why.

use std::cmp::Reverse;

use super::choices::{AT_ZERO, MENTIONED, PLAIN, SMEARED};
use super::table::Grade::{Levels, Note};
use super::table::{Measured, Row, evaluated, levels, percent, table, value, when};
use crate::estimation::estimates::Estimates;
use crate::estimation::overview::LEAST_SIZE;
use crate::estimation::range::LEAST_CONFIDENCE;
use crate::finding::{Finding, Severity, Topic};
use phasestereo_match::matcher::summary::Summary;

/// A match of a pair, and the findings on the pair that matter to it.
struct Outcome<'a> {
    estimates: &'a Estimates,
    summary: &'a Summary,
    known: Vec<Finding>,
}

table! {
    /// The share of a match that is wrong.
    FAILURES of outcome: Outcome;
    // A share of the pixels. Of 532 pairs under 28 kinds of faults, it warns of all but one of the 215 with
    // 30 % wrong pixels or more, and of 4 of the 192 with less than 15 %.
    Match, Levels([0.25, 0.25]), outcome.failed(outcome.summary.wrong),
        "about {0} of the pixels are probably wrong{1}";
    // A share of the pixels, if the share of wrong ones is unknown: up to 22 % on 12 pairs, 43 % or more on
    // unrelated images, 38 % or more with rows 2 px off.
    Match, Levels([0.25, 0.35]),
        if outcome.summary.wrong.is_nan() { outcome.failed(outcome.summary.flagged) } else { vec![] },
        "{0} of the pixels fail the left-right check{1}";
}

table! {
    /// Other properties of a map.
    MAP of outcome: Outcome;
    // A share of the pixels, minus the share that wrong matches have by chance. At the upper end, up to 0.3 %
    // on 13 pairs, and 5 % or more with a third of the range, with any preset.
    Range, Levels([0.01, 0.02]), ends(outcome),
        "the range of {0} px is too short: {1} of the pixels are at its end at {2} px; search more disparities there{3}",
        cause("a range that is too short", f64::NEG_INFINITY);
    Texture, Note, when(outcome.is_plain(outcome.summary.coarse),
            [percent(outcome.summary.coarse), format!("{:.0}", outcome.summary.detail)]),
        "{0} of the disparities were decided by smaller copies: there the images show no detail finer than about {1} px",
        cause("areas without texture", 0.0);
    Texture, Note, when(outcome.is_plain(outcome.summary.inferred), [percent(outcome.summary.inferred)]),
        "{0} of the disparities are those of planes fitted to flat areas, which show nothing to match",
        cause("areas without texture", 0.0);
    Match, Note, when(outcome.summary.is_cut_short, []),
        "the budget left no time for smaller copies and planes";
}

/// The share of wrong pixels from which a match has a warning.
pub fn most_wrong() -> f64 {
    levels(FAILURES, Topic::Match)[1]
}

/// The finding on a match during which a device failed.
pub fn device_failed(reason: &str) -> Finding {
    let sentence = format!("the GPU failed, and the processor took over, with the same result: {reason}");
    Finding::note(Topic::Match, sentence)
}

/// The findings on a match of this size, worst first; none if all is well, or if the images are too small to
/// judge.
pub fn of_match(estimates: &Estimates, summary: &Summary, (rows, cols): (usize, usize)) -> Vec<Finding> {
    if rows.min(cols) < LEAST_SIZE {
        return vec![];
    }

    let mut outcome = Outcome { estimates, summary, known: vec![] };
    outcome.known = estimates.findings.iter().filter_map(|found| outcome.of_pair(found)).collect();
    let of_map = evaluated(MAP, |measure| measure(&outcome));
    outcome.known.extend(of_map);
    let failure = evaluated(FAILURES, |measure| measure(&outcome));

    // Of equally severe ones, the match comes first, then the topics in their order.
    let mut findings = outcome.known;
    findings.sort_by_key(|one| (Reverse(one.severity), one.topic != Topic::Match));
    let is_worse = |one: &Finding| failure.iter().any(|failure| one.severity > failure.severity);
    let first = findings.partition_point(is_worse);
    findings.splice(first..first, failure);
    findings
}

/// Why the match of a copy of a pair cannot be trusted as a whole, in addition to the findings on the pair.
pub fn of_copy(
    estimates: Estimates,
    summary: &Summary,
    (rows, cols): (usize, usize),
    is_smaller: bool,
    of_pair: &[Finding],
) -> Vec<Finding> {
    let estimates = Estimates { findings: of_pair.to_vec(), ..estimates };
    let mut failed = of_match(&estimates, summary, (rows, cols));
    failed.retain(|one| {
        let is_known = of_pair.iter().any(|known| known.sentence == one.sentence);
        one.topic == Topic::Match && one.severity == Severity::Warning && !is_known
    });
    if is_smaller {
        for one in &mut failed {
            one.sentence = format!("{} (a copy of {cols} x {rows} pixels was matched)", one.sentence);
        }
    }
    failed
}

impl Outcome<'_> {
    /// A finding on the pair for its match: faults that it compensated or suffered from are notes.
    fn of_pair(&self, found: &Finding) -> Option<Finding> {
        if found.severity == Severity::Ok || found.is_unknown {
            return None;
        }

        // Small copies may differ where whole images match: the map has to pass what the copies failed.
        let failed = found.topic == Topic::Match && found.severity == Severity::Warning;
        if failed && 1.0 - self.summary.wrong >= LEAST_CONFIDENCE {
            return None;
        }
        let most = if found.topic.is_decisive() { Severity::Warning } else { Severity::Note };
        Some(Finding { severity: found.severity.min(most), ..found.clone() })
    }

    /// A share of the pixels that failed, and the causes, as far as known.
    fn failed(&self, share: f64) -> Vec<Measured> {
        // The only fault is that there is nothing to match; a finding on the pair reports it.
        if self.estimates.is_one_image() {
            return vec![];
        }
        let mut causes: Vec<&str> = vec![];
        for one in &self.known {
            if !one.cause.is_empty() && !causes.contains(&one.cause) {
                causes.push(one.cause);
            }
        }
        let smeared = self.estimates.photometry.map_or([0.0; 2], |found| found.smeared);
        if causes.is_empty() && smeared[0].max(smeared[1]) >= SMEARED {
            causes.push("smeared texture (lossy compression, denoising or focus)");
        }

        let because = match causes.as_slice() {
            [] => ": check that rows correspond, the range of disparities, noise, focus and repeated texture"
                .to_owned(),
            [one] => format!(", because of {one}"),
            [first @ .., last] => format!(", because of {} and {last}", first.join(", ")),
        };
        value(share, [percent(share), because])
    }

    /// Whether much of the image has too little detail for its size, and this share of the pixels deserves a
    /// finding.
    fn is_plain(&self, share: f64) -> bool {
        self.summary.coarse + self.summary.inferred >= PLAIN && share >= MENTIONED
    }
}

/// The share of the pixels at the fuller end of the range, unless it is reported already, or nothing matches
/// anyway.
fn ends(outcome: &Outcome) -> Vec<Measured> {
    let Outcome { estimates, summary, known } = outcome;
    let is_decided = |one: &Finding| matches!(one.topic, Topic::Match | Topic::Range);
    let is_reported = known.iter().any(|one| is_decided(one) && one.severity == Severity::Warning);
    let is_unlike = estimates.confidence.is_some_and(|found| found < LEAST_CONFIDENCE);
    if is_reported || is_unlike {
        return vec![];
    }

    let candidates = estimates.candidates.value;
    let (first, last) = (candidates.min(), candidates.max());
    let Summary { at_low, at_high, wrong, flagged, .. } = **summary;
    // Infinitely distant points lie at 0.
    let is_well = evaluated(FAILURES, |measure| measure(outcome)).is_empty() || at_low < AT_ZERO;
    let at_low = if first == 0 && is_well { 0.0 } else { at_low };
    let (share, end) = if at_low > at_high { (at_low, first) } else { (at_high, last) };

    let is_found =
        estimates.range.as_ref().is_some_and(|range| (range.min, range.count) == candidates.numbers());
    let remedy = if is_found { "" } else { ", or leave num_disparities out" };
    // Wrong matches lie anywhere in the range, including its ends.
    let by_chance = 2.0 * if wrong.is_nan() { flagged } else { wrong } / candidates.count() as f64;
    value(
        share - by_chance,
        [format!("{first} to {last}"), percent(share), end.to_string(), remedy.to_owned()],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::pair::candidates::Candidates;

    const SIZE: (usize, usize) = (100, 100);
    /// The summary of a good match, with some changes.
    fn summary(change: impl FnOnce(&mut Summary)) -> Summary {
        let mut well = Summary::default();
        (well.estimated, well.confidence, well.detail) = (1.0, 1.0, f64::NAN);
        change(&mut well);
        well
    }

    fn estimates(first: i64, findings: Vec<Finding>) -> Estimates {
        let candidates = Candidates::new(first, 20, 100).expect("legal");
        Estimates { findings, ..Estimates::of_candidates(candidates) }
    }

    fn said(findings: Vec<Finding>, first: i64, summary: Summary) -> Vec<(Severity, String)> {
        let found = of_match(&estimates(first, findings), &summary, SIZE);
        found.into_iter().map(|one| (one.severity, one.sentence)).collect()
    }

    #[test]
    fn a_match_that_is_well_says_nothing_but_what_is_worth_knowing() {
        let pair = || {
            vec![
                Finding::new(Topic::Swap, Severity::Ok, "in place"),
                Finding::unknown(Topic::Blur, "who knows"),
                Finding::warning(Topic::Noise, "noisy"),
            ]
        };
        assert_eq!(said(pair(), 0, summary(|_| ())), [(Severity::Note, "noisy".to_owned())]);
        assert!(of_match(&estimates(0, pair()), &summary(|_| ()), (47, 100)).is_empty(), "too small");
    }

    #[test]
    fn of_a_copy_only_a_failure_is_reported_that_is_not_known() {
        let failed = summary(|of| of.wrong = 0.8);
        let copy = |of_pair: &[Finding], summary: &Summary, is_smaller| {
            of_copy(estimates(0, vec![]), summary, SIZE, is_smaller, of_pair)
        };
        let noisy = [Finding::warning(Topic::Noise, "noisy")];
        assert!(copy(&noisy, &summary(|_| ()), true).is_empty());

        let first = copy(&noisy, &failed, false);
        assert!(first[0].sentence.starts_with("about 80 % of the pixels are probably wrong"));
        assert!(first.iter().all(|one| one.topic == Topic::Match));
        assert!(copy(&first, &failed, true).is_empty());
        assert!(
            copy(&noisy, &failed, true)[0].sentence.ends_with(" (a copy of 100 x 100 pixels was matched)")
        );
    }

    #[test]
    fn the_share_of_wrong_pixels_comes_first_with_its_causes() {
        let pair = vec![
            Finding::note(Topic::Contrast, "darker"),
            Finding { cause: "noise", ..Finding::note(Topic::Noise, "noisy") },
            Finding { cause: "interlaced fields", ..Finding::warning(Topic::Interlacing, "interlaced") },
        ];
        let found = said(pair, 0, summary(|s| s.wrong = 0.4));
        let first = "about 40 % of the pixels are probably wrong, because of noise and interlaced fields";
        assert_eq!(found[0], (Severity::Warning, first.to_owned()));
        assert_eq!(found.len(), 4);

        let found = said(vec![], 0, summary(|s| s.wrong = 0.4));
        assert!(found[0].1.starts_with("about 40 % of the pixels are probably wrong: check that rows"));
        assert!(
            said(
                vec![],
                0,
                summary(|s| {
                    s.wrong = 0.21;
                    s.flagged = 0.9;
                })
            )
            .is_empty()
        );
    }

    #[test]
    fn plain_images_are_named() {
        let copies = summary(|s| {
            s.coarse = 0.3;
            s.detail = 3.2;
        });
        let of_copies = "30 % of the disparities were decided by smaller copies: there the images \
                         show no detail finer than about 3 px";
        let of_planes = "27 % of the disparities are those of planes fitted to flat areas, which \
                         show nothing to match";
        let note = |sentence: String| vec![(Severity::Note, sentence)];

        assert_eq!(said(vec![], 0, copies), note(of_copies.to_owned()));
        let planes = summary(|s| {
            s.coarse = 0.004;
            s.inferred = 0.27;
            s.detail = 2.0;
        });
        assert_eq!(said(vec![], 0, planes), note(of_planes.to_owned()));
        let both = summary(|s| {
            *s = copies;
            s.inferred = 0.27;
        });
        assert_eq!(said(vec![], 0, both), [note(of_copies.to_owned()), note(of_planes.to_owned())].concat());
        assert!(
            said(
                vec![],
                0,
                summary(|s| {
                    *s = copies;
                    s.coarse = 0.1;
                    s.inferred = 0.1;
                })
            )
            .is_empty()
        );
    }

    #[test]
    fn flags_say_what_is_known_without_confidences() {
        let unsure = summary(|s| {
            s.wrong = f64::NAN;
            s.flagged = 0.3;
        });
        let found = said(vec![Finding { cause: "blur", ..Finding::note(Topic::Blur, "soft") }], 0, unsure);
        let first = "30 % of the pixels fail the left-right check, because of blur";
        assert_eq!(found[0], (Severity::Note, first.to_owned()));
        assert_eq!(
            said(
                vec![],
                0,
                summary(|s| {
                    *s = unsure;
                    s.flagged = 0.5;
                })
            )[0]
            .0,
            Severity::Warning
        );
    }

    #[test]
    fn both_ends_of_the_range_are_looked_at() {
        let at_high = summary(|s| s.at_high = 0.03);
        assert!(
            said(vec![], 0, at_high)[0]
                .1
                .contains("0 to 19 px is too short: 3 % of the pixels are at its end at 19 px")
        );

        let at_low = summary(|s| s.at_low = 0.03);
        assert!(said(vec![], -5, at_low)[0].1.contains("at its end at -5 px"));
        assert!(said(vec![], 0, at_low).is_empty(), "what is far away lies there");

        let failed = summary(|s| {
            s.at_low = 0.3;
            s.wrong = 0.5;
        });
        let found = said(vec![], 0, failed);
        assert!(found[0].1.ends_with("because of a range that is too short"));
        assert!(found[1].1.contains("30 % of the pixels are at its end at 0 px"));

        let swapped = Finding::warning(Topic::Range, "something was left out");
        assert_eq!(said(vec![swapped], 0, at_high).len(), 1, "one finding on the range");
    }

    #[test]
    fn what_small_copies_do_not_show_may_match_all_the_same() {
        let unlike = Finding::warning(Topic::Match, "hardly anything");
        assert_eq!(said(vec![unlike.clone()], 0, summary(|_| ())), []);
        let found = said(vec![unlike.clone()], 0, summary(|s| s.wrong = 0.5));
        assert!(found.len() == 1 && found[0].1.starts_with("about 50 % of the pixels are probably wrong:"));

        let found = said(
            vec![unlike],
            0,
            summary(|s| {
                s.wrong = 0.8;
                s.at_high = 0.1;
            }),
        );
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|(severity, _)| *severity == Severity::Warning));
    }
}

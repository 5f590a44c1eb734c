//! Findings on a match: how much of it is wrong, and because of what.

use std::cmp::Reverse;

use super::levels::{
    AT_END, AT_ZERO, FLAGGED, LEAST_ROUGH, MENTIONED, PLAIN, ROWS, SATURATED, SMEARED, WRONG,
};
use crate::estimation::estimates::Estimates;
use crate::estimation::overview::LEAST_SIZE;
use crate::finding::{Finding, Severity, Topic};
use phasestereo_match::matcher::summary::Summary;

/// What to look at where no cause is known.
const ADVICE: &str =
    "check that rows correspond, the range of disparities, noise, focus and repeated texture";

/// A match of a pair.
#[derive(Clone, Copy)]
struct Outcome<'a> {
    estimates: &'a Estimates,
    summary: &'a Summary,
}

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

    let outcome = Outcome { estimates, summary };
    let of_pair = estimates.findings.iter().filter_map(|found| outcome.of_pair(found));
    let mut findings: Vec<Finding> = of_pair.collect();
    findings.extend(outcome.ends(&findings));
    findings.extend(outcome.scales());
    let failure = outcome.failure(&findings);

    // Of equal ones, the match comes first, then the topics as they are.
    findings.sort_by_key(|one| (Reverse(one.severity), one.topic != Topic::Match));
    let first = findings.partition_point(|one| {
        failure.as_ref().is_some_and(|failure| one.severity > failure.severity)
    });
    findings.splice(first..first, failure);
    findings
}

impl Outcome<'_> {
    /// Whether much of the match is wrong, or may be.
    fn severity(&self) -> Severity {
        match self.summary.wrong {
            wrong if wrong.is_nan() => Severity::of(self.summary.flagged, FLAGGED),
            wrong => Severity::of(wrong, [WRONG, WRONG]),
        }
    }

    /// A finding on the pair as the match has it: what it has evened out or suffered from is no more than a note.
    fn of_pair(&self, found: &Finding) -> Option<Finding> {
        if found.severity == Severity::Ok || found.is_unknown {
            return None;
        }

        // Small copies may differ where whole images match.
        let is_refuted = found.topic == Topic::Match && self.summary.wrong < WRONG;
        let is_decisive = found.topic.is_decisive() && (!is_refuted || self.is_identical());
        let most = if is_decisive { Severity::Warning } else { Severity::Note };
        Some(Finding { severity: found.severity.min(most), ..found.clone() })
    }

    fn is_identical(&self) -> bool {
        self.estimates.range.as_ref().is_some_and(|range| range.identical)
    }

    /// That the range is too short at an end, unless that is said already, or nothing matches anyway.
    fn ends(&self, known: &[Finding]) -> Option<Finding> {
        let is_decided = |one: &Finding| matches!(one.topic, Topic::Match | Topic::Range);
        let is_said = known.iter().any(|one| is_decided(one) && one.severity == Severity::Warning);
        let is_unlike = self.estimates.confidence.is_some_and(|found| found < LEAST_ROUGH);
        if is_said || is_unlike {
            return None;
        }

        let candidates = self.estimates.candidates.value;
        let (first, last) = (candidates.min(), candidates.disparity(candidates.count() - 1));
        let Summary { at_low, at_high, .. } = *self.summary;
        // What is infinitely far away lies at 0.
        let is_well = self.severity() == Severity::Ok || at_low < AT_ZERO;
        let at_low = if first == 0 && is_well { 0.0 } else { at_low };

        let (share, end) = if at_low > at_high { (at_low, first) } else { (at_high, last) };
        // Wrong matches lie anywhere in the range, also at its ends.
        let by_chance = 2.0 * self.failed() / candidates.count() as f64;
        let severity = Severity::of(share, AT_END.map(|level| level + by_chance));
        let mend = if self.is_found() { "" } else { ", or leave num_disparities out" };

        (severity != Severity::Ok).then(|| {
            let share = 100.0 * share;
            let sentence = format!(
                "the range of {first} to {last} px is too short: {share:.0} % of the pixels are at \
                 its end at {end} px; search more disparities there{mend}"
            );
            Finding::new(Topic::Range, severity, sentence)
        })
    }

    /// That much of the image shows too little detail for its size.
    fn scales(&self) -> Option<Finding> {
        let Summary { coarse, inferred, detail, .. } = *self.summary;
        if coarse + inferred < PLAIN {
            return None;
        }

        let said = |share: f64, sentence: String| {
            (share >= MENTIONED)
                .then(|| format!("{:.0} % of the disparities {sentence}", 100.0 * share))
        };
        let of_copies = format!(
            "were decided by smaller copies: there the images hold no detail finer than about {detail:.0} px"
        );
        let of_planes = "are those of planes drawn into flat areas, which show nothing to match";
        let both = [said(coarse, of_copies), said(inferred, of_planes.to_owned())];

        let both: Vec<String> = both.into_iter().flatten().collect();
        Some(Finding::note(Topic::Texture, both.join("; ")))
    }

    /// The share of the pixels that are wrong, as far as it is known.
    fn failed(&self) -> f64 {
        let Summary { wrong, flagged, .. } = *self.summary;
        if wrong.is_nan() { flagged } else { wrong }
    }

    /// Whether the disparities are those that were found.
    fn is_found(&self) -> bool {
        let range = self.estimates.range.as_ref();
        range.is_some_and(|range| {
            self.estimates.disparities() == (range.min..range.min + range.count)
        })
    }

    /// That much of the match is wrong, and because of what.
    fn failure(&self, known: &[Finding]) -> Option<Finding> {
        let severity = self.severity();
        if severity == Severity::Ok {
            return None;
        }

        let causes = self.causes(known);
        let because = match causes.as_slice() {
            [] => format!(": {ADVICE}"),
            [one] => format!(", because of {one}"),
            [first @ .., last] => format!(", because of {} and {last}", first.join(", ")),
        };

        let Summary { wrong, flagged, .. } = self.summary;
        let sentence = if wrong.is_nan() {
            format!("{:.0} % of the pixels fail the left-right check{because}", 100.0 * flagged)
        } else {
            format!("about {:.0} % of the pixels are probably wrong{because}", 100.0 * wrong)
        };
        Some(Finding::new(Topic::Match, severity, sentence))
    }

    /// What a match suffers from, as far as it is known.
    fn causes(&self, known: &[Finding]) -> Vec<&'static str> {
        let mut causes = vec![];
        for one in known {
            let cause = self.cause(one);
            if !causes.contains(&cause) {
                causes.push(cause);
            }
        }

        let mut causes: Vec<&str> = causes.into_iter().flatten().collect();
        let smeared = self.estimates.photometry.map_or([0.0; 2], |found| found.smeared);
        if causes.is_empty() && smeared[0].max(smeared[1]) >= SMEARED {
            causes.push("smeared texture (lossy compression, denoising or focus)");
        }
        causes
    }

    fn cause(&self, found: &Finding) -> Option<&'static str> {
        let is_grave = found.severity == Severity::Warning;

        match found.topic {
            Topic::Match => is_grave.then_some("images that hardly match"),
            Topic::Swap => is_grave.then_some("images that seem to be swapped"),
            Topic::Range => Some("a range that is too short"),
            Topic::Alignment => self.has_rows_off().then_some("rows that do not correspond"),
            Topic::Blur => Some("blur"),
            // Phase hardly depends on contrast, and a finding on a map is about another one.
            Topic::Contrast | Topic::Map => None,
            Topic::Noise => Some("noise"),
            Topic::Coding => Some("lossy compression"),
            Topic::Saturation => self.is_clipped().then_some("saturated areas"),
            Topic::Texture => Some("areas without texture"),
            Topic::Repetition => Some("texture that repeats itself"),
            Topic::Interlacing => Some("interlaced fields"),
        }
    }

    /// Whether rows do not correspond in the match either.
    fn has_rows_off(&self) -> bool {
        let offsets = self.estimates.offsets.as_ref();
        let is_straightened = self.estimates.alignment.is_some();

        offsets.is_some_and(|found| !is_straightened && found.field.rms() >= ROWS[1])
    }

    /// Whether so many pixels are saturated that the match suffers.
    fn is_clipped(&self) -> bool {
        let both = self.estimates.photometry.map(|found| found.saturation);
        both.is_some_and(|both| both.iter().any(|side| side.dark.max(side.bright) >= SATURATED[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::pair::candidates::Candidates;

    const SIZE: (usize, usize) = (100, 100);
    /// The summary of a match that is well, with some changes.
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
                Finding::ok(Topic::Swap, "in place"),
                Finding::unknown(Topic::Blur, "who knows"),
                Finding::warning(Topic::Noise, "noisy"),
            ]
        };
        assert_eq!(said(pair(), 0, summary(|_| ())), [(Severity::Note, "noisy".to_owned())]);
        assert!(
            of_match(&estimates(0, pair()), &summary(|_| ()), (47, 100)).is_empty(),
            "too small"
        );
    }

    #[test]
    fn the_share_of_wrong_pixels_comes_first_with_its_causes() {
        let pair = vec![
            Finding::note(Topic::Contrast, "darker"),
            Finding::note(Topic::Noise, "noisy"),
            Finding::warning(Topic::Interlacing, "interlaced"),
        ];
        let found = said(
            pair,
            0,
            summary(|s| {
                s.wrong = 0.4;
            }),
        );
        let first =
            "about 40 % of the pixels are probably wrong, because of noise and interlaced fields";
        assert_eq!(found[0], (Severity::Warning, first.to_owned()));
        assert_eq!(found.len(), 4);

        let found = said(
            vec![],
            0,
            summary(|s| {
                s.wrong = 0.4;
            }),
        );
        assert!(
            found[0].1.starts_with("about 40 % of the pixels are probably wrong: check that rows")
        );
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
                         hold no detail finer than about 3 px";
        let of_planes = "27 % of the disparities are those of planes drawn into flat areas, which \
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
        assert_eq!(said(vec![], 0, both), note(format!("{of_copies}; {of_planes}")));
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
        let found = said(vec![Finding::note(Topic::Blur, "soft")], 0, unsure);
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
        let at_high = summary(|s| {
            s.at_high = 0.03;
        });
        assert!(
            said(vec![], 0, at_high)[0]
                .1
                .contains("0 to 19 px is too short: 3 % of the pixels are at its end at 19 px")
        );

        let at_low = summary(|s| {
            s.at_low = 0.03;
        });
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
        assert_eq!(said(vec![swapped], 0, at_high).len(), 1, "the range is said once");
    }

    #[test]
    fn what_small_copies_do_not_show_may_match_all_the_same() {
        let unlike = Finding::warning(Topic::Match, "hardly anything");
        assert_eq!(said(vec![unlike.clone()], 0, summary(|_| ()))[0].0, Severity::Note);

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

//! What there is to say of a map as a whole: severities and sentences.

use crate::verification::claims::Misreading;
use crate::verification::{Counts, verdict};

/// Shares of the claims that are refuted from which on that is noted, and warned of.
const MANY: (f64, f64) = (0.1, 0.3);
/// The same of claims outside the right image; occlusions at the left edge are seldom more.
const OUTSIDE: (f64, f64) = (0.15, 0.5);
/// Share of the claims that cannot be judged from which on that is noted.
const UNKNOWN: f64 = 0.5;

/// One thing that there is to say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// "ok", "note" or "warning".
    pub severity: &'static str,
    /// Plain words, with numbers.
    pub sentence: String,
}

/// All there is to say, worst first.
pub fn remarks(counts: Counts, misreading: Option<Misreading>) -> Vec<Remark> {
    let mut remarks: Vec<_> =
        [misreading.map(meant), Some(shares(counts)), outside(counts), unknown(counts)]
            .into_iter()
            .flatten()
            .collect();

    // The order of sentences of one severity stays.
    remarks.sort_by_key(|remark| match remark.severity {
        "warning" => 0,
        "note" => 1,
        _ => 2,
    });
    remarks
}

fn meant(misreading: Misreading) -> Remark {
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

    Remark { severity: "warning", sentence }
}

fn shares(counts: Counts) -> Remark {
    let [unknown, supported, refuted] =
        [verdict::UNKNOWN, verdict::SUPPORTED, verdict::REFUTED].map(|which| counts.share(which));

    let sentence = format!(
        "the images refute {} of the disparities, support {}, and cannot judge {}",
        percent(refuted),
        percent(supported),
        percent(unknown)
    );
    Remark { severity: severity(refuted, MANY), sentence }
}

fn outside(counts: Counts) -> Option<Remark> {
    let share = counts.outside as f64 / counts.claims().max(1) as f64;
    let sentence = || {
        format!(
            "{} of the disparities lie outside the right image: are they pixels of this left image?",
            percent(share)
        )
    };

    let severity = severity(share, OUTSIDE);
    (severity != "ok").then(|| Remark { severity, sentence: sentence() })
}

fn unknown(counts: Counts) -> Option<Remark> {
    let share = counts.share(verdict::UNKNOWN);
    let sentence = "most of the map cannot be judged: the images show too little there, or the match is not sure either";

    (share > UNKNOWN).then(|| Remark { severity: "note", sentence: sentence.into() })
}

fn severity(share: f64, (noted, warned): (f64, f64)) -> &'static str {
    if share >= warned {
        "warning"
    } else if share >= noted {
        "note"
    } else {
        "ok"
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

//! Findings on a pair that was resized or rectified before its match.

use super::choices::CLEARLY;
use super::table::Grade::Note;
use super::table::{Measured, Row, evaluated, table, value, when};
use crate::estimation::estimates::Estimates;
use crate::estimation::rows::DISTORTED;
use crate::finding::{Finding, Severity, Topic};
use crate::rectification::axis::Axis;
use crate::rectification::{Rectification, Refusal};
use phasestereo_match::pair::fitting::Fit;

const OTHER_AXIS: &str = "cameras that are not beside each other";
const DISTORT: &str = "the lenses distort, by {0} px at half the width ({1})";

table! {
    /// A pair that was rectified for its match: the parts of one sentence.
    RECTIFIED of found: Rectification;
    Alignment, Note, value(0.0, [pixels(found.rows, 1), pixels(found.rms, 2), found.blocks.to_string()]),
        "the images are far from rectified, rows differ by {0} px rms: both are rectified by what they show, to {1} px \
         rms in {2} blocks, and matched then; disparities are given in pixels of the left image as it came, and are \
         not a depth: take those of the rectified pair, or calibrate the cameras";
    Alignment, Note, distorted(found), DISTORT;
    Alignment, Note, when(found.moved > 0.0, [pixels(found.moved, 0)]),
        "columns were moved by {0} px to make disparities positive: the cameras are toed in, or left and right are \
         exchanged";
}

table! {
    /// Pairs that were rectified to be matched later.
    FOUND of found: Rectification;
    Alignment, Note, value(0.0, [pixels(found.rows, 1), blocks(found), pixels(found.rms, 2), pixels(found.error, 2)]),
        "rows were {0} px off; those of {1} now agree within {2} px, and rows are known to {3} px";
    Alignment, Note, value(0.0, [pixels(found.disparities[0], 0), pixels(found.disparities[2], 0)]),
        "disparities are about {0} to {1} px";
    Alignment, Note, distorted(found), DISTORT, remedy("that is corrected, as far as rows show it");
    Alignment, Note, when(found.moved > 0.0, [pixels(found.moved, 0)]),
        "the cameras are toed in: columns were moved by {0} px, so that disparities are not negative";
    Alignment, Note, when(found.disparities[2] < 0.0 && found.disparities[1] <= -CLEARLY, []),
        "all disparities are negative: the images are cropped, the cameras toed in, or left and right exchanged";
    Alignment, Note, when(found.is_inverted, []), "the right image seems to be a negative of the left one";
}

/// Reports that the right image was brought to the size of the left one.
pub fn fitted(fit: &Fit) -> Finding {
    let Fit { from, to, is_alike, scale, .. } = fit;
    let done = if *is_alike {
        "it is resampled to that, and disparities are in pixels of the left image".to_owned()
    } else {
        let times = pixels(scale[1], 2);
        format!(
            "it is laid over its middle, {times} times as large, and disparities are not a depth: rectify the pair"
        )
    };
    let sentence = format!(
        "the right image, of {} x {} pixels, is not of the size of the left one, {} x {}: {done}",
        from.1, from.0, to.1, to.0
    );
    Finding::note(Topic::Alignment, sentence)
}

/// Reports that a pair was rectified from its images, and the meaning of its disparities.
pub fn rectified(found: &Rectification) -> Finding {
    Finding::note(Topic::Alignment, sentences(RECTIFIED, found).join("; "))
}

/// The findings on pairs that were rectified to be matched later.
pub fn rectification(found: &Rectification) -> Vec<String> {
    sentences(FOUND, found)
}

/// Reports that a pair was matched along its columns, since one camera is above the other.
pub fn along_columns(axis: Axis) -> Finding {
    let sentence = format!(
        "one camera is above the other: {}: columns are matched, and pixel (x, y) of the left image is \
         (x, y - d) of the right one; vertical=False matches rows",
        Refusal::Axis(axis)
    );
    Finding::note(Topic::Alignment, sentence)
}

/// Reports that one camera is above the other, or, for a pair that hardly matches, why it could not be
/// rectified from its images. `is_turned`: it was to be matched along its columns.
pub fn not_rectified(estimates: &Estimates, is_turned: bool, refusal: &Refusal) -> Option<Finding> {
    if let Refusal::Axis(axis) = refusal {
        let axis = if is_turned { axis.turned_back() } else { *axis };
        let (seem, remedy) = if axis.is_along_rows() {
            ("the cameras seem to be beside each other", "match with vertical=False")
        } else if axis.is_along_columns() {
            ("one camera seems to be above the other", "match with vertical=True, the upper image first")
        } else {
            (
                "the cameras seem to be neither beside nor above each other",
                "rectify the pair by a calibration",
            )
        };
        let sentence = format!("{seem}: {}: {remedy}", Refusal::Axis(axis));
        return Some(Finding {
            cause: OTHER_AXIS,
            ..Finding::new(Topic::Alignment, Severity::Warning, sentence)
        });
    }

    if *refusal == Refusal::Late {
        let sentence = "rows may be off: the budget left no time to find out how the cameras look";
        return Some(Finding::note(Topic::Alignment, sentence));
    }

    let fails = |one: &Finding| one.topic == Topic::Match && one.severity == Severity::Warning;
    let sentence = format!("the images do not show how to rectify them: {refusal}");
    estimates.findings.iter().any(fails).then(|| Finding::note(Topic::Alignment, sentence))
}

type Measure = fn(&Rectification) -> Vec<Measured>;

fn sentences(rows: &[Row<Measure>], found: &Rectification) -> Vec<String> {
    evaluated(rows, |measure| measure(found)).into_iter().map(|one| one.sentence).collect()
}

fn pixels(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.chars().all(|one| "-0.".contains(one));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

fn blocks(found: &Rectification) -> String {
    let of = if found.pairs == 1 { String::new() } else { format!(" of {} pairs", found.pairs) };
    format!("{} blocks{of}", found.blocks)
}

/// The larger of the clear distortions of both lenses.
fn distorted(found: &Rectification) -> Vec<Measured> {
    let is_clear = |(bent, error): &(f64, f64)| bent.abs() >= DISTORTED.0.max(DISTORTED.1 * error);
    let clear = found.distortion.into_iter().filter(is_clear).map(|(bent, _)| bent);
    let most = clear.reduce(|most, one| if one.abs() > most.abs() { one } else { most });
    let kind = |bent: f64| if bent < 0.0 { "barrel" } else { "pincushion" };
    most.map_or(vec![], |bent| value(bent.abs(), [pixels(bent.abs(), 0), kind(bent).to_owned()]))
}

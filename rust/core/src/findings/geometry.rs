//! Findings on where things are: disparities, rows, and blur, which is compared where both images show the same.

use super::levels::{
    BEYOND, BLUR, BLUR_CONFIDENCE, BLUR_SHARE, ERRORS, LEAST_ROUGH, PART, PART_ERRORS, REPEATED,
    ROWS, SURE, SWAY,
};
use super::{Known, percent};
use crate::estimation::blur::psf::{Family, Psf, Taps};
use crate::estimation::blur::{self, Side};
use crate::estimation::estimates::Estimates;
use crate::estimation::range::{LeftOut, SearchRange};
use crate::estimation::rows::{DISTORTED, RowOffsets};
use crate::finding::{Finding, Severity, Topic};
use crate::rectification::{LONGEST, Rectification, Refusal};
use phasestereo_match::base::math;
use phasestereo_match::pair::alignment::{Alignment, LINEAR, TERMS};
use phasestereo_match::pair::fitting::Fit;

const NOTHING: &str = "hardly anything in one image is found in the other: these are not a pair, or far from rectified";
/// The term of the field of rows that a camera has which is turned towards the other.
const TWIST: usize = 3;
/// From so many pixels below zero on, the middle of all disparities counts as negative.
const CLEARLY: f64 = 2.0;
const INVERTED: &str = "what is bright in one image is dark in the other";

impl Known<'_> {
    /// Whether the images belong together, which one is the left one, and the disparities.
    pub(super) fn search(&self) -> Vec<Finding> {
        let estimates = self.estimates;
        if estimates.is_inverted && !self.settings.compensate_blur {
            let mend =
                "invert one of them (255 - image), or match with compensate_blur=True, which does";
            return vec![Finding::warning(Topic::Match, format!("{INVERTED}: {mend}"))];
        }

        let mut findings = vec![];
        if estimates.is_inverted {
            let done = format!("{INVERTED}: the negative of the right one is matched");
            findings.push(Finding::note(Topic::Contrast, done));
        }

        match &estimates.range {
            Some(range) => findings.extend(self.range(range)),
            None if self.is_given() => {
                let is_unlike = estimates.confidence.is_some_and(|found| found < LEAST_ROUGH);
                findings.extend(is_unlike.then(|| self.nothing()));
            }
            None => findings.push(self.nothing()),
        }

        findings.extend(estimates.left_out.iter().map(left_out));
        findings
    }

    /// That nothing matches.
    fn nothing(&self) -> Finding {
        let untold = self.untold(Topic::Range, "which disparities to search");
        untold.unwrap_or_else(|| Finding::warning(Topic::Match, NOTHING))
    }

    fn range(&self, range: &SearchRange) -> Vec<Finding> {
        let ends = format!("{} to {} px", range.low.round() as i64, range.high.round() as i64);
        let mut findings = vec![];

        if range.identical {
            let same = "both images are the same, but for noise: there is nothing to match";
            findings.push(Finding::warning(Topic::Match, same));
        } else if range.swapped && self.is_toed_in(range) {
            let toed_in = format!(
                "all disparities are negative ({ends}), and rows lie as those of cameras that are toed in, with all of \
                 the scene behind the point they look at: disparities are not a depth before the pair is rectified"
            );
            findings.push(Finding::note(Topic::Swap, toed_in));
        } else if range.swapped {
            let swapped = format!(
                "left and right seem to be swapped, since all disparities are negative ({ends}): \
                 exchange the images (cameras so toed in that all of the scene is behind the \
                 point they look at, give the same: then search negative disparities)"
            );
            findings.push(Finding::warning(Topic::Swap, swapped));
        } else if range.mixed {
            let mixed = format!(
                "disparities of both signs ({ends}): the cameras are toed in, or the images are \
                 cropped; search from a negative disparity on"
            );
            findings.push(Finding::note(Topic::Swap, mixed));
        } else {
            findings.push(Finding::ok(Topic::Swap, "left and right are in their places"));
        }

        let candidates = self.estimates.candidates.value;
        let (first, count) = (candidates.min(), candidates.count());
        let last = candidates.disparity(count - 1);
        let beyond = (first as f64 - range.low).max(range.high - last as f64);

        if !self.is_given() {
            let found = format!(
                "disparities are {ends}: match with min_disparity {} and num_disparities {}",
                range.min, range.count
            );
            findings.push(Finding::ok(Topic::Range, found));
        } else if beyond > BEYOND * count as f64 {
            let short = format!(
                "the range of {first} to {last} px is too short: there seem to be {ends}; search \
                 more disparities, or leave num_disparities out"
            );
            findings.push(Finding::warning(Topic::Range, short));
        }

        findings
    }

    /// Whether rows lie as those of cameras that are turned towards each other by so much that disparities are negative. A
    /// camera of focal length `f` that is turned moves columns by `s` and, at `(x, y)` from its center, rows by `s x y / f^2`;
    /// images that are exchanged leave rows alone.
    fn is_toed_in(&self, range: &SearchRange) -> bool {
        let Some(found) = &self.estimates.offsets else { return false };
        let (rows, cols) = found.field.size();
        let twist = found.field.coefficients()[TWIST];
        let of_shift = -range.low * rows as f64 / (4.0 * LONGEST.powi(2) * cols as f64);
        twist >= of_shift.max(ERRORS[1] * found.error)
    }

    /// How the rows correspond, and what is done about it.
    pub(super) fn rows(&self) -> Vec<Finding> {
        let topic = Topic::Alignment;
        if !self.settings.align_rows {
            return vec![];
        }
        let Some(found) = &self.estimates.offsets else {
            let unknown = "too little is found in both images to tell whether rows correspond";
            let untold = self.untold(topic, "whether rows correspond");
            return vec![untold.unwrap_or_else(|| Finding::unknown(topic, unknown))];
        };

        let is_straightened = self.estimates.alignment.is_some();
        let sway = found.field.largest_sway();
        let sways = is_straightened && sway >= SWAY;

        let mut findings = vec![];
        let (mut severity, mut off) = off(&found.field, found.error);
        if sways {
            let sways = format!(
                "rows sway by up to {sway:.1} px from row to row, as by a rolling shutter that shakes \
                 ({off}): the right image is straightened for the match"
            );
            findings.push(Finding::new(topic, severity, sways));
            (severity, off) = self::off(&found.field.clone().without_sway(), found.error);
        }

        match severity {
            Severity::Ok if sways => {}
            Severity::Ok => {
                let well = format!("rows correspond as well as can be told ({off})");
                findings.push(Finding::ok(topic, well));
            }
            _ if is_straightened => {
                let parts = parts(found);
                let mend = "it is straightened for the match, but rectify the pair again";
                let told = format!("the right image {parts} ({off}): {mend}");
                findings.push(Finding::new(topic, severity, told));
            }
            // What does not help the match may be wrong.
            _ => findings.push(Finding::note(
                topic,
                format!(
                    "rows seem to be off ({off}), but straightening does not help: the baseline \
                     may not be level"
                ),
            )),
        }

        if let Some(distortion) = found.distortion() {
            let distorted = format!(
                "the lenses seem to distort, one unlike the other by {distortion:.1} px at the border: \
                 straightened rows do not make the disparities a depth; calibrate the cameras"
            );
            findings.push(Finding::note(topic, distorted));
        }
        findings
    }

    /// Which image is softer, where, and by what.
    pub(super) fn blur(&self) -> Vec<Finding> {
        let Some(found) = &self.estimates.blur else { return vec![] };
        let what = "which image is softer";
        let is_poor = self.estimates.confidence.is_some_and(|sure| sure < BLUR_CONFIDENCE)
            || self.estimates.photometry.is_some_and(|found| found.repeats() >= REPEATED[1]);
        if found.certainty < SURE || is_poor {
            return vec![self.not_told(Topic::Blur, what)];
        }

        let (_, _, labels) = &found.labels;
        let share = |index: usize| {
            let tiles = labels.iter().filter(|label| usize::from(**label) == index).count();
            tiles as f64 / labels.len() as f64
        };

        // Disks of several radii in one image are one finding: they follow depth.
        let mut kinds: Vec<(Vec<&blur::Blur>, f64)> = vec![];
        for (index, blur) in found.blurs.iter().enumerate() {
            let same = kinds
                .iter_mut()
                .find(|(kind, _)| is_disk(blur, blur.side) && is_disk(kind[0], blur.side));
            match same {
                Some((kind, sum)) => {
                    kind.push(blur);
                    *sum += share(index);
                }
                None => kinds.push((vec![blur], share(index))),
            }
        }

        let plan = self.estimates.compensation.as_ref();
        let is_left = plan.is_none_or(|plan| plan.kernels.iter().flatten().all(Option::is_none));
        let mut findings = vec![];
        for (kind, share) in &mut kinds {
            kind.sort_by(|a, b| a.spread().total_cmp(&b.spread()));
            let grave = kind.iter().any(|blur| blur.spread() >= BLUR[0]);
            if grave && *share >= BLUR_SHARE {
                let area = (found.blurs.len() > 1).then_some(*share);
                findings.extend(softer(kind, area, is_left));
            }
        }
        if findings.is_empty() {
            findings.push(Finding::ok(Topic::Blur, "the images are equally sharp"));
        }
        findings
    }
}

/// That something seems to lie outside the range.
fn left_out(LeftOut { rows, columns, low, high }: &LeftOut) -> Finding {
    let [low, high] = [low, high].map(|end| end.round() as i64);
    let sentence = format!(
        "something at {low} to {high} px seems to be in columns {} to {}, rows {} to {}, and was not \
         searched for: search more disparities",
        columns.start, columns.end, rows.start, rows.end
    );
    Finding::warning(Topic::Range, sentence)
}

/// How grave the offsets of a field with this error are, and how large in words.
fn off(field: &Alignment, error: f64) -> (Severity, String) {
    let rms = field.rms();
    // An offset must be large, and clearly larger than its own error.
    let ends = [0, 1].map(|level| ROWS[level].max(ERRORS[level] * error));
    (Severity::of(rms, ends), format!("{rms:.2} px rms, known to {error:.2} px"))
}

/// The parts of a misalignment that are seen, in words.
fn parts(found: &RowOffsets) -> String {
    let (rows, cols) = found.field.size();
    let [shift, turn, scale, ..] = *found.field.coefficients();
    let [center, border] = PART.map(|part| part.max(PART_ERRORS * found.error));

    let mut parts = vec![];
    if shift.abs() >= center {
        let side = if shift > 0.0 { "lower" } else { "higher" };
        parts.push(format!("shows things {:.1} px {side} than the left one", shift.abs()));
    }
    if turn.abs() >= border {
        let side = if turn > 0.0 { "clockwise" } else { "counter-clockwise" };
        let degrees = math::atan2(turn.abs(), cols as f64 / 2.0).to_degrees();
        parts.push(format!("is rotated {side} (or sheared) by {degrees:.2} degrees"));
    }
    if scale.abs() >= border {
        let height = 1.0 + scale / (rows as f64 / 2.0);
        parts.push(format!("shows things at {height:.3} times the height"));
    }

    let bend = bend(found);
    if bend >= border {
        parts.push(format!("is bent by {bend:.1} px (lens distortion left in, or keystone)"));
    }
    if parts.is_empty() { "is out of line".to_owned() } else { parts.join(" and ") }
}

/// The largest offset at a border by the terms that are not linear, pixels.
fn bend(found: &RowOffsets) -> f64 {
    let coefficients = found.field.coefficients();
    coefficients[LINEAR..TERMS].iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// That the right image was brought to the size of the left one.
pub fn fitted(fit: &Fit) -> Finding {
    let Fit { from, to, is_alike, scale, .. } = fit;
    let sizes = format!(
        "the right image, of {} x {} pixels, is not of the size of the left one, {} x {}",
        from.1, from.0, to.1, to.0
    );
    let done = if *is_alike {
        "it is resampled to that, and disparities are in pixels of the left image".to_owned()
    } else {
        format!(
            "it is laid over its middle, {:.2} times as large, and disparities are not a depth: rectify the pair",
            scale[1]
        )
    };
    Finding::note(Topic::Alignment, format!("{sizes}: {done}"))
}

/// That a pair was rectified by what it shows, and what its disparities are.
pub fn rectified(found: &Rectification) -> Finding {
    let Rectification { rows, rms, blocks, moved, .. } = found;
    let mut told = vec![format!(
        "the images are far from rectified, rows differ by {rows:.1} px rms: both are rectified by what \
         they show, to {rms:.2} px rms in {blocks} blocks, and matched then; disparities are given in \
         pixels of the left image as it came, and are no depth: take those of the rectified pair, or \
         calibrate the cameras"
    )];

    told.extend(distorted(found));
    if *moved > 0.0 {
        told.push(format!(
            "columns were moved by {moved:.0} px to make disparities positive: the cameras are toed \
             in, or left and right are exchanged"
        ));
    }
    Finding::note(Topic::Alignment, told.join("; "))
}

/// What was found of pairs that were rectified to be matched later.
pub fn rectification(found: &Rectification) -> Vec<String> {
    let Rectification { rows, rms, blocks, error, disparities: [low, middle, high], .. } = found;
    let of = if found.pairs == 1 { String::new() } else { format!(" of {} pairs", found.pairs) };
    let mut told = vec![
        format!(
            "rows were {rows:.1} px off; those of {blocks} blocks{of} now agree within {rms:.2} px, and rows \
             are known to {error:.2} px"
        ),
        format!("disparities are about {low:.0} to {high:.0} px"),
    ];

    told.extend(
        distorted(found).map(|what| format!("{what}: that is undone, as far as rows tell")),
    );
    if found.moved > 0.0 {
        told.push(format!(
            "the cameras are toed in: columns were moved by {:.0} px, so that disparities are not negative",
            found.moved
        ));
    }
    if *high < 0.0 && *middle <= -CLEARLY {
        told.push(
            "left and right seem to be swapped, since all disparities are negative: exchange the images \
             (toed-in cameras give the same)"
                .to_owned(),
        );
    }
    if found.is_inverted {
        told.push("the right image seems to be a negative of the left one".to_owned());
    }
    told
}

/// That lenses distort, if they clearly do.
fn distorted(found: &Rectification) -> Option<String> {
    let (bent, _) = found
        .distortion
        .into_iter()
        .filter(|(bent, error)| bent.abs() >= DISTORTED.0.max(DISTORTED.1 * error))
        .fold((0.0f64, 0.0), |most, one| if one.0.abs() > most.0.abs() { one } else { most });
    let kind = if bent < 0.0 { "barrel" } else { "pincushion" };
    let told = || format!("the lenses distort, by {:.0} px at half the width ({kind})", bent.abs());
    (bent != 0.0).then(told)
}

/// That a pair that hardly matches could not be rectified by what it shows, and why.
pub fn not_rectified(estimates: &Estimates, refusal: &Refusal) -> Option<Finding> {
    let fails = |one: &Finding| one.topic == Topic::Match && one.severity == Severity::Warning;
    let hardly_matches = estimates.findings.iter().any(fails);
    hardly_matches.then(|| {
        let sentence = format!("the images do not show how to rectify them: {refusal}");
        Finding::note(Topic::Alignment, sentence)
    })
}

/// Whether one image alone, this one, is out of focus.
fn is_disk(blur: &blur::Blur, side: Option<Side>) -> bool {
    let family = blur.psf.map(|psf| psf.family);
    blur.other.is_none() && blur.side == side && family == Some(Family::Disk)
}

/// That one image is softer, over a part of it if there are several kinds of blur, and whether slight blur is left.
/// Several are disks, by rising radius.
fn softer(kinds: &[&blur::Blur], area: Option<f64>, is_left: bool) -> Option<Finding> {
    let (least, blur) = (kinds.first()?, kinds.last()?);
    let (side, other) = match blur.side? {
        Side::Left => ("left", "right"),
        Side::Right => ("right", "left"),
    };

    let what = match (blur.other, least.psf, blur.psf) {
        (None, Some(least), Some(psf)) if kinds.len() > 1 => format!(
            "softer than the {other} by disks of radius {:.1} to {:.1} px",
            least.size, psf.size
        ),
        (None, ..) => format!("softer than the {other} by {}", shape(blur)),
        (Some(psf), ..) => {
            format!("blurred by {}, the {other} one by {}", shape(blur), words(psf))
        }
    };
    let area =
        area.map_or(String::new(), |share| format!(", over {} of the image", percent(share)));
    let done = if is_left && blur.is_slight() {
        "it is so slight that a match does better as the images are"
    } else {
        "robust matching compensates it"
    };
    let hint = match blur.psf.map(|psf| psf.family) {
        Some(Family::Gaussian | Family::Disk | Family::Annulus) => "its focus",
        Some(Family::Motion) | None => "its mount and its exposure time",
    };

    Some(Finding::new(
        Topic::Blur,
        Severity::of(blur.spread(), BLUR),
        format!("the {side} image is {what}{area}: check {hint}; {done}"),
    ))
}

/// The shape of a kernel in words.
fn shape(blur: &blur::Blur) -> String {
    match (blur.psf, &blur.taps) {
        (Some(psf), _) => words(psf),
        (None, taps) => {
            let radius = taps.as_ref().map_or(0.0, Taps::radius);
            format!("a blur of no simple shape, of radius {radius:.1} px rms")
        }
    }
}

fn words(Psf { family, size, angle, .. }: Psf) -> String {
    match family {
        Family::Gaussian => format!("a Gaussian of sigma {size:.1} px"),
        Family::Disk => format!("a disk of radius {size:.1} px"),
        Family::Annulus => format!("an annulus of outer radius {size:.1} px"),
        Family::Motion => format!("a motion of {size:.1} px at {angle:.0} degrees"),
    }
}

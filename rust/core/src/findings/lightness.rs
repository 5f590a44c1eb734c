//! Findings on gray levels: how they compare, and how much of them carries information.

use super::levels::{CODING, CONTRAST, CURVE, NOISE, REPEATED, SATURATED, TEXTURED, TEXTURELESS};
use super::{Known, percent};
use crate::estimation::photometry::{Contrast, Photometry};
use crate::finding::{Finding, Severity, Topic};
use phasestereo_match::base::math;

/// Least factor that a logarithm is taken of.
const LEAST_FACTOR: f64 = 1e-6;
const SIDES: [&str; 2] = ["left", "right"];

impl Known<'_> {
    /// What the gray levels say.
    pub(super) fn light(&self) -> Vec<Finding> {
        let Some(found) = &self.estimates.photometry else { return vec![] };

        let mut findings = vec![];
        // Of a negative, the curve says nothing.
        if !self.estimates.is_inverted {
            findings.push(self.contrast(found));
        }
        if let Some(blur) = &self.estimates.blur {
            findings.push(self.noise(blur.noise, found.range));
            findings.extend(coding(blur.coding, found.range));
        }
        findings.push(saturation(found));
        findings.push(self.texture(found));
        findings.extend(repetition(found));
        findings.extend(self.interlacing(found));
        findings
    }

    fn contrast(&self, found: &Photometry) -> Finding {
        let topic = Topic::Contrast;
        // Without a match there is nothing to compare.
        let is_matched = self.estimates.range.is_some() || self.is_given();
        let Some(contrast) = found.contrast.filter(|_| is_matched) else {
            return self.not_told(topic, "gain and gamma");
        };

        let Contrast { gain, gamma, ratio, ends } = contrast;
        let bend = distance(ends[0] / ends[1]);
        let severity = Severity::of(distance(ratio), CONTRAST).max(Severity::of(bend, CURVE));
        let curve = format!("left = {gain:.2} x right ^ {gamma:.2}, black 0 to white 1");
        if severity == Severity::Ok {
            return Finding::ok(topic, format!("both images are equally bright ({curve})"));
        }

        let what = if distance(ratio) < CONTRAST[0] {
            "gray levels follow another curve in the right image".to_owned()
        } else {
            let (darker, other) = if ratio > 1.0 { ("right", "left") } else { ("left", "right") };
            let times = math::exp(-distance(ratio));
            format!(
                "the {darker} image is darker, its gray levels {times:.2} times the {other} one's"
            )
        };
        Finding::new(topic, severity, format!("{what} ({curve}): check exposure, gain and gamma"))
    }

    fn noise(&self, noise: [f64; 2], range: f64) -> Finding {
        let topic = Topic::Noise;
        if let Some(untold) = self.untold(topic, "the noise") {
            return untold;
        }

        let severity = Severity::of(noise[0].max(noise[1]) / range, NOISE);
        let [left, right] = noise.map(two_digits);
        let hint =
            if severity == Severity::Ok { "" } else { ": more light, or less gain, would help" };
        let scale = five_digits(range);
        Finding::new(
            topic,
            severity,
            format!(
                "noise of {left} gray levels in the left image, {right} in the right, on a scale of \
                 {scale}{hint}"
            ),
        )
    }

    fn texture(&self, found: &Photometry) -> Finding {
        let topic = Topic::Texture;
        let share = found.flat[0].max(found.flat[1]);
        if share.is_nan() {
            return Finding::unknown(topic, "the images are too small to tell their texture");
        }

        if self.matches_from(TEXTURED) {
            return Finding::ok(topic, "there is texture enough to match by");
        }

        let severity = Severity::of(share, TEXTURELESS);
        let hint = ": disparities there are guesses; project a pattern, or light it from the side";
        let hint = if severity == Severity::Ok { "" } else { hint };
        let share = percent(share);
        Finding::new(
            topic,
            severity,
            format!("{share} of the image has no texture beyond noise{hint}"),
        )
    }

    fn interlacing(&self, found: &Photometry) -> Option<Finding> {
        let which = match found.fields {
            [0, 0] => return None,
            [_, 0] => "the left image is",
            [0, _] => "the right image is",
            _ => "the images are",
        };
        let shift = found.fields.map(i32::abs).into_iter().max().unwrap_or(0);
        let mend = if self.settings.align_rows {
            "a match takes the even rows alone; deinterlace the video"
        } else {
            "match every other row, or deinterlace the video"
        };

        Some(Finding::warning(
            Topic::Interlacing,
            format!(
                "{which} interlaced: odd rows are shifted by {shift} px against even ones; {mend}"
            ),
        ))
    }
}

/// How far a factor is from 1, the same for its inverse.
fn distance(factor: f64) -> f64 {
    math::ln(factor.max(LEAST_FACTOR)).abs()
}

/// The value and the side of the worse image.
fn worse([left, right]: [f64; 2]) -> (f64, &'static str) {
    if right > left { (right, SIDES[1]) } else { (left, SIDES[0]) }
}

fn coding(coding: [f64; 2], range: f64) -> Option<Finding> {
    let (loss, side) = worse(coding);
    let severity = Severity::of(loss / range, CODING);
    let loss = two_digits(loss);

    (severity != Severity::Ok).then(|| {
        Finding::new(
            Topic::Coding,
            severity,
            format!(
                "compression has left blocks in the {side} image, as harmful as noise of {loss} gray \
                 levels: store images without loss, or with more bits"
            ),
        )
    })
}

fn saturation(found: &Photometry) -> Finding {
    let topic = Topic::Saturation;
    let mut worst = (0.0, String::new());
    for (found, side) in found.saturation.iter().zip(SIDES) {
        let ends = [
            (found.bright, "as bright as it can be: expose it less"),
            (found.dark, "as dark as it can be: expose it longer"),
        ];
        for (share, end) in ends {
            if share > worst.0 {
                worst = (share, format!("{} of the {side} image is {end}", percent(share)));
            }
        }
    }

    let (share, sentence) = worst;
    if share >= 1.0 {
        return Finding::unknown(topic, "an image of one or two gray levels: too few to tell");
    }
    match Severity::of(share, SATURATED) {
        Severity::Ok => Finding::ok(topic, "hardly any pixel is at an end of the scale"),
        severity => Finding::new(topic, severity, sentence),
    }
}

fn repetition(found: &Photometry) -> Option<Finding> {
    let share = found.repeats();
    let severity = Severity::of(share, REPEATED);

    (severity != Severity::Ok).then(|| {
        let sentence = format!(
            "texture repeats itself along {} of the rows: several disparities fit there alike",
            percent(share)
        );
        Finding::new(Topic::Repetition, severity, sentence)
    })
}

/// A number to two significant digits.
fn two_digits(value: f64) -> String {
    match value {
        _ if value >= 9.95 => format!("{value:.0}"),
        _ if value >= 0.995 => format!("{value:.1}"),
        _ if value >= 0.0995 => format!("{value:.2}"),
        _ if value >= 0.000_995 => format!("{value:.4}"),
        _ if value > 0.0 => format!("{value:.1e}"),
        _ => "0".to_owned(),
    }
}

/// A number to about five significant digits, without zeros at its end.
fn five_digits(value: f64) -> String {
    if value >= 10_000.0 {
        return format!("{value:.0}");
    }
    let text = if value >= 1.0 { format!("{value:.2}") } else { format!("{value:.5}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

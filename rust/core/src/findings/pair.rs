//! Findings on a pair: the table, and how each quantity is measured.
//!
//! Ordinary pairs are below the levels: on Middlebury, rows are off by up to 0.26 pixels rms, medians of the
//! gray levels differ by up to 9 %, and gamma by up to 7 %.

use std::fmt;

use super::choices::{BLUR_CONFIDENCE, BLUR_SHARE, PART, PART_ERRORS, SURE, SWAY, TEXTURED, UNIFORM};
use super::rectified::fitted;
use super::table::Grade::{Levels, Note, Warning, Well};
use super::table::{Measured, Row, evaluated, levels, percent, table, value, when};
use crate::estimation::blur::psf::Family;
use crate::estimation::blur::taps::Taps;
use crate::estimation::blur::{Blur, Side};
use crate::estimation::estimates::Estimates;
use crate::estimation::facts::Origin;
use crate::estimation::order::{Order, Signs};
use crate::estimation::overview::FAR_REACH;
use crate::estimation::overview::LEAST_SIZE;
use crate::estimation::photometry::{Contrast, Photometry};
use crate::estimation::range::{LEAST_CONFIDENCE, LeftOut, SearchRange};
use crate::estimation::rows::RowOffsets;
use crate::estimation::shared::Shared;
use crate::finding::{Finding, Topic};
use crate::rectification::{TWIST, least_twist};
use phasestereo_match::base::math;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::{Alignment, LINEAR, TERMS};
use phasestereo_match::pair::fitting::Fit;
use phasestereo_match::pair::overlay::Overlay;
use phasestereo_match::settings::Settings;

/// A pair with estimates.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    pub estimates: &'a Estimates,
    pub size: (usize, usize),
    pub settings: &'a Settings,
}

/// Offsets of rows, pixels rms over the image, and in standard errors.
const ROWS: [f64; 2] = [0.3, 0.75];
const ROW_ERRORS: [f64; 2] = [4.0, 5.0];
/// The logarithm of the ratio of gray levels in dark areas to that in bright ones.
const CURVES: [f64; 2] = [0.2, 0.6];
const SIDES: [&str; 2] = ["left", "right"];

const NEGATIVE: &str = "what is bright in one image is dark in the other";
const ROWS_WELL: &str = "rows correspond as well as can be measured ({0})";
const SWAYS: &str = "rows sway by up to {1} px from row to row, as by a rolling shutter that shakes ({0}): the right \
                     image is straightened for the match";
const NOISE: &str = "noise of {0} gray levels in the left image, {1} in the right, on a scale of {2}";
const FLAT: &str = "{0} of the image has no texture beyond noise";
const OFFSET: &str = "disparities are not a depth before columns are moved by the offset of the images";
const UNLIKE: &str = "images that hardly match";
const SHORT: &str = "a range that is too short";

table! {
    /// All findings on a pair, in this order.
    PAIR of known: Known;
    Match, Warning, when(known.is_stuck(), []), NEGATIVE,
        remedy("invert one of them (255 - image), or match with compensate_blur=True, which does"), cause(UNLIKE, 0.0);
    Contrast, Note, when(known.estimates.is_inverted && !known.is_stuck(), []), NEGATIVE,
        remedy("the negative of the right one is matched");
    Range, Note, if known.is_lost() { known.lack("which disparities to search") } else { vec![] }, "";
    Match, Warning, when(known.is_unlike() && known.is_given(), []),
        "hardly anything in one image is found in the other: these are not a pair, or far from rectified",
        cause(UNLIKE, 0.0);
    Match, Warning, when(known.is_unlike() && !known.is_given(), [percent(FAR_REACH)]),
        "hardly anything in one image is found in the other: these are not a pair, are far from rectified, or have \
         disparities above {0} of the width",
        remedy("give such disparities by min_disparity and num_disparities"), cause(UNLIKE, 0.0);
    Match, Warning, known.ends_if(|range| range.identical),
        "both images are the same, but for noise and light: there is nothing to match", cause(UNLIKE, 0.0);
    Swap, Note, known.ends_if(|range| !range.identical && range.negative && known.is_toed_in(range)),
        "nearly all disparities are negative ({0}), and rows differ as those of cameras that are toed in, with all of the \
         scene behind the point they look at",
        remedy("disparities are not a depth before the pair is rectified");
    Swap, Warning, known.shows(true, Order::Exchanged),
        "left and right seem to be swapped: nearly all disparities are negative ({0}), and {1}", remedy("exchange the images"),
        cause("images that seem to be swapped", 0.0);
    Swap, Note, known.shows(true, Order::InPlace),
        "nearly all disparities are negative ({0}), though left and right seem to be in their places, since {1}: the images \
         are cropped, or the cameras toed in", remedy(OFFSET);
    Swap, Note, known.shows(true, Order::Unknown),
        "nearly all disparities are negative ({0}): the images are cropped, the cameras toed in, or left and right \
         exchanged; the scene does not show which", remedy(OFFSET);
    Swap, Note, known.shows(false, Order::Exchanged),
        "left and right may be exchanged: disparities are {0}, but {1}", remedy("compare the images with the rig");
    Swap, Note, known.ends_if(|range| !range.identical && !range.negative && range.mixed),
        "disparities have both signs ({0}), as the cameras are toed in or the images are cropped",
        remedy("search from a negative disparity on");
    Swap, Well, known.ends_if(|range| !range.identical && !range.negative && !range.mixed && !range.is_exchanged()),
        "left and right are in their places";
    Range, Well, found_range(known), "disparities are {0}: match with min_disparity {1} and num_disparities {2}";
    // The part found beyond the given range, as a share of its length.
    Range, Levels([0.2, 0.2]), given_range(known), "the range of {0} px is too short: there seem to be {1}",
        remedy("search more disparities, or leave num_disparities out"), cause(SHORT, 0.0);
    Range, Warning, left_out(known),
        "something at {0} px seems to be in columns {1}, rows {2}, and was not searched for",
        remedy("search more disparities"), cause(SHORT, 0.0);
    // A share of the width.
    Range, Levels([0.25, f64::INFINITY]), seen_by_one(known),
        "only disparities {0} px are searched, so {1} of the left image cannot be matched",
        remedy("let both cameras see the scene, or search more disparities"),
        cause("parts that one camera alone sees", 0.0);
    Alignment, Levels(ROWS), sway(known), SWAYS, errors(ROW_ERRORS), well(SWAYS);
    Alignment, Levels(ROWS), rows_off(known, true), "the right image {1} ({0})", errors(ROW_ERRORS), well(ROWS_WELL),
        remedy("it is straightened for the match, but rectify the pair again");
    // No warning: an estimate that does not help the match may be wrong.
    Alignment, Levels([ROWS[0], f64::INFINITY]), rows_off(known, false),
        "rows seem to be off ({0}), but straightening does not help", errors(ROW_ERRORS), well(ROWS_WELL),
        remedy("the baseline may not be level"), cause("rows that do not correspond", ROWS[1]);
    Alignment, Note, distortion(known), "the lenses seem to distort, one unlike the other by {0} px at the border",
        remedy("straightened rows do not make the disparities a depth; calibrate the cameras");
    // Pixels, root mean square along an axis.
    Blur, Levels([0.3, 0.7]), softer(known), "the {0} image is {1}", well("the images are equally sharp"),
        remedy("check {2}; {3}"), cause("blur", 0.0);
    // The logarithm of the ratio of gray levels.
    Contrast, Levels([0.12, 0.35]), brightness(known),
        "the {1} image is darker, its gray levels {2} times the {3} one's ({0})",
        well("both images are equally bright ({0})"), remedy("check exposure, gain and gamma");
    Contrast, Levels(CURVES), curve(known), "gray levels follow another curve in the right image ({0})",
        remedy("check exposure, gain and gamma");
    // A share of the range of gray levels.
    Noise, Levels([0.02, 0.05]), noise(known), NOISE, well(NOISE), remedy("more light, or less gain, would help"),
        cause("noise", 0.0);
    Noise, Note, shared_pattern(known),
        "both images have the same pattern of {0} gray levels at the same place, as of one camera that was moved, dust or film \
         grain",
        remedy("it is subtracted for the match, but some of it stays; a dark frame or a flat field would remove a fixed one"),
        cause("a pattern that both images share", 0.0);
    // A share of each image.
    Noise, Note, crosstalk(known), "each image contains {0} of the other one, as with crosstalk or a reflection",
        remedy("it is subtracted for the match; separate the views better"), cause("crosstalk", 0.0);
    // The noise that would do the same harm, as a share of the range of gray levels.
    Coding, Levels([0.006, 0.03]), coding(known),
        "compression has left blocks in the {0} image, as harmful as noise of {1} gray levels",
        remedy("store images without loss, or with more bits"), cause("lossy compression", 0.0);
    // A share of the pixels.
    Saturation, Levels([0.1, 0.2]), saturation(known), "{0} of the {1} image is as {2} as it can be",
        well("hardly any pixel is at an end of the scale"), remedy("expose it {3}"), cause("saturated areas", 0.2);
    // A share of the pixels.
    Texture, Levels([0.5, 0.8]), flatness(known), FLAT, well(FLAT),
        remedy("disparities there are guesses; project a pattern, or light it from the side"),
        cause("areas without texture", 0.0);
    Texture, Well, when(known.matches_from(TEXTURED) && known.flat().is_some_and(|share| !share.is_nan()), []),
        "there is enough texture to match";
    // A share of the image, within the range: up to 3 % on 21 pairs.
    Repetition, Levels([0.2, 0.45]), repetition(known), "texture repeats itself along {0} of the rows",
        remedy("several disparities fit there alike"), cause("texture that repeats itself", 0.0);
    Interlacing, Warning, interlacing(known),
        "{0} interlaced: odd rows are shifted by {1} px against even ones", remedy("{2}"),
        cause("interlaced fields", 0.0);
    Interlacing, Warning, mosaic(known),
        "{0} a mosaic: pixels two apart are more alike than neighbors, as in raw images of a color sensor or in YUYV",
        remedy("{1}"), cause("a raw mosaic", 0.0);
    Border, Note, borders(known), "a black border, {0} of {1}, shows nothing and is not matched";
    Border, Note, overlaid(known),
        "an overlay, such as a clock or a logo, covers columns {0}, rows {1} of both images, and is not matched",
        remedy("mask it yourself if it is larger");
}

/// The estimates of a pair in memory, with their findings.
pub fn with_findings(estimates: Estimates, pair: &Pair, settings: &Settings) -> Estimates {
    let overlays = pair.overlays().to_vec();
    let estimates = Estimates { borders: pair.borders(), overlays, ..estimates };
    let findings = of_pair(&estimates, pair.size(), pair.fit(), settings);
    Estimates { findings, ..estimates }
}

/// The findings on a pair of this size, including topics that are well. `fit`: how its right image was
/// brought to this size.
pub fn of_pair(
    estimates: &Estimates,
    size: (usize, usize),
    fit: Option<Fit>,
    settings: &Settings,
) -> Vec<Finding> {
    let known = Known { estimates, size, settings };
    let mut findings = evaluated(PAIR, |measure| measure(&known));
    findings.extend(fit.map(|fit| fitted(&fit)));
    findings
}

/// The levels of a topic of pairs: for a note, and for a warning.
pub fn levels_of(topic: Topic) -> [f64; 2] {
    levels(PAIR, topic)
}

impl Known<'_> {
    /// Whether nothing can be matched, because one image is a negative that is not compensated.
    fn is_stuck(&self) -> bool {
        self.estimates.is_inverted && !self.settings.compensate_blur
    }

    /// Whether hardly anything matches.
    fn is_lost(&self) -> bool {
        let is_unlike = self.estimates.confidence.is_some_and(|found| found < LEAST_CONFIDENCE);
        !self.is_stuck() && self.estimates.range.is_none() && (!self.is_given() || is_unlike)
    }

    /// Whether hardly anything matches although the images are large enough and have texture.
    fn is_unlike(&self) -> bool {
        self.is_lost() && self.lack("").is_empty()
    }

    /// Whether the caller gave the disparities.
    fn is_given(&self) -> bool {
        self.estimates.candidates.origin == Origin::Given
    }

    /// Whether small copies match with this mean confidence.
    fn matches_from(&self, least: f64) -> bool {
        self.estimates.confidence.is_some_and(|found| found >= least)
    }

    /// Reports that something cannot be measured, if both images are too small or too uniform.
    fn lack(&self, what: &str) -> Vec<Measured> {
        let (rows, cols) = self.size;
        // Texture as fine as noise counts as noise, but matches.
        let is_uniform = self.flat().is_some_and(|share| share >= UNIFORM);
        if rows.min(cols) < LEAST_SIZE {
            unknown(format!("the images are too small to measure {what}"))
        } else if is_uniform && !self.matches_from(LEAST_CONFIDENCE) {
            unknown(format!("the images have too little texture to measure {what}"))
        } else {
            vec![]
        }
    }

    /// Reports that something cannot be measured, for that reason or because too little matches.
    fn unmatched(&self, what: &str) -> Vec<Measured> {
        let lack = self.lack(what);
        let unlike = || unknown(format!("the images have too little in common to measure {what}"));
        if lack.is_empty() { unlike() } else { lack }
    }

    fn range(&self) -> Option<&SearchRange> {
        self.estimates.range.as_ref().filter(|_| !self.is_stuck())
    }

    /// The least and the largest disparity, and the signs of the order of the cameras, if this is the order,
    /// and if disparities are all negative, or not, as given.
    fn shows(&self, negative: bool, order: Order) -> Vec<Measured> {
        let range = self.range().filter(|range| {
            let by_place = negative && self.is_toed_in(range) || !negative && range.mixed;
            !range.identical && range.negative == negative && range.shown.order() == order && !by_place
        });
        range.map_or(vec![], |range| value(0.0, [ends(range), signs(range.shown)]))
    }

    /// The least and the largest disparity, if the found range meets this condition.
    fn ends_if(&self, is_so: impl Fn(&SearchRange) -> bool) -> Vec<Measured> {
        let range = self.range().filter(|range| is_so(range));
        range.map_or(vec![], |range| value(0.0, [ends(range)]))
    }

    /// Whether rows differ as with cameras that are turned towards each other far enough for negative
    /// disparities.
    fn is_toed_in(&self, range: &SearchRange) -> bool {
        let Some(found) = &self.estimates.offsets else { return false };
        let of_shift = least_twist(range.low, found.field.size());
        found.field.coefficients()[TWIST] >= of_shift.max(ROW_ERRORS[1] * found.error)
    }

    fn offsets(&self) -> Option<&RowOffsets> {
        self.estimates.offsets.as_ref().filter(|_| self.settings.align_rows)
    }

    /// The largest offset of a row by the spline, if rows sway and are straightened.
    fn sway(&self) -> Option<f64> {
        let sway = self.offsets()?.field.largest_sway();
        (self.estimates.alignment.is_some() && sway >= SWAY).then_some(sway)
    }

    fn photometry(&self) -> Option<&Photometry> {
        self.estimates.photometry.as_ref()
    }

    /// The share of the worse image without texture; NaN: too small to measure.
    fn flat(&self) -> Option<f64> {
        self.photometry().map(|found| found.flat[0].max(found.flat[1]))
    }

    /// The relation of the gray levels: the curve means nothing for a negative, and nothing is compared
    /// without a match.
    fn contrast(&self) -> std::result::Result<Contrast, Vec<Measured>> {
        let is_matched = self.estimates.range.is_some() || self.is_given();
        let found = self.photometry().filter(|_| !self.estimates.is_inverted).ok_or_else(Vec::new)?;
        found.contrast.filter(|_| is_matched).ok_or_else(|| self.unmatched("gain and gamma"))
    }
}

fn unknown(why: String) -> Vec<Measured> {
    vec![Measured { unknown: Some(why), ..Measured::default() }]
}

fn span(low: impl fmt::Display, high: impl fmt::Display) -> String {
    format!("{low} to {high}")
}

/// The signs of the order of the cameras, in words.
fn signs(Signs { ground, sides, .. }: Signs) -> String {
    let mut words = vec![];
    if ground != 0.0 {
        let depth = if ground > 0.0 { "nearer" } else { "farther" };
        words.push(format!("what is lower in the image is {depth} (rank correlation {ground:.2})"));
    }
    // The strips that favor the other order are too few to count.
    if sides * ground > 0.0 {
        let side = if sides > 0.0 { "left" } else { "right" };
        words.push(format!("what one camera alone sees lies to the {side} of near things"));
    }
    words.join(", and ")
}

fn ends(range: &SearchRange) -> String {
    span(range.low.round() as i64, range.high.round() as i64) + " px"
}

fn found_range(known: &Known) -> Vec<Measured> {
    let range = known.range().filter(|_| !known.is_given());
    let words = |range: &SearchRange| [ends(range), range.min.to_string(), range.count.to_string()];
    range.map_or(vec![], |range| value(0.0, words(range)))
}

fn given_range(known: &Known) -> Vec<Measured> {
    let Some(range) = known.range().filter(|_| known.is_given()) else { return vec![] };
    let candidates = known.estimates.candidates.value;
    let (first, count) = (candidates.min(), candidates.count());
    let last = candidates.disparity(count - 1);
    let beyond = (first as f64 - range.low).max(range.high - last as f64);
    value(beyond / count as f64, [span(first, last), ends(range)])
}

/// The share of the left image that none of the searched disparities finds in the right one.
fn seen_by_one(known: &Known) -> Vec<Measured> {
    let candidates = known.estimates.candidates.value;
    let (first, last) = (candidates.min(), candidates.max());
    let (range, side, hidden) = if first > 0 {
        (format!("from {first}"), "left", first)
    } else {
        (format!("up to {last}"), "right", -last)
    };
    let share = hidden as f64 / known.size.1 as f64;
    value(share, [range, format!("the {side} {}", percent(share))])
}

fn left_out(known: &Known) -> Vec<Measured> {
    let place = |LeftOut { rows, columns, low, high }: &LeftOut| {
        let disparities = span(low.round() as i64, high.round() as i64);
        value(0.0, [disparities, span(columns.start, columns.end), span(rows.start, rows.end)])
    };
    known.estimates.left_out.iter().filter(|_| !known.is_stuck()).flat_map(place).collect()
}

/// The masked black borders: of both images in one finding, if they are alike.
fn borders(known: &Known) -> Vec<Measured> {
    let [left, right] = known.estimates.borders.map(percent);
    if left == right && known.estimates.borders[0] > 0.0 {
        return value(0.0, [left, "both images".to_owned()]);
    }
    let sides = SIDES.iter().zip([left, right]).zip(known.estimates.borders);
    let of_side = |((side, share), border): ((&&str, String), f64)| {
        when(border > 0.0, [share, format!("the {side} image")])
    };
    sides.flat_map(of_side).collect()
}

/// The rectangles of overlays, which are masked.
fn overlaid(known: &Known) -> Vec<Measured> {
    let place = |Overlay { rows, columns }: &Overlay| {
        value(0.0, [span(columns.start, columns.end), span(rows.start, rows.end)])
    };
    known.estimates.overlays.iter().flat_map(place).collect()
}

/// The offsets of a field of rows with this error.
fn offset(field: &Alignment, error: f64, what: String) -> Vec<Measured> {
    let value = field.rms();
    let words = vec![format!("{value:.2} px rms, known to {error:.2} px"), what];
    vec![Measured { value, error, words, unknown: None }]
}

fn sway(known: &Known) -> Vec<Measured> {
    if known.settings.align_rows && known.estimates.offsets.is_none() {
        return known.unmatched("whether rows correspond");
    }
    let (Some(found), Some(sway)) = (known.offsets(), known.sway()) else { return vec![] };
    offset(&found.field, found.error, format!("{sway:.1}"))
}

/// The rows of an image, straightened or not; in addition to the spline if they sway.
fn rows_off(known: &Known, is_straightened: bool) -> Vec<Measured> {
    let is_so = known.estimates.alignment.is_some() == is_straightened;
    let Some(found) = known.offsets().filter(|_| is_so) else { return vec![] };
    let field = found.field.clone().without_sway();
    let is_well = field.rms() < ROWS[0].max(ROW_ERRORS[0] * found.error);
    match known.sway() {
        Some(_) if is_well => vec![],
        Some(_) => offset(&field, found.error, parts(found)),
        None => offset(&found.field, found.error, parts(found)),
    }
}

/// The clear parts of a vertical disparity, in words.
fn parts(found: &RowOffsets) -> String {
    let (rows, cols) = found.field.size();
    let coefficients = found.field.coefficients();
    let [shift, turn, scale, ..] = *coefficients;
    let bend = coefficients[LINEAR..TERMS].iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let [center, border] = PART.map(|part| part.max(PART_ERRORS * found.error));

    let degrees = math::atan2(turn.abs(), cols as f64 / 2.0).to_degrees();
    let side = if shift > 0.0 { "lower" } else { "higher" };
    let turned = if turn > 0.0 { "clockwise" } else { "counter-clockwise" };
    let height = 1.0 + scale / (rows as f64 / 2.0);
    let all = [
        (shift.abs() >= center, format!("shows things {:.1} px {side} than the left one", shift.abs())),
        (turn.abs() >= border, format!("is rotated {turned} (or sheared) by {degrees:.2} degrees")),
        (scale.abs() >= border, format!("shows things at {height:.3} times the height")),
        (bend >= border, format!("is bent by {bend:.1} px (lens distortion left in, or keystone)")),
    ];
    let clear: Vec<String> =
        all.into_iter().filter(|(is_clear, _)| *is_clear).map(|(_, part)| part).collect();
    if clear.is_empty() { "is out of line".to_owned() } else { clear.join(" and ") }
}

fn distortion(known: &Known) -> Vec<Measured> {
    let found = known.offsets().and_then(RowOffsets::distortion);
    found.map_or(vec![], |most| value(most, [format!("{most:.1}")]))
}

/// The kinds of blur that cover enough of the image; a blur of 0 if there are none.
fn softer(known: &Known) -> Vec<Measured> {
    let Some(found) = &known.estimates.blur else { return vec![] };
    let is_poor = known.estimates.confidence.is_some_and(|sure| sure < BLUR_CONFIDENCE)
        || known.photometry().is_some_and(|found| found.repeats() >= levels_of(Topic::Repetition)[1]);
    if found.certainty < SURE || is_poor {
        return known.unmatched("which image is softer");
    }

    // Disks of several radii in one image are one finding, since they follow depth.
    let mut kinds: Vec<(Vec<&Blur>, f64)> = vec![];
    for (blur, share) in found.blurs.iter().zip(found.shares()) {
        match kinds.iter_mut().find(|(kind, _)| follow_depth(blur, kind[0])) {
            Some((kind, sum)) => {
                kind.push(blur);
                *sum += share;
            }
            None => kinds.push((vec![blur], share)),
        }
    }

    let plan = known.estimates.compensation.as_ref();
    let is_left = plan.is_none_or(|plan| plan.kernels.iter().flatten().all(Option::is_none));
    let measured = |(mut kind, share): (Vec<&Blur>, f64)| {
        // The bits of positive numbers are in the order of the numbers.
        kind.sort_by_cached_key(|blur| blur.spread().to_bits());
        let spread = kind.last()?.spread();
        let area = (found.blurs.len() > 1).then_some(share);
        let is_large = spread >= levels_of(Topic::Blur)[0] && share >= BLUR_SHARE;
        let words = blur_words(&kind, area, is_left).filter(|_| is_large)?;
        Some(Measured { value: spread, words, ..Measured::default() })
    };
    let all: Vec<Measured> = kinds.into_iter().filter_map(measured).collect();
    if all.is_empty() { value(0.0, []) } else { all }
}

/// Whether two blurs are of the same image alone, of a family whose sizes follow depth.
fn follow_depth(one: &Blur, other: &Blur) -> bool {
    let family = |blur: &Blur| blur.psf.filter(|_| blur.other.is_none()).map(|psf| psf.family);
    let is_by_depth = |family: Family| family.traits().by_depth.is_some();
    one.side.is_some()
        && one.side == other.side
        && family(one) == family(other)
        && family(one).is_some_and(is_by_depth)
}

/// The softer image; its blur, with its share of the image if there are several kinds; what to check; and
/// whether slight blur is left. Several kinds are disks, by increasing radius.
fn blur_words(kinds: &[&Blur], area: Option<f64>, is_left: bool) -> Option<Vec<String>> {
    let (least, blur) = (kinds.first()?, kinds.last()?);
    let [side, other] = [blur.side?, blur.side?.other()].map(Side::name);
    let what = match (blur.other, least.psf, blur.psf) {
        (None, Some(least), Some(psf)) if kinds.len() > 1 => {
            let words = psf.family.traits().by_depth.unwrap_or(psf.family.traits().words);
            let words = words.replace("{least}", &format!("{:.1}", least.size));
            let words = words.replace("{largest}", &format!("{:.1}", psf.size));
            format!("softer than the {other} by {words}")
        }
        (None, ..) => format!("softer than the {other} by {}", shape(blur)),
        (Some(psf), ..) => {
            format!("blurred by {}, the {other} one by {}", shape(blur), psf.words())
        }
    };
    let area = area.map_or(String::new(), |share| format!(", over {} of the image", percent(share)));
    let is_of_focus = blur.psf.is_some_and(|psf| psf.family.traits().is_of_focus);
    let check = if is_of_focus { "its focus" } else { "its mount and its exposure time" };
    let done = if is_left && blur.is_slight() {
        "it is so slight that a match does better on the images as they are"
    } else {
        "robust matching compensates it"
    };
    Some([side, &(what + &area), check, done].map(str::to_owned).to_vec())
}

/// The shape of a kernel in words.
fn shape(blur: &Blur) -> String {
    let radius = blur.taps.as_ref().map_or(0.0, Taps::radius);
    blur.psf
        .map_or_else(|| format!("a blur of no simple shape, of radius {radius:.1} px rms"), |psf| psf.words())
}

/// The distance of a factor from 1, the same for its inverse. It avoids the logarithm of zero.
fn distance(factor: f64) -> f64 {
    math::ln(factor.max(1e-6)).abs()
}

/// The difference of the ratio of gray levels between dark and bright areas.
fn bend(found: &Contrast) -> f64 {
    distance(found.ends[0] / found.ends[1])
}

fn curve_words(Contrast { gain, gamma, .. }: &Contrast) -> String {
    format!("left = {gain:.2} x right ^ {gamma:.2}, black 0 to white 1")
}

fn brightness(known: &Known) -> Vec<Measured> {
    let found = match known.contrast() {
        Ok(found) => found,
        Err(unknown) => return unknown,
    };
    let differs = distance(found.ratio);
    // Images whose curves differ are not equally bright everywhere.
    if differs < levels_of(Topic::Contrast)[0] && bend(&found) >= CURVES[0] {
        return vec![];
    }
    let [darker, other] = if found.ratio > 1.0 { ["right", "left"] } else { SIDES };
    let times = format!("{:.2}", math::exp(-differs));
    value(differs, [curve_words(&found), darker.to_owned(), times, other.to_owned()])
}

fn curve(known: &Known) -> Vec<Measured> {
    known.contrast().map_or(vec![], |found| value(bend(&found), [curve_words(&found)]))
}

fn noise(known: &Known) -> Vec<Measured> {
    let (Some(blur), Some(found)) = (&known.estimates.blur, known.photometry()) else {
        return vec![];
    };
    let lack = known.lack("the noise");
    let [left, right] = blur.noise.map(two_digits);
    let share = blur.noise[0].max(blur.noise[1]) / found.range;
    if lack.is_empty() { value(share, [left, right, five_digits(found.range)]) } else { lack }
}

fn shared_pattern(known: &Known) -> Vec<Measured> {
    match known.estimates.shared {
        Some((Shared::Pattern, strength)) => value(strength, [two_digits(strength)]),
        _ => vec![],
    }
}

fn crosstalk(known: &Known) -> Vec<Measured> {
    match known.estimates.shared {
        Some((Shared::Crosstalk(share), _)) => value(share, [percent(share)]),
        _ => vec![],
    }
}

fn coding(known: &Known) -> Vec<Measured> {
    let (Some(blur), Some(found)) = (&known.estimates.blur, known.photometry()) else {
        return vec![];
    };
    let [left, right] = blur.coding;
    let (loss, side) = if right > left { (right, SIDES[1]) } else { (left, SIDES[0]) };
    value(loss / found.range, [side.to_owned(), two_digits(loss)])
}

fn saturation(known: &Known) -> Vec<Measured> {
    let Some(found) = known.photometry() else { return vec![] };
    let (mut most, mut words) = (0.0, [""; 3]);
    for (found, side) in found.saturation.iter().zip(SIDES) {
        for (share, end) in [(found.bright, [side, "bright", "less"]), (found.dark, [side, "dark", "longer"])]
        {
            if share > most {
                (most, words) = (share, end);
            }
        }
    }
    if most >= 1.0 {
        return unknown("an image has one or two gray levels: too few to measure anything".to_owned());
    }
    let [side, end, remedy] = words.map(str::to_owned);
    value(most, [percent(most), side, end, remedy])
}

fn flatness(known: &Known) -> Vec<Measured> {
    match known.flat() {
        None => vec![],
        Some(share) if share.is_nan() => {
            unknown("the images are too small to measure their texture".to_owned())
        }
        Some(_) if known.matches_from(TEXTURED) => vec![],
        Some(share) => value(share, [percent(share)]),
    }
}

fn repetition(known: &Known) -> Vec<Measured> {
    let share = known.photometry().map(Photometry::repeats);
    share.map_or(vec![], |share| value(share, [percent(share)]))
}

/// The images of which this is so.
fn which(is_so: [bool; 2]) -> Option<String> {
    let which = match is_so {
        [false, false] => return None,
        [true, false] => "the left image is",
        [false, true] => "the right image is",
        [true, true] => "the images are",
    };
    Some(which.to_owned())
}

fn mosaic(known: &Known) -> Vec<Measured> {
    let found = known.photometry().map_or([false; 2], |found| found.mosaic);
    let smoothed = if known.settings.align_rows { "a match smooths it; " } else { "" };
    which(found).map_or(vec![], |which| value(0.0, [which, format!("{smoothed}convert such images to gray")]))
}

fn interlacing(known: &Known) -> Vec<Measured> {
    let fields = known.photometry().map_or([0; 2], |found| found.fields);
    let Some(which) = which(fields.map(|shift| shift != 0)) else { return vec![] };
    let remedy = if known.settings.align_rows {
        "a match uses only the even rows; deinterlace the video"
    } else {
        "match every other row, or deinterlace the video"
    };
    let shift = fields[0].abs().max(fields[1].abs()).to_string();
    value(0.0, [which, shift, remedy.to_owned()])
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

/// A number to about five significant digits, without trailing zeros.
fn five_digits(value: f64) -> String {
    if value >= 10_000.0 {
        return format!("{value:.0}");
    }
    let text = if value >= 1.0 { format!("{value:.2}") } else { format!("{value:.5}") };
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

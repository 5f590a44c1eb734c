//! Both images reduced to some hundred columns, and their rough disparities.

use std::borrow::Cow;
use std::ops::Range;

use crate::estimation::blur::parts::{HALO, PairRows, Part, Strips};
use crate::estimation::blur::rough::{match_reduced, raised, reduced, rough_settings};
use crate::estimation::extent::{Span, extent};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::platform::both;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::{Alignment, TERMS};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::Settings;

/// Most columns of the reduced images: few enough that all disparities can be tried, and that little is left
/// of a blur of ten pixels.
const WIDTH: usize = 256;
/// Most columns of the finer copies, on which the ends of the range and thin objects are found; they are
/// reduced by at least two.
const FINE_WIDTH: usize = 720;
/// Most columns of the still smaller copies, on which all disparities are tried.
pub const COARSE_WIDTH: usize = 128;
/// Largest disparity tried, as a share of the width.
pub const REACH: f64 = 0.45;
/// The same if the images match badly up to there. Of 21 pairs that were cropped until the median disparity
/// was 50, 60, 70 % of the width, 21, 17 and 7 match: beyond this, too few columns correspond. Not swept.
pub const FAR_REACH: f64 = 0.75;
/// Vertical shifts of the smallest copies, in rows up and down, that are tried if nothing matches.
const MOST_ROWS: isize = 6;
/// Fewest rows of a reduced image: a very wide one keeps more columns instead.
const LEAST_ROWS: usize = 24;
/// Images with fewer rows or columns are too small for estimates.
pub const LEAST_SIZE: usize = 48;
/// At this mean confidence or more, no other rows, range or inversion are tried.
pub const GOOD_CONFIDENCE: f64 = 0.65;
/// Disparities of at least this confidence are kept.
const SURE: f32 = 0.5;
/// One in this many rows of a copy is used to decide whether gray levels rise on one side where they fall on
/// the other.
const SAMPLED: usize = 4;

/// The level of detail of a match of copies.
#[derive(Debug, Clone, Copy)]
pub struct CopySettings {
    /// Side of the neighborhood of a code.
    pub neighborhood: usize,
    /// Side of the window that costs are summed over.
    pub window: usize,
    /// Regions of at most this many pixels are mistakes.
    pub speckle: usize,
    /// Whether disparities are found between whole pixels.
    pub subpixel: bool,
}

/// Large neighborhoods withstand blur and noise.
pub const ROUGH: CopySettings = CopySettings { neighborhood: 9, window: 9, speckle: 12, subpixel: false };
/// Small ones show small objects.
pub const FINE: CopySettings = CopySettings { neighborhood: 3, window: 5, speckle: 40, subpixel: true };

impl CopySettings {
    /// The settings of a rough match: with a left-right check, without filling or smoothing.
    pub fn settings(self) -> Settings {
        Settings {
            p1: 2.0,
            p2: 9.0,
            lr_check: Some(1),
            speckle_size: self.speckle,
            fill: false,
            confidence: true,
            ..rough_settings(self.neighborhood, self.window, self.subpixel)
        }
    }
}

/// Both images, reduced.
pub struct Overview {
    /// The factor by which they are reduced.
    pub factor: usize,
    /// Their gray values.
    pub planes: [Plane<f32>; 2],
    /// Whether most pixels under each pixel of the left one are valid.
    pub valid: Plane<bool>,
}

/// Disparities of a reduced image.
pub struct RoughMap {
    /// Whole pixels of the reduced image; NaN where the images do not agree.
    pub disparity: Plane<f32>,
    /// The same, before uncertain and masked pixels became NaN.
    pub unsure: Plane<f32>,
    /// The run of the known ones; see [`extent`].
    pub run: Option<Span>,
    /// The field by which the right image was resampled.
    pub field: Option<Alignment>,
    /// Mean confidence of the columns that the found disparities match: 0.66 to 0.95 on small copies of 12
    /// pairs; 0.19 to 0.39 on those of unrelated images, of noise, and of pairs whose rows are off by four or
    /// more there.
    pub confidence: f64,
}

/// Disparities of reduced images, in pixels of the full ones.
#[derive(Debug)]
pub struct Seen {
    /// NaN where the images do not agree.
    pub all: Plane<f32>,
    /// NaN also where the match is uncertain.
    pub sure: Plane<f32>,
    /// The factor by which the images are reduced.
    pub factor: usize,
}

/// The disparities of copies that a rough match found, with one at every pixel of the copies.
#[derive(Debug, Clone, Copy)]
pub struct Guess<'a> {
    /// Disparities of copies of another size; NaN: none.
    pub disparity: &'a Plane<f32>,
    /// The factor by which these are larger, or 1,
    pub by: usize,
    /// ... or smaller, or 1.
    pub finer: usize,
    /// The pixels of the copies where objects outside the run are searched; `None`: all.
    pub judged: Option<&'a Plane<bool>>,
}

/// The power of two by which an image is reduced so that it has at most `width` columns.
pub fn reduction((rows, cols): (usize, usize), width: usize) -> usize {
    let mut factor = 1;
    while cols > width * factor && rows >= 2 * factor * LEAST_ROWS {
        factor *= 2;
    }
    factor
}

/// The factor by which the copies of [`Overview::fine`] are reduced.
pub fn fine_factor(size: (usize, usize)) -> usize {
    reduction(size, FINE_WIDTH).max(2).min(reduction(size, WIDTH))
}

impl Overview {
    /// Reduces a pair; `None` if it is too small for estimates.
    pub fn new(rows: &PairRows, runtime: Runtime) -> Result<Option<Self>> {
        Self::by(reduction(rows.size(), WIDTH), rows, runtime)
    }

    /// Reduces a pair less, for finer copies; `None` if it is too small for estimates.
    pub fn fine(rows: &PairRows, runtime: Runtime) -> Result<Option<Self>> {
        Self::by(fine_factor(rows.size()), rows, runtime)
    }

    /// Reduces the pair of these copies half as much, for the finest copies, which show the smallest objects;
    /// `None`: these are not reduced.
    pub fn finest(&self, rows: &PairRows, runtime: Runtime) -> Result<Option<Self>> {
        if self.factor == 1 { Ok(None) } else { Self::by(self.factor / 2, rows, runtime) }
    }

    fn by(factor: usize, rows: &PairRows, runtime: Runtime) -> Result<Option<Self>> {
        let size = rows.size();
        if size.0.min(size.1) < LEAST_SIZE {
            return Ok(None);
        }
        let (height, cols) = (size.0 / factor, size.1 / factor);
        let tops: Vec<usize> = (0..height).map(|y| y * factor).collect();
        let strips = Strips { tops: &tops, rows: factor, halo: HALO, unit: factor };

        let (mut left, mut right, mut valid) = (vec![], vec![], vec![]);
        rows.visit(strips, runtime, |part, visited| {
            // The part begins with its halo, whose rows belong to others.
            let skipped = visited.start - part.first / factor;
            let both = both(|side| {
                let gray = &part.grays[side];
                reduced(gray, factor, runtime)
            })?;
            for (side, reduced) in [&mut left, &mut right].into_iter().zip(both) {
                let here = reduced.of_rows(skipped..skipped + visited.len()).into_vec();
                // Most pairs are one part, which is used without a copy.
                if side.is_empty() {
                    *side = here;
                } else {
                    side.extend(here);
                }
            }

            let view = part.pair.views()[0];
            // A reduced pixel is valid if at least half of its pixels are.
            let is_valid = |y: usize, x: usize| {
                let area = (0..factor * factor).map(|i| (i / factor, i % factor));
                let top = tops[y] - part.first;
                let count = area.filter(|(dy, dx)| view.is_valid(top + dy, x * factor + dx)).count();
                2 * count >= factor * factor
            };

            if view.mask().is_none() {
                valid.resize(valid.len() + visited.len() * cols, true);
                return Ok(());
            }
            for y in visited {
                valid.extend((0..cols).map(|x| is_valid(y, x)));
            }
            Ok(())
        })?;

        let plane = |values| Plane::from_vec(height, cols, values);
        let valid = Plane::from_vec(height, cols, valid)?;
        Ok(Some(Self { factor, planes: [plane(left)?, plane(right)?], valid }))
    }

    /// Some bands of the rows of a pair, one below the other, reduced as in [`Self::finest`].
    pub fn finest_of_bands(pair: &Pair, bands: &[Range<usize>], runtime: Runtime) -> Result<Self> {
        let (mut left, mut right, mut valid) = (vec![], vec![], vec![]);
        for rows in bands {
            let part = Part::new(rows.start, Cow::Owned(pair.of_rows(rows.clone())), runtime)?;
            left.extend_from_slice(part.grays[0].as_slice());
            right.extend_from_slice(part.grays[1].as_slice());
            match part.pair.views()[0].mask() {
                Some(mask) => valid.extend_from_slice(mask.as_slice()),
                None => valid.resize(left.len(), true),
            }
        }
        let (rows, cols) = (bands.iter().map(Range::len).sum(), pair.size().1);
        let planes = [Plane::from_vec(rows, cols, left)?, Plane::from_vec(rows, cols, right)?];
        let whole = Self { factor: 1, planes, valid: Plane::from_vec(rows, cols, valid)? };
        let by = fine_factor(pair.size()) / 2;
        if by > 1 { whole.reduced_by(by, runtime) } else { Ok(whole) }
    }

    /// Unchanged reduced images, valid everywhere.
    #[cfg(test)]
    pub fn of_planes(planes: [Plane<f32>; 2]) -> Self {
        let valid = planes[0].map(|_| true);
        Self { factor: 1, planes, valid }
    }

    /// The vertical shift with which still smaller copies match best; `None`: no shift.
    pub fn shift(
        &self,
        candidates: Option<Candidates>,
        size: (usize, usize),
        runtime: Runtime,
    ) -> Result<Option<Alignment>> {
        let coarse = self.reduced(COARSE_WIDTH, runtime)?;
        let span = candidates.map_or_else(|| coarse.widest(), |all| coarse.span(all));

        let mut most = coarse.matched(span, None, ROUGH, runtime)?.confidence;
        let mut best = None;

        // Small shifts first: among equal ones, the smallest is kept.
        for by in (1..=MOST_ROWS).flat_map(|by| [by, -by]) {
            let mut coefficients = [0.0; TERMS];
            coefficients[0] = (by * coarse.factor as isize) as f64;
            let shift = Alignment::new(coefficients, size)?;

            let found = coarse.matched(span, Some(&shift), ROUGH, runtime)?.confidence;
            if found > most {
                (most, best) = (found, Some(shift));
            }
        }

        Ok(best)
    }

    /// Some bands of rows, one below the other, the right image resampled by the field.
    pub fn bands(
        &self,
        bands: &[Range<usize>],
        field: Option<&Alignment>,
        control: &Control,
    ) -> Result<Self> {
        let right = field.map(|field| raised(&self.planes[1], field, self.factor, control));
        let right = right.transpose()?;
        let planes = [&self.planes[0], right.as_ref().unwrap_or(&self.planes[1])];

        Ok(Self {
            factor: self.factor,
            planes: [of_bands(planes[0], bands)?, of_bands(planes[1], bands)?],
            valid: of_bands(&self.valid, bands)?,
        })
    }

    /// The guess that a rough match of these copies gives for others of the same pair.
    pub fn guess<'a>(&self, map: &'a RoughMap, others: &Self) -> Guess<'a> {
        let finer = (self.factor / others.factor).max(1);
        Guess { disparity: &map.unsure, by: (others.factor / self.factor).max(1), finer, judged: None }
    }

    /// The same with the negative of the right image.
    pub fn inverted(&self) -> Self {
        let [left, right] = &self.planes;
        let planes = [left.clone(), right.map(|value| -value)];

        Self { factor: self.factor, planes, valid: self.valid.clone() }
    }

    /// Whether, at matching pixels, those brighter than the mean in one image are darker in the other.
    pub fn is_opposite(&self, map: &RoughMap) -> bool {
        let cols = self.valid.cols();
        let mut matched = vec![];
        for y in (0..self.valid.rows()).step_by(SAMPLED) {
            let disparities = map.unsure.row(y);
            let [left, right] = self.planes.each_ref().map(|plane| plane.row(y));
            for (x, disparity) in disparities.iter().enumerate() {
                let at = x as f32 - disparity;
                if self.valid.row(y)[x] && at >= 0.0 && at < cols as f32 {
                    matched.push([f64::from(left[x]), f64::from(right[at as usize])]);
                }
            }
        }

        let count = matched.len().max(1) as f64;
        let mean = [0, 1].map(|side| matched.iter().map(|pixel| pixel[side]).sum::<f64>() / count);
        let product = |pixel: &[f64; 2]| (pixel[0] - mean[0]) * (pixel[1] - mean[1]);
        matched.iter().map(product).sum::<f64>() < 0.0
    }

    /// The same, reduced to the width of [`Self::new`]; `None`: it has that width.
    pub fn usual(&self, runtime: Runtime) -> Result<Option<Self>> {
        let by = reduction(self.valid.size(), WIDTH);
        (by > 1).then(|| self.reduced_by(by, runtime)).transpose()
    }

    /// The same, reduced by two more; `None`: these are the smallest copies.
    pub fn halved(&self, runtime: Runtime) -> Result<Option<Self>> {
        let size = self.valid.size();
        let is_larger = reduction(size, COARSE_WIDTH) > 1;
        is_larger.then(|| self.reduced_by(2, runtime)).transpose()
    }

    /// The same, reduced further, to this many columns.
    pub fn reduced(&self, width: usize, runtime: Runtime) -> Result<Self> {
        self.reduced_by(reduction(self.valid.size(), width), runtime)
    }

    /// The same, reduced further by this factor.
    pub fn reduced_by(&self, by: usize, runtime: Runtime) -> Result<Self> {
        let planes = both(|side| reduced(&self.planes[side], by, runtime))?;

        let (rows, cols) = planes[0].size();
        let valid = Plane::from_fn(rows, cols, |y, x| self.valid.row(y * by)[x * by]);
        Ok(Self { factor: self.factor * by, planes, valid })
    }

    /// The span of these copies for disparities of the full images. It has no margin: one more on either side
    /// of a power of two would take another run of lanes.
    pub fn span(&self, all: Candidates) -> Span {
        let factor = self.factor as isize;
        (all.min().div_euclid(factor), all.max().div_euclid(factor))
    }

    /// The span of all disparities to try.
    pub fn widest(&self) -> Span {
        let reach = self.share(REACH);
        (-reach, reach)
    }

    /// The spans to try if nothing matches well within [`Self::widest`], which they overlap by half a reach:
    /// a range may lie on either side of its end.
    pub fn farther(&self) -> [Span; 2] {
        let (near, far) = (self.share(REACH / 2.0), self.share(FAR_REACH));
        [(near, far), (-far, -near)]
    }

    /// A share of the width, pixels.
    fn share(&self, share: f64) -> isize {
        (share * self.planes[0].cols() as f64) as isize
    }

    /// Matches the reduced images over a span of their disparities, with the right one resampled by the
    /// field: roughly, with a left-right check.
    pub fn matched(
        &self,
        span: Span,
        alignment: Option<&Alignment>,
        detail: CopySettings,
        runtime: Runtime,
    ) -> Result<RoughMap> {
        let (planes, settings) = (self.planes.clone(), detail.settings());
        let map = match_reduced(planes, self.factor, alignment, span, &settings, runtime)?;
        Ok(RoughMap::new(map, &self.valid, alignment.cloned()))
    }
}

/// Some bands of the rows of a plane, one below the other.
pub fn of_bands<T: Copy>(plane: &Plane<T>, bands: &[Range<usize>]) -> Result<Plane<T>> {
    let cols = plane.cols();
    let values = |rows: &Range<usize>| &plane.as_slice()[rows.start * cols..rows.end * cols];

    let rows = bands.iter().map(Range::len).sum();
    Plane::from_vec(rows, cols, bands.iter().map(values).collect::<Vec<_>>().concat())
}

/// The columns of the left image that some disparity of a span finds in the right one.
fn matched_columns((low, high): Span, cols: usize) -> Range<usize> {
    low.max(0) as usize..cols.saturating_add_signed(high.min(0))
}

impl RoughMap {
    /// The disparities of images that are reduced by a factor.
    pub fn seen(&self, factor: usize) -> Seen {
        let [all, sure] = [&self.unsure, &self.disparity].map(|plane| plane.map(|d| d * factor as f32));
        Seen { all, sure, factor }
    }

    /// A matched map without its uncertain and masked pixels.
    fn new(map: Disparity, valid: &Plane<bool>, field: Option<Alignment>) -> Self {
        let unsure = map.disparity;
        let mut disparity = unsure.clone();
        let confidences = |y: usize| map.confidence.as_ref().map_or(&[][..], |plane| plane.row(y));
        for y in 0..disparity.rows() {
            let (flags, is_valid, confidences) = (map.flags.row(y), valid.row(y), confidences(y));
            for (x, value) in disparity.row_mut(y).iter_mut().enumerate() {
                let is_known = confidences[x] >= SURE && flags[x] & flag::OUTSIDE == 0;
                if !is_valid[x] || !is_known {
                    *value = f32::NAN;
                }
            }
        }

        let run = extent(&disparity);
        let (mut sum, mut count) = (0.0, 0);
        let columns = matched_columns(run.unwrap_or((0, 0)), disparity.cols());
        for y in 0..disparity.rows() {
            let all = confidences(y).iter().zip(valid.row(y)).take(columns.end).skip(columns.start);
            for (confidence, _) in all.filter(|(_, is_valid)| **is_valid) {
                sum += f64::from(*confidence);
                count += 1;
            }
        }
        Self { disparity, unsure, run, field, confidence: sum / f64::from(count.max(1)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_halved_until_they_are_narrow_enough_or_would_be_too_flat() {
        for (cols, factor) in [(320, 1), (321, 2), (640, 2), (641, 4), (9000, 32)] {
            assert_eq!(reduction((32 * LEAST_ROWS, cols), 320), factor, "{cols}");
        }
        for (rows, factor) in [(1, 1), (2, 2), (3, 2), (4, 4), (7, 4), (8, 8)] {
            assert_eq!(reduction((rows * LEAST_ROWS, 9000), 320), factor, "{rows}");
        }
        assert_eq!(reduction((8 * LEAST_ROWS - 1, 9000), 320), 4);
    }
}

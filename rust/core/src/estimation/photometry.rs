//! The estimates from the gray values of a pair: how the two images compare, how much of them carries no
//! information, and which patterns mislead a match.
//!
//! Rows are sampled: of every sixteen the first and the ninth, and the two below the first. All counts are
//! integers, so it does not matter how a pair is cut into parts:
//!
//! ```text
//! saturated   pixels with a channel at the smallest or the largest value of the image
//! flat        runs of 16 pixels of a row that differ by no more than noise
//! smeared     runs with texture, whose values lie on a smooth curve (rows.rs)
//! repeated    windows of a row that recur a few pixels on, within the searched disparities (rows.rs)
//! fields      sums of differences between even and odd rows, shifted against each other (rows.rs)
//! ```
//!
//! Gain and gamma are fitted to windows of the reduced copies that correspond (response.rs).

mod response;
mod rows;

use std::iter;
use std::ops::Range;

use rayon::prelude::*;

pub use self::response::Contrast;
use self::rows::{FIELD_REACH, Runs, alternation, field_differences, repeated_windows, runs};
use crate::estimation::blur::parts::{HALO, PairRows, Part, Strips};
use crate::estimation::blur::rough::grays_per_unit;
use crate::estimation::overview::{Overview, RoughMap};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::simd::{Level, leveled, whole};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;

/// Rows of a strip.
const STRIP: usize = 16;
/// Every this many rows of a strip, one is sampled.
const EVERY: usize = 8;
/// Steps of a gray value in which rows are compared.
const STEPS: f32 = 64.0;
/// Differences up to this many standard deviations of the noise are not texture.
const QUIET: f64 = 2.0;
/// ... and neither are those below this share of the range, half a gray level of 8 bits, however little noise
/// there is.
const FLAT: f64 = 0.002;
/// The sharpness of runs with this many times that is judged.
const TEXTURED: f64 = 3.0;
/// Interlaced images: shifted back, the fields differ by at most this share of their unshifted difference. In
/// progressive images, no shift makes even and odd rows more similar.
const ALIKE: f64 = 0.9;
/// By chance, sums over `n` differences of noise vary by about `1 / sqrt(n)` of themselves; beyond this
/// multiple, a difference is significant.
const BEYOND_CHANCE: f64 = 6.0;

/// Shares of an image's pixels, 0 to 1, whose gray value is at an end of the image's range.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Saturation {
    /// At the least value.
    pub dark: f64,
    /// At the largest one.
    pub bright: f64,
}

/// The estimates from the gray values of a pair; pairs of values have the left image first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Photometry {
    /// Black, in units of the pixels.
    pub black: f64,
    /// Black to white, in units of the pixels: the capacity of the bits in use, or the range of floats.
    pub range: f64,
    /// Pixels at the ends of the values.
    pub saturation: [Saturation; 2],
    /// Shares of the image without texture along its rows; NaN if it is narrower than a run.
    pub flat: [f64; 2],
    /// Shares of the texture that is smeared, as by lossy compression, by denoising or by a soft lens; NaN
    /// without texture.
    pub smeared: [f64; 2],
    /// Shares of the image with texture that repeats along its rows; NaN if it is too narrow.
    pub repeated: [f64; 2],
    /// Pixels by which odd rows are shifted against even ones, as in interlaced video of motion; 0: they are
    /// not.
    pub fields: [i32; 2],
    /// Whether pixels two apart are more alike than neighbors, along rows: as in the raw mosaic of a color
    /// sensor, in bytes of YUYV, or in ordered dither. Their differences are 0.13 to 0.92 of those of
    /// neighbors there, 1.02 or more in 125 other kinds of faulty pairs, and 1.43 or more in 110 images.
    pub mosaic: [bool; 2],
    /// How the gray levels of the images correspond; `None`: too little corresponds.
    pub contrast: Option<Contrast>,
}

/// The conversion of gray values (`rough::grays`) of an image to fractions of the range from black to white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightScale {
    /// The gray value of black.
    black: f64,
    /// White minus black.
    width: f64,
    /// Gray values per unit of the pixels.
    unit: f64,
}

/// The scales of both images, and white minus black in units of the pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    sides: [LightScale; 2],
    black: f64,
    range: f64,
}

/// Counts from an image.
#[derive(Debug, Clone, Copy, PartialEq)]
struct GrayExtremes {
    /// The smallest gray value, and the number of pixels with it.
    least: (f64, u64),
    /// The largest gray value, and the number of pixels with it.
    largest: (f64, u64),
    /// Number of sampled pixels.
    pixels: u64,
    /// Runs of pixels.
    runs: Runs,
    /// Windows that repeat, and all.
    repeated: [u64; 2],
    /// Sums of differences between the fields, by shift.
    fields: [u64; 2 * FIELD_REACH + 1],
    /// Sums of differences along rows: of neighbors, and of pixels two apart.
    alternation: [u64; 2],
}

impl Photometry {
    /// Examines sampled rows of a pair with this many searched disparities. `noise` holds the standard
    /// deviations in units of the pixels, 0 if unknown.
    pub fn new(
        rows: &PairRows,
        scales: &Scales,
        noise: [f64; 2],
        disparities: usize,
        contrast: Option<Contrast>,
        runtime: Runtime,
    ) -> Result<Self> {
        let tops: Vec<usize> = (0..rows.size().0).step_by(STRIP).collect();
        let strips = Strips { tops: &tops, rows: STRIP, halo: HALO, unit: 1 };

        let mut found = [GrayExtremes::default(); 2];
        rows.visit(strips, runtime, |part, visited| {
            let of_strip = |top: &usize| {
                runtime.control.checkpoint()?;
                let level = runtime.level();
                let limits = |side| scales.limits(side, noise, disparities);
                let side = |side| GrayExtremes::of_strip(part, side, *top, &limits(side), level);
                Ok([side(0), side(1)])
            };

            let counts: Result<Vec<_>> = tops[visited].par_iter().map(of_strip).collect();
            for [left, right] in counts? {
                found = [found[0].and(left), found[1].and(right)];
            }
            Ok(())
        })?;

        Ok(Self {
            black: scales.black,
            range: scales.range,
            saturation: found.map(|counts| counts.saturation()),
            flat: found.map(|counts| share([counts.runs.flat, counts.runs.all])),
            smeared: found.map(|counts| share([counts.runs.smeared, counts.runs.textured])),
            repeated: found.map(|counts| share(counts.repeated)),
            fields: found.map(|counts| counts.field_shift()),
            mosaic: found.map(|counts| counts.alternates()),
            contrast,
        })
    }

    /// The share of the image that repeats in both.
    pub fn repeats(&self) -> f64 {
        self.repeated[0].min(self.repeated[1])
    }
}

/// The quotient of a count and of all; NaN if there are none.
fn share([some, all]: [u64; 2]) -> f64 {
    some as f64 / all as f64
}

/// Differences in steps of sampled rows, and distances.
struct Limits {
    /// The standard deviation of the noise.
    noise: f64,
    /// The standard deviation below which there is no texture.
    flat: f64,
    /// The smallest standard deviation for which the sharpness of texture is judged.
    textured: f64,
    /// The longest period that misleads a match, pixels.
    period: usize,
}

impl Scales {
    /// The scales of a pair; `sample` is any part of it.
    pub fn new(sample: &Pair) -> Self {
        let views = sample.views();
        let scales = views.map(View::scale);

        // Integers begin at 0 and have the number of bits in use; floats have one range in both images.
        let (black, range) = if let Some((step, _)) = scales[0].step().zip(scales[1].step()) {
            (0.0, 256.0 * scales[0].level() - step)
        } else {
            let ends = scales.map(|scale| scale.range().map(|end| scale.pixel(end.into())));
            let [[a, b], [c, d]] = ends;
            let (black, white) = (a.min(c), b.max(d));
            // A pair of constant images has none.
            (black, if white > black { white - black } else { 1.0 })
        };

        let side = |side: usize| {
            let unit = grays_per_unit(views[side]);
            let black = black - scales[side].pixel(0.0);
            LightScale { black: black * unit, width: range * unit, unit }
        };
        Self { sides: [side(0), side(1)], black, range }
    }

    /// How the gray levels of the reduced images correspond.
    pub fn contrast(&self, overview: &Overview, rough: &RoughMap) -> Option<Contrast> {
        Contrast::new(overview, rough, &self.sides)
    }

    fn limits(&self, side: usize, noise: [f64; 2], disparities: usize) -> Limits {
        let steps = self.sides[side].unit * f64::from(STEPS);
        let flat = (QUIET * noise[side]).max(FLAT * self.range) * steps;
        let textured = flat.max(TEXTURED * FLAT * self.range * steps);
        Limits { noise: noise[side] * steps, flat, textured, period: disparities - 1 }
    }
}

impl Default for GrayExtremes {
    fn default() -> Self {
        Self {
            least: (f64::INFINITY, 0),
            largest: (f64::NEG_INFINITY, 0),
            pixels: 0,
            runs: Runs::default(),
            repeated: [0; 2],
            fields: [0; 2 * FIELD_REACH + 1],
            alternation: [0; 2],
        }
    }
}

impl GrayExtremes {
    /// Counts in the strip with this top row of the whole image.
    fn of_strip(part: &Part, side: usize, top: usize, limits: &Limits, level: Level) -> Self {
        let mut counts = Self::default();
        let (view, plane) = (part.pair.views()[side], &part.grays[side]);

        let first = top - part.first;
        let steps = |y: usize| {
            let mut steps = vec![0; plane.cols()];
            write_steps(level, plane.row(y), &mut steps);
            steps
        };
        for y in (first..(first + STRIP).min(plane.rows())).step_by(EVERY) {
            counts = counts.and(Self::of_pixels(view, y, level));
            let row = steps(y);
            for valid in valid(view, y) {
                let runs = runs(&row[valid], limits.flat, limits.textured, level);
                counts.runs = counts.runs.and(runs);
            }
        }

        let row = steps(first);
        counts.alternation = alternation(level, &row);
        for valid in valid(view, first) {
            let Limits { noise, flat, period, .. } = *limits;
            let repeated = repeated_windows(&row[valid], noise, flat, period, level);
            counts.repeated = [0, 1].map(|at| counts.repeated[at] + repeated[at]);
        }
        // Strips begin with an even row.
        if first + 2 < plane.rows() {
            let rows = [&row, &steps(first + 1), &steps(first + 2)];
            counts.fields = field_differences(level, rows.map(Vec::as_slice));
        }

        counts
    }

    /// The valid pixels of a row of the part at the ends of their values.
    fn of_pixels(view: &View, y: usize, level: Level) -> Self {
        let all = view.gray().row(y);
        let valid: Option<Vec<i32>> = view.mask().map(|mask| {
            let pixels = all.iter().zip(mask.row(y));
            pixels.filter(|(_, valid)| **valid).map(|(pixel, _)| *pixel).collect()
        });

        let ends = count_ends(level, valid.as_deref().unwrap_or(all));
        ends.map_or(Self::default(), |RowExtremes { least, largest, pixels, counts: [dark, bright] }| Self {
            least: (least.into(), dark.into()),
            largest: (largest.into(), bright.into()),
            pixels: pixels as u64,
            ..Self::default()
        })
    }

    /// The counts of both parts.
    fn and(self, other: Self) -> Self {
        // The outer one of two ends counts.
        let end = |own: (f64, u64), other: (f64, u64), is_outer: bool| match () {
            () if own.0.to_bits() == other.0.to_bits() => (own.0, own.1 + other.1),
            () if is_outer => other,
            () => own,
        };

        let mut fields = self.fields;
        fields.iter_mut().zip(other.fields).for_each(|(sum, more)| *sum += more);
        Self {
            least: end(self.least, other.least, other.least.0 < self.least.0),
            largest: end(self.largest, other.largest, other.largest.0 > self.largest.0),
            pixels: self.pixels + other.pixels,
            runs: self.runs.and(other.runs),
            repeated: [0, 1].map(|at| self.repeated[at] + other.repeated[at]),
            fields,
            alternation: [0, 1].map(|at| self.alternation[at] + other.alternation[at]),
        }
    }

    fn saturation(&self) -> Saturation {
        let of = |count: u64| share([count, self.pixels.max(1)]);
        Saturation { dark: of(self.least.1), bright: of(self.largest.1) }
    }

    /// Pixels by which odd rows are shifted; 0: no shift makes the fields clearly more similar, or columns
    /// alternate as well.
    fn field_shift(&self) -> i32 {
        let differences = self.fields.iter().enumerate();
        let best = differences.min_by_key(|(_, sum)| **sum).map_or(FIELD_REACH, |(at, _)| at);

        let most = ALIKE.min(self.significant());
        let is_clear = (self.fields[best] as f64) < most * self.fields[FIELD_REACH] as f64;
        if is_clear && !self.alternates() { best as i32 - FIELD_REACH as i32 } else { 0 }
    }

    /// Whether pixels two apart are more alike than neighbors, along rows.
    fn alternates(&self) -> bool {
        let [near, far] = self.alternation.map(|sum| sum as f64);
        far < self.significant() * near
    }

    /// The ratio of two sums of differences below which chance does not explain it.
    fn significant(&self) -> f64 {
        // One row of pixels per strip is compared, and one in every `EVERY` is sampled.
        let compared = (self.pixels * EVERY as u64 / STRIP as u64).max(1) as f64;
        1.0 - BEYOND_CHANCE / compared.sqrt()
    }
}

/// The places of a row where the image is valid, one piece after another.
fn valid(view: &View, y: usize) -> Vec<Range<usize>> {
    let Some(mask) = view.mask() else { return iter::once(0..view.size().1).collect() };
    let mut at = 0;
    let pieces = mask.row(y).chunk_by(|a, b| a == b).map(|piece| {
        at += piece.len();
        (piece[0], at - piece.len()..at)
    });
    pieces.filter(|(is_valid, _)| *is_valid).map(|(_, piece)| piece).collect()
}

/// Gray values in steps.
#[leveled]
fn write_steps(level: Level, row: &[f32], steps: &mut [i32]) {
    for (step, value) in steps.iter_mut().zip(row) {
        *step = whole(value * STEPS);
    }
}

/// The ends of the values of a row, and the numbers of pixels with them.
struct RowExtremes {
    least: i32,
    largest: i32,
    pixels: usize,
    /// Numbers of pixels with the smallest and with the largest value.
    counts: [u32; 2],
}

/// Finds the ends of the values of pixels; `None` without any.
#[leveled]
fn count_ends(level: Level, values: &[i32]) -> Option<RowExtremes> {
    let first = *values.first()?;
    let (mut least, mut largest) = (first, first);
    for value in values {
        least = least.min(*value);
        largest = largest.max(*value);
    }

    let mut counts = [0u32; 2];
    for value in values {
        counts[0] += u32::from(*value == least);
        counts[1] += u32::from(*value == largest);
    }

    Some(RowExtremes { least, largest, pixels: values.len(), counts })
}

impl LightScale {
    /// A gray value as a fraction of the range, clipped to it.
    fn fraction(&self, shade: f32) -> f64 {
        ((f64::from(shade) - self.black) / self.width).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_parts_are_those_of_the_whole() {
        let ends = |least, largest| GrayExtremes { least, largest, pixels: 10, ..GrayExtremes::default() };
        let found = ends((3.0, 2), (9.0, 1)).and(ends((3.0, 1), (8.0, 4)));
        assert_eq!((found.least, found.largest), ((3.0, 3), (9.0, 1)));

        let found = found.and(ends((4.0, 1), (11.0, 5))).and(GrayExtremes::default());
        assert_eq!(found.saturation(), Saturation { dark: 0.1, bright: 5.0 / 30.0 });
    }

    #[test]
    fn fields_are_shifted_where_that_makes_them_clearly_more_alike() {
        let mut fields = [100; 2 * FIELD_REACH + 1];
        let shift = |fields, pixels| GrayExtremes { pixels, fields, ..GrayExtremes::default() }.field_shift();
        fields[FIELD_REACH + 3] = 95;
        assert_eq!(shift(fields, 100_000), 0);

        fields[FIELD_REACH - 2] = 70;
        assert_eq!(shift(fields, 100_000), -2);
        assert_eq!(shift(fields, 500), 0, "by chance");
        assert_eq!(GrayExtremes::default().field_shift(), 0);

        let columns =
            GrayExtremes { pixels: 100_000, fields, alternation: [100, 60], ..GrayExtremes::default() };
        assert!(columns.alternates() && columns.field_shift() == 0);
    }
}

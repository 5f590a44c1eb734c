//! Pixels of any type -> integers on one scale: gray planes for the phase codes, channel planes for SAD.
//!
//! Everything after this module is integer arithmetic, so that results do not depend on how the work is
//! cut into bands. Gray is `299 R + 587 G + 114 B` thousandths, exact for integer images: scaling both
//! images by one factor then scales every spectral component exactly, and no code changes.

use crate::control::Control;
use crate::error::Result;
use crate::masking::fill_masked;
use crate::plane::Plane;
use crate::view::View;

/// Steps into which the intensity range of a float image is cut: `2^21` to `2^22`, finer than 16 bits.
const FLOAT_STEPS_LOG2: i32 = 21;
/// Gray values of float images are clamped this many steps from black: four ranges.
const FLOAT_REACH: f64 = (1 << 24) as f64;
/// Share of the pixels left out at either end of a float image's robust range.
const OUTLIERS: f64 = 0.001;

/// Fixed-point steps per gray level of a channel plane, where black to white is 255 gray levels.
pub const LEVEL_STEPS: u16 = 16;
/// Black to white in steps of a channel plane.
const LEVEL_RANGE: f64 = 255.0 * LEVEL_STEPS as f64;
/// Black in a channel plane: float images may be darker than their robust range's end.
const LEVEL_BLACK: f64 = LEVEL_RANGE;
/// Largest value of a channel plane.
pub const LEVEL_CEILING: u16 = 3 * 255 * LEVEL_STEPS;

/// Black and white, in thousandths of the pixels' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    black: f64,
    white: f64,
}

impl Range {
    fn width(self) -> f64 {
        self.white - self.black
    }
}

/// A view with what its range was found from.
struct Measured<'a> {
    view: &'a View,
    range: Range,
    /// Float images alone need a look at all their pixels before the first can be converted.
    luminance: Option<Plane<f64>>,
}

/// The gray planes of a pair, for the phase codes.
///
/// The step of float images follows `told`, or else the wider of their robust ranges, each measured from
/// its own black: an offset between the images neither coarsens the step nor changes a code.
pub fn gray_planes(
    [left, right]: [&View; 2],
    told: Option<(f64, f64)>,
    control: &Control,
) -> Result<[Plane<i32>; 2]> {
    let (left, right) = (Measured::new(left, told, control)?, Measured::new(right, told, control)?);
    let width = left.range.width().max(right.range.width());
    Ok([left.gray(width, control)?, right.gray(width, control)?])
}

/// The gray plane of one image by itself.
pub fn gray_plane(view: &View, told: Option<(f64, f64)>, control: &Control) -> Result<Plane<i32>> {
    let measured = Measured::new(view, told, control)?;
    measured.gray(measured.range.width(), control)
}

/// The channel planes of a pair, for SAD: three where both images have colour, else gray.
pub fn level_planes(
    [left, right]: [&View; 2],
    told: Option<(f64, f64)>,
    control: &Control,
) -> Result<[Vec<Plane<u16>>; 2]> {
    let a = Measured::new(left, told, control)?.range;
    let b = Measured::new(right, told, control)?.range;
    let range = Range { black: a.black.min(b.black), white: a.white.max(b.white) };
    let as_gray = left.image.shape().2 != 3 || right.image.shape().2 != 3;
    Ok([levels(left, range, as_gray, control)?, levels(right, range, as_gray, control)?])
}

impl<'a> Measured<'a> {
    fn new(view: &'a View, told: Option<(f64, f64)>, control: &Control) -> Result<Self> {
        let thousandths = |(black, white)| Range { black: 1000.0 * black, white: 1000.0 * white };
        let known = told.or(view.image.white().map(|white| (0.0, f64::from(white))));
        if let Some(range) = known.map(thousandths) {
            return Ok(Self { view, range, luminance: None });
        }
        let (rows, cols, _) = view.image.shape();
        let write = |y: usize, row: &mut [f64]| view.image.write_luminance(y, row);
        let luminance = Plane::by_rows((rows, cols), control, write)?;
        Ok(Self { view, range: robust_range(view, &luminance), luminance: Some(luminance) })
    }

    /// The gray plane, centred so that 25 bits and the sign hold any image; `width` of the range sets the
    /// step of floats.
    fn gray(&self, width: f64, control: &Control) -> Result<Plane<i32>> {
        let (rows, cols, _) = self.view.image.shape();
        let plane = Plane::by_rows((rows, cols), control, |y, gray: &mut [i32]| {
            let mut luminance = vec![0.0; cols];
            match &self.luminance {
                Some(plane) => luminance.copy_from_slice(plane.row(y)),
                None => self.view.image.write_luminance(y, &mut luminance),
            }
            match self.view.image.white() {
                Some(white) => centre(&luminance, white, gray),
                None => quantise(&luminance, self.range.black, width, gray),
            }
        })?;
        Ok(filled(plane, self.view))
    }
}

/// Integer images exactly, about the middle of their type's range.
fn centre(luminance: &[f64], white: u16, gray: &mut [i32]) {
    let middle = 500.0 * f64::from(white);
    gray.iter_mut().zip(luminance).for_each(|(gray, value)| *gray = (value - middle) as i32);
}

/// Float images in steps of a power of two, so that scaling both images by one changes nothing.
fn quantise(luminance: &[f64], black: f64, width: f64, gray: &mut [i32]) {
    let exponent = FLOAT_STEPS_LOG2 - floor_log2(width);
    for (gray, value) in gray.iter_mut().zip(luminance) {
        let steps = scale(value - black, exponent);
        *gray = steps.clamp(-FLOAT_REACH, FLOAT_REACH).round() as i32;
    }
}

/// Channel planes in steps of `1 / LEVEL_STEPS` gray levels above `LEVEL_BLACK`.
fn levels(view: &View, range: Range, as_gray: bool, control: &Control) -> Result<Vec<Plane<u16>>> {
    let (rows, cols, channels) = view.image.shape();
    // A pair of constant images has no width; any other will do then.
    let step = if range.width() > 0.0 { range.width() / LEVEL_RANGE } else { 1.0 };
    let level = |v: f64| ((v - range.black) / step).round() + LEVEL_BLACK;
    let write = |c: usize, y: usize, values: &mut [f64]| {
        if as_gray {
            view.image.write_luminance(y, values);
        } else {
            view.image.write_channel(c, y, values);
        }
    };
    let plane = |c: usize| {
        let plane = Plane::by_rows((rows, cols), control, |y, row: &mut [u16]| {
            let mut values = vec![0.0; cols];
            write(c, y, &mut values);
            for (row, value) in row.iter_mut().zip(values) {
                *row = level(value).clamp(0.0, f64::from(LEVEL_CEILING)) as u16;
            }
        })?;
        Ok(filled(plane, view))
    };
    (0..if as_gray { 1 } else { channels }).map(plane).collect()
}

/// Where the valid pixels of a float image lie, but for the outliers at either end.
fn robust_range(view: &View, luminance: &Plane<f64>) -> Range {
    let mut values = luminance.as_slice().to_vec();
    if let Some(mask) = &view.mask {
        let mut valid = mask.as_slice().iter();
        values.retain(|_| valid.next() == Some(&true));
    }
    let Some(last) = values.len().checked_sub(1) else { return Range { black: 0.0, white: 0.0 } };
    let mut ranked = |rank: usize| *values.select_nth_unstable_by(rank, f64::total_cmp).1;
    let outliers = (OUTLIERS * last as f64) as usize;
    let robust = Range { black: ranked(outliers), white: ranked(last - outliers) };
    if robust.black < robust.white {
        return robust;
    }
    Range { black: ranked(0), white: ranked(last) }
}

/// `plane` with the masked pixels replaced by valid neighbours.
fn filled<T: Copy + Default>(mut plane: Plane<T>, view: &View) -> Plane<T> {
    if let Some(mask) = &view.mask {
        fill_masked(&mut plane, mask);
    }
    plane
}

/// The exponent of the leading bit; 0 for zero, so that a constant image has some scale.
fn floor_log2(value: f64) -> i32 {
    if value == 0.0 { 0 } else { ((value.to_bits() >> 52) & 0x7ff) as i32 - 1023 }
}

/// `value * 2^exponent` in two steps, since the power alone may overflow.
fn scale(value: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    value * 2f64.powi(half) * 2f64.powi(exponent - half)
}

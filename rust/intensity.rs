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
/// Pixels that are enough to find that range; of larger images a sample is taken.
const MOST_SAMPLES: usize = 1 << 20;

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

    fn union(self, other: Self) -> Self {
        Self { black: self.black.min(other.black), white: self.white.max(other.white) }
    }
}

/// The gray plane under the phase codes, centred so that 25 bits and the sign hold any image.
///
/// Codes compare directions, not lengths: each image may have a scale of its own.
pub fn gray_plane(view: &View, control: &Control) -> Result<Plane<i32>> {
    let (rows, cols, _) = view.image.shape();
    let scale = match view.image.white() {
        Some(white) => Scale::Exact { middle: 500.0 * f64::from(white) },
        None => Scale::new(robust_range(view, control)?),
    };
    let plane = Plane::by_rows((rows, cols), control, |y, gray: &mut [i32]| {
        let mut luminance = vec![0.0; cols];
        view.image.write_luminance(y, &mut luminance);
        gray.iter_mut().zip(luminance).for_each(|(gray, value)| *gray = scale.gray(value));
    })?;
    filled(plane, view, control)
}

/// How gray values become integers.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// Integer images, about the middle of their type's range.
    Exact { middle: f64 },
    /// Float images, in steps of a power of two above black: scaling an image by one changes nothing.
    Steps { black: f64, exponent: i32 },
}

impl Scale {
    fn new(range: Range) -> Self {
        Self::Steps { black: range.black, exponent: FLOAT_STEPS_LOG2 - floor_log2(range.width()) }
    }

    fn gray(self, value: f64) -> i32 {
        match self {
            Self::Exact { middle } => (value - middle) as i32,
            Self::Steps { black, exponent } => {
                times_power(value - black, exponent).clamp(-FLOAT_REACH, FLOAT_REACH).round() as i32
            }
        }
    }
}

/// The channel planes of a pair, for SAD: three where both images have colour, else gray.
pub fn level_planes(
    [left, right]: [&View; 2],
    told: Option<(f64, f64)>,
    control: &Control,
) -> Result<[Vec<Plane<u16>>; 2]> {
    let range = match told.or(left.image.white().map(|white| (0.0, f64::from(white)))) {
        Some((black, white)) => Range { black: 1000.0 * black, white: 1000.0 * white },
        None => robust_range(left, control)?.union(robust_range(right, control)?),
    };
    let as_gray = left.image.shape().2 != 3 || right.image.shape().2 != 3;
    Ok([levels(left, range, as_gray, control)?, levels(right, range, as_gray, control)?])
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
        filled(plane, view, control)
    };
    (0..if as_gray { 1 } else { channels }).map(plane).collect()
}

/// Where the valid pixels of a float image lie, but for the outliers at either end.
///
/// The ends are those of an even sample: a large image has more pixels than its range needs.
fn robust_range(view: &View, control: &Control) -> Result<Range> {
    let (rows, cols, _) = view.image.shape();
    let stride = (rows * cols).div_ceil(MOST_SAMPLES);
    let (mut extremes, mut sample) = (None::<Range>, Vec::new());
    let mut luminance = vec![0.0; cols];
    for y in 0..rows {
        control.checkpoint()?;
        view.image.write_luminance(y, &mut luminance);
        for (x, &value) in luminance.iter().enumerate().filter(|(x, _)| view.is_valid(y, *x)) {
            let here = Range { black: value, white: value };
            extremes = Some(extremes.map_or(here, |range| range.union(here)));
            if (y * cols + x) % stride == 0 {
                sample.push(value);
            }
        }
    }
    let extremes = extremes.unwrap_or(Range { black: 0.0, white: 0.0 });
    Ok(inner_range(&mut sample).filter(|range| range.width() > 0.0).unwrap_or(extremes))
}

/// The range of a sample without its outliers; `None` if there is nothing in it.
fn inner_range(sample: &mut [f64]) -> Option<Range> {
    let last = sample.len().checked_sub(1)?;
    let outliers = (OUTLIERS * last as f64) as usize;
    let mut ranked = |rank: usize| *sample.select_nth_unstable_by(rank, f64::total_cmp).1;
    Some(Range { black: ranked(outliers), white: ranked(last - outliers) })
}

/// `plane` with the masked pixels replaced by valid neighbours.
fn filled<T: Copy + Default>(
    mut plane: Plane<T>,
    view: &View,
    control: &Control,
) -> Result<Plane<T>> {
    if let Some(mask) = &view.mask {
        fill_masked(&mut plane, mask, control)?;
    }
    Ok(plane)
}

/// The exponent of the leading bit; 0 for zero, so that a constant image has some scale.
fn floor_log2(value: f64) -> i32 {
    if value == 0.0 { 0 } else { ((value.to_bits() >> 52) & 0x7ff) as i32 - 1023 }
}

/// `value * 2^exponent` in two steps, since the power alone may overflow.
fn times_power(value: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    value * 2f64.powi(half) * 2f64.powi(exponent - half)
}

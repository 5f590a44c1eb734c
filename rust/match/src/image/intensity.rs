//! Pixels of any type -> integers on one scale: gray values for the phase codes, channel planes for SAD.
//!
//! All arithmetic after this module is exact, so results do not depend on how the work is cut into bands. Gray values of
//! integer images are exact, too: those of color images are `299 R + 587 G + 114 B` thousandths. Scaling an image by a
//! factor then scales every spectral component by it, and no code changes.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, Loop};
use crate::base::statistics::ranked;
use crate::base::value::nearest;
use crate::image::impulses;
use crate::image::intensity_range::{IntensityRange, NOWHERE, floor_log2};
use crate::image::masking::fill_masked;
use crate::image::view::{Image, View};

/// Binary logarithm of the steps into which the intensity range of a float image is cut: finer than 16 bits.
const FLOAT_STEPS_LOG2: i32 = 22;
/// Gray values of float images are clamped this many steps from black: four ranges.
const FLOAT_REACH: f64 = (1 << 24) as f64;
/// Share of the pixels left out at either end of a float image's robust range.
const OUTLIERS: f64 = 0.001;
/// Most pixels that this range is taken from; larger images are sampled.
const MOST_SAMPLES: usize = 1 << 16;

/// Largest magnitude of a gray value: sums of products with it are exact in double precision.
pub const LARGEST_REACH: u32 = 1 << 25;
/// Binary logarithm of the most steps of a blurred or smoothed image to one of the image itself.
pub const FINER_LOG2: u32 = 4;
/// Fixed-point steps per gray level of a channel plane, where black to white is 255 gray levels.
pub const LEVEL_STEPS: u16 = 16;
/// Black to white in steps of a channel plane.
const LEVEL_RANGE: f64 = 255.0 * LEVEL_STEPS as f64;
/// Black in a channel plane, above 0: float images may have pixels darker than the black of their robust range.
const LEVEL_BLACK: f64 = LEVEL_RANGE;
/// Largest value of a channel plane.
pub const LEVEL_CEILING: u16 = 3 * 255 * LEVEL_STEPS;

/// The gray values that phase codes are taken from, centered about zero. Each image may have its own scale, since codes
/// compare directions, not lengths.
#[derive(Debug)]
pub struct Gray<'a> {
    source: Pixels<'a>,
    size: (usize, usize),
    reach: u32,
    /// Steps per unit of the caller's pixels: the product of two, since it may overflow.
    unit: [f64; 2],
}

/// Where gray values come from.
#[derive(Debug)]
enum Pixels<'a> {
    /// An image, converted row by row when it is needed.
    Image(&'a Image, Quantization),
    /// Gray values that were processed further, or come from elsewhere.
    Plane(Plane<i32>),
}

impl<'a> Gray<'a> {
    /// The gray values of a checked view; masked pixels take the values of valid neighbors, and impulses are repaired.
    pub fn new(view: &'a View, level: Level, control: &Control) -> Result<Self> {
        let (rows, cols, channels) = view.image.shape();
        let scale = match view.image.middle() {
            Some(middle) => Quantization::Exact { middle: middle.into() },
            None => Quantization::Float(FloatSteps::new(intensity_range(view, control)?)),
        };

        let reach = match scale {
            Quantization::Exact { middle } if channels == 3 => 1000 * middle as u32,
            Quantization::Exact { middle } => middle as u32,
            Quantization::Float(_) => FLOAT_REACH as u32,
        };

        let unit = match scale {
            Quantization::Exact { .. } if channels == 3 => [1000.0, 1.0],
            Quantization::Exact { .. } => [1.0, 1.0],
            Quantization::Float(FloatSteps { factors: [a, b], .. }) => [1000.0 * a, b],
        };
        let unit = [unit[0], unit[1] / view.unit];

        let gray =
            Self { source: Pixels::Image(&view.image, scale), size: (rows, cols), reach, unit };

        if view.mask.is_none() && view.impulses == 0.0 {
            return Ok(gray);
        }

        let mut plane = filled(gray.plane(level, control)?, view, control)?;
        if view.impulses > 0.0 {
            let height = gray.steps(view.impulses) as i32;
            // After filling, as masked pixels may be anything.
            plane = impulses::repaired(&plane, height, level, control)?;
        }

        Ok(Self { source: Pixels::Plane(plane), ..gray })
    }

    /// All gray values.
    pub fn plane(&self, level: Level, control: &Control) -> Result<Plane<i32>> {
        Plane::by_bands(self.size, 1, |y, row| {
            control.checkpoint()?;
            self.write_row(y, level, row)
        })
    }

    /// Gray values of magnitude up to `reach`, at most [`LARGEST_REACH`], with one step to a unit.
    pub fn within(reach: u32, plane: Plane<i32>) -> Self {
        debug_assert!(reach <= LARGEST_REACH);

        let size = (plane.rows(), plane.cols());
        Self { size, source: Pixels::Plane(plane), reach, unit: [1.0, 1.0] }
    }

    /// These gray values after processing, in other steps: the largest magnitude is `reach`.
    pub fn scaled(&self, reach: u32, plane: Plane<i32>) -> Gray<'static> {
        let [unit, rest] = self.unit;
        let unit = [unit * (f64::from(reach) / f64::from(self.reach)), rest];

        Gray { unit, ..Gray::within(reach, plane) }
    }

    /// Other gray values of the same scale.
    pub fn like(&self, plane: Plane<i32>) -> Gray<'static> {
        Gray { unit: self.unit, ..Gray::within(self.reach, plane) }
    }

    /// One step of another image in steps of this one.
    pub fn steps_to(&self, other: &Self) -> f64 {
        let [a, b] = [0, 1].map(|i| self.unit[i] / other.unit[i]);
        a * b
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The largest magnitude that gray values may have.
    pub fn reach(&self) -> u32 {
        self.reach
    }

    /// A difference in intensity, in steps.
    pub fn steps(&self, difference: f64) -> f64 {
        difference * self.unit[0] * self.unit[1]
    }

    /// Writes row `y`.
    pub fn write_row(&self, y: usize, level: Level, gray: &mut [i32]) -> Result<()> {
        match &self.source {
            Pixels::Plane(plane) => gray.copy_from_slice(plane.row(y)),
            Pixels::Image(image, Quantization::Exact { middle }) => {
                image.write_centered(y, *middle, level, gray);
            }
            Pixels::Image(image, Quantization::Float(steps)) => {
                let mut luminance = zeroed(gray.len())?;
                image.write_luminance(y, &mut luminance);
                level.run(ToSteps { luminance: &luminance, steps: *steps, gray });
            }
        }
        Ok(())
    }
}

/// How luminances become integers.
#[derive(Debug, Clone, Copy)]
enum Quantization {
    /// Integer images: exact, about the middle of their type's range.
    Exact { middle: i32 },
    /// Float images: in steps above black.
    Float(FloatSteps),
}

/// As many steps to every range: scaling an image changes gray values by no more than its own rounding, and by a power of
/// two it changes none.
#[derive(Debug, Clone, Copy)]
struct FloatSteps {
    black: f64,
    /// Steps per unit: the product of two, since it may overflow.
    factors: [f64; 2],
}

impl FloatSteps {
    fn new(range: IntensityRange) -> Self {
        // The width is `fraction * 2^power`, or anything for a constant image.
        let power = floor_log2(range.width());
        let exponent = FLOAT_STEPS_LOG2 - power;
        let halves = [exponent / 2, exponent - exponent / 2].map(|power| 2f64.powi(power));
        let steps = range.width() * halves[0] * halves[1];
        let rest = if steps > 0.0 { f64::from(1 << FLOAT_STEPS_LOG2) / steps } else { 1.0 };

        Self { black: range.black, factors: [halves[0], halves[1] * rest] }
    }

    #[inline(always)]
    fn gray(self, value: f64) -> i32 {
        let steps = (value - self.black) * self.factors[0] * self.factors[1];
        nearest(steps.clamp(-FLOAT_REACH, FLOAT_REACH))
    }
}

/// Writes the gray values of a row of luminances.
struct ToSteps<'a> {
    luminance: &'a [f64],
    steps: FloatSteps,
    gray: &'a mut [i32],
}

impl Loop for ToSteps<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (gray, value) in self.gray.iter_mut().zip(self.luminance) {
            *gray = self.steps.gray(*value);
        }
    }
}

/// The channel planes of a pair, for SAD: three where both images have color, else gray. `given` is the intensity range
/// that the user names, in units of the caller's pixels.
pub fn level_planes(
    [left, right]: [&View; 2],
    given: Option<(f64, f64)>,
    control: &Control,
) -> Result<[Vec<Plane<u16>>; 2]> {
    let range = match given {
        Some((black, white)) => {
            let [black, white] = [black, white].map(|end| 1000.0 * end / left.unit);
            IntensityRange { black, white }
        }
        None => intensity_range(left, control)?.union(intensity_range(right, control)?),
    };

    let as_gray = left.image.shape().2 != 3 || right.image.shape().2 != 3;

    Ok([levels(left, range, as_gray, control)?, levels(right, range, as_gray, control)?])
}

/// Channel planes in steps of `1 / LEVEL_STEPS` gray levels above `LEVEL_BLACK`.
fn levels(
    view: &View,
    range: IntensityRange,
    as_gray: bool,
    control: &Control,
) -> Result<Vec<Plane<u16>>> {
    let (rows, cols, channels) = view.image.shape();
    // A pair of constant images has a range of no width; any step will do.
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

/// The intensity range of an image, in its own unit: that of the type for bytes; else that of the view if it has one, or a
/// robust range of its valid pixels.
pub fn intensity_range(view: &View, control: &Control) -> Result<IntensityRange> {
    if let Image::U8(_) = view.image {
        return Ok(IntensityRange { black: 0.0, white: 1000.0 * f64::from(u8::MAX) });
    }
    if let Some(range) = view.range {
        return Ok(range);
    }

    let (rows, cols, _) = view.image.shape();
    let mut sample = RangeSample::new((rows, cols));
    sample.add(view, 0, control)?;

    match sample.range() {
        Some(range) => Ok(range),
        None => Ok(full_range(view, control)?.unwrap_or(NOWHERE)),
    }
}

/// An even sample of the valid pixels of an image. Their range, without the outliers at either end, is that of the
/// image.
#[derive(Debug)]
pub struct RangeSample {
    cols: usize,
    stride: usize,
    values: Vec<f64>,
}

impl RangeSample {
    /// An empty sample of an image of so many rows and columns.
    pub fn new((rows, cols): (usize, usize)) -> Self {
        Self { cols, stride: (rows * cols).div_ceil(MOST_SAMPLES), values: vec![] }
    }

    /// Adds the pixels of a view that begins at row `first` of the image.
    pub fn add(&mut self, view: &View, first: usize, control: &Control) -> Result<()> {
        for y in 0..view.image.shape().0 {
            control.checkpoint()?;

            let start = (first + y) * self.cols;
            // Every `stride`-th pixel of the whole image, wherever its views begin.
            let skipped = start.next_multiple_of(self.stride) - start;
            let sampled = (skipped..self.cols).step_by(self.stride);

            let valid = sampled.filter(|x| view.is_valid(y, *x));
            self.values.extend(valid.map(|x| view.image.luminance(y, x)));
        }
        Ok(())
    }

    /// The range; `None` if the sampled pixels are all equal or there are none: then every pixel must be looked at.
    pub fn range(mut self) -> Option<IntensityRange> {
        let last = self.values.len().checked_sub(1)?;
        let outliers = (OUTLIERS * last as f64) as usize;

        let [black, white] = [outliers, last - outliers].map(|at| ranked(&mut self.values, at));
        let range = IntensityRange { black: black?, white: white? };

        (range.width() > 0.0).then_some(range)
    }
}

/// The range of all valid pixels; `None` if there are none.
pub fn full_range(view: &View, control: &Control) -> Result<Option<IntensityRange>> {
    let (rows, cols, _) = view.image.shape();
    let mut range: Option<IntensityRange> = None;
    for y in 0..rows {
        control.checkpoint()?;

        let valid = (0..cols).filter(|x| view.is_valid(y, *x));
        let values = valid.map(|x| view.image.luminance(y, x));
        range = values
            .map(|value| IntensityRange { black: value, white: value })
            .chain(range)
            .reduce(IntensityRange::union);
    }

    Ok(range)
}

/// `plane` with the masked pixels replaced by valid neighbors.
fn filled<T: Copy + Default + Send + Sync>(
    mut plane: Plane<T>,
    view: &View,
    control: &Control,
) -> Result<Plane<T>> {
    if let Some(mask) = &view.mask {
        fill_masked(&mut plane, mask, control)?;
    }
    Ok(plane)
}

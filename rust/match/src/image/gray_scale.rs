//! The meaning of gray values: steps of integers, or of the range of floats.

use crate::base::value::nearest;
use crate::image::intensity_range::{IntensityRange, floor_log2};

/// Binary logarithm of the number of steps in the intensity range of a float image: finer than 16 bits.
const FLOAT_STEPS_LOG2: i32 = 22;
/// Gray values of float images are clamped to this many steps from black: four ranges.
const FLOAT_REACH: i32 = 1 << 24;
/// Binary logarithm of the most steps of a blurred or smoothed image per step of the image itself.
pub const FINER_LOG2: u32 = 4;
/// Steps of a luminance per step of its integer channels: as fine as in smoothed images.
pub const LUMINANCE_STEPS: i32 = 1 << FINER_LOG2;

/// The meaning of the gray values of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrayScale {
    /// Steps per unit of the pixels, as the product of two, since it may overflow.
    factors: [f64; 2],
    /// The pixel whose gray value is 0.
    zero: f64,
    ends: [i32; 2],
    range: [i32; 2],
    width: f64,
    level: f64,
    step: Option<f64>,
}

impl GrayScale {
    /// The scale of integers that are multiples of a step and use this many bits, of luminances or not;
    /// `given` is the black and white of words.
    pub fn of_integers(
        (step, bits): (f64, u32),
        in_color: bool,
        given: Option<IntensityRange>,
        unit: f64,
    ) -> Self {
        let parts = if in_color { LUMINANCE_STEPS } else { 1 };
        let middle = if bits <= u8::BITS { 1 << (u8::BITS - 1) } else { 1 << (u16::BITS - 1) };
        let ends = [-middle * parts, (middle - 1) * parts];
        let in_steps = |end: f64| {
            let steps = end / step * (f64::from(parts) / 1000.0);
            (steps.round() as i32).saturating_add(ends[0])
        };
        let known = given.filter(|_| bits > u8::BITS);
        let range = known.map_or(ends, |range| [range.black, range.white].map(in_steps));

        let step = step * unit;
        Self {
            factors: [parts.into(), 1.0 / step],
            zero: f64::from(middle) * step,
            ends,
            range,
            width: f64::from(range[1] - range[0]) * step / f64::from(parts),
            level: f64::from(1u32 << (bits.max(u8::BITS) - u8::BITS)) * step,
            step: Some(step),
        }
    }

    /// The scale of float images with black and white in thousandths of this unit.
    pub fn of_floats(range: IntensityRange, unit: f64) -> Self {
        let [whole, rest] = FloatSteps::new(range).factors;
        let white = if range.width() > 0.0 { 1 << FLOAT_STEPS_LOG2 } else { 0 };

        Self {
            factors: [1000.0 * whole, rest / unit],
            zero: range.black / 1000.0 * unit,
            ends: [-FLOAT_REACH, FLOAT_REACH],
            range: [0, white],
            width: range.width() / 1000.0 * unit,
            level: range.width() / 256e3 * unit,
            step: None,
        }
    }

    /// A scale of one step to a unit, with values up to `reach` on either side of 0.
    #[cfg(test)]
    pub fn of_steps(reach: u32) -> Self {
        let reach = reach as i32;
        Self {
            factors: [1.0; 2],
            zero: 0.0,
            ends: [-reach, reach],
            range: [-reach, reach],
            width: 2.0 * f64::from(reach),
            level: f64::from(reach) / 128.0,
            step: Some(1.0),
        }
    }

    /// Steps per unit of the pixels, as the product of two, since it may overflow.
    pub fn factors(&self) -> [f64; 2] {
        self.factors
    }

    /// A difference of pixels, in steps.
    pub fn steps(&self, difference: f64) -> f64 {
        difference * self.factors[0] * self.factors[1]
    }

    /// The gray value of a pixel, without rounding.
    pub fn gray(&self, pixel: f64) -> f64 {
        self.steps(pixel - self.zero)
    }

    /// The pixel that has a gray value.
    pub fn pixel(&self, gray: f64) -> f64 {
        self.zero + gray / self.factors[0] / self.factors[1]
    }

    /// Least and largest gray value.
    pub fn ends(&self) -> [i32; 2] {
        self.ends
    }

    /// The largest magnitude of a gray value.
    pub fn reach(&self) -> u32 {
        self.ends[0].unsigned_abs()
    }

    /// Bits of gray values beyond the 15 for which sums of their squares over windows fit.
    pub fn surplus(&self) -> u32 {
        (u32::BITS - self.reach().leading_zeros()).saturating_sub(15)
    }

    /// Black and white as gray values: for bytes the ends, else robust ones of the image's valid pixels.
    pub fn range(&self) -> [i32; 2] {
        self.range
    }

    /// White minus black, in units of the pixels.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// A gray level, one of 256 from black to white, in units of the pixels. Few cameras use all 16 bits, so
    /// for integers white is the largest value of the bits that the brightest pixel of the pair has.
    pub fn level(&self) -> f64 {
        self.level
    }

    /// The difference between two consecutive integers, in units of the pixels; `None`: pixels are floats.
    pub fn step(&self) -> Option<f64> {
        self.step
    }

    /// The nearest gray value; ties are rounded away from the least one.
    #[inline]
    pub fn nearest(&self, gray: f64) -> i32 {
        let least = f64::from(self.ends[0]);
        (least + (gray - least).round()).clamp(least, self.ends[1].into()) as i32
    }

    /// The gray value of the darkest pixels.
    pub fn darkest(&self) -> i32 {
        if self.step.is_some() { self.ends[0] } else { self.range[0] }
    }

    /// The scale of the negative.
    pub fn inverted(&self) -> Self {
        let range = [self.range[1], self.range[0]].map(|end| self.mirror() - end);
        Self { range, ..*self }
    }

    /// The sum of a gray value and its negative's.
    pub fn mirror(&self) -> i32 {
        let [dark, bright] = if self.step.is_some() { self.ends } else { self.range };
        dark + bright
    }
}

/// Steps for floats: the same number in every range.
#[derive(Debug, Clone, Copy)]
pub struct FloatSteps {
    black: f64,
    /// Steps per unit, as the product of two, since it may overflow.
    factors: [f64; 2],
}

impl FloatSteps {
    /// Steps from black to white.
    pub fn new(range: IntensityRange) -> Self {
        // The width is `fraction * 2^power`, or anything for a constant image.
        let power = floor_log2(range.width());
        let exponent = FLOAT_STEPS_LOG2 - power;
        let halves = [exponent / 2, exponent - exponent / 2].map(|power| 2f64.powi(power));
        let steps = range.width() * halves[0] * halves[1];
        let rest = if steps > 0.0 { f64::from(1 << FLOAT_STEPS_LOG2) / steps } else { 1.0 };

        Self { black: range.black, factors: [halves[0], halves[1] * rest] }
    }

    #[inline(always)]
    /// The gray value of a pixel.
    pub fn gray(self, value: f64) -> i32 {
        let steps = (value - self.black) * self.factors[0] * self.factors[1];
        nearest(steps.clamp(-f64::from(FLOAT_REACH), f64::from(FLOAT_REACH)))
    }
}

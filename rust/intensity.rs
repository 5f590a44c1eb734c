//! Pixels of any type -> integers on one scale: gray planes for the phase codes, channel planes for SAD.
//!
//! Everything after this module is integer arithmetic, so that results do not depend on how the work is
//! cut into bands. Gray is `299 R + 587 G + 114 B` thousandths, exact for integer images: scaling both
//! images by one factor then scales every spectral component exactly, and no code changes.

use ndarray::{Array3, ArrayView3};

use crate::error::{Error, Result};
use crate::plane::{Plane, reflect};

/// Steps into which the intensity range of a float image is cut: `2^21` to `2^22`, finer than 16 bits.
const FLOAT_STEPS_LOG2: i32 = 21;
/// Gray values of float images are clamped this many steps from black: four ranges.
const FLOAT_REACH: f64 = (1 << 24) as f64;
/// Share of the pixels left out at either end of a float image's robust range.
const OUTLIERS: f64 = 0.001;
/// Largest magnitude of a float pixel; products with it stay finite.
const LARGEST_PIXEL: f64 = 1e300;

/// Fixed-point steps per gray level of a channel plane, where black to white is 255 gray levels.
pub const LEVEL_STEPS: u16 = 16;
/// Black to white in steps of a channel plane.
const LEVEL_RANGE: f64 = 255.0 * LEVEL_STEPS as f64;
/// Black in a channel plane: float images may be darker than their robust range's end.
const LEVEL_BLACK: f64 = LEVEL_RANGE;
/// Largest value of a channel plane.
pub const LEVEL_CEILING: u16 = 3 * 255 * LEVEL_STEPS;

/// Fixed-point steps per standard deviation of a normalised plane.
pub const DEVIATION_STEPS: u16 = 256;
/// Normalised values are clamped to this many deviations; only windows beyond 17 px can reach it.
const DEVIATION_REACH: f64 = 16.0;
/// Largest value of a normalised plane.
pub const DEVIATION_CEILING: u16 = 2 * 16 * DEVIATION_STEPS;

/// An image of `rows x cols x channels` (1 or 3 channels) as it came from the caller.
#[derive(Debug, Clone, PartialEq)]
pub enum Image {
    /// 8 bits a channel.
    U8(Array3<u8>),
    /// 16 bits a channel.
    U16(Array3<u16>),
    /// Single precision.
    F32(Array3<f32>),
    /// Double precision.
    F64(Array3<f64>),
}

/// Which pixels are valid.
pub type Mask = Plane<bool>;

/// One camera's part of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Its pixels.
    pub image: Image,
    /// Its valid pixels; `None`: all.
    pub mask: Option<Mask>,
}

/// Black and white of a pair, in thousandths of the pixels' unit.
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

/// How float images become integers: in steps of a power of two, so that scaling both images by one
/// changes nothing.
#[derive(Debug, Clone, Copy)]
struct FloatStep {
    black: f64,
    exponent: i32,
}

impl FloatStep {
    fn new(black: f64, width: f64) -> Self {
        Self { black, exponent: FLOAT_STEPS_LOG2 - floor_log2(width) }
    }

    fn quantise(self, value: f64) -> i32 {
        let steps = scale(value - self.black, self.exponent);
        steps.clamp(-FLOAT_REACH, FLOAT_REACH).round() as i32
    }
}

impl Image {
    /// Rows, columns and channels.
    pub fn shape(&self) -> (usize, usize, usize) {
        match self {
            Self::U8(pixels) => pixels.dim(),
            Self::U16(pixels) => pixels.dim(),
            Self::F32(pixels) => pixels.dim(),
            Self::F64(pixels) => pixels.dim(),
        }
    }

    /// The range that an integer type spans; floats have none of their own.
    fn type_range(&self) -> Option<Range> {
        let range = |white: u16| Some(Range { black: 0.0, white: 1000.0 * f64::from(white) });
        match self {
            Self::U8(_) => range(u8::MAX.into()),
            Self::U16(_) => range(u16::MAX),
            Self::F32(_) | Self::F64(_) => None,
        }
    }

    /// Every channel, in thousandths of the pixels' unit.
    fn channels(&self) -> Vec<Plane<f64>> {
        match self {
            Self::U8(pixels) => channels(pixels.view(), f64::from),
            Self::U16(pixels) => channels(pixels.view(), f64::from),
            Self::F32(pixels) => channels(pixels.view(), f64::from),
            Self::F64(pixels) => channels(pixels.view(), |value| value),
        }
    }

    /// Luminance in thousandths of the pixels' unit; exact for integer images.
    fn luminance(&self) -> Plane<f64> {
        let mut channels = self.channels();
        if channels.len() != 3 {
            return channels.remove(0);
        }
        let (red, green, blue) = (&channels[0], &channels[1], &channels[2]);
        Plane::from_fn(red.rows(), red.cols(), |y, x| {
            (299.0 * red.row(y)[x] + 587.0 * green.row(y)[x] + 114.0 * blue.row(y)[x]) / 1000.0
        })
    }
}

fn channels<T: Copy>(pixels: ArrayView3<T>, widen: impl Fn(T) -> f64) -> Vec<Plane<f64>> {
    let (rows, cols, count) = pixels.dim();
    let plane = |c| Plane::from_fn(rows, cols, |y, x| 1000.0 * widen(pixels[(y, x, c)]));
    (0..count).map(plane).collect()
}

impl View {
    /// Refuses pixels that are NaN, infinite or absurdly large, unless the mask covers them.
    pub fn check(&self, argument: &'static str) -> Result<()> {
        let valid = |y: usize, x: usize| self.mask.as_ref().is_none_or(|mask| mask.row(y)[x]);
        let fault = match &self.image {
            Image::F32(pixels) => first_fault(pixels.view(), f64::from, valid),
            Image::F64(pixels) => first_fault(pixels.view(), |value| value, valid),
            Image::U8(_) | Image::U16(_) => None,
        };
        let Some((y, x, value)) = fault else { return Ok(()) };
        let got = format!("{value} at row {y}, column {x}");
        let accepts = format!(
            "finite pixels of magnitude up to {LARGEST_PIXEL:e}; to leave pixels out, pass {argument}_mask \
             (True = valid)"
        );
        Err(Error::value(argument, got, accepts))
    }

    /// The gray plane under the phase codes, centred so that 25 bits and the sign hold any image.
    fn gray(&self, luminance: &Plane<f64>, step: FloatStep) -> Plane<i32> {
        let gray = match self.image.type_range() {
            Some(range) => luminance.map(|v| (v - range.black.midpoint(range.white)) as i32),
            None => luminance.map(|v| step.quantise(*v)),
        };
        self.filled(gray)
    }

    /// Channel planes in steps of `1 / LEVEL_STEPS` gray levels above `LEVEL_BLACK`.
    fn levels(&self, range: Range, as_gray: bool) -> Vec<Plane<u16>> {
        let channels = if as_gray { vec![self.image.luminance()] } else { self.image.channels() };
        // A pair of constant images has no width; any other will do then.
        let step = if range.width() > 0.0 { range.width() / LEVEL_RANGE } else { 1.0 };
        let level = |v: &f64| ((v - range.black) / step).round() + LEVEL_BLACK;
        let plane = |channel: &Plane<f64>| {
            self.filled(channel.map(|v| level(v).clamp(0.0, f64::from(LEVEL_CEILING)) as u16))
        };
        channels.iter().map(plane).collect()
    }

    /// Where the valid pixels lie, but for the outliers at either end.
    fn robust_range(&self, luminance: &Plane<f64>) -> Range {
        let mut values = luminance.as_slice().to_vec();
        if let Some(mask) = &self.mask {
            let mut valid = mask.as_slice().iter();
            values.retain(|_| valid.next() == Some(&true));
        }
        let Some(last) = values.len().checked_sub(1) else {
            return Range { black: 0.0, white: 0.0 };
        };
        let mut ranked = |rank: usize| *values.select_nth_unstable_by(rank, f64::total_cmp).1;
        let outliers = (OUTLIERS * last as f64) as usize;
        let robust = Range { black: ranked(outliers), white: ranked(last - outliers) };
        if robust.black < robust.white {
            return robust;
        }
        Range { black: ranked(0), white: ranked(last) }
    }

    /// `plane` with the masked pixels replaced by valid neighbours, so that their content has no effect.
    fn filled<T: Copy + Default>(&self, mut plane: Plane<T>) -> Plane<T> {
        if let Some(mask) = &self.mask {
            fill_masked(&mut plane, mask);
        }
        plane
    }
}

/// The gray planes of images that are to be compared, for the phase codes.
///
/// The step of float images follows `told`, or else the widest of their robust ranges, each measured from
/// its own black: an offset between images neither coarsens the step nor changes a code.
pub fn gray_planes<const N: usize>(views: [&View; N], told: Option<(f64, f64)>) -> [Plane<i32>; N] {
    let planes = views.map(|view| (view, view.image.luminance()));
    let ranges = planes.each_ref().map(|(view, luminance)| match view.image.type_range() {
        Some(range) => range,
        None => told_range(told).unwrap_or_else(|| view.robust_range(luminance)),
    });
    let width = ranges.iter().map(|range| range.width()).fold(0.0, f64::max);
    let mut blacks = ranges.iter().map(|range| range.black);
    planes.map(|(view, luminance)| {
        let black = blacks.next().unwrap_or_default();
        view.gray(&luminance, FloatStep::new(black, width))
    })
}

/// The channel planes of a pair, for SAD: three where both images have colour, else gray.
pub fn level_planes([left, right]: [&View; 2], told: Option<(f64, f64)>) -> [Vec<Plane<u16>>; 2] {
    let own = |view: &View| view.robust_range(&view.image.luminance());
    let range = told_range(told).or_else(|| left.image.type_range()).unwrap_or_else(|| {
        let (a, b) = (own(left), own(right));
        Range { black: a.black.min(b.black), white: a.white.max(b.white) }
    });
    let as_gray = left.image.shape().2 != 3 || right.image.shape().2 != 3;
    [left.levels(range, as_gray), right.levels(range, as_gray)]
}

/// Each pixel less the mean of the window around it, over its standard deviation there.
///
/// One gray level of variance is added, so that flat areas do not turn noise into signal. Sums are exact
/// integers; the one division and square root per pixel are those of IEEE 754, alike on every machine.
pub fn normalise(plane: &Plane<u16>, window: usize) -> Plane<u16> {
    let values = plane.map(|&v| i64::from(v));
    let sums = box_sums(&values, window);
    let squares = box_sums(&values.map(|v| v * v), window);
    let count = (window * window) as i64;
    let floor = (count * i64::from(LEVEL_STEPS)).pow(2);
    Plane::from_fn(plane.rows(), plane.cols(), |y, x| {
        let (value, sum, square) = (values.row(y)[x], sums.row(y)[x], squares.row(y)[x]);
        let variance = count * square - sum * sum + floor;
        let deviations = (count * value - sum) as f64 / (variance as f64).sqrt();
        let clamped = deviations.clamp(-DEVIATION_REACH, DEVIATION_REACH) + DEVIATION_REACH;
        (clamped * f64::from(DEVIATION_STEPS)).round() as u16
    })
}

/// Sums over `window x window` pixels, the plane continued by reflection.
fn box_sums(plane: &Plane<i64>, window: usize) -> Plane<i64> {
    let (rows, cols) = (plane.rows(), plane.cols());
    let mut along = Plane::from_fn(rows, cols, |_, _| 0);
    for y in 0..rows {
        let row = plane.row(y);
        slide(
            window,
            cols,
            |x, sign, sum: &mut i64| *sum += sign * row[x],
            |x, sum| {
                along.row_mut(y)[x] = *sum;
            },
        );
    }
    let mut sums = Plane::from_fn(rows, cols, |_, _| 0);
    let add = |y: usize, sign: i64, sum: &mut Vec<i64>| {
        sum.resize(cols, 0);
        sum.iter_mut().zip(along.row(y)).for_each(|(sum, value)| *sum += sign * value);
    };
    slide(window, rows, add, |y, sum| sums.row_mut(y).copy_from_slice(sum));
    sums
}

/// Slides a window over `0..length`, continued by reflection: calls `add` with the sign of what enters or
/// leaves, then `write` for each place.
fn slide<S: Default>(
    window: usize,
    length: usize,
    add: impl Fn(usize, i64, &mut S),
    mut write: impl FnMut(usize, &S),
) {
    let radius = (window / 2) as isize;
    let mut sum = S::default();
    (-radius..radius).for_each(|place| add(reflect(place, length), 1, &mut sum));
    for centre in 0..length as isize {
        add(reflect(centre + radius, length), 1, &mut sum);
        write(centre as usize, &sum);
        add(reflect(centre - radius, length), -1, &mut sum);
    }
}

fn told_range(told: Option<(f64, f64)>) -> Option<Range> {
    told.map(|(black, white)| Range { black: 1000.0 * black, white: 1000.0 * white })
}

fn first_fault<T: Copy>(
    pixels: ArrayView3<T>,
    widen: impl Fn(T) -> f64,
    valid: impl Fn(usize, usize) -> bool,
) -> Option<(usize, usize, f64)> {
    let values = pixels.indexed_iter().map(|((y, x, _), &value)| (y, x, widen(value)));
    let fault = |value: f64| value.is_nan() || value.abs() > LARGEST_PIXEL;
    values.into_iter().find(|&(y, x, value)| fault(value) && valid(y, x))
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

/// Replaces masked values by the nearest valid one of their row (ties: left); rows without any copy the
/// nearest row that has one (ties: above); a plane without any becomes zero.
pub fn fill_masked<T: Copy + Default>(plane: &mut Plane<T>, mask: &Mask) {
    let seeded: Vec<bool> =
        (0..plane.rows()).map(|y| fill_row(plane.row_mut(y), mask.row(y))).collect();
    let sources = nearest(&seeded);
    for (y, source) in sources.into_iter().enumerate() {
        match source {
            Some(from) if from != y => {
                let copied = plane.row(from).to_vec();
                plane.row_mut(y).copy_from_slice(&copied);
            }
            Some(_) => {}
            None => plane.row_mut(y).fill(T::default()),
        }
    }
}

fn fill_row<T: Copy>(row: &mut [T], valid: &[bool]) -> bool {
    let sources = nearest(valid);
    let original = row.to_vec();
    for (value, source) in row.iter_mut().zip(&sources) {
        if let Some(x) = source {
            *value = original[*x];
        }
    }
    valid.contains(&true)
}

/// For every place the nearest one that holds true, ties to the smaller.
fn nearest(present: &[bool]) -> Vec<Option<usize>> {
    let mut before = None;
    let mut places: Vec<Option<usize>> = Vec::with_capacity(present.len());
    for (i, &here) in present.iter().enumerate() {
        before = if here { Some(i) } else { before };
        places.push(before);
    }
    let mut after: Option<usize> = None;
    for (i, place) in places.iter_mut().enumerate().rev() {
        after = if present[i] { Some(i) } else { after };
        *place = match (*place, after) {
            (Some(a), Some(b)) => Some(if b - i < i - a { b } else { a }),
            (found, None) | (None, found) => found,
        };
    }
    places
}

//! Images as callers pass them: pixels of four types, in one channel or three.

use ndarray::{Array3, ArrayView2, Axis, s};

use crate::base::error::{Error, Result};
use crate::base::plane::{Plane, zeroed};
use crate::base::simd::{Level, Loop};
use crate::image::gray_scale::LUMINANCE_STEPS;
use crate::image::masking::{Mask, filled_along_columns};
use crate::image::resampling::TAPS;
use crate::settings::LARGEST_PIXEL;

/// An image of `rows x cols x channels` (1 or 3 channels) as passed by the caller.
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

/// One camera's image as passed by the caller, before it becomes gray.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Its pixels.
    pub image: Image,
    /// Its valid pixels; `None`: all.
    pub mask: Option<Mask>,
    /// The meaning of 1 in the image, in units of the pixels of the pair.
    pub unit: f64,
}

/// Applies the same code to pixels of any type.
macro_rules! of_any_type {
    ($image:expr, $pixels:ident => $work:expr) => {
        match $image {
            Image::U8($pixels) => $work,
            Image::U16($pixels) => $work,
            Image::F32($pixels) => $work,
            Image::F64($pixels) => $work,
        }
    };
}

/// The same for code that returns pixels of the image's type, which become an image again.
macro_rules! of_same_type {
    ($image:expr, $pixels:ident => $work:expr) => {
        match $image {
            Image::U8($pixels) => Image::U8($work),
            Image::U16($pixels) => Image::U16($work),
            Image::F32($pixels) => Image::F32($work),
            Image::F64($pixels) => Image::F64($work),
        }
    };
}

impl From<Image> for Input {
    /// An image that is valid everywhere.
    fn from(image: Image) -> Self {
        Self { image, mask: None, unit: 1.0 }
    }
}

impl Image {
    /// Rows, columns and channels.
    pub fn shape(&self) -> (usize, usize, usize) {
        of_any_type!(self, pixels => pixels.dim())
    }

    /// Channels of this many rows and columns as an image of the type of this one, with values rounded to the
    /// nearest.
    pub fn of_channels(&self, channels: &[Plane<f64>]) -> Result<Self> {
        Ok(match self {
            Self::U8(_) => Self::U8(joined(channels)?),
            Self::U16(_) => Self::U16(joined(channels)?),
            Self::F32(_) => Self::F32(joined(channels)?),
            Self::F64(_) => Self::F64(joined(channels)?),
        })
    }

    /// Appends row `y` as integers: multiples of a step above `ends[0]`, from 0 to `ends[1] - ends[0]`. With
    /// `in_color`, they are the luminances of three channels, in sixteenths; else the first channel counts.
    pub fn append_integers(
        &self,
        y: usize,
        step: f64,
        in_color: bool,
        [least, largest]: [i32; 2],
        gray: &mut Vec<i32>,
    ) {
        let most = (largest - least) / if in_color { LUMINANCE_STEPS } else { 1 };
        let is_one = step.to_bits() == 1f64.to_bits();
        match self {
            Self::U8(pixels) if is_one => append(pixels, y, in_color, least, i32::from, gray),
            Self::U16(pixels) if is_one => {
                append(pixels, y, in_color, least, |value| i32::from(value).min(most), gray);
            }
            // Masked pixels may have any value; conversions saturate.
            _ => of_any_type!(self, pixels => {
                let integer = |value| i32::from((double(value) / step + 0.5) as u16).min(most);
                append(pixels, y, in_color, least, integer, gray);
            }),
        }
    }

    /// Writes the luminances of row `y` in thousandths of the pixels' unit: `299 R + 587 G + 114 B`, or those
    /// of the first channel.
    pub fn write_luminance(&self, y: usize, in_color: bool, row: &mut [f64]) {
        of_any_type!(self, pixels => {
            for (value, pixel) in row.iter_mut().zip(row_of(pixels, y).rows()) {
                *value = if in_color {
                    let [r, g, b] = [0, 1, 2].map(|c| double(pixel[c]));
                    299.0 * r + 587.0 * g + 114.0 * b
                } else {
                    1000.0 * double(pixel[0])
                };
            }
        });
    }
}

/// A channel of a pixel.
pub trait Channel: Copy + Default + Send + Sync + Into<f64> {
    /// The nearest value of this type.
    fn nearest(value: f64) -> Self;
}

impl Channel for u8 {
    fn nearest(value: f64) -> Self {
        value.round_ties_even().clamp(0.0, Self::MAX.into()) as Self
    }
}

impl Channel for u16 {
    fn nearest(value: f64) -> Self {
        value.round_ties_even().clamp(0.0, Self::MAX.into()) as Self
    }
}

impl Channel for f32 {
    fn nearest(value: f64) -> Self {
        value as Self
    }
}

impl Channel for f64 {
    fn nearest(value: f64) -> Self {
        value
    }
}

/// A way to read images between their pixels.
pub trait Resampler {
    /// Rows and columns of the result.
    fn size(&self) -> (usize, usize);

    /// Resamples pixels of this many rows, columns and channels.
    fn resampled<T: Copy + Default + Send + Sync + Into<f64>>(
        &self,
        pixels: &[T],
        shape: (usize, usize, usize),
        nearest: impl Fn(f64) -> T + Sync,
    ) -> Result<Vec<T>>;
}

impl Input {
    /// Pixels of the same type, resampled; masked ones do not spread. The caller decides which results are
    /// valid.
    pub fn resampled(&self, by: &impl Resampler, mask: Option<Mask>) -> Result<Self> {
        let image = of_same_type!(&self.image, pixels => self.resampled_type(pixels, by)?);
        Ok(Self { image, mask, unit: self.unit })
    }

    fn resampled_type<T: Channel>(&self, pixels: &Array3<T>, by: &impl Resampler) -> Result<Array3<T>> {
        let shape @ (_, _, channels) = pixels.dim();
        let pixels = pixels.as_standard_layout();
        let values = pixels.as_slice().unwrap_or_default();

        let found = match &self.mask {
            Some(mask) => {
                let filled = filled_along_columns(values, channels, mask, TAPS, T::default());
                by.resampled(&filled, shape, T::nearest)?
            }
            None => by.resampled(values, shape, T::nearest)?,
        };
        let (rows, cols) = by.size();
        Array3::from_shape_vec((rows, cols, channels), found)
            .map_err(|fault| Error::value("image", fault, "values of every pixel"))
    }

    /// One channel of the image.
    pub fn channel(&self, channel: usize) -> Self {
        let image = of_same_type!(&self.image, pixels => channel_of(pixels, channel));
        Self { image, mask: self.mask.clone(), unit: self.unit }
    }

    /// The image turned by 90 degrees counterclockwise, like [`Plane::turned`].
    pub fn turned(&self) -> Self {
        let image = of_same_type!(&self.image, pixels => turned(pixels));
        Self { image, mask: self.mask.as_ref().map(Plane::turned), unit: self.unit }
    }

    /// The image with its rows or columns in reverse order, like [`Plane::reversed`].
    pub fn reversed(&self, axis: Axis) -> Self {
        let image = of_same_type!(&self.image, pixels => reversed(pixels, axis));
        Self { image, mask: self.mask.as_ref().map(|mask| mask.reversed(axis)), unit: self.unit }
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        let (rows, cols, _) = self.image.shape();
        (rows, cols)
    }

    /// Whether the pixel is valid by the mask, if there is one.
    pub fn is_valid(&self, y: usize, x: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.row(y)[x])
    }

    /// Appends all channels of the valid pixels of row `y`.
    pub fn write_valid(&self, y: usize, row: &mut Vec<f64>) {
        let is_valid = |x: usize| self.is_valid(y, x);
        of_any_type!(&self.image, pixels => {
            let pixels = row_of(pixels, y);
            if self.mask.is_none() {
                row.extend(pixels.iter().map(|value| double(*value)));
            } else {
                let valid = pixels.rows().into_iter().enumerate().filter(|(x, _)| is_valid(*x));
                row.extend(valid.flat_map(|(_, pixel)| pixel).map(|value| double(*value)));
            }
        });
    }

    /// The largest magnitude of a channel of a valid pixel.
    pub fn largest(&self) -> f64 {
        let (mut most, mut row) = (0.0, vec![]);
        for y in 0..self.size().0 {
            row.clear();
            self.write_valid(y, &mut row);
            most = row.iter().fold(most, |most: f64, value| most.max(value.abs()));
        }
        most
    }

    /// An error if a valid pixel is NaN, infinite or absurdly large.
    pub fn check(&self, argument: &'static str) -> Result<()> {
        let fault = match &self.image {
            Image::F32(pixels) => self.first_fault(pixels),
            Image::F64(pixels) => self.first_fault(pixels),
            Image::U8(_) | Image::U16(_) => None,
        };
        let Some((y, x, value)) = fault else { return Ok(()) };

        let got = format!("{value:e} at row {y}, column {x}");
        let accepts = format!(
            "finite pixels of magnitude up to {LARGEST_PIXEL:e}, and anything where a mask is False \
             (match takes left_mask and right_mask)"
        );
        Err(Error::value(argument, got, accepts))
    }

    /// Row, column and value of the first faulty pixel that is valid.
    fn first_fault<T: Copy + Into<f64>>(&self, pixels: &Array3<T>) -> Option<(usize, usize, f64)> {
        let is_fault = |value: f64| value.is_nan() || value.abs() > LARGEST_PIXEL;

        // Nearly all images have no faults, and a plain pass over the values shows it quickly.
        if !pixels.iter().any(|&value| is_fault(value.into())) {
            return None;
        }

        let mut values = pixels.indexed_iter().map(|((y, x, _), &value)| (y, x, value.into()));
        values.find(|&(y, x, value)| is_fault(value) && self.is_valid(y, x))
    }
}

fn turned<T: Copy>(pixels: &Array3<T>) -> Array3<T> {
    let mut columns_first = pixels.view().permuted_axes([1, 0, 2]);
    columns_first.invert_axis(Axis(0));
    columns_first.as_standard_layout().into_owned()
}

fn reversed<T: Copy>(pixels: &Array3<T>, axis: Axis) -> Array3<T> {
    let mut reversed = pixels.view();
    reversed.invert_axis(axis);
    reversed.as_standard_layout().into_owned()
}

fn channel_of<T: Copy>(pixels: &Array3<T>, channel: usize) -> Array3<T> {
    pixels.slice(s![.., .., channel..=channel]).to_owned()
}

/// Channels as pixels of a type.
fn joined<T: Channel>(channels: &[Plane<f64>]) -> Result<Array3<T>> {
    let (rows, cols) = channels.first().map_or((0, 0), |plane| (plane.rows(), plane.cols()));
    let mut values = zeroed(rows * cols * channels.len())?;
    for (c, plane) in channels.iter().enumerate() {
        for (to, value) in values.iter_mut().skip(c).step_by(channels.len()).zip(plane.as_slice()) {
            *to = T::nearest(*value);
        }
    }
    Array3::from_shape_vec((rows, cols, channels.len()), values)
        .map_err(|fault| Error::value("image", fault, "values of every pixel"))
}

/// A channel in double precision.
fn double(channel: impl Into<f64>) -> f64 {
    channel.into()
}

/// The pixels of row `y`, columns x channels.
fn row_of<T>(pixels: &Array3<T>, y: usize) -> ArrayView2<'_, T> {
    pixels.index_axis(Axis(0), y)
}

/// [`Image::append_integers`] for one type.
fn append<T: Copy>(
    pixels: &Array3<T>,
    y: usize,
    in_color: bool,
    least: i32,
    integer: impl Fn(T) -> i32,
    gray: &mut Vec<i32>,
) {
    let pixels = row_of(pixels, y);
    let channels = pixels.ncols();
    let pixels = pixels.as_standard_layout();
    let values = pixels.as_slice().unwrap_or_default();
    Level::best().run(Append { values, channels, in_color, least, integer, gray });
}

/// Appends a row of gray values.
struct Append<'a, T, F> {
    values: &'a [T],
    channels: usize,
    in_color: bool,
    least: i32,
    integer: F,
    gray: &'a mut Vec<i32>,
}

impl<T: Copy, F: Fn(T) -> i32> Loop for Append<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { values, channels, in_color, least, integer, gray } = self;
        if in_color {
            // 0.299, 0.587 and 0.114 in 2^15ths, so that sums of words fit in 31 bits; the result is in
            // rounded sixteenths.
            gray.extend(values.as_chunks().0.iter().map(|pixel| {
                let [r, g, b] = pixel.map(&integer);
                ((9798 * r + 19235 * g + 3735 * b + 1024) >> 11) + least
            }));
        } else if channels == 1 {
            gray.extend(values.iter().map(|value| integer(*value) + least));
        } else {
            gray.extend(values.iter().step_by(channels).map(|value| integer(*value) + least));
        }
    }
}

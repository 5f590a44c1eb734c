//! One camera's part of a pair: its pixels, of any type, and which of them are valid.

use std::ops;

use ndarray::{Array3, ArrayView1, ArrayView2, ArrayView3, Axis, Zip, s};

use crate::base::error::{Error, Result};
use crate::base::plane::Plane;
use crate::base::simd::{Level, Loop};
use crate::image::intensity_range::{IntensityRange, NOWHERE};
use crate::settings::LARGEST_PIXEL;

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
    /// The intensity range of the whole image, in its own unit, if this is a part of one that is not of bytes; `None`: it is
    /// the whole.
    pub range: Option<IntensityRange>,
    /// Least height of impulses, in units of the caller's pixels; 0: there are none.
    pub impulses: f64,
    /// What 1 stands for in the image, in units of the caller's pixels.
    pub unit: f64,
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

    /// The middle of an integer type; floats have none.
    pub fn middle(&self) -> Option<u16> {
        match self {
            Self::U8(_) => Some(1 << (u8::BITS - 1)),
            Self::U16(_) => Some(1 << (u16::BITS - 1)),
            Self::F32(_) | Self::F64(_) => None,
        }
    }

    /// Writes the exact gray values of row `y` of an integer image, less `middle`. Those of color images,
    /// `299 R + 587 G + 114 B`, are in thousandths.
    pub fn write_centered(&self, y: usize, middle: i32, level: Level, row: &mut [i32]) {
        match self {
            Self::U8(pixels) => write_centered(row_of(pixels, y), middle, level, row),
            Self::U16(pixels) => write_centered(row_of(pixels, y), middle, level, row),
            Self::F32(_) | Self::F64(_) => unreachable!("floats have no middle"),
        }
    }

    /// Writes the luminance of row `y` in thousandths of the pixels' unit: `299 R + 587 G + 114 B`, exact
    /// for integers.
    pub fn write_luminance(&self, y: usize, row: &mut [f64]) {
        match self {
            Self::U8(pixels) => write_luminance(row_of(pixels, y), f64::from, row),
            Self::U16(pixels) => write_luminance(row_of(pixels, y), f64::from, row),
            Self::F32(pixels) => write_luminance(row_of(pixels, y), f64::from, row),
            Self::F64(pixels) => write_luminance(row_of(pixels, y), |value| value, row),
        }
    }

    /// The luminance of one pixel in thousandths of the pixels' unit.
    pub fn luminance(&self, y: usize, x: usize) -> f64 {
        match self {
            Self::U8(pixels) => luminance(pixels.slice(s![y, x, ..]), f64::from),
            Self::U16(pixels) => luminance(pixels.slice(s![y, x, ..]), f64::from),
            Self::F32(pixels) => luminance(pixels.slice(s![y, x, ..]), f64::from),
            Self::F64(pixels) => luminance(pixels.slice(s![y, x, ..]), |value| value),
        }
    }

    /// Writes channel `c` of row `y` in thousandths of the pixels' unit.
    pub fn write_channel(&self, c: usize, y: usize, row: &mut [f64]) {
        match self {
            Self::U8(pixels) => write_channel(row_of(pixels, y), c, f64::from, row),
            Self::U16(pixels) => write_channel(row_of(pixels, y), c, f64::from, row),
            Self::F32(pixels) => write_channel(row_of(pixels, y), c, f64::from, row),
            Self::F64(pixels) => write_channel(row_of(pixels, y), c, |value| value, row),
        }
    }
}

impl From<Image> for View {
    /// A whole image that is valid everywhere.
    fn from(image: Image) -> Self {
        Self { image, mask: None, range: None, impulses: 0.0, unit: 1.0 }
    }
}

impl View {
    /// The negative: white becomes black. Floats are inverted about the middle of their range, which must be set.
    pub fn inverted(&self) -> Self {
        let IntensityRange { black, white } = self.range.unwrap_or(NOWHERE);
        // Ranges are in thousandths of the pixels' unit.
        let sum = (black + white) / 1000.0;

        let image = match &self.image {
            Image::U8(pixels) => Image::U8(pixels.mapv(|value| u8::MAX - value)),
            Image::U16(pixels) => Image::U16(pixels.mapv(|value| u16::MAX - value)),
            Image::F32(pixels) => Image::F32(pixels.mapv(|value| (sum - f64::from(value)) as f32)),
            Image::F64(pixels) => Image::F64(pixels.mapv(|value| sum - value)),
        };

        let range = match &image {
            Image::U16(_) => self.range.map(|IntensityRange { black, white }| {
                let sum = 1000.0 * f64::from(u16::MAX);
                IntensityRange { black: sum - white, white: sum - black }
            }),
            _ => self.range,
        };

        Self { image, mask: self.mask.clone(), range, ..*self }
    }

    /// The even rows of a whole image alone: an odd one becomes the mean of those beside it, the last one a copy of the one
    /// above. A pixel is valid where both are.
    pub fn of_even_rows(&self) -> Self {
        let image = match &self.image {
            Image::U8(pixels) => Image::U8(of_even_rows(pixels, u8::midpoint)),
            Image::U16(pixels) => Image::U16(of_even_rows(pixels, u16::midpoint)),
            Image::F32(pixels) => Image::F32(of_even_rows(pixels, f32::midpoint)),
            Image::F64(pixels) => Image::F64(of_even_rows(pixels, f64::midpoint)),
        };
        let mask = self.mask.as_ref().map(|mask| {
            let rows = mask.rows();
            let is_valid = |y: usize, x: usize| beside(y, rows).iter().all(|y| mask.row(*y)[x]);
            Plane::from_fn(rows, mask.cols(), is_valid)
        });

        // The range may be another one.
        Self { image, mask, range: None, ..*self }
    }

    /// Some rows.
    pub fn of_rows(&self, rows: ops::Range<usize>) -> Self {
        // The range and the impulses remain those of the whole image.
        let part = s![rows.clone(), .., ..];
        let image = match &self.image {
            Image::U8(pixels) => Image::U8(pixels.slice(part).to_owned()),
            Image::U16(pixels) => Image::U16(pixels.slice(part).to_owned()),
            Image::F32(pixels) => Image::F32(pixels.slice(part).to_owned()),
            Image::F64(pixels) => Image::F64(pixels.slice(part).to_owned()),
        };

        let mask = self.mask.as_ref();
        let mask = mask.map(|mask| {
            Plane::from_fn(rows.len(), mask.cols(), |y, x| mask.row(rows.start + y)[x])
        });

        Self { image, mask, ..*self }
    }

    /// Whether the mask, if there is one, calls the pixel valid.
    pub fn is_valid(&self, y: usize, x: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.row(y)[x])
    }

    /// An error if a valid pixel is NaN, infinite or absurdly large.
    pub fn check(&self, argument: &'static str) -> Result<()> {
        let valid = |y: usize, x: usize| self.is_valid(y, x);
        let fault = match &self.image {
            Image::F32(pixels) => first_fault(pixels.view(), f64::from, valid),
            Image::F64(pixels) => first_fault(pixels.view(), |value| value, valid),
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
}

/// The even rows that make up row `y` of so many: itself, or those above and below it.
fn beside(y: usize, rows: usize) -> [usize; 2] {
    let below = if y + y % 2 < rows { y + y % 2 } else { y - 1 };
    [y - y % 2, below]
}

/// As [`View::of_even_rows`], of one type.
fn of_even_rows<T: Copy>(pixels: &Array3<T>, mean: impl Fn(T, T) -> T) -> Array3<T> {
    let mut merged = pixels.clone();
    for (y, mut row) in merged.axis_iter_mut(Axis(0)).enumerate().skip(1).step_by(2) {
        let [above, below] = beside(y, pixels.dim().0).map(|y| row_of(pixels, y));
        Zip::from(&mut row).and(above).and(below).for_each(|own, a, b| *own = mean(*a, *b));
    }
    merged
}

/// The pixels of row `y`, columns x channels.
fn row_of<T>(pixels: &Array3<T>, y: usize) -> ArrayView2<'_, T> {
    pixels.index_axis(Axis(0), y)
}

/// As [`Image::write_centered`], of one type.
fn write_centered<T>(pixels: ArrayView2<T>, middle: i32, level: Level, row: &mut [i32])
where
    T: Copy + Into<i32>,
{
    let pixels = pixels.as_standard_layout();
    let values = pixels.as_slice().unwrap_or_default();

    level.run(Centered { values, in_color: pixels.ncols() == 3, middle, row });
}

/// Writes gray values less the middle of their range.
struct Centered<'a, T> {
    values: &'a [T],
    in_color: bool,
    middle: i32,
    row: &'a mut [i32],
}

impl<T: Copy + Into<i32>> Loop for Centered<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        if self.in_color {
            for (gray, pixel) in self.row.iter_mut().zip(self.values.as_chunks().0) {
                let [r, g, b] = pixel.map(T::into);
                *gray = 299 * r + 587 * g + 114 * b - 1000 * self.middle;
            }
        } else {
            for (gray, value) in self.row.iter_mut().zip(self.values) {
                *gray = (*value).into() - self.middle;
            }
        }
    }
}

/// As [`Image::write_luminance`], of one type.
fn write_luminance<T: Copy>(pixels: ArrayView2<T>, widen: impl Fn(T) -> f64, row: &mut [f64]) {
    if pixels.ncols() != 3 {
        return write_channel(pixels, 0, widen, row);
    }

    let pixels = pixels.as_standard_layout();

    for (value, pixel) in row.iter_mut().zip(pixels.as_slice().unwrap_or_default().as_chunks().0) {
        *value = weighted(pixel.map(&widen));
    }
}

/// As [`Image::luminance`], of one type.
fn luminance<T: Copy>(pixel: ArrayView1<T>, widen: impl Fn(T) -> f64) -> f64 {
    if pixel.len() == 3 {
        weighted([0, 1, 2].map(|c| widen(pixel[c])))
    } else {
        1000.0 * widen(pixel[0])
    }
}

/// The luminance in thousandths.
fn weighted([r, g, b]: [f64; 3]) -> f64 {
    299.0 * r + 587.0 * g + 114.0 * b
}

/// As [`Image::write_channel`], of one type.
fn write_channel<T: Copy>(
    pixels: ArrayView2<T>,
    c: usize,
    widen: impl Fn(T) -> f64,
    row: &mut [f64],
) {
    for (value, pixel) in row.iter_mut().zip(pixels.column(c)) {
        *value = 1000.0 * widen(*pixel);
    }
}

/// Row, column and value of the first faulty pixel that is valid.
fn first_fault<T: Copy>(
    pixels: ArrayView3<T>,
    widen: impl Fn(T) -> f64,
    valid: impl Fn(usize, usize) -> bool,
) -> Option<(usize, usize, f64)> {
    let is_fault = |value: f64| value.is_nan() || value.abs() > LARGEST_PIXEL;

    // Nearly all images have no faults, and a plain sweep over the values finds that out quickly.
    if !pixels.iter().any(|&value| is_fault(widen(value))) {
        return None;
    }

    let values = pixels.indexed_iter().map(|((y, x, _), &value)| (y, x, widen(value)));
    values.into_iter().find(|&(y, x, value)| is_fault(value) && valid(y, x))
}

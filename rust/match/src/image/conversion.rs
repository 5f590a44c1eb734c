//! Pixels of any type -> gray values: integers on one scale, made once, where images enter.
//!
//! The content of an image does not depend on its pixel type, so the values decide how a pair is converted:
//!
//! ```text
//! channels all equal                                          ->  the first one
//! other colors                                                ->  the luminance 0.299 R + 0.587 G + 0.114 B
//! both images hold step * (0, 1, ... 255), for some step      ->  these integers, less 128
//! both hold integers below 2^16, or 1 / 65535 etc. of some    ->  these integers, less 32768
//! all else                                                    ->  2^22 steps from black to white, black at 0
//! ```
//!
//! Gray values of integers are exact; luminances of integers are in sixteenths. Both images of a pair have
//! one step if they have one type. Whether channels are equal is decided for each image, since a one-channel
//! image may be matched with a three-channel one. Only valid pixels count. A part of a pair is converted like
//! the whole ([`Conversion`]).
//!
//! Scaling a float image changes gray values by no more than its own rounding; scaling by a power of two
//! changes nothing.

use crate::base::error::Result;
use crate::base::plane::{Plane, reserve, zeroed};
use crate::image::gray_scale::{FloatSteps, GrayScale};
use crate::image::intensity_range::{IntensityRange, NOWHERE};
use crate::image::pixels::{Image, Input};
use crate::image::view::View;

/// Steps of bytes that are tried first, if the values allow several: bytes in wider integers, or as fractions
/// of white.
const BYTE_STEPS: [f64; 5] = [1.0, 257.0, 256.0, 1.0 / 255.0, 1.0 / 256.0];
/// White of words stored as fractions of it: the largest value of this many bits, or one more.
const WHITES: [f64; 9] = [1023.0, 4095.0, 16383.0, 65535.0, 256.0, 1024.0, 4096.0, 16384.0, 65536.0];
/// Most distinct values for which a step is searched: bytes scaled in two ways have twice 256.
const MOST_VALUES: usize = 512;
/// Largest difference between a value and a multiple of the step, as a share of the value: some roundings of
/// single precision.
const TOLERANCE: f64 = 1.0 / (1 << 21) as f64;
/// Entries in the table of recently seen values.
const RECENT: usize = 1024;

/// Share of the pixels left out at either end of a float image's robust range.
const OUTLIERS: f64 = 0.001;
/// Most pixels that determine this range; larger images are sampled.
const MOST_SAMPLES: usize = 1 << 16;

/// How the pixels of an image become gray values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conversion {
    /// Integers that describe the pixels; `None`: they are floats.
    pub integers: Option<Integers>,
    /// Whether there are three channels, all equal.
    pub is_gray: bool,
    /// Black and white of pixels that are not bytes, in thousandths of the pixels' unit; `None`: those of the
    /// current pixels.
    pub range: Option<IntensityRange>,
}

/// The scale of pixels that are integer multiples of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Integers {
    /// The step, in units of the pixels.
    pub step: f64,
    /// The bits that both images use, 8 to 16.
    pub bits: u32,
}

impl Conversion {
    /// How a whole pair is converted.
    pub fn of_pair(inputs: [&Input; 2]) -> [Self; 2] {
        let mut scan = Scan::new(inputs);
        scan.add(inputs);

        let mut extents = inputs.map(|input| Extent::new(input.size()));
        if !scan.are_bytes() {
            for (input, extent) in inputs.into_iter().zip(&mut extents) {
                extent.add(input, 0);
            }
        }
        scan.conversions(extents)
    }

    /// Whether gray values do not depend on the range of the whole image.
    pub fn is_of_bytes(&self) -> bool {
        self.integers.is_some_and(|integers| integers.bits <= u8::BITS)
    }

    /// The gray values of an image, or of some of its rows; masked pixels take the values of valid neighbors.
    pub fn view(mut self, input: Input) -> Result<View> {
        self.integers = self.integers.or(match input.image {
            Image::U8(_) => Some(Integers { step: 1.0, bits: u8::BITS }),
            Image::U16(_) => Some(Integers { step: 1.0, bits: u16::BITS }),
            Image::F32(_) | Image::F64(_) => None,
        });
        if self.range.is_none() && !self.is_of_bytes() {
            let mut extent = Extent::new(input.size());
            extent.add(&input, 0);
            self.range = Some(extent.range());
        }

        let Input { image, mask, unit } = input;
        let (rows, cols, channels) = image.shape();
        let in_color = channels == 3 && !self.is_gray;
        let scale = self.scale(in_color, unit);

        let mut gray = Vec::new();
        reserve(&mut gray, rows * cols)?;
        if let Some(Integers { step, .. }) = self.integers {
            for y in 0..rows {
                image.append_integers(y, step, in_color, scale.ends(), &mut gray);
            }
        } else {
            let steps = FloatSteps::new(self.range.unwrap_or(NOWHERE));
            let mut luminance = zeroed(cols)?;
            for y in 0..rows {
                image.write_luminance(y, in_color, &mut luminance);
                gray.extend(luminance.iter().map(|value| steps.gray(*value)));
            }
        }

        Ok(View::new(Plane::from_vec(rows, cols, gray)?, mask, scale))
    }

    /// The scale of gray values, from luminances or not, for pixels with this unit.
    fn scale(&self, in_color: bool, unit: f64) -> GrayScale {
        let Some(Integers { step, bits }) = self.integers else {
            return GrayScale::of_floats(self.range.unwrap_or(NOWHERE), unit);
        };

        GrayScale::of_integers((step, bits), in_color, self.range, unit)
    }
}

/// The gray values of a single image.
pub fn view_of_input(input: Input) -> Result<View> {
    let [conversion, _] = Conversion::of_pair([&input, &input]);
    conversion.view(input)
}

/// A plane of values as a gray image, valid everywhere, with black and white in thousandths of their unit.
pub fn view_of_plane(plane: &Plane<f32>, range: IntensityRange) -> View {
    let steps = FloatSteps::new(range);
    let gray = plane.map(|value| steps.gray(1000.0 * f64::from(*value)));
    View::new(gray, None, GrayScale::of_floats(range, 1.0))
}

/// Properties of the values of a pair whose rows are added in any portions.
#[derive(Debug)]
pub struct Scan {
    /// Whether there are three channels that have all been equal so far.
    is_gray: [bool; 2],
    /// The values so far, as long as they may be bytes.
    values: Option<PixelValues>,
    /// The greatest common divisor of the values, as long as they are integers below 2^16.
    divisor: Option<u32>,
    /// The whites of which all values are fractions.
    whites: Vec<f64>,
    types: Types,
}

/// The types of the pixels of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Types {
    Bytes,
    Words,
    Floats,
}

impl Scan {
    /// The start of a scan of images of these types.
    pub fn new(inputs: [&Input; 2]) -> Self {
        let undecided = Self {
            is_gray: inputs.map(|input| input.image.shape().2 == 3),
            values: Some(PixelValues::new()),
            divisor: Some(0),
            whites: WHITES.to_vec(),
            types: Types::Floats,
        };

        match inputs[0].image {
            Image::U8(_) => {
                Self { values: None, divisor: None, whites: vec![], types: Types::Bytes, ..undecided }
            }
            Image::U16(_) => Self { whites: vec![], types: Types::Words, ..undecided },
            Image::F32(_) | Image::F64(_) => undecided,
        }
    }

    /// Adds the valid pixels of some rows, until more make no difference.
    pub fn add(&mut self, inputs: [&Input; 2]) {
        let mut row = vec![];

        for (side, input) in inputs.into_iter().enumerate() {
            for y in 0..input.size().0 {
                if self.is_decided() {
                    return;
                }

                if self.is_gray[side] || !self.are_integers_decided() {
                    row.clear();
                    input.write_valid(y, &mut row);
                    self.add_row(&row, side);
                }
            }
        }
    }

    /// Whether more pixels make no difference.
    pub fn is_decided(&self) -> bool {
        !self.is_gray.contains(&true) && self.are_integers_decided()
    }

    /// Whether the pixels are bytes, which need no [`Extent`].
    pub fn are_bytes(&self) -> bool {
        self.types == Types::Bytes || self.byte_step().is_some()
    }

    /// How to convert both images, whose rows were added here and to their extents.
    pub fn conversions(&self, extents: [Extent; 2]) -> [Conversion; 2] {
        let bytes = if self.types == Types::Bytes { Some(1.0) } else { self.byte_step() };
        let ranges = extents.each_ref().map(Extent::range);
        let bits = |step: f64| {
            let most = extents.iter().map(|extent| extent.white() / 1000.0 / step + 0.5);
            let most = most.fold(0.0, f64::max) as u16;
            (u16::BITS - most.leading_zeros()).max(u8::BITS)
        };
        let words = || self.word_step().map(|step| Integers { step, bits: bits(step) });
        let integers = bytes.map(|step| Integers { step, bits: u8::BITS }).or_else(words);

        [0, 1].map(|side| Conversion {
            integers,
            is_gray: self.is_gray[side],
            range: bytes.is_none().then(|| ranges[side]),
        })
    }

    fn byte_step(&self) -> Option<f64> {
        self.values.as_ref().and_then(PixelValues::step)
    }

    fn word_step(&self) -> Option<f64> {
        match self.divisor {
            Some(divisor) => Some(f64::from(divisor.max(1))),
            None => self.whites.first().map(|white| 1.0 / white),
        }
    }

    fn are_integers_decided(&self) -> bool {
        let is_divided = self.divisor.is_none() || (self.types == Types::Words && self.divisor == Some(1));
        self.values.is_none() && is_divided && self.whites.is_empty()
    }

    /// Adds the valid pixels of a row.
    #[expect(clippy::float_cmp, reason = "the same values are meant, to the bit")]
    fn add_row(&mut self, row: &[f64], side: usize) {
        self.is_gray[side] &= row.as_chunks().0.iter().all(|[r, g, b]| r == g && g == b);

        if !self.values.as_mut().is_none_or(|values| values.add(row)) {
            self.values = None;
        }

        if let Some(divisor) = self.divisor {
            let are_words = row.iter().all(|value| f64::from(*value as u16) == *value);
            self.divisor = are_words.then(|| common_divisor(divisor, row));
        }

        let most = f64::from(u16::MAX);
        self.whites.retain(|white| row.iter().all(|value| is_near_integer(value * white, most)));
    }
}

/// Distinct values, as long as they are few.
#[derive(Debug)]
struct PixelValues {
    /// The values in rising order.
    sorted: Vec<f64>,
    /// Recently seen values, each at a place that depends on its bits.
    recent: Vec<f64>,
}

impl PixelValues {
    fn new() -> Self {
        Self { sorted: vec![], recent: vec![f64::NAN; RECENT] }
    }

    /// Adds values; returns whether they are still few.
    fn add(&mut self, values: &[f64]) -> bool {
        for value in values {
            // The high bits of a product depend on all bits of its factors (the golden ratio, in 64 bits).
            let hash = value.to_bits().wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let recent = &mut self.recent[(hash >> (64 - RECENT.ilog2())) as usize];
            if recent.to_bits() == value.to_bits() {
                continue;
            }

            *recent = *value;
            if let Err(place) = self.sorted.binary_search_by(|other| other.total_cmp(value)) {
                if self.sorted.len() == MOST_VALUES {
                    return false;
                }
                self.sorted.insert(place, *value);
            }
        }

        true
    }

    /// The step by which all values are bytes: a common one, or the smallest difference between two values.
    fn step(&self) -> Option<f64> {
        let are_bytes =
            |step: &f64| self.sorted.iter().all(|value| is_near_integer(value / step, f64::from(u8::MAX)));
        let usual = BYTE_STEPS.into_iter().find(are_bytes);
        usual.or_else(|| self.least_step().filter(are_bytes))
    }

    /// The largest value divided by the number of smallest differences in it, which reduces the effect of
    /// rounding.
    fn least_step(&self) -> Option<f64> {
        let last = *self.sorted.last()?;
        let differences = self.sorted.windows(2).map(|two| two[1] - two[0]);
        let steps = last / differences.min_by(f64::total_cmp)?;

        (steps.round() >= 1.0).then(|| last / steps.round())
    }
}

/// Whether a value is an integer from 0 to `most`, except for rounding.
fn is_near_integer(value: f64, most: f64) -> bool {
    let nearest = f64::from((value + 0.5) as i32);
    (0.0..=most).contains(&nearest) && (value - nearest).abs() <= nearest * TOLERANCE
}

/// The greatest common divisor of integers and a divisor, or 0.
fn common_divisor(divisor: u32, values: &[f64]) -> u32 {
    let mut divisor = divisor;
    for value in values {
        if divisor == 1 {
            break;
        }

        let mut rest = *value as u32;
        while rest != 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
    }
    divisor
}

/// The extremes of the valid pixels of an image whose rows are added from the first one on, in thousandths of
/// their unit.
///
/// The range of an image is that of an even sample of its pixels without the outliers at either end; if these
/// are all equal, that of all pixels.
#[derive(Debug, Clone)]
pub struct Extent {
    cols: usize,
    stride: usize,
    sample: Vec<f64>,
    full: Option<IntensityRange>,
}

impl Extent {
    /// An image of this many rows and columns, without pixels so far.
    pub fn new((rows, cols): (usize, usize)) -> Self {
        let stride = (rows * cols).div_ceil(MOST_SAMPLES);
        Self { cols, stride, sample: vec![], full: None }
    }

    /// Adds the pixels of an input that begins at row `first` of the image.
    pub fn add(&mut self, input: &Input, first: usize) {
        let mut luminance = vec![0.0; self.cols];
        let in_color = input.image.shape().2 == 3;
        for y in 0..input.size().0 {
            input.image.write_luminance(y, in_color, &mut luminance);
            let valid = (0..self.cols).filter(|x| input.is_valid(y, *x)).map(|x| luminance[x]);
            let here = valid.map(|value| IntensityRange { black: value, white: value });
            self.full = here.chain(self.full).reduce(IntensityRange::union);

            let start = (first + y) * self.cols;
            // Every `stride`-th pixel of the whole image, wherever its parts begin.
            let skipped = start.next_multiple_of(self.stride) - start;
            let sampled = (skipped..self.cols).step_by(self.stride);
            self.sample.extend(sampled.filter(|x| input.is_valid(y, *x)).map(|x| luminance[x]));
        }
    }

    /// Black and white.
    pub fn range(&self) -> IntensityRange {
        let full = self.full.unwrap_or(NOWHERE);
        let Some(last) = self.sample.len().checked_sub(1) else { return full };
        let outliers = (OUTLIERS * last as f64) as usize;

        // Selecting two ranks is faster than sorting.
        let mut values = self.sample.clone();
        let mut ranked = |rank: usize| *values.select_nth_unstable_by(rank, f64::total_cmp).1;
        let range = IntensityRange { black: ranked(outliers), white: ranked(last - outliers) };

        if range.width() > 0.0 { range } else { full }
    }

    /// The largest pixel.
    fn white(&self) -> f64 {
        self.full.map_or(0.0, |full| full.white)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::view::Mask;
    use ndarray::Array3;

    /// Two images of bytes that use most of their range, with this many channels.
    fn bytes(channels: usize) -> [Array3<u8>; 2] {
        [3, 5].map(|factor| {
            Array3::from_shape_fn((9, 40, channels), |(y, x, c)| {
                ((41 * y + factor * x * (x + 7) + 50 * c) % 256) as u8
            })
        })
    }

    fn views(images: [Image; 2]) -> [View; 2] {
        let [left, right] = images.map(Input::from);
        let [of_left, of_right] = Conversion::of_pair([&left, &right]);
        [of_left.view(left), of_right.view(right)].map(|view| view.expect("memory"))
    }

    /// Checks that both images have the same gray values as others, whose unit is a step of theirs.
    fn check(images: [Image; 2], others: &[Image; 2], step: f64) {
        for (found, expected) in views(images).iter().zip(&views(others.clone())) {
            assert_eq!(found.gray(), expected.gray());
            let (found, expected) = (found.scale(), expected.scale());
            assert_eq!(
                (found.ends(), found.range(), found.step().is_some()),
                (expected.ends(), expected.range(), expected.step().is_some())
            );
            for (found, expected) in [
                (1.0 / found.steps(1.0), step / expected.steps(1.0)),
                (found.level(), step * expected.level()),
                (found.width(), step * expected.width()),
                (found.pixel(0.0), step * expected.pixel(0.0)),
            ] {
                assert!((found - expected).abs() <= 1e-6 * expected, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn bytes_of_any_type_and_scale_are_bytes() {
        for channels in [1, 3] {
            let bytes = bytes(channels);
            let expected = bytes.clone().map(Image::U8);
            let parts = if channels == 3 { 16 } else { 1 };
            assert_eq!(views(expected.clone())[0].scale().ends(), [-128 * parts, 127 * parts]);

            for step in [1u16, 2, 3, 16, 100, 256, 257] {
                let words = |bytes: &Array3<u8>| bytes.mapv(|byte| step * u16::from(byte));
                check(bytes.each_ref().map(|bytes| Image::U16(words(bytes))), &expected, step.into());
            }

            for step in [1.0, 0.1, 1.0 / 255.0, 1.0 / 256.0, 257.0, 3.7e-12, 1e20] {
                let singles = |bytes: &Array3<u8>| bytes.mapv(|byte| f32::from(byte) * step as f32);
                check(bytes.each_ref().map(|bytes| Image::F32(singles(bytes))), &expected, step);
                let doubles = |bytes: &Array3<u8>| bytes.mapv(|byte| f64::from(byte) * step);
                check(bytes.each_ref().map(|bytes| Image::F64(doubles(bytes))), &expected, step);
            }
        }
    }

    #[test]
    fn usual_scales_come_before_what_the_values_would_allow_for() {
        let even = Array3::from_shape_fn((3, 50, 1), |(y, x, _)| (2 * (x + y)) as u8);
        let expected = [Image::U8(even.clone()), Image::U8(even.clone())];

        for step in [1.0, 257.0, 1.0 / 255.0] {
            let scaled = Image::F64(even.mapv(|byte| f64::from(byte) * step));
            check([scaled.clone(), scaled], &expected, step);
        }
    }

    #[test]
    fn integers_beyond_bytes_are_words_and_fractions_of_white_too() {
        let words = Array3::from_shape_fn((9, 120, 1), |(y, x, _)| (37 * (y * 120 + x) % 4096) as u16);
        let expected = [Image::U16(words.clone()), Image::U16(words.clone())];
        let [found, _] = views(expected.clone());
        assert_eq!(found.scale().ends(), [-32768, 32767]);
        assert!((found.scale().level() - 16.0).abs() < 1e-9, "12 bits");

        for step in [1.0, 7.0, 1.0 / 4095.0, 1.0 / 65535.0] {
            let scaled = Image::F32(words.mapv(|word| (f64::from(word) * step) as f32));
            check([scaled.clone(), scaled], &expected, step);
        }
        let shifted = Image::U16(words.mapv(|word| word << 4));
        check([shifted.clone(), shifted], &expected, 16.0);
    }

    #[test]
    fn what_is_no_integer_of_one_step_is_cut_into_steps_of_its_range() {
        let roots = Image::F64(Array3::from_shape_fn((9, 90, 1), |(y, x, _)| (x as f64).sqrt() + y as f64));
        let negative = Image::F32(Array3::from_shape_fn((9, 90, 1), |(y, x, _)| x as f32 - y as f32));
        let bytes = Image::F32(Array3::from_shape_fn((9, 90, 1), |(_, x, _)| x as f32));

        for image in [roots, negative.clone()] {
            for view in views([image.clone(), image]) {
                assert_eq!((view.scale().step(), view.scale().range()), (None, [0, 1 << 22]));
            }
        }
        assert!(views([bytes, negative]).iter().all(|view| view.scale().step().is_none()));
    }

    #[test]
    fn equal_channels_are_one_whatever_the_other_image_has() {
        let [left, right] = bytes(1);
        let thrice = Array3::from_shape_fn((9, 40, 3), |(y, x, _)| right[(y, x, 0)]);
        let [_, color] = bytes(3);

        let one = [Image::U8(left.clone()), Image::U8(right)];
        check([one[0].clone(), Image::U8(thrice.clone())], &one, 1.0);

        let both = [one[1].clone(), Image::U8(color.clone())];
        check([Image::U8(thrice), Image::U8(color)], &both, 1.0);
    }

    #[test]
    fn masked_pixels_do_not_count_and_parts_are_converted_as_the_whole() {
        let hidden = |y: usize, x: usize| (y * 40 + x).is_multiple_of(7);
        let input = |pixels: &Array3<f32>, rows: std::ops::Range<usize>| {
            let first = rows.start;
            let part = pixels.slice(ndarray::s![rows.clone(), .., ..]).to_owned();
            let mask = Mask::from_fn(rows.len(), 40, |y, x| !hidden(first + y, x));
            Input { mask: Some(mask), ..Image::F32(part).into() }
        };

        let forms: [fn(f32) -> f32; 3] = [|byte| byte, |byte| 0.3 * byte, f32::sqrt];
        for form in forms {
            let pixels = bytes(3).map(|bytes| {
                let value = |byte: u8| form(byte.into());
                Array3::from_shape_fn(bytes.dim(), |(y, x, c)| {
                    if hidden(y, x) { f32::NAN } else { value(bytes[(y, x, c)]) }
                })
            });
            let whole = pixels.each_ref().map(|pixels| input(pixels, 0..9));
            let conversions = Conversion::of_pair(whole.each_ref());

            let mut scan = Scan::new(whole.each_ref());
            let mut extents = [Extent::new((9, 40)), Extent::new((9, 40))];
            for rows in [0..2, 2..3, 3..9] {
                let parts = pixels.each_ref().map(|pixels| input(pixels, rows.clone()));
                scan.add(parts.each_ref());
                for (part, extent) in parts.iter().zip(&mut extents) {
                    extent.add(part, rows.start);
                }
            }
            assert_eq!(scan.conversions(extents), conversions);

            let [left, _] = whole;
            let whole = conversions[0].view(left).expect("memory");
            let part = conversions[0].view(input(&pixels[0], 3..9)).expect("memory");
            assert_eq!(part.gray(), whole.of_rows(3..9).gray());
        }
    }
}

//! Pixels of any type -> the same values in the narrowest type that holds them, and one channel where all are equal.
//!
//! What an image shows does not depend on the type of its pixels, but integers are processed exactly and floats in steps of
//! their range. So it is the values that decide how a pair is processed:
//!
//! ```text
//! channels all equal                                          ->  one channel
//! both images hold step * (0, 1, ... 255), for some step      ->  bytes
//! both hold integers below 2^16, or 1 / 65535 etc. of some    ->  words
//! all else                                                    ->  as it is
//! ```
//!
//! The step is the new unit of the pixels: noise and heights of impulses stay in that of the caller. Both images of a pair
//! have one step, as costs may compare their values; whether channels are equal is found out for each of them, since an
//! image of one channel may be matched with one of three. Only valid pixels count. A part of a pair is packed as the whole.

use ndarray::{Array3, Axis, s};

use crate::base::control::Control;
use crate::base::error::Result;
use crate::image::view::{Image, View};

/// Steps of bytes that come first, if the values allow for several: bytes in wider integers, or as fractions of white.
const BYTE_STEPS: [f64; 5] = [1.0, 257.0, 256.0, 1.0 / 255.0, 1.0 / 256.0];
/// White of words that are stored as fractions of it: the largest value of so many bits, or one more.
const WHITES: [f64; 9] =
    [1023.0, 4095.0, 16383.0, 65535.0, 256.0, 1024.0, 4096.0, 16384.0, 65536.0];
/// Most values that differ of which a step is looked for: bytes that were scaled in two ways have twice 256.
const MOST_VALUES: usize = 512;
/// Largest difference between a value and a multiple of the step, as a share of it: some roundings of single precision.
const TOLERANCE: f64 = 1.0 / (1 << 21) as f64;
/// Places of the table of values that were seen lately.
const RECENT: usize = 1024;

/// How the pixels of a pair are packed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Packing {
    /// The integers that the pixels become; `None`: they keep their type.
    pub integers: Option<Integers>,
    /// Whether the channels of the left and of the right image, three each, are equal.
    pub is_gray: [bool; 2],
}

/// Integers that pixels are multiples of a step by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Integers {
    /// The step, in units of the pixels.
    pub step: f64,
    /// Whether they are below 256, else below 65536.
    pub are_bytes: bool,
}

impl Packing {
    /// How a whole pair is packed.
    pub fn of_views(views: [&View; 2], control: &Control) -> Result<Self> {
        let mut scan = Scan::new(views);
        scan.add(views, control)?;
        Ok(scan.packing())
    }

    /// The left (0) or right (1) view, or some rows of it, in its new type, without a mask that leaves everything valid.
    pub fn packed(&self, view: View, side: usize) -> View {
        let View { image, mask, unit, .. } = view;
        let image = match image {
            Image::U8(pixels) => Image::U8(self.selected(pixels, side)),
            Image::U16(pixels) => self.converted(pixels, side, f64::from, Image::U16),
            Image::F32(pixels) => self.converted(pixels, side, f64::from, Image::F32),
            Image::F64(pixels) => self.converted(pixels, side, |value| value, Image::F64),
        };

        let step = self.integers.map_or(1.0, |integers| integers.step);
        let mask = mask.filter(|mask| mask.as_slice().contains(&false));
        View { image, mask, unit: unit * step, ..view }
    }

    /// The pixels in their new type; `as_before` if they keep theirs.
    fn converted<T: Copy>(
        &self,
        pixels: Array3<T>,
        side: usize,
        widen: impl Fn(T) -> f64,
        as_before: impl Fn(Array3<T>) -> Image,
    ) -> Image {
        let pixels = self.selected(pixels, side);
        match self.integers {
            None => as_before(pixels),
            // Masked pixels may be anything; conversions saturate.
            Some(Integers { step, are_bytes: true }) => {
                Image::U8(pixels.mapv(|value| (widen(value) / step + 0.5) as u8))
            }
            Some(Integers { step, are_bytes: false }) => {
                Image::U16(pixels.mapv(|value| (widen(value) / step + 0.5) as u16))
            }
        }
    }

    /// The pixels, or one channel of them.
    fn selected<T: Copy>(&self, pixels: Array3<T>, side: usize) -> Array3<T> {
        if self.is_gray[side] { pixels.slice(s![.., .., ..1]).to_owned() } else { pixels }
    }
}

/// What is known of the values of a pair, of which rows are added in any portions.
#[derive(Debug)]
pub struct Scan {
    /// Whether there are three channels, all equal so far.
    is_gray: [bool; 2],
    /// The values so far, as long as they may be bytes.
    values: Option<Values>,
    /// The greatest common divisor of the values, as long as they are integers below 2^16.
    divisor: Option<u32>,
    /// The whites of which all values are fractions.
    whites: Vec<f64>,
    /// Whether the pixels are words already.
    are_words: bool,
}

impl Scan {
    /// Nothing is known yet of a pair that has views of these types.
    pub fn new(views: [&View; 2]) -> Self {
        let is_gray = views.map(|view| view.image.shape().2 == 3);
        let undecided = Self {
            is_gray,
            values: Some(Values::new()),
            divisor: Some(0),
            whites: WHITES.to_vec(),
            are_words: false,
        };

        match views[0].image {
            Image::U8(_) => Self { values: None, divisor: None, whites: vec![], ..undecided },
            Image::U16(_) => Self { whites: vec![], are_words: true, ..undecided },
            Image::F32(_) | Image::F64(_) => undecided,
        }
    }

    /// Adds the valid pixels of some rows, until no further one makes a difference.
    pub fn add(&mut self, views: [&View; 2], control: &Control) -> Result<()> {
        let mut row = vec![];

        for (side, view) in views.into_iter().enumerate() {
            for y in 0..view.image.shape().0 {
                if self.is_decided() {
                    return Ok(());
                }
                control.checkpoint()?;

                if self.is_gray[side] || !self.are_integers_decided() {
                    row.clear();
                    write_valid(view, y, &mut row);
                    self.add_row(&row, side);
                }
            }
        }

        Ok(())
    }

    /// Whether further pixels make no difference.
    pub fn is_decided(&self) -> bool {
        !self.is_gray.contains(&true) && self.are_integers_decided()
    }

    /// How the pair is packed whose rows were added.
    pub fn packing(&self) -> Packing {
        let bytes = self.values.as_ref().and_then(Values::step);
        let words = match self.divisor {
            // Nothing changes.
            Some(0 | 1) if self.are_words => None,
            Some(divisor) => Some(f64::from(divisor.max(1))),
            None => self.whites.first().map(|white| 1.0 / white),
        };

        let bytes = bytes.map(|step| Integers { step, are_bytes: true });
        let words = words.map(|step| Integers { step, are_bytes: false });
        Packing { integers: bytes.or(words), is_gray: self.is_gray }
    }

    fn are_integers_decided(&self) -> bool {
        let is_divided = self.divisor.is_none() || (self.are_words && self.divisor == Some(1));
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

/// Values that differ, as long as they are few.
#[derive(Debug)]
struct Values {
    /// The values in rising order.
    sorted: Vec<f64>,
    /// Values that were seen, each at a place that depends on its bits.
    recent: Vec<f64>,
}

impl Values {
    fn new() -> Self {
        Self { sorted: vec![], recent: vec![f64::NAN; RECENT] }
    }

    /// Adds values; whether they are still few.
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

    /// The step by which all values are bytes: a usual one, or the least difference of two values.
    fn step(&self) -> Option<f64> {
        let are_bytes = |step: &f64| {
            self.sorted.iter().all(|value| is_near_integer(value / step, f64::from(u8::MAX)))
        };
        let usual = BYTE_STEPS.into_iter().find(are_bytes);
        usual.or_else(|| self.least_step().filter(are_bytes))
    }

    /// The largest value by the number of least differences in it, so that its rounding matters less.
    fn least_step(&self) -> Option<f64> {
        let last = *self.sorted.last()?;
        let differences = self.sorted.windows(2).map(|two| two[1] - two[0]);
        let steps = last / differences.min_by(f64::total_cmp)?;

        (steps.round() >= 1.0).then(|| last / steps.round())
    }
}

/// Whether a value is an integer from 0 to `most`, up to roundings.
fn is_near_integer(value: f64, most: f64) -> bool {
    let nearest = f64::from((value + 0.5) as i32);
    (0.0..=most).contains(&nearest) && (value - nearest).abs() <= nearest * TOLERANCE
}

/// The greatest common divisor of a divisor, or 0, and integers.
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

/// Appends all channels of the valid pixels of row `y`.
fn write_valid(view: &View, y: usize, row: &mut Vec<f64>) {
    let valid = view.mask.as_ref().map(|mask| mask.row(y));

    match &view.image {
        Image::U8(pixels) => write_valid_of(pixels, y, valid, f64::from, row),
        Image::U16(pixels) => write_valid_of(pixels, y, valid, f64::from, row),
        Image::F32(pixels) => write_valid_of(pixels, y, valid, f64::from, row),
        Image::F64(pixels) => write_valid_of(pixels, y, valid, |value| value, row),
    }
}

/// As [`write_valid`], of one type.
fn write_valid_of<T: Copy>(
    pixels: &Array3<T>,
    y: usize,
    valid: Option<&[bool]>,
    widen: impl Fn(T) -> f64,
    row: &mut Vec<f64>,
) {
    let pixels = pixels.index_axis(Axis(0), y);
    let channels = pixels.ncols();
    let pixels = pixels.as_standard_layout();
    let values = pixels.as_slice().unwrap_or_default();

    match valid {
        None => row.extend(values.iter().map(|value| widen(*value))),
        Some(valid) => {
            let pixels = values.chunks_exact(channels).zip(valid).filter(|(_, valid)| **valid);
            row.extend(pixels.flat_map(|(pixel, _)| pixel).map(|value| widen(*value)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::plane::Plane;

    /// Two views of bytes that use most of their range, of so many channels.
    fn bytes(channels: usize) -> [Array3<u8>; 2] {
        [3, 5].map(|factor| {
            Array3::from_shape_fn((9, 40, channels), |(y, x, c)| {
                ((41 * y + factor * x * (x + 7) + 50 * c) % 256) as u8
            })
        })
    }

    fn packed(images: [Image; 2]) -> [View; 2] {
        let views = images.map(View::from);
        let packing = Packing::of_views([&views[0], &views[1]], &Control::default());
        let packing = packing.expect("not cancelled");
        let [left, right] = views;
        [packing.packed(left, 0), packing.packed(right, 1)]
    }

    fn check(images: [Image; 2], expected: &[Image; 2], step: f64) {
        for (found, expected) in packed(images).into_iter().zip(expected) {
            assert_eq!(found.image, *expected);
            assert!((found.unit / step - 1.0).abs() < 1e-6, "{} for {step}", found.unit);
        }
    }

    #[test]
    fn bytes_of_any_type_and_scale_are_bytes() {
        for channels in [1, 3] {
            let bytes = bytes(channels);
            let expected = bytes.clone().map(Image::U8);
            check(expected.clone(), &expected, 1.0);

            for step in [1u16, 2, 3, 16, 100, 256, 257] {
                let words = |bytes: &Array3<u8>| bytes.mapv(|byte| step * u16::from(byte));
                check(
                    bytes.each_ref().map(|bytes| Image::U16(words(bytes))),
                    &expected,
                    step.into(),
                );
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
        let words =
            Array3::from_shape_fn((9, 120, 1), |(y, x, _)| (37 * (y * 120 + x) % 4096) as u16);
        let expected = [Image::U16(words.clone()), Image::U16(words.clone())];
        check(expected.clone(), &expected, 1.0);

        for step in [1.0, 7.0, 1.0 / 4095.0, 1.0 / 65535.0] {
            let scaled = Image::F32(words.mapv(|word| (f64::from(word) * step) as f32));
            check([scaled.clone(), scaled], &expected, step);
        }
        let shifted = Image::U16(words.mapv(|word| word << 4));
        check([shifted.clone(), shifted], &expected, 16.0);
    }

    #[test]
    fn what_is_no_integer_of_one_step_stays_as_it_is() {
        let roots =
            Image::F64(Array3::from_shape_fn((9, 90, 1), |(y, x, _)| (x as f64).sqrt() + y as f64));
        let negative =
            Image::F32(Array3::from_shape_fn((9, 90, 1), |(y, x, _)| x as f32 - y as f32));
        let bytes = Image::F32(Array3::from_shape_fn((9, 90, 1), |(_, x, _)| x as f32));

        let single = [bytes, negative];
        check(single.clone(), &single, 1.0);
        let double = [roots.clone(), roots];
        check(double.clone(), &double, 1.0);
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
    fn masked_pixels_do_not_count_and_parts_are_packed_as_the_whole() {
        let [left, right] = bytes(3);
        let hidden = |(y, x): (usize, usize)| (y * 40 + x).is_multiple_of(7);
        let mask = Plane::from_fn(9, 40, |y, x| !hidden((y, x)));
        let view = |bytes: &Array3<u8>| {
            let value = |(y, x, c)| if hidden((y, x)) { f32::NAN } else { bytes[(y, x, c)].into() };
            let image = Image::F32(Array3::from_shape_fn(bytes.dim(), value));
            View { mask: Some(mask.clone()), ..View::from(image) }
        };

        let views = [view(&left), view(&right)];
        let views = [&views[0], &views[1]];
        let whole = Packing::of_views(views, &Control::default()).expect("not cancelled");
        assert_eq!(whole.integers, Some(Integers { step: 1.0, are_bytes: true }));

        let mut scan = Scan::new(views);
        for rows in [0..2, 2..3, 3..9] {
            let [left, right] = views.map(|view| view.of_rows(rows.clone()));
            scan.add([&left, &right], &Control::default()).expect("not cancelled");
        }
        assert_eq!(scan.packing(), whole);

        let found = whole.packed(views[0].clone(), 0);
        let Image::U8(found) = found.image else { panic!("no bytes") };
        let same = |((y, x, c), byte): ((usize, usize, usize), &u8)| {
            hidden((y, x)) || *byte == left[(y, x, c)]
        };
        assert!(found.indexed_iter().all(same));
    }
}

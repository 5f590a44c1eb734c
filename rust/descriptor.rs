//! An image -> packed phase codes (paper, section 2.1).

pub mod basis;
pub mod quantizer;
pub mod spectrum;

use crate::descriptor::basis::{Basis, Component};
use crate::descriptor::quantizer::Quantizer;
use crate::descriptor::spectrum::{Lane, Spectrum, Word, padded, segments};
use crate::error::{Error, Result};
use crate::image::intensity::Gray;
use crate::image::plane::{Plane, reflect, zeroed};
use crate::pipeline::control::Control;
use crate::rig::blur_compensation::check_noise;
use crate::settings::Settings;
use crate::simd::{Level, Loop};

/// Rows that one task describes; it reads `L - 1` further ones. 16 and 64 are as fast to a few percent.
const BAND_ROWS: usize = 32;

/// A word that holds the code of one pixel.
pub trait Code: Copy + Default + Send + Sync + Into<u64> + 'static {
    /// The low bits of a code; those that are cut off must be zero.
    fn narrowed(code: u64) -> Self;
    /// Hamming distance (paper, eq. 7).
    fn distance(self, other: Self) -> u16;
}

macro_rules! code {
    ($($word:ty),*) => {$(
        impl Code for $word {
            #[inline(always)]
            fn narrowed(code: u64) -> Self {
                debug_assert!(code <= Self::MAX.into());
                code as Self
            }

            fn distance(self, other: Self) -> u16 {
                (self ^ other).count_ones() as u16
            }
        }
    )*};
}
code!(u16, u32, u64);

/// Codes in the narrowest words that hold them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Codes {
    /// Up to 16 bits.
    U16(Plane<u16>),
    /// Up to 32 bits.
    U32(Plane<u32>),
    /// Up to 64 bits.
    U64(Plane<u64>),
}

impl Codes {
    /// Takes the codes of another plane of the same settings where the labels of the row are `label`.
    pub fn take_where<'b>(&mut self, other: &Self, labels: impl Fn(usize) -> &'b [u8], label: u8) {
        match (self, other) {
            (Self::U16(codes), Self::U16(other)) => take_where(codes, other, labels, label),
            (Self::U32(codes), Self::U32(other)) => take_where(codes, other, labels, label),
            (Self::U64(codes), Self::U64(other)) => take_where(codes, other, labels, label),
            _ => unreachable!("codes of the same settings are equally wide"),
        }
    }

    /// The same codes in the widest words.
    #[cfg(any(test, feature = "internals"))]
    pub fn widened(self) -> Plane<u64> {
        match self {
            Self::U16(codes) => codes.map(|&code| code.into()),
            Self::U32(codes) => codes.map(|&code| code.into()),
            Self::U64(codes) => codes,
        }
    }
}

/// As [`Codes::take_where`], of codes in words of one width.
fn take_where<'b, C: Code>(
    codes: &mut Plane<C>,
    other: &Plane<C>,
    labels: impl Fn(usize) -> &'b [u8],
    label: u8,
) {
    for y in 0..codes.rows() {
        for ((code, other), known) in codes.row_mut(y).iter_mut().zip(other.row(y)).zip(labels(y)) {
            *code = if *known == label { *other } else { *code };
        }
    }
}

/// The codes of every pixel, component 0 in the lowest bits. `noise` is the standard deviation of the image's noise, in
/// units of its pixels; only a weak level needs it.
pub fn describe(
    gray: &Gray,
    settings: &Settings,
    noise: Option<f64>,
    level: Level,
    control: &Control,
) -> Result<Codes> {
    Ok(match settings.code_length() {
        ..=16 => Codes::U16(describe_as(gray, settings, noise, level, control)?),
        17..=32 => Codes::U32(describe_as(gray, settings, noise, level, control)?),
        _ => Codes::U64(describe_as(gray, settings, noise, level, control)?),
    })
}

/// As [`describe`], in words of the caller's choice, which must be wide enough.
pub fn describe_as<C: Code>(
    gray: &Gray,
    settings: &Settings,
    noise: Option<f64>,
    level: Level,
    control: &Control,
) -> Result<Plane<C>> {
    let layers = layers(gray, settings, noise)?;

    // Sums are exact in both arithmetics. The narrow one is twice as fast, if it holds the largest sum.
    let gain = layers.iter().map(|layer| layer.basis.gain()).max().unwrap_or(0);
    let fits = i32::try_from(gain * u64::from(gray.reach())).is_ok();

    Plane::by_bands(gray.size(), BAND_ROWS, |first, codes| {
        let band = DescribedBand { gray, first, layers: &layers, level, control };
        if fits { band.describe::<i32, C>(codes) } else { band.describe::<f64, C>(codes) }
    })
}

/// One size of neighborhoods, and its bits of the codes.
struct Layer {
    basis: Basis,
    quantizer: Quantizer,
    /// The lowest bit of each component, by index; `None`: the component does not count.
    bits: Vec<Option<usize>>,
}

impl Layer {
    /// A layer whose components have their bits from `first` on; of `axes_alone` only `(1, 0)` and `(0, 1)` count.
    fn new(settings: &Settings, quantizer: Quantizer, first: usize, axes_alone: bool) -> Self {
        let basis = Basis::new(settings);
        let length = quantizer.code_length();
        let mut next = first;

        let place = |component: Component| {
            let counts = !axes_alone || component.u + component.v.unsigned_abs() == 1;
            let bit = counts.then_some(next);
            next += if counts { length } else { 0 };
            bit
        };

        let bits = basis.components().into_iter().map(place).collect();
        Self { basis, quantizer, bits }
    }
}

/// The sizes of neighborhoods that codes describe. Of two the larger one has the lowest bits, so that no component lies in
/// two halves of a word.
fn layers(gray: &Gray, settings: &Settings, noise: Option<f64>) -> Result<Vec<Layer>> {
    let weak = |settings: &Settings| -> Result<Quantizer> {
        let quantizer = Quantizer::new(settings);
        if !settings.has_weak() {
            return Ok(quantizer);
        }

        let threshold =
            weak_threshold(gray, &Basis::new(settings), settings.noise_threshold, noise)?;
        Ok(quantizer.with_weak_level(threshold))
    };

    if !settings.has_larger() {
        return Ok(vec![Layer::new(settings, weak(settings)?, 0, false)]);
    }

    let (r, s) = settings.frequencies;
    let larger = Settings {
        neighborhood: settings.largest_neighborhood(),
        frequencies: (r.min(1), s.min(1)),
        ..settings.clone()
    };

    let larger = Layer::new(&larger, weak(&larger)?, 0, true);

    let first = settings.larger_components() * larger.quantizer.code_length();
    Ok(vec![larger, Layer::new(settings, Quantizer::new(settings), first, false)])
}

/// The magnitude up to which a real or imaginary part of a component is weak, a whole number.
fn weak_threshold(gray: &Gray, basis: &Basis, weak: f64, noise: Option<f64>) -> Result<f64> {
    let missing = || {
        Error::value(
            "noise",
            "None",
            "the noise of the images, which noise_threshold is relative to",
        )
    };
    let noise = check_noise(noise.ok_or_else(missing)?)?;

    // Beyond any component a larger threshold makes no difference; its square must be finite.
    let beyond_any = (1u64 << 53) as f64;
    Ok((weak * basis.deviation() * gray.steps(noise)).round().min(beyond_any))
}

/// A band of rows that one task describes.
struct DescribedBand<'a> {
    gray: &'a Gray<'a>,
    first: usize,
    layers: &'a [Layer],
    level: Level,
    control: &'a Control,
}

impl DescribedBand<'_> {
    /// Writes the codes of the band, with sums in numbers of type `T`.
    fn describe<T: Lane, C: Code>(&self, codes: &mut [C]) -> Result<()> {
        let cols = self.gray.size().1;
        let rows = codes.len() / cols;

        let prepare = |layer: &Layer| -> Result<(Spectrum<T>, Vec<i32>)> {
            let spectrum = Spectrum::<T>::new(&layer.basis, cols)?;
            let pixels = self.pixels(rows, spectrum.width(), layer.basis.radius())?;
            Ok((spectrum, pixels))
        };

        // Buffers are per band: bands run on any thread.
        let mut prepared = self.layers.iter().map(prepare).collect::<Result<Vec<_>>>()?;
        let mut words = [zeroed(padded(cols))?, zeroed(padded(cols))?];

        for (y, codes) in codes.chunks_exact_mut(cols).enumerate() {
            self.control.checkpoint()?;
            for words in &mut words {
                words.fill(T::Word::default());
            }

            for (layer, (spectrum, pixels)) in self.layers.iter().zip(&mut prepared) {
                let width = spectrum.width();
                let surroundings = &pixels[y * width..][..(2 * layer.basis.radius() + 1) * width];
                let words = &mut words;
                self.level.run(TransformRow { spectrum, surroundings, layer, words });
            }

            self.level.run(NarrowRow { words: [&words[0], &words[1]], codes });
        }

        Ok(())
    }

    /// The pixels of the band and its halo; the image continues by reflection.
    fn pixels(&self, height: usize, width: usize, radius: usize) -> Result<Vec<i32>> {
        let (rows, cols) = self.gray.size();
        let mut pixels = zeroed(width * (height + 2 * radius))?;
        let places = self.first as isize - radius as isize..;

        for (y, row) in places.zip(pixels.chunks_exact_mut(width)) {
            self.gray.write_row(reflect(y, rows), self.level, &mut row[radius..][..cols])?;

            // Left and right of the image, from the row itself.
            for x in (0..radius).chain(radius + cols..width) {
                row[x] = row[radius + reflect(x as isize - radius as isize, cols)];
            }
        }

        Ok(pixels)
    }
}

/// A row of pixels and its surroundings -> the bits of one size of neighborhoods: bits 0 to 31 of the codes in the first
/// words, the others in the second.
struct TransformRow<'a, T: Lane> {
    spectrum: &'a mut Spectrum<T>,
    surroundings: &'a [i32],
    layer: &'a Layer,
    words: &'a mut [Vec<T::Word>; 2],
}

impl<T: Lane> Loop for TransformRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { spectrum, surroundings, layer: Layer { quantizer, bits, .. }, words } = self;

        spectrum.center_on(surroundings);
        for columns in segments(words[0].len()) {
            for frequency in spectrum.frequencies() {
                for (c, re, im) in spectrum.components(frequency, columns.clone()) {
                    let Some(shift) = bits[c] else { continue };
                    let words = &mut words[shift / 32][columns.clone()];
                    quantizer.add(re, im, shift % 32, words);
                }
            }
        }
    }
}

/// Joins the two halves of the codes.
struct NarrowRow<'a, W, C> {
    words: [&'a [W]; 2],
    codes: &'a mut [C],
}

impl<W: Word, C: Code> Loop for NarrowRow<'_, W, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        narrow(self.words[0], self.words[1], self.codes);
    }
}

/// Outputs and inputs are arguments of their own, so that the vectorizer knows that they do not overlap.
#[inline(always)]
fn narrow<W: Word, C: Code>(low: &[W], high: &[W], codes: &mut [C]) {
    let n = codes.len();
    let (low, high) = (&low[..n], &high[..n]);

    for i in 0..n {
        codes[i] = C::narrowed(low[i].into() | high[i].into() << 32);
    }
}

//! An image -> phase codes (paper, section 2.1), in words or in the caller's layout ([`RowOfCodes`]).

pub mod basis;
pub mod quantizer;
pub mod spectrum;

use std::collections::BTreeSet;
use std::marker::PhantomData;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::memory::Memory;
use crate::base::plane::{Plane, reflect};
use crate::base::simd::{Level, leveled};
use crate::descriptor::basis::{Basis, Component};
use crate::descriptor::quantizer::Quantizer;
use crate::descriptor::spectrum::{Lane, Layout, Spectrum, Word, segments};
use crate::image::intensity::Gray;
use crate::pair::blur_compensation::check_noise;
use crate::settings::Settings;

/// Rows that one task describes; it reads `L - 1` more. 16 and 64 are as fast to within a few percent.
const BAND_ROWS: usize = 32;

/// A word that holds the code of one pixel.
pub trait Code: Copy + Default + Send + Sync + Into<u64> + 'static {
    /// The low bits of a code; the dropped bits must be zero.
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
code!(u8, u16, u32, u64);

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
    /// The same codes in the widest words.
    pub fn widened(self) -> Plane<u64> {
        match self {
            Self::U16(codes) => codes.map(|&code| code.into()),
            Self::U32(codes) => codes.map(|&code| code.into()),
            Self::U64(codes) => codes,
        }
    }
}

/// The codes of all pixels, component 0 in the lowest bits. `noise` is the standard deviation of the image's
/// noise, in units of its pixels; only a weak level needs it.
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

/// Codes of one size without a weak level that fit a byte, from tables so coarse that sums of gray values up
/// to [`basis::ROUGH_REACH`] use the narrow arithmetic.
pub fn describe_roughly(
    gray: &Gray,
    settings: &Settings,
    level: Level,
    control: &Control,
) -> Result<Plane<u8>> {
    let layers = [Layer::new(Basis::rough(settings), Quantizer::new(settings), 0, false)];
    let packed = Packed(PhantomData::<u8>);
    describe_layers(gray, &layers, &packed, gray.size().1, level, control)
}

/// Like [`describe`], in words of the caller's choice, which must be wide enough. Other crates use the
/// functions above, so that transforms are compiled once.
fn describe_as<C: Code>(
    gray: &Gray,
    settings: &Settings,
    noise: Option<f64>,
    level: Level,
    control: &Control,
) -> Result<Plane<C>> {
    let packed = Packed(PhantomData::<C>);
    describe_rows(gray, settings, noise, &packed, gray.size().1, level, control)
}

/// How the codes of a row are stored.
pub trait RowOfCodes: Sync {
    /// The element of a row.
    type Item: Clone + Default + Send;

    /// Writes a row. Codes have bits 0 to 31 in the first words, the others in the second.
    fn write<W: Word>(&self, words: [&[W]; 2], row: &mut [Self::Item]);
}

/// Like [`describe`], in rows of this many items, written by `rows`.
pub fn describe_rows<R: RowOfCodes>(
    gray: &Gray,
    settings: &Settings,
    noise: Option<f64>,
    rows: &R,
    width: usize,
    level: Level,
    control: &Control,
) -> Result<Plane<R::Item>> {
    describe_layers(gray, &layers(gray, settings, noise)?, rows, width, level, control)
}

/// The rows of codes of these neighborhood sizes.
fn describe_layers<R: RowOfCodes>(
    gray: &Gray,
    layers: &[Layer],
    rows: &R,
    width: usize,
    level: Level,
    control: &Control,
) -> Result<Plane<R::Item>> {
    let job = DescribedImage { gray, layers, rows, level, control };

    // Sums are exact in both arithmetics. The narrow one is twice as fast, if the largest sum fits.
    let gain = layers.iter().map(|layer| layer.basis.gain()).max().unwrap_or(0);
    let fits = i32::try_from(gain * u64::from(gray.reach())).is_ok();

    if fits { job.described::<i32>(width) } else { job.described::<f64>(width) }
}

/// Each code in a word of its own.
struct Packed<C>(PhantomData<C>);

impl<C: Code> RowOfCodes for Packed<C> {
    type Item = C;

    #[inline(always)]
    fn write<W: Word>(&self, [low, high]: [&[W]; 2], codes: &mut [C]) {
        narrow(low, high, codes);
    }
}

/// One neighborhood size and its bits of the codes.
struct Layer {
    basis: Basis,
    quantizer: Quantizer,
    /// The lowest bit of each component, by index; `None`: the component does not count.
    bits: Vec<Option<usize>>,
    /// The frequencies `(u, |v|)` of the components that count.
    frequencies: Vec<(usize, usize)>,
}

impl Layer {
    /// A layer whose components have their bits from `first` on; with `axes_alone`, only `(1, 0)` and `(0,
    /// 1)` count.
    fn new(basis: Basis, quantizer: Quantizer, first: usize, axes_alone: bool) -> Self {
        let length = quantizer.code_length();
        let mut next = first;

        let place = |component: Component| {
            let counts = !axes_alone || component.u + component.v.unsigned_abs() == 1;
            let bit = counts.then_some(next);
            next += if counts { length } else { 0 };
            bit
        };

        let components = basis.components();
        let bits: Vec<_> = components.iter().copied().map(place).collect();

        let counts = components.iter().zip(&bits).filter(|(_, bit)| bit.is_some());
        let frequencies = counts.map(|(component, _)| (component.u, component.v.unsigned_abs()));
        // Ordered by the frequency along y, then along x, so that results along y are reused.
        let frequencies: BTreeSet<_> = frequencies.map(|(u, v)| (v, u)).collect();
        let frequencies = frequencies.into_iter().map(|(v, u)| (u, v)).collect();

        Self { basis, quantizer, bits, frequencies }
    }
}

/// The neighborhood sizes that codes describe. Of two, the larger one has the lowest bits, so that no
/// component straddles two halves of a word.
fn layers(gray: &Gray, settings: &Settings, noise: Option<f64>) -> Result<Vec<Layer>> {
    let weak = |settings: &Settings| -> Result<(Basis, Quantizer)> {
        let (basis, quantizer) = (Basis::new(settings), Quantizer::new(settings));
        if !settings.has_weak() {
            return Ok((basis, quantizer));
        }

        let threshold = weak_threshold(gray, &basis, settings.noise_threshold, noise)?;
        Ok((basis, quantizer.with_weak_level(threshold)))
    };

    if !settings.has_larger() {
        let (basis, quantizer) = weak(settings)?;
        return Ok(vec![Layer::new(basis, quantizer, 0, false)]);
    }

    let (r, s) = settings.frequencies;
    let larger = Settings {
        neighborhood: settings.largest_neighborhood(),
        frequencies: (r.min(1), s.min(1)),
        ..settings.clone()
    };

    let (basis, quantizer) = weak(&larger)?;
    let larger = Layer::new(basis, quantizer, 0, true);

    let first = settings.larger_components() * larger.quantizer.code_length();
    Ok(vec![larger, Layer::new(Basis::new(settings), Quantizer::new(settings), first, false)])
}

/// The magnitude up to which a real or imaginary part of a component is weak, a whole number.
fn weak_threshold(gray: &Gray, basis: &Basis, weak: f64, noise: Option<f64>) -> Result<f64> {
    let missing =
        || Error::value("noise", "None", "the noise of the images, which noise_threshold is relative to");
    let noise = check_noise(noise.ok_or_else(missing)?)?;

    // A threshold beyond any component makes no difference; its square must be finite.
    let beyond_any = (1u64 << 53) as f64;
    Ok((weak * basis.deviation() * gray.steps(noise)).round().min(beyond_any))
}

/// The description of an image.
struct DescribedImage<'a, R> {
    gray: &'a Gray<'a>,
    layers: &'a [Layer],
    rows: &'a R,
    level: Level,
    control: &'a Control,
}

/// The buffers of a thread, reused from band to band.
struct DescriptionBuffers<T: Lane> {
    /// The transform of each layer.
    spectra: Vec<Spectrum<T>>,
    /// The pixels of a band and its halo.
    pixels: Memory<i32>,
    /// The codes of a group of rows.
    words: [Memory<T::Word>; 2],
}

impl<R: RowOfCodes> DescribedImage<'_, R> {
    /// All rows, with sums in numbers of type `T`.
    fn described<T: Lane>(&self, width: usize) -> Result<Plane<R::Item>> {
        let rows = self.gray.size().0;
        let buffers = || self.buffers::<T>();

        Plane::by_bands_with((rows, width), BAND_ROWS, buffers, |buffers, first, band| {
            self.write_pixels(first, band.len() / width, &mut buffers.pixels);

            let group = self.layout().group();
            for (y, rows) in (0..).step_by(group).zip(band.chunks_mut(group * width)) {
                self.control.checkpoint()?;
                self.write_rows(y, buffers, rows.chunks_exact_mut(width));
            }

            Ok(())
        })
    }

    /// The buffers of a thread.
    fn buffers<T: Lane>(&self) -> Result<DescriptionBuffers<T>> {
        let layout = self.layout();
        let spectrum = |layer: &Layer| Spectrum::new(&layer.basis, &layer.frequencies, layout);
        let rows = self.gray.size().0.min(BAND_ROWS) + 2 * layout.margin;
        let words = layout.span(layout.group());

        Ok(DescriptionBuffers {
            spectra: self.layers.iter().map(spectrum).collect::<Result<_>>()?,
            pixels: Memory::new(rows * layout.width())?,
            words: [Memory::new(words)?, Memory::new(words)?],
        })
    }

    /// The layout of the pixels, with the margin that the largest neighborhood needs.
    fn layout(&self) -> Layout {
        let margin = self.layers.iter().map(|layer| layer.basis.radius()).max();
        Layout { cols: self.gray.size().1, margin: margin.unwrap_or(0) }
    }

    /// Writes a group of rows, from row `y` on of the band whose pixels are in the buffers.
    fn write_rows<'r, T: Lane>(
        &self,
        y: usize,
        buffers: &mut DescriptionBuffers<T>,
        rows: impl ExactSizeIterator<Item = &'r mut [R::Item]>,
    ) where
        R::Item: 'r,
    {
        let layout = self.layout();
        let (width, count) = (layout.width(), rows.len());
        let DescriptionBuffers { spectra, pixels, words } = buffers;
        let mut words = words.each_mut().map(|words| &mut words[..layout.span(count)]);

        for words in &mut words {
            words.fill(T::Word::default());
        }

        for (layer, spectrum) in self.layers.iter().zip(spectra) {
            let radius = layer.basis.radius();
            let above = (y + layout.margin - radius) * width;
            let surroundings = &pixels[above..][..(count + 2 * radius) * width];
            let words = words.each_mut().map(|words| &mut **words);
            transform_rows(self.level, spectrum, surroundings, layer, words);
        }

        for (start, row) in (0..).step_by(width).zip(rows) {
            let words = words.each_ref().map(|words| &words[start..][..layout.cols]);
            store_row(self.level, self.rows, words, row);
        }
    }

    /// Writes the pixels of this many rows and their halo; the image continues by reflection.
    fn write_pixels(&self, first: usize, count: usize, pixels: &mut [i32]) {
        let rows = self.gray.size().0;
        let layout = self.layout();
        let Layout { cols, margin } = layout;
        let places = (first as isize - margin as isize..).take(count + 2 * margin);

        for (y, row) in places.zip(pixels.chunks_exact_mut(layout.width())) {
            row[margin..][..cols].copy_from_slice(self.gray.row(reflect(y, rows)));

            // Left and right of the image, from the row itself.
            for x in (0..margin).chain(margin + cols..cols + 2 * margin) {
                row[x] = row[margin + reflect(x as isize - margin as isize, cols)];
            }
        }
    }
}

/// Rows of pixels and their surroundings -> the bits of one neighborhood size: bits 0 to 31 of the codes in
/// the first words, the others in the second.
#[leveled]
fn transform_rows<T: Lane>(
    level: Level,
    spectrum: &mut Spectrum<T>,
    surroundings: &[i32],
    layer: &Layer,
    words: [&mut [T::Word]; 2],
) {
    let Layer { quantizer, bits, .. } = layer;

    spectrum.center_on(surroundings);
    for places in segments(words[0].len()) {
        for frequency in 0..spectrum.frequencies() {
            for (c, re, im) in spectrum.components(frequency, places.clone()) {
                let Some(shift) = bits[c] else { continue };
                let words = &mut words[shift / 32][places.clone()];
                quantizer.add(re, im, shift % 32, words);
            }
        }
    }
}

/// Stores the codes of a row.
#[leveled]
fn store_row<R: RowOfCodes, W: Word>(level: Level, rows: &R, words: [&[W]; 2], row: &mut [R::Item]) {
    rows.write(words, row);
}

/// Joins the two halves of the codes. Outputs and inputs are separate arguments, so that the vectorizer sees
/// that they do not overlap.
#[inline(always)]
fn narrow<W: Word, C: Code>(low: &[W], high: &[W], codes: &mut [C]) {
    let n = codes.len();
    let (low, high) = (&low[..n], &high[..n]);

    for i in 0..n {
        codes[i] = C::narrowed(low[i].into() | high[i].into() << 32);
    }
}

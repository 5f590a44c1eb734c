//! An image -> packed phase codes (paper, section 2.1).

use crate::basis::Basis;
use crate::control::Control;
use crate::error::Result;
use crate::plane::{Plane, reflect};
use crate::quantiser::Quantiser;
use crate::settings::Settings;
use crate::spectrum::Spectrum;

/// Rows that one task describes; each task warms up over `L - 1` further rows.
const BAND_ROWS: usize = 128;

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
    /// The same codes in the widest words.
    pub fn widened(self) -> Plane<u64> {
        match self {
            Self::U16(codes) => codes.map(|&code| code.into()),
            Self::U32(codes) => codes.map(|&code| code.into()),
            Self::U64(codes) => codes,
        }
    }
}

/// The codes of every pixel of a gray plane, component 0 in the lowest bits.
pub fn describe(gray: &Plane<i32>, settings: &Settings, control: &Control) -> Result<Codes> {
    let length = settings.code_length();
    Ok(match length {
        ..=16 => Codes::U16(describe_as(gray, settings, control)?),
        17..=32 => Codes::U32(describe_as(gray, settings, control)?),
        _ => Codes::U64(describe_as(gray, settings, control)?),
    })
}

/// The codes in words of the caller's choice, which must be wide enough.
pub fn describe_as<C: Code>(
    gray: &Plane<i32>,
    settings: &Settings,
    control: &Control,
) -> Result<Plane<C>> {
    let (basis, quantiser) = (Basis::new(settings), Quantiser::new(settings));
    Plane::by_bands((gray.rows(), gray.cols()), BAND_ROWS, |first, codes| {
        describe_band(gray, first, &basis, &quantiser, control, codes)
    })
}

fn describe_band<C: Code>(
    gray: &Plane<i32>,
    first: usize,
    basis: &Basis,
    quantiser: &Quantiser,
    control: &Control,
    codes: &mut [C],
) -> Result<()> {
    let radius = basis.radius() as isize;
    let mut spectrum = Spectrum::new(basis, gray.cols())?;
    let push = |spectrum: &mut Spectrum, y| spectrum.push(y, gray.row(reflect(y, gray.rows())));
    for y in first as isize - radius..first as isize + radius {
        push(&mut spectrum, y)?;
    }
    for (y, codes) in (first..).zip(codes.chunks_exact_mut(gray.cols())) {
        control.checkpoint()?;
        push(&mut spectrum, y as isize + radius)?;
        spectrum.centre_on(y as isize);
        pack_row(&spectrum, basis, quantiser, y, codes);
    }
    Ok(())
}

/// Moves every component's origin to its centre pixel, quantises it and packs the bits.
fn pack_row<C: Code>(
    spectrum: &Spectrum,
    basis: &Basis,
    quantiser: &Quantiser,
    y: usize,
    codes: &mut [C],
) {
    let mut packed = vec![0u64; codes.len()];
    for (c, &component) in basis.components().iter().enumerate() {
        // The rotation's index rises by u from pixel to pixel, modulo L.
        let mut rotation = basis.rotation_index(component, 0, y);
        for (x, packed) in packed.iter_mut().enumerate() {
            let (re, im) = basis.rotations()[rotation].times(spectrum.at(c, x));
            *packed |= quantiser.code(re, im) << (c * quantiser.code_length());
            rotation += component.u;
            rotation -= if rotation < basis.size() { 0 } else { basis.size() };
        }
    }
    codes.iter_mut().zip(packed).for_each(|(code, packed)| *code = C::narrowed(packed));
}

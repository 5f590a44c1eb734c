//! A kernel that no family knows, measured from what both images show.

use rustfft::num_complex::Complex32;

use super::bank::Side;
use super::bins::SIDE;
use super::rough::{Rough, Shades};
use super::spectrum::{Place, cross, kernel};
use crate::control::Control;
use crate::error::Result;
use crate::plane::Plane;
use crate::psf::Taps;

/// Taps on either side of the centre: of larger kernels blocks see too little.
const REACH: usize = 15;
/// Taps below this share of the largest are noise.
const LEAST_TAP: f32 = 0.08;
/// Share of the mean power of the sharp image that is added to every power, against division by nothing.
const REGULAR: f32 = 1e-3;

/// The kernel that turns the sharp image into the soft one, by least squares over blocks of the left image
/// and of the right one as seen from the left: the sum of cross-spectra over that of powers.
///
/// `None` if there is nothing to see it by.
pub fn measured(
    shades: [&Shades; 2],
    rough: &Rough,
    places: &[Place],
    side: Side,
    control: &Control,
) -> Result<Option<Taps>> {
    let seen = warped(&shades[1].plane, rough, control)?;
    let places: Vec<Place> =
        places.iter().map(|place| Place { right: place.left, ..*place }).collect();
    let sums = cross([&shades[0].plane, &seen], &places, control)?;
    let sharp = &sums.powers[1 - side.index()];
    let regular = sharp.iter().sum::<f32>() / sharp.len() as f32 * REGULAR;
    let quotient = |(product, power): (&Complex32, &f32)| {
        let product = if side == Side::Left { *product } else { product.conj() };
        product / (power + regular).max(f32::MIN_POSITIVE)
    };
    let quotients: Vec<_> = sums.product.iter().zip(sharp).map(quotient).collect();
    Ok(cleaned(&kernel(&quotients)))
}

/// The right image as seen from the left one.
fn warped(right: &Plane<f32>, rough: &Rough, control: &Control) -> Result<Plane<f32>> {
    let last = right.cols() as isize - 1;
    Plane::by_rows((right.rows(), right.cols()), control, |y, row: &mut [f32]| {
        for (x, value) in row.iter_mut().enumerate() {
            let from = x as isize - rough.at(y, x).round() as isize;
            *value = right.row(y)[from.clamp(0, last) as usize];
        }
    })
}

/// What is a point-spread function of it: positive taps that hang together about the largest.
fn cleaned(kernel: &Plane<f32>) -> Option<Taps> {
    let (corner, side) = (SIDE / 2 - REACH, 2 * REACH + 1);
    let inner = Plane::from_fn(side, side, |y, x| kernel.row(corner + y)[corner + x]);
    let largest = inner.as_slice().iter().copied().fold(0.0, f32::max);
    let floor = largest * LEAST_TAP;
    let start =
        inner.as_slice().iter().position(|tap| *tap == largest).filter(|_| largest > 0.0)?;
    let mut values = vec![0.0; side * side];
    let mut open = vec![start];
    while let Some(place) = open.pop() {
        let tap = inner.as_slice()[place];
        if tap < floor || values[place] != 0.0 {
            continue;
        }
        values[place] = f64::from(tap);
        let (y, x) = (place / side, place % side);
        for row in y.saturating_sub(1)..(y + 2).min(side) {
            open.extend((x.saturating_sub(1)..(x + 2).min(side)).map(|col| row * side + col));
        }
    }
    Some(Taps::new(REACH, values))
}

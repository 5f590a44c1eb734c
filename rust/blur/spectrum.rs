//! Power spectra of blocks that show the same in both images, and kernels' responses on the same bins.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlannerScalar};

use super::bins::{SIDE, bins};
use super::fit::Response;
use crate::control::Control;
use crate::error::Result;
use crate::plane::Plane;
use crate::psf::Taps;

/// Coefficients of half a spectrum: those of a real block mirror each other.
const HALF: usize = SIDE * SIDE / 2;

/// A place in both images: the corner of a left block, and of the right one that shows the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Row of the corners.
    pub top: usize,
    /// Column of the left one.
    pub left: usize,
    /// Column of the right one.
    pub right: usize,
}

/// What is kept of a pair of blocks.
#[derive(Debug, Clone)]
pub struct Powers {
    /// Mean power in every bin, left and right.
    pub binned: [Vec<f32>; 2],
    /// Least mean power of any direction at high frequencies.
    pub least_high: [f32; 2],
}

/// Sums of products of the spectra of blocks.
#[derive(Debug, Clone)]
pub struct Cross {
    /// Of each left coefficient and the conjugate of the right one.
    pub product: Vec<Complex32>,
    /// Powers, left and right.
    pub powers: [Vec<f32>; 2],
}

/// The transform of a block; the planner without vector instructions is the same on every machine.
struct Transform {
    fft: Arc<dyn Fft<f32>>,
    /// Raised cosine, of which the sum of squares over the block is 1.
    window: Vec<f32>,
    window_sum: f32,
}

impl Transform {
    fn get() -> &'static Self {
        static TRANSFORM: OnceLock<Transform> = OnceLock::new();
        TRANSFORM.get_or_init(|| {
            let wave = |i: usize| (i as f64 + 0.5) / SIDE as f64 * std::f64::consts::TAU;
            let hann: Vec<f64> = (0..SIDE).map(|i| 0.5 - 0.5 * wave(i).cos()).collect();
            let square: f64 = hann.iter().map(|value| value * value).sum();
            let rows = hann.iter().flat_map(|a| hann.iter().map(move |b| a * b / square));
            let window: Vec<f32> = rows.map(|value| value as f32).collect();
            let window_sum = window.iter().sum();
            Self { fft: FftPlannerScalar::new().plan_fft_forward(SIDE), window, window_sum }
        })
    }

    /// In place; the outcome is at `kx * SIDE + ky`.
    fn apply(&self, block: &mut [Complex32]) {
        let mut scratch = vec![Complex32::default(); self.fft.get_inplace_scratch_len()];
        for _ in 0..2 {
            self.fft.process_with_scratch(block, &mut scratch);
            for y in 0..SIDE {
                (0..y).for_each(|x| block.swap(y * SIDE + x, x * SIDE + y));
            }
        }
    }

    /// The spectra of two real blocks by one complex transform: coefficients of half the plane.
    fn pair(&self, images: [&Plane<f32>; 2], place: Place) -> Vec<[Complex32; 2]> {
        let mut block: Vec<Complex32> = Vec::with_capacity(SIDE * SIDE);
        for y in place.top..place.top + SIDE {
            let left = &images[0].row(y)[place.left..place.left + SIDE];
            let right = &images[1].row(y)[place.right..place.right + SIDE];
            block.extend(left.iter().zip(right).map(|(l, r)| Complex32::new(*l, *r)));
        }
        let weighted: Complex32 = block.iter().zip(&self.window).map(|(v, w)| v * w).sum();
        let mean = weighted / self.window_sum;
        block.iter_mut().zip(&self.window).for_each(|(value, w)| *value = (*value - mean) * w);
        self.apply(&mut block);
        let mirror = |k: usize| (SIDE - k) % SIDE;
        let coefficient = |place: usize| {
            let (ahead, behind) =
                (block[place], block[mirror(place / SIDE) * SIDE + mirror(place % SIDE)].conj());
            let (even, odd) = (ahead + behind, ahead - behind);
            [even * 0.5, Complex32::new(odd.im, -odd.re) * 0.5]
        };
        (0..HALF).map(coefficient).collect()
    }
}

/// The powers of every pair of blocks, in the order of their places.
pub fn powers(
    images: [&Plane<f32>; 2],
    places: &[Place],
    control: &Control,
) -> Result<Vec<Powers>> {
    let (bins, transform) = (bins(), Transform::get());
    let of_pair = |place: &Place| {
        control.checkpoint()?;
        let spectra = transform.pair(images, *place);
        let powers = [0, 1]
            .map(|side| spectra.iter().map(|pair| pair[side].norm_sqr()).collect::<Vec<f32>>());
        let [left, right] = &powers;
        Ok(Powers {
            binned: [bins.pooled(left), bins.pooled(right)],
            least_high: [bins.least_high(left), bins.least_high(right)],
        })
    };
    places.par_iter().map(of_pair).collect()
}

/// The sums of the products over pairs of blocks, each scaled so that strong contrast counts no more.
pub fn cross(images: [&Plane<f32>; 2], places: &[Place], control: &Control) -> Result<Cross> {
    let transform = Transform::get();
    let empty = || Cross {
        product: vec![Complex32::default(); HALF],
        powers: [vec![0.0; HALF], vec![0.0; HALF]],
    };
    // In groups of a fixed size, one after another: the sums must not depend on the threads.
    let groups: Result<Vec<Cross>> = places
        .par_chunks(16)
        .map(|group| {
            control.checkpoint()?;
            let mut sums = empty();
            group.iter().for_each(|place| sums.add_pair(&transform.pair(images, *place)));
            Ok(sums)
        })
        .collect();
    let mut total = empty();
    groups?.iter().for_each(|sums| total.add(sums));
    Ok(total)
}

impl Cross {
    fn add_pair(&mut self, spectra: &[[Complex32; 2]]) {
        let power: f32 = spectra.iter().flatten().map(Complex32::norm_sqr).sum();
        let scale = HALF as f32 / power.max(f32::MIN_POSITIVE);
        for (place, [left, right]) in spectra.iter().enumerate() {
            self.product[place] += left * right.conj() * scale;
            self.powers[0][place] += left.norm_sqr() * scale;
            self.powers[1][place] += right.norm_sqr() * scale;
        }
    }

    fn add(&mut self, other: &Self) {
        self.product.iter_mut().zip(&other.product).for_each(|(sum, value)| *sum += value);
        for (sums, values) in self.powers.iter_mut().zip(&other.powers) {
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    }
}

/// What a kernel leaves of the power in every bin, seen through the window of the blocks.
pub fn response(taps: &Taps) -> Response {
    let mut block = vec![Complex32::default(); SIDE * SIDE];
    let wrapped = |offset: isize| offset.rem_euclid(SIDE as isize) as usize;
    for (dy, dx, value) in taps.places() {
        block[wrapped(dy) * SIDE + wrapped(dx)].re += value as f32;
    }
    Transform::get().apply(&mut block);
    let powers: Vec<f32> = block.iter().map(Complex32::norm_sqr).collect();
    Response::new(bins().pooled(&smeared(&powers)[..HALF]))
}

/// Convolved with the power spectrum of the window along both axes.
fn smeared(powers: &[f32]) -> Vec<f32> {
    let neighbours = |place: usize, step: usize| {
        let (row, col) = (place / SIDE, place % SIDE);
        let next = |k: usize, by: usize| (k + by) % SIDE;
        if step == 1 {
            [row * SIDE + next(col, 1), row * SIDE + next(col, SIDE - 1)]
        } else {
            [next(row, 1) * SIDE + col, next(row, SIDE - 1) * SIDE + col]
        }
    };
    let smear = |powers: &[f32], step: usize| -> Vec<f32> {
        let value = |place: usize| {
            let [a, b] = neighbours(place, step);
            powers[place] * (2.0 / 3.0) + (powers[a] + powers[b]) * (1.0 / 6.0)
        };
        (0..SIDE * SIDE).map(value).collect()
    };
    smear(&smear(powers, 1), SIDE)
}

/// The kernel, centred, whose coefficients these are (half the plane, at `kx * SIDE + ky`).
pub fn kernel(coefficients: &[Complex32]) -> Plane<f32> {
    let mut block = vec![Complex32::default(); SIDE * SIDE];
    let mirror = |k: usize| (SIDE - k) % SIDE;
    for (place, value) in coefficients.iter().enumerate() {
        let (kx, ky) = (place / SIDE, place % SIDE);
        // Conjugated, so that the forward transform goes back; and real, so that the mirror image is its conjugate.
        block[mirror(kx) * SIDE + mirror(ky)] = *value;
        block[kx * SIDE + ky] = value.conj();
    }
    Transform::get().apply(&mut block);
    let scale = 1.0 / (SIDE * SIDE) as f32;
    let centre = SIDE / 2;
    Plane::from_fn(SIDE, SIDE, |y, x| {
        let (y, x) = ((y + centre) % SIDE, (x + centre) % SIDE);
        block[y * SIDE + x].re * scale
    })
}

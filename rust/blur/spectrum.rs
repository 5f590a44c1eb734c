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

    /// In place; the outcome is at `ky * SIDE + kx`.
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

impl Default for Cross {
    fn default() -> Self {
        Self {
            product: vec![Complex32::default(); HALF],
            powers: [vec![0.0; HALF], vec![0.0; HALF]],
        }
    }
}

impl Cross {
    /// Adds the products of pairs of blocks, each scaled so that strong contrast counts no more.
    pub fn add_all(
        &mut self,
        images: [&Plane<f32>; 2],
        places: &[Place],
        control: &Control,
    ) -> Result<()> {
        let transform = Transform::get();
        // In groups that depend neither on the threads nor on how many rows of blocks there are, one after another.
        let rows = places.chunk_by(|a, b| a.top == b.top);
        let groups: Vec<&[Place]> = rows.flat_map(|row| row.chunks(16)).collect();
        let sums_of = |group: &&[Place]| {
            control.checkpoint()?;
            let mut sums = Self::default();
            for place in *group {
                sums.add_pair(&transform.pair(images, *place));
            }
            Ok(sums)
        };
        let sums: Result<Vec<Self>> = groups.par_iter().map(sums_of).collect();
        sums?.iter().for_each(|sums| self.add(sums));
        Ok(())
    }

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

/// The kernel, centred, whose coefficients these are (half the plane, at `ky * SIDE + kx`).
pub fn kernel(coefficients: &[Complex32]) -> Plane<f32> {
    let mut block = vec![Complex32::default(); SIDE * SIDE];
    let mirror = |k: usize| (SIDE - k) % SIDE;
    for (place, value) in coefficients.iter().enumerate() {
        let (ky, kx) = (place / SIDE, place % SIDE);
        // Conjugated, so that the forward transform goes back; and real, so that the mirror image is its conjugate.
        block[mirror(ky) * SIDE + mirror(kx)] = *value;
        block[ky * SIDE + kx] = value.conj();
    }
    Transform::get().apply(&mut block);
    let scale = 1.0 / (SIDE * SIDE) as f32;
    let centre = SIDE / 2;
    Plane::from_fn(SIDE, SIDE, |y, x| {
        let (y, x) = ((y + centre) % SIDE, (x + centre) % SIDE);
        block[y * SIDE + x].re * scale
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::psf::{Family, Psf};

    fn noise(seed: u32) -> Plane<f32> {
        let mut state = seed;
        Plane::from_fn(70, 90, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as f32 - 128.0
        })
    }

    /// Powers of half the plane at `ky * SIDE + kx`, a sum for each.
    fn naive(image: &Plane<f32>, top: usize, left: usize) -> Vec<f32> {
        let hann = |i: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / SIDE as f64).cos();
        let square: f64 = (0..SIDE).map(|i| hann(i).powi(2)).sum();
        let window = |y: usize, x: usize| hann(y) * hann(x) / square;
        let pixel = |y: usize, x: usize| f64::from(image.row(top + y)[left + x]);
        let all = || (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x)));
        let sum: f64 = all().map(|(y, x)| window(y, x)).sum();
        let mean = all().map(|(y, x)| window(y, x) * pixel(y, x)).sum::<f64>() / sum;
        let turn = |k: usize, i: usize| (TAU * ((k * i) % SIDE) as f64 / SIDE as f64).sin_cos();
        let weighed = |y, x| (pixel(y, x) - mean) * window(y, x);
        let along = |y: usize, kx: usize| {
            (0..SIDE).fold((0.0, 0.0), |(re, im), x| {
                let (sine, cosine) = turn(kx, x);
                (re + weighed(y, x) * cosine, im - weighed(y, x) * sine)
            })
        };
        let rows: Vec<Vec<(f64, f64)>> =
            (0..SIDE).map(|y| (0..SIDE).map(|kx| along(y, kx)).collect()).collect();
        let power = |place: usize| {
            let (ky, kx) = (place / SIDE, place % SIDE);
            let (re, im) = (0..SIDE).fold((0.0, 0.0), |(re, im), y| {
                let ((sine, cosine), (a, b)) = (turn(ky, y), rows[y][kx]);
                (re + a * cosine + b * sine, im + b * cosine - a * sine)
            });
            (re * re + im * im) as f32
        };
        (0..HALF).map(power).collect()
    }

    #[test]
    fn powers_of_a_pair_are_those_of_a_naive_transform() {
        let images = [noise(1), noise(2)];
        let place = Place { top: 3, left: 11, right: 25 };
        let found = powers([&images[0], &images[1]], &[place], &Control::default());
        let found = &found.expect("not cancelled")[0];
        for (side, left) in [place.left, place.right].into_iter().enumerate() {
            let expected = naive(&images[side], place.top, left);
            for (a, b) in found.binned[side].iter().zip(bins().pooled(&expected)) {
                assert!((a - b).abs() <= 1e-4 * b, "{a} {b}");
            }
            let high = bins().least_high(&expected);
            assert!((found.least_high[side] - high).abs() <= 1e-4 * high);
        }
    }

    #[test]
    fn cross_spectra_scale_every_pair_of_blocks_alike() {
        let image = noise(3);
        let loud = image.map(|value| 10.0 * value);
        let place = Place { top: 0, left: 5, right: 5 };
        let sums = |image| {
            let mut sums = Cross::default();
            sums.add_all([image, image], &[place], &Control::default()).expect("it runs");
            sums
        };
        let (one, ten) = (sums(&image), sums(&loud));
        for (a, b) in one.product.iter().zip(&ten.product) {
            assert!((a - b).norm() <= 1e-3 * a.norm().max(1e-3));
        }
        let total: f32 = one.powers.iter().flatten().sum();
        assert!((total / HALF as f32 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn sums_over_blocks_do_not_depend_on_the_threads() {
        let images = [noise(4), noise(5)];
        let place = |i: usize| Place { top: i / 40, left: i % 23, right: i % 19 };
        let places: Vec<Place> = (0..50).map(place).collect();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut sums = Cross::default();
            let mut work = || sums.add_all([&images[0], &images[1]], &places, &Control::default());
            pool.expect("threads").install(&mut work).expect("it runs");
            sums
        };
        let (one, four) = (on(1), on(4));
        assert_eq!(one.product, four.product);
        assert_eq!(one.powers, four.powers);
    }

    fn near(found: &Response, expected: Vec<f32>, tolerance: f32) {
        let flat = Response::new(expected);
        for (a, b) in found.values().iter().zip(flat.values()) {
            assert!((a - b).abs() < tolerance, "{a} {b}");
        }
    }

    #[test]
    fn a_single_tap_leaves_everything() {
        for place in [4, 0, 5] {
            let mut taps = vec![0.0; 9];
            taps[place] = 1.0;
            near(&response(&Taps::new(1, taps)), vec![1.0; bins().count()], 1e-5);
        }
    }

    #[test]
    fn a_gaussian_leaves_a_gaussian_as_the_window_smears_it() {
        for sigma in [1.2, 2.0, 3.5] {
            let psf = Psf { family: Family::Gaussian, size: sigma, angle: 0.0 };
            // The kernel is sampled: its spectrum comes again from either side.
            let along = |k: f64| -> f64 {
                let at = |k: f64| (-0.5 * (TAU * k / SIDE as f64 * sigma).powi(2)).exp();
                [-1.0, 0.0, 1.0].iter().map(|turn| at(k + turn * SIDE as f64)).sum::<f64>().powi(2)
            };
            let smeared = |k: usize| {
                let k = if k < SIDE / 2 { k as f64 } else { k as f64 - SIDE as f64 };
                along(k) * 2.0 / 3.0 + (along(k - 1.0) + along(k + 1.0)) / 6.0
            };
            let power = |place: usize| smeared(place / SIDE) * smeared(place % SIDE);
            let powers: Vec<f32> = (0..HALF).map(|place| power(place) as f32).collect();
            near(&response(&psf.taps()), bins().pooled(&powers), 1e-3);
        }
    }

    #[test]
    fn a_response_knows_directions() {
        let psf = |angle| Psf { family: Family::Motion, size: 9.0, angle };
        let of = |psf: Psf| response(&psf.taps());
        // A motion along x leaves what varies along y alone: place ky = 8, kx = 0.
        let bin = |place: usize| {
            let mut powers = vec![0.0; HALF];
            powers[place] = 1.0;
            bins().pooled(&powers).iter().position(|value| *value > 0.0 && *value < 1.0)
        };
        let along_y = bin(8 * SIDE).expect("a bin of several");
        assert!(of(psf(0.0)).values()[along_y] > 0.9);
        assert!(of(psf(90.0)).values()[along_y] < 0.3);
    }

    #[test]
    fn the_kernel_of_a_kernels_coefficients_is_that_kernel() {
        let tap = |dy: isize, dx: isize| {
            let bump = |y: f64, x: f64, s: f64| {
                (-((dy as f64 - y).powi(2) + (dx as f64 - x).powi(2)) / (2.0 * s * s)).exp()
            };
            bump(1.0, -2.0, 1.5) + 0.4 * bump(-3.0, 3.0, 1.3)
        };
        let reach = 9isize;
        let side = || -reach..=reach;
        let values = side().flat_map(|dy| side().map(move |dx| tap(dy, dx))).collect();
        let taps = Taps::new(reach as usize, values);
        let mut block = vec![Complex32::default(); SIDE * SIDE];
        for (dy, dx, value) in taps.places() {
            let wrapped = |offset: isize| offset.rem_euclid(SIDE as isize) as usize;
            block[wrapped(dy) * SIDE + wrapped(dx)].re = value as f32;
        }
        Transform::get().apply(&mut block);
        let found = kernel(&block[..HALF]);
        for (dy, dx, value) in taps.places() {
            let place = |offset: isize| (SIDE as isize / 2 + offset) as usize;
            let tap = found.row(place(dy))[place(dx)];
            assert!((f64::from(tap) - value).abs() < 1e-5, "{dy} {dx}: {tap} {value}");
        }
    }
}

//! Power spectra of corresponding blocks of both images.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::bins::{FLOAT_LANES, FloatLanes, SIDE, bins, total};
use super::transform::{ComplexBlock, Content, HALF, Scratch};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::matcher::runtime::Runtime;

/// The corners of a pair of corresponding blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockPlace {
    /// Row of the left one.
    pub top: usize,
    /// Column of the left one.
    pub left: usize,
    /// Row of the right one, which differs if the rows of the images do not correspond.
    pub right_top: usize,
    /// Column of the right one.
    pub right: usize,
}

/// Statistics of the spectra of a pair of blocks.
#[derive(Debug, Clone)]
pub struct Powers {
    /// Mean power in every bin, left and right.
    pub binned: [Vec<f32>; 2],
    /// Smallest mean power of any direction at high frequencies, left and right.
    pub least_high: [f32; 2],
}

/// Sums of cross-spectra and powers over pairs of blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct Cross {
    /// Each left coefficient times the conjugate of the right one: real and imaginary parts.
    pub product: [Vec<f32>; 2],
    /// Powers, left and right.
    pub powers: [Vec<f32>; 2],
}

/// A Hann window, whose sum of squares over the block is 1.
struct HannWindow {
    values: Vec<FloatLanes>,
    sum: f32,
}

fn window() -> &'static HannWindow {
    static WINDOW: OnceLock<HannWindow> = OnceLock::new();
    WINDOW.get_or_init(|| {
        // Samples lie at the centers of pixels, so the window is symmetric.
        let wave = |i: usize| (i as f64 + 0.5) / SIDE as f64 * std::f64::consts::TAU;
        let hann: Vec<f64> = (0..SIDE).map(|i| 0.5 - 0.5 * math::cos(wave(i))).collect();
        let square: f64 = hann.iter().map(|value| value * value).sum();

        let rows = hann.iter().flat_map(|a| hann.iter().map(move |b| a * b / square));
        let window: Vec<f32> = rows.map(|value| value as f32).collect();
        HannWindow { values: window.as_chunks().0.to_vec(), sum: window.iter().sum() }
    })
}

/// Cuts out the blocks at a place as the real and imaginary parts of one, subtracts their means under the
/// window, and multiplies them by it.
#[leveled]
fn cut_blocks(
    level: Level,
    images: [&Plane<f32>; 2],
    place: BlockPlace,
    window: &HannWindow,
    block: &mut ComplexBlock,
) {
    let corners = [(place.top, place.left), (place.right_top, place.right)];
    let parts = [&mut block.re, &mut block.im];
    for ((image, (top, left)), part) in images.into_iter().zip(corners).zip(parts) {
        for (y, row) in part.chunks_exact_mut(SIDE / FLOAT_LANES).enumerate() {
            let pixels = &image.row(top + y)[left..left + SIDE];
            row.copy_from_slice(pixels.as_chunks().0);
        }

        // Subtracts the mean under the window, so that the brightness does not leak into low frequencies.
        let mut weighted = [0.0; FLOAT_LANES];
        for (values, weights) in part.iter().zip(&window.values) {
            for lane in 0..FLOAT_LANES {
                weighted[lane] += values[lane] * weights[lane];
            }
        }
        let mean = total(weighted) / window.sum;
        let values = part.as_flattened_mut().iter_mut();
        for (value, weight) in values.zip(window.values.as_flattened()) {
            *value = (*value - mean) * weight;
        }
    }
}

/// Replaces the real parts of a block by its powers.
#[leveled]
pub fn take_norms(level: Level, block: &mut ComplexBlock) {
    let ComplexBlock { re, im } = block;
    for (re, im) in re.as_flattened_mut().iter_mut().zip(im.as_flattened()) {
        *re = *re * *re + im * im;
    }
}

/// Computes the lower halves of the spectra of the blocks at a place.
fn take_spectra(images: [&Plane<f32>; 2], place: BlockPlace, work: &mut Scratch, level: Level) {
    cut_blocks(level, images, place, window(), &mut work.block);
    work.transform(Content::Pair, level);
}

/// The powers of every pair of blocks, in the order of their places.
pub fn powers(images: [&Plane<f32>; 2], places: &[BlockPlace], runtime: Runtime) -> Result<Vec<Powers>> {
    let of_pair = |work: &mut Scratch, place: &BlockPlace| {
        runtime.control.checkpoint()?;
        take_spectra(images, *place, work, runtime.level());

        take_norms(runtime.level(), &mut work.block);
        let (left, right) = work.block.re.as_flattened().split_at(HALF);

        let bins = bins();
        Ok(Powers {
            binned: [bins.pooled(left), bins.pooled(right)],
            least_high: [bins.least_high(left), bins.least_high(right)],
        })
    };

    places.par_iter().map_init(Scratch::new, of_pair).collect()
}

impl Default for Cross {
    fn default() -> Self {
        let nothing = || [vec![0.0; HALF], vec![0.0; HALF]];
        Self { product: nothing(), powers: nothing() }
    }
}

impl Cross {
    /// Adds the spectra of pairs of blocks, each scaled so that all have the same total power.
    pub fn add_all(
        &mut self,
        images: [&Plane<f32>; 2],
        places: &[BlockPlace],
        runtime: Runtime,
    ) -> Result<()> {
        // Groups are summed one after another, and do not depend on threads or on the number of rows that are
        // read.
        let rows = places.chunk_by(|a, b| a.top == b.top);
        let groups: Vec<&[BlockPlace]> = rows.flat_map(|row| row.chunks(16)).collect();

        let sums_of = |work: &mut Scratch, group: &&[BlockPlace]| {
            runtime.control.checkpoint()?;
            let mut sums = Self::default();
            for place in *group {
                take_spectra(images, *place, work, runtime.level());
                sums.add_pair(&work.block);
            }
            Ok(sums)
        };

        let sums: Result<Vec<Self>> = groups.par_iter().map_init(Scratch::new, sums_of).collect();
        sums?.iter().for_each(|sums| self.add(sums));
        Ok(())
    }

    fn add_pair(&mut self, spectra: &ComplexBlock) {
        let (re, im) = (spectra.re.as_flattened(), spectra.im.as_flattened());
        // Without the scale, a few blocks of strong contrast would dominate.
        let norms: Vec<f32> = re.iter().zip(im).map(|(re, im)| re * re + im * im).collect();
        let scale = HALF as f32 / norms.iter().sum::<f32>().max(f32::MIN_POSITIVE);

        for place in 0..HALF {
            let (left, right) = (place, HALF + place);
            self.product[0][place] += (re[left] * re[right] + im[left] * im[right]) * scale;
            self.product[1][place] += (im[left] * re[right] - re[left] * im[right]) * scale;
            self.powers[0][place] += norms[left] * scale;
            self.powers[1][place] += norms[right] * scale;
        }
    }

    fn add(&mut self, other: &Self) {
        let (sums, others) = (&mut self.product, &other.product);
        let sums = sums.iter_mut().chain(&mut self.powers);
        for (sums, values) in sums.zip(others.iter().chain(&other.powers)) {
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    }
}

/// The centered kernel with these coefficients: the lower half of a spectrum, real and imaginary parts.
pub fn kernel([re, im]: &[Vec<f32>; 2], level: Level) -> Plane<f32> {
    let mut work = Scratch::new();
    let block = [work.block.re.as_flattened_mut(), work.block.im.as_flattened_mut()];
    let mirror = |k: usize| (SIDE - k) % SIDE;

    for place in 0..HALF {
        let (kx, ky) = (place / (SIDE / 2), place % (SIDE / 2));
        // The coefficients are conjugated, so that the forward transform inverts. The kernel is real, so
        // mirrored ones are conjugates.
        let (there, mirrored) = (ky * SIDE + kx, mirror(ky) * SIDE + mirror(kx));
        (block[0][mirrored], block[1][mirrored]) = (re[place], im[place]);
        (block[0][there], block[1][there]) = (re[place], -im[place]);
    }

    work.transform(Content::Complex, level);

    let values = work.block.re.as_flattened();

    let scale = 1.0 / (SIDE * SIDE) as f32;
    let center = SIDE / 2;
    // The transform leaves the values transposed, in halves; the kernel's center is at the corner.
    Plane::from_fn(SIDE, SIDE, |y, x| {
        let (y, x) = ((y + center) % SIDE, (x + center) % SIDE);
        values[y / center * HALF + x * center + y % center] * scale
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::taps::Taps;
    use super::*;
    use crate::testing::{on_a_thread, random};

    fn noise(seed: u32) -> Plane<f32> {
        let mut random = random(seed);
        Plane::from_fn(70, 90, |_, _| (random() >> 16) as f32 - 128.0)
    }

    /// Powers of half the plane at `kx * SIDE / 2 + ky`, a sum for each.
    fn naive(image: &Plane<f32>, top: usize, left: usize) -> Vec<f32> {
        let hann = |i: usize| 0.5 - 0.5 * math::cos(TAU * (i as f64 + 0.5) / SIDE as f64);
        let square: f64 = (0..SIDE).map(|i| hann(i).powi(2)).sum();

        let window = |y: usize, x: usize| hann(y) * hann(x) / square;
        let pixel = |y: usize, x: usize| f64::from(image.row(top + y)[left + x]);
        let all = || (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x)));

        let sum: f64 = all().map(|(y, x)| window(y, x)).sum();
        let mean = all().map(|(y, x)| window(y, x) * pixel(y, x)).sum::<f64>() / sum;

        let turn = |k: usize, i: usize| math::sin_cos(TAU * ((k * i) % SIDE) as f64 / SIDE as f64);
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
            let (kx, ky) = (place / (SIDE / 2), place % (SIDE / 2));
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
        let place = BlockPlace { top: 3, left: 11, right_top: 5, right: 25 };

        let images_of = [&images[0], &images[1]];
        let found = on_a_thread(Level::best(), |runtime| powers(images_of, &[place], runtime));
        let found = &found.expect("not cancelled")[0];

        let corners = [(place.top, place.left), (place.right_top, place.right)];
        for (side, (top, left)) in corners.into_iter().enumerate() {
            let expected = naive(&images[side], top, left);
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

        let place = BlockPlace { top: 0, left: 5, right_top: 0, right: 5 };
        let sums = |image| {
            let mut sums = Cross::default();
            on_a_thread(Level::best(), |runtime| sums.add_all([image, image], &[place], runtime))
                .expect("it runs");
            sums
        };

        let (one, ten) = (sums(&image), sums(&loud));

        let norm =
            |[re, im]: &[Vec<f32>; 2], place: usize| math::hypot(f64::from(re[place]), f64::from(im[place]));

        for place in 0..HALF {
            let [a, b] = [&one, &ten].map(|sums| norm(&sums.product, place));
            assert!((a - b).abs() <= 1e-3 * a.max(1e-3));
        }

        let total: f32 = one.powers.iter().flatten().sum();
        assert!((total / HALF as f32 - 1.0).abs() < 1e-3);
    }

    #[test]
    fn sums_over_blocks_do_not_depend_on_the_threads() {
        let images = [noise(4), noise(5)];

        let place = |i: usize| BlockPlace { top: i / 40, left: i % 23, right_top: i / 40, right: i % 19 };
        let places: Vec<BlockPlace> = (0..50).map(place).collect();

        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let mut sums = Cross::default();
            let images = [&images[0], &images[1]];
            on_a_thread(Level::best(), |runtime| {
                pool.expect("threads").install(|| sums.add_all(images, &places, runtime))
            })
            .expect("it runs");
            sums
        };

        assert_eq!(on(1), on(4));
    }

    #[test]
    fn the_kernel_of_a_kernels_coefficients_is_that_kernel() {
        let tap = |dy: isize, dx: isize| {
            let bump = |y: f64, x: f64, s: f64| {
                math::exp(-((dy as f64 - y).powi(2) + (dx as f64 - x).powi(2)) / (2.0 * s * s))
            };
            bump(1.0, -2.0, 1.5) + 0.4 * bump(-3.0, 3.0, 1.3)
        };

        let reach = 9isize;
        let side = || -reach..=reach;
        let values = side().flat_map(|dy| side().map(move |dx| tap(dy, dx))).collect();
        let taps = Taps::new(reach as usize, values);

        let mut work = Scratch::new();
        for (dy, dx, value) in taps.places() {
            let wrapped = |offset: isize| offset.rem_euclid(SIDE as isize) as usize;
            let block = work.block.re.as_flattened_mut();
            block[wrapped(dy) * SIDE + wrapped(dx)] = value as f32;
        }

        work.transform(Content::Complex, Level::best());
        let half = |values: &[FloatLanes]| values.as_flattened()[..HALF].to_vec();
        let found = kernel(&[half(&*work.block.re), half(&*work.block.im)], Level::best());

        for (dy, dx, value) in taps.places() {
            let place = |offset: isize| (SIDE as isize / 2 + offset) as usize;
            let tap = found.row(place(dy))[place(dx)];
            assert!((f64::from(tap) - value).abs() < 1e-5, "{dy} {dx}: {tap} {value}");
        }
    }
}

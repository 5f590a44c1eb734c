//! Responses: the share of the power that a kernel leaves in every bin of a spectrum.

use super::bins::{SIDE, bins, ln};
use super::spectrum::take_norms;
use super::taps::Taps;
use super::transform::{Content, HALF, Scratch};
use phasestereo_match::base::simd::Level;

/// The share of the power that a kernel leaves in every bin.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// The share of each bin.
    pub values: Vec<f32>,
    /// The mean logarithm at low frequencies.
    pub low: f32,
}

impl Response {
    /// The response with one value for every bin.
    pub fn new(values: Vec<f32>) -> Self {
        let low = bins().low.iter().zip(&values).map(|(weight, value)| weight * ln(*value)).sum();
        Self { values, low }
    }

    /// The response of no blur.
    pub fn flat() -> Self {
        Self::new(vec![1.0; bins().count()])
    }
}

/// The share of the power that a kernel leaves in every bin, smeared by the window of the blocks.
pub fn response(taps: &Taps, level: Level) -> Response {
    let mut work = Scratch::new();
    let block = work.block.re.as_flattened_mut();

    let wrapped = |offset: isize| offset.rem_euclid(SIDE as isize) as usize;
    for (dy, dx, value) in taps.places() {
        block[wrapped(dy) * SIDE + wrapped(dx)] += value as f32;
    }

    work.transform(Content::Complex, level);
    take_norms(level, &mut work.block);
    Response::new(bins().pooled(&smeared(work.block.re.as_flattened())))
}

/// The first half of powers that are convolved with the power spectrum of the Hann window along both axes.
fn smeared(powers: &[f32]) -> Vec<f32> {
    // The coefficients of a Hann window are 1/2 and twice -1/4: their squares, scaled to sum 1, are 2/3 and
    // twice 1/6.
    let smear = |before: f32, here: f32, after: f32| here * (2.0 / 3.0) + (before + after) * (1.0 / 6.0);

    let (lower, upper) = powers.split_at(HALF);
    let mut smeared = Vec::with_capacity(HALF);
    for (lower, upper) in lower.chunks(SIDE / 2).zip(upper.chunks(SIDE / 2)) {
        // Along y, the half needs one more coefficient on either side, from the other half.
        let row = [&upper[SIDE / 2 - 1..], lower, &upper[..1]].concat();
        smeared.extend(row.windows(3).map(|three| smear(three[0], three[1], three[2])));
    }

    let row = |kx: usize| &smeared[kx % SIDE * (SIDE / 2)..][..SIDE / 2];
    let along_x = |kx: usize| {
        let three = row(kx + SIDE - 1).iter().zip(row(kx)).zip(row(kx + 1));
        three.map(|((before, here), after)| smear(*before, *here, *after))
    };

    (0..SIDE).flat_map(along_x).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::psf::Psf;
    use super::*;
    use phasestereo_match::base::math;

    fn near(found: &Response, expected: Vec<f32>, tolerance: f32) {
        let flat = Response::new(expected);
        for (a, b) in found.values.iter().zip(flat.values) {
            assert!((a - b).abs() < tolerance, "{a} {b}");
        }
    }

    #[test]
    fn a_single_tap_leaves_everything() {
        for place in [4, 0, 5] {
            let mut taps = vec![0.0; 9];
            taps[place] = 1.0;
            near(&response(&Taps::new(1, taps), Level::best()), vec![1.0; bins().count()], 1e-5);
        }
    }

    #[test]
    fn a_gaussian_leaves_a_gaussian_as_the_window_smears_it() {
        for sigma in [1.2, 2.0, 3.5] {
            let psf = Psf::gaussian(sigma);
            // The kernel is sampled, so its spectrum repeats on either side.
            let along = |k: f64| -> f64 {
                let at = |k: f64| math::exp(-0.5 * (TAU * k / SIDE as f64 * sigma).powi(2));
                [-1.0, 0.0, 1.0].iter().map(|turn| at(k + turn * SIDE as f64)).sum::<f64>().powi(2)
            };

            let smeared = |k: usize| {
                let k = if k < SIDE / 2 { k as f64 } else { k as f64 - SIDE as f64 };
                along(k) * 2.0 / 3.0 + (along(k - 1.0) + along(k + 1.0)) / 6.0
            };

            let power = |place: usize| smeared(place / (SIDE / 2)) * smeared(place % (SIDE / 2));
            let powers: Vec<f32> = (0..HALF).map(|place| power(place) as f32).collect();
            near(&response(&psf.taps(), Level::best()), bins().pooled(&powers), 1e-3);
        }
    }

    #[test]
    fn a_response_depends_on_the_direction() {
        let psf = |angle| Psf::motion(9.0, angle);

        let of = |psf: Psf| response(&psf.taps(), Level::best());
        // A motion along x leaves detail that varies only along y: place kx = 0, ky = 8.
        let bin = |place: usize| {
            let mut powers = vec![0.0; HALF];
            powers[place] = 1.0;
            bins().pooled(&powers).iter().position(|value| *value > 0.0 && *value < 1.0)
        };

        let along_y = bin(8).expect("a bin of several");
        assert!(of(psf(0.0)).values[along_y] > 0.9);
        assert!(of(psf(90.0)).values[along_y] < 0.3);
    }
}

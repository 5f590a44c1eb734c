//! How well a blur explains what two power spectra differ by.

use super::bins::{LANES, bins};
use super::spectrum::Powers;
use crate::simd::{Kernel, Level};

/// Residuals beyond this, in nepers, count for no more: blocks need not show the same altogether.
const LARGEST_RESIDUAL: f32 = 2.0;
/// Of an image's power at least this share is taken for signal.
const LEAST_SIGNAL: f32 = 0.02;
/// Gains of power lie within this many nepers of 1, corrections of them within one.
const LARGEST_GAIN: f32 = 20.0;

type Lanes = [f32; LANES];

/// What a kernel leaves of the power in every bin.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    values: Vec<f32>,
    /// The mean logarithm of the low ones.
    low: f32,
}

/// What the spectra of two blocks, one of which may be blurrier, have to say.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Logarithms of the blurrier one's power.
    blurred: Vec<f32>,
    /// The sharper one's power without its noise.
    sharp: Vec<f32>,
    /// The power of the blurrier one's noise.
    noise: f32,
    /// Mean logarithm of the quotient of both signals where frequencies are low.
    low: f32,
}

/// How a blur explains the evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Mean magnitude of the residuals, nepers of power; 0 is a perfect fit.
    pub loss: f32,
    /// Gain of power.
    pub gain: f32,
}

impl Response {
    /// That of one value in every bin.
    pub fn new(values: Vec<f32>) -> Self {
        let low = bins().low.iter().zip(&values).map(|(weight, value)| weight * ln(*value)).sum();
        Self { values, low }
    }

    /// What is left in every bin.
    #[cfg(test)]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// That of no blur.
    pub fn flat() -> Self {
        Self::new(vec![1.0; bins().count()])
    }
}

impl Evidence {
    /// That for a blur of one image, `side` (0 left, 1 right), given the powers of the noise of both.
    pub fn new(powers: &Powers, noise: [f32; 2], side: usize) -> Self {
        let signal = |power: &f32, noise: f32| (power - noise).max(LEAST_SIGNAL * power);
        let (blurred, sharp) = (&powers.binned[side], &powers.binned[1 - side]);
        let sharp: Vec<f32> = sharp.iter().map(|power| signal(power, noise[1 - side])).collect();
        let quotient =
            |(blurred, sharp): (&f32, &f32)| ln(signal(blurred, noise[side])) - ln(*sharp);
        let low = bins().low.iter().zip(blurred.iter().zip(&sharp).map(quotient));
        Self {
            low: low.map(|(weight, quotient)| weight * quotient).sum(),
            blurred: blurred.iter().map(|power| ln(*power)).collect(),
            sharp,
            noise: noise[side],
        }
    }

    /// By how much the image that is taken for the blurrier one has less power than the other one, given no
    /// blur, nepers on average.
    pub fn lack(&self) -> f32 {
        let gain = self.low.clamp(-LARGEST_GAIN, LARGEST_GAIN).exp();
        let lack = |(blurred, sharp): (&f32, &f32)| ln(gain * sharp + self.noise) - blurred;
        let lacks = self.blurred.iter().zip(&self.sharp).map(lack);
        lacks.zip(&bins().weights).map(|(lack, weight)| weight * lack).sum()
    }

    /// Fits the model: blurred = gain x response x (sharp - its noise) + noise.
    pub fn fit(&self, response: &Response, level: Level) -> Fit {
        level.run(Model { evidence: self, response, weights: &bins().weights })
    }
}

struct Model<'a> {
    evidence: &'a Evidence,
    response: &'a Response,
    weights: &'a [f32],
}

/// Most bins there can be.
const MOST_BINS: usize = 256;

impl Kernel for Model<'_> {
    type Output = Fit;

    #[inline(always)]
    fn run(self) -> Fit {
        let Self { evidence, response, weights } = self;
        let noise = evidence.noise;
        let first = (evidence.low - response.low).clamp(-LARGEST_GAIN, LARGEST_GAIN).exp();
        let (blurred, _) = evidence.blurred.as_chunks::<LANES>();
        let (sharp, _) = evidence.sharp.as_chunks::<LANES>();
        let (response, _) = response.values.as_chunks::<LANES>();
        let (weights, _) = weights.as_chunks::<LANES>();
        let mut residuals = [([0.0; LANES], [0.0; LANES]); MOST_BINS / LANES];
        let (mut pull, mut trusted) = ([0.0; LANES], [0.0; LANES]);
        let powers = blurred.iter().zip(sharp).zip(response).zip(weights);
        for ((((blurred, sharp), response), weights), kept) in powers.zip(&mut residuals) {
            let (residual, trust) = residual(*blurred, *sharp, *response, first, noise);
            for lane in 0..LANES {
                let clipped = residual[lane].clamp(-LARGEST_RESIDUAL, LARGEST_RESIDUAL);
                pull[lane] += weights[lane] * trust[lane] * clipped;
                trusted[lane] += weights[lane] * trust[lane];
            }
            *kept = (residual, trust);
        }
        let correction = (total(pull) / total(trusted).max(1e-9)).clamp(-1.0, 1.0);
        let mut loss = [0.0; LANES];
        for (weights, (residual, trust)) in weights.iter().zip(&residuals) {
            for lane in 0..LANES {
                // To the first order, what a little more gain does where there is signal and where there is noise.
                let residual = (residual[lane] - trust[lane] * correction).abs();
                loss[lane] += weights[lane] * residual.min(LARGEST_RESIDUAL);
            }
        }
        Fit { loss: total(loss), gain: first * correction.exp() }
    }
}

/// Logarithmic residuals, and the share of the signal in what is expected.
#[inline(always)]
fn residual(
    blurred: Lanes,
    sharp: Lanes,
    response: Lanes,
    gain: f32,
    noise: f32,
) -> (Lanes, Lanes) {
    let (mut residual, mut trust) = ([0.0; LANES], [0.0; LANES]);
    for lane in 0..LANES {
        let signal = gain * response[lane] * sharp[lane];
        let expected = signal + noise;
        residual[lane] = blurred[lane] - ln(expected);
        trust[lane] = signal / expected.max(f32::MIN_POSITIVE);
    }
    (residual, trust)
}

#[inline(always)]
fn total(sums: Lanes) -> f32 {
    sums.iter().sum()
}

/// The natural logarithm of a positive number, to 4e-5: this one is the same on every machine, and the loops
/// around it are vectorised.
#[inline(always)]
fn ln(value: f32) -> f32 {
    let bits = value.max(f32::MIN_POSITIVE).to_bits() as i32;
    let exponent = ((bits >> 23) - 127) as f32;
    let t = f32::from_bits((bits & 0x007f_ffff | 0x3f80_0000) as u32) - 1.0;
    // Least squares of ln(1 + t) / t at Chebyshev nodes.
    let series = 0.041_551_114 * t - 0.157_838_38;
    let series = (series * t + 0.306_561_1) * t - 0.497_030_84;
    (series * t + 0.999_945) * t + exponent * std::f32::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::super::bank::bank;
    use super::super::bins::bins;
    use super::*;
    use crate::reference;

    /// Powers that fall with the frequency, as those of images do, and what a blur of them would be.
    fn powers(seed: u32, response: &Response, gain: f32, noise: [f32; 2]) -> Powers {
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let count = bins().count();
        let scene: Vec<f32> =
            (0..count).map(|bin| 400.0 / (1.0 + bin as f32) * (0.5 + random())).collect();
        let blurred = scene.iter().zip(&response.values);
        let blurred = blurred.map(|(power, left)| gain * left * power + noise[0]).collect();
        let sharp = scene.iter().map(|power| power + noise[1]).collect();
        Powers { binned: [blurred, sharp], least_high: [0.0; 2] }
    }

    fn levels() -> impl Iterator<Item = Level> {
        Level::all().filter_map(|(_, level)| level)
    }

    #[test]
    fn the_logarithm_is_one() {
        for power in -60..60 {
            let value = 1.37f32.powi(power);
            assert!((ln(value) - value.ln()).abs() < 1e-4, "{value}");
        }
    }

    #[test]
    fn the_logarithm_of_nothing_is_finite() {
        assert!((ln(0.0) - f32::MIN_POSITIVE.ln()).abs() < 1e-3);
    }

    #[test]
    fn there_is_room_for_all_bins() {
        assert!(bins().count() <= MOST_BINS);
    }

    #[test]
    fn a_blur_explains_what_it_has_made() {
        for entry in bank().iter().step_by(11) {
            let powers = powers(1, &entry.response, 3.7, [0.4, 0.2]);
            let fit = Evidence::new(&powers, [0.4, 0.2], 0).fit(&entry.response, Level::best());
            assert!(fit.loss < 0.02, "{:?}: {fit:?}", entry.psf);
            assert!((fit.gain / 3.7).ln().abs() < 0.05, "{:?}: {fit:?}", entry.psf);
        }
    }

    #[test]
    fn any_fit_is_that_of_the_naive_twin_at_every_level() {
        let noise = [0.7, 0.3];
        for (seed, entry) in bank().iter().enumerate().step_by(7) {
            let powers = powers(seed as u32, &entry.response, 0.4, noise);
            for side in 0..2 {
                let evidence = Evidence::new(&powers, noise, side);
                for other in bank().iter().step_by(13) {
                    let expected = naive(&powers, noise, side, &other.response);
                    let fit = evidence.fit(&other.response, Level::best());
                    assert!((f64::from(fit.loss) - expected.0).abs() < 1e-3);
                    assert!((f64::from(fit.gain) / expected.1).ln().abs() < 1e-3);
                    assert!(levels().all(|level| evidence.fit(&other.response, level) == fit));
                }
            }
        }
    }

    fn naive(powers: &Powers, noise: [f32; 2], side: usize, response: &Response) -> (f64, f64) {
        let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect::<Vec<_>>();
        reference::blur_fit(
            [side, 1 - side].map(|side| wide(&powers.binned[side])),
            [side, 1 - side].map(|side| f64::from(noise[side])),
            &wide(&response.values),
            [&bins().weights, &bins().low].map(|weights| wide(weights)),
        )
    }

    #[test]
    fn the_softer_image_lacks_power_and_the_sharper_one_does_not() {
        for entry in bank().iter().step_by(9) {
            let powers = powers(5, &entry.response, 2.0, [0.3, 0.3]);
            let [soft, sharp] = [0, 1].map(|side| Evidence::new(&powers, [0.3; 2], side).lack());
            assert!(soft > sharp && soft > 0.0, "{:?}: {soft} {sharp}", entry.psf);
        }
        let alike = powers(5, &Response::flat(), 2.0, [0.3, 0.3]);
        assert!(Evidence::new(&alike, [0.3; 2], 0).lack().abs() < 0.05);
    }

    #[test]
    fn powers_of_nothing_are_explained_by_no_number_that_is_none() {
        let nothing = vec![0.0; bins().count()];
        let powers = Powers { binned: [nothing.clone(), nothing], least_high: [0.0; 2] };
        let fit = Evidence::new(&powers, [0.0; 2], 0).fit(&bank()[0].response, Level::best());
        assert!(fit.loss.is_finite() && fit.gain.is_finite());
    }
}

//! The fit of a blur to the power spectra of two blocks.
//!
//! The model, in every bin, is
//!
//! ```text
//! blurred = gain x response x (sharp - noise of the sharp) + noise of the blurred
//! ```
//!
//! and the loss is the weighted mean magnitude of the residuals of its logarithm. The gain is first that of
//! the low frequencies, which blur hardly changes; then one Gauss-Newton step corrects it.

use super::bins::{FLOAT_LANES, FloatLanes, bins, ln, total};
use super::response::Response;
use super::spectrum::Powers;
use phasestereo_match::base::math;
use phasestereo_match::base::simd::{Level, Loop, leveled};

/// Residuals beyond this, nepers, are clipped: blocks do not always show exactly the same things.
const LARGEST_RESIDUAL: f32 = 2.0;
/// Smallest share of an image's power that is assumed to be signal.
const LEAST_SIGNAL: f32 = 0.02;
/// Smallest share of the power that a blur is assumed to leave, when it is undone.
const LEAST_LEFT: f32 = 1e-3;
/// The logarithm of the gain of power lies within this many nepers of 0, that of its correction within one.
const LARGEST_GAIN: f32 = 20.0;

/// Most bins that residuals are stored for.
const MOST_BINS: usize = 256;

/// Power spectra of two blocks, one of which may be blurrier.
#[derive(Debug, Clone)]
pub struct BlurEvidence {
    /// Logarithms of the power of the blurrier one.
    blurred: Vec<FloatLanes>,
    /// Power of the sharper one without its noise.
    sharp: Vec<FloatLanes>,
    /// Power of the noise of the blurrier one.
    noise: f32,
    /// Mean logarithm of the quotient of both signals at low frequencies.
    low: f32,
}

/// How well a blur explains the evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlurFit {
    /// Mean magnitude of the residuals, nepers of power; 0 is a perfect fit.
    pub loss: f32,
    /// The missing power of the image that is assumed to be blurrier, nepers on average, compared with that
    /// expected from the gain of the low frequencies.
    pub lack: f32,
    /// Logarithm of the gain of power.
    log_gain: f32,
}

impl BlurFit {
    /// Gain of power.
    pub fn gain(&self) -> f32 {
        math::exp(f64::from(self.log_gain)) as f32
    }
}

impl BlurEvidence {
    /// Evidence for a blur of the left image and for one of the right image, given the powers of the noise of
    /// both.
    pub fn of_both(powers: &Powers, noise: [f32; 2], level: Level) -> [Self; 2] {
        evidence_of_both(level, powers, noise)
    }

    /// The evidence after undoing a blur of the sharper image with this response.
    pub fn against(&self, response: &Response) -> Self {
        let (responses, _) = response.values.as_chunks::<FLOAT_LANES>();

        let mut undone = self.clone();
        for (sharp, response) in undone.sharp.iter_mut().zip(responses) {
            for (sharp, left) in sharp.iter_mut().zip(response) {
                *sharp /= left.max(LEAST_LEFT);
            }
        }

        undone.low += response.low;
        undone
    }

    /// Fits the model: blurred = gain x response x (sharp - its noise) + noise.
    pub fn fit(&self, response: &Response, level: Level) -> BlurFit {
        fit_response(level, self, response)
    }

    /// The losses of many responses.
    pub fn losses<'a>(&self, responses: impl Iterator<Item = &'a Response>, level: Level) -> Vec<f32> {
        level.run(Models { evidence: self, responses })
    }
}

/// Subtracts the noise and takes logarithms, as evidence for either side.
#[leveled]
fn evidence_of_both(level: Level, powers: &Powers, noise: [f32; 2]) -> [BlurEvidence; 2] {
    let [left, right] = &powers.binned;
    let (left, right) = (left.as_chunks::<FLOAT_LANES>().0, right.as_chunks::<FLOAT_LANES>().0);
    let with_capacity = || Vec::with_capacity(left.len());
    let evidence = |noise| BlurEvidence { blurred: with_capacity(), sharp: with_capacity(), noise, low: 0.0 };
    // Evidence for a blur of the left image treats the right one as the sharp one, and the other way round.
    let (mut for_left, mut for_right) = (evidence(noise[0]), evidence(noise[1]));

    let mut low = [0.0; FLOAT_LANES];
    for ((left, right), weights) in left.iter().zip(right).zip(bins().low.as_chunks::<FLOAT_LANES>().0) {
        let left_signal = signal(*left, noise[0]);
        let right_signal = signal(*right, noise[1]);
        let (left_log, right_log) = (logarithms(left_signal), logarithms(right_signal));

        for lane in 0..FLOAT_LANES {
            low[lane] += weights[lane] * (left_log[lane] - right_log[lane]);
        }

        for_left.blurred.push(logarithms(*left));
        for_left.sharp.push(right_signal);
        for_right.blurred.push(logarithms(*right));
        for_right.sharp.push(left_signal);
    }

    for_left.low = total(low);
    for_right.low = -for_left.low;

    [for_left, for_right]
}

/// Fits one response.
#[leveled]
fn fit_response(level: Level, evidence: &BlurEvidence, response: &Response) -> BlurFit {
    let (loss, excess, log_gain) = fitted(evidence, response, &mut { NO_RESIDUALS });
    BlurFit { loss: total(loss), lack: -total(excess), log_gain }
}

/// Fits responses one after another: setting up each fit alone takes a third of its time.
struct Models<'e, R> {
    evidence: &'e BlurEvidence,
    responses: R,
}

impl<'r, R: Iterator<Item = &'r Response>> Loop for Models<'_, R> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let mut losses = Vec::with_capacity(self.responses.size_hint().0);
        let mut residuals = NO_RESIDUALS;
        for response in self.responses {
            losses.push(fitted(self.evidence, response, &mut residuals).0);
        }

        // Totals come last: a total at the end of a loop makes the compiler split the lanes inside it into
        // pairs.
        losses.into_iter().map(total).collect()
    }
}

/// Residuals of groups of bins, and the share of the signal in the expected power.
type Residuals = [(FloatLanes, FloatLanes); MOST_BINS / FLOAT_LANES];
const NO_RESIDUALS: Residuals = [([0.0; FLOAT_LANES], [0.0; FLOAT_LANES]); MOST_BINS / FLOAT_LANES];

/// One fit: a first gain, residuals with it, a correction of the gain, and the final loss. Returns the loss
/// and the excess power of the blurrier image, as sums in each lane, and the logarithm of the gain.
#[inline(always)]
fn fitted(
    evidence: &BlurEvidence,
    response: &Response,
    residuals: &mut Residuals,
) -> (FloatLanes, FloatLanes, f32) {
    let log_gain = (evidence.low - response.low).clamp(-LARGEST_GAIN, LARGEST_GAIN);
    let gain = math::exp(f64::from(log_gain)) as f32;
    let noise = evidence.noise;

    let (responses, _) = response.values.as_chunks::<FLOAT_LANES>();
    let (weights, _) = bins().weights.as_chunks::<FLOAT_LANES>();

    // Sums for the correction of the gain and for the missing power of the softer image.
    let (mut pull, mut trusted, mut excess) = ([0.0; FLOAT_LANES], [0.0; FLOAT_LANES], [0.0; FLOAT_LANES]);
    let powers = evidence.blurred.iter().zip(&evidence.sharp).zip(responses).zip(weights);
    for ((((blurred, sharp), response), weights), kept) in powers.zip(residuals.iter_mut()) {
        let (residual, trust) = residual(*blurred, *sharp, *response, gain, noise);

        for lane in 0..FLOAT_LANES {
            let clipped = residual[lane].clamp(-LARGEST_RESIDUAL, LARGEST_RESIDUAL);
            pull[lane] += weights[lane] * trust[lane] * clipped;
            trusted[lane] += weights[lane] * trust[lane];
            excess[lane] += weights[lane] * residual[lane];
        }

        *kept = (residual, trust);
    }

    // The weighted mean of the residuals, as far as the signal contributes to the expected power.
    let correction = (total(pull) / total(trusted).max(1e-9)).clamp(-1.0, 1.0);

    let mut loss = [0.0; FLOAT_LANES];
    for (weights, (residual, trust)) in weights.iter().zip(residuals) {
        for lane in 0..FLOAT_LANES {
            // The residual changes with the logarithm of the gain by the share of the signal, to the first
            // order.
            let residual = (residual[lane] - trust[lane] * correction).abs();
            // A choice, not `f32::min`, which also has to handle NaN.
            let residual = if residual < LARGEST_RESIDUAL { residual } else { LARGEST_RESIDUAL };
            loss[lane] += weights[lane] * residual;
        }
    }

    (loss, excess, log_gain + correction)
}

/// Residuals of the logarithm, and the share of the signal in the expected power.
#[inline(always)]
fn residual(
    blurred: FloatLanes,
    sharp: FloatLanes,
    response: FloatLanes,
    gain: f32,
    noise: f32,
) -> (FloatLanes, FloatLanes) {
    let mut residual = [0.0; FLOAT_LANES];
    let mut trust = [0.0; FLOAT_LANES];

    for lane in 0..FLOAT_LANES {
        let signal = gain * response[lane] * sharp[lane];
        let expected = signal + noise;
        residual[lane] = blurred[lane] - ln(expected);
        trust[lane] = signal / expected.max(f32::MIN_POSITIVE);
    }

    (residual, trust)
}

/// Powers minus that of the noise.
#[inline(always)]
fn signal(powers: FloatLanes, noise: f32) -> FloatLanes {
    let mut signal = powers;
    for value in &mut signal {
        *value = (*value - noise).max(LEAST_SIGNAL * *value);
    }
    signal
}

#[inline(always)]
fn logarithms(values: FloatLanes) -> FloatLanes {
    let mut logarithms = values;
    for value in &mut logarithms {
        *value = ln(*value);
    }
    logarithms
}

#[cfg(test)]
mod tests {
    use super::super::bank::bank;
    use super::super::bins::bins;
    use super::*;
    use crate::testing::{levels, random};

    /// Powers that fall with the frequency, like those of images, and those of a blurred version.
    fn powers(seed: u32, response: &Response, gain: f32, noise: [f32; 2]) -> Powers {
        let mut number = random(seed);
        let mut portion = || number() as f32 / (1 << 24) as f32;

        let count = bins().count();
        let scene: Vec<f32> = (0..count).map(|bin| 400.0 / (1.0 + bin as f32) * (0.5 + portion())).collect();

        let blurred = scene.iter().zip(&response.values);
        let blurred = blurred.map(|(power, left)| gain * left * power + noise[0]).collect();
        let sharp = scene.iter().map(|power| power + noise[1]).collect();

        Powers { binned: [blurred, sharp], least_high: [0.0; 2] }
    }

    #[test]
    fn the_logarithm_is_nearly_exact() {
        for power in -60..60 {
            let value = 1.37f32.powi(power);
            assert!((f64::from(ln(value)) - math::ln(f64::from(value))).abs() < 1e-4, "{value}");
        }
    }

    #[test]
    fn the_logarithm_of_zero_is_finite() {
        assert!((f64::from(ln(0.0)) - math::ln(f64::from(f32::MIN_POSITIVE))).abs() < 1e-3);
    }

    #[test]
    fn the_residuals_of_all_bins_fit() {
        assert!(bins().count() <= MOST_BINS);
    }

    #[test]
    fn a_blur_explains_what_it_has_made() {
        for entry in bank().iter().step_by(11) {
            let powers = powers(1, &entry.response, 3.7, [0.4, 0.2]);
            let fit = BlurEvidence::of_both(&powers, [0.4, 0.2], Level::best())[0]
                .fit(&entry.response, Level::best());
            assert!(fit.loss < 0.02, "{:?}: {fit:?}", entry.psf);
            assert!(math::ln(f64::from(fit.gain()) / 3.7).abs() < 0.05, "{:?}: {fit:?}", entry.psf);
        }
    }

    #[test]
    fn any_fit_is_that_of_the_naive_reference_at_every_level() {
        let noise = [0.7, 0.3];
        for (seed, entry) in bank().iter().enumerate().step_by(7) {
            let powers = powers(seed as u32, &entry.response, 0.4, noise);

            let others: Vec<&Response> = bank().iter().step_by(13).map(|other| &other.response).collect();

            for side in 0..2 {
                let of = |level| BlurEvidence::of_both(&powers, noise, level)[side].clone();
                let evidence = of(Level::best());

                let fits: Vec<BlurFit> =
                    others.iter().map(|other| evidence.fit(other, Level::best())).collect();

                for (other, fit) in others.iter().zip(&fits) {
                    let expected = naive(&powers, noise, side, other);
                    assert!((f64::from(fit.loss) - expected.0).abs() < 1e-3);
                    assert!(math::ln(f64::from(fit.gain()) / expected.1).abs() < 1e-3);
                }

                let losses: Vec<f32> = fits.iter().map(|fit| fit.loss).collect();

                for level in levels() {
                    let evidence = of(level);
                    let alone = others.iter().map(|other| evidence.fit(other, level));
                    assert!(alone.eq(fits.iter().copied()), "{}", level.name());
                    assert_eq!(evidence.losses(others.iter().copied(), level), losses);
                }
            }
        }
    }

    fn naive(powers: &Powers, noise: [f32; 2], side: usize, response: &Response) -> (f64, f64) {
        let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect::<Vec<_>>();

        blur_fit(
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
            let [soft, sharp] = lacks(&powers);
            assert!(soft > sharp && soft > 0.0, "{:?}: {soft} {sharp}", entry.psf);
        }

        let alike = powers(5, &Response::flat(), 2.0, [0.3, 0.3]);
        assert!(lacks(&alike)[0].abs() < 0.05);
    }

    fn lacks(powers: &Powers) -> [f32; 2] {
        let evidence = BlurEvidence::of_both(powers, [0.3; 2], Level::best());
        evidence.map(|evidence| evidence.fit(&Response::flat(), Level::best()).lack)
    }

    #[test]

    fn zero_powers_give_finite_fits() {
        let nothing = vec![0.0; bins().count()];
        let powers = Powers { binned: [nothing.clone(), nothing], least_high: [0.0; 2] };

        for evidence in BlurEvidence::of_both(&powers, [0.0; 2], Level::best()) {
            let fit = evidence.fit(&bank()[0].response, Level::best());
            assert!(fit.loss.is_finite() && fit.gain().is_finite());
        }
    }

    /// Reference implementation of the fit of a blur to the powers of two blocks, `[blurred, sharp]` like the
    /// noise; `weights` are those of all bins and those that determine the gain. Returns loss and gain.
    fn blur_fit(
        [blurred, sharp]: [Vec<f64>; 2],
        noise: [f64; 2],
        response: &[f64],
        [weights, low]: [Vec<f64>; 2],
    ) -> (f64, f64) {
        let bins = 0..blurred.len();

        let signal = |power: f64, noise: f64| (power - noise).max(0.02 * power);

        let quotient = |bin: usize| {
            let there = response[bin] * signal(sharp[bin], noise[1]);
            math::ln(signal(blurred[bin], noise[0]) / there)
        };

        let log_gain: f64 = bins.clone().map(|bin| low[bin] * quotient(bin)).sum();
        let gain = math::exp(log_gain.clamp(-20.0, 20.0));

        let there = |bin: usize| gain * response[bin] * signal(sharp[bin], noise[1]);
        let residual = |bin: usize| math::ln(blurred[bin] / (there(bin) + noise[0]));
        let trust = |bin: usize| weights[bin] * there(bin) / (there(bin) + noise[0]);

        let pull: f64 = bins.clone().map(|bin| trust(bin) * residual(bin).clamp(-2.0, 2.0)).sum();
        let trusted: f64 = bins.clone().map(trust).sum();

        let correction = (pull / trusted.max(1e-9)).clamp(-1.0, 1.0);

        let left = |bin: usize| (residual(bin) - trust(bin) / weights[bin].max(1e-300) * correction).abs();

        let loss = bins.map(|bin| weights[bin] * left(bin).min(2.0)).sum();
        (loss, gain * math::exp(correction))
    }
}

//! How the gray levels of two images correspond: gain and gamma between windows that show the same things.
//!
//! Means over windows of the reduced copies are compared, so that disparities off by a few pixels, noise, or
//! blur in one of the images matter little:
//!
//! ```text
//! left = gain right^gamma, black 0 to white 1
//! mean of right^gamma ~ m^gamma (1 + gamma (gamma - 1) / 2 (s / m)^2)   m, s: mean, deviation of a window
//! ```
//!
//! It uses Gauss-Newton on the logarithm of the gain and on gamma, weighted first for absolute deviations, to
//! come near from anywhere, then by Tukey's biweight, which ignores outliers. Windows that may be clipped are
//! left out. A prior keeps gamma near 1 if the windows do not determine it. All sums are in the order of the
//! windows.

use super::LightScale;
use crate::estimation::overview::{Overview, RoughMap};
use phasestereo_match::base::linear::Normal;
use phasestereo_match::base::math;
use phasestereo_match::base::statistics::{deviation, median, ranked, robust_weight};

/// Side of a cell, pixels of the copy. Every other row of it is sampled.
const CELL: usize = 4;
/// Cells along the side of a window: little light moves across the border of this many pixels.
const CELLS: usize = 3;
/// Distance of windows, cells.
const STRIDE: usize = 2;
/// Sampled pixels of a window.
const WINDOW: usize = CELLS * CELL * CELLS * CELL / 2;
/// Every this many pixels of the copy, one enters the percentiles: a prime, so that they lie in all columns.
const EVERY: usize = 7;
/// Pixels of the right image beyond these fractions may be clipped.
const USABLE: [f64; 2] = [0.005, 0.985];
/// Windows are used if at least this share is known.
const LEAST_KNOWN: f64 = 0.5;
/// Fewest windows to fit to.
const LEAST_WINDOWS: usize = 12;
/// Windows that reach this fraction may be clipped: in the left image,
const TOP: f64 = 0.95;
/// ... and in the prediction of the fit, which does not favor windows by their noise.
const FITTED_TOP: f64 = 0.9;
/// The brightest pixels of a window are this many standard deviations above its mean.
const ABOVE_MEAN: f64 = 1.5;
/// Residual of a window without contrast, as a fraction.
const TOLERANCE: f64 = 0.004;
/// The share of a window's variance that misplaced pixels may cause.
const UNEVEN: f64 = 0.1;
/// Least and largest gamma.
const GAMMAS: [f64; 2] = [0.2, 5.0];
/// Standard deviation of gamma about 1, if windows do not determine it.
const PRIOR: f64 = 0.5;
/// Windows that share each pixel.
const OVERLAP: f64 = 2.0;
/// Steps, and how many of them use absolute deviations.
const STEPS: (usize, usize) = (30, 8);
/// Longest change of a parameter in a step.
const LONGEST: f64 = 0.3;
/// A change too small for another step.
const SETTLED: f64 = 1e-5;
/// Fractions between which the typical gray level lies.
const GRAYS: [f64; 2] = [0.02, 0.98];

/// How gray levels correspond: `left = gain right^gamma`, as fractions of the range from black to white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contrast {
    /// The factor.
    pub gain: f64,
    /// The exponent.
    pub gamma: f64,
    /// The left gray level divided by the right one, at the right image's median.
    pub ratio: f64,
    /// The same at the tenth and the ninetieth percentile: they differ if gamma differs from 1, as far as
    /// there are such grays.
    pub ends: [f64; 2],
}

/// A pair of windows that show the same things.
#[derive(Debug, Clone, Copy, PartialEq)]
struct WindowPair {
    /// Means.
    left: f64,
    right: f64,
    /// Standard deviations.
    left_spread: f64,
    right_spread: f64,
    /// Logarithms of the right mean and of the brightest pixels there.
    log: f64,
    log_brightest: f64,
}

impl Contrast {
    /// The contrast of the copies, with right pixels matched by the rough map; `None`: too few windows
    /// correspond.
    pub(super) fn new(overview: &Overview, rough: &RoughMap, scales: &[LightScale; 2]) -> Option<Self> {
        let windows = windows(overview, rough, scales);
        let is_unclipped = |window: &&WindowPair| window.left + ABOVE_MEAN * window.left_spread < TOP;
        let usable: Vec<WindowPair> = windows.iter().filter(is_unclipped).copied().collect();
        if usable.len() < LEAST_WINDOWS {
            return None;
        }

        let (gain, gamma) = fitted(&usable);

        let mut grays: Vec<f32> = overview.planes[1].as_slice().iter().step_by(EVERY).copied().collect();
        let mut ratio = |tenths: usize| {
            let at = (grays.len() - 1) * tenths / 10;
            let shade = ranked(&mut grays, at).unwrap_or(0.0);
            let gray = scales[1].fraction(shade).clamp(GRAYS[0], GRAYS[1]);
            gain * math::exp((gamma - 1.0) * math::ln(gray))
        };
        Some(Self { gain, gamma, ratio: ratio(5), ends: [ratio(1), ratio(9)] })
    }
}

/// The windows of which enough is known.
fn windows(overview: &Overview, rough: &RoughMap, scales: &[LightScale; 2]) -> Vec<WindowPair> {
    let [left, right] = &overview.planes;
    let (rows, cols) = (left.rows() / CELL, left.cols() / CELL);

    // Windows overlap, so sums are taken over cells first.
    let mut cells = vec![ResponseSums::default(); rows * cols];
    for y in (0..rows * CELL).step_by(2) {
        let (disparities, _) = rough.disparity.row(y).as_chunks::<CELL>();
        let of_row = cells[y / CELL * cols..][..cols].iter_mut().zip(disparities);
        for ((cell, disparities), first) in of_row.zip((0..).step_by(CELL)) {
            let mut sums = ResponseSums::default();
            for (x, disparity) in (first..).zip(disparities) {
                let match_x = x as f32 - disparity;
                // NaN is in no range.
                if !(0.0..right.cols() as f32).contains(&match_x) {
                    continue;
                }

                let there = scales[1].fraction(right.row(y)[match_x as usize]);
                if there > USABLE[0] && there < USABLE[1] {
                    sums.add(scales[0].fraction(left.row(y)[x]), there);
                }
            }
            *cell = cell.and(sums);
        }
    }

    let starts = |length: usize| (0..(length + 1).saturating_sub(CELLS)).step_by(STRIDE);
    let window = |top: usize, first: usize| {
        let cell = |at: usize| cells[(top + at / CELLS) * cols + first + at % CELLS];
        (0..CELLS * CELLS).map(cell).fold(ResponseSums::default(), ResponseSums::and).window()
    };
    let of_row = |top: usize| starts(cols).filter_map(move |first| window(top, first));
    starts(rows).flat_map(of_row).collect()
}

/// Sums over the known pixels of a window.
#[derive(Debug, Clone, Copy, Default)]
struct ResponseSums {
    count: f64,
    values: [f64; 2],
    squares: [f64; 2],
}

impl ResponseSums {
    fn add(&mut self, left: f64, right: f64) {
        self.count += 1.0;
        for (side, value) in [left, right].into_iter().enumerate() {
            self.values[side] += value;
            self.squares[side] += value * value;
        }
    }

    fn and(self, other: Self) -> Self {
        let sum = |own: [f64; 2], other: [f64; 2]| [own[0] + other[0], own[1] + other[1]];
        Self {
            count: self.count + other.count,
            values: sum(self.values, other.values),
            squares: sum(self.squares, other.squares),
        }
    }

    /// The statistics; `None` if too little is known.
    fn window(&self) -> Option<WindowPair> {
        if self.count < LEAST_KNOWN * WINDOW as f64 {
            return None;
        }

        let [left, right] = self.values.map(|sum| sum / self.count);
        let spread = |side: usize, mean: f64| (self.squares[side] / self.count - mean * mean).max(0.0).sqrt();
        let (left_spread, right_spread) = (spread(0, left), spread(1, right));
        let log_brightest = math::ln(right + ABOVE_MEAN * right_spread);
        let log = math::ln(right);
        Some(WindowPair { left, right, left_spread, right_spread, log, log_brightest })
    }
}

impl WindowPair {
    /// The left mean that a fit predicts, and its tolerance, which is large if there is an edge in the
    /// window.
    fn expected(&self, gain: f64, gamma: f64) -> (f64, f64) {
        let power = gain * math::exp(gamma * self.log);
        // The mean of a power differs from the power of the mean; this is right to the second order in the
        // spread.
        let relative = self.right_spread / self.right;
        let mean = power * (1.0 + gamma * (gamma - 1.0) / 2.0 * (relative * relative).min(0.5));

        let spread = (gamma * power * relative).min(self.left_spread);
        (mean, TOLERANCE * TOLERANCE + UNEVEN * spread * spread)
    }

    /// Whether the window is not clipped, according to a fit.
    fn is_below_top(&self, gain: f64, gamma: f64) -> bool {
        gain * math::exp(gamma * self.log_brightest) < FITTED_TOP
    }
}

/// Gain and gamma.
fn fitted(windows: &[WindowPair]) -> (f64, f64) {
    let of = |value: fn(&WindowPair) -> f64| median(windows.iter().map(value)).unwrap_or(1.0);
    let (mut gain, mut gamma) = (of(|window| window.left) / of(|window| window.right), 1.0);

    for step in 0..STEPS.0 {
        let is_settled = step >= STEPS.1;
        let is_used = |window: &&WindowPair| !is_settled || window.is_below_top(gain, gamma);
        let mut used: Vec<&WindowPair> = windows.iter().filter(is_used).collect();
        if used.len() < LEAST_WINDOWS {
            used = windows.iter().collect();
        }

        let change = change(&used, (gain, gamma), is_settled);
        gain *= math::exp(change[0]);
        gamma = (gamma + change[1]).clamp(GAMMAS[0], GAMMAS[1]);
        if is_settled && change.iter().all(|value| value.abs() < SETTLED) {
            break;
        }
    }

    (gain, gamma)
}

/// A step of Gauss-Newton: the changes of the logarithm of the gain, and of gamma.
fn change(windows: &[&WindowPair], (gain, gamma): (f64, f64), is_settled: bool) -> [f64; 2] {
    let fits: Vec<(f64, f64)> = windows.iter().map(|window| window.expected(gain, gamma)).collect();
    let scaled = |(window, (mean, variance)): (&&WindowPair, &(f64, f64))| {
        (window.left - mean).abs() / variance.sqrt()
    };
    let scaled: Vec<f64> = windows.iter().zip(&fits).map(scaled).collect();
    let scale = deviation(scaled.iter().copied()) + 0.3;

    // The normal equations of the derivatives by the logarithm of the gain and by gamma.
    let mut normal = Normal::new(2);
    for ((window, (mean, variance)), scaled) in windows.iter().zip(&fits).zip(scaled) {
        let weight = robust_weight(scaled, scale, is_settled) / variance;
        normal.add(&[*mean, mean * window.log], window.left - mean, weight);
    }

    if is_settled {
        let strength = OVERLAP * (scale / PRIOR).powi(2);
        normal.add(&[0.0, 1.0], 1.0 - gamma, strength);
    }

    // A tiny ridge: windows may be equally bright.
    let ridge = 1e-9 * (normal.matrix[0][0] + normal.matrix[1][1]) + f64::MIN_POSITIVE;
    normal.matrix[0][0] += ridge;
    normal.matrix[1][1] += ridge;
    // Short steps: the model is far from linear.
    normal.solved().unwrap_or_default().map(|value| value.clamp(-LONGEST, LONGEST))
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::base::plane::Plane;

    const WHOLE: LightScale = LightScale { black: 0.0, width: 1.0, unit: 1.0 };

    /// Grays from 0.05 to 0.9 in squares of 16 pixels.
    fn gray(y: usize, x: usize) -> f64 {
        let hash = ((y / 16 * 31 + x / 16) as u32).wrapping_mul(2_654_435_761) >> 16;
        0.05 + 0.85 * f64::from(hash) / 65536.0
    }

    /// The contrast of a pair whose left image is a function of the place and of its gray value.
    fn found(
        left: impl Fn(usize, usize, f64) -> f64,
        disparity: &dyn Fn(usize, usize) -> f32,
    ) -> Option<Contrast> {
        let plane = |value: &dyn Fn(usize, usize) -> f64| Plane::from_fn(160, 220, |y, x| value(y, x) as f32);
        let planes = [plane(&|y, x| left(y, x, gray(y, x))), plane(&|y, x| gray(y, x + 10))];
        let disparity = Plane::from_fn(160, 220, disparity);
        let rough =
            RoughMap { unsure: disparity.clone(), disparity, run: None, field: None, confidence: 1.0 };

        let overview = Overview::of_planes(planes);
        Contrast::new(&overview, &rough, &[WHOLE; 2])
    }

    #[test]
    fn gain_and_gamma_are_found_back() {
        for (gain, gamma) in [(0.4, 1.0), (1.0, 0.5), (1.0, 2.0), (0.4, 0.5), (1.5, 1.0)] {
            let power = |gray: f64| gain * math::exp(gamma * math::ln(gray));
            let clipped = |_, _, gray| f64::min(power(gray), 1.0);

            // Scattered errors, and a part where nothing is known.
            let disparity = |y: usize, x: usize| match (y, (7 * x + 13 * y) % 11) {
                (0..40, _) => f32::NAN,
                (_, 0) => -30.0,
                _ => 10.0,
            };
            let contrast = found(clipped, &disparity).expect("enough corresponds");
            let ends = contrast.ends[0] / contrast.ends[1];
            assert!(if gamma < 1.0 { ends > 1.1 } else { ends < 1.05 }, "{gain} {gamma} {contrast:?}");
            assert!((contrast.gain / gain - 1.0).abs() < 0.05, "{gain} {gamma} {contrast:?}");
            assert!((contrast.gamma / gamma - 1.0).abs() < 0.05, "{gain} {gamma} {contrast:?}");
        }
    }

    #[test]
    fn too_little_tells_nothing() {
        assert!(found(|_, _, gray| gray, &|_, _| f32::NAN).is_none(), "nothing corresponds");
        assert!(found(|_, _, _| 1.0, &|_, _| 10.0).is_none(), "clipped");
    }
}

//! Integer tables of the local Fourier transform.
//!
//! The descriptor is *defined* on these integers, rounding included. Tables of non-zero frequencies sum
//! to zero exactly, so a constant added to an image changes nothing, not even on ties.
//!
//! The uniform window slides: its table is indexed by the absolute coordinate modulo `L`, a sum over any
//! `L` neighbours is then one period whatever pixel it starts at, and one rotation at the end moves the
//! transform's origin to the centre pixel. Tapered windows do not slide; their tables are indexed by the
//! offset from the centre and their rotation is the identity.

use std::f64::consts::TAU;

use crate::settings::{Settings, Taper};

/// Amplitude of the tables, as a power of two. Sums of 26-bit pixels over 63 x 63 with two tables then
/// fit in 62 bits, and a tap is within 2^-12 of the exact value (2^-13 by rounding, the rest by balancing).
const AMPLITUDE_LOG2: u32 = 12;

/// A complex number in integers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Complex {
    /// Real part.
    pub re: i64,
    /// Imaginary part.
    pub im: i64,
}

impl Complex {
    /// The complex conjugate.
    pub fn conj(self) -> Self {
        Self { im: -self.im, ..self }
    }

    /// This sum with `factor * value` added.
    pub fn plus(self, factor: Self, value: i64) -> Self {
        Self { re: self.re + factor.re * value, im: self.im + factor.im * value }
    }

    /// The exact product.
    pub fn times(self, other: Self) -> (i128, i128) {
        let (a, b) = (i128::from(self.re), i128::from(self.im));
        let (c, d) = (i128::from(other.re), i128::from(other.im));
        (a * c - b * d, a * d + b * c)
    }
}

/// One spectral component of the descriptor: its frequency indices along x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Component {
    /// Index along x, `0..=r`.
    pub u: usize,
    /// Index along y, `-s..=s`.
    pub v: isize,
}

/// Everything about the transform that does not depend on the image.
#[derive(Debug, Clone)]
pub struct Basis {
    size: usize,
    slides: bool,
    components: Vec<Component>,
    filters: Vec<Vec<Complex>>,
    rotations: Vec<Complex>,
}

impl Basis {
    /// Tables for checked settings.
    pub fn new(settings: &Settings) -> Self {
        let (size, (r, s)) = (settings.neighborhood, settings.frequencies);
        let slides = settings.taper == Taper::Uniform;
        let filter = |f| if slides { wave(size, f) } else { tapered(settings.taper, size, f) };
        let identity = vec![Complex { re: 1, im: 0 }; size];
        Self {
            size,
            slides,
            components: components(r, s),
            filters: (0..=r.max(s)).map(filter).collect(),
            rotations: if slides { rotations(size) } else { identity },
        }
    }

    /// Side of the neighbourhood, `L`.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Pixels from the centre of the neighbourhood to its side.
    pub fn radius(&self) -> usize {
        self.size / 2
    }

    /// Whether filters are indexed by the absolute coordinate, so that sums can slide.
    pub fn slides(&self) -> bool {
        self.slides
    }

    /// The components in the order of the paper: `u = 0` first, `v` innermost.
    pub fn components(&self) -> &[Component] {
        &self.components
    }

    /// Highest frequency index along x.
    pub fn highest_u(&self) -> usize {
        self.components.iter().map(|c| c.u).max().unwrap_or(0)
    }

    /// The factor of frequency index `f` (negative: the conjugate) at `coordinate`, which lies `offset`
    /// pixels from the centre.
    pub fn filter(&self, f: isize, coordinate: isize, offset: isize) -> Complex {
        let place = if self.slides {
            coordinate.rem_euclid(self.size as isize)
        } else {
            offset + self.radius() as isize
        };
        let value = self.filters[f.unsigned_abs()][place as usize];
        if f < 0 { value.conj() } else { value }
    }

    /// The factors that move the origin to the centre pixel, by `(u x + v y)` modulo `L`.
    pub fn rotations(&self) -> &[Complex] {
        &self.rotations
    }

    /// Index into [`Self::rotations`] of `component` at pixel `(x, y)`.
    pub fn rotation_index(&self, component: Component, x: usize, y: usize) -> usize {
        let cycles = (component.u * x) as isize + component.v * y as isize;
        cycles.rem_euclid(self.size as isize) as usize
    }
}

/// Half of the conjugate-symmetric spectrum: `u = 0` with `v = 1..=s`, then `u = 1..=r` with all `v`.
fn components(r: usize, s: usize) -> Vec<Component> {
    let s = s as isize;
    let axis = (1..=s).map(|v| Component { u: 0, v });
    let rest = (1..=r).flat_map(|u| (-s..=s).map(move |v| Component { u, v }));
    axis.chain(rest).collect()
}

/// `exp(-2 pi i f m / L)` for `m = 0..L`; frequency 0 is plainly 1.
fn wave(size: usize, f: usize) -> Vec<Complex> {
    if f == 0 {
        return vec![Complex { re: 1, im: 0 }; size];
    }
    // Frequencies that share a divisor with L run through a shorter cycle, which must sum to zero itself.
    let divisor = greatest_common_divisor(f, size);
    let (period, step) = (size / divisor, f / divisor);
    let angle = |m: usize| TAU * m as f64 / period as f64;
    let cosines: Vec<f64> = (0..=period / 2).map(|m| amplitude() * angle(m).cos()).collect();
    let cosines = rounded_to_zero_sum(&cosines);
    let at = |m: usize| Complex {
        re: cosines[m.min(period - m)],
        im: -(amplitude() * angle(m).sin()).round() as i64,
    };
    (0..size).map(|m| at(m * step % period)).collect()
}

/// `exp(+2 pi i m / L)`.
fn rotations(size: usize) -> Vec<Complex> {
    let angle = |m: usize| TAU * m as f64 / size as f64;
    let rounded = |value: f64| (amplitude() * value).round() as i64;
    (0..size)
        .map(|m| Complex { re: rounded(angle(m).cos()), im: rounded(angle(m).sin()) })
        .collect()
}

/// `w(j) (exp(-2 pi i f j / L) - kappa)` for `j = -h..=h`, `kappa` such that a constant gives zero (the
/// correction that makes Morlet wavelets admissible); frequency 0 is the window `w` itself.
fn tapered(taper: Taper, size: usize, f: usize) -> Vec<Complex> {
    let radius = size / 2;
    let window: Vec<f64> = (0..=radius).map(|j| weight(taper, size, j)).collect();
    let angle = |j: usize| TAU * (f * j) as f64 / size as f64;
    let both_sides =
        |value: &dyn Fn(usize) -> f64| value(0) + 2.0 * (1..=radius).map(value).sum::<f64>();
    let kappa = both_sides(&|j| window[j] * angle(j).cos()) / both_sides(&|j| window[j]);
    let real =
        |j: usize| amplitude() * window[j] * if f == 0 { 1.0 } else { angle(j).cos() - kappa };
    let exact: Vec<f64> = (0..=radius).map(real).collect();
    let cosines = if f == 0 {
        exact.iter().map(|v| v.round() as i64).collect()
    } else {
        rounded_to_zero_sum(&exact)
    };
    let imaginary = |j: usize| (amplitude() * window[j] * angle(j).sin()).round() as i64;
    let left = (1..=radius).rev().map(|j| Complex { re: cosines[j], im: imaginary(j) });
    let right = (0..=radius).map(|j| Complex { re: cosines[j], im: -imaginary(j) });
    left.chain(right).collect()
}

/// The window's weight `j` pixels from its centre, where it is 1.
fn weight(taper: Taper, size: usize, j: usize) -> f64 {
    let offset = j as f64;
    match taper {
        Taper::Uniform => 1.0,
        Taper::Gaussian => (-0.5 * (offset / ((size - 1) as f64 / 4.0)).powi(2)).exp(),
        Taper::Hann => 0.5 * (1.0 + (TAU * offset / (size + 1) as f64).cos()),
    }
}

fn amplitude() -> f64 {
    f64::from(1u32 << AMPLITUDE_LOG2)
}

/// Rounds one half of a symmetric filter, its centre first, so that the whole filter sums to zero: the
/// taps that rounding had moved furthest to the wrong side are moved back by one.
fn rounded_to_zero_sum(exact: &[f64]) -> Vec<i64> {
    let mut rounded: Vec<i64> = exact.iter().map(|value| value.round() as i64).collect();
    // The centre counts once and all others twice: only an even centre can be balanced.
    if rounded[0] % 2 != 0 {
        rounded[0] += if exact[0] > rounded[0] as f64 { 1 } else { -1 };
    }
    let excess = rounded[0] / 2 + rounded[1..].iter().sum::<i64>();
    let gain = |k: usize| (rounded[k] as f64 - exact[k]) * excess as f64;
    let mut order: Vec<usize> = (1..exact.len()).collect();
    order.sort_by(|&a, &b| gain(b).total_cmp(&gain(a)));
    for &k in order.iter().cycle().take(excess.unsigned_abs() as usize) {
        rounded[k] -= excess.signum();
    }
    rounded
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::LARGEST_WINDOW;

    const TAPERS: [Taper; 3] = [Taper::Uniform, Taper::Gaussian, Taper::Hann];

    fn every_basis() -> impl Iterator<Item = (Taper, usize, Basis)> {
        let sizes = (3..=LARGEST_WINDOW).step_by(2);
        TAPERS.into_iter().flat_map(move |taper| sizes.clone().map(move |size| (taper, size))).map(
            |(taper, size)| {
                let highest = 4.min((size - 1) / 2);
                let settings = Settings {
                    taper,
                    neighborhood: size,
                    frequencies: (highest, highest),
                    bits: 1,
                    ..Settings::default()
                };
                (taper, size, Basis::new(&settings))
            },
        )
    }

    #[test]
    fn filters_of_non_zero_frequency_sum_to_zero() {
        for (taper, size, basis) in every_basis() {
            for filter in &basis.filters[1..] {
                let sum = filter.iter().fold((0, 0), |(re, im), c| (re + c.re, im + c.im));
                assert_eq!(sum, (0, 0), "{taper:?} {size}");
            }
        }
    }

    #[test]
    fn uniform_filters_are_within_a_step_of_the_exact_wave() {
        for (_, size, basis) in every_basis().filter(|(taper, ..)| *taper == Taper::Uniform) {
            for (f, filter) in basis.filters.iter().enumerate().skip(1) {
                for (m, c) in filter.iter().enumerate() {
                    let angle = TAU * (f * m) as f64 / size as f64;
                    let error = (c.re as f64 - amplitude() * angle.cos())
                        .hypot(c.im as f64 + amplitude() * angle.sin());
                    assert!(error < 0.75, "L = {size}, f = {f}, m = {m}: {error}");
                }
            }
        }
    }

    #[test]
    fn tapered_filters_are_within_a_step_of_the_exact_ones() {
        for (taper, size, basis) in every_basis().filter(|(taper, ..)| *taper != Taper::Uniform) {
            let radius = (size / 2) as isize;
            let weights: Vec<f64> =
                (-radius..=radius).map(|j| weight(taper, size, j.unsigned_abs())).collect();
            for (f, filter) in basis.filters.iter().enumerate().skip(1) {
                let angle = |j: usize| TAU * f as f64 * (j as f64 - radius as f64) / size as f64;
                let total: f64 = weights.iter().sum();
                let kappa = (0..size).map(|j| weights[j] * angle(j).cos()).sum::<f64>() / total;
                for (j, c) in filter.iter().enumerate() {
                    let scale = amplitude() * weights[j];
                    let error = (c.re as f64 - scale * (angle(j).cos() - kappa))
                        .hypot(c.im as f64 + scale * angle(j).sin());
                    assert!(error < 1.01, "{taper:?}, L = {size}, f = {f}, j = {j}: {error}");
                }
            }
        }
    }

    #[test]
    fn components_follow_the_paper() {
        let order: Vec<_> = components(2, 1).iter().map(|c| (c.u, c.v)).collect();
        assert_eq!(order, [(0, 1), (1, -1), (1, 0), (1, 1), (2, -1), (2, 0), (2, 1)]);
        assert_eq!(components(4, 4).len(), 40);
        assert_eq!(components(0, 2).len(), 2);
    }

    #[test]
    fn tapers_fall_from_one_at_the_centre() {
        for (taper, size, basis) in every_basis().filter(|(taper, ..)| *taper != Taper::Uniform) {
            let window = &basis.filters[0];
            assert_eq!(window[size / 2].re, 1 << AMPLITUDE_LOG2);
            assert!((1..=size / 2).all(|j| window[j - 1].re <= window[j].re), "{taper:?} {size}");
        }
    }
}

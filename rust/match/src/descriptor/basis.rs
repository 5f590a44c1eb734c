//! Integer tables of the local Fourier transform.
//!
//! The descriptor is *defined* on these integers, rounding included. Tables of non-zero frequencies sum to
//! exactly zero, so a constant added to an image changes nothing, not even in ties. All are centered at the
//! pixel: the real part is even and the imaginary part odd, so one half is enough.

use std::f64::consts::TAU;

use crate::base::math;
use crate::settings::{Settings, Taper};

/// Amplitude of the tables times `L`. Sums of 8-bit pixels in sixteenths of a gray level, as in luminances
/// and smoothed images, then fit in 32 bits for every `L` (the square of this, times 2^11), and sums of any
/// pixels are exact in double precision. A tap is within one step of its exact value: 1/140 for `L` = 7, an
/// angle within half a degree.
const AMPLITUDE_TIMES_SIZE: usize = 1000;
/// The same for codes that are compared only within an estimate, of images in 128ths of a gray level
/// ([`ROUGH_REACH`]): a tap is within 1/110 for `L` = 3.
const ROUGH_AMPLITUDE_TIMES_SIZE: usize = 350;
/// Largest gray value for which sums with those tables fit in 32 bits.
pub const ROUGH_REACH: u32 = 1 << 14;

/// One spectral component of the descriptor: its frequency indices along x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Component {
    /// Index along x, `0..=r`.
    pub u: usize,
    /// Index along y, `-s..=s`.
    pub v: isize,
}

/// The taps `even[|j|] + i sgn(j) odd[|j|]`, `j` pixels from the center.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BasisFilter {
    /// Real parts, from the center outward.
    pub even: Vec<i32>,
    /// Imaginary parts on the side of increasing coordinates, from the center (0) outward.
    pub odd: Vec<i32>,
}

/// Everything about the transform that does not depend on the image.
#[derive(Debug, Clone)]
pub struct Basis {
    size: usize,
    frequencies: (usize, usize),
    filters: Vec<BasisFilter>,
}

impl Basis {
    /// Tables for checked settings.
    pub fn new(settings: &Settings) -> Self {
        Self::of(settings, AMPLITUDE_TIMES_SIZE)
    }

    /// Tables for which sums of gray values up to [`ROUGH_REACH`] fit in 32 bits.
    pub fn rough(settings: &Settings) -> Self {
        Self::of(settings, ROUGH_AMPLITUDE_TIMES_SIZE)
    }

    fn of(settings: &Settings, amplitude_times_size: usize) -> Self {
        let size = settings.neighborhood;
        let (r, s) = settings.frequencies;
        let scale = amplitude(size, amplitude_times_size);
        let filters = (0..=r.max(s)).map(|f| filter(settings.taper, size, scale, f)).collect();

        Self { size, frequencies: (r, s), filters }
    }

    /// Pixels from the center of the neighborhood to its side.
    pub fn radius(&self) -> usize {
        self.size / 2
    }

    /// Highest frequency indices `(r, s)` along x and y.
    pub fn frequencies(&self) -> (usize, usize) {
        self.frequencies
    }

    /// The components in the order of the paper: `u = 0` with `v = 1..=s`, half of a conjugate-symmetric
    /// row of the spectrum; then `u = 1..=r` with all `v`.
    pub fn components(&self) -> Vec<Component> {
        let (r, s) = (self.frequencies.0, self.frequencies.1 as isize);
        let axis = (1..=s).map(|v| Component { u: 0, v });
        let rest = (1..=r).flat_map(|u| (-s..=s).map(move |v| Component { u, v }));
        axis.chain(rest).collect()
    }

    /// The filters by frequency index; index 0 is the window itself.
    pub fn filters(&self) -> &[BasisFilter] {
        &self.filters
    }

    /// Standard deviation of the real or imaginary part of a component for white noise of standard deviation
    /// 1: the energy of the window, half of which belongs to cosines and half to sines.
    pub fn deviation(&self) -> f64 {
        let window = self.filters[0].even.iter().map(|tap| f64::from(*tap).powi(2));
        let side: f64 = window.clone().skip(1).sum();
        (window.take(1).sum::<f64>() + 2.0 * side) / f64::sqrt(2.0)
    }

    /// The largest component, and the largest intermediate sum, in multiples of the largest pixel.
    pub fn gain(&self) -> u64 {
        let largest = self.filters.iter().map(BasisFilter::total).fold(0.0, f64::max);
        largest.powi(2).ceil() as u64
    }
}

impl BasisFilter {
    /// The sum of the magnitudes of all taps.
    fn total(&self) -> f64 {
        let side = self.even[1..].iter().zip(&self.odd[1..]);
        let side = side.map(|(even, odd)| math::hypot(f64::from(*even), f64::from(*odd)));
        f64::from(self.even[0]).abs() + 2.0 * side.sum::<f64>()
    }
}

/// The amplitude of the tables: an even number, as the center of a table that sums to zero must be.
fn amplitude(size: usize, times_size: usize) -> usize {
    times_size / size / 2 * 2
}

/// `w(j) (exp(-2 pi i f j / L) - kappa)`, with `kappa` such that the taps sum to zero: the correction that
/// makes Morlet wavelets admissible; the uniform window does not need it. Frequency 0 is the window `w`
/// itself.
fn filter(taper: Taper, size: usize, scale: usize, f: usize) -> BasisFilter {
    let radius = size / 2;
    let scale = scale as f64;
    let window: Vec<f64> = (0..=radius).map(|j| weight(taper, size, j)).collect();
    let angle = |j: usize| TAU * (f * j) as f64 / size as f64;

    let both_sides = |value: &dyn Fn(usize) -> f64| value(0) + 2.0 * (1..=radius).map(value).sum::<f64>();
    let kappa = both_sides(&|j| window[j] * math::cos(angle(j))) / both_sides(&|j| window[j]);

    let real = |j: usize| scale * window[j] * if f == 0 { 1.0 } else { math::cos(angle(j)) - kappa };
    let exact: Vec<f64> = (0..=radius).map(real).collect();
    let imaginary = |j: usize| -(scale * window[j] * math::sin(angle(j))).round() as i32;

    BasisFilter {
        even: if f == 0 { rounded(&exact) } else { rounded_to_zero_sum(&exact) },
        odd: (0..=radius).map(imaginary).collect(),
    }
}

/// The window's weight `j` pixels from its center, where it is 1.
fn weight(taper: Taper, size: usize, j: usize) -> f64 {
    let offset = j as f64;
    match taper {
        Taper::Uniform => 1.0,
        Taper::Gaussian => math::exp(-0.5 * (offset / ((size - 1) as f64 / 4.0)).powi(2)),
        Taper::Hann => 0.5 * (1.0 + math::cos(TAU * offset / (size + 1) as f64)),
    }
}

/// Rounds every value.
fn rounded(exact: &[f64]) -> Vec<i32> {
    exact.iter().map(|value| value.round() as i32).collect()
}

/// Rounds one half of a symmetric filter, its center first, so that the whole filter sums to zero: the taps
/// that rounding moved furthest in the direction of the excess are moved back by one.
fn rounded_to_zero_sum(exact: &[f64]) -> Vec<i32> {
    let mut rounded = rounded(exact);
    // The center counts once and all others twice: only an even center can be balanced.
    if rounded[0] % 2 != 0 {
        rounded[0] += if exact[0] > f64::from(rounded[0]) { 1 } else { -1 };
    }

    // Half the sum of the whole filter.
    let excess = rounded[0] / 2 + rounded[1..].iter().sum::<i32>();

    let gain = |k: usize| (f64::from(rounded[k]) - exact[k]) * f64::from(excess);
    let mut order: Vec<usize> = (1..exact.len()).collect();
    order.sort_by(|&a, &b| gain(b).total_cmp(&gain(a)));

    for &k in order.iter().cycle().take(excess.unsigned_abs() as usize) {
        rounded[k] -= excess.signum();
    }

    rounded
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::LARGEST_WINDOW;
    use crate::settings::presets::Preset;

    const TAPERS: [Taper; 3] = [Taper::Uniform, Taper::Gaussian, Taper::Hann];

    /// All bases by taper, size, and the largest gray value for which sums fit in 32 bits.
    fn every_basis() -> impl Iterator<Item = (Taper, usize, u64, Basis)> {
        let sizes = (3..=LARGEST_WINDOW).step_by(2);
        let all = TAPERS.into_iter().flat_map(move |taper| sizes.clone().map(move |size| (taper, size)));

        all.flat_map(|(taper, neighborhood)| {
            let highest = 4.min((neighborhood - 1) / 2);
            let frequencies = (highest, highest);
            let settings = Settings { taper, neighborhood, frequencies, bits: 1, ..Preset::Paper.settings() };
            [(128 << 4, Basis::new(&settings)), (ROUGH_REACH.into(), Basis::rough(&settings))]
                .map(|(reach, basis)| (taper, neighborhood, reach, basis))
        })
    }

    #[test]
    fn filters_of_non_zero_frequency_sum_to_zero() {
        for (taper, size, _, basis) in every_basis() {
            for filter in &basis.filters[1..] {
                let sum = filter.even[0] + 2 * filter.even[1..].iter().sum::<i32>();
                assert_eq!((sum, filter.odd[0]), (0, 0), "{taper:?} {size}");
            }
        }
    }

    #[test]
    fn filters_are_within_a_step_of_the_exact_ones() {
        for (taper, size, _, basis) in every_basis() {
            let radius = (size / 2) as isize;
            let weight = |j: isize| weight(taper, size, j.unsigned_abs());
            let total: f64 = (-radius..=radius).map(weight).sum();

            for (f, filter) in basis.filters.iter().enumerate().skip(1) {
                let angle = |j: isize| TAU * f as f64 * j as f64 / size as f64;
                let kappa = (-radius..=radius).map(|j| weight(j) * math::cos(angle(j))).sum::<f64>() / total;

                for (j, (even, odd)) in (0..).zip(filter.even.iter().zip(&filter.odd)) {
                    let scale = f64::from(basis.filters[0].even[0]) * weight(j);
                    let error = math::hypot(
                        f64::from(*even) - scale * (math::cos(angle(j)) - kappa),
                        f64::from(*odd) + scale * math::sin(angle(j)),
                    );

                    assert!(error < 1.01, "{taper:?}, L = {size}, f = {f}, j = {j}: {error}");
                }
            }
        }
    }

    #[test]
    fn sums_of_bytes_fit_in_32_bits_and_those_of_any_pixels_in_53() {
        for (taper, size, reach, basis) in every_basis() {
            assert!(reach * basis.gain() < 1 << 31, "{taper:?} {size}");
            assert!(basis.gain() << 25 < 1 << 53, "{taper:?} {size}");
        }
    }

    #[test]
    fn components_follow_the_paper() {
        let order = |frequencies| -> Vec<_> {
            let basis = Basis::new(&Settings { frequencies, neighborhood: 9, ..Preset::Paper.settings() });
            basis.components().iter().map(|c| (c.u, c.v)).collect()
        };

        assert_eq!(order((2, 1)), [(0, 1), (1, -1), (1, 0), (1, 1), (2, -1), (2, 0), (2, 1)]);
        assert_eq!(order((4, 4)).len(), 40);
        assert_eq!(order((0, 2)), [(0, 1), (0, 2)]);
    }

    #[test]
    fn windows_fall_from_the_amplitude_at_the_center() {
        for (taper, size, reach, basis) in every_basis() {
            let window = &basis.filters[0].even;
            // The more bits gray values have, the fewer remain for taps.
            let most = (2f64.powi(31) / reach as f64).sqrt() / size as f64;
            assert!((0.9 * most - 3.0..most).contains(&window[0].into()), "{taper:?} {size} {reach}");
            assert!(window.is_sorted_by(|a, b| a >= b), "{taper:?} {size}");
        }
    }
}

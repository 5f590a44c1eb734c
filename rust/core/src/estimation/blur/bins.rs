//! Bins of the frequency plane, in which powers are averaged and compared.
//!
//! The bins are small at low frequencies, since the zeros of wide kernels lie close together there.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use phasestereo_match::base::math;

/// Side of a block whose spectrum is taken, pixels.
pub const SIDE: usize = 64;
/// Values are processed in groups of this many, so that the compiler vectorizes loops over them.
pub const FLOAT_LANES: usize = 16;
/// A group of values.
pub type FloatLanes = [f32; FLOAT_LANES];

/// Below this frequency, cycles per block, cells are small.
const COARSE_FROM: isize = 16;
/// Below this frequency, cycles per block, the spectrum of the window covers that of the image.
const LOWEST: f64 = 1.2;
/// Up to this frequency, cycles per block, a blur leaves enough power to estimate the gain.
const LOW: f64 = 5.0;
/// Above this frequency, cycles per block, there is little but noise, at least in some directions.
const HIGH: f64 = 0.35 * SIDE as f64;
/// Directions in which the noise is measured.
const SECTORS: usize = 8;

/// Directions in which a quick comparison checks the blur.
pub const DIRECTIONS: usize = 4;

/// Bins of half the frequency plane (the other half mirrors it), by increasing frequency.
#[derive(Debug)]
pub struct Bins {
    /// The coefficients in each bin, at `kx * SIDE / 2 + ky`.
    members: Vec<Vec<u16>>,
    /// The weight of each bin: one over the frequency, so that every octave counts as much as its area in one
    /// dimension; sum 1.
    pub weights: Vec<f32>,
    /// The weight of each bin in the gain: equal at low frequencies, else 0; sum 1.
    pub low: Vec<f32>,
    /// The weight of each bin in its own direction, 0 in the others; sum 1 for each direction.
    pub directions: [Vec<f32>; DIRECTIONS],
    /// The coefficients of high frequency by direction.
    sectors: [Vec<u16>; SECTORS],
}

/// The bins, which are computed once.
pub fn bins() -> &'static Bins {
    static BINS: OnceLock<Bins> = OnceLock::new();
    BINS.get_or_init(Bins::new)
}

impl Bins {
    fn new() -> Self {
        // Cells of 2 x 2 coefficients at low frequencies, of 4 x 4 at others.
        let mut cells: BTreeMap<(isize, isize, isize), Vec<usize>> = BTreeMap::new();
        for place in 0..SIDE * SIDE / 2 {
            let (kx, ky) = wave(place);
            let fine = ky < COARSE_FROM && (-COARSE_FROM..COARSE_FROM - 1).contains(&kx);
            let size = if fine { 2 } else { 4 };
            cells.entry((size, ky / size, (kx + 1).div_euclid(size))).or_default().push(place);
        }

        let mut cells: Vec<Vec<usize>> = cells.into_values().collect();
        // The bits of positive numbers sort like the numbers.
        cells.sort_by_cached_key(|cell| mean_frequency(cell).to_bits());
        // Empty bins at the end fill the last group.
        let count = cells.len().next_multiple_of(FLOAT_LANES);

        let mut bins = Self {
            members: vec![vec![]; count],
            weights: vec![0.0; count],
            low: vec![0.0; count],
            directions: std::array::from_fn(|_| vec![0.0; count]),
            sectors: Default::default(),
        };

        for (index, cell) in cells.iter().enumerate() {
            bins.members[index] = cell.iter().map(|place| *place as u16).collect();
            // The lowest frequencies have no weight, but their bins are kept.
            let counted = cell.iter().map(|place| frequency(*place)).filter(|f| *f > LOWEST);
            bins.weights[index] = counted.map(|f| 1.0 / f).sum::<f64>() as f32;
            bins.directions[sector(cell[0], DIRECTIONS)][index] = bins.weights[index];

            let is_low = (LOWEST..LOW).contains(&mean_frequency(cell));
            bins.low[index] = if is_low { 1.0 } else { 0.0 };
        }

        normalize(&mut bins.weights);
        normalize(&mut bins.low);
        bins.directions.iter_mut().for_each(|weights| normalize(weights));

        let above = |place: &usize| wave(*place).1 > 0 && frequency(*place) > HIGH;
        for place in (0..SIDE * SIDE / 2).filter(above) {
            bins.sectors[sector(place, SECTORS)].push(place as u16);
        }

        bins
    }

    /// Number of bins, a multiple of [`FLOAT_LANES`]; the last ones may be empty and then have no weight.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    /// The mean of the powers in every bin, from powers at `kx * SIDE / 2 + ky`; 1 in empty bins, whose
    /// logarithm is finite.
    pub fn pooled(&self, powers: &[f32]) -> Vec<f32> {
        let of_bin = |members: &Vec<u16>| if members.is_empty() { 1.0 } else { mean(powers, members) };

        self.members.iter().map(of_bin).collect()
    }

    /// The smallest mean power at high frequencies in any direction: a motion leaves the perpendicular
    /// direction unchanged, so the quietest direction shows the noise.
    pub fn least_high(&self, powers: &[f32]) -> f32 {
        let means = self.sectors.iter().map(|members| mean(powers, members));
        means.fold(f32::INFINITY, f32::min)
    }
}

/// The mean of the powers with these indices.
fn mean(powers: &[f32], members: &[u16]) -> f32 {
    let power = |place: &u16| powers[usize::from(*place)];
    let (fours, rest) = members.as_chunks();

    // Sums of four values each shorten the chain of dependent additions.
    let of_four = |[a, b, c, d]: &[u16; 4]| power(a) + power(b) + (power(c) + power(d));
    let sum = fours.iter().map(of_four).sum::<f32>() + rest.iter().map(power).sum::<f32>();

    sum / members.len() as f32
}

/// The sum of all lanes, by halves: a chain of additions would take as long as everything else.
#[inline(always)]
pub fn total(mut sums: FloatLanes) -> f32 {
    let mut half = FLOAT_LANES / 2;
    while half > 0 {
        for lane in 0..half {
            sums[lane] += sums[lane + half];
        }
        half /= 2;
    }
    sums[0]
}

/// The cycles per block along x and y of coefficient `kx * SIDE / 2 + ky`.
fn wave(place: usize) -> (isize, isize) {
    let kx = (place / (SIDE / 2)) as isize;
    let ky = (place % (SIDE / 2)) as isize;

    // The upper half of the coefficients along x are negative frequencies.
    (if kx < SIDE as isize / 2 { kx } else { kx - SIDE as isize }, ky)
}

fn frequency(place: usize) -> f64 {
    let (kx, ky) = wave(place);
    math::hypot(kx as f64, ky as f64)
}

fn mean_frequency(cell: &[usize]) -> f64 {
    cell.iter().map(|place| frequency(*place)).sum::<f64>() / cell.len() as f64
}

/// The index of the direction of a coefficient, of `count` directions over half a turn.
fn sector(place: usize, count: usize) -> usize {
    let (kx, ky) = wave(place);

    let turns = math::atan2(ky as f64, kx as f64) / std::f64::consts::PI;
    (turns * count as f64).round().rem_euclid(count as f64) as usize
}

fn normalize(values: &mut [f32]) {
    let sum: f32 = values.iter().sum();
    for value in values {
        *value /= sum;
    }
}

/// The natural logarithm of a positive number, to 4e-5. It is the same on every machine, and loops over it
/// are vectorized.
#[inline(always)]
pub fn ln(value: f32) -> f32 {
    let bits = value.max(f32::MIN_POSITIVE).to_bits() as i32;

    // The value is (1 + t) 2^exponent, by its bits.
    let exponent = ((bits >> 23) - 127) as f32;
    let t = f32::from_bits((bits & 0x007f_ffff | 0x3f80_0000) as u32) - 1.0;

    // A polynomial for ln(1 + t) / t, by least squares at Chebyshev nodes.
    let series = 0.041_551_114 * t - 0.157_838_38;
    let series = (series * t + 0.306_561_1) * t - 0.497_030_84;
    (series * t + 0.999_945) * t + exponent * std::f32::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_have_the_sum_one_and_only_low_bins_count_for_the_gain() {
        let bins = bins();
        for weights in [&bins.weights, &bins.low].into_iter().chain(&bins.directions) {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            assert!(weights.iter().all(|weight| *weight >= 0.0));
        }

        let is_low: Vec<bool> = bins.low.iter().map(|weight| *weight > 0.0).collect();
        let first = is_low.iter().position(|low| *low).expect("some are low");

        assert!(is_low[first..].windows(2).all(|pair| pair[0] || !pair[1]), "by rising frequency");
    }

    #[test]
    fn every_coefficient_is_in_one_bin() {
        let mut places = bins().members.concat();
        places.sort_unstable();
        assert!(places.into_iter().map(usize::from).eq(0..SIDE * SIDE / 2));
        assert_eq!(bins().count() % FLOAT_LANES, 0);
    }

    #[test]
    fn bins_are_small_cells_finer_where_frequencies_are_low() {
        for members in &bins().members {
            let waves: Vec<_> = members.iter().map(|place| wave(usize::from(*place))).collect();
            let span = |of: &dyn Fn(&(isize, isize)) -> isize| {
                let values = waves.iter().map(of);

                values.clone().max().unwrap_or(0) - values.min().unwrap_or(0)
            };

            let lowest = waves.iter().map(|(x, y)| x.abs().max(*y)).min().unwrap_or(0);
            let most = if lowest < COARSE_FROM - 2 { 1 } else { 3 };
            assert!(span(&|wave| wave.0) <= most && span(&|wave| wave.1) <= most, "{waves:?}");
        }
    }

    #[test]
    fn pooled_is_the_mean_of_a_bin() {
        let bins = bins();
        let powers: Vec<f32> = (0..SIDE * SIDE / 2).map(|place| (place % 97) as f32).collect();

        for (members, mean) in bins.members.iter().zip(bins.pooled(&powers)) {
            let sum: f32 = members.iter().map(|place| powers[usize::from(*place)]).sum();
            let expected = if members.is_empty() { 1.0 } else { sum / members.len() as f32 };
            assert!((mean - expected).abs() < 1e-4);
        }
    }

    #[test]
    fn noise_is_measured_in_the_quietest_direction() {
        for quiet in 0..SECTORS {
            let power = |place: usize| if sector(place, SECTORS) == quiet { 0.5 } else { 3.0 };
            let powers: Vec<f32> = (0..SIDE * SIDE / 2).map(power).collect();
            assert!((bins().least_high(&powers) - 0.5).abs() < 1e-6);
        }

        let along_x = 30 * SIDE / 2 + 1;
        assert_eq!(wave(along_x), (30, 1));
        assert_eq!((sector(along_x, SECTORS), sector(30, SECTORS)), (0, SECTORS / 2));
    }
}

//! The frequency plane cut into bins, in which powers are compared.
//!
//! Fine where the frequencies are low, since there the zeros of wide kernels lie close together.

use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Side of a block whose spectrum is taken, pixels.
pub const SIDE: usize = 64;
/// Values are grouped by so many, so that loops over bins are vectorised.
pub const LANES: usize = 16;

/// Frequencies from here on are seen in fine cells, cycles per block.
const COARSE_FROM: isize = 16;
/// Below so many cycles per block the window's own spectrum covers everything.
const LOWEST: f64 = 1.2;
/// Up to so many cycles per block a blur leaves enough to tell the gain by.
const LOW: f64 = 5.0;
/// From so many cycles per block on there is little but noise, or at least in some directions.
const HIGH: f64 = 0.35 * SIDE as f64;
/// Directions in which noise is looked for.
const SECTORS: usize = 8;

/// Bins of half the frequency plane (the other half mirrors it), by rising frequency.
#[derive(Debug)]
pub struct Bins {
    /// The bin of coefficient `kx * SIDE + ky`, kx below `SIDE / 2`.
    bin: Vec<u16>,
    /// One over the number of coefficients in each bin.
    share: Vec<f32>,
    /// How much each bin counts: one over the frequency, so that every octave counts as much as its area in
    /// one dimension; sum 1.
    pub weights: Vec<f32>,
    /// How much each bin counts when gains are looked for: only low ones do; sum 1.
    pub low: Vec<f32>,
    /// Coefficients of high frequency by direction.
    sectors: [Vec<usize>; SECTORS],
}

/// The bins; there is but one way to cut the plane.
pub fn bins() -> &'static Bins {
    static BINS: OnceLock<Bins> = OnceLock::new();
    BINS.get_or_init(Bins::new)
}

impl Bins {
    fn new() -> Self {
        let mut cells: BTreeMap<(isize, isize, isize), Vec<usize>> = BTreeMap::new();
        for place in 0..SIDE * SIDE / 2 {
            let (kx, ky) = wave(place);
            let fine = kx < COARSE_FROM && (-COARSE_FROM..COARSE_FROM - 1).contains(&ky);
            let size = if fine { 2 } else { 4 };
            cells.entry((size, kx / size, (ky + 1).div_euclid(size))).or_default().push(place);
        }
        let mut cells: Vec<Vec<usize>> = cells.into_values().collect();
        cells.sort_by(|a, b| mean_frequency(a).total_cmp(&mean_frequency(b)));
        let count = cells.len().next_multiple_of(LANES);
        let mut bins = Self {
            bin: vec![0; SIDE * SIDE / 2],
            share: vec![0.0; count],
            weights: vec![0.0; count],
            low: vec![0.0; count],
            sectors: Default::default(),
        };
        for (index, cell) in cells.iter().enumerate() {
            cell.iter().for_each(|place| bins.bin[*place] = index as u16);
            bins.share[index] = 1.0 / cell.len() as f32;
            let counted = cell.iter().map(|place| frequency(*place)).filter(|f| *f > LOWEST);
            bins.weights[index] = counted.map(|f| 1.0 / f).sum::<f64>() as f32;
            let is_low = (LOWEST..LOW).contains(&mean_frequency(cell));
            bins.low[index] = if is_low { 1.0 } else { 0.0 };
        }
        normalise(&mut bins.weights);
        normalise(&mut bins.low);
        for place in (SIDE..SIDE * SIDE / 2).filter(|place| frequency(*place) > HIGH) {
            bins.sectors[sector(place)].push(place);
        }
        bins
    }

    /// Number of bins, a multiple of [`LANES`]; the last ones may be empty and count for nothing.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    /// The mean in every bin of powers at `kx * SIDE + ky`; 1 in empty ones, which have a logarithm then.
    pub fn pooled(&self, powers: &[f32]) -> Vec<f32> {
        let mut pooled = vec![0.0; self.count()];
        for (bin, power) in self.bin.iter().zip(powers) {
            pooled[usize::from(*bin)] += power;
        }
        for (value, share) in pooled.iter_mut().zip(&self.share) {
            *value = if *share > 0.0 { *value * share } else { 1.0 };
        }
        pooled
    }

    /// The least mean power at high frequencies in any direction: a motion leaves the direction across it as
    /// it was.
    pub fn least_high(&self, powers: &[f32]) -> f32 {
        let mean = |places: &Vec<usize>| {
            places.iter().map(|place| powers[*place]).sum::<f32>() / places.len() as f32
        };
        self.sectors.iter().map(mean).fold(f32::INFINITY, f32::min)
    }
}

/// The cycles per block along x and y of coefficient `kx * SIDE + ky`.
fn wave(place: usize) -> (isize, isize) {
    let (kx, ky) = ((place / SIDE) as isize, (place % SIDE) as isize);
    (kx, if ky < SIDE as isize / 2 { ky } else { ky - SIDE as isize })
}

fn frequency(place: usize) -> f64 {
    let (kx, ky) = wave(place);
    (kx as f64).hypot(ky as f64)
}

fn mean_frequency(cell: &[usize]) -> f64 {
    cell.iter().map(|place| frequency(*place)).sum::<f64>() / cell.len() as f64
}

fn sector(place: usize) -> usize {
    let (kx, ky) = wave(place);
    let turns = (ky as f64).atan2(kx as f64) / std::f64::consts::PI;
    (turns * SECTORS as f64).round().rem_euclid(SECTORS as f64) as usize
}

fn normalise(values: &mut [f32]) {
    let sum: f32 = values.iter().sum();
    values.iter_mut().for_each(|value| *value /= sum);
}

//! The Fourier transform of blocks of one size, sixteen rows or columns at a time: each in a lane.

use std::sync::OnceLock;

use super::bins::{LANES, Lanes, SIDE};
use crate::math;
use crate::simd::{Level, Loop};

/// Coefficients of half a spectrum: those of a real block mirror each other.
pub const HALF: usize = SIDE * SIDE / 2;
/// Groups of lanes in a row of a block.
const GROUPS: usize = SIDE / LANES;

/// A block of complex values.
///
/// Before it is transformed, the value at (y, x) is at `y * SIDE + x`. Then the coefficient at (ky, kx) is at
/// `kx * SIDE / 2 + ky` of the first half, or `kx * SIDE / 2 + ky - SIDE / 2` of the second one.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Real parts.
    pub re: Box<[Lanes; SIDE * GROUPS]>,
    /// Imaginary parts.
    pub im: Box<[Lanes; SIDE * GROUPS]>,
}

/// A block to be transformed, and one to be written to in between.
pub struct Work {
    /// The block.
    pub block: Block,
    between: Block,
}

/// What is transformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Complex values.
    Complex,
    /// Two blocks of real ones, as real and as imaginary parts: the halves become the lower halves of both spectra.
    Pair,
}

impl Default for Block {
    fn default() -> Self {
        let nothing = || Box::new([[0.0; LANES]; SIDE * GROUPS]);
        Self { re: nothing(), im: nothing() }
    }
}

impl Work {
    /// Work on a block of zeros.
    pub fn new() -> Self {
        Self { block: Block::default(), between: Block::default() }
    }

    /// Transforms the block.
    pub fn transform(&mut self, kind: Kind, level: Level) {
        level.run(Transform { work: self, kind });
    }
}

struct Transform<'a> {
    work: &'a mut Work,
    kind: Kind,
}

impl Loop for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (Work { block, between }, turns) = (self.work, turns());
        for group in 0..GROUPS {
            let mut strip = Strip::of_rows(block, group);
            strip.transform(turns);
            match self.kind {
                Kind::Complex => strip.put(between, group),
                Kind::Pair => strip.put_pair(between, group),
            }
        }
        for group in 0..GROUPS {
            let mut strip = Strip::of_columns(between, group);
            strip.transform(turns);
            strip.put_halves(block, group);
        }
    }
}

/// Values to be transformed, in each lane so many.
struct Strip {
    re: [Lanes; SIDE],
    im: [Lanes; SIDE],
}

impl Strip {
    /// Some columns of a block, its rows in the order in which they are transformed.
    #[inline(always)]
    fn of_rows(block: &Block, group: usize) -> Self {
        let mut strip = Self { re: [[0.0; LANES]; SIDE], im: [[0.0; LANES]; SIDE] };
        for place in 0..SIDE {
            let from = reversed(place) * GROUPS + group;
            strip.re[place] = block.re[from];
            strip.im[place] = block.im[from];
        }
        strip
    }

    /// Some rows of a block, likewise.
    #[inline(always)]
    fn of_columns(block: &Block, group: usize) -> Self {
        let mut strip = Self { re: [[0.0; LANES]; SIDE], im: [[0.0; LANES]; SIDE] };
        for lane in 0..LANES {
            let row = (group * LANES + lane) * GROUPS;
            for place in 0..SIDE {
                let from = reversed(place);
                strip.re[place][lane] = block.re[row + from / LANES][from % LANES];
                strip.im[place][lane] = block.im[row + from / LANES][from % LANES];
            }
        }
        strip
    }

    #[inline(always)]
    fn put(&self, block: &mut Block, group: usize) {
        for k in 0..SIDE {
            block.re[k * GROUPS + group] = self.re[k];
            block.im[k * GROUPS + group] = self.im[k];
        }
    }

    /// Puts the lower halves of the spectra of the real and of the imaginary parts, one below the other.
    #[inline(always)]
    fn put_pair(&self, block: &mut Block, group: usize) {
        for k in 0..SIDE / 2 {
            let mirrored = (SIDE - k) % SIDE;
            let (re, im) = (self.re[k], self.im[k]);
            let (other_re, other_im) = (self.re[mirrored], self.im[mirrored]);
            let (one, two) = (k * GROUPS + group, (k + SIDE / 2) * GROUPS + group);
            for lane in 0..LANES {
                block.re[one][lane] = 0.5 * (re[lane] + other_re[lane]);
                block.im[one][lane] = 0.5 * (im[lane] - other_im[lane]);
                block.re[two][lane] = 0.5 * (im[lane] + other_im[lane]);
                block.im[two][lane] = 0.5 * (other_re[lane] - re[lane]);
            }
        }
    }

    #[inline(always)]
    fn put_halves(&self, block: &mut Block, group: usize) {
        let (half, part) = (group / (GROUPS / 2), group % (GROUPS / 2));
        for k in 0..SIDE {
            let place = (half * SIDE + k) * (GROUPS / 2) + part;
            block.re[place] = self.re[k];
            block.im[place] = self.im[k];
        }
    }

    /// Decimation in time: quarters of quarters are put together, from the smallest on.
    #[inline(always)]
    fn transform(&mut self, turns: &Turns) {
        self.join::<1>(turns);
        self.join::<4>(turns);
        self.join::<16>(turns);
    }

    /// Puts the transforms of every four times `PART` values together.
    #[inline(always)]
    fn join<const PART: usize>(&mut self, turns: &Turns) {
        for first in (0..SIDE).step_by(4 * PART) {
            for k in 0..PART {
                let turn = |part: usize| turns[part * k * (SIDE / (4 * PART))];
                let place = |part: usize| first + k + part * PART;
                let (a_re, a_im) = (self.re[place(0)], self.im[place(0)]);
                let (b_re, b_im) = self.turned(place(1), turn(1));
                let (c_re, c_im) = self.turned(place(2), turn(2));
                let (d_re, d_im) = self.turned(place(3), turn(3));
                for lane in 0..LANES {
                    let (even_re, even_im) = (a_re[lane] + c_re[lane], a_im[lane] + c_im[lane]);
                    let (odd_re, odd_im) = (a_re[lane] - c_re[lane], a_im[lane] - c_im[lane]);
                    let (sum_re, sum_im) = (b_re[lane] + d_re[lane], b_im[lane] + d_im[lane]);
                    let (gap_re, gap_im) = (b_re[lane] - d_re[lane], b_im[lane] - d_im[lane]);
                    self.re[place(0)][lane] = even_re + sum_re;
                    self.im[place(0)][lane] = even_im + sum_im;
                    self.re[place(1)][lane] = odd_re + gap_im;
                    self.im[place(1)][lane] = odd_im - gap_re;
                    self.re[place(2)][lane] = even_re - sum_re;
                    self.im[place(2)][lane] = even_im - sum_im;
                    self.re[place(3)][lane] = odd_re - gap_im;
                    self.im[place(3)][lane] = odd_im + gap_re;
                }
            }
        }
    }

    /// The values at a place, multiplied by a number of magnitude 1.
    #[inline(always)]
    fn turned(&self, place: usize, [cosine, sine]: [f32; 2]) -> (Lanes, Lanes) {
        let (mut re, mut im) = (self.re[place], self.im[place]);
        for lane in 0..LANES {
            let (a, b) = (re[lane], im[lane]);
            re[lane] = a * cosine - b * sine;
            im[lane] = a * sine + b * cosine;
        }
        (re, im)
    }
}

/// Cosines and sines of so many parts of a turn back.
type Turns = [[f32; 2]; SIDE];

fn turns() -> &'static Turns {
    static TURNS: OnceLock<Turns> = OnceLock::new();
    TURNS.get_or_init(|| {
        std::array::from_fn(|part| {
            let turn = part as f64 / SIDE as f64 * -std::f64::consts::TAU;
            [math::cos(turn) as f32, math::sin(turn) as f32]
        })
    })
}

/// A place with its digits to the base of 4 the other way round.
#[inline(always)]
const fn reversed(place: usize) -> usize {
    place % 4 * 16 + place / 4 % 4 * 4 + place / 16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values between -1 and 1.
    fn noise(seed: u32) -> Block {
        let mut state = seed;
        let mut block = Block::default();
        let values = block.re.as_flattened_mut().iter_mut().chain(block.im.as_flattened_mut());
        for value in values {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *value = (state >> 8) as f32 / (1 << 23) as f32 - 1.0;
        }
        block
    }

    fn transformed(block: &Block, kind: Kind, level: Level) -> Block {
        let mut work = Work::new();
        work.block = block.clone();
        work.transform(kind, level);
        work.block
    }

    /// By its definition, along one axis after the other: coefficients [ky][kx].
    fn naive(re: &[f32], im: &[f32]) -> Vec<(f64, f64)> {
        let along = |values: &[(f64, f64)]| -> Vec<(f64, f64)> {
            let coefficient = |k: usize| {
                let term = |(n, (re, im)): (usize, &(f64, f64))| {
                    let turn = (k * n % SIDE) as f64 / SIDE as f64 * std::f64::consts::TAU;
                    let (sine, cosine) = math::sin_cos(turn);
                    (re * cosine + im * sine, im * cosine - re * sine)
                };
                let terms = values.iter().enumerate().map(term);
                terms.fold((0.0, 0.0), |sum, term| (sum.0 + term.0, sum.1 + term.1))
            };
            (0..SIDE).map(coefficient).collect()
        };
        let turned = |values: Vec<(f64, f64)>| -> Vec<(f64, f64)> {
            (0..SIDE * SIDE).map(|place| values[place % SIDE * SIDE + place / SIDE]).collect()
        };
        let wide = |(re, im): (&f32, &f32)| (f64::from(*re), f64::from(*im));
        let values: Vec<_> = re.iter().zip(im).map(wide).collect();
        let rows: Vec<_> = values.chunks(SIDE).flat_map(along).collect();
        turned(turned(rows).chunks(SIDE).flat_map(along).collect())
    }

    /// Coefficients have magnitudes of 50 or so.
    const TOLERANCE: f64 = 1e-4;

    #[track_caller]
    fn check(block: &Block, half: usize, at: usize, (re, im): (f64, f64)) {
        let (ky, kx) = (at / SIDE, at % SIDE);
        let place = half * HALF + kx * SIDE / 2 + ky % (SIDE / 2);
        let found = [&block.re, &block.im].map(|part| f64::from(part.as_flattened()[place]));
        let off = math::hypot(found[0] - re, found[1] - im);
        assert!(off < TOLERANCE, "{ky} {kx}: {found:?}, {re} {im}");
    }

    #[test]
    fn coefficients_are_those_of_a_naive_transform() {
        let block = noise(1);
        let found = transformed(&block, Kind::Complex, Level::best());
        let expected = naive(block.re.as_flattened(), block.im.as_flattened());
        for (at, expected) in expected.into_iter().enumerate() {
            check(&found, at / HALF, at, expected);
        }
    }

    #[test]
    fn pairs_of_real_blocks_become_the_halves_of_their_spectra() {
        let block = noise(2);
        let found = transformed(&block, Kind::Pair, Level::best());
        for (half, part) in [&block.re, &block.im].into_iter().enumerate() {
            let expected = naive(part.as_flattened(), &[0.0; SIDE * SIDE]);
            for (at, expected) in expected.into_iter().take(HALF).enumerate() {
                check(&found, half, at, expected);
            }
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let block = noise(3);
        for kind in [Kind::Complex, Kind::Pair] {
            let expected = transformed(&block, kind, Level::best());
            for (name, level) in Level::all() {
                let Some(level) = level else { continue };
                assert_eq!(transformed(&block, kind, level), expected, "{name}");
            }
        }
    }
}

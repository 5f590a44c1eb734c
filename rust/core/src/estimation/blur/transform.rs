//! The Fourier transform of blocks of one size, sixteen rows or columns at a time, each in a lane.

use std::sync::OnceLock;

use super::bins::{FLOAT_LANES, FloatLanes, SIDE};
use phasestereo_match::base::math;
use phasestereo_match::base::simd::{Level, leveled};

/// Coefficients of half a spectrum: the other half of a real block's mirrors it.
pub const HALF: usize = SIDE * SIDE / 2;
/// Groups of lanes in a row of a block.
const GROUPS: usize = SIDE / FLOAT_LANES;

/// A block of complex values.
///
/// Before the transform, the value at (y, x) is at `y * SIDE + x`. After it, the coefficient at (ky, kx) is
/// at `kx * SIDE / 2 + ky` of the first half, or `kx * SIDE / 2 + ky - SIDE / 2` of the second one.
#[derive(Debug, Clone, PartialEq)]
pub struct ComplexBlock {
    /// Real parts.
    pub re: Box<[FloatLanes; SIDE * GROUPS]>,
    /// Imaginary parts.
    pub im: Box<[FloatLanes; SIDE * GROUPS]>,
}

/// A block to transform, and a buffer for the transform along one axis.
pub struct Scratch {
    /// The block.
    pub block: ComplexBlock,
    between: ComplexBlock,
}

/// The content of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Complex values.
    Complex,
    /// Two blocks of real values, as real and as imaginary parts: the transform leaves the lower halves of
    /// both spectra.
    Pair,
}

impl Default for ComplexBlock {
    fn default() -> Self {
        let nothing = || Box::new([[0.0; FLOAT_LANES]; SIDE * GROUPS]);
        Self { re: nothing(), im: nothing() }
    }
}

impl Scratch {
    /// Work on a block of zeros.
    pub fn new() -> Self {
        Self { block: ComplexBlock::default(), between: ComplexBlock::default() }
    }

    /// Transforms the block.
    pub fn transform(&mut self, content: Content, level: Level) {
        transform_block(level, self, content);
    }
}

/// The transform along y, then along x.
#[leveled]
fn transform_block(level: Level, work: &mut Scratch, content: Content) {
    let Scratch { block, between } = work;
    let turns = turns();

    // Each lane holds a column.
    for group in 0..GROUPS {
        let mut strip = Strip::of_rows(block, group);
        strip.transform(turns);
        match content {
            Content::Complex => strip.put(between, group),
            Content::Pair => strip.put_pair(between, group),
        }
    }

    // Each lane holds a row of the coefficients along y.
    for group in 0..GROUPS {
        let mut strip = Strip::of_columns(between, group);
        strip.transform(turns);
        strip.put_halves(block, group);
    }
}

/// Values along one axis, for one column or row per lane.
struct Strip {
    re: [FloatLanes; SIDE],
    im: [FloatLanes; SIDE],
}

impl Strip {
    /// Some columns of a block, their values in digit-reversed order.
    #[inline(always)]
    fn of_rows(block: &ComplexBlock, group: usize) -> Self {
        let mut strip = Self { re: [[0.0; FLOAT_LANES]; SIDE], im: [[0.0; FLOAT_LANES]; SIDE] };

        for place in 0..SIDE {
            let from = reversed(place) * GROUPS + group;
            strip.re[place] = block.re[from];
            strip.im[place] = block.im[from];
        }

        strip
    }

    /// Some rows of a block, their values in digit-reversed order.
    #[inline(always)]
    fn of_columns(block: &ComplexBlock, group: usize) -> Self {
        let mut strip = Self { re: [[0.0; FLOAT_LANES]; SIDE], im: [[0.0; FLOAT_LANES]; SIDE] };

        for lane in 0..FLOAT_LANES {
            let row = (group * FLOAT_LANES + lane) * GROUPS;
            for place in 0..SIDE {
                let from = reversed(place);
                strip.re[place][lane] = block.re[row + from / FLOAT_LANES][from % FLOAT_LANES];
                strip.im[place][lane] = block.im[row + from / FLOAT_LANES][from % FLOAT_LANES];
            }
        }

        strip
    }

    /// Writes all coefficients.
    #[inline(always)]
    fn put(&self, block: &mut ComplexBlock, group: usize) {
        for k in 0..SIDE {
            block.re[k * GROUPS + group] = self.re[k];
            block.im[k * GROUPS + group] = self.im[k];
        }
    }

    /// Writes the lower halves of the spectra of the real and of the imaginary parts, one below the other.
    ///
    /// Of the spectrum F of a + ib, those of the real a and b are (F(k) + conj F(-k)) / 2 and (F(k) - conj
    /// F(-k)) / 2i.
    #[inline(always)]
    fn put_pair(&self, block: &mut ComplexBlock, group: usize) {
        for k in 0..SIDE / 2 {
            let mirrored = (SIDE - k) % SIDE;

            let (re, im) = (self.re[k], self.im[k]);
            let (other_re, other_im) = (self.re[mirrored], self.im[mirrored]);
            let (one, two) = (k * GROUPS + group, (k + SIDE / 2) * GROUPS + group);

            for lane in 0..FLOAT_LANES {
                block.re[one][lane] = 0.5 * (re[lane] + other_re[lane]);
                block.im[one][lane] = 0.5 * (im[lane] - other_im[lane]);
                block.re[two][lane] = 0.5 * (im[lane] + other_im[lane]);
                block.im[two][lane] = 0.5 * (other_re[lane] - re[lane]);
            }
        }
    }

    /// Writes the lower and the upper half of the coefficients along y one after the other, transposed.
    #[inline(always)]
    fn put_halves(&self, block: &mut ComplexBlock, group: usize) {
        let half = group / (GROUPS / 2);
        let part = group % (GROUPS / 2);

        for k in 0..SIDE {
            let place = (half * SIDE + k) * (GROUPS / 2) + part;
            block.re[place] = self.re[k];
            block.im[place] = self.im[k];
        }
    }

    /// Radix-4 decimation in time: three rounds join transforms of 1, 4 and 16 values.
    #[inline(always)]
    fn transform(&mut self, turns: &Turns) {
        self.join::<1>(turns);
        self.join::<4>(turns);
        self.join::<16>(turns);
    }

    /// Joins every four transforms of `PART` values into one.
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

                for lane in 0..FLOAT_LANES {
                    // The four outputs are a + c + (b + d), a - c - i (b - d), a + c - (b + d) and a - c + i
                    // (b - d).
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

    /// The values at a place, multiplied by a twiddle factor.
    #[inline(always)]
    fn turned(&self, place: usize, [cosine, sine]: [f32; 2]) -> (FloatLanes, FloatLanes) {
        let (mut re, mut im) = (self.re[place], self.im[place]);

        for lane in 0..FLOAT_LANES {
            let (a, b) = (re[lane], im[lane]);
            re[lane] = a * cosine - b * sine;
            im[lane] = a * sine + b * cosine;
        }

        (re, im)
    }
}

/// Cosine and sine of the negative of this many parts of a turn: the twiddle factors.
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

/// A place with its three base-4 digits reversed.
#[inline(always)]
const fn reversed(place: usize) -> usize {
    place % 4 * 16 + place / 4 % 4 * 4 + place / 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{levels, random};

    /// Values between -1 and 1.
    fn noise(seed: u32) -> ComplexBlock {
        let mut random = random(seed);
        let mut block = ComplexBlock::default();

        let values = block.re.as_flattened_mut().iter_mut().chain(block.im.as_flattened_mut());
        for value in values {
            *value = random() as f32 / (1 << 23) as f32 - 1.0;
        }

        block
    }

    fn transformed(block: &ComplexBlock, content: Content, level: Level) -> ComplexBlock {
        let mut work = Scratch::new();

        work.block = block.clone();
        work.transform(content, level);

        work.block
    }

    /// By definition, along one axis after the other: coefficients [ky][kx].
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

    /// Coefficients have magnitudes of about 50.
    const TOLERANCE: f64 = 1e-4;

    #[track_caller]
    fn check(block: &ComplexBlock, half: usize, at: usize, (re, im): (f64, f64)) {
        let (ky, kx) = (at / SIDE, at % SIDE);

        let place = half * HALF + kx * SIDE / 2 + ky % (SIDE / 2);
        let found = [&block.re, &block.im].map(|part| f64::from(part.as_flattened()[place]));

        let off = math::hypot(found[0] - re, found[1] - im);
        assert!(off < TOLERANCE, "{ky} {kx}: {found:?}, {re} {im}");
    }

    #[test]
    fn coefficients_are_those_of_a_naive_transform() {
        let block = noise(1);
        let found = transformed(&block, Content::Complex, Level::best());

        let expected = naive(block.re.as_flattened(), block.im.as_flattened());

        for (at, expected) in expected.into_iter().enumerate() {
            check(&found, at / HALF, at, expected);
        }
    }

    #[test]
    fn pairs_of_real_blocks_become_the_halves_of_their_spectra() {
        let block = noise(2);

        let found = transformed(&block, Content::Pair, Level::best());

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
        for content in [Content::Complex, Content::Pair] {
            let expected = transformed(&block, content, Level::best());
            for level in levels() {
                assert_eq!(transformed(&block, content, level), expected, "{}", level.name());
            }
        }
    }
}

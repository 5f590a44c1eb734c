//! Gray values under a point-spread function, in integers: the image that the camera would have recorded with
//! that blur.
//!
//! True convolution, with the kernel flipped, of the image continued by reflection (`d c b a | a b c d`),
//! like `scipy.ndimage.convolve(mode="reflect")`. Sums are exact and rounded once (twice for kernels applied
//! along one axis after the other), so the bits do not depend on bands, threads or instructions.

use std::array::from_fn;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::plane::{Plane, reflect, zeroed};
use crate::base::simd::{Level, leveled};
use crate::image::LARGEST_KERNEL;
use crate::image::gray_scale::FINER_LOG2;
use crate::image::intensity::{Gray, LARGEST_REACH};

/// Binary logarithm of the sum of a kernel's weights: the taps of a disk of radius 10 are then right to 2 %,
/// and gray values below `2^17` still have 32-bit sums.
pub const SHIFT: u32 = 14;
/// Most bits after the point of a result.
pub const MOST_FRACTION: u32 = 8;
/// Further bits kept between the two passes of a separable kernel.
pub const GUARD: u32 = 2;

/// Largest difference of the sum of the taps from 1; they are divided by their sum.
const SUM_TOLERANCE: f64 = 1e-3;
/// Largest difference from an outer product, as a share of the largest tap: 16 roundings of single precision.
const PRODUCT_TOLERANCE: f64 = 1.0 / (1 << 20) as f64;
/// Inverse of the difference below which remainders are ties: taps that should be equal may differ in their
/// last bits.
const TIE_STEPS: f64 = (1 << 20) as f64;

/// Pixels whose sums stay in registers during the loop over taps: four AVX2 registers, or eight for 64-bit
/// sums. With a kernel of 129 taps, this loop alone takes 1.9 ms for 741 x 497 pixels on a Zen 3; with 64
/// pixels 1.7; in single precision 2.3; on 16-bit pixels 2.1.
const BLOCK: usize = 32;

/// A point-spread function in integers: weights of at least 0 with the sum `2^SHIFT`. So no result leaves the
/// range of the image, and a constant image does not change.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kernel(KernelWeights);

/// The weights of a kernel, by offset from their center: sides are odd and as small as possible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KernelWeights {
    /// All weights, applied in one pass.
    All(Plane<i32>),
    /// The factors of an outer product: applied along the columns, then along the rows.
    Factors {
        /// One column.
        column: Plane<i32>,
        /// One row.
        row: Plane<i32>,
    },
}

impl Kernel {
    /// A kernel with odd sides up to [`LARGEST_KERNEL`]; its taps are finite, not negative, with a sum of 1
    /// within 0.001.
    ///
    /// A kernel that is an outer product, to single precision, is applied along the columns and then along
    /// the rows.
    pub fn new(taps: &Plane<f64>) -> Result<Self> {
        let total = check(taps)?;
        let taps = taps.map(|tap| tap / total);
        match factors(&taps) {
            Some([column, row]) => Ok(Self::of_factors(&column, &row)),
            None => Ok(Self(KernelWeights::All(trimmed(&quantized(&taps))))),
        }
    }

    /// The outer product of a column and a row of taps, each as [`Self::new`] accepts them.
    pub fn separable(column: &[f64], row: &[f64]) -> Result<Self> {
        let column = Plane::from_vec(column.len(), 1, column.to_vec())?;
        let row = Plane::from_vec(1, row.len(), row.to_vec())?;
        let totals = [check(&column)?, check(&row)?];

        Ok(Self::of_factors(&column.map(|tap| tap / totals[0]), &row.map(|tap| tap / totals[1])))
    }

    /// Applies one factor after the other. A factor that changes nothing is left out.
    fn of_factors(column: &Plane<f64>, row: &Plane<f64>) -> Self {
        let [column, row] = [column, row].map(|taps| trimmed(&quantized(taps)));
        Self(match [column.rows(), row.cols()] {
            [1, _] => KernelWeights::All(row),
            [_, 1] => KernelWeights::All(column),
            _ => KernelWeights::Factors { column, row },
        })
    }

    /// Rows and columns on either side of a pixel that its sum depends on.
    pub fn radii(&self) -> (usize, usize) {
        let (rows, cols) = match &self.0 {
            KernelWeights::All(weights) => (weights.rows(), weights.cols()),
            KernelWeights::Factors { column, row } => (column.rows(), row.cols()),
        };

        (rows / 2, cols / 2)
    }

    /// The weights.
    pub fn weights(&self) -> &KernelWeights {
        &self.0
    }
}

impl Gray<'_> {
    /// The same image under a kernel, in the finest steps that fit. Masked pixels already have the values of
    /// valid neighbors, so they spread nothing of their own.
    pub fn convolved(&self, kernel: &Kernel, level: Level, control: &Control) -> Result<Gray<'static>> {
        let fits = |bits: &u32| self.reach() << bits <= LARGEST_REACH;
        let bits = (0..=FINER_LOG2).rev().find(fits).unwrap_or(0);

        Ok(self.scaled(self.reach() << bits, convolve(self, kernel, bits, level, control)?))
    }
}

/// The gray values under the kernel, with `fraction` bits after the point: their magnitude is at most the
/// image's reach times `2^fraction`.
///
/// Each sum is rounded to the nearest, half upward. `fraction` is at most [`MOST_FRACTION`], and the reach
/// times `2^(fraction + GUARD)` is below `2^31`: the largest possible reach, `2^25`, leaves 3 bits.
///
/// Sums use 32 bits if the largest possible one fits: for values below `2^17`, which in the second pass of an
/// outer product have `fraction + GUARD` bits after the point. 64 bits take 1.6 to 1.8 times as long.
pub fn convolve(
    gray: &Gray,
    kernel: &Kernel,
    fraction: u32,
    level: Level,
    control: &Control,
) -> Result<Plane<i32>> {
    check_fraction(fraction, gray.reach())?;
    let (first, second) = passes(kernel, fraction, gray);
    let pixels = first.pixels(gray, control)?;

    Plane::by_bands(gray.size(), 1, |y, out| {
        control.checkpoint()?;
        write_row(level, &first, &pixels.as_slice()[y * first.width..], out);

        // The second pass needs only one row, so it follows at once, while the row is in the cache.
        if let Some(pass) = &second {
            let mut row = zeroed(pass.width)?;
            row[pass.columns(out.len())].copy_from_slice(out);
            pass.continue_sides(&mut row, out.len());
            write_row(level, pass, &row, out);
        }

        Ok(())
    })
}

/// The sum of taps; an error if they are invalid.
fn check(taps: &Plane<f64>) -> Result<f64> {
    let (rows, cols) = (taps.rows(), taps.cols());
    if [rows, cols].iter().any(|side| side % 2 == 0 || *side > LARGEST_KERNEL) {
        let accepted = format!("odd sides from 1 to {LARGEST_KERNEL}");
        return Err(Error::value("kernel", format!("{rows} x {cols} taps"), accepted));
    }

    if let Some(tap) = taps.as_slice().iter().find(|tap| !(tap.is_finite() && **tap >= 0.0)) {
        return Err(Error::value("kernel", format!("the tap {tap}"), "finite taps from 0"));
    }

    let total: f64 = taps.as_slice().iter().sum();

    if (total - 1.0).abs() > SUM_TOLERANCE {
        let accepted = format!("a sum of 1 within {SUM_TOLERANCE}");
        return Err(Error::value("kernel", format!("taps of sum {total}"), accepted));
    }

    Ok(total)
}

/// An error unless sums have room for this many bits after the point.
fn check_fraction(fraction: u32, reach: u32) -> Result<()> {
    if fraction <= MOST_FRACTION && i32::try_from(u64::from(reach) << (fraction + GUARD)).is_ok() {
        return Ok(());
    }

    let accepted = format!("up to {MOST_FRACTION} bits, and {GUARD} more, beside the gray values");
    Err(Error::value("fraction", format!("{fraction} for values up to {reach}"), accepted))
}

/// The column and the row whose outer product the taps (of sum 1) are, if they are one: the sums along the
/// other axis.
fn factors(taps: &Plane<f64>) -> Option<[Plane<f64>; 2]> {
    let (rows, cols) = (taps.rows(), taps.cols());
    let column = Plane::from_fn(rows, 1, |y, _| taps.row(y).iter().sum::<f64>());
    let row = Plane::from_fn(1, cols, |_, x| (0..rows).map(|y| taps.row(y)[x]).sum::<f64>());

    let largest = taps.as_slice().iter().copied().fold(0.0, f64::max);
    let missed_by = |y: usize, x: usize| (column.row(y)[0] * row.row(0)[x] - taps.row(y)[x]).abs();
    let is_near = |y: usize, x: usize| missed_by(y, x) <= largest * PRODUCT_TOLERANCE;
    (0..rows).all(|y| (0..cols).all(|x| is_near(y, x))).then_some([column, row])
}

/// Taps of sum 1 as weights of sum `2^SHIFT`: rounded down, except those with the largest remainders, which
/// are rounded up.
///
/// Ties are broken from the center outward, opposite taps one after the other, so that the leftover weights
/// do not shift a disk, whose taps are all alike.
fn quantized(taps: &Plane<f64>) -> Plane<i32> {
    let exact = taps.map(|tap| tap * f64::from(1 << SHIFT));
    let mut weights = exact.map(|tap| *tap as i32);
    let missing = (1 << SHIFT) - weights.as_slice().iter().sum::<i32>();
    let count = exact.as_slice().len();
    let cols = taps.cols();

    let urgency = |i: usize| {
        let remainder = exact.as_slice()[i].fract();
        let (dy, dx) = ((i / cols).abs_diff(taps.rows() / 2), (i % cols).abs_diff(cols / 2));
        let tie = (remainder * TIE_STEPS).round() as i64;
        // `count - 1 - i` is the opposite tap: both have the same third key.
        (-tie, dy * dy + dx * dx, i.min(count - 1 - i), i)
    };

    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_cached_key(|&i| urgency(i));

    for &i in order.iter().take(missing as usize) {
        weights.as_mut_slice()[i] += 1;
    }

    weights
}

/// The same kernel without the outer rows and columns that are zero.
fn trimmed(weights: &Plane<i32>) -> Plane<i32> {
    let center = [weights.rows() / 2, weights.cols() / 2];
    let used = taps(weights).fold([0, 0], |[vertical, horizontal], (y, x, _)| {
        [vertical.max(y.abs_diff(center[0])), horizontal.max(x.abs_diff(center[1]))]
    });

    // The center stays the center: both sides keep the same amount.
    let (rows, cols) = (2 * used[0] + 1, 2 * used[1] + 1);
    let at = |y: usize, x: usize| weights.row(y + center[0] - used[0])[x + center[1] - used[1]];
    Plane::from_fn(rows, cols, at)
}

/// Row, column and value of the weights that are not zero.
fn taps(weights: &Plane<i32>) -> impl Iterator<Item = (usize, usize, i32)> {
    let all = (0..weights.rows()).flat_map(|y| (0..weights.cols()).map(move |x| (y, x)));
    all.map(|(y, x)| (y, x, weights.row(y)[x])).filter(|(.., weight)| *weight != 0)
}

/// One pass of a kernel over the rows of an image with its continuation.
#[derive(Debug)]
struct KernelPass {
    /// Halo: rows above and below, columns on the left and at least that number on the right.
    radii: (usize, usize),
    /// Values from the start of one row to the next.
    width: usize,
    taps: Vec<Tap>,
    /// Bits that are rounded off.
    shift: u32,
    /// Whether 32 bits hold every sum.
    is_narrow: bool,
}

/// A weight, and the offset of its pixel from the first one under the kernel.
#[derive(Debug, Clone, Copy)]
struct Tap {
    offset: usize,
    weight: i32,
}

/// The passes of a kernel over an image.
fn passes(kernel: &Kernel, fraction: u32, gray: &Gray) -> (KernelPass, Option<KernelPass>) {
    let (cols, reach) = (gray.size().1, gray.reach());

    match &kernel.0 {
        KernelWeights::All(weights) => (KernelPass::new(weights, (0, fraction), cols, reach), None),
        KernelWeights::Factors { column, row } => {
            let between = fraction + GUARD;
            let second = KernelPass::new(row, (between, fraction), cols, reach << between);
            (KernelPass::new(column, (0, between), cols, reach), Some(second))
        }
    }
}

impl KernelPass {
    /// A pass over values with `had` bits after the point and magnitude up to `reach`; results have `kept`
    /// bits.
    fn new(weights: &Plane<i32>, (had, kept): (u32, u32), image_cols: usize, reach: u32) -> Self {
        let (rows, cols) = (weights.rows(), weights.cols());
        let width = image_cols.next_multiple_of(BLOCK) + cols - 1;
        // True convolution: the weight right of the center applies to the pixel left of it.
        let tap = |(y, x, weight)| Tap { offset: (rows - 1 - y) * width + cols - 1 - x, weight };

        let shift = SHIFT + had - kept;
        // Weights sum to 2^SHIFT, so no sum exceeds the largest value times that, plus half for rounding.
        let largest = (u64::from(reach) << SHIFT) + (1 << (shift - 1));

        Self {
            radii: (rows / 2, cols / 2),
            width,
            taps: taps(weights).map(tap).collect(),
            shift,
            is_narrow: i32::try_from(largest).is_ok(),
        }
    }

    /// The image continued by reflection on all sides.
    fn pixels(&self, gray: &Gray, control: &Control) -> Result<Plane<i32>> {
        let (rows, cols) = gray.size();
        let above = self.radii.0;

        Plane::by_bands((rows + 2 * above, self.width), 1, |y, row| {
            control.checkpoint()?;
            let from = reflect(y as isize - above as isize, rows);
            row[self.columns(cols)].copy_from_slice(gray.row(from));
            self.continue_sides(row, cols);

            Ok(())
        })
    }

    /// The columns of the image in a row with its continuation.
    fn columns(&self, cols: usize) -> Range<usize> {
        self.radii.1..self.radii.1 + cols
    }

    /// Continues a row of the image by reflection on either side.
    fn continue_sides(&self, row: &mut [i32], cols: usize) {
        let columns = self.columns(cols);
        for x in (0..columns.start).chain(columns.end..row.len()) {
            row[x] = row[columns.start + reflect(x as isize - columns.start as isize, cols)];
        }
    }
}

/// Writes one row of rounded sums, from the first row under the kernel on.
#[leveled]
fn write_row(level: Level, pass: &KernelPass, pixels: &[i32], out: &mut [i32]) {
    let KernelPass { taps, shift, is_narrow, .. } = pass;
    if *is_narrow {
        write_sums::<i32>(taps, *shift, pixels, out);
    } else {
        write_sums::<i64>(taps, *shift, pixels, out);
    }
}

/// Writes rounded sums, block by block.
#[inline(always)]
fn write_sums<S: Accumulator>(taps: &[Tap], shift: u32, pixels: &[i32], out: &mut [i32]) {
    for (start, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        let sums = sums::<S>(taps, shift, &pixels[start..]);
        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// The rounded sums of a block. Values are copied, so that the compiler sees that sums do not overlap them.
#[inline(always)]
fn sums<S: Accumulator>(taps: &[Tap], shift: u32, pixels: &[i32]) -> [i32; BLOCK] {
    let mut sums = [S::half(shift); BLOCK];

    for tap in taps {
        let pixels = &pixels[tap.offset..][..BLOCK];
        let values: [i32; BLOCK] = from_fn(|k| pixels[k]);
        sums = from_fn(|k| sums[k].plus(values[k], tap.weight));
    }

    sums.map(|sum| sum.without(shift))
}

/// A number in which weighted sums are exact.
trait Accumulator: Copy {
    /// Half a unit: with it, rounding down rounds to the nearest.
    fn half(shift: u32) -> Self;
    /// The sum plus a weighted pixel.
    fn plus(self, value: i32, weight: i32) -> Self;
    /// The sum without its lowest bits.
    fn without(self, shift: u32) -> i32;
}

impl Accumulator for i32 {
    #[inline(always)]
    fn half(shift: u32) -> Self {
        1 << (shift - 1)
    }

    #[inline(always)]
    fn plus(self, value: i32, weight: i32) -> Self {
        self.wrapping_add(value.wrapping_mul(weight))
    }

    #[inline(always)]
    fn without(self, shift: u32) -> i32 {
        self >> shift
    }
}

impl Accumulator for i64 {
    #[inline(always)]
    fn half(shift: u32) -> Self {
        1 << (shift - 1)
    }

    #[inline(always)]
    fn plus(self, value: i32, weight: i32) -> Self {
        self.wrapping_add(Self::from(value) * Self::from(weight))
    }

    #[inline(always)]
    fn without(self, shift: u32) -> i32 {
        (self >> shift) as i32
    }
}

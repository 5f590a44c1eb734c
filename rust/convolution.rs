//! Gray values under a point-spread function, in integers: what a blurred image would have been.
//!
//! True convolution, the kernel flipped, of the image continued by reflection (`d c b a | a b c d`), as
//! `scipy.ndimage.convolve(mode="reflect")` has it. Sums are exact and rounded once (twice for kernels that
//! are applied along one axis after the other), so the bits do not depend on bands, threads or instructions.

use std::array::from_fn;
use std::ops::Range;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::intensity::Gray;
use crate::plane::{Plane, reflect, zeroed};
use crate::simd::{self, Level};

/// Weights of a kernel sum to `2^SHIFT`: the taps of a disk of radius 10 are then right to 1 %, and gray
/// values below `2^17` still have sums of 32 bits.
pub const SHIFT: u32 = 14;
/// Largest side of a kernel.
pub const LARGEST_KERNEL: usize = 129;
/// Most bits after the point that can be asked for.
pub const MOST_FRACTION: u32 = 8;
/// Further bits that are kept between the two passes of a separable kernel.
pub const GUARD: u32 = 2;

/// How far from 1 the sum of the taps may be; they are divided by it.
const SUM_TOLERANCE: f64 = 1e-3;
/// Share of the largest tap by which an outer product may be missed: 16 roundings of single precision.
const PRODUCT_TOLERANCE: f64 = 1.0 / (1 << 20) as f64;
/// Remainders closer than its inverse are ties: taps that should be equal may differ in their last bits.
const TIE_STEPS: f64 = (1 << 20) as f64;

/// Rows that one task convolves: it reads as many further ones as the kernel has, less one. Of 16 to 128
/// all are as fast to a few percent.
const BAND_ROWS: usize = 32;
/// Pixels whose sums stay in registers while the taps go by: four registers of AVX2, so that each waits for
/// none of the others.
const BLOCK: usize = 32;

/// A point-spread function in integers: weights from 0 that sum to `2^SHIFT`, so no result leaves the range
/// of the image, and a constant stays what it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kernel {
    passes: Vec<Plane<i32>>,
}

impl Kernel {
    /// A kernel of odd sides up to [`LARGEST_KERNEL`], its taps finite, not negative, of sum 1 within 0.001.
    ///
    /// An outer product, to single precision, is applied along the columns and then along the rows.
    pub fn new(taps: &Plane<f64>) -> Result<Self> {
        let total = check(taps)?;
        let taps = taps.map(|tap| tap / total);
        match factors(&taps) {
            Some([column, row]) => Ok(Self::of_factors(&column, &row)),
            None => Ok(Self { passes: vec![trimmed(&quantised(&taps))] }),
        }
    }

    /// The outer product of a column and a row of taps, for each of which holds what does for [`Self::new`].
    pub fn separable(column: &[f64], row: &[f64]) -> Result<Self> {
        let column = Plane::from_vec(column.len(), 1, column.to_vec())?;
        let row = Plane::from_vec(1, row.len(), row.to_vec())?;
        let totals = [check(&column)?, check(&row)?];
        Ok(Self::of_factors(&column.map(|tap| tap / totals[0]), &row.map(|tap| tap / totals[1])))
    }

    /// A factor that changes nothing is left out.
    fn of_factors(column: &Plane<f64>, row: &Plane<f64>) -> Self {
        let [column, row] = [column, row].map(|taps| trimmed(&quantised(taps)));
        let passes = match [&column, &row].map(|taps| taps.as_slice().len()) {
            [1, _] => vec![row],
            [_, 1] => vec![column],
            _ => vec![column, row],
        };
        Self { passes }
    }

    /// The weights: all of them; or those along the columns and then, applied to what these give, those along
    /// the rows. Sides are odd, and not larger than the weights on them need.
    pub fn passes(&self) -> &[Plane<i32>] {
        &self.passes
    }

    /// Bits after the point of what each pass gives, when so many are wanted in the end.
    pub fn fractions(&self, fraction: u32) -> impl Iterator<Item = u32> {
        let between = self.passes.len() - 1;
        std::iter::repeat_n(fraction + GUARD, between).chain([fraction])
    }
}

/// The gray values under the kernel, with `fraction` bits after the point: values of magnitude up to the
/// image's reach times `2^fraction`.
///
/// `fraction` is at most [`MOST_FRACTION`], and the reach times `2^(fraction + GUARD)` at most `2^31 - 1`: a
/// reach of `2^25`, the largest there is, leaves 3 bits. Each sum is rounded to the nearest, half upwards.
/// Sums have 32 bits if the reach is below `2^17`, or `2^(17 - fraction - GUARD)` in the second pass of a
/// separable kernel, else 64, which takes twice as long.
pub fn convolve(
    gray: &Gray,
    kernel: &Kernel,
    fraction: u32,
    level: Level,
    control: &Control,
) -> Result<Plane<i32>> {
    check_fraction(fraction, gray.reach())?;
    let passes = passes(kernel, fraction, gray);
    Plane::by_bands(gray.size(), BAND_ROWS, |first, band| {
        let band = Band { gray, first, band, level, control };
        match &passes[..] {
            [column, row] => band.convolve_twice(column, row),
            [all] => band.convolve_once(all),
            _ => Ok(()),
        }
    })
}

/// The sum of legal taps.
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

fn check_fraction(fraction: u32, reach: u32) -> Result<()> {
    if fraction <= MOST_FRACTION && i32::try_from(u64::from(reach) << (fraction + GUARD)).is_ok() {
        return Ok(());
    }
    let accepted = format!("up to {MOST_FRACTION} bits, and {GUARD} more, beside the gray values");
    Err(Error::value("fraction", format!("{fraction} for values up to {reach}"), accepted))
}

/// The column and the row that taps of sum 1 are the outer product of, if they are: their sums.
fn factors(taps: &Plane<f64>) -> Option<[Plane<f64>; 2]> {
    let (rows, cols) = (taps.rows(), taps.cols());
    let column = Plane::from_fn(rows, 1, |y, _| taps.row(y).iter().sum::<f64>());
    let row = Plane::from_fn(1, cols, |_, x| (0..rows).map(|y| taps.row(y)[x]).sum::<f64>());
    let largest = taps.as_slice().iter().copied().fold(0.0, f64::max);
    let missed_by = |y: usize, x: usize| (column.row(y)[0] * row.row(0)[x] - taps.row(y)[x]).abs();
    let is_near = |y: usize, x: usize| missed_by(y, x) <= largest * PRODUCT_TOLERANCE;
    (0..rows).all(|y| (0..cols).all(|x| is_near(y, x))).then_some([column, row])
}

/// Taps of sum 1 as weights of sum `2^SHIFT`: rounded down, and those with the largest remainders up.
///
/// Ties are broken from the centre outwards, opposite taps one after the other: a disk, whose taps are all
/// alike, must not be shifted by what is left over.
fn quantised(taps: &Plane<f64>) -> Plane<i32> {
    let exact = taps.map(|tap| tap * f64::from(1 << SHIFT));
    let mut weights = exact.map(|tap| *tap as i32);
    let missing = (1 << SHIFT) - weights.as_slice().iter().sum::<i32>();
    let (count, cols) = (exact.as_slice().len(), taps.cols());
    let urgency = |i: usize| {
        let remainder = exact.as_slice()[i].fract();
        let (dy, dx) = ((i / cols).abs_diff(taps.rows() / 2), (i % cols).abs_diff(cols / 2));
        let tie = (remainder * TIE_STEPS).round() as i64;
        (-tie, dy * dy + dx * dx, i.min(count - 1 - i), i)
    };
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_cached_key(|&i| urgency(i));
    for &i in order.iter().take(missing as usize) {
        weights.as_mut_slice()[i] += 1;
    }
    weights
}

/// The same kernel without the outer rows and columns in which there is nothing.
fn trimmed(weights: &Plane<i32>) -> Plane<i32> {
    let centre = [weights.rows() / 2, weights.cols() / 2];
    let used = taps(weights).fold([0, 0], |[down, across], (y, x, _)| {
        [down.max(y.abs_diff(centre[0])), across.max(x.abs_diff(centre[1]))]
    });
    let (rows, cols) = (2 * used[0] + 1, 2 * used[1] + 1);
    let at = |y: usize, x: usize| weights.row(y + centre[0] - used[0])[x + centre[1] - used[1]];
    Plane::from_fn(rows, cols, at)
}

/// The weights that are not zero, and where.
fn taps(weights: &Plane<i32>) -> impl Iterator<Item = (usize, usize, i32)> {
    let all = (0..weights.rows()).flat_map(|y| (0..weights.cols()).map(move |x| (y, x)));
    all.map(|(y, x)| (y, x, weights.row(y)[x])).filter(|(.., weight)| *weight != 0)
}

/// One sweep of a kernel over rows that lie one after the other, each with what continues it.
#[derive(Debug)]
struct Pass {
    /// Rows needed above and below, columns on the left and at least as many on the right.
    radii: (usize, usize),
    /// Values from the start of a row to that of the next.
    width: usize,
    taps: Vec<Tap>,
    /// Bits that are rounded off.
    shift: u32,
    /// Whether 32 bits hold every sum.
    is_narrow: bool,
}

/// One pixel under the kernel, counted from the first, and its weight.
#[derive(Debug, Clone, Copy)]
struct Tap {
    offset: usize,
    weight: i32,
}

/// The passes of a kernel over an image.
fn passes(kernel: &Kernel, fraction: u32, gray: &Gray) -> Vec<Pass> {
    let mut had = 0;
    let pass = |(weights, kept): (&Plane<i32>, u32)| {
        let pass = Pass::new(weights, (had, kept), gray);
        had = kept;
        pass
    };
    kernel.passes().iter().zip(kernel.fractions(fraction)).map(pass).collect()
}

impl Pass {
    /// Over values with `had` bits after the point, so that `kept` are left of them.
    fn new(weights: &Plane<i32>, (had, kept): (u32, u32), gray: &Gray) -> Self {
        let (rows, cols) = (weights.rows(), weights.cols());
        let width = gray.size().1.next_multiple_of(BLOCK) + cols - 1;
        // True convolution: what lies to the right of the centre weighs the pixel to its left.
        let tap = |(y, x, weight)| Tap { offset: (rows - 1 - y) * width + cols - 1 - x, weight };
        let shift = SHIFT + had - kept;
        let largest = (u64::from(gray.reach()) << (had + SHIFT)) + (1 << (shift - 1));
        Self {
            radii: (rows / 2, cols / 2),
            width,
            taps: taps(weights).map(tap).collect(),
            shift,
            is_narrow: i32::try_from(largest).is_ok(),
        }
    }

    /// Rows of pixels, of which those between the margins are still to be written.
    fn room(&self, rows: usize) -> Result<Vec<i32>> {
        zeroed(self.width * (rows + 2 * self.radii.0))
    }

    /// Where in its row the image lies.
    fn columns(&self, cols: usize) -> Range<usize> {
        self.radii.1..self.radii.1 + cols
    }

    /// Continues a row by reflection on either side.
    fn continue_row(&self, row: &mut [i32], cols: usize) {
        let columns = self.columns(cols);
        for x in (0..columns.start).chain(columns.end..row.len()) {
            row[x] = row[columns.start + reflect(x as isize - columns.start as isize, cols)];
        }
    }
}

/// Rows that one task convolves.
struct Band<'a> {
    gray: &'a Gray<'a>,
    first: usize,
    band: &'a mut [i32],
    level: Level,
    control: &'a Control,
}

impl Band<'_> {
    fn convolve_once(self, pass: &Pass) -> Result<()> {
        let cols = self.gray.size().1;
        let pixels = self.pixels(pass)?;
        for (y, out) in self.band.chunks_exact_mut(cols).enumerate() {
            self.control.checkpoint()?;
            self.level.run(Sums { pass, pixels: &pixels[y * pass.width..], out });
        }
        Ok(())
    }

    fn convolve_twice(self, column: &Pass, row: &Pass) -> Result<()> {
        let cols = self.gray.size().1;
        let pixels = self.pixels(column)?;
        let mut between = row.room(1)?;
        for (y, out) in self.band.chunks_exact_mut(cols).enumerate() {
            self.control.checkpoint()?;
            let sums = &mut between[row.columns(cols)];
            self.level.run(Sums { pass: column, pixels: &pixels[y * column.width..], out: sums });
            row.continue_row(&mut between, cols);
            self.level.run(Sums { pass: row, pixels: &between, out });
        }
        Ok(())
    }

    /// The pixels of the band and around it, the image continued by reflection.
    fn pixels(&self, pass: &Pass) -> Result<Vec<i32>> {
        let (rows, cols) = self.gray.size();
        let mut pixels = pass.room(self.band.len() / cols)?;
        let places = self.first as isize - pass.radii.0 as isize..;
        for (y, row) in places.zip(pixels.chunks_exact_mut(pass.width)) {
            self.gray.write_row(reflect(y, rows), self.level, &mut row[pass.columns(cols)])?;
            pass.continue_row(row, cols);
        }
        Ok(pixels)
    }
}

/// Rows from the first under the kernel on -> one row of rounded sums.
struct Sums<'a> {
    pass: &'a Pass,
    pixels: &'a [i32],
    out: &'a mut [i32],
}

impl simd::Kernel for Sums<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { pass: Pass { taps, shift, is_narrow, .. }, pixels, out } = self;
        if *is_narrow {
            write_sums::<i32>(taps, *shift, pixels, out);
        } else {
            write_sums::<i64>(taps, *shift, pixels, out);
        }
    }
}

#[inline(always)]
fn write_sums<S: Sum>(taps: &[Tap], shift: u32, pixels: &[i32], out: &mut [i32]) {
    for (start, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        let sums = sums::<S>(taps, shift, &pixels[start..]);
        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// The rounded sums of a block. Values are copied first: only so are the sums known not to overlap them.
#[inline(always)]
fn sums<S: Sum>(taps: &[Tap], shift: u32, pixels: &[i32]) -> [i32; BLOCK] {
    let mut sums = [S::half(shift); BLOCK];
    for tap in taps {
        let pixels = &pixels[tap.offset..][..BLOCK];
        let values: [i32; BLOCK] = from_fn(|k| pixels[k]);
        sums = from_fn(|k| sums[k].plus(values[k], tap.weight));
    }
    sums.map(|sum| sum.without(shift))
}

/// A number in which weighted sums are exact.
trait Sum: Copy {
    /// What is added so that rounding down is rounding to the nearest.
    fn half(shift: u32) -> Self;
    /// The sum with one pixel more.
    fn plus(self, value: i32, weight: i32) -> Self;
    /// The sum without its lowest bits.
    fn without(self, shift: u32) -> i32;
}

impl Sum for i32 {
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

impl Sum for i64 {
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

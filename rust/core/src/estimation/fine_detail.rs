//! How well the fine detail of two images agrees at the same place.
//!
//! ```text
//! fine    = g - kernel * g,  kernel = (1 4 6 4 1)/16 x (1 4 6 4 1)/16, its taps `spacing` pixels apart
//! same(k) = mean of sign(fine of left[y, x]) sign(fine of right[y, x - k spacing])
//! lead    = same(0) - max of same(-3), same(-2), same(2), same(3)
//! ```

use rayon::prelude::*;

use phasestereo_match::base::error::Result;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::view::View;

/// Disparities at which fine detail is compared, in units of the spacing: first that of the same place.
const SHIFTS: [isize; 5] = [0, -3, -2, 2, 3];
/// Enough pixels: by chance, their means deviate by 0.005.
const ENOUGH: usize = 1 << 16;
/// Weights along an axis; their sum is 16.
const WEIGHTS: [i32; 5] = [1, 4, 6, 4, 1];
const WHOLE: i32 = 256;

/// The kernel of WEIGHTS along both axes, this many pixels apart.
pub fn kernel(spacing: usize) -> Result<Kernel> {
    let mut taps = vec![0.0; (WEIGHTS.len() - 1) * spacing + 1];
    for (k, weight) in WEIGHTS.into_iter().enumerate() {
        taps[k * spacing] = f64::from(weight) / 16.0;
    }
    Kernel::separable(&taps, &taps)
}

/// The rows that are examined.
pub fn sampled((rows, cols): (usize, usize), spacing: usize) -> Vec<usize> {
    let every = (rows * cols / ENOUGH).max(1);
    (2 * spacing..rows.saturating_sub(2 * spacing)).step_by(every).collect()
}

/// How well the signs of some pixels agree at each of SHIFTS, and the number of these pixels; in large images,
/// of some rows. `spacing`: that of the kernel.
pub fn same(
    grays: [&Gray; 2],
    spacing: usize,
    is_one: impl Fn(usize, usize) -> bool + Sync,
) -> ([f64; 5], i64) {
    let of_row = |y: usize| {
        let [mut left, right] = grays.map(|gray| signs(gray, spacing, y));
        let mut count = 0;
        for (x, sign) in left.iter_mut().enumerate() {
            let is_one = is_one(y, x);
            count += i64::from(is_one);
            *sign *= i32::from(is_one);
        }
        (agreeing(&left, &right, spacing), count)
    };
    let none = || ([0; 5], 0);
    let add =
        |(a, m): ([i64; 5], i64), (b, n): ([i64; 5], i64)| ([0, 1, 2, 3, 4].map(|k| a[k] + b[k]), m + n);
    let (sums, count) = sampled(grays[0].size(), spacing).into_par_iter().map(of_row).reduce(none, add);
    (sums.map(|sum| sum as f64 / count.max(1) as f64), count)
}

/// The sums of the products of the signs of a row at each of SHIFTS.
pub fn agreeing(left: &[i32], right: &[i32], spacing: usize) -> [i64; 5] {
    SHIFTS.map(|shift| {
        let by = |shift: isize| shift.max(0) as usize * spacing;
        let places = left[by(shift)..].iter().zip(&right[by(-shift)..]);
        places.map(|(a, b)| i64::from(a * b)).sum::<i64>()
    })
}

/// By how much signs agree better at the same place than beside it.
pub fn led([here, beside @ ..]: [f64; 5]) -> f64 {
    here - beside.into_iter().fold(f64::NEG_INFINITY, f64::max)
}

/// The lead of all pixels.
pub fn lead(grays: [&Gray; 2], spacing: usize) -> f64 {
    led(same(grays, spacing, |_, _| true).0)
}

/// The signs of the fine detail of a row.
pub fn signs(gray: &Gray, spacing: usize, y: usize) -> Vec<i32> {
    fine(gray, spacing, y).into_iter().map(i32::signum).collect()
}

/// The fine detail of a row, in gray levels; 0 at its ends.
pub fn fine_levels(view: &View, y: usize) -> Vec<f64> {
    let gray = Gray::of_view(view);
    let level = gray.steps(view.scale().level()) * f64::from(WHOLE) / f64::from(1u32 << surplus(&gray));
    fine(&gray, 1, y).into_iter().map(|fine| f64::from(fine) / level).collect()
}

/// The fine detail of a row, WHOLE times, without the surplus; 0 at its ends.
fn fine(gray: &Gray, spacing: usize, y: usize) -> Vec<i32> {
    let (cols, surplus, reach) = (gray.size().1, surplus(gray), 2 * spacing);
    let mut sums = vec![0; cols];
    for (row, weight) in (y - reach..=y + reach).step_by(spacing).zip(WEIGHTS) {
        let grays = sums.iter_mut().zip(gray.row(row));
        grays.for_each(|(sum, gray)| *sum += weight * (gray >> surplus));
    }
    let mut fine = vec![0; cols];
    let inner = &mut fine[reach..cols - reach];
    for (fine, gray) in inner.iter_mut().zip(&gray.row(y)[reach..]) {
        *fine = WHOLE * (gray >> surplus);
    }
    // Tap after tap, which is vectorized for any spacing.
    for (k, weight) in WEIGHTS.into_iter().enumerate() {
        let sums = inner.iter_mut().zip(&sums[k * spacing..]);
        sums.for_each(|(fine, sum)| *fine -= weight * sum);
    }
    fine
}

/// How many of the lowest bits of gray values are dropped so that sums over windows fit.
pub fn surplus(gray: &Gray) -> u32 {
    (u32::BITS - gray.reach().leading_zeros()).saturating_sub(22)
}

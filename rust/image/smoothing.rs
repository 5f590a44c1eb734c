//! Gray values -> gray values with less noise and the same edges: the guided filter of an image by itself (K. He, J. Sun,
//! X. Tang: *Guided Image Filtering*, PAMI 2013) over 5 x 5 pixels.
//!
//! In each window the image is drawn towards its mean, by a share that falls as the variance rises above that of the
//! noise. Every pixel takes the mean over the windows that it lies in:
//!
//! ```text
//! share = deviation^2 / (variance in the window + deviation^2)    # 1: flat, 0: far more than noise
//! out = pixel + mean over the windows of share * (mean in the window - pixel)
//! ```
//!
//! Sums of gray values are exact, other sums have a fixed order. So a pixel does not depend on where bands begin or on the
//! instructions. The image and the shares continue by reflection.

use std::ops::Range;

use crate::error::Result;
use crate::image::intensity::Gray;
use crate::image::plane::{Plane, reflect, zeroed};
use crate::pipeline::control::Control;
use crate::simd::{Level, Loop};
use crate::value::nearest;

/// Pixels from the center of a window to its side.
///
/// Means of bad-1.0 (%) over 12 scenes by radius, with the deviations that suit them, codes of two sizes and penalties of
/// (5, 20): sharp, noise of 5 and of 20 gray levels, JPEG of quality 30, both images after a disk of 3 px: none: 5.39, 14.1,
/// 34.4, 26.9, 15.6; 1: 5.22, 12.5, 29.4, 25.7, 14.2; 2: 5.23, 12.3, 28.7, 25.0, 14.4; 3: 5.40, 12.6, 29.1, 25.0, 15.1.
const RADIUS: usize = 2;
/// Side of a window.
const SIDE: usize = 2 * RADIUS + 1;
/// Pixels in a window.
const AREA: f64 = (SIDE * SIDE) as f64;
/// Rows above and below a pixel that it depends on: those of all windows that it lies in.
pub const REACH: usize = 2 * RADIUS;
/// Rows that one task smooths; it prepares `2 * REACH` further ones.
const BAND_ROWS: usize = 32;
/// Larger deviations, in steps, are beyond any window's and make no difference; their squares must be finite.
const LARGEST_DEVIATION: f64 = (1u64 << 40) as f64;

/// Smooths gray values whose noise has, or is taken to have, this standard deviation, in steps. One step of the gray
/// values is `scale` steps of the result.
pub fn smooth(
    gray: &Gray,
    deviation: f64,
    scale: f64,
    level: Level,
    control: &Control,
) -> Result<Plane<i32>> {
    let (rows, cols) = gray.size();
    let noise = deviation.min(LARGEST_DEVIATION).powi(2).max(f64::MIN_POSITIVE);

    Plane::by_bands((rows, cols), BAND_ROWS, |first, out| {
        let last = first + out.len() / cols;
        // The rows whose windows the band needs; `values` has `RADIUS` more rows on either side.
        let windows = first.saturating_sub(RADIUS)..(last + RADIUS).min(rows);
        let values = around(gray, &windows, level)?;
        let width = cols + 2 * RADIUS;
        let mut sums = zeroed(width)?;
        let mut squares = zeroed(width)?;

        // Shares, and shares of the means, of every window.
        let mut shares = zeroed(width * windows.len())?;
        let mut drawn = zeroed(width * windows.len())?;
        for (y, (shares, drawn)) in
            shares.chunks_exact_mut(width).zip(drawn.chunks_exact_mut(width)).enumerate()
        {
            control.checkpoint()?;

            let values = window_rows(&values, width, y);
            let columns = [&mut sums[..], &mut squares];
            let out = [&mut shares[RADIUS..][..cols], &mut drawn[RADIUS..][..cols]];
            level.run(Windows { values, columns, noise, out });

            // Shares continue by reflection, as the image does.
            continue_sides(shares, cols);
            continue_sides(drawn, cols);
        }

        // Means over the windows of every pixel.
        let of_window = |y: isize| reflect(y, rows) - windows.start;
        for (y, out) in (first as isize..).zip(out.chunks_exact_mut(cols)) {
            control.checkpoint()?;

            let mut of_shares = [&[][..]; SIDE];
            let mut of_drawn = [&[][..]; SIDE];
            for dy in 0..SIDE {
                let start = of_window(y + dy as isize - RADIUS as isize) * width;
                of_shares[dy] = &shares[start..][..width];
                of_drawn[dy] = &drawn[start..][..width];
            }

            let own = (y as usize + RADIUS - windows.start) * width + RADIUS;
            let columns = [&mut sums[..], &mut squares];
            let values = &values[own..][..cols];
            level.run(FilterRow { values, of_shares, of_drawn, columns, scale, out });
        }

        Ok(())
    })
}

/// The rows of windows centered on some rows, each with its continuation.
fn around(gray: &Gray, wanted: &Range<usize>, level: Level) -> Result<Vec<f64>> {
    let (rows, cols) = gray.size();
    let width = cols + 2 * RADIUS;
    let mut values = zeroed(width * (wanted.len() + 2 * RADIUS))?;
    let mut row = zeroed(cols)?;

    let places = wanted.start as isize - RADIUS as isize..;
    for (y, values) in places.zip(values.chunks_exact_mut(width)) {
        gray.write_row(reflect(y, rows), level, &mut row)?;

        for (value, gray) in values[RADIUS..].iter_mut().zip(&row) {
            *value = f64::from(*gray);
        }

        continue_sides(values, cols);
    }

    Ok(values)
}

/// The rows under row `y` of windows.
fn window_rows(values: &[f64], width: usize, y: usize) -> [&[f64]; SIDE] {
    let mut rows = [&[][..]; SIDE];
    for dy in 0..SIDE {
        rows[dy] = &values[(y + dy) * width..][..width];
    }
    rows
}

/// Continues a row by reflection on either side.
fn continue_sides(row: &mut [f64], cols: usize) {
    for x in (0..RADIUS).chain(RADIUS + cols..row.len()) {
        row[x] = row[RADIUS + reflect(x as isize - RADIUS as isize, cols)];
    }
}

/// Writes the shares of a row of windows, and those of their means.
struct Windows<'a> {
    values: [&'a [f64]; SIDE],
    columns: [&'a mut [f64]; 2],
    noise: f64,
    out: [&'a mut [f64]; 2],
}

impl Loop for Windows<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [sums, squares] = self.columns;
        add_columns(self.values, sums);
        add_squares(self.values, squares);

        let [shares, drawn] = self.out;
        write_shares(sums, squares, self.noise, shares, drawn);
    }
}

/// Writes a row of smoothed values, from rows of shares.
struct FilterRow<'a> {
    values: &'a [f64],
    of_shares: [&'a [f64]; SIDE],
    of_drawn: [&'a [f64]; SIDE],
    columns: [&'a mut [f64]; 2],
    scale: f64,
    out: &'a mut [i32],
}

impl Loop for FilterRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [shares, drawn] = self.columns;
        add_columns(self.of_shares, shares);
        add_columns(self.of_drawn, drawn);

        write_smoothed(self.values, shares, drawn, self.scale, self.out);
    }
}

/// Sums of columns, in the order of their rows.
#[inline(always)]
#[expect(clippy::many_single_char_names, reason = "rows in order")]
fn add_columns([a, b, c, d, e]: [&[f64]; SIDE], sums: &mut [f64]) {
    let n = sums.len();
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);

    for i in 0..n {
        sums[i] = a[i] + b[i] + c[i] + d[i] + e[i];
    }
}

/// Sums of the squares of columns, in the order of their rows.
#[inline(always)]
#[expect(clippy::many_single_char_names, reason = "rows in order")]
fn add_squares([a, b, c, d, e]: [&[f64]; SIDE], sums: &mut [f64]) {
    let n = sums.len();
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);

    for i in 0..n {
        sums[i] = a[i] * a[i] + b[i] * b[i] + c[i] * c[i] + d[i] * d[i] + e[i] * e[i];
    }
}

/// Writes shares, and shares of means, from sums of columns.
#[inline(always)]
fn write_shares(sums: &[f64], squares: &[f64], noise: f64, shares: &mut [f64], drawn: &mut [f64]) {
    let n = shares.len();
    let drawn = &mut drawn[..n];
    let sums = &sums[..n + 2 * RADIUS];
    let squares = &squares[..n + 2 * RADIUS];

    for i in 0..n {
        let mean = beside(sums, i) / AREA;
        let variance = (beside(squares, i) / AREA - mean * mean).max(0.0);

        let share = noise / (variance + noise);
        shares[i] = share;
        drawn[i] = share * mean;
    }
}

/// Writes smoothed values, from sums of columns of shares.
#[inline(always)]
fn write_smoothed(values: &[f64], shares: &[f64], drawn: &[f64], scale: f64, out: &mut [i32]) {
    let n = out.len();
    let values = &values[..n];
    let shares = &shares[..n + 2 * RADIUS];
    let drawn = &drawn[..n + 2 * RADIUS];

    for i in 0..n {
        let share = beside(shares, i) / AREA;
        let drawn = beside(drawn, i) / AREA;

        // The order of these operations defines the last bits.
        let value = (values[i] - share * values[i] + drawn) * scale;
        out[i] = nearest(value);
    }
}

/// The sum over the columns of the window that begins with column `i`.
#[inline(always)]
fn beside(columns: &[f64], i: usize) -> f64 {
    columns[i] + columns[i + 1] + columns[i + 2] + columns[i + 3] + columns[i + 4]
}

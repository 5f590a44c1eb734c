//! Gray values -> gray values with less noise and the same edges: the guided filter of an image by itself (K.
//! He, J. Sun, X. Tang: *Guided Image Filtering*, PAMI 2013) over 5 x 5 pixels.
//!
//! Each window draws the image toward its mean, by a share that falls as the variance rises above that of the
//! noise. Every pixel takes the mean over the windows that contain it:
//!
//! ```text
//! share = deviation^2 / (variance in the window + deviation^2)    # 1: flat, 0: far more than noise
//! out = pixel + mean over the windows of share * (mean in the window - pixel)
//! ```
//!
//! Sums of gray values are exact; other sums have a fixed order. So a pixel does not depend on where bands
//! begin or on the instructions. The image and the shares continue by reflection.
//!
//! A task smooths a band of rows: first the shares of all windows it needs, then the means over them. Each
//! step works down a block of columns, so that the five rows that a row needs are still in the first-level
//! cache from the row above. Rows begin at a cache line; sums over the five rows of a column come before
//! those over five columns, which start anywhere.

use std::array::from_fn;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::base::plane::{Plane, reflect, widened};
use crate::base::simd::{Level, leveled};
use crate::base::value::nearest;
use crate::image::gray_scale::{FINER_LOG2, LUMINANCE_STEPS};
use crate::image::intensity::Gray;

/// Pixels from the center of a window to its side. Smaller windows leave more of strong noise; larger ones
/// harm sharp and blurred pairs.
const RADIUS: usize = 2;
/// Side of a window.
const SIDE: usize = 2 * RADIUS + 1;
/// Pixels in a window.
const AREA: f64 = (SIDE * SIDE) as f64;
/// Keeps 27 of the 53 bits of the fraction of a number.
const HIGH_BITS: u64 = u64::MAX << 26;
/// The inverse of [`AREA`], cut off after 26 bits ...
const INVERSE_HIGH: f64 = f64::from_bits((1.0 / AREA).to_bits() & u64::MAX << 27);
/// ... and the rest: `1 / AREA - INVERSE_HIGH`, whose dividend is exact.
const INVERSE_LOW: f64 = (1.0 - AREA * INVERSE_HIGH) / AREA;
/// Rows above and below a pixel that it depends on: those of all windows that contain it.
pub const REACH: usize = 2 * RADIUS;
/// Values of a row before its first pixel, the last [`RADIUS`] of which are its continuation: one cache line,
/// so that the pixels start at one.
const MARGIN: usize = 8;
/// Pixels that are computed together.
const BLOCK: usize = 16;
/// Columns that are computed row after row, a multiple of [`BLOCK`]: the rows of their windows stay in the
/// first-level cache. With 384, rows of 741 pixels take the same time; with 128 and 768, they take 0.1 to 0.2
/// ms longer than 1 ms.
const PART: usize = 256;
/// The same, with the margins on either side.
const SPAN: usize = PART + 2 * MARGIN;
/// Rows that one task smooths; it prepares `2 * REACH` further ones.
const BAND_ROWS: usize = 32;
/// Larger deviations, in steps, exceed those of any window and make no difference; their squares must be
/// finite.
const LARGEST_DEVIATION: f64 = (1u64 << 40) as f64;
/// Largest magnitude of smoothed values, unless the image has larger ones: sums of a later convolution then
/// fit in 32 bits.
const NARROW_REACH: u32 = 1 << 17;
/// Largest magnitudes of gray values of bytes, without and with color.
const REACH_OF_BYTES: [u32; 2] = [128, 128 * LUMINANCE_STEPS as u32];
/// Largest magnitude of these after smoothing, in sixteenths of a gray level: sums of codes then fit in 32
/// bits.
const SMOOTHED_BYTES: u32 = 128 << FINER_LOG2;

impl Gray<'_> {
    /// The same image with less noise: [`smooth`] for noise of this standard deviation, in units of the
    /// pixels.
    pub fn smoothed(&self, deviation: f64, level: Level, control: &Control) -> Result<Gray<'static>> {
        let fits = |bits: &u32| self.reach() << bits <= NARROW_REACH;
        let bits = (0..=FINER_LOG2).rev().find(fits).unwrap_or(0);
        // Bytes, with or without color, end up on the same scale.
        let is_of_bytes = REACH_OF_BYTES.contains(&self.reach());
        let reach = if is_of_bytes { SMOOTHED_BYTES } else { self.reach() << bits };

        let scale = f64::from(reach) / f64::from(self.reach());
        let plane = smooth(self, self.steps(deviation), scale, level, control)?;
        Ok(self.scaled(reach, plane))
    }
}

/// Smooths gray values whose noise is assumed to have this standard deviation, in steps. One step of the gray
/// values is `scale` steps of the result.
pub fn smooth(
    gray: &Gray,
    deviation: f64,
    scale: f64,
    level: Level,
    control: &Control,
) -> Result<Plane<i32>> {
    let size = gray.size();
    let noise = deviation.min(LARGEST_DEVIATION).powi(2).max(f64::MIN_POSITIVE);
    let smoothing = Smoothing { gray, noise, scale, level, control };

    Plane::by_bands_with(
        size,
        BAND_ROWS,
        || SmoothingBuffers::new(size),
        |buffers, first, out| {
            let windows = widened(&(first..first + out.len() / size.1), RADIUS, size.0);

            smoothing.write_values(&windows, buffers);
            smoothing.write_shares(windows.len(), buffers)?;
            smoothing.write_smoothed(windows.start, buffers, first, out)
        },
    )
}

/// The values shared by all bands.
struct Smoothing<'a> {
    gray: &'a Gray<'a>,
    noise: f64,
    scale: f64,
    level: Level,
    control: &'a Control,
}

/// The buffers of a thread, reused from band to band.
struct SmoothingBuffers {
    /// A smoothed row.
    row: Memory<i32>,
    /// The rows under the windows, each with its continuation.
    values: Memory<f64>,
    /// The share of every window.
    shares: Memory<f64>,
    /// The share times the mean, of every window.
    drawn: Memory<f64>,
    /// Two sums over the columns of the rows of a window.
    columns: [Memory<f64>; 2],
}

impl SmoothingBuffers {
    /// For bands of an image of this many rows and columns.
    fn new((rows, cols): (usize, usize)) -> Result<Self> {
        let width = width(cols);
        let rows = rows.min(BAND_ROWS) + 2 * RADIUS;

        Ok(Self {
            row: Memory::new(width)?,
            values: Memory::new((rows + 2 * RADIUS) * width)?,
            shares: Memory::new(rows * width)?,
            drawn: Memory::new(rows * width)?,
            columns: [Memory::new(SPAN)?, Memory::new(SPAN)?],
        })
    }
}

impl Smoothing<'_> {
    /// Writes the gray values under rows of windows: [`RADIUS`] more rows on either side.
    fn write_values(&self, windows: &Range<usize>, buffers: &mut SmoothingBuffers) {
        let (rows, cols) = self.gray.size();
        let places = windows.start as isize - RADIUS as isize..(windows.end + RADIUS) as isize;
        for (y, values) in places.zip(buffers.values.chunks_exact_mut(width(cols))) {
            let row = self.gray.row(reflect(y, rows));
            widen(self.level, row, &mut values[MARGIN..][..cols]);
            continue_sides(values, cols);
        }
    }

    /// Writes the shares of this many rows of windows, and the shares times the means.
    fn write_shares(&self, rows: usize, buffers: &mut SmoothingBuffers) -> Result<()> {
        let cols = self.gray.size().1;
        let width = width(cols);
        let SmoothingBuffers { values, shares, drawn, columns, .. } = buffers;

        for part in parts(cols) {
            self.control.checkpoint()?;

            for y in 0..rows {
                let values = window_rows(values, &part, |dy| (y + dy) * width);
                let own = y * width + MARGIN + part.start;
                let out = [&mut *shares, drawn].map(|rows| &mut rows[own..][..part.len()]);
                share_windows(self.level, values, columns, self.noise, out);
            }
        }

        // Shares continue by reflection, as the image does.
        let rows = shares.chunks_exact_mut(width).chain(drawn.chunks_exact_mut(width));
        rows.for_each(|row| continue_sides(row, cols));
        Ok(())
    }

    /// Writes the smoothed rows of a band, which are means over the windows of every pixel.
    fn write_smoothed(
        &self,
        first_window: usize,
        buffers: &mut SmoothingBuffers,
        first: usize,
        out: &mut [i32],
    ) -> Result<()> {
        let (rows, cols) = self.gray.size();
        let width = width(cols);
        let SmoothingBuffers { row, values, shares, drawn, columns } = buffers;

        for part in parts(cols) {
            self.control.checkpoint()?;

            for (y, out) in (first..).zip(out.chunks_exact_mut(cols)) {
                let place = |dy: usize| y as isize + dy as isize - RADIUS as isize;
                let start = |dy: usize| (reflect(place(dy), rows) - first_window) * width;
                let windows = [&*shares, drawn].map(|rows| window_rows(rows, &part, start));

                let own = (y + RADIUS - first_window) * width + MARGIN + part.start;
                let values = &values[own..][..part.len()];
                let smoothed = &mut row[part.clone()];
                filter_row(self.level, values, windows, columns, self.scale, smoothed);

                let part = part.start..part.end.min(cols);
                out[part.clone()].copy_from_slice(&row[part]);
            }
        }

        Ok(())
    }
}

/// Columns whose windows are computed together; the last part extends to the end of its last block.
fn parts(cols: usize) -> impl Iterator<Item = Range<usize>> {
    let padded = cols.next_multiple_of(BLOCK);
    (0..padded).step_by(PART).map(move |x| x..(x + PART).min(padded))
}

/// Values of a row of this many columns with its continuation, up to the end of the last block.
fn width(cols: usize) -> usize {
    cols.next_multiple_of(BLOCK) + 2 * MARGIN
}

/// Converts a row.
#[leveled]
fn widen(level: Level, row: &[i32], values: &mut [f64]) {
    for (value, gray) in values.iter_mut().zip(row) {
        *value = f64::from(*gray);
    }
}

/// The rows of a window over a part of the columns and the margins beside it; `start` is where each row
/// begins.
fn window_rows<'a>(
    rows: &'a [f64],
    part: &Range<usize>,
    start: impl Fn(usize) -> usize,
) -> [&'a [f64]; SIDE] {
    from_fn(|dy| &rows[start(dy) + part.start..][..part.len() + 2 * MARGIN])
}

/// Continues a row by reflection on either side.
fn continue_sides(row: &mut [f64], cols: usize) {
    let end = MARGIN + cols;
    for x in (MARGIN - RADIUS..MARGIN).chain(end..end + RADIUS) {
        row[x] = row[MARGIN + reflect(x as isize - MARGIN as isize, cols)];
    }
}

/// Writes the shares of a row of windows, and the shares times the means.
#[leveled]
fn share_windows(
    level: Level,
    values: [&[f64]; SIDE],
    columns: &mut [Memory<f64>; 2],
    noise: f64,
    out: [&mut [f64]; 2],
) {
    let [shares, drawn] = out;
    let [sums, squares] = columns;
    add_squares(values, sums, squares);

    write_shares(sums, squares, noise, shares, drawn);
}

/// Writes a row of smoothed values from rows of shares and of shares times means.
#[leveled]
fn filter_row(
    level: Level,
    values: &[f64],
    windows: [[&[f64]; SIDE]; 2],
    columns: &mut [Memory<f64>; 2],
    scale: f64,
    smoothed: &mut [i32],
) {
    let [shares, drawn] = columns;
    add_columns(windows[0], shares);
    add_columns(windows[1], drawn);

    write_smoothed(values, shares, drawn, scale, smoothed);
}

/// Sums of columns, in the order of their rows.
#[inline(always)]
#[expect(clippy::many_single_char_names, reason = "rows in order")]
fn add_columns([a, b, c, d, e]: [&[f64]; SIDE], sums: &mut [f64]) {
    let n = a.len();
    let sums = &mut sums[..n];
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);

    for i in 0..n {
        sums[i] = a[i] + b[i] + c[i] + d[i] + e[i];
    }
}

/// The same, with sums of their squares.
#[inline(always)]
#[expect(clippy::many_single_char_names, reason = "rows in order")]
fn add_squares([a, b, c, d, e]: [&[f64]; SIDE], sums: &mut [f64], squares: &mut [f64]) {
    let n = a.len();
    let (sums, squares) = (&mut sums[..n], &mut squares[..n]);
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);

    for i in 0..n {
        let [a, b, c, d, e] = [a[i], b[i], c[i], d[i], e[i]];
        sums[i] = a + b + c + d + e;
        squares[i] = a * a + b * b + c * c + d * d + e * e;
    }
}

/// Writes shares, and shares times means, from sums of columns.
#[inline(always)]
fn write_shares(sums: &[f64], squares: &[f64], noise: f64, shares: &mut [f64], drawn: &mut [f64]) {
    let blocks = shares.as_chunks_mut::<BLOCK>().0.iter_mut().zip(drawn.as_chunks_mut::<BLOCK>().0);

    for (start, (shares, drawn)) in (0..).step_by(BLOCK).zip(blocks) {
        let mean = beside(sums, start);
        let square = beside(squares, start);

        let variance: [f64; BLOCK] = from_fn(|i| (square[i] - mean[i] * mean[i]).max(0.0));
        let share: [f64; BLOCK] = from_fn(|i| noise / (variance[i] + noise));

        *shares = share;
        *drawn = from_fn(|i| share[i] * mean[i]);
    }
}

/// Writes smoothed values, from sums of columns of shares.
#[inline(always)]
fn write_smoothed(values: &[f64], shares: &[f64], drawn: &[f64], scale: f64, out: &mut [i32]) {
    for (start, out) in (0..).step_by(BLOCK).zip(out.as_chunks_mut::<BLOCK>().0) {
        let values = &values[start..][..BLOCK];
        let share = beside(shares, start);
        let drawn = beside(drawn, start);

        for i in 0..BLOCK {
            // The order of these operations defines the last bits.
            let value = (values[i] - share[i] * values[i] + drawn[i]) * scale;
            out[i] = nearest(value);
        }
    }
}

/// The quotient of a sum and [`AREA`], correctly rounded, as a division would give it. With divisions,
/// smoothing takes 1.5 times as long.
///
/// The inverse and the sum are each split in two. The product of the high parts and that of the low part of
/// the sum are exact, so the last addition rounds a value that is right to 2^-76 of itself. No quotient of 53
/// bits by 25 lies that close to the middle between two numbers.
#[inline(always)]
fn over_area(sum: f64) -> f64 {
    let high = f64::from_bits(sum.to_bits() & HIGH_BITS);
    let low = sum - high;

    high * INVERSE_HIGH + (low * INVERSE_HIGH + sum * INVERSE_LOW)
}

/// The means over the columns of the windows that begin at column `start` and at the following ones.
#[inline(always)]
fn beside(columns: &[f64], start: usize) -> [f64; BLOCK] {
    let c = &columns[start + MARGIN - RADIUS..][..SIDE + BLOCK - 1];
    from_fn(|i| over_area(c[i] + c[i + 1] + c[i + 2] + c[i + 3] + c[i + 4]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotients_are_those_of_a_division() {
        let mut state = 1u64;

        for exponent in (-200..=200).cycle().take(100_000) {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            // Any number of 53 bits, and neighbors of multiples of the divisor.
            let any = f64::from_bits((state >> 12) | 1.0f64.to_bits()) * 2f64.powi(exponent);
            let multiple = AREA * (state >> 16) as f64;

            for sum in [any, -any, multiple, multiple + 1.0, multiple.next_down()] {
                assert_eq!(over_area(sum).to_bits(), (sum / AREA).to_bits(), "{sum:e}");
            }
        }

        assert_eq!(over_area(0.0).to_bits(), 0);
    }
}

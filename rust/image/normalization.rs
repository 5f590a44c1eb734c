//! Channel planes -> local contrast, which normalized SAD compares: each pixel less the mean of the window around it, over
//! its standard deviation there.

use std::ops::Range;

use crate::error::Result;
use crate::image::intensity::LEVEL_STEPS;
use crate::image::plane::{Plane, reflect};
use crate::pipeline::control::Control;

/// Fixed-point steps per standard deviation.
pub const DEVIATION_STEPS: u16 = 256;
/// Normalized values are clamped to this many deviations; only windows beyond 16 px can reach it.
const DEVIATION_REACH: f64 = 16.0;
/// Largest value of a normalized plane.
pub const DEVIATION_CEILING: u16 = 2 * 16 * DEVIATION_STEPS;
/// Rows that one task normalizes; each task warms up over `window - 1` further rows.
const BAND_ROWS: usize = 128;

/// Sums of the values and of their squares: exact integers, so sliding sums have no error.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    sum: i64,
    squares: i64,
}

impl Moments {
    /// Adds another pair of sums, or subtracts it for a `sign` of -1.
    fn add(&mut self, other: Self, sign: i64) {
        self.sum += sign * other.sum;
        self.squares += sign * other.squares;
    }
}

/// Normalizes a plane over `window x window` pixels, continued by reflection.
///
/// One gray level of deviation is added in quadrature, so that flat areas do not turn noise into signal.
/// The one division and square root per pixel are those of IEEE 754, alike on every machine.
pub fn normalize(plane: &Plane<u16>, window: usize, control: &Control) -> Result<Plane<u16>> {
    let size = (plane.rows(), plane.cols());
    Plane::by_bands(size, BAND_ROWS, |first, band| {
        normalize_band(plane, window, first, control, band)
    })
}

/// Normalizes the rows of a band, from row `first` on: sums of columns slide from row to row.
fn normalize_band(
    plane: &Plane<u16>,
    window: usize,
    first: usize,
    control: &Control,
    band: &mut [u16],
) -> Result<()> {
    let cols = plane.cols();
    let places = first..first + band.len() / cols;

    let add_row = |y: usize, sign: i64, columns: &mut Vec<Moments>| {
        for (column, &value) in columns.iter_mut().zip(plane.row(y)) {
            let value = i64::from(value);
            column.add(Moments { sum: value, squares: value * value }, sign);
        }
    };

    let columns = vec![Moments::default(); cols];
    slide(window, places, plane.rows(), columns, add_row, |y, columns| {
        control.checkpoint()?;
        normalize_row(plane.row(y), columns, window, &mut band[(y - first) * cols..][..cols])
    })
}

/// Normalizes a row: sums of columns slide from pixel to pixel.
fn normalize_row(row: &[u16], columns: &[Moments], window: usize, out: &mut [u16]) -> Result<()> {
    let count = (window * window) as i64;
    let one_gray_level = (count * i64::from(LEVEL_STEPS)).pow(2);
    let add = |x: usize, sign: i64, sum: &mut Moments| sum.add(columns[x], sign);

    slide(
        window,
        0..row.len(),
        row.len(),
        Moments::default(),
        add,
        |x, Moments { sum, squares }| {
            // Everything is multiplied by the number of pixels, so that only the quotient is rounded.
            let variance = count * squares - sum * sum + one_gray_level;
            let deviations = (count * i64::from(row[x]) - sum) as f64 / (variance as f64).sqrt();

            let clamped = deviations.clamp(-DEVIATION_REACH, DEVIATION_REACH) + DEVIATION_REACH;
            out[x] = (clamped * f64::from(DEVIATION_STEPS)).round() as u16;
            Ok(())
        },
    )
}

/// Slides a window over `places` of `0..length`, continued by reflection. Calls `add` for what enters (sign 1) or leaves
/// (sign -1) the sum, and `write` for each place in between.
fn slide<S>(
    window: usize,
    places: Range<usize>,
    length: usize,
    mut sum: S,
    add: impl Fn(usize, i64, &mut S),
    mut write: impl FnMut(usize, &S) -> Result<()>,
) -> Result<()> {
    let radius = (window / 2) as isize;
    let first = places.start as isize;

    // All of the first window but its last place.
    (first - radius..first + radius).for_each(|place| add(reflect(place, length), 1, &mut sum));

    for center in places {
        add(reflect(center as isize + radius, length), 1, &mut sum);
        write(center, &sum)?;
        add(reflect(center as isize - radius, length), -1, &mut sum);
    }

    Ok(())
}

//! Channel planes -> local contrast, which normalized SAD compares: each pixel less the mean of the window around it, over
//! its standard deviation there.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::image::intensity::LEVEL_STEPS;
use crate::image::window_sums::{Beyond, Windows};

/// Fixed-point steps per standard deviation.
pub const DEVIATION_STEPS: u16 = 256;
/// Normalized values are clamped to this many deviations; only windows beyond 16 px can reach it.
const DEVIATION_REACH: f64 = 16.0;
/// Largest value of a normalized plane.
pub const DEVIATION_CEILING: u16 = 2 * 16 * DEVIATION_STEPS;
/// Rows that one task normalizes; each task warms up over `window - 1` further rows.
const BAND_ROWS: usize = 128;

/// Normalizes a plane over `window x window` pixels, continued by reflection.
///
/// One gray level of deviation is added in quadrature, so that flat areas do not turn noise into signal.
/// The one division and square root per pixel are those of IEEE 754, alike on every machine.
pub fn normalize(
    plane: &Plane<u16>,
    window: usize,
    level: Level,
    control: &Control,
) -> Result<Plane<u16>> {
    let size = (plane.rows(), plane.cols());
    let windows = Windows { size, radius: window / 2, beyond: Beyond::Reflection };
    let count = (window * window) as i64;
    let one_gray_level = (count * i64::from(LEVEL_STEPS)).pow(2);

    // Of sums of values and of their squares everything is multiplied by the number of pixels, so that only the quotient
    // is rounded.
    let moments = |y: usize| plane.row(y).iter().map(|value| i64::from(*value)).map(|v| [v, v * v]);
    let normalized = |y: usize, x: usize, [sum, squares]: [i64; 2]| {
        let variance = count * squares - sum * sum + one_gray_level;
        let difference = count * i64::from(plane.row(y)[x]) - sum;
        let deviations = difference as f64 / (variance as f64).sqrt();

        let clamped = deviations.clamp(-DEVIATION_REACH, DEVIATION_REACH) + DEVIATION_REACH;
        (clamped * f64::from(DEVIATION_STEPS)).round() as u16
    };

    Plane::by_bands(size, BAND_ROWS, |first, band| {
        control.checkpoint()?;
        windows.write((first, band), moments, normalized, level)
    })
}

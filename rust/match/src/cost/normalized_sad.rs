//! Absolute differences of local contrast: each pixel minus the mean of the window around it, divided by the
//! standard deviation there (normalized SAD, a baseline of the paper's section 3).

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::base::value::Value;
use crate::choices::LARGEST_DEVIATION;
use crate::cost::differences::Differences;
use crate::cost::{Cost, CostInput, Lines, PixelBytes, RowPart};
use crate::image::intensity::{LEVEL_STEPS, level_planes};
use crate::image::window_sums::{Beyond, Windows};
use crate::pair::plan::{Demand, Plan};
use crate::settings::Settings;

/// Fixed-point steps per standard deviation.
const DEVIATION_STEPS: u16 = 256;
/// Largest value of a normalized plane.
const DEVIATION_CEILING: u16 = 2 * LARGEST_DEVIATION * DEVIATION_STEPS;
/// Rows that one task normalizes; each task warms up over `window - 1` further rows.
const BAND_ROWS: usize = 128;

/// The normalized gray levels of a pair.
pub struct NormalizedSad(Differences);

impl Cost for NormalizedSad {
    const STEPS: u16 = DEVIATION_STEPS;

    fn ceiling(_: &Settings) -> u16 {
        DEVIATION_CEILING
    }

    fn reach(plan: Plan) -> usize {
        plan.settings.window / 2
    }

    fn bytes(_: &Demand) -> PixelBytes {
        PixelBytes { described: 2, versions: 1, passing: 14 }
    }

    fn new(CostInput { views, candidates, settings, level, control, .. }: CostInput) -> Result<Self> {
        let [left, right] = level_planes(views, settings.intensity_range, control)?;
        let normalized = |plane: &Plane<u16>| normalize(plane, settings.window, level, control);

        Ok(Self(Differences::new([normalized(&left)?, normalized(&right)?], candidates)?))
    }

    #[inline(always)]
    fn write<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        self.0.write(part, out);
    }

    fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        self.0.between(y, x, place)
    }
}

/// Normalizes a plane over `window x window` pixels, continued by reflection.
///
/// One gray level of deviation is added in quadrature, so that flat areas do not turn noise into signal. The
/// one division and square root per pixel are those of IEEE 754, identical on every machine.
pub fn normalize(plane: &Plane<u16>, window: usize, level: Level, control: &Control) -> Result<Plane<u16>> {
    let size = (plane.rows(), plane.cols());
    let windows = Windows { size, radius: window / 2, beyond: Beyond::Reflection };
    let count = (window * window) as i64;
    let one_gray_level = (count * i64::from(LEVEL_STEPS)).pow(2);

    let largest = f64::from(LARGEST_DEVIATION);

    // Sums of values and of their squares are multiplied by the number of pixels, so that only the quotient
    // is rounded.
    let moments = |y: usize| plane.row(y).iter().map(|value| i64::from(*value)).map(|v| [v, v * v]);
    let normalized = |y: usize, x: usize, [sum, squares]: [i64; 2]| {
        let variance = count * squares - sum * sum + one_gray_level;
        let difference = count * i64::from(plane.row(y)[x]) - sum;
        let deviations = difference as f64 / (variance as f64).sqrt();

        let clamped = deviations.clamp(-largest, largest) + largest;
        (clamped * f64::from(DEVIATION_STEPS)).round() as u16
    };

    Plane::by_bands(size, BAND_ROWS, |first, band| {
        control.checkpoint()?;
        windows.write((first, band), moments, normalized, level)
    })
}

//! How much an image shows around each pixel: what is left of its gray values without their means nearby.
//!
//! ```text
//! rest   = g - mean of g over 7 x 7 pixels
//! detail = root mean square of rest over 9 x 9 pixels
//! blank  = detail <= BLANK steps of rounding, opened by 5 x 5, and so for 8 px around
//! ```
//!
//! Rests are integers, in parts of a step of gray values, and clipped: from `MOST` on, one alone makes more
//! detail than any bound. So the sums of their squares have no error, and fit into 32 bits.
//!
//! In a blank area the codes are those of rounding, or of nothing. A pixel there may match, and even agree
//! with others, but not by what the image shows.

use crate::scales::choices::{BLANK, BLANK_DEPTH, BLANK_LEAST, DETAIL_RADIUS, SMOOTH_RADIUS};
use crate::scales::flat_areas::{grown, shrunk};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, TASK_ROWS};
use phasestereo_match::base::simd::{Level, leveled, whole};
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::runtime::Runtime;

/// Parts of a step of gray values that a rest has.
const PARTS: i32 = 16;
/// Largest rest, in these parts: the sum of its squares over a window fits into 32 bits.
const MOST: i32 = 7000;
const _: () = assert!((MOST as u64).pow(2) * ((2 * DETAIL_RADIUS + 1) as u64).pow(2) <= u32::MAX as u64);

/// The detail around each pixel of an image.
pub struct Detail {
    /// Mean squares, in squares of parts of a step.
    squares: Plane<f32>,
    /// One step of rounding, in the same parts.
    rounding: f64,
}

impl Detail {
    /// The detail of an image of gray values of 15 bits, which were rounded to multiples of this step; 0:
    /// floats.
    pub fn new(gray: &Plane<i32>, rounding: f64, runtime: Runtime) -> Result<Self> {
        let size = gray.size();
        let means = Windows::new(size, SMOOTH_RADIUS);
        let rest = Plane::by_bands(size, TASK_ROWS, |first, band| {
            runtime.control.checkpoint()?;
            let values = |y: usize| gray.row(y).iter().map(|gray| [*gray]);
            means.write((first, band), values, |_, _, [sum]: [i32; 1]| sum, runtime.level())?;
            for (y, rests) in (first..).zip(band.chunks_exact_mut(size.1)) {
                write_rests(runtime.level(), means, y, gray.row(y), rests);
            }
            Ok(())
        })?;

        let around = Windows::new(size, DETAIL_RADIUS);
        let values = |y: usize| rest.row(y).iter().map(|rest| [(rest * rest) as u32]);
        let mean = move |y: usize, x: usize, [sum]: [u32; 1]| sum as f32 / around.pixels(y, x) as f32;
        let squares = around.plane(values, mean, runtime.level(), runtime.control)?;

        Ok(Self { squares, rounding: rounding * f64::from(PARTS) })
    }

    /// Whether gray values were rounded, so that hardly any detail is more than none.
    pub fn is_rounded(&self) -> bool {
        self.rounding > 0.0
    }

    /// The pixels whose detail is at most this number of steps of rounding.
    pub fn at_most(&self, steps: f64) -> Plane<bool> {
        let side = (2 * DETAIL_RADIUS + 1) as f64;
        let most = (steps * self.rounding).min(f64::from(MOST - 1) / side).powi(2) as f32;
        self.squares.map(|square| *square <= most)
    }

    /// The pixels deep in blank areas; `None`: there are none.
    pub fn blank(&self, runtime: Runtime) -> Result<Option<Plane<bool>>> {
        let blank = self.at_most(BLANK);
        if !blank.as_slice().contains(&true) {
            return Ok(None);
        }

        let wide = shrunk(&blank, BLANK_LEAST, runtime)?;
        let wide = grown(&wide, BLANK_LEAST, runtime)?;
        shrunk(&wide, BLANK_DEPTH, runtime).map(Some)
    }
}

/// Makes rests of the sums of gray values over the windows of row `y`.
#[leveled]
fn write_rests(level: Level, means: Windows, y: usize, gray: &[i32], rests: &mut [i32]) {
    for (x, (rest, gray)) in rests.iter_mut().zip(gray).enumerate() {
        let count = means.pixels(y, x) as i32;
        let parts = PARTS * (count * gray - *rest);
        // Exact: floats of such quotients are finer than one part of the largest window.
        let quotient = parts.clamp(-MOST * count, MOST * count) as f32 / count as f32;
        *rest = whole(quotient) as i32;
    }
}

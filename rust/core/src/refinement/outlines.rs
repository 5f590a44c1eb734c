//! Draws the outlines of surfaces to edges of the image: near a jump of the disparities each pixel takes the weighted
//! median of the disparities around it, weighted by similarity of the gray values and by distance.
//!
//! ```text
//! for pixels within NEAR of a jump:
//!     weight of each around = max(0, 1 - difference of gray values / (LIKENESS * mean difference of neighbors))
//!                           * Gaussian of the distance
//!     disparity = the weighted median
//! ```
//!
//! Its window is larger than that of [`guided_median`](crate::refinement::guided_median), and its weights are gradual. That
//! pays where an image is blurred: there outlines are wide ramps and maps are off by more pixels.
//!
//! Wrong pixels of four scenes under four blurs, after [`synthesis`](crate::refinement::synthesis): 22.5 %; with these 49
//! pixels, or 81, or 25 of the same span: 21.3, 21.3, 21.4; by the three color channels, which takes longer: 21.2.
//!
//! Arithmetic is in 16-bit integers, many pixels side by side: disparities are counted in steps from the pixel's own, and
//! the median is found by bisection.

use std::array::from_fn;

use crate::error::Result;
use crate::image::plane::{Plane, parts, zeroed};
use crate::image::texture::{Roughness, Texture};
use crate::pipeline::control::Control;
use crate::refinement::jumps::Mark;
use crate::simd::{Level, Loop};

/// Every third row and column of a window counts.
pub const STRIDE: usize = 3;
/// Rows and columns of a window that count, on either side.
pub const STEPS: usize = 3;
/// Pixels that the window of a pixel reaches in each direction.
pub const REACH: usize = STEPS * STRIDE;
/// Pixels from a jump, up, down, left and right, within which there may be change. 7: 21.4 % wrong, as above; 10 and
/// 14: 21.3.
pub const NEAR: usize = 8;
/// Mean differences of horizontal neighbors from which on gray values have nothing in common: their weight is 0.
/// From 12 to 24 it makes no difference.
pub const LIKENESS: f64 = 16.0;
/// Steps of a disparity to the pixel.
pub const FINENESS: f32 = 8.0;
/// Steps of gray values to the difference of [`LIKENESS`].
pub const GRAYS: f64 = 255.0;

/// Largest magnitude of gray values in these steps.
const FARTHEST: f64 = 16_383.0;
/// The gray value of pixels that do not count: further from any other than weights reach.
const NOTHING: i16 = i16::MAX;
/// Gaussian of standard deviation 6 pixels, in 256ths, by the distance in strides along rows and columns.
pub const WEIGHTS: [[u16; STEPS + 1]; STEPS + 1] =
    [[255, 226, 155, 83], [226, 199, 137, 73], [155, 137, 94, 50], [83, 73, 50, 27]];

/// Pixels of a window that count, in a row.
const SIDE: usize = 2 * STEPS + 1;
/// Pixels of a window that count, in all.
const PLACES: usize = SIDE * SIDE;
/// Pixels that are drawn at a time.
const LANES: usize = 32;
/// Columns that their windows reach.
const SPAN: usize = LANES + 2 * REACH;
/// Rows of a band; jumps and gray values in its halo are computed again.
const BAND: usize = 64;

/// Writes the map with the outlines of surfaces drawn to edges of the image.
pub fn draw(
    disparity: &Plane<f32>,
    texture: &Texture,
    drawn: &mut Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let scale = scale(texture.roughness);
    drawn.write_bands(BAND, |first, out| {
        control.checkpoint()?;
        let count = out.len() / cols;

        // Row 0 of these planes is row `first - REACH` of the map; rows beyond the image do not count.
        let mut grays = Plane::new(count + 2 * REACH, cols)?;
        let mut steps = Plane::new(count + 2 * REACH, cols)?;
        for row in 0..grays.rows() {
            if let Some(y) = (first + row).checked_sub(REACH).filter(|y| *y < rows) {
                let disparity = disparity.row(y);
                let gray = texture.gray.row(y);
                let grays = grays.row_mut(row);
                let steps = steps.row_mut(row);
                level.run(Quantize { disparity, gray, scale, grays, steps });
            } else {
                grays.row_mut(row).fill(NOTHING);
            }
        }

        let mut jumps = Plane::new(count + 2 * NEAR, cols)?;
        for row in 0..jumps.rows() {
            if let Some(y) = (first + row).checked_sub(NEAR).filter(|y| *y < rows) {
                let here = disparity.row(y);
                let below = disparity.row((y + 1).min(rows - 1));
                level.run(Mark::<NEAR> { here, below, jumps: jumps.row_mut(row) });
            }
        }

        let mut near = zeroed(cols)?;
        for (y, out) in out.chunks_mut(cols).enumerate() {
            near.fill(0);
            for away in 0..=2 * NEAR {
                level.run(Or { row: jumps.row(y + away), near: &mut near });
            }

            let row = |k: usize| y + k * STRIDE;
            let grays = from_fn(|k| grays.row(row(k)));
            let steps = from_fn(|k| steps.row(row(k)));
            level.run(Draw { disparity: disparity.row(first + y), grays, steps, near: &near, out });
        }

        Ok(())
    })
}

/// Steps per unit of the gray values, such that [`GRAYS`] steps are [`LIKENESS`] mean differences of neighbors.
pub fn scale(roughness: Roughness) -> f32 {
    (GRAYS / (LIKENESS * roughness.mean()).max(1.0)) as f32
}

/// Converts gray values and disparities of a row to steps. Pixels without a disparity do not count.
struct Quantize<'a> {
    disparity: &'a [f32],
    gray: &'a [i32],
    scale: f32,
    grays: &'a mut [i16],
    steps: &'a mut [i32],
}

impl Loop for Quantize<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.grays.len();
        let (disparity, gray) = (&self.disparity[..n], &self.gray[..n]);
        let (grays, steps) = (&mut self.grays[..n], &mut self.steps[..n]);

        for x in 0..n {
            let level = (gray[x] as f32 * self.scale).clamp(-FARTHEST as f32, FARTHEST as f32);
            grays[x] = if disparity[x].is_nan() { NOTHING } else { level as i32 as i16 };
            // NaN becomes 0 steps; its gray value takes its weight away.
            steps[x] = (disparity[x] * FINENESS) as i32;
        }
    }
}

/// Adds the marks of a row to those of the rows before.
struct Or<'a> {
    row: &'a [u8],
    near: &'a mut [u8],
}

impl Loop for Or<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (near, row) in self.near.iter_mut().zip(self.row) {
            *near |= row;
        }
    }
}

/// Draws one row, from the rows of its windows.
struct Draw<'a> {
    disparity: &'a [f32],
    grays: [&'a [i16]; SIDE],
    steps: [&'a [i32]; SIDE],
    near: &'a [u8],
    out: &'a mut [f32],
}

impl Loop for Draw<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut gray_buffer = [[0; SPAN]; SIDE];
        let mut step_buffer = [[0; SPAN]; SIDE];

        for (index, out) in self.out.chunks_mut(LANES).enumerate() {
            let x = index * LANES;
            let own = &self.disparity[x..][..out.len()];
            let near = &self.near[x..][..out.len()];
            out.copy_from_slice(own);
            // Most pixels are far from any jump.
            if near.iter().all(|near| *near == 0) {
                continue;
            }

            let first = x as isize - REACH as isize;
            let grays = parts(self.grays, first, &mut gray_buffer, |_, _| NOTHING);
            let steps = parts(self.steps, first, &mut step_buffer, |_, _| 0);
            let away = away(steps);
            let weights = weights(grays);
            let median = median(&away, &weights);

            for (j, out) in out.iter_mut().enumerate() {
                let is_drawn = (near[j] != 0) & (median[j] != 0) & !own[j].is_nan();
                *out = if is_drawn { own[j] + f32::from(median[j]) / FINENESS } else { own[j] };
            }
        }
    }
}

/// One value for each of [`LANES`] neighboring pixels.
type PixelLanes<T> = [T; LANES];

/// The disparities in the windows less the pixel's own, in steps.
#[inline(always)]
fn away(steps: [&[i32]; SIDE]) -> [PixelLanes<i16>; PLACES] {
    let mut away = [[0; LANES]; PLACES];
    let own = &steps[STEPS][REACH..][..LANES];

    for (place, away) in away.iter_mut().enumerate() {
        let steps = &steps[place / SIDE][place % SIDE * STRIDE..][..LANES];
        for j in 0..LANES {
            let difference = steps[j].wrapping_sub(own[j]);
            away[j] = difference.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        }
    }

    away
}

/// The weights of the pixels in the windows, by gray value and distance; 0 for pixels that do not count.
#[inline(always)]
fn weights(grays: [&[i16]; SIDE]) -> [PixelLanes<u16>; PLACES] {
    let mut weights = [[0; LANES]; PLACES];
    let own = &grays[STEPS][REACH..][..LANES];

    for (place, weights) in weights.iter_mut().enumerate() {
        let (row, column) = (place / SIDE, place % SIDE);
        let grays = &grays[row][column * STRIDE..][..LANES];
        let largest = WEIGHTS[row.abs_diff(STEPS)][column.abs_diff(STEPS)];

        for j in 0..LANES {
            let alike = (GRAYS as u16).saturating_sub(grays[j].abs_diff(own[j]));
            weights[j] = (alike * largest) >> 8;
        }
    }

    weights
}

/// The weighted median: the least value such that half of the weight is not above it; 0 where there is no weight.
///
/// By bisection between the least and the largest value with any weight, for all pixels until the last one has its median.
#[inline(always)]
fn median(
    values: &[PixelLanes<i16>; PLACES],
    weights: &[PixelLanes<u16>; PLACES],
) -> PixelLanes<i16> {
    let mut low = [0; LANES];
    let mut high = [0; LANES];
    let mut total = [0; LANES];

    for place in 0..PLACES {
        widen(&values[place], &weights[place], [&mut low, &mut high]);
        for j in 0..LANES {
            total[j] += weights[place][j];
        }
    }

    while low != high {
        let mut middle = [0; LANES];
        let mut below = [0; LANES];
        for j in 0..LANES {
            // The mean rounded down, without the overflow of a sum.
            middle[j] = (low[j] & high[j]) + ((low[j] ^ high[j]) >> 1);
        }

        for place in 0..PLACES {
            add_where(&values[place], &middle, &weights[place], &mut below);
        }

        for j in 0..LANES {
            let is_low = 2 * below[j] >= total[j];
            let (least, most) = (middle[j].wrapping_add(1), middle[j]);
            // Pixels that have their median stay as they are.
            low[j] = if is_low | (low[j] == high[j]) { low[j] } else { least };
            high[j] = if is_low & (low[j] != high[j]) { most } else { high[j] };
        }
    }

    low
}

/// Widens the range to values that have any weight, by masks as in [`add_where`].
#[inline(always)]
fn widen(
    values: &PixelLanes<i16>,
    weights: &PixelLanes<u16>,
    [low, high]: [&mut PixelLanes<i16>; 2],
) {
    for j in 0..LANES {
        let mask = i16::from(weights[j] != 0).wrapping_neg();
        let value = values[j] & mask;
        low[j] = low[j].min(value);
        high[j] = high[j].max(value);
    }
}

/// Adds the weights of values up to `most`. By masks: a choice would be compiled pixel by pixel.
#[inline(always)]
fn add_where(
    values: &PixelLanes<i16>,
    most: &PixelLanes<i16>,
    weights: &PixelLanes<u16>,
    sums: &mut PixelLanes<u16>,
) {
    for j in 0..LANES {
        let mask = u16::from(values[j] <= most[j]).wrapping_neg();
        sums[j] += weights[j] & mask;
    }
}

//! Guided median: aligns depth edges with those of the image. Near a jump of the disparities, each pixel
//! takes the median of the disparities around it, weighted by similarity of the gray values and by distance.
//!
//! ```text
//! for pixels within NEAR of a jump:
//!     weight of each pixel around = likeness(difference of gray values / mean difference of neighbors)
//!                                   * nearness(distance)
//!     disparity = the weighted median; of two in the middle, the smaller one: that of the background
//! ```
//!
//! Costs are summed over windows and paths, which moves the edges of surfaces by a few pixels. The left-right
//! check does not detect that, and filling does not use the image. Away from jumps nothing changes. Gray
//! values are compared in units of the mean difference of neighbors, so the result does not depend on
//! contrast.
//!
//! | | pixels of a window | within | likeness | nearness |
//! |---|---|---|---|---|
//! | [`GuidedMedian::Narrow`] | 5 x 5, every second one | 4 px | 1 up to one mean difference, else 0 | 1 |
//! | [`GuidedMedian::Wide`] | 7 x 7, every third one | 8 px | falls from 1 to 0 at 16 mean differences | Gaussian of 6 px |
//!
//! Every map takes the narrow median, which keeps thin objects. After the [`synthesis`] of a blurred image,
//! edges are wide ramps and off by more pixels, so the wide median follows. Sampled windows are as accurate
//! as full ones.
//!
//! Arithmetic uses 16-bit integers, many pixels side by side: disparities are counted in steps from the
//! pixel's own, and the median is found by bisection.

use std::array::from_fn;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, parts, zeroed};
use crate::base::simd::{Level, Loop, leveled, whole};
use crate::choices::LEAST_ROUGHNESS;
use crate::image::texture::{Roughness, Texture};
use crate::pair::plan::{Plan, Stage};
use crate::refinement::jumps::Mark;
use crate::refinement::synthesis;

/// The two guided medians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuidedMedian {
    /// For every map.
    Narrow,
    /// For the map of a blurred image.
    Wide,
}

/// Windows of `SIDE` x `SIDE` pixels, `STRIDE` rows or columns apart, for pixels within `NEAR` of a jump.
#[derive(Debug, Clone, Copy)]
struct JumpWindows<const SIDE: usize, const STRIDE: usize, const NEAR: usize> {
    /// Steps of gray values per mean difference of horizontal neighbors.
    fineness: f64,
    /// Smallest difference of gray values, in these steps, with weight 0.
    unlike: u16,
    /// Growth of weights per step below it, up to [`MOST`].
    growth: u16,
    /// Weights by the distance in strides along rows and columns.
    nearness: fn(usize, usize) -> u16,
}

type NarrowWindows = JumpWindows<5, 2, 4>;
type WideWindows = JumpWindows<7, 3, 8>;

/// Windows of 9 x 9 pixels.
const NARROW: NarrowWindows =
    NarrowWindows { fineness: 32.0, unlike: 33, growth: MOST, nearness: |_, _| MOST };
/// Windows of 19 x 19 pixels.
const WIDE: WideWindows = WideWindows {
    fineness: 255.0 / 16.0,
    unlike: 255,
    growth: 1,
    nearness: |down, along| WEIGHTS[down][along],
};

/// Gaussian of standard deviation 6 pixels, in 256ths, by the distance in strides of 3.
const WEIGHTS: [[u16; 4]; 4] =
    [[255, 226, 155, 83], [226, 199, 137, 73], [155, 137, 94, 50], [83, 73, 50, 27]];
/// The weight of equal gray values, and of the nearest pixels.
const MOST: u16 = 255;
/// Steps of a disparity per pixel.
const FINENESS: f32 = 8.0;

/// Largest magnitude of gray values in their steps.
const FARTHEST: f64 = 16_383.0;
/// The gray value of pixels that do not count: weights do not reach this far from any other value.
const NOTHING: i16 = i16::MAX;

/// Pixels that are filtered at a time.
const LANES: usize = 32;
/// Most columns that their windows reach.
const SPAN: usize = LANES + 2 * WideWindows::REACH;
/// Rows of a band; jumps and gray values in its halo are computed again.
const BAND: usize = 64;

impl Stage for GuidedMedian {
    fn reach(&self, Plan { settings, compensation, .. }: Plan) -> usize {
        let is_used = match self {
            Self::Narrow => settings.guided_median,
            Self::Wide => synthesis::is_asked_for(settings, compensation),
        };
        if is_used { self.rows() } else { 0 }
    }
}

impl GuidedMedian {
    /// Rows on either side of a pixel that its disparity depends on. A jump between two rows belongs to both.
    const fn rows(self) -> usize {
        match self {
            Self::Narrow => NarrowWindows::REACH + 1,
            Self::Wide => WideWindows::REACH + 1,
        }
    }

    /// Writes the filtered map.
    pub fn filter(
        self,
        disparity: &Plane<f32>,
        texture: &Texture,
        filtered: &mut Plane<f32>,
        level: Level,
        control: &Control,
    ) -> Result<()> {
        match self {
            Self::Narrow => NARROW.filter(disparity, texture, filtered, level, control),
            Self::Wide => WIDE.filter(disparity, texture, filtered, level, control),
        }
    }
}

impl<const SIDE: usize, const STRIDE: usize, const NEAR: usize> JumpWindows<SIDE, STRIDE, NEAR> {
    /// Pixels that the window of a pixel reaches in each direction.
    const REACH: usize = SIDE / 2 * STRIDE;

    fn filter(
        self,
        disparity: &Plane<f32>,
        texture: &Texture,
        filtered: &mut Plane<f32>,
        level: Level,
        control: &Control,
    ) -> Result<()> {
        let (rows, cols) = (disparity.rows(), disparity.cols());
        let scale = self.scale(texture.roughness);
        let center = SIDE / 2;
        let nearness =
            from_fn(|row| from_fn(|column| (self.nearness)(row.abs_diff(center), column.abs_diff(center))));

        filtered.write_bands(BAND, |first, out| {
            control.checkpoint()?;
            let count = out.len() / cols;

            // Row 0 of these planes is row `first - REACH` of the map; rows beyond the image do not count.
            let mut grays = Plane::new(count + 2 * Self::REACH, cols)?;
            let mut steps = Plane::new(count + 2 * Self::REACH, cols)?;
            for row in 0..grays.rows() {
                if let Some(y) = (first + row).checked_sub(Self::REACH).filter(|y| *y < rows) {
                    let disparity = disparity.row(y);
                    let gray = texture.gray.row(y);
                    let grays = grays.row_mut(row);
                    let steps = steps.row_mut(row);
                    quantize(level, disparity, gray, scale, grays, steps);
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
                    or(level, jumps.row(y + away), &mut near);
                }

                let row = |k: usize| y + k * STRIDE;
                let grays = from_fn(|k| grays.row(row(k)));
                let steps = from_fn(|k| steps.row(row(k)));
                let disparity = disparity.row(first + y);
                let (windows, nearness, near) = (self, &nearness, &near);
                level.run(Filter { windows, nearness, disparity, grays, steps, near, out });
            }

            Ok(())
        })
    }

    /// Steps per unit of the gray values.
    fn scale(self, roughness: Roughness) -> f32 {
        (self.fineness / roughness.mean().max(LEAST_ROUGHNESS)) as f32
    }
}

/// Converts gray values and disparities of a row to steps. Pixels without a disparity do not count.
#[leveled]
fn quantize(level: Level, disparity: &[f32], gray: &[i32], scale: f32, grays: &mut [i16], steps: &mut [i32]) {
    let n = grays.len();
    let (disparity, gray) = (&disparity[..n], &gray[..n]);
    let (grays, steps) = (&mut grays[..n], &mut steps[..n]);

    for x in 0..n {
        let level = (gray[x] as f32 * scale).clamp(-FARTHEST as f32, FARTHEST as f32);
        grays[x] = if disparity[x].is_nan() { NOTHING } else { whole(level) as i16 };
        // NaN becomes 0 steps; its gray value sets its weight to 0.
        steps[x] = whole(disparity[x] * FINENESS);
    }
}

/// Adds the marks of a row to those of the rows before.
#[leveled]
fn or(level: Level, row: &[u8], near: &mut [u8]) {
    for (near, row) in near.iter_mut().zip(row) {
        *near |= row;
    }
}

/// Filters one row, from the rows of its windows.
struct Filter<'a, const SIDE: usize, const STRIDE: usize, const NEAR: usize> {
    windows: JumpWindows<SIDE, STRIDE, NEAR>,
    /// The weight of the place of each pixel of a window.
    nearness: &'a [[u16; SIDE]; SIDE],
    disparity: &'a [f32],
    grays: [&'a [i16]; SIDE],
    steps: [&'a [i32]; SIDE],
    near: &'a [u8],
    out: &'a mut [f32],
}

impl<const SIDE: usize, const STRIDE: usize, const NEAR: usize> Loop for Filter<'_, SIDE, STRIDE, NEAR> {
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

            let first = x as isize - JumpWindows::<SIDE, STRIDE, NEAR>::REACH as isize;
            let grays = parts(self.grays, first, &mut gray_buffer, |_, _| NOTHING);
            let steps = parts(self.steps, first, &mut step_buffer, |_, _| 0);
            let away = JumpWindows::<SIDE, STRIDE, NEAR>::away(steps);
            let weights = self.windows.weights(self.nearness, grays);
            let median = median(away.as_flattened(), weights.as_flattened());

            for (j, out) in out.iter_mut().enumerate() {
                let is_moved = (near[j] != 0) & (median[j] != 0) & !own[j].is_nan();
                *out = if is_moved { own[j] + f32::from(median[j]) / FINENESS } else { own[j] };
            }
        }
    }
}

/// One value for each of [`LANES`] neighboring pixels.
type PixelLanes<T> = [T; LANES];

impl<const SIDE: usize, const STRIDE: usize, const NEAR: usize> JumpWindows<SIDE, STRIDE, NEAR> {
    /// The disparities in the windows minus the pixel's own, in steps.
    #[inline(always)]
    fn away(steps: [&[i32]; SIDE]) -> [[PixelLanes<i16>; SIDE]; SIDE] {
        let mut away = [[[0; LANES]; SIDE]; SIDE];
        let own = &steps[SIDE / 2][Self::REACH..][..LANES];

        for (steps, away) in steps.into_iter().zip(&mut away) {
            for (column, away) in away.iter_mut().enumerate() {
                let steps = &steps[column * STRIDE..][..LANES];
                for j in 0..LANES {
                    let difference = steps[j].wrapping_sub(own[j]);
                    away[j] = difference.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
                }
            }
        }

        away
    }

    /// The weights of the pixels in the windows, by gray value and distance; 0 for pixels that do not count.
    #[inline(always)]
    fn weights(
        self,
        nearness: &[[u16; SIDE]; SIDE],
        grays: [&[i16]; SIDE],
    ) -> [[PixelLanes<u16>; SIDE]; SIDE] {
        let mut weights = [[[0; LANES]; SIDE]; SIDE];
        let own = &grays[SIDE / 2][Self::REACH..][..LANES];

        for ((grays, nearness), weights) in grays.into_iter().zip(nearness).zip(&mut weights) {
            for (column, (weights, nearness)) in weights.iter_mut().zip(nearness).enumerate() {
                let grays = &grays[column * STRIDE..][..LANES];
                for j in 0..LANES {
                    let likeness = self.unlike.saturating_sub(grays[j].abs_diff(own[j]));
                    let likeness = (likeness * self.growth).min(MOST);
                    weights[j] = (likeness * nearness) >> 8;
                }
            }
        }

        weights
    }
}

/// The weighted median: the smallest value such that half of the weight is not above it; 0 without weight.
///
/// By bisection between the smallest and the largest value with any weight, for all pixels until the last one
/// is done.
#[inline(always)]
fn median(values: &[PixelLanes<i16>], weights: &[PixelLanes<u16>]) -> PixelLanes<i16> {
    let mut low = [0; LANES];
    let mut high = [0; LANES];
    let mut total = [0; LANES];

    for (values, weights) in values.iter().zip(weights) {
        widen(values, weights, [&mut low, &mut high]);
        for j in 0..LANES {
            total[j] += weights[j];
        }
    }

    while low != high {
        let mut middle = [0; LANES];
        let mut below = [0; LANES];
        for j in 0..LANES {
            // The mean, rounded down, without overflow of the sum.
            middle[j] = (low[j] & high[j]) + ((low[j] ^ high[j]) >> 1);
        }

        for (values, weights) in values.iter().zip(weights) {
            add_where(values, &middle, weights, &mut below);
        }

        for j in 0..LANES {
            let is_low = 2 * below[j] >= total[j];
            let (least, most) = (middle[j].wrapping_add(1), middle[j]);
            // Finished pixels stay unchanged.
            low[j] = if is_low | (low[j] == high[j]) { low[j] } else { least };
            high[j] = if is_low & (low[j] != high[j]) { most } else { high[j] };
        }
    }

    low
}

/// Widens the range to values with any weight, using masks as in [`add_where`].
#[inline(always)]
fn widen(values: &PixelLanes<i16>, weights: &PixelLanes<u16>, [low, high]: [&mut PixelLanes<i16>; 2]) {
    for j in 0..LANES {
        let mask = i16::from(weights[j] != 0).wrapping_neg();
        let value = values[j] & mask;
        low[j] = low[j].min(value);
        high[j] = high[j].max(value);
    }
}

/// Adds the weights of values up to `most`. It uses masks: a choice would be compiled pixel by pixel.
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

//! Draws edges in depth to those of the image: near a jump of the disparities each pixel takes the median of the
//! disparities around it whose pixels have a similar gray value.
//!
//! Costs are summed over windows and paths, which moves the edges of surfaces by a few pixels. The left-right check does
//! not see that, and filling does not look at the image. Away from jumps everything stays as it is.

use std::array::from_fn;

use crate::error::Result;
use crate::image::plane::{Plane, parts};
use crate::image::texture::{Roughness, Texture};
use crate::pipeline::control::Control;
use crate::refinement::jumps::Mark;
use crate::refinement::median::{
    KeyLanes, LANES, NONE, disparity as disparity_of, keys_of, lanes, median25,
};
use crate::simd::{Level, Loop};

/// Pixels that a window reaches in each direction.
pub const REACH: usize = 4;
/// Every second row and column of a window counts: as good as all of them, and better than as many adjacent pixels. Wrong
/// pixels over twelve scenes with 5 x 5 pixels of 5 x 5, 9 x 9, 13 x 13 and 17 x 17: 5.9, 5.7, 5.8 and 6.2 %.
pub const STRIDE: usize = 2;

/// Pixels of a window that count, in a row.
const SIDE: usize = 2 * REACH / STRIDE + 1;
/// Pixels of a window that count, in all.
const PLACES: usize = SIDE * SIDE;
/// Columns that the windows of neighboring pixels reach.
const SPAN: usize = LANES + 2 * REACH;
/// Rows of a band; jumps in its halo are searched again.
const BAND: usize = 32;

/// The map with the median of similar pixels near jumps. Of two values in the middle the smaller disparity is taken, that
/// of the background. Gray values are similar if they differ by no more than the mean difference of neighbors in the
/// image, which holds for any contrast.
pub fn guide(
    disparity: &Plane<f32>,
    texture: &Texture,
    guided: &mut Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<()> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let tolerance = likeness(texture.roughness);
    guided.write_bands(BAND, |first, band| {
        control.checkpoint()?;
        let count = band.len() / cols;

        // Row 0 of the jumps is row `first - REACH` of the map.
        let mut jumps = vec![0; (count + 2 * REACH) * cols];
        for (y, jumps) in (first..).zip(jumps.chunks_mut(cols)) {
            if let Some(y) = y.checked_sub(REACH).filter(|y| *y < rows) {
                let here = disparity.row(y);
                let below = disparity.row((y + 1).min(rows - 1));
                level.run(Mark::<REACH> { here, below, jumps });
            }
        }

        for (y, out) in band.chunks_mut(cols).enumerate() {
            // Row `y` of the band is row `y + REACH` of the jumps.
            let near = from_fn(|row| &jumps[(y + row) * cols..][..cols]);
            let row = |k: usize| (first + y + k * STRIDE) as isize - REACH as isize;
            let disparity = from_fn(|k| disparity.row_or_nothing(row(k)));
            let gray = from_fn(|k| texture.gray.row_or_nothing(row(k)));
            level.run(Guide { disparity, gray, near, tolerance, out });
        }

        Ok(())
    })
}

/// The mean difference of horizontal neighbors, rounded up.
pub fn likeness(roughness: Roughness) -> i32 {
    roughness.ceiling() as i32
}

/// Writes one row, from the rows of its windows and the jumps of all rows within reach.
struct Guide<'a> {
    disparity: [&'a [f32]; SIDE],
    gray: [&'a [i32]; SIDE],
    near: [&'a [u8]; 2 * REACH + 1],
    tolerance: i32,
    out: &'a mut [f32],
}

impl Loop for Guide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut buffer = [[0.0; SPAN]; SIDE];
        let mut gray_buffer = [[0; SPAN]; SIDE];
        let mut near_buffer = [[0; LANES]; 2 * REACH + 1];

        for (index, out) in self.out.chunks_mut(LANES).enumerate() {
            let x = index * LANES;

            let mut near = [0; LANES];
            for row in parts(self.near, x as isize, &mut near_buffer, |_, _| 0) {
                let row = &row[..LANES];
                for j in 0..LANES {
                    near[j] |= row[j];
                }
            }

            // Most pixels are far from any jump.
            if near == [0; LANES] {
                out.copy_from_slice(&self.disparity[SIDE / 2][x..][..out.len()]);
                continue;
            }

            let first = x as isize - REACH as isize;
            let keys = keys_of(parts(self.disparity, first, &mut buffer, |_, _| f32::NAN));
            let grays = parts(self.gray, first, &mut gray_buffer, |_, _| 0);
            let median = median25(similar_keys(&keys, grays, self.tolerance));
            let center = lanes(&keys[SIDE / 2], REACH);

            let mut guided = [0.0; LANES];
            for j in 0..LANES {
                let is_guided = (near[j] != 0) & (center[j] != NONE);
                guided[j] = disparity_of(if is_guided { median[j] } else { center[j] });
            }

            out.copy_from_slice(&guided[..out.len()]);
        }
    }
}

/// The keys in the windows of neighboring pixels. A key that does not count is replaced by the least and the largest value
/// in turn, so that the median of the others stays in the middle.
#[inline(always)]
fn similar_keys(
    keys: &[[i32; SPAN]; SIDE],
    grays: [&[i32]; SIDE],
    tolerance: i32,
) -> [KeyLanes; PLACES] {
    let center = lanes(grays[SIDE / 2], REACH);
    let mut far = [i32::MIN; LANES];
    let mut kept = [[NONE; LANES]; PLACES];

    for (place, kept) in kept.iter_mut().enumerate() {
        let column = place % SIDE * STRIDE;
        let key = lanes(&keys[place / SIDE], column);
        let gray = lanes(grays[place / SIDE], column);

        for j in 0..LANES {
            let is_other = ((gray[j] - center[j]).abs() > tolerance) | (key[j] == NONE);
            // All bits or none: a mask, since a choice would be compiled pixel by pixel.
            let other = -i32::from(is_other);
            kept[j] = key[j] & !other | far[j] & other;
            far[j] ^= other;
        }
    }

    kept
}

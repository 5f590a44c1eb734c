//! Edges in depth are drawn to those of the image: near a jump of the disparities a pixel takes the median of
//! those about it that are of like gray value.
//!
//! Costs are summed over windows and paths, which moves the edges of surfaces by a few pixels, past the
//! check too, and filling knows nothing of the image. Away from jumps everything stays as it is.

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
/// Of the rows and columns of a window every second one is looked at: that is as good as all, and better than as
/// many pixels side by side. Wrong pixels over twelve scenes with 5 x 5 pixels of 5 x 5, 9 x 9, 13 x 13
/// and 17 x 17: 5.9, 5.7, 5.8 and 6.2 %.
pub const STRIDE: usize = 2;

/// Pixels of a window in a row, and in all.
const SIDE: usize = 2 * REACH / STRIDE + 1;
const PLACES: usize = SIDE * SIDE;
/// Columns that the windows of neighboring pixels reach.
const SPAN: usize = LANES + 2 * REACH;
/// Rows of a band: of those about it, jumps are looked for again.
const BAND: usize = 32;

/// The map with the median of like pixels near jumps (of two in the middle the smaller disparity, which is that
/// of the background). Like are pixels whose gray values differ by no more than those of neighbors in the
/// image do on average, which is the same for any contrast.
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
        // From row `first - REACH` on.
        let mut jumps = vec![0; (count + 2 * REACH) * cols];
        for (y, jumps) in (first..).zip(jumps.chunks_mut(cols)) {
            if let Some(y) = y.checked_sub(REACH).filter(|y| *y < rows) {
                let (here, below) = (disparity.row(y), disparity.row((y + 1).min(rows - 1)));
                level.run(Mark::<REACH> { here, below, jumps });
            }
        }
        for (y, out) in band.chunks_mut(cols).enumerate() {
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

/// One row, from those that its windows look at, and from what [`Mark`] tells of all within reach.
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
        let (mut room, mut gray_room) = ([[0.0; SPAN]; SIDE], [[0; SPAN]; SIDE]);
        let mut near_room = [[0; LANES]; 2 * REACH + 1];
        for (index, out) in self.out.chunks_mut(LANES).enumerate() {
            let x = index * LANES;
            let mut near = [0; LANES];
            for row in parts(self.near, x as isize, &mut near_room, |_, _| 0) {
                let row = &row[..LANES];
                for j in 0..LANES {
                    near[j] |= row[j];
                }
            }
            if near == [0; LANES] {
                out.copy_from_slice(&self.disparity[SIDE / 2][x..][..out.len()]);
                continue;
            }
            let first = x as isize - REACH as isize;
            let keys = keys_of(parts(self.disparity, first, &mut room, |_, _| f32::NAN));
            let grays = parts(self.gray, first, &mut gray_room, |_, _| 0);
            let median = median25(like(&keys, grays, self.tolerance));
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

/// The keys in the windows of neighboring pixels; in place of those that do not count in turn one below and
/// one above all, so that what is in the middle stays there.
#[inline(always)]
fn like(keys: &[[i32; SPAN]; SIDE], grays: [&[i32]; SIDE], tolerance: i32) -> [KeyLanes; PLACES] {
    let center = lanes(grays[SIDE / 2], REACH);
    let mut far = [i32::MIN; LANES];
    let mut kept = [[NONE; LANES]; PLACES];
    for (place, kept) in kept.iter_mut().enumerate() {
        let column = place % SIDE * STRIDE;
        let key = lanes(&keys[place / SIDE], column);
        let gray = lanes(grays[place / SIDE], column);
        for j in 0..LANES {
            let is_other = ((gray[j] - center[j]).abs() > tolerance) | (key[j] == NONE);
            // All bits or none.
            let other = -i32::from(is_other);
            kept[j] = key[j] & !other | far[j] & other;
            far[j] ^= other;
        }
    }
    kept
}

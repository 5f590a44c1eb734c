//! Draws edges in depth to those of the image: near a jump of the disparities each pixel takes the median of the
//! disparities around it whose pixels have a similar gray value.
//!
//! Costs are summed over windows and paths, which moves the edges of surfaces by a few pixels. The left-right check does
//! not see that, and filling does not look at the image. Away from jumps everything stays as it is.

use std::array::from_fn;

use crate::error::Result;
use crate::image::plane::Plane;
use crate::image::texture::{Roughness, Texture};
use crate::pipeline::control::Control;
use crate::refinement::jumps::Mark;
use crate::refinement::median::{NONE, disparity as disparity_of, median25, write_keys};
use crate::refinement::window_rows::{BAND, WindowRows, missing_rows};
use crate::simd::{Level, Loop};

/// Pixels that a window reaches in each direction.
pub const REACH: usize = 4;
/// Every second row and column of a window counts: as good as all of them, and better than as many adjacent pixels. Wrong
/// pixels over twelve scenes with 5 x 5 pixels of 5 x 5, 9 x 9, 13 x 13 and 17 x 17: 5.9, 5.7, 5.8 and 6.2 %.
pub const STRIDE: usize = 2;

/// Rows that a window reaches.
const ROWS: usize = 2 * REACH + 1;
/// Pixels of a window that count, in a row.
const SIDE: usize = 2 * REACH / STRIDE + 1;
/// Pixels of a window that count, in all.
const PLACES: usize = SIDE * SIDE;
/// Pixels that are looked at together: where none of them is near a jump, nothing is done.
const LANES: usize = 16;

/// Columns that their windows reach.
const SPAN: usize = LANES + 2 * REACH;
/// The gray value of pixels without a disparity: similar to no other.
const UNLIKE: i32 = i32::MIN / 2;

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

        let rows =
            KeyedRows { keys: WindowRows::new(cols, NONE)?, grays: WindowRows::new(cols, UNLIKE)? };
        let (jumps, near) = (&jumps, vec![0; cols.next_multiple_of(LANES)]);
        level.run(Guide { disparity, texture, first, rows, jumps, near, tolerance, band });
        Ok(())
    })
}

/// The mean difference of horizontal neighbors, rounded up.
pub fn likeness(roughness: Roughness) -> i32 {
    roughness.ceiling() as i32
}

/// The rows within reach of one row; row `y` of the map is number `y + REACH`.
struct KeyedRows {
    keys: WindowRows<i32, ROWS>,
    grays: WindowRows<i32, ROWS>,
}

impl KeyedRows {
    /// Copies the row of this number; pixels beyond the map and those without a disparity are like no other.
    #[inline(always)]
    fn copy(&mut self, number: usize, disparity: &Plane<f32>, texture: &Texture) {
        let (keys, grays) = (self.keys.row_mut(number), self.grays.row_mut(number));
        let Some(y) = number.checked_sub(REACH).filter(|y| *y < disparity.rows()) else {
            grays.fill(UNLIKE);
            return;
        };

        write_keys(disparity.row(y), keys);
        for ((to, from), key) in grays.iter_mut().zip(texture.gray.row(y)).zip(keys) {
            *to = if *key == NONE { UNLIKE } else { *from };
        }
    }
}

/// Writes a band of rows, of which `first` is the first.
struct Guide<'a> {
    disparity: &'a Plane<f32>,
    texture: &'a Texture,
    first: usize,
    rows: KeyedRows,
    /// Which pixels of the band and of [`REACH`] rows around it are near a jump of their row.
    jumps: &'a [u8],
    /// Which pixels of a row are near a jump; zeros up to a multiple of [`LANES`].
    near: Vec<u8>,
    tolerance: i32,
    band: &'a mut [f32],
}

impl Loop for Guide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { disparity, texture, first, mut rows, jumps, mut near, tolerance, band } = self;
        let cols = disparity.cols();

        for (index, out) in band.chunks_mut(cols).enumerate() {
            let y = first + index;
            for number in missing_rows::<ROWS>(y, first) {
                rows.copy(number, disparity, texture);
            }

            near.fill(0);
            for row in jumps[index * cols..][..ROWS * cols].chunks(cols) {
                for (near, jump) in near.iter_mut().zip(row) {
                    *near |= jump;
                }
            }

            // Most pixels are far from any jump.
            out.copy_from_slice(disparity.row(y));
            let keys = from_fn(|k| rows.keys.row(y + k * STRIDE, REACH));
            let grays = from_fn(|k| rows.grays.row(y + k * STRIDE, REACH));

            for (part, (out, near)) in out.chunks_mut(LANES).zip(near.as_chunks().0).enumerate() {
                if *near != [0; LANES] {
                    let [keys, grays] =
                        [keys, grays].map(|rows| rows.map(|row: &[i32]| &row[part * LANES..]));

                    let guided = guided(keys, grays, near, tolerance);
                    out.copy_from_slice(&guided[..out.len()]);
                }
            }
        }
    }
}

/// The medians of similar pixels around [`LANES`] neighboring pixels, where they are near a jump.
#[inline(always)]
fn guided(
    keys: [&[i32]; SIDE],
    grays: [&[i32]; SIDE],
    near: &[u8; LANES],
    tolerance: i32,
) -> [f32; LANES] {
    let nothing = [UNLIKE; SPAN];
    let keys = keys.map(|row| row.first_chunk::<SPAN>().unwrap_or(&nothing));
    let grays = grays.map(|row| row.first_chunk::<SPAN>().unwrap_or(&nothing));

    let mut guided = [0.0; LANES];
    for x in 0..LANES {
        let (key, gray) = (keys[SIDE / 2][x + REACH], grays[SIDE / 2][x + REACH]);

        // A key that does not count is replaced by the least and the largest value in turn, so that the median of the others
        // stays in the middle.
        let mut far = i32::MIN;
        let mut window = [NONE; PLACES];
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = x + column * STRIDE;
                // All bits or none: a mask, since a choice would become a branch.
                let other = -i32::from((grays[row][at] - gray).abs() > tolerance);
                window[row * SIDE + column] = keys[row][at] & !other | far & other;
                far ^= other;
            }
        }

        let is_guided = (near[x] != 0) & (key != NONE);
        guided[x] = disparity_of(if is_guided { median25(window) } else { key });
    }
    guided
}

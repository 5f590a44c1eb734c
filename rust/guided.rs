//! Edges in depth are drawn to those of the image: near a jump of the disparities a pixel takes the median of
//! those about it that are of like gray value.
//!
//! Costs are summed over windows and paths, which moves the edges of surfaces by a few pixels, past the
//! check too, and filling knows nothing of the image. Away from jumps everything stays as it is.

use std::array::from_fn;

use crate::control::Control;
use crate::error::Result;
use crate::median::{
    BAND, LANES, Lanes, NONE, Padded, disparity as disparity_of, key, lanes, median25,
};
use crate::plane::Plane;
use crate::simd::{Kernel, Level};
use crate::texture::{Roughness, Texture};

/// Pixels that a window reaches in each direction.
pub const REACH: usize = 4;
/// Of the rows and columns of a window every second one is looked at: that is as good as all, and better than as
/// many pixels side by side. Wrong pixels over twelve scenes with 5 x 5 pixels of 5 x 5, 9 x 9, 13 x 13
/// and 17 x 17: 5.9, 5.7, 5.8 and 6.2 %.
pub const STRIDE: usize = 2;
/// Neighbouring disparities further apart than this are a jump, pixels.
pub const JUMP: f32 = 1.0;

/// Pixels of a window in a row, and in all.
const SIDE: usize = 2 * REACH / STRIDE + 1;
const PLACES: usize = SIDE * SIDE;

/// The map with the median of like pixels near jumps (of two in the middle the smaller disparity, which is that
/// of the background). Like are pixels whose gray values differ by no more than those of neighbours in the
/// image do on average, which is the same for any contrast.
pub fn guide(
    disparity: &Plane<f32>,
    texture: &Texture,
    level: Level,
    control: &Control,
) -> Result<Plane<f32>> {
    let size = (disparity.rows(), disparity.cols());
    let tolerance = likeness(texture.roughness);
    Plane::by_bands(size, BAND, |first, out| {
        control.checkpoint()?;
        let count = out.len() / size.1;
        let rows = first as isize - REACH as isize..(first + count + REACH) as isize;
        let near = near_jumps(disparity, first, count);
        let keys = Padded::new(disparity, rows.clone(), REACH, key, |_| NONE)?;
        let grays = Padded::new(&texture.gray, rows, REACH, |gray| gray, |gray| gray)?;
        let rows = out.chunks_mut(size.1).zip(near.chunks(size.1)).enumerate();
        for (y, (out, near)) in rows {
            let keys = from_fn(|row| keys.row(y + row * STRIDE));
            let grays = from_fn(|row| grays.row(y + row * STRIDE));
            level.run(Guide { keys, grays, near, tolerance, out });
        }
        Ok(())
    })
}

/// The mean difference of horizontal neighbours, rounded up.
pub fn likeness(roughness: Roughness) -> i32 {
    roughness.ceiling() as i32
}

/// Which pixels of `count` rows have one within reach that differs from its right or lower neighbour by a jump:
/// bytes that are not 0.
fn near_jumps(disparity: &Plane<f32>, first: usize, count: usize) -> Vec<u8> {
    let (rows, cols) = (disparity.rows(), disparity.cols());
    let mut near = vec![0; count * cols];
    let (mut jumps, mut wide) = (vec![0; cols + 2 * REACH], vec![0; cols]);
    for y in first.saturating_sub(REACH)..(first + count + REACH).min(rows) {
        let (here, below) = (disparity.row(y), disparity.row((y + 1).min(rows - 1)));
        let inside = &mut jumps[REACH..][..cols];
        for (jump, (a, b)) in inside.iter_mut().zip(here.iter().zip(below)) {
            *jump = u8::from((a - b).abs() > JUMP);
        }
        for (jump, (a, b)) in inside.iter_mut().zip(here.iter().zip(&here[1..])) {
            *jump |= u8::from((a - b).abs() > JUMP);
        }
        wide.fill(0);
        (0..=2 * REACH).for_each(|shift| mark(&mut wide, &jumps[shift..]));
        let last = (y + REACH + 1).saturating_sub(first).min(count);
        for y in y.saturating_sub(first + REACH)..last {
            mark(&mut near[y * cols..][..cols], &wide);
        }
    }
    near
}

fn mark(marks: &mut [u8], others: &[u8]) {
    marks.iter_mut().zip(others).for_each(|(mark, other)| *mark |= other);
}

/// One row, from those that its windows look at, with as many more columns on either side as they reach.
struct Guide<'a> {
    /// Of disparities; none beside the image.
    keys: [&'a [i32]; SIDE],
    grays: [&'a [i32]; SIDE],
    near: &'a [u8],
    tolerance: i32,
    out: &'a mut [f32],
}

impl Kernel for Guide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let chunks = self.out.chunks_mut(LANES).zip(self.near.chunks(LANES));
        for (chunk, (out, near)) in chunks.enumerate() {
            let x = chunk * LANES;
            let centre = lanes(self.keys[SIDE / 2], x + REACH);
            let mut guided = centre;
            if near.iter().any(|&near| near != 0) {
                let median = median25(like(self.keys, self.grays, x, self.tolerance));
                for (j, &near) in near.iter().enumerate() {
                    guided[j] =
                        if (near != 0) & (centre[j] != NONE) { median[j] } else { centre[j] };
                }
            }
            for (out, &key) in out.iter_mut().zip(&guided) {
                *out = disparity_of(key);
            }
        }
    }
}

/// The keys in the windows of the pixels from `x` on; in place of those that do not count in turn one below and
/// one above all, so that what is in the middle stays there.
#[inline(always)]
fn like(keys: [&[i32]; SIDE], grays: [&[i32]; SIDE], x: usize, tolerance: i32) -> [Lanes; PLACES] {
    let centre = lanes(grays[SIDE / 2], x + REACH);
    let mut far = [i32::MIN; LANES];
    let mut kept = [[NONE; LANES]; PLACES];
    for (place, kept) in kept.iter_mut().enumerate() {
        let column = x + place % SIDE * STRIDE;
        let (key, gray) = (lanes(keys[place / SIDE], column), lanes(grays[place / SIDE], column));
        for j in 0..LANES {
            let is_other = ((gray[j] - centre[j]).abs() > tolerance) | (key[j] == NONE);
            // All bits or none.
            let other = -i32::from(is_other);
            kept[j] = key[j] & !other | far[j] & other;
            far[j] ^= other;
        }
    }
    kept
}

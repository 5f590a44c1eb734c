//! Where the disparities jump: what is near may be moved to the edges of the image, by [`guided`](crate::refinement::guided_median) and
//! [`outlines`](crate::refinement::outlines).

use crate::image::plane::parts;
use crate::simd::Loop;

/// Neighboring disparities further apart than this are a jump, pixels.
pub const JUMP: f32 = 1.0;

/// Pixels side by side.
const LANES: usize = 32;
/// Pixels that are looked at to either side, at most.
const MOST_REACH: usize = 8;
/// Columns that may jump within reach of those side by side.
const AROUND: usize = LANES + 2 * MOST_REACH;

/// Which pixels of a row are within reach of one, in that row, that differs from its right or lower neighbor by a
/// jump: bytes that are not 0.
pub struct Mark<'a, const REACH: usize> {
    /// Disparities of the row.
    pub here: &'a [f32],
    /// Disparities of the row below it.
    pub below: &'a [f32],
    /// What is told.
    pub jumps: &'a mut [u8],
}

impl<const REACH: usize> Loop for Mark<'_, REACH> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const { assert!(REACH <= MOST_REACH, "the room is too small") };
        let mut room = [[0.0; AROUND + 1]; 2];
        for (index, out) in self.jumps.chunks_mut(LANES).enumerate() {
            let first = (index * LANES) as isize - REACH as isize;
            let [here, below] = parts([self.here, self.below], first, &mut room, |_, _| f32::NAN);
            let (here, next, below) = (&here[..AROUND], &here[1..][..AROUND], &below[..AROUND]);
            let mut jump = [0; AROUND];
            for j in 0..AROUND {
                let steps = [(here[j] - below[j]).abs(), (here[j] - next[j]).abs()];
                jump[j] = u8::from((steps[0] > JUMP) | (steps[1] > JUMP));
            }
            let mut near = [0; LANES];
            for away in 0..=2 * REACH {
                for j in 0..LANES {
                    near[j] |= jump[away + j];
                }
            }
            out.copy_from_slice(&near[..out.len()]);
        }
    }
}

//! Where the disparities jump. Pixels nearby take the
//! [guided median](crate::refinement::guided_median).

use crate::base::plane::parts;
use crate::base::simd::Loop;
use crate::choices::JUMP;

/// Pixels that are marked at a time.
const LANES: usize = 32;
/// Largest reach, pixels.
const MOST_REACH: usize = 8;
/// Columns whose jumps matter for these pixels.
const AROUND: usize = LANES + 2 * MOST_REACH;

/// Marks, with nonzero bytes, the pixels of a row within reach of a jump in the same row to the right or
/// lower neighbor.
pub struct Mark<'a, const REACH: usize> {
    /// Disparities of the row.
    pub here: &'a [f32],
    /// Disparities of the row below it.
    pub below: &'a [f32],
    /// The marks, writable.
    pub jumps: &'a mut [u8],
}

impl<const REACH: usize> Loop for Mark<'_, REACH> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const { assert!(REACH <= MOST_REACH, "the buffer is too small") };

        let mut buffer = [[0.0; AROUND + 1]; 2];
        for (index, out) in self.jumps.chunks_mut(LANES).enumerate() {
            let first = (index * LANES) as isize - REACH as isize;
            // Differences with NaN are not jumps: there are none beyond the image.
            let [here, below] = parts([self.here, self.below], first, &mut buffer, |_, _| f32::NAN);
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

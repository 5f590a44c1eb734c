//! Absolute differences of gray levels, or of values derived from them.

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::value::Value;
use crate::cost::unrolled::UnrolledPlane;
use crate::cost::{Lines, RowPart};
use crate::pair::candidates::Candidates;

/// The levels of the left and of the unrolled right image.
pub struct Differences {
    left: Plane<u16>,
    right: UnrolledPlane<u16>,
}

impl Differences {
    /// The differences of two images.
    pub fn new([left, right]: [Plane<u16>; 2], candidates: Candidates) -> Result<Self> {
        let right = UnrolledPlane::new(&right, candidates, |level| level)?;
        Ok(Self { left, right })
    }

    /// Writes the costs of a part of a row.
    #[inline(always)]
    pub fn write<V: Value, const L: usize>(&self, (y, columns, searched): RowPart, out: &mut Lines<V, L>) {
        for (place, x) in columns.enumerate() {
            let (left, right) = (self.left.row(y)[x], self.right.under(y, x, searched));
            write_differences(left, right, out.line(place));
        }
    }

    /// The cost of a left pixel and the one at a place of the unrolled right image.
    pub fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        self.left.row(y)[x].abs_diff(self.right.row(y)[place]).into()
    }
}

#[inline(always)]
fn write_differences<V: Value, const L: usize>(left: u16, right: &[u16; L], out: &mut [V; L]) {
    for j in 0..L {
        out[j] = V::truncated(left.abs_diff(right[j]).into());
    }
}

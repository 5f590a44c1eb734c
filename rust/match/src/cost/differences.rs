//! Sums over the channels of absolute differences.

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::value::Value;
use crate::cost::unrolled::UnrolledPlane;
use crate::cost::{Lines, RowPart, clear};
use crate::pair::candidates::Candidates;

/// The channels of the left and of the unrolled right image.
pub struct Differences(Vec<(Plane<u16>, UnrolledPlane<u16>)>);

impl Differences {
    /// The differences of the channels of two images.
    pub fn new([left, right]: [Vec<Plane<u16>>; 2], candidates: Candidates) -> Result<Self> {
        let unrolled = |right: Plane<u16>| UnrolledPlane::new(&right, candidates, |level| level);
        let channels =
            left.into_iter().zip(right).map(|(left, right)| Ok((left, unrolled(right)?)));

        Ok(Self(channels.collect::<Result<_>>()?))
    }

    /// Writes the costs of a part of a row.
    #[inline(always)]
    pub fn write<V: Value, const L: usize>(
        &self,
        (y, columns, searched): RowPart,
        out: &mut Lines<V, L>,
    ) {
        clear(out);
        for (left, right) in &self.0 {
            for (place, x) in columns.clone().enumerate() {
                let (left, right) = (left.row(y)[x], right.under(y, x, searched));
                add_differences(left, right, out.line(place));
            }
        }
    }

    /// The cost of a left pixel with the one at a place of the unrolled right image.
    pub fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        let difference = |(left, right): &(Plane<u16>, UnrolledPlane<u16>)| {
            u32::from(left.row(y)[x].abs_diff(right.row(y)[place]))
        };
        self.0.iter().map(difference).sum()
    }
}

#[inline(always)]
fn add_differences<V: Value, const L: usize>(left: u16, right: &[u16; L], out: &mut [V; L]) {
    for j in 0..L {
        out[j] = out[j].plus(V::truncated(left.abs_diff(right[j]).into()));
    }
}

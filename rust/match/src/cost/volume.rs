//! Costs given by the caller.

use crate::base::plane::Plane;
use crate::base::value::Value;
use crate::cost::{Lines, RowPart};

/// Rows of `columns x candidates`.
pub struct Volume<'a> {
    costs: &'a Plane<u16>,
    candidates: usize,
}

impl<'a> Volume<'a> {
    /// The costs of `candidates` of each pixel.
    pub fn new(costs: &'a Plane<u16>, candidates: usize) -> Self {
        Self { costs, candidates }
    }

    /// Columns of the image.
    pub fn cols(&self) -> usize {
        self.costs.cols() / self.candidates
    }

    /// Writes the costs of a part of a row.
    #[inline(always)]
    pub fn write<V: Value, const L: usize>(&self, (y, columns, searched): RowPart, out: &mut Lines<V, L>) {
        let count = self.candidates;
        let costs = self.costs.row(y)[columns.start * count..].chunks_exact(count);
        for (place, costs) in costs.take(columns.len()).enumerate() {
            let lanes = out.line(place).iter_mut().zip(&costs[searched.start..]);
            lanes.for_each(|(out, cost)| *out = V::truncated((*cost).into()));
        }
    }

    /// The cost of a left pixel and the one at a place of an unrolled right image; `None`: not a candidate.
    pub fn between(&self, y: usize, x: usize, place: usize) -> Option<u32> {
        let column = self.cols() - 1 - place;
        let candidate = x.checked_sub(column).filter(|candidate| *candidate < self.candidates)?;
        Some(self.costs.row(y)[x * self.candidates + candidate].into())
    }
}

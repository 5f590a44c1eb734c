//! The valid pairs of a pixel and a candidate: both pixels must be valid.

use std::ops::Range;

use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::value::Value;
use crate::cost::unrolled::UnrolledPlane;
use crate::cost::{Lines, RowPart};
use crate::image::view::{Mask, View};
use crate::pair::candidates::{Candidates, Searched};

/// The valid pairs of two images, at least one of which is masked: 1 where a pixel is valid, else 0.
#[derive(Debug)]
pub struct Validity {
    left: Plane<u8>,
    right: UnrolledPlane<u8>,
    candidates: usize,
}

impl Validity {
    /// The valid pairs of two images; `None` if neither has a mask.
    pub fn new([left, right]: [&View; 2], candidates: Candidates) -> Result<Option<Self>> {
        let masks = [left.mask(), right.mask()];
        if masks.iter().all(Option::is_none) {
            return Ok(None);
        }

        let (rows, cols) = left.size();
        let everywhere = Mask::from_fn(rows, cols, |_, _| true);
        let [left, right] = masks.map(|mask| mask.unwrap_or(&everywhere));
        Ok(Some(Self {
            left: left.map(|valid| u8::from(*valid)),
            right: UnrolledPlane::new(right, candidates, u8::from)?,
            candidates: candidates.count(),
        }))
    }

    /// Whether the left pixel is masked.
    pub fn is_masked(&self, y: usize, x: usize) -> bool {
        self.left.row(y)[x] == 0
    }

    /// Whether the left pixel and its candidate `k` are both valid.
    #[inline(always)]
    pub fn is_valid(&self, y: usize, x: usize, k: usize) -> bool {
        self.are_valid(y, x, self.left.cols() - 1 - x + k)
    }

    /// Whether a left pixel and the one at a place of the unrolled right image are both valid.
    #[inline(always)]
    pub fn are_valid(&self, y: usize, x: usize, place: usize) -> bool {
        self.left.row(y)[x] & self.right.row(y)[place] != 0
    }

    /// Whether any candidate of a left pixel is valid.
    pub fn has_candidate(&self, y: usize, x: usize) -> bool {
        self.right.row(y)[self.left.cols() - 1 - x..][..self.candidates].contains(&1)
    }

    /// Sets the values of invalid pairs in the lines of some columns to 0.
    #[inline(always)]
    pub fn mask<V: Value, const L: usize>(&self, (y, columns, searched): RowPart, out: &mut Lines<V, L>) {
        let left = &self.left.row(y)[columns.clone()];
        for (pixel, (x, left)) in columns.zip(left).enumerate() {
            mask_out(*left, self.right.under(y, x, searched), out.line(pixel));
        }
    }

    /// Writes 1 for each valid pair into the lines of some columns, else 0.
    #[inline(always)]
    pub fn write<V: Value, const L: usize>(&self, (y, columns, searched): RowPart, out: &mut Lines<V, L>) {
        let left = &self.left.row(y)[columns.clone()];
        for (pixel, (x, left)) in columns.zip(left).enumerate() {
            mark_valid(*left, self.right.under(y, x, searched), out.line(pixel));
        }
    }
}

/// 1 for the candidates that are valid together with their pixel, else 0: computed in registers, since the
/// output may not overlap the inputs.
#[inline(always)]
fn both_valid<const L: usize>(left: u8, right: &[u8; L]) -> [u8; L] {
    let mut both = *right;
    for both in &mut both {
        *both &= left;
    }
    both
}

#[inline(always)]
fn mark_valid<V: Value, const L: usize>(left: u8, right: &[u8; L], out: &mut [V; L]) {
    let both = both_valid(left, right);
    for j in 0..L {
        out[j] = V::truncated(both[j].into());
    }
}

#[inline(always)]
fn mask_out<V: Value, const L: usize>(left: u8, right: &[u8; L], out: &mut [V; L]) {
    let both = both_valid(left, right);
    for j in 0..L {
        // All bits or none: the compiler handles a choice lane by lane.
        out[j] = V::truncated(out[j].widened() & u64::from(both[j]).wrapping_neg());
    }
}

/// How much of a set of pairs is valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// All of it.
    All,
    /// Some of it; or none, though both images have valid pixels.
    Part,
    /// Nothing: all pixels of an image are masked.
    Nothing,
}

/// The validity of the rows of a block.
#[derive(Debug)]
pub struct BlockValidity {
    left: Census,
    right: Census,
    /// The place of the unrolled right image that column 0 meets under candidate 0.
    origin: usize,
}

impl BlockValidity {
    /// Covers some rows and columns, and the places these meet under the searched candidates. `None`: all is
    /// valid.
    pub fn new(
        validity: &Validity,
        rows: &Range<usize>,
        columns: &Range<usize>,
        searched: Searched,
    ) -> Option<Self> {
        let Validity { left, right, .. } = validity;
        let origin = left.cols() - 1;
        let left = Census::new(left, rows, columns);
        let right = Census::new(right.plane(), rows, &places(origin, columns, searched));

        let block = Self { left, right, origin };
        (block.extent(columns, searched) != Extent::All).then_some(block)
    }

    /// How much of some columns is valid under some candidates, in all rows.
    pub fn extent(&self, columns: &Range<usize>, searched: Searched) -> Extent {
        let left = self.left.extent(columns);
        let right = self.right.extent(&places(self.origin, columns, searched));
        if left == right || right == Extent::Nothing {
            right
        } else if left == Extent::Nothing {
            left
        } else {
            Extent::Part
        }
    }
}

/// The places of an unrolled row that some columns meet under some candidates.
fn places(origin: usize, columns: &Range<usize>, searched: Searched) -> Range<usize> {
    let first = origin + searched.start;
    first + 1 - columns.end..first + searched.count - columns.start
}

/// Counts, among neighboring columns, those with a masked pixel, and those with a valid one.
#[derive(Debug)]
struct Census {
    first: usize,
    /// Before each column, and before the one after the last.
    masked: Vec<u32>,
    valid: Vec<u32>,
}

impl Census {
    fn new(plane: &Plane<u8>, rows: &Range<usize>, columns: &Range<usize>) -> Self {
        let [mut all, mut any] = [vec![1; columns.len()], vec![0; columns.len()]];
        for y in rows.clone() {
            let row = &plane.row(y)[columns.clone()];
            for ((all, any), valid) in all.iter_mut().zip(&mut any).zip(row) {
                *all &= valid;
                *any |= valid;
            }
        }

        let masked = sums_before(all.iter().map(|all| 1 - all));
        Self { first: columns.start, masked, valid: sums_before(any.into_iter()) }
    }

    fn extent(&self, columns: &Range<usize>) -> Extent {
        let [start, end] = [columns.start, columns.end].map(|column| column - self.first);
        if self.masked[start] == self.masked[end] {
            Extent::All
        } else if self.valid[start] == self.valid[end] {
            Extent::Nothing
        } else {
            Extent::Part
        }
    }
}

/// The sum of the numbers before each one, and of all.
fn sums_before(numbers: impl Iterator<Item = u8>) -> Vec<u32> {
    let sums = numbers.scan(0, |sum, number| {
        *sum += u32::from(number);
        Some(*sum)
    });
    std::iter::once(0).chain(sums).collect()
}

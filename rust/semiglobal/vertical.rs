//! Paths from row to row: straight and on both diagonals, every column of a group in a lane of its own.

use std::array::from_fn;
use std::mem::swap;
use std::ops::Range;

use crate::edges::{Edges, Neighbour};
use crate::error::Result;
use crate::memory::Memory;
use crate::semiglobal::Far;
use crate::semiglobal::across::Rows;
use crate::semiglobal::selection::Selection;
use crate::semiglobal::volume::{GROUP, Volume};
use crate::simd::Kernel;
use crate::value::Value;

/// Where paths come from in the row before: its column to the left, the same, the one to the right.
const WAYS: usize = 3;

/// A value for each column of a group.
type Lanes<T> = [T; GROUP];

/// Totals of the paths to the candidates of a row: of one way after another, candidate after candidate, column
/// after column, between zeros. A path that begins at the edge of the image comes from zeros.
#[derive(Debug)]
struct Totals<T> {
    candidates: usize,
    stride: usize,
    values: Memory<T>,
    /// The least of each way and column.
    least: Memory<T>,
}

impl<T> Default for Totals<T> {
    fn default() -> Self {
        Self { candidates: 0, stride: 0, values: Memory::default(), least: Memory::default() }
    }
}

impl<T: Value> Totals<T> {
    fn begin(&mut self, groups: usize, candidates: usize) -> Result<()> {
        // An odd number of cache lines, if of bytes: then not all candidates contend for the same few sets.
        (self.candidates, self.stride) = (candidates, 2 * GROUP * ((groups + 2).div_ceil(2) | 1));
        self.values.room(WAYS * candidates * self.stride)?;
        self.least.room(WAYS * self.stride)?;
        self.values.fill(T::default());
        self.least.fill(T::default());
        Ok(())
    }

    /// Copies groups from those of another, with which they begin at `first`, and `to` here.
    fn take(&mut self, other: &Self, first: usize, to: usize, groups: usize) {
        let count = groups * GROUP;
        let copy = |ours: &mut Memory<T>, stride: usize, theirs: &Memory<T>| {
            let rows = ours.chunks_exact_mut(stride).zip(theirs.chunks_exact(other.stride));
            for (ours, theirs) in rows {
                ours[to * GROUP..][..count].copy_from_slice(&theirs[first * GROUP..][..count]);
            }
        };
        copy(&mut self.values, self.stride, &other.values);
        copy(&mut self.least, self.stride, &other.least);
    }
}

/// Paths that go on from row to row, over some groups of columns.
#[derive(Debug)]
pub struct Vertical<T> {
    groups: usize,
    before: Totals<T>,
    here: Totals<T>,
}

impl<T> Default for Vertical<T> {
    fn default() -> Self {
        Self { groups: 0, before: Totals::default(), here: Totals::default() }
    }
}

impl<T: Value> Vertical<T> {
    /// Begins paths at the edge of the image.
    pub fn begin(&mut self, groups: usize, candidates: usize) -> Result<()> {
        self.groups = groups;
        self.before.begin(groups, candidates)?;
        self.here.begin(groups, candidates)
    }

    /// Goes on where others are, of which these are the groups `range`.
    pub fn branch_off(
        &mut self,
        whole: &Self,
        range: &Range<usize>,
        candidates: usize,
    ) -> Result<()> {
        self.begin(range.len(), candidates)?;
        self.before.take(&whole.before, range.start, 0, range.len() + 2);
        Ok(())
    }

    /// Takes over where some groups of others are, that branched off at the group `first`.
    pub fn join(&mut self, part: &Self, first: usize, range: &Range<usize>) {
        self.before.take(&part.before, range.start - first + 1, range.start + 1, range.len());
    }

    #[inline(always)]
    fn advance_group<V: Value>(
        &mut self,
        group: usize,
        near: T,
        costs: &[Lanes<V>],
        far: [Lanes<T>; WAYS],
        mut hand_on: impl FnMut(usize, [Lanes<T>; WAYS]),
    ) {
        let Self { before, here, .. } = self;
        let (count, stride) = (costs.len(), before.stride);
        let first = (group + 1) * GROUP;
        let came = |way: usize| first + way - 1;
        let least: [Lanes<T>; WAYS] = from_fn(|way| lanes(&before.least, way * stride + came(way)));
        let run = |way: usize| &before.values[way * count * stride..][..count * stride];
        let runs: [&[T]; WAYS] = from_fn(run);
        let relative = |k: usize, way: usize| -> Lanes<T> {
            let total = lanes(runs[way], k * stride + came(way));
            from_fn(|j| total[j].minus(least[way][j]))
        };
        let mut below = [[T::FAR; GROUP]; WAYS];
        let mut now: [Lanes<T>; WAYS] = from_fn(|way| relative(0, way));
        let mut least_here = [[T::FAR; GROUP]; WAYS];
        for k in 0..count {
            let mut totals = [[T::default(); GROUP]; WAYS];
            for way in 0..WAYS {
                let above = if k + 1 < count { relative(k + 1, way) } else { [T::FAR; GROUP] };
                for j in 0..GROUP {
                    let changed = below[way][j].min(above[j]).plus_penalty(near);
                    let best = now[way][j].min(far[way][j]).min(changed);
                    totals[way][j] = best.plus(T::truncated(costs[k][j].widened()));
                    least_here[way][j] = least_here[way][j].min(totals[way][j]);
                }
                let place = (way * count + k) * stride + first;
                here.values[place..][..GROUP].copy_from_slice(&totals[way]);
                (below[way], now[way]) = (now[way], above);
            }
            hand_on(k, totals);
        }
        for way in 0..WAYS {
            here.least[way * stride + first..][..GROUP].copy_from_slice(&least_here[way]);
        }
    }
}

#[inline(always)]
fn lanes<T: Copy + Default>(values: &[T], first: usize) -> Lanes<T> {
    let mut lanes = [T::default(); GROUP];
    lanes.copy_from_slice(&values[first..first + GROUP]);
    lanes
}

/// Jumps of the gray values to a group of columns from some neighbour, in a row of the image: from the column
/// `shift - 1` places to the right on; none beyond the image.
#[inline(always)]
fn jumps(
    edges: Option<&Edges>,
    y: usize,
    group: usize,
    shift: usize,
    neighbour: Neighbour,
) -> [u8; GROUP] {
    let mut jumps = [0; GROUP];
    if let Some(edges) = edges {
        let row = edges.row(y);
        let (first, skipped) = match (group * GROUP + shift).checked_sub(1) {
            Some(first) => (first, 0),
            None => (0, 1),
        };
        let there = &row[first.min(row.len())..];
        for (jump, edges) in jumps[skipped..].iter_mut().zip(there) {
            *jump = neighbour.jump(*edges);
        }
    }
    jumps
}

/// Paths from below, through the rows of a band, from some rows of the next one on.
pub struct Up<'a, V, T> {
    /// Where they are kept.
    pub paths: &'a mut Vertical<T>,
    /// The rows of the band and of the next one.
    pub rows: [Option<&'a Rows<V, T>>; 2],
    /// The first row of the band, its last one, and that where paths begin.
    pub places: [usize; 3],
    /// Jumps of the gray values.
    pub edges: Option<&'a Edges>,
    /// The penalties.
    pub penalties: (T, Far<T>),
    /// A quarter of the sum of the totals, for the rows of the band.
    pub sums: &'a mut Volume<T>,
}

impl<V: Value, T: Value> Kernel for Up<'_, V, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { paths, rows, places: [first, last, start], edges, penalties, sums } = self;
        let (near, far) = penalties;
        let height = last + 1 - first;
        for y in (first..=start).rev() {
            let row = y - first;
            let Some(here) = rows[row / height.max(1)] else { continue };
            let row = row % height.max(1);
            for group in 0..paths.groups {
                let far = from_fn(|way| {
                    let from = Neighbour::ABOVE[WAYS - 1 - way];
                    let below = (y < start).then_some(edges).flatten();
                    jumps(below, y + 1, group, way, from).map(|jump| far.after(jump))
                });
                let costs = here.costs.of(row, group);
                if y <= last {
                    let sums = sums.of_mut(row, group);
                    paths.advance_group(group, near, costs, far, |k, [a, b, c]| {
                        sums[k] = from_fn(|j| quarter([a[j], b[j], c[j]]));
                    });
                } else {
                    paths.advance_group(group, near, costs, far, |_, _| ());
                }
            }
            swap(&mut paths.before, &mut paths.here);
        }
    }
}

/// A quarter of the sum, rounded.
#[inline(always)]
fn quarter<T: Value>(totals: [T; WAYS]) -> T {
    let [a, b, c] = totals.map(wide);
    T::truncated(a.plus(b).plus(c).plus(T::Wide::truncated(2)).shifted(2).widened())
}

#[inline(always)]
fn wide<T: Value>(value: T) -> T::Wide {
    T::Wide::truncated(value.widened())
}

/// Paths from above, through the rows of a band, and what all paths come to.
pub struct Down<'a, V, T: Value> {
    /// Where they are kept.
    pub paths: &'a mut Vertical<T>,
    /// The first group of columns that they cover.
    pub first_group: usize,
    /// The rows of the band.
    pub rows: &'a Rows<V, T>,
    /// Which of the image they are.
    pub places: Range<usize>,
    /// What [`Up`] came to.
    pub from_below: &'a Volume<T>,
    /// Jumps of the gray values.
    pub edges: Option<&'a Edges>,
    /// The penalties.
    pub penalties: (T, Far<T>),
    /// What is best by all paths.
    pub selection: &'a mut Selection<T::Wide>,
}

impl<V: Value, T: Value> Kernel for Down<'_, V, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { paths, first_group, rows, places, from_below, edges, penalties, selection } =
            self;
        let (near, far) = penalties;
        for (row, y) in places.enumerate() {
            for local in 0..paths.groups {
                let group = first_group + local;
                let far = from_fn(|way| {
                    jumps(edges, y, group, 1, Neighbour::ABOVE[way]).map(|jump| far.after(jump))
                });
                let (costs, across) = (rows.costs.of(row, group), rows.totals.of(row, group));
                let up = &from_below.of(row, group)[..costs.len()];
                let across = &across[..costs.len()];
                let sums = selection.sums(costs.len());
                paths.advance_group(local, near, costs, far, |k, [a, b, c]| {
                    sums[k] = from_fn(|j| sum([a[j], b[j], c[j]], across[k][j], up[k][j]));
                });
                selection.select(row, group);
            }
            swap(&mut paths.before, &mut paths.here);
        }
    }
}

/// The sum of eight totals: of three from above, of two along the row, of which the mean is given, and of three
/// from below, of which a quarter is.
#[inline(always)]
fn sum<T: Value>(above: [T; WAYS], across: T, below: T) -> T::Wide {
    let [a, b, c] = above.map(wide);
    let twice = wide(below).plus(wide(below)).plus(wide(across));
    a.plus(b).plus(c).plus(twice).plus(twice)
}

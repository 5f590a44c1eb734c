//! Paths from row to row: straight and on both diagonals, every column of a group in a lane of its own.

use std::mem::swap;
use std::ops::Range;

use crate::edges::{Edges, Neighbour};
use crate::error::{Error, Result};
use crate::memory::Memory;
use crate::semiglobal::Far;
use crate::semiglobal::across::Rows;
use crate::semiglobal::selection::Selection;
use crate::semiglobal::volume::{GROUP, Volume};
use crate::simd::Kernel;
use crate::value::{Value, read};

/// Where paths come from in the row before: its column to the left, the same, the one to the right.
const WAYS: usize = 3;

/// A value for each column of a group.
type Lanes<T> = [T; GROUP];

/// Where the totals of each way begin in a [`Run`]; between the last and the first way there is room for one column
/// of the groups on either side.
const PLACES: [usize; WAYS] = [2 * GROUP, 3 * GROUP, 0];
/// The first column of the group to the right, by the last way.
const FROM_RIGHT: usize = GROUP;
/// The last column of the group to the left, by the first way.
const FROM_LEFT: usize = 2 * GROUP - 1;

/// Totals of the paths to a candidate, of a group of columns.
type Run<T> = [T; 4 * GROUP];

/// Totals of the paths to the candidates of a row: of one group of columns after another, so that they are read
/// one behind the other, between two groups that nobody reads. What lies beside a group, and is looked at from there,
/// is kept a second time with it; beyond the image there are zeros, as if paths began there.
#[derive(Debug)]
struct Totals<T> {
    candidates: usize,
    values: Memory<T>,
    /// The least of each way and column, between zeros.
    least: [Memory<T>; WAYS],
}

impl<T> Default for Totals<T> {
    fn default() -> Self {
        Self { candidates: 0, values: Memory::default(), least: Default::default() }
    }
}

impl<T: Value> Totals<T> {
    fn begin(&mut self, groups: usize, candidates: usize) -> Result<()> {
        self.candidates = candidates;
        self.values.room((groups + 2) * candidates * size_of::<Run<u8>>())?;
        self.values.fill(T::default());
        self.least.iter_mut().try_for_each(|least| {
            least.room((groups + 2) * GROUP)?;
            least.fill(T::default());
            Ok(())
        })
    }

    #[inline(always)]
    fn runs(&self, group: usize) -> &[Run<T>] {
        &self.values.as_chunks().0[(group + 1) * self.candidates..][..self.candidates]
    }

    /// The runs of a group, and of those to its left and to its right.
    #[inline(always)]
    fn around(&mut self, group: usize) -> [&mut [Run<T>]; 3] {
        let runs = self.values.as_chunks_mut().0[group * self.candidates..]
            .chunks_exact_mut(self.candidates);
        let mut runs = runs.into_iter();
        std::array::from_fn(|_| runs.next().unwrap_or_default())
    }

    /// Copies some groups from those of another, which begin at `first`, and `to` here.
    fn take(&mut self, other: &Self, first: usize, to: usize, groups: usize) {
        let copy = |ours: &mut [T], theirs: &[T], places: usize| {
            let theirs = &theirs[(first + 1) * places..][..groups * places];
            ours[(to + 1) * places..][..theirs.len()].copy_from_slice(theirs);
        };
        copy(&mut self.values, &other.values, self.candidates * size_of::<Run<u8>>());
        for (ours, theirs) in self.least.iter_mut().zip(&other.least) {
            copy(ours, theirs, GROUP);
        }
    }

    /// Everything that the next row needs, as bytes, after their number for each value.
    fn write(&self) -> Vec<u8> {
        let mut bytes = vec![size_of::<T>() as u8];
        T::write(&self.values, &mut bytes);
        self.least.iter().for_each(|least| T::write(least, &mut bytes));
        bytes
    }

    /// Takes over what was written, perhaps as another type; whether it is of as many paths.
    fn read(&mut self, bytes: &[u8]) -> bool {
        let Some((&width @ 1..=8, mut rest)) = bytes.split_first() else { return false };
        for part in std::iter::once(&mut self.values).chain(&mut self.least) {
            let length = part.len() * usize::from(width);
            let Some((bytes, after)) = rest.split_at_checked(length) else { return false };
            read(part, width.into(), bytes);
            rest = after;
        }
        rest.is_empty()
    }

    /// Has a group and the one to its left see each other.
    fn meet(&mut self, group: usize) {
        let [left, here, _] = self.around(group);
        for (left, here) in left.iter_mut().zip(here) {
            left[FROM_RIGHT] = here[PLACES[WAYS - 1]];
            here[FROM_LEFT] = left[PLACES[0] + GROUP - 1];
        }
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

    /// Where the paths are, as bytes.
    pub fn write(&self) -> Vec<u8> {
        self.before.write()
    }

    /// Goes on where the paths were that were written; they must be as many.
    pub fn read(&mut self, bytes: &[u8]) -> Result<()> {
        if self.before.read(bytes) {
            return Ok(());
        }
        let got = format!("{} bytes", bytes.len());
        Err(Error::value("paths", got, "what a match of the same images and settings has left"))
    }

    /// Goes on where others are, of which these are the groups from `first` on.
    pub fn branch_off(&mut self, whole: &Self, first: usize) {
        self.before.take(&whole.before, first, 0, self.groups);
    }

    /// Takes over where some groups of others are, that branched off at the group `first`.
    pub fn join(&mut self, part: &Self, first: usize, range: &Range<usize>) {
        self.before.take(&part.before, range.start - first, range.start, range.len());
    }

    /// After parts of the groups have joined, on both sides of this one.
    pub fn meet(&mut self, group: usize) {
        self.before.meet(group);
    }

    /// Extends the paths of a group of columns by a row.
    #[inline(always)]
    fn advance<V: Value>(
        &mut self,
        group: usize,
        near: T,
        costs: &[Lanes<V>],
        far: [Lanes<T>; WAYS],
        sink: &mut impl Sink<T>,
    ) {
        let runs = self.before.runs(group);
        let (mut least, mut now) = ([[T::FAR; GROUP]; WAYS], [[T::FAR; GROUP]; WAYS]);
        for way in 0..WAYS {
            least[way] = lanes(&self.before.least[way], (group + 1) * GROUP + way - 1);
            now[way] = came(&runs[0], way, least[way]);
        }
        let [left, here, right] = self.here.around(group);
        let (mut below, mut least_here) = ([[T::FAR; GROUP]; WAYS], [[T::FAR; GROUP]; WAYS]);
        for (k, (cost, here)) in costs.iter().copied().zip(here).enumerate() {
            let mut totals = [[T::default(); GROUP]; WAYS];
            for way in 0..WAYS {
                let above = match runs.get(k + 1) {
                    Some(run) => came(run, way, least[way]),
                    None => [T::FAR; GROUP],
                };
                for j in 0..GROUP {
                    let changed = below[way][j].min(above[j]).plus_penalty(near);
                    let best = now[way][j].min(far[way][j]).min(changed);
                    totals[way][j] = best.plus(T::truncated(cost[j].widened()));
                    least_here[way][j] = least_here[way][j].min(totals[way][j]);
                }
                here[PLACES[way]..][..GROUP].copy_from_slice(&totals[way]);
                (below[way], now[way]) = (now[way], above);
            }
            left[k][FROM_RIGHT] = here[PLACES[WAYS - 1]];
            right[k][FROM_LEFT] = here[PLACES[0] + GROUP - 1];
            sink.take(k, totals);
        }
        let here = &mut self.here;
        for (least, totals) in here.least.iter_mut().zip(least_here) {
            least[(group + 1) * GROUP..][..GROUP].copy_from_slice(&totals);
        }
    }

    #[inline(always)]
    fn end_row(&mut self) {
        swap(&mut self.before, &mut self.here);
    }
}

/// What takes the totals of the paths to each candidate.
trait Sink<T> {
    fn take(&mut self, k: usize, totals: [Lanes<T>; WAYS]);
}

/// Nobody wants them.
struct Nowhere;

impl<T> Sink<T> for Nowhere {
    #[inline(always)]
    fn take(&mut self, _: usize, _: [Lanes<T>; WAYS]) {}
}

/// The totals of a candidate where paths come from by one of the ways, relative to the least of these.
#[inline(always)]
fn came<T: Value>(run: &Run<T>, way: usize, least: Lanes<T>) -> Lanes<T> {
    let mut totals = lanes(run, PLACES[way] + way - 1);
    for j in 0..GROUP {
        totals[j] = totals[j].minus(least[j]);
    }
    totals
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
        let mut near = [0; GROUP];
        if let (Some(all), 0) = (there.first_chunk(), skipped) {
            near = *all;
        } else {
            near[skipped..].iter_mut().zip(there).for_each(|(near, edges)| *near = *edges);
        }
        for (jump, edges) in jumps.iter_mut().zip(near) {
            *jump = neighbour.jump(edges);
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
        for y in (first..=start).rev() {
            let below = (y < start).then_some(edges).flatten();
            let [here, next] = rows;
            let (Some(rows), row) =
                (if y <= last { (here, y - first) } else { (next, y - last - 1) })
            else {
                continue;
            };
            for group in 0..paths.groups {
                let mut penalties = [[T::default(); GROUP]; WAYS];
                for (way, penalties) in penalties.iter_mut().enumerate() {
                    let from = Neighbour::ABOVE[WAYS - 1 - way];
                    *penalties = far.after_all(jumps(below, y + 1, group, way, from));
                }
                let costs = rows.costs.of(row, group);
                if y <= last {
                    let mut sink = Quarters(sums.of_mut(row, group));
                    paths.advance(group, near, costs, penalties, &mut sink);
                } else {
                    paths.advance(group, near, costs, penalties, &mut Nowhere);
                }
            }
            paths.end_row();
        }
    }
}

/// Writes a quarter of the sum of the totals, rounded.
struct Quarters<'a, T>(&'a mut [Lanes<T>]);

impl<T: Value> Sink<T> for Quarters<'_, T> {
    #[inline(always)]
    fn take(&mut self, k: usize, [a, b, c]: [Lanes<T>; WAYS]) {
        let mut quarters = [T::default(); GROUP];
        for j in 0..GROUP {
            let sum = wide(a[j]).plus(wide(b[j])).plus(wide(c[j]));
            quarters[j] = T::truncated(sum.plus(T::Wide::truncated(2)).shifted(2).widened());
        }
        self.0[k] = quarters;
    }
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
                let mut penalties = [[T::default(); GROUP]; WAYS];
                for (penalties, neighbour) in penalties.iter_mut().zip(Neighbour::ABOVE) {
                    *penalties = far.after_all(jumps(edges, y, group, 1, neighbour));
                }
                let costs = rows.costs.of(row, group);
                let mut sink = Total {
                    across: rows.totals.of(row, group),
                    below: from_below.of(row, group),
                    out: selection.sums(),
                };
                paths.advance(local, near, costs, penalties, &mut sink);
                selection.select(row, group, costs);
            }
            paths.end_row();
        }
    }
}

/// Writes the sum of eight totals: of three from above, of two along the row, of which the mean is given, and of
/// three from below, of which a quarter is.
struct Total<'a, T: Value> {
    across: &'a [Lanes<T>],
    below: &'a [Lanes<T>],
    out: &'a mut [Lanes<T::Wide>],
}

impl<T: Value> Sink<T> for Total<'_, T> {
    #[inline(always)]
    fn take(&mut self, k: usize, [a, b, c]: [Lanes<T>; WAYS]) {
        let (across, below) = (self.across[k], self.below[k]);
        let mut sums = [T::Wide::default(); GROUP];
        for j in 0..GROUP {
            let twice = wide(below[j]).plus(wide(below[j])).plus(wide(across[j]));
            let above = wide(a[j]).plus(wide(b[j])).plus(wide(c[j]));
            sums[j] = above.plus(twice).plus(twice);
        }
        self.out[k] = sums;
    }
}

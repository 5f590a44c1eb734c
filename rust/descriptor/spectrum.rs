//! Pixels -> spectral components of one row.
//!
//! The transform is separable: down the columns first, for every `v`, then along the row, for every `(u, v)`. Filters are
//! even or odd, so the two pixels at one distance from the center are added or subtracted first and share one
//! multiplication. Rows do not depend on one another's sums, so the work can be cut anywhere.

use std::array::from_fn;
use std::ops::{BitOr, Range, Shl};

use crate::descriptor::basis::{Basis, Filter};
use crate::error::Result;
use crate::image::plane::zeroed;

/// Pixels of a row that are computed together: few enough that their data stay close to the first-level cache. With 512
/// or 256, rows of 640 pixels take 10 or 20 % longer.
const SEGMENT: usize = 1024;
/// Rows are computed to a multiple of so many pixels, whole registers: a part of one would take as long.
const LANES: usize = 16;
/// Pairs of taps that are applied in one sweep over a row: as many as fit in registers.
const SWEEP: usize = 4;

/// A word of the bits of a code.
pub trait Word:
    Copy + Default + From<bool> + Into<u64> + BitOr<Output = Self> + Shl<usize, Output = Self>
{
}

impl Word for u32 {}
impl Word for u64 {}

/// A number in which sums are exact, if [`Basis::gain`] times the largest pixel fits in it.
pub trait Lane:
    Copy + Default + PartialOrd + From<i32> + Into<f64> + Send + Sync + 'static
{
    /// Bits, as wide as the number, so that comparisons need no repacking.
    type Word: Word;
    /// The sum.
    fn plus(self, other: Self) -> Self;
    /// The difference.
    fn minus(self, other: Self) -> Self;
    /// The product.
    fn times(self, other: Self) -> Self;
    /// The magnitude.
    fn magnitude(self) -> Self;
    /// A whole number, or the nearest one there is.
    fn nearest(whole: f64) -> Self;
}

impl Lane for i32 {
    type Word = u32;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self.wrapping_mul(other)
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        self.wrapping_abs()
    }

    fn nearest(whole: f64) -> Self {
        whole as Self
    }
}

impl Lane for f64 {
    type Word = u64;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self - other
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        self * other
    }

    #[inline(always)]
    fn magnitude(self) -> Self {
        self.abs()
    }

    fn nearest(whole: f64) -> Self {
        whole
    }
}

/// The even and the odd part of a filter, from the center outwards; or a row under each of them.
#[derive(Debug)]
struct EvenOdd<T> {
    even: Vec<T>,
    odd: Vec<T>,
}

impl<T: Lane> EvenOdd<T> {
    /// Buffers for a row of so many values.
    fn new(width: usize) -> Result<Self> {
        Ok(Self { even: zeroed(width)?, odd: zeroed(width)? })
    }

    /// The taps of a filter, as numbers of this type.
    fn lanes(filter: &Filter) -> Self {
        let lanes = |taps: &[i32]| taps.iter().map(|tap| (*tap).into()).collect();
        Self { even: lanes(&filter.even), odd: lanes(&filter.odd) }
    }
}

/// A component of neighboring pixels: its index, its real and its imaginary parts.
pub type Components<'a, T> = (usize, &'a [T], &'a [T]);

/// The local Fourier transform of one row after the other.
#[derive(Debug)]
pub struct Spectrum<T> {
    /// Highest frequency indices.
    highest: (usize, usize),
    /// By frequency index.
    filters: Vec<EvenOdd<T>>,
    /// The row under the filters along y, by `v`.
    columns: Vec<EvenOdd<T>>,
    /// The even and the odd part of `columns` for one `v`, each under the filter along x for one `u`.
    crossed: [EvenOdd<T>; 2],
}

impl<T: Lane> Spectrum<T> {
    /// Buffers and filters for rows of so many pixels.
    pub fn new(basis: &Basis, cols: usize) -> Result<Self> {
        let width = padded(padded(cols) + 2 * basis.radius());
        Ok(Self {
            highest: basis.frequencies(),
            filters: basis.filters().iter().map(EvenOdd::lanes).collect(),
            columns: (0..=basis.frequencies().1)
                .map(|_| EvenOdd::new(width))
                .collect::<Result<_>>()?,
            crossed: [EvenOdd::new(SEGMENT)?, EvenOdd::new(SEGMENT)?],
        })
    }

    /// Pixels of a row with its continuation: the radius on the left, at least as many on the right.
    pub fn width(&self) -> usize {
        self.columns[0].even.len()
    }

    /// Filters a row along y, from its surroundings: `L` rows of [`Self::width`], one after the other.
    #[inline(always)]
    pub fn center_on(&mut self, surroundings: &[i32]) {
        let step = self.width();
        let place = (surroundings.len() / step / 2 * step, step);

        for (v, (columns, filter)) in self.columns.iter_mut().zip(&self.filters).enumerate() {
            apply(filter, v > 0, surroundings, place, [&mut columns.even, &mut columns.odd]);
        }
    }

    /// The frequencies `(u, v)`, `v` not negative, that have components.
    #[inline(always)]
    pub fn frequencies(&self) -> impl Iterator<Item = (usize, usize)> + use<T> {
        let (r, s) = self.highest;
        (0..=s).flat_map(move |v| (0..=r).map(move |u| (u, v))).filter(|f| *f != (0, 0))
    }

    /// The components `(u, v)` and, if it differs, `(u, -v)` of the pixels in these columns.
    #[inline(always)]
    pub fn components(
        &mut self,
        (u, v): (usize, usize),
        columns: Range<usize>,
    ) -> impl Iterator<Item = Components<'_, T>> {
        // The first letter is the part along x, the second one that along y.
        let [EvenOdd { even: ee, odd: oe }, EvenOdd { even: eo, odd: oo }] = &mut self.crossed;
        let [ee, oe, eo, oo] = [ee, oe, eo, oo].map(|row| &mut row[..columns.len()]);

        let filter = &self.filters[u];
        let down = &self.columns[v];
        let place = (columns.start + filter.even.len() - 1, 1);
        apply::<T, T>(filter, u > 0, &down.even, place, [ee, oe]);
        if v > 0 {
            apply::<T, T>(filter, u > 0, &down.odd, place, [eo, oo]);
        }

        if u.min(v) > 0 {
            // F(u, v) = (ee - oo) + i (oe + eo); with the conjugate along y, F(u, -v) = (ee + oo) + i (oe - eo).
            // Afterwards `oo` and `oe` hold the former, `ee` and `eo` the latter.
            to_sum_and_difference(ee, oo);
            to_sum_and_difference(oe, eo);
        }

        let [ee, oe, eo, oo] = [&*ee, oe, eo, oo];
        // Components lie as `Basis::components` lists them: the axis first, then `v` from `-highest` on for each `u`.
        let highest = self.highest.1;
        let index = |v: usize| highest + (u - 1) * (2 * highest + 1) + v;
        let found = match (u, v) {
            (0, _) => [Some((v - 1, ee, eo)), None],
            (_, 0) => [Some((index(highest), ee, oe)), None],
            _ => [Some((index(highest + v), oo, oe)), Some((index(highest - v), ee, eo))],
        };

        found.into_iter().flatten()
    }
}

/// The columns of the segments of a row.
pub fn segments(cols: usize) -> impl Iterator<Item = Range<usize>> {
    (0..cols).step_by(SEGMENT).map(move |x| x..(x + SEGMENT).min(cols))
}

/// So many pixels, rounded up to whole registers.
pub fn padded(cols: usize) -> usize {
    cols.next_multiple_of(LANES)
}

/// `a, b = a + b, a - b`.
#[inline(always)]
fn to_sum_and_difference<T: Lane>(a: &mut [T], b: &mut [T]) {
    let n = a.len();
    let b = &mut b[..n];

    for i in 0..n {
        (a[i], b[i]) = (a[i].plus(b[i]), a[i].minus(b[i]));
    }
}

/// Where a filter lies on the data in one sweep: its center for the first output, the distance of neighboring taps, and the
/// first of the pairs of taps around the center.
#[derive(Debug, Clone, Copy)]
struct Pairs {
    center: usize,
    step: usize,
    nearest: usize,
}

impl Pairs {
    /// The data under the taps on either side of the center.
    #[inline(always)]
    fn rows<P, const K: usize>(self, data: &[P], length: usize) -> ([&[P]; K], [&[P]; K]) {
        let away = |k: usize| (self.nearest + k) * self.step;
        let before = from_fn(|k| &data[self.center - away(k)..][..length]);

        (before, from_fn(|k| &data[self.center + away(k)..][..length]))
    }
}

/// Applies a filter to a row of outputs: both of its parts, or the even one only.
#[inline(always)]
fn apply<P: Lane, T: Lane + From<P>>(
    filter: &EvenOdd<T>,
    both: bool,
    data: &[P],
    (center, step): (usize, usize),
    [even, odd]: [&mut [T]; 2],
) {
    let radius = filter.even.len() - 1;

    for nearest in (1..=radius).step_by(SWEEP) {
        let pairs = Pairs { center, step, nearest };
        let out = [&mut *even, &mut *odd];

        match radius + 1 - nearest {
            1 => sweep::<P, T, 1>(filter, both, data, pairs, out),
            2 => sweep::<P, T, 2>(filter, both, data, pairs, out),
            3 => sweep::<P, T, 3>(filter, both, data, pairs, out),
            _ => sweep::<P, T, SWEEP>(filter, both, data, pairs, out),
        }
    }
}

/// Adds the contributions of `K` pairs of taps. The first sweep starts from the center.
#[inline(always)]
fn sweep<P: Lane, T: Lane + From<P>, const K: usize>(
    filter: &EvenOdd<T>,
    both: bool,
    data: &[P],
    pairs: Pairs,
    [even, odd]: [&mut [T]; 2],
) {
    let evens: [T; K] = from_fn(|k| filter.even[pairs.nearest + k]);
    let odds: [T; K] = from_fn(|k| filter.odd[pairs.nearest + k]);
    let middle = filter.even[0];
    let center = |value: P| middle.times(lane(value));

    match (pairs.nearest, both) {
        (1, false) => add_even(even, data, pairs, evens, |_, value| center(value)),
        (_, false) => add_even(even, data, pairs, evens, |sum, _| sum),
        (1, true) => {
            add_both(even, odd, data, pairs, (evens, odds), |_, value| {
                (center(value), T::default())
            });
        }
        (_, true) => add_both(even, odd, data, pairs, (evens, odds), |sums, _| sums),
    }
}

/// Adds to the even part. Outputs and inputs are arguments of their own, so that the vectorizer knows that they do not
/// overlap.
#[inline(always)]
fn add_even<P: Lane, T: Lane + From<P>, const K: usize>(
    even: &mut [T],
    data: &[P],
    pairs: Pairs,
    evens: [T; K],
    start: impl Fn(T, P) -> T,
) {
    let n = even.len();
    let (before, after) = pairs.rows::<P, K>(data, n);
    let center = &data[pairs.center..][..n];

    for i in 0..n {
        let mut sum = start(even[i], center[i]);
        for k in 0..K {
            sum = sum.plus(evens[k].times(lane(after[k][i].plus(before[k][i]))));
        }

        even[i] = sum;
    }
}

/// Adds to both parts, which share their loads.
#[inline(always)]
fn add_both<P: Lane, T: Lane + From<P>, const K: usize>(
    even: &mut [T],
    odd: &mut [T],
    data: &[P],
    pairs: Pairs,
    (evens, odds): ([T; K], [T; K]),
    start: impl Fn((T, T), P) -> (T, T),
) {
    let n = even.len();
    let odd = &mut odd[..n];
    let (before, after) = pairs.rows::<P, K>(data, n);
    let center = &data[pairs.center..][..n];

    for i in 0..n {
        let (mut e, mut o) = start((even[i], odd[i]), center[i]);
        for k in 0..K {
            e = e.plus(evens[k].times(lane(after[k][i].plus(before[k][i]))));
            o = o.plus(odds[k].times(lane(after[k][i].minus(before[k][i]))));
        }

        (even[i], odd[i]) = (e, o);
    }
}

/// A pixel or value as a number of type `T`.
#[inline(always)]
fn lane<P, T: From<P>>(value: P) -> T {
    T::from(value)
}

//! Pixels -> spectral components of a few rows at a time.
//!
//! The transform is separable: first down the columns, for every `v`, then along the row, for every `(u, v)`.
//! Filters are even or odd, so the two pixels at the same distance from the center are added or subtracted
//! first and share one multiplication. Rows do not depend on each other's sums, so the work can be cut
//! anywhere.

use std::array::from_fn;
use std::ops::{BitOr, Range, Shl};

use crate::base::error::Result;
use crate::base::memory::Memory;
use crate::descriptor::basis::{Basis, BasisFilter};

/// Pixels that are computed together, from one or a few rows: enough that starting the loops takes little of
/// the time, few enough that their data stay close to the first-level cache. With 1024, rows of 741 pixels
/// take 10 % longer in AVX-512; with 2048, they take as much longer in AVX2.
const SEGMENT: usize = 1536;
/// Rows are computed to a multiple of this many pixels, whole registers: part of a register would take as
/// long.
const LANES: usize = 16;
/// Pairs of taps that are applied in one sweep over a row: all that fit in registers.
const SWEEP: usize = 4;

/// A 32-bit word of a code, in a register lane of any width.
pub trait Word:
    Copy + Default + From<bool> + Into<u64> + BitOr<Output = Self> + Shl<usize, Output = Self>
{
    /// One of its four bytes, the lowest first.
    fn byte(self, index: usize) -> u8;
}

macro_rules! word {
    ($($word:ty),*) => {$(
        impl Word for $word {
            #[inline(always)]
            fn byte(self, index: usize) -> u8 {
                (self >> (8 * index)) as u8
            }
        }
    )*};
}
word!(u32, u64);

/// A number type in which sums are exact, if [`Basis::gain`] times the largest pixel fits.
pub trait Lane: Copy + Default + PartialOrd + From<i32> + Into<f64> + Send + Sync + 'static {
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
    /// A whole number, or the nearest one that the type holds.
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

/// The even and the odd part of a filter, from the center outward; or a row under each of them.
#[derive(Debug)]
struct EvenOdd<B> {
    even: B,
    odd: B,
}

impl<T: Lane> EvenOdd<Memory<T>> {
    /// Buffers for a row of this many values.
    fn new(width: usize) -> Result<Self> {
        Ok(Self { even: Memory::new(width)?, odd: Memory::new(width)? })
    }
}

impl<T: Lane> EvenOdd<Vec<T>> {
    /// The taps of a filter, as numbers of this type.
    fn lanes(filter: &BasisFilter) -> Self {
        let lanes = |taps: &[i32]| taps.iter().map(|tap| (*tap).into()).collect();
        Self { even: lanes(&filter.even), odd: lanes(&filter.odd) }
    }
}

/// A component of neighboring pixels: its index, its real and its imaginary parts.
pub type Components<'a, T> = (usize, &'a [T], &'a [T]);

/// The layout of rows of pixels in memory: one after the other, each with its continuation on either side.
///
/// So a few rows form one long row. Values computed in the continuation between two of them are useless, but
/// take less time than restarting with each row.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Pixels of a row.
    pub cols: usize,
    /// Pixels of its continuation on the left, and the least number of those on the right.
    pub margin: usize,
}

impl Layout {
    /// Places of a row.
    pub fn width(self) -> usize {
        padded(padded(self.cols) + 2 * self.margin)
    }

    /// Rows that are computed together: those of a segment, at least one.
    pub fn group(self) -> usize {
        (SEGMENT / self.width()).max(1)
    }

    /// Places from the first pixel of this many rows to the last one, in whole registers.
    pub fn span(self, rows: usize) -> usize {
        (rows - 1) * self.width() + padded(self.cols)
    }
}

/// The local Fourier transform of one group of rows after another.
#[derive(Debug)]
pub struct Spectrum<T> {
    /// Highest frequency index along y of all components.
    highest: usize,
    /// The frequencies `(u, v)`, with `v >= 0`, whose components are requested.
    frequencies: Vec<(usize, usize)>,
    /// By frequency index.
    filters: Vec<EvenOdd<Vec<T>>>,
    layout: Layout,
    /// The rows under the filters along y, by `v`.
    columns: Vec<EvenOdd<Memory<T>>>,
    /// The even and the odd part of `columns` for one `v`, each under the filter along x for one `u`.
    crossed: [EvenOdd<Memory<T>>; 2],
}

impl<T: Lane> Spectrum<T> {
    /// Buffers and filters for groups of rows whose margin is at least the radius of the basis.
    pub fn new(basis: &Basis, frequencies: &[(usize, usize)], layout: Layout) -> Result<Self> {
        let highest = basis.frequencies().1;
        let places = layout.group() * layout.width();
        let columns = (0..=highest).map(|_| EvenOdd::new(places));

        Ok(Self {
            highest,
            frequencies: frequencies.to_vec(),
            filters: basis.filters().iter().map(EvenOdd::lanes).collect(),
            layout,
            columns: columns.collect::<Result<_>>()?,
            crossed: [EvenOdd::new(SEGMENT)?, EvenOdd::new(SEGMENT)?],
        })
    }

    /// Filters rows along y, at most a group: from the radius of the basis above the first one to the same
    /// distance below the last one.
    #[inline(always)]
    pub fn center_on(&mut self, surroundings: &[i32]) {
        let step = self.layout.width();
        let above = (self.filters[0].even.len() - 1) * step;
        let places = surroundings.len() - 2 * above;

        for (v, (columns, filter)) in self.columns.iter_mut().zip(&self.filters).enumerate() {
            let out = [&mut columns.even[..places], &mut columns.odd[..places]];
            apply(filter, v > 0, surroundings, (above, step), out);
        }
    }

    /// The number of requested frequencies.
    pub fn frequencies(&self) -> usize {
        self.frequencies.len()
    }

    /// The components `(u, v)` and, if different, `(u, -v)` of one of the frequencies, for the pixels at
    /// these places.
    #[inline(always)]
    pub fn components(
        &mut self,
        frequency: usize,
        places: Range<usize>,
    ) -> impl Iterator<Item = Components<'_, T>> {
        let (u, v) = self.frequencies[frequency];

        // The first letter is the part along x, the second one that along y.
        let [EvenOdd { even: ee, odd: oe }, EvenOdd { even: eo, odd: oo }] = &mut self.crossed;
        let [ee, oe, eo, oo] = [ee, oe, eo, oo].map(|row| &mut row[..places.len()]);

        let filter = &self.filters[u];
        let down = &self.columns[v];
        let place = (places.start + self.layout.margin, 1);
        apply::<T, T>(filter, u > 0, &down.even, place, [ee, oe]);
        if v > 0 {
            apply::<T, T>(filter, u > 0, &down.odd, place, [eo, oo]);
        }

        if u.min(v) > 0 {
            // F(u, v) = (ee - oo) + i (oe + eo); with the conjugate along y, F(u, -v) = (ee + oo) + i (oe -
            // eo). Afterwards `oo` and `oe` hold the former, `ee` and `eo` the latter.
            to_sum_and_difference(ee, oo);
            to_sum_and_difference(oe, eo);
        }

        let [ee, oe, eo, oo] = [&*ee, oe, eo, oo];
        // Components are ordered as in `Basis::components`: the axis first, then `v` from `-highest` on for
        // each `u`.
        let highest = self.highest;
        let index = |v: usize| highest + (u - 1) * (2 * highest + 1) + v;
        let found = match (u, v) {
            (0, _) => [Some((v - 1, ee, eo)), None],
            (_, 0) => [Some((index(highest), ee, oe)), None],
            _ => [Some((index(highest + v), oo, oe)), Some((index(highest - v), ee, eo))],
        };

        found.into_iter().flatten()
    }
}

/// The segments of this many places.
pub fn segments(places: usize) -> impl Iterator<Item = Range<usize>> {
    (0..places).step_by(SEGMENT).map(move |x| x..(x + SEGMENT).min(places))
}

/// This many pixels, rounded up to whole registers.
fn padded(cols: usize) -> usize {
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

/// The placement of a filter on the data in one sweep: its center for the first output, the distance of
/// neighboring taps, and the first of the pairs of taps around the center.
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

/// Applies a filter to a row of outputs: both parts, or only the even one.
#[inline(always)]
fn apply<P: Lane, T: Lane + From<P>>(
    filter: &EvenOdd<Vec<T>>,
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
    filter: &EvenOdd<Vec<T>>,
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
            add_both(even, odd, data, pairs, (evens, odds), |_, value| (center(value), T::default()));
        }
        (_, true) => add_both(even, odd, data, pairs, (evens, odds), |sums, _| sums),
    }
}

/// Adds to the even part. Outputs and inputs are separate arguments, so that the vectorizer sees that they do
/// not overlap.
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

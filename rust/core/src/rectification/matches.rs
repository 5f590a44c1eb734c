//! Matches of corners between the left and the right image, by their codes.
//!
//! ```text
//! likeness(i, j) = code[i] . code[j]   # for rows at most 20 % of the width apart, scales at most 2.1 times
//! j = the most similar to i;   next = the largest likeness of i elsewhere, more than 10 px from j
//! match if the most similar to j is i, or within 3 px of it, and distance(i, j) < 0.85 distance(next)
//! ```
//!
//! The squared distance of two codes of length 1 is 2 minus twice their product. Products are integers.

use std::collections::BTreeSet;

use super::codes::{CornerCode, Features, LENGTH, UNIT};
use phasestereo_match::base::simd::{Level, leveled};

/// Rows within which a corner's match is searched, as a share of the width.
const ROWS: f64 = 0.20;
/// Largest ratio of scales.
const SCALES: f64 = 2.1;
/// Largest ratio of the distances to the most similar corner and to the next one elsewhere.
const RATIO: f64 = 0.85;
/// Least likeness, as a share of that of equal codes.
const LEAST: f64 = 0.5;
/// Largest distance of two corners that show the same thing, and smallest of two that show different things,
/// in pixels of their level.
const SAME: f64 = 3.0;
const ELSEWHERE: f64 = 10.0;
/// Matches within a square of this many pixels are one corner on several levels.
const SQUARE: f64 = 6.0;
/// Products that are summed at once.
pub const SUMMED: usize = 16;
const _: () = assert!(LENGTH.is_multiple_of(SUMMED), "a product leaves out values of a code");

/// A place of the left image, and the place of the same thing in the right one: columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerMatch {
    /// In the left image.
    pub left: [f64; 2],
    /// In the right image.
    pub right: [f64; 2],
}

/// The most similar right corner of a left one.
#[derive(Debug, Clone, Copy)]
struct Likest {
    corner: usize,
    likeness: i32,
    /// The likeness of the next one elsewhere.
    next: i32,
}

/// Matches corners, given their codes, in images of this many columns. The most similar come first.
pub fn matched(
    [left, right]: [&Features; 2],
    [left_codes, right_codes]: [&[CornerCode]; 2],
    cols: usize,
    simd: Level,
) -> Vec<CornerMatch> {
    let window = ROWS * cols as f64;
    // Of the right corners, sorted by rows, only some are near enough.
    let mut order: Vec<usize> = (0..right.places.len()).collect();
    order.sort_by(|a, b| right.places[*a][1].total_cmp(&right.places[*b][1]));

    let mut back = vec![(0, usize::MAX); right.places.len()];
    let mut likest = Vec::with_capacity(left.places.len());
    let mut likenesses = vec![];
    for (index, (place, scale)) in left.places.iter().zip(&left.scales).enumerate() {
        let first = order.partition_point(|other| right.places[*other][1] < place[1] - window);
        let end = order.partition_point(|other| right.places[*other][1] <= place[1] + window);
        let near = order[first..end].iter().filter(|other| {
            let other = right.scales[**other];
            *scale <= SCALES * other && other <= SCALES * scale
        });

        likenesses.clear();
        likenesses.extend(near.map(|other| (*other, 0)));
        write_products(simd, &left_codes[index], right_codes, &mut likenesses);

        for (other, likeness) in &likenesses {
            if *likeness > back[*other].0 {
                back[*other] = (*likeness, index);
            }
        }
        likest.push(likest_of(&likenesses, right));
    }

    let found = likest.iter().enumerate().filter_map(|(index, likest)| {
        let likest = (*likest)?;
        let reached = left.places.get(back[likest.corner].1)?;
        let is_mutual = distance(*reached, left.places[index]) <= SAME * left.scales[index];
        (is_mutual && likest.is_distinct()).then_some((likest, index))
    });
    let mut found: Vec<_> = found.collect();
    found.sort_by_key(|(likest, _)| -likest.likeness);

    let mut taken = BTreeSet::new();
    found.retain(|(_, index)| taken.insert(left.places[*index].map(|value| (value / SQUARE).round() as i64)));
    let pair = |(likest, index): &(Likest, usize)| CornerMatch {
        left: left.places[*index],
        right: right.places[likest.corner],
    };
    found.iter().map(pair).collect()
}

fn likest_of(likenesses: &[(usize, i32)], right: &Features) -> Option<Likest> {
    let first = |best: (usize, i32), one: &(usize, i32)| if one.1 > best.1 { *one } else { best };
    let (corner, likeness) = likenesses.iter().fold((usize::MAX, 0), first);
    let place = *right.places.get(corner)?;

    let far = ELSEWHERE * right.scales[corner];
    let elsewhere = likenesses.iter().filter(|one| distance(right.places[one.0], place) > far);
    let next = elsewhere.map(|one| one.1).max().unwrap_or(0);
    Some(Likest { corner, likeness, next })
}

impl Likest {
    fn is_distinct(self) -> bool {
        let short = |likeness: i32| (1.0 - f64::from(likeness) / f64::from(UNIT * UNIT)).max(0.0);
        let is_like = f64::from(self.likeness) > LEAST * f64::from(UNIT * UNIT);
        is_like && short(self.likeness) < RATIO * RATIO * short(self.next)
    }
}

/// The sum of the differences in columns and in rows.
fn distance(one: [f64; 2], other: [f64; 2]) -> f64 {
    (one[0] - other[0]).abs() + (one[1] - other[1]).abs()
}

/// The products of a code with others, whose indices are given.
#[leveled]
fn write_products(level: Level, code: &CornerCode, codes: &[CornerCode], out: &mut [(usize, i32)]) {
    for (other, product) in out {
        *product = scalar_product(code, &codes[*other]);
    }
}

/// The sum of the products of two lists whose length is a multiple of [`SUMMED`]. For arrays instead of
/// slices, or slices of unknown length, the compiler multiplies only a few values at a time.
#[inline(always)]
pub fn scalar_product(one: &[i16], other: &[i16]) -> i32 {
    let mut sums = [0i32; SUMMED];
    for (a, b) in one.chunks_exact(SUMMED).zip(other.chunks_exact(SUMMED)) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += i32::from(*a) * i32::from(*b);
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::levels;

    #[test]
    fn products_are_sums_of_all_terms() {
        let code = |seed: usize| -> CornerCode {
            std::array::from_fn(|index| ((index * 31 + seed * 97) % 2048) as i16)
        };
        let codes: Vec<CornerCode> = (0..9).map(code).collect();
        for level in levels() {
            let name = level.name();
            let mut out = [(4, 0), (0, 0), (8, 0)];
            write_products(level, &codes[3], &codes, &mut out);
            for (other, product) in out {
                let terms = (0..LENGTH).map(|k| i64::from(codes[3][k]) * i64::from(codes[other][k]));
                assert_eq!(i64::from(product), terms.sum::<i64>(), "{name}");
            }
        }
    }

    #[test]
    fn what_is_nearly_as_like_elsewhere_is_not_distinct() {
        let unit = f64::from(UNIT * UNIT);
        let likest = |likeness: f64, next: f64| Likest {
            corner: 0,
            likeness: (likeness * unit) as i32,
            next: (next * unit) as i32,
        };
        assert!(likest(0.95, 0.9).is_distinct() && !likest(0.92, 0.9).is_distinct());
        assert!(!likest(0.45, 0.0).is_distinct(), "hardly like");
    }
}

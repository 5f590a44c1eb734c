//! The range of disparities to search: of those found in reduced copies of a pair, the shortest range that holds nearly
//! all, with what lies next to it.

use std::ops::Range;

use super::overview::{Overview, RoughMap};
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::settings::MOST_DISPARITIES;

/// Least mean confidence of a usable match: between those of unrelated images and of true pairs, see [`RoughMap`].
pub const LEAST_CONFIDENCE: f64 = 0.45;
/// Share of the matches that the shortest range holds at least.
const CORE: f64 = 0.97;
/// A disparity next to the range belongs to it if it has at least this share of the matches.
const FEW: f64 = 0.001;
/// Disparities farther off than this share of the range's length are mistakes.
const NEXT: f64 = 0.12;
/// Disparities to search beyond those that were found on either side, as a share of the range's length.
const MARGIN: f64 = 0.08;
/// Nearly all of the matches.
const NEARLY_ALL: f64 = 0.95;
/// Disparities of the copy, pixels, that are clearly not zero.
const CLEARLY: f64 = 2.0;

/// The range of disparities of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchRange {
    /// Smallest disparity to search.
    pub min: i64,
    /// Number of disparities to search.
    pub count: i64,
    /// Least disparity found, pixels.
    pub low: f64,
    /// Largest disparity found, pixels.
    pub high: f64,
    /// Whether nearly all disparities are negative, most of them clearly, as when the images are swapped.
    pub swapped: bool,
    /// Whether many disparities of either sign are clearly not zero, as with toed-in cameras.
    pub mixed: bool,
    /// Whether both images are the same, but for noise.
    pub identical: bool,
}

/// A place whose disparities are not searched, although something seems to be there; pixels of the whole image.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Its rows.
    pub rows: Range<usize>,
    /// Its columns.
    pub columns: Range<usize>,
    /// The least disparity there.
    pub low: f64,
    /// The largest one.
    pub high: f64,
}

impl SearchRange {
    /// The disparities to search in images of this width.
    pub fn candidates(&self, width: usize) -> Result<Candidates> {
        let count = self.count.clamp(1, width.min(MOST_DISPARITIES) as i64);
        let min = self.min.clamp(1 - width as i64, width as i64 - 1);
        Candidates::new(min, count, width)
    }
}

/// The range of a rough match of the overview; `None` where there is too little texture or too little in common.
pub fn range(overview: &Overview, map: &RoughMap) -> Option<SearchRange> {
    let (first, last) = extent(map).filter(|_| map.confidence >= LEAST_CONFIDENCE)?;

    let factor = overview.factor as f64;
    let mut low = (first as f64 - 0.5) * factor;
    let mut high = (last as f64 + 0.5) * factor;
    // A pixel of the copy at zero stands for disparities of both signs: those of the others decide.
    if first >= 0 {
        low = low.max(0.0);
    }
    if last <= 0 {
        high = high.min(0.0);
    }

    let width = (overview.planes[0].cols() * overview.factor) as i64;
    let (start, end) = with_margin(low, high);

    let known: Vec<f64> = known(map).map(f64::from).collect();
    let share = |is_one: &dyn Fn(f64) -> bool| {
        known.iter().filter(|value| is_one(**value)).count() as f64 / known.len() as f64
    };
    // Few clear disparities of the other sign may be mistakes.
    let below = share(&|value| value <= -CLEARLY);
    Some(SearchRange {
        min: start,
        count: (end - start + 1).min(width),
        low,
        high,
        swapped: share(&|value| value < 0.0) >= NEARLY_ALL && below >= 0.5,
        mixed: below.min(share(&|value| value >= CLEARLY)) >= 1.0 - NEARLY_ALL,
        identical: false,
    })
}

/// The finite disparities.
fn known(map: &RoughMap) -> impl Iterator<Item = f32> {
    map.disparity.as_slice().iter().copied().filter(|value| value.is_finite())
}

/// The least and the largest disparity, without mistakes.
pub fn extent(map: &RoughMap) -> Option<(isize, isize)> {
    let lowest = known(map).reduce(f32::min)? as isize;
    let highest = known(map).reduce(f32::max)? as isize;

    let mut counts = vec![0usize; (highest - lowest + 1) as usize];
    known(map).for_each(|value| counts[(value as isize - lowest) as usize] += 1);
    let total: usize = counts.iter().sum();

    let (mut first, mut last) = shortest(&counts, (CORE * total as f64).ceil() as usize);

    // The range grows as long as disparities within a step of its ends have enough matches.
    let is_likely = |count: usize| count as f64 >= (FEW * total as f64).max(2.0);
    loop {
        let step = ((NEXT * (last - first) as f64).round() as usize).max(2);

        let mut likely = (first.saturating_sub(step)..(last + step + 1).min(counts.len()))
            .filter(|at| is_likely(counts[*at]));
        let from = likely.next().unwrap_or(first);
        let to = likely.next_back().unwrap_or(last);

        let wider = (first.min(from), last.max(to));
        if wider == (first, last) {
            return Some((first as isize + lowest, last as isize + lowest));
        }
        (first, last) = wider;
    }
}

/// The first and the last index of the shortest run of counts whose sum is at least `enough`.
fn shortest(counts: &[usize], enough: usize) -> (usize, usize) {
    let mut best = (0, counts.len() - 1);
    let (mut start, mut sum) = (0, 0);

    // Each end has one best start, which moves only to the right: linear time.
    for (end, count) in counts.iter().enumerate() {
        sum += count;

        while start < end && sum - counts[start] >= enough {
            sum -= counts[start];
            start += 1;
        }

        if sum >= enough && end - start < best.1 - best.0 {
            best = (start, end);
        }
    }

    best
}

/// The first and the last disparity to search, with a margin around those from low to high.
///
/// A range on one side of zero stays there, and begins at zero unless that would more than double it. Searching more
/// than there is costs time but no accuracy; searching less costs both.
fn with_margin(low: f64, high: f64) -> (i64, i64) {
    let margin = 1.0 + MARGIN * (high - low);
    let start = (low - margin).floor() as i64;
    let end = (high + margin).ceil() as i64;
    let length = end - start;
    let is_above = low.ceil() >= 0.0;
    let is_below = high.floor() <= 0.0;

    if low + high > 0.0 {
        let start = if is_above && start <= length { 0 } else { start };
        (start, end)
    } else {
        let end = if is_below && -end <= length { 0 } else { end };
        (start, end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_run_holds_enough() {
        assert_eq!(shortest(&[1, 0, 5, 6, 0, 1], 11), (2, 3));
        assert_eq!(shortest(&[1, 0, 5, 6, 0, 1], 13), (0, 5));
        assert_eq!(shortest(&[4], 4), (0, 0));
    }

    #[test]
    fn margins_stay_on_their_side_of_zero() {
        assert_eq!(with_margin(2.0, 52.0), (0, 57));
        assert_eq!(with_margin(30.0, 60.0), (0, 64));
        assert_eq!(with_margin(200.0, 250.0), (195, 255));
        assert_eq!(with_margin(-52.0, -2.0), (-57, 0));
        assert_eq!(with_margin(-20.0, 30.0), (-25, 35));
    }
}

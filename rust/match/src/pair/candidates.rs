//! The searched disparities, and where each of them looks in the right image.

use crate::base::error::{Error, Result};
use crate::base::value::LANES;
use crate::settings::MOST_DISPARITIES;

/// The disparities `min .. min + count`, half-open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidates {
    min: isize,
    count: usize,
}

impl Candidates {
    /// Candidates for images of the given width. A range that gives no pixel a match in the right image is an
    /// error.
    pub fn new(min: i64, count: i64, width: usize) -> Result<Self> {
        let most = width.min(MOST_DISPARITIES) as i64;
        if !(1..=most).contains(&count) {
            let accepts = format!("an integer from 1 to {most} (the width, at most {MOST_DISPARITIES})");
            return Err(Error::value("num_disparities", count, accepts));
        }

        // At the ends of the range, one candidate of one column still lies within the right image.
        let lowest = 1 - width as i64 - (count - 1);
        let highest = width as i64 - 1;
        if !(lowest..=highest).contains(&min) {
            let accepts = format!(
                "an integer from {lowest} to {highest}: with {count} disparities and width {width}, \
                 every candidate would lie outside the right image"
            );
            return Err(Error::value("min_disparity", min, accepts));
        }

        Ok(Self { min: min as isize, count: count as usize })
    }

    /// The candidates of a span of disparities, both ends included, clipped to the range that the width
    /// allows.
    pub fn of_span((low, high): (isize, isize), width: usize) -> Result<Self> {
        let count = (high - low + 1).clamp(1, width as isize);
        let low = low.clamp(1 - width as isize - (count - 1), width as isize - 1);
        Self::new(low as i64, count as i64, width)
    }

    /// The smallest disparity and the number of candidates, as [`Self::new`] accepts them.
    pub fn numbers(self) -> (i64, i64) {
        (self.min as i64, self.count as i64)
    }

    /// Number of candidates.
    pub fn count(self) -> usize {
        self.count
    }

    /// Smallest disparity.
    pub fn min(self) -> isize {
        self.min
    }

    /// Largest disparity.
    pub fn max(self) -> isize {
        self.min + self.count as isize - 1
    }

    /// The candidate of a disparity; for those below the range the first one, for those above it the number
    /// of candidates.
    #[inline]
    pub fn index(self, disparity: isize) -> usize {
        (disparity - self.min).clamp(0, self.count as isize) as usize
    }

    /// Disparity of candidate `k`, pixels.
    pub fn disparity(self, k: usize) -> isize {
        self.min + k as isize
    }

    /// Right column of left column `x` under candidate `k`, clamped into the image.
    pub fn column(self, x: usize, k: usize, width: usize) -> usize {
        (x as isize - self.disparity(k)).clamp(0, width as isize - 1) as usize
    }

    /// Right column of left column `x` under candidate `k`. Columns left of the image are negative, so as
    /// unsigned numbers they are beyond it, too.
    #[inline(always)]
    pub fn column_or_beyond(self, x: i32, k: u16) -> u32 {
        (x - self.min as i32 - i32::from(k)) as u32
    }
}

/// Neighboring candidates that are searched, out of all of a pair.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Searched {
    /// The first of them.
    pub start: usize,
    /// How many there are.
    pub count: usize,
}

impl Searched {
    /// All of this many candidates.
    pub fn all(count: usize) -> Self {
        Self { start: 0, count }
    }

    /// The fewest whole runs of [`LANES`] out of `count` candidates, at least `runs`, that hold those from
    /// `first` to `last`, with equal room on either side.
    pub fn holding(first: usize, last: usize, runs: usize, count: usize) -> Self {
        let needed = last + 1 - first;
        let searched = needed.next_multiple_of(LANES).max(runs * LANES).min(count);
        let start = first.saturating_sub((searched - needed) / 2);

        Self { start: start.min(count - searched), count: searched }
    }

    /// Those from index `first` on, this many at most.
    #[inline(always)]
    pub fn part(self, first: usize, most: usize) -> Self {
        Self { start: self.start + first, count: (self.count - first).min(most) }
    }

    /// Runs of [`LANES`] candidates, the last one padded.
    #[inline(always)]
    pub fn runs(self) -> usize {
        self.count.div_ceil(LANES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_refused_by_name() {
        let refused = |min, count| Candidates::new(min, count, 5).expect_err("refused").to_string();

        assert!(refused(0, 0).starts_with("num_disparities: got 0"));
        assert!(refused(0, 6).starts_with("num_disparities: got 6; accepts an integer from 1 to 5"));
        assert!(refused(5, 1).starts_with("min_disparity: got 5"));
        assert!(refused(-6, 2).starts_with("min_disparity: got -6"));
        assert!(refused(i64::MIN, 5).starts_with("min_disparity"));
    }

    #[test]
    fn the_extreme_ranges_touch_one_column() {
        let rightmost = Candidates::new(4, 1, 5).expect("accepted");
        assert!(rightmost.column_or_beyond(4, 0) < 5 && rightmost.column_or_beyond(3, 0) >= 5);

        let leftmost = Candidates::new(-5, 2, 5).expect("accepted");
        assert!(leftmost.column_or_beyond(0, 1) < 5 && leftmost.column_or_beyond(0, 0) >= 5);
    }

    #[test]
    fn whole_runs_hold_a_range_in_their_middle() {
        let holding = |first, last, runs, count| {
            let Searched { start, count } = Searched::holding(first, last, runs, count);
            (start, start + count)
        };

        assert_eq!(holding(100, 110, 1, 200), (90, 122));
        assert_eq!(holding(100, 110, 2, 200), (74, 138));
        assert_eq!(holding(100, 140, 1, 200), (89, 153));
        // At either end they are shifted.
        assert_eq!(holding(3, 5, 2, 200), (0, 64));
        assert_eq!(holding(190, 199, 1, 200), (168, 200));
        // All of them, where these are the only ones.
        assert_eq!(holding(3, 5, 2, 40), (0, 40));
        assert_eq!(holding(0, 199, 1, 200), (0, 200));
    }
}

//! Kernels on single rows of gray values, in integers: texture, repetition, and fields of interlaced video.
//!
//! ```text
//! flat:      a run of n = 16 pixels with n sum v^2 - (sum v)^2 < (n deviation)^2
//! repeated:  a[k] = sum over 96 pixels of |v[x] - v[x + k]|,  k = 1..64
//!            a rises to its largest value, and falls again to less than a quarter of that, both less what noise adds
//! fields:    f[k] = sum over x of |even[x] - odd[x + k]| + |odd[x] - even'[x - k]|,  even' the next even row
//! ```
//!
//! A slanted edge moves the same way from any row to the next; only fields move back and forth.

use crate::simd::{Level, Loop};

/// Pixels of a run.
const RUN: usize = 16;
/// Pixels that are compared with those some way on.
const WINDOW: usize = 96;
/// Longest period that is seen, pixels.
const LONGEST: usize = 64;
/// What a repetition leaves of the largest difference.
const LEFT: f64 = 0.25;
/// The mean of the difference of two values with noise, in standard deviations of it.
const MEAN_OF_NOISE: f64 = 1.13;
/// Largest shift between two fields, pixels.
pub const FIELD_REACH: usize = 12;

/// The number of runs of a row whose standard deviation is below `deviation`, and of all runs.
pub fn flat_runs(row: &[i32], deviation: f64, level: Level) -> [u64; 2] {
    let limit = (deviation * RUN as f64).powi(2) as i64;
    let runs = row.as_chunks::<RUN>().0;

    [level.run(FlatRuns { runs, limit }), runs.len() as u64]
}

/// Counts runs with a sum of squared deviations, times their length, below a limit.
struct FlatRuns<'a> {
    runs: &'a [[i32; RUN]],
    limit: i64,
}

impl Loop for FlatRuns<'_> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let mut count = 0;
        for run in self.runs {
            let (mut sum, mut squares) = (0i64, 0i64);
            for value in run {
                sum += i64::from(*value);
                squares += i64::from(value * value);
            }
            count += u64::from(RUN as i64 * squares - sum * sum < self.limit);
        }
        count
    }
}

/// The number of windows of a row that come back further on, and of all windows. `noise` is the standard deviation of the
/// noise; what differs by less than `least` is no texture.
pub fn repeated_windows(row: &[i32], noise: f64, least: f64, level: Level) -> [u64; 2] {
    let windows = row.windows(WINDOW + LONGEST).step_by(WINDOW);

    let repeats = |part: &[i32]| {
        let differences = level.run(Differences(part));
        let part = |sum: u32| f64::from(sum) / WINDOW as f64 - MEAN_OF_NOISE * noise;

        let largest = differences.iter().copied().max().unwrap_or(0);
        let after = differences.iter().skip_while(|sum| **sum < largest);
        let smallest = after.copied().min().unwrap_or(largest);
        part(largest) > least && part(smallest) < LEFT * part(largest)
    };

    let all = windows.len() as u64;
    [windows.filter(|part| repeats(part)).count() as u64, all]
}

/// The sums of differences between the first pixels and those some way on.
struct Differences<'a>(&'a [i32]);

impl Loop for Differences<'_> {
    type Output = [u32; LONGEST];

    #[inline(always)]
    fn run(self) -> [u32; LONGEST] {
        let first = &self.0[..WINDOW];
        let mut sums = [0; LONGEST];

        for (at, sum) in sums.iter_mut().enumerate() {
            let other = &self.0[at + 1..at + 1 + WINDOW];
            *sum = first.iter().zip(other).map(|(a, b)| a.abs_diff(*b)).sum();
        }
        sums
    }
}

/// The differences between an even row, the odd one below and the even one below that, by the shift of the odd row, from
/// `-FIELD_REACH` on; all 0 where rows are too short.
pub fn field_differences(rows: [&[i32]; 3], level: Level) -> [u64; 2 * FIELD_REACH + 1] {
    if rows[0].len() <= 2 * FIELD_REACH {
        return [0; 2 * FIELD_REACH + 1];
    }

    level.run(FieldDifferences(rows))
}

struct FieldDifferences<'a>([&'a [i32]; 3]);

impl Loop for FieldDifferences<'_> {
    type Output = [u64; 2 * FIELD_REACH + 1];

    #[inline(always)]
    fn run(self) -> [u64; 2 * FIELD_REACH + 1] {
        let [even, odd, next] = self.0;
        let count = even.len() - 2 * FIELD_REACH;
        let middle = FIELD_REACH..FIELD_REACH + count;
        let (first, second) = (&even[middle.clone()], &odd[middle]);

        let mut sums = [0; 2 * FIELD_REACH + 1];
        for (at, sum) in sums.iter_mut().enumerate() {
            let back = 2 * FIELD_REACH - at;
            let (moved, other) = (&odd[at..at + count], &next[back..back + count]);

            for x in 0..count {
                *sum += u64::from(first[x].abs_diff(moved[x]) + second[x].abs_diff(other[x]));
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values without any pattern.
    fn hashed(x: usize) -> i32 {
        ((x as u32).wrapping_mul(2_654_435_761) >> 20) as i32
    }

    #[test]
    fn runs_without_contrast_are_flat() {
        let row: Vec<i32> = (0..53).map(|x| if x < 32 { 100 + x % 2 } else { hashed(x as usize) }).collect();
        assert_eq!(flat_runs(&row, 0.6, Level::best()), [2, 3]);
        assert_eq!(flat_runs(&row, 0.4, Level::best()), [0, 3]);
    }

    #[test]
    fn only_what_comes_back_is_repeated() {
        let count = |value: &dyn Fn(usize) -> i32| {
            let row: Vec<i32> = (0..400).map(value).collect();
            repeated_windows(&row, 10.0, 100.0, Level::best())
        };

        assert_eq!(count(&|x| hashed(x % 23)), [3, 3]);
        assert_eq!(count(&hashed), [0, 3]);
        assert_eq!(count(&|x| 40 * x as i32), [0, 3], "a slope rises for ever");
        assert_eq!(count(&|x| i32::from(x % 150 == 90) * 4000), [0, 3], "a line alone");
        assert_eq!(count(&|x| hashed(x % 23) % 8), [0, 3], "too faint");
        assert_eq!(repeated_windows(&[1; 159], 1.0, 1.0, Level::best()), [0, 0]);
    }

    #[test]
    fn fields_are_most_alike_at_their_shift_to_the_sum() {
        let row = |shift: usize| -> Vec<i32> { (0..90).map(|x| hashed(x + shift)).collect() };
        let (even, odd) = (row(20), row(15)); // 5 columns to the right

        let found = field_differences([&even, &odd, &even], Level::best());
        assert_eq!(found.iter().position(|sum| *sum == 0), Some(FIELD_REACH + 5));

        let naive = |k: isize| -> u64 {
            let inside = FIELD_REACH as isize..90 - FIELD_REACH as isize;
            let at = |row: &[i32], x: isize| row[x as usize];
            inside
                .map(|x| at(&even, x).abs_diff(at(&odd, x + k)) + at(&odd, x).abs_diff(at(&even, x - k)))
                .map(u64::from)
                .sum()
        };
        for (index, sum) in found.into_iter().enumerate() {
            assert_eq!(sum, naive(index as isize - FIELD_REACH as isize));
        }
    }
}

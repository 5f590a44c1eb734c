//! Kernels on single rows of gray values, in integers: texture, repetition, and fields of interlaced video.
//!
//! ```text
//! flat:      a run of n = 16 pixels with n sum v^2 - (sum v)^2 < (n deviation)^2
//! smeared:   mean of |v[x - 1] - 2 v[x] + v[x + 1]| < 0.4 mean of |v[x] - v[x - 4]|
//! repeated:  a[k] = sum over 96 pixels of |v[x] - v[x + k]|,  k = 1..64, or to the longest misleading period
//!            a rises to its largest value and falls below a quarter of that, both minus the effect of noise
//! fields:    f[k] = sum over x of |even[x] - odd[x + k]| + |odd[x] - even'[x - k]|,  even' the next even row
//! ```
//!
//! A slanted edge moves the same way from any row to the next; only fields move back and forth.

use phasestereo_match::base::simd::{Level, leveled};

/// Pixels of a run.
const RUN: usize = 16;
/// Distance of the pixels whose differences are steps.
const FAR: usize = 4;
/// Bends below this share of the steps are those of a smooth curve. Medians of the quotient: 21 sharp images
/// 0.42 to 0.76; under H.264 of quality 33 and 38 0.26 to 0.37, under a disk of radius 3 0.15.
const SMOOTH: f64 = 0.4;
/// Pixels that are compared with those at a distance.
const WINDOW: usize = 96;
/// Longest period that is detected, pixels.
const LONGEST: usize = 64;
/// Largest share of the largest difference that a repetition leaves.
const LEFT: f64 = 0.25;
/// The mean difference of two noisy values, in standard deviations of the noise.
const MEAN_OF_NOISE: f64 = 1.13;
/// Differences that are summed in 32 bits; each has 15 bits at most.
const SUMMED: usize = 4096;
/// Largest shift between two fields, pixels.
pub const FIELD_REACH: usize = 12;

/// Numbers of runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Runs {
    /// All.
    pub all: u64,
    /// Runs without texture.
    pub flat: u64,
    /// Runs with enough texture to judge whether it is smeared.
    pub textured: u64,
    /// Those among them that are smeared.
    pub smeared: u64,
}

impl Runs {
    /// The numbers of both parts.
    pub fn and(self, other: Self) -> Self {
        Self {
            all: self.all + other.all,
            flat: self.flat + other.flat,
            textured: self.textured + other.textured,
            smeared: self.smeared + other.smeared,
        }
    }
}

/// Counts the runs of a row by their standard deviations: below `flat`, and from `textured` on.
pub fn runs(row: &[i32], flat: f64, textured: f64, level: Level) -> Runs {
    let [flat, textured] = [flat, textured].map(|limit| (limit * RUN as f64).powi(2) as i64);

    count_runs(level, row.as_chunks::<RUN>().0, flat, textured)
}

/// Counts runs by sums of squared deviations, times their length.
#[leveled]
fn count_runs(level: Level, runs: &[[i32; RUN]], flat: i64, textured: i64) -> Runs {
    let mut count = Runs { all: runs.len() as u64, ..Runs::default() };

    for run in runs {
        let (mut sum, mut squares) = (0i64, 0i64);
        for value in run {
            sum += i64::from(*value);
            squares += i64::from(*value) * i64::from(*value);
        }
        let deviation = RUN as i64 * squares - sum * sum;
        count.flat += u64::from(deviation < flat);
        if deviation < textured {
            continue;
        }

        let (mut bends, mut steps) = (0u32, 0u32);
        for x in 1..RUN - 1 {
            bends += (2 * run[x]).abs_diff(run[x - 1] + run[x + 1]);
        }
        for x in FAR..RUN {
            steps += run[x].abs_diff(run[x - FAR]);
        }
        // Means: there are two fewer bends than pixels, and FAR fewer steps.
        let is_smeared =
            f64::from(bends) * ((RUN - FAR) as f64) < SMOOTH * f64::from(steps) * ((RUN - 2) as f64);
        count.textured += 1;
        count.smeared += u64::from(is_smeared);
    }
    count
}

/// The number of windows of a row that recur further on, and of all windows. `noise` is the standard
/// deviation of the noise; differences below `least` are not texture; periods longer than `period` do not
/// count.
pub fn repeated_windows(row: &[i32], noise: f64, least: f64, period: usize, level: Level) -> [u64; 2] {
    let windows = row.windows(WINDOW + LONGEST).step_by(WINDOW);

    let repeats = |part: &[i32]| {
        let differences = &row_differences(level, part)[..period.min(LONGEST)];
        let part = |sum: u32| f64::from(sum) / WINDOW as f64 - MEAN_OF_NOISE * noise;

        let largest = differences.iter().copied().max().unwrap_or(0);
        let after = differences.iter().skip_while(|sum| **sum < largest);
        let smallest = after.copied().min().unwrap_or(largest);
        part(largest) > least && part(smallest) < LEFT * part(largest)
    };

    let all = windows.len() as u64;
    [windows.filter(|part| repeats(part)).count() as u64, all]
}

/// The sums of differences between the first pixels and those at each distance.
#[leveled]
fn row_differences(level: Level, row: &[i32]) -> [u32; LONGEST] {
    let first = &row[..WINDOW];
    let mut sums = [0; LONGEST];

    for (at, sum) in sums.iter_mut().enumerate() {
        let other = &row[at + 1..at + 1 + WINDOW];
        *sum = first.iter().zip(other).map(|(a, b)| a.abs_diff(*b)).sum();
    }
    sums
}

/// The differences between an even row, the odd one below and the even one below that, by the shift of the
/// odd row, starting at `-FIELD_REACH`; all 0 if rows are too short.
#[leveled]
pub fn field_differences(level: Level, rows: [&[i32]; 3]) -> [u64; 2 * FIELD_REACH + 1] {
    let [even, odd, next] = rows;
    if even.len() <= 2 * FIELD_REACH {
        return [0; 2 * FIELD_REACH + 1];
    }

    let count = even.len() - 2 * FIELD_REACH;
    let middle = FIELD_REACH..FIELD_REACH + count;
    let (first, second) = (&even[middle.clone()], &odd[middle]);

    let mut sums = [0; 2 * FIELD_REACH + 1];
    for (at, sum) in sums.iter_mut().enumerate() {
        let back = 2 * FIELD_REACH - at;
        let (moved, other) = (&odd[at..at + count], &next[back..back + count]);

        for at in (0..count).step_by(SUMMED) {
            let part = at..(at + SUMMED).min(count);
            let differences =
                |one: &[i32], two: &[i32]| -> u32 { one.iter().zip(two).map(|(a, b)| a.abs_diff(*b)).sum() };
            *sum += u64::from(differences(&first[part.clone()], &moved[part.clone()]));
            *sum += u64::from(differences(&second[part.clone()], &other[part]));
        }
    }
    sums
}

/// The sums of the differences between neighbors of a row, and between its pixels two apart.
#[leveled]
pub fn alternation(level: Level, row: &[i32]) -> [u64; 2] {
    let count = row.len().saturating_sub(2);
    let mut sums = [0; 2];
    for at in (0..count).step_by(SUMMED) {
        let first = &row[at..(at + SUMMED).min(count)];
        for (by, sum) in (1..).zip(&mut sums) {
            let other = &row[at + by..][..first.len()];
            let part: u32 = first.iter().zip(other).map(|(a, b)| a.abs_diff(*b)).sum();
            *sum += u64::from(part);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alternations_are_sums_of_differences() {
        for length in [0, 1, 2, 3, 70, 4099] {
            let row: Vec<i32> = (0..length).map(hashed).collect();
            let sum = |by: usize| -> u64 {
                (0..length.saturating_sub(2)).map(|x| u64::from(row[x].abs_diff(row[x + by]))).sum()
            };
            assert_eq!(alternation(Level::best(), &row), [sum(1), sum(2)], "{length}");
        }
    }

    /// Values without any pattern.
    fn hashed(x: usize) -> i32 {
        let mixed = (x as u32 + 1).wrapping_mul(2_654_435_761);
        let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519);
        ((mixed ^ (mixed >> 13)) >> 20) as i32
    }

    #[test]
    fn runs_are_told_by_their_contrast_and_by_how_smooth_it_is() {
        let wave = |x: usize| if x % 16 < 8 { 40 * (x % 16) as i32 } else { 40 * (16 - x % 16) as i32 };
        let row: Vec<i32> = (0..69)
            .map(|x| match x / 16 {
                0 => 100 + x as i32 % 2,
                1 => wave(x),
                _ => hashed(x),
            })
            .collect();

        let found = runs(&row, 0.6, 50.0, Level::best());
        assert_eq!(found, Runs { all: 4, flat: 1, textured: 3, smeared: 1 });
        assert_eq!(runs(&row, 0.4, 50.0, Level::best()).flat, 0);
    }

    #[test]
    fn only_what_comes_back_is_repeated() {
        let count = |value: &dyn Fn(usize) -> i32| {
            let row: Vec<i32> = (0..400).map(value).collect();
            repeated_windows(&row, 10.0, 100.0, 40, Level::best())
        };

        assert_eq!(count(&|x| hashed(x % 23)), [3, 3]);
        assert_eq!(count(&hashed), [0, 3]);
        assert_eq!(count(&|x| hashed(x % 41)), [0, 3], "a period that is too long to mislead");
        assert_eq!(count(&|x| 40 * x as i32), [0, 3], "a slope rises for ever");
        assert_eq!(count(&|x| i32::from(x % 150 == 90) * 4000), [0, 3], "a line alone");
        assert_eq!(count(&|x| hashed(x % 23) % 8), [0, 3], "too faint");
        assert_eq!(repeated_windows(&[1; 159], 1.0, 1.0, 40, Level::best()), [0, 0]);
    }

    #[test]
    fn fields_are_most_alike_at_their_shift_to_the_sum() {
        let row = |shift: usize| -> Vec<i32> { (0..90).map(|x| hashed(x + shift)).collect() };
        let (even, odd) = (row(20), row(15)); // 5 columns to the right

        let found = field_differences(Level::best(), [&even, &odd, &even]);
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

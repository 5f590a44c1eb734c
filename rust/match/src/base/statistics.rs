//! Order statistics, and the weights of robust fits.

use std::cmp::Ordering;

/// Converts a median absolute deviation to the standard deviation of normal errors: 1 over the third quartile
/// of the normal distribution.
const OF_MEDIAN: f64 = 1.4826;

/// Values with a total order.
pub trait TotalOrder: Copy {
    /// The order of two values.
    fn order(&self, other: &Self) -> Ordering;
}

impl TotalOrder for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl TotalOrder for u32 {
    fn order(&self, other: &Self) -> Ordering {
        self.cmp(other)
    }
}

/// The value of a rank, 0 for the smallest; `None` beyond the last. It reorders the values, which is faster
/// than sorting.
pub fn ranked<T: TotalOrder>(values: &mut [T], rank: usize) -> Option<T> {
    (rank < values.len()).then(|| *values.select_nth_unstable_by(rank, T::order).1)
}

/// The value at a quantile, 0 for the smallest to 1 for the largest, by the nearest rank.
pub fn quantile<T: TotalOrder>(values: &mut [T], share: f64) -> Option<T> {
    let last = values.len().saturating_sub(1);
    ranked(values, (share * last as f64).round() as usize)
}

/// The median (of an even number, the larger of the middle two); `None` without values.
pub fn median<T: TotalOrder>(values: impl IntoIterator<Item = T>) -> Option<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    let middle = values.len() / 2;
    ranked(&mut values, middle)
}

/// The standard deviation of normal errors from the median of their absolute values, which outliers hardly
/// change; 0 without errors.
pub fn deviation(errors: impl IntoIterator<Item = f64>) -> f64 {
    OF_MEDIAN * median(errors.into_iter().map(f64::abs)).unwrap_or(0.0)
}

/// Errors beyond this many robust standard deviations have zero weight once a fit is near.
const CUT: f64 = 4.0;

/// The weight of an absolute error in a robust fit with this robust standard deviation. Least absolute
/// deviations lead near the solution from anywhere; the biweight then ignores outliers entirely.
pub fn robust_weight(error: f64, deviation: f64, is_near: bool) -> f64 {
    if is_near { biweight(error, CUT * deviation) } else { 1.0 / error.max(0.1 * deviation) }
}

/// Tukey's weight of an error: 1 for none, 0 from `cut` on (Beaton and Tukey, Technometrics 16, 1974).
pub fn biweight(error: f64, cut: f64) -> f64 {
    (1.0 - (error / cut).powi(2)).max(0.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_those_of_sorted_values() {
        for count in 1..40usize {
            let values: Vec<f64> = (0..count).map(|at| (at * 17 % 23) as f64 - 9.0).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);

            for (rank, value) in sorted.iter().enumerate() {
                assert_eq!(ranked(&mut values.clone(), rank), Some(*value));
            }
            assert_eq!(ranked(&mut values.clone(), count), None);
            assert_eq!(median(values.iter().copied()), Some(sorted[count / 2]));
            assert_eq!(quantile(&mut values.clone(), 0.0), Some(sorted[0]));
            assert_eq!(quantile(&mut values.clone(), 1.0), Some(sorted[count - 1]));
            assert_eq!(quantile(&mut values.clone(), 0.25), Some(sorted[(count + 1) / 4]));
        }
        assert_eq!(median::<f32>([]), None);
        assert_eq!(quantile::<u32>(&mut [], 0.5), None);
    }

    #[test]
    fn the_deviation_is_that_of_normal_errors_and_stands_outliers() {
        // Sums of twelve uniform numbers are nearly normal, of variance 1.
        let mut state = 1u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let errors: Vec<f64> = (0..4000).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect();
        assert!((deviation(errors.clone()) - 1.0).abs() < 0.05);

        let spoiled = errors.iter().enumerate().map(|(at, e)| if at % 20 == 0 { 1e6 } else { *e });
        assert!((deviation(spoiled) - 1.0).abs() < 0.15);
        assert!(deviation([]).abs() < f64::MIN_POSITIVE);
    }

    #[test]
    fn weights_fall_from_one_to_zero() {
        let expected = [(0.0, 1.0), (1.0, 0.878_906_25), (2.0, 0.5625), (4.0, 0.0), (9.0, 0.0)];
        for (error, weight) in expected {
            assert!((biweight(error, 4.0) - weight).abs() < 1e-15);
            assert!((biweight(-error, 4.0) - weight).abs() < 1e-15);
        }
    }
}

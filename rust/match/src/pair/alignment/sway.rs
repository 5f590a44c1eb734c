//! A spline of the row: the vertical offset that all columns of a row share in addition to the smooth field,
//! as with a shaking rolling shutter.
//!
//! It is a cubic B-spline with uniform knots: the image is divided into [`INTERVALS`] intervals of its
//! height, and in each of them the spline is the sum of four of the [`KNOTS`] factors,
//!
//! ```text
//! t = (y + 1/2) / rows * INTERVALS;  k = floor(t);  u = t - k
//! s(y) = sum over i in 0..4 of b_i(u) factor[k + i]
//! ```
//!
//! It lies between the smallest and the largest of them.

/// Intervals of the height, each with a polynomial of its own.
pub const INTERVALS: usize = 16;
/// Factors of the spline.
pub const KNOTS: usize = INTERVALS + 3;

/// The first of the four factors that count at a fraction of the height from 0 to 1, and their weights.
pub fn weights(fraction: f64) -> (usize, [f64; 4]) {
    let t = fraction.clamp(0.0, 1.0) * INTERVALS as f64;
    let first = (t as usize).min(INTERVALS - 1);
    let u = t - first as f64;

    let rest = 1.0 - u;
    let outer = [rest * rest * rest / 6.0, u * u * u / 6.0];
    let inner = |u: f64| (4.0 - 3.0 * u * u * (2.0 - u)) / 6.0;
    (first, [outer[0], inner(u), inner(rest), outer[1]])
}

/// The spline with these factors at a fraction of the height.
pub fn at(factors: &[f64; KNOTS], fraction: f64) -> f64 {
    let (first, weights) = weights(fraction);
    weights.iter().zip(&factors[first..]).map(|(weight, factor)| weight * factor).sum()
}

/// The weight of every factor in the mean of the spline from one fraction of the height to another.
pub fn mean_weights(from: f64, to: f64) -> [f64; KNOTS] {
    /// Places where the spline is evaluated.
    const PLACES: usize = 8;

    let mut all = [0.0; KNOTS];
    for place in 0..PLACES {
        let share = (place as f64 + 0.5) / PLACES as f64;
        let (first, weights) = weights(from + share * (to - from));
        for (total, weight) in all[first..].iter_mut().zip(weights) {
            *total += weight / PLACES as f64;
        }
    }

    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spline_of_equal_factors_is_their_value_and_one_of_a_line_the_line() {
        let line = std::array::from_fn(|knot| 0.5 * knot as f64 - 0.5);
        for place in 0..=100 {
            let fraction = f64::from(place) / 100.0;
            assert!((at(&[2.5; KNOTS], fraction) - 2.5).abs() < 1e-12);
            assert!((at(&line, fraction) - 0.5 * fraction * INTERVALS as f64).abs() < 1e-12);
        }
    }

    #[test]
    fn means_are_those_of_many_places() {
        let factors = std::array::from_fn(|knot| ((7 * knot) % 5) as f64);
        let (from, to) = (0.21, 0.34);
        let mean: f64 =
            (0..1000).map(|i| at(&factors, from + (f64::from(i) + 0.5) / 1000.0 * (to - from))).sum();
        let found: f64 =
            mean_weights(from, to).iter().zip(factors).map(|(weight, factor)| weight * factor).sum();
        assert!((found - mean / 1000.0).abs() < 0.02);
    }
}

//! The place of a block between pixels: the peak of the paraboloid through nine correlations.
//!
//! ```text
//! c(x, y) = c0 + g . (x, y) + (x, y)' H (x, y) / 2      # g, H: central differences of the nine
//! (x, y) = -H^-1 g                                      # a step of Newton's method
//! curvature of y with x free to follow = -det H / H_xx;   of x: -det H / H_yy
//! covariance of (x, y) = noise (-H)^-1                  # so the curvature is noise over the variance
//! ```

/// Least determinant of a peak: below it, one direction has no peak, as along an edge.
const LEAST_DETERMINANT: f64 = 1e-9;
/// The noise of correlations is this minus their value. A little more than 1 keeps the precision finite.
const PERFECT: f64 = 1.02;

/// The peak of nine correlations, the middle one of which is the largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Columns and rows from the middle, each less than one.
    pub offset: [f64; 2],
    /// The curvature along columns and along rows, with the other free to follow.
    pub curvature: [f64; 2],
    /// The correlation in the middle.
    correlation: f64,
}

impl Peak {
    /// The peak of nine correlations, row after row; `None` if they have none nearby.
    pub fn new(nine: [f64; 9]) -> Option<Self> {
        let [above, middle, below] = [0, 3, 6].map(|row| [0, 1, 2].map(|col| nine[row + col]));
        let correlation = middle[1];

        let slope = [(middle[2] - middle[0]) / 2.0, (below[1] - above[1]) / 2.0];
        let bend = [middle[2] + middle[0] - 2.0 * correlation, below[1] + above[1] - 2.0 * correlation];
        let twist = (below[2] - below[0] - above[2] + above[0]) / 4.0;
        let determinant = bend[0] * bend[1] - twist * twist;
        if determinant <= LEAST_DETERMINANT || bend[0] >= 0.0 {
            return None;
        }

        let offset = [
            (twist * slope[1] - bend[1] * slope[0]) / determinant,
            (twist * slope[0] - bend[0] * slope[1]) / determinant,
        ];
        let curvature = [-determinant / bend[1], -determinant / bend[0]];
        let is_near = offset.iter().all(|by| by.abs() < 1.0);
        is_near.then_some(Self { offset, curvature, correlation })
    }

    /// Inverse variances of the column and of the row, of arbitrary scale: curvature over the noise of the
    /// correlation.
    pub fn precision(&self) -> [f64; 2] {
        self.curvature.map(|curvature| curvature / (PERFECT - self.correlation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nine values of a paraboloid with its largest value at a place.
    fn nine([x, y]: [f64; 2], bend: [f64; 2], twist: f64, best: f64) -> [f64; 9] {
        std::array::from_fn(|at| {
            let (dx, dy) = ((at % 3) as f64 - 1.0 - x, (at / 3) as f64 - 1.0 - y);
            best + 0.5 * (bend[0] * dx * dx + bend[1] * dy * dy) + twist * dx * dy
        })
    }

    #[test]
    fn the_peak_of_a_paraboloid_is_exact() {
        for (at, twist) in [([0.3, -0.4], 0.0), ([-0.45, 0.2], 0.02), ([0.0, 0.0], -0.03)] {
            let peak = Peak::new(nine(at, [-0.1, -0.05], twist, 0.9)).expect("a peak");
            assert!((0..2).all(|axis| (peak.offset[axis] - at[axis]).abs() < 1e-9));
            // The inverse of the Hessian, by definition.
            let determinant = 0.1 * 0.05 - twist * twist;
            assert!((peak.curvature[0] - determinant / 0.05).abs() < 1e-9);
            assert!((peak.curvature[1] - determinant / 0.1).abs() < 1e-9);
        }
    }

    #[test]
    fn saddles_hollows_edges_and_far_peaks_are_none() {
        assert_eq!(Peak::new(nine([0.0; 2], [0.1, 0.1], 0.0, 0.9)), None);
        assert_eq!(Peak::new(nine([0.0; 2], [-0.1, -0.1], 0.2, 0.9)), None);
        assert_eq!(Peak::new(nine([0.0; 2], [-0.1, 0.1], 0.0, 0.9)), None);
        assert_eq!(Peak::new(nine([0.0; 2], [-0.1, 0.0], 0.0, 0.9)), None);
        assert_eq!(Peak::new(nine([1.2, 0.0], [-0.1, -0.1], 0.0, 0.9)), None);
    }

    #[test]
    fn better_correlations_are_more_precise() {
        let precision =
            |best| Peak::new(nine([0.1; 2], [-0.1, -0.1], 0.0, best)).expect("a peak").precision();
        assert!((0..2).all(|axis| precision(0.99)[axis] > 3.0 * precision(0.7)[axis]));
    }
}

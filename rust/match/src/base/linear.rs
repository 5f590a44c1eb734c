//! Least squares of a few unknowns: normal equations and their Cholesky factor.
//!
//! ```text
//! A = sum of w t t',  b = sum of w v t     # observations t . x = v of weight w
//! A = L L',  x = L'^-1 L^-1 b              # L: lower triangle
//! t' A^-1 t = |L^-1 t|^2                   # variance of t . x where weights are inverse variances
//! ```

use super::math;

/// Symmetric equations `matrix x = target`; only the lower triangle of the matrix is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normal<const N: usize> {
    /// The matrix.
    pub matrix: [[f64; N]; N],
    /// The right side.
    pub target: [f64; N],
    /// The number of unknowns, at most `N`. Those beyond it are 0.
    pub count: usize,
}

/// The Cholesky factor of a matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cholesky<const N: usize> {
    lower: [[f64; N]; N],
    count: usize,
}

impl<const N: usize> Normal<N> {
    /// Equations without observations.
    pub fn new(count: usize) -> Self {
        Self { matrix: [[0.0; N]; N], target: [0.0; N], count }
    }

    /// Equations of unknowns with a prior of mean 0 and variances `1 / weights`.
    pub fn held(weights: [f64; N]) -> Self {
        let mut normal = Self::new(N);
        for (index, weight) in weights.into_iter().enumerate() {
            normal.matrix[index][index] = weight;
        }
        normal
    }

    /// Adds an observation: `terms . x = value`.
    pub fn add(&mut self, terms: &[f64; N], value: f64, weight: f64) {
        for row in 0..self.count {
            let weighted = weight * terms[row];
            // Most terms of a spline are 0.
            if weighted == 0.0 {
                continue;
            }
            self.target[row] += weighted * value;
            for (sum, term) in self.matrix[row].iter_mut().zip(&terms[..=row]) {
                *sum += weighted * term;
            }
        }
    }

    /// Both sides multiplied by a factor.
    pub fn scaled(mut self, by: f64) -> Self {
        self.matrix.iter_mut().flatten().chain(&mut self.target).for_each(|value| *value *= by);
        self
    }

    /// The same, with the diagonal times `1 + share`.
    pub fn damped(mut self, share: f64) -> Self {
        for index in 0..self.count {
            self.matrix[index][index] *= 1.0 + share;
        }
        self
    }

    /// The unknowns; `None` if the matrix is not positive definite.
    pub fn solved(&self) -> Option<[f64; N]> {
        Some(self.factor()?.solved(self.target))
    }

    /// The factor of the matrix; `None` if it is not positive definite.
    pub fn factor(&self) -> Option<Cholesky<N>> {
        let mut lower = [[0.0f64; N]; N];
        for row in 0..self.count {
            for col in 0..=row {
                let done: f64 = (0..col).map(|k| lower[row][k] * lower[col][k]).sum();
                let rest = self.matrix[row][col] - done;
                if row > col {
                    lower[row][col] = rest / lower[col][col];
                } else if rest > 0.0 {
                    lower[row][row] = rest.sqrt();
                } else {
                    return None;
                }
            }
        }
        Some(Cholesky { lower, count: self.count })
    }
}

impl<const N: usize> Cholesky<N> {
    /// The unknowns, by substitution forward and backward.
    pub fn solved(&self, target: [f64; N]) -> [f64; N] {
        let mut solution = self.forward(target);
        for row in (0..self.count).rev() {
            let known: f64 = (row + 1..self.count).map(|k| self.lower[k][row] * solution[k]).sum();
            solution[row] = (solution[row] - known) / self.lower[row][row];
        }
        solution
    }

    /// The variance of `terms . x`: `terms' A^-1 terms`.
    pub fn variance(&self, terms: [f64; N]) -> f64 {
        self.forward(terms)[..self.count].iter().map(|value| value * value).sum()
    }

    /// Half of the logarithm of the determinant of the matrix.
    pub fn half_log_determinant(&self) -> f64 {
        (0..self.count).map(|at| math::ln(self.lower[at][at])).sum()
    }

    /// The ratio of the first pivot to the smallest of the first `count`: large if the observations hardly
    /// determine a term.
    pub fn condition(&self, count: usize) -> f64 {
        let least = (0..count).map(|at| self.lower[at][at]).fold(self.lower[0][0], f64::min);
        (self.lower[0][0] / least).powi(2)
    }

    /// Solves the lower triangular equations.
    fn forward(&self, mut values: [f64; N]) -> [f64; N] {
        for row in 0..self.count {
            let known: f64 = (0..row).map(|k| self.lower[row][k] * values[k]).sum();
            values[row] = (values[row] - known) / self.lower[row][row];
        }
        values[self.count..].fill(0.0);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look random, from -1 to 1.
    fn number(index: usize) -> f64 {
        (index * 7919 % 2003) as f64 / 1001.0 - 1.0
    }

    #[test]
    fn exact_observations_give_the_unknowns_and_those_in_use_alone() {
        let exact = [3.0, -2.0, 0.5, 7.0];
        for count in 1..=4 {
            let mut normal = Normal::<4>::new(count);
            for index in 0..20 {
                let terms = [0, 1, 2, 3].map(|term| number(4 * index + term));
                let value = (0..count).map(|at| terms[at] * exact[at]).sum();
                normal.add(&terms, value, 1.0 + number(index).abs());
            }
            let solved = normal.solved().expect("positive definite");
            let known: [f64; 4] = std::array::from_fn(|at| if at < count { exact[at] } else { 0.0 });
            assert!(solved.iter().zip(known).all(|(a, b)| (a - b).abs() < 1e-12), "{solved:?}");

            // The variance by definition: terms . (A^-1 terms).
            let factor = normal.factor().expect("positive definite");
            let terms = [0.3, -1.0, 2.0, 0.7];
            let inverse = factor.solved(terms);
            let variance: f64 = terms.iter().zip(inverse).map(|(a, b)| a * b).sum();
            assert!((factor.variance(terms) - variance).abs() < 1e-12);
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let mut normal = Normal::<2>::new(2);
        normal.add(&[1.0, 1.0], 2.0, 1.0);
        assert_eq!(normal.solved(), None);
        normal.add(&[1.0, 1.0 + 1e-5], 2.0, 1.0);
        assert!(normal.factor().expect("hardly determined").condition(2) > 1e9);
    }

    #[test]
    fn the_determinant_is_the_product_of_the_pivots() {
        let normal = Normal { matrix: [[4.0, 0.0], [2.0, 10.0]], target: [0.0; 2], count: 2 };
        let factor = normal.factor().expect("positive definite");
        assert!((factor.half_log_determinant() - math::ln(6.0)).abs() < 1e-15);
        assert!((factor.condition(2) - 1.0).abs() < 1e-15);
    }
}

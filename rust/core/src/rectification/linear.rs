//! Normal equations of a few unknowns, solved by Cholesky's decomposition.

/// Symmetric equations `matrix x = target`; of the matrix, the lower triangle is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normal<const N: usize> {
    /// The matrix.
    pub matrix: [[f64; N]; N],
    /// The right side.
    pub target: [f64; N],
}

impl<const N: usize> Normal<N> {
    /// Those of unknowns that are 0 but for deviations of variance `1 / weights`.
    pub fn held(weights: [f64; N]) -> Self {
        let mut matrix = [[0.0; N]; N];
        for (index, weight) in weights.iter().enumerate() {
            matrix[index][index] = *weight;
        }
        Self { matrix, target: [0.0; N] }
    }

    /// Adds an observation: `terms . x = value`.
    pub fn add(&mut self, terms: &[f64; N], value: f64, weight: f64) {
        for row in 0..N {
            let weighted = weight * terms[row];
            self.target[row] += weighted * value;
            for (sum, term) in self.matrix[row].iter_mut().zip(&terms[..=row]) {
                *sum += weighted * term;
            }
        }
    }

    /// The same with the diagonal times `1 + share`.
    pub fn damped(mut self, share: f64) -> Self {
        for index in 0..N {
            self.matrix[index][index] *= 1.0 + share;
        }
        self
    }

    /// The unknowns; `None` where the matrix is not positive definite.
    pub fn solved(&self) -> Option<[f64; N]> {
        let lower = self.factor()?;
        let mut solution = forward(&lower, self.target);
        for row in (0..N).rev() {
            let known: f64 = (row + 1..N).map(|k| lower[k][row] * solution[k]).sum();
            solution[row] = (solution[row] - known) / lower[row][row];
        }
        Some(solution)
    }

    /// The Cholesky factor: a lower triangle.
    pub fn factor(&self) -> Option<[[f64; N]; N]> {
        let mut lower = [[0.0f64; N]; N];
        for row in 0..N {
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
        Some(lower)
    }
}

/// Solves the equations of a lower triangle.
pub fn forward<const N: usize>(lower: &[[f64; N]; N], mut values: [f64; N]) -> [f64; N] {
    for row in 0..N {
        let known: f64 = (0..row).map(|k| lower[row][k] * values[k]).sum();
        values[row] = (values[row] - known) / lower[row][row];
    }
    values
}

/// The median; 0 of no values.
pub fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

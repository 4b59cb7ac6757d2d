//! Dense linear algebra of a few hundred unknowns: symmetric eigenvectors, Cholesky factors.

/// A square matrix, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Square {
    size: usize,
    values: Vec<f64>,
}

impl Square {
    /// The zero matrix of `size` rows.
    pub fn zero(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size] }
    }

    /// Number of rows, which is also that of columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Entry in a row and a column.
    pub fn get(&self, row: usize, column: usize) -> f64 {
        self.values[row * self.size + column]
    }

    /// Adds `value` to an entry.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.values[row * self.size + column] += value;
    }

    /// Adds another matrix of the same size.
    pub fn add_all(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(sum, value)| *sum += value);
    }

    /// Adds the outer product of a row vector with itself, times a weight.
    pub fn add_outer(&mut self, row: &[f64], weight: f64) {
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                self.add(i, j, weight * a * b);
            }
        }
    }

    /// Lower Cholesky factor; `None` unless the matrix is positive definite to rounding.
    pub fn cholesky(&self) -> Option<Cholesky> {
        let n = self.size;
        let mut factor = Self::zero(n);
        for i in 0..n {
            for j in 0..=i {
                let (a, b) = (&factor.values[i * n..i * n + j], &factor.values[j * n..j * n + j]);
                let rest = self.get(i, j) - a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                factor.values[i * n + j] = if i == j {
                    (rest > 1e-14 * self.get(i, i).abs()).then(|| rest.sqrt())?
                } else {
                    rest / factor.get(j, j)
                };
            }
        }
        Some(Cholesky(factor))
    }

    /// Eigenvalues in ascending order with their unit eigenvectors, by Jacobi rotations; the matrix is symmetric.
    pub fn eigen(&self) -> Vec<(f64, Vec<f64>)> {
        /// Maximum number of sweeps over all pairs of rows; usually fewer than ten suffice, since convergence is
        /// quadratic.
        const SWEEPS: usize = 60;
        let n = self.size;
        let mut matrix = self.clone();
        let mut vectors = Self::zero(n);
        (0..n).for_each(|index| vectors.add(index, index, 1.0));
        for _ in 0..SWEEPS {
            let off =
                (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| matrix.get(i, j).powi(2)).sum::<f64>();
            if off <= 1e-40 * matrix.values.iter().map(|value| value * value).sum::<f64>() {
                break;
            }
            for p in 0..n {
                for q in p + 1..n {
                    matrix.rotate(p, q, &mut vectors);
                }
            }
        }
        let mut pairs: Vec<(f64, Vec<f64>)> = (0..n)
            .map(|index| (matrix.get(index, index), (0..n).map(|row| vectors.get(row, index)).collect()))
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        pairs
    }

    /// Jacobi rotation that zeroes the entry (p, q); also applied to the columns of `vectors`.
    fn rotate(&mut self, p: usize, q: usize, vectors: &mut Self) {
        let n = self.size;
        let entry = self.get(p, q);
        if entry == 0.0 {
            return;
        }
        let theta = (self.get(q, q) - self.get(p, p)) / (2.0 * entry);
        let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
        let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
        let sine = tangent * cosine;
        for k in 0..n {
            let (a, b) = (self.get(k, p), self.get(k, q));
            self.values[k * n + p] = cosine * a - sine * b;
            self.values[k * n + q] = sine * a + cosine * b;
        }
        for k in 0..n {
            let (a, b) = (self.get(p, k), self.get(q, k));
            self.values[p * n + k] = cosine * a - sine * b;
            self.values[q * n + k] = sine * a + cosine * b;
            let (a, b) = (vectors.get(k, p), vectors.get(k, q));
            vectors.values[k * n + p] = cosine * a - sine * b;
            vectors.values[k * n + q] = sine * a + cosine * b;
        }
    }
}

/// Lower triangular factor L with A = L Lᵀ.
#[derive(Clone, Debug)]
pub struct Cholesky(Square);

impl Cholesky {
    /// Solution x of A x = b.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let n = self.0.size;
        let mut x = right.to_vec();
        for i in 0..n {
            let known: f64 = (0..i).map(|j| self.0.get(i, j) * x[j]).sum();
            x[i] = (x[i] - known) / self.0.get(i, i);
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|j| self.0.get(j, i) * x[j]).sum();
            x[i] = (x[i] - known) / self.0.get(i, i);
        }
        x
    }

    /// The first `count` rows and columns of the inverse of A.
    pub fn inverse_block(&self, count: usize) -> Square {
        let mut block = Square::zero(count);
        for column in 0..count {
            let mut unit = vec![0.0; self.0.size];
            unit[column] = 1.0;
            let solved = self.solve(&unit);
            (0..count).for_each(|row| block.add(row, column, solved[row]));
        }
        block
    }

    /// Natural logarithm of the determinant of A.
    pub fn log_determinant(&self) -> f64 {
        2.0 * (0..self.0.size).map(|index| self.0.get(index, index).ln()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// AᵀA + I of pseudo-random rows.
    fn sample(size: usize) -> Square {
        let mut matrix = Square::zero(size);
        for row in 0..2 * size {
            let values: Vec<f64> =
                (0..size).map(|column| ((7 * row + 13 * column * column + 1) as f64).sin()).collect();
            matrix.add_outer(&values, 1.0);
        }
        (0..size).for_each(|index| matrix.add(index, index, 1.0));
        matrix
    }

    #[test]
    fn factors_and_eigenvectors_reproduce_the_matrix() {
        let matrix = sample(9);
        let factor = matrix.cholesky().unwrap();
        let wanted: Vec<f64> = (0..9).map(|index| f64::from(index) - 4.0).collect();
        let right: Vec<f64> = (0..9).map(|row| (0..9).map(|k| matrix.get(row, k) * wanted[k]).sum()).collect();
        assert!(factor.solve(&right).iter().zip(&wanted).all(|(got, wanted)| (got - wanted).abs() < 1e-9));
        let block = factor.inverse_block(9);
        let product = |i: usize, j: usize| (0..9).map(|k| matrix.get(i, k) * block.get(k, j)).sum::<f64>();
        assert!((product(3, 3) - 1.0).abs() < 1e-9 && product(3, 4).abs() < 1e-9);
        let pairs = matrix.eigen();
        assert!(pairs.windows(2).all(|two| two[0].0 <= two[1].0));
        for (value, vector) in &pairs {
            for row in 0..9 {
                let image: f64 = (0..9).map(|k| matrix.get(row, k) * vector[k]).sum();
                assert!((image - value * vector[row]).abs() < 1e-9);
            }
        }
        let logs: f64 = pairs.iter().map(|(value, _)| value.ln()).sum();
        assert!((factor.log_determinant() - logs).abs() < 1e-9);
        let mut singular = Square::zero(2);
        singular.add_outer(&[1.0, 2.0], 1.0);
        assert!(singular.cholesky().is_none());
    }
}

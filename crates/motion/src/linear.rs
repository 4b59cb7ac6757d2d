//! Dense 6x6 linear algebra for task-space computations.

/// Solves `matrix * x = right` by Gaussian elimination with partial pivoting; `None` if singular.
pub(crate) fn solve(mut matrix: [[f64; 6]; 6], mut right: [f64; 6]) -> Option<[f64; 6]> {
    for column in 0..6 {
        let pivot = (column..6).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs()))?;
        if matrix[pivot][column].abs() < 1e-14 {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..6 {
            let factor = matrix[row][column] / matrix[column][column];
            subtract(&mut matrix, row, column, factor);
            right[row] -= factor * right[column];
        }
    }
    let mut solution = [0.0; 6];
    for row in (0..6).rev() {
        let known: f64 = (row + 1..6).map(|k| matrix[row][k] * solution[k]).sum();
        solution[row] = (right[row] - known) / matrix[row][row];
    }
    Some(solution)
}

/// Determinant by Gaussian elimination with partial pivoting.
pub(crate) fn determinant(mut matrix: [[f64; 6]; 6]) -> f64 {
    let mut determinant = 1.0;
    for column in 0..6 {
        let pivot = (column..6).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs()));
        let pivot = pivot.unwrap_or(column);
        if matrix[pivot][column] == 0.0 {
            return 0.0;
        }
        if pivot != column {
            matrix.swap(column, pivot);
            determinant = -determinant;
        }
        determinant *= matrix[column][column];
        for row in column + 1..6 {
            let factor = matrix[row][column] / matrix[column][column];
            subtract(&mut matrix, row, column, factor);
        }
    }
    determinant
}

/// row -= factor · pivot row.
fn subtract(matrix: &mut [[f64; 6]; 6], row: usize, pivot: usize, factor: f64) {
    let pivot_row = matrix[pivot];
    for (cell, value) in matrix[row].iter_mut().zip(pivot_row) {
        *cell -= factor * value;
    }
}

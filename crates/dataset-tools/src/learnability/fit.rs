//! Ridge regression with cross-validation.

/// Number of folds of the cross-validation.
const FOLDS: usize = 5;
/// Ridge term added to the diagonal of the normal equations, so that constant features do not make them singular.
const RIDGE: f64 = 1e-9;

/// Features of a quadratic regression: a constant, the entries of `squared` with all their products, and those of
/// `once` linearly.
pub(super) fn quadratic((squared, once): (Vec<f64>, Vec<f64>)) -> Vec<f64> {
    let mut features = vec![1.0];
    features.extend(&squared);
    for (index, a) in squared.iter().enumerate() {
        features.extend(squared[index..].iter().map(|b| a * b));
    }
    features.extend(once);
    features
}

/// Cross-validated sum of squared residuals of each entry of the targets: every fifth row is predicted by a fit to the
/// other rows.
pub(super) fn residuals(inputs: &[Vec<f64>], targets: &[Vec<f64>]) -> Vec<f64> {
    let entries = targets.first().map_or(0, Vec::len);
    let mut squares = vec![0.0; entries];
    for fold in 0..FOLDS {
        let is_tested = |index: &usize| index % FOLDS == fold;
        let known: Vec<usize> = (0..inputs.len()).filter(|index| !is_tested(index)).collect();
        let weights = fitted(inputs, targets, &known, entries);
        for index in (0..inputs.len()).filter(is_tested) {
            for (entry, square) in squares.iter_mut().enumerate() {
                let predicted: f64 = inputs[index].iter().zip(&weights).map(|(x, w)| x * w[entry]).sum();
                *square += (targets[index][entry] - predicted).powi(2);
            }
        }
    }
    squares
}

/// Ridge regression weights from the rows `known`, a row per feature and a column per entry of the targets.
fn fitted(inputs: &[Vec<f64>], targets: &[Vec<f64>], known: &[usize], entries: usize) -> Vec<Vec<f64>> {
    let features = inputs.first().map_or(0, Vec::len);
    let mut rows: Vec<Vec<f64>> = (0..features)
        .map(|row| {
            let sum =
                |of: &dyn Fn(usize) -> f64| known.iter().map(|&index| inputs[index][row] * of(index)).sum::<f64>();
            let left = (0..features)
                .map(|column| sum(&|index| inputs[index][column]) + if row == column { RIDGE } else { 0.0 });
            left.chain((0..entries).map(|entry| sum(&|index| targets[index][entry]))).collect()
        })
        .collect();
    // Gauss-Jordan elimination with pivoting.
    for column in 0..features {
        let pivot = (column..features).max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
        rows.swap(column, pivot.unwrap_or(column));
        let divisor = rows[column][column];
        if divisor == 0.0 {
            continue;
        }
        rows[column].iter_mut().for_each(|value| *value /= divisor);
        let pivot = rows[column].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(index, _)| *index != column) {
            let factor = row[column];
            row.iter_mut().zip(&pivot).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    rows.into_iter().map(|row| row[features..].to_vec()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_functions_are_fitted_exactly_and_noise_is_not() {
        let at = |index: usize| [(index as f64 * 0.37).sin(), (index as f64 * 0.91).cos()];
        let inputs: Vec<Vec<f64>> = (0..60).map(|index| quadratic((at(index).to_vec(), vec![]))).collect();
        let targets: Vec<Vec<f64>> = (0..60)
            .map(|index| {
                let [x, y] = at(index);
                vec![1.0 + 2.0 * x - y + 0.5 * x * y - y * y, if index % 2 == 0 { 1.0 } else { -1.0 }]
            })
            .collect();
        let squares = residuals(&inputs, &targets);
        assert!(squares[0] < 1e-9, "{squares:?}");
        assert!(squares[1] > 0.8 * 60.0, "{squares:?}");
        // The second feature is constant.
        let inputs: Vec<Vec<f64>> = (0..60).map(|index| quadratic((vec![at(index)[0], 0.0], vec![1.0]))).collect();
        let linear: Vec<Vec<f64>> = (0..60).map(|index| vec![3.0 - at(index)[0]]).collect();
        assert!(residuals(&inputs, &linear)[0] < 1e-6);
    }
}

//! Least squares for curves over time with a handful of unknowns.

use genmanip_real::least_squares::{Normal, minimise};

use crate::structure::whiteness;

/// A measured curve with a formula of `N` unknowns.
pub struct Curve<'a, const N: usize, F: Fn(&[f64; N], f64) -> f64> {
    /// Times, s.
    pub times_s: &'a [f64],
    /// Measured values, m.
    pub values_m: &'a [f64],
    /// Value of the formula at a time.
    pub at: F,
    /// Steps of the finite differences.
    pub steps: [f64; N],
    /// The same for the uncertainty, within the bounds: as large as changes that the curve may barely show.
    pub spans: [f64; N],
    /// Smallest and largest value of each unknown.
    pub bounds: [[f64; 2]; N],
}

/// Solution with standard deviations.
pub struct CurveFit<const N: usize> {
    /// Unknowns.
    pub point: [f64; N],
    /// Their standard deviations.
    pub sd: [f64; N],
}

/// A coefficient as one measurement shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficient {
    /// Value.
    pub value: f64,
    /// Its standard deviation; infinite if nothing shows the coefficient.
    pub sd: f64,
}

impl<const N: usize> CurveFit<N> {
    /// One of the unknowns.
    pub fn coefficient(&self, index: usize) -> Coefficient {
        Coefficient { value: self.point[index], sd: self.sd[index] }
    }
}

impl<const N: usize, F: Fn(&[f64; N], f64) -> f64> Curve<'_, N, F> {
    /// Best of the solutions from several starts; `None` if none of them determines all unknowns.
    pub fn fit(&self, starts: &[[f64; N]], least_noise: f64) -> Option<CurveFit<N>> {
        let moved = |point: &[f64; N], change: &[f64]| -> [f64; N] {
            std::array::from_fn(|index| {
                let [least, most] = self.bounds[index];
                (point[index] + change[index]).clamp(least, most)
            })
        };
        let evaluate = |point: &[f64; N]| Some(self.normal(point, &self.steps));
        let solved = starts.iter().filter_map(|start| minimise(*start, evaluate, moved));
        let (point, _) = solved.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
        let residuals = whiteness(&self.residuals(&point), 0.0);
        let noise = residuals.noise.max(least_noise);
        // A curve that the formula does not explain to the noise says less than its scatter promises (Birge, 1932).
        let birge = residuals.slow_ratio.max(1.0).sqrt();
        let covariance = self.normal(&point, &self.spans).hessian.cholesky()?.inverse_block(N);
        let sd = std::array::from_fn(|index| birge * noise * covariance.get(index, index).sqrt());
        Some(CurveFit { point, sd })
    }

    fn residuals(&self, point: &[f64; N]) -> Vec<f64> {
        self.times_s.iter().zip(self.values_m).map(|(time, value)| value - (self.at)(point, *time)).collect()
    }

    fn normal(&self, point: &[f64; N], steps: &[f64; N]) -> Normal {
        let column = |index: usize| -> Vec<f64> {
            let [least, most] = self.bounds[index];
            let beside = |by: f64| {
                let mut beside = *point;
                beside[index] = (beside[index] + by).clamp(least, most);
                (beside[index], self.residuals(&beside))
            };
            let ((high, up), (low, down)) = (beside(steps[index]), beside(-steps[index]));
            up.iter().zip(&down).map(|(up, down)| (up - down) / (high - low)).collect()
        };
        let columns: [Vec<f64>; N] = std::array::from_fn(column);
        let mut normal = Normal::new(N);
        for (row, residual) in self.residuals(point).into_iter().enumerate() {
            let entries: [(usize, f64); N] = std::array::from_fn(|index| (index, columns[index][row]));
            normal.add(residual, &entries, 1.0);
        }
        normal
    }
}

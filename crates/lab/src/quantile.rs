//! Quantiles of measured values.

/// Quantile of ascending values: the nearest value at a share from 0 to 1; 0 without values.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (sorted.len().saturating_sub(1) as f64 * share).round() as usize;
    sorted.get(index).copied().unwrap_or_default()
}

/// Median and 95th percentile of measured values.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Spread {
    /// Median of the values.
    pub median: f64,
    /// 95th percentile of the values.
    pub p95: f64,
}

impl Spread {
    /// Median and 95th percentile of values in any order; both 0 without values.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self { median: quantile(&values, 0.5), p95: quantile(&values, 0.95) }
    }

    /// Text `median / 95th percentile`, both multiplied by `scale` to change the unit.
    pub fn text(self, scale: f64) -> String {
        format!("{:.2} / {:.2}", scale * self.median, scale * self.p95)
    }
}

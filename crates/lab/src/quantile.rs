//! Quantiles of measured values.

/// The value at a share (0-1) of sorted values, the nearest one; 0 if there are none.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let index = (sorted.len().saturating_sub(1) as f64 * share).round() as usize;
    sorted.get(index).copied().unwrap_or_default()
}

/// Median and 95th percentile.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl Spread {
    /// Of values in any order; 0 without any.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self { median: quantile(&values, 0.5), p95: quantile(&values, 0.95) }
    }

    /// `median / 95th percentile` in another unit.
    pub fn text(self, scale: f64) -> String {
        format!("{:.2} / {:.2}", scale * self.median, scale * self.p95)
    }
}

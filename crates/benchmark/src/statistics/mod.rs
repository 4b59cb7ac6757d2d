//! Statistics of results: rates and means with intervals, summaries, paired comparisons, agreement of
//! simulation and reality, agreement of reviewers.

mod agreement;
mod interval;
mod paired;
mod power;
mod reviewers;
mod sequential;
mod summary;
#[cfg(test)]
pub(crate) mod tests;
mod traits;

pub use agreement::{Duel, RankViolation, bradley_terry, kendall, mmrv, pearson, rank_violations, spearman};
pub use interval::{Mean, Rate, mean_with_interval, wilson_interval};
pub(crate) use interval::{expanded_tail, percentiles};
pub use paired::{PairedComparison, compare, mcnemar_exact, paired_difference, permutation_test};
pub use power::{detectable_difference, power};
pub use reviewers::{ReviewerAgreement, reviewer_agreement};
pub use sequential::{Sequential, sequential};
pub use summary::{
    AgentFailureCount, FailureCount, KindSummary, StatisticsError, SuiteSummary, agent_failure_counts, failure_counts,
    spl, summarise,
};
pub use traits::{MIN_SCENARIOS, TraitSummary, Traits, by_trait};

use genmanip_core::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of summaries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StatisticsSettings {
    /// Two-sided normal quantile of the Wilson intervals.
    pub z: f64,
    /// Two-sided coverage of the bootstrap intervals.
    pub coverage: f64,
    /// Resamples of the bootstrap.
    pub resamples: usize,
    /// Random stream of the bootstrap.
    pub seed: Seed,
    /// Stray contact force from which an episode counts as a collision, N.
    pub collision_n: f64,
}

impl Default for StatisticsSettings {
    fn default() -> Self {
        Self {
            // 95 %.
            z: 1.959_963_984_540_054,
            // The same 95 %.
            coverage: 0.95,
            // The error of a 2.5 % quantile from 2,000 resamples is about 0.35 percentage points of coverage.
            resamples: 2_000,
            // Any fixed number: the same results must give the same interval.
            seed: Seed::new(0),
            // More than the touch of a finger that closes before the other, less than a shove.
            collision_n: 20.0,
        }
    }
}

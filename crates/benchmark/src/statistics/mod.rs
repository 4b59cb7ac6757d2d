//! Statistics of results: rates and means with intervals, summaries, paired comparisons, agreement of simulation and
//! reality, and agreement of reviewers.

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

/// Settings of intervals, tests and summaries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StatisticsSettings {
    /// Two-sided normal quantile of the Wilson intervals, for example 1.96 for 95 %.
    pub z: f64,
    /// Two-sided coverage of the bootstrap intervals, 0 to 1; 1 minus the level of tests.
    pub coverage: f64,
    /// Number of resamples of the bootstrap.
    pub resamples: usize,
    /// Seed of the bootstrap.
    pub seed: Seed,
    /// Stray contact force from which an episode counts as a collision, N.
    pub collision_n: f64,
}

impl Default for StatisticsSettings {
    fn default() -> Self {
        Self {
            // Quantile for a coverage of 95 %.
            z: 1.959_963_984_540_054,
            // The same coverage as that of `z`.
            coverage: 0.95,
            // The error of a 2.5 % quantile from 2,000 resamples is about 0.35 percentage points of coverage.
            resamples: 2_000,
            // Any fixed number will do; it must be fixed, so that the same results give the same interval.
            seed: Seed::new(0),
            // Above the force of a finger that touches before the other one closes, below that of pushing an object
            // aside. Chosen by
            // hand.
            collision_n: 20.0,
        }
    }
}

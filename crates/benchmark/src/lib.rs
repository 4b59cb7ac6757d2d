//! Benchmark suites, statistics of results, comparisons, leaderboards and the report.
//!
//! Statistics and pages are pure functions from values to text; [`suites`], [`compare`](mod@compare) and [`leaderboard_files`] read
//! and write files. Nothing here runs a policy: `genmanip-pipeline` does, also to build and to perturb suites.
//!
//! - [`statistics`]: rates and means with confidence intervals, summaries per policy, paired comparisons.
//! - [`evaluation`]: the results of one policy on one suite as a versioned file.
//! - [`suite_format`]: frozen scenarios for evaluation, and their selection.
//! - [`rows`]: one row per episode of a run, totals over rows, and the selection of episodes with images.
//! - [`report`]: one self-contained HTML page.
//! - [`leaderboard_html`]: policies on the same suites.
//! - [`failure_page`]: failures of a policy that asks questions, with its images.
//! - [`suites`]: suite folders: check, freeze, review, differences, training tasks.
//! - [`balance`]: distribution of a collection against targets, and the choice of a balanced suite with its reasons.
//! - [`distributions`]: suites of task distributions, whose layouts are regenerated: to learn from and to be tested on.
//! - [`compare`](mod@compare): paired comparison of two evaluations of one suite.
//! - [`sim2real`]: agreement of success rates in simulation and in reality.

pub mod balance;
pub mod compare;
mod dataset_page;
pub mod distributions;
pub mod evaluation;
mod failure_page;
mod leaderboard;
pub mod leaderboard_files;
mod line_chart;
pub mod report;
pub mod rows;
pub mod sim2real;
pub mod statistics;
pub mod suite_format;
pub mod suites;
mod training_page;

pub use dataset_page::{FilmStrip, dataset_page};
pub use evaluation::{EvaluationError, EvaluationReport, reference_paths_m, suite_hash};
pub use failure_page::{CaseMoment, FailureCase, FailurePage, KindFailures, failure_page};
pub use leaderboard::{Entry, Leaderboard, boards, leaderboard_html, leaderboard_markdown};
pub use line_chart::{Line, LineChart};
pub use report::{
    AttemptRow, EpisodeImage, ReportError, ReportInput, ReportSettings, TaskSection, Timing, report_html,
};
pub use rows::{EpisodeRow, Outcome, TaskRow};
pub use statistics::{
    PairedComparison, StatisticsError, StatisticsSettings, SuiteSummary, compare, failure_counts, spl, summarise,
};
pub use training_page::{PredictedMoment, training_page};

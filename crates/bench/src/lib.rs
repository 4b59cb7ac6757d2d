//! What came out: drawings of tasks and layouts, statistics of results, and the report people read.
//!
//! Everything here is a pure function from plain values to text; no file is read or written, nothing is simulated.
//!
//! - [`drawing`]: the scene graph and the top view of a layout as SVG.
//! - [`statistics`]: rates and means with confidence intervals, summaries per policy, paired comparisons.
//! - [`evaluation`]: the results of one policy on one suite as a versioned file.
//! - [`suite`]: scenarios that are frozen to be evaluated on, and how they are chosen.
//! - [`rows`]: every episode of a run as a row, totals over rows, and which episodes are worth a picture.
//! - [`report`]: one self-contained HTML page.
//! - [`leaderboard_html`]: how policies did on the same suites.
//! - [`failure_page`]: why a policy that asks failed, with what it was shown.
//! - [`text_table`]: a table for people who read a terminal.

mod dataset_page;
pub mod drawing;
pub mod evaluation;
mod failure_page;
mod leaderboard;
mod markup;
pub mod report;
pub mod rows;
pub mod statistics;
pub mod suite;
mod text_table;

pub use dataset_page::{FilmStrip, dataset_page};
pub use drawing::{
    DrawnEdge, EdgeRole, Footprint, LayoutPicture, PlaceWindow, Refusal, Svg, explain_svg, graph_svg, layout_svg,
};
pub use evaluation::{EvaluationError, EvaluationReport, reference_paths_m, suite_hash};
pub use failure_page::{CaseMoment, FailureCase, FailurePage, KindFailures, failure_page};
pub use leaderboard::{Board, Entry, boards, leaderboard_html, leaderboard_markdown};
pub use report::{AttemptRow, FilmFrame, ReportError, ReportInput, ReportSettings, TaskSection, Timing, report_html};
pub use rows::{EpisodeRow, Outcome, TaskRow};
pub use statistics::{
    PairedComparison, StatisticsError, StatisticsSettings, SuiteSummary, compare, failure_counts, spl, summarise,
};
pub use text_table::{MOST_ROWS, attention, text_table};

//! Results of the measurement of the studio.

use serde::Serialize;

use crate::quantile::Spread;

/// Cost and correctness of the studio's verdicts, edits and repairs.
#[derive(Debug, Default, Serialize)]
pub struct Measured {
    /// Seed of the random operations and faults.
    pub seed: u64,
    /// Number of random operations tried.
    pub operations: usize,
    /// Number of operations that were applied; the others were conflicts or invalid.
    pub applied: usize,
    /// Median CPU time from an edit to the quick verdict (wording, relations, goal and collision), ms.
    pub verdict_ms_p50: f64,
    /// 95th percentile of the CPU time of the quick verdict, ms.
    pub verdict_ms_p95: f64,
    /// 95th percentile of the CPU time from an edit to all stages, ms.
    pub all_checks_ms_p95: f64,
    /// 95th percentile of the CPU time of rendering one camera (512×288 pixels) after an edit, ms; `None` without
    /// cameras.
    pub preview_ms_p95: Option<f64>,
    /// Time to the page's first paint, ms; measured in a browser, always `None` here.
    pub first_paint_ms: Option<f64>,
    /// Time until robot and objects can be moved in the page, ms; measured in a browser, always `None` here.
    pub movable_ms: Option<f64>,
    /// Mean CPU time of an operation with its verdict, image and comparison, s: in the first and in the second half of
    /// the operations.
    pub operation_s: [f64; 2],
    /// Mean CPU time by stage of the verdict, ms.
    pub stage_ms: Vec<(&'static str, f64)>,
    /// Number of acknowledged edits that are missing after a simulated kill.
    pub lost: usize,
    /// Number of operations refused as conflicts.
    pub conflicts: usize,
    /// True if memory, disk and the reopened log always held the same bytes.
    pub equal_bytes: bool,
    /// Number of verdicts that differ from the layout audit or from the judge of an episode.
    pub verdict_mismatches: usize,
    /// Number of faults planted in sound scenarios.
    pub planted: usize,
    /// Number of planted faults that the verdict found, naming the right object.
    pub found: usize,
    /// Number of faults whose offered repairs, applied one after another, removed every blocking problem.
    pub repaired: usize,
    /// Number of repaired scenarios that the expert tried, once each.
    pub repaired_tried: usize,
    /// Number of these that the expert solved.
    pub repaired_solved: usize,
    /// Number of sound scenarios: those that the expert solved once.
    pub sound: usize,
    /// Number of sound scenarios with a blocking problem in the verdict.
    pub false_alarms: usize,
    /// Numbers of planted, found and repaired faults, by kind of fault.
    pub by_fault: Vec<(&'static str, [usize; 3])>,
    /// CPU time of finding and applying all repairs of a fault, s.
    pub repair_s: Spread,
    /// Details of mismatches, missed faults and false alarms, for people.
    pub notes: Vec<String>,
}

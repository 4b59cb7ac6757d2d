//! Results of the measurement of the studio.

use serde::Serialize;

use crate::quantile::Spread;

/// Results.
#[derive(Debug, Default, Serialize)]
pub struct Measured {
    /// Seed.
    pub seed: u64,
    /// Random operations given.
    pub operations: usize,
    /// Those applied.
    pub applied: usize,
    /// Median CPU time from an edit to wording, relations, goal and collision, ms.
    pub verdict_ms_p50: f64,
    /// 95th percentile of the same.
    pub verdict_ms_p95: f64,
    /// 95th percentile of the CPU time from an edit to all stages, ms.
    pub all_checks_ms_p95: f64,
    /// 95th percentile of the CPU time of a camera's image of 512×288 pixels after an edit, ms.
    pub preview_ms_p95: Option<f64>,
    /// First paint of the page; not measured here.
    pub first_paint_ms: Option<f64>,
    /// Robot and objects movable in the page; not measured here.
    pub movable_ms: Option<f64>,
    /// Mean CPU time by stage, ms.
    pub stage_ms: Vec<(&'static str, f64)>,
    /// Acknowledged edits that are missing after a kill.
    pub lost: usize,
    /// Operations answered as conflicts.
    pub conflicts: usize,
    /// True if memory, disk and a log that is read again always agree.
    pub equal_bytes: bool,
    /// Verdicts that differ from the audit of layouts or from the independent reader.
    pub verdict_mismatches: usize,
    /// Planted faults.
    pub planted: usize,
    /// Faults found, with the right object named.
    pub found: usize,
    /// Faults after whose repair, by offered repairs one after another, no blocking problem is left.
    pub repaired: usize,
    /// Repaired scenarios that the expert tried, once each.
    pub repaired_tried: usize,
    /// Those that it solved.
    pub repaired_solved: usize,
    /// Sound scenarios: the expert solved each once.
    pub sound: usize,
    /// Sound scenarios with a blocking problem.
    pub false_alarms: usize,
    /// Planted, found and repaired by kind of fault.
    pub by_fault: Vec<(&'static str, [usize; 3])>,
    /// Median and 95th percentile of the CPU time of repairing all that can be repaired, s.
    pub repair_s: Spread,
    /// Particulars of mismatches, missed faults and false alarms.
    pub notes: Vec<String>,
}

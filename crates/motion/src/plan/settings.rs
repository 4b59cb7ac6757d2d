//! Settings of planning.

use serde::{Deserialize, Serialize};

/// Settings of joint-space search and path smoothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanSettings {
    /// Clearance to everything that must not be touched (m).
    pub padding: f64,
    /// Clearance between links of the robot (m) after [`PlanSettings::link_padding_after`] iterations: some arms are
    /// built with gaps narrower than the padding.
    pub link_padding: f64,
    /// Number of iterations of the search with the whole padding between links of the robot.
    pub link_padding_after: usize,
    /// Allowed penetration at start and goal (m), since physical contacts penetrate slightly.
    pub contact_tolerance: f64,
    /// Maximum edge of the search tree (rad) (`rrt_range` of the paper's planner, which used 0.001).
    pub rrt_range: f64,
    /// Half of the samples are drawn from the bounding box of start and goals extended by this (rad), since most paths
    /// stay within it, and such paths are shorter.
    pub sample_around: f64,
    /// Maximum number of iterations of the search.
    pub max_iterations: usize,
    /// Maximum motion of any robot point between states checked during the search (m).
    pub search_spacing: f64,
    /// Maximum motion of any robot point between states checked in the returned path (m); up to twice the padding
    /// nothing can be touched in between.
    pub final_spacing: f64,
    /// Maximum number of repeated searches with denser checks after the final check finds a contact.
    pub retries: usize,
    /// Maximum number of random shortcuts.
    pub shortcuts: usize,
    /// Number of consecutive failed shortcuts after which shortening stops.
    pub shortcut_failures: usize,
    /// Maximum length of a corner's blend along either of its edges (rad).
    pub blend: f64,
    /// Maximum number of halvings of a blend before the robot has to stop at the corner.
    pub blend_halvings: usize,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            padding: 0.003,
            link_padding: 0.0001,
            link_padding_after: 5_000,
            contact_tolerance: 0.001,
            rrt_range: 0.7,
            max_iterations: 50_000,
            sample_around: 1.0,
            search_spacing: 0.05,
            final_spacing: 0.006,
            retries: 3,
            shortcuts: 30,
            shortcut_failures: 10,
            blend: 0.4,
            blend_halvings: 5,
        }
    }
}

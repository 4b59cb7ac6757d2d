//! Settings of the layout with their defaults.

use genmanip_core::Workspace;
use genmanip_motion::FeasibilitySettings;
use serde::{Deserialize, Serialize};

use crate::articulation::JointSettings;

/// Search limits and acceptance criteria of layouts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayoutSettings {
    /// Maximum number of attempts at a layout, complete or not, before the task is rejected.
    pub max_restarts: usize,
    /// Maximum number of complete layouts that fail validation before the task is rejected.
    pub max_unaccepted: usize,
    /// Number of candidate poses per object and layout.
    pub candidates_per_object: usize,
    /// Maximum number of backtracking steps per layout.
    pub max_retreats: usize,
    /// Minimum gap between footprints on the table (m); space for a finger.
    pub min_gap_m: f64,
    /// Minimum gap between footprints on or in a carrier (m).
    pub min_gap_on_carrier_m: f64,
    /// Number of distractors on the table.
    pub distractors: usize,
    /// Minimum gap between a distractor and other objects (m); `min_gap_m` if there is too little space.
    pub distractor_gap_m: f64,
    /// Margin of relations at placement (m), and its equivalent in other units (see
    /// [`genmanip_core::Unit::normalise`]); settling may reduce it.
    pub relation_margin_m: f64,
    /// Object area within the workspace, for robots with the reach of the default one: minimum and maximum x from the
    /// robot's base (m).
    pub x_m: [f64; 2],
    /// Object area within the workspace: minimum and maximum y (m).
    pub y_m: [f64; 2],
    /// Larger object area, used if a layout needs more space: minimum and maximum x (m).
    pub wide_x_m: [f64; 2],
    /// Larger object area: minimum and maximum y (m).
    pub wide_y_m: [f64; 2],
    /// Graspability criteria of objects to be moved.
    pub grasp: FeasibilitySettings,
    /// Search for goal poses when checking that the goal is feasible.
    pub goal_pose: GoalPoseSettings,
    /// Criteria for joints to be movable by the arm.
    pub joint: JointSettings,
    /// Gap between an object and its support when settling starts (m).
    pub drop_m: f64,
    /// Maximum settling time [s, simulated].
    pub settle_s: f64,
    /// Maximum displacement while settling (m).
    pub max_settle_shift_m: f64,
    /// Maximum rotation while settling (rad).
    pub max_settle_tilt_rad: f64,
    /// Duration of the stability check [s, simulated]; shorter if nothing accelerates and everything is nearly still.
    pub stay_s: f64,
    /// Maximum displacement during the stability check (m).
    pub max_drift_m: f64,
    /// Maximum penetration after settling (m).
    pub max_penetration_m: f64,
    /// Minimum number of pixels of each task object in at least one camera.
    pub min_pixels: usize,
    /// Minimum visible share of each task object in that camera.
    pub min_visible_share: f64,
}

impl LayoutSettings {
    /// Object area on the table, the larger one if `wide`, for a robot with a reach scale
    /// ([`genmanip_core::RobotModel::reach_scale`]).
    pub(crate) fn area(&self, workspace: &Workspace, reach_scale: f64, wide: bool) -> Workspace {
        let (x, y) = if wide { (self.wide_x_m, self.wide_y_m) } else { (self.x_m, self.y_m) };
        workspace.within(x.map(|metres| metres * reach_scale), y.map(|metres| metres * reach_scale))
    }
}

impl Default for LayoutSettings {
    fn default() -> Self {
        Self {
            // Search limits. Chosen: a rejection takes seconds, not minutes.
            max_restarts: 60,
            max_unaccepted: 30,
            candidates_per_object: 60,
            max_retreats: 30,
            // Chosen: space for a finger of the Panda.
            min_gap_m: 0.03,
            // Chosen: carriers are small, and grippers approach from above.
            min_gap_on_carrier_m: 0.01,
            distractors: 0,
            // Chosen: twice the gap of other objects, so that a distractor is rarely in the way.
            distractor_gap_m: 0.06,
            // Chosen: settling moves objects by a few millimetres.
            relation_margin_m: 0.01,
            // Chosen: well inside the workspace and in the middle of the camera images.
            x_m: [0.26, 0.78],
            y_m: [-0.42, 0.42],
            // Chosen: the workspace minus 2 cm.
            wide_x_m: [0.22, 0.88],
            wide_y_m: [-0.48, 0.48],
            // The layout only checks that a grasp exists; the expert plans its motions.
            grasp: FeasibilitySettings::reach_only(),
            // Chosen: one goal pose suffices, and if 250 samples find none there is hardly any.
            goal_pose: GoalPoseSettings { count: 1, draws: 250, ..GoalPoseSettings::default() },
            joint: JointSettings::default(),
            // Chosen: objects dropped from higher may roll; lower ones may start in penetration.
            drop_m: 0.002,
            // Chosen: as in `SettleSettings`; objects that roll longer are not at rest for a task either.
            settle_s: 2.0,
            // Chosen: larger displacements change relations.
            max_settle_shift_m: 0.03,
            // Chosen: 34 degrees; fruit may roll into a bowl's middle, bottles must not topple.
            max_settle_tilt_rad: 0.6,
            // Chosen: objects balanced on their edge fall within it, see the tests of `audit`.
            stay_s: 2.0,
            // Chosen: half of the millimetre that `lab layout` accepts.
            max_drift_m: 0.0005,
            // Chosen: more than the penetration of soft contacts at rest.
            max_penetration_m: 0.001,
            // Chosen: a patch of 10x10 pixels can still be pointed at by a prompt-based system.
            min_pixels: 100,
            // Chosen: objects with less than a third visible are hard to name.
            min_visible_share: 0.3,
        }
    }
}

/// Settings of the search for goal poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GoalPoseSettings {
    /// Maximum number of goal poses found.
    pub count: usize,
    /// Maximum number of sampled poses.
    pub draws: usize,
    /// Margin of directional relations (m); for `between` the equivalent angle, see [`genmanip_core::Unit::normalise`].
    pub margin_m: f64,
    /// Planar clearance around the object (m).
    pub clearance_m: f64,
}

impl Default for GoalPoseSettings {
    fn default() -> Self {
        Self {
            // Chosen: planning a pick tests pairs of grasp and goal pose, so its time grows with this number.
            count: 10,
            // Search limit, chosen.
            draws: 600,
            // Chosen: release and settling move objects by a few millimetres.
            margin_m: 0.012,
            // Chosen: space for a finger beside the object, less than the gap of a layout.
            clearance_m: 0.015,
        }
    }
}

//! Every default of the layout on one screen.

use genmanip_motion::FeasibilitySettings;
use serde::{Deserialize, Serialize};

use crate::articulation::JointSettings;

/// How layouts are searched and what they must satisfy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayoutSettings {
    /// Whole layouts tried before the task is refused.
    pub max_restarts: usize,
    /// Layouts that were placed but not accepted, before the task is refused.
    pub max_unaccepted: usize,
    /// Candidate poses per object within one layout.
    pub candidates_per_object: usize,
    /// Times an object that found no place sends the search back to one that stood in its way, within one layout.
    pub max_retreats: usize,
    /// Smallest gap between the footprints of objects on the table, metres; room for a finger.
    pub min_gap_m: f64,
    /// The same for objects that something else carries or holds, metres.
    pub min_gap_on_carrier_m: f64,
    /// Objects that the task does not mention, put on the table beside it.
    pub distractors: usize,
    /// Smallest gap between a distractor and anything else, metres; where that leaves no room, `min_gap_m`.
    pub distractor_gap_m: f64,
    /// How far inside its threshold a relation must hold when an object is placed, metres, and what weighs the same in
    /// other units (see [`genmanip_core::Unit::normalise`]); settling may eat some of it.
    pub relation_margin_m: f64,
    /// Area for objects within the world's workspace, metres from the robot's base: nearest and farthest x.
    pub x_m: [f64; 2],
    /// Area for objects: rightmost and leftmost y, metres.
    pub y_m: [f64; 2],
    /// The same where a layout needs more room, metres; as much of the table as the cameras see well.
    pub wide_x_m: [f64; 2],
    /// Rightmost and leftmost y where a layout needs more room, metres.
    pub wide_y_m: [f64; 2],
    /// When an object that is to be moved counts as graspable where it lies.
    pub grasp: FeasibilitySettings,
    /// How room at the goal is sought.
    pub goal_pose: GoalPoseSettings,
    /// How a joint must be moved to count as movable by the arm.
    pub joint: JointSettings,
    /// Height from which supported objects are let down, metres.
    pub drop_m: f64,
    /// Longest settling, simulated seconds.
    pub settle_s: f64,
    /// Largest displacement of an object while settling, metres.
    pub max_settle_shift_m: f64,
    /// Largest tilt of an object while settling, radians.
    pub max_settle_tilt_rad: f64,
    /// How long a settled layout is left alone, simulated seconds; less where nothing gets faster and all is nearly still.
    pub stay_s: f64,
    /// Farthest that an object may move in this time, metres.
    pub max_drift_m: f64,
    /// Deepest penetration accepted after settling, metres.
    pub max_penetration_m: f64,
    /// Fewest pixels of each task object in at least one camera.
    pub min_pixels: usize,
    /// Smallest visible share of each task object in that camera.
    pub min_visible_share: f64,
}

impl Default for LayoutSettings {
    fn default() -> Self {
        Self {
            // Bounds of the search, chosen: a refusal takes seconds, not minutes.
            max_restarts: 60,
            max_unaccepted: 30,
            candidates_per_object: 60,
            max_retreats: 30,
            // Chosen: room for a finger of the Panda.
            min_gap_m: 0.03,
            // Chosen: carriers are small, and hands come from above there.
            min_gap_on_carrier_m: 0.01,
            distractors: 0,
            // Chosen: twice the gap of others, so that a distractor is never in the way.
            distractor_gap_m: 0.06,
            // Chosen: settling moves things by a few millimetres.
            relation_margin_m: 0.01,
            // Chosen: well inside the workspace and in the middle of the cameras' pictures.
            x_m: [0.26, 0.78],
            y_m: [-0.42, 0.42],
            // Chosen: the workspace less 2 cm.
            wide_x_m: [0.22, 0.88],
            wide_y_m: [-0.48, 0.48],
            // Layout only asks whether there is a grasp; the expert plans its motions.
            grasp: FeasibilitySettings::reach_only(),
            // Chosen: one place suffices, and where 250 draws find none there is hardly any.
            goal_pose: GoalPoseSettings { count: 1, draws: 250, ..GoalPoseSettings::default() },
            joint: JointSettings::default(),
            // Chosen: what falls farther may roll; what starts nearer may start inside.
            drop_m: 0.002,
            // Chosen: as in `SettleSettings`; what rolls longer is not at rest for a task either.
            settle_s: 2.0,
            // Chosen: more than this and a relation would be another one.
            max_settle_shift_m: 0.03,
            // Chosen: 34 degrees; fruit may roll into a bowl's middle, bottles must not fall.
            max_settle_tilt_rad: 0.6,
            // Chosen: things balanced on their edge fall within it, see the tests of `audit`.
            stay_s: 2.0,
            // Chosen: half of the millimetre that `lab layout` accepts of a returned layout.
            max_drift_m: 0.0005,
            // Chosen: soft contacts of things at rest sink in by less.
            max_penetration_m: 0.001,
            // Chosen: a patch of ten by ten pixels can still be pointed at by a prompt-based system.
            min_pixels: 100,
            // Chosen: with less than a third in view a thing is hard to name.
            min_visible_share: 0.3,
        }
    }
}

/// How goal poses are searched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GoalPoseSettings {
    /// Goal poses kept.
    pub count: usize,
    /// Goal poses drawn at most.
    pub draws: usize,
    /// How far inside its threshold a direction must hold, metres; for `between` as many radians as weigh the same,
    /// see [`genmanip_core::Unit::normalise`].
    pub margin_m: f64,
    /// Free space around the object in the plane, metres.
    pub clearance_m: f64,
}

impl Default for GoalPoseSettings {
    fn default() -> Self {
        Self {
            // Chosen: a pick looks at every grasp with each of them.
            count: 10,
            // A bound of the search, chosen.
            draws: 600,
            // Chosen: letting go and settling move things by a few millimetres.
            margin_m: 0.012,
            // Chosen: room for a finger beside the object, less than a layout keeps.
            clearance_m: 0.015,
        }
    }
}

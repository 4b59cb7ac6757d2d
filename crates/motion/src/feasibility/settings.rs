//! Every default of the feasibility query on one screen.
//!
//! "Chosen" means: by hand, tried on demonstrations of the example tasks and kept when failures became fewer, not fitted.

use serde::{Deserialize, Serialize};

/// What a grasp must satisfy to count as feasible.
///
/// The default is what a grasp needs to be carried out; [`FeasibilitySettings::reach_only`] only asks whether the arm
/// gets there.
/// In files every field is said, since it would be unclear which of the two fills in what is missing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeasibilitySettings {
    /// Feasible grasps after which the search ends.
    pub wanted: usize,
    /// Arm configurations tried per grasp, those nearest to where the arm is first.
    pub configurations: usize,
    /// Free configurations of one grasp that are returned, each as a feasible grasp of its own.
    pub configurations_kept: usize,
    /// What becomes of the same grasp with the hand turned by half a circle.
    pub half_turn: HalfTurn,
    /// Distance of the robot from everything but the object, at the grasp and where it lets go, m.
    pub clearance_m: f64,
    /// Distance of the robot from the object before the fingers close, m; `None` lets the gripper touch the object, for
    /// grasps whose room beside the object is known, and arm links then keep `clearance_m` from it.
    pub object_clearance_m: Option<f64>,
    /// Opening beyond the width of the grasp, both sides together, m, used where there is room for it; elsewhere, and
    /// when it is `None`, the opening with which the grasp was proposed.
    pub finger_room_m: Option<f64>,
    /// Length of the straight approach and of the straight retreat, m.
    pub approach_m: f64,
    /// Whether the start of the approach is tested with the grasp; the line between them is tested when it is asked for.
    pub tests_pregrasp: bool,
    /// Height by which the object is lifted straight up, and from which it is at least lowered, m.
    pub lift_m: f64,
    /// Heights above a goal pose at which the object may be let go of, m, lowest first.
    pub release_heights_m: Vec<f64>,
    /// Arm configurations tried per goal pose and height.
    pub goal_configurations: usize,
}

/// What becomes of the same grasp with the hand turned by half a circle about its approach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HalfTurn {
    /// It is tried after the grasp, as a grasp of its own.
    Both,
    /// Of the two, the one whose configuration is nearer to where the arm is.
    Nearer,
}

impl Default for FeasibilitySettings {
    fn default() -> Self {
        Self {
            // Chosen: both ways of the hand for six grasps; free motions seldom fail for all of them.
            wanted: 12,
            // All that `IkSettings::max_solutions` keeps.
            configurations: 48,
            configurations_kept: 1,
            half_turn: HalfTurn::Both,
            // The padding of free motions (`PlanSettings::padding`), so that they may start and end here.
            clearance_m: 0.003,
            // Chosen, on rings and handles: with none, open fingers landed on them; much more would refuse them.
            object_clearance_m: Some(0.0005),
            // Chosen: 12 mm a side, 2 mm more than `GraspSettings::opening_clearance`.
            finger_room_m: Some(0.024),
            // Twice the 4.5 cm by which the Panda's fingers reach beyond its palm: they start outside what they hold.
            approach_m: 0.09,
            tests_pregrasp: false,
            // Chosen: most neighbours are cleared, and most lifts still within reach.
            lift_m: 0.10,
            // Chosen: from the padding of free motions to what gets the hand out of the catalogue's deep hollows;
            // the lowest that works is taken, since what falls far tips over.
            release_heights_m: vec![0.003, 0.015, 0.03, 0.05, 0.08, 0.12],
            // Chosen: the nearest ones, for time's sake.
            goal_configurations: 4,
        }
    }
}

impl FeasibilitySettings {
    /// Whether the arm gets to grasp and pre-grasp at all: for those who only ask, and plan nothing.
    ///
    /// It ends with the first grasp, since one is enough to say yes.
    #[must_use]
    pub fn reach_only() -> Self {
        Self {
            wanted: 1,
            // Chosen: the nearest ones, for time's sake; a grasp that needs others is rarely the only one.
            configurations: 6,
            // Chosen below what motions keep: the expert makes do with as much for flat things.
            clearance_m: 0.001,
            object_clearance_m: None,
            finger_room_m: None,
            // Chosen: a little less than motions need, so that this test does not refuse what they can do.
            approach_m: 0.08,
            tests_pregrasp: true,
            ..Self::default()
        }
    }
}

//! Every default of the feasibility query on one screen.

use serde::{Deserialize, Serialize};

/// What a grasp must satisfy to count as feasible.
///
/// The default is what a grasp needs to be carried out; [`FeasibilitySettings::reach_only`] only asks whether the arm
/// gets there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
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
            // Free motions fail for one grasp in several at most; a dozen covers both sides of six grasps.
            wanted: 12,
            // All that `IkSettings::max_solutions` keeps.
            configurations: 48,
            configurations_kept: 1,
            half_turn: HalfTurn::Both,
            // The padding of free motions (`PlanSettings::padding`), so that they may start and end here.
            clearance_m: 0.003,
            // Fingers that come down on a rim otherwise stand on it; more would refuse rings and handles.
            object_clearance_m: Some(0.0005),
            // 12 mm a side: 2 mm more than grasps are proposed with, for the arm's lag while it comes in.
            finger_room_m: Some(0.024),
            // Fingers reach about 5 cm beyond the palm; from 9 cm they clear what they will hold.
            approach_m: 0.09,
            tests_pregrasp: false,
            // Clears most neighbours of the catalogue, which are up to 10 cm high where things stand close.
            lift_m: 0.10,
            // From the gap that settling closes without a bounce to the depth of the deepest hollow the hand must stay
            // above; tuned on demonstrations: the higher, the more things tip over.
            release_heights_m: vec![0.003, 0.015, 0.03, 0.05, 0.08, 0.12],
            // The nearest ones: others turn the wrist far round while the object is carried.
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
            // The nearest ones; a grasp that needs others is rarely the only one, and each costs a collision test.
            configurations: 6,
            // What physics leaves between things that stand beside each other and do not touch.
            clearance_m: 0.001,
            object_clearance_m: None,
            finger_room_m: None,
            // A little less than motions need, so that this test does not refuse what they can do.
            approach_m: 0.08,
            tests_pregrasp: true,
            ..Self::default()
        }
    }
}

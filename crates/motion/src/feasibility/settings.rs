//! Settings of the feasibility query with their defaults.
//!
//! "Chosen" marks values tuned by hand on demonstrations of the example tasks and kept if failures decreased; not
//! fitted.

use genmanip_core::RobotModel;
use serde::{Deserialize, Serialize};

/// Feasibility criteria of grasps.
///
/// The default requires a fully executable grasp; [`FeasibilitySettings::reach_only`] only checks reachability.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeasibilitySettings {
    /// Number of feasible grasps after which the search ends.
    pub wanted: usize,
    /// Maximum number of arm configurations tried per grasp, nearest to the current one first.
    pub configurations: usize,
    /// Maximum number of collision-free configurations returned per grasp, each as a separate feasible grasp.
    pub configurations_kept: usize,
    /// Treatment of the same grasp rotated by half a turn.
    pub half_turn: HalfTurn,
    /// Clearance of the robot to everything but the object, at grasp and release (m).
    pub clearance_m: f64,
    /// Clearance of the robot to the object before the gripper closes (m); `None` lets the gripper touch the object,
    /// for grasps with known finger clearance, and arm links then keep `clearance_m` to it.
    pub object_clearance_m: Option<f64>,
    /// Additional opening beyond the grasp width, both sides together (m), if there is space; otherwise, and if `None`,
    /// the opening proposed with the grasp.
    pub finger_room_m: Option<f64>,
    /// Length of the straight approach and retreat (m), for robots with the reach of the default one.
    pub approach_m: f64,
    /// True to check the pre-grasp together with the grasp; the line between them is checked when the motion is
    /// planned.
    pub tests_pregrasp: bool,
    /// Lift height, and minimum height from which the object is lowered (m), for robots with the reach of the default
    /// one.
    pub lift_m: f64,
    /// Release heights above a goal pose to try (m), lowest first.
    pub release_heights_m: Vec<f64>,
    /// Maximum number of arm configurations tried per goal pose and height.
    pub goal_configurations: usize,
}

/// Treatment of the same grasp rotated by half a turn about its approach direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HalfTurn {
    /// Try it after the grasp as a separate grasp.
    Both,
    /// Do not try it.
    Neither,
    /// Use only the one of the two whose arm configuration is nearer to the current one.
    Nearer,
}

impl Default for FeasibilitySettings {
    fn default() -> Self {
        Self {
            // Chosen: six grasps in both orientations; free motions rarely fail for all of them.
            wanted: 12,
            // All that `IkSettings::max_solutions` keeps.
            configurations: 48,
            configurations_kept: 1,
            half_turn: HalfTurn::Both,
            // The padding of free motions (`PlanSettings::padding`), so that they may start and end here.
            clearance_m: 0.003,
            // Chosen on rings and handles: without clearance, open fingers landed on them; much more would reject them.
            object_clearance_m: Some(0.0005),
            // Chosen: 12 mm a side, 2 mm more than `GraspSettings::opening_clearance`.
            finger_room_m: Some(0.024),
            // Twice the 4.5 cm by which the Panda's fingers extend beyond its palm, so that they start outside the
            // object.
            approach_m: 0.09,
            tests_pregrasp: false,
            // Chosen: clears most neighbours, and most lifts are still reachable.
            lift_m: 0.10,
            // Chosen: from the padding of free motions to a height that clears the catalogue's deepest cavities; the
            // lowest feasible one is used, since objects dropped from high topple.
            release_heights_m: vec![0.003, 0.015, 0.03, 0.05, 0.08, 0.12],
            // Chosen: only the nearest ones, for speed.
            goal_configurations: 4,
        }
    }
}

impl FeasibilitySettings {
    /// Length of the straight approach and retreat (m) of a robot. A short arm points down only at small heights, so
    /// straight lines are scaled to its reach.
    pub fn approach_for_m(&self, robot: &RobotModel) -> f64 {
        self.approach_m * robot.reach_scale()
    }

    /// Lift height (m) of a robot, scaled in the same way.
    pub fn lift_for_m(&self, robot: &RobotModel) -> f64 {
        self.lift_m * robot.reach_scale()
    }

    /// Settings that only check reachability of grasp and pre-grasp.
    ///
    /// The search ends with the first grasp.
    #[must_use]
    pub fn reach_only() -> Self {
        Self {
            wanted: 1,
            // Chosen: only the nearest ones, for speed; a grasp that needs others is rarely the only one.
            configurations: 6,
            // Chosen smaller than the clearance of motions: the expert accepts as much for flat objects.
            clearance_m: 0.001,
            object_clearance_m: None,
            finger_room_m: None,
            // Chosen: slightly less than motions need, so that this check does not reject feasible ones.
            approach_m: 0.08,
            tests_pregrasp: true,
            ..Self::default()
        }
    }
}

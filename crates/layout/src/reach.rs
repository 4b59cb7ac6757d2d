//! Whether the arm gets to what the goal moves.

use std::f64::consts::{FRAC_PI_4, PI};

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, Task};
use genmanip_motion::Planner;
use genmanip_scene::relations::PosedScene;

/// How far above an object the hand must get too, metres.
const ABOVE_M: f64 = 0.12;

/// The reason when some object that the goal moves cannot be reached from above.
pub(crate) fn unreachable(task: &Task, scene: &PosedScene, planner: &Planner) -> Option<String> {
    let home = &planner.robot().home;
    let reaches = |point: DVec3| {
        (0..4).any(|turn| !planner.ik(&pointing_down(point, f64::from(turn) * FRAC_PI_4), home).is_empty())
    };
    scene.objects().enumerate().find_map(|(index, object)| {
        let is_moved = task.goal.alternatives.iter().flatten().any(|atom| atom.subject() == object.uid);
        let bounds = scene.bounds(index)?;
        let top = bounds.center().with_z(bounds.max.z.max(0.02));
        (is_moved && !object.model.card.is_articulated && !(reaches(top) && reaches(top + DVec3::Z * ABOVE_M)))
            .then(|| format!("{} cannot be reached", object.model.card.name))
    })
}

/// A tool pose that looks straight down.
fn pointing_down(position: DVec3, yaw: f64) -> Pose {
    Pose::from_position_yaw(position, yaw) * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(PI) }
}

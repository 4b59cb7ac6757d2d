//! Whether the arm gets to what the goal moves.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Pose, RobotModel, Task};
use genmanip_motion::Planner;
use genmanip_scene::relations::PosedScene;

use crate::LayoutSettings;

/// The reason when some object that the goal moves, or the place it is moved to, cannot be reached from above.
pub(crate) fn unreachable(
    task: &Task,
    scene: &PosedScene,
    robot: &Arc<RobotModel>,
    _settings: &LayoutSettings,
) -> Option<String> {
    let planner = Planner::new(Arc::clone(robot));
    let reaches = |point: DVec3| {
        (0..4).any(|quarter| {
            let yaw = f64::from(quarter) * std::f64::consts::FRAC_PI_4;
            !planner.ik(&pointing_down(point, yaw), &robot.home).is_empty()
        })
    };
    scene.objects().iter().find_map(|object| {
        let moved = task.goal.alternatives.iter().flatten().any(|atom| atom.subject() == object.uid());
        let bounds = object.bounds();
        let top = bounds.center().with_z(bounds.max.z.max(0.02));
        (moved && !object.model.card.is_articulated && !(reaches(top) && reaches(top + DVec3::Z * 0.12)))
            .then(|| format!("{} cannot be reached", object.model.card.name))
    })
}

/// A tool pose that looks straight down.
fn pointing_down(position: DVec3, yaw: f64) -> Pose {
    Pose::from_position_yaw(position, yaw)
        * Pose { position: DVec3::ZERO, rotation: genmanip_core::glam::DQuat::from_rotation_x(std::f64::consts::PI) }
}

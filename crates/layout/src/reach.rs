//! Whether the arm can do what the goal asks: take each object as it lies, and let go of it where it belongs.

use std::f64::consts::{FRAC_PI_4, PI};

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, Pose, Seed, Task, Workspace};
use genmanip_motion::{Allowed, Planner, Surroundings};
use genmanip_scene::relations::{PosedScene, RelationSettings};

use crate::articulation::{JointSettings, Sweeper, joint_changes};
use crate::goal_pose::{GoalPoseSettings, goal_poses};
use crate::moves::{Move, moves, references};
use crate::surroundings;

/// The reason when no alternative of the goal can be served.
pub(crate) fn unreachable(
    task: &Task,
    scene: &PosedScene,
    planner: &Planner,
    relations: &RelationSettings,
    seed: Seed,
) -> Option<String> {
    let mut reason = None;
    for alternative in moves(&task.goal, scene) {
        match alternative.iter().find_map(|step| obstacle(step, &alternative, scene, planner, relations, seed)) {
            None => return None,
            Some(obstacle) => reason = Some(obstacle),
        }
    }
    reason
}

/// What stands in the way of one move.
fn obstacle(
    step: &Move,
    alternative: &[Move],
    scene: &PosedScene,
    planner: &Planner,
    relations: &RelationSettings,
    seed: Seed,
) -> Option<String> {
    let object = scene.objects().nth(step.object)?;
    let name = &object.model.card.name;
    if let Some(state) = step.state() {
        let blocked = !can_turn(step.object, state, scene, planner);
        return blocked.then(|| format!("no way for the arm to bring {name} into the state {state}"));
    }
    let world = surroundings::world(scene, None);
    let nothing = Allowed::none();
    let around = Surroundings { world: &world, attached: None, allowed: &nothing, gripper_width: 0.0 };
    let home = &planner.robot().home;
    let within_reach = |candidates: &[Grasp]| {
        !planner.reachable_grasps(&around, &object.uid, &object.pose, candidates, home, 1).is_empty()
    };
    if !within_reach(&surroundings::tried_grasps(planner, scene, step.object))
        && !within_reach(&surroundings::generated_grasps(planner, scene, step.object, seed.fork("reach")))
    {
        return Some(format!("{name} cannot be grasped where it lies"));
    }
    // A place beside something that moves first is only known later.
    let waits = step.atoms.iter().flat_map(references).any(|uid| {
        alternative.iter().any(|other| other.object != step.object && scene.index_of(uid) == Some(other.object))
    });
    let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
    let usable = |goal: &Pose| is_in_reach(planner, goal.position + DVec3::Z * height);
    let settings = GoalPoseSettings { count: 1, draws: 250, ..GoalPoseSettings::default() };
    let places = goal_poses(
        scene,
        step,
        object.pose.rotation,
        &Workspace::default(),
        relations,
        &settings,
        &usable,
        seed.fork("room"),
    );
    (!waits && places.is_empty()).then(|| format!("no room for {name} where the goal wants it"))
}

/// Whether the arm can move every joint that a state wants moved, one after the other.
fn can_turn(object: usize, state: &str, scene: &PosedScene, planner: &Planner) -> bool {
    let settings = JointSettings::default();
    let mut scene = scene.clone();
    joint_changes(&scene, object, state).into_iter().all(|change| {
        let sweeper = Sweeper::new(&scene, &change, planner, &settings);
        let possible = sweeper.is_some_and(|s| s.search(&planner.robot().home, &mut |_| Some(())).is_ok());
        let moved = scene.objects().nth(object).map(|posed| (posed.pose, posed.joint_positions.clone()));
        if let Some((pose, mut joints)) = moved {
            joints[change.joint] = change.targets[0];
            scene.set_pose(object, pose, &joints);
        }
        possible
    })
}

/// Whether the hand, pointing straight down, gets to a point.
pub fn is_in_reach(planner: &Planner, point: DVec3) -> bool {
    let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(PI) };
    (0..4).any(|turn| {
        let world_from_tcp = Pose::from_position_yaw(point, f64::from(turn) * FRAC_PI_4) * down;
        !planner.ik(&world_from_tcp, &planner.robot().home).is_empty()
    })
}

//! Whether the arm can do what the goal asks: take each object as it lies, and let go of it where it belongs.

use std::f64::consts::{FRAC_PI_4, PI};

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, Pose, Seed, Task, TriedGrasp, Workspace};
use genmanip_motion::{Allowed, Planner, PlanningScene};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings};

use crate::articulation::{JointSettings, Sweeper, joint_changes};
use crate::goal_pose::{GoalPoseSettings, GoalSearch};
use crate::moves::{Move, moves};
use crate::rejection::{NamedObject, Rejection};
use crate::surroundings;

/// The reason when no alternative of the goal can be served; `tried` are the known grasps of each object.
pub(crate) fn unreachable(
    task: &Task,
    scene: &PosedScene,
    planner: &Planner,
    relations: &RelationSettings,
    tried: &[&[TriedGrasp]],
    seed: Seed,
) -> Option<Rejection> {
    let mut reason = None;
    for alternative in moves(&task.goal, scene) {
        match obstacle(&alternative, scene, planner, relations, tried, seed) {
            None => return None,
            Some(obstacle) => reason = Some(obstacle),
        }
    }
    reason
}

/// What stands in the way of moves that are made one after the other.
fn obstacle(
    steps: &[Move],
    scene: &PosedScene,
    planner: &Planner,
    relations: &RelationSettings,
    tried: &[&[TriedGrasp]],
    seed: Seed,
) -> Option<Rejection> {
    let world = surroundings::world(scene, None);
    let nothing = Allowed::none();
    let around = PlanningScene { world: &world, attached: None, allowed: &nothing, gripper_width: 0.0 };
    let home = &planner.robot().home;
    let within_reach = |object: &PosedObject, candidates: &[Grasp]| {
        !planner.reachable_grasps(&around, &object.id, &object.pose, candidates, home, 1).is_empty()
    };
    let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
    let settings = GoalPoseSettings { count: 1, draws: 250, ..GoalPoseSettings::default() };
    let mut after = scene.clone();
    steps.iter().enumerate().find_map(|(index, step)| {
        let object = scene.objects().nth(step.object)?;
        let named = || NamedObject::of(object);
        if let Some(state) = step.state() {
            let Some(joints) = turned(step.object, state, scene, planner) else {
                return Some(Rejection::NoWayToState { object: named(), state: state.into() });
            };
            after.set_pose(step.object, object.pose, &joints);
            return None;
        }
        let generated = || surroundings::generated_grasps(planner, scene, step.object, seed.fork("reach"));
        let can_be_grasped = surroundings::tried_grasps(
            planner,
            scene,
            step.object,
            tried.get(step.object).copied().unwrap_or_default(),
        )
        .and_then(|tried| Ok(within_reach(object, &tried) || within_reach(object, &generated()?)));
        match can_be_grasped {
            Ok(true) => {}
            Ok(false) => return Some(Rejection::NoGrasp(named())),
            Err(error) => {
                return Some(Rejection::NoGraspGeometry { object: named(), reason: error.to_string() });
            }
        }
        let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
        let usable = |goal: &Pose| is_in_reach(planner, goal.position + DVec3::Z * height);
        let search = GoalSearch {
            scene: &after,
            upright: &upright,
            workspace: &Workspace::default(),
            relations,
            settings: &settings,
        };
        let places = search.places(step, &steps[index + 1..], &usable, seed.fork("room"));
        let Some(place) = places.first() else { return Some(Rejection::NoRoomAtGoal(named())) };
        after.set_pose(step.object, place.world_from_object, &object.joint_positions);
        None
    })
}

/// Joint positions of an object in a state; `None` when the arm cannot move every joint there, one after the other.
fn turned(object: usize, state: &str, scene: &PosedScene, planner: &Planner) -> Option<Vec<f64>> {
    let settings = JointSettings::default();
    let mut scene = scene.clone();
    for change in joint_changes(&scene, object, state) {
        let sweeper = Sweeper::new(&scene, &change, planner, &settings)?;
        sweeper.search(&planner.robot().home, &mut |_| Some(())).ok()?;
        let posed = scene.objects().nth(object)?;
        let (pose, mut joints) = (posed.pose, posed.joint_positions.clone());
        joints[change.joint] = change.targets[0];
        scene.set_pose(object, pose, &joints);
    }
    scene.objects().nth(object).map(|posed| posed.joint_positions.clone())
}

/// Whether the hand, pointing straight down, gets to a point.
pub fn is_in_reach(planner: &Planner, point: DVec3) -> bool {
    let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(PI) };
    (0..4).any(|turn| {
        let world_from_tcp = Pose::from_position_yaw(point, f64::from(turn) * FRAC_PI_4) * down;
        planner.ik_each(&world_from_tcp, &planner.robot().home).next().is_some()
    })
}

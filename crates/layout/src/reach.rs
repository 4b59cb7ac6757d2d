//! Whether the arm can do what the goal asks: take each object as it lies, and let go of it where it belongs.

use genmanip_core::glam::DVec3;
use genmanip_core::{Grasp, Pose, Seed, Task, Workspace};
use genmanip_motion::{CollisionWorld, FeasibilitySettings, PickQuery, PickedObject, Planner};
use genmanip_scene::relations::{PosedObject, PosedScene, RelationSettings};

use crate::articulation::{JointSettings, Sweeper, joint_changes};
use crate::goal_pose::{GoalPoseSettings, GoalSearch};
use crate::moves::{Move, moves};
use crate::rejection::{NamedObject, Rejection};
use crate::surroundings;

/// The reason when no alternative of the goal can be served.
pub(crate) fn unreachable(
    task: &Task,
    scene: &PosedScene,
    planner: &Planner,
    relations: &RelationSettings,
    feasibility: &FeasibilitySettings,
    seed: Seed,
) -> Option<Rejection> {
    let mut reason = None;
    for alternative in moves(&task.goal, scene) {
        match obstacle(&alternative, scene, planner, relations, feasibility, seed) {
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
    feasibility: &FeasibilitySettings,
    seed: Seed,
) -> Option<Rejection> {
    let world = surroundings::world(scene, None);
    let within_reach =
        |object: &PosedObject, candidates: Vec<Grasp>| is_graspable(object, candidates, planner, &world, feasibility);
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
        let can_be_grasped = surroundings::tried_grasps(planner, scene, step.object)
            .and_then(|tried| Ok(within_reach(object, tried) || within_reach(object, generated()?)));
        match can_be_grasped {
            Ok(true) => {}
            Ok(false) => return Some(Rejection::NoGrasp(named())),
            Err(error) => {
                return Some(Rejection::NoGraspGeometry { object: named(), reason: error.to_string() });
            }
        }
        let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
        let usable = |goal: &Pose| planner.reaches_from_above(goal.position + DVec3::Z * height);
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

/// Whether the arm can carry any of the candidates out, from its home.
fn is_graspable(
    object: &PosedObject,
    candidates: Vec<Grasp>,
    planner: &Planner,
    world: &CollisionWorld,
    settings: &FeasibilitySettings,
) -> bool {
    let pieces = object.model.pieces(&object.joint_positions);
    let query = PickQuery {
        planner,
        world,
        object: PickedObject { name: &object.id, world_from_object: object.pose, pieces: &pieces },
        goals: &[],
        arm: &planner.robot().home,
        settings,
    };
    query.grasps(candidates.into_iter()).next().is_some()
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

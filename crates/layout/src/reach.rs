//! Whether the arm can do what the goal asks: take each object as it lies, and let go of it where it belongs.

use std::collections::BTreeMap;

use genmanip_core::glam::DVec3;
use genmanip_core::{Goal, Grasp, Pose, Seed, TriedGrasp, World};
use genmanip_motion::{CollisionWorld, GeometryError, PickQuery, PickedObject, Planner};
use genmanip_relations::{PosedObject, PosedScene};

use crate::articulation::{JointSettings, Sweeper, joint_changes};
use crate::goal_pose::GoalSearch;
use crate::moves::{Move, moves};
use crate::obstacles;
use crate::rejection::{NamedObject, Rejection};
use crate::settings::LayoutSettings;

/// Joint positions of objects in the states that were asked for, `None` where the arm cannot bring them there.
type Turned = BTreeMap<(usize, String), Option<Vec<f64>>>;

/// Everything that whether a layout can be served depends on.
pub(crate) struct ReachCheck<'a> {
    /// The layout, settled.
    pub scene: &'a PosedScene,
    /// Where things may stand, and how they are judged.
    pub world: &'a World,
    /// Robot and gripper.
    pub planner: &'a Planner,
    /// When an object counts as graspable, how room at the goal is sought, and how joints are moved.
    pub settings: &'a LayoutSettings,
    /// Known grasps of each object.
    pub tried: &'a [&'a [TriedGrasp]],
    /// Stream of this attempt.
    pub seed: Seed,
}

impl ReachCheck<'_> {
    /// The reason when no alternative of the goal can be served.
    pub fn unreachable(&self, goal: &Goal) -> Option<Rejection> {
        let (mut reason, mut turned) = (None, Turned::new());
        for alternative in moves(goal, self.scene) {
            match self.obstacle(&alternative, &mut turned) {
                None => return None,
                Some(obstacle) => reason = Some(obstacle),
            }
        }
        reason
    }

    /// What stands in the way of moves that are made one after the other; first what is quick to tell.
    fn obstacle(&self, steps: &[Move], turned: &mut Turned) -> Option<Rejection> {
        self.ungraspable(steps).or_else(|| self.no_way(steps, turned))
    }

    /// The first object that is to be carried and cannot be grasped.
    fn ungraspable(&self, steps: &[Move]) -> Option<Rejection> {
        let occupied = obstacles::around(self.scene, None);
        steps.iter().filter(|step| step.state().is_none()).find_map(|step| {
            let object = self.scene.objects().nth(step.object)?;
            match self.is_graspable(step.object, object, &occupied) {
                Ok(true) => None,
                Ok(false) => Some(Rejection::NoGrasp(NamedObject::of(object))),
                Err(error) => {
                    let (object, reason) = (NamedObject::of(object), error.to_string());
                    Some(Rejection::NoGraspGeometry { object, reason })
                }
            }
        })
    }

    /// The first object that cannot be brought into its state, or finds no place.
    fn no_way(&self, steps: &[Move], known: &mut Turned) -> Option<Rejection> {
        let Self { scene, world, planner, settings, seed, .. } = *self;
        let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
        let mut after = scene.clone();
        steps.iter().enumerate().find_map(|(index, step)| {
            let object = scene.objects().nth(step.object)?;
            let named = || NamedObject::of(object);
            if let Some(state) = step.state() {
                let ask = || turned(step.object, state, scene, planner, &settings.joint);
                let Some(joints) = known.entry((step.object, state.to_owned())).or_insert_with(ask) else {
                    return Some(Rejection::NoWayToState { object: named(), state: state.into() });
                };
                after.set_pose(step.object, object.pose, joints);
                return None;
            }
            let height = scene.bounds(step.object).map_or(0.0, |bounds| bounds.size().z);
            let usable = |goal: &Pose| planner.reaches_from_above(goal.position + DVec3::Z * height);
            let search = GoalSearch {
                scene: &after,
                upright: &upright,
                workspace: &world.workspace,
                relations: &world.relations,
                settings: &settings.goal_pose,
            };
            let places = search.places(step, &steps[index + 1..], &usable, seed.fork("room"));
            let Some(place) = places.first() else { return Some(Rejection::NoRoomAtGoal(named())) };
            after.set_pose(step.object, place.world_from_object, &object.joint_positions);
            None
        })
    }

    /// Whether the arm can carry any grasp of an object out, from its home: known ones first, then sampled ones.
    fn is_graspable(
        &self,
        index: usize,
        object: &PosedObject,
        occupied: &CollisionWorld,
    ) -> Result<bool, GeometryError> {
        let Self { scene, planner, tried, seed, .. } = *self;
        let pieces = object.model.pieces(&object.joint_positions);
        let query = PickQuery {
            planner,
            world: occupied,
            object: PickedObject { name: &object.id, world_from_object: object.pose, pieces: &pieces },
            goals: &[],
            arm: &planner.robot().home,
            settings: &self.settings.grasp,
        };
        let within_reach = |candidates: Vec<Grasp>| query.grasps(candidates.into_iter()).next().is_some();
        let known = tried.get(index).copied().unwrap_or_default();
        Ok(within_reach(obstacles::tried_grasps(planner, scene, index, known)?)
            || within_reach(obstacles::generated_grasps(planner, scene, index, seed.fork("reach"))?))
    }
}

/// Joint positions of an object in a state; `None` when the arm cannot move every joint there, one after the other.
fn turned(
    object: usize,
    state: &str,
    scene: &PosedScene,
    planner: &Planner,
    settings: &JointSettings,
) -> Option<Vec<f64>> {
    let mut scene = scene.clone();
    for change in joint_changes(&scene, object, state) {
        let sweeper = Sweeper::new(&scene, &change, planner, settings)?;
        sweeper.search(&planner.robot().home, &mut |_| Some(())).ok()?;
        let posed = scene.objects().nth(object)?;
        let (pose, mut joints) = (posed.pose, posed.joint_positions.clone());
        joints[change.joint] = change.targets[0];
        scene.set_pose(object, pose, &joints);
    }
    scene.objects().nth(object).map(|posed| posed.joint_positions.clone())
}

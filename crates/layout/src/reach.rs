//! Feasibility check of the goal: each moved object is graspable and has a goal pose.

use std::collections::BTreeMap;

use genmanip_core::glam::DVec3;
use genmanip_core::{Goal, Grasp, Pose, Seed, VerifiedGrasp, World};
use genmanip_motion::{
    AllowedCollisions, CollisionWorld, FeasibilitySettings, GeometryError, PickQuery, PickedObject, Planner,
    PlanningScene,
};
use genmanip_relations::PosedScene;

use crate::articulation::{JointSettings, Sweeper, joint_changes};
use crate::goal_pose::{GoalOrder, GoalSearch};
use crate::moves::{Move, moves};
use crate::obstacles;
use crate::rejection::{NamedObject, Rejection};
use crate::settings::LayoutSettings;

/// Joint positions of objects, by index, in requested states; `None` if the arm cannot bring the object into the state.
type ReachableStates = BTreeMap<(usize, String), Option<Vec<f64>>>;

/// Feasibility check of a goal.
pub struct ReachCheck<'a> {
    /// Scene with all objects at rest.
    pub scene: &'a PosedScene,
    /// Workspace and relation settings.
    pub world: &'a World,
    /// Planner for the robot of the world.
    pub planner: &'a Planner,
    /// Settings for grasps, goal poses and joint motions.
    pub settings: &'a LayoutSettings,
    /// Known grasps of each object, in the order of the scene.
    pub known_grasps: &'a [&'a [VerifiedGrasp]],
    /// Random stream of this attempt.
    pub seed: Seed,
}

impl ReachCheck<'_> {
    /// Rejection for an object that the robot touches at its home; `None` if there is none.
    pub fn at_home(&self) -> Option<Rejection> {
        let (mut world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
        for object in self.scene.objects() {
            // Poses are finite, and pieces of a built model have volume.
            let _ = world.add(object.id.as_str(), &object.model.pieces(&object.joint_positions), &object.pose);
        }
        let robot = self.planner.robot();
        let gripper_width = robot.gripper.max_width;
        let around = PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width };
        let report = self.planner.checker(&around, 0.0).check(&robot.home)?;
        let touched =
            self.scene.objects().find(|object| [&report.part, &report.other].contains(&&object.id.to_string()));
        touched.map(|object| Rejection::AtHome(NamedObject::of(object)))
    }

    /// Reason why no goal alternative is feasible; `None` if one is.
    pub fn unreachable(&self, goal: &Goal) -> Option<Rejection> {
        let (mut reason, mut reachable_state) = (None, ReachableStates::new());
        for alternative in moves(goal, self.scene) {
            match self.obstacle(&alternative, &mut reachable_state) {
                None => return None,
                Some(obstacle) => reason = Some(obstacle),
            }
        }
        reason
    }

    /// First reason why a sequence of moves is infeasible, `None` if it is feasible; cheap checks come first.
    fn obstacle(&self, steps: &[Move], reachable_state: &mut ReachableStates) -> Option<Rejection> {
        self.ungraspable(steps).or_else(|| self.infeasible_move(steps, reachable_state))
    }

    /// Rejection for the first object to be carried that cannot be grasped; `None` if all can.
    pub fn ungraspable(&self, steps: &[Move]) -> Option<Rejection> {
        let occupied = obstacles::around(self.scene, None);
        steps.iter().filter(|step| step.state().is_none()).find_map(|step| {
            let object = self.scene.objects().nth(step.object)?;
            match self.is_graspable(step.object, &occupied) {
                Ok(true) => None,
                Ok(false) => Some(Rejection::NoGrasp(NamedObject::of(object))),
                Err(error) => {
                    let (object, reason) = (NamedObject::of(object), error.to_string());
                    Some(Rejection::NoGraspGeometry { object, reason })
                }
            }
        })
    }

    /// Rejection for the first object whose state is unreachable or that has no goal pose; `None` if there is none.
    pub fn infeasible(&self, steps: &[Move]) -> Option<Rejection> {
        self.infeasible_move(steps, &mut ReachableStates::new())
    }

    fn infeasible_move(&self, steps: &[Move], known: &mut ReachableStates) -> Option<Rejection> {
        let Self { scene, world, planner, settings, seed, .. } = *self;
        let upright: Vec<_> = scene.objects().map(|object| object.pose.rotation).collect();
        let mut after = scene.clone();
        steps.iter().enumerate().find_map(|(index, step)| {
            let object = scene.objects().nth(step.object)?;
            let named = || NamedObject::of(object);
            if let Some(state) = step.state() {
                let ask = || reachable_state(step.object, state, scene, planner, &settings.joint);
                let Some(joints) = known.entry((step.object, state.to_owned())).or_insert_with(ask) else {
                    return Some(Rejection::UnreachableState { object: named(), state: state.into() });
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
                order: GoalOrder::Margin,
            };
            let goal_poses = search.goal_poses(step, &steps[index + 1..], &usable, seed.fork("room"));
            let Some(goal_pose) = goal_poses.first() else { return Some(Rejection::NoSpaceAtGoal(named())) };
            after.set_pose(step.object, goal_pose.world_from_object, &object.joint_positions);
            None
        })
    }

    /// True if any grasp of an object among obstacles is feasible from the home configuration: known grasps first, then
    /// sampled ones. `occupied` holds the object itself, too.
    ///
    /// # Errors
    /// Fails if a collision piece of the object is not finite or has no volume.
    pub fn is_graspable(&self, index: usize, occupied: &CollisionWorld) -> Result<bool, GeometryError> {
        let any_feasible = |candidates: Vec<Grasp>| !self.feasible(index, occupied, candidates, 1).is_empty();
        Ok(any_feasible(self.known(index)?) || any_feasible(self.sampled(index)?))
    }

    /// Known grasps of an object that fit its pose, best first, in the object frame.
    ///
    /// # Errors
    /// Fails if a collision piece of the object is not finite or has no volume.
    pub fn known(&self, index: usize) -> Result<Vec<Grasp>, GeometryError> {
        let known = self.known_grasps.get(index).copied().unwrap_or_default();
        obstacles::verified_grasps(self.planner, self.scene, index, known)
    }

    /// Grasps of an object sampled from its geometry, best first, in the object frame.
    ///
    /// # Errors
    /// Fails if a collision piece of the object is not finite or has no volume.
    pub fn sampled(&self, index: usize) -> Result<Vec<Grasp>, GeometryError> {
        obstacles::generated_grasps(self.planner, self.scene, index, self.seed.fork("reach"))
    }

    /// Up to `most` of an object's grasps that are feasible among obstacles from the home configuration, in order; as
    /// they are or turned by half a turn. `occupied` holds the object itself, too.
    pub fn feasible(&self, index: usize, occupied: &CollisionWorld, candidates: Vec<Grasp>, most: usize) -> Vec<Grasp> {
        let Self { scene, planner, .. } = *self;
        let Some(object) = scene.objects().nth(index) else { return Vec::new() };
        let pieces = object.model.pieces(&object.joint_positions);
        let query = PickQuery {
            planner,
            world: occupied,
            object: PickedObject { name: object.id.as_str(), world_from_object: object.pose, pieces: &pieces },
            goals: &[],
            arm: &planner.robot().home,
            settings: &FeasibilitySettings { wanted: most, ..self.settings.grasp.clone() },
        };
        query.grasps(candidates.into_iter()).map(|grasp| grasp.object_from_tcp).collect()
    }
}

/// Joint positions of an object in a state; `None` if the arm cannot move every joint there in sequence.
fn reachable_state(
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

//! Planned motion of the tool to a pose, with all objects as obstacles and the one in the hand carried along.

use std::sync::Arc;

use genmanip_core::{
    ActionChunk, EpisodeStart, Failure, FailureCause, Observation, Policy, PolicyError, PolicySpec, Pose,
    PrivilegedState, Seed,
};
use genmanip_layout::obstacles;
use genmanip_motion::{AllowedCollisions, Attached, Path, PlanError, Planner, PlanningScene, commands};

use crate::Stage;

/// Name of [`GoTo`].
pub const NAME: &str = "go_to";
/// Rate of the commands, Hz.
const RATE_HZ: f64 = 60.0;
/// Share of the robot's velocity limits. Chosen: slow enough to watch and to stop in time.
const SPEED: f64 = 0.4;
/// Control steps in which the arm comes to rest.
const REST_STEPS: usize = 12;

/// Path of the arm from a configuration (rad) to a pose of the tool, free of collisions; `opening_m` is the gripper's.
/// A grasped object moves with the hand unless it has joints, which may be fixed to the table.
///
/// # Errors
/// If the pose is out of reach or blocked, or no path is found.
pub fn free_path(
    stage: &Stage,
    planner: &Planner,
    truth: &PrivilegedState,
    (arm, opening_m): (&[f64], f64),
    world_from_tcp: &Pose,
    seed: Seed,
) -> Result<Path, PlanError> {
    let goals = planner.ik(world_from_tcp, arm);
    if goals.is_empty() {
        return Err(PlanError::Unreachable { what: "the arm has no posture with the tool there".into() });
    }
    let scene = stage.posed(&truth.objects);
    let held = truth.grasped.filter(|object| stage.models[*object].joint_states.is_empty());
    let tcp_from_world = planner.tcp_pose(arm).inverse();
    let attached = held.and_then(|object| {
        let posed = scene.objects().nth(object)?;
        let pieces = posed.model.pieces(&posed.joint_positions);
        Attached::new(posed.id.as_str(), &pieces, &(tcp_from_world * posed.pose)).ok()
    });
    let (world, allowed) = (obstacles::around(&scene, held), AllowedCollisions::none());
    let around =
        PlanningScene { world: &world, attached: attached.as_ref(), allowed: &allowed, gripper_width: opening_m };
    planner.plan_joint(&around, arm, &goals, seed)
}

/// Policy that moves the tool to a pose and finishes, or gives up before it has moved. It reads simulator truth.
pub struct GoTo {
    stage: Stage,
    planner: Arc<Planner>,
    world_from_tcp: Pose,
    seed: Seed,
}

impl GoTo {
    /// Policy for a stage.
    pub fn new(stage: &Stage, planner: &Arc<Planner>, world_from_tcp: Pose) -> Self {
        Self { stage: stage.clone(), planner: Arc::clone(planner), world_from_tcp, seed: Seed::new(0) }
    }
}

impl Policy for GoTo {
    fn spec(&self) -> PolicySpec {
        PolicySpec { privileged: true, ..PolicySpec::native(NAME, RATE_HZ) }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.seed = start.seed.fork("go to");
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let unsuited = |what: &str| PolicyError::Unsuited(format!("needs {what}"));
        let entry = |key: &str| observation.state.get(key).and_then(|values| values.split_last());
        let (Some((width_m, arm)), Some((opening_m, _))) = (entry(Observation::COMMAND), entry(Observation::STATE))
        else {
            return Err(unsuited("the command in force and the state of the robot"));
        };
        let truth = observation.privileged.as_ref().ok_or_else(|| unsuited("simulator truth"))?;
        let found = free_path(&self.stage, &self.planner, truth, (arm, *opening_m), &self.world_from_tcp, self.seed);
        let path = found.map_err(|error| {
            let cause = match error {
                PlanError::Unreachable { .. } => FailureCause::NoIk,
                _ => FailureCause::Planning,
            };
            PolicyError::GaveUp(Failure { cause, evidence: error.to_string() })
        })?;
        let mut actions = commands::follow(&self.planner, &path, *width_m, SPEED);
        let last = actions.last().cloned().unwrap_or_else(|| commands::command(arm, *width_m));
        actions.extend(std::iter::repeat_n(last, REST_STEPS));
        Ok(ActionChunk { actions, finished: true })
    }
}

//! Planning of one motion of the arm in a scenario: to a grasp, to a point or to joint positions.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, Seed};
use genmanip_layout::obstacles;
use genmanip_motion::{
    AllowedCollisions, FeasibilitySettings, FeasibleGrasp, HalfTurn, Path, PickQuery, PickedObject, PlanError, Planner,
    PlanningScene,
};
use genmanip_rollout::Stage;
use serde::Serialize;

use genmanip_viz::motion_images::MotionView;
use genmanip_workspace::WorkspaceError;

/// Settings of the grasp search: a dozen reachable grasps, each in the nearer of the two wrist orientations half a turn
/// apart.
fn feasibility() -> FeasibilitySettings {
    FeasibilitySettings { wanted: 12, half_turn: HalfTurn::Nearer, ..FeasibilitySettings::reach_only() }
}

/// Number of yaw angles tried for an arm with fewer than six joints, which cannot reach every orientation.
const TURNS: u32 = 72;

/// Target of the motion, as given by the user.
#[derive(Clone, Debug, PartialEq)]
pub enum Target {
    /// A grasp of the object with this uid or name.
    Object(String),
    /// A point that the tool centre between the fingertips reaches, with the hand pointing down.
    Point {
        /// x, y, z in the robot's base frame, m.
        position_m: Vec<f64>,
        /// Yaw of the hand about the vertical, rad.
        yaw_rad: f64,
    },
    /// Joint positions, rad or m.
    Joints(Vec<f64>),
}

/// Request for a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionRequest {
    /// Target of the motion.
    pub target: Target,
    /// Initial joint positions, rad or m; the robot's home if `None`.
    pub from: Option<Vec<f64>>,
    /// Opening of the gripper, m; ignored for a grasp, which has its own.
    pub gripper_width_m: f64,
}

/// Planned motion, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedMotion {
    /// Id of the scenario.
    pub scenario: String,
    /// Description of the target.
    pub goal: String,
    /// True if a path was found.
    pub solved: bool,
    /// Reason why there is no path; `None` if there is one.
    pub failure: Option<String>,
    /// CPU time of planning and time parametrisation, ms.
    pub planning_ms: f64,
    /// Length of the path: sum of the Euclidean distances between waypoints in joint space, rad.
    pub path_length_rad: f64,
    /// Duration of the trajectory, s.
    pub duration_s: f64,
    /// Waypoints of the path, joint positions in rad.
    pub waypoints: Vec<Vec<f64>>,
    /// Opening of the gripper during the motion, m.
    pub gripper_width_m: f64,
    /// Time between two states of the trajectory, s.
    pub dt_s: f64,
    /// Trajectory: joint positions at the control rate, rad.
    pub trajectory: Vec<Vec<f64>>,
    /// A goal configuration in collision, rad, for the diagram; `None` if planning succeeded or there is none.
    #[serde(skip)]
    pub blocked: Option<Vec<f64>>,
}

/// Target of the search: configurations or grasps.
enum Goal {
    /// Any of these configurations. With `any_yaw`, they may have any rotation of the hand about the vertical, as for
    /// an arm with few joints.
    Configurations { configs: Vec<Vec<f64>>, any_yaw: bool },
    /// The first collision-free grasp of an object, given by its index.
    Grasp { object: usize, grasps: Vec<FeasibleGrasp> },
}

/// Plans one motion from rest to rest; `clock` returns the CPU time used so far, s.
///
/// # Errors
/// When the request does not fit the robot or the scenario. An unreachable target is a result, not an error.
pub fn plan(
    stage: &Stage,
    planner: &Planner,
    request: &MotionRequest,
    seed: Seed,
    clock: &mut dyn FnMut() -> f64,
) -> Result<PlannedMotion, WorkspaceError> {
    let start = joints("--from", request.from.as_deref(), stage)?.unwrap_or_else(|| stage.robot.home.clone());
    let most = stage.robot.gripper.max_width;
    if !(0.0..=most).contains(&request.gripper_width_m) {
        return Err(WorkspaceError::input(format!("--gripper {} m is not possible", request.gripper_width_m))
            .with_hint(format!("expected 0 to {most} m")));
    }
    let goal = goal(&request.target, stage, planner, &start, seed)?;
    let began = clock();
    let planned = paths(&goal, request.gripper_width_m, stage, planner, &start, seed);
    let (paths, gripper_width_m) =
        planned.as_ref().map_or((&[][..], request.gripper_width_m), |(paths, width)| (paths, *width));
    let trajectory = timed(planner, paths, &start);
    let planning_ms = (clock() - began) * 1e3;
    let dt_s = planner.settings().timing.dt;
    Ok(PlannedMotion {
        scenario: stage.scenario.id.clone(),
        goal: match &goal {
            Goal::Configurations { any_yaw: true, .. } => {
                format!("{}, turned as the arm can", request.target.describe())
            }
            Goal::Configurations { .. } | Goal::Grasp { .. } => request.target.describe(),
        },
        solved: planned.is_ok(),
        failure: planned.as_ref().err().map(ToString::to_string),
        planning_ms,
        path_length_rad: paths.iter().map(Path::length).sum(),
        duration_s: dt_s * trajectory.len().saturating_sub(1) as f64,
        waypoints: paths.iter().flat_map(|path| path.waypoints().to_vec()).collect(),
        gripper_width_m,
        dt_s,
        trajectory,
        blocked: match goal {
            Goal::Configurations { configs, .. } if planned.is_err() => configs.into_iter().next(),
            _ => None,
        },
    })
}

impl PlannedMotion {
    /// Summary in one line.
    pub fn headline(&self) -> String {
        match &self.failure {
            None => format!(
                "planned in {:.2} ms: {:.2} rad, {:.2} s, {} corners",
                self.planning_ms,
                self.path_length_rad,
                self.duration_s,
                self.waypoints.len()
            ),
            Some(failure) => format!("no path to {}: {failure}", self.goal),
        }
    }

    /// The trajectory as input for an image or a video.
    pub fn drawn<'a>(&'a self, stage: &'a Stage, planner: &Planner) -> MotionView<'a> {
        MotionView {
            stage,
            configs: &self.trajectory,
            tcp: self.trajectory.iter().map(|config| planner.tcp_pose(config).position).collect(),
            gripper_width: self.gripper_width_m,
            blocked: self.blocked.as_deref(),
        }
    }
}

impl Target {
    fn describe(&self) -> String {
        let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        match self {
            Self::Object(object) => format!("a grasp of {object}"),
            Self::Point { position_m, .. } => format!("({}) m, hand down", numbers(position_m)),
            Self::Joints(joints) => format!("[{}] rad", numbers(joints)),
        }
    }
}

/// Paths in sequence (free motion, then for a grasp the straight approach), and the opening of the gripper, m.
fn paths(
    goal: &Goal,
    gripper_width_m: f64,
    stage: &Stage,
    planner: &Planner,
    start: &[f64],
    seed: Seed,
) -> Result<(Vec<Path>, f64), PlanError> {
    let world = obstacles::around(stage.start(), None);
    let nothing = AllowedCollisions::none();
    let free = |width: f64| PlanningScene { world: &world, attached: None, allowed: &nothing, gripper_width: width };
    let (object, grasps) = match goal {
        Goal::Configurations { configs, .. } => {
            let path = planner.plan_joint(&free(gripper_width_m), start, configs, seed)?;
            return Ok((vec![path], gripper_width_m));
        }
        Goal::Grasp { object, grasps } => (object, grasps),
    };
    let object = picked_object(stage, *object);
    let settings = feasibility();
    let query = PickQuery { planner, world: &world, object, goals: &[], arm: start, settings: &settings };
    let mut problem = PlanError::Unreachable { what: format!("no grasp of {} is free and in reach", object.name) };
    for grasp in grasps {
        let to_grasp = |approach: Path| Ok(vec![query.reach(grasp, &approach, seed)?, approach]);
        match query.approach(grasp).and_then(to_grasp) {
            Ok(paths) => return Ok((paths, grasp.opening_m)),
            Err(error) => problem = error,
        }
    }
    Err(problem)
}

/// An object at its initial pose. Its collision pieces are omitted, since it is not lifted here.
fn picked_object(stage: &Stage, index: usize) -> PickedObject<'_> {
    let placed = &stage.scenario.objects[index];
    PickedObject { name: placed.id.as_str(), world_from_object: placed.pose, pieces: &[] }
}

/// Trajectory at the control rate over all paths, with rest at the end of each path.
fn timed(planner: &Planner, paths: &[Path], start: &[f64]) -> Vec<Vec<f64>> {
    let mut configs = vec![start.to_vec()];
    for path in paths {
        configs.extend(planner.time(path, 1.0).configs.into_iter().skip(1));
    }
    configs
}

fn goal(target: &Target, stage: &Stage, planner: &Planner, start: &[f64], seed: Seed) -> Result<Goal, WorkspaceError> {
    let wanted = match target {
        Target::Joints(given) => {
            let configuration = joints("--joints", Some(given), stage)?;
            return Ok(Goal::Configurations { configs: configuration.into_iter().collect(), any_yaw: false });
        }
        Target::Point { position_m, yaw_rad } => return above(position_m, *yaw_rad, planner, start),
        Target::Object(wanted) => wanted.as_str(),
    };
    let ids: Vec<&str> = stage.scenario.objects.iter().map(|placed| placed.id.as_str()).collect();
    let named = |&index: &usize| ids[index] == wanted || stage.name(index).eq_ignore_ascii_case(wanted);
    let Some(index) = (0..ids.len()).find(named) else {
        let known: Vec<String> =
            ids.iter().enumerate().map(|(index, id)| format!("{id} ({})", stage.name(index))).collect();
        return Err(WorkspaceError::input(format!("there is no object `{wanted}` in {}", stage.scenario.id))
            .with_hint(format!("objects are {}", known.join(", "))));
    };
    let scene = stage.start();
    let world = obstacles::around(scene, None);
    let settings = feasibility();
    let object = picked_object(stage, index);
    let query = PickQuery { planner, world: &world, object, goals: &[], arm: start, settings: &settings };
    let candidates = obstacles::generated_grasps(planner, scene, index, seed)
        .map_err(|error| WorkspaceError::broken(format!("grasps of `{wanted}` cannot be sought"), error))?;
    Ok(Goal::Grasp { object: index, grasps: query.grasps(candidates.into_iter()).collect() })
}

/// Configurations with the tcp at a point (m, base frame) and the hand pointing down.
fn above(position_m: &[f64], yaw_rad: f64, planner: &Planner, start: &[f64]) -> Result<Goal, WorkspaceError> {
    let &[x, y, z] = position_m else {
        return Err(WorkspaceError::input(format!("--to has {} numbers", position_m.len()))
            .with_hint("expected x,y,z in metres"));
    };
    let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(std::f64::consts::PI) };
    let world_from_tcp = Pose::from_position_yaw(DVec3::new(x, y, z), yaw_rad) * down;
    let mut goals = planner.ik(&world_from_tcp, start);
    let any_yaw = goals.is_empty() && planner.tool_dof() < 6;
    if any_yaw {
        let turned = (1..TURNS).map(|turn| f64::from(turn) * std::f64::consts::TAU / f64::from(TURNS));
        let turned = turned.map(|turn| Pose::from_position_yaw(DVec3::new(x, y, z), yaw_rad + turn) * down);
        goals = turned.map(|pose| planner.ik(&pose, start)).find(|goals| !goals.is_empty()).unwrap_or_default();
    }
    if goals.is_empty() {
        return Err(WorkspaceError::input(format!("the hand, pointing down, does not get to ({x}, {y}, {z})"))
            .with_hint("positions are metres in the robot's base frame: x ahead, y to its left, z above the table"));
    }
    Ok(Goal::Configurations { configs: goals, any_yaw })
}

/// Validated joint positions of an option; `None` if it was not given.
fn joints(option: &str, given: Option<&[f64]>, stage: &Stage) -> Result<Option<Vec<f64>>, WorkspaceError> {
    let (Some(given), expected) = (given, stage.robot.arm_dof()) else { return Ok(None) };
    if given.len() != expected || !given.iter().all(|q| q.is_finite()) {
        return Err(WorkspaceError::input(format!("{option} has {} numbers", given.len()))
            .with_hint(format!("expected {expected} joint positions in rad, separated by commas")));
    }
    Ok(Some(given.to_vec()))
}

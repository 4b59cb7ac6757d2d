//! `genmanip plan`: one motion of the arm in a scenario, with a picture or an animation of it.

use std::path::Path as FilePath;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, Seed};
use genmanip_layout::obstacles;
use genmanip_motion::{Allowed, Path, PlanError, Planner, PlannerSettings, ReachableGrasp, Surroundings, World};
use genmanip_rollout::Stage;
use serde::Serialize;

use super::lab::cpu_clock;
use crate::args::PlanArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::pictures::motion::{self, Drawn};
use crate::printer::Printer;

/// Grasps among which the planner may choose.
const GRASPS: usize = 12;

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    scenario: String,
    goal: String,
    solved: bool,
    /// Why there is no path.
    failure: Option<String>,
    /// Processor time of planning and timing together.
    planning_ms: f64,
    /// Sum of the Euclidean joint-space steps.
    path_length_rad: f64,
    duration_s: f64,
    /// Corners of the path, joint positions in rad.
    waypoints: Vec<Vec<f64>>,
    /// Opening of the gripper on the way.
    gripper_width_m: f64,
    dt_s: f64,
    /// Joint positions at the control rate, rad.
    trajectory: Vec<Vec<f64>>,
}

/// Where the arm shall go.
enum Goal {
    /// One of these configurations.
    Configurations(Vec<Vec<f64>>),
    /// The first free grasp.
    Grasp { object: String, grasps: Vec<ReachableGrasp> },
}

pub fn run(arguments: &PlanArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stage = inputs::read_stage(&arguments.scenario)?;
    let mut settings = PlannerSettings::default();
    settings.plan.rrt_range = arguments.rrt_range.unwrap_or(settings.plan.rrt_range);
    let planner = inputs::planner(&settings)?;
    let start = joints("--from", arguments.from.as_deref(), &stage)?.unwrap_or_else(|| stage.robot.home.clone());
    let most = stage.robot.gripper.max_width;
    if !(0.0..=most).contains(&arguments.gripper) {
        return Err(Failed::new(format!("--gripper {} m is not possible", arguments.gripper))
            .hint(format!("expected 0 to {most} m")));
    }
    let goal = goal(arguments, &stage, &planner, &start)?;
    let mut clock = cpu_clock();
    let planned = plan(&goal, arguments, &stage, &planner, &start);
    let (paths, gripper_width) =
        planned.as_ref().map_or((&[][..], arguments.gripper), |(paths, width)| (paths, *width));
    let trajectory = timed(&planner, paths, &start);
    let planning_ms = clock() * 1e3;
    let report = Report {
        scenario: stage.scenario.id.clone(),
        goal: in_words(arguments),
        solved: planned.is_ok(),
        failure: planned.as_ref().err().map(ToString::to_string),
        planning_ms,
        path_length_rad: paths.iter().map(Path::length).sum(),
        duration_s: planner.settings().timing.dt * trajectory.len().saturating_sub(1) as f64,
        waypoints: paths.iter().flat_map(|path| path.waypoints().to_vec()).collect(),
        gripper_width_m: gripper_width,
        dt_s: planner.settings().timing.dt,
        trajectory,
    };
    draw(arguments, &stage, &planner, &goal, &report, printer)?;
    let headline = match &report.failure {
        None => format!(
            "planned in {:.2} ms: {:.2} rad, {:.2} s, {} corners",
            report.planning_ms,
            report.path_length_rad,
            report.duration_s,
            report.waypoints.len()
        ),
        Some(failure) => format!("no path to {}: {failure}", report.goal),
    };
    printer.data(&report, &headline);
    Ok(if report.solved { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// The paths one after the other (free motion, then for a grasp the straight approach), and the gripper's opening.
fn plan(
    goal: &Goal,
    arguments: &PlanArguments,
    stage: &Stage,
    planner: &Planner,
    start: &[f64],
) -> Result<(Vec<Path>, f64), PlanError> {
    let world = obstacles::around(stage.start(), None);
    let nothing = Allowed::none();
    let seed = Seed::new(arguments.seed);
    let free = |width: f64| Surroundings { world: &world, attached: None, allowed: &nothing, gripper_width: width };
    let (object, grasps) = match goal {
        Goal::Configurations(goals) => {
            let path = planner.plan_joint(&free(arguments.gripper), start, goals, seed)?;
            return Ok((vec![path], arguments.gripper));
        }
        Goal::Grasp { object, grasps } => (object, grasps),
    };
    let mut problem = PlanError::Unreachable { what: format!("no grasp of {object} is free and in reach") };
    for grasp in grasps {
        match to_grasp(grasp, object, &world, planner, start, &free(grasp.opening), seed) {
            Ok(paths) => return Ok((paths, grasp.opening)),
            Err(error) => problem = error,
        }
    }
    Err(problem)
}

fn to_grasp(
    grasp: &ReachableGrasp,
    object: &str,
    world: &World,
    planner: &Planner,
    start: &[f64],
    free: &Surroundings,
    seed: Seed,
) -> Result<Vec<Path>, PlanError> {
    let touching = Allowed::none().and_gripper(planner.robot(), object);
    let beside = Surroundings { world, attached: None, allowed: &touching, gripper_width: grasp.opening };
    let approach = planner.straight(&beside, &grasp.config, &planner.tcp_pose(&grasp.pregrasp))?.reversed();
    let reach = planner.plan_joint(free, start, &[approach.start().to_vec()], seed)?;
    Ok(vec![reach, approach])
}

/// Joint positions at the control rate, from rest to rest on each path.
fn timed(planner: &Planner, paths: &[Path], start: &[f64]) -> Vec<Vec<f64>> {
    let mut configs = vec![start.to_vec()];
    for path in paths {
        configs.extend(planner.time(path, 1.0).configs.into_iter().skip(1));
    }
    configs
}

fn goal(arguments: &PlanArguments, stage: &Stage, planner: &Planner, start: &[f64]) -> Result<Goal, Failed> {
    if let Some(configuration) = joints("--joints", arguments.joints.as_deref(), stage)? {
        return Ok(Goal::Configurations(vec![configuration]));
    }
    if let Some(position) = &arguments.to {
        let &[x, y, z] = position.as_slice() else {
            return Err(Failed::new(format!("--to has {} numbers", position.len())).hint("expected x,y,z in metres"));
        };
        let down = Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(std::f64::consts::PI) };
        let world_from_tcp = Pose::from_position_yaw(DVec3::new(x, y, z), arguments.yaw.to_radians()) * down;
        let goals = planner.ik(&world_from_tcp, start);
        if goals.is_empty() {
            return Err(Failed::new(format!("the hand, pointing down, does not get to ({x}, {y}, {z})"))
                .hint("positions are metres in the robot's base frame: x ahead, y to its left, z above the table"));
        }
        return Ok(Goal::Configurations(goals));
    }
    let wanted = arguments.pick.as_deref().unwrap_or_default();
    let named =
        |model: &genmanip_core::ObjectModel| model.card.uid == wanted || model.card.name.eq_ignore_ascii_case(wanted);
    let Some(index) = stage.models.iter().position(|model| named(model)) else {
        let known: Vec<String> =
            stage.models.iter().map(|model| format!("{} ({})", model.card.uid, model.card.name)).collect();
        return Err(Failed::new(format!("there is no object `{wanted}` in {}", stage.scenario.id))
            .hint(format!("objects are {}", known.join(", "))));
    };
    let scene = stage.start();
    let world = obstacles::around(scene, None);
    let nothing = Allowed::none();
    let around = Surroundings { world: &world, attached: None, allowed: &nothing, gripper_width: 0.0 };
    let candidates = obstacles::generated_grasps(planner, scene, index, Seed::new(arguments.seed))
        .map_err(|error| Failed::because(format!("grasps of `{wanted}` cannot be sought"), &error))?;
    let (id, pose) = (&scenario_object(stage, index).id, scenario_object(stage, index).pose);
    let grasps = planner.reachable_grasps(&around, id, &pose, &candidates, start, GRASPS);
    Ok(Goal::Grasp { object: id.clone(), grasps })
}

fn scenario_object(stage: &Stage, index: usize) -> &genmanip_core::PlacedObject {
    &stage.scenario.objects[index]
}

/// Joint positions as the user gave them.
fn joints(option: &str, given: Option<&[f64]>, stage: &Stage) -> Result<Option<Vec<f64>>, Failed> {
    let (Some(given), expected) = (given, stage.robot.arm_dof()) else { return Ok(None) };
    if given.len() != expected || !given.iter().all(|q| q.is_finite()) {
        return Err(Failed::new(format!("{option} has {} numbers", given.len()))
            .hint(format!("expected {expected} joint positions in rad, separated by commas")));
    }
    Ok(Some(given.to_vec()))
}

fn draw(
    arguments: &PlanArguments,
    stage: &Stage,
    planner: &Planner,
    goal: &Goal,
    report: &Report,
    printer: &Printer,
) -> Result<(), Failed> {
    let blocked = match goal {
        Goal::Configurations(goals) if !report.solved => goals.first(),
        _ => None,
    };
    let drawn = Drawn {
        stage,
        configs: &report.trajectory,
        tcp: report.trajectory.iter().map(|config| planner.tcp_pose(config).position).collect(),
        gripper_width: report.gripper_width_m,
        blocked: blocked.map(Vec::as_slice),
    };
    let write = |path: &FilePath, bytes: Vec<u8>| {
        inputs::write_file(path, &bytes)?;
        printer.say(format!("wrote {}", path.display()));
        Ok(())
    };
    if let Some(path) = &arguments.picture {
        write(path, motion::picture(&drawn, path, arguments.camera.as_deref())?)?;
    }
    match &arguments.animation {
        Some(path) if report.solved => write(path, motion::animation(&drawn, path, arguments.camera.as_deref())?),
        _ => Ok(()),
    }
}

fn in_words(arguments: &PlanArguments) -> String {
    let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    match (&arguments.pick, &arguments.to, &arguments.joints) {
        (Some(object), ..) => format!("a grasp of {object}"),
        (_, Some(position), _) => format!("({}) m, hand down", numbers(position)),
        (.., Some(joints)) => format!("[{}] rad", numbers(joints)),
        _ => String::new(),
    }
}

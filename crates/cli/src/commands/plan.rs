//! `genmanip plan`: one motion of the arm in a scenario, with an image or a video of it.

use std::path::Path;

use genmanip_core::Seed;
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::plan::{MotionRequest, Target, plan};
use genmanip_rollout::Stage;
use genmanip_viz::motion_images;
use genmanip_workspace::{documents, scenarios, worlds};

use crate::args::PlanArguments;
use genmanip_import::robots;
use genmanip_terminal::{ExitStatus, Failed};
use genmanip_terminal::{Printer, UrdfArguments};
use genmanip_workspace::WorkspaceError;

pub fn run(arguments: &PlanArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stage = stage(arguments, printer)?;
    let mut settings = PlannerSettings::default();
    settings.plan.rrt_range = arguments.rrt_range.unwrap_or(settings.plan.rrt_range);
    let planner = worlds::planner(&stage.scenario.world, &settings)?;
    let gripper_width_m = arguments.gripper.unwrap_or_else(|| OPENING_M.min(stage.robot.gripper.max_width));
    let request = MotionRequest { target: target(arguments), from: arguments.from.clone(), gripper_width_m };
    let motion = plan(&stage, &planner, &request, Seed::new(arguments.seed), &mut genmanip_lab::cpu_clock())?;
    let (drawn, camera) = (motion.drawn(&stage, &planner), arguments.camera.as_deref());
    let write = |path: &Path, bytes: Vec<u8>| -> Result<(), Failed> {
        documents::write_file(path, &bytes)?;
        printer.say(format!("wrote {}", path.display()));
        Ok(())
    };
    if let Some(path) = &arguments.picture {
        write(path, motion_images::picture(&drawn, path, camera)?)?;
    }
    if let Some(path) = arguments.animation.as_ref().filter(|_| motion.solved) {
        write(path, motion_images::animation(&drawn, path, camera)?)?;
    }
    printer.data(&motion, &motion.headline());
    Ok(if motion.solved { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// Default opening of the gripper, m.
const OPENING_M: f64 = 0.08;

/// Stage of the given scenario, or of an empty world with the given robot.
fn stage(arguments: &PlanArguments, printer: &Printer) -> Result<Stage, Failed> {
    let from_urdf = arguments.robot.as_deref().filter(|name| is_urdf(name));
    let from_urdf = from_urdf.map(|path| registered(Path::new(path), arguments, printer)).transpose()?;
    let robot = from_urdf.as_deref().or(arguments.robot.as_deref());
    if let Some(path) = &arguments.scenario {
        let stage = scenarios::read_stage(path)?;
        worlds::check_robot(&stage.scenario.world, robot)?;
        return Ok(stage);
    }
    Ok(scenarios::empty_stage(worlds::read_world_with(arguments.world.as_deref(), robot)?)?)
}

/// True for the path of a URDF file or a folder, false for the name of a built-in robot.
fn is_urdf(name: &str) -> bool {
    let path = Path::new(name);
    name.contains('/') || path.extension().is_some_and(|ending| ending == "urdf" || ending == "xacro")
}

/// Reads a robot from its URDF, registers it, and returns the name under which worlds can refer to it.
fn registered(path: &Path, arguments: &PlanArguments, printer: &Printer) -> Result<String, Failed> {
    let UrdfArguments { packages, tip, visuals_collide } = arguments.urdf.clone();
    let visible = arguments.picture.is_some() || arguments.animation.is_some();
    let settings = robots::Settings::new(&packages, robots::Choices { tip, visuals_collide, visible });
    let robots::PlannedRobot { mut model, notes } = robots::read(path, &settings)?;
    notes.iter().for_each(|note| printer.say(note));
    model.name = format!("{} (URDF)", model.name);
    let refused = |error| WorkspaceError::input(format!("{} cannot be used", path.display())).because(error);
    Ok(genmanip_assets::robots::register(&path.display().to_string(), model).map_err(refused)?.name.clone())
}

fn target(arguments: &PlanArguments) -> Target {
    let PlanArguments { pick, to, joints, .. } = arguments;
    match (joints, to) {
        (Some(joints), _) => Target::Joints(joints.clone()),
        (_, Some(to)) => Target::Point { position_m: to.clone(), yaw_rad: arguments.yaw.to_radians() },
        _ => Target::Object(pick.clone().unwrap_or_default()),
    }
}

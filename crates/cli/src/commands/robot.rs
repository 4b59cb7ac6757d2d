//! `genmanip robot`: robots from their URDF.

use std::path::Path;

use genmanip_import::robots::{self, add};
use genmanip_motion::PlannerSettings;
use genmanip_terminal::{ExitStatus, Failed, Printer, UrdfArguments};
use genmanip_viz::motion_images::{self, MotionView};
use genmanip_workspace::{documents, scenarios, text_table, worlds};
use serde_json::json;

use crate::args::{RobotAddArguments, RobotCommand};

pub fn run(command: &RobotCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        RobotCommand::Add(arguments) => add_robot(arguments, printer),
    }
}

fn add_robot(arguments: &RobotAddArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let UrdfArguments { packages, tip, visuals_collide } = arguments.places.clone();
    let settings = robots::Settings::new(&packages, robots::Choices { tip, visuals_collide, visible: true });
    let read = robots::read(&arguments.urdf, &settings)?;
    let name = arguments.name.clone().unwrap_or_else(|| plain(&read.model.name));
    let place = |folder: &str| arguments.out.join(folder).join(format!("{name}.json"));
    let (robot, arm) = (place(""), place("arms"));
    if let Some(taken) = [&robot, &arm].into_iter().find(|path| path.exists()) {
        return Err(Failed::new(format!("{} exists", taken.display()))
            .hint("--name gives another name, --out another folder; nothing was written"));
    }
    let proposal = add::propose(read, &name, arguments.gripper.as_deref())?;
    let write = |path: &Path, text: String| -> Result<(), Failed> {
        documents::write_file(path, text.as_bytes())?;
        printer.say(format!("wrote {}", path.display()));
        Ok(())
    };
    let picture = robot.with_extension("jpg");
    let drawn = image(proposal.model, &picture)?;
    write(&arm, format!("{}\n", proposal.arm))?;
    write(&robot, format!("{:#}\n", proposal.robot))?;
    documents::write_file(&picture, &drawn)?;
    printer.say(format!("wrote {}: the home posture", picture.display()));
    proposal.notes.iter().for_each(|note| printer.say(note));
    let rows: Vec<Vec<String>> = proposal.proposals.iter().map(|row| row.to_vec()).collect();
    let files = [&robot, &arm, &picture].map(|path| path.display().to_string());
    printer.data(
        &json!({"name": name, "files": files, "proposals": proposal.proposals, "notes": proposal.notes}),
        &text_table(&rows),
    );
    Ok(ExitStatus::Done)
}

/// The name in lower case with every character but letters and digits replaced by `_`; at most 64 characters.
fn plain(name: &str) -> String {
    let letter = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    let plain: String = name.chars().map(letter).take(64).collect();
    if plain.is_empty() { "robot".into() } else { plain }
}

/// JPEG or PNG image of the robot at its home configuration in an empty world.
fn image(model: genmanip_core::RobotModel, path: &Path) -> Result<Vec<u8>, Failed> {
    let name = model.name.clone();
    let refused = |error| {
        genmanip_workspace::WorkspaceError::input("the robot's name is taken")
            .because(error)
            .with_hint("--name gives another name")
    };
    genmanip_assets::robots::register(&path.display().to_string(), model).map_err(refused)?;
    let stage = scenarios::empty_stage(worlds::read_world_with(None, Some(&name))?)?;
    let planner = worlds::planner(&stage.scenario.world, &PlannerSettings::default())?;
    let configs = [stage.robot.home.clone()];
    let tcp = configs.iter().map(|config| planner.tcp_pose(config).position).collect();
    let gripper_width = stage.robot.gripper.max_width;
    let view = MotionView { stage: &stage, configs: &configs, tcp, gripper_width, blocked: None };
    Ok(motion_images::picture(&view, path, None)?)
}

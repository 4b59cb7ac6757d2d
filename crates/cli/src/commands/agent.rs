//! `genmanip agent act`: motions that the agent plans from one RGB-D image and an instruction.

use genmanip_agent_sim::AgentChoice;
use genmanip_agent_sim::act_on_files::{ActFiles, act};
use genmanip_assets::worlds::default_world;
use genmanip_core::Seed;
use genmanip_motion::PlannerSettings;
use genmanip_workspace::worlds;

use crate::args::{ActArguments, AgentCommand};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(command: &AgentCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    let AgentCommand::Act(arguments) = command;
    let ActArguments { vlm, masks, grasps, path, .. } = arguments;
    let choice =
        AgentChoice::named(vlm, masks, path, "full")?.with_grasps(grasps)?.with_depth_error(arguments.depth_error)?;
    let planner = worlds::planner(&default_world(), &PlannerSettings::default())?;
    let files = ActFiles {
        rgb: arguments.rgb.clone(),
        depth: arguments.depth.clone(),
        camera: arguments.camera.clone(),
        joints: arguments.joints.clone(),
        gripper_width_m: arguments.gripper,
        instruction: arguments.instruction.clone(),
        seed: Seed::new(arguments.seed),
        out: arguments.out.clone(),
    };
    let acted = act(&choice, &planner, &files)?;
    let mut words: Vec<String> = acted
        .steps
        .iter()
        .map(|step| {
            let duration_s = step.trajectory.len() as f64 / acted.rate_hz;
            format!("{:.1} s + {duration_s:.1} s, {} waypoints: {}", step.start_s, step.waypoints.len(), step.what)
        })
        .collect();
    words.extend(acted.failure.iter().map(ToString::to_string));
    words.push(format!("{} has the motions, the transcript and a picture of each stage", arguments.out.display()));
    printer.data(&acted, &words.join("\n"));
    Ok(if acted.failure.is_some() { ExitStatus::NotMet } else { ExitStatus::Done })
}

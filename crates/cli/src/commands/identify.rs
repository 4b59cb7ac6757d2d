//! `genmanip identify`: parameters of the simulator from recordings of an arm.

mod camera;
mod files;
mod motion;

use genmanip_core::World;
use genmanip_identify::parameters::{Parameter, set_contact_damping};
use genmanip_identify::recording::Recording;
use genmanip_identify::{Identification, SearchSettings, identify};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{WorkspaceError, text_table, worlds};

use crate::args::{IdentifyArguments, IdentifyCommand};

pub fn run(arguments: &IdentifyArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    match &arguments.command {
        Some(IdentifyCommand::Excite(arguments)) => motion::excite(arguments, printer),
        Some(IdentifyCommand::Rehearse(arguments)) => motion::rehearse(arguments, printer),
        Some(IdentifyCommand::Camera(arguments)) => camera::run(arguments, printer),
        None => solve(arguments, printer),
    }
}

fn solve(arguments: &IdentifyArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
    let robot = worlds::robot(&world)?;
    let read = |paths: &[std::path::PathBuf]| -> Result<Vec<Recording>, Failed> {
        paths.iter().map(|path| files::read(path, &robot)).collect()
    };
    let recordings = read(&arguments.recordings)?;
    let held_out = read(&arguments.held_out)?;
    if let Some(path) = arguments
        .recordings
        .iter()
        .chain(&arguments.held_out)
        .zip(recordings.iter().chain(&held_out))
        .find_map(|(path, recording)| (!recording.is_measured()).then_some(path))
    {
        return Err(WorkspaceError::input(format!("{} is a motion without measurements", path.display()))
            .with_hint("execute it on the arm and add joint_rad, or rehearse it: genmanip identify rehearse")
            .into());
    }
    let found = identify(&world, &robot, &recordings, &held_out, &SearchSettings::default())
        .map_err(|error| WorkspaceError::input("the recordings identify nothing").because(error))?;
    if let Some(out) = &arguments.out {
        files::write_world(arguments.world.as_deref(), &world, &identified_world(&world, &found), out)?;
        printer.say(format!("wrote {}", out.display()));
    }
    printer.data(&found, &describe(&found));
    Ok(ExitStatus::Done)
}

/// The world with the identified values; everything else stays.
fn identified_world(world: &World, found: &Identification) -> World {
    let mut identified = world.clone();
    let is_found = |wanted: fn(&Parameter) -> bool| found.parameters.iter().any(|it| wanted(&it.parameter));
    if is_found(|it| it.joint().is_some() || *it == Parameter::Latency) {
        let mut arm = found.values.arm.clone();
        for list in [&mut arm.kp, &mut arm.kv, &mut arm.damping, &mut arm.friction_loss] {
            list.iter_mut().for_each(|value| *value = rounded(*value));
        }
        arm.latency_s = rounded(arm.latency_s);
        identified.physics.arm = Some(arm);
    }
    if is_found(|it| *it == Parameter::PadFriction) {
        identified.physics.pad_friction = rounded(found.values.pad_friction);
    }
    if let Some(damping) = found.contact_damping {
        set_contact_damping(&mut identified, rounded(damping));
    }
    if is_found(|it| *it == Parameter::TableFriction)
        && let Some(table) = identified.surfaces.first_mut()
    {
        table.friction = rounded(found.values.table_friction);
    }
    identified
}

/// Value with six significant digits: more than any interval needs.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn describe(found: &Identification) -> String {
    let head = ["parameter", "before", "identified", "95 % interval", "unit"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let number = |value: f64| {
        let digits = (3 - value.abs().max(1e-4).log10().floor() as i32).clamp(0, 6) as usize;
        format!("{value:.digits$}")
    };
    for it in &found.parameters {
        let [low, high] = it.interval.map(number);
        let bound = if it.is_at_bound { ", at its bound" } else { "" };
        rows.push(vec![
            it.name.clone(),
            number(it.before),
            number(it.value),
            format!("{low} to {high}{bound}"),
            it.unit.into(),
        ]);
    }
    let mut text = text_table(&rows);
    for it in &found.unidentified {
        text += &format!("not identified: {}: {}; to see it, {}\n", it.name, it.reason, it.motion);
    }
    if found.contact_damping.is_none() && found.parameters.iter().any(|it| it.parameter == Parameter::Restitution) {
        text += "warning: no damping ratio of the simulated contacts bounces as much: physics.engine.contact_solref stays\n";
    }
    for fit in &found.fits {
        let motions = fit.motions.iter().map(|motion| motion.name()).collect::<Vec<_>>().join(" and ");
        let noise = fit.channels.iter().map(|channel| channel.noise).fold(0.0, f64::max);
        let residual = fit.channels.iter().map(|channel| channel.residual).fold(0.0, f64::max);
        text += &format!(
            "{motions}: condition number {:.0}; largest residual {residual:.1e}, noise {noise:.1e}\n",
            fit.condition_number
        );
    }
    if let Some(held_out) = &found.held_out {
        text += &format!(
            "tracking error where not used: {:.2} mrad before, {:.2} mrad after ({:.1} times smaller)\n",
            1e3 * held_out.before_rad,
            1e3 * held_out.after_rad,
            held_out.ratio()
        );
    }
    if found.is_structure_wrong {
        text += "warning: the residuals are no noise: the arm does something that the simulator lacks, such as backlash, \
                 friction that changes with speed, or a controller at another rate; the intervals do not hold\n";
    }
    text
}

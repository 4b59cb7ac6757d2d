//! `genmanip identify excite` and `rehearse`: motions, and recordings of a simulated arm.

use genmanip_core::{RobotModel, Seed, World};
use genmanip_identify::motions::{ExcitationSettings, drop_block, excitation, push, slip, with_payload};
use genmanip_identify::parameters::Values;
use genmanip_identify::recording::{Block, Motion, Payload, Recording};
use genmanip_identify::synthetic::{Effect, HiddenArm, Sensors, record};
use genmanip_identify::{Expected, IdentifyError, expected};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{WorkspaceError, text_table, worlds};
use serde_json::json;

use super::files;
use crate::args::{ExciteArguments, RehearseArguments};

pub fn excite(arguments: &ExciteArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
    let planner = worlds::planner(&world, &PlannerSettings::default())?;
    let refused = |error: IdentifyError| WorkspaceError::input("no such motion was found").because(error);
    let (motion, accuracy) = match arguments.shown.as_str() {
        "arm" | "payload" => free(arguments, &planner, &world)?,
        "table-friction" => {
            let block = block(arguments)?;
            (push(&planner, block, positive("--speed", arguments.speed)?).map_err(refused)?, Vec::new())
        }
        "restitution" => {
            let mut block = block(arguments)?;
            block.base_m[2] = 1e-3 * positive("--drop-mm", arguments.drop_mm)?;
            (drop_block(planner.robot(), block).map_err(refused)?, Vec::new())
        }
        _ => (slip(&planner, block(arguments)?).map_err(refused)?, Vec::new()),
    };
    files::write(&arguments.out, &motion)?;
    printer.say(format!("wrote {}", arguments.out.display()));
    let duration_s = motion.time_s.last().copied().unwrap_or_default();
    printer.data(
        &json!({"motion": motion.motion, "duration_s": duration_s, "expected": accuracy}),
        &describe(&motion, duration_s, &accuracy),
    );
    Ok(ExitStatus::Done)
}

/// The most informative of several random free motions, with the accuracy to expect.
fn free(arguments: &ExciteArguments, planner: &Planner, world: &World) -> Result<(Recording, Vec<Expected>), Failed> {
    let robot = planner.robot();
    let refused = |error: IdentifyError| WorkspaceError::input("no such motion was found").because(error);
    let joints = joints(&arguments.joints, robot)?;
    let defaults = ExcitationSettings::default();
    let duration_s = positive("--duration", arguments.duration)?;
    if !(3.0..=100.0).contains(&duration_s) || !(0.05..=1.0).contains(&arguments.effort) {
        return Err(Failed::misused(format!("--duration {duration_s} --effort {} is not possible", arguments.effort))
            .hint("3 to 100 s; an effort from 0.05 to 1"));
    }
    let settings = ExcitationSettings { duration_s, effort: arguments.effort, joints, ..defaults };
    let noise = positive("--noise", arguments.noise)?;
    let payload = || {
        let [x, y, z] = arguments.payload_at[..] else {
            return Err(Failed::misused("--payload-at has no three coordinates").hint("--payload-at X,Y,Z in metres"));
        };
        let gyration_m = 1e-3 * positive("--payload-gyration-mm", arguments.payload_gyration_mm)?;
        Ok(Payload { center_m: [x, y, z], gyration_m })
    };
    let mut best: Option<(f64, Recording, Vec<Expected>)> = None;
    for candidate in 0..arguments.candidates {
        let seed = Seed::new(arguments.seed).fork_index(candidate as u64);
        let mut motion = excitation(planner, world, &settings, seed).map_err(refused)?;
        if arguments.shown == "payload" {
            motion = with_payload(&motion, payload()?);
        }
        let accuracy = expected(world, robot, std::slice::from_ref(&motion), noise).map_err(refused)?;
        // The least accurate of the parameters that it shows at all decides.
        let shown = accuracy.iter().filter(|it| it.is_identified);
        let lost = accuracy.len() - shown.clone().count();
        let score = lost as f64 + shown.map(|it| it.share).fold(0.0, f64::max);
        if best.as_ref().is_none_or(|(least, ..)| score < *least) {
            best = Some((score, motion, accuracy));
        }
    }
    best.map(|(_, motion, accuracy)| (motion, accuracy))
        .ok_or_else(|| Failed::misused("--candidates 0 leaves no motion"))
}

/// Joints counted from 0, of numbers counted from 1.
fn joints(numbers: &[usize], robot: &RobotModel) -> Result<Vec<usize>, Failed> {
    let count = robot.arm_dof();
    match numbers.iter().find(|number| !(1..=count).contains(*number)) {
        Some(number) => Err(Failed::misused(format!("--joints {number} does not exist"))
            .hint(format!("{} has joints 1 to {count}", robot.name))),
        None => Ok(numbers.iter().map(|number| number - 1).collect()),
    }
}

fn positive(flag: &str, value: f64) -> Result<f64, Failed> {
    if value > 0.0 { Ok(value) } else { Err(Failed::misused(format!("{flag} {value}: expected a positive number"))) }
}

fn block(arguments: &ExciteArguments) -> Result<Block, Failed> {
    let ([x, y, z], [at_x, at_y]) = (&arguments.block_mm[..], &arguments.block_at[..]) else {
        return Err(Failed::misused("--block-mm has no three extents, or --block-at no two coordinates")
            .hint("--block-mm 60,60,60 --block-at 0.45,0"));
    };
    let size_m = [*x, *y, *z].map(|extent| 1e-3 * extent);
    if !size_m.iter().all(|extent| (5e-3..0.3).contains(extent)) {
        return Err(Failed::misused("--block-mm: expected extents from 5 to 300 mm"));
    }
    let mass_kg = positive("--block-kg", arguments.block_kg)?;
    Ok(Block { size_m, mass_kg, base_m: [*at_x, *at_y, 0.0], track_m: Vec::new() })
}

fn describe(motion: &Recording, duration_s: f64, accuracy: &[Expected]) -> String {
    let mut text = format!("{} motion of {duration_s:.1} s, {} commands\n", motion.motion.name(), motion.len());
    if !accuracy.is_empty() {
        let head = ["parameter", "assumed", "95 % interval"];
        let mut rows = vec![head.map(String::from).to_vec()];
        rows.extend(accuracy.iter().map(|it| {
            let width = match it.is_identified {
                true => format!("± {:.1} %", 100.0 * it.share),
                false => "not identified".into(),
            };
            vec![it.name.clone(), format!("{:.4} {}", it.value, it.unit), width]
        }));
        text += &text_table(&rows);
    }
    text
}

pub fn rehearse(arguments: &RehearseArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world(arguments.world.as_deref())?;
    let robot = worlds::robot(&world)?;
    let motion = files::read(&arguments.motion, &robot)?;
    let payload_kg = match motion.motion {
        Motion::Payload => positive("--payload-kg", arguments.payload_kg)?,
        _ => 0.0,
    };
    let values = Values { payload_kg, ..Values::of(&world, &robot).with_center_of([&motion]) };
    let sensors = Sensors {
        joint_rad: arguments.noise.max(0.0),
        joint_step_rad: arguments.step.max(0.0),
        block_m: 1e-3 * arguments.block_noise_mm.max(0.0),
    };
    let hidden = HiddenArm { world, values, effect: Effect::None, sensors };
    let recording = record(&hidden, &robot, &motion, Seed::new(arguments.seed))
        .map_err(|error| WorkspaceError::broken("the motion cannot be simulated", error))?;
    files::write(&arguments.out, &recording)?;
    printer.say(format!("wrote {}", arguments.out.display()));
    printer.data(&json!({"out": arguments.out, "moments": recording.len()}), "");
    Ok(ExitStatus::Done)
}

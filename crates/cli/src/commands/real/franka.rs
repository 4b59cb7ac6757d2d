//! `genmanip real franka`: a Franka arm over its own control protocol, behind a bridge.

use std::sync::Arc;

use genmanip_core::Seed;
use genmanip_franka::{FR3, FrankaArm, FrankaError, Hand, HandSettings, JOINTS, RealtimeConfig, Robot, limit_velocity};
use genmanip_pipeline::real::simulated::bridge_robot;
use genmanip_real::bridge::server::{Clock, NoImages, serve};
use genmanip_real::bridge::{Bridge, BridgeSettings, Driver, GripperSettings, beyond_m};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::worlds;

use super::listening;
use crate::args::RealFrankaArguments;

/// Distance between the tool of the robot's model and the end effector that the arm reports above which a person is told, m.
const SAME_TOOL_M: f64 = 5e-3;
/// Time without motion after which the fingers count as stopped, s: a Franka Hand begins to move up to 0.3 s after a
/// command.
const HAND_STALL_S: f64 = 0.5;

pub fn run(arguments: &RealFrankaArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world_with(None, Some(&arguments.robot))?;
    let model = worlds::robot(&world)?;
    let mut facts = bridge_robot(&model);
    if facts.joints.len() != JOINTS {
        return Err(Failed::new(format!(
            "robot `{}` has {} joints, a Franka arm {JOINTS}",
            model.name,
            facts.joints.len()
        ))
        .hint("choose --robot fr3 or --robot panda"));
    }
    if model.name == FR3 {
        limit_velocity(&mut facts.joints);
    }
    let (listener, address) = listening::open(&arguments.bridge)?;
    let host = arguments.host.as_str();
    let realtime = if arguments.no_realtime { RealtimeConfig::Ignore } else { RealtimeConfig::Enforce };
    let robot = Robot::new(host, realtime).map_err(|error| unusable("arm", host, &error))?;
    let hand = match arguments.no_gripper {
        true => {
            facts.max_width_m = 0.0;
            None
        }
        false => {
            let settings = HandSettings { speed_m_s: arguments.gripper_speed, force_n: arguments.gripper_force };
            Some(Hand::connect(host, settings).map_err(|error| unusable("gripper", host, &error))?)
        }
    };
    let mut arm = FrankaArm::new(&robot, hand);
    let failed = |error| Failed::because("the bridge stopped", &error);
    let reading = arm.read().map_err(failed)?;
    let reported = arm.end_effector().map_err(|error| unusable("arm", host, &error))?;
    let tool = (facts.tool)(&reading.positions);
    let apart_m = beyond_m(&[reported, reported], &tool);
    if apart_m > SAME_TOOL_M {
        printer.say(format!(
            "the arm reports its end effector at {reported:.3?} m, where robot `{}` has its tool at {tool:.3?} m; is it this \
             robot, and is its end effector set on the arm's own page?",
            model.name
        ));
    }
    let settings = BridgeSettings {
        gripper: hand_limits(facts.max_width_m, arguments.gripper_speed),
        ..listening::settings(&arguments.bridge)
    };
    let bridge = Bridge::new(facts, settings, reading)
        .ok_or_else(|| Failed::new(format!("robot `{}` has joints without limits", model.name)))?;
    let stop = genmanip_terminal::on_interrupt();
    printer.say(format!("the Franka arm at {host} is at tcp://{address} as {}; Ctrl-C ends it", model.name));
    let flaws = listening::flaws(&arguments.bridge, Seed::new(arguments.seed));
    let ended = serve(listener, bridge, &mut arm, Arc::new(NoImages), flaws, Clock::new(), &stop);
    let report = arm.report();
    let aborts = report.aborts.iter().map(|(word, count)| format!("{count} {word}")).collect::<Vec<_>>();
    printer.say(format!(
        "{} motions, {} setpoints, {} states missed ({} in a row at most); aborted by the arm: {}; recovered {} times",
        report.motions,
        report.setpoints,
        report.missed,
        report.most_missed,
        if aborts.is_empty() { "none".into() } else { aborts.join(", ") },
        report.recoveries
    ));
    listening::say(&ended.map_err(failed)?, printer);
    Ok(ExitStatus::Done)
}

/// Time limits of gripper commands: one ends after twice the time that its speed asks for, and a second.
fn hand_limits(max_width_m: f64, speed_m_s: f64) -> GripperSettings {
    let usual = GripperSettings::default();
    let longest_s = usual.longest_s.max(1.0 + 2.0 * max_width_m / speed_m_s);
    GripperSettings { stall_s: HAND_STALL_S, longest_s, ..usual }
}

fn unusable(what: &str, host: &str, error: &FrankaError) -> Failed {
    let failed = Failed::because(format!("the {what} at {host} cannot be used"), error);
    match error {
        FrankaError::Realtime(_) => failed.hint("run a kernel with PREEMPT_RT; --no-realtime is for simulated arms"),
        _ if what == "gripper" => failed.hint("pass --no-gripper for an arm without a Franka Hand"),
        _ => failed.hint("unlock the joints and activate FCI on the arm's own page"),
    }
}

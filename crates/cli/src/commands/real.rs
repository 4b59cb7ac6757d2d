//! `genmanip real`: policies on an arm behind a bridge, bridges to a Franka arm and to a simulated one, and worlds that
//! look like the real workspace.

mod franka;
mod listening;
mod matched;

use std::io::{IsTerminal, stdin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

use genmanip_core::Seed;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::real::arm::ArmSettings;
use genmanip_pipeline::real::cameras::Rig;
use genmanip_pipeline::real::run::{Judgement, Outcome, RealRequest, open_store, run as run_on_arm};
use genmanip_pipeline::real::simulated::{PacedArm, SimulatedArm, SimulatedArmSettings, bridge_robot};
use genmanip_real::bridge::Bridge;
use genmanip_real::bridge::client::{ClientSettings, SLOW};
use genmanip_real::bridge::server::{Clock, serve};
use genmanip_rollout::Stage;
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{scenarios, worlds};

use crate::args::{RealCommand, RealRunArguments, RealSimulateArguments};

pub fn run(command: &RealCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        RealCommand::Simulate(arguments) => simulate(arguments, printer),
        RealCommand::Franka(arguments) => franka::run(arguments, printer),
        RealCommand::Run(arguments) => run_policy(arguments, printer),
        RealCommand::Match(arguments) => matched::run(arguments, printer),
    }
}

fn simulate(arguments: &RealSimulateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (listener, address) = listening::open(&arguments.bridge)?;
    let stage = match &arguments.scenario {
        Some(path) => {
            let stage = scenarios::read_stage(path)?;
            worlds::check_robot(&stage.scenario.world, arguments.robot.as_deref())?;
            stage
        }
        None => {
            let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
            scenarios::empty_stage(world)?
        }
    };
    if stage.robot.drives.is_none() {
        return Err(Failed::new(format!("robot `{}` has no drives, so it cannot be simulated", stage.robot.name)));
    }
    let settings = listening::settings(&arguments.bridge);
    let flaws = SimulatedArmSettings {
        lag_s: arguments.lag_ms / 1e3,
        noise_rad: arguments.noise_rad,
        reflex_n: arguments.reflex_n,
    };
    let (seed, clock) = (Seed::new(arguments.seed), Clock::new());
    let arm = SimulatedArm::new(&stage, flaws, settings.guard.tick_s, seed);
    let cameras = arm.cameras(&stage).map_err(|error| Failed::because("the cameras cannot be rendered", &error))?;
    let bridge = Bridge::new(bridge_robot(&stage.robot), settings, arm.reading())
        .ok_or_else(|| Failed::new(format!("robot `{}` has joints without limits", stage.robot.name)))?;
    let stop = genmanip_terminal::on_interrupt();
    printer.say(format!(
        "a simulated {} is at tcp://{address} with {} cameras and {} objects; Ctrl-C ends it",
        stage.robot.name,
        stage.scenario.world.cameras.len(),
        stage.scenario.objects.len()
    ));
    let mut driver = PacedArm::new(arm, clock);
    let flaws = listening::flaws(&arguments.bridge, seed);
    let report = serve(listener, bridge, &mut driver, Arc::new(cameras), flaws, clock, &stop)
        .map_err(|error| Failed::because("the bridge stopped", &error))?;
    listening::say(&report, printer);
    Ok(ExitStatus::Done)
}

fn run_policy(arguments: &RealRunArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let policy = PolicyFactory::resolve(&arguments.policy)?;
    let stage = stage(arguments)?;
    let request = RealRequest {
        url: arguments.robot.clone(),
        client: ClientSettings {
            speed: if arguments.slow { SLOW } else { arguments.speed },
            workspace_m: arguments.workspace,
            ..ClientSettings::default()
        },
        rig: arguments.cameras.as_deref().map(Rig::read).transpose()?.unwrap_or_default(),
        arm: ArmSettings { horizon_s: arguments.horizon, dry_run: arguments.dry_run },
        seed: Seed::new(arguments.seed),
        fps: if arguments.out.is_some() { arguments.fps } else { 0 },
        ahead: !arguments.no_ahead,
        judged: arguments.judge.as_ref().and(arguments.scenario.as_deref()).map(scenarios::read_stage).transpose()?,
    };
    // A folder of another run is refused before the arm moves.
    let store = match &arguments.out {
        Some(out) if !arguments.dry_run => Some((out, open_store(out, &stage)?)),
        _ => None,
    };
    let keys = keys(printer);
    let run = match run_on_arm(&request, &stage, &policy, &keys.held)? {
        Outcome::Episode(run) => run,
        Outcome::Dry(report) => {
            let text = format!(
                "{} commands, none sent: {} beyond the joint limits, {} outside of the workspace; the first one is {:.3} rad \
                 away, later ones at most {:.3} rad from the one before\n",
                report.commands,
                report.beyond_limits,
                report.outside_workspace,
                report.first_step_rad,
                report.largest_step_rad
            );
            printer.data(&report, &text);
            return Ok(ExitStatus::Done);
        }
    };
    let (facts, frames) = (run.facts.clone(), run.result().frames);
    for failure in &run.result().failures {
        printer.say(&failure.evidence);
    }
    let judgement = judgement(arguments, &keys, printer);
    let said = match (&judgement, &facts.points) {
        (Some(judgement), _) if judgement.success => "judged as done".into(),
        (Some(_), _) => "judged as not done".into(),
        (None, Some(points)) => points.text(),
        (None, None) => "not judged".into(),
    };
    let text = format!(
        "{frames} control steps, {} commands, {} refused, {} starts, {} stops of the arm by itself; {said}\n",
        facts.tally.commands,
        facts.tally.refused.values().sum::<usize>(),
        facts.tally.starts,
        facts.tally.arm_stops
    );
    if let Some(chunks) = &facts.chunks {
        printer.say(format!(
            "{} chunks of actions, {} joined on the way, {} times the arm waited for one, {:.2} s in total; answers took {:.0} ms \
             at most",
            chunks.chunks,
            chunks.joined,
            chunks.holds,
            chunks.held_s,
            1e3 * chunks.longest_answer_s
        ));
    }
    match store {
        Some((out, store)) => {
            let result = run.store(&store, judgement)?;
            printer.data(&result, &text);
            printer.say(format!("episode {} in {}", result.id, out.display()));
        }
        None => printer.data(&facts, &text),
    }
    Ok(ExitStatus::Done)
}

/// Robot, cameras and instruction of a run, without objects.
fn stage(arguments: &RealRunArguments) -> Result<Stage, Failed> {
    let (world, given) = match &arguments.scenario {
        Some(path) => {
            let scenario = scenarios::read_scenario(path)?;
            (scenario.world, Some((scenario.id, scenario.task)))
        }
        None => (worlds::read_world(arguments.world.as_deref())?, None),
    };
    let mut stage = scenarios::empty_stage(world)?;
    let scenario = Arc::make_mut(&mut stage.scenario);
    match given {
        Some((id, task)) => (scenario.id, scenario.task) = (id, task),
        None => (scenario.id, scenario.task.id) = ("real".into(), "real".into()),
    }
    if let Some(instruction) = &arguments.instruction {
        scenario.task.instruction.clone_from(instruction);
    }
    Ok(stage)
}

/// Dead-man's switch of a run in a terminal.
struct Keys {
    /// True until Ctrl-C, Enter or the end of the terminal.
    held: Arc<AtomicBool>,
    /// Lines of the terminal; `None` without one.
    lines: Option<Receiver<String>>,
}

fn keys(printer: &Printer) -> Keys {
    let held = Arc::new(AtomicBool::new(true));
    let interrupted = genmanip_terminal::on_interrupt();
    let released = Arc::clone(&held);
    thread::spawn(move || {
        while !interrupted.load(Ordering::Relaxed) {
            thread::sleep(Duration::from_millis(5));
        }
        released.store(false, Ordering::Relaxed);
    });
    let lines = stdin().is_terminal().then(|| {
        printer.say("Enter or Ctrl-C stops the arm");
        let (sender, lines) = channel();
        let released = Arc::clone(&held);
        thread::spawn(move || {
            for line in stdin().lines().map_while(Result::ok) {
                released.store(false, Ordering::Relaxed);
                // The run may be over.
                let _ = sender.send(line);
            }
            released.store(false, Ordering::Relaxed);
        });
        lines
    });
    Keys { held, lines }
}

/// Judgement from the arguments, or asked in a terminal.
fn judgement(arguments: &RealRunArguments, keys: &Keys, printer: &Printer) -> Option<Judgement> {
    if let Some(success) = &arguments.success {
        return Some(Judgement { success: success == "yes", notes: arguments.notes.clone().unwrap_or_default() });
    }
    let lines = keys.lines.as_ref().filter(|_| arguments.out.is_some() && arguments.judge.is_none())?;
    // Keys that stopped the arm are no answer.
    while lines.try_recv().is_ok() {}
    loop {
        printer.say("was the task done? yes or no, then remarks if there are any");
        let line = lines.recv().ok()?;
        let (word, notes) = line.trim().split_once([' ', ',', ':']).unwrap_or((line.trim(), ""));
        let success = match word {
            "yes" | "y" => true,
            "no" | "n" => false,
            _ => continue,
        };
        return Some(Judgement { success, notes: notes.trim().to_owned() });
    }
}

//! `genmanip teleop`: a person moves the robot with a SpaceMouse, without a browser.

use std::io::BufRead;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use genmanip_core::EpisodeResult;
use genmanip_data::EpisodeStore;
use genmanip_pipeline::PolicyFactory;
use genmanip_studio::teleop::{Hidraw, Phase, Request, Session, SessionSetup, SessionStatus, TakeCommand};
use genmanip_teleop::TeleopSettings;
use genmanip_teleop::mapping::OperatorFrame;
use genmanip_teleop::record::Hold;
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{WorkspaceError, scenarios};
use serde_json::json;

use crate::args::TeleopArguments;

/// Interval of status lines while nothing but numbers changes.
const LINE: Duration = Duration::from_secs(2);
/// Interval in which the status is looked at.
const LOOK: Duration = Duration::from_millis(50);
/// Number of the only connection of the session.
const TERMINAL: u64 = 0;
/// Letters of the terminal.
const LETTERS: &str = "p pause or go on, b back 5 s, t take over or hand over, n begin anew, k keep, \
                       l keep without idle ends, x discard; each with Enter";

pub fn run(arguments: &TeleopArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let TeleopArguments { scenario, device, descriptor, policy, watch, frame, out, author } = arguments;
    PolicyFactory::resolve(policy)?;
    let mouse = Hidraw::find(device, descriptor.as_deref())?;
    let stage = scenarios::read_stage(scenario)?;
    let mut teleop = TeleopSettings::default();
    teleop.mapping.frame = if frame == "hand" { OperatorFrame::Hand } else { OperatorFrame::World };
    let (bodies, models) = (Vec::new(), stage.models.clone());
    let first = watch.then(|| policy.clone());
    let instruction = stage.scenario.task.instruction.clone();
    let setup =
        SessionSetup { stage, bodies, models, operator: author.clone(), teleop, policy: first, runs: out.clone() };
    let stop = genmanip_terminal::on_interrupt();
    let session = Arc::new(Session::new(json!({}), Arc::clone(&stop)));
    session.attach(TERMINAL);
    printer.say(format!("{instruction}\n{} moves the arm; {LETTERS}", mouse.name()));
    mouse.watch(Arc::clone(&session.inbox), Arc::clone(&stop));
    listen(&session, policy);
    let place = std::thread::scope(|scope| {
        let (running, ended) = channel();
        let told = &*session;
        scope.spawn(move || tell(told, &ended, printer));
        let place = session.run(&setup, |_| ());
        drop(running);
        place
    })?;
    let Some(place) = place else {
        printer.say("nothing was kept");
        return Ok(ExitStatus::NotMet);
    };
    let unread = |error| WorkspaceError::broken("the take cannot be read back", error);
    let result: EpisodeResult =
        EpisodeStore::open(&place.store).and_then(|store| store.read_result(&place.id)).map_err(unread)?;
    let verdict = if result.success { "success" } else { "goal missed" };
    let data = json!({ "store": place.store, "id": place.id, "success": result.success, "source": result.source });
    printer.data(&data, &format!("kept {} in {}: {verdict}", place.id, place.store.display()));
    Ok(ExitStatus::Done)
}

/// Obeys the letters that are typed until the take is kept, in a thread that ends with the program. The end of the input
/// discards the take.
fn listen(session: &Arc<Session>, policy: &str) {
    let (session, policy) = (Arc::clone(session), policy.to_owned());
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            let (phase, has_policy) = {
                let status = session.status.borrow();
                (status.phase, status.policy.is_some())
            };
            match line.trim() {
                "p" if phase == Phase::Paused => session.set_command(TakeCommand::Run),
                "p" => session.set_command(TakeCommand::Pause),
                "b" => session.ask(Request::Back),
                "t" if has_policy => session.ask(Request::TakeOver),
                "t" => session.ask(Request::HandOver(policy.clone())),
                "n" => session.set_command(TakeCommand::Retry),
                "k" => return session.set_command(TakeCommand::Keep),
                "l" => return session.set_command(TakeCommand::KeepTrimmed),
                "x" => session.set_command(TakeCommand::Discard),
                _ => {}
            }
        }
        session.set_command(TakeCommand::Discard);
    });
}

/// Prints the status when it changes in more than its numbers, and every few seconds, until the session has ended.
fn tell(session: &Session, ended: &Receiver<()>, printer: &Printer) {
    let mut told: Option<(Instant, String)> = None;
    while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
        let status = session.status.borrow().clone();
        let state = state(&status);
        if told.as_ref().is_some_and(|(at, before)| *before == state && at.elapsed() < LINE) {
            continue;
        }
        printer.say(format!("{:6.1} s  {state}; {}", status.time_s, numbers(&status)));
        told = Some((Instant::now(), state));
    }
}

/// Words for the side in command, and for the reason why the arm does not move.
fn state(status: &SessionStatus) -> String {
    let in_command = match (&status.note, &status.policy) {
        (Some(note), _) => note.clone(),
        (None, Some(policy)) => format!("{policy} is in command"),
        (None, None) => "you are in command".into(),
    };
    let held = status.held.map_or_else(String::new, |held| {
        let reason = match held {
            Hold::Silence => "no input",
            Hold::Clutch => "clutch",
            Hold::ReleaseFirst => "release the device first",
            Hold::OtherJoints => "the device has other joints",
        };
        format!(", the arm holds: {reason}")
    });
    let phase = match status.phase {
        Phase::Waiting => "waiting",
        Phase::Running => "running",
        Phase::Paused => "paused",
        Phase::Judged if status.success == Some(true) => "success: k keeps it, n begins anew, x discards it",
        Phase::Judged => "goal missed: k keeps it, n begins anew, x discards it",
        Phase::Kept => "kept",
        Phase::Discarded => "discarded",
        Phase::Failed => "failed",
    };
    let gripper = if status.closed { "closed" } else { "open" };
    let (times, cut_s) = status.undone;
    let undone = if times > 0 { format!(", {cut_s:.1} s undone") } else { String::new() };
    format!("take {}, {phase}, {in_command}{held}, gripper {gripper}{undone}", status.take)
}

fn numbers(status: &SessionStatus) -> String {
    let [met, all] = status.conditions;
    let next = status.next.as_ref().map_or_else(String::new, |next| format!(", next: {}", next.text));
    format!("{met} of {all} conditions hold{next}; {} of {} steps late", status.late_steps, status.steps)
}

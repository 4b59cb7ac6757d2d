//! Teleoperation of one scenario: takes in real time, one after the other, until one is kept or all are discarded.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{ObjectModel, Seed};
use genmanip_data::EpisodeStore;
use genmanip_relations::judge_goal;
use genmanip_rollout::{Environment, RolloutError, RolloutSettings, Stage};
use genmanip_teleop::device::Control;
use genmanip_teleop::record::Hold;
use genmanip_teleop::{Status, TeleopSettings, Teleoperation};
use genmanip_workspace::WorkspaceError;
use serde::Serialize;
use tokio::sync::watch;

use super::inbox::{Inbox, MOST_EVENTS, PageSource};
use super::pace::Pace;
use super::take::Take;
use crate::run::playback::{Body, row};
use crate::run::{Place, run_folder_name};

/// Time limit of a take, simulated s.
pub const HORIZON_S: f64 = 300.0;
/// Time without a connection after which a session is discarded.
const ABANDONED: Duration = Duration::from_secs(120);
/// Longest wait before the session looks whether it is cancelled or abandoned.
const LOOK: Duration = Duration::from_millis(100);
/// Control steps between two states for the page.
const STATE_EVERY: usize = 2;
/// Control steps between two verdicts on the goal for the page.
const JUDGE_EVERY: usize = 12;

/// Stage of a session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Waiting for episodes of other jobs.
    #[default]
    Waiting,
    /// The simulation runs in real time.
    Running,
    /// The simulation stands still.
    Paused,
    /// The take is judged, and is to be kept, repeated or discarded.
    Judged,
    /// The take was stored.
    Kept,
    /// All takes were discarded.
    Discarded,
    /// The session has failed.
    Failed,
}

impl Phase {
    /// True if the session has ended.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Kept | Self::Discarded | Self::Failed)
    }
}

/// Command of the person for the take in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TakeCommand {
    /// Goes on.
    Run,
    /// Stands still.
    Pause,
    /// Begins anew; the take is dropped.
    Retry,
    /// Ends the take and stores it.
    Keep,
    /// Ends the session; nothing is stored.
    Discard,
}

/// State of a session, as the page shows it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SessionStatus {
    /// Stage.
    pub phase: Phase,
    /// Number of the take, from 1.
    pub take: usize,
    /// Simulated time of the take, s.
    pub time_s: f64,
    /// Control steps of the take.
    pub steps: usize,
    /// Control steps of the take that began late.
    pub late_steps: usize,
    /// Reason why the deflected device does not move the arm.
    pub held: Option<Hold>,
    /// Limits that slow the tool.
    pub limits: Vec<genmanip_teleop::target::Limit>,
    /// Frame in use.
    pub frame: genmanip_teleop::mapping::OperatorFrame,
    /// True if the gripper is to be closed.
    pub closed: bool,
    /// Force between the robot and anything but the grasped object, N.
    pub contact_n: f64,
    /// Name of the object that both fingers press.
    pub grasped: Option<String>,
    /// Number of conditions of the goal that hold, and of all, of its best alternative.
    pub conditions: [usize; 2],
    /// Next condition that does not hold.
    pub next: Option<Unmet>,
    /// Verdict on the settled take; `None` before it.
    pub success: Option<bool>,
    /// Sequence number of the last message with events.
    pub sequence: Option<u64>,
    /// Time of the page at which it was sent, ms.
    pub sent_ms: f64,
    /// Events dropped for their number or size, and messages out of order.
    pub dropped: u64,
}

/// Condition of the goal that does not hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unmet {
    /// Explanation in words and numbers.
    pub text: String,
    /// Distance of the deciding quantity from its threshold.
    pub distance: f64,
    /// Unit of the distance.
    pub unit: Option<genmanip_core::Unit>,
}

/// Scenario of a session and the place of its takes.
#[derive(Debug)]
pub struct SessionSetup {
    /// The scenario with its simulation.
    pub stage: Stage,
    /// Links of a state, in the order of the scene's message.
    pub bodies: Vec<Body>,
    /// Models of the objects.
    pub models: Vec<Arc<ObjectModel>>,
    /// Name of the person.
    pub operator: String,
    /// Frame of the device, and its camera.
    pub teleop: TeleopSettings,
    /// Folder that the run folders are created in.
    pub runs: PathBuf,
}

/// Teleoperation of one scenario.
#[derive(Debug)]
pub struct Session {
    /// Events of the page.
    pub inbox: Arc<Inbox>,
    /// Newest state of robot and objects, as little-endian 32-bit numbers like those of a playback.
    pub states: watch::Sender<Arc<Vec<u8>>>,
    /// Newest status.
    pub status: watch::Sender<SessionStatus>,
    /// Facts that a page needs about the scenario: instruction, revision, rates, width of a state.
    pub about: serde_json::Value,
    /// True once the job of the session is to be cancelled.
    stop: Arc<AtomicBool>,
    state: Mutex<SessionState>,
    changed: Condvar,
}

#[derive(Debug)]
struct SessionState {
    command: TakeCommand,
    /// Number of the connection that is attached; `None` without one.
    attached: Option<u64>,
    /// Time at which the last connection was lost.
    alone_since: Instant,
}

/// Newest session of each scenario, by key.
#[derive(Debug, Default)]
pub struct Sessions(Mutex<BTreeMap<String, Arc<Session>>>);

impl Sessions {
    /// Newest session of a scenario; `None` without one.
    pub fn newest(&self, key: &str) -> Option<Arc<Session>> {
        self.lock().get(key).cloned()
    }

    /// Adds a session, which replaces the older one of the scenario.
    pub fn add(&self, key: &str, session: &Arc<Session>) {
        self.lock().insert(key.to_owned(), Arc::clone(session));
    }

    // A panic of another thread leaves the values consistent, so a poisoned lock is used.
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Session>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Session {
    /// A session without connection; `stop` cancels it.
    pub fn new(about: serde_json::Value, stop: Arc<AtomicBool>) -> Self {
        let now = Instant::now();
        Self {
            inbox: Arc::new(Inbox::new(now)),
            states: watch::Sender::default(),
            status: watch::Sender::default(),
            about,
            stop,
            state: Mutex::new(SessionState { command: TakeCommand::Run, attached: None, alone_since: now }),
            changed: Condvar::new(),
        }
    }

    /// Attaches a connection; false if there is another one.
    pub fn attach(&self, connection: u64) -> bool {
        let mut state = self.lock();
        if state.attached.is_some_and(|other| other != connection) {
            return false;
        }
        state.attached = Some(connection);
        self.inbox.reconnect();
        true
    }

    /// Detaches a connection: the arm holds and the take pauses.
    pub fn detach(&self, connection: u64) {
        let mut state = self.lock();
        if state.attached != Some(connection) {
            return;
        }
        (state.attached, state.alone_since) = (None, Instant::now());
        self.inbox.reconnect();
        if state.command == TakeCommand::Run {
            state.command = TakeCommand::Pause;
        }
        self.changed.notify_all();
    }

    /// Sets the command of the person. A take that is to be kept cannot be resumed.
    pub fn set_command(&self, command: TakeCommand) {
        let mut state = self.lock();
        if matches!(command, TakeCommand::Run | TakeCommand::Pause)
            && !matches!(state.command, TakeCommand::Run | TakeCommand::Pause)
        {
            return;
        }
        state.command = command;
        self.changed.notify_all();
    }

    /// Runs takes until one is kept; `None` if all were discarded.
    ///
    /// # Errors
    /// If the simulation becomes unstable, or a take cannot be stored.
    pub fn run(&self, setup: &SessionSetup, progress: impl Fn(f64)) -> Result<Option<Place>, WorkspaceError> {
        let scenario = &setup.stage.scenario;
        let root = setup.runs.join(run_folder_name(scenario)).join("evaluation").join("teleop").join("episodes");
        let unwritable = |error| WorkspaceError::broken("the take cannot be stored", error);
        for number in 1.. {
            let store = EpisodeStore::create(&root).map_err(unwritable)?;
            let before = store.ids().map_err(unwritable)?.len();
            let id = if before == 0 { scenario.id.clone() } else { format!("{}+{before}", scenario.id) };
            let take = self.take(setup, &id, Seed::new(before as u64), number, &progress)?;
            let command = match &take {
                Some(take) => self.decision(take.episode.result.success),
                None => self.decided(),
            };
            match (command, take) {
                (TakeCommand::Keep, Some(take)) => {
                    take.store(&store).map_err(unwritable)?;
                    return Ok(Some(Place { store: root, id }));
                }
                (TakeCommand::Discard, _) => return Ok(None),
                _ => {}
            }
            let mut state = self.lock();
            if state.command != TakeCommand::Discard {
                state.command = TakeCommand::Run;
            }
        }
        Ok(None)
    }

    /// Runs one take; `None` if it was dropped.
    fn take(
        &self,
        setup: &SessionSetup,
        id: &str,
        seed: Seed,
        number: usize,
        progress: &impl Fn(f64),
    ) -> Result<Option<Take>, WorkspaceError> {
        let SessionSetup { stage, operator, .. } = setup;
        let now = Instant::now();
        self.inbox.begin_take(now);
        let mut teleop = setup.teleop.clone();
        teleop.input.most_events = MOST_EVENTS;
        let source = PageSource { name: operator.clone(), inbox: Arc::clone(&self.inbox) };
        let status: Arc<Mutex<Status>> = Arc::default();
        let told = Arc::clone(&status);
        let mut policy = Teleoperation::new(teleop, Box::new(source), &stage.robot, &stage.scenario.world)
            .map_err(WorkspaceError::input)?
            .reporting_to(move |now| *told.lock().unwrap_or_else(PoisonError::into_inner) = now.clone());
        let settings = rollout_settings();
        let mut pace = Pace::new(stage.control_rate_hz(), now);
        self.status.send_replace(SessionStatus { phase: Phase::Running, take: number, ..SessionStatus::default() });
        let mut ends = false;
        let mut before_turn = |environment: &Environment| {
            if environment.frames().is_empty() {
                pace.resume(Instant::now());
            }
            let wait = pace.next(Instant::now());
            let command = self.wait(wait, || pace.resume(Instant::now()));
            match command {
                TakeCommand::Retry | TakeCommand::Discard => return Err(dropped()),
                TakeCommand::Keep if !ends => {
                    ends = true;
                    self.inbox.press(Control::Finish);
                }
                _ => {}
            }
            let status = status.lock().unwrap_or_else(PoisonError::into_inner).clone();
            self.show(setup, environment, &settings, status, pace.late())?;
            progress(environment.frames().len() as f64 / stage.control_rate_hz());
            Ok(())
        };
        match Take::run(stage, &mut policy, id, seed, &settings, &mut before_turn) {
            Ok(take) => Ok(Some(take)),
            Err(_) if matches!(self.decided(), TakeCommand::Retry | TakeCommand::Discard) => Ok(None),
            Err(error) => Err(WorkspaceError::broken(format!("the take {id} broke"), error)),
        }
    }

    /// Waits until the next control step is due, and through pauses; the command then.
    fn wait(&self, wait: Duration, resume: impl FnOnce()) -> TakeCommand {
        if !wait.is_zero() {
            std::thread::sleep(wait);
        }
        if self.decided() != TakeCommand::Pause {
            return self.decided();
        }
        self.status.send_modify(|status| status.phase = Phase::Paused);
        let command = self.wait_for(|command| command != TakeCommand::Pause);
        self.inbox.restart(Instant::now());
        resume();
        self.status.send_modify(|status| status.phase = Phase::Running);
        command
    }

    /// Shows the verdict on a take and waits for the decision on it.
    fn decision(&self, success: bool) -> TakeCommand {
        let known = self.decided();
        self.status.send_modify(|status| {
            (status.phase, status.success) = (Phase::Judged, Some(success));
        });
        match known {
            TakeCommand::Run | TakeCommand::Pause => {
                self.wait_for(|command| !matches!(command, TakeCommand::Run | TakeCommand::Pause))
            }
            known => known,
        }
    }

    /// Command in force.
    fn decided(&self) -> TakeCommand {
        let mut state = self.lock();
        self.look(&mut state)
    }

    /// TakeCommand after a look for a cancelled job or a connection that is gone for too long.
    fn look(&self, state: &mut SessionState) -> TakeCommand {
        let is_abandoned = state.attached.is_none() && state.alone_since.elapsed() > ABANDONED;
        if self.stop.load(Ordering::Relaxed) || is_abandoned {
            state.command = TakeCommand::Discard;
        }
        state.command
    }

    /// Waits for a command.
    fn wait_for(&self, is_meant: impl Fn(TakeCommand) -> bool) -> TakeCommand {
        let mut state = self.lock();
        loop {
            let command = self.look(&mut state);
            if is_meant(command) {
                return command;
            }
            state = self.changed.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Sends state and status to the page.
    fn show(
        &self,
        setup: &SessionSetup,
        environment: &Environment,
        settings: &RolloutSettings,
        status: Status,
        late_steps: usize,
    ) -> Result<(), RolloutError> {
        let (stage, frames) = (&setup.stage, environment.frames());
        let steps = frames.len();
        let last = frames.last();
        let time_s = steps as f64 / stage.control_rate_hz();
        if steps.is_multiple_of(STATE_EVERY) {
            let objects = environment.objects()?;
            let opening_m = last.map_or(stage.robot.gripper.max_width, |frame| frame.gripper_width);
            let arm = environment.joint_positions()?;
            let values = row(time_s, &arm, opening_m, &objects, &setup.bodies, &stage.robot, &setup.models);
            let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            self.states.send_replace(Arc::new(bytes));
        }
        let goal = match steps.is_multiple_of(JUDGE_EVERY) {
            true => Some(goal(stage, environment, settings)?),
            false => None,
        };
        let received = self.inbox.received();
        let Status { frame, held, limits, closed } = status;
        self.status.send_modify(|status| {
            (status.time_s, status.steps, status.late_steps) = (time_s, steps, late_steps);
            (status.frame, status.held, status.limits, status.closed) = (frame, held, limits, closed);
            status.contact_n = last.map_or(0.0, |frame| frame.stray_contact_n);
            status.grasped = last.and_then(|frame| frame.grasped).map(|object| stage.name(object).to_owned());
            (status.sequence, status.sent_ms, status.dropped) = (received.sequence, received.sent_ms, received.dropped);
            if let Some((conditions, next)) = goal {
                (status.conditions, status.next) = (conditions, next);
            }
        });
        Ok(())
    }

    // A panic of another thread leaves the values consistent, so a poisoned lock is used.
    fn lock(&self) -> MutexGuard<'_, SessionState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Settings of the episode of a take.
pub fn rollout_settings() -> RolloutSettings {
    RolloutSettings { horizon_s: HORIZON_S, ..RolloutSettings::default() }
}

/// Number of conditions that hold, and of all, of the best alternative; and the next one that does not hold.
fn goal(
    stage: &Stage,
    environment: &Environment,
    settings: &RolloutSettings,
) -> Result<([usize; 2], Option<Unmet>), RolloutError> {
    let objects = environment.objects()?;
    let grasped = environment.frames().last().and_then(|frame| frame.grasped);
    let rest = Stage::rest(&objects, grasped, settings);
    let verdict = judge_goal(&stage.posed(&objects), &stage.goal, &rest, &stage.relations);
    let met = |alternative: &[genmanip_core::AtomVerdict]| alternative.iter().filter(|atom| atom.holds).count();
    let best = verdict.alternatives.iter().max_by_key(|alternative| met(alternative)).map_or(&[][..], Vec::as_slice);
    let next = best.iter().find(|atom| !atom.holds).map(|atom| Unmet {
        text: atom.explanation.clone(),
        distance: atom.margin.abs(),
        unit: atom.measurements.first().map(|measured| measured.unit),
    });
    Ok(([met(best), best.len()], next))
}

/// Error that ends a take which is not wanted any more.
fn dropped() -> RolloutError {
    RolloutError::NotRun { policy: "teleop".into(), reason: "the take was dropped".into(), mistake: false }
}

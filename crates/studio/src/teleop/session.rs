//! Teleoperation of one scenario: takes in real time, one after the other, until one is kept or all are discarded.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{Ending, ObjectModel, Policy, Seed};
use genmanip_data::EpisodeStore;
use genmanip_relations::judge_goal;
use genmanip_rollout::{Environment, RolloutError, RolloutSettings, Stage, run_policy};
use genmanip_teleop::device::Control;
use genmanip_teleop::mapping::OperatorFrame;
use genmanip_teleop::{EpisodeLog, Status, TeleopSettings, Teleoperation};
use genmanip_workspace::WorkspaceError;
use tokio::sync::watch;

use super::deputy::Deputy;
use super::inbox::{Inbox, MOST_EVENTS, PageSource};
use super::live::Live;
use super::pace::Pace;
use super::status::{Phase, Request, SessionStatus, TakeCommand, Unmet};
use super::take::{Take, interrupted};
use super::touch::Touch;
use crate::run::playback::{Body, row};
use crate::run::{Place, run_folder_name};

/// Time limit of a take, simulated s.
pub const HORIZON_S: f64 = 300.0;
/// Simulated time by which a person goes back, s.
pub const BACK_S: f64 = 5.0;
/// Time without a connection after which a session is discarded.
const ABANDONED: Duration = Duration::from_secs(120);
/// Longest wait before the session looks whether it is cancelled or abandoned.
const LOOK: Duration = Duration::from_millis(100);
/// Control steps between two states for the page.
const STATE_EVERY: usize = 2;
/// Control steps between two verdicts on the goal for the page.
const JUDGE_EVERY: usize = 12;

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
    /// Policy that is in command at first, by its name with arguments; `None` for the person.
    pub policy: Option<String>,
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
    /// Request that the take in progress has not met yet.
    request: Option<Request>,
    /// Number of the connection that is attached; `None` without one.
    attached: Option<u64>,
    /// Number of the connection of a program beside the page that sends the events; `None` without one.
    joined: Option<u64>,
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
            state: Mutex::new(SessionState {
                command: TakeCommand::Run,
                request: None,
                attached: None,
                joined: None,
                alone_since: now,
            }),
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

    /// Lets a program beside the page send the events of its device; false if another one does.
    pub fn join(&self, connection: u64) -> bool {
        let mut state = self.lock();
        if state.joined.is_some() {
            return false;
        }
        state.joined = Some(connection);
        self.inbox.join(true);
        true
    }

    /// Gives the events back to the page: the arm holds until its device is released.
    pub fn leave(&self, connection: u64) {
        let mut state = self.lock();
        if state.joined == Some(connection) {
            state.joined = None;
            self.inbox.join(false);
        }
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

    /// Asks for a change of command, or to go back. Without effect once the take has ended.
    pub fn ask(&self, request: Request) {
        let mut state = self.lock();
        if matches!(state.command, TakeCommand::Run | TakeCommand::Pause) {
            state.request = Some(request);
        }
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
                (TakeCommand::Keep | TakeCommand::KeepTrimmed, Some(take)) => {
                    let trimmed = match command {
                        TakeCommand::KeepTrimmed => take.trimmed(&setup.stage, &rollout_settings())?,
                        _ => None,
                    };
                    trimmed.unwrap_or(take).store(&store).map_err(unwritable)?;
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
        let stage = &setup.stage;
        let broke = |error: RolloutError| WorkspaceError::broken(format!("the take {id} broke"), error);
        let now = Instant::now();
        self.inbox.begin_take(now);
        self.lock().request = None;
        let settings = rollout_settings();
        let mut pace = Pace::new(stage.control_rate_hz(), now);
        self.status.send_replace(SessionStatus { phase: Phase::Running, take: number, ..SessionStatus::default() });
        let status: Arc<Mutex<Status>> = Arc::default();
        let touch: RefCell<Option<Touch>> = RefCell::new(None);
        let mut environment = Environment::new(settings.clone());
        environment.reset(stage, seed);
        let before_step = |environment: &Environment| {
            let is_first = environment.frames().is_empty();
            if let Some(touch) = touch.borrow_mut().as_mut()
                && touch.is_felt(&self.inbox.take(Instant::now()))
            {
                self.ask(Request::TakeOver);
            }
            self.before_step(&mut pace, is_first)?;
            let status = status.lock().unwrap_or_else(PoisonError::into_inner).clone();
            self.show(setup, environment, &settings, status, pace.late())?;
            progress(environment.frames().len() as f64 / stage.control_rate_hz());
            Ok(())
        };
        let mut robot = Live::new(environment, Box::new(before_step));
        let first = self.operator(setup, setup.teleop.mapping.frame, &status)?;
        let (mut log, mut frame) = (EpisodeLog::new(&first), first.frame());
        let mut command: Option<Deputy> = setup.policy.clone().map(Deputy::Policy);
        let mut oracle = false;
        let ending = loop {
            let from = robot.environment.frames().len();
            self.status.send_modify(|status| status.policy = command.as_ref().map(|deputy| deputy.name().to_owned()));
            let ended = match &command {
                None => {
                    let mut policy = self.operator(setup, frame, &status)?.starting_at(from);
                    oracle |= policy.spec().privileged;
                    let ended = run_policy(&mut robot, stage, &mut policy, seed, &settings);
                    log.add_operator(&policy, frame, from, robot.environment.frames().len());
                    frame = policy.frame();
                    ended
                }
                Some(deputy) => {
                    let seed = seed.fork_index(log.in_command().len() as u64);
                    let is_planned = matches!(deputy, Deputy::GoTo(_));
                    touch.replace(is_planned.then(|| Touch::new(&setup.teleop.mapping)));
                    let ended = deputy.policy(stage).map(|mut policy| {
                        oracle |= policy.spec().privileged;
                        run_policy(&mut robot, stage, policy.as_mut(), seed, &settings)
                    });
                    touch.take();
                    log.add_policy(deputy.name(), from, robot.environment.frames().len());
                    match ended {
                        Ok(ended) => ended,
                        Err(error) => {
                            let (policy, reason) = (deputy.name().to_owned(), error.to_string());
                            Err(RolloutError::NotRun { policy, reason, mistake: false })
                        }
                    }
                }
            };
            let request = self.lock().request.take();
            match (self.decided(), request, ended) {
                (TakeCommand::Retry | TakeCommand::Discard, ..) => return Ok(None),
                // The person keeps while a policy is in command; otherwise the device's last event ends the stretch.
                (decided, ..) if decided.is_keep() && command.is_some() => break Ending::Finished,
                (_, Some(Request::Back), Err(_)) => {
                    let steps = (BACK_S * stage.control_rate_hz()).round() as usize;
                    log.undo(robot.back(steps).map_err(broke)?);
                    let undone_s = log.undone_steps() as f64 / stage.control_rate_hz();
                    self.status.send_modify(|status| status.undone = (log.record().undone.len(), undone_s));
                    self.pause(None);
                    command = command.filter(|deputy| matches!(deputy, Deputy::Policy(_)));
                    let now = status.lock().unwrap_or_else(PoisonError::into_inner).clone();
                    let late_steps = self.status.borrow().late_steps;
                    self.show(setup, &robot.environment, &settings, now, late_steps).map_err(broke)?;
                }
                (_, Some(Request::HandOver(name)), Err(_)) => command = Some(Deputy::Policy(name)),
                (_, Some(Request::GoTo(goal)), Err(_)) => command = Some(Deputy::GoTo(goal)),
                (_, Some(Request::TakeOver), Err(_)) => command = None,
                (_, _, Ok((Ending::Horizon, _))) => break Ending::Horizon,
                (_, _, Ok((ending, _))) if command.is_none() => break ending,
                (_, _, Ok((_, gave_up))) => {
                    if let Some(note) = command.take().and_then(|deputy| deputy.note(gave_up.as_ref())) {
                        self.pause(Some(note));
                    }
                }
                (_, _, Err(error)) if command.is_some() => {
                    command = None;
                    self.pause(Some(error.to_string()));
                }
                (_, _, Err(error)) => return Err(broke(error)),
            }
            self.inbox.restart(Instant::now());
        };
        let Live { mut environment, .. } = robot;
        Take::finish(&mut environment, log, id, ending, oracle).map(Some).map_err(broke)
    }

    /// The person as a policy, in a frame.
    fn operator(
        &self,
        setup: &SessionSetup,
        frame: OperatorFrame,
        status: &Arc<Mutex<Status>>,
    ) -> Result<Teleoperation, WorkspaceError> {
        let mut teleop = setup.teleop.clone();
        teleop.input.most_events = MOST_EVENTS;
        teleop.mapping.frame = frame;
        let source = PageSource { name: setup.operator.clone(), inbox: Arc::clone(&self.inbox) };
        let told = Arc::clone(status);
        let Stage { robot, scenario, .. } = &setup.stage;
        let policy = Teleoperation::new(teleop, Box::new(source), robot, &scenario.world);
        let policy = policy.map_err(WorkspaceError::input)?;
        Ok(policy.reporting_to(move |now| *told.lock().unwrap_or_else(PoisonError::into_inner) = now.clone()))
    }

    /// Waits for a control step; an error ends the stretch of whoever is in command.
    fn before_step(&self, pace: &mut Pace, is_first: bool) -> Result<(), RolloutError> {
        if is_first {
            pace.resume(Instant::now());
        }
        let wait = pace.next(Instant::now());
        let command = self.wait(wait, || pace.resume(Instant::now()));
        let is_asked = self.lock().request.is_some();
        let has_policy = self.status.borrow().policy.is_some();
        match command {
            TakeCommand::Retry | TakeCommand::Discard => return Err(interrupted()),
            TakeCommand::Keep | TakeCommand::KeepTrimmed if has_policy => return Err(interrupted()),
            TakeCommand::Keep | TakeCommand::KeepTrimmed => self.inbox.press(Control::Finish),
            _ if is_asked => return Err(interrupted()),
            TakeCommand::Run | TakeCommand::Pause => {}
        }
        Ok(())
    }

    /// Pauses the take, with a note for the person.
    fn pause(&self, note: Option<String>) {
        let mut state = self.lock();
        if state.command == TakeCommand::Run {
            state.command = TakeCommand::Pause;
        }
        drop(state);
        self.status.send_modify(|status| status.note = note);
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
        let command = self.wait_for(|state| state.command != TakeCommand::Pause || state.request.is_some());
        self.inbox.restart(Instant::now());
        resume();
        if command != TakeCommand::Pause {
            self.status.send_modify(|status| (status.phase, status.note) = (Phase::Running, None));
        }
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
                self.wait_for(|state| !matches!(state.command, TakeCommand::Run | TakeCommand::Pause))
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

    /// Waits for a command or a request.
    fn wait_for(&self, is_meant: impl Fn(&SessionState) -> bool) -> TakeCommand {
        let mut state = self.lock();
        loop {
            let command = self.look(&mut state);
            if is_meant(&state) {
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
            let world_from_tcp = stage.robot.tcp_pose(&arm);
            self.status.send_modify(|status| status.world_from_tcp = world_from_tcp);
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

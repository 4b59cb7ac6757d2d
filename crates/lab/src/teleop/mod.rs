//! Teleoperation through the real input path: directions and gains, cross-talk, return, latency, faults, and episodes
//! of a scripted operator that are stored and replayed.
//!
//! Poses are commanded tool poses (forward kinematics of the current joint targets) unless stated otherwise. The
//! browser page and its images are not measured: their figures are null.

mod input;
pub(crate) mod script;

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{CameraMount, Pose, Seed, TaskKind};
use genmanip_data::EpisodeStore;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_rollout::{RolloutError, RolloutSettings, Stage};
use genmanip_studio::teleop::{Take, is_replayed};
use genmanip_tasks::designer::{DesignSettings, design_many};
use genmanip_teleop::device::{AXES, DeviceEvent};
use genmanip_teleop::mapping::OperatorFrame;
use genmanip_teleop::scripted::{Habits, ScriptedOperator, VirtualKind};
use genmanip_teleop::{TeleopSettings, Teleoperation};
use genmanip_workspace::{Progress, text_table, worlds};
use rand::RngExt;
use serde::Serialize;

use self::input::{Driven, Events, drive};
use self::script::{Script, placement, script};
use crate::LabError;
use crate::clock::cpu_clock;
use crate::quantile::Spread;

/// Number of control steps of a push: one axis at full deflection.
const PUSH_STEPS: usize = 6;
/// Tolerances of a push: relative error of the gain, and angle between the commanded and the expected direction (rad).
const EXACT: [f64; 2] = [0.01, 0.01];
/// Largest unwanted motion in such a push: translation during a rotation (m), rotation during a translation (rad).
const EXACT_OTHER: [f64; 2] = [1e-4, 2e-3];
/// Number of control steps in which the arm comes to rest after the last event.
const REST_STEPS: usize = 30;
/// Number of control steps simulated after the last event of a fault.
const FAULT_STEPS: usize = 20;
/// Number of events of a flood.
const FLOOD: usize = 10_000;
/// Time limit of an episode of the scripted operator, s.
const HORIZON_S: f64 = 60.0;
/// Maximum number of tasks tried per episode, with one layout each.
const TRIES: u64 = 20;

/// Numbers of episodes and commands, and output folder.
#[derive(Clone, Debug)]
pub struct TeleopArguments {
    /// Number of episodes of the scripted operator.
    pub episodes: usize,
    /// Number of random commands; the second half are the opposites of the first half in reverse order.
    pub commands: usize,
    /// Folder to keep the episodes in; `None` to remove them afterwards.
    pub out: Option<PathBuf>,
}

/// Accuracy, latency and fault handling of teleoperation, and success of the scripted operator.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number of pushes: every device, frame, axis and direction.
    pub axes: usize,
    /// Number of pushes with a wrong direction or gain, or with unwanted motion.
    pub axis_errors: usize,
    /// Largest rotation during pure translations by 0.3 m, degrees.
    pub cross_talk_deg: f64,
    /// Largest displacement during pure rotations by 90 degrees, mm.
    pub cross_talk_mm: f64,
    /// Number of these translations and rotations that were completed, and number of all.
    pub completed: [usize; 2],
    /// Largest distance between measured and commanded tool position during these motions, mm.
    pub lag_mm_max: f64,
    /// Largest distance from the start during the random commands, mm.
    pub there_mm: f64,
    /// Distance from the start after the random commands and their opposites, mm.
    pub return_mm: f64,
    /// Angle between the orientations at the start and after these commands, degrees.
    pub return_deg: f64,
    /// Largest distance between measured and commanded tool position at rest, mm.
    pub measured_off_mm: f64,
    /// Largest angle between measured and commanded tool orientation at rest, degrees.
    pub measured_off_deg: f64,
    /// 95th percentile of the simulated time from an event to the start of the first control step whose command it
    /// changes, ms.
    pub input_to_command_ms_p95: f64,
    /// 95th percentile of the time from an event to the image that shows it, ms; always `None`, without a page.
    pub input_to_image_ms_p95: Option<f64>,
    /// Number of images per second; always `None`, without a page.
    pub images_per_s: Option<f64>,
    /// Longest simulated time from a device's last event until the commanded pose stays constant, over all faults, ms.
    pub hold_ms_max: f64,
    /// Number of control steps of the episodes that took more wall-clock time than they last in the simulation.
    pub late_steps: usize,
    /// Number of control steps of the episodes.
    pub steps: usize,
    /// Number of episodes of the scripted operator.
    pub episodes: usize,
    /// Number of stored episodes whose commands and whose raw events both replay to the same states, bit for bit.
    pub replay_equal: usize,
    /// Number of episodes in which the operator lifted the object.
    pub picked: usize,
    /// Number of episodes whose goal holds after settling.
    pub succeeded: usize,
    /// Results by device.
    pub devices: Vec<DeviceReport>,
    /// Limitations of the measurement, for people.
    pub notes: Vec<&'static str>,
    /// CPU time of the measurement, s.
    pub cpu_s: f64,
}

/// Results of the episodes of one device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceReport {
    /// Name of the virtual device.
    pub device: &'static str,
    /// Number of episodes with this device.
    pub episodes: usize,
    /// Number of episodes in which the operator lifted the object.
    pub picked: usize,
    /// Number of episodes whose goal holds after settling.
    pub succeeded: usize,
    /// Simulated duration of the episodes, s.
    pub duration_s: Spread,
}

/// Limitations of the measurement, for people.
const NOTES: [&str; 4] = [
    "input_to_image_ms_p95 and images_per_s are null: they take the page in a browser, which is not started here",
    "devices are virtual: HID reports by their descriptor, gamepad states and key events go in where a device's would",
    "input_to_command_ms_p95 is simulated time; late_steps counts control steps computed in more time than they last",
    "the operator is scripted and reads the pose of the object from the simulator (oracle)",
];

/// Measures in scenes of designed tasks; one thread.
///
/// # Errors
/// If a scene cannot be laid out, an episode raises an error, or a file cannot be written.
pub fn measure(arguments: &TeleopArguments, seed: Seed, progress: &dyn Progress) -> Result<Report, LabError> {
    let mut clock = cpu_clock();
    let settings = PipelineSettings::in_world((*default_world()).clone());
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    progress.begin("laying out scenes", arguments.episodes.max(1));
    let mut cases = Vec::new();
    for number in 0..arguments.episodes.max(1) {
        cases.push(case(number, resources, &settings, seed)?);
        progress.advance();
    }
    progress.end();
    let Some((stage, _)) = cases.first() else { return Err(LabError::input("no scene")) };
    let axes = axes(stage, seed, progress)?;
    let cross = cross_talk(stage)?;
    let returned = there_and_back(stage, arguments.commands, seed)?;
    let hold_ms_max = faults(stage)?;
    let rest = [cross.rest, returned.rest];
    let operated = operated(&cases[..arguments.episodes.min(cases.len())], arguments, seed, progress)?;
    let count = |of: fn(&DeviceReport) -> usize| operated.devices.iter().map(of).sum();
    Ok(Report {
        axes: axes.pushes,
        axis_errors: axes.errors,
        cross_talk_deg: cross.turn_rad.to_degrees(),
        cross_talk_mm: cross.way_m * 1e3,
        completed: cross.completed,
        lag_mm_max: cross.lag_m * 1e3,
        there_mm: returned.there_m * 1e3,
        return_mm: returned.off_m * 1e3,
        return_deg: returned.off_rad.to_degrees(),
        measured_off_mm: rest.iter().map(|rest| rest[0]).fold(0.0, f64::max) * 1e3,
        measured_off_deg: rest.iter().map(|rest| rest[1]).fold(0.0, f64::max).to_degrees(),
        input_to_command_ms_p95: Spread::of(axes.latencies_s).p95 * 1e3,
        input_to_image_ms_p95: None,
        images_per_s: None,
        hold_ms_max,
        late_steps: operated.late_steps,
        steps: operated.steps,
        episodes: arguments.episodes,
        replay_equal: operated.replay_equal,
        picked: count(|device| device.picked),
        succeeded: count(|device| device.succeeded),
        devices: operated.devices,
        notes: NOTES.to_vec(),
        cpu_s: clock(),
    })
}

/// Stage and script of an episode: a designed pick and place *on* or *in*, laid out at random.
fn case(
    number: usize,
    resources: Resources,
    settings: &PipelineSettings,
    seed: Seed,
) -> Result<(Stage, Script), LabError> {
    let seed = seed.fork("case").fork_index(number as u64);
    for attempt in 0..TRIES {
        let seed = seed.fork_index(attempt);
        let cards = Catalogue::builtin().cards();
        let batch = design_many(&[TaskKind::PickAndPlace], 1, cards, seed, &DesignSettings::default())
            .map_err(|error| LabError::broken("the designer gave up", error))?;
        let task = batch.tasks.into_iter().find(|task| placement(&task.goal).is_some());
        let Some(task) = task else { continue };
        let laid_out = Attempt { task: &task, number: number as u64, seed };
        // Another task if this one has no layout or no grasp from above.
        let Ok(scenario) = laid_out.scenario(resources, &settings.world, &settings.layout) else { continue };
        let stage = Stage::open(Arc::new(scenario), resources.catalogue, resources.planner.robot())
            .map_err(|error| LabError::broken(format!("scene {number} cannot be opened"), error))?;
        if let Some(script) = script(&stage, GraspLibrary::builtin()) {
            return Ok((stage, script));
        }
    }
    Err(LabError::input(format!("no scene {number} with a pick from above in {TRIES} tasks"))
        .with_hint("take another seed"))
}

/// Default settings with this frame of reference; for the frame of a camera, with the camera's name.
fn in_frame(frame: OperatorFrame, camera: Option<&str>) -> TeleopSettings {
    let mut settings = TeleopSettings { camera: camera.map(str::to_owned), ..TeleopSettings::default() };
    settings.mapping.frame = frame;
    settings
}

fn unit(axis: usize, sign: f64) -> [f64; AXES] {
    std::array::from_fn(|at| if at == axis { sign } else { 0.0 })
}

#[derive(Default)]
struct AxesMeasured {
    pushes: usize,
    errors: usize,
    latencies_s: Vec<f64>,
}

/// Pushes every axis of every device in both directions and in every frame, and compares each motion with the expected
/// one.
fn axes(stage: &Stage, seed: Seed, progress: &dyn Progress) -> Result<AxesMeasured, LabError> {
    let world = &stage.scenario.world;
    let tool = stage.robot.tcp_pose(world.robot.start());
    let period_s = 1.0 / stage.control_rate_hz();
    let mut frames = vec![
        (OperatorFrame::World, None, [DVec3::X, DVec3::Y, DVec3::Z]),
        (OperatorFrame::Hand, None, [DVec3::Z, DVec3::NEG_Y, DVec3::X].map(|axis| tool.rotation * axis)),
    ];
    for camera in &world.cameras {
        let world_from_camera = match camera.mount {
            CameraMount::World => camera.mount_from_camera,
            CameraMount::Hand => tool * stage.robot.hand_from_tcp.inverse() * camera.mount_from_camera,
        };
        // Forward is into the image, left and up as in the image.
        let seen = [DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y].map(|axis| world_from_camera.rotation * axis);
        if ["static", "wrist"].contains(&camera.name.as_str()) {
            frames.push((OperatorFrame::Camera, Some(camera.name.as_str()), seen));
        }
    }
    let mut rng = seed.fork("arrival").rng();
    let mut measured = AxesMeasured::default();
    progress.begin("pushing", VirtualKind::ALL.len() * frames.len());
    for kind in VirtualKind::ALL {
        for (frame, camera, directions) in &frames {
            let settings = in_frame(*frame, *camera);
            for axis in 0..AXES {
                for sign in [1.0, -1.0] {
                    let mut events = Events::new(kind);
                    for step in 1..=PUSH_STEPS {
                        events.act(step, &unit(axis, sign), &[]);
                    }
                    events.act(PUSH_STEPS + 1, &[0.0; AXES], &[]);
                    let driven = drive(stage, &settings, events, PUSH_STEPS + 3)?;
                    let speed = if axis < 3 { settings.mapping.linear_m_s } else { settings.mapping.angular_rad_s };
                    let wanted = directions[axis % 3] * (sign * speed * PUSH_STEPS as f64 * period_s);
                    measured.pushes += 1;
                    measured.errors += usize::from(!is_exact(&driven, axis < 3, wanted));
                    // The first event arrived at some time in the control step before.
                    let waited_s = rng.random_range(0.0..1.0) * period_s;
                    let first = driven.commanded.windows(2).position(is_moving);
                    measured.latencies_s.push(waited_s + first.map_or(f64::INFINITY, |first| first as f64 * period_s));
                }
            }
            progress.advance();
        }
    }
    progress.end();
    Ok(measured)
}

/// True if the commanded tool moves by more than the rounding of joint targets between two control steps.
fn is_moving(pair: &[Pose]) -> bool {
    pair[0].position.distance(pair[1].position) > 1e-6 || pair[0].angle_to(&pair[1]) > 1e-5
}

/// True if a run's commanded motion is `wanted` within the tolerances: a translation (m), or a rotation vector (rad).
fn is_exact(driven: &Driven, is_translation: bool, wanted: DVec3) -> bool {
    let (start, end) = Driven::ends(&driven.commanded);
    let way = end.position - start.position;
    let turn = rotation_vector(end.rotation * start.rotation.inverse());
    let (got, other, most) = match is_translation {
        true => (way, turn.length(), EXACT_OTHER[1]),
        false => (turn, way.length(), EXACT_OTHER[0]),
    };
    let (gain, angle_rad) = ((got.length() / wanted.length() - 1.0).abs(), got.angle_between(wanted));
    gain <= EXACT[0] && angle_rad <= EXACT[1] && other <= most
}

/// Rotation vector (axis times angle, rad) with an angle of at most π.
fn rotation_vector(rotation: DQuat) -> DVec3 {
    if rotation.w < 0.0 { (-rotation).to_scaled_axis() } else { rotation.to_scaled_axis() }
}

#[derive(Default)]
struct CrossTalk {
    turn_rad: f64,
    way_m: f64,
    completed: [usize; 2],
    /// Largest distance of the measured tool from the commanded one, m.
    lag_m: f64,
    /// Largest distance (m) and angle (rad) of the measured tool from the commanded one at rest.
    rest: [f64; 2],
}

/// Pure translations by 0.3 m and pure rotations by 90 degrees, from the start, in every direction of the world.
///
/// Motions that end early at a limit of the arm or of the workspace contribute their cross-talk and lag, but do not
/// count as completed.
fn cross_talk(stage: &Stage) -> Result<CrossTalk, LabError> {
    let settings = in_frame(OperatorFrame::World, None);
    let period_s = 1.0 / stage.control_rate_hz();
    let mut found = CrossTalk::default();
    for axis in 0..AXES {
        for sign in [1.0, -1.0] {
            let (amount, speed) = match axis < 3 {
                true => (0.3, settings.mapping.linear_m_s),
                false => (std::f64::consts::FRAC_PI_2, settings.mapping.angular_rad_s),
            };
            let pushes = (amount / (speed * period_s)).ceil() as usize;
            let mut events = Events::new(VirtualKind::SpaceMouse);
            for step in 1..=pushes {
                events.act(step, &unit(axis, sign), &[]);
            }
            events.act(pushes + 1, &[0.0; AXES], &[]);
            let driven = drive(stage, &settings, events, pushes + 1 + REST_STEPS)?;
            let (way_m, turn_rad) = driven.largest_motion();
            let did = if axis < 3 { way_m } else { turn_rad };
            let pairs = driven.commanded.iter().zip(driven.measured.iter().skip(1));
            let lags = pairs.map(|(commanded, measured)| commanded.position.distance(measured.position));
            found.lag_m = lags.fold(found.lag_m, f64::max);
            found.completed[0] += usize::from(did >= amount * 0.999);
            found.completed[1] += 1;
            match axis < 3 {
                true => found.turn_rad = found.turn_rad.max(turn_rad),
                false => found.way_m = found.way_m.max(way_m),
            }
            if did >= amount * 0.999 {
                let off = at_rest(&driven);
                found.rest = [found.rest[0].max(off[0]), found.rest[1].max(off[1])];
            }
        }
    }
    Ok(found)
}

/// Distance (m) and angle (rad) of the measured tool from the commanded one at the end.
fn at_rest(driven: &Driven) -> [f64; 2] {
    let ((_, commanded), (_, measured)) = (Driven::ends(&driven.commanded), Driven::ends(&driven.measured));
    [commanded.position.distance(measured.position), commanded.angle_to(&measured)]
}

/// Result of random commands followed by their opposites.
struct Returned {
    /// Largest distance from the start, m.
    there_m: f64,
    /// Distance from the start at the end, m.
    off_m: f64,
    /// Angle from the start at the end, rad.
    off_rad: f64,
    /// Distance (m) and angle (rad) of the measured tool from the commanded one at rest.
    rest: [f64; 2],
}

/// Random commands of a SpaceMouse in the frame of the hand, then their opposites in reverse order.
fn there_and_back(stage: &Stage, commands: usize, seed: Seed) -> Result<Returned, LabError> {
    let settings = in_frame(OperatorFrame::Hand, None);
    let mut rng = seed.fork("there and back").rng();
    let half = commands / 2;
    // Independent deflections stay near the start, as a random walk does; the speed limit is not reached.
    let there: Vec<[f64; AXES]> = (0..half).map(|_| std::array::from_fn(|_| rng.random_range(-0.6..=0.6))).collect();
    let back = there.iter().rev().map(|axes| axes.map(|axis: f64| -axis));
    let mut events = Events::new(VirtualKind::SpaceMouse);
    for (step, axes) in there.iter().copied().chain(back).enumerate() {
        events.act(step + 1, &axes, &[]);
    }
    events.act(2 * half + 1, &[0.0; AXES], &[]);
    let driven = drive(stage, &settings, events, 2 * half + 1 + REST_STEPS)?;
    let (start, end) = Driven::ends(&driven.commanded);
    Ok(Returned {
        there_m: driven.largest_motion().0,
        off_m: start.position.distance(end.position),
        off_rad: start.angle_to(&end),
        rest: at_rest(&driven),
    })
}

/// Fault of a device while it moves the arm; no event follows it.
enum Fault {
    Silence,
    /// [`FLOOD`] events in one control step.
    Flood,
    Event(DeviceEvent),
}

/// Longest simulated time from a device's last event until the commanded pose stays constant, over all devices and
/// faults, ms.
fn faults(stage: &Stage) -> Result<f64, LabError> {
    let settings = in_frame(OperatorFrame::World, None);
    let period_ms = 1e3 / stage.control_rate_hz();
    let mut longest_ms: f64 = 0.0;
    for kind in VirtualKind::ALL {
        for fault in
            [Fault::Silence, Fault::Flood, Fault::Event(DeviceEvent::Disconnected), Fault::Event(DeviceEvent::Blurred)]
        {
            let mut events = Events::new(kind);
            for step in 1..=PUSH_STEPS {
                events.act(step, &unit(2, 1.0), &[]);
            }
            match fault {
                Fault::Silence => {}
                Fault::Event(event) => events.push(PUSH_STEPS + 1, event),
                Fault::Flood => {
                    let before = events.len();
                    while events.len() < before + FLOOD {
                        events.act(PUSH_STEPS + 1, &unit(2, 1.0), &[]);
                    }
                }
            }
            let last = events.last_step();
            let driven = drive(stage, &settings, events, last + FAULT_STEPS)?;
            let moved = driven.commanded.windows(2).rposition(is_moving);
            let hold = moved.map_or(0, |moved| moved + 2);
            // In the worst case the event arrived at the start of the control step before the one that it changed
            // first.
            longest_ms = longest_ms.max((hold as f64 - (last as f64 - 1.0)) * period_ms);
        }
    }
    Ok(longest_ms)
}

#[derive(Default)]
struct Operated {
    devices: Vec<DeviceReport>,
    late_steps: usize,
    steps: usize,
    replay_equal: usize,
}

/// Episodes of the scripted operator, the devices in turn; stored, read back and replayed.
fn operated(
    cases: &[(Stage, Script)],
    arguments: &TeleopArguments,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Operated, LabError> {
    let temporary = std::env::temp_dir().join(format!("genmanip-lab-teleop-{}", std::process::id()));
    let folder = arguments.out.as_ref().unwrap_or(&temporary);
    let store = EpisodeStore::create(folder).map_err(|error| LabError::broken("episodes cannot be stored", error))?;
    let mut operated = Operated::default();
    progress.begin("operating", cases.len());
    for kind in VirtualKind::ALL {
        let mut report =
            DeviceReport { device: kind.name(), episodes: 0, picked: 0, succeeded: 0, duration_s: Spread::default() };
        let mut durations = Vec::new();
        let own =
            cases.iter().enumerate().filter(|(number, _)| VirtualKind::ALL[number % VirtualKind::ALL.len()] == kind);
        for (number, (stage, script)) in own {
            let id = format!("{}-{number:03}", kind.name());
            let episode = episode(stage, script, kind, &id, seed.fork("operator").fork_index(number as u64), &store)?;
            report.episodes += 1;
            report.picked += usize::from(episode.picked);
            report.succeeded += usize::from(episode.succeeded);
            durations.push(episode.duration_s);
            operated.late_steps += episode.late_steps;
            operated.steps += episode.steps;
            operated.replay_equal += usize::from(is_replayed(stage, &store, &id, &rollout_settings())?);
            progress.advance();
        }
        report.duration_s = Spread::of(durations);
        operated.devices.push(report);
    }
    progress.end();
    if arguments.out.is_none() {
        // Best effort: a folder that cannot be removed lies in the system's temporary folder.
        let _ = fs::remove_dir_all(&temporary);
    }
    Ok(operated)
}

struct Outcome {
    picked: bool,
    succeeded: bool,
    duration_s: f64,
    late_steps: usize,
    steps: usize,
}

fn rollout_settings() -> RolloutSettings {
    // A SpaceNavigator has no button to end the episode.
    RolloutSettings { horizon_s: HORIZON_S, stop_on_success: true, ..RolloutSettings::default() }
}

/// Runs and stores an episode of the scripted operator.
fn episode(
    stage: &Stage,
    script: &Script,
    kind: VirtualKind,
    id: &str,
    seed: Seed,
    store: &EpisodeStore,
) -> Result<Outcome, LabError> {
    let settings = TeleopSettings::default();
    let period_s = 1.0 / stage.control_rate_hz();
    let waypoints = script.waypoints.clone();
    let operator = ScriptedOperator::new(kind, waypoints, Habits::default(), settings.mapping.clone(), period_s);
    let mut policy = Teleoperation::new(settings, Box::new(operator), &stage.robot, &stage.scenario.world)
        .map_err(LabError::input)?;
    let (mut last, mut late_steps): (Option<Instant>, usize) = (None, 0);
    let mut before_turn = |_: &genmanip_rollout::Environment| {
        let now = Instant::now();
        late_steps += usize::from(last.is_some_and(|last| (now - last).as_secs_f64() > period_s));
        last = Some(now);
        Ok(())
    };
    let broke = |error: RolloutError| LabError::broken(format!("episode {id} broke"), error);
    let take = Take::run(stage, &mut policy, id, seed, &rollout_settings(), &mut before_turn).map_err(broke)?;
    take.store(store).map_err(|error| LabError::broken("an episode cannot be stored", error))?;
    let episode = take.episode;
    let height = |frame: &genmanip_core::Frame| frame.objects[script.object].pose.position.z;
    let first_m = episode.frames.first().map_or(0.0, height);
    let is_lifted =
        |frame: &genmanip_core::Frame| frame.grasped == Some(script.object) && height(frame) > first_m + 0.05;
    Ok(Outcome {
        picked: episode.frames.iter().any(is_lifted),
        succeeded: episode.result.success,
        duration_s: episode.result.duration_s,
        late_steps,
        steps: episode.frames.len(),
    })
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let rows = [
        ("axis errors", format!("{} of {}", report.axis_errors, report.axes)),
        ("cross-talk of 0.3 m", format!("{:.4} degrees", report.cross_talk_deg)),
        ("cross-talk of 90 degrees", format!("{:.4} mm", report.cross_talk_mm)),
        ("completed", format!("{} of {}", report.completed[0], report.completed[1])),
        ("there and back", format!("{:.4} mm, {:.4} degrees", report.return_mm, report.return_deg)),
        ("lag in motion", format!("{:.1} mm", report.lag_mm_max)),
        ("farthest in between", format!("{:.0} mm", report.there_mm)),
        ("measured at rest", format!("{:.2} mm, {:.3} degrees", report.measured_off_mm, report.measured_off_deg)),
        ("input to command, p95", format!("{:.1} ms", report.input_to_command_ms_p95)),
        ("hold", format!("{:.0} ms", report.hold_ms_max)),
        ("late steps", format!("{} of {}", report.late_steps, report.steps)),
        ("replayed", format!("{} of {}", report.replay_equal, report.episodes)),
        ("picked", format!("{} of {}", report.picked, report.episodes)),
        ("succeeded", format!("{} of {}", report.succeeded, report.episodes)),
    ];
    let table = text_table(&rows.map(|(what, value)| vec![what.to_owned(), value]));
    let notes: String = report.notes.iter().map(|note| format!("\n{note}")).collect();
    format!("{table}{notes}")
}

//! One episode of a policy on an arm, recorded in a run folder.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};

use genmanip_core::{
    CameraRequest, Ending, Episode, EpisodeResult, ExpertStyle, Failure, FailureCause, GoalVerdict, ImageChannels, Seed,
};
use genmanip_data::images::{CameraTrack, TrackRecorder};
use genmanip_data::store::{Attachment, EpisodeStore};
use genmanip_data::video::VideoSettings;
use genmanip_motion::Planner;
use genmanip_real::bridge::client::{ArmClient, ClientSettings, Tally, TcpConnection};
use genmanip_rollout::ahead::{ChunkReport, can_ask_ahead, run_ahead};
use genmanip_rollout::collect::{PipelineSettings, Resources};
use genmanip_rollout::images::ImageSettings;
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, run_policy};
use genmanip_workspace::{Tasks, WorkspaceError, worlds};
use serde::{Deserialize, Serialize};

use super::alongside::{Alongside, Eyes, Images};
use super::arm::{ArmSettings, DryReport, RealArm};
use super::cameras::Rig;
use super::points::{PointJudge, PointVerdict, is_shown, moment};
use crate::folder::{Run, RunFolder};
use crate::policies::{PolicyContext, PolicyFactory};

/// Name of the file beside an episode that only real episodes have.
const FILE: &str = "real.json";

/// Request for an episode on an arm.
#[derive(Clone, Debug)]
pub struct RealRequest {
    /// Address of the bridge.
    pub url: String,
    /// Time limits, speed and workspace box.
    pub client: ClientSettings,
    /// Sources of the images.
    pub rig: Rig,
    /// Time limit and dry run.
    pub arm: ArmSettings,
    /// Seed of the policy.
    pub seed: Seed,
    /// Recorded images per second; 0 for none.
    pub fps: u32,
    /// True to request the next chunk of actions while the present one is executed, of policies that allow it.
    pub ahead: bool,
    /// Scenario with the objects that lie in front of the arm, to judge the goal by images; `None` to leave it to a person.
    pub judged: Option<Stage>,
}

/// Episode on an arm, before a person judged it.
#[derive(Debug)]
pub struct RealRun {
    episode: Episode,
    tracks: Vec<CameraTrack>,
    /// Facts that only a real episode has.
    pub facts: RealFacts,
}

/// Facts that only a real episode has, as stored beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RealFacts {
    /// Name of the robot behind the bridge.
    pub robot: String,
    /// Settings of the client.
    pub client: ClientSettings,
    /// Counts of commands, refusals and stops.
    pub tally: Tally,
    /// Time of each frame's measurement on the bridge's clock, s.
    pub measured_s: Vec<f64>,
    /// Counts of chunks of actions that were requested ahead; absent if none were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chunks: Option<ChunkReport>,
    /// Verdict on the images of the cameras; absent if it was not asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points: Option<PointVerdict>,
    /// Judgement of a person; absent if nobody judged the episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judgement: Option<Judgement>,
}

/// Judgement of a person on an episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judgement {
    /// True if the task was done.
    pub success: bool,
    /// Remarks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
}

/// Outcome of a request.
#[derive(Debug)]
pub enum Outcome {
    /// An episode to be judged and stored.
    Episode(Box<RealRun>),
    /// Findings of a dry run.
    Dry(DryReport),
}

/// Runs one episode of a policy on the arm behind a bridge; the stage gives robot, cameras and instruction, and has no
/// objects.
///
/// The arm stops when `dead_man` becomes false. Whatever ends the episode, what was recorded is returned.
///
/// # Errors
/// If the bridge cannot be reached, or the policy cannot act on a real arm.
pub fn run(
    request: &RealRequest,
    stage: &Stage,
    policy: &PolicyFactory,
    dead_man: &Arc<AtomicBool>,
) -> Result<Outcome, WorkspaceError> {
    let settings = PipelineSettings {
        rollout: RolloutSettings { horizon_s: request.arm.horizon_s, ..RolloutSettings::default() },
        ..PipelineSettings::in_world(stage.scenario.world.clone())
    };
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let mut actor = actor(policy, stage, &planner, &settings)?;
    let spec = actor.spec();
    if spec.privileged {
        return Err(WorkspaceError::input(format!(
            "policy `{}` reads simulator truth, which a real arm lacks",
            policy.label()
        ))
        .with_hint(
            "choose a policy that acts on observations, such as a learned or remote one, or the agent with a model",
        ));
    }
    if request.judged.as_ref().is_some_and(|judged| !is_shown(&judged.goal)) {
        return Err(WorkspaceError::input("the goal asks for the state of a joint, which point clouds do not show")
            .with_hint("judge the episode yourself, with --success and --notes or when you are asked"));
    }
    let client = connect(request, dead_man)?;
    let robot = client.welcome().robot.clone();
    let arm = RealArm::new(client, stage, request.arm.clone(), request.rig.clone()).map_err(stopped)?;
    let every = (stage.control_rate_hz() / f64::from(request.fps.max(1))).round() as usize;
    let has_images = request.fps > 0 && !request.arm.dry_run && !stage.scenario.world.cameras.is_empty();
    let recorder = has_images.then(|| Recorder::start(request, stage)).transpose()?;
    let (mut arm, recorded) = match recorder {
        Some(Recorder { shutter, thread }) => {
            let watched = arm.watched(move |frame| {
                if frame.is_multiple_of(every.max(1)) {
                    // The recorder may have failed; the arm goes on, and the error is reported at the end.
                    let _ = shutter.send(());
                }
            });
            (watched, Some(thread))
        }
        None => (arm, None),
    };
    let judge = match &request.judged {
        Some(judged) if !request.arm.dry_run => {
            let first = moment(&mut arm, judged).map_err(stopped)?;
            Some(PointJudge::begin(judged, first).map_err(stopped)?)
        }
        _ => None,
    };
    let mut chunks = None;
    let acted = if request.ahead && can_ask_ahead(&spec) && !request.arm.dry_run {
        let report = chunks.insert(ChunkReport::default());
        let mut alongside = Alongside::new(actor, eyes(request, stage, &spec.cameras)?);
        run_ahead(&mut arm, stage, &spec, &mut alongside, request.seed, &settings.rollout, report)
    } else {
        run_policy(&mut arm, stage, actor.as_mut(), request.seed, &settings.rollout)
    };
    let (ending, mut gave_up) = match acted {
        Ok(acted) => acted,
        Err(error @ RolloutError::Robot(_)) => {
            (Ending::GaveUp, Some(Failure { cause: FailureCause::Policy, evidence: error.to_string() }))
        }
        Err(error) => return Err(stopped(error)),
    };
    if gave_up.is_none()
        && !request.arm.dry_run
        && dead_man.load(Ordering::Relaxed)
        && let Err(error) = arm.hold(settings.rollout.settle_s)
    {
        gave_up = Some(Failure { cause: FailureCause::Policy, evidence: error.to_string() });
    }
    let released = arm.release();
    if request.arm.dry_run {
        return Ok(Outcome::Dry(arm.dry_report().clone()));
    }
    let points = match judge {
        Some(judge) => match moment(&mut arm, judge.stage()) {
            Ok(last) => Some(judge.judge(last)),
            Err(error) => {
                gave_up.get_or_insert(Failure { cause: FailureCause::Policy, evidence: error.to_string() });
                None
            }
        },
        None => None,
    };
    if let Err(error) = released {
        gave_up.get_or_insert(Failure { cause: FailureCause::Policy, evidence: error.to_string() });
    }
    let facts = RealFacts {
        robot,
        client: request.client.clone(),
        tally: arm.client().tally().clone(),
        measured_s: arm.stamps_s().to_vec(),
        chunks,
        points,
        judgement: None,
    };
    let unreachable = arm.unreachable();
    let frames = arm.into_frames();
    let tracks = recorded.map_or(Ok(Vec::new()), |thread| thread.join().unwrap_or_else(|_| Err("it panicked".into())));
    let tracks = tracks.map_err(|why| WorkspaceError::input(format!("the images could not be recorded: {why}")))?;
    let path = frames.windows(2).map(|pair| (pair[1].tcp.position - pair[0].tcp.position).length()).sum();
    let result = EpisodeResult {
        id: String::new(),
        scenario_id: stage.scenario.id.clone(),
        task_id: stage.scenario.task.id.clone(),
        policy: policy.label().into(),
        oracle: false,
        seed: request.seed,
        success: false,
        success_once: false,
        verdict: GoalVerdict { score: 0.0, success: false, alternatives: Vec::new() },
        ending: Some(ending),
        failures: gave_up.into_iter().collect(),
        agent_failure: None,
        duration_s: frames.len() as f64 / stage.control_rate_hz(),
        horizon_s: request.arm.horizon_s,
        control_rate_hz: stage.control_rate_hz(),
        frames: frames.len(),
        unreachable_actions: unreachable,
        tcp_path_m: path,
        max_stray_contact_n: 0.0,
        stray_contact: None,
        world_hashes: Some(stage.scenario.world.hashes()),
        cloud: facts.points.as_ref().map(|points| points.verdict.clone()),
        other_request_success: None,
        correction: None,
        expert: ExpertStyle::Default,
        source: None,
        engine: format!("bridge to {}", facts.robot),
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
    };
    let episode = Episode {
        scenario: (*stage.scenario).clone(),
        result,
        initial_state: Vec::new(),
        final_state: Vec::new(),
        frames,
    };
    Ok(Outcome::Episode(Box::new(RealRun { episode, tracks, facts })))
}

/// Store of a run folder for the episodes of one task in one world, begun or continued.
///
/// # Errors
/// When the folder holds another run, or cannot be written.
pub fn open_store(folder: &Path, stage: &Stage) -> Result<EpisodeStore, WorkspaceError> {
    let scenario = &stage.scenario;
    let tasks = Tasks::spool([scenario.task.clone()], &std::env::temp_dir())?;
    let settings = PipelineSettings {
        images: Some(ImageSettings {
            cameras: scenario.world.cameras.iter().map(|camera| camera.name.clone()).collect(),
            ..ImageSettings::default()
        }),
        ..PipelineSettings::in_world(scenario.world.clone())
    };
    RunFolder::begin(folder, &Run::new(tasks, 1, settings, Seed::new(0)))?.store()
}

impl RealRun {
    /// Result before the judgement.
    pub fn result(&self) -> &EpisodeResult {
        &self.episode.result
    }

    /// Stores the episode, with its judgement; its id is the next free number.
    ///
    /// # Errors
    /// When the store cannot be written.
    pub fn store(
        mut self,
        store: &EpisodeStore,
        judgement: Option<Judgement>,
    ) -> Result<EpisodeResult, WorkspaceError> {
        let broken = |error| WorkspaceError::broken("the episode cannot be stored", error);
        let free = (0..).map(|number| format!("real-{number:04}")).find(|id| !store.has_folder(id));
        let result = &mut self.episode.result;
        result.id = free.unwrap_or_default();
        // A person's judgement stands above that of the images.
        let by_images = self.facts.points.as_ref();
        let is_done = match &judgement {
            Some(judgement) => judgement.success,
            None => by_images.is_some_and(|points| points.verdict.success),
        };
        (result.success, result.success_once) = (is_done, is_done);
        result.verdict.success = is_done;
        result.verdict.score = f64::from(u8::from(is_done));
        match &judgement {
            _ if is_done => result.failures.clear(),
            Some(judgement) => {
                let evidence = match judgement.notes.as_str() {
                    "" => "a person judged the task as not done".to_owned(),
                    notes => format!("a person judged the task as not done: {notes}"),
                };
                result.failures.push(Failure { cause: FailureCause::GoalMissed, evidence });
            }
            None => {
                let evidence = by_images.map_or_else(|| "nobody judged the episode".into(), PointVerdict::text);
                result.failures.push(Failure { cause: FailureCause::GoalMissed, evidence });
            }
        }
        self.facts.judgement = judgement;
        let bytes = serde_json::to_vec_pretty(&self.facts)
            .map_err(|error| WorkspaceError::input("the facts cannot be written").because(error))?;
        store.write(&self.episode, &[Attachment { name: FILE.into(), bytes }]).map_err(broken)?;
        if !self.tracks.is_empty() {
            store.attach_tracks(&self.episode.result.id, &self.tracks).map_err(broken)?;
        }
        Ok(self.episode.result)
    }
}

fn connect(request: &RealRequest, dead_man: &Arc<AtomicBool>) -> Result<ArmClient<TcpConnection>, WorkspaceError> {
    let connection = TcpConnection::open(&request.url);
    let client = connection.and_then(|it| ArmClient::connect(it, request.client.clone(), Arc::clone(dead_man)));
    client.map_err(|error| {
        WorkspaceError::input(error.to_string())
            .with_hint("start one first, such as `genmanip real simulate` in another terminal")
    })
}

fn actor(
    policy: &PolicyFactory,
    stage: &Stage,
    planner: &Arc<Planner>,
    settings: &PipelineSettings,
) -> Result<Box<dyn genmanip_core::Policy>, WorkspaceError> {
    if policy.needs_record() {
        return Err(WorkspaceError::input(format!("policy `{}` needs a recorded episode", policy.label())));
    }
    let grasps = Resources::builtin(planner).grasps;
    policy.make(&PolicyContext { stage, recorded: None, planner, grasps, settings, cores: None })
}

/// Images of a policy over a connection of its own: a slow camera does not delay the arm.
fn eyes(request: &RealRequest, stage: &Stage, cameras: &[CameraRequest]) -> Result<Eyes, WorkspaceError> {
    if cameras.is_empty() {
        return Ok(Box::new(|| Ok(Images::new())));
    }
    let mut client = connect(request, &Arc::default())?;
    let views = cameras.iter().map(|request| Ok((request.clone(), stage.camera(request)?)));
    let views = views.collect::<Result<Vec<_>, RolloutError>>().map_err(stopped)?;
    let (rig, robot) = (request.rig.clone(), Arc::clone(&stage.robot));
    Ok(Box::new(move || {
        client.wait(client.now_s()).map_err(|error| error.to_string())?;
        let mut images = Images::new();
        for (request, camera) in &views {
            let image = rig.image(&mut client, &robot, camera, request).map_err(|error| error.to_string())?;
            images.insert(request.name.clone(), Arc::new(image));
        }
        Ok(images)
    }))
}

fn stopped(error: RolloutError) -> WorkspaceError {
    WorkspaceError::broken("the run on the arm stopped", error)
}

/// Recorder of camera tracks, with a connection of its own: a slow camera does not delay the arm.
struct Recorder {
    /// A message for each image to take.
    shutter: std::sync::mpsc::Sender<()>,
    thread: std::thread::JoinHandle<Result<Vec<CameraTrack>, String>>,
}

impl Recorder {
    fn start(request: &RealRequest, stage: &Stage) -> Result<Self, WorkspaceError> {
        let client = connect(request, &Arc::default())?;
        let (shutter, shots) = channel();
        let (rig, stage, fps) = (request.rig.clone(), stage.clone(), request.fps);
        let thread = std::thread::spawn(move || record(&rig, client, &stage, fps, &shots));
        Ok(Self { shutter, thread })
    }
}

/// Takes an image of every camera per message; while it is late, an image stands for those that it missed.
fn record(
    rig: &Rig,
    mut client: ArmClient<TcpConnection>,
    stage: &Stage,
    fps: u32,
    shots: &Receiver<()>,
) -> Result<Vec<CameraTrack>, String> {
    let cameras = &stage.scenario.world.cameras;
    let tracks = cameras.iter().map(|camera| TrackRecorder::new(camera, fps, &VideoSettings::default()));
    let mut tracks = tracks.collect::<Result<Vec<_>, _>>().map_err(|error| error.to_string())?;
    while let Ok(()) = shots.recv() {
        let missed = shots.try_iter().count();
        client.wait(client.now_s()).map_err(|error| error.to_string())?;
        for (camera, track) in cameras.iter().zip(&mut tracks) {
            let request = CameraRequest::new(&camera.name, ImageChannels::RGBD);
            let request = match rig.gives_depth(&camera.name) {
                true => request,
                false => CameraRequest { channels: ImageChannels::RGB, ..request },
            };
            let image = rig.image(&mut client, &stage.robot, camera, &request).map_err(|error| error.to_string())?;
            for _ in 0..=missed {
                track.push(&image).map_err(|error| error.to_string())?;
            }
        }
    }
    tracks.into_iter().map(|track| track.finish().map_err(|error| error.to_string())).collect()
}

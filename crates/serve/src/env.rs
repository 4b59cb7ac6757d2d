//! Environments that other programs drive over HTTP, a request per action.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{Observation, Pose, RgbdImage};
use genmanip_pipeline::sessions::{Outcome, Saved, Scenes, Session, SessionSettings};
use genmanip_remote_policies::numpy::{Array, Numbers};
use genmanip_workspace::RunError;
use rmpv::Value;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::refusal::Refusal;
use crate::wire;

/// A session that was not asked for so long makes room for another one.
const IDLE: Duration = Duration::from_secs(600);

/// Environments of the same scenes, at most so many.
#[derive(Debug)]
pub struct EnvOffer {
    scenes: Arc<Scenes>,
    most: usize,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    opened: u64,
    sessions: BTreeMap<u64, (Arc<Mutex<Seat>>, Instant)>,
}

/// A session and the moment it may go back to.
#[derive(Debug)]
struct Seat {
    session: Session,
    saved: Option<Saved>,
}

/// What a program asks for; `session` is the number that `open` gave.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum EnvRequest {
    /// A new session, without an episode: its `session` and the ids of `scenes`.
    Open {
        /// What it is driven with and what is seen.
        settings: SessionSettings,
    },
    /// Begins an episode: `observation`, `id`, `instruction`, `kind`.
    Reset {
        session: u64,
        /// Which of the scenes.
        #[serde(default)]
        index: usize,
        /// Names the stream of chance of a scenario, or the layout of a task.
        #[serde(default)]
        seed: Option<u64>,
    },
    /// Carries out an action: `reward`, `score`, `success`, `terminated`, `truncated`, `refused`, `observation`.
    Step {
        session: u64,
        /// Numbers, or an array.
        action: Vec<f32>,
    },
    /// `observation`.
    Observe { session: u64 },
    /// The goal as it is now, condition by condition: `verdict`.
    Verdict { session: u64 },
    /// Keeps this moment, one per session.
    Save { session: u64 },
    /// Goes back to it: `observation`.
    Restore { session: u64 },
    /// Ends the episode: `result`, as in the results of an evaluation.
    Finish {
        session: u64,
        /// Name of the policy.
        policy: String,
    },
    /// Ends the session.
    Close { session: u64 },
}

impl EnvOffer {
    /// No session is open; at most `most` will be.
    pub fn new(scenes: Arc<Scenes>, most: usize) -> Self {
        Self { scenes, most: most.max(1), open: Mutex::default() }
    }

    /// The answer to a request, both MessagePack.
    pub(crate) fn answer(&self, body: &[u8]) -> Result<Vec<u8>, Refusal> {
        let request = wire::read(body).map_err(Refusal::Malformed)?;
        let request: EnvRequest = serde_path_to_error::deserialize(request)
            .map_err(|error| Refusal::Malformed(format!("at {}: {}", error.path(), error.inner())))?;
        Ok(wire::written(&map(self.answered(request)?)))
    }

    fn answered(&self, request: EnvRequest) -> Result<Vec<(&'static str, Value)>, Refusal> {
        match request {
            EnvRequest::Open { settings } => {
                let ids = self.scenes.ids().into_iter().map(Value::from).collect();
                Ok(vec![("session", self.open(settings)?.into()), ("scenes", Value::Array(ids))])
            }
            EnvRequest::Reset { session, index, seed } => self.with(session, |seat| {
                seat.session.reset(index, seed)?;
                let mut answer = vec![("observation", seen(&seat.session.observe()?))];
                if let Some(case) = seat.session.case() {
                    let task = &case.scenario.task;
                    answer.push(("id", case.id.as_str().into()));
                    answer.push(("instruction", task.instruction.as_str().into()));
                    answer.push(("kind", task.kind.name().into()));
                }
                Ok(answer)
            }),
            EnvRequest::Step { session, action } => self.with(session, |seat| {
                let Outcome { reward, verdict, terminated, truncated, refused, .. } = seat.session.step(&action)?;
                Ok(vec![
                    ("reward", reward.into()),
                    ("score", verdict.score.into()),
                    ("success", verdict.success.into()),
                    ("terminated", terminated.into()),
                    ("truncated", truncated.into()),
                    ("refused", refused.map_or(Value::Nil, Value::from)),
                    ("observation", seen(&seat.session.observe()?)),
                ])
            }),
            EnvRequest::Observe { session } => {
                self.with(session, |seat| Ok(vec![("observation", seen(&seat.session.observe()?))]))
            }
            EnvRequest::Verdict { session } => {
                self.with(session, |seat| Ok(vec![("verdict", wire::of(&seat.session.verdict()?))]))
            }
            EnvRequest::Save { session } => self.with(session, |seat| {
                seat.saved = Some(seat.session.save()?);
                Ok(Vec::new())
            }),
            EnvRequest::Restore { session } => self.with(session, |seat| {
                let nothing = || RunError::input("nothing was saved").with_hint("save keeps a moment of the session");
                let saved = seat.saved.as_ref().ok_or_else(nothing)?;
                seat.session.restore(saved)?;
                Ok(vec![("observation", seen(&seat.session.observe()?))])
            }),
            EnvRequest::Finish { session, policy } => {
                self.with(session, |seat| Ok(vec![("result", wire::of(&seat.session.finish(&policy)?))]))
            }
            EnvRequest::Close { session } => {
                let gone = || Refusal::Unsuited(format!("there is no session {session}"));
                self.lock().sessions.remove(&session).map(|_| Vec::new()).ok_or_else(gone)
            }
        }
    }

    /// A new session; where there are too many, the one that has been idle longest goes, if it has been so long enough.
    fn open(&self, settings: SessionSettings) -> Result<u64, Refusal> {
        let mut open = self.lock();
        if open.sessions.len() >= self.most {
            let oldest = open.sessions.iter().min_by_key(|(_, (_, asked))| *asked);
            match oldest.filter(|(_, (_, asked))| asked.elapsed() >= IDLE).map(|(number, _)| *number) {
                Some(number) => open.sessions.remove(&number),
                None => {
                    let what = format!("{} sessions are open; close one, or ask for more with --sessions", self.most);
                    return Err(Refusal::Unsuited(what));
                }
            };
        }
        open.opened += 1;
        let number = open.opened;
        let seat = Seat { session: Session::new(Arc::clone(&self.scenes), settings), saved: None };
        open.sessions.insert(number, (Arc::new(Mutex::new(seat)), Instant::now()));
        Ok(number)
    }

    /// Works with a session, which others wait for meanwhile.
    fn with<T>(&self, number: u64, work: impl FnOnce(&mut Seat) -> Result<T, RunError>) -> Result<T, Refusal> {
        let seat = {
            let mut open = self.lock();
            let found = open.sessions.get_mut(&number);
            let (seat, asked) = found.ok_or_else(|| {
                Refusal::Unsuited(format!("there is no session {number}: it was closed, or idle while others came"))
            })?;
            *asked = Instant::now();
            Arc::clone(seat)
        };
        let mut seat = seat.lock().unwrap_or_else(PoisonError::into_inner);
        work(&mut seat).map_err(|error| Refusal::Unsuited(in_words(&error)))
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An error with those behind it and its hint.
fn in_words(error: &RunError) -> String {
    let mut text = error.to_string();
    let mut next = std::error::Error::source(error);
    while let Some(cause) = next {
        text += &format!(": {cause}");
        next = cause.source();
    }
    text + &error.hint().map_or_else(String::new, |hint| format!("; hint: {hint}"))
}

fn map(entries: Vec<(&str, Value)>) -> Value {
    Value::Map(entries.into_iter().map(|(key, value)| (Value::from(key), value)).collect())
}

/// An observation under the names that the Python package gives its parts.
fn seen(observation: &Observation) -> Value {
    let state = observation.state.get(Observation::STATE).cloned().unwrap_or_default();
    let images = observation.images.iter().map(|(name, image)| (Value::from(name.as_str()), picture(image)));
    let mut entries = vec![
        ("time_s", observation.time_s.into()),
        ("state", Array::vector(state).value()),
        ("images", Value::Map(images.collect())),
    ];
    if let Some(truth) = &observation.privileged {
        let poses = truth.objects.iter().flat_map(|object| pose(&object.pose)).collect();
        entries.push(("objects", array(&[truth.objects.len(), 7], Numbers::F64(poses))));
        entries.push(("grasped", truth.grasped.map_or(Value::Nil, Value::from)));
    }
    map(entries)
}

fn picture(image: &RgbdImage) -> Value {
    let size = [image.height() as usize, image.width() as usize];
    let with_three = [size[0], size[1], 3];
    let k = &image.intrinsics;
    let k = vec![k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0];
    let mut entries = vec![("K", array(&[3, 3], Numbers::F64(k)))];
    entries.push(("world_from_camera", array(&[7], Numbers::F64(pose(&image.world_from_camera).to_vec()))));
    if !image.rgb.is_empty() {
        entries.push(("rgb", array(&with_three, Numbers::U8(image.rgb.clone()))));
    }
    if !image.depth_m.is_empty() {
        entries.push(("depth_m", array(&size, Numbers::F32(image.depth_m.clone()))));
    }
    if !image.points_m.is_empty() {
        entries.push(("points_m", array(&with_three, Numbers::F32(image.points_m.as_flattened().to_vec()))));
    }
    map(entries)
}

fn array(shape: &[usize], numbers: Numbers) -> Value {
    Array { shape: shape.to_vec(), numbers }.value()
}

/// Position, then the unit quaternion with w first.
fn pose(pose: &Pose) -> [f64; 7] {
    let (p, q) = (pose.position, pose.rotation);
    [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
}

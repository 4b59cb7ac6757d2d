//! Environment sessions over HTTP: one request per action.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use genmanip_core::{Observation, Pose, RgbdImage};
use genmanip_pipeline::sessions::{SceneSource, Session, SessionSettings, SessionState, StepOutcome};
use genmanip_remote_policies::numpy::{Array, Numbers};
use genmanip_remote_policies::wire;
use genmanip_workspace::{WorkspaceError, with_causes};
use rmpv::Value;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::request_error::RequestError;

/// Idle time after which a session may be closed to make room for a new one.
const IDLE: Duration = Duration::from_secs(600);

/// Environment service: a bounded number of sessions on the same scenes.
#[derive(Debug)]
pub struct EnvEndpoint {
    scenes: Arc<SceneSource>,
    max_sessions: usize,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    opened: u64,
    sessions: BTreeMap<u64, (Arc<Mutex<Slot>>, Instant)>,
}

/// A session, with its saved state if there is one.
#[derive(Debug)]
struct Slot {
    session: Session,
    saved: Option<SessionState>,
}

/// Request of a session; `session` is the number returned by `open`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum EnvRequest {
    /// Opens a session without an episode. Returns `session` and the ids of `scenes`.
    Open {
        /// Action and observation settings.
        settings: SessionSettings,
    },
    /// Starts an episode. Returns `observation`, `id`, `instruction`, `kind`.
    Reset {
        session: u64,
        /// Index of the scene.
        #[serde(default)]
        index: usize,
        /// Seed of a scenario's random stream, or of a task's layout.
        #[serde(default)]
        seed: Option<u64>,
    },
    /// Executes an action. Returns `reward`, `score`, `success`, `terminated`, `truncated`, `refused`, `observation`.
    Step {
        session: u64,
        /// Action as numbers or an array.
        action: Vec<f32>,
    },
    /// Returns `observation`.
    Observe { session: u64 },
    /// Evaluates the goal condition by condition. Returns `verdict`.
    Verdict { session: u64 },
    /// Saves the state, one per session.
    Save { session: u64 },
    /// Restores the saved state. Returns `observation`.
    Restore { session: u64 },
    /// Ends the episode. Returns `result`, as in the results of an evaluation.
    Finish {
        session: u64,
        /// Policy name.
        policy: String,
    },
    /// Closes the session.
    Close { session: u64 },
}

impl EnvEndpoint {
    /// A service with at most `max_sessions` open sessions (at least one).
    pub fn new(scenes: Arc<SceneSource>, max_sessions: usize) -> Self {
        Self { scenes, max_sessions: max_sessions.max(1), open: Mutex::default() }
    }

    /// Processes a request; request and response are MessagePack.
    pub(crate) fn answer(&self, body: &[u8]) -> Result<Vec<u8>, RequestError> {
        let request = wire::read(body).map_err(RequestError::Malformed)?;
        let request: EnvRequest = serde_path_to_error::deserialize(request)
            .map_err(|error| RequestError::Malformed(format!("at {}: {}", error.path(), error.inner())))?;
        Ok(wire::encoded(&map(self.dispatch(request)?)))
    }

    fn dispatch(&self, request: EnvRequest) -> Result<Vec<(&'static str, Value)>, RequestError> {
        match request {
            EnvRequest::Open { settings } => {
                let ids = self.scenes.ids().into_iter().map(Value::from).collect();
                Ok(vec![("session", self.open(settings)?.into()), ("scenes", Value::Array(ids))])
            }
            EnvRequest::Reset { session, index, seed } => self.with(session, |slot| {
                slot.session.reset(index, seed)?;
                let mut answer = vec![("observation", encoded_observation(&slot.session.observe()?))];
                if let Some(case) = slot.session.case() {
                    let task = &case.scenario.task;
                    answer.push(("id", case.id.as_str().into()));
                    answer.push(("instruction", task.instruction.as_str().into()));
                    answer.push(("kind", task.kind.name().into()));
                }
                Ok(answer)
            }),
            EnvRequest::Step { session, action } => self.with(session, |slot| {
                let outcome = slot.session.step(&action)?;
                let StepOutcome { reward, score, success, terminated, truncated, refused, .. } = outcome;
                Ok(vec![
                    ("reward", reward.into()),
                    ("score", score.into()),
                    ("success", success.into()),
                    ("terminated", terminated.into()),
                    ("truncated", truncated.into()),
                    ("refused", refused.map_or(Value::Nil, Value::from)),
                    ("observation", encoded_observation(&slot.session.observe()?)),
                ])
            }),
            EnvRequest::Observe { session } => {
                self.with(session, |slot| Ok(vec![("observation", encoded_observation(&slot.session.observe()?))]))
            }
            EnvRequest::Verdict { session } => {
                self.with(session, |slot| Ok(vec![("verdict", wire::of(&slot.session.verdict()?))]))
            }
            EnvRequest::Save { session } => self.with(session, |slot| {
                slot.saved = Some(slot.session.save()?);
                Ok(Vec::new())
            }),
            EnvRequest::Restore { session } => self.with(session, |slot| {
                let nothing = || WorkspaceError::input("no state was saved").with_hint("send `save` first");
                let saved = slot.saved.as_ref().ok_or_else(nothing)?;
                slot.session.restore(saved)?;
                Ok(vec![("observation", encoded_observation(&slot.session.observe()?))])
            }),
            EnvRequest::Finish { session, policy } => {
                self.with(session, |slot| Ok(vec![("result", wire::of(&slot.session.finish(&policy)?))]))
            }
            EnvRequest::Close { session } => {
                let gone = || RequestError::Unsuited(format!("there is no session {session}"));
                self.lock().sessions.remove(&session).map(|_| Vec::new()).ok_or_else(gone)
            }
        }
    }

    /// Opens a session; at the maximum, closes the longest idle one if it exceeds [`IDLE`].
    fn open(&self, settings: SessionSettings) -> Result<u64, RequestError> {
        let session = Session::new(Arc::clone(&self.scenes), settings);
        let session = session.map_err(|error| RequestError::Unsuited(full_message(&error)))?;
        let mut open = self.lock();
        if open.sessions.len() >= self.max_sessions {
            let oldest = open.sessions.iter().min_by_key(|(_, (_, asked))| *asked);
            match oldest.filter(|(_, (_, asked))| asked.elapsed() >= IDLE).map(|(number, _)| *number) {
                Some(number) => open.sessions.remove(&number),
                None => {
                    let what =
                        format!("{} sessions are open; close one, or allow more with --sessions", self.max_sessions);
                    return Err(RequestError::Unsuited(what));
                }
            };
        }
        open.opened += 1;
        let number = open.opened;
        let slot = Slot { session, saved: None };
        open.sessions.insert(number, (Arc::new(Mutex::new(slot)), Instant::now()));
        Ok(number)
    }

    /// Runs `work` on a session, exclusively; an error for an unknown session.
    fn with<T>(
        &self,
        number: u64,
        work: impl FnOnce(&mut Slot) -> Result<T, WorkspaceError>,
    ) -> Result<T, RequestError> {
        let slot = {
            let mut open = self.lock();
            let found = open.sessions.get_mut(&number);
            let (slot, asked) = found.ok_or_else(|| {
                RequestError::Unsuited(format!(
                    "there is no session {number}: it was closed, possibly because it was idle"
                ))
            })?;
            *asked = Instant::now();
            Arc::clone(slot)
        };
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        work(&mut slot).map_err(|error| RequestError::Unsuited(full_message(&error)))
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Error message with its causes and its hint.
fn full_message(error: &WorkspaceError) -> String {
    with_causes(error) + &error.hint().map_or_else(String::new, |hint| format!("; hint: {hint}"))
}

fn map(entries: Vec<(&str, Value)>) -> Value {
    Value::Map(entries.into_iter().map(|(key, value)| (Value::from(key), value)).collect())
}

/// Encodes an observation with the field names of the Python package.
fn encoded_observation(observation: &Observation) -> Value {
    let state = Observation::NAMES
        .map(|(name, key)| (name, Array::vector(observation.state.get(key).cloned().unwrap_or_default()).value()));
    let images = observation.images.iter().map(|(name, image)| (Value::from(name.as_str()), encoded_image(image)));
    let mut entries = vec![("time_s", observation.time_s.into()), ("images", Value::Map(images.collect()))];
    entries.extend(state);
    if let Some(truth) = &observation.privileged {
        let poses = truth.objects.iter().flat_map(|object| pose(&object.pose)).collect();
        let joints: Vec<&[f64]> = truth.objects.iter().map(|object| &object.joint_positions[..]).collect();
        entries.push(("objects", array(&[truth.objects.len(), 7], Numbers::F64(poses))));
        entries.push(("object_joints", wire::of(&joints)));
        entries.push(("grasped", truth.grasped.map_or(Value::Nil, Value::from)));
    }
    map(entries)
}

fn encoded_image(image: &RgbdImage) -> Value {
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

/// A pose as position (3, m) and unit quaternion (4, w first).
fn pose(pose: &Pose) -> [f64; 7] {
    let (p, q) = (pose.position, pose.rotation);
    [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
}

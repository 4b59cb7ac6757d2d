//! One environment.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_core::PolicySpec;
use genmanip_pipeline::evaluate::Suite;
use genmanip_pipeline::policies::read_spec;
use genmanip_pipeline::sessions::{self, DEFAULT_KEPT, Session, SessionSettings, StepOutcome};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;

use crate::errors::{Error, error, json, read_json};
use crate::observation::{dictionary, picture};

/// One path, or several.
#[derive(FromPyObject)]
enum Paths {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

/// Scenes in which episodes start; environments share one.
#[pyclass(frozen, name = "Scenes", module = "genmanip")]
pub struct SceneSource(pub Arc<sessions::SceneSource>);

#[pymethods]
impl SceneSource {
    /// Of a frozen suite, a run, or scenario files.
    #[staticmethod]
    #[pyo3(signature = (path, keep=DEFAULT_KEPT))]
    fn suite(py: Python, path: PathBuf, keep: usize) -> PyResult<Self> {
        let scenes = py.detach(|| sessions::SceneSource::of_suite(&Suite::at(&path)?));
        Ok(Self(Arc::new(scenes.map_err(error)?.keeping(keep))))
    }

    /// Of task files, which are laid out anew for each seed; "reach", "lift" and "place" are built-in tasks.
    #[staticmethod]
    #[pyo3(signature = (paths, world=None, keep=DEFAULT_KEPT))]
    fn tasks(py: Python, paths: Paths, world: Option<PathBuf>, keep: usize) -> PyResult<Self> {
        let paths = match paths {
            Paths::One(path) => vec![path],
            Paths::Several(paths) => paths,
        };
        let scenes = py.detach(|| sessions::SceneSource::of_tasks(&paths, world.as_deref()));
        Ok(Self(Arc::new(scenes.map_err(error)?.keeping(keep))))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// Ids by index.
    fn ids(&self) -> Vec<String> {
        self.0.ids().into_iter().map(String::from).collect()
    }

    /// Most objects that any of them has.
    #[pyo3(name = "most_objects")]
    fn max_objects(&self) -> usize {
        self.0.max_objects()
    }

    /// Most joints that any object has.
    #[pyo3(name = "most_joints")]
    fn max_joints(&self) -> usize {
        self.0.max_joints()
    }

    /// `(name, lower, upper, fastest)` of the arm's joints, rad and rad/s, then of the opening between the fingers, m.
    fn robot(&self) -> Vec<(String, f64, f64, f64)> {
        let robot = self.0.planner().robot();
        let arm = robot.arm_joints().map(|joint| (joint.name.clone(), joint.lower, joint.upper, joint.max_velocity));
        arm.chain([("opening".to_owned(), 0.0, robot.gripper.max_width, f64::INFINITY)]).collect()
    }
}

/// A moment to go back to.
#[pyclass(frozen, name = "Saved", module = "genmanip")]
pub struct SessionState(sessions::SessionState);

/// An environment that a program drives.
#[pyclass(frozen, module = "genmanip._genmanip")]
pub struct Env {
    session: Mutex<Session>,
}

impl Env {
    fn session(&self) -> MutexGuard<'_, Session> {
        self.session.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Settings of a session: the specification of its actions and observations, as that of a policy, and its times.
#[derive(Deserialize)]
struct GivenSettings {
    spec: serde_json::Value,
    horizon_s: Option<f64>,
    stop_on_success: Option<bool>,
    shaping_discount: Option<f64>,
}

/// Settings that were given as JSON.
pub fn session_settings(text: &str) -> PyResult<SessionSettings> {
    let given: GivenSettings = read_json("settings of the environment", text)?;
    let spec = read_spec("session", &given.spec).map_err(Error::new_err)?;
    let PolicySpec { action, rate_hz, cameras, privileged, .. } = spec;
    let GivenSettings { horizon_s, stop_on_success, shaping_discount, .. } = given;
    Ok(SessionSettings { action, rate_hz, cameras, privileged, horizon_s, stop_on_success, shaping_discount })
}

/// Reward, score, success, terminated, truncated, and why the action was refused.
pub type StepTuple = (f64, f64, bool, bool, bool, Option<String>);

pub fn step_tuple(outcome: StepOutcome) -> StepTuple {
    let StepOutcome { reward, score, success, terminated, truncated, refused, .. } = outcome;
    (reward, score, success, terminated, truncated, refused)
}

#[pymethods]
impl Env {
    /// Settings are those of a session, as JSON.
    #[new]
    fn new(scenes: &SceneSource, settings: &str) -> PyResult<Self> {
        let session = Session::new(Arc::clone(&scenes.0), session_settings(settings)?).map_err(error)?;
        Ok(Self { session: Mutex::new(session) })
    }

    #[pyo3(signature = (index=0, seed=None))]
    fn reset(&self, py: Python, index: usize, seed: Option<u64>) -> PyResult<()> {
        py.detach(|| self.session().reset(index, seed)).map_err(error)
    }

    fn step(&self, py: Python, action: Vec<f32>) -> PyResult<StepTuple> {
        Ok(step_tuple(py.detach(|| self.session().step(&action)).map_err(error)?))
    }

    fn observe<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &py.detach(|| self.session().observe()).map_err(error)?)
    }

    /// As `observe`, but with the object that was grasped during the last control step: for loops that count
    /// microseconds.
    #[pyo3(name = "glance")]
    fn observe_quickly<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &py.detach(|| self.session().observe_quickly()).map_err(error)?)
    }

    #[pyo3(signature = (camera, size=None))]
    fn picture<'py>(&self, py: Python<'py>, camera: &str, size: Option<[u32; 2]>) -> PyResult<Bound<'py, PyDict>> {
        picture(py, &py.detach(|| self.session().picture(camera, size)).map_err(error)?)
    }

    /// JSON.
    fn verdict(&self, py: Python) -> PyResult<String> {
        json(&py.detach(|| self.session().verdict()).map_err(error)?)
    }

    /// JSON, or nothing without an episode.
    fn scenario(&self) -> PyResult<Option<String>> {
        self.session().case().map(|case| json(&*case.scenario)).transpose()
    }

    /// Name, kind of the task and instruction of the episode.
    fn about(&self) -> Option<(String, String, String)> {
        let session = self.session();
        let case = session.case()?;
        let task = &case.scenario.task;
        Some((case.id.clone(), task.kind.name().to_owned(), task.instruction.clone()))
    }

    fn control_steps(&self) -> usize {
        self.session().control_steps()
    }

    /// JSON.
    fn finish(&self, py: Python, policy: &str) -> PyResult<String> {
        json(&py.detach(|| self.session().finish(policy)).map_err(error)?)
    }

    fn save(&self, py: Python) -> PyResult<SessionState> {
        Ok(SessionState(py.detach(|| self.session().save()).map_err(error)?))
    }

    fn restore(&self, py: Python, saved: &SessionState) -> PyResult<()> {
        py.detach(|| self.session().restore(&saved.0)).map_err(error)
    }
}

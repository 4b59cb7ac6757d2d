//! Evaluating policies, also those that are written in Python.

use genmanip_workspace::workers;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use genmanip_benchmark::statistics::{StatisticsSettings, wilson_interval};
use genmanip_core::{ActionChunk, Document, EpisodeStart, Observation, Policy, PolicyError, PolicySpec};
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::evaluate::{self as run, EndingRules, EvaluateOptions, Suite};
use genmanip_pipeline::policies::{POLICIES, PolicyContext, mistaken, read_spec};
use genmanip_workspace::WorkspaceError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::{error, json, read_json};
use crate::observation::dictionary;
use crate::progress::Reporter;

/// Ends of the 95 % interval (Wilson) of a success rate.
#[pyfunction]
pub fn success_interval(successes: usize, episodes: usize) -> [f64; 2] {
    wilson_interval(successes, episodes, StatisticsSettings::default().z)
}

/// Evaluates policies on a suite, a run or scenarios; reports as JSON.
///
/// A policy is a text as on the command line, or `(name, make)`: `make()` gives an object with `spec()`, JSON of what it
/// needs, `reset(start)` and `act(observation)`, which returns `(actions, finished)`.
#[pyfunction]
#[pyo3(signature = (
    suite, policies, out, episodes_per_scenario, keep_episodes, workers, horizon_s, stop_on_success, stop_on_unreachable,
    keep_going, progress
))]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn evaluate(
    py: Python,
    suite: PathBuf,
    policies: Vec<Bound<'_, PyAny>>,
    out: Option<PathBuf>,
    episodes_per_scenario: usize,
    keep_episodes: Option<bool>,
    workers: Option<usize>,
    horizon_s: Option<f64>,
    stop_on_success: Option<bool>,
    stop_on_unreachable: bool,
    keep_going: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let factories: Vec<PolicyFactory> = policies.iter().map(factory).collect::<PyResult<_>>()?;
    let progress = Reporter::new(progress);
    let reports = interruptible(py, |stop| {
        let suite_of = Suite::at(&suite)?.with_episodes(episodes_per_scenario);
        let is_run = suite.join("run.json").is_file();
        let out = if is_run { Some(suite.clone()) } else { out.clone() };
        let options = EvaluateOptions {
            keep_episodes: keep_episodes.unwrap_or(!is_run && out.is_some()),
            out,
            workers: workers::workers(workers),
            ending: EndingRules { horizon_s, stop_on_success, stop_on_unreachable },
            keep_going,
            ..EvaluateOptions::default()
        };
        run::evaluate(&suite_of, &factories, &options, &progress, stop)
    })?;
    json(&reports.iter().map(Document::to_value).collect::<Vec<_>>())
}

/// Names of the built-in policies, with what they are.
#[pyfunction]
pub fn policies() -> Vec<(&'static str, &'static str)> {
    POLICIES.iter().map(|entry| (entry.name, entry.about)).collect()
}

fn factory(given: &Bound<'_, PyAny>) -> PyResult<PolicyFactory> {
    if let Ok(text) = given.extract::<String>() {
        return PolicyFactory::resolve(&text).map_err(error);
    }
    let (name, make): (String, Py<PyAny>) = given.extract()?;
    let label = name.clone();
    let make = move |_: &PolicyContext| -> Result<Box<dyn Policy>, WorkspaceError> {
        let made = Python::attach(|py| PythonPolicy::new(&label, make.bind(py)));
        let made = made.map_err(|error| mistaken(&format!("policy {label}"), &text(&error)))?;
        Ok(Box::new(made))
    };
    PolicyFactory::of(&name, make).map_err(error)
}

/// A policy that is a Python object.
struct PythonPolicy {
    object: Py<PyAny>,
    spec: PolicySpec,
}

impl PythonPolicy {
    fn new(name: &str, make: &Bound<'_, PyAny>) -> PyResult<Self> {
        let object = make.call0()?;
        let spec: String = object.call_method0("spec")?.extract()?;
        let given = read_json::<serde_json::Value>("the policy's spec", &spec)?;
        let spec = read_spec(name, &given).map_err(crate::errors::Error::new_err)?;
        Ok(Self { object: object.unbind(), spec })
    }
}

impl Policy for PythonPolicy {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        Python::attach(|py| {
            let episode = PyDict::new(py);
            episode.set_item("instruction", &start.instruction)?;
            episode.set_item("seed", start.seed.value())?;
            self.object.bind(py).call_method1("reset", (episode,)).map(|_| ())
        })
        .map_err(mistake)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        Python::attach(|py| {
            let seen = dictionary(py, observation)?;
            let answer = self.object.bind(py).call_method1("act", (seen,))?;
            let (actions, finished) = answer.extract()?;
            Ok(ActionChunk { actions, finished })
        })
        .map_err(mistake)
    }
}

/// The package raises mistakes of a policy with their place and remedy.
fn mistake(error: PyErr) -> PolicyError {
    PolicyError::Mistake(text(&error))
}

/// Text of an exception, without its type.
fn text(error: &PyErr) -> String {
    Python::attach(|py| error.value(py).to_string())
}

/// Mistakes of a specification (JSON), one per line; nothing if there are none.
#[pyfunction]
pub fn spec_mistakes(spec: &str) -> PyResult<Option<String>> {
    let given = read_json::<serde_json::Value>("the policy's spec", spec)?;
    Ok(read_spec("policy", &given).err())
}

/// Interval of checks for an interrupt by the user.
const LOOK: Duration = Duration::from_millis(50);

/// Runs work without Python's lock; Ctrl-C tells it to stop, and is raised when it has.
pub fn interruptible<T: Send>(
    py: Python,
    work: impl FnOnce(&AtomicBool) -> Result<T, WorkspaceError> + Send,
) -> PyResult<T> {
    let stop = AtomicBool::new(false);
    let mut interrupted = Ok(());
    let result = std::thread::scope(|scope| {
        let worker = scope.spawn(|| work(&stop));
        while !worker.is_finished() {
            py.detach(|| std::thread::sleep(LOOK));
            if let Err(signal) = py.check_signals() {
                stop.store(true, Ordering::Relaxed);
                interrupted = Err(signal);
            }
        }
        worker.join()
    });
    interrupted?;
    match result {
        Ok(result) => result.map_err(error),
        Err(_) => Err(error(WorkspaceError::input("the work ended unexpectedly; its message is above"))),
    }
}

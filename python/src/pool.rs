//! Many environments at once, stepped by threads without Python's lock.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_core::Observation;
use genmanip_pipeline::sessions::Session;
use genmanip_workspace::WorkspaceError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::environment::{SceneSource, StepTuple, session_settings, step_tuple};
use crate::errors::{error, json};
use crate::observation::dictionary;

/// Environments of the same scenes and settings.
#[pyclass(frozen, module = "genmanip._genmanip")]
pub struct Pool {
    sessions: Vec<Mutex<Session>>,
    threads: usize,
}

/// Work of one environment.
#[derive(Clone)]
enum Order {
    Step(Vec<f32>),
    Reset(usize, Option<u64>),
}

type Done = Result<(Option<StepTuple>, Observation), WorkspaceError>;

#[pymethods]
impl Pool {
    #[new]
    fn new(scenes: &SceneSource, settings: &str, count: usize, threads: usize) -> PyResult<Self> {
        let settings = session_settings(settings)?;
        let session = |_| Session::new(Arc::clone(&scenes.0), settings.clone()).map(Mutex::new);
        let sessions = (0..count).map(session).collect::<Result<_, _>>().map_err(error)?;
        Ok(Self { sessions, threads: threads.max(1) })
    }

    /// Steps every environment that `resets` does not name, and resets the others to `(index, seed)`: what each came to
    /// (nothing after a reset) and what is seen then.
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: Vec<Vec<f32>>,
        resets: Vec<Option<(usize, Option<u64>)>>,
    ) -> PyResult<(Vec<Option<StepTuple>>, Bound<'py, PyList>)> {
        let (count, given) = (self.sessions.len(), actions.len());
        if given != count || resets.len() != count {
            return Err(error(WorkspaceError::input(format!("expected {count} actions, got {given}"))));
        }
        let order = |(action, reset)| match reset {
            Some((index, seed)) => Order::Reset(index, seed),
            None => Order::Step(action),
        };
        let orders: Vec<Order> = actions.into_iter().zip(resets).map(order).collect();
        let done = py.detach(|| self.carry_out(&orders));
        let (mut outcomes, mut seen) = (Vec::new(), Vec::<Bound<'py, PyDict>>::new());
        for done in done {
            let (outcome, observation) = done.map_err(error)?;
            outcomes.push(outcome);
            seen.push(dictionary(py, &observation)?);
        }
        Ok((outcomes, PyList::new(py, seen)?))
    }

    /// Scenario of each episode as JSON, or nothing without an episode.
    fn scenarios(&self) -> PyResult<Vec<Option<String>>> {
        let scenario = |session: &Mutex<Session>| {
            let session = session.lock().unwrap_or_else(PoisonError::into_inner);
            session.case().map(|case| json(&*case.scenario)).transpose()
        };
        self.sessions.iter().map(scenario).collect()
    }

    /// Name, kind of the task and instruction of each episode.
    fn about(&self) -> Vec<Option<(String, String, String)>> {
        let about = |session: &Mutex<Session>| {
            let session = session.lock().unwrap_or_else(PoisonError::into_inner);
            let case = session.case()?;
            let task = &case.scenario.task;
            Some((case.id.clone(), task.kind.name().to_owned(), task.instruction.clone()))
        };
        self.sessions.iter().map(about).collect()
    }
}

impl Pool {
    /// In the order of the environments, whichever thread took which.
    fn carry_out(&self, orders: &[Order]) -> Vec<Done> {
        let threads = self.threads.min(orders.len()).max(1);
        let taken: Vec<AtomicBool> = orders.iter().map(|_| AtomicBool::new(false)).collect();
        let done: Vec<Mutex<Option<Done>>> = orders.iter().map(|_| Mutex::new(None)).collect();
        // Each thread begins with the environments that it stepped the last time, whose state is in its core's cache,
        // and then helps the others.
        let work = &|thread: usize| {
            let first = thread * orders.len() / threads;
            for index in (first..orders.len()).chain(0..first) {
                if !taken[index].swap(true, Ordering::Relaxed) {
                    let result = self.one(index, &orders[index]);
                    *done[index].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
                }
            }
        };
        std::thread::scope(|scope| {
            for thread in 1..threads {
                scope.spawn(move || work(thread));
            }
            work(0);
        });
        let done = done.into_iter().map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner));
        done.map(|slot| slot.unwrap_or_else(|| Err(WorkspaceError::input("an environment was not stepped")))).collect()
    }

    fn one(&self, index: usize, order: &Order) -> Done {
        let mut session = self.sessions[index].lock().unwrap_or_else(PoisonError::into_inner);
        let outcome = match order {
            Order::Step(action) => Some(step_tuple(session.step(action)?)),
            Order::Reset(index, seed) => {
                session.reset(*index, *seed)?;
                None
            }
        };
        Ok((outcome, session.observe_quickly()?))
    }
}

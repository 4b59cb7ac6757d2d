//! Progress of a stage, for a Python callable.

use std::sync::{Mutex, PoisonError};

use genmanip_workspace::Progress;
use pyo3::prelude::*;

/// Reports `(what, done, total)` to a callable, and notes as warnings.
pub struct Reporter {
    call: Option<Py<PyAny>>,
    counted: Mutex<(String, usize, usize)>,
}

impl Reporter {
    pub fn new(call: Option<Py<PyAny>>) -> Self {
        Self { call, counted: Mutex::default() }
    }

    /// Changes the count, then reports it; an exception of the callable is printed, as nobody can catch it.
    fn report(&self, change: impl FnOnce(&mut (String, usize, usize))) {
        let (what, done, total) = {
            let mut counted = self.counted.lock().unwrap_or_else(PoisonError::into_inner);
            change(&mut counted);
            counted.clone()
        };
        let Some(call) = &self.call else { return };
        Python::attach(|py| {
            if let Err(error) = call.call1(py, (what, done, total)) {
                error.write_unraisable(py, Some(call.bind(py)));
            }
        });
    }
}

impl Progress for Reporter {
    fn begin(&self, what: &str, total: usize) {
        self.report(|counted| *counted = (what.to_owned(), 0, total));
    }

    fn advance(&self) {
        self.report(|counted| counted.1 += 1);
    }

    fn end(&self) {}

    fn note(&self, text: &str) {
        Python::attach(|py| {
            let warned = py.import("warnings").and_then(|warnings| warnings.call_method1("warn", (text,)));
            if let Err(error) = warned {
                error.write_unraisable(py, None);
            }
        });
    }
}

//! Inspection of one scenario: the stages of its verdict.

use std::sync::Arc;

use genmanip_core::Scenario;

use super::equipment::{Equipment, VerdictError};
use super::problem::{Problem, Repair, Stage, Verdict};

/// A scenario under inspection; stages may be asked in any order, and share what they compute.
pub struct Inspection<'a> {
    scenario: Arc<Scenario>,
    equipment: &'a Equipment,
}

impl<'a> Inspection<'a> {
    /// Begins the inspection of a scenario.
    pub fn new(scenario: Arc<Scenario>, equipment: &'a Equipment) -> Self {
        Self { scenario, equipment }
    }

    /// The problems that a stage finds.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn problems(&mut self, stage: Stage) -> Result<Vec<Problem>, VerdictError> {
        let _ = (stage, &self.scenario, self.equipment);
        Ok(Vec::new())
    }

    /// The verdict of all stages.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn verdict(&mut self, revision: u64) -> Result<Verdict, VerdictError> {
        let mut problems = Vec::new();
        for stage in Stage::ALL {
            problems.extend(self.problems(stage)?);
        }
        Ok(Verdict { revision, problems })
    }

    /// Repairs of a problem, best first; each removes it and adds no blocking one.
    ///
    /// # Errors
    /// [`VerdictError`].
    pub fn repairs(&mut self, problem: &Problem) -> Result<Vec<Repair>, VerdictError> {
        let _ = problem;
        Ok(Vec::new())
    }
}

//! Judgement of one scenario: by an episode of the expert, and by the studio's verdict.

use std::sync::Arc;

use genmanip_core::{Scenario, Seed};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::expert::Expert;
use genmanip_rollout::{Stage, run_episode};
use genmanip_studio::verdict::{Equipment, Inspection, Problem};

use crate::LabError;

/// True if the expert solves the scenario in one episode.
pub(super) fn is_solved(scenario: &Arc<Scenario>, equipment: &Equipment, seed: Seed) -> Result<bool, LabError> {
    let broken =
        |error: &dyn std::fmt::Display| LabError::broken(format!("cannot run {}", scenario.id), error.to_string());
    let planner = &equipment.planner;
    let stage = Stage::open(Arc::clone(scenario), equipment.assets, planner.robot()).map_err(|error| broken(&error))?;
    let settings = PipelineSettings::in_world(scenario.world.clone());
    let expert = Expert::new(&stage, planner, equipment.grasps, settings.expert);
    let mut expert = expert.map_err(|error| broken(&error))?;
    let episode = run_episode(&stage, &mut expert, &scenario.id, seed, &settings.rollout);
    Ok(episode.map_err(|error| broken(&error))?.result.success)
}

/// Blocking problems in the verdict on a scenario.
pub(super) fn blocking(scenario: &Arc<Scenario>, equipment: &Equipment) -> Result<Vec<Problem>, LabError> {
    let verdict = Inspection::new(Arc::clone(scenario), equipment).verdict(0);
    let verdict = verdict.map_err(|error| LabError::broken(format!("cannot judge {}", scenario.id), error))?;
    Ok(verdict.blocking().cloned().collect())
}

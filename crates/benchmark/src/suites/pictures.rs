//! Hashes of what the cameras of scenarios see.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::suite::sha256;
use genmanip_core::Scenario;
use genmanip_rollout::collect::in_parallel;

use super::assets::SuiteAssets;
use genmanip_viz::views;
use genmanip_workspace::Progress;
use genmanip_workspace::RunError;
use genmanip_workspace::worlds::Setting;

/// SHA-256 of the colours that each camera sees at the start of a scenario, by the camera's name.
pub(super) type Pictures = BTreeMap<String, String>;

/// What the cameras of scenarios see; `None` when it was stopped.
pub(super) fn draw(
    scenarios: &[Scenario],
    source: &SuiteAssets,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Vec<Pictures>>, RunError> {
    progress.begin("drawing", scenarios.len());
    let one = |scenario: &Scenario| -> Result<Pictures, RunError> {
        let cameras = &scenario.world.cameras;
        let drawn = views::draw(&Setting::Scenario(Box::new(scenario.clone())), cameras, source)?;
        progress.advance();
        Ok(cameras.iter().zip(drawn).map(|(camera, picture)| (camera.name.clone(), sha256(&picture.rgb))).collect())
    };
    let drawn = in_parallel(scenarios, workers, stop, &one)?;
    progress.end();
    Ok((!stop.load(Ordering::Relaxed)).then_some(drawn))
}

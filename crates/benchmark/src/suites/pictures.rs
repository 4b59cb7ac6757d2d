//! Hashes of the initial camera images of scenarios.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::suite_format::sha256;
use genmanip_core::Scenario;
use genmanip_rollout::collect::in_parallel;

use super::assets::SuiteAssets;
use genmanip_viz::views;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::worlds::CameraFile;

/// SHA-256 of each camera's initial colour image, hexadecimal, by camera name.
pub(super) type Pictures = BTreeMap<String, String>;

/// Image hashes of these scenarios, in their order; `None` if interrupted.
pub(super) fn draw(
    scenarios: &[Scenario],
    source: &SuiteAssets,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Vec<Pictures>>, WorkspaceError> {
    progress.begin("drawing", scenarios.len());
    let one = |scenario: &Scenario| -> Result<Pictures, WorkspaceError> {
        let cameras = &scenario.world.cameras;
        let drawn = views::draw(&CameraFile::Scenario(Box::new(scenario.clone())), cameras, source)?;
        progress.advance();
        Ok(cameras.iter().zip(drawn).map(|(camera, picture)| (camera.name.clone(), sha256(&picture.rgb))).collect())
    };
    let drawn = in_parallel(scenarios, workers, stop, &one)?;
    progress.end();
    Ok((!stop.load(Ordering::Relaxed)).then_some(drawn))
}

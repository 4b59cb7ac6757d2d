//! What is told of an episode as a whole.

use genmanip_core::{Document, EpisodeResult, Seed};
use genmanip_tasks::wording;

use super::steps::Steps;
use super::{ExportSettings, Source};
use crate::CameraTrack;
use crate::images::look_seed;

/// Paraphrases of an instruction; chosen.
const PARAPHRASES: usize = 6;

/// What is told of an episode as a whole, whatever the format.
#[derive(Clone, Debug)]
pub(crate) struct EpisodeFacts {
    pub(crate) result: EpisodeResult,
    pub(crate) instruction: String,
    /// Other sentences that ask for the same in this scene; none where the instruction is not understood.
    pub(crate) paraphrases: Vec<String>,
    /// What its steps are called.
    pub(crate) steps: Steps,
    /// Ids of the objects in the scene, in the order of the scenario.
    pub(crate) objects: Vec<String>,
    pub(crate) kind: &'static str,
    pub(crate) scenario_json: String,
    /// Name, and fx, fy, cx, cy in pixels.
    pub(crate) cameras: Vec<(String, [f64; 4])>,
    /// Of the look of its pictures, if it has one of its own.
    pub(crate) variation_seed: Option<Seed>,
    /// Whether it is told who was corrected, and why.
    pub(crate) has_correction_columns: bool,
}

/// What every writer must know of an episode, whoever made it.
pub(crate) trait Told {
    /// Its name, for messages.
    fn name(&self) -> &str;
    /// What it was to do.
    fn instruction(&self) -> &str;
    /// What its steps are called; empty where that is not told.
    fn steps(&self) -> &[String];
}

impl Told for EpisodeFacts {
    fn name(&self) -> &str {
        &self.result.id
    }

    fn instruction(&self) -> &str {
        &self.instruction
    }

    fn steps(&self) -> &[String] {
        &self.steps.texts
    }
}

impl EpisodeFacts {
    pub(crate) fn of(source: &Source, settings: &ExportSettings) -> Self {
        let scenario = &source.episode.scenario;
        let intrinsics = |track: &CameraTrack| {
            let k = &track.camera.intrinsics;
            (track.camera.name.clone(), [k.fx, k.fy, k.cx, k.cy])
        };
        Self {
            result: source.episode.result.clone(),
            instruction: scenario.task.instruction.clone(),
            paraphrases: wording::paraphrases(&scenario.task, PARAPHRASES),
            steps: Steps::of(&source.episode),
            objects: scenario.objects.iter().map(|object| object.id.clone()).collect(),
            kind: scenario.task.kind.name(),
            scenario_json: scenario.to_value().to_string(),
            cameras: source.tracks.iter().map(intrinsics).collect(),
            variation_seed: settings.is_varied.then(|| look_seed(source.episode.result.seed, settings.look)),
            has_correction_columns: settings.has_corrections,
        }
    }
}

//! Episode-level metadata of an export.

use genmanip_core::{Document, EpisodeResult, InstanceId, Seed};
use genmanip_tasks::wording;

use super::steps::Steps;
use super::{ExportSettings, Source};
use crate::CameraTrack;
use crate::images::appearance_seed;

/// Maximum number of exported paraphrases of an instruction. Chosen by hand.
const PARAPHRASES: usize = 6;

/// Metadata of an episode, independent of the format.
#[derive(Clone, Debug)]
pub struct EpisodeMetadata {
    /// Result of the attempt in the store.
    pub result: EpisodeResult,
    /// Instruction of the task, in English.
    pub instruction: String,
    /// Other sentences for the same goal in this scene; empty if the instruction cannot be parsed.
    pub paraphrases: Vec<String>,
    /// Steps (subtasks) of the episode, with their instructions.
    pub steps: Steps,
    /// Ids of the objects in the scene, in the order of the scenario.
    pub objects: Vec<InstanceId>,
    /// Name of the task's kind.
    pub kind: &'static str,
    /// Initial scenario as JSON text.
    pub scenario_json: String,
    /// Name and fx, fy, cx, cy (pixels) of each camera.
    pub cameras: Vec<(String, [f64; 4])>,
    /// Seed of the randomised appearance in the images; `None` if the appearance was not randomised.
    pub variation_seed: Option<Seed>,
    /// True if the correction columns are written.
    pub has_correction_columns: bool,
}

/// Metadata of an episode that every format's writer needs, for exported and for imported episodes.
pub trait LanguageLabels {
    /// Name of the episode, for messages.
    fn name(&self) -> &str;
    /// Instruction of the task, in English.
    fn instruction(&self) -> &str;
    /// Instructions of the steps (subtasks); empty if the steps are unknown.
    fn steps(&self) -> &[String];
}

impl LanguageLabels for EpisodeMetadata {
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

impl EpisodeMetadata {
    /// The metadata of an episode of a store.
    pub fn of(source: &Source, settings: &ExportSettings) -> Self {
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
            variation_seed: settings.is_varied.then(|| appearance_seed(source.episode.result.seed, settings.look)),
            has_correction_columns: settings.has_corrections,
        }
    }
}

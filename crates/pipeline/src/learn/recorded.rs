//! Recorded rows of demonstrations, executed as if a network had predicted them.

use std::io;
use std::sync::Arc;

use genmanip_core::Seed;
use genmanip_policy::{Inputs, PolicyDescription, Prediction, Preset, Seen, TrainingFacts};

use super::demonstrations::RunDemonstrations;
use super::presets::PresetSettings;

/// Normalised rows of demonstrations, and the description of a policy whose predictions they could be.
pub(super) struct Recorded {
    pub description: PolicyDescription,
    /// Inputs at the first row of each demonstration.
    pub starts: Vec<Vec<f32>>,
    /// Normalised actions by demonstration and row.
    pub rows: Vec<Vec<Vec<f32>>>,
}

/// Settings of a preset without images and words as inputs.
pub(super) fn without_images(preset: PresetSettings) -> PresetSettings {
    let inputs = Inputs { images: Vec::new(), words: 0, ..preset.inputs.clone() };
    PresetSettings { inputs, ..preset }
}

impl Recorded {
    /// From demonstrations that were read with these settings.
    pub fn of(preset: Preset, settings: PresetSettings, read: &RunDemonstrations) -> Self {
        let PresetSettings { model, execute, training, privileged, .. } = settings;
        let (arrays, contract) = (&read.arrays, read.contract.clone());
        let normalisation = arrays.normalisation();
        let normalised = |action: &[f32]| normalisation.action.normalise(action).collect();
        let (entries, width) = (contract.names.len(), arrays.inputs.width());
        let rows =
            arrays.episodes.iter().map(|it| it.actions.chunks_exact(entries).map(normalised).collect()).collect();
        let starts = arrays.episodes.iter().map(|it| it.inputs[..width].to_vec()).collect();
        let description = PolicyDescription {
            preset,
            privileged,
            inputs: arrays.inputs.clone(),
            execute,
            contract,
            training: TrainingFacts {
                sources: Vec::new(),
                run: read.run.clone(),
                demonstrations: read.ids.len(),
                rows: arrays.total_rows(),
                seed: Seed::new(0),
                steps: 0,
                settings: training,
                final_l1: 0.0,
                parameters: 0,
                genmanip_version: env!("CARGO_PKG_VERSION").into(),
            },
            tensors_sha256: String::new(),
            normalisation,
            model,
        };
        Self { description, starts, rows }
    }

    /// Predictor that replays the demonstration whose index `choose` returns at the first call; each call returns the
    /// rows that follow the executed ones.
    pub fn lookup(
        self: &Arc<Self>,
        choose: impl Fn(&Self, &Seen) -> Option<usize> + Send + 'static,
    ) -> impl FnMut(&Seen) -> io::Result<Prediction> + Send + 'static {
        let recorded = Arc::clone(self);
        let (chunk, execute) = (self.description.model.chunk, self.description.execute);
        let (mut next, mut chosen) = (0, None);
        move |seen| {
            let episode = *chosen.get_or_insert_with(|| choose(&recorded, seen));
            let rows = episode.and_then(|episode| recorded.rows.get(episode)).map_or(&[][..], Vec::as_slice);
            let row = |place: usize| rows.get(place).or(rows.last()).cloned().unwrap_or_default();
            let window = next..next + chunk;
            let end = window.clone().map(|place| if place < rows.len() { 0.0 } else { 1.0 }).collect();
            next += execute;
            Ok(Prediction { actions: window.map(row).collect(), end })
        }
    }
}

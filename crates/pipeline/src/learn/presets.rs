//! Settings of the presets of inputs and network size.

use genmanip_core::{ActionSpace, RotationEncoding};
use genmanip_data::ExportSettings;
use genmanip_data::export::choice::action;
use genmanip_policy::{Augmentation, Inputs, ModelSettings, Preset, TrainingSettings};

use crate::learned::inputs::layout;

/// Inputs, model, training and export settings of one preset.
pub(super) struct PresetSettings {
    pub inputs: Inputs,
    pub model: ModelSettings,
    pub execute: usize,
    pub training: TrainingSettings,
    /// Rate and action space of the rows. Actions are tool poses, which are a smoother function of the scene than joint
    /// positions.
    pub rows: ExportSettings,
    /// True if the inputs contain simulator ground truth.
    pub privileged: bool,
}

/// Number of points for the auxiliary loss: subject and reference of the goal's first condition.
pub(super) const LABELLED_POINTS: usize = 2;

/// Settings of a preset. With `labels`, an auxiliary loss predicts the positions of objects, unless the inputs contain
/// them.
pub(super) fn settings(preset: Preset, labels: bool) -> PresetSettings {
    let transformer = ModelSettings {
        width: 128,
        heads: 4,
        feed_forward: 512,
        encoder_layers: 3,
        decoder_layers: 1,
        chunk: 16,
        ..ModelSettings::default()
    };
    let rows = ExportSettings {
        action: action(ActionSpace::EePose, RotationEncoding::SixD),
        cameras: Vec::new(),
        depth: false,
        ..ExportSettings::default()
    };
    let (inputs, execute) = (layout(preset), 8);
    let seeing = TrainingSettings {
        start_copies: 4,
        augmentation: Augmentation { shift_px: 4, gain: 0.1, state_noise: 0.01 },
        ..TrainingSettings::default()
    };
    match preset {
        Preset::State => PresetSettings {
            inputs,
            model: transformer,
            execute,
            training: TrainingSettings::default(),
            rows,
            privileged: true,
        },
        Preset::Tiny => PresetSettings {
            inputs,
            model: ModelSettings {
                channels: 32,
                keypoints: 16,
                labelled_points: if labels { LABELLED_POINTS } else { 0 },
                ..transformer
            },
            execute,
            training: TrainingSettings { label_weight: if labels { 1.0 } else { 0.0 }, ..seeing },
            rows,
            privileged: false,
        },
        // The weight of the KL divergence is that of the publication.
        Preset::Act => PresetSettings {
            inputs,
            model: ModelSettings { channels: 32, residual_blocks: 1, latent: 32, ..transformer },
            execute,
            training: TrainingSettings { kl_weight: 10.0, ..seeing },
            rows,
            privileged: false,
        },
    }
}

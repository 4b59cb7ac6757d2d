//! Settings of the presets.

use genmanip_core::{ActionSpace, RotationEncoding};
use genmanip_data::ExportSettings;
use genmanip_data::export::choice::action;
use genmanip_policy::{ModelSettings, Preset, TrainingSettings};

/// Settings of one preset.
pub(super) struct PresetSettings {
    pub model: ModelSettings,
    pub execute: usize,
    pub training: TrainingSettings,
    /// Rate and actions of the rows: tool poses, which are a smoother function of the scene than joint positions.
    pub rows: ExportSettings,
    /// True if the inputs hold simulator ground truth.
    pub privileged: bool,
}

/// Settings of a preset.
pub(super) fn settings(preset: Preset) -> PresetSettings {
    match preset {
        Preset::State => PresetSettings {
            model: ModelSettings {
                width: 128,
                heads: 4,
                feed_forward: 512,
                encoder_layers: 3,
                decoder_layers: 1,
                chunk: 16,
            },
            execute: 8,
            training: TrainingSettings::default(),
            rows: ExportSettings {
                action: action(ActionSpace::EePose, RotationEncoding::SixD),
                cameras: Vec::new(),
                depth: false,
                ..ExportSettings::default()
            },
            privileged: true,
        },
    }
}

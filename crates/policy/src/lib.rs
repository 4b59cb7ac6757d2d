//! Learned policies: networks that predict chunks of actions, and their training from demonstrations.
//!
//! The crate sees arrays only: `pipeline` turns recorded episodes and observations into [`Demonstrations`] and inputs.
//! Without the feature `learn`, the crate holds the description of a policy, normalisation and augmentation, and does
//! not depend on Burn. Types of Burn are not exported.

mod augmentation;
mod demonstrations;
mod description;
mod scale;
mod words;

pub use augmentation::normalised_pixel;
pub use demonstrations::{Batch, Demonstration, Demonstrations, ImageBatch, RowImages, Sampler};
pub use description::{
    Augmentation, Head, ImageInput, Inputs, ModelSettings, Normalisation, PolicyDescription, Preset, TrainingFacts,
    TrainingSettings,
};
pub use scale::Scale;
pub use words::instruction_words;

#[cfg(feature = "learn")]
mod learning;
#[cfg(feature = "learn")]
pub use learning::{
    Array, Checkpoint, Ensemble, Network, NetworkError, Parameters, ParametersError, Precision, Prediction, Seen,
    TrainError, Trainer, TrainingStep,
};

//! Learned policies: networks that predict chunks of actions, and their training from demonstrations.
//!
//! The crate sees arrays only: `pipeline` turns recorded episodes and observations into [`Demonstrations`] and inputs.
//! Without the feature `learn` it holds the description of a policy and the arithmetic around a network, and none of
//! Burn, which does not leave this crate.

mod augmentation;
mod demonstrations;
mod description;
mod scale;
mod words;

pub use augmentation::normalised_pixel;
pub use demonstrations::{Batch, Demonstration, Demonstrations, ImageBatch, RowImages, Sampler};
pub use description::{
    Augmentation, ImageInput, Inputs, ModelSettings, Normalisation, PolicyDescription, Preset, TrainingFacts,
    TrainingSettings,
};
pub use scale::Scale;
pub use words::instruction_words;

#[cfg(feature = "learn")]
mod learning;
#[cfg(feature = "learn")]
pub use learning::{
    Array, Checkpoint, Network, NetworkError, Parameters, ParametersError, Precision, Prediction, Seen, TrainError,
    Trainer, TrainingStep,
};

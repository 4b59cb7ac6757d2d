//! Neural networks of policies and their training.

mod adam;
mod ensemble;
mod flow;
mod layers;
mod neighbourhoods;
mod network;
mod nn;
mod parameters;
mod style;
mod tensor;
mod train;
mod trunk;
mod vision;

pub use ensemble::Ensemble;
pub use network::{Network, NetworkError, Prediction, Seen};
pub use parameters::{Array, Parameters, ParametersError, Precision};
pub use train::{Checkpoint, TrainError, Trainer, TrainingStep};

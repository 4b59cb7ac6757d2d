//! Inference of a trained network on the CPU.

use std::io;

use genmanip_core::Document;

use super::flow;
use super::layers::Weights;
use super::nn::Transformer;
use super::parameters::ParametersError;
use super::tensor::{Cpu, Tensor};
use crate::augmentation::ImageChange;
use crate::{Batch, Demonstrations, Head, PolicyDescription};

/// A trained network with its description.
pub struct Network {
    description: PolicyDescription,
    transformer: Transformer,
    weights: Weights<Cpu>,
}

/// Network inputs of one observation, not yet normalised.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Numbers of robot and objects: [`crate::Inputs::width`].
    pub numbers: Vec<f32>,
    /// Hashed words of the instruction, see [`crate::instruction_words`].
    pub words: Vec<f32>,
    /// Images in the format of [`crate::RowImages::read`].
    pub rgb: Vec<u8>,
    /// Number of the row (control step), on which the noise of a flow head depends.
    pub row: usize,
}

/// Action chunk predicted by the network.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Normalised actions, in the order of their execution.
    pub actions: Vec<Vec<f32>>,
    /// Probability for each action that the episode is over before it.
    pub end: Vec<f32>,
}

/// Reason why a policy cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// The weights cannot be read.
    #[error(transparent)]
    Parameters(#[from] ParametersError),
    /// The description is inconsistent.
    #[error(transparent)]
    Description(#[from] genmanip_core::DocumentError),
    /// The hash of the weights differs from that in the description.
    #[error("the tensors have hash {got}, expected {expected}")]
    OtherTensors {
        /// SHA-256 in the description.
        expected: String,
        /// Hash of the file's tensors.
        got: String,
    },
}

impl Network {
    /// Network from a description and the bytes of its weights file.
    ///
    /// # Errors
    /// If the description is inconsistent, or the weights are damaged or have another hash.
    pub fn new(description: PolicyDescription, weights: &[u8]) -> Result<Self, NetworkError> {
        description.check()?;
        let PolicyDescription { model, inputs, contract, tensors_sha256, .. } = &description;
        let transformer = Transformer::new(model.clone(), inputs.clone(), contract.names.len());
        let parameters = transformer.empty().from_bytes(weights, "")?;
        let got = parameters.sha256();
        if got != *tensors_sha256 {
            return Err(NetworkError::OtherTensors { expected: tensors_sha256.clone(), got });
        }
        Ok(Self { weights: Transformer::load(&parameters), description, transformer })
    }

    /// Description of the network.
    pub fn description(&self) -> &PolicyDescription {
        &self.description
    }

    /// Predicts the action chunk for an observation.
    ///
    /// # Errors
    /// If the images have the wrong number of bytes.
    pub fn predict(&self, seen: &Seen) -> io::Result<Prediction> {
        let PolicyDescription { inputs: layout, normalisation, contract, model, training, .. } = &self.description;
        let mut batch = Batch::default();
        Demonstrations::push_inputs(layout, normalisation, &seen.numbers, &mut batch);
        Demonstrations::push_images(layout, &seen.rgb, &mut || ImageChange::NONE, &mut batch)?;
        batch.words.extend(&seen.words);
        if model.head == Head::Flow {
            let seed = training.seed.fork("prediction").fork_index(seen.row as u64);
            batch.noise = flow::noise(seed, model.chunk * contract.names.len());
        }
        let [actions, end] = self.transformer.predict(&self.weights, &batch).map(Tensor::values);
        let probability = |logit: f32| 1.0 / (1.0 + (-logit).exp());
        Ok(Prediction {
            actions: actions.chunks_exact(contract.names.len()).map(<[f32]>::to_vec).collect(),
            end: end.into_iter().map(probability).collect(),
        })
    }
}

//! Description of a learned policy, the file `policy.json` beside its weights.

use genmanip_core::{ActionContract, Document, DocumentError, Seed, named_enum};
use serde::{Deserialize, Serialize};

use crate::Scale;

/// A learned policy: its network, inputs and outputs, and the facts of its training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyDescription {
    /// Preset from which the training settings started.
    pub preset: Preset,
    /// True if the policy reads simulator ground truth; its results are then marked `oracle`.
    pub privileged: bool,
    /// Architecture of the network.
    pub model: ModelSettings,
    /// Layout of the network's input tokens and images.
    pub inputs: Inputs,
    /// Contract of the predicted actions, that of the demonstrations.
    pub contract: ActionContract,
    /// Actions of a chunk that are executed before the next observation.
    pub execute: usize,
    /// Means and standard deviations of inputs and actions over the demonstrations.
    pub normalisation: Normalisation,
    /// Provenance of the weights: data, seed, settings.
    pub training: TrainingFacts,
    /// SHA-256 of all tensors in the order of their names, hexadecimal.
    pub tensors_sha256: String,
}

impl Document for PolicyDescription {
    const SCHEMA: &'static str = "genmanip.policy/1";

    fn check(&self) -> Result<(), DocumentError> {
        let actions = self.contract.names.len();
        let widths = [
            ("$.normalisation.robot", self.normalisation.robot.width(), self.inputs.robot.len()),
            ("$.normalisation.object", self.normalisation.object.width(), self.inputs.object.len()),
            ("$.normalisation.action", self.normalisation.action.width(), actions),
        ];
        let wrong = widths.into_iter().find(|(_, got, expected)| *got != Some(*expected));
        let refuse = |path: &str, message: String| Err(DocumentError::Invalid { path: path.into(), message });
        match wrong {
            Some((path, _, expected)) => refuse(path, format!("expected {expected} means and positive deviations")),
            None if actions == 0 || self.inputs.robot.is_empty() => {
                refuse("$.contract.names", "expected a policy with inputs and actions".into())
            }
            None if !(1..=self.model.chunk).contains(&self.execute) => {
                refuse("$.execute", format!("expected 1 to {}, got {}", self.model.chunk, self.execute))
            }
            None => self.model.check().or_else(|message| refuse("$.model", message)),
        }
    }
}

named_enum! {
    /// Inputs and sizes of a policy under one name.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Preset {
        /// Poses of the objects as the simulator knows them; a privileged policy without images.
        State = "state",
        /// Images of two cameras and the instruction; small enough to train and run on a CPU.
        Tiny = "tiny",
        /// ACT (Zhao et al., 2023) with the inputs of `tiny`, in sizes for a CPU; no simulator labels.
        Act = "act",
    }
}

named_enum! {
    /// Output of a network, with its loss.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Head {
        /// Actions, by the L1 loss: the median of what the demonstrations do.
        #[default]
        L1 = "l1",
        /// Samples of the demonstrations' distribution, by conditional flow matching.
        Flow = "flow",
    }
}

impl Head {
    fn is_l1(&self) -> bool {
        *self == Self::L1
    }
}

/// Architecture of the transformer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelSettings {
    /// Embedding dimension of tokens.
    pub width: usize,
    /// Number of attention heads.
    pub heads: usize,
    /// Width of the feed-forward layers.
    pub feed_forward: usize,
    /// Number of transformer encoder layers, which read the input tokens.
    pub encoder_layers: usize,
    /// Number of transformer decoder layers, which predict the chunk.
    pub decoder_layers: usize,
    /// Number of actions predicted at once (chunk size).
    pub chunk: usize,
    /// Channels of the convolutions of each camera; 0 without cameras.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub channels: usize,
    /// Keypoints of each camera's spatial softmax, grouped into a quarter as many tokens; 0 without cameras.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub keypoints: usize,
    /// Keypoints supervised by an auxiliary loss with positions from the simulator, at most
    /// [`ModelSettings::keypoints`]; 0 for none. Only training reads these labels.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub labelled_points: usize,
    /// Residual blocks per stage of the convolutional trunk of each camera, whose cells become tokens; 0 for keypoints.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub residual_blocks: usize,
    /// Entries of the latent style variable (CVAE), which is 0 at inference; 0 without it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub latent: usize,
    /// Output of the decoder.
    #[serde(default, skip_serializing_if = "Head::is_l1")]
    pub head: Head,
}

fn one() -> usize {
    1
}

fn is_one(count: &usize) -> bool {
    *count == 1
}

fn is_none(weight: &f64) -> bool {
    *weight == 0.0
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Maximum embedding dimension, chunk size and number of layers; several times those of published policies.
const MAX_WIDTH: usize = 4096;
const MAX_CHUNK: usize = 512;
const MAX_LAYERS: usize = 64;

impl ModelSettings {
    fn check(&self) -> Result<(), String> {
        let ranges = [
            ("width", self.width, MAX_WIDTH),
            ("heads", self.heads, self.width),
            ("feed_forward", self.feed_forward, 4 * MAX_WIDTH),
            ("encoder_layers", self.encoder_layers, MAX_LAYERS),
            ("decoder_layers", self.decoder_layers, MAX_LAYERS),
            ("chunk", self.chunk, MAX_CHUNK),
        ];
        match ranges.into_iter().find(|(_, value, most)| !(1..=*most).contains(value)) {
            Some((name, value, most)) => Err(format!("{name}: expected 1 to {most}, got {value}")),
            None if self.channels.max(self.keypoints) > MAX_WIDTH || self.labelled_points > self.keypoints => {
                Err(format!("labelled_points: expected at most {} keypoints of {MAX_WIDTH}", self.keypoints))
            }
            None if self.residual_blocks.max(self.latent) > MAX_WIDTH => {
                Err(format!("residual_blocks, latent: expected at most {MAX_WIDTH}"))
            }
            None if self.residual_blocks > 0 && self.keypoints > 0 => {
                Err("keypoints: expected 0 beside residual_blocks".into())
            }
            None if self.latent > 0 && self.head == Head::Flow => {
                Err("latent: expected 0 with a flow head, whose noise tells the demonstrations apart".into())
            }
            None if !self.width.is_multiple_of(self.heads) => {
                Err(format!("width: expected a multiple of {} heads, got {}", self.heads, self.width))
            }
            None => Ok(()),
        }
    }
}

/// Inputs of a network: one token of the robot, one per object slot, one of the instruction, and tokens of images.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inputs {
    /// Names of the numbers of the robot's token, in order.
    pub robot: Vec<String>,
    /// Names of the numbers of an object's token, in order. The first number is 1 where the slot holds an object; all
    /// numbers of an empty slot are 0.
    pub object: Vec<String>,
    /// Number of object slots; further objects are omitted.
    pub slots: usize,
    /// Input images, in the order in which the network receives them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<ImageInput>,
    /// Buckets of the hashed words of the instruction, see [`crate::instruction_words`]; 0 without language.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub words: usize,
}

/// Image of a camera as a network's input: 8-bit sRGB.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageInput {
    /// Name of the camera that provides the image.
    pub camera: String,
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
}

/// Side of the patches that images are divided into, pixels. Chosen by hand.
pub(crate) const PATCH: usize = 4;

impl ImageInput {
    /// Number of bytes of an image, three per pixel.
    pub fn bytes(&self) -> usize {
        3 * self.width * self.height
    }

    /// Number of rows and columns of whole patches.
    pub(crate) fn patches(&self) -> [usize; 2] {
        [self.height / PATCH, self.width / PATCH]
    }
}

impl Inputs {
    /// Number of inputs of one row: the robot's, then those of each object slot.
    pub fn width(&self) -> usize {
        self.robot.len() + self.slots * self.object.len()
    }
}

/// Means and standard deviations that normalise inputs and actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalisation {
    /// Scale of the robot's token.
    pub robot: Scale,
    /// Scale of the objects' tokens, over filled slots.
    pub object: Scale,
    /// Scale of actions, per entry of the action contract.
    pub action: Scale,
}

/// Hyperparameters of a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingSettings {
    /// Batch size, samples per step.
    pub batch: usize,
    /// Peak learning rate of AdamW.
    pub learning_rate: f64,
    /// Number of steps of linear warm-up; cosine decay to 0 follows.
    pub warm_up: u64,
    /// Decoupled weight decay of weight matrices; biases and gains have none.
    pub weight_decay: f64,
    /// Gradient clipping: largest global L2 norm.
    pub max_gradient_norm: f64,
    /// Decay of the exponential moving average (EMA) of the weights; the averaged weights become the policy.
    pub average_decay: f64,
    /// Weight of the loss of the predicted end of the episode, relative to the L1 loss of actions.
    pub end_weight: f64,
    /// Oversampling: samples per row when the gripper opens or closes within the row's chunk; 1 for other rows.
    pub transition_copies: usize,
    /// Oversampling of the rows of the first chunk, where only images and instruction determine the task: later, the
    /// motion under way does.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub start_copies: usize,
    /// Weight of the KL divergence of the latent style variable, relative to the L1 loss of actions.
    #[serde(default, skip_serializing_if = "is_none")]
    pub kl_weight: f64,
    /// Weight of the auxiliary loss of labelled keypoints, relative to the L1 loss of actions.
    pub label_weight: f64,
    /// Data augmentation of the training samples.
    pub augmentation: Augmentation,
}

/// Amplitudes of random augmentations, uniformly distributed; 0 for none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// Largest shift of an image along each axis, pixels; border pixels are repeated.
    pub shift_px: u32,
    /// Largest relative change of the brightness of each colour channel.
    pub gain: f32,
    /// Largest noise added to each entry of the robot's token, in standard deviations.
    pub state_noise: f32,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self {
            batch: 64,
            learning_rate: 1e-3,
            warm_up: 100,
            weight_decay: 1e-4,
            max_gradient_norm: 1.0,
            average_decay: 0.999,
            end_weight: 0.1,
            transition_copies: 2,
            start_copies: 1,
            kl_weight: 0.0,
            label_weight: 0.0,
            augmentation: Augmentation::default(),
        }
    }
}

/// Provenance of a training run: the same facts give the same weights, bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingFacts {
    /// Hash of the collection run that made the demonstrations.
    pub run: String,
    /// Names of the sources whose demonstrations alone were used; empty for all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<String>,
    /// Number of demonstrations trained on.
    pub demonstrations: usize,
    /// Number of rows (control steps) of all demonstrations.
    pub rows: usize,
    /// Seed of initial weights and samples.
    pub seed: Seed,
    /// Number of optimiser steps.
    pub steps: u64,
    /// Hyperparameters of the run.
    pub settings: TrainingSettings,
    /// Mean L1 error of normalised actions over the last hundredth of the steps.
    pub final_l1: f64,
    /// Number of trainable scalars of the network.
    pub parameters: usize,
    /// Version of this program that trained the policy.
    pub genmanip_version: String,
}

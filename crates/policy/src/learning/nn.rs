//! The transformer that predicts a chunk of actions at once, after ACT (Zhao et al., 2023) without its variational
//! encoder: scripted demonstrations need none.
//!
//! Tokens of the robot, the objects, the instruction and the keypoints of images ([`super::vision`]) pass through an
//! encoder; learned queries, one per action of the chunk, read its output in a decoder. Layers normalise before attention.

use burn_backend::Backend;
use genmanip_core::Seed;

use super::layers::{Initials, Layers, Weights};
use super::parameters::{Array, Parameters};
use super::tensor::Tensor;
use super::vision;
use crate::{Batch, Inputs, ModelSettings};

/// The network: sizes without weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Transformer {
    settings: ModelSettings,
    inputs: Inputs,
    action: usize,
}

/// Output for a batch.
pub struct Output<B: Backend> {
    /// Normalised actions: batch × chunk × action.
    pub actions: Tensor<B>,
    /// Logit that the episode is over before each action: batch × chunk × 1.
    pub end: Tensor<B>,
    /// Positions of the labelled points in [`POINT_UNIT_M`], world frame: batch × 3 · points.
    pub points: Option<Tensor<B>>,
    /// Keypoints of each image in normalised pixels: batch × keypoints × 2.
    pub keypoints: Vec<Tensor<B>>,
}

/// Unit of predicted positions, m; about the deviation of positions on a table.
pub const POINT_UNIT_M: f32 = 0.1;

/// Largest value of learned tokens before training.
const MAX_TOKEN: f32 = 0.1;

impl Transformer {
    /// The network for inputs and actions of these widths.
    pub fn new(settings: ModelSettings, inputs: Inputs, action: usize) -> Self {
        Self { settings, inputs, action }
    }

    /// Initial weights: uniform within the inverse square root of the number of inputs, biases 0.
    pub fn initial(&self, seed: Seed) -> Parameters {
        self.arrays().drawn(seed)
    }

    /// Names and shapes of the weights, without values.
    pub fn empty(&self) -> Parameters {
        self.arrays().empty()
    }

    fn arrays(&self) -> Initials {
        let ModelSettings { width, feed_forward, encoder_layers, decoder_layers, chunk, .. } = self.settings;
        let mut arrays = Initials::default();
        arrays.linear("robot", self.inputs.robot.len(), width);
        if self.inputs.slots > 0 {
            arrays.linear("object", self.inputs.object.len(), width);
        }
        if self.inputs.words > 0 {
            arrays.linear("words", self.inputs.words, width);
            arrays.linear("instruction", width, width);
        }
        for image in 0..self.inputs.images.len() {
            vision::add(&format!("image.{image}"), &self.settings, self.inputs.words > 0, &mut arrays);
        }
        for layer in 0..encoder_layers {
            arrays.layer(&format!("encoder.{layer}"), &["attention"], width, feed_forward);
        }
        for layer in 0..decoder_layers {
            arrays.layer(&format!("decoder.{layer}"), &["attention", "cross"], width, feed_forward);
        }
        arrays.norm("encoder.norm", width);
        arrays.norm("decoder.norm", width);
        arrays.linear("head", width, self.action + 1);
        if self.settings.labelled_points > 0 {
            arrays.linear("points", width, 3 * self.settings.labelled_points);
        }
        arrays.add("tokens".into(), &[1, self.tokens(), width], MAX_TOKEN, 0.0);
        arrays.add("queries".into(), &[1, chunk, width], MAX_TOKEN, 0.0);
        arrays
    }

    /// Number of tokens of the encoder.
    fn tokens(&self) -> usize {
        let Inputs { slots, words, images, .. } = &self.inputs;
        1 + slots + usize::from(*words > 0) + images.len() * self.settings.keypoints
    }

    /// Weights on a back end.
    pub fn load<B: Backend>(parameters: &Parameters) -> Weights<B> {
        let load = |array: &Array| (array.name.clone(), Tensor::new(&array.values, &array.shape));
        parameters.arrays.iter().map(load).collect()
    }

    /// Predictions for the inputs of a batch.
    pub fn forward<B: Backend>(&self, weights: &Weights<B>, batch: &Batch) -> Output<B> {
        let (size, width) = (batch.size, self.settings.width);
        let Inputs { robot, object, slots, images, words } = &self.inputs;
        let layers = Layers { weights, heads: self.settings.heads };
        let mut tokens = vec![layers.linear(Tensor::new(&batch.robot, &[size, 1, robot.len()]), "robot")];
        if *slots > 0 {
            tokens.push(layers.linear(Tensor::new(&batch.objects, &[size, *slots, object.len()]), "object"));
        }
        let instruction = (*words > 0).then(|| {
            let hidden = layers.linear(Tensor::new(&batch.words, &[size, 1, *words]), "words").relu();
            layers.linear(hidden, "instruction").relu()
        });
        tokens.extend(instruction.clone());
        let mut keypoints = Vec::new();
        for (index, (image, batch)) in images.iter().zip(&batch.images).enumerate() {
            let name = format!("image.{index}");
            let seen = vision::keypoints(&layers, &name, &self.settings, instruction.as_ref(), image, batch);
            tokens.push(seen.tokens);
            keypoints.push(seen.pixels);
        }
        let mut memory = Tensor::join(tokens, 1).add(layers.get("tokens"));
        for layer in 0..self.settings.encoder_layers {
            memory = layers.attend(memory, None, &format!("encoder.{layer}.attention"));
            memory = layers.feed_forward(memory, &format!("encoder.{layer}"));
        }
        let memory = layers.norm(memory, "encoder.norm");
        let points = (self.settings.labelled_points > 0).then(|| {
            let robot = memory.clone().narrow(1, 0..1).reshape(&[size, width]);
            layers.linear(robot, "points")
        });
        let chunk = self.settings.chunk;
        let mut queries = layers.get("queries").expand(&[size, chunk, width]);
        for layer in 0..self.settings.decoder_layers {
            queries = layers.attend(queries, None, &format!("decoder.{layer}.attention"));
            queries = layers.attend(queries, Some(&memory), &format!("decoder.{layer}.cross"));
            queries = layers.feed_forward(queries, &format!("decoder.{layer}"));
        }
        let out = layers.linear(layers.norm(queries, "decoder.norm"), "head");
        let end = out.clone().narrow(2, self.action..self.action + 1);
        Output { actions: out.narrow(2, 0..self.action), end, points, keypoints }
    }
}

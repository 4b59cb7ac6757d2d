//! Transformer that predicts a chunk of actions at once, after ACT (Zhao et al., 2023); its variational encoder
//! ([`super::style`]) is optional, since scripted demonstrations have little multimodality.
//!
//! Tokens of the robot, the objects, the instruction and images pass through an encoder; learned queries, one per
//! action of the chunk, read the encoder's output in a decoder by cross-attention. Layers are pre-norm.
//!
//! Of an image, all cells become tokens ([`super::trunk`]), or its keypoints a few ([`super::vision`]). Labelled
//! keypoints are first located in 3D, then become one token each with their image features, in analogy to the object
//! tokens of a privileged policy.

use genmanip_core::Seed;

use super::flow;
use super::layers::{Initials, Layers, Weights};
use super::neighbourhoods::NetworkBackend;
use super::parameters::{Array, Parameters};
use super::tensor::Tensor;
use super::vision::{self, Keypoints};
use super::{style, trunk};
use crate::{Batch, Head, ImageInput, Inputs, ModelSettings};

/// Architecture of the network: sizes without weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Transformer {
    settings: ModelSettings,
    inputs: Inputs,
    action: usize,
}

/// Network output for a batch.
pub struct Output<B: NetworkBackend> {
    /// Normalised actions, or for the loss of a flow head the velocity of noised ones: batch × chunk × action.
    pub actions: Tensor<B>,
    /// Logit that the episode is over before each action: batch × chunk × 1.
    pub end: Tensor<B>,
    /// Positions of the labelled keypoints in units of [`POINT_UNIT_M`], world frame: batch × 3 · points; `None`
    /// without labelled keypoints.
    pub points: Option<Tensor<B>>,
    /// Keypoints of the images of each camera.
    pub keypoints: Vec<Keypoints<B>>,
    /// KL divergence of the latent style variable, summed over the batch; `None` without it.
    pub divergence: Option<Tensor<B>>,
}

/// Output of the encoder.
struct Encoded<B: NetworkBackend> {
    /// Encoded tokens: batch × tokens × width.
    memory: Tensor<B>,
    points: Option<Tensor<B>>,
    keypoints: Vec<Keypoints<B>>,
}

/// Unit of predicted positions, m; about the standard deviation of object positions on a table.
pub const POINT_UNIT_M: f32 = 0.1;

/// Bound of the initial values of learned tokens. Chosen by hand.
const MAX_TOKEN: f32 = 0.1;
/// Number of keypoints that are grouped into one token. Chosen by hand.
const KEYPOINTS_PER_TOKEN: usize = 4;
/// Names of the hidden layers that locate the labelled keypoints in 3D.
const LOCATE: [&str; 2] = ["locate.0", "locate.1"];
/// Names of the layers that add noised actions and their time to the queries.
const NOISED: [&str; 2] = ["noised.0", "noised.1"];

impl Transformer {
    /// Architecture for these inputs and actions of `action` entries.
    pub fn new(settings: ModelSettings, inputs: Inputs, action: usize) -> Self {
        Self { settings, inputs, action }
    }

    /// Input images of the network.
    pub fn images(&self) -> &[ImageInput] {
        &self.inputs.images
    }

    /// Sizes of the network.
    pub fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// Initial weights: uniform within the inverse square root of the number of inputs; biases are 0.
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
        let ModelSettings { channels, keypoints, labelled_points, .. } = self.settings;
        for image in 0..self.inputs.images.len() {
            let name = format!("image.{image}");
            if self.settings.residual_blocks > 0 {
                trunk::add(&name, &self.settings, &mut arrays);
                continue;
            }
            vision::add(&name, &self.settings, self.inputs.words > 0, &mut arrays);
            arrays.linear(&format!("{name}.tokens"), keypoints * (channels + 2), self.keypoint_tokens() * width);
        }
        if self.settings.latent > 0 {
            style::add(&self.settings, self.inputs.robot.len(), self.action, &mut arrays);
        }
        if labelled_points > 0 {
            let (robot, images) = (self.inputs.robot.len(), self.inputs.images.len());
            arrays.linear(LOCATE[0], robot + images * (2 * keypoints + labelled_points * channels), 2 * width);
            arrays.linear(LOCATE[1], 2 * width, 2 * width);
            arrays.linear("points", 2 * width, 3 * labelled_points);
            arrays.linear("point", robot + 3 + images * channels, width);
        }
        for layer in 0..encoder_layers {
            arrays.layer(&format!("encoder.{layer}"), &["attention"], width, feed_forward);
        }
        for layer in 0..decoder_layers {
            arrays.layer(&format!("decoder.{layer}"), &["attention", "cross"], width, feed_forward);
        }
        arrays.norm("encoder.norm", width);
        arrays.norm("decoder.norm", width);
        match self.settings.head {
            Head::L1 => arrays.linear("head", width, self.action + 1),
            Head::Flow => {
                arrays.linear(NOISED[0], self.action + flow::TIME_FEATURES, width);
                arrays.linear(NOISED[1], width, width);
                arrays.linear("head", width, self.action);
                arrays.linear("end", width, chunk);
            }
        }
        arrays.add("tokens".into(), &[1, self.tokens(), width], MAX_TOKEN, 0.0);
        arrays.add("queries".into(), &[1, chunk, width], MAX_TOKEN, 0.0);
        arrays
    }

    /// Number of tokens that enter the encoder.
    fn tokens(&self) -> usize {
        let Inputs { slots, words, images, .. } = &self.inputs;
        let points = self.settings.labelled_points;
        let of_image = |image: &ImageInput| match self.settings.residual_blocks {
            0 => self.keypoint_tokens(),
            _ => trunk::grid(image).iter().product(),
        };
        let style = usize::from(self.settings.latent > 0);
        1 + slots + usize::from(*words > 0) + images.iter().map(of_image).sum::<usize>() + points + style
    }

    /// Number of tokens of the keypoints of one image.
    fn keypoint_tokens(&self) -> usize {
        self.settings.keypoints.div_ceil(KEYPOINTS_PER_TOKEN)
    }

    /// Weights as tensors of a back end.
    pub fn load<B: NetworkBackend>(parameters: &Parameters) -> Weights<B> {
        let load = |array: &Array| (array.name.clone(), Tensor::new(&array.values, &array.shape));
        parameters.arrays.iter().map(load).collect()
    }

    /// Forward pass for the loss of a batch.
    pub fn forward<B: NetworkBackend>(&self, weights: &Weights<B>, batch: &Batch) -> Output<B> {
        let layers = Layers { weights, heads: self.settings.heads };
        let robot = self.inputs.robot.len();
        let style = (self.settings.latent > 0).then(|| style::sample(&layers, &self.settings, robot, batch));
        let (latent, divergence) = style.map(|[latent, divergence]| (latent, divergence)).unzip();
        let encoded = self.encode(&layers, batch, latent);
        let (actions, end) = match self.settings.head {
            Head::L1 => self.actions(&layers, &encoded.memory),
            Head::Flow => {
                let noised = Tensor::new(&batch.noised(), &self.shape(batch));
                (self.velocity(&layers, &encoded.memory, noised, &batch.time), self.end(&layers, &encoded.memory))
            }
        };
        Output { actions, end, points: encoded.points, keypoints: encoded.keypoints, divergence }
    }

    /// Actions predicted for a batch, and logits of the end. A flow starts from the batch's noise.
    pub fn predict<B: NetworkBackend>(&self, weights: &Weights<B>, batch: &Batch) -> [Tensor<B>; 2] {
        let layers = Layers { weights, heads: self.settings.heads };
        let Encoded { memory, .. } = self.encode(&layers, batch, None);
        if self.settings.head == Head::L1 {
            return self.actions(&layers, &memory).into();
        }
        let end = self.end(&layers, &memory);
        let there: Vec<f32> = end.clone().values().iter().map(|logit| f32::from(u8::from(*logit <= 0.0))).collect();
        let there = Tensor::new(&there, &end.shape());
        let mut actions = Tensor::new(&batch.noise, &self.shape(batch));
        for step in 0..flow::STEPS {
            let time = vec![step as f32 / flow::STEPS as f32; batch.size];
            let velocity = self.velocity(&layers, &memory, actions.clone(), &time);
            actions = actions.add(velocity.mul(there.clone()).scale(1.0 / flow::STEPS as f64));
        }
        [actions, end]
    }

    /// Shape of the actions of a batch.
    fn shape(&self, batch: &Batch) -> [usize; 3] {
        [batch.size, self.settings.chunk, self.action]
    }

    /// Actions and logits of the end from the L1 head.
    fn actions<B: NetworkBackend>(&self, layers: &Layers<B>, memory: &Tensor<B>) -> (Tensor<B>, Tensor<B>) {
        let out = self.decode(layers, memory, None);
        (out.clone().narrow(2, 0..self.action), out.narrow(2, self.action..self.action + 1))
    }

    /// Velocity of noised actions at a time per sample.
    fn velocity<B: NetworkBackend>(
        &self,
        layers: &Layers<B>,
        memory: &Tensor<B>,
        noised: Tensor<B>,
        time: &[f32],
    ) -> Tensor<B> {
        let (size, chunk) = (time.len(), self.settings.chunk);
        let features: Vec<f32> = time.iter().flat_map(|time| flow::time_features(*time)).collect();
        let features = Tensor::new(&features, &[size, 1, flow::TIME_FEATURES]);
        let features = features.expand(&[size, chunk, flow::TIME_FEATURES]);
        let hidden = layers.linear(Tensor::join(vec![noised, features], 2), NOISED[0]).relu();
        self.decode(layers, memory, Some(layers.linear(hidden, NOISED[1])))
    }

    /// Logits of the end beside a flow head, from the robot's encoded token: noised actions would tell the end.
    fn end<B: NetworkBackend>(&self, layers: &Layers<B>, memory: &Tensor<B>) -> Tensor<B> {
        let (size, chunk) = (memory.length(0), self.settings.chunk);
        layers.linear(memory.clone().narrow(1, 0..1), "end").reshape(&[size, chunk, 1])
    }

    /// Output of the decoder, whose queries are the learned ones plus `noised`: batch × chunk × outputs of the head.
    fn decode<B: NetworkBackend>(
        &self,
        layers: &Layers<B>,
        memory: &Tensor<B>,
        noised: Option<Tensor<B>>,
    ) -> Tensor<B> {
        let ModelSettings { width, chunk, decoder_layers, .. } = self.settings;
        let learned = layers.get("queries").expand(&[memory.length(0), chunk, width]);
        let mut queries = match noised {
            Some(noised) => learned.add(noised),
            None => learned,
        };
        for layer in 0..decoder_layers {
            queries = layers.attend(queries, None, &format!("decoder.{layer}.attention"));
            queries = layers.attend(queries, Some(memory), &format!("decoder.{layer}.cross"));
            queries = layers.feed_forward(queries, &format!("decoder.{layer}"));
        }
        layers.linear(layers.norm(queries, "decoder.norm"), "head")
    }

    /// Encodes the inputs of a batch, with the latent variable of its style; `None` for 0.
    fn encode<B: NetworkBackend>(&self, layers: &Layers<B>, batch: &Batch, latent: Option<Tensor<B>>) -> Encoded<B> {
        let (size, width) = (batch.size, self.settings.width);
        let image_numbers = self.settings.keypoints * (self.settings.channels + 2);
        let Inputs { robot, object, slots, images, words } = &self.inputs;
        let mut tokens = vec![layers.linear(Tensor::new(&batch.robot, &[size, 1, robot.len()]), "robot")];
        if *slots > 0 {
            tokens.push(layers.linear(Tensor::new(&batch.objects, &[size, *slots, object.len()]), "object"));
        }
        let instruction = (*words > 0).then(|| {
            let hidden = layers.linear(Tensor::new(&batch.words, &[size, 1, *words]), "words").relu();
            layers.linear(hidden, "instruction").relu()
        });
        tokens.extend(instruction.clone());
        let mut seen = Vec::new();
        for (index, (image, batch)) in images.iter().zip(&batch.images).enumerate() {
            let name = format!("image.{index}");
            if self.settings.residual_blocks > 0 {
                tokens.push(trunk::tokens(layers, &name, &self.settings, image, batch));
                continue;
            }
            let found = vision::keypoints(layers, &name, &self.settings, instruction.as_ref(), image, batch);
            let all = Tensor::join(vec![found.features.clone(), found.pixels.clone()], 2);
            let all = layers.linear(all.reshape(&[size, 1, image_numbers]), &format!("{name}.tokens"));
            tokens.push(all.reshape(&[size, self.keypoint_tokens(), width]));
            seen.push(found);
        }
        let points = (self.settings.labelled_points > 0).then(|| self.locate(layers, batch, &seen, &mut tokens));
        if self.settings.latent > 0 {
            let count = self.settings.latent;
            let latent = latent.unwrap_or_else(|| Tensor::owned(vec![0.0; size * count], &[size, count]));
            tokens.push(layers.linear(latent.reshape(&[size, 1, count]), "latent"));
        }
        let mut memory = Tensor::join(tokens, 1).add(layers.get("tokens"));
        for layer in 0..self.settings.encoder_layers {
            memory = layers.encode(memory, &format!("encoder.{layer}"));
        }
        Encoded { memory: layers.norm(memory, "encoder.norm"), points, keypoints: seen }
    }

    /// Predicts the 3D positions of the labelled keypoints, and appends one token per keypoint to `tokens`.
    fn locate<B: NetworkBackend>(
        &self,
        layers: &Layers<B>,
        batch: &Batch,
        seen: &[Keypoints<B>],
        tokens: &mut Vec<Tensor<B>>,
    ) -> Tensor<B> {
        let (size, robot) = (batch.size, self.inputs.robot.len());
        let ModelSettings { channels, keypoints, labelled_points: points, .. } = self.settings;
        let robot = |count: usize| Tensor::new(&batch.robot, &[size, 1, robot]).expand(&[size, count, robot]);
        let features: Vec<Tensor<B>> = seen.iter().map(|found| found.features.clone().narrow(1, 0..points)).collect();
        let flat = |tensor: Tensor<B>, length: usize| tensor.reshape(&[size, 1, length]);
        let mut inputs = vec![robot(1)];
        inputs.extend(seen.iter().map(|found| flat(found.pixels.clone(), 2 * keypoints)));
        inputs.extend(features.iter().map(|features| flat(features.clone(), points * channels)));
        let hidden = LOCATE.iter().fold(Tensor::join(inputs, 2), |x, layer| layers.linear(x, layer).relu());
        let found = layers.linear(hidden, "points");
        let mut parts = vec![robot(points), found.clone().reshape(&[size, points, 3])];
        parts.extend(features);
        tokens.push(layers.linear(Tensor::join(parts, 2), "point"));
        found.reshape(&[size, 3 * points])
    }
}

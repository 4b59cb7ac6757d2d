//! The transformer that predicts a chunk of actions at once, after ACT (Zhao et al., 2023) without its variational
//! encoder: scripted demonstrations need none.
//!
//! Tokens of the robot and of the objects pass through an encoder; learned queries, one per action of the chunk, read
//! its output in a decoder. Layers normalise before attention.

use std::collections::BTreeMap;

use burn_backend::Backend;
use genmanip_core::Seed;
use rand::RngExt;

use super::parameters::{Array, Parameters};
use super::tensor::Tensor;
use crate::{Batch, Inputs, ModelSettings};

/// The network: sizes without weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Transformer {
    settings: ModelSettings,
    inputs: Inputs,
    action: usize,
}

/// Weights on a back end by name.
pub type Weights<B> = BTreeMap<String, Tensor<B>>;

/// Output for a batch.
pub struct Output<B: Backend> {
    /// Normalised actions: batch × chunk × action.
    pub actions: Tensor<B>,
    /// Logit that the episode is over before each action: batch × chunk × 1.
    pub end: Tensor<B>,
}

/// An array before training: values within `bound` of `mean`.
struct Initial {
    name: String,
    shape: Vec<usize>,
    bound: f32,
    mean: f32,
}

/// Largest value of learned tokens before training.
const MAX_TOKEN: f32 = 0.1;

impl Transformer {
    /// The network for inputs and actions of these widths.
    pub fn new(settings: ModelSettings, inputs: Inputs, action: usize) -> Self {
        Self { settings, inputs, action }
    }

    /// Initial weights: uniform within the inverse square root of the number of inputs, biases 0.
    pub fn initial(&self, seed: Seed) -> Parameters {
        let array = |Initial { name, shape, bound, mean }| {
            let mut rng = seed.fork("weights").fork(&name).rng();
            let count = shape.iter().product();
            let values = (0..count).map(|_| mean + bound * (2.0 * rng.random::<f32>() - 1.0)).collect();
            Array { name, shape, values }
        };
        Parameters { arrays: self.arrays().into_iter().map(array).collect() }
    }

    /// Names and shapes of the weights, without values.
    pub fn empty(&self) -> Parameters {
        let array = |Initial { name, shape, .. }| Array { name, shape, values: Vec::new() };
        Parameters { arrays: self.arrays().into_iter().map(array).collect() }
    }

    fn arrays(&self) -> Vec<Initial> {
        let ModelSettings { width, feed_forward, encoder_layers, decoder_layers, chunk, .. } = self.settings;
        let mut arrays = Vec::new();
        let mut add = |name: String, shape: &[usize], bound: f32, mean: f32| {
            arrays.push(Initial { name, shape: shape.to_vec(), bound, mean });
        };
        let mut linear = |name: &str, from: usize, to: usize| {
            add(format!("{name}.weight"), &[from, to], (1.0 / from as f32).sqrt(), 0.0);
            add(format!("{name}.bias"), &[to], 0.0, 0.0);
        };
        linear("robot", self.inputs.robot.len(), width);
        linear("object", self.inputs.object.len(), width);
        let layers = (0..encoder_layers).map(|layer| (format!("encoder.{layer}"), false));
        let layers: Vec<(String, bool)> =
            layers.chain((0..decoder_layers).map(|layer| (format!("decoder.{layer}"), true))).collect();
        let attentions = |layer: &str, is_decoder: bool| {
            let own = format!("{layer}.attention");
            if is_decoder { vec![own, format!("{layer}.cross")] } else { vec![own] }
        };
        for (layer, is_decoder) in &layers {
            for attention in attentions(layer, *is_decoder) {
                for part in ["query", "key", "value", "out"] {
                    linear(&format!("{attention}.{part}"), width, width);
                }
            }
            linear(&format!("{layer}.widen"), width, feed_forward);
            linear(&format!("{layer}.narrow"), feed_forward, width);
        }
        linear("head", width, self.action + 1);
        let norms = layers.iter().flat_map(|(layer, is_decoder)| {
            let before = attentions(layer, *is_decoder).into_iter().map(|attention| format!("{attention}.norm"));
            before.chain([format!("{layer}.norm")]).collect::<Vec<_>>()
        });
        for norm in norms.chain(["encoder.norm".into(), "decoder.norm".into()]) {
            add(format!("{norm}.gain"), &[width], 0.0, 1.0);
            add(format!("{norm}.bias"), &[width], 0.0, 0.0);
        }
        add("tokens".into(), &[1, 1 + self.inputs.slots, width], MAX_TOKEN, 0.0);
        add("queries".into(), &[1, chunk, width], MAX_TOKEN, 0.0);
        arrays
    }

    /// Weights on a back end.
    pub fn load<B: Backend>(parameters: &Parameters) -> Weights<B> {
        let load = |array: &Array| (array.name.clone(), Tensor::new(&array.values, &array.shape));
        parameters.arrays.iter().map(load).collect()
    }

    /// Predictions for the inputs of a batch.
    pub fn forward<B: Backend>(&self, weights: &Weights<B>, batch: &Batch) -> Output<B> {
        let (size, slots, width) = (batch.size, self.inputs.slots, self.settings.width);
        let layers = Layers { weights, heads: self.settings.heads };
        let robot = Tensor::new(&batch.robot, &[size, 1, self.inputs.robot.len()]);
        let objects = Tensor::new(&batch.objects, &[size, slots, self.inputs.object.len()]);
        let tokens = Tensor::join(vec![layers.linear(robot, "robot"), layers.linear(objects, "object")], 1);
        let mut memory = tokens.add(layers.get("tokens"));
        for layer in 0..self.settings.encoder_layers {
            memory = layers.attend(memory, None, &format!("encoder.{layer}.attention"));
            memory = layers.feed_forward(memory, &format!("encoder.{layer}"));
        }
        let memory = layers.norm(memory, "encoder.norm");
        let chunk = self.settings.chunk;
        let mut queries = layers.get("queries").expand(&[size, chunk, width]);
        for layer in 0..self.settings.decoder_layers {
            queries = layers.attend(queries, None, &format!("decoder.{layer}.attention"));
            queries = layers.attend(queries, Some(&memory), &format!("decoder.{layer}.cross"));
            queries = layers.feed_forward(queries, &format!("decoder.{layer}"));
        }
        let out = layers.linear(layers.norm(queries, "decoder.norm"), "head");
        let end = out.clone().narrow(2, self.action..self.action + 1);
        Output { actions: out.narrow(2, 0..self.action), end }
    }
}

/// Layers by the names of their weights.
struct Layers<'a, B: Backend> {
    weights: &'a Weights<B>,
    heads: usize,
}

impl<B: Backend> Layers<'_, B> {
    /// # Panics
    /// If there is no weight of that name, which [`Transformer::initial`] rules out.
    fn get(&self, name: &str) -> Tensor<B> {
        self.weights.get(name).unwrap_or_else(|| unreachable!("no weight `{name}`")).clone()
    }

    fn linear(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        x.linear(self.get(&format!("{name}.weight")), self.get(&format!("{name}.bias")))
    }

    fn norm(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        x.layer_norm(self.get(&format!("{name}.gain")), self.get(&format!("{name}.bias")))
    }

    /// Attention of tokens to a memory, or to themselves, added to them: batch × tokens × width.
    fn attend(&self, x: Tensor<B>, memory: Option<&Tensor<B>>, name: &str) -> Tensor<B> {
        let normed = self.norm(x.clone(), &format!("{name}.norm"));
        let source = memory.unwrap_or(&normed).clone();
        let [size, width] = [x.length(0), x.length(2)];
        let depth = width / self.heads;
        let split = |y: Tensor<B>, part: &str| {
            let tokens = y.length(1);
            self.linear(y, &format!("{name}.{part}")).reshape(&[size, tokens, self.heads, depth]).swap(1, 2)
        };
        let tokens = normed.length(1);
        let (query, key, value) = (split(normed, "query"), split(source.clone(), "key"), split(source, "value"));
        let shares = query.matmul(key.swap(2, 3)).scale(1.0 / (depth as f64).sqrt()).softmax();
        let mixed = shares.matmul(value).swap(1, 2).reshape(&[size, tokens, width]);
        x.add(self.linear(mixed, &format!("{name}.out")))
    }

    fn feed_forward(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        let wide = self.linear(self.norm(x.clone(), &format!("{name}.norm")), &format!("{name}.widen")).relu();
        x.add(self.linear(wide, &format!("{name}.narrow")))
    }
}

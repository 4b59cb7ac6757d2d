//! Layers addressed by the names of their weights, and the initialisation of these weights.

use std::collections::BTreeMap;

use genmanip_core::Seed;
use rand::RngExt;

use super::neighbourhoods::NetworkBackend;
use super::parameters::{Array, Parameters};
use super::tensor::Tensor;

/// Weights by name, as tensors of a back end.
pub type Weights<B> = BTreeMap<String, Tensor<B>>;

/// Layers addressed by the names of their weights.
pub(super) struct Layers<'a, B: NetworkBackend> {
    pub weights: &'a Weights<B>,
    /// Number of attention heads.
    pub heads: usize,
}

impl<B: NetworkBackend> Layers<'_, B> {
    /// # Panics
    /// If there is no weight of that name, which [`Initials`] of the same network rule out.
    pub fn get(&self, name: &str) -> Tensor<B> {
        self.weights.get(name).unwrap_or_else(|| unreachable!("no weight `{name}`")).clone()
    }

    pub fn linear(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        x.linear(self.get(&format!("{name}.weight")), self.get(&format!("{name}.bias")))
    }

    pub fn norm(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        x.layer_norm(self.get(&format!("{name}.gain")), self.get(&format!("{name}.bias")))
    }

    /// Pre-norm multi-head attention with a residual connection: cross-attention to `memory`, or self-attention without
    /// it. Both `x` and `memory` are batch × tokens × width.
    pub fn attend(&self, x: Tensor<B>, memory: Option<&Tensor<B>>, name: &str) -> Tensor<B> {
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

    /// Transformer encoder layer.
    pub fn encode(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        self.feed_forward(self.attend(x, None, &format!("{name}.attention")), name)
    }

    pub fn feed_forward(&self, x: Tensor<B>, name: &str) -> Tensor<B> {
        let wide = self.linear(self.norm(x.clone(), &format!("{name}.norm")), &format!("{name}.widen")).relu();
        x.add(self.linear(wide, &format!("{name}.narrow")))
    }
}

/// Names, shapes and initial distributions of all weights.
#[derive(Default)]
pub(super) struct Initials(Vec<Initial>);

/// Name, shape and initial distribution of one array: uniform within `bound` of `mean`.
struct Initial {
    name: String,
    shape: Vec<usize>,
    bound: f32,
    mean: f32,
}

impl Initials {
    /// Weights drawn from their initial distributions by a seed.
    pub fn drawn(self, seed: Seed) -> Parameters {
        let array = |Initial { name, shape, bound, mean }| {
            let mut rng = seed.fork("weights").fork(&name).rng();
            let count = shape.iter().product();
            let values = (0..count).map(|_| mean + bound * (2.0 * rng.random::<f32>() - 1.0)).collect();
            Array { name, shape, values }
        };
        Parameters { arrays: self.0.into_iter().map(array).collect() }
    }

    /// Names and shapes of the arrays; their values are empty.
    pub fn empty(self) -> Parameters {
        let array = |Initial { name, shape, .. }| Array { name, shape, values: Vec::new() };
        Parameters { arrays: self.0.into_iter().map(array).collect() }
    }

    pub fn add(&mut self, name: String, shape: &[usize], bound: f32, mean: f32) {
        self.0.push(Initial { name, shape: shape.to_vec(), bound, mean });
    }

    /// Adds weight and bias of [`Layers::linear`].
    pub fn linear(&mut self, name: &str, from: usize, to: usize) {
        self.weight(name, from, to);
        self.bias(name, to);
    }

    pub fn weight(&mut self, name: &str, from: usize, to: usize) {
        self.add(format!("{name}.weight"), &[from, to], (1.0 / from.max(1) as f32).sqrt(), 0.0);
    }

    pub fn bias(&mut self, name: &str, to: usize) {
        self.add(format!("{name}.bias"), &[to], 0.0, 0.0);
    }

    /// Adds gain and bias of [`Layers::norm`].
    pub fn norm(&mut self, name: &str, width: usize) {
        self.add(format!("{name}.gain"), &[width], 0.0, 1.0);
        self.add(format!("{name}.bias"), &[width], 0.0, 0.0);
    }

    /// Adds the weights of one transformer layer with the named attentions.
    pub fn layer(&mut self, layer: &str, attentions: &[&str], width: usize, feed_forward: usize) {
        for attention in attentions {
            for part in ["query", "key", "value", "out"] {
                self.linear(&format!("{layer}.{attention}.{part}"), width, width);
            }
            self.norm(&format!("{layer}.{attention}.norm"), width);
        }
        self.linear(&format!("{layer}.widen"), width, feed_forward);
        self.linear(&format!("{layer}.narrow"), feed_forward, width);
        self.norm(&format!("{layer}.norm"), width);
    }
}

//! Training: demonstrations, settings, seed and number of steps determine the weights bit for bit.
//!
//! A step is a function of weights, optimiser state and step number, so training resumes from a checkpoint exactly. The
//! batch is divided into parts of a fixed size, whose gradients are added in a fixed order, so the number of threads
//! does not affect the result.

use std::collections::BTreeMap;
use std::{io, thread};

use genmanip_core::Seed;

use super::adam::{Adam, learning_rate};
use super::layers::Weights;
use super::nn::{POINT_UNIT_M, Transformer};
use super::parameters::{Parameters, ParametersError, Precision};
use super::tensor::{Cpu, CpuTraining, Tensor};
use super::vision::{self, Keypoints};
use crate::{
    Batch, Demonstrations, Head, ImageBatch, Inputs, ModelSettings, Normalisation, RowImages, Sampler, TrainingSettings,
};

/// Weight of the KL divergence of the spatial softmax of labelled keypoints, relative to their L1 errors. The
/// divergence soon finds the right object; the L1 error refines the position within a cell.
const CELL_WEIGHT: f64 = 0.1;
/// Added to the spatial softmax before the logarithm, to avoid infinity.
const LEAST_SHARE: f64 = 1e-6;
/// Number of samples whose gradients are computed together; smaller (`PART_WITH_IMAGES`) with images, so that their
/// im2col matrices fit in memory that the allocator keeps.
const PART: usize = 32;
const PART_WITH_IMAGES: usize = 8;

/// A training run in progress.
pub struct Trainer<'a> {
    demonstrations: &'a Demonstrations,
    images: &'a dyn RowImages,
    normalisation: Normalisation,
    network: Transformer,
    settings: TrainingSettings,
    seed: Seed,
    sampler: Sampler,
    parameters: Parameters,
    adam: Adam,
    step: u64,
    threads: usize,
}

/// Losses and measures of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainingStep {
    /// Number of the step, from 0.
    pub step: u64,
    /// Mean L1 error of the normalised actions; of a flow head, of those to which the predicted velocities lead.
    pub l1: f64,
    /// Cross-entropy of the predicted end of the episode.
    pub end_loss: f64,
    /// Auxiliary loss of labelled keypoints: L1 errors of positions (units of 0.1 m) and of normalised pixels, plus a
    /// tenth of the KL divergence of the spatial softmax from the bilinear target.
    pub label_loss: f64,
    /// Global gradient norm before clipping.
    pub gradient_norm: f64,
    /// Learning rate of the step.
    pub learning_rate: f64,
}

/// Checkpoint of a training run.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Safetensors file with weights, both moments and averaged weights.
    pub bytes: Vec<u8>,
}

/// Reason why a training run fails.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The demonstrations have no rows.
    #[error("there are no rows to learn from")]
    NoRows,
    /// An image cannot be read.
    #[error("the images of the demonstrations cannot be read")]
    Images(#[from] io::Error),
    /// The loss has become NaN or infinite.
    #[error("the loss of step {step} is not finite")]
    NotFinite {
        /// Number of the step, from 0.
        step: u64,
    },
    /// The checkpoint cannot be read.
    #[error("the checkpoint cannot be read")]
    Checkpoint(#[from] ParametersError),
    /// The checkpoint lacks its step.
    #[error("the checkpoint does not say after which step it was written")]
    NoStep,
}

/// Prefixes of array names in a checkpoint: weights, first and second moments, averaged weights.
const PREFIXES: [&str; 4] = ["weights.", "first.", "second.", "average."];
/// Key of the number of finished steps in a checkpoint's metadata.
const STEP: &str = "step";

impl<'a> Trainer<'a> {
    /// A training run before its first step.
    ///
    /// # Errors
    /// If the demonstrations have no rows.
    pub fn new(
        demonstrations: &'a Demonstrations,
        images: &'a dyn RowImages,
        model: &ModelSettings,
        settings: &TrainingSettings,
        seed: Seed,
        threads: usize,
    ) -> Result<Self, TrainError> {
        if demonstrations.total_rows() == 0 {
            return Err(TrainError::NoRows);
        }
        let normalisation = demonstrations.normalisation();
        let gripper = normalisation.action.deviation.last().copied().unwrap_or(1.0);
        let sampler = Sampler::new(demonstrations, gripper, model.chunk, settings, seed);
        let network = Transformer::new(model.clone(), demonstrations.inputs.clone(), demonstrations.action);
        let parameters = network.initial(seed);
        let adam = Adam::new(&parameters);
        let settings = settings.clone();
        Ok(Self {
            demonstrations,
            images,
            normalisation,
            network,
            settings,
            seed,
            sampler,
            parameters,
            adam,
            step: 0,
            threads,
        })
    }

    /// Number of finished steps, which is also the number of the next one.
    pub fn finished(&self) -> u64 {
        self.step
    }

    /// Means and standard deviations of the demonstrations' inputs and actions.
    pub fn normalisation(&self) -> &Normalisation {
        &self.normalisation
    }

    /// Number of samples per step.
    pub fn batch_size(&self) -> usize {
        self.settings.batch
    }

    /// Mean L1 error of the averaged weights on the samples of the first `batches` steps.
    ///
    /// # Errors
    /// If it is not finite.
    pub fn error_of_average(&mut self, batches: u64) -> Result<f64, TrainError> {
        let weights = Transformer::load::<Cpu>(&self.average());
        let (mut sum, mut count) = (0.0, 0.0);
        for step in 0..batches {
            for batch in self.parts(step)? {
                let [actions, _] = self.network.predict(&weights, &batch).map(Tensor::values);
                let pairs = actions.iter().zip(&batch.actions).enumerate();
                let there = pairs.filter(|(place, _)| batch.mask[place / self.demonstrations.action] > 0.0);
                for (_, (got, target)) in there {
                    sum += f64::from((got - target).abs());
                    count += 1.0;
                }
            }
        }
        let error: f64 = sum / f64::max(count, 1.0);
        if error.is_finite() { Ok(error) } else { Err(TrainError::NotFinite { step: self.step }) }
    }

    /// Averaged weights rounded to half precision, which become the policy.
    pub fn average(&self) -> Parameters {
        Parameters { arrays: self.parameters.with("", &self.adam.average).collect() }.rounded_to_half()
    }

    /// Performs the next step of a run of `steps` steps, on which the learning rate depends.
    ///
    /// # Errors
    /// If the loss is not finite; the weights are then unchanged.
    pub fn step(&mut self, steps: u64) -> Result<TrainingStep, TrainError> {
        let step = self.step;
        let parts = self.parts(step)?;
        let targets = f64::from(parts.iter().flat_map(|part| &part.mask).sum::<f32>()).max(1.0);
        let loss = Loss {
            network: &self.network,
            parameters: &self.parameters,
            action: self.demonstrations.action,
            actions: targets * self.demonstrations.action as f64,
            queries: parts.iter().map(|part| part.mask.len()).sum::<usize>() as f64,
            size: self.settings.batch as f64,
            points: self.demonstrations.points,
            end_weight: self.settings.end_weight,
            kl_weight: self.settings.kl_weight,
            label_weight: self.settings.label_weight,
        };
        let (mut total, mut l1, mut end_loss, mut label_loss) = (0.0_f64, 0.0, 0.0, 0.0);
        let mut gradients: Vec<Vec<f32>> =
            self.parameters.arrays.iter().map(|array| vec![0.0; array.values.len()]).collect();
        for parts in parts.chunks(self.threads.max(1)) {
            for part in loss.of_parts(parts) {
                total += part.total;
                l1 += part.l1;
                end_loss += part.end;
                label_loss += part.labels;
                for (sum, gradient) in gradients.iter_mut().flatten().zip(part.gradients.iter().flatten()) {
                    *sum += gradient;
                }
            }
        }
        if !(total.is_finite() && gradients.iter().flatten().all(|value| value.is_finite())) {
            return Err(TrainError::NotFinite { step });
        }
        let learning_rate = learning_rate(step, steps, &self.settings);
        let gradient_norm = self.adam.step(&mut self.parameters, &gradients, step, learning_rate, &self.settings);
        self.step += 1;
        Ok(TrainingStep { step, l1, end_loss, label_loss, gradient_norm, learning_rate })
    }

    /// Batch of a step, divided into parts.
    fn parts(&mut self, step: u64) -> Result<Vec<Batch>, TrainError> {
        let Self { demonstrations, images, normalisation, settings, .. } = self;
        let mut batch = self.sampler.batch(demonstrations, *images, normalisation, step, settings.batch)?;
        let ModelSettings { head, latent, .. } = *self.network.settings();
        let noise = if head == Head::Flow { batch.actions.len() / batch.size.max(1) } else { latent };
        if noise > 0 {
            batch.draw_noise(noise, self.seed, step);
        }
        let part = if demonstrations.inputs.images.is_empty() { PART } else { PART_WITH_IMAGES };
        Ok(batch.parts(part, &demonstrations.inputs))
    }

    /// Checkpoint of the whole state, with additional metadata.
    pub fn checkpoint(&self, metadata: &BTreeMap<String, String>) -> Checkpoint {
        let weights: Vec<Vec<f32>> = self.parameters.arrays.iter().map(|array| array.values.clone()).collect();
        let parts = [&weights, &self.adam.first, &self.adam.second, &self.adam.average];
        let arrays = PREFIXES.iter().zip(parts).flat_map(|(prefix, values)| self.parameters.with(prefix, values));
        let mut metadata = metadata.clone();
        metadata.insert(STEP.into(), self.step.to_string());
        Checkpoint { bytes: Parameters { arrays: arrays.collect() }.to_bytes(Precision::Single, &metadata) }
    }

    /// Restores the state of a checkpoint of the same run; the caller checks by the metadata that it is the same.
    ///
    /// # Errors
    /// If the checkpoint is damaged or belongs to another network.
    pub fn resume(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainError> {
        let metadata = Parameters::metadata(&checkpoint.bytes)?;
        let step = metadata.get(STEP).and_then(|step| step.parse().ok()).ok_or(TrainError::NoStep)?;
        let [weights, first, second, average] =
            PREFIXES.map(|prefix| self.parameters.from_bytes(&checkpoint.bytes, prefix));
        let values = |part: Parameters| part.arrays.into_iter().map(|array| array.values).collect();
        (self.parameters, self.step) = (weights?, step);
        self.adam = Adam { first: values(first?), second: values(second?), average: values(average?) };
        Ok(())
    }
}

impl Checkpoint {
    /// Metadata given when the checkpoint was written.
    ///
    /// # Errors
    /// If the bytes are not a checkpoint.
    pub fn metadata(&self) -> Result<BTreeMap<String, String>, ParametersError> {
        Parameters::metadata(&self.bytes)
    }
}

impl Batch {
    /// The same samples, divided into parts of at most `size`.
    fn parts(self, size: usize, inputs: &Inputs) -> Vec<Self> {
        let per = |values: &[f32]| values.len() / self.size.max(1);
        let (actions, mask, labels) = (per(&self.actions), per(&self.mask), per(&self.labels));
        let (noise, time) = (per(&self.noise), per(&self.time));
        let (robot, objects) = (inputs.robot.len(), inputs.slots * inputs.object.len());
        let part = |from: usize| {
            let to = (from + size).min(self.size);
            let cut = |values: &[f32], width: usize| values[from * width..to * width].to_vec();
            Self {
                size: to - from,
                robot: cut(&self.robot, robot),
                objects: cut(&self.objects, objects),
                words: cut(&self.words, inputs.words),
                images: self
                    .images
                    .iter()
                    .map(|images| ImageBatch {
                        patches: cut(&images.patches, per(&images.patches)),
                        shift: cut(&images.shift, 2),
                    })
                    .collect(),
                labels: cut(&self.labels, labels),
                actions: cut(&self.actions, actions),
                mask: cut(&self.mask, mask),
                noise: cut(&self.noise, noise),
                time: cut(&self.time, time),
            }
        };
        (0..self.size).step_by(size.max(1)).map(part).collect()
    }
}

/// Loss function of a batch, evaluated in parts; the sums over parts are divided by the numbers of the whole batch.
struct Loss<'a> {
    network: &'a Transformer,
    parameters: &'a Parameters,
    /// Number of entries of an action.
    action: usize,
    /// Number of entries of all action targets of the batch.
    actions: f64,
    /// Number of decoder queries of the batch.
    queries: f64,
    /// Number of samples of the batch.
    size: f64,
    /// Number of labelled keypoints per sample.
    points: usize,
    end_weight: f64,
    kl_weight: f64,
    label_weight: f64,
}

/// Contribution of a part to losses and gradients of its batch.
struct PartLoss {
    /// Weighted sum of all losses, whose gradients these are.
    total: f64,
    l1: f64,
    end: f64,
    labels: f64,
    gradients: Vec<Vec<f32>>,
}

impl Loss<'_> {
    /// Losses of the parts in their order; each is computed in a thread of its own.
    fn of_parts(&self, parts: &[Batch]) -> Vec<PartLoss> {
        match parts {
            [one] => vec![self.of(one)],
            parts => thread::scope(|scope| {
                let running: Vec<_> = parts.iter().map(|part| scope.spawn(|| self.of(part))).collect();
                let join = |thread: thread::ScopedJoinHandle<PartLoss>| {
                    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                };
                running.into_iter().map(join).collect()
            }),
        }
    }

    fn of(&self, part: &Batch) -> PartLoss {
        let arrays = &self.parameters.arrays;
        let leaves: Vec<Tensor<CpuTraining>> =
            arrays.iter().map(|array| Tensor::leaf(&array.values, &array.shape)).collect();
        let names = arrays.iter().map(|array| array.name.clone());
        let weights: Weights<CpuTraining> = names.zip(leaves.iter().cloned()).collect();
        let output = self.network.forward(&weights, part);
        let chunk = part.mask.len() / part.size;
        let mask = Tensor::new(&part.mask, &[part.size, chunk, 1]);
        let targets = match self.network.settings().head {
            Head::L1 => Tensor::new(&part.actions, &[part.size, chunk, self.action]),
            Head::Flow => Tensor::new(&part.velocity(), &[part.size, chunk, self.action]),
        };
        let error = output.actions.sub(targets).mul(mask);
        let absolute = error.clone().abs();
        let (actions, l1) = match self.network.settings().head {
            Head::L1 => (absolute.clone(), absolute),
            Head::Flow => {
                // The remaining time turns an error of velocity into one of the actions that it leads to.
                let left: Vec<f32> = part.time.iter().map(|time| 1.0 - time).collect();
                (error.clone().mul(error), absolute.mul(Tensor::new(&left, &[part.size, 1, 1])))
            }
        };
        let [actions, l1] = [actions, l1].map(|errors| errors.sum().scale(1.0 / self.actions));
        // Cross-entropy of the logit x against the end 1 - mask: softplus(x) - x (1 - mask).
        let over = Tensor::new(&part.mask.iter().map(|there| 1.0 - there).collect::<Vec<_>>(), &[part.size, chunk, 1]);
        let end = output.end.clone().softplus().sub(output.end.mul(over)).sum().scale(1.0 / self.queries);
        let value = |tensor: &Tensor<CpuTraining>| tensor.clone().values().first().map_or(f64::NAN, |x| f64::from(*x));
        let (l1_value, end_value) = (value(&l1), value(&end));
        let loss = actions.add(end.scale(self.end_weight));
        let loss = match output.divergence {
            Some(divergence) => loss.add(divergence.scale(self.kl_weight / self.size)),
            None => loss,
        };
        let labels = self.labels(&output.points, &output.keypoints, part);
        let labels_value = labels.as_ref().map_or(0.0, value);
        let loss = match labels {
            Some(labels) => loss.add(labels.scale(self.label_weight)),
            None => loss,
        };
        let total = value(&loss);
        let gradients = loss.gradients(&leaves);
        PartLoss { total, l1: l1_value, end: end_value, labels: labels_value, gradients }
    }

    /// Auxiliary loss of the labelled keypoints, in 3D and in each image that shows them; `None` without labels.
    fn labels(
        &self,
        points: &Option<Tensor<CpuTraining>>,
        keypoints: &[Keypoints<CpuTraining>],
        part: &Batch,
    ) -> Option<Tensor<CpuTraining>> {
        let (count, size) = (self.points, part.size);
        let points = points.clone()?;
        let rows = part.labels.chunks_exact(part.labels.len() / size.max(1));
        let targets: Vec<f32> =
            rows.clone().flat_map(|row| &row[..3 * count]).map(|metres| metres / POINT_UNIT_M).collect();
        let entries = self.size * count as f64;
        let error = points.sub(Tensor::new(&targets, &[size, 3 * count])).abs().sum().scale(1.0 / (3.0 * entries));
        let images = self.network.images().iter().zip(&part.images).zip(keypoints).enumerate();
        let errors = images.map(|(image, ((input, batch), Keypoints { pixels, shares, .. }))| {
            let seen = rows.clone().flat_map(|row| row[3 * count * (1 + image)..].chunks_exact(3).take(count));
            let targets: Vec<f32> = seen.clone().flat_map(|point| [point[0], point[1]]).collect();
            let mask: Vec<f32> = seen.clone().map(|point| point[2]).collect();
            let pixels = pixels.clone().narrow(1, 0..count).sub(Tensor::new(&targets, &[size, count, 2]));
            let pixels = pixels.abs().mul(Tensor::new(&mask, &[size, count, 1])).sum().scale(1.0 / (2.0 * entries));
            let shifted = seen.enumerate().flat_map(|(place, point)| {
                let shift = &batch.shift[2 * (place / count)..];
                let target = vision::target([point[0] + shift[0], point[1] + shift[1]], input);
                target.into_iter().map(|share| share * point[2])
            });
            let shifted: Vec<f32> = shifted.collect();
            let entropy: f32 = shifted.iter().filter(|share| **share > 0.0).map(|share| -share * share.ln()).sum();
            let targets = Tensor::new(&shifted, &[size, count, shares.length(2)]);
            let logs = shares.clone().narrow(1, 0..count).shift(LEAST_SHARE).log();
            let divergence = logs.mul(targets).sum().scale(-1.0).shift(-f64::from(entropy));
            pixels.add(divergence.scale(CELL_WEIGHT / entries))
        });
        Some(errors.fold(error, Tensor::add))
    }
}

#[cfg(test)]
mod tests;

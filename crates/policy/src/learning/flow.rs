//! Conditional flow matching (Lipman et al., 2023) along straight lines (rectified flow, Liu et al., 2023): the network
//! predicts the velocity that leads a noised chunk of actions, from noise at time 0 to actions at time 1. Samples of the
//! flow follow the distribution of the demonstrations' actions, where the L1 head predicts their median.

use std::f32::consts::{PI, TAU};

use genmanip_core::Seed;
use rand::{Rng, RngExt};

use crate::Batch;

/// Number of Euler steps from noise to actions at inference. Chosen by hand.
pub const STEPS: usize = 10;

/// Angular frequencies of the time features: π/2 · 2^k. Chosen by hand.
const FREQUENCIES: usize = 6;
/// Number of features of a time.
pub const TIME_FEATURES: usize = 2 * FREQUENCIES;

/// Fourier features of a time from 0 to 1.
pub fn time_features(time: f32) -> impl Iterator<Item = f32> {
    (0..FREQUENCIES).flat_map(move |k| {
        let (sine, cosine) = (PI / 2.0 * 2_f32.powi(k as i32) * time).sin_cos();
        [sine, cosine]
    })
}

/// Standard normal noise of a chunk, as a function of the seed.
pub fn noise(seed: Seed, count: usize) -> Vec<f32> {
    let mut rng = seed.rng();
    (0..count).map(|_| normal(&mut rng)).collect()
}

/// Standard normal number by the Box–Muller transform.
fn normal(rng: &mut impl Rng) -> f32 {
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    radius * (TAU * rng.random::<f32>()).cos()
}

impl Batch {
    /// Draws `count` entries of noise and the time of each sample of a step, as functions of the seed and of the
    /// sample's number, counted over all steps.
    pub(super) fn draw_noise(&mut self, count: usize, seed: Seed, step: u64) {
        for sample in 0..self.size as u64 {
            let seed = seed.fork("flow").fork_index(step * self.size as u64 + sample);
            self.noise.extend(noise(seed.fork("noise"), count));
            self.time.push(seed.fork("time").rng().random());
        }
    }

    /// Noised actions at the times of the samples. Places after the end of a demonstration remain noise, so that they
    /// say nothing about the end; at inference, they do so after the predicted end.
    pub(super) fn noised(&self) -> Vec<f32> {
        let places = self.noise.iter().zip(self.velocity()).enumerate();
        let per_sample = self.noise.len() / self.size.max(1);
        places.map(|(place, (noise, velocity))| noise + self.time[place / per_sample] * velocity).collect()
    }

    /// Velocity from noise to actions, the target of the network; 0 after the end of a demonstration.
    pub(super) fn velocity(&self) -> Vec<f32> {
        let action = self.actions.len() / self.mask.len().max(1);
        let places = self.actions.iter().zip(&self.noise).enumerate();
        places.map(|(place, (action_target, noise))| self.mask[place / action] * (action_target - noise)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_standard_normal_and_a_function_of_the_seed() {
        let drawn = noise(Seed::new(1), 20_000);
        assert_eq!(drawn, noise(Seed::new(1), 20_000));
        assert_ne!(drawn[..9], noise(Seed::new(2), 9));
        let moment = |power: i32| drawn.iter().map(|x| f64::from(*x).powi(power)).sum::<f64>() / drawn.len() as f64;
        assert!(moment(1).abs() < 0.03 && (moment(2) - 1.0).abs() < 0.04 && (moment(4) - 3.0).abs() < 0.3);
    }

    #[test]
    fn the_velocity_leads_from_noise_to_actions() {
        let mut batch = Batch {
            size: 2,
            actions: vec![3.0, 4.0, 0.0, 0.0, -1.0, 0.5, 2.0, 1.0],
            mask: vec![1.0, 0.0, 1.0, 1.0],
            ..Batch::default()
        };
        batch.draw_noise(4, Seed::new(1), 7);
        batch.time = vec![0.25, 1.0];
        let (noised, velocity) = (batch.noised(), batch.velocity());
        assert_eq!(noised[2..4], batch.noise[2..4], "after the end there is only noise");
        let is_near = |one: f32, other: f32| (one - other).abs() < 1e-5;
        assert!((0..2).all(|at| is_near(noised[at] + 0.75 * velocity[at], batch.actions[at])), "{noised:?}");
        assert!((4..8).all(|at| is_near(noised[at], batch.actions[at])), "{noised:?}");
    }
}

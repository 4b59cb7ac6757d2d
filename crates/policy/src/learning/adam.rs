//! AdamW (Loshchilov and Hutter, 2019) with gradient clipping and an exponential moving average of the weights.

use super::parameters::{Array, Parameters};
use crate::TrainingSettings;

const BETA: (f32, f32) = (0.9, 0.999);
const EPSILON: f32 = 1e-8;

/// State of the optimiser: one entry per value of the parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// First moments: exponential moving averages of the gradients.
    pub first: Vec<Vec<f32>>,
    /// Second moments: exponential moving averages of the squared gradients.
    pub second: Vec<Vec<f32>>,
    /// Exponential moving average of the weights.
    pub average: Vec<Vec<f32>>,
}

impl Adam {
    /// The state before the first step.
    pub fn new(parameters: &Parameters) -> Self {
        let zeros: Vec<Vec<f32>> = parameters.arrays.iter().map(|array| vec![0.0; array.values.len()]).collect();
        let average = parameters.arrays.iter().map(|array| array.values.clone()).collect();
        Self { first: zeros.clone(), second: zeros, average }
    }

    /// Applies step number `step`, counted from 0; returns the global gradient norm before clipping.
    pub fn step(
        &mut self,
        parameters: &mut Parameters,
        gradients: &[Vec<f32>],
        step: u64,
        rate: f64,
        settings: &TrainingSettings,
    ) -> f64 {
        let squares = gradients.iter().flatten().map(|value| f64::from(*value).powi(2));
        let norm = squares.sum::<f64>().sqrt();
        let clip = (settings.max_gradient_norm / norm.max(1e-12)).min(1.0) as f32;
        let count = (step + 1).min(100_000) as i32;
        let correction = (1.0 - BETA.0.powi(count), 1.0 - BETA.1.powi(count));
        let rate_now = rate as f32;
        // The decay is lower in early steps, so that the average forgets the initial weights.
        let keep = settings.average_decay.min((1.0 + step as f64) / (10.0 + step as f64)) as f32;
        let moments = self.first.iter_mut().zip(&mut self.second).zip(&mut self.average);
        for ((Array { shape, values, .. }, gradient), ((first, second), average)) in
            parameters.arrays.iter_mut().zip(gradients).zip(moments)
        {
            let decay = if shape.len() == 2 { (rate * settings.weight_decay) as f32 } else { 0.0 };
            let entries = values.iter_mut().zip(gradient).zip(first.iter_mut().zip(second).zip(average));
            for ((value, gradient), ((first, second), average)) in entries {
                let gradient = gradient * clip;
                *first = BETA.0 * *first + (1.0 - BETA.0) * gradient;
                *second = BETA.1 * *second + (1.0 - BETA.1) * gradient * gradient;
                let direction = (*first / correction.0) / ((*second / correction.1).sqrt() + EPSILON);
                *value -= decay * *value + rate_now * direction;
                *average = keep * *average + (1.0 - keep) * *value;
            }
        }
        norm
    }
}

/// Learning rate of a step: linear warm-up, then cosine decay to 0 at the last step.
pub fn learning_rate(step: u64, steps: u64, settings: &TrainingSettings) -> f64 {
    if step < settings.warm_up {
        return settings.learning_rate * (step + 1) as f64 / settings.warm_up as f64;
    }
    let share = (step - settings.warm_up) as f64 / steps.saturating_sub(settings.warm_up).max(1) as f64;
    settings.learning_rate * 0.5 * (1.0 + (std::f64::consts::PI * share.min(1.0)).cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_warms_up_and_decays_to_zero() {
        let settings = TrainingSettings { learning_rate: 2.0, warm_up: 10, ..TrainingSettings::default() };
        let rate = |step| learning_rate(step, 110, &settings);
        assert_eq!((rate(0), rate(9), rate(10)), (0.2, 2.0, 2.0));
        assert!((rate(60) - 1.0).abs() < 1e-9 && rate(109) < 0.001);
    }

    #[test]
    fn a_parabola_is_descended() {
        let array = Array { name: "x".into(), shape: vec![2], values: vec![3.0, -2.0] };
        let mut parameters = Parameters { arrays: vec![array] };
        let mut adam = Adam::new(&parameters);
        let settings = TrainingSettings::default();
        for step in 0..2000 {
            let gradient = parameters.arrays[0].values.iter().map(|x| 2.0 * (x - 1.0)).collect();
            adam.step(&mut parameters, &[gradient], step, 0.01, &settings);
        }
        let near = |values: &[f32]| values.iter().all(|x| (x - 1.0).abs() < 0.02);
        assert!(near(&parameters.arrays[0].values) && near(&adam.average[0]), "{parameters:?} {adam:?}");
    }
}

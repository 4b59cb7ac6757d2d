//! Style encoder of the conditional variational autoencoder (CVAE) of ACT (Zhao et al., 2023): what distinguishes
//! demonstrations of the same scene goes into a latent variable, which is 0 at inference.

use super::layers::{Initials, Layers};
use super::neighbourhoods::NetworkBackend;
use super::tensor::Tensor;
use crate::{Batch, ModelSettings};

/// Bound of the initial values of learned tokens. Chosen by hand.
const MAX_TOKEN: f32 = 0.1;

/// Adds the initial parameters of the style encoder, and of the token of the latent variable.
pub(super) fn add(settings: &ModelSettings, robot: usize, action: usize, arrays: &mut Initials) {
    let ModelSettings { width, feed_forward, encoder_layers, chunk, latent, .. } = *settings;
    arrays.linear("style.robot", robot, width);
    arrays.linear("style.action", action + 1, width);
    arrays.add("style.tokens".into(), &[1, 2 + chunk, width], MAX_TOKEN, 0.0);
    for layer in 0..encoder_layers {
        arrays.layer(&format!("style.{layer}"), &["attention"], width, feed_forward);
    }
    arrays.norm("style.norm", width);
    arrays.linear("style.latent", width, 2 * latent);
    arrays.linear("latent", latent, width);
}

/// Sample of the latent variable of each demonstrated chunk by the batch's noise (batch × latent), and the KL divergence
/// of its distribution from the standard normal one, summed over the batch.
pub(super) fn sample<B: NetworkBackend>(
    layers: &Layers<B>,
    settings: &ModelSettings,
    robot: usize,
    batch: &Batch,
) -> [Tensor<B>; 2] {
    let ModelSettings { width, encoder_layers, chunk, latent, .. } = *settings;
    let size = batch.size;
    let action = batch.actions.len() / batch.mask.len().max(1);
    // Places after the end hold zeros, and say so.
    let places = batch.actions.chunks_exact(action).zip(&batch.mask);
    let places: Vec<f32> =
        places.flat_map(|(target, there)| target.iter().map(move |entry| there * entry).chain([*there])).collect();
    let tokens = vec![
        Tensor::owned(vec![0.0; size * width], &[size, 1, width]),
        layers.linear(Tensor::new(&batch.robot, &[size, 1, robot]), "style.robot"),
        layers.linear(Tensor::new(&places, &[size, chunk, action + 1]), "style.action"),
    ];
    let mut tokens = Tensor::join(tokens, 1).add(layers.get("style.tokens"));
    for layer in 0..encoder_layers {
        tokens = layers.encode(tokens, &format!("style.{layer}"));
    }
    let distribution = layers.linear(layers.norm(tokens.narrow(1, 0..1), "style.norm"), "style.latent");
    let distribution = distribution.reshape(&[size, 2 * latent]);
    let (mean, log_variance) = (distribution.clone().narrow(1, 0..latent), distribution.narrow(1, latent..2 * latent));
    let deviation = log_variance.clone().scale(0.5).exp();
    let noise = Tensor::new(&batch.noise, &[size, latent]);
    // KL(N(m, s²) ‖ N(0, 1)) = (m² + s² − ln s² − 1) / 2.
    let divergence = mean.clone().mul(mean.clone()).add(log_variance.clone().exp()).sub(log_variance).shift(-1.0);
    [mean.add(deviation.mul(noise)), divergence.sum().scale(0.5)]
}

//! Keypoints of an image: convolutions, then the expected pixel of each channel of a spatial softmax (Levine et al., 2016),
//! with the features found there.
//!
//! Convolutions see the same content alike wherever it lies, and a keypoint is a pixel to a fraction of a cell: few
//! layouts suffice to learn where things are. The instruction scales and shifts the channels (FiLM, Perez et al., 2018),
//! so that keypoints can follow the object it names.

use burn_backend::Backend;

use super::layers::{Initials, Layers};
use super::tensor::Tensor;
use crate::{ImageBatch, ImageInput, ModelSettings, normalised_pixel};

/// Side of the patches of the first convolution, pixels.
const PATCH: usize = 4;
/// Convolutions after the first, each added to its input.
const CONVOLUTIONS: usize = 3;
const SIDE: usize = 3;

/// Keypoints of the images of a batch.
pub(super) struct Keypoints<B: Backend> {
    /// Tokens: batch × keypoints × width.
    pub tokens: Tensor<B>,
    /// Normalised pixels in the images before augmentation: batch × keypoints × 2.
    pub pixels: Tensor<B>,
}

/// Adds the arrays of a camera.
pub(super) fn add(name: &str, settings: &ModelSettings, has_words: bool, arrays: &mut Initials) {
    let ModelSettings { width, channels, keypoints, .. } = *settings;
    arrays.convolution(&format!("{name}.patch"), 3, channels, PATCH);
    for layer in 0..CONVOLUTIONS {
        arrays.convolution(&format!("{name}.convolution.{layer}"), channels, channels, SIDE);
        if has_words {
            arrays.linear(&format!("{name}.gain.{layer}"), width, channels);
            arrays.linear(&format!("{name}.offset.{layer}"), width, channels);
        }
    }
    arrays.convolution(&format!("{name}.keypoint"), channels, keypoints, 1);
    arrays.linear(&format!("{name}.token"), channels + 2, width);
}

/// Keypoints of the images of one camera.
pub(super) fn keypoints<B: Backend>(
    layers: &Layers<B>,
    name: &str,
    settings: &ModelSettings,
    instruction: Option<&Tensor<B>>,
    input: &ImageInput,
    batch: &ImageBatch,
) -> Keypoints<B> {
    let ModelSettings { channels, keypoints, .. } = *settings;
    let (rows, columns) = (input.height / PATCH, input.width / PATCH);
    let size = batch.shift.len() / 2;
    let image = Tensor::new(&batch.planes, &[size, 3, input.height, input.width]);
    let mut features = layers.convolve(image, &format!("{name}.patch"), PATCH, 0).relu();
    for layer in 0..CONVOLUTIONS {
        let mut found = layers.convolve(features.clone(), &format!("{name}.convolution.{layer}"), 1, SIDE / 2);
        if let Some(instruction) = instruction {
            let of = |part: &str| {
                let part = format!("{name}.{part}.{layer}");
                layers.linear(instruction.clone(), &part).reshape(&[size, channels, 1, 1])
            };
            found = found.clone().add(found.mul(of("gain"))).add(of("offset"));
        }
        features = features.add(found.relu());
    }
    let cells = rows * columns;
    let scores = layers.convolve(features.clone(), &format!("{name}.keypoint"), 1, 0);
    let shares = scores.reshape(&[size, keypoints, cells]).softmax();
    let pixels = shares.clone().matmul(centres(input, rows, columns).expand(&[size, cells, 2]));
    let found = shares.matmul(features.reshape(&[size, channels, cells]).swap(1, 2));
    // Keypoints are those of the image before augmentation.
    let pixels = pixels.sub(Tensor::new(&batch.shift, &[size, 1, 2]));
    let tokens = layers.linear(Tensor::join(vec![found, pixels.clone()], 2), &format!("{name}.token"));
    Keypoints { tokens, pixels }
}

/// Centres of the patches in normalised pixels: 1 × cells × 2.
fn centres<B: Backend>(input: &ImageInput, rows: usize, columns: usize) -> Tensor<B> {
    let middle = (PATCH as f64 - 1.0) / 2.0;
    let centre = |cell: usize| [cell % columns, cell / columns].map(|at| (at * PATCH) as f64 + middle);
    let values: Vec<f32> = (0..rows * columns).flat_map(|cell| normalised_pixel(centre(cell), input)).collect();
    Tensor::new(&values, &[1, rows * columns, 2])
}

//! Keypoints of an image: convolutions, then the expected pixel of each channel of a spatial softmax (Levine et al., 2016),
//! with the features found there.
//!
//! Convolutions are translation-equivariant, and a keypoint has sub-cell resolution: few layouts suffice to learn where
//! objects are. The instruction scales the weights of the convolutions and shifts their output (FiLM, Perez et al.,
//! 2018), so that keypoints can follow the object it names.

use super::layers::{Initials, Layers};
use super::neighbourhoods::{NetworkBackend, SIDE, neighbourhoods};
use super::tensor::Tensor;
use crate::description::PATCH;
use crate::{ImageBatch, ImageInput, ModelSettings, normalised_pixel};

/// Residual convolutions after the first one. Chosen by hand.
const CONVOLUTIONS: usize = 3;

/// Keypoints of the images of a batch.
pub struct Keypoints<B: NetworkBackend> {
    /// Features found at the keypoints: batch × keypoints × channels.
    pub features: Tensor<B>,
    /// Normalised pixels in the images before augmentation: batch × keypoints × 2.
    pub pixels: Tensor<B>,
    /// Spatial softmax weights of the cells of each keypoint: batch × keypoints × cells.
    pub shares: Tensor<B>,
}

/// Adds the initial parameters of the vision network of one camera.
pub(super) fn add(name: &str, settings: &ModelSettings, has_words: bool, arrays: &mut Initials) {
    let ModelSettings { width, channels, keypoints, .. } = *settings;
    arrays.linear(&format!("{name}.patch"), PATCH * PATCH * 3, channels);
    for layer in 0..CONVOLUTIONS {
        arrays.weight(&format!("{name}.convolution.{layer}"), SIDE * SIDE * channels, channels);
        if has_words {
            arrays.linear(&format!("{name}.gain.{layer}"), width, channels);
            arrays.linear(&format!("{name}.offset.{layer}"), width, channels);
        } else {
            arrays.bias(&format!("{name}.convolution.{layer}"), channels);
        }
    }
    arrays.linear(&format!("{name}.keypoint"), channels, keypoints);
}

/// Keypoints of the images of one camera.
pub(super) fn keypoints<B: NetworkBackend>(
    layers: &Layers<B>,
    name: &str,
    settings: &ModelSettings,
    instruction: Option<&Tensor<B>>,
    input: &ImageInput,
    batch: &ImageBatch,
) -> Keypoints<B> {
    let ModelSettings { channels, .. } = *settings;
    let [rows, columns] = input.patches();
    let (size, cells) = (batch.shift.len() / 2, rows * columns);
    let patches = Tensor::new(&batch.patches, &[size, cells, PATCH * PATCH * 3]);
    let mut features = layers.linear(patches, &format!("{name}.patch")).relu();
    for layer in 0..CONVOLUTIONS {
        let around = neighbourhoods(features.clone().reshape(&[size, rows, columns, channels]));
        let convolution = format!("{name}.convolution.{layer}");
        let found = match instruction {
            None => layers.linear(around, &convolution),
            Some(instruction) => {
                let of = |part: &str| layers.linear(instruction.clone(), &format!("{name}.{part}.{layer}"));
                let weight = layers.get(&format!("{convolution}.weight"));
                let weight = weight.reshape(&[1, SIDE * SIDE * channels, channels]);
                let scaled = weight.clone().add(weight.mul(of("gain")));
                around.matmul(scaled).add(of("offset"))
            }
        };
        features = features.add(found.relu());
    }
    let scores = layers.linear(features.clone(), &format!("{name}.keypoint"));
    let shares = scores.swap(1, 2).softmax();
    let pixels = shares.clone().matmul(centres(input, rows, columns).expand(&[size, cells, 2]));
    // Subtracting the augmentation's shift gives pixels of the original image.
    let pixels = pixels.sub(Tensor::new(&batch.shift, &[size, 1, 2]));
    Keypoints { features: shares.clone().matmul(features), pixels, shares }
}

/// Centres of the patches in normalised pixels: 1 × cells × 2.
fn centres<B: NetworkBackend>(input: &ImageInput, rows: usize, columns: usize) -> Tensor<B> {
    let middle = (PATCH as f64 - 1.0) / 2.0;
    let centre = |cell: usize| [cell % columns, cell / columns].map(|at| (at * PATCH) as f64 + middle);
    let values: Vec<f32> = (0..rows * columns).flat_map(|cell| normalised_pixel(centre(cell), input)).collect();
    Tensor::new(&values, &[1, rows * columns, 2])
}

/// Target weights of the cells, whose expected pixel is a given point of the augmented image (normalised pixels):
/// bilinear weights of the four cell centres around the point, or of the nearest ones at the border.
pub(super) fn target(point: [f32; 2], input: &ImageInput) -> Vec<f32> {
    let [rows, columns] = input.patches();
    let middle = (PATCH as f32 - 1.0) / 2.0;
    let along = |at: f32, length: usize, cells: usize| {
        let place = ((at + 1.0) * length as f32 / 2.0 - 0.5 - middle) / PATCH as f32;
        let place = place.clamp(0.0, cells as f32 - 1.0);
        let first = (place as usize).min(cells.saturating_sub(2));
        (0..cells)
            .map(move |cell| if cell == first || cell == first + 1 { 1.0 - (place - cell as f32).abs() } else { 0.0 })
    };
    let [u, v] = point;
    along(v, input.height, rows)
        .flat_map(|row| along(u, input.width, columns).map(move |column| row * column))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learning::tensor::Cpu;

    #[test]
    fn the_expected_pixel_of_a_target_is_its_point() {
        let input = ImageInput { camera: "static".into(), width: 32, height: 16 };
        let [rows, columns] = input.patches();
        let centres = centres::<Cpu>(&input, rows, columns).values();
        for point in [[0.0, 0.0], [-0.3, 0.5], [0.71, -0.6]] {
            let shares = target(point, &input);
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            for axis in 0..2 {
                let expected: f32 =
                    shares.iter().enumerate().map(|(cell, share)| share * centres[2 * cell + axis]).sum();
                assert!((expected - point[axis]).abs() < 1e-5, "{point:?}: {expected} along axis {axis}");
            }
        }
    }
}

//! Data augmentation: pure functions of the seed and of the sample's number, counted over all steps.

use genmanip_core::Seed;
use rand::{Rng, RngExt};

use crate::description::PATCH;
use crate::{Augmentation, ImageInput};

/// Augmentation of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ImageChange {
    /// Shift of the content to the right and down, pixels.
    shift_px: [i64; 2],
    gain: [f32; 3],
}

impl ImageChange {
    /// Identity, for inference.
    #[cfg(feature = "learn")]
    pub const NONE: Self = Self { shift_px: [0; 2], gain: [1.0; 3] };

    /// Shift of the image content in the units of [`normalised_pixel`].
    pub fn shift(&self, size: &ImageInput) -> [f32; 2] {
        [self.shift_px[0] as f32 * 2.0 / size.width as f32, self.shift_px[1] as f32 * 2.0 / size.height as f32]
    }

    /// Appends the augmented image to `patches`: patches in row-major order, pixels of each patch in row-major order,
    /// RGB values of about −2 to 2. Pixels beyond whole patches are omitted.
    pub fn push(&self, rgb: &[u8], size: &ImageInput, patches: &mut Vec<f32>) {
        let inside = |at: usize, shift: i64, length: usize| (at as i64 - shift).clamp(0, length as i64 - 1) as usize;
        let [rows, columns] = size.patches();
        let starts: Vec<usize> =
            (0..columns * PATCH).map(|column| 3 * inside(column, self.shift_px[0], size.width)).collect();
        // Values are normalised with mean 128 and scale 64, roughly the mean and standard deviation of uniformly
        // distributed 8-bit values. The gain applies before normalisation: it changes the brightness.
        let factors = self.gain.map(|gain| gain / 64.0);
        for patch_row in 0..rows {
            for columns in starts.chunks_exact(PATCH) {
                for row in patch_row * PATCH..(patch_row + 1) * PATCH {
                    let row = &rgb[3 * size.width * inside(row, self.shift_px[1], size.height)..];
                    for column in columns {
                        let pixel = row[*column..*column + 3].iter().zip(factors);
                        patches.extend(pixel.map(|(value, factor)| f32::from(*value) * factor - 2.0));
                    }
                }
            }
        }
    }
}

/// Generator of the random augmentations of one sample.
pub(crate) struct Changes<R> {
    rng: R,
    settings: Augmentation,
}

impl Augmentation {
    /// Augmentations of the sample at `position`, counted over all steps: step × batch size + index in the batch.
    pub(crate) fn of_sample(&self, seed: Seed, position: u64) -> Changes<impl Rng + use<>> {
        Changes { rng: seed.fork("augmentation").fork_index(position).rng(), settings: self.clone() }
    }
}

impl<R: Rng> Changes<R> {
    /// Random augmentation of the next image of the sample.
    pub fn image(&mut self) -> ImageChange {
        let most = i64::from(self.settings.shift_px);
        let shift_px = [(); 2].map(|()| self.rng.random_range(-most..=most));
        let gain = [(); 3].map(|()| 1.0 + self.settings.gain * self.symmetric());
        ImageChange { shift_px, gain }
    }

    /// Adds uniform noise of amplitude `state_noise` to normalised entries.
    pub fn noise(&mut self, entries: &mut [f32]) {
        let most = self.settings.state_noise;
        if most > 0.0 {
            entries.iter_mut().for_each(|entry| *entry += most * self.symmetric());
        }
    }

    /// Uniform random number in [−1, 1).
    fn symmetric(&mut self) -> f32 {
        2.0 * self.rng.random::<f32>() - 1.0
    }
}

/// Pixel coordinates (u right, v down, pixel centres at integers) scaled to −1 at one edge of the image and 1 at the
/// opposite one.
pub fn normalised_pixel(pixel: [f64; 2], size: &ImageInput) -> [f32; 2] {
    let normalised = |at: f64, length: usize| ((at + 0.5) * 2.0 / length as f64 - 1.0) as f32;
    [normalised(pixel[0], size.width), normalised(pixel[1], size.height)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_image_moves_its_points_along() {
        let size = ImageInput { camera: "static".into(), width: 8, height: 4 };
        let mut rgb = vec![0_u8; size.bytes()];
        // One bright green pixel at u = 3, v = 1.
        rgb[3 * (8 + 3) + 1] = 255;
        let settings = Augmentation { shift_px: 1, gain: 0.0, state_noise: 0.0 };
        let mut seen = std::collections::BTreeSet::new();
        for position in 0..40 {
            let change = settings.of_sample(Seed::new(1), position).image();
            assert_eq!(change, settings.of_sample(Seed::new(1), position).image());
            let mut patches = Vec::new();
            change.push(&rgb, &size, &mut patches);
            let bright = patches.iter().position(|value| *value > 0.0).unwrap();
            let (channel, v, u) = (bright % 3, bright / 12 % 4, bright / 48 * 4 + bright / 3 % 4);
            assert_eq!(channel, 1);
            let (from, to) = (normalised_pixel([3.0, 1.0], &size), normalised_pixel([u as f64, v as f64], &size));
            let shift = change.shift(&size);
            assert!((0..2).all(|axis| (to[axis] - from[axis] - shift[axis]).abs() < 1e-6), "{from:?} {to:?} {shift:?}");
            seen.insert((u, v));
        }
        assert_eq!(seen.len(), 9, "every shift of at most one pixel");
    }
}

//! Normalisation of vectors by mean and standard deviation.

use serde::{Deserialize, Serialize};

/// Mean and standard deviation per entry of a vector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scale {
    /// Mean of each entry.
    pub mean: Vec<f32>,
    /// Standard deviations of the entries, positive.
    pub deviation: Vec<f32>,
}

impl Scale {
    /// Minimum standard deviation, in metres and in entries of rotation matrices. An entry that hardly varies would
    /// otherwise count as much as one that matters for the task. Chosen by hand.
    pub const MIN_DEVIATION: f32 = 0.02;

    /// Mean and standard deviation of vectors of `width` entries, at least [`Scale::MIN_DEVIATION`].
    pub fn of<'a>(width: usize, vectors: impl Iterator<Item = &'a [f32]> + Clone) -> Self {
        let count = vectors.clone().count().max(1) as f64;
        let mut mean = vec![0.0_f64; width];
        for vector in vectors.clone() {
            mean.iter_mut().zip(vector).for_each(|(sum, value)| *sum += f64::from(*value) / count);
        }
        let mut variance = vec![0.0_f64; width];
        for vector in vectors {
            let centred = vector.iter().zip(&mean).map(|(value, mean)| f64::from(*value) - mean);
            variance.iter_mut().zip(centred).for_each(|(sum, value)| *sum += value * value / count);
        }
        let deviation = variance.iter().map(|variance| (variance.sqrt() as f32).max(Self::MIN_DEVIATION)).collect();
        Self { mean: mean.into_iter().map(|mean| mean as f32).collect(), deviation }
    }

    /// Number of entries; `None` if the two arrays differ in length, or a value is not finite or a deviation not
    /// positive.
    pub fn width(&self) -> Option<usize> {
        let is_usable = self.mean.iter().all(|mean| mean.is_finite())
            && self.deviation.iter().all(|deviation| deviation.is_finite() && *deviation > 0.0);
        (is_usable && self.mean.len() == self.deviation.len()).then_some(self.mean.len())
    }

    /// Vector with the mean subtracted, divided by the standard deviation.
    pub fn normalise<'a>(&'a self, vector: &'a [f32]) -> impl Iterator<Item = f32> + 'a {
        vector
            .iter()
            .zip(self.mean.iter().zip(&self.deviation))
            .map(|(value, (mean, deviation))| (value - mean) / deviation)
    }

    /// Vector restored from a normalised one; inverse of [`Scale::normalise`].
    pub fn restore<'a>(&'a self, vector: &'a [f32]) -> impl Iterator<Item = f32> + 'a {
        vector
            .iter()
            .zip(self.mean.iter().zip(&self.deviation))
            .map(|(value, (mean, deviation))| value * deviation + mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restored_vectors_are_the_original_ones() {
        let vectors: Vec<Vec<f32>> =
            (0..50).map(|row| (0..4).map(|entry| (row * entry) as f32 * 0.01 + entry as f32).collect()).collect();
        let scale = Scale::of(4, vectors.iter().map(Vec::as_slice));
        assert_eq!(scale.width(), Some(4));
        assert_eq!(scale.deviation[0], Scale::MIN_DEVIATION);
        for vector in &vectors {
            let normalised: Vec<f32> = scale.normalise(vector).collect();
            let restored: Vec<f32> = scale.restore(&normalised).collect();
            assert!(vector.iter().zip(&restored).all(|(one, other)| (one - other).abs() < 1e-5), "{restored:?}");
        }
        let third: Vec<f32> = vectors.iter().filter_map(|vector| scale.normalise(vector).nth(3)).collect();
        let mean: f32 = third.iter().sum::<f32>() / 50.0;
        let square: f32 = third.iter().map(|value| value * value).sum::<f32>() / 50.0;
        assert!(mean.abs() < 1e-4 && (square - 1.0).abs() < 1e-3, "{mean} {square}");
    }
}

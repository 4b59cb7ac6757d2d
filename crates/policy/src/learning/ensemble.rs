//! Temporal ensembling (ACT, Zhao et al., 2023): the mean of all predictions for the same row (control step).

use super::network::Prediction;

/// Predictions of one episode that overlap.
#[derive(Clone, Debug)]
pub struct Ensemble {
    decay: f64,
    /// First row of each prediction, and the prediction; oldest first.
    chunks: Vec<(usize, Prediction)>,
}

impl Ensemble {
    /// Ensemble with weights exp(−`decay` · i), where i = 0 is the oldest prediction of a row.
    pub fn new(decay: f64) -> Self {
        Self { decay, chunks: Vec::new() }
    }

    /// Adds the prediction made at `row`, and returns for each of its rows the mean over all predictions that reach it.
    /// Rows must not fall between calls.
    pub fn add(&mut self, row: usize, prediction: Prediction) -> Prediction {
        self.chunks.retain(|(first, chunk)| first + chunk.actions.len() > row);
        self.chunks.push((row, prediction));
        let rows = row..row + self.chunks.last().map_or(0, |(_, chunk)| chunk.actions.len());
        let (actions, end) = rows.map(|row| self.mean(row)).unzip();
        Prediction { actions, end }
    }

    /// Mean action of a row, and mean probability that the episode is over before it.
    fn mean(&self, row: usize) -> (Vec<f32>, f32) {
        let reaching = self.chunks.iter().filter_map(|(first, chunk)| {
            let place = row - first;
            Some((chunk.actions.get(place)?, chunk.end.get(place)?))
        });
        let (mut total, mut end, mut action) = (0.0, 0.0, Vec::new());
        for (age, (predicted, over)) in reaching.enumerate() {
            let weight = (-self.decay * age as f64).exp() as f32;
            action.resize(predicted.len(), 0.0);
            action.iter_mut().zip(predicted).for_each(|(sum, value)| *sum += weight * value);
            end += weight * over;
            total += weight;
        }
        action.iter_mut().for_each(|sum| *sum /= total);
        (action, end / total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Prediction made at `row`: the number of the prediction, and the row that an action is meant for.
    fn counted(number: usize, row: usize) -> Prediction {
        let place = |at: usize| vec![number as f32, (row + at) as f32];
        Prediction { actions: (0..4).map(place).collect(), end: (0..4).map(|at| (number + at) as f32).collect() }
    }

    /// Means by their definition: over all predictions of a row, the oldest with weight 1.
    #[test]
    fn overlapping_predictions_are_averaged_with_the_oldest_first() {
        for (decay, every) in [(0.0, 1), (0.5, 1), (0.5, 3), (-0.3, 2), (0.2, 5)] {
            let mut ensemble = Ensemble::new(decay);
            for number in 0..7 {
                let row = number * every;
                let got = ensemble.add(row, counted(number, row));
                assert_eq!(got.actions.len(), 4);
                for place in 0..4 {
                    let reaching: Vec<usize> = (0..=number).filter(|one| one * every + 4 > row + place).collect();
                    let weights: Vec<f64> = (0..reaching.len()).map(|age| (-decay * age as f64).exp()).collect();
                    let mean = |of: &dyn Fn(usize) -> f64| {
                        let sum: f64 = reaching.iter().zip(&weights).map(|(one, weight)| weight * of(*one)).sum();
                        (sum / weights.iter().sum::<f64>()) as f32
                    };
                    let expected = [
                        mean(&|one| one as f64),
                        (row + place) as f32,
                        mean(&|one| (one + row + place - one * every) as f64),
                    ];
                    let got = [got.actions[place][0], got.actions[place][1], got.end[place]];
                    let is_near = got.iter().zip(&expected).all(|(one, other)| (one - other).abs() < 1e-4);
                    assert!(is_near, "decay {decay}, row {row} + {place}: {got:?}, expected {expected:?}");
                }
            }
        }
    }
}

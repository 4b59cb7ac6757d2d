//! Baseline of learnability: k-nearest-neighbour prediction of the motion in the next second, from other episodes of
//! the task.

use serde::Serialize;

/// Rate at which episodes are sampled to rows, Hz.
pub(super) const ROWS_HZ: f64 = 15.0;
/// Prediction horizon, s. Chosen by hand.
const AHEAD_S: f64 = 1.0;
/// Number of nearest neighbours whose motions are averaged (k). Chosen by hand.
const NEIGHBOURS: usize = 5;
/// Maximum number of rows of a task that are predicted, and (`MAX_SEARCHED`) that are searched for neighbours: keeps
/// the time at a few seconds.
const MAX_PREDICTED: usize = 1500;
const MAX_SEARCHED: usize = 20_000;

/// Mean absolute errors of predicted motions over the next second, in standard deviations of each entry.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Prediction {
    /// Number of rows whose motion was predicted.
    pub rows: usize,
    /// Error of the joints' change, predicted by the nearest neighbours.
    pub joints_l1: f64,
    /// Error of the joints' change, predicted by the mean over the task.
    pub joints_mean_l1: f64,
    /// Error of the change of the tool pose (position and 6D rotation), predicted by the nearest neighbours.
    pub tool_l1: f64,
    /// Error of the change of the tool pose, predicted by the mean over the task.
    pub tool_mean_l1: f64,
}

/// State of the robot and the goal's objects in one row of an episode.
pub(super) struct Row {
    /// Joints (rad), gripper opening (m) and, per object of the goal, position (m) and heading.
    pub state: Vec<f64>,
    /// Positions of the arm joints, rad.
    pub joints: Vec<f64>,
    /// Tool position (m) and 6D rotation.
    pub tool: Vec<f64>,
}

/// Sums of errors over tasks.
#[derive(Default)]
pub(super) struct Neighbours {
    rows: usize,
    joints: [f64; 2],
    tool: [f64; 2],
}

/// A state with the motion that follows it, and the number of its episode.
struct Example {
    episode: usize,
    state: Vec<f32>,
    /// Changes within the prediction horizon, divided by their standard deviations: joints, then tool.
    motion: Vec<f64>,
}

impl Neighbours {
    /// Adds the episodes of a task.
    pub(super) fn add(&mut self, episodes: &[&[Row]]) {
        let ahead = (AHEAD_S * ROWS_HZ) as usize;
        let mut examples: Vec<(usize, Vec<f64>, Vec<f64>)> = Vec::new();
        for (episode, rows) in episodes.iter().enumerate() {
            examples.extend(rows.iter().zip(rows.iter().skip(ahead)).map(|(now, then)| {
                let change = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| b - a).collect::<Vec<_>>();
                (
                    episode,
                    now.state.clone(),
                    [change(&now.joints, &then.joints), change(&now.tool, &then.tool)].concat(),
                )
            }));
        }
        let Some(joints) = episodes.iter().find_map(|rows| rows.first()).map(|row| row.joints.len()) else { return };
        let examples = thinned(examples, MAX_SEARCHED);
        let states = scales(examples.iter().map(|(_, state, _)| state.as_slice()));
        let motions = scales(examples.iter().map(|(.., motion)| motion.as_slice()));
        let examples: Vec<Example> = examples
            .into_iter()
            .map(|(episode, state, motion)| Example {
                episode,
                state: scaled(&state, &states).map(|value| value as f32).collect(),
                motion: scaled(&motion, &motions).collect(),
            })
            .collect();
        let stride = examples.len().div_ceil(MAX_PREDICTED).max(1);
        for example in examples.iter().step_by(stride) {
            let nearest = nearest(example, &examples);
            if nearest.is_empty() {
                continue;
            }
            let errors = example.motion.iter().enumerate().map(|(entry, &actual)| {
                let mean = nearest.iter().map(|near| near.motion[entry]).sum::<f64>() / nearest.len() as f64;
                // Motions are normalised: predicting their mean is predicting 0.
                [(actual - mean).abs(), actual.abs()]
            });
            let errors: Vec<[f64; 2]> = errors.collect();
            let (of_joints, of_tool) = errors.split_at(joints);
            for (sums, errors) in [(&mut self.joints, of_joints), (&mut self.tool, of_tool)] {
                for which in 0..2 {
                    sums[which] += errors.iter().map(|error| error[which]).sum::<f64>() / errors.len().max(1) as f64;
                }
            }
            self.rows += 1;
        }
    }

    /// Mean errors; `None` without rows.
    pub(super) fn prediction(&self) -> Option<Prediction> {
        let mean = |sum: f64| sum / self.rows as f64;
        (self.rows > 0).then(|| Prediction {
            rows: self.rows,
            joints_l1: mean(self.joints[0]),
            joints_mean_l1: mean(self.joints[1]),
            tool_l1: mean(self.tool[0]),
            tool_mean_l1: mean(self.tool[1]),
        })
    }
}

/// At most `most` examples, subsampled evenly.
fn thinned<T>(all: Vec<T>, most: usize) -> Vec<T> {
    let stride = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(stride).collect()
}

/// Mean and standard deviation of each entry.
fn scales<'a>(rows: impl Iterator<Item = &'a [f64]> + Clone) -> Vec<[f64; 2]> {
    let count = rows.clone().count().max(1) as f64;
    let entries = rows.clone().map(<[f64]>::len).min().unwrap_or(0);
    (0..entries)
        .map(|entry| {
            let mean = rows.clone().map(|row| row[entry]).sum::<f64>() / count;
            let square = rows.clone().map(|row| (row[entry] - mean).powi(2)).sum::<f64>() / count;
            [mean, square.sqrt()]
        })
        .collect()
}

/// Row normalised to zero mean and unit standard deviation; constant entries are 0.
fn scaled<'a>(row: &'a [f64], scales: &'a [[f64; 2]]) -> impl Iterator<Item = f64> + 'a {
    row.iter().zip(scales).map(|(value, [mean, deviation])| match *deviation > 1e-9 {
        true => (value - mean) / deviation,
        false => 0.0,
    })
}

/// The [`NEIGHBOURS`] examples of other episodes whose states are nearest (Euclidean distance).
fn nearest<'a>(example: &Example, all: &'a [Example]) -> Vec<&'a Example> {
    let mut nearest: Vec<(f32, &Example)> = Vec::new();
    for other in all.iter().filter(|other| other.episode != example.episode) {
        let distance: f32 = example.state.iter().zip(&other.state).map(|(a, b)| (a - b) * (a - b)).sum();
        if nearest.len() < NEIGHBOURS || nearest.last().is_some_and(|(farthest, _)| distance < *farthest) {
            let at = nearest.partition_point(|(known, _)| *known <= distance);
            nearest.insert(at, (distance, other));
            nearest.truncate(NEIGHBOURS);
        }
    }
    nearest.into_iter().map(|(_, example)| example).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Episodes that move at a constant speed; `speed` of the number of the episode and its state.
    fn measured(speed: impl Fn(usize, f64) -> f64) -> Prediction {
        let row = |position: f64| Row { state: vec![position, 7.0], joints: vec![position], tool: vec![position, 1.0] };
        let episodes: Vec<Vec<Row>> = (0..20)
            .map(|episode| {
                let mut position = 0.25 * episode as f64;
                (0..40)
                    .map(|_| {
                        position += speed(episode, position);
                        row(position)
                    })
                    .collect()
            })
            .collect();
        let mut neighbours = Neighbours::default();
        neighbours.add(&episodes.iter().map(Vec::as_slice).collect::<Vec<_>>());
        neighbours.prediction().unwrap()
    }

    #[test]
    fn motions_that_follow_from_the_state_are_predicted_and_others_are_not() {
        let smooth = measured(|_, position| 0.02 * (position * 0.3).sin());
        assert!(smooth.joints_l1 < 0.2 * smooth.joints_mean_l1, "{smooth:?}");
        let random = measured(|episode, _| if (episode * 7 + episode / 3) % 2 == 0 { 0.05 } else { -0.05 });
        assert!(random.joints_l1 > 0.6 * random.joints_mean_l1, "{random:?}");
    }
}

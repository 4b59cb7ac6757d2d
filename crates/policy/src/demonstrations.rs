//! Demonstrations as arrays, and batches of windows of them.

use genmanip_core::Seed;
use rand::RngExt;

use crate::{Inputs, Normalisation, Scale};

/// One demonstration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Demonstration {
    /// Inputs at each row, and once more at the end: [`Inputs::width`] numbers each.
    pub inputs: Vec<f32>,
    /// Action of each row.
    pub actions: Vec<f32>,
}

/// Demonstrations of one task distribution.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstrations {
    /// Layout of a row's inputs.
    pub inputs: Inputs,
    /// Entries of an action; the last is the gripper's.
    pub action: usize,
    /// The demonstrations, in a fixed order.
    pub episodes: Vec<Demonstration>,
}

impl Demonstrations {
    /// Rows of a demonstration.
    fn rows(&self, episode: &Demonstration) -> usize {
        episode.actions.len() / self.action.max(1)
    }

    /// Rows of all demonstrations.
    pub fn total_rows(&self) -> usize {
        self.episodes.iter().map(|episode| self.rows(episode)).sum()
    }

    /// Means and deviations of inputs and actions.
    pub fn normalisation(&self) -> Normalisation {
        let Inputs { robot, object, .. } = &self.inputs;
        let rows = self.episodes.iter().flat_map(|episode| episode.inputs.chunks_exact(self.inputs.width()));
        let actions = self.episodes.iter().flat_map(|episode| episode.actions.chunks_exact(self.action));
        let objects = rows.clone().flat_map(|row| row[robot.len()..].chunks_exact(object.len()));
        Normalisation {
            robot: Scale::of(robot.len(), rows.map(|row| &row[..robot.len()])),
            object: Scale::of(object.len(), objects.filter(|object| object[0] > 0.0)),
            action: Scale::of(self.action, actions),
        }
    }

    /// Adds a row's normalised inputs to those of a batch.
    pub(crate) fn push_inputs(inputs: &Inputs, normalisation: &Normalisation, row: &[f32], batch: &mut Batch) {
        let (robot, objects) = row.split_at(inputs.robot.len());
        batch.robot.extend(normalisation.robot.normalise(robot));
        for object in objects.chunks_exact(inputs.object.len()) {
            match object.first().is_some_and(|present| *present > 0.0) {
                true => batch.objects.extend(normalisation.object.normalise(object)),
                false => batch.objects.extend(object),
            }
        }
        batch.size += 1;
    }
}

/// Windows of demonstrations, normalised.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// Number of samples.
    pub size: usize,
    /// Robot tokens: size × robot.
    pub robot: Vec<f32>,
    /// Object tokens: size × slots × object.
    pub objects: Vec<f32>,
    /// Action targets: size × chunk × action; 0 after the end of the demonstration.
    pub actions: Vec<f32>,
    /// 1 where there is a target, 0 after the end: size × chunk.
    pub mask: Vec<f32>,
}

/// Order of the samples: a function of seed and step.
#[derive(Clone, Debug)]
pub struct Sampler {
    seed: Seed,
    /// Episode and row of each sample of an epoch, before they are shuffled.
    samples: Vec<(u32, u32)>,
    /// Number of the epoch whose order is known, and the order.
    epoch: Option<(u64, Vec<u32>)>,
    chunk: usize,
}

/// Change of the gripper's value that counts as a transition, in deviations; chosen.
const TRANSITION: f32 = 0.25;

impl Sampler {
    /// Samples of all rows and of the end of each demonstration; rows within a chunk before a change of the gripper
    /// have `copies` of them.
    pub fn new(
        demonstrations: &Demonstrations,
        gripper_deviation: f32,
        chunk: usize,
        copies: usize,
        seed: Seed,
    ) -> Self {
        let mut samples = Vec::new();
        for (number, episode) in demonstrations.episodes.iter().enumerate() {
            let rows = demonstrations.rows(episode);
            let gripper: Vec<f32> =
                episode.actions.chunks_exact(demonstrations.action).filter_map(|row| row.last().copied()).collect();
            for row in 0..=rows {
                let coming = &gripper[row.min(rows)..(row + chunk).min(rows)];
                let changes = coming.windows(2).any(|two| (two[1] - two[0]).abs() > TRANSITION * gripper_deviation);
                let copies = if changes { copies.max(1) } else { 1 };
                samples.extend(std::iter::repeat_n((number as u32, row as u32), copies));
            }
        }
        Self { seed: seed.fork("samples"), samples, epoch: None, chunk }
    }

    /// Number of samples of an epoch.
    pub fn epoch_length(&self) -> usize {
        self.samples.len()
    }

    /// The batch of a step.
    pub fn batch(
        &mut self,
        demonstrations: &Demonstrations,
        normalisation: &Normalisation,
        step: u64,
        size: usize,
    ) -> Batch {
        let mut batch = Batch::default();
        for position in step * size as u64..(step + 1) * size as u64 {
            let (episode, row) = self.sample(position);
            self.push(demonstrations, normalisation, episode as usize, row as usize, &mut batch);
        }
        batch
    }

    fn sample(&mut self, position: u64) -> (u32, u32) {
        let length = self.samples.len() as u64;
        let (epoch, place) = (position / length, (position % length) as usize);
        if self.epoch.as_ref().is_none_or(|(known, _)| *known != epoch) {
            let mut order: Vec<u32> = (0..length as u32).collect();
            let mut rng = self.seed.fork_index(epoch).rng();
            for end in (1..order.len()).rev() {
                order.swap(end, rng.random_range(0..=end));
            }
            self.epoch = Some((epoch, order));
        }
        let place = self.epoch.as_ref().map_or(place, |(_, order)| order[place] as usize);
        self.samples[place]
    }

    /// Adds the window that begins at a row.
    fn push(
        &self,
        demonstrations: &Demonstrations,
        normalisation: &Normalisation,
        episode: usize,
        row: usize,
        batch: &mut Batch,
    ) {
        let Demonstrations { inputs, action, episodes } = demonstrations;
        let Demonstration { inputs: rows, actions } = &episodes[episode];
        let width = inputs.width();
        Demonstrations::push_inputs(inputs, normalisation, &rows[row * width..(row + 1) * width], batch);
        for place in row..row + self.chunk {
            match actions.get(place * action..(place + 1) * action) {
                Some(target) => batch.actions.extend(normalisation.action.normalise(target)),
                None => batch.actions.extend(std::iter::repeat_n(0.0, *action)),
            }
            batch.mask.push(if (place + 1) * action <= actions.len() { 1.0 } else { 0.0 });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Demonstrations of 3 and 5 rows whose action is 100 · episode + row.
    fn counted() -> Demonstrations {
        let inputs = Inputs { robot: vec!["row".into()], object: vec!["present".into(), "x".into()], slots: 2 };
        let episode = |number: usize, rows: usize| Demonstration {
            inputs: (0..=rows).flat_map(|row| [row as f32, 1.0, 7.0, 0.0, 0.0]).collect(),
            actions: (0..rows).flat_map(|row| [(100 * number + row) as f32, 0.0]).collect(),
        };
        Demonstrations { inputs, action: 2, episodes: vec![episode(0, 3), episode(1, 5)] }
    }

    fn as_it_is() -> Normalisation {
        let same = |width| Scale { mean: vec![0.0; width], deviation: vec![1.0; width] };
        Normalisation { robot: same(1), object: same(2), action: same(2) }
    }

    #[test]
    fn windows_end_with_the_demonstration() {
        let demonstrations = counted();
        let mut sampler = Sampler::new(&demonstrations, 1.0, 4, 2, Seed::new(1));
        assert_eq!(sampler.epoch_length(), 3 + 1 + 5 + 1);
        let batch = sampler.batch(&demonstrations, &as_it_is(), 0, 10);
        let mut seen = Vec::new();
        for sample in 0..10 {
            let row = batch.robot[sample] as usize;
            let mask = &batch.mask[sample * 4..(sample + 1) * 4];
            let first: Vec<f32> = batch.actions[sample * 8..(sample + 1) * 8].iter().step_by(2).copied().collect();
            // The naive implementation: which episode, by the first target, or neither at an end.
            let (episode, rows) = match (mask[0] > 0.0, first[0] >= 100.0) {
                (true, false) => (0, 3),
                (true, true) => (1, 5),
                (false, _) => (usize::from(row == 5), row),
            };
            for place in 0..4 {
                let there = row + place < rows;
                assert_eq!(mask[place], f32::from(u8::from(there)), "row {row} of episode {episode}");
                let expected = if there { (100 * episode + row + place) as f32 } else { 0.0 };
                assert_eq!(first[place], expected);
            }
            assert_eq!(&batch.objects[sample * 4..(sample + 1) * 4], [1.0, 7.0, 0.0, 0.0]);
            seen.push((episode, row));
        }
        seen.sort_unstable();
        let all = (0..=3).map(|row| (0, row)).chain((0..=5).map(|row| (1, row)));
        assert_eq!(seen, all.collect::<Vec<_>>(), "an epoch holds each sample once");
    }

    #[test]
    fn batches_depend_on_seed_and_step_alone() {
        let demonstrations = counted();
        let sampler = |seed| Sampler::new(&demonstrations, 1.0, 4, 2, Seed::new(seed));
        let mut first = sampler(1);
        let expected: Vec<Batch> = (0..9).map(|step| first.batch(&demonstrations, &as_it_is(), step, 3)).collect();
        let mut backwards = sampler(1);
        for step in (0..9).rev() {
            assert_eq!(backwards.batch(&demonstrations, &as_it_is(), step, 3), expected[step as usize]);
        }
        assert_ne!(sampler(2).batch(&demonstrations, &as_it_is(), 0, 3), expected[0]);
    }

    #[test]
    fn rows_before_a_change_of_the_gripper_come_oftener() {
        let mut demonstrations = counted();
        demonstrations.episodes[1].actions[9] = 1.0;
        let sampler = |copies| Sampler::new(&demonstrations, 1.0, 2, copies, Seed::new(1)).epoch_length();
        assert_eq!((sampler(1), sampler(3)), (10, 12));
    }
}

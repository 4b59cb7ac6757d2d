//! Demonstrations as arrays, and sampling of normalised batches from them.

use std::io;

use genmanip_core::Seed;
use rand::RngExt;

use crate::augmentation::ImageChange;
use crate::{Augmentation, Inputs, Normalisation, Scale, TrainingSettings};

/// One demonstration as arrays over its rows (control steps).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Demonstration {
    /// Inputs at each row, and once more at the end: [`Inputs::width`] numbers each.
    pub inputs: Vec<f32>,
    /// Actions of all rows: [`Demonstrations::action`] numbers each.
    pub actions: Vec<f32>,
    /// Hashed words of the instruction: [`Inputs::words`] numbers.
    pub words: Vec<f32>,
    /// Labels of each row, and once more at the end: [`Demonstrations::labels_width`] numbers each; empty without
    /// labels.
    pub labels: Vec<f32>,
}

/// Source of the images of demonstrations.
pub trait RowImages: Send + Sync {
    /// Images of a row, in the order of [`Inputs::images`], one after the other: row-major, three bytes per pixel.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, episode: usize, row: usize) -> io::Result<Vec<u8>>;
}

/// Source for inputs without images.
impl RowImages for () {
    fn read(&self, _episode: usize, _row: usize) -> io::Result<Vec<u8>> {
        Ok(Vec::new())
    }
}

/// Demonstrations of one task distribution.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstrations {
    /// Layout of a row's inputs.
    pub inputs: Inputs,
    /// Number of entries of an action; the last one is the gripper's.
    pub action: usize,
    /// Number of labelled keypoints per row; 0 without labels.
    pub points: usize,
    /// The demonstrations, in a fixed order.
    pub episodes: Vec<Demonstration>,
}

impl Demonstrations {
    /// Number of rows of a demonstration.
    fn rows(&self, episode: &Demonstration) -> usize {
        episode.actions.len() / self.action.max(1)
    }

    /// Number of rows of all demonstrations.
    pub fn total_rows(&self) -> usize {
        self.episodes.iter().map(|episode| self.rows(episode)).sum()
    }

    /// Numbers of a row's labels: per point its position (m, world frame), then per image and point its normalised
    /// pixel ([`crate::normalised_pixel`]) and 1 if that lies in the image, else 0.
    pub fn labels_width(inputs: &Inputs, points: usize) -> usize {
        3 * points * (1 + inputs.images.len())
    }

    /// Means and standard deviations of inputs and actions.
    pub fn normalisation(&self) -> Normalisation {
        let Inputs { robot, object, .. } = &self.inputs;
        let rows = self.episodes.iter().flat_map(|episode| episode.inputs.chunks_exact(self.inputs.width()));
        let actions = self.episodes.iter().flat_map(|episode| episode.actions.chunks_exact(self.action));
        let objects = rows.clone().flat_map(|row| row[robot.len()..].chunks_exact(object.len().max(1)));
        Normalisation {
            robot: Scale::of(robot.len(), rows.map(|row| &row[..robot.len()])),
            object: Scale::of(object.len(), objects.filter(|object| object[0] > 0.0)),
            action: Scale::of(self.action, actions),
        }
    }

    /// Appends a row's inputs, normalised, to a batch.
    pub(crate) fn push_inputs(inputs: &Inputs, normalisation: &Normalisation, row: &[f32], batch: &mut Batch) {
        let (robot, objects) = row.split_at(inputs.robot.len());
        batch.robot.extend(normalisation.robot.normalise(robot));
        for object in objects.chunks_exact(inputs.object.len().max(1)) {
            match object.first().is_some_and(|present| *present > 0.0) {
                true => batch.objects.extend(normalisation.object.normalise(object)),
                false => batch.objects.extend(object),
            }
        }
        batch.size += 1;
    }

    /// Appends the images of a row, augmented by `change`, to a batch.
    ///
    /// # Errors
    /// If the number of bytes is not that of the input images.
    pub(crate) fn push_images(
        inputs: &Inputs,
        rgb: &[u8],
        change: &mut dyn FnMut() -> ImageChange,
        batch: &mut Batch,
    ) -> io::Result<()> {
        let expected: usize = inputs.images.iter().map(crate::ImageInput::bytes).sum();
        if rgb.len() != expected {
            return Err(io::Error::other(format!("expected images of {expected} bytes, got {}", rgb.len())));
        }
        batch.images.resize(inputs.images.len(), ImageBatch::default());
        let mut rest = rgb;
        for (size, images) in inputs.images.iter().zip(&mut batch.images) {
            let (image, behind) = rest.split_at(size.bytes());
            let change = change();
            change.push(image, size, &mut images.patches);
            images.shift.extend(change.shift(size));
            rest = behind;
        }
        Ok(())
    }
}

/// Images of one camera for a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageBatch {
    /// Patches of the images: size × rows × columns × RGB values of a patch's pixels, normalised to about −2 to 2.
    pub patches: Vec<f32>,
    /// Shift of the image content by augmentation, in normalised pixels: size × 2.
    pub shift: Vec<f32>,
}

/// Batch of normalised samples; each is a window of a demonstration that starts at a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// Number of samples in the batch.
    pub size: usize,
    /// Robot tokens: size × robot.
    pub robot: Vec<f32>,
    /// Object tokens: size × slots × object.
    pub objects: Vec<f32>,
    /// Hashed words of the instructions: size × words.
    pub words: Vec<f32>,
    /// Images of each camera.
    pub images: Vec<ImageBatch>,
    /// Labels: size × [`Demonstrations::labels_width`].
    pub labels: Vec<f32>,
    /// Action targets: size × chunk × action; 0 after the end of the demonstration.
    pub actions: Vec<f32>,
    /// 1 where there is a target, 0 after the end: size × chunk.
    pub mask: Vec<f32>,
    /// Noise of a flow head: size × chunk × action; of the latent style variable in training: size × latent; else empty.
    pub noise: Vec<f32>,
    /// Times of a flow head, from 0 (noise) to 1 (actions): size; empty for the L1 head and at inference.
    pub time: Vec<f32>,
}

/// Sampler of batches; the order of samples is a function of seed and step.
#[derive(Clone, Debug)]
pub struct Sampler {
    seed: Seed,
    /// Episode and row of each sample of an epoch, before shuffling.
    samples: Vec<(u32, u32)>,
    /// Number and shuffled order of the epoch that was used last. `None` before the first batch.
    epoch: Option<(u64, Vec<u32>)>,
    chunk: usize,
    augmentation: Augmentation,
}

/// Minimum change of the gripper's action that counts as a transition, in standard deviations. Chosen by hand.
const TRANSITION: f32 = 0.25;

impl Sampler {
    /// Sampler over all rows and the end of each demonstration. Oversamples rows whose chunk contains a change of the
    /// gripper by [`TrainingSettings::transition_copies`], and rows of the first chunk additionally by
    /// [`TrainingSettings::start_copies`].
    pub fn new(
        demonstrations: &Demonstrations,
        gripper_deviation: f32,
        chunk: usize,
        settings: &TrainingSettings,
        seed: Seed,
    ) -> Self {
        let TrainingSettings { transition_copies, start_copies, augmentation, .. } = settings.clone();
        let mut samples = Vec::new();
        for (number, episode) in demonstrations.episodes.iter().enumerate() {
            let rows = demonstrations.rows(episode);
            let gripper: Vec<f32> =
                episode.actions.chunks_exact(demonstrations.action).filter_map(|row| row.last().copied()).collect();
            for row in 0..=rows {
                let coming = &gripper[row.min(rows)..(row + chunk).min(rows)];
                let changes = coming.windows(2).any(|two| (two[1] - two[0]).abs() > TRANSITION * gripper_deviation);
                let copies = if changes { transition_copies.max(1) } else { 1 };
                let copies = if row < chunk { copies * start_copies.max(1) } else { copies };
                samples.extend(std::iter::repeat_n((number as u32, row as u32), copies));
            }
        }
        Self { seed: seed.fork("samples"), samples, epoch: None, chunk, augmentation }
    }

    /// Number of samples of an epoch.
    pub fn epoch_length(&self) -> usize {
        self.samples.len()
    }

    /// Batch of a step, counted from 0.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn batch(
        &mut self,
        demonstrations: &Demonstrations,
        images: &dyn RowImages,
        normalisation: &Normalisation,
        step: u64,
        size: usize,
    ) -> io::Result<Batch> {
        let mut batch = Batch::default();
        for position in step * size as u64..(step + 1) * size as u64 {
            let (episode, row) = self.sample(position);
            let (episode, row) = (episode as usize, row as usize);
            self.push(demonstrations, normalisation, episode, row, &mut batch);
            let mut changes = self.augmentation.of_sample(self.seed, position);
            let robot = batch.robot.len() - demonstrations.inputs.robot.len();
            changes.noise(&mut batch.robot[robot..]);
            let rgb = images.read(episode, row)?;
            Demonstrations::push_images(&demonstrations.inputs, &rgb, &mut || changes.image(), &mut batch)?;
        }
        Ok(batch)
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

    /// Appends the window that starts at a row, to a batch.
    fn push(
        &self,
        demonstrations: &Demonstrations,
        normalisation: &Normalisation,
        episode: usize,
        row: usize,
        batch: &mut Batch,
    ) {
        let Demonstrations { inputs, action, points, episodes } = demonstrations;
        let Demonstration { inputs: rows, actions, words, labels } = &episodes[episode];
        let width = inputs.width();
        let labelled = Demonstrations::labels_width(inputs, *points);
        batch.words.extend(words);
        batch.labels.extend(&labels[row * labelled..(row + 1) * labelled]);
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
        let inputs = Inputs {
            robot: vec!["row".into()],
            object: vec!["present".into(), "x".into()],
            slots: 2,
            ..Inputs::default()
        };
        let episode = |number: usize, rows: usize| Demonstration {
            inputs: (0..=rows).flat_map(|row| [row as f32, 1.0, 7.0, 0.0, 0.0]).collect(),
            actions: (0..rows).flat_map(|row| [(100 * number + row) as f32, 0.0]).collect(),
            ..Demonstration::default()
        };
        Demonstrations { inputs, action: 2, points: 0, episodes: vec![episode(0, 3), episode(1, 5)] }
    }

    fn as_it_is() -> Normalisation {
        let same = |width| Scale { mean: vec![0.0; width], deviation: vec![1.0; width] };
        Normalisation { robot: same(1), object: same(2), action: same(2) }
    }

    #[test]
    fn windows_end_with_the_demonstration() {
        let demonstrations = counted();
        let mut sampler = Sampler::new(&demonstrations, 1.0, 4, &TrainingSettings::default(), Seed::new(1));
        assert_eq!(sampler.epoch_length(), 3 + 1 + 5 + 1);
        let batch = sampler.batch(&demonstrations, &(), &as_it_is(), 0, 10).unwrap();
        let mut seen = Vec::new();
        for sample in 0..10 {
            let row = batch.robot[sample] as usize;
            let mask = &batch.mask[sample * 4..(sample + 1) * 4];
            let first: Vec<f32> = batch.actions[sample * 8..(sample + 1) * 8].iter().step_by(2).copied().collect();
            // Recovers episode and row from the first target; an end has no target.
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
        let augmentation = Augmentation { state_noise: 0.1, ..Augmentation::default() };
        let noisy = TrainingSettings { augmentation, ..TrainingSettings::default() };
        let sampler = |seed| Sampler::new(&demonstrations, 1.0, 4, &noisy, Seed::new(seed));
        let batch = |sampler: &mut Sampler, step| sampler.batch(&demonstrations, &(), &as_it_is(), step, 3).unwrap();
        let mut first = sampler(1);
        let expected: Vec<Batch> = (0..9).map(|step| batch(&mut first, step)).collect();
        let mut backwards = sampler(1);
        for step in (0..9).rev() {
            assert_eq!(batch(&mut backwards, step), expected[step as usize]);
        }
        assert_ne!(batch(&mut sampler(2), 0), expected[0]);
    }

    #[test]
    fn rows_at_the_start_and_before_a_change_of_the_gripper_come_oftener() {
        let mut demonstrations = counted();
        demonstrations.episodes[1].actions[9] = 1.0;
        let length = |transition_copies, start_copies| {
            let settings = TrainingSettings { transition_copies, start_copies, ..TrainingSettings::default() };
            Sampler::new(&demonstrations, 1.0, 2, &settings, Seed::new(1)).epoch_length()
        };
        assert_eq!((length(1, 1), length(3, 1)), (10, 12));
        // The first chunk: two rows of each of the two demonstrations.
        assert_eq!((length(1, 4), length(3, 4)), (10 + 4 * 3, 12 + 4 * 3));
    }
}

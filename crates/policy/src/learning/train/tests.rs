use super::*;
use crate::{Augmentation, Demonstration, ImageInput, normalised_pixel};

fn inputs() -> Inputs {
    Inputs {
        robot: vec!["x".into(), "width".into()],
        object: vec!["present".into(), "x".into()],
        slots: 2,
        ..Inputs::default()
    }
}

fn model() -> ModelSettings {
    ModelSettings {
        width: 16,
        heads: 2,
        feed_forward: 32,
        encoder_layers: 1,
        decoder_layers: 1,
        chunk: 4,
        channels: 0,
        keypoints: 0,
        labelled_points: 0,
    }
}

fn settings() -> TrainingSettings {
    TrainingSettings { batch: 48, warm_up: 10, average_decay: 0.9, ..TrainingSettings::default() }
}

/// The robot moves to its object in steps of 0.1 and closes.
fn demonstrations() -> Demonstrations {
    let episode = |goal: f32| {
        let rows = 9;
        let at = |row: usize| goal * row.min(rows) as f32 / rows as f32;
        let inputs = (0..=rows).flat_map(|row| [at(row), 0.08, 1.0, goal, 0.0, 0.0]);
        let actions = (0..rows).flat_map(|row| [at(row + 1), if row > 6 { 0.0 } else { 0.08 }]);
        Demonstration { inputs: inputs.collect(), actions: actions.collect(), ..Demonstration::default() }
    };
    Demonstrations {
        inputs: inputs(),
        action: 2,
        points: 0,
        episodes: (1..6).map(|goal| episode(goal as f32 * 0.1)).collect(),
    }
}

fn trained(steps: u64, threads: usize) -> (Vec<f64>, String) {
    let demonstrations = demonstrations();
    let mut trainer = Trainer::new(&demonstrations, &(), &model(), &settings(), Seed::new(3), threads).unwrap();
    let losses = (0..steps).map(|_| trainer.step(steps).unwrap().l1).collect();
    (losses, trainer.average().sha256())
}

#[test]
fn the_loss_falls() {
    let (losses, _) = trained(300, 1);
    let (first, last) = (losses[0], losses[losses.len() - 1]);
    assert!(last < 0.25 * first, "{first} {last}");
}

#[test]
fn same_weights_with_any_number_of_threads_and_after_a_resume() {
    let (_, expected) = trained(40, 1);
    assert_eq!(trained(40, 2).1, expected);
    let demonstrations = demonstrations();
    let start = || Trainer::new(&demonstrations, &(), &model(), &settings(), Seed::new(3), 2).unwrap();
    let mut trainer = start();
    (0..17).for_each(|_| _ = trainer.step(40).unwrap());
    let metadata = BTreeMap::from([("steps".into(), "40".into())]);
    let checkpoint = trainer.checkpoint(&metadata);
    // What follows is lost, as after a kill.
    (0..5).for_each(|_| _ = trainer.step(40).unwrap());
    let mut trainer = start();
    trainer.resume(&checkpoint).unwrap();
    assert_eq!((trainer.finished(), checkpoint.metadata().unwrap()["steps"].as_str()), (17, "40"));
    (17..40).for_each(|_| _ = trainer.step(40).unwrap());
    assert_eq!(trainer.average().sha256(), expected);
    let mut other = Trainer::new(&demonstrations, &(), &model(), &settings(), Seed::new(4), 1).unwrap();
    (0..40).for_each(|_| _ = other.step(40).unwrap());
    assert_ne!(other.average().sha256(), expected);
    let cut = Checkpoint { bytes: checkpoint.bytes[..checkpoint.bytes.len() / 2].to_vec() };
    assert!(start().resume(&cut).is_err());
}

/// Loss and gradients of one batch.
fn loss(parameters: &Parameters, batch: &Batch) -> PartLoss {
    let network = Transformer::new(model(), inputs(), 2);
    of(&network, parameters, batch, 0)
}

fn of(network: &Transformer, parameters: &Parameters, batch: &Batch, points: usize) -> PartLoss {
    let loss = Loss {
        network,
        parameters,
        action: 2,
        actions: 20.0,
        queries: 10.0,
        size: 6.0,
        points,
        end_weight: 0.5,
        label_weight: 0.7,
    };
    loss.of(batch)
}

/// Every row once.
fn sampled(augmentation: Augmentation) -> TrainingSettings {
    TrainingSettings { transition_copies: 1, augmentation, ..TrainingSettings::default() }
}

fn batch() -> Batch {
    let demonstrations = demonstrations();
    let normalisation = demonstrations.normalisation();
    let mut sampler = Sampler::new(&demonstrations, 1.0, 4, &sampled(Augmentation::default()), Seed::new(5));
    sampler.batch(&demonstrations, &(), &normalisation, 0, 6).unwrap()
}

/// Gradients against finite differences in the middle of each array; names of the arrays without influence.
fn check_gradients(network: &Transformer, batch: &Batch, points: usize) -> Vec<String> {
    let parameters = network.initial(Seed::new(1));
    let gradients = of(network, &parameters, batch, points).gradients;
    let total = |parameters: &Parameters| {
        let PartLoss { l1, end, labels, .. } = of(network, parameters, batch, points);
        l1 + 0.5 * end + 0.7 * labels
    };
    for (index, array) in parameters.arrays.iter().enumerate() {
        let place = array.values.len() / 2;
        let moved = |by: f32| {
            let mut moved = parameters.clone();
            moved.arrays[index].values[place] += by;
            total(&moved)
        };
        let expected = (moved(2e-3) - moved(-2e-3)) / 4e-3;
        let got = f64::from(gradients[index][place]);
        assert!((got - expected).abs() < 2e-3 + 0.05 * expected.abs(), "{}: {got} {expected}", array.name);
    }
    let is_without = |index: &usize| gradients[*index].iter().all(|gradient| gradient.abs() < 1e-7);
    (0..gradients.len()).filter(is_without).map(|index| parameters.arrays[index].name.clone()).collect()
}

#[test]
fn gradients_are_those_of_finite_differences() {
    let without = check_gradients(&Transformer::new(model(), inputs(), 2), &batch(), 0);
    // A bias of the keys shifts all scores of a query alike.
    assert!(without.iter().all(|name| name.ends_with("key.bias")), "{without:?}");
}

/// Images with a bright square, whose place is a label.
struct Squares;

const SIZE: [usize; 2] = [16, 12];

fn square(episode: usize, row: usize) -> [usize; 2] {
    [2 + (5 * episode + row) % 12, 2 + (3 * episode + 2 * row) % 8]
}

impl RowImages for Squares {
    fn read(&self, episode: usize, row: usize) -> io::Result<Vec<u8>> {
        let [u, v] = square(episode, row);
        let is_bright = |at: usize| (at % SIZE[0]).abs_diff(u) < 2 && (at / SIZE[0]).abs_diff(v) < 2;
        Ok((0..SIZE[0] * SIZE[1]).flat_map(|at| if is_bright(at) { [250, 200, 30] } else { [40, 50, 60] }).collect())
    }
}

/// Demonstrations of [`demonstrations`] that are seen in an image, with an instruction, but without the object's place.
fn seen() -> (Demonstrations, ModelSettings) {
    let image = ImageInput { camera: "static".into(), width: SIZE[0], height: SIZE[1] };
    let inputs = Inputs {
        robot: vec!["x".into(), "width".into()],
        object: Vec::new(),
        slots: 0,
        words: 8,
        images: vec![image.clone()],
    };
    let mut demonstrations = demonstrations();
    for (episode, demonstration) in demonstrations.episodes.iter_mut().enumerate() {
        demonstration.inputs = demonstration.inputs.chunks_exact(6).flat_map(|row| row[..2].to_vec()).collect();
        demonstration.words = (0..8).map(|word| f32::from(u8::from(word == episode))).collect();
        let rows = demonstration.inputs.len() / 2;
        demonstration.labels = (0..rows)
            .flat_map(|row| {
                let [u, v] = normalised_pixel(square(episode, row).map(|at| at as f64), &image);
                [0.1 * u, 0.1 * v, 0.02, u, v, 1.0]
            })
            .collect();
    }
    let model = ModelSettings { channels: 8, keypoints: 3, labelled_points: 1, ..model() };
    (Demonstrations { inputs, points: 1, ..demonstrations }, model)
}

#[test]
fn gradients_of_images_are_those_of_finite_differences() {
    let (demonstrations, model) = seen();
    let changed = Augmentation { shift_px: 2, gain: 0.2, state_noise: 0.1 };
    let mut sampler = Sampler::new(&demonstrations, 1.0, 4, &sampled(changed), Seed::new(5));
    let batch = sampler.batch(&demonstrations, &Squares, &demonstrations.normalisation(), 0, 6).unwrap();
    let without = check_gradients(&Transformer::new(model, demonstrations.inputs.clone(), 2), &batch, 1);
    // A bias of scores shifts all cells alike.
    let known = ["key.bias", "image.0.keypoint.bias"];
    assert!(without.iter().all(|name| known.iter().any(|end| name.ends_with(end))), "{without:?}");
}

#[test]
fn a_keypoint_finds_what_its_label_names() {
    let (demonstrations, model) = seen();
    let augmentation = Augmentation { shift_px: 2, ..Augmentation::default() };
    let settings = TrainingSettings { label_weight: 1.0, augmentation, ..settings() };
    let mut trainer = Trainer::new(&demonstrations, &Squares, &model, &settings, Seed::new(3), 1).unwrap();
    let losses: Vec<f64> = (0..200).map(|_| trainer.step(200).unwrap().label_loss).collect();
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let (first, last) = (mean(&losses[..10]), mean(&losses[190..]));
    assert!(last < 0.4 * first, "{first} {last}");
}

#[test]
fn targets_after_the_end_have_no_influence() {
    let parameters = Transformer::new(model(), inputs(), 2).initial(Seed::new(1));
    let batch = batch();
    let mut padded = batch.clone();
    let mut changed = 0;
    for (target, there) in padded.actions.chunks_exact_mut(2).zip(&batch.mask) {
        if *there == 0.0 {
            target.fill(1e3);
            changed += 1;
        }
    }
    assert!(changed > 0);
    let (one, other) = (loss(&parameters, &batch), loss(&parameters, &padded));
    assert_eq!((one.l1, one.gradients), (other.l1, other.gradients));
}

#[test]
fn shapes_follow_the_settings() {
    let network = Transformer::new(model(), inputs(), 2);
    let output =
        network.forward(&Transformer::load::<crate::learning::tensor::Cpu>(&network.initial(Seed::new(1))), &batch());
    assert_eq!((output.actions.shape(), output.end.shape()), (vec![6, 4, 2], vec![6, 4, 1]));
}

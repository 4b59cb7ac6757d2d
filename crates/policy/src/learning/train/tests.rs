use super::super::flow;
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
        ..ModelSettings::default()
    }
}

/// Model with each head.
fn both_heads() -> [ModelSettings; 2] {
    Head::ALL.map(|head| ModelSettings { head, ..model() })
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

fn trained(model: &ModelSettings, steps: u64, threads: usize) -> (Vec<f64>, String) {
    let demonstrations = demonstrations();
    let mut trainer = Trainer::new(&demonstrations, &(), model, &settings(), Seed::new(3), threads).unwrap();
    let losses = (0..steps).map(|_| trainer.step(steps).unwrap().l1).collect();
    (losses, trainer.average().sha256())
}

#[test]
fn the_loss_falls() {
    for model in both_heads() {
        let (losses, _) = trained(&model, 300, 1);
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        let (first, last) = (mean(&losses[..5]), mean(&losses[290..]));
        // The noise of a flow hides part of what is to be predicted.
        let expected = if model.head == Head::L1 { 0.25 } else { 0.5 };
        assert!(last < expected * first, "{:?}: {first} {last}", model.head);
    }
}

#[test]
fn same_weights_with_any_number_of_threads_and_after_a_resume() {
    for model in both_heads() {
        check_resume(&model);
    }
}

fn check_resume(model: &ModelSettings) {
    let (_, expected) = trained(model, 40, 1);
    assert_eq!(trained(model, 40, 2).1, expected);
    let demonstrations = demonstrations();
    let start = || Trainer::new(&demonstrations, &(), model, &settings(), Seed::new(3), 2).unwrap();
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
    let mut other = Trainer::new(&demonstrations, &(), model, &settings(), Seed::new(4), 1).unwrap();
    (0..40).for_each(|_| _ = other.step(40).unwrap());
    assert_ne!(other.average().sha256(), expected);
    let cut = Checkpoint { bytes: checkpoint.bytes[..checkpoint.bytes.len() / 2].to_vec() };
    assert!(start().resume(&cut).is_err());
}

/// Losses and gradients of one batch.
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
        kl_weight: 0.3,
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
    let mut batch = sampler.batch(&demonstrations, &(), &normalisation, 0, 6).unwrap();
    batch.draw_noise(8, Seed::new(6), 0);
    batch
}

/// Gradients against finite differences in the middle of each array; names of the arrays without influence.
fn check_gradients(network: &Transformer, batch: &Batch, points: usize) -> Vec<String> {
    let parameters = network.initial(Seed::new(1));
    let gradients = of(network, &parameters, batch, points).gradients;
    let total = |parameters: &Parameters| of(network, parameters, batch, points).total;
    for (index, array) in parameters.arrays.iter().enumerate() {
        let place = array.values.len() / 2;
        let moved = |by: f32| {
            let mut moved = parameters.clone();
            moved.arrays[index].values[place] += by;
            total(&moved)
        };
        let got = f64::from(gradients[index][place]);
        // A step may cross a kink of a rectified unit or of an absolute value; then a smaller one does not.
        let expected = [2e-3, 5e-4].map(|step| (moved(step) - moved(-step)) / f64::from(2.0 * step));
        let is_met = expected.iter().any(|expected| (got - expected).abs() < 2e-3 + 0.05 * expected.abs());
        assert!(is_met, "{}: {got} {expected:?}", array.name);
    }
    let is_without = |index: &usize| gradients[*index].iter().all(|gradient| gradient.abs() < 1e-7);
    (0..gradients.len()).filter(is_without).map(|index| parameters.arrays[index].name.clone()).collect()
}

#[test]
fn gradients_are_those_of_finite_differences() {
    for model in both_heads() {
        let without = check_gradients(&Transformer::new(model, inputs(), 2), &batch(), 0);
        // A bias of the keys shifts all scores of a query alike.
        assert!(without.iter().all(|name| name.ends_with("key.bias")), "{without:?}");
    }
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
    for model in both_heads() {
        let network = Transformer::new(model, inputs(), 2);
        let parameters = network.initial(Seed::new(1));
        let [one, other] = [&batch, &padded].map(|batch| of(&network, &parameters, batch, 0));
        assert_eq!((one.total, one.gradients), (other.total, other.gradients));
    }
}

#[test]
fn shapes_follow_the_settings() {
    for model in both_heads() {
        let network = Transformer::new(model, inputs(), 2);
        let weights = Transformer::load::<Cpu>(&network.initial(Seed::new(1)));
        let output = network.forward(&weights, &batch());
        let [actions, end] = network.predict(&weights, &batch());
        for (actions, end) in [(output.actions, output.end), (actions, end)] {
            assert_eq!((actions.shape(), end.shape()), (vec![6, 4, 2], vec![6, 4, 1]));
        }
    }
}

/// The same input, after which half of the demonstrations move to one side and half to the other.
fn two_sides() -> Demonstrations {
    let episode = |side: f32| Demonstration {
        // A second row, at which the demonstration is over.
        inputs: vec![0.0, 0.08, 1.0, 0.08],
        actions: vec![side, 0.08],
        ..Demonstration::default()
    };
    let inputs = Inputs { object: Vec::new(), slots: 0, ..inputs() };
    Demonstrations { inputs, action: 2, points: 0, episodes: vec![episode(-1.0), episode(1.0)] }
}

#[test]
fn a_flow_learns_both_of_two_modes_and_the_l1_head_one_value() {
    let demonstrations = two_sides();
    let settings = TrainingSettings { learning_rate: 3e-3, ..settings() };
    let predicted = |head: Head| -> Vec<f32> {
        let model = ModelSettings { head, chunk: 1, width: 32, feed_forward: 64, ..model() };
        let mut trainer = Trainer::new(&demonstrations, &(), &model, &settings, Seed::new(3), 1).unwrap();
        (0..900).for_each(|_| _ = trainer.step(900).unwrap());
        let network = Transformer::new(model, demonstrations.inputs.clone(), 2);
        let weights = Transformer::load::<Cpu>(&trainer.average());
        let inputs = &demonstrations.episodes[0].inputs[..2];
        let predict = |row: u64| {
            let mut batch = Batch { noise: flow::noise(Seed::new(row), 2), ..Batch::default() };
            Demonstrations::push_inputs(&demonstrations.inputs, trainer.normalisation(), inputs, &mut batch);
            let [actions, end] = network.predict(&weights, &batch).map(Tensor::values);
            assert!(end[0] < 0.0, "{head:?}: the episode is not over");
            actions[0]
        };
        (0..60).map(predict).collect()
    };
    let median = predicted(Head::L1);
    assert!(median.iter().all(|side| *side == median[0] && side.abs() < 1.2), "{median:?}");
    let sampled = predicted(Head::Flow);
    let near = |mode: f32| sampled.iter().filter(|side| (**side - mode).abs() < 0.3).count();
    let (left, right) = (near(-1.0), near(1.0));
    // Some samples between the modes are unavoidable: the velocity is continuous.
    assert!(left + right >= 54 && left.min(right) >= 15, "{left} left, {right} right of {sampled:?}");
}

/// The images of [`seen`] in the network of ACT.
fn act() -> (Demonstrations, ModelSettings) {
    let (demonstrations, _) = seen();
    let demonstrations = Demonstrations { points: 0, ..demonstrations };
    (demonstrations, ModelSettings { channels: 4, residual_blocks: 1, latent: 8, ..model() })
}

fn act_batch(demonstrations: &Demonstrations) -> Batch {
    let changed = Augmentation { shift_px: 2, gain: 0.2, state_noise: 0.1 };
    let mut sampler = Sampler::new(demonstrations, 1.0, 4, &sampled(changed), Seed::new(5));
    let mut batch = sampler.batch(demonstrations, &Squares, &demonstrations.normalisation(), 0, 6).unwrap();
    batch.draw_noise(8, Seed::new(6), 0);
    batch
}

#[test]
fn gradients_of_act_are_those_of_finite_differences() {
    let (demonstrations, model) = act();
    let network = Transformer::new(model, demonstrations.inputs.clone(), 2);
    let batch = act_batch(&demonstrations);
    let without = check_gradients(&network, &batch, 0);
    assert!(without.iter().all(|name| name.ends_with("key.bias")), "{without:?}");
    let mut padded = batch.clone();
    let ended = padded.actions.chunks_exact_mut(2).zip(&batch.mask).filter(|(_, there)| **there == 0.0);
    assert!(ended.map(|(target, _)| target.fill(1e3)).count() > 0);
    let parameters = network.initial(Seed::new(1));
    let [one, other] = [&batch, &padded].map(|batch| of(&network, &parameters, batch, 0));
    assert_eq!((one.total, one.gradients), (other.total, other.gradients));
}

/// At inference the style is 0, so the noise of training has no influence.
#[test]
fn act_predicts_without_style() {
    let (demonstrations, model) = act();
    let network = Transformer::new(model, demonstrations.inputs.clone(), 2);
    let weights = Transformer::load::<Cpu>(&network.initial(Seed::new(1)));
    let batch = act_batch(&demonstrations);
    let silent = Batch { noise: Vec::new(), ..batch.clone() };
    let predicted = [&batch, &silent].map(|batch| network.predict(&weights, batch).map(Tensor::values));
    assert_eq!(predicted[0], predicted[1]);
    assert_eq!(predicted[0].each_ref().map(Vec::len), [6 * 4 * 2, 6 * 4]);
    assert_ne!(network.forward(&weights, &batch).actions.values(), predicted[0][0]);
}

#[test]
fn act_learns_an_episode_by_heart_and_resumes() {
    let (demonstrations, model) = act();
    let demonstrations = Demonstrations { episodes: demonstrations.episodes[..1].to_vec(), ..demonstrations };
    let settings = TrainingSettings { batch: 16, kl_weight: 10.0, learning_rate: 3e-3, ..settings() };
    let start = || Trainer::new(&demonstrations, &Squares, &model, &settings, Seed::new(3), 1).unwrap();
    let (mut trainer, steps) = (start(), 300);
    (0..9).for_each(|_| _ = trainer.step(steps).unwrap());
    let checkpoint = trainer.checkpoint(&BTreeMap::new());
    (9..12).for_each(|_| _ = trainer.step(steps).unwrap());
    let mut resumed = start();
    resumed.resume(&checkpoint).unwrap();
    (9..12).for_each(|_| _ = resumed.step(steps).unwrap());
    assert_eq!(trainer.average().sha256(), resumed.average().sha256());
    (12..steps).for_each(|_| _ = trainer.step(steps).unwrap());
    let error = trainer.error_of_average(4).unwrap();
    assert!(error < 0.1, "{error}");
}

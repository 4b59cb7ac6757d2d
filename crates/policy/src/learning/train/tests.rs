use super::*;
use crate::Demonstration;

fn inputs() -> Inputs {
    Inputs { robot: vec!["x".into(), "width".into()], object: vec!["present".into(), "x".into()], slots: 2 }
}

fn model() -> ModelSettings {
    ModelSettings { width: 16, heads: 2, feed_forward: 32, encoder_layers: 1, decoder_layers: 1, chunk: 4 }
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
        Demonstration { inputs: inputs.collect(), actions: actions.collect() }
    };
    Demonstrations { inputs: inputs(), action: 2, episodes: (1..6).map(|goal| episode(goal as f32 * 0.1)).collect() }
}

fn trained(steps: u64, threads: usize) -> (Vec<f64>, String) {
    let demonstrations = demonstrations();
    let mut trainer = Trainer::new(&demonstrations, &model(), &settings(), Seed::new(3), threads).unwrap();
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
    let start = || Trainer::new(&demonstrations, &model(), &settings(), Seed::new(3), 2).unwrap();
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
    let mut other = Trainer::new(&demonstrations, &model(), &settings(), Seed::new(4), 1).unwrap();
    (0..40).for_each(|_| _ = other.step(40).unwrap());
    assert_ne!(other.average().sha256(), expected);
    let cut = Checkpoint { bytes: checkpoint.bytes[..checkpoint.bytes.len() / 2].to_vec() };
    assert!(start().resume(&cut).is_err());
}

/// Loss and gradients of one batch.
fn loss(parameters: &Parameters, batch: &Batch) -> PartLoss {
    let network = Transformer::new(model(), inputs(), 2);
    let loss = Loss { network: &network, parameters, action: 2, actions: 20.0, queries: 10.0, end_weight: 0.5 };
    loss.of(batch)
}

fn batch() -> Batch {
    let demonstrations = demonstrations();
    let normalisation = demonstrations.normalisation();
    Sampler::new(&demonstrations, 1.0, 4, 1, Seed::new(5)).batch(&demonstrations, &normalisation, 0, 6)
}

#[test]
fn gradients_are_those_of_finite_differences() {
    let (network, batch) = (Transformer::new(model(), inputs(), 2), batch());
    let parameters = network.initial(Seed::new(1));
    let gradients = loss(&parameters, &batch).gradients;
    let total = |parameters: &Parameters| {
        let PartLoss { l1, end, .. } = loss(parameters, &batch);
        l1 + 0.5 * end
    };
    let (mut checked, mut with_influence) = (0, 0);
    for (index, array) in parameters.arrays.iter().enumerate() {
        with_influence += usize::from(gradients[index].iter().any(|gradient| gradient.abs() > 1e-7));
        let place = array.values.len() / 2;
        let moved = |by: f32| {
            let mut moved = parameters.clone();
            moved.arrays[index].values[place] += by;
            total(&moved)
        };
        let expected = (moved(2e-3) - moved(-2e-3)) / 4e-3;
        let got = f64::from(gradients[index][place]);
        assert!((got - expected).abs() < 2e-3 + 0.05 * expected.abs(), "{}: {got} {expected}", array.name);
        checked += 1;
    }
    // A bias of the keys shifts all scores of a query alike.
    let keys = parameters.arrays.iter().filter(|array| array.name.ends_with("key.bias")).count();
    assert_eq!((checked, with_influence), (parameters.arrays.len(), parameters.arrays.len() - keys));
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

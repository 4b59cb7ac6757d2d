//! How fast: for people, not for CI.

use std::sync::Arc;
use std::time::Instant;

use genmanip_sim::{Scene, SettleSettings, Sim, SimSettings};

use crate::{panda::panda, scene, six_objects};

#[test]
#[ignore = "figures for people: cargo test --release -p genmanip-sim --test sim speed -- --ignored --nocapture"]
#[allow(clippy::print_stderr, reason = "figures for people")]
fn speed() {
    let time = |count: u32, mut work: Box<dyn FnMut()>| {
        let start = Instant::now();
        (0..count).for_each(|_| work());
        start.elapsed().as_secs_f64() / f64::from(count)
    };
    let settings = SimSettings::default();
    let objects = six_objects();
    let text = scene().mjcf().len();
    let compile = time(20, Box::new(move || drop(Scene::compile(&panda(), &objects, &settings).unwrap())));
    eprintln!("compile with robot and 6 objects: {:.2} ms ({} kB of MJCF)", compile * 1e3, text / 1000);
    let (objects, settings) = (six_objects(), SimSettings::default());
    let compile = time(20, Box::new(move || drop(Scene::compile_without_robot(&objects, &settings).unwrap())));
    eprintln!("compile 6 objects: {:.2} ms", compile * 1e3);

    let mut sim = Sim::new(scene());
    let command: Vec<f32> = panda().home.iter().map(|&value| value as f32).chain([0.08]).collect();
    let seconds = time(600, Box::new(move || drop(sim.control_step(&command).unwrap())));
    eprintln!("physics steps per second with robot: {:.0}", 8.0 / seconds);

    let bare = Arc::new(Scene::compile_without_robot(&six_objects(), &SimSettings::default()).unwrap());
    let settle = time(10, {
        let bare = Arc::clone(&bare);
        Box::new(move || drop(Sim::new(Arc::clone(&bare)).settle(&SettleSettings::default()).unwrap()))
    });
    eprintln!("settling 6 objects: {:.2} ms", settle * 1e3);
    let mut sim = Sim::new(bare);
    let seconds = time(600, Box::new(move || sim.advance(8).unwrap()));
    eprintln!("physics steps per second without robot: {:.0}", 8.0 / seconds);
}

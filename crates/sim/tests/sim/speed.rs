//! Throughput measurements, run by hand.

use std::sync::Arc;

use genmanip_core::Pose;
use genmanip_core::glam::DVec3;
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim};

use genmanip_assets::{Catalogue, panda, worlds::default_world};

use crate::pick::solve;
use crate::placed;

/// A mug, a bowl, a can, a book, a pen and a basket.
fn six_objects() -> Vec<SceneObject> {
    let places = [
        ("001", 0.45, 0.0),
        ("005", 0.5, 0.2),
        ("019", 0.6, -0.1),
        ("041", 0.6, 0.3),
        ("042", 0.4, -0.25),
        ("051", 0.7, -0.3),
    ];
    places.map(|(uid, x, y)| placed(uid, Catalogue::builtin().build(uid).unwrap(), x, y, 0.4)).to_vec()
}

fn scene() -> Arc<Model> {
    Arc::new(Model::compile(&default_world(), &panda(), &six_objects()).unwrap())
}

/// CPU time of this thread (Linux), independent of the machine's load.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}

#[test]
#[ignore = "figures for people: cargo test --release -p genmanip-sim --test sim speed -- --ignored --nocapture"]
#[allow(clippy::print_stderr, reason = "figures for people")]
fn speed() {
    let time = |count: u32, mut work: Box<dyn FnMut()>| {
        let start = cpu_seconds();
        (0..count).for_each(|_| work());
        (cpu_seconds() - start) / f64::from(count)
    };
    let objects = six_objects();
    let text = scene().mjcf().len();
    let compile = time(20, Box::new(move || drop(Model::compile(&default_world(), &panda(), &objects).unwrap())));
    eprintln!("compile with robot and 6 objects: {:.2} ms ({} kB of MJCF)", compile * 1e3, text / 1000);
    let objects = six_objects();
    let compile = time(20, Box::new(move || drop(Model::compile_without_robot(&default_world(), &objects).unwrap())));
    eprintln!("compile 6 objects: {:.2} ms", compile * 1e3);

    let robot = panda();
    let above = Pose::from_axes(DVec3::new(0.45, 0.0, 0.3), DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let down = Pose::from_axes(DVec3::new(0.6, -0.1, 0.1), DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let ends = [solve(&robot, &robot.home, &above), solve(&robot, &robot.home, &down)];
    let (mut sim, mut step) = (Sim::new(scene()), 0);
    let work = move || {
        // Down to the can, close, carry it around.
        let t = 0.5 - 0.5 * (f64::from(step) / 60.0).cos();
        let joints = ends[0].iter().zip(&ends[1]).map(|(a, b)| (a + (b - a) * t) as f32);
        let command: Vec<f32> = joints.chain([if step > 190 { 0.0 } else { 0.08 }]).collect();
        drop(sim.control_step(&command).unwrap());
        step += 1;
    };
    let seconds = time(600, Box::new(work));
    eprintln!("physics steps per second, robot moving and grasping: {:.0}", 8.0 / seconds);

    let bare = Arc::new(Model::compile_without_robot(&default_world(), &six_objects()).unwrap());
    let settle = time(10, {
        let bare = Arc::clone(&bare);
        Box::new(move || drop(Sim::new(Arc::clone(&bare)).settle(&SettleSettings::default()).unwrap()))
    });
    eprintln!("settling 6 objects: {:.2} ms", settle * 1e3);
    let mut sim = Sim::new(bare);
    let seconds = time(600, Box::new(move || sim.advance(8).unwrap()));
    eprintln!("physics steps per second without robot: {:.0}", 8.0 / seconds);
}

//! Prints who the robot touches, frame by frame (scratch).
use std::sync::Arc;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let store = genmanip_data::EpisodeStore::open(&a[1]).unwrap();
    let e = store.read(&a[2]).unwrap();
    let (from, to): (usize, usize) = (a[3].parse().unwrap(), a[4].parse().unwrap());
    let stage = genmanip_rollout::Stage::open(
        Arc::new(e.scenario.clone()),
        genmanip_assets::Catalogue::builtin(),
        &genmanip_assets::panda(),
        &Default::default(),
    )
    .unwrap();
    let mut sim = genmanip_sim::Sim::new(stage.scene.clone());
    sim.set_state(&e.initial_state).unwrap();
    for (i, f) in e.frames.iter().enumerate().take(to) {
        sim.control_step(&f.command).unwrap();
        if i >= from {
            for c in sim.contacts() {
                let (x, y) = (stage.scene.body_name(c.a), stage.scene.body_name(c.b));
                if c.normal_force > 1.0 && (format!("{:?}{:?}", c.a, c.b).contains("Robot")) {
                    println!(
                        "{i} {x} {y} {:.1} N at {:.3?} n {:.2?}",
                        c.normal_force,
                        c.position.to_array(),
                        c.normal.to_array()
                    );
                }
            }
        }
    }
}

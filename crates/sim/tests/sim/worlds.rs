//! Worlds compile to models: version 1 unchanged, others with everything they describe.

use std::sync::Arc;

use genmanip_assets::robots;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec3;
use genmanip_core::{Board, Document, Scenario, SupportSurface, World};
use genmanip_sim::{BodyId, Model, SettleSettings, Sim};
use sha2::{Digest, Sha256};

use crate::models::{cuboid, rigid};
use crate::{placed, six_objects};

/// A scenario of version 1, reduced to the physics inputs.
const VERSION_1: &str = include_str!("scenario_of_version_1.json");

fn old_world() -> World {
    Scenario::from_json(VERSION_1).unwrap().world
}

/// The text's hash is that of the last version without worlds; the state's was taken when recordings of that version
/// replayed bit-exactly (the rollout tests replay two of them).
/// They may only change when such recordings can no longer be replayed.
#[test]
fn the_world_of_version_1_compiles_to_the_same_model() {
    let world = old_world();
    let robot = robots::of_world(&world).unwrap();
    let scene = Model::compile(&world, &robot, &six_objects()).unwrap();
    // The engine's compiler threads do not affect the model; they were enabled when this was recorded.
    let mjcf = scene.mjcf().replace(" usethread=\"false\"", "");
    let text: String = Sha256::digest(mjcf.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(text, "38f2383ab5efe2a06ae81d531292aef2880e5799ce1f10c983821f59b55a6342");

    let mut sim = Sim::new(Arc::new(scene));
    let mut command: Vec<f32> = robot.home.iter().map(|&q| q as f32).collect();
    command.push(0.03);
    for _ in 0..30 {
        command[0] += 0.01;
        command[3] -= 0.005;
        sim.control_step(&command).unwrap();
    }
    let mut state = Sha256::new();
    sim.state().iter().for_each(|value| state.update(value.to_bits().to_le_bytes()));
    let state: String = state.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(state, "415b63b90176a330d93633f5a8b99817802fb68052bd777db2030520ca7d6618");
}

#[test]
fn objects_rest_on_a_further_surface_and_its_boards() {
    let mut world = (*default_world()).clone();
    world.surfaces.push(SupportSurface {
        id: "shelf".into(),
        name: "shelf".into(),
        top_center_m: DVec3::new(0.6, 0.3, 0.25),
        yaw_rad: 0.4,
        size_m: DVec3::new(0.3, 0.2, 0.02),
        friction: 0.5,
        edge_margin_m: 0.02,
        boards: vec![Board { center_m: DVec3::new(0.14, 0.0, 0.05), size_m: DVec3::new(0.02, 0.2, 0.1) }],
        legs: false,
    });
    let mut low = placed("low", rigid("box", 0.2, 0.5, vec![cuboid(0.05, 0.05, 0.05)]), 0.6, 0.3, 0.4);
    low.pose.position.z = 0.251;
    let mut high = placed("high", rigid("box", 0.2, 0.5, vec![cuboid(0.012, 0.05, 0.02)]), 0.6, 0.3, 0.4);
    high.pose.position = world.surfaces[1].world_from_surface().transform_point(DVec3::new(0.14, 0.0, 0.101));
    let scene = Arc::new(Model::compile_without_robot(&world, &[low, high]).unwrap());
    let mut sim = Sim::new(Arc::clone(&scene));
    let report = sim.settle(&SettleSettings::default()).unwrap();
    assert!(report.settled && report.displacement.iter().all(|&moved| moved < 2e-3), "{report:?}");
    let mut on = |object| {
        let body = BodyId::Object { object, link: 0 };
        sim.contacts()
            .iter()
            .all(|contact| contact.other(body).is_none_or(|other| other == BodyId::Surface { surface: 1 }))
    };
    assert!(on(0) && on(1));
    assert_eq!(scene.body_name(BodyId::Surface { surface: 1 }), "shelf");
}

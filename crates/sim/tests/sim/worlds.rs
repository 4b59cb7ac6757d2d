//! Worlds compile to models: version 1 unchanged, others with everything they describe.

use std::sync::Arc;

use genmanip_assets::robots;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec3;
use genmanip_core::{ArmPhysics, Board, Document, Scenario, SupportSurface, World};
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

/// World of the arm with joint dynamics of its own.
fn world_with(arm: ArmPhysics) -> World {
    let mut world = (*default_world()).clone();
    world.physics.arm = Some(arm);
    world
}

/// Positions of joint 1 under a command of constant speed, 1 rad/s, after each physics step.
fn ramp(arm: ArmPhysics) -> Vec<f64> {
    let world = world_with(arm);
    let robot = robots::of_world(&world).unwrap();
    let mut sim = Sim::new(Arc::new(Model::compile(&world, &robot, &[]).unwrap()));
    let (mut targets, mut speeds) = (sim.joint_positions(), vec![0.0; robot.arm_dof()]);
    speeds[0] = 1.0;
    let mut step = |sim: &mut Sim| {
        targets[0] += world.physics.timestep_s();
        sim.drive_step(&targets, &speeds, &vec![0.0; targets.len()]).unwrap();
        sim.joint_positions()[0]
    };
    (0..200).map(|_| step(&mut sim)).collect()
}

/// Steady lag behind a command of constant speed: latency, and friction over gain.
#[test]
fn latency_and_friction_lag_behind_a_ramp_as_the_closed_form_says() {
    let damped = |damping: f64, friction_loss: f64, latency_s: f64| ArmPhysics {
        kp: vec![4000.0; 7],
        kv: vec![300.0; 7],
        damping: vec![damping; 7],
        friction_loss: vec![friction_loss; 7],
        latency_s,
    };
    for (damping, friction_loss, latency_s) in [(0.0, 0.0, 0.03), (8.0, 0.0, 0.0), (0.0, 4.0, 0.0), (8.0, 4.0, 0.05)] {
        let last = *ramp(damped(damping, friction_loss, latency_s)).last().unwrap();
        let lag = latency_s + (damping + friction_loss) / 4000.0;
        let expected = 200.0 / 480.0 - lag;
        assert!((last - expected).abs() < 2e-4, "{damping} {friction_loss} {latency_s}: {last}, expected {expected}");
    }
    // At rest the set points of the past are those of the start.
    let still = Model::compile(&world_with(damped(1.0, 1.0, 0.1)), &robots::named("panda").unwrap(), &[]).unwrap();
    let mut sim = Sim::new(Arc::new(still));
    let start = sim.joint_positions();
    sim.advance(100).unwrap();
    assert!(sim.joint_positions().iter().zip(&start).all(|(now, start)| (now - start).abs() < 1e-4));
}

/// The delay line is part of the state.
#[test]
fn a_restored_state_with_latency_continues_to_the_same_bits() {
    let world = world_with(ArmPhysics { latency_s: 0.04, ..ArmPhysics::default() });
    let robot = robots::of_world(&world).unwrap();
    let scene = Arc::new(Model::compile(&world, &robot, &[]).unwrap());
    let mut command: Vec<f32> = robot.home.iter().map(|&q| q as f32).collect();
    command.push(0.03);
    let mut sim = Sim::new(Arc::clone(&scene));
    let mut run = |sim: &mut Sim, from: f32| {
        for step in 0..10 {
            command[0] = from + 0.01 * step as f32;
            sim.control_step(&command).unwrap();
        }
        sim.state()
    };
    let saved = run(&mut sim, 0.0);
    let expected = run(&mut sim, 0.1);
    let mut other = Sim::new(scene);
    other.set_state(&saved).unwrap();
    assert_eq!(run(&mut other, 0.1), expected);
}

#[test]
fn an_arms_dynamics_of_another_arm_are_refused() {
    let cases = [
        (ArmPhysics { kp: vec![1.0; 6], ..ArmPhysics::default() }, "physics.arm.kp"),
        (ArmPhysics { damping: vec![-1.0; 7], ..ArmPhysics::default() }, "physics.arm.damping"),
        (ArmPhysics { latency_s: 3.0, ..ArmPhysics::default() }, "physics.arm.latency_s"),
    ];
    let robot = robots::named("panda").unwrap();
    for (arm, place) in cases {
        let world = world_with(arm);
        let error = Model::compile(&world, &robot, &[]).unwrap_err().to_string();
        assert!(error.contains(place), "{error}");
        assert!(world.faults(&robot).iter().any(|fault| fault.place == place), "{place}");
    }
}

//! Tests on simulated recordings with known truth.

use std::sync::Arc;

use genmanip_assets::{robots, worlds::default_world};
use genmanip_core::{Document, RobotModel, Seed, World};
use genmanip_motion::{Planner, PlannerSettings};
use rand::RngExt;

use crate::identify::{Identification, identify};
use crate::motions::{ExcitationSettings, drop_block, excitation, push, slip, with_payload};
use crate::parameters::{Parameter, Values, set_contact_damping};
use crate::recording::{Block, Payload, Recording};
use crate::replay::{bare, replay};
use crate::restitution;
use crate::search::SearchSettings;
use crate::structure::whiteness;
use crate::synthetic::{Effect, HiddenArm, Sensors, record};

const SENSORS: Sensors = Sensors { joint_rad: 5e-5, joint_step_rad: 2e-5, block_m: 1e-3 };

fn setting() -> (World, Arc<RobotModel>, Planner) {
    let world = (*default_world()).clone();
    let robot = robots::of_world(&world).unwrap();
    let planner = Planner::new(Arc::clone(&robot), PlannerSettings::default()).unwrap();
    (world, robot, planner)
}

fn hidden(world: &World, robot: &RobotModel, sensors: Sensors, effect: Effect) -> HiddenArm {
    let mut values = Values::of(world, robot);
    for (joint, limits) in robot.arm_joints().enumerate() {
        values.arm.kp[joint] *= 0.8 + 0.08 * joint as f64;
        values.arm.kv[joint] *= 1.3 - 0.07 * joint as f64;
        values.arm.damping[joint] = 1.0 + 0.4 * joint as f64;
        values.arm.friction_loss[joint] = 0.015 * limits.max_effort;
    }
    values.arm.latency_s = 0.0312;
    values.table_friction = 0.4;
    values.pad_friction = 0.8;
    HiddenArm { world: world.clone(), values, effect, sensors }
}

/// A short motion of all joints but the last.
fn motion(planner: &Planner, world: &World) -> Recording {
    let settings = ExcitationSettings { duration_s: 3.5, joints: (0..6).collect(), ..ExcitationSettings::default() };
    excitation(planner, world, &settings, Seed::new(1)).unwrap()
}

fn identified(effect: Effect) -> (HiddenArm, Identification) {
    let (world, robot, planner) = setting();
    let hidden = hidden(&world, &robot, SENSORS, effect);
    let recording = record(&hidden, &robot, &motion(&planner, &world), Seed::new(5)).unwrap();
    let settings = SearchSettings { starts: vec![[1.0, 1.0, 0.7]], ..SearchSettings::default() };
    let found = identify(&world, &robot, &[recording], &[], &settings).unwrap();
    (hidden, found)
}

#[test]
fn an_arm_is_identified_and_a_joint_that_stands_still_is_named() {
    let (hidden, found) = identified(Effect::None);
    let named: Vec<&str> = found.unidentified.iter().map(|it| it.name.as_str()).collect();
    for name in ["joint7.kp", "joint7.kv", "joint7.damping", "payload_mass"] {
        assert!(named.contains(&name), "{name} is not among {named:?}");
    }
    let errors: Vec<f64> = found
        .parameters
        .iter()
        .map(|it| (it.value - hidden.values.get(it.parameter)) / ((it.interval[1] - it.interval[0]) / 3.92))
        .collect();
    assert!(errors.len() >= 20 && errors.iter().all(|error| error.abs() < 4.5), "{errors:?}");
    let latency = found.parameters.iter().find(|it| it.parameter == Parameter::Latency).unwrap();
    assert!((latency.value - 0.0312).abs() < 1e-3, "{latency:?}");
    assert!(!found.is_structure_wrong && found.held_out.unwrap().ratio() > 5.0, "{:?}", found.held_out);
}

#[test]
fn backlash_is_flagged() {
    let (_, found) = identified(Effect::Backlash { width_rad: 0.003 });
    assert!(found.is_structure_wrong, "{:?}", found.fits);
}

/// The identification shifts commands in time and drops collision geometry; the simulator that users run does neither.
#[test]
fn a_replay_equals_the_simulation_with_its_own_delay_lines() {
    let (world, robot, planner) = setting();
    let hidden = hidden(&world, &robot, Sensors::default(), Effect::None);
    let recording = record(&hidden, &robot, &motion(&planner, &world), Seed::new(5)).unwrap();
    let track = replay(&recording, &world, &bare(&robot, false), &hidden.values).unwrap();
    for row in recording.settled()..recording.len() {
        for joint in 0..robot.arm_dof() {
            let off = track.joints[row][joint] - recording.joint_rad[row][joint];
            assert!(off.abs() < 1e-5, "joint {joint} at {}: {off:e}", recording.time_s[row]);
        }
    }
}

#[test]
fn frictions_are_identified_from_a_push_and_a_slip() {
    let (world, robot, planner) = setting();
    let hidden = hidden(&world, &robot, SENSORS, Effect::None);
    let known = World {
        physics: genmanip_core::PhysicsSettings { arm: Some(hidden.values.arm.clone()), ..world.physics.clone() },
        ..world.clone()
    };
    let block =
        |size_m: [f64; 3], mass_kg: f64| Block { size_m, mass_kg, base_m: [0.4, 0.0, 0.0], track_m: Vec::new() };
    let motions = [
        push(&planner, block([0.08, 0.08, 0.05], 2.0), 0.5).unwrap(),
        slip(&planner, block([0.04, 0.03, 0.08], 0.75)).unwrap(),
    ];
    let recordings: Vec<Recording> =
        motions.iter().map(|motion| record(&hidden, &robot, motion, Seed::new(5)).unwrap()).collect();
    let settings = SearchSettings { frictions: ([0.2, 1.2], 6), ..SearchSettings::default() };
    let found = identify(&known, &robot, &recordings, &[], &settings).unwrap();
    for (parameter, truth) in [(Parameter::TableFriction, 0.4), (Parameter::PadFriction, 0.8)] {
        let it = found.parameters.iter().find(|it| it.parameter == parameter).unwrap();
        assert!((it.value - truth).abs() < 0.03, "{it:?}");
    }
    // Blocks that nothing moves show nothing.
    let unmoved = recordings.iter().map(|recording| {
        let mut unmoved = recording.clone();
        unmoved.block.iter_mut().for_each(|block| block.track_m.fill(block.base_m));
        unmoved
    });
    let found = identify(&known, &robot, &unmoved.collect::<Vec<_>>(), &[], &settings).unwrap();
    for parameter in [Parameter::TableFriction, Parameter::PadFriction] {
        assert!(found.unidentified.iter().any(|it| it.parameter == parameter), "{:?}", found.parameters);
    }
}

/// The stated centre of the payload is a guess; the true one is 2 cm away.
#[test]
fn the_mass_and_the_centre_of_a_payload_are_identified() {
    let (world, robot, planner) = setting();
    let mut hidden = hidden(&world, &robot, SENSORS, Effect::None);
    (hidden.values.payload_kg, hidden.values.payload_center_m) = (1.2, [0.015, -0.01, 0.12]);
    let payload = Payload { center_m: [0.0, 0.0, 0.1], gyration_m: 0.03 };
    let settings = ExcitationSettings { duration_s: 4.0, ..ExcitationSettings::default() };
    let motion = with_payload(&excitation(&planner, &world, &settings, Seed::new(2)).unwrap(), payload);
    let recording = record(&hidden, &robot, &motion, Seed::new(5)).unwrap();
    let settings = SearchSettings { starts: vec![[1.0, 1.0, 0.7]], ..SearchSettings::default() };
    let found = identify(&world, &robot, &[recording], &[], &settings).unwrap();
    let of = |parameter| found.parameters.iter().find(|it| it.parameter == parameter).unwrap();
    let mass = of(Parameter::PayloadMass);
    assert!((mass.value - 1.2).abs() < 0.036, "{mass:?}");
    for axis in 0..3 {
        let it = of(Parameter::PayloadCenter(axis));
        let truth = hidden.values.payload_center_m[axis];
        assert!((it.value - truth).abs() < 0.01 && it.interval[0] < truth && truth < it.interval[1], "{it:?}");
    }
}

#[test]
fn a_drop_shows_the_restitution_and_the_identified_world_bounces_as_much() {
    let (world, robot, _) = setting();
    let block = Block { size_m: [0.06; 3], mass_kg: 0.3, base_m: [0.5, 0.2, 0.15], track_m: Vec::new() };
    let motion = drop_block(&robot, block).unwrap();
    let mut bouncy = world.clone();
    set_contact_damping(&mut bouncy, 0.4);
    let hidden = hidden(&bouncy, &robot, SENSORS, Effect::None);
    let bare = bare(&robot, false);
    let truth = restitution::simulated(&motion, &world, &bare, &hidden.values, 0.4).unwrap().unwrap();
    let recording = record(&hidden, &robot, &motion, Seed::new(5)).unwrap();
    let found = identify(&world, &robot, &[recording], &[], &SearchSettings::default()).unwrap();
    let it = found.parameters.iter().find(|it| it.parameter == Parameter::Restitution).unwrap();
    assert!(truth > 0.2 && it.before < 0.1, "{truth} before {}", it.before);
    assert!((it.value - truth).abs() < 0.03 && it.interval[0] < truth && truth < it.interval[1], "{truth}: {it:?}");
    assert!((found.contact_damping.unwrap() - 0.4).abs() < 0.05, "{:?}", found.contact_damping);
    // A block that lies on the table shows nothing.
    let mut still = motion.clone();
    still.joint_rad = still.command_rad.clone();
    still.block.as_mut().unwrap().track_m = vec![[0.5, 0.2, 0.0]; still.len()];
    let found = identify(&world, &robot, &[still], &[], &SearchSettings::default()).unwrap();
    assert!(found.unidentified.iter().any(|it| it.parameter == Parameter::Restitution));
}

#[test]
fn white_noise_is_no_structure_and_a_slow_error_is() {
    let rng = &mut Seed::new(3).rng();
    let white: Vec<f64> = (0..2000).map(|_| rng.random_range(-1.0..1.0)).collect();
    assert!(!whiteness(&white, 0.0).is_structured);
    let slow: Vec<f64> =
        white.iter().zip(0..).map(|(noise, row)| noise + 0.5 * (f64::from(row) / 40.0).sin()).collect();
    assert!(whiteness(&slow, 0.0).is_structured);
    // The same error may be the rounding of a coarse sensor at rest.
    assert!(!whiteness(&slow, 4.0).is_structured);
}

#[test]
fn broken_recordings_are_refused_with_their_place() {
    let (world, robot, planner) = setting();
    let good = motion(&planner, &world).to_value();
    type Break = fn(&mut serde_json::Value);
    let cases: [(&str, Break); 8] = [
        ("ascending seconds", |it| it["time_s"][5] = 0.0.into()),
        ("expected one per time", |it| it["command_rad"].as_array_mut().unwrap().truncate(9)),
        ("7 finite positions", |it| it["command_rad"][3] = vec![0.0; 6].into()),
        ("joint_rad", |it| it["joint_rad"] = vec![vec![0.0; 7]; 3].into()),
        ("a payload needs it", |it| it["motion"] = "payload".into()),
        ("at least 0.3 s at rest", |it| it["command_rad"][2][0] = 0.1.into()),
        ("its range is", |it| it["command_rad"][200][1] = 3.0.into()),
        ("it is of robot `ur5e_2f85`", |it| it["robot"] = "ur5e_2f85".into()),
    ];
    for (expected, change) in cases {
        let mut broken = good.clone();
        change(&mut broken);
        let error = match Recording::from_value(broken) {
            Err(error) => error.to_string(),
            Ok(recording) => recording.check_robot(&robot).unwrap_err().to_string(),
        };
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn the_schema_on_disk_is_that_of_the_type() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas/recording.schema.json");
    let text = serde_json::to_string_pretty(&schemars::schema_for!(Recording)).unwrap() + "\n";
    if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let stored = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(stored == text, "schemas/recording.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
}

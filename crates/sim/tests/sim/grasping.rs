//! Grasps hold light, thin, round, hollow and heavy objects by friction, within the robot's limits.

use genmanip_core::glam::DVec3;
use genmanip_core::{ObjectModel, Piece, Pose, Seed};
use genmanip_sim::{Model, SettleSettings, Sim};
use std::sync::Arc;

use genmanip_assets::{Catalogue, panda, worlds::default_world};

use crate::models::{ball, can, cuboid, mug, pen, rigid};
use crate::pick::{Pick, PickReport, pick};
use crate::placed;

/// Largest drift of a held object in the gripper while lifting and holding.
const MAX_SLIP_M: f64 = 0.003;

/// Picks an object, asserts what must hold for every pick, and returns the measurements.
fn check(name: &str, case: &Pick) -> PickReport {
    let robot = panda();
    let report = pick(&robot, case).unwrap();
    let last = report.frames.last().unwrap();
    assert_eq!(last.grasped, Some(0), "{name}: {}", figures(&report));
    assert!((report.lifted - 0.2).abs() < MAX_SLIP_M, "{name}: {}", figures(&report));
    assert!(report.slip < MAX_SLIP_M, "{name}: {}", figures(&report));
    assert!(report.tracking < 0.003, "{name}: {}", figures(&report));
    for frame in &report.frames {
        assert!(
            frame.grip_force <= robot.drives.as_ref().unwrap().grip_force_n
                && frame.grip_force <= robot.gripper.max_force
        );
        for (index, joint) in robot.arm_joints().enumerate() {
            assert!(frame.joint_torque[index] <= joint.max_effort, "{name}: torque of {}", joint.name);
            assert!(frame.joint_velocity[index].abs() <= joint.max_velocity, "{name}: speed of {}", joint.name);
            assert!((joint.lower..=joint.upper).contains(&frame.joint_position[index]));
        }
    }
    report
}

fn figures(report: &PickReport) -> String {
    let last = report.frames.last().unwrap();
    let stray = report.frames.iter().map(|frame| frame.stray_contact_n).fold(0.0, f64::max);
    format!(
        "lifted {:.1} mm, slip {:.2} mm, turn {:.2}°, creep {:.3} mm/s, nudge {:.2} mm, tracking {:.2} mm, \
         width {:.1} mm, grip {:.0} N, stray {:.1} N",
        report.lifted * 1e3,
        report.slip * 1e3,
        report.turn.to_degrees(),
        report.creep * 2e3,
        report.nudge * 1e3,
        report.tracking * 1e3,
        last.gripper_width * 1e3,
        last.grip_force,
        stray
    )
}

fn at(model: Arc<ObjectModel>, grasp: DVec3) -> Pick {
    Pick { model, start: Pose::from_position(DVec3::new(0.5, 0.1, 0.0)), grasp, yaw: 0.0, opening: 0.08 }
}

fn named_cases() -> Vec<(&'static str, Pick)> {
    let case = |name, mass, friction, pieces: Vec<Piece>, grasp: [f64; 3]| {
        (name, at(rigid(name, mass, friction, pieces), DVec3::from_array(grasp)))
    };
    vec![
        case("cube 4 cm, 60 g", 0.06, 0.5, vec![cuboid(0.04, 0.04, 0.04)], [0.0, 0.0, 0.02]),
        case("can 66 mm, 350 g", 0.35, 0.4, vec![can(0.033, 0.12)], [0.0, 0.0, 0.09]),
        case("mug by its 4 mm rim, 300 g", 0.3, 0.5, mug(0.04, 0.09, 0.004, 16), [0.0, 0.038, 0.08]),
        case("pen 12 mm, 15 g", 0.015, 0.4, vec![pen(0.006, 0.14)], [0.0, 0.0, 0.0125]),
        case("book 30 mm, 400 g", 0.4, 0.5, vec![cuboid(0.2, 0.03, 0.13)], [0.0, 0.0, 0.11]),
        case("box 60 mm, 600 g", 0.6, 0.4, vec![cuboid(0.06, 0.06, 0.16)], [0.0, 0.0, 0.13]),
        case("ball 65 mm, 60 g", 0.06, 0.5, vec![ball(0.0325)], [0.0, 0.0, 0.0325]),
    ]
}

#[test]
fn everyday_objects_are_held() {
    for (name, case) in named_cases() {
        check(name, &case);
    }
}

/// A random object, pose and off-centre grasp from a seed.
fn random_case(seed: Seed) -> (String, Pick) {
    let draw =
        |label: &str, low: f64, high: f64| low + (high - low) * (seed.fork(label).value() as f64 / (1u64 << 53) as f64);
    let mass = draw("mass", 0.02f64.ln(), 0.7f64.ln()).exp();
    let width = draw("width", 0.008, 0.065);
    let height = draw("height", 0.03, 0.16);
    let depth = draw("depth", 0.02, 0.14);
    let (kind, pieces, top) = match seed.fork("kind").value() % 5 {
        0 => ("box", vec![cuboid(depth, width, height)], height),
        1 => ("can", vec![can(width.max(0.02) / 2.0, height)], height),
        2 => ("ball", vec![ball(width.max(0.03) / 2.0)], width.max(0.03)),
        3 => ("pen", vec![pen(width.clamp(0.008, 0.025) / 2.0, depth.max(0.08))], width.clamp(0.008, 0.025)),
        _ => ("mug", mug(draw("radius", 0.03, 0.045), height.max(0.06), 0.004, 16), height.max(0.06)),
    };
    let offset = match kind {
        "box" => DVec3::new(draw("x", -0.25, 0.25) * depth, draw("y", -0.004, 0.004), 0.0),
        "mug" => DVec3::new(0.0, draw("radius", 0.03, 0.045) - 0.002, 0.0),
        "pen" => DVec3::new(draw("x", -0.25, 0.25) * depth, 0.0, 0.0),
        _ => DVec3::Y * draw("y", -0.002, 0.002),
    };
    let grasp_z = if kind == "ball" { top / 2.0 } else { top - 0.015 }.max(0.0125);
    let start = Pose::from_position_yaw(
        DVec3::new(draw("table x", 0.4, 0.6), draw("table y", -0.2, 0.2), 0.0),
        draw("yaw", -0.6, 0.6),
    );
    let name = format!("{kind} {:.0} mm, {:.0} g, seed {seed}", width * 1e3, mass * 1e3);
    let model = rigid(kind, mass, draw("friction", 0.25, 0.9), pieces);
    // The inner finger has to fit into a mug.
    let opening = if kind == "mug" { 0.03 } else { 0.08 };
    (name, Pick { model, start, grasp: DVec3::new(offset.x, offset.y, grasp_z), yaw: 0.0, opening })
}

#[test]
fn random_objects_are_held() {
    for index in 0..12 {
        let (name, case) = random_case(Seed::new(1).fork_index(index));
        check(&name, &case);
    }
}

/// A top-down grasp over the centre, across the narrower side.
fn catalogue_case(uid: &str) -> Option<(String, Pick)> {
    let model = Catalogue::builtin().build(uid).unwrap();
    let bounds = model.world_bounds(&Pose::IDENTITY, &[]);
    let (size, center) = (bounds.size(), bounds.center());
    let (across, yaw) = if size.y <= size.x { (size.y, 0.0) } else { (size.x, std::f64::consts::FRAC_PI_2) };
    let grasp = DVec3::new(center.x, center.y, (size.z - 0.02).max(0.0125));
    let name = format!("{uid} {}", model.card.name);
    (across < 0.076).then(|| (name, Pick { yaw, ..at(model, grasp) }))
}

#[test]
fn catalogue_objects_are_held() {
    // A 12 mm pen, a heavy wrench, a heavy book, a tall carton, a can, round fruit.
    for uid in ["042", "056", "041", "026", "019", "027"] {
        let (name, case) = catalogue_case(uid).unwrap();
        check(&name, &case);
    }
}

#[test]
fn catalogue_objects_stay_where_they_are_placed() {
    let mut restless = Vec::new();
    for card in Catalogue::builtin().cards().iter().filter(|card| !card.is_articulated) {
        let object = placed(card.uid.as_str(), Catalogue::builtin().build(&card.uid).unwrap(), 0.5, 0.0, 0.3);
        let scene = Model::compile_without_robot(&default_world(), &[object]).unwrap();
        let report = Sim::new(Arc::new(scene)).settle(&SettleSettings::default()).unwrap();
        if !report.settled || report.displacement[0] > 0.005 || report.rotation[0] > 0.05 {
            restless.push(format!(
                "{} {}: settled {} after {:.2} s, moved {:.1} mm, turned {:.1}°, {:.2} mm deep",
                card.uid,
                card.name,
                report.settled,
                report.seconds,
                report.displacement[0] * 1e3,
                report.rotation[0].to_degrees(),
                report.max_penetration * 1e3
            ));
        }
    }
    assert!(restless.is_empty(), "{}", restless.join("\n"));
}

#[test]
#[ignore = "a table for people: cargo test --release -p genmanip-sim --test sim pick_table -- --ignored --nocapture"]
#[allow(clippy::print_stderr, reason = "a table for people")]
fn pick_table() {
    let fresh = (0..100).map(|index| random_case(Seed::new(2).fork_index(index)));
    let named = named_cases().into_iter().map(|(name, case)| (name.to_string(), case));
    let catalogue = Catalogue::builtin().cards().iter().filter(|card| !card.is_articulated);
    let catalogue = catalogue.filter_map(|card| catalogue_case(card.uid.as_str()));
    for (name, case) in named.chain(fresh).chain(catalogue) {
        match pick(&panda(), &case) {
            Ok(report) => eprintln!("{name:34} {}", figures(&report)),
            Err(error) => eprintln!("{name:34} {error}"),
        }
    }
}

//! Physics as its users meet it: scenes compile, states restore, things are held.

mod models;
mod panda;
mod pick;

use std::sync::Arc;

use genmanip_core::Pose;
use genmanip_core::glam::DVec3;
use genmanip_sim::SimSettings;

use models::{ball, can, cuboid, mug, pen, rigid};
use panda::panda;
use pick::{Pick, pick};

#[test]
#[ignore = "a table for people"]
fn pick_table() {
    let at = |z: f64| (DVec3::Z * z, 0.0);
    let cases: Vec<(&str, f64, f64, Vec<genmanip_core::Piece>, (DVec3, f64))> = vec![
        ("cube 4 cm", 0.06, 0.5, vec![cuboid(0.04, 0.04, 0.04)], at(0.02)),
        ("can 66 mm", 0.35, 0.4, vec![can(0.033, 0.12)], at(0.08)),
        ("mug rim", 0.3, 0.5, mug(0.04, 0.09, 0.004, 16), (DVec3::new(0.0, 0.038, 0.08), 0.0)),
        ("pen 12 mm", 0.015, 0.4, vec![pen(0.006, 0.14)], at(0.007)),
        ("book", 0.4, 0.5, vec![cuboid(0.2, 0.03, 0.13)], at(0.11)),
        ("box 0.6 kg", 0.6, 0.4, vec![cuboid(0.06, 0.06, 0.16)], at(0.1)),
        ("ball", 0.06, 0.5, vec![ball(0.0325)], at(0.0325)),
    ];
    let settings = SimSettings::default();
    for (name, mass, friction, pieces, (grasp, yaw)) in cases {
        let model = rigid(name, mass, friction, pieces);
        let report = pick(
            &panda(),
            &Pick { model, start: Pose::from_position(DVec3::new(0.5, 0.1, 0.0)), grasp, yaw },
            &settings,
        )
        .unwrap();
        let last = report.frames.last().unwrap();
        eprintln!(
            "{name:12} lifted {:.4} slip {:.2} mm turn {:.2} deg creep {:.3} mm nudge {:.2} mm tracking {:.2} mm width {:.1} mm grip {:.1} torque {:.1?} grasped {:?} stray {:.2}",
            report.lifted, report.slip * 1e3, report.turn.to_degrees(), report.creep * 1e3, report.nudge * 1e3,
            report.tracking * 1e3, last.gripper_width * 1e3, last.grip_force,
            report.frames.iter().fold(vec![0.0f64; 7], |m, f| m.iter().zip(&f.joint_torque).map(|(a, b)| a.max(*b)).collect()),
            last.grasped,
            report.frames.iter().map(|f| f.stray_contact_n).fold(0.0, f64::max),
        );
    }
    let _ = Arc::new(());
}

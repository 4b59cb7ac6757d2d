//! Analytic inverse kinematics of arms with the Panda's geometry, after Y. He and S. Liu, *Analytical Inverse
//! Kinematics for Franka Emika Panda* (2021): joint 7 is the free parameter.
//!
//! With joint 7 given, the wrist centre W (axes 5 and 6 meet there) is known, and the shoulder S is fixed.
//! The triangle S - elbow - W gives joint 4; axis 5 lies in the triangle's plane, at a known angle to S-W,
//! and is perpendicular to the known axis 6, which gives the plane; the rest are Euler angles.
//! All eight branches are computed (two elbows, two planes, two shoulders).

use glam::DVec3;

use crate::chain::Chain;
use crate::rigid::Rigid;

/// Link lengths of an arm with the Panda's axes (modified Denavit-Hartenberg parameters) (m).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrankaGeometry {
    base_from_shoulder: Rigid,
    upper_arm: f64,
    elbow_in: f64,
    elbow_out: f64,
    forearm: f64,
    wrist_offset: f64,
    frame7_from_tcp: Rigid,
}

/// Up to eight solutions in fixed storage, without heap allocation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Branches {
    configs: [[f64; 7]; 8],
    count: usize,
}

impl Branches {
    fn push(&mut self, config: [f64; 7]) {
        if let Some(slot) = self.configs.get_mut(self.count) {
            *slot = config;
            self.count += 1;
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &[f64; 7]> {
        self.configs.iter().take(self.count)
    }
}

impl FrankaGeometry {
    /// Link lengths of a chain with the Panda's geometry; `None` if its axes differ.
    pub(crate) fn of(chain: &Chain) -> Option<Self> {
        const TOLERANCE: f64 = 1e-7;
        // sin of the twist between each axis and its predecessor; the cosine is 0, but 1 for the first.
        const TWISTS: [f64; 7] = [0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0];
        let joints = chain.joints();
        let (tcp_frame, frame7_from_tcp) = chain.tcp_mount();
        if joints.len() != 7 || tcp_frame != 7 {
            return None;
        }
        let serial = joints.iter().enumerate().all(|(index, joint)| joint.parent_frame == index && !joint.is_prismatic);
        let twisted = joints.iter().zip(TWISTS).skip(1).all(|(joint, sin)| {
            let rotation = joint.parent_from_joint.rotation;
            (rotation.x_axis - DVec3::X).length() < TOLERANCE
                && (rotation.z_axis - DVec3::new(0.0, -sin, 0.0)).length() < TOLERANCE
        });
        let offset = |index: usize| joints[index].parent_from_joint.translation;
        let expected = [
            DVec3::ZERO,
            DVec3::new(0.0, offset(2).y, 0.0),
            DVec3::new(offset(3).x, 0.0, 0.0),
            DVec3::new(offset(4).x, offset(4).y, 0.0),
            DVec3::ZERO,
            DVec3::new(offset(6).x, 0.0, 0.0),
        ];
        let placed =
            expected.iter().enumerate().all(|(index, place)| (offset(index + 1) - *place).length() < TOLERANCE);
        (serial && twisted && placed).then(|| Self {
            base_from_shoulder: joints[0].parent_from_joint,
            upper_arm: -offset(2).y,
            elbow_in: offset(3).x,
            elbow_out: offset(4).x,
            forearm: offset(4).y,
            wrist_offset: offset(6).x,
            frame7_from_tcp,
        })
    }

    /// All solutions for a TCP pose and a value of joint 7, without applying joint limits.
    ///
    /// `joint1` is used if joint 1 is free (upper arm vertical).
    pub(crate) fn solve(&self, world_from_tcp: &Rigid, joint7: f64, joint1: f64) -> Branches {
        let mut branches = Branches::default();
        let shoulder_from_frame7 = self.base_from_shoulder.inverse() * *world_from_tcp * self.frame7_from_tcp.inverse();
        // Frame 6 from frame 7: undo the rotation of joint 7, its twist of +90° and the offset along x.
        let (sin7, cos7) = joint7.sin_cos();
        let untwisted = shoulder_from_frame7.rotated_z(-sin7, cos7).rotation;
        let (x6, y6, z6) = (untwisted.x_axis, -untwisted.z_axis, untwisted.y_axis);
        let wrist = shoulder_from_frame7.translation - x6 * self.wrist_offset;

        let (a4, a5, d3, d5) = (self.elbow_in, self.elbow_out, self.upper_arm, self.forearm);
        let reach = wrist.length();
        if reach < 1e-9 {
            return branches;
        }
        // |wrist|² as a function of joint 4: a·cos + b·sin = c.
        let (a, b) = (a4 * a5 + d3 * d5, d3 * a5 - a4 * d5);
        let c = (reach * reach - a4 * a4 - a5 * a5 - d3 * d3 - d5 * d5) / 2.0;
        let Some(spread) = angle_of_cosine(c / a.hypot(b)) else { return branches };
        for joint4 in both(b.atan2(a), spread) {
            let (s4, c4) = joint4.sin_cos();
            // wrist -> shoulder in the axes x4 and y4 (= axis 5).
            let along_x4 = -a4 * c4 - d3 * s4 - a5;
            let along_axis5 = a4 * s4 - d3 * c4 - d5;
            let to_shoulder = -wrist;
            // Axis 5: perpendicular to axis 6, at a known angle to the line wrist - shoulder.
            let across = to_shoulder - z6 * to_shoulder.dot(z6);
            let Some(across_unit) = across.try_normalize() else { continue };
            let Some(tilt) = angle_of_cosine(along_axis5 / across.length()) else { continue };
            if along_x4.abs() < 1e-12 {
                continue;
            }
            for turn in both(0.0, tilt) {
                let axis5 = across_unit * turn.cos() + z6.cross(across_unit) * turn.sin();
                let x4 = ((to_shoulder - axis5 * along_axis5) / along_x4).normalize_or_zero();
                let y5 = -z6;
                let x5 = y5.cross(axis5);
                let joint6 = axis5.dot(x6).atan2(axis5.dot(y6));
                let joint5 = (-x4.dot(y5)).atan2(x4.dot(x5));
                let x3 = x4 * c4 - axis5 * s4;
                let z3 = x4 * s4 + axis5 * c4;
                let lean = DVec3::new(z3.x, z3.y, 0.0).length().atan2(z3.z);
                for (joint2, side) in [(lean, 1.0), (-lean, -1.0)] {
                    let joint1 = if lean.abs() < 1e-9 { joint1 } else { (side * z3.y).atan2(side * z3.x) };
                    let (s1, c1) = joint1.sin_cos();
                    let (s2, c2) = joint2.sin_cos();
                    let joint3 = x3.dot(DVec3::new(-s1, c1, 0.0)).atan2(x3.dot(DVec3::new(c1 * c2, s1 * c2, -s2)));
                    branches.push([joint1, joint2, joint3, joint4, joint5, joint6, joint7]);
                }
            }
        }
        branches
    }
}

/// arccos, tolerating rounding just beyond ±1; `None` farther outside.
fn angle_of_cosine(cosine: f64) -> Option<f64> {
    (cosine.abs() <= 1.0 + 1e-9).then(|| cosine.clamp(-1.0, 1.0).acos())
}

fn both(center: f64, spread: f64) -> [f64; 2] {
    [center + spread, center - spread]
}

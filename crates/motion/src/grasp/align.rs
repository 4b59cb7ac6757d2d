//! Grasps turned towards a tool orientation, where the object is round.

use std::f64::consts::TAU;

use genmanip_core::{Grasp, Pose};
use glam::{DQuat, DVec3};

use super::solid::Solid;
use super::target::GraspTarget;
use crate::collision::GeometryError;

/// Number of turns about the vertical at which an object must offer the same contacts to count as round.
const TURNS: usize = 12;
/// Maximum difference of contact positions at these turns (m): more than the error of a body of revolution that is made
/// of flat pieces.
const SAME_CONTACT_M: f64 = 0.002;
/// Maximum loss of the cosine between closing line and surface normals at these turns: pieces with 16 sides lose 0.02.
const SAME_COSINE: f64 = 0.05;
/// Distance before the TCP at which rays along the closing line start (m): outside of any object that fits the gripper.
const OUTSIDE_M: f64 = 0.3;

/// Grasps (object frame) on a round object, each turned about the vertical through the centre of mass as near to a tool
/// orientation (world frame) as possible; other grasps unchanged.
///
/// # Errors
/// Fails if a collision piece has no volume.
pub(crate) fn turned_towards(
    target: &GraspTarget,
    grasps: Vec<Grasp>,
    world_from_tcp: DQuat,
) -> Result<Vec<Grasp>, GeometryError> {
    let solid = Solid::new(target.pieces)?;
    let object_from_world = target.world_from_object.rotation.inverse();
    let (up, wanted) = ((object_from_world * DVec3::Z).normalize(), object_from_world * world_from_tcp);
    let turn = |grasp: &Grasp, angle: f64| {
        let turn = DQuat::from_axis_angle(up, angle);
        let center = target.center_of_mass;
        let position = center + turn * (grasp.pose.position - center);
        Grasp { pose: Pose { position, rotation: turn * grasp.pose.rotation }, ..grasp.clone() }
    };
    let is_round = |grasp: &Grasp| {
        let Some(here) = contacts(&solid, grasp) else { return false };
        (1..TURNS).all(|step| {
            let there = contacts(&solid, &turn(grasp, TAU * step as f64 / TURNS as f64));
            there.is_some_and(|there| here.is_same(&there))
        })
    };
    let towards = |grasp: Grasp| {
        if !is_round(&grasp) {
            return grasp;
        }
        // Swing-twist decomposition: the twist about the vertical of the rotation from the grasp to the wanted
        // orientation.
        let missing = wanted * grasp.pose.rotation.inverse();
        turn(&grasp, 2.0 * missing.xyz().dot(up).atan2(missing.w))
    };
    Ok(grasps.into_iter().map(towards).collect())
}

/// Ends of the closing line inside the object, relative to the TCP (m), and the smaller of the two cosines between
/// closing line and surface normals there.
struct Contacts {
    ends: [f64; 2],
    cosine: f64,
}

impl Contacts {
    fn is_same(&self, other: &Self) -> bool {
        self.ends.iter().zip(other.ends).all(|(a, b)| (a - b).abs() <= SAME_CONTACT_M)
            && other.cosine >= self.cosine - SAME_COSINE
    }
}

/// Contacts nearest to the fingers of a grasp; `None` if the closing line misses the object.
fn contacts(solid: &Solid, grasp: &Grasp) -> Option<Contacts> {
    let closing = grasp.pose.transform_vector(DVec3::Y);
    let chords = solid.chords(grasp.pose.position - closing * OUTSIDE_M, closing, 0.0005);
    let nearest = |side: f64, offset: fn(&super::solid::Chord) -> f64| {
        let missed = move |chord: &super::solid::Chord| (offset(chord) - OUTSIDE_M - side * grasp.width / 2.0).abs();
        chords.iter().min_by(|a, b| missed(a).total_cmp(&missed(b)))
    };
    let (enter, leave) = (nearest(-1.0, |chord| chord.enter)?, nearest(1.0, |chord| chord.leave)?);
    Some(Contacts {
        ends: [enter.enter - OUTSIDE_M, leave.leave - OUTSIDE_M],
        cosine: (-enter.enter_normal.dot(closing)).min(leave.leave_normal.dot(closing)),
    })
}

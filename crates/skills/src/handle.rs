//! Frame of a moving link's handle.

use genmanip_assets::handle_bounds;
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{ObjectModel, Pose};
use genmanip_layout::articulation::JointChange;

use crate::Verb;

/// Handle of a moving link: its frame has the origin at the centre of the handle's bounds and the axes of the link, with
/// which it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Handle {
    /// Index of the link in the object.
    pub link: usize,
    /// Index into the object's joint positions.
    pub joint: usize,
    /// The handle's frame in that of the link.
    pub link_from_handle: Pose,
    /// Half of the handle's size along its axes, m.
    pub half_m: DVec3,
}

impl Handle {
    /// Handle of a link, by its index and that of its joint; without a handle, the frame is that of the link's bounds.
    /// `None` if there is no such link.
    pub fn of(model: &ObjectModel, link: usize, joint: usize) -> Option<Self> {
        let moving = model.links.get(link)?;
        let bounds =
            handle_bounds(moving).unwrap_or_else(|| genmanip_core::Aabb::from_pieces(&Pose::IDENTITY, &moving.pieces));
        let center = bounds.center();
        center.is_finite().then(|| Self {
            link,
            joint,
            link_from_handle: Pose::from_position(center),
            half_m: bounds.size() / 2.0,
        })
    }

    /// `world_from_handle` with the handle's joint at a position (rad or m), and the object's other joints as given.
    pub fn world_pose(
        &self,
        model: &ObjectModel,
        world_from_object: &Pose,
        joint_positions: &[f64],
        position: f64,
    ) -> Pose {
        let mut positions = joint_positions.to_vec();
        if let Some(own) = positions.get_mut(self.joint) {
            *own = position;
        }
        let object_from_link = model.link_poses(&positions).get(self.link).copied().unwrap_or_default();
        *world_from_object * object_from_link * self.link_from_handle
    }
}

/// `handle_from_tcp` for a handle of another size: a tool inside the handle's bounds keeps its share of the size along
/// each axis, one outside keeps its distance from the surface. Into a longer handle the tool reaches no deeper, since
/// its fingers do not grow.
pub fn rescaled(handle_from_tcp: &Pose, from_half_m: DVec3, to_half_m: DVec3) -> Pose {
    let into = handle_from_tcp.rotation * DVec3::Z;
    let along = |axis: usize| {
        let (at, from, to) = (handle_from_tcp.position[axis], from_half_m[axis], to_half_m[axis]);
        if into[axis].abs() > STEEP && to > from {
            return at - (to - from) * into[axis].signum();
        }
        let beyond = at.abs() - from;
        match beyond > 0.0 || from < MIN_HALF_M {
            true => at + (to - from) * at.signum(),
            false => at * to / from,
        }
    };
    Pose { position: DVec3::new(along(0), along(1), along(2)), ..*handle_from_tcp }
}

/// Cosine of the angle between a tool's direction and an axis up to which the tool reaches along that axis.
const STEEP: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Half size of a handle below which shares of it are meaningless, m.
const MIN_HALF_M: f64 = 1e-4;

/// The same grip with the fingers exchanged: half a turn about the approach direction.
pub fn flipped(tcp: &Pose) -> Pose {
    Pose { rotation: tcp.rotation * DQuat::from_rotation_z(std::f64::consts::PI), ..*tcp }
}

/// Kind of manipulation of a joint change, from the object's affordances and the direction of the change.
pub fn verb(model: &ObjectModel, change: &JointChange) -> Verb {
    let affords = |word: &str| model.card.annotations.affordances.iter().any(|known| known == word);
    let opens = change.targets.first().is_some_and(|target| target.abs() > change.from.abs());
    match opens {
        _ if affords("press") => Verb::Press,
        _ if affords("turn") => Verb::Turn,
        true if affords("lift") => Verb::Lift,
        true => Verb::Pull,
        false => Verb::Push,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_keeps_its_share_of_a_handle_its_distance_from_it_and_its_depth_in_a_longer_one() {
        let down = DQuat::from_rotation_x(std::f64::consts::PI);
        let small = DVec3::new(0.02, 0.03, 0.04);
        for (what, rotation, at, half_m, expected) in [
            ("a share to the side", down, [0.01, 0.0, 0.0], [0.04, 0.03, 0.04], [0.02, 0.0, 0.0]),
            ("beside it", down, [0.025, 0.0, 0.0], [0.04, 0.03, 0.04], [0.045, 0.0, 0.0]),
            ("above it", down, [0.0, 0.0, 0.05], [0.02, 0.03, 0.06], [0.0, 0.0, 0.07]),
            ("as deep in a taller one", down, [0.0, 0.0, 0.01], [0.02, 0.03, 0.06], [0.0, 0.0, 0.03]),
            ("from below likewise", DQuat::IDENTITY, [0.0, 0.0, -0.01], [0.02, 0.03, 0.06], [0.0, 0.0, -0.03]),
            ("less deep in a flatter one", down, [0.0, 0.0, 0.02], [0.02, 0.03, 0.02], [0.0, 0.0, 0.01]),
        ] {
            let pose = Pose { position: at.into(), rotation };
            let moved = rescaled(&pose, small, half_m.into());
            assert!(moved.position.abs_diff_eq(expected.into(), 1e-12), "{what}: {}", moved.position);
            assert_eq!(moved.rotation, rotation);
        }
    }
}

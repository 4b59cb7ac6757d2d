//! Bound on the reach of an arm: rejects a pose at once where a search would try thousands of postures in vain.

use glam::DVec3;

use super::numeric::{FEW_POSITION, FewJoints};
use crate::chain::{Chain, ChainJoint};
use crate::rigid::Rigid;

/// Ball that contains the origin of the last joint at every configuration.
///
/// A TCP pose fixes the last joint's origin, so that the length of the tool does not loosen the bound.
#[derive(Clone, Debug)]
pub(super) struct Reach {
    /// Origin of the first joint (m, world frame).
    center: DVec3,
    radius_m: f64,
    tcp_from_last: Rigid,
}

impl Reach {
    pub fn of(chain: &Chain) -> Self {
        let (last, last_from_tcp) = chain.tcp_mount();
        let joint = |frame: usize| chain.moving().get(frame.checked_sub(1)?);
        let upwards = std::iter::successors(joint(last), |it| joint(it.parent_frame));
        let mut path: Vec<&ChainJoint> = upwards.collect();
        path.reverse();
        let slide = |joint: &&ChainJoint| {
            if joint.is_prismatic { joint.lower.abs().max(joint.upper.abs()) } else { 0.0 }
        };
        let slides: f64 = path.iter().map(slide).sum();
        // An arm with fewer than six joints meets the pose within these errors.
        let few = FEW_POSITION + FewJoints::MET.max_error * last_from_tcp.translation.length();
        let error = if chain.tool_dof() < 6 { few } else { 1e-9 };
        Self {
            center: path.first().map_or(DVec3::ZERO, |joint| joint.parent_from_joint.translation),
            radius_m: extent_m(path.get(1..).unwrap_or_default()) + slides + error,
            tcp_from_last: last_from_tcp.inverse(),
        }
    }

    /// False if no configuration has this `world_from_tcp`.
    pub fn may_contain(&self, world_from_tcp: &Rigid) -> bool {
        world_from_tcp.point(self.tcp_from_last.translation).distance(self.center) <= self.radius_m
    }
}

/// Upper bound on the distance that the offsets of consecutive joints span: each offset counts with its length, or two
/// with the largest length of their sum as the joint between them turns, whichever partition is shortest.
fn extent_m(joints: &[&ChainJoint]) -> f64 {
    let (mut before, mut here) = (f64::INFINITY, 0.0);
    for (index, joint) in joints.iter().enumerate() {
        let single = here + joint.parent_from_joint.translation.length();
        let pair = index.checked_sub(1).map_or(f64::INFINITY, |previous| before + pair_m(joints[previous], joint));
        (before, here) = (here, single.min(pair));
    }
    here
}

/// Largest distance between the origins of a joint's parent and of the joint after it.
fn pair_m(joint: &ChainJoint, next: &ChainJoint) -> f64 {
    let one = joint.parent_from_joint.rotation.transpose() * joint.parent_from_joint.translation;
    let other = next.parent_from_joint.translation;
    let radius = |offset: DVec3| offset.truncate().length();
    let product = one.z * other.z + radius(one) * radius(other);
    (one.length_squared() + other.length_squared() + 2.0 * product).sqrt()
}

//! Stable poses of an object on a level surface.

use genmanip_core::{ObjectModel, Piece, Pose};
use glam::{DQuat, DVec3};
use serde::Serialize;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Height above the lowest point up to which support points carry the object, m: more than rounding of data, less than
/// the height of a foot.
const TOUCHING_M: f64 = 0.0004;
/// Minimum distance of the centre of mass from the edge of the support polygon, m; with less, a nudge would topple the
/// object. Chosen by hand.
const MARGIN_M: f64 = 0.003;
/// Number of directions in which the support polygon is measured.
const DIRECTIONS: usize = 32;

/// Stable pose on a level surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StablePose {
    /// Name of the pose, e.g. `upright`.
    pub name: &'static str,
    /// Pose with the lowest point at z = 0; the horizontal position is unchanged.
    pub world_from_object: Pose,
    /// Smallest distance of the centre of mass from the edge of the support polygon, m; negative outside.
    pub margin_m: f64,
}

/// Stable poses among the six axis-aligned orientations, upright first.
///
/// Upright is always included; a negative margin means a slight lean, as of a spoon resting on bowl and grip.
///
/// Computed from the support function of the exact pieces: curved side faces contribute no support polygon, so that a
/// ball or a can on its side is not listed.
/// Articulated objects have only the canonical pose.
pub fn stable_poses(model: &ObjectModel) -> Vec<StablePose> {
    let turns = [
        ("upright", DQuat::IDENTITY),
        ("upside down", DQuat::from_rotation_x(PI)),
        ("on its front", DQuat::from_rotation_y(-FRAC_PI_2)),
        ("on its back", DQuat::from_rotation_y(FRAC_PI_2)),
        ("on its left side", DQuat::from_rotation_x(FRAC_PI_2)),
        ("on its right side", DQuat::from_rotation_x(-FRAC_PI_2)),
    ];
    let joints = vec![0.0; model.joint_count()];
    let pieces = model.pieces(&joints);
    let total: f64 = model.links.iter().map(|link| link.mass.mass_kg).sum();
    let weighted = model.links.iter().zip(model.link_poses(&joints));
    let center = weighted.map(|(link, pose)| pose.transform_point(link.mass.center) * link.mass.mass_kg).sum::<DVec3>()
        / total.max(1e-9);
    turns
        .into_iter()
        .enumerate()
        .filter_map(|(index, (name, rotation))| {
            let (lowest, margin_m) = support(&pieces, center, rotation);
            let is_canonical = index == 0;
            if !is_canonical && (model.card.is_articulated || margin_m < MARGIN_M) {
                return None;
            }
            Some(StablePose { name, world_from_object: Pose::new(DVec3::Z * -lowest, rotation), margin_m })
        })
        .collect()
}

/// Lowest height of the rotated pieces (m), and distance of the centre of mass from the edge of the support polygon
/// (m).
fn support(pieces: &[Piece], center: DVec3, rotation: DQuat) -> (f64, f64) {
    let back = rotation.inverse();
    let height = |point: DVec3| (rotation * point).z;
    let lowest = pieces.iter().map(|piece| height(piece.support(back * DVec3::NEG_Z))).fold(f64::INFINITY, f64::min);
    let low: Vec<&Piece> =
        pieces.iter().filter(|piece| height(piece.support(back * DVec3::NEG_Z)) < lowest + TOUCHING_M).collect();
    let margin = (0..DIRECTIONS).map(|index| {
        let angle = TAU * index as f64 / DIRECTIONS as f64;
        let outward = DVec3::new(angle.cos(), angle.sin(), 0.0);
        // A direction slightly off the vertical finds the vertex of the lowest face that is outermost in that
        // direction.
        let reach = low.iter().map(|piece| {
            let point = rotation * piece.support(back * (DVec3::NEG_Z + outward * 1e-3));
            if point.z < lowest + TOUCHING_M { (point - rotation * center).dot(outward) } else { f64::NEG_INFINITY }
        });
        reach.fold(f64::NEG_INFINITY, f64::max)
    });
    (lowest, margin.fold(f64::INFINITY, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Catalogue;

    #[test]
    fn stable_poses_of_known_objects() {
        let check = |uid: &str, expected: &[&str]| {
            let model = Catalogue::builtin().build(uid).unwrap();
            let names: Vec<&str> = stable_poses(&model).iter().map(|pose| pose.name).collect();
            assert_eq!(names, expected, "{}", model.card.name);
        };
        // Expected poses: a cube on every side, a can on its ends, a mug also on its rim, a cabinet only upright.
        check(
            "046",
            &["upright", "upside down", "on its front", "on its back", "on its left side", "on its right side"],
        );
        check("021", &["upright", "upside down"]);
        check("001", &["upright", "upside down"]);
        check("057", &["upright"]);
    }
}

//! Primitive fitting: boxes, cylinders and ellipsoids for meshes that nearly match one.

use genmanip_core::{Aabb, Piece, Pose, Shape};
use glam::{DQuat, DVec3};

/// Minimum volume of the mesh as a fraction of the fitted primitive's volume. Chosen by hand.
const FILLED: f64 = 0.92;
/// Number of yaw angles within 90° at which a bounding box is fitted.
const TURNS: usize = 18;

/// Best bounding box, cylinder or ellipsoid of hull vertices that enclose `volume` (m³), with its name; `None` if the
/// mesh fills less than `FILLED` of it.
pub fn fit(corners: &[DVec3], volume: f64) -> Option<(Piece, &'static str)> {
    let shapes = [ball(corners, volume), cylinder(corners, volume), cuboid(corners, volume)];
    let best = shapes.into_iter().flatten().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let name = match best.0.shape {
        Shape::Box { .. } => "box",
        Shape::Cylinder { .. } => "cylinder",
        _ => "ellipsoid",
    };
    (best.1 >= FILLED).then_some((best.0, name))
}

fn cuboid(corners: &[DVec3], volume: f64) -> Option<(Piece, f64)> {
    (0..TURNS)
        .map(|turn| {
            let rotation = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * turn as f64 / TURNS as f64);
            let bounds = Aabb::from_points(corners.iter().map(|corner| rotation.inverse() * *corner));
            let half_extents = bounds.size() / 2.0;
            let pose = Pose { position: rotation * bounds.center(), rotation };
            (
                Piece { shape: Shape::Box { half_extents }, link_from_piece: pose },
                volume / bounds.size().element_product(),
            )
        })
        .filter(|(_, filled)| filled.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

fn cylinder(corners: &[DVec3], volume: f64) -> Option<(Piece, f64)> {
    let bounds = Aabb::from_points(corners.iter().copied());
    let along = [
        (DVec3::Z, DQuat::IDENTITY),
        (DVec3::X, DQuat::from_rotation_arc(DVec3::Z, DVec3::X)),
        (DVec3::Y, DQuat::from_rotation_arc(DVec3::Z, DVec3::Y)),
    ];
    along
        .into_iter()
        .map(|(axis, rotation)| {
            let center = bounds.center();
            let half_height = bounds.size().dot(axis) / 2.0;
            let radius = corners.iter().map(|corner| (*corner - center).reject_from(axis).length()).fold(0.0, f64::max);
            let shape = Shape::Cylinder { radius, half_height };
            let filled = volume / (2.0 * std::f64::consts::PI * radius * radius * half_height);
            (Piece { shape, link_from_piece: Pose { position: center, rotation } }, filled)
        })
        .filter(|(_, filled)| filled.is_finite())
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Ellipsoid inscribed in the bounding box, and the fraction of it that the mesh fills; `None` if a vertex protrudes by
/// more than 2 %.
fn ball(corners: &[DVec3], volume: f64) -> Option<(Piece, f64)> {
    let bounds = Aabb::from_points(corners.iter().copied());
    let radii = bounds.size() / 2.0;
    let outermost = corners.iter().map(|corner| ((*corner - bounds.center()) / radii).length()).fold(0.0, f64::max);
    let filled = volume / (4.0 / 3.0 * std::f64::consts::PI * radii.element_product());
    // A faceted ball fills less than the exact one: 0.92 admits a coarse ball.
    (outermost < 1.02 && filled.is_finite() && filled <= 1.02)
        .then(|| (Piece::at(bounds.center(), Shape::Ellipsoid { radii }), filled))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collision::hull::{convex_hull, volume};

    #[test]
    fn boxes_cylinders_and_balls_are_fitted() {
        let turn = DQuat::from_rotation_z(0.5);
        let cuboid: Vec<DVec3> = (0..8_u32)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * 2.0 - 1.0)
            .map(|corner| turn * (corner * DVec3::new(0.05, 0.02, 0.08)) + DVec3::Z * 0.08)
            .collect();
        let ring = |count: u32, radius: f64, height: f64| {
            (0..count).map(move |i| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
                DVec3::new(radius * cos, radius * sin, height)
            })
        };
        let can: Vec<DVec3> = ring(32, 0.03, 0.0).chain(ring(32, 0.03, 0.12)).collect();
        let ball: Vec<DVec3> = (1..20)
            .flat_map(|row| {
                let angle = std::f64::consts::PI * f64::from(row) / 20.0;
                ring(40, 0.04 * angle.sin(), 0.04 * angle.cos())
            })
            .chain([DVec3::Z * 0.04, DVec3::Z * -0.04])
            .collect();
        let pyramid: Vec<DVec3> = ring(4, 0.05, 0.0).chain([DVec3::Z * 0.1]).collect();
        let named = |points: &[DVec3]| {
            let (corners, triangles) = convex_hull(points).unwrap();
            fit(&corners, volume(&corners, &triangles)).map(|(_, name)| name)
        };
        assert_eq!(named(&cuboid), Some("box"));
        assert_eq!(named(&can), Some("cylinder"));
        assert_eq!(named(&ball), Some("ellipsoid"));
        assert_eq!(named(&pyramid), None);
    }
}

//! Triangle meshes of primitive shapes.

use std::f64::consts::{PI, TAU};

use genmanip_core::Shape;
use glam::DVec3;

use crate::collision::hull::convex_hull;
use crate::raw::RawMesh;

/// Number of vertices around the circumference of a round shape, and (`ROWS`) rows per hemisphere. Chosen by hand.
const AROUND: usize = 32;
const ROWS: usize = 8;

/// Mesh of a shape in its own frame.
pub fn mesh(shape: &Shape) -> RawMesh {
    let ring = |radius: f64, z: f64| {
        (0..AROUND).map(move |i| {
            let (sin, cos) = (TAU * i as f64 / AROUND as f64).sin_cos();
            DVec3::new(radius * cos, radius * sin, z)
        })
    };
    // Rings of the two hemispheres, shifted apart by the half length.
    let ball = |half_length: f64| {
        let rows = (1..2 * ROWS).flat_map(|row| {
            let angle = PI * row as f64 / (2 * ROWS) as f64;
            let shift = if row <= ROWS { half_length } else { -half_length };
            let both = if row == ROWS && half_length > 0.0 { vec![half_length, -half_length] } else { vec![shift] };
            both.into_iter().map(move |shift| (angle.sin(), angle.cos(), shift)).collect::<Vec<_>>()
        });
        rows.collect::<Vec<_>>()
    };
    let points: Vec<DVec3> = match shape {
        Shape::Box { half_extents } => (0..8_u32)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * 2.0 - 1.0)
            .map(|corner| corner * *half_extents)
            .collect(),
        Shape::Sphere { radius } => round(&ball(0.0), DVec3::splat(*radius), 0.0),
        Shape::Ellipsoid { radii } => round(&ball(0.0), *radii, 0.0),
        Shape::Capsule { radius, half_length } => round(&ball(*half_length), DVec3::splat(*radius), *half_length),
        Shape::Cylinder { radius, half_height } => {
            ring(*radius, -half_height).chain(ring(*radius, *half_height)).collect()
        }
        Shape::Hull { points } => points.clone(),
    };
    let (positions, triangles) = convex_hull(&points).unwrap_or_default();
    RawMesh { positions, uvs: Vec::new(), triangles }
}

fn round(rows: &[(f64, f64, f64)], radii: DVec3, half_length: f64) -> Vec<DVec3> {
    let poles = [DVec3::Z * (radii.z + half_length), DVec3::Z * -(radii.z + half_length)];
    let around = rows.iter().flat_map(|&(across, up, shift)| {
        (0..AROUND).map(move |i| {
            let (sin, cos) = (TAU * i as f64 / AROUND as f64).sin_cos();
            DVec3::new(across * cos, across * sin, up) * radii + DVec3::Z * shift
        })
    });
    around.chain(poles).collect()
}

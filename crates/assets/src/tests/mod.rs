//! Tests of the built-in data, with shared geometry functions.

mod cameras;
mod families;
mod frozen;
mod grasps;
mod joints;
mod objects;
mod robot;
mod robot_files;
mod surfaces;
mod variants;
mod world_text;
mod worlds;

use genmanip_core::{Piece, Pose, VisualPart};
use glam::DVec3;

/// Maximum of a function of a unit vector: a coarse search over the sphere, refined in shrinking caps.
fn largest_over_directions(value: impl Fn(DVec3) -> f64) -> f64 {
    let sphere = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 100.0;
        let angle = 2.399_963 * f64::from(i);
        DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
    };
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    let mut best = axes
        .chain((0..100).map(sphere))
        .map(|d| (value(d), d))
        .fold((f64::MIN, DVec3::Z), |best, next| if next.0 > best.0 { next } else { best });
    for round in 0..30 {
        let reach = 0.3 * 0.75f64.powi(round);
        for i in 0..20 {
            let direction = (best.1 + sphere((i * 5 + round as u32 * 37) % 100) * reach).normalize();
            let next = value(direction);
            if next > best.0 {
                best = (next, direction);
            }
        }
    }
    best.0
}

/// Signed distance of a point from a piece; positive outside.
fn separation(piece: &Piece, point: DVec3) -> f64 {
    largest_over_directions(|direction| (point - piece.support(direction)).dot(direction))
}

/// Largest distance by which the visual surface protrudes from the collision pieces, sampled at every `stride`-th
/// vertex.
fn uncovered(visual: &[VisualPart], pieces: &[Piece], stride: usize) -> f64 {
    let corners = visual.iter().flat_map(|part| {
        part.mesh.positions.iter().map(|position| part.link_from_part.transform_point(position.as_dvec3()))
    });
    let gap = |point: DVec3| {
        let within_reach = pieces.iter().filter(|piece| {
            let reach = piece.shape.bounding_radius() + 0.02;
            piece.link_from_piece.position.distance(point) < reach
        });
        within_reach.map(|piece| separation(piece, point)).fold(0.02, f64::min)
    };
    corners.step_by(stride).map(gap).fold(0.0, f64::max)
}

/// Smallest signed distance between two sets of pieces; negative if they overlap, at most 5 cm.
fn gap(a: &[Piece], world_from_a: &Pose, b: &[Piece], world_from_b: &Pose) -> f64 {
    let mut smallest: f64 = 0.05;
    for first in a {
        for second in b {
            let place =
                |pose: &Pose, piece: &Piece| Piece { link_from_piece: *pose * piece.link_from_piece, ..piece.clone() };
            let (first, second) = (place(world_from_a, first), place(world_from_b, second));
            let reach = first.shape.bounding_radius() + second.shape.bounding_radius();
            if first.link_from_piece.position.distance(second.link_from_piece.position) < reach + smallest.max(0.0) {
                let separation = largest_over_directions(|d| (second.support(-d) - first.support(d)).dot(d));
                smallest = smallest.min(separation);
            }
        }
    }
    smallest
}

//! Variants of a rigid object with other proportions, size and mass.

use genmanip_core::{
    AssetRef, CavitySize, MassProperties, ObjectLink, ObjectModel, Piece, Pose, Seed, Shape, TriMesh, VisualPart,
};
use glam::{DMat3, DQuat, DVec3};
use rand::RngExt;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Parameter that holds the uid of the built-in object of which an object is a variant.
pub(crate) const VARIANT_OF: &str = "of";

/// Maximum relative changes of width and depth, of height, and of the length of elongated objects.
const WIDTH_SPREAD: f64 = 0.15;
const HEIGHT_SPREAD: f64 = 0.15;
const LENGTH_SPREAD: f64 = 0.1;
/// Maximum relative change of density.
const DENSITY_SPREAD: f64 = 0.15;
/// Maximum width (m) that scaling may give a graspable object, for a gripper that opens 8 cm.
const MAX_GRASPABLE_M: f64 = 0.0745;

/// Variant of a rigid object, scaled and with another density by factors sampled from the seed.
///
/// Width and depth scale equally, so that round objects stay round; objects more than 1.8 times as long as wide also
/// change their length. A graspable object stays graspable by the 8 cm gripper.
/// Collision pieces are scaled exactly: primitives where possible, otherwise hulls (of round bodies, the inscribed hull
/// of 32 sides).
/// Articulated objects are returned unchanged.
pub fn variant(model: &ObjectModel, seed: Seed) -> ObjectModel {
    let ([link], false) = (model.links.as_slice(), model.card.is_articulated) else { return model.clone() };
    let mut rng = seed.fork("variant").rng();
    let mut spread = |share: f64| 1.0 + share * (2.0 * rng.random::<f64>() - 1.0);
    let size = model.card.size_m;
    let (width, height, length) = (spread(WIDTH_SPREAD), spread(HEIGHT_SPREAD), spread(LENGTH_SPREAD));
    let density = spread(DENSITY_SPREAD);
    let narrow = size.x.min(size.y);
    let width = if narrow <= MAX_GRASPABLE_M + 0.001 { width.min(MAX_GRASPABLE_M / narrow) } else { width };
    let factors = match () {
        () if size.x > 1.8 * size.y => DVec3::new(width * length, width, height),
        () if size.y > 1.8 * size.x => DVec3::new(width, width * length, height),
        () => DVec3::new(width, width, height),
    };
    let mut changed = model.clone();
    let version = match model.asset {
        AssetRef::Builtin { version, .. } | AssetRef::Generated { version, .. } => version,
        AssetRef::Imported { .. } => 0,
    };
    changed.asset = AssetRef::Generated {
        family: model.family.clone(),
        params: BTreeMap::from([(VARIANT_OF.to_owned(), model.card.uid.as_str().into())]),
        seed,
        version,
    };
    changed.card.size_m = size * factors;
    changed.card.annotations.room = changed.card.annotations.room.map(|room| CavitySize {
        inside_m: [room.inside_m[0] * factors.x, room.inside_m[1] * factors.y],
        depth_m: room.depth_m * factors.z,
    });
    changed.card.mass_kg *= factors.element_product() * density;
    changed.links = vec![ObjectLink {
        pieces: link.pieces.iter().map(|piece| stretched_piece(piece, factors)).collect(),
        cavity: link.cavity.iter().map(|piece| stretched_piece(piece, factors)).collect(),
        visual: link.visual.iter().map(|part| stretched_visual(part, factors)).collect(),
        mass: stretched_mass(&link.mass, factors, density),
        ..link.clone()
    }];
    changed
}

fn stretched_mass(mass: &MassProperties, factors: DVec3, density: f64) -> MassProperties {
    let scale = DMat3::from_diagonal(factors);
    let share = factors.element_product() * density;
    // Inertia I is converted to second moments Σ and back: I = tr(Σ) 1 - Σ.
    let trace = |m: &DMat3| m.x_axis.x + m.y_axis.y + m.z_axis.z;
    let second = DMat3::IDENTITY * (trace(&mass.inertia) / 2.0) - mass.inertia;
    let second = scale * second * scale * share;
    MassProperties {
        mass_kg: mass.mass_kg * share,
        center: mass.center * factors,
        inertia: DMat3::IDENTITY * trace(&second) - second,
    }
}

fn stretched_visual(part: &VisualPart, factors: DVec3) -> VisualPart {
    let position = |p: &glam::Vec3| (part.link_from_part.transform_point(p.as_dvec3()) * factors).as_vec3();
    let normal = |n: &glam::Vec3| {
        (part.link_from_part.transform_vector(n.as_dvec3()) / factors).normalize_or(DVec3::Z).as_vec3()
    };
    let stretched = |mesh: &TriMesh| {
        Arc::new(TriMesh {
            positions: mesh.positions.iter().map(position).collect(),
            normals: mesh.normals.iter().map(normal).collect(),
            ..mesh.clone()
        })
    };
    let (mesh, render_mesh) = (stretched(&part.mesh), stretched(&part.render_mesh));
    VisualPart { mesh, render_mesh, link_from_part: Pose::IDENTITY, ..part.clone() }
}

fn stretched_piece(piece: &Piece, factors: DVec3) -> Piece {
    let pose = piece.link_from_piece;
    let rotation = DMat3::from_quat(pose.rotation);
    let local = rotation.transpose() * DMat3::from_diagonal(factors) * rotation;
    let diagonal = DVec3::new(local.x_axis.x, local.y_axis.y, local.z_axis.z);
    let is_diagonal = (local - DMat3::from_diagonal(diagonal)).to_cols_array().iter().all(|v| v.abs() < 1e-9);
    let is_round = is_diagonal && (diagonal.x - diagonal.y).abs() < 1e-9;
    let position = pose.position * factors;
    let kept = |shape: Shape| Piece { shape, link_from_piece: Pose { position, ..pose } };
    match &piece.shape {
        Shape::Sphere { radius } if factors.max_element() - factors.min_element() < 1e-9 => {
            kept(Shape::Sphere { radius: radius * factors.x })
        }
        Shape::Sphere { radius } => Piece::at(position, Shape::Ellipsoid { radii: factors * *radius }),
        Shape::Box { half_extents } if is_diagonal => kept(Shape::Box { half_extents: *half_extents * diagonal }),
        Shape::Ellipsoid { radii } if is_diagonal => kept(Shape::Ellipsoid { radii: *radii * diagonal }),
        Shape::Cylinder { radius, half_height } if is_round => {
            kept(Shape::Cylinder { radius: radius * diagonal.x, half_height: half_height * diagonal.z })
        }
        shape => {
            let image = |point: DVec3| (pose.rotation * point) * factors;
            let points = outline(shape).into_iter().map(image).collect();
            Piece { shape: Shape::Hull { points }, link_from_piece: Pose { position, rotation: DQuat::IDENTITY } }
        }
    }
}

/// Points whose convex hull is the shape; of round shapes, the inscribed body of 32 sides.
fn outline(shape: &Shape) -> Vec<DVec3> {
    const SIDES: usize = 32;
    const RINGS: usize = 8;
    let circle = |radius: f64, height: f64| {
        (0..SIDES).map(move |side| {
            let (sin, cos) = (TAU * side as f64 / SIDES as f64).sin_cos();
            DVec3::new(radius * cos, radius * sin, height)
        })
    };
    let ball = |radii: DVec3| {
        let rings = (0..=RINGS).flat_map(move |ring| {
            let (sin, cos) = (PI * ring as f64 / RINGS as f64).sin_cos();
            circle(sin, cos)
        });
        rings.map(move |point| point * radii).collect::<Vec<_>>()
    };
    match shape {
        Shape::Hull { points } => points.clone(),
        Shape::Box { half_extents } => (0..8)
            .map(|corner| {
                let sign = |bit: usize| if corner >> bit & 1 == 0 { 1.0 } else { -1.0 };
                *half_extents * DVec3::new(sign(0), sign(1), sign(2))
            })
            .collect(),
        Shape::Sphere { radius } => ball(DVec3::splat(*radius)),
        Shape::Ellipsoid { radii } => ball(*radii),
        Shape::Cylinder { radius, half_height } => {
            circle(*radius, *half_height).chain(circle(*radius, -half_height)).collect()
        }
        Shape::Capsule { radius, half_length } => ball(DVec3::splat(*radius))
            .into_iter()
            .flat_map(|point| {
                let shift = DVec3::Z * *half_length;
                let ends = if point.z.abs() < 1e-12 {
                    [Some(shift), Some(-shift)]
                } else {
                    [Some(shift * point.z.signum()), None]
                };
                ends.into_iter().flatten().map(move |shift| point + shift)
            })
            .collect(),
    }
}

//! Geometry of an object model that relations need, prepared once per model.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use genmanip_core::{AssetRef, ObjectLink, ObjectModel, Pose, Seed, Shape, SupportSurface};
use glam::DVec3;
use rand::RngExt;

use super::body_model::BodyModel;
use super::solid::Solid;
use crate::hull::Hull;

/// Number of corners of the polygon that represents a curved outline.
const SIDES: usize = 64;

/// An object model with its surface sampled and its cavities prepared.
#[derive(Debug)]
pub struct ObjectShape {
    /// Model whose geometry is prepared.
    pub(super) model: BodyModel,
    /// One entry per link of the model.
    pub(super) links: Vec<LinkShape>,
    /// Convex hull of a rigid object in its own frame, computed on first use.
    rigid_hull: OnceLock<Solid>,
}

/// The surface and the cavities of one link, in the link's frame.
#[derive(Debug)]
pub(super) struct LinkShape {
    /// Surface points, uniform by area.
    pub samples: Vec<DVec3>,
    /// Area of the surface (m²).
    pub area: f64,
    /// Centroid of the surface.
    pub centroid: DVec3,
    /// Solids in which another object's points count as *in* the object.
    pub cavity: Vec<Solid>,
}

/// Shapes by asset, so that each model is prepared once. Lookups only; iteration order is undefined.
#[derive(Debug)]
pub struct ShapeCache {
    shapes: HashMap<AssetRef, Arc<ObjectShape>>,
    samples: usize,
}

impl Default for ShapeCache {
    fn default() -> Self {
        // The standard error of a share of points is then about 2 %.
        Self::with_samples(512)
    }
}

impl ShapeCache {
    /// A cache that samples each object with about `samples` points.
    pub fn with_samples(samples: usize) -> Self {
        Self { shapes: HashMap::new(), samples }
    }

    /// The shape of a support surface, which is not cached, sampled like the others.
    pub(super) fn of_surface(&self, surface: &SupportSurface) -> ObjectShape {
        ObjectShape::new(BodyModel::of_surface(surface), self.samples)
    }

    /// Prepared shape of a model, from the cache if it is there.
    pub fn get(&mut self, model: &Arc<ObjectModel>) -> Arc<ObjectShape> {
        let make = || Arc::new(ObjectShape::new(BodyModel::Object(Arc::clone(model)), self.samples));
        Arc::clone(self.shapes.entry(model.asset.clone()).or_insert_with(make))
    }
}

impl ObjectShape {
    /// Samples the visual surface, or the collision pieces of a link without one, with about `samples` points.
    fn new(model: BodyModel, samples: usize) -> Self {
        let faces: Vec<Vec<[DVec3; 3]>> = model.links().iter().map(surface).collect();
        let areas: Vec<f64> = faces.iter().map(|faces| faces.iter().map(area).sum()).collect();
        let total: f64 = areas.iter().sum();
        let links = faces
            .iter()
            .zip(&areas)
            .enumerate()
            .map(|(index, (faces, &area))| {
                let count = if total > 0.0 { (samples as f64 * area / total).round() as usize } else { 0 };
                let seed = Seed::new(0).fork("surface").fork_index(index as u64);
                let cavity = model.links()[index].cavity.iter().map(Solid::of_piece).collect();
                LinkShape { samples: sample(faces, area, count, seed), area, centroid: centroid(faces, area), cavity }
            })
            .collect();
        Self { model, links, rigid_hull: OnceLock::new() }
    }

    /// The convex hull in the object's frame at the given link poses.
    pub(super) fn hull(&self, object_from_link: &[Pose]) -> std::borrow::Cow<'_, Solid> {
        let make = || {
            let points: Vec<DVec3> = self
                .model
                .links()
                .iter()
                .zip(object_from_link)
                .flat_map(|(link, pose)| link.pieces.iter().map(move |piece| (*pose * piece.link_from_piece, piece)))
                .flat_map(|(pose, piece)| {
                    outline_points(&piece.shape).into_iter().map(move |point| pose.transform_point(point))
                })
                .collect();
            Solid::of_hull(&Hull::of(&points))
        };
        if self.model.links().len() == 1 {
            std::borrow::Cow::Borrowed(self.rigid_hull.get_or_init(make))
        } else {
            std::borrow::Cow::Owned(make())
        }
    }
}

/// Surface points of a shape whose hull is the shape, with `SIDES` corners around curved shapes.
pub(super) fn outline_points(shape: &Shape) -> Vec<DVec3> {
    let circle = |count: usize| {
        (0..count).map(move |index| {
            let (sin, cos) = (std::f64::consts::TAU * index as f64 / count as f64).sin_cos();
            DVec3::new(cos, sin, 0.0)
        })
    };
    let ball = || {
        (0..=16).flat_map(move |ring| {
            let (sin, cos) = (std::f64::consts::PI * f64::from(ring) / 16.0).sin_cos();
            circle(32).map(move |point| point * sin + DVec3::Z * cos)
        })
    };
    match shape {
        Shape::Box { half_extents } => (0..8)
            .map(|corner| {
                let sign = |bit: u32| if corner & (1 << bit) == 0 { -1.0 } else { 1.0 };
                *half_extents * DVec3::new(sign(0), sign(1), sign(2))
            })
            .collect(),
        Shape::Hull { points } => points.clone(),
        Shape::Sphere { radius } => ball().map(|point| point * *radius).collect(),
        Shape::Ellipsoid { radii } => ball().map(|point| point * *radii).collect(),
        Shape::Cylinder { radius, half_height } => [-1.0, 1.0]
            .into_iter()
            .flat_map(|end| circle(SIDES).map(move |point| point * *radius + DVec3::Z * (end * half_height)))
            .collect(),
        Shape::Capsule { radius, half_length } => ball()
            .map(|point| point * *radius + DVec3::Z * (half_length * if point.z < 0.0 { -1.0 } else { 1.0 }))
            .collect(),
    }
}

/// Directions in the plane of the corners of curved outlines; the set is invariant under mirroring and quarter turns.
pub(super) fn outline_directions() -> impl Iterator<Item = DVec3> {
    (0..SIDES).map(|index| {
        let (sin, cos) = (std::f64::consts::TAU * index as f64 / SIDES as f64).sin_cos();
        DVec3::new(cos, sin, 0.0)
    })
}

fn surface(link: &ObjectLink) -> Vec<[DVec3; 3]> {
    let drawn: Vec<[DVec3; 3]> = link
        .visual
        .iter()
        .flat_map(|part| {
            part.mesh.corners().map(|corners| corners.map(|corner| part.link_from_part.transform_point(corner)))
        })
        .collect();
    if !drawn.is_empty() {
        return drawn;
    }
    let hulls = link.pieces.iter().map(|piece| (Hull::of(&outline_points(&piece.shape)), piece.link_from_piece));
    hulls
        .flat_map(|(hull, pose)| {
            let faces: Vec<[DVec3; 3]> = hull.faces().collect();
            faces.into_iter().map(move |face| face.map(|corner| pose.transform_point(corner)))
        })
        .collect()
}

fn area([a, b, c]: &[DVec3; 3]) -> f64 {
    (*b - *a).cross(*c - *a).length() * 0.5
}

fn centroid(faces: &[[DVec3; 3]], total: f64) -> DVec3 {
    if total <= 0.0 {
        return DVec3::ZERO;
    }
    faces.iter().map(|face| (face[0] + face[1] + face[2]) / 3.0 * area(face)).sum::<DVec3>() / total
}

/// Points at even steps of cumulative area, so that each face gets its share, at random positions in the faces.
fn sample(faces: &[[DVec3; 3]], total: f64, count: usize, seed: Seed) -> Vec<DVec3> {
    let mut rng = seed.rng();
    let mut points = Vec::with_capacity(count);
    let mut covered = 0.0;
    for face in faces {
        covered += area(face);
        while points.len() < count && (points.len() as f64 + 0.5) * total <= covered * count as f64 {
            let (mut u, mut v) = (rng.random::<f64>(), rng.random::<f64>());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            points.push(face[0] + (face[1] - face[0]) * u + (face[2] - face[0]) * v);
        }
    }
    points
}

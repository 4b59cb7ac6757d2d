//! Objects at their poses.

use std::sync::{Arc, OnceLock};

use genmanip_core::{Aabb, InstanceId, ObjectModel, Piece, Pose, ReferenceId, Shape, SupportSurface};
use glam::{DAffine3, DVec2, DVec3};

use super::shape::{ObjectShape, ShapeCache, outline_directions, outline_points};
use crate::planar::Polygon;

/// Depth below the top of a surface down to which an object counts as standing on it, metres: more than the penetration
/// of contacts and less than the thickness of any slab.
const SURFACE_TOLERANCE_M: f64 = 0.002;

/// An object at its pose.
#[derive(Clone, Debug)]
pub struct PosedObject {
    /// Id in the scene.
    pub id: InstanceId,
    /// Object model, shared by instances of the same asset.
    pub model: Arc<ObjectModel>,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions in the order of the links; empty for a rigid object.
    pub joint_positions: Vec<f64>,
}

/// Objects at their poses, ready for relation queries. Outlines are computed on first use.
///
/// Indices count the objects first, then the support surfaces other than the table. Relations treat these surfaces like
/// objects, but they cannot be moved.
#[derive(Clone, Debug)]
pub struct PosedScene {
    objects: Vec<PosedObject>,
    surfaces: Arc<[SupportSurface]>,
    /// Geometry of the objects, then of the surfaces other than the table.
    pub(super) bodies: Vec<Body>,
}

/// Geometry of an object or a surface in the world.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub shape: Arc<ObjectShape>,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions in the order of the links.
    pub joint_positions: Vec<f64>,
    pub object_from_link: Vec<Pose>,
    pub pieces: Vec<WorldPiece>,
    pub bounds: Aabb,
    /// Centroid of the surface, world frame.
    pub center: DVec3,
    /// State given by [`PosedScene::set_previous_states`], for hysteresis; `None` if unknown.
    pub previous_state: Option<String>,
    footprint: OnceLock<Footprint>,
}

/// A convex piece in the world.
#[derive(Clone, Debug)]
pub(super) struct WorldPiece {
    pub link: usize,
    index: usize,
    pub world_from_piece: Pose,
    pub bounds: Aabb,
}

/// Projections of a body onto the table.
#[derive(Clone, Debug)]
pub(super) struct Footprint {
    /// One convex polygon per piece.
    pub pieces: Vec<Polygon>,
    /// Convex hull of all pieces.
    pub hull: Polygon,
}

impl PosedScene {
    /// Places objects among the support surfaces of their world, of which the table is the first. Shapes are taken from
    /// the cache or added to it.
    pub fn new(objects: Vec<PosedObject>, surfaces: &[SupportSurface], shapes: &mut ShapeCache) -> Self {
        let of_object =
            |object: &PosedObject| Body::new(shapes.get(&object.model), object.pose, object.joint_positions.clone());
        let mut bodies: Vec<Body> = objects.iter().map(of_object).collect();
        bodies.extend(surfaces.iter().skip(1).map(|surface| {
            // Not cached: another world may have another surface with the same id.
            Body::new(Arc::new(shapes.of_surface(surface)), surface.world_from_surface(), Vec::new())
        }));
        Self { objects, surfaces: surfaces.into(), bodies }
    }

    /// The support surfaces, the table first.
    pub fn surfaces(&self) -> &[SupportSurface] {
        &self.surfaces
    }

    /// The objects, in the order of their indices.
    pub fn objects(&self) -> impl ExactSizeIterator<Item = &PosedObject> {
        self.objects.iter()
    }

    /// The position among [`PosedScene::surfaces`] of the surface with a body index; `None` for an object.
    pub fn surface_at(&self, index: usize) -> Option<usize> {
        // The table has no body index.
        let count = self.objects.len();
        (count..self.bodies.len()).contains(&index).then(|| index - count + 1)
    }

    /// True if an object penetrates a support surface or one of its boards, or is closer to its side than a margin,
    /// based on bounding boxes. An object standing on a surface does not hit it. False in a world with a table only.
    pub fn hits_surface(&self, index: usize, margin_m: f64) -> bool {
        let Some(bounds) = self.bounds(index).filter(|_| self.surfaces.len() > 1) else { return false };
        let mut pieces = self.surfaces.iter().flat_map(|surface| {
            let world_from_surface = surface.world_from_surface();
            surface.pieces().into_iter().map(move |piece| Aabb::from_pieces(&world_from_surface, [&piece]))
        });
        pieces.any(|piece| {
            let beside = margin_m * DVec3::new(1.0, 1.0, 0.0);
            bounds.min.cmplt(piece.max + beside).all()
                && (piece.min - beside).cmplt(bounds.max).all()
                && bounds.min.z < piece.max.z - SURFACE_TOLERANCE_M
        })
    }

    /// Index of an object, or of a support surface other than the table; `None` for an unknown id.
    pub fn index_of(&self, id: &ReferenceId) -> Option<usize> {
        let surface = || self.surfaces.iter().skip(1).position(|surface| surface.id == *id);
        let object = self.objects.iter().position(|object| object.id == *id);
        object.or_else(|| Some(self.objects.len() + surface()?))
    }

    /// Moves one object and keeps the geometry of the others. An index out of range has no effect.
    pub fn set_pose(&mut self, index: usize, world_from_object: Pose, joint_positions: &[f64]) {
        if let Some((object, body)) = self.objects.get_mut(index).zip(self.bodies.get_mut(index)) {
            (object.pose, object.joint_positions) = (world_from_object, joint_positions.to_vec());
            let previous_state = body.previous_state.take();
            let moved = Body::new(Arc::clone(&body.shape), world_from_object, joint_positions.to_vec());
            *body = Body { previous_state, ..moved };
        }
    }

    /// Translates one object, which keeps its outlines. An index out of range has no effect.
    pub fn shift(&mut self, index: usize, by: DVec3) {
        if let Some((object, body)) = self.objects.get_mut(index).zip(self.bodies.get_mut(index)) {
            object.pose.position += by;
            body.shift(by);
        }
    }

    /// Exact bounds of an object in the world; `None` if the index is out of range.
    pub fn bounds(&self, index: usize) -> Option<Aabb> {
        self.bodies.get(index).map(|body| body.bounds)
    }

    /// Centroid of an object's surface in the world; `None` if the index is out of range.
    pub fn center(&self, index: usize) -> Option<DVec3> {
        self.bodies.get(index).map(|body| body.center)
    }

    /// The sampled surface points of an object in the world.
    pub fn surface_points(&self, index: usize) -> Vec<DVec3> {
        self.bodies.get(index).map(|body| body.samples().collect()).unwrap_or_default()
    }

    /// Corners of each piece of an object projected onto the table; empty if the index is out of range.
    pub fn footprints(&self, index: usize) -> Vec<&[DVec2]> {
        let pieces = self.bodies.get(index).map(|body| body.footprint().pieces.iter());
        pieces.into_iter().flatten().map(|polygon| polygon.corners.as_slice()).collect()
    }

    /// Corners of the convex outline of an object on the table, counter-clockwise; `None` if the index is out of range.
    pub fn outline(&self, index: usize) -> Option<&[DVec2]> {
        self.bodies.get(index).map(|body| body.footprint().hull.corners.as_slice())
    }
}

impl Body {
    fn new(shape: Arc<ObjectShape>, pose: Pose, joint_positions: Vec<f64>) -> Self {
        let object_from_link = shape.model.link_poses(&joint_positions);
        let mut pieces = Vec::new();
        for (link, (part, link_pose)) in shape.model.links().iter().zip(&object_from_link).enumerate() {
            let world_from_link = pose * *link_pose;
            pieces.extend(part.pieces.iter().enumerate().map(|(index, piece)| WorldPiece {
                link,
                index,
                world_from_piece: world_from_link * piece.link_from_piece,
                bounds: Aabb::from_pieces(&world_from_link, [piece]),
            }));
        }
        let bounds = pieces.iter().fold(Aabb::EMPTY, |bounds, piece| bounds.union(&piece.bounds));
        let mut body = Self {
            shape,
            pose,
            joint_positions,
            object_from_link,
            pieces,
            bounds,
            center: DVec3::ZERO,
            previous_state: None,
            footprint: OnceLock::new(),
        };
        let area: f64 = body.shape.links.iter().map(|link| link.area).sum();
        body.center = if area > 0.0 {
            (0..body.shape.links.len()).map(|link| body.link_center(link) * body.shape.links[link].area).sum::<DVec3>()
                / area
        } else {
            bounds.center()
        };
        body
    }

    fn shift(&mut self, by: DVec3) {
        self.pose.position += by;
        self.center += by;
        let moved = |bounds: &Aabb| Aabb { min: bounds.min + by, max: bounds.max + by };
        self.bounds = moved(&self.bounds);
        for piece in &mut self.pieces {
            piece.world_from_piece.position += by;
            piece.bounds = moved(&piece.bounds);
        }
        if let Some(footprint) = self.footprint.get_mut() {
            footprint.pieces.iter_mut().chain([&mut footprint.hull]).for_each(|polygon| polygon.shift(by.truncate()));
        }
    }

    /// Centroid of a link's surface in the world.
    pub fn link_center(&self, link: usize) -> DVec3 {
        (self.pose * self.object_from_link[link]).transform_point(self.shape.links[link].centroid)
    }

    /// The convex body of a piece in its own frame.
    pub fn shape_of(&self, piece: &WorldPiece) -> &Shape {
        &self.piece(piece).shape
    }

    /// Surface points in the world.
    pub fn samples(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.shape.links.iter().zip(&self.object_from_link).flat_map(|(link, object_from_link)| {
            let Pose { position, rotation } = self.pose * *object_from_link;
            // A matrix is faster than a quaternion for thousands of points.
            let world_from_link = DAffine3::from_rotation_translation(rotation, position);
            link.samples.iter().map(move |&point| world_from_link.transform_point3(point))
        })
    }

    /// Projections onto the table, computed on first use.
    pub fn footprint(&self) -> &Footprint {
        self.footprint.get_or_init(|| {
            let pieces: Vec<Polygon> = self.pieces.iter().map(|piece| self.outline_of(piece)).collect();
            let hull = Polygon::hull(pieces.iter().flat_map(|polygon| polygon.corners.iter().copied()).collect());
            Footprint { pieces, hull }
        })
    }

    /// True if the footprint is computed already.
    #[cfg(test)]
    pub fn is_outlined(&self) -> bool {
        self.footprint.get().is_some()
    }

    fn outline_of(&self, piece: &WorldPiece) -> Polygon {
        let shape = self.shape_of(piece);
        let pose = &piece.world_from_piece;
        let points = match shape {
            Shape::Box { .. } | Shape::Hull { .. } => {
                outline_points(shape).into_iter().map(|point| pose.transform_point(point).truncate()).collect()
            }
            _ => outline_directions().map(|direction| piece.support(shape, direction).truncate()).collect(),
        };
        Polygon::hull(points)
    }

    fn piece(&self, piece: &WorldPiece) -> &Piece {
        &self.shape.model.links()[piece.link].pieces[piece.index]
    }
}

impl WorldPiece {
    /// Support point: the farthest point of a piece along a direction, both in the world frame.
    pub fn support(&self, shape: &Shape, direction: DVec3) -> DVec3 {
        let local = self.world_from_piece.rotation.inverse() * direction;
        self.world_from_piece.transform_point(shape.support(local))
    }
}

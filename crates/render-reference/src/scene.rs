//! Scene of the path tracer, and the contribution of a path.

use genmanip_core::Pose;
use genmanip_render::internals::{Backdrop, Material, Mesh, rotation};
use glam::{Affine3A, Vec3A};

use crate::bvh::Bvh;
use crate::lamps::Lamps;

/// Scene of the path tracer.
pub(crate) struct Reference<'a> {
    pub bvh: Bvh,
    pub bodies: Vec<Body<'a>>,
    pub materials: Vec<Material>,
    pub lamps: Lamps<'a>,
    pub backdrop: Backdrop,
}

/// A posed part.
pub(crate) struct Body<'a> {
    pub mesh: &'a Mesh,
    pub body_from_world: Affine3A,
}

impl<'a> Body<'a> {
    pub fn new(mesh: &'a Mesh, pose: &Pose) -> Self {
        let world_from_body = Affine3A { matrix3: rotation(pose), translation: pose.position.as_vec3a() };
        Self { mesh, body_from_world: world_from_body.inverse() }
    }
}

/// Contribution of a path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Brought {
    /// Radiance before exposure.
    pub radiance: Vec3A,
    /// Visible share of the background, and its colour: part of the image, not light.
    pub behind: Vec3A,
    pub background: Vec3A,
}

//! Scene of the path tracer, and the contribution of a path.

use genmanip_core::Pose;
use genmanip_render::internals::{Backdrop, Material, Mesh, rotation};
use glam::{Affine3A, Vec3A};

use crate::bvh::Bvh;
use crate::lamps::Lamps;

/// Everything that paths interact with: geometry, materials, lights and background.
pub(crate) struct Reference<'a> {
    pub bvh: Bvh,
    pub bodies: Vec<Body<'a>>,
    pub materials: Vec<Material>,
    pub lamps: Lamps<'a>,
    pub backdrop: Backdrop,
}

/// Part placed in the world.
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
    /// Radiance of surfaces before exposure, linear RGB.
    pub radiance: Vec3A,
    /// Share of the pixel that shows the background (per colour channel, tinted by glass), and the background colour
    /// times that share. The background is part of the image, not a light.
    pub behind: Vec3A,
    pub background: Vec3A,
}

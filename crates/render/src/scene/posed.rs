//! Posed meshes of a frame, for other renderers.

use genmanip_core::Pose;
use glam::Vec3;

use crate::error::RenderError;
use crate::job::FrameState;
use crate::scene::assets::RenderAssets;

/// A posed mesh of one material.
#[derive(Clone, Copy, Debug)]
pub struct PosedMesh<'a> {
    /// Instance id of its pixels, as in [`crate::FrameBuffers::instance`].
    pub instance: u16,
    /// Pose of the mesh in the world.
    pub world_from_mesh: Pose,
    /// Vertices in the mesh's frame (m).
    pub positions: &'a [Vec3],
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
    /// Linear base colour without the texture, 0-1.
    pub base_color_linear: [f32; 3],
    /// Opacity, 1 for an opaque material.
    pub opacity: f32,
    /// True if it casts shadows.
    pub casts_shadow: bool,
}

impl RenderAssets {
    /// All meshes in full detail at a frame.
    ///
    /// # Errors
    /// A frame of other assets.
    pub fn posed_meshes<'a>(
        &'a self,
        frame: &'a FrameState,
    ) -> Result<impl Iterator<Item = PosedMesh<'a>>, RenderError> {
        let (expected, got) = (self.body_count(), frame.body_poses.len());
        if expected != got {
            return Err(RenderError::BodyCount { expected, got });
        }
        Ok(self.parts.iter().map(|part| PosedMesh {
            instance: part.instance,
            world_from_mesh: part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]),
            positions: &part.mesh.positions,
            triangles: &part.mesh.triangles,
            base_color_linear: part.material.base.to_array(),
            opacity: part.material.opacity,
            casts_shadow: part.casts_shadow,
        }))
    }
}

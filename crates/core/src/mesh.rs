//! Triangle meshes and materials.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use rand::{Rng, RngExt};

use crate::Pose;

/// An indexed triangle mesh in its link's frame, counter-clockwise winding seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertices, metres.
    pub positions: Vec<Vec3>,
    /// Unit normal per vertex.
    pub normals: Vec<Vec3>,
    /// Texture coordinates per vertex; (0, 0) is the first pixel of the first row.
    pub uvs: Vec<Vec2>,
    /// Three vertex indices per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh with its material, posed in the link.
#[derive(Clone, Debug)]
pub struct VisualPart {
    /// Name of the part, e.g. `handle`.
    pub name: String,
    /// Full-resolution mesh, used by judges and planners.
    pub mesh: Arc<TriMesh>,
    /// Mesh used for rendering: the same, or a simplified one within 0.1 mm of it.
    pub render_mesh: Arc<TriMesh>,
    /// Material of the whole part.
    pub material: Material,
    /// Pose of the part in the link's frame.
    pub link_from_part: Pose,
}

impl VisualPart {
    /// A part whose rendering mesh is its full-resolution mesh.
    pub fn new(name: impl Into<String>, mesh: TriMesh, material: Material, link_from_part: Pose) -> Self {
        let mesh = Arc::new(mesh);
        Self { name: name.into(), render_mesh: Arc::clone(&mesh), mesh, material, link_from_part }
    }
}

/// Material of the metallic-roughness model.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Albedo in sRGB, 0-1; multiplied with the texture.
    pub base_color: [f32; 3],
    /// 0 mirror, 1 fully rough.
    pub roughness: f32,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// 1 opaque, 0 transparent.
    pub opacity: f32,
    /// Index of refraction.
    pub ior: f32,
    /// True for a shell without volume, e.g. a drinking glass.
    pub thin_walled: bool,
    /// Base-colour texture; `None` for a uniform colour.
    pub texture: Option<Arc<Texture>>,
}

/// An sRGB image that tiles beyond its borders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// `width * height` pixels, row-major, 8-bit sRGB.
    pub rgb: Vec<u8>,
}

impl Material {
    /// An opaque dielectric of uniform colour (sRGB).
    pub fn plain(base_color: [f32; 3], roughness: f32) -> Self {
        Self { base_color, roughness, metallic: 0.0, opacity: 1.0, ior: 1.5, thin_walled: false, texture: None }
    }

    /// A bare metal of uniform colour (sRGB).
    pub fn metal(base_color: [f32; 3], roughness: f32) -> Self {
        Self { metallic: 1.0, ..Self::plain(base_color, roughness) }
    }
}

impl TriMesh {
    /// Vertex positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.positions[index as usize].as_dvec3()))
    }

    /// Area-weighted centroid of the surface.
    pub fn centroid(&self) -> DVec3 {
        let (sum, area) = self.corners().fold((DVec3::ZERO, 0.0), |(sum, area), [a, b, c]| {
            let weight = (b - a).cross(c - a).length();
            (sum + (a + b + c) / 3.0 * weight, area + weight)
        });
        if area > 0.0 { sum / area } else { DVec3::ZERO }
    }

    /// Points sampled uniformly by area, with outward normals, both in the mesh's frame.
    pub fn sample_surface(&self, count: usize, rng: &mut impl Rng) -> Vec<(DVec3, DVec3)> {
        let mut total = 0.0;
        let cumulative: Vec<f64> = self
            .corners()
            .map(|[a, b, c]| {
                total += (b - a).cross(c - a).length();
                total
            })
            .collect();
        if total <= 0.0 {
            return Vec::new();
        }
        (0..count)
            .map(|_| {
                let target = rng.random::<f64>() * total;
                let index = cumulative.partition_point(|&value| value < target).min(cumulative.len() - 1);
                let [a, b, c] = self.triangles[index].map(|corner| self.positions[corner as usize].as_dvec3());
                let (mut u, mut v) = (rng.random::<f64>(), rng.random::<f64>());
                if u + v > 1.0 {
                    (u, v) = (1.0 - u, 1.0 - v);
                }
                (a + (b - a) * u + (c - a) * v, (b - a).cross(c - a).normalize_or_zero())
            })
            .collect()
    }
}

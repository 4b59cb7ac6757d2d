//! What things look like: triangle meshes and materials.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};
use rand::{Rng, RngExt};

use crate::Pose;

/// An indexed triangle mesh in its link's frame, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Corners, metres.
    pub positions: Vec<Vec3>,
    /// Unit normal per corner.
    pub normals: Vec<Vec3>,
    /// Texture coordinate per corner; (0, 0) is the first pixel of the first row.
    pub uvs: Vec<Vec2>,
    /// Three corners per triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// A mesh with its material, at its place in the link.
#[derive(Clone, Debug)]
pub struct VisualPart {
    /// Name of the part, e.g. `handle`.
    pub name: String,
    /// The surface as finely as it is known: what judges and planners measure.
    pub mesh: Arc<TriMesh>,
    /// The surface that pictures show: the same, or one of fewer triangles within 0.1 mm of it.
    pub drawn: Arc<TriMesh>,
    /// How it reflects.
    pub material: Material,
    /// Where it sits.
    pub link_from_part: Pose,
}

impl VisualPart {
    /// A part that is drawn as it is measured.
    pub fn new(name: impl Into<String>, mesh: TriMesh, material: Material, link_from_part: Pose) -> Self {
        let mesh = Arc::new(mesh);
        Self { name: name.into(), drawn: Arc::clone(&mesh), mesh, material, link_from_part }
    }
}

/// Metallic-roughness material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Albedo in sRGB, 0-1; multiplied with the texture.
    pub base_color: [f32; 3],
    /// 0 mirror, 1 chalk.
    pub roughness: f32,
    /// 0 dielectric, 1 metal.
    pub metallic: f32,
    /// 1 opaque; below, what is behind shows through.
    pub opacity: f32,
    /// Index of refraction.
    pub ior: f32,
    /// A shell without volume, e.g. a drinking glass.
    pub thin_walled: bool,
    /// Picture over the texture coordinates.
    pub texture: Option<Arc<Texture>>,
}

/// An sRGB picture, repeated beyond its borders.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels, row by row, 8-bit sRGB.
    pub rgb: Vec<u8>,
}

impl Material {
    /// An opaque dielectric of one colour.
    pub fn plain(base_color: [f32; 3], roughness: f32) -> Self {
        Self { base_color, roughness, metallic: 0.0, opacity: 1.0, ior: 1.5, thin_walled: false, texture: None }
    }

    /// A bare metal.
    pub fn metal(base_color: [f32; 3], roughness: f32) -> Self {
        Self { metallic: 1.0, ..Self::plain(base_color, roughness) }
    }
}

impl TriMesh {
    /// Corners of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.positions[index as usize].as_dvec3()))
    }

    /// Mean of the surface, weighted by area.
    pub fn centroid(&self) -> DVec3 {
        let (sum, area) = self.corners().fold((DVec3::ZERO, 0.0), |(sum, area), [a, b, c]| {
            let weight = (b - a).cross(c - a).length();
            (sum + (a + b + c) / 3.0 * weight, area + weight)
        });
        if area > 0.0 { sum / area } else { DVec3::ZERO }
    }

    /// Area-uniform points on the surface with outward normals, both in the mesh's frame.
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
